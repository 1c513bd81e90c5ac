//! Networks written by hand, byte by byte: one input, a layer or two, one
//! output.

use super::*;

fn message(number: u8, content: &[u8]) -> Vec<u8> {
    let mut length = content.len();
    let mut bytes = vec![number << 3 | 2];
    while length > 127 {
        bytes.push(length as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
    [bytes, content.to_vec()].concat()
}

fn number(field: u8, value: u8) -> Vec<u8> {
    vec![field << 3, value]
}

/// `ValueInfoProto` of a float tensor.
fn value(name: &str, shape: [u8; 4]) -> Vec<u8> {
    let dims: Vec<u8> = shape.iter().flat_map(|&d| message(1, &number(1, d))).collect();
    let tensor = [number(1, 1), message(2, &dims)].concat();
    [message(1, name.as_bytes()), message(2, &message(1, &tensor))].concat()
}

/// `NodeProto` of an operator, with an axis where it has one.
fn node(operator: &str, axis: Option<u8>, input: &str, output: &str) -> Vec<u8> {
    // Its `AttributeProto`, of type INT, which is field 20.
    let attribute = |axis| [message(1, b"axis"), number(3, axis), vec![0xa0, 1, 2]].concat();
    let attribute = axis.map_or_else(Vec::new, |axis| message(5, &attribute(axis)));
    let ends = [message(1, input.as_bytes()), message(2, output.as_bytes())].concat();
    [ends, message(3, output.as_bytes()), message(4, operator.as_bytes()), attribute].concat()
}

fn network_of(nodes: &[Vec<u8>], output: &str, shape: [u8; 4]) -> Vec<u8> {
    let nodes: Vec<u8> = nodes.iter().flat_map(|node| message(1, node)).collect();
    let graph =
        [nodes, message(2, b"tiny"), message(11, &value("image", shape)), message(12, &value(output, shape))].concat();
    [number(1, 8), message(7, &graph), message(8, &number(2, 17))].concat()
}

fn sigmoid_network(output: &str, shape: [u8; 4]) -> Vec<u8> {
    network_of(&[node("Sigmoid", None, "image", output)], output, shape)
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn network(&self, output: &str, shape: [u8; 4], toml: Option<&str>) -> Result<Network, Error> {
        let path = self.0.path().join("tiny.onnx");
        std::fs::write(&path, sigmoid_network(output, shape)).unwrap();
        if let Some(toml) = toml {
            std::fs::write(path.with_extension("toml"), toml).unwrap();
        }
        Network::load(path, Runtime::default())
    }

    fn refusal(&self, toml: &str) -> String {
        self.network("scores", [1, 3, 4, 8], Some(toml)).err().unwrap().to_string()
    }
}

#[test]
fn a_described_network_runs_on_an_image_of_another_size() {
    let toml = "mean = [0.0, 0.5, 0.0]\n[classes]\nsign = [1]\nlane = [0, 2]\n";
    let network = Folder::new().network("scores", [1, 3, 4, 8], Some(toml)).unwrap();
    assert_eq!(network.classes().collect::<Vec<_>>(), [Class::Sign, Class::Lane]);
    let image = RgbImage::new(16, [0, 255, 0].repeat(16 * 6)).unwrap();
    let maps = run_all(&[network], &image).unwrap();
    // sigmoid(1 - 0.5) = 0.622; twice sigmoid(0) = 1.
    assert!(maps.plane(Class::Sign).data().iter().all(|&p| p == 159));
    assert!(maps.plane(Class::Lane).data().iter().all(|&p| p == 255));
    assert!(maps.plane(Class::Pole).data().iter().all(|&p| p == 0));
    assert_eq!((maps.width(), maps.height()), (16, 6));
}

#[test]
fn a_softmax_at_the_end_is_the_same_whatever_is_behind_it() {
    let folder = Folder::new();
    let path = folder.0.path().join("tiny.onnx");
    let run = |nodes: &[Vec<u8>]| {
        std::fs::write(&path, network_of(nodes, "out", [1, 3, 4, 8])).unwrap();
        std::fs::write(path.with_extension("toml"), "[classes]\nsign = [1]\nlane = [2]\n").unwrap();
        let network = Network::load(&path, Runtime::default()).unwrap();
        let maps = run_all(&[network], &RgbImage::new(8, [0, 255, 0].repeat(8 * 4)).unwrap()).unwrap();
        [Class::Sign, Class::Lane].map(|class| maps.plane(class).data()[17])
    };
    // Over channels e / (e + 2) = 0.576 and 1 / (e + 2) = 0.212.
    assert_eq!(run(&[node("Softmax", Some(1), "image", "out")]), [147, 54]);
    // sigmoid(0.576) = 0.640, sigmoid(0.212) = 0.553.
    let behind = [node("Softmax", Some(1), "image", "inner"), node("Sigmoid", None, "inner", "out")];
    assert_eq!(run(&behind), [163, 141]);
    // Over columns 1 / 8.
    assert_eq!(run(&[node("Softmax", Some(3), "image", "out")]), [32, 32]);
}

/// A network of 8 columns and 64 rows whose values pass through this shape
/// and back, in which its size is fixed.
fn fixed_network(inner: &[u64]) -> Vec<u8> {
    let shape = |name: &str, sizes: &[u64]| {
        let raw: Vec<u8> = sizes.iter().flat_map(|size| size.to_le_bytes()).collect();
        message(
            5,
            &[number(1, sizes.len() as u8), number(2, 7), message(8, name.as_bytes()), message(9, &raw)].concat(),
        )
    };
    let reshape = |input: &str, shape: &str, output: &str| {
        let ends = [message(1, input.as_bytes()), message(1, shape.as_bytes()), message(2, output.as_bytes())].concat();
        message(1, &[ends, message(3, output.as_bytes()), message(4, b"Reshape")].concat())
    };
    let size = [1, 3, 64, 8];
    let graph = [
        reshape("image", "there", "flat"),
        reshape("flat", "back", "again"),
        message(1, &node("Sigmoid", None, "again", "out")),
        message(2, b"fixed"),
        shape("there", inner),
        shape("back", &size.map(u64::from)),
        message(11, &value("image", size)),
        message(12, &value("out", size)),
    ]
    .concat();
    [number(1, 8), message(7, &graph), message(8, &number(2, 17))].concat()
}

#[test]
fn rows_that_hold_nothing_are_left_out_until_something_reaches_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fixed.onnx");
    let load = |inner: &[u64], skip_top: &str| {
        std::fs::write(&path, fixed_network(inner)).unwrap();
        let toml = format!("mean = [0.5, 0.5, 0.5]\n{skip_top}\n[classes]\nlane = [1]\n");
        std::fs::write(path.with_extension("toml"), toml).unwrap();
        Network::load(&path, Runtime::default())
    };
    // Dark with one bright row: sigmoid(-0.5) = 0.378 and sigmoid(0.5) = 0.622.
    let rows = |network: &Network, bright: usize| {
        let grey = |i: usize| if i / 8 == bright { 255 } else { 0 };
        let image = RgbImage::new(8, (0..8 * 64).flat_map(|i| [grey(i); 3]).collect()).unwrap();
        let mut maps = ProbabilityMaps::zeros(8, 64);
        network.run(&image, &mut maps).unwrap();
        [0, 31, 32, bright].map(|row| maps.plane(Class::Lane).data()[8 * row + 3])
    };
    let planes = [1, 3, 512];
    assert_eq!(rows(&load(&planes, "").unwrap(), 50), [96, 96, 96, 159]);
    let lower = load(&planes, "skip_top = 0.5").unwrap();
    assert_eq!(rows(&lower, 50), [0, 0, 96, 159]);
    assert_eq!(rows(&lower, 33), [96, 96, 96, 159]);
    let error = load(&[1, 3, 64, 8], "skip_top = 1.0").err().unwrap().to_string();
    assert!(error.contains("`skip_top` must be at least 0 and below 1"), "{error}");
    // Here its size is in numbers that are no extent of its planes.
    let error = load(&[1, 6, 256], "skip_top = 0.5").err().unwrap().to_string();
    assert!(error.contains("it does not run with `skip_top`") && error.contains("fixed.toml"), "{error}");
}

#[test]
fn an_undescribed_network_is_told_where_to_be_described() {
    let error = Folder::new().network("scores", [1, 3, 4, 8], None).err().unwrap().to_string();
    assert!(
        error.contains("scores 1x3x4x8") && error.contains("describe it in") && error.contains("tiny.toml"),
        "{error}"
    );
}

#[test]
fn each_contradiction_has_its_sentence() {
    let lane = "[classes]\nlane = [0]\n";
    for (toml, part) in [
        ("[classes]\nlane = [3]\n", "channel 3 and the output has 3"),
        ("[classes]\n", "names no output channel"),
        (&format!("width = 9\n{lane}"), "the network's width is 8 and the description says 9"),
        (&format!("input = \"x\"\n{lane}"), "it has no input `x`"),
        (&format!("skip_top = -0.1\n{lane}"), "`skip_top` must be at least 0 and below 1"),
        (&format!("layout = \"nhwc\"\n{lane}"), "8 channels where 1 of 3 is needed"),
        (&format!("std = [1.0, 0.0, 1.0]\n{lane}"), "must be positive"),
        (&format!("heigth = 4\n{lane}"), "did you mean `height`"),
        (&format!("layout = \"nhcw\"\n{lane}"), "tiny.toml:1: unknown variant `nhcw`"),
        ("[classes]\nlane = 0\n", "tiny.toml:2: "),
    ] {
        let error = Folder::new().refusal(toml);
        assert!(error.contains(part), "{toml}: {error}");
    }
}

#[test]
fn an_input_that_no_memory_holds_is_refused() {
    let open = Folder::new();
    let error = open.network("scores", [1, 3, 0, 0], Some("width = 64\nheight = 900000\n[classes]\nlane = [0]\n"));
    let error = error.err().unwrap().to_string();
    assert!(error.contains("a height of 900000 pixels is more than the 16384 that are taken"), "{error}");
}

#[test]
fn what_is_no_network_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.onnx");
    let whole = sigmoid_network("scores", [1, 3, 4, 8]);
    for bytes in [&b""[..], b"hello, this is text", &whole[..whole.len() / 2]] {
        std::fs::write(&path, bytes).unwrap();
        let error = Network::load(&path, Runtime::default()).err().unwrap().to_string();
        assert!(error.contains("broken.onnx"), "{error}");
    }
}

