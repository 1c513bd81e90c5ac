//! What the localizer is given to look at, and it cannot be: images, networks, odometry.

use std::path::{Path, PathBuf};

use common::map::{EncodeOptions, SemanticMap};

use crate::support::{DEMO, Ran, plain, run, run_with, text, write_png};

/// `localizer run` in an empty map of the plain drive.
fn localize(root: &Path, more: &[&str]) -> Ran {
    let map = root.join("empty.csm");
    common::map::write(&map, &SemanticMap::default(), &EncodeOptions::default()).unwrap();
    let out = root.join("out");
    let words = ["run", "--map", text(&map), "--kitti", text(root), "--sequence", "04", "--out", text(&out)];
    run("localizer", &[&words[..], more].concat())
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

/// A night of `segment` is not lost for one image.
#[test]
fn a_damaged_image_costs_no_other_its_labels() {
    let root = plain();
    let images = root.path().join("sequences/04/image_2");
    for frame in 0..3 {
        write_png(&images.join(format!("{frame:06}.png")), (1226, 370), png::ColorType::Rgb);
    }
    std::fs::write(images.join("000001.png"), "no image").unwrap();
    let network = tiny_network(root.path());
    let description = "mean = [0, 0, 0]\nstd = [1, 1, 1]\n[classes]\npole = [0]\n";
    std::fs::write(network.with_extension("toml"), description).unwrap();
    let out = root.path().join("labels");
    let ran =
        run("localizer", &["segment", "--kitti", text(root.path()), "--pole-net", text(&network), "--out", text(&out)]);
    assert!(ran.code == 2 && ran.out.contains("2 frames written"), "{ran:?}");
    for said in ["note: frame 1 is passed over: ", "000001.png", "the images of 1 frames could not be read"] {
        assert!(ran.err.contains(said), "{ran:?}");
    }
    let written = |frame: usize| out.join(format!("pole/{frame:06}.png")).is_file();
    assert_eq!([0, 1, 2].map(written), [true, false, true]);
}

/// Built with the feature `ort` or without it.
#[test]
fn a_runtime_that_is_not_there() {
    let root = plain();
    let network = tiny_network(root.path());
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
    let network = tiny_network(root.path());
    std::fs::write(network.with_extension("toml"), "[classes]\npole = [0]\n").unwrap();
    let ran = localize(root.path(), &["--pole-net", text(&network)]);
    ran.refused(&["000000.png has 613x185 px", "neither scaled nor cropped"]);
}

#[test]
fn a_network_with_other_shapes() {
    let root = plain();
    write_png(&root.path().join("sequences/04/image_2/000000.png"), (1226, 370), png::ColorType::Rgb);
    let network = tiny_network(root.path());
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

/// A network of 8 by 4 pixels in a folder, of which nobody knows what it says.
fn tiny_network(folder: &Path) -> PathBuf {
    let network = folder.join("tiny.onnx");
    std::fs::write(&network, sigmoid_network([1, 3, 4, 8])).unwrap();
    network
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
