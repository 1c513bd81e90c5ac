//! Every bad input ends with exit code 2 and one sentence that names the file
//! and says what to do.

use std::path::{Path, PathBuf};

use common::map::{EncodeOptions, SemanticMap};

use crate::support::{CALIBRATION, DEMO, Ran, build, plain, run, run_with, text, write_png};

/// `mapper build` of every scan of sequence 04.
fn build_of(root: &Path, more: &[&str]) -> Ran {
    let map = root.join("04.csm");
    let ran = build(root, "04", &map, &[&["--every", "1"], more].concat());
    assert_eq!(ran.code == 0, map.exists(), "a map is written if and only if all went well");
    ran
}

#[test]
fn the_plain_drive_itself_is_fine() {
    build_of(plain().path(), &[]).ok();
}

#[test]
fn a_missing_sequence() {
    let root = plain();
    let ran = build(root.path(), "07", &root.path().join("07.csm"), &[]);
    ran.refused(&["sequence 07 is not in", "which holds 04"]);
}

#[test]
fn a_truncated_scan() {
    let root = plain();
    let scan = root.path().join("sequences/04/velodyne/000001.bin");
    let bytes = std::fs::read(&scan).unwrap();
    std::fs::write(&scan, &bytes[..bytes.len() - 5]).unwrap();
    build_of(root.path(), &[]).refused(&["000001.bin has 57595 bytes", "copy it again"]);
    std::fs::write(&scan, []).unwrap();
    build_of(root.path(), &[]).refused(&["000001.bin has 0 bytes", "copy it again"]);
}

#[test]
fn a_calibration_without_tr() {
    let root = plain();
    let without: Vec<&str> = CALIBRATION.lines().filter(|line| !line.starts_with("Tr")).collect();
    std::fs::write(root.path().join("sequences/04/calib.txt"), without.join("\n")).unwrap();
    build_of(root.path(), &[]).refused(&["calib.txt has no line `Tr:`", "take `calib.txt` from"]);
}

#[test]
fn a_calibration_of_other_axes() {
    let root = plain();
    let other: Vec<&str> = CALIBRATION
        .lines()
        .map(|line| if line.starts_with("Tr") { "Tr: 1 0 0 0 0 1 0 0 0 0 1 0" } else { line })
        .collect();
    std::fs::write(root.path().join("sequences/04/calib.txt"), other.join("\n")).unwrap();
    build_of(root.path(), &[]).refused(&["ground lies level under", "check the calibration"]);
}

#[test]
fn no_drive_at_all() {
    run("mapper", &["build", "--out", "04.csm"]).refused(&["no drive is given", "--kitti", "--raw", "--scans"]);
}

#[test]
fn poses_of_the_wrong_length() {
    let root = plain();
    let poses = root.path().join("poses/04.txt");
    let rows = std::fs::read_to_string(&poses).unwrap();
    let short: Vec<&str> = rows.lines().take(2).collect();
    std::fs::write(&poses, short.join("\n")).unwrap();
    build_of(root.path(), &[]).refused(&["04.txt has 2 poses", "times.txt has 3 times"]);
}

#[test]
fn a_survey_that_jumps() {
    let root = plain();
    let poses = root.path().join("poses/04.txt");
    let rows = std::fs::read_to_string(&poses).unwrap();
    let mut rows: Vec<String> = rows.lines().map(str::to_owned).collect();
    let mut far: Vec<&str> = rows[1].split_whitespace().collect();
    far[3] = "600";
    rows[1] = far.join(" ");
    std::fs::write(&poses, rows.join("\n")).unwrap();
    build_of(root.path(), &[]).refused(&["04.txt: from frame 0 to frame 1", "jumps by 600.0 m", "longest_step_m"]);
    // What is not stitched does not matter.
    build_of(root.path(), &["--last", "0"]).ok();
}

#[test]
fn poses_far_from_their_origin() {
    let root = plain();
    let poses = root.path().join("poses/04.txt");
    for far in ["5e6", "1e300"] {
        let rows: Vec<String> = (0..3).map(|z| format!("1 0 0 {far} 0 1 0 0 0 0 1 {z}\n")).collect();
        std::fs::write(&poses, rows.concat()).unwrap();
        build_of(root.path(), &[]).refused(&["04.txt: frame 0 is", "from the origin of the poses", "farthest_m"]);
    }
}

#[test]
fn an_unknown_config_key() {
    let root = plain();
    let config = root.path().join("build.toml");
    std::fs::write(&config, "quantum_m = 0.02\n[poles]\nlargest_tilt_deg = 3\n").unwrap();
    let ran = build_of(root.path(), &["--config", text(&config)]);
    ran.refused(&["build.toml:3", "no setting `largest_tilt_deg`", "did you mean `largest_tilt_rad`"]);
}

