//! Makes an atlas as large as a country out of one map, and measures what a
//! localizer pays for it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, Subcommand};
use common::geometry::Pose;
use common::map::atlas::{Atlas, AtlasBuilder, AtlasOptions};
use common::map::decode_with_layout;
use localizer::local_map::{LocalMap, LocalMapConfig};
use mapper::inspect::road_length_m;
use nalgebra::{Point3, Vector3};
use waymark_tests::cli::{Outcome, ended};
use waymark_tests::map_score::moved;

/// Makes an atlas as large as a country out of one map, and measures what a
/// localizer pays for it.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Put copies of a map on a square grid of places; one stays where it was.
    Make {
        /// The map.
        #[arg(long, value_name = "MAP.csm")]
        map: PathBuf,
        /// Length of all roads together, kilometres.
        #[arg(long, value_name = "KM", default_value_t = 100_000.0)]
        km: f64,
        /// Distance of the places, metres.
        #[arg(long, value_name = "M", default_value_t = 1000.0)]
        spacing: f64,
        /// The atlas to write.
        #[arg(long, value_name = "ATLAS.csa")]
        out: PathBuf,
    },
    /// Open an atlas, look around at many places, and drive through it.
    Measure {
        /// The atlas.
        #[arg(long, value_name = "ATLAS.csa")]
        atlas: PathBuf,
        /// Places to look around at.
        #[arg(long, value_name = "N", default_value_t = 1000)]
        places: usize,
        /// Length of the drive along z from the origin, kilometres.
        #[arg(long, value_name = "KM", default_value_t = 20.0)]
        drive: f64,
    },
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse().command))
}

fn run(command: &Command) -> Outcome {
    match command {
        Command::Make { map, km, spacing, out } => make(map, *km, *spacing, out)?,
        Command::Measure { atlas, places, drive } => measure(atlas, *places, *drive)?,
    }
    Ok(())
}

fn make(map: &Path, km: f64, spacing_m: f64, out: &Path) -> common::Result<()> {
    let bytes = std::fs::read(map).map_err(common::Error::io(map))?;
    let (original, layout) = decode_with_layout(&bytes).map_err(common::Error::in_file(map))?;
    let copies = (km * 1e3 / road_length_m(&original).max(1.0)).ceil().max(1.0) as i64;
    let side = (copies as f64).sqrt().ceil() as i64;
    let started = Instant::now();
    let mut builder = AtlasBuilder::new(out, AtlasOptions::default());
    let mut road_m = 0.0;
    for copy in 0..copies {
        let place = |index: i64| (index - side / 2) as f64 * spacing_m;
        let moved = moved(&original, &Pose::translation(place(copy % side), 0.0, place(copy / side)));
        road_m += road_length_m(&moved);
        builder.add(&moved, layout.quantum_m)?;
    }
    let summary = builder.write(None)?;
    common::say!(
        "{copies} copies, {:.0} km: {} bytes in {} tiles, {} levels; {:.1} s, peak memory {:.1} MB",
        road_m / 1e3,
        summary.bytes,
        summary.counts.tiles,
        summary.levels,
        started.elapsed().as_secs_f64(),
        peak_mb(),
    );
    Ok(())
}

fn measure(path: &Path, places: usize, drive_km: f64) -> localizer::Result<()> {
    // The distance at which landmarks are seen, and the settings of a drive.
    let (reach_m, config) =
        (localizer::preselect::PreselectConfig::default().max_distance_m, LocalMapConfig::default());
    let at_rest_mb = peak_mb();
    let mut opening_us = Vec::new();
    let mut opening_bytes = 0;
    for _ in 0..100 {
        let started = Instant::now();
        let atlas = Atlas::open(path)?;
        opening_us.push(started.elapsed().as_secs_f64() * 1e6);
        opening_bytes = atlas.bytes_read();
    }
    let summary = Atlas::open(path)?.summary();
    common::say!(
        "{}: {} bytes, {} tiles, {} levels",
        path.display(),
        summary.bytes,
        summary.counts.tiles,
        summary.levels
    );
    common::say!("opening: {}; {opening_bytes} bytes read", times(opening_us));
    common::say!("peak memory over that of the program: {:.2} MB after opening", peak_mb() - at_rest_mb);

    let Some(bounds) = summary.bounds else { return Ok(()) };
    let size = bounds.max_map - bounds.min_map;
    let (mut start_us, mut roads) = (Vec::new(), Vec::new());
    let (mut tiles, mut bytes) = (0, 0);
    for place in 1..=places {
        // Evenly spread over the ground, the same in every run (the R2 sequence).
        let share = |ratio: f64| (ratio * place as f64).fract();
        let off = Vector3::new(share(0.754_877_666_246_692_8) * size.x, 0.0, share(0.569_840_290_998_053_3) * size.z);
        let started = Instant::now();
        let mut local = LocalMap::around(Atlas::open(path)?, &config);
        local.roads_near(&(bounds.min_map + off), reach_m, &mut roads)?;
        let took_us = started.elapsed().as_secs_f64() * 1e6;
        // Where there is nothing, nothing is paid.
        if !roads.is_empty() {
            start_us.push(took_us);
            let usage = local.usage().unwrap_or_default();
            tiles += usage.tiles_read;
            bytes += usage.bytes_read;
        }
    }
    let with_roads = start_us.len();
    let mean = |sum: f64| sum / with_roads.max(1) as f64;
    common::say!(
        "opening and what is within {reach_m} m, at the {with_roads} of {places} places that have roads: {}; {:.1} tiles, {:.0} bytes read on average",
        times(start_us),
        mean(tiles as f64),
        mean(bytes as f64),
    );

    let mut local = LocalMap::around(Atlas::open(path)?, &config);
    let mut frame_us = Vec::new();
    let step_m = 1.5;
    for frame in 0..(drive_km * 1e3 / step_m) as usize {
        let started = Instant::now();
        local.next_frame()?;
        local.roads_near(&Point3::new(0.0, 0.0, frame as f64 * step_m), reach_m, &mut roads)?;
        frame_us.push(started.elapsed().as_secs_f64() * 1e6);
    }
    let (frames, usage) = (frame_us.len(), local.usage().unwrap_or_default());
    common::say!("a drive of {drive_km} km, {frames} frames of {step_m} m: {} per frame", times(frame_us));
    common::say!(
        "  {} tiles and {} bytes read, at most {} tiles held",
        usage.tiles_read,
        usage.bytes_read,
        usage.most_held
    );
    common::say!("peak memory over that of the program: {:.2} MB at the end", peak_mb() - at_rest_mb);
    Ok(())
}

/// Median, 99th percentile and the longest.
fn times(mut us: Vec<f64>) -> String {
    us.sort_by(f64::total_cmp);
    let at = |share: f64| us.get(((us.len() as f64 * share) as usize).min(us.len().saturating_sub(1)));
    let [median, p99, most] = [0.5, 0.99, 1.0].map(|share| at(share).copied().unwrap_or(0.0));
    format!("median {median:.0} us, 99 % {p99:.0} us, longest {most:.0} us")
}

/// Most memory that this process has held, MB; 0 where the system does not say.
fn peak_mb() -> f64 {
    mapper::cli::usage::peak_bytes().unwrap_or(0) as f64 / 1e6
}
