use std::path::Path;

use common::geometry::{Pose, Tangent, retract};
use common::map::EncodeOptions;
use common::trajectory::Trajectory;

use super::*;
use crate::testing::{Recipe, World, time_s};
use crate::vision::labels;
use crate::vision::{Class, Plane, ProbabilityMaps};

fn run_words(words: &str) -> Result<bool> {
    let cli = Cli::try_parse_from(std::iter::once("localizer").chain(words.split_whitespace())).unwrap();
    dispatch(&cli.command)
}

/// Draws a line into a probability map.
fn draw(plane: &mut Plane, from: (f64, f64), to: (f64, f64), half_width: i64) {
    let (width, height) = (plane.width() as i64, plane.height() as i64);
    let steps = (to.0 - from.0).hypot(to.1 - from.1).ceil().max(1.0) as i64;
    for i in 0..=steps {
        let share = i as f64 / steps as f64;
        let (u, v) = (from.0 + (to.0 - from.0) * share, from.1 + (to.1 - from.1) * share);
        for x in u.round() as i64 - half_width..=u.round() as i64 + half_width {
            let y = v.round() as i64;
            if (0..width).contains(&x) && (0..height).contains(&y) {
                plane.data_mut()[(y * width + x) as usize] = 230;
            }
        }
    }
}

/// A drive in KITTI layout with its map and probability images, made up; returns the words
/// that name them.
fn write_drive(folder: &Path, frames: usize) -> String {
    write_drive_of(folder, frames, 1);
    let at = folder.display();
    format!("--map {at}/90.csm --kitti {at}/kitti --sequence 90 --labels {at}/labels")
}

/// The same with so many times the pixels across and down.
fn write_drive_of(folder: &Path, frames: usize, pixels: usize) {
    let world = World::new(Recipe { missed: 0.05, false_poles: 1, length_m: 60.0, ..Recipe::default() });
    let sequence = folder.join("kitti/sequences/90");
    std::fs::create_dir_all(&sequence).unwrap();
    std::fs::create_dir_all(folder.join("kitti/poses")).unwrap();
    let times_s: Vec<f64> = (0..frames).map(time_s).collect();
    common::kitti::write_times(sequence.join("times.txt"), &times_s).unwrap();
    common::kitti::write_poses(folder.join("kitti/poses/90.txt"), &world.truth[..frames]).unwrap();
    let camera = world.camera.stretched(pixels as f64, pixels as f64);
    let calibration = common::kitti::Calibration { cameras: [camera; 4], camera_from_velodyne: Pose::identity() };
    common::kitti::write_calibration(sequence.join("calib.txt"), &calibration).unwrap();
    common::map::write(folder.join("90.csm"), &world.map, &EncodeOptions::default()).unwrap();
    for frame in 0..frames {
        let features = world.features(frame);
        let mut maps = ProbabilityMaps::zeros(1226, 370);
        let mut poles = maps.plane(Class::Pole).clone();
        for pole in &features.poles {
            draw(&mut poles, (pole.upper_px.x, pole.upper_px.y), (pole.lower_px.x, pole.lower_px.y), 2);
        }
        maps.set(Class::Pole, poles).unwrap();
        let mut lanes = maps.plane(Class::Lane).clone();
        for lane in &features.lanes {
            for ends in lane.points_px.windows(2) {
                draw(&mut lanes, (ends[0].x, ends[0].y), (ends[1].x, ends[1].y), 4);
            }
        }
        maps.set(Class::Lane, lanes).unwrap();
        labels::write(&folder.join("labels"), frame, &maps.resized((1226 * pixels, 370 * pixels))).unwrap();
    }
}

