//! Images to network inputs and network outputs to image planes: bilinear,
//! with the centres of pixels at half-integers of the image's extent, so that
//! nothing shifts when the size changes.

use crate::vision::{Plane, RgbImage};

use super::spec::{ChannelOrder, Fit, Layout, NetworkSpec};

/// Where a network sees an image: network pixels per image pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct View {
    /// Width and height of the network's input, pixels.
    pub(super) size: (usize, usize),
    scale: (f64, f64),
    /// How far outputs lie from what they show, input pixels.
    shift: [f64; 2],
}

impl View {
    /// How an image of `image` pixels lies in an input of `size` pixels.
    pub(super) fn new(spec: &NetworkSpec, image: (usize, usize), size: (usize, usize)) -> Self {
        let scale = (size.0 as f64 / image.0 as f64, size.1 as f64 / image.1 as f64);
        let (least, most) = (scale.0.min(scale.1), scale.0.max(scale.1));
        let is_near = most <= NEAR * least;
        let scale = match spec.fit {
            Fit::Stretch => scale,
            Fit::Near if is_near => scale,
            Fit::Near | Fit::Pad => (least, least),
        };
        Self { size, scale, shift: spec.shift_px }
    }
}

/// Largest ratio of the scales of both axes at which an image is stretched ([`Fit::Near`]).
const NEAR: f64 = 1.25;

/// Two neighbours and the share of the second.
#[derive(Debug, Clone, Copy)]
struct Tap {
    first: usize,
    second: usize,
    share: f32,
}

/// The taps of the outputs that see the input, `step` input pixels apart: all
/// of them, or where the input is padded, the leading ones. What they see is
/// found `shift` input pixels further on.
fn taps(outputs: usize, inputs: usize, step: f64, shift: f64) -> Vec<Tap> {
    let last = inputs.saturating_sub(1);
    (0..outputs)
        .map(|output| (output as f64 + 0.5) * step - 0.5)
        .take_while(|&at| at < inputs as f64 - 0.5 + 1e-9)
        .map(|at| {
            let at = (at + shift).clamp(0.0, last as f64);
            Tap { first: at as usize, second: (at as usize + 1).min(last), share: (at - at.floor()) as f32 }
        })
        .collect()
}

/// The image as the network wants it: resized, normalised, in its layout.
/// Padding is black before normalisation, the rows above `top` are left out.
pub(super) fn to_input(image: &RgbImage, view: &View, top: usize, spec: &NetworkSpec) -> Vec<f32> {
    let columns = taps(view.size.0, image.width(), 1.0 / view.scale.0, 0.0);
    let rows = taps(view.size.1, image.height(), 1.0 / view.scale.1, 0.0);
    let (width, height) = (view.size.0, view.size.1 - top);
    let (pixel, plane) = match spec.layout {
        Layout::Nchw => (1, width * height),
        Layout::Nhwc => (3, 1),
    };
    let mut input = vec![0.0; 3 * width * height];
    let mut blended = vec![0.0_f32; 3 * image.width()];
    for y in 0..height {
        blended.fill(0.0);
        if let Some(tap) = rows.get(top + y) {
            let pair = image.row(tap.first).iter().zip(image.row(tap.second));
            for (out, (&a, &b)) in blended.iter_mut().zip(pair) {
                *out = lerp(f32::from(a), f32::from(b), tap.share);
            }
        }
        for channel in 0..3 {
            let from = match spec.channels {
                ChannelOrder::Rgb => channel,
                ChannelOrder::Bgr => 2 - channel,
            };
            let (gain, bias) = spec.gain_and_bias(channel);
            let at = y * width * pixel + channel * plane;
            let outputs = input.iter_mut().skip(at).step_by(pixel).take(width);
            let seen = columns
                .iter()
                .map(|tap| lerp(blended[3 * tap.first + from], blended[3 * tap.second + from], tap.share));
            for (out, value) in outputs.zip(seen.chain(std::iter::repeat(0.0))) {
                *out = value * gain + bias;
            }
        }
    }
    input
}

