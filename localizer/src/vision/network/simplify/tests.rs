use std::path::Path;

use rten_onnx::onnx::{TensorProto, ValueInfoProto};

use super::*;
use crate::vision::network::graphs::{floats, model, node, value};
use crate::vision::network::runtime::Runtime;
use crate::vision::network::tests::shared;

/// Weights none of which is zero, but for those at `zeros` of an axis.
fn weights(name: &str, sizes: &[usize], axis: usize, zeros: &[usize]) -> TensorProto {
    let after: usize = sizes[axis + 1..].iter().product();
    let is_zero = |i: usize| zeros.contains(&(i / after % sizes[axis]));
    let value = |i: usize| if is_zero(i) { 0.0 } else { ((i * 37 + name.len()) % 19) as f32 / 10.0 - 0.95 };
    floats(name, sizes, &(0..sizes.iter().product()).map(value).collect::<Vec<_>>())
}

fn simpler(model: &ModelProto) -> Option<GraphProto> {
    ModelProto::parse_buf(&simplified(&model.write_buf().unwrap())?).unwrap().graph
}

/// The sizes of the constant that a node of this output has at an input.
fn sizes<'a>(graph: &'a GraphProto, output: &str, input: usize) -> &'a [i64] {
    let node = graph.node.iter().find(|node| node.output == [output]).unwrap();
    let is_it = |tensor: &&TensorProto| tensor.name.as_ref() == Some(&node.input[input]);
    &graph.initializer.iter().find(is_it).unwrap().dims
}

fn operators(graph: &GraphProto) -> Vec<&str> {
    graph.node.iter().map(|node| node.op_type.as_deref().unwrap()).collect()
}

fn run(model: &[u8], shape: [usize; 4], values: &[f32]) -> Vec<f32> {
    let model = Runtime::Rten.load(Path::new("hand.onnx"), model.to_vec()).unwrap();
    model.run((0, 0), shape, values.to_vec()).unwrap().values
}

/// Runs a model as it is and simplified.
fn assert_same_output(model: &ModelProto, shape: [usize; 4], count: usize) {
    let whole = model.write_buf().unwrap();
    let simpler = simplified(&whole).unwrap();
    let values: Vec<f32> = (0..shape.iter().product()).map(|i: usize| ((i * 61) % 97) as f32 / 48.5 - 1.0).collect();
    let (is, should) = (run(&simpler, shape, &values), run(&whole, shape, &values));
    assert_eq!(is.len(), count);
    assert!(is.iter().zip(&should).all(|(is, should)| (is - should).abs() < 1e-5), "{is:?} {should:?}");
    assert!(simplified(&simpler).is_none());
}

/// `rten` knows no default.
const PLAIN: [(&str, &[i64]); 3] = [("strides", &[1, 1]), ("dilations", &[1, 1]), ("pads", &[0; 4])];

/// Two branches that are laid on each other and made larger: of the first
/// one's four channels three are read, one of them by what nobody reads, and
/// of the second one's two one.
fn branches() -> ModelProto {
    let nodes = vec![
        node("Conv", &["image", "first", "bias"], "a", &[("pads", &[1, 1, 1, 1]), PLAIN[0], PLAIN[1]]),
        node("Mul", &["slope", "a"], "scaled", &[]),
        node("Relu", &["a"], "positive", &[]),
        node("Mul", &["positive", "rest"], "lifted", &[]),
        node("Add", &["scaled", "lifted"], "bent", &[]),
        node("Conv", &["image", "second"], "b", &PLAIN),
        node("Concat", &["bent", "b"], "both", &[("axis", &[1])]),
        node("BatchNormalization", &["both", "scale", "shift", "mean", "variance"], "even", &[]),
        node("ConvTranspose", &["even", "larger"], "large", &[("strides", &[2, 2]), PLAIN[1], PLAIN[2]]),
        node("Conv", &["large", "last"], "out", &PLAIN),
    ];
    let mut variance = floats("variance", &[6], &[]);
    variance.raw_data = None;
    variance.float_data = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    let larger = weights("larger", &[6, 3, 2, 2], 0, &[3, 5]);
    // Channel 1 is read by channel 2 of the larger image alone.
    larger.raw_data.as_ref().unwrap().borrow_mut()[4 * 12..4 * 20].fill(0);
    let tensors = vec![
        weights("first", &[4, 2, 3, 3], 0, &[]),
        weights("bias", &[4], 0, &[]),
        weights("slope", &[1, 4, 1, 1], 1, &[]),
        weights("rest", &[4, 1, 1], 0, &[]),
        weights("second", &[2, 2, 1, 1], 0, &[]),
        weights("scale", &[6], 0, &[]),
        weights("shift", &[6], 0, &[]),
        weights("mean", &[6], 0, &[]),
        variance,
        larger,
        weights("last", &[1, 3, 1, 1], 1, &[2]),
    ];
    model([1, 2, 5, 7], nodes, tensors, &["out"])
}