#[test]
fn a_folder_that_does_not_exist() {
    let root = plain();
    let map = root.path().join("maps/04.csm");
    build(root.path(), "04", &map, &[]).refused(&["04.csm cannot be written", "create it first"]);
}

/// A good map, its bytes, and a folder for worse ones.
struct Maps(tempfile::TempDir);

impl Maps {
    fn new() -> (Self, Vec<u8>) {
        let map = SemanticMap { frame_note: "made".into(), ..SemanticMap::default() };
        (Self(tempfile::tempdir().unwrap()), map.encode(&EncodeOptions::default()).unwrap())
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("bad.csm")
    }

    /// Every command that reads a map refuses these bytes with a sentence.
    fn refused(&self, bytes: &[u8], part: &str) {
        let (path, picture) = (self.path(), self.0.path().join("bad.svg"));
        std::fs::write(&path, bytes).unwrap();
        let map = text(&path);
        for words in [
            &["inspect", map][..],
            &["size", map, "--budget", "4096"],
            &["ascii", map],
            &["draw", map, "--out", text(&picture)],
        ] {
            run("mapper", words).refused(&["bad.csm", part]);
        }
        assert!(!picture.exists());
        let folder = text(self.0.path());
        let words = ["run", "--map", map, "--kitti", folder, "--labels", folder, "--out", folder];
        run("localizer", &words).refused(&["bad.csm", part]);
    }
}

#[test]
fn a_map_with_a_flipped_byte() {
    let (maps, bytes) = Maps::new();
    // The magic, the version and the length have sentences of their own.
    for at in 8..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[at] ^= 0x10;
        std::fs::write(maps.path(), &flipped).unwrap();
        run("mapper", &["ascii", text(&maps.path())]).refused(&["bad.csm", "damaged"]);
    }
    let mut flipped = bytes;
    flipped[12] ^= 1;
    maps.refused(&flipped, "damaged");
}

#[test]
fn a_truncated_map() {
    let (maps, bytes) = Maps::new();
    maps.refused(&bytes[..bytes.len() - 3], "it was cut off");
}

#[test]
fn a_map_of_a_future_version() {
    let (maps, mut bytes) = Maps::new();
    bytes[3] = 9;
    maps.refused(&bytes, "format version 9, and this program reads versions up to 5");
}

#[test]
fn what_is_no_map() {
    let (maps, _) = Maps::new();
    maps.refused(b"hello, this is text", "no Waymark map");
}

/// `localizer run` in an empty map of the plain drive.
fn localize(root: &Path, more: &[&str]) -> Ran {
    let map = root.join("empty.csm");
    common::map::write(&map, &SemanticMap::default(), &EncodeOptions::default()).unwrap();
    let out = root.join("out");
    let words = ["run", "--map", text(&map), "--kitti", text(root), "--sequence", "04", "--out", text(&out)];
    run("localizer", &[&words[..], more].concat())
}

/// `/dev/full` takes nothing, as a full disk does.
#[cfg(target_os = "linux")]
#[test]
fn an_output_that_takes_nothing() {
    for (program, words) in [
        ("fixtures", "worlds"),
        ("localizer", "run --print-config"),
        ("mapper", "--help"),
        ("mapper", "build --help"),
        ("fixtures", "--version"),
    ] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        crate::support::run_into(full, program, &words.split(' ').collect::<Vec<_>>())
            .refused(&["could not be written", "room"]);
    }
}

#[test]
fn no_label_images() {
    let root = plain();
    let missing = root.path().join("elsewhere");
    localize(root.path(), &["--labels", text(&missing)]).refused(&["elsewhere", "No such file"]);
    localize(root.path(), &["--labels", text(root.path())]).refused(&["holds no images", "pole/000000.png"]);
}

#[test]
fn a_label_image_of_another_size() {
    let root = plain();
    let labels = root.path().join("labels");
    for (frame, size) in [(0, (1226, 370)), (1, (1226, 370)), (2, (1242, 376))] {
        write_png(&labels.join(format!("pole/{frame:06}.png")), size, png::ColorType::Grayscale);
    }
    let ran = localize(root.path(), &["--labels", text(&labels)]);
    ran.refused(&["pole/000002.png has 1242x376 px where 1226x370", "give images"]);
}

#[test]
fn label_images_that_are_not_of_the_calibrated_size() {
    let root = plain();
    let labels = root.path().join("labels");
    for frame in 0..3 {
        write_png(&labels.join(format!("pole/{frame:06}.png")), (613, 185), png::ColorType::Grayscale);
    }
    let ran = localize(root.path(), &["--labels", text(&labels)]);
    ran.refused(&["labels", "613x185", "calib"]);
}

