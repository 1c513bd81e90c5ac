//! How far off the points are that are followed through many images, and how far the
//! vehicle went for that.
//!
//! A point whose depth was told by one step tells the length of the next, whatever the
//! road does: crests, sags and nodding, by which the road misleads for a second, cancel
//! out. Depths are kept as their inverse, whose errors are those of pixels (Civera, Davison
//! and Montiel 2008), each by itself (Forster, Pizzoli and Scaramuzza 2014).

use nalgebra::{SMatrix, SVector};

use super::LEAST_WAY_M;
use super::fading::MOST_DEVIATION;
use super::rotation::{Fit, Motion, PARAMETERS, Parameters, STEP, Track};

/// Share by which a depth may be another one in the next image: a window slides along
/// what it shows.
const SLIDES: f64 = 0.005;
/// Fewest points that tell a way.
const FEWEST: usize = 8;
/// How well single points have to tell it to be asked first, as shares; then all are.
const CLEAR: [f64; 2] = [0.1, 1.0];
/// Rounds of reweighting.
const ROUNDS: usize = 8;
/// Scale of the Geman-McClure kernel, standard deviations.
const KERNEL: f64 = 2.0;
/// The way and the parameters of the motion.
const UNKNOWNS: usize = PARAMETERS + 1;

/// One over a depth, 1/m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct InverseDepth {
    pub per_m: f64,
    /// Variance of that.
    pub variance: f64,
}

impl InverseDepth {
    fn differs(&self, other: &Self) -> bool {
        let variance = self.variance + other.variance;
        (self.per_m - other.per_m).powi(2) > MOST_DEVIATION * MOST_DEVIATION * variance
    }

    fn with(self, other: Self) -> Self {
        let gain = self.variance / (self.variance + other.variance);
        Self { per_m: self.per_m + gain * (other.per_m - self.per_m), variance: self.variance * (1.0 - gain) }
    }
}

/// How far the vehicle went, metres, and the variance of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Way {
    pub forward_m: f64,
    pub variance: f64,
}

/// A point of known depth that came nearer.
struct Approach {
    depth: InverseDepth,
    /// By which share of its depth.
    share: f64,
    /// Variance of that.
    variance: f64,
    /// How that share changes with the motion.
    slope: Parameters,
}

impl Approach {
    fn new(track: &Track, motion: &Motion, around: &[Motion; PARAMETERS], sigma: f64) -> Option<Self> {
        let depth = track.depth?;
        let (share, sigma_of_share) = motion.share(track, sigma)?;
        let change = |moved: &Motion| Some((moved.share(track, sigma)?.0 - share) / STEP);
        let slope = Parameters::from_fn(|i, _| change(&around[i]).unwrap_or(0.0));
        Some(Self { depth, share, variance: sigma_of_share * sigma_of_share, slope })
    }

    /// The way that it tells alone, if that is known to so large a share.
    fn way_m(&self, known: f64) -> Option<f64> {
        let squares = self.variance / (self.share * self.share) + self.depth.variance / self.depth.per_m.powi(2);
        (squares < known * known).then_some(self.share / self.depth.per_m)
    }
}

