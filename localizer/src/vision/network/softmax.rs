//! Softmax over channels that lie in planes, one after the other.

use rayon::prelude::*;
use rten_simd::SimdUnaryOp as _;
use rten_vecmath::Exp;

/// Pixels of which all channels are looked at together: those of twenty are
/// 40 KB, which the nearest cache holds.
const BLOCK: usize = 512;

/// Makes probabilities of the logits of `channels` planes.
pub(super) fn over_channels(values: &mut [f32], channels: usize) {
    let pixels = values.len() / channels.max(1);
    let mut blocks: Vec<Vec<&mut [f32]>> = Vec::new();
    blocks.resize_with(pixels.div_ceil(BLOCK), Vec::new);
    for plane in values.chunks_exact_mut(pixels.max(1)) {
        for (block, part) in blocks.iter_mut().zip(plane.chunks_mut(BLOCK)) {
            block.push(part);
        }
    }
    blocks.into_par_iter().for_each(|mut planes| in_block(&mut planes));
}

/// The same of some pixels, a slice for each channel.
fn in_block(planes: &mut [&mut [f32]]) {
    let mut largest = [f32::MIN; BLOCK];
    for plane in &*planes {
        for (largest, value) in largest.iter_mut().zip(&**plane) {
            *largest = largest.max(*value);
        }
    }
    let mut sums = [0.0_f32; BLOCK];
    for plane in &mut *planes {
        for (value, largest) in plane.iter_mut().zip(&largest) {
            *value -= largest;
        }
        Exp {}.map_mut(plane);
        for (sum, value) in sums.iter_mut().zip(&**plane) {
            *sum += value;
        }
    }
    for plane in planes {
        for (value, sum) in plane.iter_mut().zip(&sums) {
            *value /= sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_that_of_each_pixel_however_many_there_are() {
        for pixels in [0, 1, BLOCK, 2 * BLOCK + 3] {
            let channels = 3;
            let logits: Vec<f32> = (0..channels * pixels).map(|i| ((i * 37) % 101) as f32 - 70.0).collect();
            let mut is = logits.clone();
            over_channels(&mut is, channels);
            for pixel in 0..pixels {
                let exp = |channel: usize| f64::from(logits[channel * pixels + pixel]).exp();
                let sum: f64 = (0..channels).map(exp).sum();
                for channel in 0..channels {
                    let (is, should) = (f64::from(is[channel * pixels + pixel]), exp(channel) / sum);
                    assert!((is - should).abs() < 1e-6, "{pixels} {pixel} {channel}: {is} {should}");
                }
            }
        }
    }
}
