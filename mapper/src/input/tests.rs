//! The same scans in every format are the same drive, and what is no scan is
//! told.

use std::path::{Path, PathBuf};

use common::geometry::Pose;
use common::kitti::{ScanPoint, write_poses, write_scan, write_times};
use nalgebra::{Point3, Vector3};

use super::formats::ScanFormat;
use super::*;
use crate::drive::{Choice, Drive};
use crate::lidar::LidarConfig;

mod noise;
mod numbers;
mod order;
mod stitched;

const ALL: Choice = Choice { every: 1, first: 0, last: usize::MAX };

/// Points in quarters of a metre: exact in all formats.
fn points() -> Vec<ScanPoint> {
    let point = |i: i32| ScanPoint {
        x_m: f32::from((i % 40) as i16 - 20) * 0.25 + 0.125,
        y_m: f32::from((i / 40) as i16 - 10) * 0.25,
        z_m: -1.75,
        reflectance: f32::from((i % 200) as i16),
    };
    (0..800).map(point).collect()
}

fn write_las(path: &Path, points: &[ScanPoint], times_s: Option<&dyn Fn(usize) -> f64>) {
    write_las_with(path, 6, points, |i, point| point.gps_time = Some(times_s.map_or(0.0, |t| t(i))));
}

/// Points of a format, of which `change` says what is not that of all.
fn write_las_with(path: &Path, format: u8, points: &[ScanPoint], change: impl Fn(usize, &mut las::Point)) {
    let mut builder = las::Builder::from((1, 4));
    let mut format = las::point::Format::new(format).unwrap();
    format.is_compressed = path.extension().is_some_and(|e| e == "laz");
    builder.point_format = format;
    let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    for (i, p) in points.iter().enumerate() {
        let mut point = las::Point {
            x: p.x_m.into(),
            y: p.y_m.into(),
            z: p.z_m.into(),
            intensity: p.reflectance as u16,
            return_number: 1,
            number_of_returns: 1,
            ..las::Point::default()
        };
        change(i, &mut point);
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

fn floats(p: &ScanPoint) -> [f32; 4] {
    [p.x_m, p.y_m, p.z_m, p.reflectance]
}

/// A PCD file: `x y z intensity` as floats.
fn pcd(points: &[ScanPoint], data: &str) -> Vec<u8> {
    let n = points.len();
    let mut out = format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n\
         WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {data}\n"
    )
    .into_bytes();
    match data {
        "ascii" => {
            for p in points {
                out.extend(format!("{} {} {} {}\n", p.x_m, p.y_m, p.z_m, p.reflectance).bytes());
            }
        }
        "binary" => out.extend(points.iter().flat_map(floats).flat_map(f32::to_le_bytes)),
        _ => {
            let columns: Vec<u8> =
                (0..4).flat_map(|c| points.iter().map(move |p| floats(p)[c])).flat_map(f32::to_le_bytes).collect();
            // Literals only: a file that any reader of LZF reads.
            let packed: Vec<u8> =
                columns.chunks(32).flat_map(|c| std::iter::once(c.len() as u8 - 1).chain(c.iter().copied())).collect();
            out.extend((packed.len() as u32).to_le_bytes());
            out.extend((columns.len() as u32).to_le_bytes());
            out.extend(packed);
        }
    }
    out
}

fn ply(points: &[ScanPoint], encoding: &str) -> Vec<u8> {
    let mut out = format!(
        "ply\nformat {encoding} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float scalar_Intensity\nend_header\n",
        points.len()
    )
    .into_bytes();
    for p in points {
        match encoding {
            "ascii" => out.extend(format!("{} {} {} {}\n", p.x_m, p.y_m, p.z_m, p.reflectance).bytes()),
            "binary_little_endian" => out.extend(floats(p).into_iter().flat_map(f32::to_le_bytes)),
            _ => out.extend(floats(p).into_iter().flat_map(f32::to_be_bytes)),
        }
    }
    out
}

/// The points as a file of every kind.
fn files(folder: &Path) -> Vec<PathBuf> {
    let points = points();
    let mut all = Vec::new();
    let mut add = |name: &str, bytes: Vec<u8>| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        all.push(path);
    };
    for data in ["ascii", "binary", "binary_compressed"] {
        add(&format!("{data}.pcd"), pcd(&points, data));
    }
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        add(&format!("{encoding}.ply"), ply(&points, encoding));
    }
    for name in ["a.las", "a.laz"] {
        write_las(&folder.join(name), &points, None);
        all.push(folder.join(name));
    }
    write_scan(folder.join("a.bin"), &points).unwrap();
    all.push(folder.join("a.bin"));
    all
}

fn read(path: &Path) -> Result<Scan> {
    ScanFormat::of(path).unwrap().read(path, 120.0, Steps::of(&LidarConfig::default()))
}

