//! Streets laid along real trajectories with their measured poles (KITTI 00, 04
//! and 07): the files that belong together are accepted and no others, poles
//! stand where they were measured, and drives go where the real ones went.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use common::kitti;
use fixtures::Error;
use fixtures::drive::Drive;
use fixtures::landmark::Landmark;
use fixtures::world::survey_street::files::{self, pole_in_world, world_from_survey};
use fixtures::world::{World, WorldSpec};
use nalgebra::Point3;
use waymark_tests::data;
use waymark_tests::map_score::{aligned, score};

use crate::support::{build, run, text};

const DRIVES: [&str; 3] = ["00", "04", "07"];

fn poses(root: &Path, drive: &str) -> PathBuf {
    root.join(format!("kitti/poses/{drive}.txt"))
}

fn poles(root: &Path, drive: &str) -> PathBuf {
    root.join(format!("kitti/pole_maps/{drive}.csv"))
}

#[test]
fn poses_and_poles_of_one_drive_belong_together_and_no_others() {
    let Some(root) = data::folder() else { return };
    for of_poses in DRIVES {
        for of_poles in DRIVES {
            let read = files::read(Some(&poses(&root, of_poses)), Some(&poles(&root, of_poles)));
            if of_poses == of_poles {
                let (near, covered) = read.unwrap().shares();
                assert!(near > 0.95 && covered > 0.95, "{of_poses}: {near} {covered}");
            } else {
                assert!(matches!(read, Err(Error::NotTogether { .. })), "poses {of_poses}, poles {of_poles}");
            }
        }
    }
}

#[test]
fn drives_go_where_the_real_ones_went_past_the_poles_that_were_measured() {
    let Some(root) = data::folder() else { return };
    for name in ["04", "07"] {
        let spec = WorldSpec {
            poses: Some(poses(&root, name)),
            poles: Some(poles(&root, name)),
            ..WorldSpec::named("from-survey", 1)
        };
        let world = World::new(&spec).unwrap();
        let real = kitti::read_poses(poses(&root, name)).unwrap();
        assert_eq!(world.frames, real.len());
        let drive = Drive::new(&world, world.frames, 1, 0);
        let way: Vec<_> = real.iter().map(|pose| world_from_survey(&Point3::from(pose.translation.vector))).collect();
        let plan = |pose: &common::geometry::Pose, i: usize| {
            (pose.translation.vector.x - way[i].x).hypot(pose.translation.vector.y - way[i].y)
        };
        let mut offsets: Vec<f64> = Vec::new();
        for (frame, pose) in drive.world_from_camera.iter().enumerate() {
            // Drivers hold a speed to 3 %: in time within half a second.
            assert!(plan(pose, frame) < 7.0, "{name}, frame {frame}: {} m", plan(pose, frame));
            // They wander in their lane by 12 cm, whenever they are there.
            let segment_m = way.windows(2).map(|pair| {
                let (a, way) = (pair[0].truncate(), (pair[1] - pair[0]).truncate());
                let to = fixtures::landmark::from_point(Point3::from(pose.translation.vector)).truncate() - a;
                (to - way * (to.dot(way) / way.length_squared().max(1e-12)).clamp(0.0, 1.0)).length()
            });
            offsets.push(segment_m.fold(f64::INFINITY, f64::min));
        }
        offsets.sort_by(f64::total_cmp);
        let (median_m, most_m) = (offsets[offsets.len() / 2], offsets[offsets.len() - 1]);
        assert!(median_m < 0.15 && most_m < 0.6, "{name}: {median_m} m and up to {most_m} m beside the real way");

        let text = std::fs::read_to_string(poles(&root, name)).unwrap();
        let (mut rows, mut met) = (0, 0);
        for row in text.lines().skip(1) {
            let (x, y) = row.split_once(',').unwrap();
            let [x, y] = pole_in_world(x.trim().parse().unwrap(), y.trim().parse().unwrap());
            rows += 1;
            met += usize::from(world.landmarks.iter().any(
                |landmark| matches!(landmark, Landmark::Pole { foot, .. } if (foot.x - x).hypot(foot.y - y) < 1e-6),
            ));
        }
        assert!(met * 10 >= rows * 9, "{name}: {met} of {rows} poles");
        assert!(world.notes[0].starts_with(&format!("{met} of {rows} measured poles")), "{}", world.notes[0]);
    }
}

