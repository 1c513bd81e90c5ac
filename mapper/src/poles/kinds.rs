//! What kind of pole one is, and whether it is a tree.

use std::ops::Range;

use common::map::PoleKind;
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{Filling, FittedPole, Plumb, PoleConfig, Stacks, is_equipped_post};

/// What tells trees from posts where no crown is seen: each of it adds to the log
/// odds, in nats, and a tree is what has more for it than against it. No single
/// one tells: the crown is above the field of view of the lidar, masts are as
/// thick as trunks, and some trees stand upright.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TreeConfig {
    /// Median radius of posts, metres: signs are on tubes of 60 to 76 mm, lamps
    /// on masts of 90 to 180 mm.
    pub post_radius_m: f64,
    /// Standard deviation of its logarithm: nine in ten are from 2 to 14 cm.
    pub post_radius_spread: f64,
    /// The median where the upper end is seen and is lower than any lamp,
    /// metres: then it carries a sign, or part of it is hidden.
    pub low_post_radius_m: f64,
    /// Standard deviation of its logarithm: nine in ten are from 2 to 9 cm.
    pub low_post_radius_spread: f64,
    /// Median radius of the trunks of street trees, metres.
    pub tree_radius_m: f64,
    /// Standard deviation of its logarithm: nine in ten are from 8 to 29 cm.
    pub tree_radius_spread: f64,
    /// How far trees lean from the plumb line, radians, one standard deviation
    /// along each axis: 2 degrees. For posts it is `usual_lean_rad`.
    pub tree_lean_rad: f64,
    /// Most that a lean adds, nats: some post was run into.
    pub most_of_lean: f64,
    /// Scale of the height `h` up to which trees are bare, metres: to `h` are
    /// `exp(-(h / bare_m)^4)` of them. Branches are cut to 2.5 m over footways
    /// and to 4.5 m over carriageways.
    pub bare_m: f64,
    /// What it takes away that no crown is seen, nats: of half of the trees none
    /// is, the logarithm of 2.
    pub no_crown: f64,
    /// What sheeting takes away, nats: reflectors are nailed to few trees. The
    /// radius then tells nothing, for a plate makes its post look thick, nor does
    /// what is around its upper end, for signs stand before hedges.
    pub sheeting: f64,
    /// What hangs on another pole is within this of its axis, metres, and is no
    /// crown of this one: signs and lights.
    pub reach_of_others_m: f64,
    /// Longest way between two masts that carry one board, metres: boards go on beyond
    /// them, and are up to 4 m wide.
    pub widest_board_m: f64,
    /// What is within this of the way from one to the other, metres, is that board.
    pub board_reach_m: f64,
    /// Least share of the space where a crown may be that a board fills: one that is wide
    /// and seen well fills four times as much.
    pub board_share: f64,
    /// What is there lies within this of an upright plane through the post where it is a
    /// board, metres, root mean square: hits and columns on boards do within 0.1 to 0.18 m,
    /// in crowns from 0.24 m on.
    pub board_spread_m: f64,
    /// So many poles with as many trees as posts among them count with those of
    /// a place when it is asked how many there are trees: avenues have more of
    /// them than squares.
    pub usual_poles: f64,
}

impl Default for TreeConfig {
    fn default() -> Self {
        Self {
            post_radius_m: 0.055,
            post_radius_spread: 0.55,
            low_post_radius_m: 0.04,
            low_post_radius_spread: 0.5,
            tree_radius_m: 0.15,
            tree_radius_spread: 0.4,
            tree_lean_rad: 0.035,
            most_of_lean: 3.0,
            bare_m: 3.8,
            no_crown: 0.69,
            sheeting: 5.0,
            reach_of_others_m: 0.5,
            widest_board_m: 2.0,
            board_reach_m: 0.25,
            board_share: 0.005,
            board_spread_m: 0.2,
            usual_poles: 6.0,
        }
    }
}