#[test]
fn channels_that_nobody_reads_go_all_the_way() {
    let graph = simpler(&branches()).unwrap();
    for (output, input, expected) in [
        ("a", 1, &[2, 2, 3, 3][..]),
        ("a", 2, &[2]),
        ("scaled", 0, &[1, 2, 1, 1]),
        ("lifted", 1, &[2, 1, 1]),
        ("b", 1, &[1, 2, 1, 1]),
        ("even", 4, &[3]),
        ("large", 1, &[3, 2, 2, 2]),
        ("out", 1, &[1, 2, 1, 1]),
    ] {
        assert_eq!(sizes(&graph, output, input), expected, "{output} {input}");
    }
    assert!(!graph.initializer.iter().any(|tensor| tensor.name.as_deref() == Some("first")));
    assert_same_output(&branches(), [1, 2, 5, 7], 10 * 14);
}

/// A convolution of two channels, and one that reads the first of them.
fn pair(between: &[NodeProto], outputs: &[&str]) -> ModelProto {
    let read = between.last().map_or("a", |node| &node.output[0]);
    let (first, last) = (node("Conv", &["image", "first"], "a", &[]), node("Conv", &[read, "last"], "out", &[]));
    let constants = vec![
        weights("first", &[2, 2, 1, 1], 0, &[]),
        weights("last", &[1, 2, 1, 1], 1, &[1]),
        weights("each", &[2, 1, 1], 0, &[]),
        weights("columns", &[2], 0, &[]),
        weights("grouped", &[2, 1, 1, 1], 0, &[]),
    ];
    model([1, 2, 2, 2], [&[first], between, &[last]].concat(), constants, outputs)
}

#[test]
fn a_channel_that_anything_else_reads_stays() {
    let made = |between: &[NodeProto], outputs: &[&str]| {
        simpler(&pair(between, outputs)).map(|graph| sizes(&graph, "a", 1)[0])
    };
    assert_eq!(made(&[], &["out"]), Some(1));
    assert_eq!(made(&[node("Mul", &["a", "each"], "b", &[])], &["out"]), Some(1));
    // The output of the graph is read by whoever runs it.
    assert_eq!(made(&[], &["out", "a"]), None);
    for stays in [
        &[node("Softmax", &["a"], "b", &[("axis", &[1])])][..],
        &[node("Conv", &["a", "grouped"], "b", &[("group", &[2])])],
        // These lie along columns.
        &[node("Mul", &["a", "columns"], "b", &[])],
        &[node("Mul", &["a", "columns"], "b", &[("axis", &[1]), ("broadcast", &[1])])],
        &[node("Concat", &["a", "a"], "c", &[("axis", &[2])]), node("Relu", &["c"], "b", &[])],
        &[node("Add", &["a", "image"], "b", &[])],
        &[node("Transpose", &["a"], "t", &[]), node("Relu", &["a"], "b", &[])],
        &[
            node("Conv", &["image", "first"], "c", &[]),
            node("Exp", &["c"], "t", &[]),
            node("Add", &["a", "c"], "b", &[]),
        ],
    ] {
        assert_eq!(made(stays, &["out", "t"]), None, "{stays:?}");
    }
    let mut foreign = node("Relu", &["a"], "b", &[]);
    foreign.domain = Some("elsewhere".into());
    assert_eq!(made(&[foreign], &["out"]), None);
}

#[test]
fn a_constant_that_others_read_stays_for_them() {
    let nodes = [node("Mul", &["image", "each"], "other", &[]), node("Mul", &["a", "each"], "b", &[])];
    let graph = simpler(&pair(&nodes, &["out", "other"])).unwrap();
    assert_eq!((sizes(&graph, "other", 1), sizes(&graph, "b", 1)), (&[2, 1, 1][..], &[1, 1, 1][..]));
}

#[test]
fn something_is_left_of_what_nobody_reads_at_all() {
    let mut whole = pair(&[], &["out"]);
    whole.graph.as_mut().unwrap().initializer[1] = weights("last", &[1, 2, 1, 1], 1, &[0, 1]);
    let graph = simpler(&whole).unwrap();
    assert_eq!((sizes(&graph, "a", 1), sizes(&graph, "out", 1)), (&[1, 2, 1, 1][..], &[1, 1, 1, 1][..]));
}

