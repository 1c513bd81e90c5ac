//! Merging the shards of a town, in one go and as a tree of merges: wall time,
//! peak memory, and whether the bytes are the same.
//!
//! ```sh
//! cargo bench -p mapper --bench shards             # 1,000 shards of 400 m
//! cargo bench -p mapper --bench shards -- 200      # another number
//! ```

// A bench may fall where a test may.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::time::Instant;

use common::map::{EncodeOptions, LaneKind, LaneLine, Pole, PoleKind, Road, RoadId, SemanticMap};
use mapper::merge::{MergeConfig, Sources, merge};
use nalgebra::{Point3, Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Edge of a block of the town, metres.
const BLOCK_M: f64 = 100.0;
/// Blocks driven along in one shard.
const BLOCKS: usize = 4;
/// Maps merged at a time in the tree.
const FAN: usize = 10;

fn main() {
    let shards = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(1000);
    let folder = tempfile::tempdir().unwrap();
    // As many streets as keep about five passes on each.
    let side = ((shards * BLOCKS) as f64 / 10.0).sqrt().ceil().max(2.0) as i64;
    let files: Vec<PathBuf> = (0..shards).map(|k| write(&shard(k as u64, side), folder.path(), k)).collect();
    let given: u64 = files.iter().map(|file| std::fs::metadata(file).unwrap().len()).sum();
    println!("{shards} shards of {} m over {side} x {side} blocks, {given} bytes", BLOCKS as f64 * BLOCK_M);

    let started = Instant::now();
    let at_once = folder.path().join("at_once.csm");
    let said = merge_files(&files, &at_once);
    println!("in one go: {:.1} s, peak memory {:.0} MB", started.elapsed().as_secs_f64(), peak_mb());
    println!("{said}{} bytes", std::fs::metadata(&at_once).unwrap().len());

    let started = Instant::now();
    let (mut level, mut merges) = (files, 0);
    while level.len() > 1 {
        let above = level.chunks(FAN).enumerate().map(|(k, inputs)| {
            let out = folder.path().join(format!("tree_{}_{k}.csm", level.len()));
            merge_files(inputs, &out);
            out
        });
        level = above.collect();
        merges += level.len();
    }
    println!(
        "as a tree of {merges} merges of {FAN}: {:.1} s, peak memory {:.0} MB",
        started.elapsed().as_secs_f64(),
        peak_mb()
    );
    assert_eq!(std::fs::read(&level[0]).unwrap(), std::fs::read(&at_once).unwrap(), "the bytes differ");
    println!("the bytes are the same");
}

/// `mapper merge`, as the command does it.
fn merge_files(files: &[PathBuf], out: &Path) -> String {
    let mut sources = Sources::default();
    for file in files {
        sources.add_file(file).unwrap();
    }
    let merged = merge(&sources.read().unwrap(), &MergeConfig::default());
    let bytes = match sources.only() {
        Some(bytes) => bytes.to_vec(),
        None => merged.map.encode(&EncodeOptions { quantum_m: merged.report.quantum_m }).unwrap(),
    };
    sources.write(out, &bytes).unwrap();
    merged.report.text()
}

fn write(map: &SemanticMap, folder: &Path, k: usize) -> PathBuf {
    let path = folder.join(format!("shard_{k}.csm"));
    std::fs::write(&path, map.encode(&EncodeOptions::default()).unwrap()).unwrap();
    path
}

/// Most memory that this process held so far.
fn peak_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
    line.trim().trim_end_matches("kB").trim().parse().unwrap_or(0.0) * 1024.0 / 1e6
}