#[test]
fn a_drive_in_which_nothing_is_seen_leaves_what_was_there() {
    let root = plain();
    let (labels, out) = (root.path().join("labels"), root.path().join("out"));
    for frame in 0..3 {
        write_png(&labels.join(format!("pole/{frame:06}.png")), (1226, 370), png::ColorType::Grayscale);
    }
    std::fs::create_dir_all(&out).unwrap();
    std::fs::write(out.join("poses.txt"), "of yesterday").unwrap();
    let truth = root.path().join("poses/04.txt");
    let ran = localize(root.path(), &["--labels", text(&labels), "--truth", text(&truth), "--last", "2"]);
    ran.refused(&["no frame was localized", "--gps"]);
    assert_eq!(std::fs::read_to_string(out.join("poses.txt")).unwrap(), "of yesterday");
}

/// A disk that was full for a moment in a drive of hours.
#[test]
fn a_damaged_image_amid_a_drive_is_told_and_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let (labels, out) = (folder.path().join("labels"), folder.path().join("out"));
    std::fs::create_dir_all(labels.join("pole")).unwrap();
    for frame in 0..30 {
        let image = format!("pole/{frame:06}.png");
        std::fs::copy(DEMO.file("drive/sequences/00/labels_2").join(&image), labels.join(&image)).unwrap();
    }
    let damage = |frame: usize| {
        let image = labels.join(format!("pole/{frame:06}.png"));
        let bytes = std::fs::read(&image).unwrap();
        std::fs::write(&image, &bytes[..bytes.len() / 2]).unwrap();
    };
    let ran = || DEMO.localize_by(&labels, &DEMO.file("street.csm"), &out, &[]);
    damage(12);
    let told = ran();
    assert_eq!(told.code, 2, "{told:?}");
    let said = told.out + &told.err;
    assert!(said.contains("frame 12 ") && said.contains("pole/000012.png") && said.contains("1 frames"), "{said}");
    let estimates = std::fs::read_to_string(out.join("estimates.csv")).unwrap();
    assert_eq!(estimates.lines().count(), 1 + 29, "{estimates}");
    // The first one says what all are like.
    std::fs::remove_dir_all(&out).unwrap();
    damage(0);
    ran().refused(&["pole/000000.png", "give an intact PNG"]);
    assert!(!out.exists());
}

/// Built with the feature `ort` or without it.
#[test]
fn a_runtime_that_is_not_there() {
    let root = plain();
    let network = root.path().join("tiny.onnx");
    std::fs::write(&network, sigmoid_network([1, 3, 4, 8])).unwrap();
    let library = root.path().join("libnone.so");
    std::fs::write(&library, "no library").unwrap();
    let words = ["segment", "--runtime", "ort", "--kitti", text(root.path()), "--pole-net", text(&network)];
    let out = root.path().join("out");
    let ran = run_with(("ORT_DYLIB_PATH", text(&library)), "localizer", &[&words[..], &["--out", text(&out)]].concat());
    ran.refused(&["`--runtime ort`", "leave the option out"]);
}

#[test]
fn images_that_are_not_the_calibrated_ones() {
    let root = plain();
    write_png(&root.path().join("sequences/04/image_2/000000.png"), (613, 185), png::ColorType::Rgb);
    let network = root.path().join("tiny.onnx");
    std::fs::write(&network, sigmoid_network([1, 3, 4, 8])).unwrap();
    std::fs::write(network.with_extension("toml"), "[classes]\npole = [0]\n").unwrap();
    let ran = localize(root.path(), &["--pole-net", text(&network)]);
    ran.refused(&["000000.png has 613x185 px", "neither scaled nor cropped"]);
}

#[test]
fn a_network_with_other_shapes() {
    let root = plain();
    write_png(&root.path().join("sequences/04/image_2/000000.png"), (1226, 370), png::ColorType::Rgb);
    let network = root.path().join("tiny.onnx");
    std::fs::write(&network, sigmoid_network([1, 3, 4, 8])).unwrap();
    let words = ["--pole-net", text(&network)];
    localize(root.path(), &words).refused(&["tiny.onnx is no known network", "scores 1x3x4x8", "tiny.toml"]);
    for (description, said) in [
        ("widht = 8\n", "tiny.toml:1: there is no key `widht` (did you mean `width`?); a description has "),
        ("\nwidth = 'wide'\n", "tiny.toml:2: "),
    ] {
        std::fs::write(network.with_extension("toml"), description).unwrap();
        let ran = localize(root.path(), &words);
        ran.refused(&[said, "`skip_top`", "under `[classes]`", "`vegetation`"]);
        assert!(!ran.err.contains("--print-config"), "{ran:?}");
    }
    std::fs::write(network.with_extension("toml"), "width = 1248\n[classes]\npole = [0]\n").unwrap();
    localize(root.path(), &words).refused(&["tiny.onnx", "width is 8 and the description says 1248", "tiny.toml"]);
}