/// The first 160 frames of a street along KITTI 00, and its map.
struct Along00 {
    folder: PathBuf,
}

impl Along00 {
    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }
}

/// None without the data.
static ALONG_00: LazyLock<Option<Along00>> = LazyLock::new(|| {
    let root = data::folder()?;
    let along = Along00 { folder: Path::new(env!("CARGO_TARGET_TMPDIR")).join("along_00") };
    // An earlier version may have left a drive that this one does not know.
    if along.folder.exists() {
        std::fs::remove_dir_all(&along.folder).unwrap();
    }
    std::fs::create_dir_all(&along.folder).unwrap();
    let drive = along.file("drive");
    let (poses, poles) = (poses(&root, "00"), poles(&root, "00"));
    let survey = ["--world", "from-survey", "--poses", text(&poses), "--poles", text(&poles)];
    run("fixtures", &[&["generate", "--frames", "160", "--out", text(&drive)][..], &survey].concat()).ok();
    build(&drive, "00", &along.file("map.csm"), &["--trajectory", text(&along.file("built.txt"))]).ok();
    Some(along)
});

/// One stands close before a bush, and three masts carry a roof.
#[test]
fn a_map_of_a_street_with_trees_and_fences_has_its_posts_and_calls_few_others_so() {
    let Some(along) = &*ALONG_00 else { return };
    let truth = waymark_tests::truth::read(&along.file("drive")).unwrap();
    let exact = kitti::read_poses(along.file("drive/truth/poses.txt")).unwrap();
    let built = kitti::read_poses(along.file("built.txt")).unwrap();
    let map = aligned(&common::map::read(along.file("map.csm")).unwrap(), &built, &exact);
    let score = score(&map, &truth, &exact, 20.0);
    println!("{:?}, {:?}; missed {:?}; wrong {:?}", score.poles, score.trunks, score.missed, score.wrong);
    assert!(score.poles.recall() > 0.95 && score.poles.precision() > 0.9);
    assert!(score.trunks.recall() > 0.5 && score.trunks.precision() > 0.95);
}

/// At a corner of KITTI 00 a sign is seen in the leaves, frame after frame, where
/// there is none: five metres aside it would be one of the map's.
#[test]
fn what_stays_in_view_and_is_no_landmark_does_not_draw_the_pose_away() {
    let Some(along) = &*ALONG_00 else { return };
    let (drive, map, found) = (along.file("drive"), along.file("map.csm"), along.file("found"));
    let (labels, truth) = (drive.join("sequences/00/labels_2"), drive.join("truth/poses.txt"));
    let odometry = drive.join("sequences/00/odometry.csv");
    let words = ["run", "--map", text(&map), "--kitti", text(&drive), "--sequence", "00", "--labels", text(&labels)];
    let more = ["--truth", text(&truth), "--odometry", text(&odometry), "--out", text(&found)];
    run("localizer", &[&words[..], &more].concat()).ok();
    let words = ["eval", "--estimate", text(&found), "--truth", text(&truth), "--json"];
    let score: serde_json::Value = serde_json::from_str(&run("localizer", &words).ok()).unwrap();
    let (rms_m, most_m) = (score["rms_position_m"].as_f64().unwrap(), score["max_position_m"].as_f64().unwrap());
    assert!(rms_m < 0.3 && most_m < 1.5, "{rms_m} m, at most {most_m} m");
    assert_eq!(score["ok_but_off"], 0);
}
