use common::geometry::{Pose, local};

use super::*;
use crate::gps::{GpsConfig, simulate};
use crate::testing::{IMAGE, Recipe, World};

struct Run {
    errors_m: Vec<f64>,
    statuses: Vec<Status>,
}

fn run(world: &World, config: &Config, gps: &GpsConfig, seed: u64, hide: impl Fn(usize) -> bool) -> Run {
    let index = RoadIndex::new(&world.map);
    let fixes = simulate(&world.truth[..gps.simulated_fixes], gps, seed);
    let mut tracker = Tracker::new(&world.map, &index, &world.camera, IMAGE, config);
    let (mut errors_m, mut statuses) = (Vec::new(), Vec::new());
    for frame in 0..world.truth.len() {
        let features = if hide(frame) { Features::default() } else { world.features(frame) };
        let input = FrameInput { time_s: world.time_s(frame), features: &features, gps: fixes.get(frame) };
        let estimate = tracker.step(&input).unwrap();
        errors_m.push(off_m(&world.truth[frame], &estimate.map_from_camera));
        statuses.push(estimate.status);
    }
    Run { errors_m, statuses }
}

fn off_m(truth: &Pose, estimate: &Pose) -> f64 {
    local(truth, estimate).fixed_rows::<3>(0).norm()
}

fn rms(errors_m: &[f64]) -> f64 {
    (errors_m.iter().map(|e| e * e).sum::<f64>() / errors_m.len() as f64).sqrt()
}

#[test]
#[ignore]
fn explore() {
    for (name, recipe) in [
        ("street", Recipe::default()),
        ("nolane", Recipe { lanes_m: &[], ..Recipe::default() }),
        ("sparse", Recipe { pole_spacing_m: 30.0, ..Recipe::default() }),
        ("clutter", Recipe { false_poles: 10, missed: 0.5, ..Recipe::default() }),
    ] {
        for (gname, gps) in [("1.5", GpsConfig::default()), ("3.5", GpsConfig { horizontal_sigma_m: 3.5, heading_sigma_deg: 17.0, ..Default::default() })] {
            let world = World::new(recipe);
            for seed in 0..6 {
                let t = std::time::Instant::now();
                let run = run(&world, &Config::default(), &gps, seed, |_| false);
                let ms = t.elapsed().as_secs_f64() * 1e3 / run.errors_m.len() as f64;
                let first_ok = run.statuses.iter().position(|s| *s == Status::Ok);
                let count = |s| run.statuses.iter().filter(|x| **x == s).count();
                let lie = run.statuses.iter().zip(&run.errors_m).filter(|(s, e)| **s == Status::Ok && **e > 0.5).count();
                println!("{name} gps {gname} seed {seed}: rms(10..) {:.3} max {:.2} e0 {:.2} e1 {:.2} e5 {:.2} first ok {first_ok:?} ok {} deg {} lost {} lies {lie}  {ms:.2} ms/frame",
                    rms(&run.errors_m[10..]), run.errors_m[10..].iter().fold(0.0_f64, |a, b| a.max(*b)), run.errors_m[0], run.errors_m[1], run.errors_m[5],
                    count(Status::Ok), count(Status::Degraded), count(Status::Lost));
            }
        }
    }
}