/// An ONNX network of one `Sigmoid`, byte by byte: protocol buffers whose
/// lengths all fit into seven bits, or into fourteen at the top.
fn sigmoid_network(shape: [u8; 4]) -> Vec<u8> {
    let message = |number: u8, content: &[u8]| {
        let (low, high) = ((content.len() & 0x7f) as u8, (content.len() >> 7) as u8);
        let length = if high > 0 { vec![low | 0x80, high] } else { vec![low] };
        [vec![number << 3 | 2], length, content.to_vec()].concat()
    };
    let number = |field: u8, value: u8| vec![field << 3, value];
    let value = |name: &[u8]| {
        let dims: Vec<u8> = shape.iter().flat_map(|&d| message(1, &number(1, d))).collect();
        let tensor = [number(1, 1), message(2, &dims)].concat();
        [message(1, name), message(2, &message(1, &tensor))].concat()
    };
    let node = [message(1, b"image"), message(2, b"scores"), message(3, b"only"), message(4, b"Sigmoid")].concat();
    let graph = [message(1, &node), message(2, b"tiny"), message(11, &value(b"image")), message(12, &value(b"scores"))]
        .concat();
    [number(1, 8), message(7, &graph), message(8, &number(2, 17))].concat()
}

#[test]
fn odometry_that_is_none() {
    let root = plain();
    let file = root.path().join("odometry.csv");
    let labels = root.path().join("labels");
    let words = ["--labels", text(&labels), "--odometry", text(&file)];
    localize(root.path(), &words).refused(&["odometry.csv", "No such file"]);
    std::fs::write(&file, "t_s,speed_m_s,yaw_rate_rad_s\n0.02,10,0\n0.04,10\n").unwrap();
    localize(root.path(), &words).refused(&["odometry.csv line 3", "2 columns"]);
    std::fs::write(&file, "0.04,10,0\n0.02,10,0\n").unwrap();
    localize(root.path(), &words).refused(&["odometry.csv line 2", "sort the lines by time"]);
    std::fs::write(&file, "0.04,10,0\n").unwrap();
    localize(root.path(), &words).refused(&["odometry.csv has fewer than two lines", "leave `--odometry` out"]);
    for frame in 0..3 {
        write_png(&labels.join(format!("pole/{frame:06}.png")), (1226, 370), png::ColorType::Grayscale);
    }
    // Of the afternoon, where the drive begins at 0.
    std::fs::write(&file, "54000.1,10,0\n54000.2,10,0\n").unwrap();
    localize(root.path(), &words).refused(&["odometry.csv tells of no step", "from 0.000 to 0.200 s", "times.txt"]);
}

#[test]
fn an_output_that_is_an_input_or_another_output() {
    let root = plain();
    let (map, poses) = (root.path().join("04.csm"), root.path().join("poses/04.txt"));
    let scan = root.path().join("sequences/04/velodyne/000001.bin");
    let before = [&poses, &scan].map(|file| std::fs::read(file).unwrap());
    let around = root.path().join("poses/../04.csm");
    let report = root.path().join("04.build.json");
    for (option, path, said) in [
        ("--trajectory", &map, "04.csm: --out and --trajectory would be one file"),
        ("--cloud", &around, "04.csm: --out and --cloud would be one file"),
        ("--trajectory", &report, "the report beside the map and --trajectory would be one file"),
        ("--trajectory", &poses, "04.txt: it is read, and --trajectory would replace it"),
        ("--cloud", &scan, "000001.bin: it is read, and --cloud would replace it"),
    ] {
        build_of(root.path(), &[option, text(path)]).refused(&[said, "name"]);
    }
    assert_eq!([&poses, &scan].map(|file| std::fs::read(file).unwrap()), before);
    build_of(root.path(), &[]).ok();
    for words in [&["draw"][..], &["export", "--format", "csv"], &["reduce", "--budget", "500"]] {
        run("mapper", &[words, &[text(&map), "--out", text(&around)]].concat()).refused(&["04.csm: it is read"]);
    }
}

#[test]
fn a_report_that_cannot_be_written_leaves_no_map() {
    let root = plain();
    std::fs::create_dir(root.path().join("04.build.json")).unwrap();
    build_of(root.path(), &[]).refused(&["04.build.json"]);
}

#[test]
fn a_sequence_of_what_has_none() {
    let root = plain();
    let (folder, poses) = (root.path().join("sequences/04/velodyne"), root.path().join("poses/04.txt"));
    let map = root.path().join("a.csm");
    let words = ["build", "--scans", text(&folder), "--survey", text(&poses), "--sequence", "04", "--out", text(&map)];
    let ran = run("mapper", &words);
    for part in ["'--sequence <NN>'", "cannot be used with", "'--scans <FOLDER>'"] {
        assert!(ran.code == 2 && ran.err.contains(part), "{ran:?}");
    }
}
