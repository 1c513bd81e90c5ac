//! How often images come.

/// Share of the newest in the mean time between two images: of about the last
/// four.
const NEWEST_SHARE: f64 = 0.25;

/// A time between two images that is longer than so many usual ones is a pause,
/// and says as little of the pace as one of these. Twice would not do: times that
/// are early and late in turn are as long.
const LONGEST: f64 = 3.0;

/// Mean time between two images, the last ones most.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pace {
    interval_s: f64,
}

impl Pace {
    /// By how much less than the usual time an image of `dt_s` after the one before
    /// comes, seconds: 0 where that is no sooner than this share of it. Cameras keep
    /// their pace, and may miss an image.
    pub fn missing_s(self, dt_s: f64, soonest: f64) -> f64 {
        if dt_s < soonest * self.interval_s { self.interval_s - dt_s } else { 0.0 }
    }

    /// Takes in a time between two images, seconds.
    pub fn tick(&mut self, dt_s: f64) {
        if self.interval_s <= 0.0 {
            self.interval_s = dt_s.max(0.0);
        } else if dt_s > 0.0 {
            self.interval_s += NEWEST_SHARE * (dt_s.min(LONGEST * self.interval_s) - self.interval_s);
        }
    }
}