/// How far the vehicle went, from points that agree with its motion and are seen to `sigma`:
/// those whose depths are known tell it.
///
/// Shares and depths both have errors, so the sum of `(share - way * inverse depth)^2`, each
/// over its variance, is made least (weighted orthogonal regression). What the motion is off
/// by changes all shares together, and is unknown to the extent that the points left it so.
/// It is found here only to be left out: a motion that was set right by the depths that it
/// gave would believe itself.
pub(super) fn way_of(tracks: &[Track], fit: &Fit, sigma: f64) -> Option<Way> {
    let (motion, around) = (Motion::new(&fit.parameters), Motion::around(&fit.parameters));
    let seen = tracks.iter().filter_map(|track| Approach::new(track, &motion, &around, sigma));
    let seen: Vec<Approach> = seen.collect();
    if seen.len() < FEWEST {
        return None;
    }
    // One thing that is near may have more weight than all others, and be followed wrongly.
    let middle_m = |known: f64| {
        let mut ways_m: Vec<f64> = seen.iter().filter_map(|approach| approach.way_m(known)).collect();
        ways_m.sort_by(f64::total_cmp);
        ways_m.get(ways_m.len() / 2).copied().filter(|_| ways_m.len() >= FEWEST)
    };
    let mut unknowns = SVector::<f64, UNKNOWNS>::zeros();
    unknowns[PARAMETERS] = CLEAR.into_iter().find_map(middle_m).unwrap_or(0.0);
    let mut variance = f64::INFINITY;
    for _ in 0..ROUNDS {
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        normal.fixed_view_mut::<PARAMETERS, PARAMETERS>(0, 0).copy_from(&fit.normal);
        let off_by: Parameters = unknowns.fixed_rows::<PARAMETERS>(0).into();
        let way_m = unknowns[PARAMETERS];
        let mut gradient = (fit.normal * -off_by).push(0.0);
        for Approach { depth, share, variance, slope } in &seen {
            let share = share + slope.dot(&off_by);
            let both = variance + way_m * way_m * depth.variance;
            let off = share - way_m * depth.per_m;
            // The depth that fits both best.
            let per_m = (depth.per_m * variance + way_m * share * depth.variance) / both;
            let weight = (1.0 + off * off / (KERNEL * KERNEL * both)).powi(-2) / both;
            let row = (-slope).push(per_m);
            normal += row * row.transpose() * weight;
            gradient += row * (weight * off);
        }
        let inverse = normal.cholesky()?.inverse();
        unknowns += inverse * gradient;
        variance = inverse[(PARAMETERS, PARAMETERS)];
    }
    let forward_m = unknowns[PARAMETERS];
    (forward_m.is_finite() && variance.is_finite()).then_some(Way { forward_m, variance })
}

