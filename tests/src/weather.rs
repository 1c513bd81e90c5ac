//! Images as other weather, light or another lens would have made them, and what
//! the localizer makes of these.

use std::path::Path;

use clap::ValueEnum;
use common::kitti::Sequence;
use localizer::config::Config;
use localizer::drive::{CAMERA, Drive};
use localizer::features::Features;
use localizer::vision::{RgbImage, write_png};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use serde::Serialize;

use crate::trial::{LookArgs, Scored};

/// Share of the contrast that is left in fog, and the grey of the veil.
const FOG: (f32, f32) = (0.35, 200.0);
/// Exponent by which mid tones darken at dusk, and what is left of the brightness.
const DUSK: (f32, f32) = (2.2, 0.6);
/// Noise of a sensor at dusk, and of one whose gain is at its highest, standard
/// deviations of each value of 255.
const DUSK_SIGMA: f32 = 4.0;
const NOISE_SIGMA: f32 = 18.0;
/// Standard deviation of a lens that is out of focus or wet, pixels.
const BLUR_SIGMA_PX: f32 = 2.5;
/// Where the sun stands, and half of its halo's width and height, as shares of the
/// image.
const SUN: [f32; 2] = [0.52, 0.35];
const HALO: [f32; 2] = [0.26, 0.38];

/// What spoils the images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Weather {
    /// Nothing.
    Clear,
    /// A third of the contrast is left, under a light grey veil.
    Fog,
    /// Mid tones are at a fifth of their brightness, with noise of 4 of 255.
    Dusk,
    /// Noise of 18 of 255 on each value: the sensor's highest gain.
    Noise,
    /// The lens is out of focus by 2.5 pixels.
    Blur,
    /// A low sun ahead: white in the middle, a halo over half of the width.
    Glare,
    /// Half of the resolution.
    Coarse,
}

impl Weather {
    /// The image in this weather; the same for the same random numbers.
    #[must_use]
    pub fn spoilt(self, image: &RgbImage, random: &mut Pcg64) -> RgbImage {
        let (width, height) = (image.width(), image.height());
        let each = |value: &mut dyn FnMut(usize, f32) -> f32| {
            let of = |(i, v): (usize, &u8)| value(i, f32::from(*v)).round().clamp(0.0, 255.0) as u8;
            image.data().iter().enumerate().map(of).collect::<Vec<u8>>()
        };
        let mut noise = |sigma: f32| sigma * random.sample::<f32, _>(StandardNormal);
        let data = match self {
            Self::Clear => image.data().to_vec(),
            Self::Fog => each(&mut |_, v| FOG.1 + FOG.0 * (v - FOG.1)),
            Self::Dusk => each(&mut |_, v| 255.0 * DUSK.1 * (v / 255.0).powf(DUSK.0) + noise(DUSK_SIGMA)),
            Self::Noise => each(&mut |_, v| v + noise(NOISE_SIGMA)),
            Self::Blur => blurred(image),
            Self::Glare => each(&mut |i, v| {
                let place = [(i / 3 % width) as f32 / width as f32, (i / 3 / width) as f32 / height as f32];
                let off = [0, 1].map(|k| (place[k] - SUN[k]) / HALO[k]);
                v + 255.0 * (-off[0] * off[0] - off[1] * off[1]).exp()
            }),
            Self::Coarse => coarse(image),
        };
        RgbImage::new(width, data).unwrap_or_else(|| image.clone())
    }

    /// Writes the images of a drive in this weather, with its calibration and times,
    /// to a folder in the layout of KITTI odometry; the same for the same seed.
    ///
    /// # Errors
    /// Where an image cannot be read or a file cannot be written.
    pub fn write(self, drive: &Drive, root: &Path, seed: u64) -> localizer::Result<()> {
        let name = drive.sequence.name();
        let folder = root.join("sequences").join(name);
        std::fs::create_dir_all(&folder).map_err(common::Error::io(&folder))?;
        let spoilt = Sequence::open(root, name)?;
        for file in ["calib.txt", "times.txt"] {
            let from = drive.sequence.folder().join(file);
            std::fs::copy(&from, folder.join(file)).map_err(common::Error::io(&from))?;
        }
        let images = folder.join(format!("image_{CAMERA}"));
        std::fs::create_dir_all(&images).map_err(common::Error::io(&images))?;
        for &frame in &drive.frames {
            let mut random = Pcg64::seed_from_u64(seed.wrapping_mul(1_000_003).wrapping_add(frame as u64));
            write_png(spoilt.image_path(CAMERA, frame), &self.spoilt(&drive.image(frame)?, &mut random))?;
        }
        Ok(())
    }