/// A drive round some corners of the town: nine of ten landmarks, 2 cm off,
/// on a survey that is up to half a metre and 0.1 degrees off.
fn shard(seed: u64, side: i64) -> SemanticMap {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut map = SemanticMap { frame_note: "town".into(), ..SemanticMap::default() };
    let mut at = (random.random_range(0..=side), random.random_range(0..=side));
    let mut came_from = at;
    for _ in 0..BLOCKS {
        let ways = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(x, z)| (at.0 + x, at.1 + z));
        let is_way = |to: &&(i64, i64)| **to != came_from && (0..=side).contains(&to.0) && (0..=side).contains(&to.1);
        let open: Vec<&(i64, i64)> = ways.iter().filter(is_way).collect();
        let to = *open[random.random_range(0..open.len())];
        block(at, to, &mut map, &mut random);
        (came_from, at) = (at, to);
    }
    let mut off = || random.random_range(-0.25..0.25);
    let (shift, turn) = (Vector3::new(off(), 0.2 * off(), off()), off() * 0.008);
    let about = map.poles.first().map_or_else(Point3::origin, |pole| pole.foot_map);
    let survey = |p: &mut Point3<f64>| {
        *p = about + Rotation3::from_axis_angle(&Vector3::y_axis(), turn) * (*p - about) + shift;
    };
    for pole in &mut map.poles {
        survey(&mut pole.foot_map);
        survey(&mut pole.top_map);
    }
    map.lanes.iter_mut().flat_map(|lane| &mut lane.points_map).for_each(survey);
    map.roads.iter_mut().flat_map(|road| &mut road.path_map).for_each(survey);
    map
}

/// A street between two corners: what stands there depends on the street only,
/// what is seen of it on the pass.
fn block(from: (i64, i64), to: (i64, i64), map: &mut SemanticMap, pass: &mut Pcg64Mcg) {
    let corner = |c: (i64, i64)| Point3::new(c.0 as f64 * BLOCK_M, 0.0, c.1 as f64 * BLOCK_M);
    let (low, high) = (from.min(to), from.max(to));
    let along = (corner(high) - corner(low)).normalize();
    let right = Vector3::new(along.z, 0.0, -along.x);
    let place = |station: f64, offset: f64, y: f64| corner(low) + along * station + right * offset + Vector3::y() * y;
    let name = (low.0 * 4096 + low.1) * 2 + i64::from(low.0 == high.0);
    let mut street = Pcg64Mcg::seed_from_u64(name.cast_unsigned());
    let first = map.roads.len() as u32;
    let half = 0.5 * BLOCK_M;
    let driven = if from == low { [0.0, half, BLOCK_M] } else { [BLOCK_M, half, 0.0] };
    let road_at = |station: f64| RoadId(first + u32::from((station < half) != (from == low)));
    for pair in driven.windows(2) {
        map.roads.push(Road { path_map: vec![place(pair[0], 0.0, 0.0), place(pair[1], 0.0, 0.0)] });
    }
    for k in 0..14 {
        let station = 12.0 + f64::from(k / 2) * 11.5 + street.random_range(-3.0..3.0);
        let offset = (6.0 + street.random_range(-1.0..1.0)) * if k % 2 == 0 { 1.0 } else { -1.0 };
        let height_m = street.random_range(1.0..7.0);
        let mut noise = || pass.random_range(-0.03..0.03);
        let foot_map = place(station + noise(), offset + noise(), 1.6 + noise());
        if pass.random_range(0.0..1.0) < 0.9 {
            let (kind, top_map) = (PoleKind::LampPost, foot_map - Vector3::y() * height_m);
            map.poles.push(Pole { kind, foot_map, top_map, road: road_at(station) });
        }
    }
    for (offset, kind) in [(-3.5, LaneKind::Solid), (0.0, LaneKind::Dashed), (3.5, LaneKind::Solid)] {
        for (start, end) in [(8.0, half), (half, BLOCK_M - 8.0)] {
            if pass.random_range(0.0..1.0) < 0.9 {
                let points_map = vec![place(start, offset, 1.6), place(end, offset, 1.6)];
                map.lanes.push(LaneLine { kind, points_map, road: road_at(0.5 * (start + end)), marks_m: Vec::new() });
            }
        }
    }
}
