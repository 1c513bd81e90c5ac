//! The images tell how the camera moved.

use localizer::camera::Source;
use localizer::config::Config;
use localizer::drive::Drive;
use localizer::watch::{Delivery, motion, watch};

use crate::support::{run, text};

#[test]
fn speed_and_turn_come_from_the_images_of_a_drive() {
    let folder = tempfile::tempdir().unwrap();
    let (drive, csv) = (folder.path().join("drive"), folder.path().join("motion.csv"));
    run("fixtures", &["generate", "--world", "street", "--frames", "8", "--images", "--out", text(&drive)]).ok();
    let truth = drive.join("truth/poses.txt");
    let words = ["motion", "--kitti", text(&drive), "--sequence", "00", "--out", text(&csv), "--truth"];
    let said = run("localizer", &[&words[..], &[text(&truth)]].concat()).ok();
    assert!(said.contains("pitch rate, rad/s off by 0.00") && said.contains("roll rate, rad/s"), "{said}");
    // One speed alone is not believed.
    assert!(said.starts_with("7 steps: turn told in 7, speed in 6; "), "{said}");
    let poses = common::kitti::read_poses(&truth).unwrap();
    let written = std::fs::read_to_string(&csv).unwrap();
    let rows: Vec<&str> = written.lines().skip(1).collect();
    assert_eq!(rows.len(), 7);
    assert!(rows[0].contains(",,"), "{}", rows[0]);
    for (row, pair) in rows.iter().zip(poses.windows(2)).skip(1) {
        let values: Vec<f64> = row.split(',').map(|value| value.parse().unwrap()).collect();
        let moved = pair[0].inverse() * pair[1];
        let speed_m_s = 10.0 * moved.translation.vector.z;
        assert!((values[1] / speed_m_s - 1.0).abs() < 0.1, "{row}: {speed_m_s}");
        assert!((values[2] + 10.0 * moved.rotation.scaled_axis().y).abs() < 0.01, "{row}");
    }
    let nowhere = folder.path().join("nowhere.txt");
    run("localizer", &[&words[..], &[text(&nowhere)]].concat()).refused(&["nowhere.txt", "No such file"]);
}

#[test]
fn a_missing_image_costs_what_it_alone_would_tell() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("drive");
    run("fixtures", &["generate", "--world", "street", "--frames", "8", "--images", "--out", text(&root)]).ok();
    for missing in [0, 4] {
        std::fs::remove_file(root.join(format!("sequences/00/image_2/{missing:06}.png"))).unwrap();
    }
    let labels = root.join("sequences/00/labels_2");
    let widest_px = Config::default().vision.widest_px;
    let drive = Drive::open(&root, "00", Some(&labels), 0, None, widest_px).unwrap();
    let (config, times_s) = (Config::default(), &drive.times_s);
    let watched = watch(&drive, drive.frames.clone(), &Source::Labels(labels.clone()), false, &config, |_, _| Ok(()))
        .unwrap()
        .motion;
    let delivered = |&frame: &usize| Delivery { time_s: times_s[frame], frame: Some(frame) };
    let deliveries: Vec<Delivery> = drive.frames.iter().map(delivered).collect();
    assert_eq!(motion(&drive, Some(&labels), &deliveries, &config).unwrap(), watched);
    let poses = common::kitti::read_poses(root.join("truth/poses.txt")).unwrap();
    let turn = (poses[5].inverse() * poses[6]).rotation.scaled_axis() / (times_s[6] - times_s[5]);
    let [pitch_rad_s, roll_rad_s] = watched.log.between(times_s[5], times_s[6]).unwrap().sway_rad_s.unwrap();
    assert!((pitch_rad_s - turn.x).abs() < 0.01 && (roll_rad_s - turn.z).abs() < 0.01, "{pitch_rad_s} {roll_rad_s}");
    let speed_m_s = |from: usize, to: usize| watched.log.between(times_s[from], times_s[to])?.speed_m_s;
    assert!(speed_m_s(2, 3).is_some() && speed_m_s(3, 5).is_some() && speed_m_s(6, 7).is_some());
    assert!(watched.log.between(times_s[0], times_s[1]).is_none());
    // Without any, label images tell the turn, but not where wheels tell it better.
    std::fs::remove_dir_all(root.join("sequences/00/image_2")).unwrap();
    let drive = Drive::open(&root, "00", Some(&labels), 0, None, widest_px).unwrap();
    for has_wheels in [false, true] {
        let source = Source::Labels(labels.clone());
        let log = watch(&drive, drive.frames.clone(), &source, has_wheels, &config, |_, _| Ok(())).unwrap().motion.log;
        assert_eq!(log.is_empty(), has_wheels);
    }
}
