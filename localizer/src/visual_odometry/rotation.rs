//! Rotation and direction of the motion, from points in two images.
//!
//! A point of unknown depth lies on the ray of its direction `r`, so it is seen
//! again at `R^T (r - d m)`, `R` and `m` the rotation and the displacement of the
//! camera in its axes before, `d` its inverse depth: on a segment of the epipolar
//! line, from `d = 0`, infinitely far, to the nearest that is believed; on the
//! other side of it where the vehicle goes back. A point is off by its distance
//! from there, so a vehicle that stands, whose segments have no length, is no
//! special case.

use nalgebra::{Point2, Rotation3, SMatrix, SVector, Vector2, Vector3};

use super::depths::InverseDepth;

/// Rotation vector (0 to 2), and displacement to the right and down per metre
/// forward (3, 4).
pub(super) const PARAMETERS: usize = 5;
/// The turn about the axis that points down, to the right.
pub(super) const YAW: usize = 1;
/// The displacement to the right.
pub(super) const ASIDE: usize = 3;
/// The displacement down.
pub(super) const DOWN: usize = 4;
pub(super) type Parameters = SVector<f64, PARAMETERS>;
type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// The nearest point that is believed: it comes nearer by this share of its
/// depth from one image to the next.
const NEAREST: f64 = 0.6;
/// Scales of the Geman-McClure kernel, standard deviations of a point, each the
/// start of the next: the first takes what the prior does not know.
const KERNELS: [f64; 4] = [16.0, 8.0, 4.0, 2.0];
/// Most steps with a kernel.
const ROUNDS: usize = 4;
/// Points off by no more than so many standard deviations agree.
const AGREES: f64 = 3.0;
/// Step of the numerical derivatives.
pub(super) const STEP: f64 = 1e-6;
/// A point that is nearer than this share of its depth before is lost.
const NEAREST_LEFT: f64 = 1.0 - NEAREST;

/// A point in two images, pixels over the focal length from the optical axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Track {
    /// In the image before.
    pub before: Point2<f64>,
    /// In this one.
    pub after: Point2<f64>,
    /// Its depth in the image before, where it is known.
    pub depth: Option<InverseDepth>,
    /// Where it is in this image, pixels.
    pub after_px: (f32, f32),
}

/// What is believed before points are looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Belief {
    pub mean: Parameters,
    pub sigma: Parameters,
    /// By which share of its depth a point goes farther off at most: 0 where the
    /// vehicle cannot go back.
    pub farthest: f64,
}

/// A camera that moves: one set of parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion {
    /// From the camera's axes before to those after.
    pub after_from_before: Rotation3<f64>,
    moved: Vector3<f64>,
}

impl Motion {
    pub fn new(parameters: &Parameters) -> Self {
        let turn = Vector3::new(parameters[0], parameters[1], parameters[2]);
        Self {
            after_from_before: Rotation3::from_scaled_axis(-turn),
            moved: Vector3::new(parameters[ASIDE], parameters[DOWN], 1.0),
        }
    }

    /// The same with each parameter larger by [`STEP`].
    pub fn around(parameters: &Parameters) -> [Self; PARAMETERS] {
        std::array::from_fn(|i| {
            let mut stepped = *parameters;
            stepped[i] += STEP;
            Self::new(&stepped)
        })
    }

    /// Where a point is seen again that comes nearer by this share of its depth.
    pub fn at(&self, before: &Point2<f64>, share: f64) -> Option<Point2<f64>> {
        let seen = self.after_from_before * (Vector3::new(before.x, before.y, 1.0) - self.moved * share);
        (seen.z > 1e-3).then(|| Point2::new(seen.x / seen.z, seen.y / seen.z))
    }

    /// By which share of its depth the point came nearer, and the standard deviation of
    /// that where a point is seen to `sigma`; none at the point that the camera moves to.
    pub fn share(&self, track: &Track, sigma: f64) -> Option<(f64, f64)> {
        let seen = self.after_from_before.inverse_transform_vector(&track.after.coords.push(1.0));
        let to = self.moved.xy() - seen.xy() / seen.z;
        let length = to.norm();
        if seen.z < 1e-3 || length < sigma {
            return None;
        }
        let share = (track.before.coords - seen.xy() / seen.z).dot(&to) / (length * length);
        Some((share, sigma * (1.0 - share).abs() / length))
    }

    /// The depth of a point after as a share of that before, which came nearer by `share` of
    /// that; none where it is no longer before the camera.
    pub fn depth_after(&self, before: &Point2<f64>, share: f64) -> Option<f64> {
        let depth = (self.after_from_before * (before.coords.push(1.0) - self.moved * share)).z;
        (depth > NEAREST_LEFT).then_some(depth)
    }

    /// Whether a point that is seen to `sigma` is where it may be; `farthest` as in [`Belief`].
    pub fn agrees(&self, track: &Track, farthest: f64, sigma: f64) -> bool {
        self.off(track, farthest).is_some_and(|off| off.norm() < AGREES * sigma)
    }