#[test]
fn a_scan_is_the_same_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let all = files(folder.path());
    let expected = read(&folder.path().join("a.bin")).unwrap();
    assert_eq!(expected.points.len(), 800);
    for path in all {
        assert_eq!(read(&path).unwrap(), expected, "{}", path.display());
    }
}

#[test]
fn a_table_of_more_chunks_than_there_are_bytes_takes_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.laz");
    write_las(&path, &points(), None);
    let mut bytes = std::fs::read(&path).unwrap();
    let points_at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    let table_at = i64::from_le_bytes(bytes[points_at..points_at + 8].try_into().unwrap()) as usize;
    assert_eq!(bytes[table_at + 4..table_at + 8], [1, 0, 0, 0]);
    bytes[table_at + 4..table_at + 8].fill(255);
    std::fs::write(&path, &bytes).unwrap();
    let said = read(&path).unwrap_err().to_string();
    assert!(said.contains("promises 4294967295 chunks"), "{said}");
}

#[test]
fn a_truncated_scan_is_told_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    for path in files(folder.path()) {
        let bytes = std::fs::read(&path).unwrap();
        for share in [0, 1, 3, 9, 20, 50, 97] {
            // Within a point: a KITTI scan cut between two is a shorter scan.
            let cut = (bytes.len() * share / 100) | 1;
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let said = read(&path).unwrap_err().to_string();
            assert!(said.contains(&*path.file_name().unwrap().to_string_lossy()), "{said}");
            assert!(!said.contains('\n') && (said.contains("again") || said.contains("check")), "{said}");
        }
    }
}

#[test]
fn what_stands_before_the_vertices_is_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let camera = "element camera 2\nproperty float view_px\nproperty list uchar int of\n";
    for encoding in ["ascii", "binary_little_endian"] {
        let mut bytes = ply(&points(), encoding);
        let at = |bytes: &[u8], what: &[u8]| bytes.windows(what.len()).position(|w| w == what).unwrap();
        let first = at(&bytes, b"element vertex");
        bytes.splice(first..first, camera.bytes());
        let first = at(&bytes, b"end_header\n") + b"end_header\n".len();
        // Of the first one two numbers, of the second none.
        let binary = [&1.5_f32.to_le_bytes()[..], &[2], &[7; 8], &2.5_f32.to_le_bytes(), &[0]].concat();
        let content = if encoding == "ascii" { b"1.5 2 7 7\n2.5 0\n".to_vec() } else { binary };
        bytes.splice(first..first, content);
        let path = folder.path().join("a.ply");
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(read(&path).unwrap().points.len(), 800, "{encoding}");
    }
}

#[test]
fn what_a_scan_lacks_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let said = |name: &str, content: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        read(&path).unwrap_err().to_string()
    };
    let pcd = String::from_utf8(pcd(&points()[..2], "ascii")).unwrap();
    let no_z = said("a.pcd", &pcd.replace("x y z", "x y t"));
    assert!(no_z.contains("FIELDS are `x y t intensity` and lack x, y or z"), "{no_z}");
    assert!(said("b.pcd", &pcd.replace("SIZE 4 4 4 4", "SIZE 4 4 4")).contains("4, 3, 4 and 4 entries"));
    assert!(said("c.pcd", &pcd.replace("SIZE 4", "SIZE 3")).contains("field `x` has type F3"));
    for count in ["0", "9223372036854775807"] {
        let said = said("f.pcd", &pcd.replace("COUNT 1 1 1 1", &format!("COUNT 1 1 1 {count}")));
        assert!(said.contains(&format!("field `intensity` has a COUNT of {count}")), "{said}");
    }
    assert!(said("d.pcd", &pcd.replace("DATA ascii", "DATA zip")).contains("DATA `zip` is none of"));
    let word = said("e.pcd", &pcd.replace("-1.75 1\n", "up 1\n"));
    assert!(word.contains("line 13: `up` is not a number"), "{word}");
    let ply = String::from_utf8(ply(&points()[..2], "ascii")).unwrap();
    assert!(said("a.ply", &ply.replace("float z", "float h")).contains("no properties x, y and z"));
    assert!(said("b.ply", &ply.replace("vertex 2", "face 2")).contains("not `vertex`"));
    assert!(said("a.las", "LASX").contains("a.las: it is no whole LAS or LAZ file"));
}

/// A folder of scans named as `names` say, and a file of poses.
fn drive_folder(names: &[&str], poses: &str) -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    std::fs::create_dir(root.path().join("scans")).unwrap();
    for name in names {
        std::fs::write(root.path().join("scans").join(name), pcd(&points(), "binary")).unwrap();
    }
    std::fs::write(root.path().join("poses.txt"), poses).unwrap();
    root
}

fn open(root: &Path, frame: SurveyFrame) -> Result<Drive> {
    open_reduced(root, frame, None)
}