impl TreeConfig {
    /// What the radius says for a tree, nats: log-normal both.
    fn of_radius(&self, pole: &FittedPole, config: &PoleConfig) -> f64 {
        let ends_low = !pole.top_is_open && pole.top_height_m < config.lamp_top_m;
        let (median_m, spread) = if ends_low {
            (self.low_post_radius_m, self.low_post_radius_spread)
        } else {
            (self.post_radius_m, self.post_radius_spread)
        };
        let off = |median_m: f64, spread: f64| (pole.radius_m / median_m).ln() / spread;
        let (of_post, of_tree) = (off(median_m, spread), off(self.tree_radius_m, self.tree_radius_spread));
        (spread / self.tree_radius_spread).ln() + (of_post.powi(2) - of_tree.powi(2)) / 2.0
    }

    /// What the lean says for a tree, nats: normal in both axes, with the
    /// uncertainty of the slope that the hits tell.
    fn of_lean(&self, pole: &FittedPole, plumb: &Plumb, config: &PoleConfig) -> f64 {
        let known = pole.slope_covariance.trace() / 2.0;
        let (of_post, of_tree) = (config.usual_lean_rad.powi(2) + known, self.tree_lean_rad.powi(2) + known);
        let squared = (pole.slope_of_hits - plumb.slope).norm_squared();
        ((of_post / of_tree).ln() + squared * (of_post.recip() - of_tree.recip()) / 2.0).min(self.most_of_lean)
    }
}

/// Tells the kinds of the poles of one place.
pub(super) struct Kinds<'a> {
    plumb: &'a Plumb,
    stacks: &'a Stacks,
    config: &'a PoleConfig,
    /// The poles of the place.
    poles: &'a [FittedPole],
    /// Log odds of trees among them, nats.
    prior: f64,
}

impl<'a> Kinds<'a> {
    /// For the poles of a place, which tell how many trees are among them.
    pub fn of(poles: &'a [FittedPole], plumb: &'a Plumb, stacks: &'a Stacks, config: &'a PoleConfig) -> Self {
        let mut kinds = Self { plumb, stacks, config, poles, prior: 0.0 };
        let odds: Vec<f64> = poles
            .iter()
            .filter(|p| kinds.may_be_tree(p))
            .map(|p| if kinds.is_crowned(p) { CERTAIN } else { kinds.tree_odds(p) })
            .collect();
        kinds.prior = prior(&odds, config.trees.usual_poles);
        kinds
    }

    /// Whether a crown or a roof is over it: a parasol is no post either.
    fn has_crown(&self, pole: &FittedPole) -> bool {
        let (at, config) = (Point2::new(pole.top.x, pole.top.z), self.config);
        let far_m = (config.crown_radii_m[1] + config.trees.reach_of_others_m).max(config.trees.widest_board_m);
        let others: Vec<Other> = self
            .poles
            .iter()
            .map(|other| {
                let is_as_high = other.top_height_m + config.crown_height_m >= pole.top_height_m;
                Other { at: other.at_height_of(&pole.top), is_as_high }
            })
            .filter(|other| {
                let off_m = (other.at - at).norm();
                off_m >= config.ring_inner_m && off_m <= far_m
            })
            .collect();
        has_crown(pole, &others, self.stacks, config)
    }

    /// Whether its crown makes a tree of it.
    fn is_crowned(&self, pole: &FittedPole) -> bool {
        self.has_crown(pole) && !pole.has_sheeting(self.config)
    }

    /// Whether it is no short post, and no slender one with sheeting.
    fn may_be_tree(&self, pole: &FittedPole) -> bool {
        !is_equipped_post(pole, self.config) && !pole.is_short(self.config)
    }

    /// Log odds that what may be a tree and shows no crown is one, nats.
    fn tree_odds(&self, pole: &FittedPole) -> f64 {
        let trees = &self.config.trees;
        let bare = (pole.top_height_m / trees.bare_m).powi(4);
        let of_width =
            if pole.has_sheeting(self.config) { -trees.sheeting } else { trees.of_radius(pole, self.config) };
        of_width + trees.of_lean(pole, self.plumb, self.config) - bare - trees.no_crown + self.prior
    }