    fn off(&self, track: &Track, farthest: f64) -> Option<Vector2<f64>> {
        let far = self.at(&track.before, 0.0)?;
        let along = self.at(&track.before, NEAREST)? - far;
        let seen = track.after - far;
        let share = (along.dot(&seen) / along.norm_squared().max(1e-12)).clamp(-farthest / NEAREST, 1.0);
        Some(seen - along * share)
    }
}

/// A motion on which points agree.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    pub parameters: Parameters,
    /// How many points agree.
    pub agree: usize,
    /// One over the covariance of the parameters.
    pub normal: Normal,
}

/// The motion on which most points agree. None without a solution.
pub(super) fn fit(tracks: &[Track], belief: &Belief, sigma: f64) -> Option<Fit> {
    let mut parameters = belief.mean;
    for kernel in KERNELS {
        for _ in 0..ROUNDS {
            let (normal, gradient) = linearised(tracks, &parameters, belief, sigma, kernel * sigma);
            let step = normal.cholesky()?.solve(&gradient);
            parameters -= step;
            if step.norm() < 1e-7 {
                break;
            }
        }
    }
    let motion = Motion::new(&parameters);
    let agree = tracks.iter().filter(|track| motion.agrees(track, belief.farthest, sigma)).count();
    let (normal, _) = linearised(tracks, &parameters, belief, sigma, KERNELS[KERNELS.len() - 1] * sigma);
    parameters.iter().all(|p| p.is_finite()).then_some(Fit { parameters, agree, normal })
}

fn linearised(
    tracks: &[Track],
    parameters: &Parameters,
    belief: &Belief,
    sigma: f64,
    kernel: f64,
) -> (Normal, Parameters) {
    let motion = Motion::new(parameters);
    let moved = Motion::around(parameters);
    let precision = belief.sigma.map(|sigma| sigma.powi(-2));
    let mut normal = Normal::from_diagonal(&precision);
    let mut gradient = precision.component_mul(&(parameters - belief.mean));
    for track in tracks {
        let Some(off) = motion.off(track, belief.farthest) else { continue };
        let weight = (sigma * (1.0 + off.norm_squared() / (kernel * kernel))).powi(-2);
        let mut slope = SMatrix::<f64, 2, PARAMETERS>::zeros();
        for (i, stepped) in moved.iter().enumerate() {
            if let Some(there) = stepped.off(track, belief.farthest) {
                slope.set_column(i, &((there - off) / STEP));
            }
        }
        normal += slope.transpose() * slope * weight;
        gradient += slope.transpose() * off * weight;
    }
    (normal, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Points all around at 4 to 60 m, seen from two places.
    fn tracks(truth: &Parameters, step_m: f64) -> Vec<Track> {
        let motion = Motion::new(truth);
        let place = |i: i32| {
            let before = Point2::new(f64::from(i % 20) * 0.08 - 0.8, f64::from(i / 20) * 0.04 - 0.2);
            let depth_m = 4.0 + f64::from(i * 37 % 57);
            Some(Track { before, after: motion.at(&before, step_m / depth_m)?, depth: None, after_px: (0.0, 0.0) })
        };
        (0..240).filter_map(place).collect()
    }

    fn belief() -> Belief {
        let sigma = Parameters::from_column_slice(&[0.02, 0.03, 0.02, 0.03, 0.02]);
        Belief { mean: Parameters::zeros(), sigma, farthest: 0.0 }
    }

    proptest! {
        #[test]
        fn the_motion_that_moved_the_points_is_found(
            turn in prop::array::uniform3(-0.03..0.03_f64),
            aside in -0.04..0.04_f64,
            down in -0.02..0.02_f64,
            others in 0..80_usize,
        ) {
            let truth = Parameters::from_column_slice(&[turn[0], turn[1], turn[2], aside, down]);
            let mut tracks = tracks(&truth, 1.2);
            // Others go their own ways.
            for (i, track) in tracks.iter_mut().step_by(3).take(others).enumerate() {
                track.after.x += 0.02 + 0.001 * i as f64;
            }
            let Fit { parameters: found, agree, .. } = fit(&tracks, &belief(), 0.0007).unwrap();
            prop_assert!((found - truth).rows(0, 3).norm() < 5e-4, "{}", found - truth);
            prop_assert!((found - truth).rows(3, 2).norm() < 5e-3, "{}", found - truth);
            prop_assert!(agree >= tracks.len() - others - 5);
        }
    }

    #[test]
    fn who_stands_and_looks_around_only_turns() {
        let truth = Parameters::from_column_slice(&[0.004, -0.02, 0.003, 0.0, 0.0]);
        let Fit { parameters: found, agree, .. } = fit(&tracks(&truth, 0.0), &belief(), 0.0007).unwrap();
        assert!((found - truth).rows(0, 3).norm() < 2e-4 && agree == 240, "{found}");
    }

    #[test]
    fn without_points_the_belief_stays() {
        let Fit { parameters, agree, .. } = fit(&[], &belief(), 0.0007).unwrap();
        assert_eq!((parameters, agree), (Parameters::zeros(), 0));
    }
}