/// Pooling of 3 pixels into 2 and, the other way, of 2 into 3.
fn pooling(spoilt: usize) -> ModelProto {
    let matrix = |name: &str, high: usize, wide: usize| {
        let block = |i: usize| 0.5 + (i / (wide * 8) % high + 2 * (i % (wide * 8) % wide)) as f32;
        let at = |i: usize| if i / (wide * 8) / high == i % (wide * 8) / wide { block(i) } else { 0.0 };
        let mut values: Vec<f32> = (0..64 * high * wide).map(at).collect();
        values[2] += spoilt as f32;
        values[wide] += spoilt as f32;
        floats(name, &[8 * high, 8 * wide], &values)
    };
    let nodes = vec![node("MatMul", &["rows", "image"], "a", &[]), node("MatMul", &["a", "columns"], "out", &[])];
    let mut model = model([1, 2, 24, 16], nodes, vec![matrix("rows", 2, 3), matrix("columns", 2, 3)], &["out"]);
    model.graph.as_mut().unwrap().value_info = vec![value("a", [1, 2, 16, 16])];
    model
}

#[test]
fn products_with_blocks_along_a_diagonal_are_those_with_one_block() {
    let graph = simpler(&pooling(0)).unwrap();
    assert_eq!(operators(&graph), ["Reshape", "MatMul", "Reshape", "Reshape", "MatMul", "Reshape"]);
    assert!(graph.initializer.iter().all(|tensor| tensor.dims.iter().product::<i64>() <= 6));
    assert_same_output(&pooling(0), [1, 2, 24, 16], 2 * 16 * 24);
    assert!(simpler(&pooling(1)).is_none());
}

#[test]
fn no_graph_makes_it_panic() {
    for make in [branches, || pooling(0)] {
        let try_with = |change: &dyn Fn(&mut GraphProto)| {
            let mut changed = make();
            change(changed.graph.as_mut().unwrap());
            simplified(&changed.write_buf().unwrap());
        };
        let graph = make().graph.unwrap();
        for tensor in 0..graph.initializer.len() {
            for sizes in [&[][..], &[0], &[-1, 2], &[i64::MAX, i64::MAX, 4], &[6], &[1; 9], &[2, 2, 1, 1], &[1, 384]] {
                try_with(&|graph| graph.initializer[tensor].dims = sizes.to_vec());
            }
            try_with(&|graph| graph.initializer[tensor].raw_data = None);
            try_with(&|graph| graph.initializer[tensor].name = None);
        }
        for at in 0..graph.node.len() {
            try_with(&|graph| graph.node[at].input.clear());
            try_with(&|graph| graph.node[at].input.truncate(1));
            try_with(&|graph| graph.node[at].input.reverse());
            try_with(&|graph| graph.node[at].output.clear());
            try_with(&|graph| graph.node[at].output = vec!["a".into()]);
            try_with(&|graph| graph.node[at].attribute.clear());
            try_with(&|graph| graph.node.rotate_left(at));
            for operator in ["Conv", "ConvTranspose", "Concat", "BatchNormalization", "Clip", "Constant", "MatMul"] {
                try_with(&|graph| graph.node[at].op_type = Some(operator.into()));
            }
        }
        try_with(&|graph| graph.value_info = vec![ValueInfoProto::default(), value("a", [0, -1, 1, i64::MAX])]);
        let bytes = make().write_buf().unwrap();
        for length in 0..bytes.len() {
            simplified(&bytes[..length]);
        }
    }
}

#[test]
fn the_known_networks_do_less_and_say_the_same() {
    let Some(shared) = shared() else { return };
    let image = crate::vision::read_image(shared.join("kitti/sequences/04/image_2/000000.png")).unwrap();
    let pixel = |channel: usize, row: usize, column: usize| {
        image.row(row.min(image.height() - 1)).get(3 * column + channel).map_or(0.0, |&value| f32::from(value) / 255.0)
    };
    let image: Vec<f32> = (0..3 * 384 * 1248).map(|i| pixel(i / (384 * 1248), i / 1248 % 384, i % 1248)).collect();
    for (name, products) in [("espnetv2_cityscapes_384x1248.onnx", 9), ("twinlitenet_lane_384x1248.onnx", 0)] {
        let mut whole = std::fs::read(shared.join("models").join(name)).unwrap();
        crate::vision::network::denormals::flush(&mut whole);
        let simpler = simplified(&whole).unwrap();
        let graph = ModelProto::parse_buf(&simpler).unwrap().graph.unwrap();
        if products == 0 {
            assert_eq!(sizes(&graph, "/Conv_20_output_0", 1), [54, 131, 3, 3]);
        }
        let reshaped = graph.node.iter().filter(|node| node.name.is_none() && is(node, "MatMul"));
        assert_eq!(reshaped.count(), products);
        let (is, should) = (run(&simpler, [1, 3, 384, 1248], &image), run(&whole, [1, 3, 384, 1248], &image));
        let off = is.iter().zip(&should).map(|(is, should)| (is - should).abs()).fold(0.0, f32::max);
        println!("{name}: largest difference of a probability {off:e}");
        assert!(off < 1e-3 && should.iter().any(|&probability| probability > 0.9));
    }
}