#[test]
#[ignore]
fn explore_search() {
    use crate::solver::Prior;
    for (name, recipe) in [("street", Recipe::default()), ("nolane", Recipe { lanes_m: &[], ..Recipe::default() }), ("sparse", Recipe { pole_spacing_m: 30.0, ..Recipe::default() })] {
        let world = World::new(recipe);
        let index = RoadIndex::new(&world.map);
        let config = Config::default();
        for frame in [0, 1, 50, 100, 150, 200] {
            let gps = GpsConfig::default();
            let fix = simulate(&world.truth[frame..=frame], &gps, frame as u64 + 7)[0];
            let mut tracker = Tracker::new(&world.map, &index, &world.camera, IMAGE, &config);
            let features = world.features(frame);
            tracker.prepared.fill(&features);
            let rough = tracker.rough_from(&fix);
            let reach = Reach { position_m: 6.0, angle_rad: 0.1 };
            tracker.select(&rough.map_from_camera, &reach);
            let scene = Scene { camera: &world.camera, image: IMAGE, features: &tracker.prepared, candidates: &tracker.candidates, noise: &config.noise, detection: &config.detection };
            let mut a = Associator::default();
            let prior = Prior::new(rough.map_from_camera, &rough.covariance()).unwrap();
            let s = Vector6::new(0.1, 0.1, 0.1, 0.01, 0.01, 0.01);
            let g = Matrix6::from_diagonal(&s.component_mul(&s));
            let truth = &world.truth[frame];
            println!("{name} frame {frame}: gps off {:.2}; features {} poles {} lanes {} signs; candidates {} {} {}", off_m(truth, &rough.map_from_camera), features.poles.len(), features.lanes.len(), features.signs.len(), scene.candidates.poles.len(), scene.candidates.lanes.len(), scene.candidates.signs.len());
            let show = |label: &str, r: &crate::associate::robust::Refined| {
                let e = local(truth, &r.map_from_camera);
                println!("   {label}: evidence {:.1} support {:.1} prior {:.1} occam {:.1} matches {} ms {:.2} | off r {:.2} d {:.2} f {:.2} p {:.3} y {:.3} r {:.3}", r.evidence(), r.support, r.prior_cost, r.occam, r.matches, r.mean_square, e[0], e[1], e[2], e[3], e[4], e[5]);
            };
            let r = a.refine(&scene, truth, &g, &prior, &config.robust, &config.solver).unwrap();
            show("truth", &r);
            let mut all: Vec<_> = a.matcher.matches.iter().map(|m| format!("{:?}/{} {:.1}", m.landmark, m.feature, m.support)).collect();
            all.sort();
            println!("      {}", all.join(", "));
            let mut search = Search::default();
            let found = search.run(&scene, &rough, &mut a, &config.start, &config.robust, &config.solver);
            for r in found.iter().take(4) { show("found", r); }
            println!("   cells: best {:.1}; truth cell rank {:?}", search.cells()[0].0, search.cells().iter().position(|(_, p)| { let e = local(truth, p); e[0].abs() < 0.4 && e[2].abs() < 0.4 && e[4].abs() < 0.02 }));
        }
    }
}

#[test]
#[ignore]
fn explore_trace() {
    let recipe = Recipe { false_poles: 10, missed: 0.5, ..Recipe::default() };
    let world = World::new(recipe);
    let index = RoadIndex::new(&world.map);
    let config = Config::default();
    let gps = GpsConfig::default();
    let fixes = simulate(&world.truth[..2], &gps, 0);
    let mut tracker = Tracker::new(&world.map, &index, &world.camera, IMAGE, &config);
    for frame in 0..world.truth.len() {
        let features = world.features(frame);
        let input = FrameInput { time_s: world.time_s(frame), features: &features, gps: fixes.get(frame) };
        let estimate = tracker.step(&input).unwrap();
        let e = local(&world.truth[frame], &estimate.map_from_camera);
        let b = &tracker.bank[0];
        let s = estimate.sigmas();
        println!("{frame} err {:.2} {:.2} {:.2} yaw {:.3} {} sup {:.1} ev {:.1} lw {:.1} age {} ms {:.2} m {} bank {} margin {:.1} sig {:.2} {:.2} v {:.1} 2nd {:?}", e[0], e[1], e[2], e[4], estimate.status, estimate.support, b.evidence, b.log_weight, b.age_frames, b.mean_square, estimate.correspondences.len(), tracker.bank.len(), estimate.margin, s[0], s[2], b.state.velocity[2], tracker.bank.get(1).map(|b| { let e = local(&world.truth[frame], &b.state.map_from_camera); format!("lw {:.1} err {:.2} {:.2}", b.log_weight, e[0], e[2]) }));
    }
}