#[test]
fn a_camera_with_more_pixels_is_looked_at_as_networks_do() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().display();
    write_drive_of(folder.path(), 20, 2);
    let drive = format!("--map {at}/90.csm --kitti {at}/kitti --sequence 90 --labels {at}/labels");
    assert!(run_words(&format!("run {drive} --gps-seed 3 --out {at}/out --save-labels {at}/saved")).unwrap());
    let estimates = crate::output::read_estimates(&folder.path().join("out/estimates.csv")).unwrap();
    let truth = common::kitti::read_poses(folder.path().join("kitti/poses/90.txt")).unwrap();
    let truth: Vec<Option<Pose>> = truth.into_iter().map(Some).collect();
    let report = crate::eval::score(&estimates[5..], &truth, &[]).unwrap();
    assert!(report.rms_position_m < 0.35, "{} m", report.rms_position_m);
    // What is saved has the size of the images, so that it can be given instead.
    assert_eq!(labels::size(&folder.path().join("saved"), 0).unwrap(), (2452, 740));
    let saved = drive.replace("/labels", "/saved");
    assert!(run_words(&format!("run {saved} --gps-seed 3 --out {at}/again")).unwrap());
    let config = folder.path().join("as_taken.toml");
    std::fs::write(&config, "[vision]\nwidest_px = 10000\n").unwrap();
    assert!(run_words(&format!("run {drive} --config {} --gps-seed 3 --out {at}/large", config.display())).unwrap());
    let estimates = |out: &str| std::fs::read(folder.path().join(out).join("estimates.csv")).unwrap();
    assert_ne!(estimates("out"), estimates("large"));
}

#[test]
fn a_drive_is_localized_and_scored_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().display();
    let drive = write_drive(folder.path(), 30);
    // Has no images to draw on, and is localized all the same.
    assert!(run_words(&format!("run {drive} --gps-seed 3 --out {at}/out --overlay {at}/drawn")).unwrap());
    let estimates = crate::output::read_estimates(&folder.path().join("out/estimates.csv")).unwrap();
    let truth: Vec<Option<Pose>> =
        common::kitti::read_poses(folder.path().join("kitti/poses/90.txt")).unwrap().into_iter().map(Some).collect();
    let report = crate::eval::score(&estimates[5..], &truth, &[]).unwrap();
    assert!(report.rms_position_m < 0.35, "{} m", report.rms_position_m);
    for estimate in ["out", "out/estimates.csv", "out/poses.txt"] {
        let eval = format!("eval --estimate {at}/{estimate} --truth {at}/kitti/poses/90.txt");
        assert!(run_words(&eval).unwrap() && run_words(&format!("{eval} --json")).unwrap());
    }
    let tum = format!("eval --estimate {at}/out/poses.tum --truth {at}/kitti/poses/90.txt");
    let said = run_words(&tum).unwrap_err().to_string();
    assert!(said.contains("poses.tum: its lines have times") && said.contains("`--times`"), "{said}");
    let times = format!("--times {at}/kitti/sequences/90/times.txt");
    assert!(run_words(&format!("{tum} {times}")).unwrap());
    // And the truth may be one, too: here the estimate itself.
    let same = format!("eval --estimate {at}/out --truth {at}/out/poses.tum");
    assert!(run_words(&same).unwrap_err().to_string().contains("`--times`"));
    assert!(run_words(&format!("{same} {times}")).unwrap());
    // Frames of no true pose do not count, in whatever form the estimate is.
    let rows = std::fs::read_to_string(folder.path().join("kitti/poses/90.txt")).unwrap();
    std::fs::write(folder.path().join("10.txt"), rows.split_inclusive('\n').take(10).collect::<String>()).unwrap();
    for estimate in ["out", "out/poses.tum"] {
        assert!(run_words(&format!("eval --estimate {at}/{estimate} --truth {at}/10.txt {times}")).unwrap());
    }
    assert!(run_words(&format!("trial {drive} --draws 1")).unwrap());
    // Two frames are the start, and nothing of no draw is scored.
    let start = run_words(&format!("trial {drive} --draws 1 --last 1")).unwrap_err().to_string();
    assert!(start.contains("only 2 of the frames were localized, and the first 2,"), "{start}");
    let none = Cli::try_parse_from(format!("localizer trial {drive} --draws 0").split_whitespace());
    assert!(none.unwrap_err().to_string().contains("--draws"));
    let motion = format!("motion --kitti {at}/kitti --sequence 90 --labels {at}/labels");
    assert!(run_words(&format!("{motion} --truth {at}/kitti/poses/90.txt --out {at}/motion.csv")).unwrap());
    // The same input gives the same bytes.
    assert!(run_words(&format!("run {drive} --gps-seed 3 --out {at}/again")).unwrap());
    let bytes = |out: &str, name: &str| std::fs::read(folder.path().join(out).join(name)).unwrap();
    for name in ["estimates.csv", "matches.csv", "poses.txt", "poses.tum"] {
        assert_eq!(bytes("out", name), bytes("again", name), "{name}");
    }
}

