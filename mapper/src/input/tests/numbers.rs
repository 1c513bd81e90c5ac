//! Scans that are named by the numbers of a drive's frames get the poses and the times of these.

use super::*;

#[test]
fn scans_get_the_stamped_poses_of_their_numbers() {
    let root = drive_folder(&["000000.pcd", "000002.pcd"], TUM);
    let drive = open(root.path(), SurveyFrame::Lidar).unwrap();
    assert_eq!((drive.frames.clone(), drive.times_s.clone()), (vec![0, 2], vec![100.0, 100.2, 100.4]));
    assert!((drive.survey[2].translation.vector - Vector3::new(-1.0, -0.5, 4.0)).norm() < 1e-9);
    assert!(drive.notes.iter().any(|n| n.contains("1 of 3 poses have no scan")), "{:?}", drive.notes);
    // A number without a pose is told.
    let said = open(drive_folder(&["000000.pcd", "000003.pcd"], TUM).path(), SurveyFrame::Lidar).unwrap_err();
    assert!(said.to_string().contains("has 3 poses and"), "{said}");
}

#[test]
fn scans_get_the_times_of_their_numbers() {
    let root = drive_folder(&["000001.pcd", "000004.pcd"], TUM);
    let with = |times_s: &[f64]| {
        write_times(root.path().join("times.txt"), times_s).unwrap();
        open_timed(root.path())
    };
    // Two scans of five frames, and three poses.
    assert_eq!(with(&[100.0, 100.1, 100.2, 100.3, 100.4]).unwrap().times_s, [100.1, 100.4]);
    assert!(with(&[100.0, 100.1, 100.2, 100.3]).unwrap_err().to_string().contains("give one time per scan"));
}