/// The shared folder of real data and networks, where it is.
pub(super) fn shared() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let shared = std::env::var_os("WAYMARK_DATA").map_or(beside, PathBuf::from);
    let is_there = shared.join("models").is_dir() && shared.join("kitti").is_dir();
    if !is_there {
        println!("no real networks (set WAYMARK_DATA): not tested with them");
    }
    is_there.then_some(shared)
}

#[test]
fn the_known_networks_need_no_description_and_find_a_real_lamp_post_and_lane() {
    let Some(shared) = shared() else { return };
    let networks = ["espnetv2_cityscapes_384x1248.onnx", "twinlitenet_lane_384x1248.onnx"]
        .map(|name| Network::load(shared.join("models").join(name), Runtime::default()).unwrap());
    let image = crate::vision::read_image(shared.join("kitti/sequences/04/image_2/000000.png")).unwrap();
    let maps = run_all(&networks, &image).unwrap();
    let features = crate::vision::extract(&maps, Some(&image.grey()), &crate::vision::VisionConfig::default());
    // By eye in the image: the mast beside the speed limit, and the left end
    // of the lane's own line.
    let column_at = |line: &crate::features::LineFeature, row: f64| {
        let (a, b) = (line.upper_px, line.lower_px);
        a.x + (b.x - a.x) * (row - a.y) / (b.y - a.y)
    };
    let near = |line: &crate::features::LineFeature, u: f64, v: f64| (column_at(line, v) - u).abs() < 2.0;
    assert!(features.poles.iter().any(|pole| near(pole, 800.3, 100.0) && pole.length_px() > 200.0));
    assert!(features.lanes.iter().any(|lane| near(&lane.line, 471.0, 328.0)));
}

