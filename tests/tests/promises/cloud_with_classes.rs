//! The stitched cloud as LAZ: every point once, the landmarks' points marked. It is input, too.

use std::collections::BTreeMap;
use std::path::Path;

use common::geometry::Pose;
use common::kitti::{Sequence, read_poses, write_poses};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use waymark_tests::map_score::{WITHIN_M, aligned, score};

use crate::support::{DEMO, build, run, text};

#[test]
fn points_on_the_landmarks_of_the_map_carry_their_class() {
    let folder = tempfile::tempdir().unwrap();
    let (map, cloud) = (folder.path().join("a.csm"), folder.path().join("a.laz"));
    build(&DEMO.file("drive"), "00", &map, &["--cloud", text(&cloud)]).ok();
    let map = common::map::read(&map).unwrap();
    let points = las::Reader::from_path(&cloud).unwrap().read_all().unwrap();
    let points: Vec<las::Point> = points.points().map(|p| p.unwrap()).collect();
    let mut classes: BTreeMap<u8, usize> = BTreeMap::new();
    for p in &points {
        *classes.entry(u8::from(p.classification)).or_default() += 1;
        assert!(p.point_source_id % 5 == 0, "only every fifth frame was stitched");
    }
    for class in [1, 2, 11, 70] {
        assert!(classes.get(&class).is_some_and(|n| *n > 500), "{classes:?}");
    }
    // Map x, z, -y: a pole's points stand around its axis.
    for pole in &map.poles {
        let middle = nalgebra::center(&pole.foot_map, &pole.top_map);
        let marked =
            points.iter().filter(|p| u8::from(p.classification) >= 64 && (p.x - middle.x).hypot(p.y - middle.z) < 0.4);
        assert!(marked.count() >= 5, "{pole:?}");
    }
}

/// Such a cloud, with a trajectory that has no times, tells as little as most that lie in
/// archives: who saw what is not known.
#[test]
fn a_stitched_cloud_without_times_gives_most_of_what_its_scans_gave() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let [map, cloud, built, survey] = ["a.csm", "a.laz", "a.txt", "survey.txt"].map(file);
    let drive = DEMO.file("drive");
    build(&drive, "00", &map, &["--cloud", text(&cloud), "--trajectory", text(&built)]).ok();
    // The cloud's axes are right, forward and up.
    let cloud_from_map = Pose::from_parts(
        Translation3::identity(),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f64::consts::FRAC_PI_2),
    );
    let camera_from_lidar = Sequence::open(&drive, "00").unwrap().calibration().unwrap().camera_from_velodyne;
    let lidar = |pose: &Pose| cloud_from_map * pose * camera_from_lidar;
    write_poses(&survey, &read_poses(&built).unwrap().iter().map(lidar).collect::<Vec<_>>()).unwrap();

    let (stitched, trajectory) = (file("b.csm"), file("b.txt"));
    let calib = drive.join("sequences/00/calib.txt");
    let words = ["build", "--stitched", text(&cloud), "--survey", text(&survey)];
    let more = ["--calib", text(&calib), "--out", text(&stitched), "--trajectory", text(&trajectory)];
    let said = run("mapper", &[&words[..], &more].concat()).ok();
    assert!(said.contains("cut by position, and what stands dealt to the places that may have seen it"), "{said}");

    let truth = waymark_tests::truth::read(&drive).unwrap();
    let exact = read_poses(drive.join("truth/poses.txt")).unwrap();
    let scored = |map: &Path, poses: &Path| {
        let map = common::map::read(map).unwrap();
        score(&aligned(&map, &read_poses(poses).unwrap(), &exact), &truth, &exact, WITHIN_M)
    };
    let (scans, cloud) = (scored(&map, &built), scored(&stitched, &trajectory));
    println!("poles {:?} of {:?}, lanes {:?} of {:?}", cloud.poles, scans.poles, cloud.lanes, scans.lanes);
    assert!(cloud.poles.recall() > scans.poles.recall() - 0.1 && cloud.poles.precision() > 0.8, "{:?}", cloud.poles);
    assert!(cloud.poles.off_m < 0.08, "{:?}", cloud.poles);
    assert!(cloud.lanes.recall() > scans.lanes.recall() - 0.05, "{:?} of {:?}", cloud.lanes, scans.lanes);
}