#[test]
fn wrong_input_gets_its_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().display();
    write_drive(folder.path(), 3);
    let drive = format!("--map {at}/90.csm --kitti {at}/kitti --sequence 90");
    let labels = format!("--labels {at}/labels");
    let message = |words: &str| run_words(words).unwrap_err().to_string();
    assert!(message(&format!("run {drive} {labels}")).contains("--out"));
    assert!(message(&format!("run {drive} --out {at}/o")).contains("--pole-net"));
    // What the paper's method would pass over.
    let paper = format!("{drive} {labels} --method paper");
    let odometry = format!("--odometry {at}/no.csv");
    assert!(message(&format!("run {paper} {odometry} --out {at}/o")).contains("`--odometry` would change nothing"));
    assert!(message(&format!("trial {paper} {odometry}")).contains("`--odometry` would change nothing"));
    let fused = format!("run {paper} --gps {at}/gps.txt --fuse-gps --out {at}/o");
    assert!(message(&fused).contains("`--fuse-gps` would change nothing"));
    std::fs::write(folder.path().join("fuse.toml"), "[gps]\nfuse = true\n").unwrap();
    let set = format!("trial {paper} --config {at}/fuse.toml");
    assert!(message(&set).contains("`gps.fuse` would change nothing"));
    assert!(message(&format!("run --map {at}/no.csm --kitti {at}/kitti {labels} --out {at}/o")).contains("no.csm"));
    assert!(message(&format!("run {drive} {labels} --first 7 --out {at}/o")).contains("0 to 2"));
    assert!(message(&format!("run {drive} --labels {at}/nowhere --out {at}/o")).contains("nowhere"));
    std::fs::write(folder.path().join("gps.txt"), "0.0 1 2\n").unwrap();
    assert!(message(&format!("run {drive} {labels} --gps {at}/gps.txt --out {at}/o")).contains("line 1"));
    std::fs::write(folder.path().join("gps.txt"), "").unwrap();
    let none = message(&format!("run {drive} {labels} --gps {at}/gps.txt --out {at}/o"));
    assert!(none.contains("gps.txt has no fix of the frames 0 to 2"), "{none}");
    std::fs::write(folder.path().join("c.toml"), "[robust]\nmax_runds = 3\n").unwrap();
    assert!(message(&format!("run --config {at}/c.toml")).contains("max_rounds"));
    let eval = format!("eval --estimate {at}/kitti/poses/90.txt --truth {at}/kitti/poses/90.txt --first 9");
    assert!(message(&eval).contains("share no frame from 9 on"));
    assert!(message(&format!("{eval} --last 12")).contains("share no frame from 9 to 12"));
    std::fs::write(folder.path().join("none.txt"), "# no pose\n").unwrap();
    let poses = format!("{at}/kitti/poses/90.txt");
    for (estimate, truth) in [(format!("{at}/none.txt"), poses.clone()), (poses, format!("{at}/none.txt"))] {
        assert!(message(&format!("eval --estimate {estimate} --truth {truth}")).contains("none.txt holds no pose"));
    }
    for backward in [eval, format!("run {drive} {labels} --first 9 --out {at}/o")] {
        assert!(message(&format!("{backward} --last 4")).contains("`--first` is after `--last`"));
    }
    assert!(!folder.path().join("o").exists());
    // Found before the drive is, which is not there.
    std::fs::write(folder.path().join("file"), "").unwrap();
    for out in ["--out AT/file", "--out AT/file/o", "--out AT/o --overlay AT/file", "--out AT/o --save-labels AT/file"]
    {
        let words = format!("run --map {at}/no.csm --kitti {at}/no {labels} {out}").replace("AT", &at.to_string());
        assert!(message(&words).contains("file is a file; give another folder"), "{out}");
    }
    let motion = format!("motion --kitti {at}/no --out {at}/nowhere/motion.csv");
    assert!(message(&motion).contains("nowhere does not exist; create it first"));
    let still = format!("motion --kitti {at}/kitti --sequence 90 {labels} --last 0 --out {at}/o");
    assert!(message(&still).contains("the frames show no motion"));
    assert!(!folder.path().join("o").exists());
    assert!(message(&format!("segment --kitti {at}/no --out {at}/file")).contains("file is a file"));
}

