//! How often images come.

/// Pairs of times between two images that the pace is taken from, the last ones.
const PAIRS: usize = 20;

/// Share of these pairs that may be shorter than the pace: one image in five that is
/// stamped late makes as many pairs with the next that are too short.
const SHORTER_SHARE: f64 = 0.2;

/// The usual time between two images.
///
/// It is the mean time of a pair of them, so that times that are early and late in turn
/// tell the right one; and of the last pairs one of the short ones (a fifth of them are shorter),
/// for where images are missing, be it every second at random, that is what the camera
/// keeps, and a pause is none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pace {
    /// Mean times of the last pairs, seconds, in no order once there are [`PAIRS`].
    pairs_s: [f64; PAIRS],
    /// How many there were.
    count: usize,
    /// The last time between two images, seconds.
    last_s: Option<f64>,
}

impl Pace {
    /// The usual time, seconds, once there was a pair.
    pub fn usual_s(&self) -> Option<f64> {
        (self.count > 0).then(|| self.interval_s())
    }

    /// The usual time, seconds; 0 as long as there is none.
    fn interval_s(&self) -> f64 {
        let mut pairs_s = self.pairs_s;
        let Some(pairs_s) = pairs_s.get_mut(..self.count.min(PAIRS)).filter(|pairs_s| !pairs_s.is_empty()) else {
            return self.last_s.unwrap_or(0.0);
        };
        pairs_s.sort_unstable_by(f64::total_cmp);
        pairs_s[(SHORTER_SHARE * pairs_s.len() as f64) as usize]
    }

    /// By how much less than the usual time an image of `dt_s` after the one before
    /// comes, seconds: 0 where that is no sooner than this share of it. Cameras keep
    /// their pace, and may miss an image.
    pub fn missing_s(&self, dt_s: f64, soonest: f64) -> f64 {
        let interval_s = self.interval_s();
        if dt_s < soonest * interval_s { interval_s - dt_s } else { 0.0 }
    }

    /// Takes in a time between two images, seconds.
    pub fn tick(&mut self, dt_s: f64) {
        if dt_s <= 0.0 {
            return;
        }
        if let Some(last_s) = self.last_s.replace(dt_s) {
            self.pairs_s[self.count % PAIRS] = 0.5 * (last_s + dt_s);
            self.count += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    const SOONEST: f64 = 0.6;

    /// The share of these times, after the first ones, that are too soon.
    fn too_soon(times_s: impl Iterator<Item = f64>) -> f64 {
        let mut pace = Pace::default();
        let soon = times_s.map(|dt_s| {
            let is_too_soon = pace.missing_s(dt_s, SOONEST) > 0.0;
            pace.tick(dt_s);
            is_too_soon
        });
        let soon: Vec<bool> = soon.skip(PAIRS).collect();
        soon.iter().filter(|soon| **soon).count() as f64 / soon.len() as f64
    }

    #[test]
    fn a_camera_that_misses_images_is_hardly_ever_too_soon() {
        let mut random = Pcg64::seed_from_u64(1);
        // One image of five, and of two, is missing at random.
        for (missing, most) in [(0.2, 0.0), (0.5, 0.03)] {
            let mut waited_s = || {
                let mut dt_s = 0.1;
                while random.random_bool(missing) {
                    dt_s += 0.1;
                }
                dt_s
            };
            let share = too_soon((0..2000).map(|_| waited_s()));
            assert!(share <= most, "{missing}: {share}");
        }
        // A camera that waits for its shutter, by some milliseconds.
        assert!(too_soon((0..500).map(|_| 0.1 + random.random_range(-0.01..0.01))) <= 0.0);
        // One that goes slower at night, and faster again.
        assert!(too_soon([0.1, 0.13].into_iter().cycle().flat_map(|dt_s| [dt_s; 40]).take(400)) <= 0.0);
    }

    #[test]
    fn times_that_are_early_and_late_are() {
        assert!((too_soon([0.15, 0.05].into_iter().cycle().take(100)) - 0.5).abs() < 0.02);
        // Every fifth image is stamped late, by most of a frame.
        assert!((too_soon([0.1, 0.1, 0.19, 0.01, 0.1].into_iter().cycle().take(512)) - 0.2).abs() < 0.01);
    }
}