    /// The kind of a pole.
    pub fn of_pole(&self, pole: &FittedPole) -> PoleKind {
        let (top, config) = (pole.top_height_m, self.config);
        // People beside it and the hedge behind it are no crown of a post with
        // sheeting on it. Parked cars are higher than bollards, and stand by them.
        let is_stem = || self.has_crown(pole) && is_covered(pole, self.stacks, config);
        let is_tree = if self.may_be_tree(pole) {
            self.is_crowned(pole) || self.tree_odds(pole) > 0.0
        } else {
            !is_equipped_post(pole, config) && is_stem()
        };
        if is_tree || pole.radius_m > config.trunk_radius_m {
            PoleKind::Trunk
        } else if top <= config.delineator_top_m {
            PoleKind::Delineator
        } else if pole.shows_plates_alone {
            PoleKind::SignPost
        } else if top >= config.lamp_top_m || (pole.top_is_open && top >= config.open_lamp_top_m) {
            PoleKind::LampPost
        } else {
            PoleKind::SignPost
        }
    }
}

/// Log odds of trees among poles, from those of each where trees are as many as
/// posts: the share that explains itself (expectation-maximization), nats.
fn prior(odds: &[f64], usual_poles: f64) -> f64 {
    let log_odds = |trees: f64, posts: f64| (trees / posts).ln();
    let mut prior = 0.0_f64;
    for _ in 0..PRIOR_STEPS {
        let trees: f64 = odds.iter().map(|odds| (1.0 + (-odds - prior).exp()).recip()).sum();
        let posts = odds.len() as f64 - trees;
        prior = log_odds(trees + usual_poles / 2.0, posts + usual_poles / 2.0);
    }
    prior
}

/// Log odds of what is known to be one, nats.
const CERTAIN: f64 = 20.0;

/// Steps of the expectation-maximization: the share settles within a few.
const PRIOR_STEPS: usize = 20;

/// Another pole beside one.
pub(super) struct Other {
    /// Where it stands, map (x, z).
    at: Point2<f64>,
    /// Whether it is about as high, so that something may hang between the two.
    is_as_high: bool,
}

impl Other {
    /// Whether what is at a place is on it, or between it and the pole at `from`.
    fn has(&self, at: &Point2<f64>, from: &Point2<f64>, config: &PoleConfig) -> bool {
        let way = from - self.at;
        let share = (way.dot(&(at - self.at)) / way.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (at - self.at).norm() < config.trees.reach_of_others_m
            || (self.is_as_high && (at - self.at - way * share).norm() < config.trees.board_reach_m)
    }
}

/// Whether something is above the upper end and around it that is not on one of
/// `others`. What is no farther off than a plate reaches is a plate where it covers the
/// post, and what is farther off is a board on it where it is flat and to both sides.
pub(super) fn has_crown(pole: &FittedPole, others: &[Other], stacks: &Stacks, config: &PoleConfig) -> bool {
    let [near_m, far_m] = config.crown_radii_m;
    let around = above(pole, others, stacks, 0.0, near_m..far_m, config);
    if pole.stands_out_of_hedge(config) && around.share < config.hedges.least_crown * pole.hedge_share {
        return false;
    }
    let is_flat = around.across_m <= config.trees.board_spread_m && around.aside_m < near_m;
    if around.share >= config.trees.board_share && is_flat {
        return false;
    }
    let is_filled = |radii_m| above(pole, others, stacks, 0.0, radii_m, config).share >= config.crown_share;
    around.share >= config.crown_share || (is_filled(0.0..far_m) && !is_covered(pole, stacks, config))
}

/// Whether something is right over the upper end, its own cap aside: a plate, or
/// the crown that a stem goes on into. What stands by a bollard is beside it.
fn is_covered(pole: &FittedPole, stacks: &Stacks, config: &PoleConfig) -> bool {
    above(pole, &[], stacks, 2.0 * config.slice_m, 0.0..config.ring_inner_m, config).share >= config.crown_share
}

/// What fills the space from a height over the upper end on, and between two radii.
fn above(
    pole: &FittedPole,
    others: &[Other],
    stacks: &Stacks,
    from_m: f64,
    radii_m: Range<f64>,
    config: &PoleConfig,
) -> Filling {
    let heights_m = pole.top_height_m + from_m..pole.top_height_m + config.crown_height_m;
    let from = Point2::new(pole.top.x, pole.top.z);
    stacks.filling(&from, heights_m, radii_m, |at| others.iter().any(|other| other.has(at, &from, config)))
}