#[test]
fn a_gps_file_starts_as_the_simulation_does() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().display();
    write_drive(folder.path(), 12);
    let truth = common::kitti::read_poses(folder.path().join("kitti/poses/90.txt")).unwrap();
    let off: Vec<Pose> =
        truth[..2].iter().map(|pose| retract(pose, &Tangent::new(1.0, 0.0, -1.2, 0.0, 0.02, 0.0))).collect();
    Trajectory::from_poses(&off, &[0.0, 0.1]).write_tum(folder.path().join("gps.txt")).unwrap();
    let drive = format!("--map {at}/90.csm --kitti {at}/kitti --sequence 90 --labels {at}/labels");
    assert!(run_words(&format!("run {drive} --gps {at}/gps.txt --out {at}/out")).unwrap());
    let last = *crate::output::read_estimates(&folder.path().join("out/estimates.csv")).unwrap().last().unwrap();
    assert!(common::geometry::local(&truth[11], &last.map_from_camera).norm() < 0.5);
}

#[test]
fn all_settings_survive_their_file() {
    let text = common::config::to_toml(&Config::default()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("all.toml");
    std::fs::write(&path, text).unwrap();
    assert_eq!(common::config::load::<Config>(&path).unwrap(), Config::default());
    assert!(run_words(&format!("run --config {} --print-config", path.display())).unwrap());
}

#[test]
fn what_would_be_misread_or_written_over_is_told_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().display();
    let drive = write_drive(folder.path(), 3) + &format!(" --out {at}/o");
    let message = |words: &str| run_words(&format!("run {drive} {words}")).unwrap_err().to_string();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    // Speeds of other units, or in another column, are numbers, too.
    for names in ["t_s,speed_km_h,yaw_rate_deg_s", "t_s,yaw_rate_rad_s,speed_m_s"] {
        write("wheels.csv", &format!("# a log\n{names}\n0.0,1,0\n0.1,1,0\n0.2,1,0\n"));
        let said = message(&format!("--odometry {at}/wheels.csv"));
        assert!(said.contains(names) && said.contains("line 2") && said.contains("in this order"), "{said}");
    }
    write("wheels.csv", "\"t_s\",\"speed_m_s\",\"yaw_rate_rad_s\"\n0.0,1,0\n0.1,1,0\n0.2,1,0\n");
    assert!(run_words(&format!("run {drive} --odometry {at}/wheels.csv")).unwrap());
    write("gps.csv", "t_s,x_m,y_m,z_m\n0.0,1,2\n");
    assert!(message(&format!("--gps {at}/gps.csv")).contains("line 2 has 3 columns"));
    let over = message(&format!("--save-labels {at}/kitti/../labels"));
    assert!(over.contains("`--save-labels` would write over the images"), "{over}");
    // Nothing of these three is found after all images.
    std::fs::rename(folder.path().join("kitti/poses"), folder.path().join("kitti/hidden")).unwrap();
    let untrue = message("");
    assert!(untrue.contains("90.txt is missing") && untrue.contains("`--gps`"), "{untrue}");
    // Masks of 0 and 1.
    for frame in 0..3 {
        let maps = labels::read(&folder.path().join("labels"), frame, None).unwrap();
        let mut masks = ProbabilityMaps::zeros(maps.width(), maps.height());
        for class in Class::ALL {
            let mask = maps.plane(class).data().iter().map(|value| u8::from(*value > 127)).collect();
            masks.set(class, Plane::new(maps.width(), mask).unwrap()).unwrap();
        }
        labels::write(&folder.path().join("labels"), frame, &masks).unwrap();
    }
    write("gps.txt", "0.0 0 0 0\n");
    let faint = message(&format!("--gps {at}/gps.txt"));
    assert!(faint.contains("over 1 of 255") && faint.contains("labels"), "{faint}");
}
