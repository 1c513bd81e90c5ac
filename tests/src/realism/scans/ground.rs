//! The ground of one scan, without labels: a height profile in each sector.

use nalgebra::Point3;

/// Sectors about the sensor.
const SECTORS: usize = 180;
/// Length of a bin of a profile, metres.
const BIN_M: f64 = 1.0;
/// Bins of a profile: to 100 m.
const BINS: usize = 100;
/// KITTI's lidar stands this high above the ground, metres (its set-up page).
const SENSOR_M: f64 = 1.73;
/// Least points in a bin for a height.
const FEWEST: usize = 3;
/// A bin continues the ground where its low points lie within this of the last
/// ground seen, metres, and this much more for each metre between them.
const STEP_M: f64 = 0.15;
/// See [`STEP_M`].
const SLOPE: f64 = 0.06;
/// Beyond this distance from the last ground seen the slope gives no more room,
/// metres.
const BLIND_M: f64 = 8.0;

/// Height of the ground by sector and distance.
pub struct Profile {
    height_m: Vec<f64>,
}

impl Profile {
    /// Grows the ground outwards from below the sensor.
    pub fn grow(points: &[Point3<f64>]) -> Self {
        let mut bins: Vec<Vec<f64>> = vec![Vec::new(); SECTORS * BINS];
        for p in points {
            bins[bin(p)].push(p.z);
        }
        let mut height_m = vec![-SENSOR_M; SECTORS * BINS];
        for (bins, heights) in bins.chunks_mut(BINS).zip(height_m.chunks_mut(BINS)) {
            // Place and height of the last ground seen.
            let (mut at, mut last_m) = (0, -SENSOR_M);
            for (i, z) in bins.iter_mut().enumerate() {
                z.sort_by(f64::total_cmp);
                // The lowest fifth: in a hedge that is its foot.
                let low = (z.len() >= FEWEST).then(|| z[z.len() / 5]);
                let room_m = STEP_M + SLOPE * ((i - at) as f64 * BIN_M).min(BLIND_M);
                if let Some(low) = low.filter(|low| (low - last_m).abs() < room_m) {
                    // Also for the bins between, which were hidden.
                    for (j, height_m) in heights[at..=i].iter_mut().enumerate().skip(1) {
                        *height_m = last_m + (low - last_m) * j as f64 / (i - at) as f64;
                    }
                    (at, last_m) = (i, low);
                } else {
                    heights[i] = last_m;
                }
            }
        }
        Self { height_m }
    }

    /// Height of the ground below or above a point, Velodyne frame, metres.
    pub fn height_m(&self, p: &Point3<f64>) -> f64 {
        self.height_m[bin(p)]
    }
}

fn bin(p: &Point3<f64>) -> usize {
    let turn = p.y.atan2(p.x) / std::f64::consts::TAU + 0.5;
    let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
    sector * BINS + ((p.x.hypot(p.y) / BIN_M) as usize).min(BINS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ground_follows_a_slope_and_goes_on_behind_a_hedge() {
        let mut points = Vec::new();
        for i in 0..40_000 {
            let (turn, rho) = (f64::from(i % 400) * 0.0157, 3.0 + f64::from(i / 400) * 0.3);
            let (x, y) = (rho * turn.cos(), rho * turn.sin());
            let hidden = y > 10.0 && y < 18.0;
            let z = 0.03 * x - 1.73 + if hidden { 0.8 + f64::from(i % 7) * 0.2 } else { 0.0 };
            points.push(Point3::new(x, y, z));
        }
        let profile = Profile::grow(&points);
        let off = |x: f64, y: f64| profile.height_m(&Point3::new(x, y, 0.0)) - (0.03 * x - 1.73);
        assert!(off(25.0, 3.0).abs() < 0.05 && off(-25.0, -3.0).abs() < 0.05);
        assert!(off(1.0, 14.0).abs() < 0.1, "{}", off(1.0, 14.0));
        assert!(off(1.0, 25.0).abs() < 0.1, "{}", off(1.0, 25.0));
    }
}