/// What is known of the depth of a point in the axes after, where the vehicle went so far and
/// all depths were too small by a factor.
pub(super) fn known_after(track: &Track, motion: &Motion, way_m: f64, factor: f64, sigma: f64) -> Option<InverseDepth> {
    let before = track
        .depth
        .map(|depth| InverseDepth { per_m: depth.per_m / factor, variance: depth.variance / (factor * factor) });
    let depth = if way_m.abs() < LEAST_WAY_M {
        before?
    } else {
        let (share, sigma_of_share) = motion.share(track, sigma)?;
        let seen = InverseDepth { per_m: share / way_m, variance: (sigma_of_share / way_m).powi(2) };
        before.filter(|before| !before.differs(&seen)).map_or(seen, |before| before.with(seen))
    };
    let nearer = motion.depth_after(&track.before, depth.per_m * way_m)?;
    let per_m = depth.per_m / nearer;
    Some(InverseDepth { per_m, variance: depth.variance / nearer.powi(4) + (SLIDES * per_m).powi(2) })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, SMatrix};
    use proptest::prelude::*;

    use super::*;

    const SIGMA: f64 = 0.0005;

    /// As many points all around at 5 to 60 m, each known to a share of its depth.
    fn points(count: usize, known: f64) -> Vec<(Point2<f64>, InverseDepth)> {
        let point = |i: usize| {
            let place = Point2::new((i % 20) as f64 * 0.08 - 0.77, (i / 20) as f64 * 0.04 - 0.2);
            let per_m = (5.0 + (i * 37 % 56) as f64).recip();
            (place, InverseDepth { per_m, variance: (known * per_m).powi(2) })
        };
        (0..count).map(point).collect()
    }

    fn fit(parameters: Parameters) -> Fit {
        Fit { parameters, agree: 0, normal: SMatrix::identity() * 1e8 }
    }

    /// How a camera that went so far sees a point that it knows to be so far off.
    fn track(fit: &Fit, way_m: f64, (before, depth): (Point2<f64>, InverseDepth), believed: InverseDepth) -> Track {
        let after = Motion::new(&fit.parameters).at(&before, way_m * depth.per_m).unwrap();
        Track { before, after, depth: Some(believed), after_px: (0.0, 0.0) }
    }

    proptest! {
        #[test]
        fn the_way_is_told_by_points_that_are_known_roughly(
            way_m in 0.2..2.5_f64,
            turn in prop::array::uniform3(-0.02..0.02_f64),
            errors in prop::collection::vec(-1.0..1.0_f64, 200),
        ) {
            let fit = fit(Parameters::from_column_slice(&[turn[0], turn[1], turn[2], 0.02, -0.01]));
            let known = 0.05;
            let tracks: Vec<Track> = points(200, known)
                .into_iter()
                .zip(errors)
                .map(|(point, error)| {
                    let per_m = point.1.per_m * (1.0 + known * error);
                    track(&fit, way_m, point, InverseDepth { per_m, ..point.1 })
                })
                .collect();
            let way = way_of(&tracks, &fit, SIGMA).unwrap();
            prop_assert!((way.forward_m / way_m - 1.0).abs() < 0.02, "{way:?}");
        }
    }

    #[test]
    fn a_near_thing_that_is_followed_wrongly_does_not_decide() {
        let fit = fit(Parameters::zeros());
        let mut all = points(60, 0.03);
        // Nine points of one thing weigh more than all others.
        for (i, (place, depth)) in all.iter_mut().take(9).enumerate() {
            *place = Point2::new(0.5 + 0.01 * i as f64, 0.15);
            *depth = InverseDepth { per_m: 0.09, variance: (0.004_f64 * 0.09).powi(2) };
        }
        let tracks: Vec<Track> = (0..60)
            .map(|i| {
                let way_m = if i < 9 { 1.6 } else { 1.4 };
                track(&fit, way_m, all[i], all[i].1)
            })
            .collect();
        let way = way_of(&tracks, &fit, SIGMA).unwrap();
        assert!((way.forward_m - 1.4).abs() < 0.02, "{way:?}");
        assert!(way_of(&tracks[..FEWEST - 1], &fit, SIGMA).is_none());
    }

    #[test]
    fn depths_go_along_and_get_better() {
        let fit = fit(Parameters::from_column_slice(&[0.0, 0.005, 0.0, 0.0, 0.0]));
        let motion = Motion::new(&fit.parameters);
        let (mut place, mut known, mut depth_m) = (Point2::new(0.3, 0.1), None, 20.0);
        let mut shares = Vec::new();
        for _ in 0..8 {
            let exact = InverseDepth { per_m: 1.0 / depth_m, variance: 0.0 };
            let seen = Track { depth: known, ..track(&fit, 1.0, (place, exact), exact) };
            known = known_after(&seen, &motion, 1.0, 1.0, SIGMA);
            depth_m *= motion.depth_after(&place, 1.0 / depth_m).unwrap();
            place = seen.after;
            let InverseDepth { per_m, variance } = known.unwrap();
            assert!((per_m * depth_m - 1.0).abs() < 1e-6, "{per_m} at {depth_m} m");
            shares.push(variance.sqrt() / per_m);
        }
        assert!(shares.windows(2).all(|two| two[1] < two[0]), "{shares:?}");
        // Twice as far off as known before, where all were too near by that.
        let seen = Track { depth: known, ..track(&fit, 0.0, (place, known.unwrap()), known.unwrap()) };
        let scaled = known_after(&seen, &motion, 0.0, 2.0, SIGMA).unwrap();
        assert!((scaled.per_m * depth_m * 2.0 - 1.0).abs() < 0.02, "{scaled:?}");
        // Who stands learns nothing of what it does not know.
        assert!(known_after(&Track { depth: None, ..seen }, &motion, 0.0, 1.0, SIGMA).is_none());
    }
}