fn open_reduced(root: &Path, frame: SurveyFrame, reduced_by_m: Option<Vector3<f64>>) -> Result<Drive> {
    let (path, survey) = (root.join("scans"), root.join("poses.txt"));
    open_input(&ScanInput { frame, reduced_by_m, ..beside(&path, &survey) })
}

/// With the times of `times.txt`.
fn open_timed(root: &Path) -> Result<Drive> {
    let [path, survey, times] = ["scans", "poses.txt", "times.txt"].map(|name| root.join(name));
    open_input(&ScanInput { scan_times: Some(&times), ..beside(&path, &survey) })
}

fn open_input(input: &ScanInput) -> Result<Drive> {
    open_scans(input, ALL, 120.0, &InputConfig::default(), &LidarConfig::default())
}

const TUM: &str = "# t x y z q\n100.0 0 0 0 0 0 0 1\n100.2 2 0 0 0 0 0 1\n100.4 4 1 0.5 0 0 0 1\n";

#[test]
fn scans_get_the_poses_of_their_times() {
    let root = drive_folder(&["100.100.pcd", "100.400.pcd", "99.000.pcd"], TUM);
    let drive = open(root.path(), SurveyFrame::Lidar).unwrap();
    assert_eq!((drive.frames.len(), drive.times_s.clone()), (2, vec![100.1, 100.4]));
    // One metre ahead is one metre along z of the map; left is -x, up is -y.
    assert!((drive.survey[0].translation.vector - Vector3::new(0.0, 0.0, 1.0)).norm() < 1e-9);
    assert!((drive.survey[1].translation.vector - Vector3::new(-1.0, -0.5, 4.0)).norm() < 1e-9);
    assert!(drive.notes.iter().any(|n| n.contains("1 scans have no pose")), "{:?}", drive.notes);
    let scan = drive.read(0, 0.0).unwrap();
    let on_the_map = drive.survey[0] * drive.camera_from_velodyne * Point3::new(10.0, 2.0, 1.0);
    assert!((on_the_map - Point3::new(-2.0, -1.0, 11.0)).norm() < 1e-9, "{on_the_map}");
    // Intensities to 199: of eight bits.
    assert!(scan.reflectance.iter().all(|r| (0.0..=1.0).contains(r)));
    assert!(scan.reflectance.iter().any(|r| *r > 0.7));
}

#[test]
fn scans_get_the_rows_of_their_numbers() {
    let root = drive_folder(&["000001.pcd", "000003.pcd"], "");
    let poses: Vec<Pose> = (0..5).map(|i| Pose::translation(0.0, 0.0, f64::from(i))).collect();
    write_poses(root.path().join("poses.txt"), &poses).unwrap();
    let drive = open(root.path(), SurveyFrame::Camera).unwrap();
    assert_eq!((drive.frames.clone(), drive.survey.len()), (vec![1, 3], 5));
    assert_eq!(drive.survey, poses);
    assert!(drive.name().starts_with("scans "));
    let has_note = |note: &str| drive.notes.iter().any(|n| n.contains(note));
    assert!(has_note("3 of 5 poses have no scan") && has_note("no scan of frames 2,"), "{:?}", drive.notes);
}

#[test]
fn a_time_without_scans_is_told() {
    let rows: Vec<String> = (0..100).map(|i| format!("{}.{} {i} 0 0 0 0 0 1\n", 100 + i / 10, i % 10)).collect();
    let rows = rows.concat();
    let notes = |names: &[&str]| open(drive_folder(names, &rows).path(), SurveyFrame::Lidar).unwrap().notes;
    let whole = ["100.0.pcd", "100.5.pcd", "101.0.pcd", "101.5.pcd", "102.0.pcd", "102.5.pcd"];
    assert!(notes(&whole).iter().all(|n| !n.contains("no scan for")));
    let lacking = [&whole[..2], &whole[5..], &["103.0.pcd"]].concat();
    assert!(
        notes(&lacking).iter().any(|n| n.starts_with("no scan for 2.0 s after 100.500 s")),
        "{:?}",
        notes(&lacking)
    );
}

#[cfg(unix)]
#[test]
fn a_survey_may_come_through_a_pipe_and_a_cloud_may_not() {
    use std::io::Write;
    use std::os::fd::AsRawFd;
    let root = drive_folder(&["100.1.pcd"], "");
    let (reader, mut writer) = std::io::pipe().unwrap();
    writer.write_all(TUM.as_bytes()).unwrap();
    drop(writer);
    let pipe = PathBuf::from(format!("/dev/fd/{}", reader.as_raw_fd()));
    assert_eq!(open_input(&beside(&root.path().join("scans"), &pipe)).unwrap().times_s, [100.1]);
    let survey = root.path().join("poses.txt");
    std::fs::write(&survey, TUM).unwrap();
    let cloud = open_stitched(&beside(&pipe, &survey), ALL, 120.0, &InputConfig::default(), &LidarConfig::default());
    let said = cloud.unwrap_err().to_string();
    assert!(said.contains("is no file, and it is read more than once"), "{said}");
}

