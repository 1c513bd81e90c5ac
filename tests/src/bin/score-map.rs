//! Scores a map against the truth of the generated drive that it was built
//! from.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use common::kitti::read_poses;
use waymark_tests::cli::{MapOfDrive, Outcome, ended};
use waymark_tests::map_score::{Found, MapScore, WITHIN_M, aligned, score};

/// Scores a map against the truth of the generated drive that it was built
/// from: recall, precision and errors by class.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    of: MapOfDrive,
    /// The poses that it was built with, from `mapper build --trajectory`: map
    /// and truth are then aligned by them (rigidly), as a survey that drifts
    /// gives a map that lies elsewhere.
    #[arg(long, value_name = "POSES.txt")]
    trajectory: Option<PathBuf>,
    /// What is farther from the driven path does not count, metres.
    #[arg(long, value_name = "M", default_value_t = WITHIN_M)]
    within: f64,
    /// Name each pole, sign, light and part of a lane line that is missing or
    /// wrong.
    #[arg(long)]
    list: bool,
}

fn main() -> ExitCode {
    ended(run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Outcome {
    let mut map = common::map::read(&arguments.of.map)?;
    let (truth, exact) = arguments.of.truth()?;
    if let Some(path) = &arguments.trajectory {
        map = aligned(&map, &read_poses(path)?, &exact);
    }
    print(&score(&map, &truth, &exact, arguments.within), arguments);
    Ok(())
}

fn print(score: &MapScore, arguments: &Arguments) {
    common::say!("{} within {} m of the path", arguments.of.map.display(), arguments.within);
    common::say!("{:14} {:>7} {:>9} {:>8} {:>10}  ", "", "recall", "precision", "true", "off, m RMS");
    let row = |name: &str, found: &Found, unit: &str| {
        let (recall, precision) = (found.recall(), found.precision());
        common::say!("{name:14} {recall:7.3} {precision:9.3} {:8.0} {:10.3}  {unit}", found.wanted, found.off_m);
    };
    row("poles", &score.poles, "feet, from above");
    row("trunks", &score.trunks, "of those that the map has: called so");
    row("signs", &score.signs, "centroids");
    row("lights", &score.lights, "centroids");
    row("lanes", &score.lanes, "across; true: metres");
    row("kerbs", &score.kerbs, "of roads without paint, likewise");
    row("marks", &score.marks, "the worse end of each, of dashed lines");
    common::say!(
        "poles: feet {:.3} m RMS in height, tilt {:.2} degrees RMS",
        score.foot_height_m,
        score.tilt_rad.to_degrees()
    );
    common::say!("lanes: {:.3} of the found length solid or dashed as it is", score.lane_kinds);
    if arguments.list {
        for pole in &score.missed {
            let [x, _, z] = pole.foot_map_m;
            common::say!("missed x {x:8.2}  z {z:8.2}  {}", pole.kind);
        }
        for pole in &score.wrong {
            common::say!("wrong  x {:8.2}  z {:8.2}  {}", pole.foot_map.x, pole.foot_map.z, pole.kind.name());
        }
        for sign in &score.missed_signs {
            let [x, y, z] = sign.centroid_map_m;
            common::say!("missed x {x:8.2}  z {z:8.2}  {}, y {y:.2}, {:.2} m large", sign.kind, sign.size_m);
        }
        for sign in &score.wrong_signs {
            let p = &sign.centroid_map;
            common::say!("wrong  x {:8.2}  z {:8.2}  {}, y {:.2}", p.x, p.z, sign.kind.name(), p.y);
        }
        for (what, stretches) in [("missed", &score.missed_lanes), ("wrong ", &score.wrong_lanes)] {
            for part in stretches {
                let (p, q) = (&part.from_map_m, &part.to_map_m);
                common::say!(
                    "{what} x {:8.2}  z {:8.2}  {}, {:.2} m to x {:.2}, z {:.2}",
                    p.x,
                    p.z,
                    part.name(),
                    part.length_m,
                    q.x,
                    q.z
                );
            }
        }
    }
}