/// A plane of probabilities that the network gave over its whole input,
/// `size` pixels, as a plane of the image, `image` pixels.
pub(super) fn to_plane(values: &[f32], size: (usize, usize), view: &View, image: (usize, usize)) -> Plane {
    // Outputs per input pixel.
    let density = (size.0 as f64 / view.size.0 as f64, size.1 as f64 / view.size.1 as f64);
    let columns = taps(image.0, size.0, view.scale.0 * density.0, view.shift[0] * density.0);
    let rows = taps(image.1, size.1, view.scale.1 * density.1, view.shift[1] * density.1);
    let mut plane = Plane::zeros(image.0, image.1);
    let mut blended = vec![0.0_f32; size.0];
    for (tap, out) in rows.iter().zip(plane.data_mut().chunks_exact_mut(image.0)) {
        let pair = values[tap.first * size.0..].iter().zip(&values[tap.second * size.0..]);
        for (out, (&a, &b)) in blended.iter_mut().zip(pair) {
            *out = lerp(a, b, tap.share);
        }
        for (out, tap) in out.iter_mut().zip(&columns) {
            // The cast saturates, so nothing outside 0..1 wraps around.
            *out = (lerp(blended[tap.first], blended[tap.second], tap.share) * 255.0 + 0.5) as u8;
        }
    }
    plane
}

fn lerp(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image that is brighter by 2 per column and by 3 per row.
    fn ramp(width: usize, height: usize) -> RgbImage {
        let value = |i: usize| (2 * (i % width) + 3 * (i / width)) as u8;
        RgbImage::new(width, (0..width * height).flat_map(|i| [value(i); 3]).collect()).unwrap()
    }

    fn spec(fit: Fit) -> NetworkSpec {
        // Network values are probabilities x 255 in this test.
        NetworkSpec { fit, scale: 1.0 / 255.0, ..NetworkSpec::default() }
    }

    #[test]
    fn an_image_of_another_shape_is_padded() {
        let scale = |fit: Fit, image| View::new(&spec(fit), image, (1248, 384)).scale;
        for kitti in [(1242, 375), (1226, 370), (1392, 512)] {
            assert_eq!(scale(Fit::Near, kitti), scale(Fit::Stretch, kitti));
        }
        for other in [(1920, 1080), (640, 480), (2000, 400)] {
            assert_eq!(scale(Fit::Near, other), scale(Fit::Pad, other));
        }
    }

    #[test]
    fn there_and_back_nothing_shifts() {
        for (fit, size) in [(Fit::Stretch, (48, 39)), (Fit::Pad, (64, 30))] {
            let image = ramp(40, 30);
            let view = View::new(&spec(fit), (40, 30), size);
            let input = to_input(&image, &view, 0, &spec(fit));
            let plane = to_plane(&input[..size.0 * size.1], size, &view, (40, 30));
            // At the border the nearest pixel is repeated, so look inside.
            for y in 2..28 {
                for x in 2..38 {
                    let (is, was) = (plane.row(y)[x], image.row(y)[3 * x]);
                    assert!(is.abs_diff(was) <= 1, "{fit:?} {x} {y}: {is} {was}");
                }
            }
        }
    }

    #[test]
    fn a_coarse_output_is_spread_over_the_image() {
        // 10x5 outputs over a 20x10 input over a 40x20 image: 4 pixels per output.
        let view = View::new(&spec(Fit::Stretch), (40, 20), (20, 10));
        let values: Vec<f32> = (0..50).map(|i| (i % 10) as f32 / 10.0).collect();
        let plane = to_plane(&values, (10, 5), &view, (40, 20));
        // Output 4 has its centre at image x = 17.5, output 5 at 21.5.
        let between = f64::midpoint(f64::from(plane.row(9)[19]), f64::from(plane.row(9)[20]));
        assert!((between / 255.0 - 0.45).abs() < 0.003, "{between}");
    }

    #[test]
    fn a_known_shift_is_taken_back() {
        // 8 inputs over 16 image pixels; the output shows things 1.5 inputs too low.
        let spec = NetworkSpec { shift_px: [0.0, 1.5], ..spec(Fit::Stretch) };
        let view = View::new(&spec, (4, 16), (4, 8));
        let values: Vec<f32> = (0..32).map(|i| (i / 4) as f32 / 10.0).collect();
        let plane = to_plane(&values, (4, 8), &view, (4, 16));
        // Image row 4.5 is input row 2, which shows up in output row 3.5.
        let between = f64::midpoint(f64::from(plane.row(4)[0]), f64::from(plane.row(5)[0]));
        assert!((between / 255.0 - 0.35).abs() < 0.003, "{between}");
    }

    #[test]
    fn padding_is_black_and_layouts_agree() {
        let image = ramp(8, 8);
        let view = View::new(&spec(Fit::Pad), (8, 8), (12, 8));
        let planar = spec(Fit::Pad);
        let packed = NetworkSpec { layout: Layout::Nhwc, channels: ChannelOrder::Bgr, ..planar.clone() };
        let (a, b) = (to_input(&image, &view, 0, &planar), to_input(&image, &view, 0, &packed));
        assert!(a[8].abs() < 1e-9);
        for i in 0..96 {
            assert!((a[i] - b[3 * i]).abs() < 1e-9);
        }
    }
}