#[test]
fn times_beside_rows_are_those_of_the_rows() {
    let root = drive_folder(&["000001.pcd", "000003.pcd"], "");
    let poses: Vec<Pose> = (0..5).map(|i| Pose::translation(0.0, 0.0, f64::from(i))).collect();
    write_poses(root.path().join("poses.txt"), &poses).unwrap();
    let times_s = [10.0, 10.2, 10.4, 10.6, 10.8];
    let with = |times_s: &[f64]| {
        write_times(root.path().join("times.txt"), times_s).unwrap();
        open_timed(root.path())
    };
    assert_eq!(with(&times_s).unwrap().times_s, times_s);
    let said = with(&times_s[..2]).unwrap_err().to_string();
    assert!(said.contains("times.txt has 2 times and ") && said.contains("poses.txt has 5 poses"), "{said}");
    // Poses with times are matched at those of the scans.
    std::fs::write(root.path().join("poses.txt"), TUM).unwrap();
    assert_eq!(with(&[100.0, 100.3]).unwrap().times_s, [100.0, 100.3]);
    assert!(with(&times_s).unwrap_err().to_string().contains("give one time per scan"));
}

#[test]
fn scans_follow_each_other_as_people_count() {
    let names: Vec<String> = (1..=12).rev().map(|i| format!("scan_{i}_of_12.pcd")).collect();
    let rows: Vec<String> = (1..=12).map(|i| format!("{i} {i} 0 0 0 0 0 1\n")).collect();
    let root = drive_folder(&names.iter().map(String::as_str).collect::<Vec<_>>(), &rows.concat());
    let drive = open(root.path(), SurveyFrame::Lidar).unwrap();
    for (frame, name) in names.iter().rev().enumerate() {
        assert!(drive.scan_path(frame).ends_with(name), "{frame}: {}", drive.scan_path(frame).display());
    }
}

#[test]
fn national_coordinates_are_reduced_by_the_first_pose_or_as_said() {
    let far = TUM.replace(" 0 0 0 0 0 0 1\n100.2 2", " 457123 5428456 0 0 0 0 1\n100.2 457125");
    let root = drive_folder(&["100.0.pcd"], &far);
    let drive = open(root.path(), SurveyFrame::Lidar).unwrap();
    assert!((drive.survey[0].translation.vector - Vector3::new(-8456.0, 0.0, 7123.0)).norm() < 1e-6);
    assert!(drive.notes.iter().any(|n| n.contains("reduced by (450000, 5420000, 0) m")), "{:?}", drive.notes);
    // One that starts south of a multiple would be reduced by 10 km less.
    let near = far.replace(" 457123 5428456 ", " 457123 5419999 ");
    let root = drive_folder(&["100.0.pcd"], &near);
    let x_m = |drive: Result<Drive>| drive.unwrap().survey[0].translation.x;
    assert!((x_m(open(root.path(), SurveyFrame::Lidar)) + 9999.0).abs() < 1e-6);
    let alike = open_reduced(root.path(), SurveyFrame::Lidar, Some(Vector3::new(450_000.0, 5_420_000.0, 0.0)));
    assert!((x_m(alike) - 1.0).abs() < 1e-6);
}

#[test]
fn a_folder_that_does_not_fit_is_told() {
    let said = |names: &[&str], poses: &str| {
        open(drive_folder(names, poses).path(), SurveyFrame::Lidar).unwrap_err().to_string()
    };
    assert!(said(&[], TUM).contains("holds no scan; give a folder of .las"));
    assert!(said(&["a.pcd", "b.ply"], TUM).contains("are of two formats"));
    assert!(said(&["a.pcd", "b.pcd"], TUM).contains("has 3 poses and"));
    assert!(said(&["300.5.pcd"], TUM).contains("its poses are from 100.000 to 100.400 s"));
    assert!(said(&["a.pcd"], "").contains("poses.txt holds no pose"));
    assert!(said(&["a.pcd"], "1 0 0 nan 0 0 0 1\n").contains("poses.txt:1: `nan` is not a finite number"));
    assert!(
        said(&["a.pcd"], "1 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n").contains("poses.txt:2: the time 0.5 s is not after")
    );
}

/// A cloud or a folder of scans, with poses of its lidar and nothing else.
fn beside<'a>(path: &'a Path, survey: &'a Path) -> ScanInput<'a> {
    ScanInput { path, survey, frame: SurveyFrame::Lidar, calibration: None, scan_times: None, reduced_by_m: None }
}