#[cfg(feature = "ort")]
#[test]
fn both_runtimes_give_the_same_probabilities() {
    let Some(shared) = shared() else { return };
    if std::env::var_os("ORT_DYLIB_PATH").is_none() {
        println!("no ONNX Runtime (set ORT_DYLIB_PATH): not tested with it");
        return;
    }
    let load = |runtime| {
        ["espnetv2_cityscapes_384x1248.onnx", "twinlitenet_lane_384x1248.onnx"]
            .map(|name| Network::load(shared.join("models").join(name), runtime).unwrap())
    };
    let (built_in, other) = (load(Runtime::Rten), load(Runtime::Ort));
    for frame in ["000000", "000040"] {
        let image = shared.join(format!("kitti/sequences/04/image_2/{frame}.png"));
        let image = crate::vision::read_image(image).unwrap();
        let maps = [&built_in, &other].map(|networks| run_all(networks, &image).unwrap());
        for class in Class::ALL {
            let [a, b] = maps.each_ref().map(|maps| maps.plane(class).data());
            let off = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
            let count = a.iter().zip(b).filter(|(a, b)| a != b).count();
            println!("frame {frame}, {class:?}: largest difference {off:?} of 255, at {count} of {} pixels", a.len());
            assert!(off <= Some(1));
        }
    }
}
