//! Scans as if all points had been seen at one moment.
//!
//! A spinning lidar sees the points of a scan one after the other, over a
//! turn. KITTI's odometry benchmark has moved them to where they were when the
//! lidar looked ahead; KITTI's raw recordings and most others have not.

use common::geometry::{Pose, Tangent, retract};
use common::kitti::ScanPoint;
use nalgebra::Point3;
use std::f32::consts::TAU;

/// How a lidar turns, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Deskew {
    /// The points are where they were at the time of the scan.
    #[default]
    None,
    /// Counter-clockwise, as KITTI's authors say of theirs.
    CounterClockwise,
    /// Clockwise.
    Clockwise,
}

impl Deskew {
    /// Moves the points (lidar frame) to where they were when the lidar looked
    /// ahead, which is the time of the scan. `motion_per_s` is the motion of
    /// the lidar in its own frame, per second; a turn takes `turn_s`.
    pub fn apply(self, points: &mut [ScanPoint], motion_per_s: &Tangent, turn_s: f64) {
        let sense = match self {
            Self::None => return,
            Self::CounterClockwise => 1.0,
            Self::Clockwise => -1.0,
        };
        for p in points {
            let after_s = f64::from(sense * p.y_m.atan2(p.x_m) / TAU) * turn_s;
            let then_from_later = retract(&Pose::identity(), &(motion_per_s * after_s));
            let moved = then_from_later * Point3::new(f64::from(p.x_m), f64::from(p.y_m), f64::from(p.z_m));
            (p.x_m, p.y_m, p.z_m) = (moved.x as f32, moved.y as f32, moved.z as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_that_is_driven_along_is_straight_again() {
        // 10 m/s ahead while turning left, over a turn of 0.1 s.
        let motion = Tangent::new(10.0, 0.0, 0.0, 0.0, 0.0, 0.3);
        for (deskew, sense) in [(Deskew::CounterClockwise, 1.0), (Deskew::Clockwise, -1.0)] {
            let wall: Vec<Point3<f64>> = (-20..20).map(|i| Point3::new(f64::from(i), 5.0, 0.5)).collect();
            let seen = |p: &Point3<f64>| {
                // When the beam meets the point depends on where it is then.
                let mut q = *p;
                for _ in 0..20 {
                    let after_s = sense * q.y.atan2(q.x) / f64::from(TAU) * 0.1;
                    q = retract(&Pose::identity(), &(motion * after_s)).inverse() * p;
                }
                ScanPoint { x_m: q.x as f32, y_m: q.y as f32, z_m: q.z as f32, reflectance: 0.0 }
            };
            let mut points: Vec<ScanPoint> = wall.iter().map(seen).collect();
            let off = |points: &[ScanPoint]| {
                let each = points.iter().zip(&wall).map(|(p, w)| (p.y_m - w.y as f32).hypot(p.x_m - w.x as f32));
                each.fold(0.0_f32, f32::max)
            };
            assert!(off(&points) > 0.3, "{}", off(&points));
            deskew.apply(&mut points, &motion, 0.1);
            assert!(off(&points) < 1e-4, "{}", off(&points));
        }
    }
}