    /// The word for it on the command line and in the table.
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// The values of an image under a Gaussian, along rows and then along columns.
fn blurred(image: &RgbImage) -> Vec<u8> {
    let (width, height) = (image.width() as isize, image.height() as isize);
    let reach = (3.0 * BLUR_SIGMA_PX).ceil() as isize;
    let weight = |off: isize| (-0.5 * (off as f32 / BLUR_SIGMA_PX).powi(2)).exp();
    let sum: f32 = (-reach..=reach).map(weight).sum();
    let taps: Vec<(isize, f32)> = (-reach..=reach).map(|off| (off, weight(off) / sum)).collect();
    // At the borders the last pixel goes on.
    let at = |x: isize, y: isize| 3 * (y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize;
    let along = |values: &[f32], (right, down): (isize, isize)| {
        let pixel = |i: usize| {
            let (x, y, channel) = ((i / 3) as isize % width, (i / 3) as isize / width, i % 3);
            taps.iter().map(|(off, weight)| weight * values[at(x + off * right, y + off * down) + channel]).sum()
        };
        (0..values.len()).map(pixel).collect::<Vec<f32>>()
    };
    let values: Vec<f32> = image.data().iter().map(|v| f32::from(*v)).collect();
    along(&along(&values, (1, 0)), (0, 1)).into_iter().map(|v| v.round() as u8).collect()
}

/// The values of an image of which every two by two pixels are their mean.
fn coarse(image: &RgbImage) -> Vec<u8> {
    let value = |x: usize, y: usize, channel: usize| image.row(y).get(3 * x + channel).map(|v| u32::from(*v));
    let of = |i: usize| {
        let (x, y, channel) = (i / 3 % image.width() / 2 * 2, i / 3 / image.width() / 2 * 2, i % 3);
        // At an odd border a block is cut.
        let block = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
        let (sum, count) = block
            .iter()
            .filter_map(|(x, y)| value(*x, *y, channel))
            .fold((0, 0), |(sum, count), v| (sum + v, count + 1));
        (sum / u32::max(count, 1)) as u8
    };
    (0..image.data().len()).map(of).collect()
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The weather.
    pub weather: String,
    /// Poles and trunks, lane lines, signs and lights found in an image, on average.
    pub features: [f64; 3],
    /// What came of it.
    #[serde(flatten)]
    pub outcome: Scored,
}

impl Row {
    /// Localizes the drive in this weather.
    ///
    /// # Errors
    /// As [`Weather::write`], [`LookArgs::read`] and [`crate::trial::Trial::run`].
    pub fn of(weather: Weather, look: &LookArgs, config: &Config) -> localizer::Result<Self> {
        let folder = tempfile::tempdir().map_err(common::Error::io(std::env::temp_dir()))?;
        // Images are spoilt as they were taken.
        let mut as_taken = config.clone();
        as_taken.vision.widest_px = usize::MAX;
        let drive = look.input.open_drive(&as_taken)?;
        weather.write(&drive, folder.path(), look.seed)?;
        let trial = look.at(folder.path(), &drive.sequence).read_by(config.clone())?;
        let count = trial.frames.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Features) -> usize| {
            trial.frames.iter().map(|seen| of(&seen.features)).sum::<usize>() as f64 / count
        };
        let features = [mean(&Features::uprights), mean(&|f| f.lanes.len()), mean(&|f| f.signs.len())];
        Ok(Self { weather: weather.name(), features, outcome: trial.outcome(&trial.run()?) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dark post before a bright house, and the road, with an odd width and height.
    fn image() -> RgbImage {
        let value = |i: usize| {
            let (x, y) = (i / 3 % 61, i / 3 / 61);
            if x == 30 { 20 } else { 120 + (x + 2 * y) as u8 }
        };
        RgbImage::new(61, (0..3 * 61 * 31).map(value).collect()).unwrap()
    }

    fn spoilt(weather: Weather) -> RgbImage {
        weather.spoilt(&image(), &mut Pcg64::seed_from_u64(3))
    }

    /// Brightness of the post and of what is beside it, in a row.
    fn post_and_house(image: &RgbImage, y: usize) -> (i32, i32) {
        let at = |x: usize| i32::from(image.row(y)[3 * x]);
        (at(30), at(26))
    }

    #[test]
    fn every_weather_but_a_clear_one_spoils_the_image_and_keeps_its_size() {
        for weather in Weather::value_variants() {
            let spoilt = spoilt(*weather);
            assert_eq!((spoilt.width(), spoilt.height()), (61, 31));
            assert_eq!(spoilt == image(), *weather == Weather::Clear, "{weather:?}");
            assert_eq!(spoilt, self::spoilt(*weather), "the same random numbers give the same image");
        }
    }

    #[test]
    fn fog_dusk_blur_and_half_the_resolution_take_contrast_away_and_glare_hides_what_is_before_it() {
        let contrast = |image: &RgbImage, y: usize| {
            let (post, house) = post_and_house(image, y);
            f64::from(house - post)
        };
        let own = contrast(&image(), 20);
        let left = |weather: Weather| contrast(&spoilt(weather), 20) / own;
        assert!((left(Weather::Fog) - 0.35).abs() < 0.02);
        assert!(left(Weather::Dusk) < 0.6 && left(Weather::Blur) < 0.2 && left(Weather::Coarse) < 0.6);
        assert!(contrast(&spoilt(Weather::Glare), 11) < 0.2 * contrast(&image(), 11), "the sun stands there");
    }

    #[test]
    fn noise_is_as_strong_as_is_said_and_a_blurred_image_is_as_bright() {
        let (plain, noisy) = (image(), spoilt(Weather::Noise));
        let off = plain.data().iter().zip(noisy.data()).map(|(a, b)| f64::from(*b) - f64::from(*a));
        let sigma = (off.map(|off| off * off).sum::<f64>() / plain.data().len() as f64).sqrt();
        assert!((sigma - 18.0).abs() < 1.0, "{sigma}");
        let mean =
            |image: &RgbImage| image.data().iter().map(|v| f64::from(*v)).sum::<f64>() / image.data().len() as f64;
        assert!((mean(&spoilt(Weather::Blur)) - mean(&plain)).abs() < 0.5);
    }
}
