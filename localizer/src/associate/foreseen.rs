//! What the map says should be seen, against what is.

/// Poles, signs and lights that should be seen, and those of them that were found: each
/// weighs as much as it was expected, for that what is far and hardly ever found was not,
/// or something else in its stead, tells little. And posts that are seen, of which the map
/// knows.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Foreseen {
    /// Sum of the squared probabilities to find each.
    pub expected: f64,
    /// Sum of the probabilities of those found: more where the view is good.
    pub found: f64,
    /// Posts that are seen.
    pub seen: f64,
    /// Those of them that are matched.
    pub known: f64,
}

impl Foreseen {
    /// Counts one landmark that costs so much unseen, nats (not above 0).
    pub fn count(&mut self, unseen: f64, is_found: bool) {
        let probability = -unseen.exp_m1();
        self.expected += probability * probability;
        if is_found {
            self.found += probability;
        }
    }

    /// Takes in what another frame shows, `weight` times.
    pub fn add(&mut self, other: &Self, weight: f64) {
        self.expected += weight * other.expected;
        self.found += weight * other.found;
        self.seen += weight * other.seen;
        self.known += weight * other.known;
    }

    /// Keeps a share of what was counted.
    pub fn fade(&mut self, kept: f64) {
        for sum in [&mut self.expected, &mut self.found, &mut self.seen, &mut self.known] {
            *sum *= kept;
        }
    }

    /// Share of what was expected that was found, as if two more had been expected and
    /// found: all of it where a map has nothing but lines, and promises none.
    pub fn share(&self) -> f64 {
        (self.found + 2.0) / (self.expected + 2.0)
    }

    /// Share of the posts that were seen that the map knows; none before any was.
    pub fn known_share(&self) -> f64 {
        self.known / (self.seen + 2.0)
    }

    /// [`Self::share`] and the share of the posts that were seen that the map knows,
    /// together: of these `usual` before any was, and as far as the map promises none.
    pub fn agreement(&self, usual: f64) -> f64 {
        let promised = self.expected / (self.expected + 2.0);
        let known = (self.known + 2.0 * usual) / (self.seen + 2.0);
        self.share() + promised * known + (1.0 - promised) * usual
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a landmark that is found so often costs unseen, nats.
    fn unseen(probability: f64) -> f64 {
        (1.0 - probability).ln()
    }

    #[test]
    fn who_finds_as_often_as_expected_finds_all_that_is_expected() {
        let mut foreseen = Foreseen::default();
        assert!((foreseen.share() - 1.0).abs() < 1e-12, "nothing is promised yet");
        for i in 0..1000 {
            // Of near ones eight of ten, of far ones one of ten.
            foreseen.count(unseen(0.8), i % 10 < 8);
            foreseen.count(unseen(0.1), i % 10 < 1);
            // Outside the image nothing is expected.
            foreseen.count(0.0, i % 2 == 0);
        }
        assert!((foreseen.share() - 1.0).abs() < 0.01, "{}", foreseen.share());
    }

    #[test]
    fn far_ones_that_fit_by_chance_do_not_make_up_for_near_ones_that_are_missing() {
        let mut foreseen = Foreseen::default();
        for _ in 0..100 {
            foreseen.count(unseen(0.8), false);
            foreseen.count(unseen(0.1), true);
        }
        assert!(foreseen.share() < 0.2, "{}", foreseen.share());
    }

    #[test]
    fn who_sees_half_of_it_may_still_know_what_it_sees() {
        let mut foreseen = Foreseen::default();
        assert!(foreseen.known_share().abs() < 1e-12, "nothing is known yet");
        for i in 0..1000 {
            foreseen.count(unseen(0.8), i % 10 < 4);
        }
        foreseen.add(&Foreseen { seen: 800.0, known: 400.0, ..Foreseen::default() }, 2.0);
        assert!((foreseen.share() - 0.5).abs() < 0.01 && (foreseen.known_share() - 0.5).abs() < 0.01);
    }

    #[test]
    fn a_map_agrees_that_promises_what_is_there_and_knows_what_is_seen() {
        let of = |expected: f64, found: f64, seen: f64, known: f64| Foreseen { expected, found, seen, known };
        let agreement = |of: Foreseen| of.agreement(0.45);
        // Nothing is known yet, or the map has nothing but lines.
        assert!((agreement(of(0.0, 0.0, 0.0, 0.0)) - 1.45).abs() < 1e-12);
        assert!((agreement(of(0.0, 0.0, 500.0, 0.0)) - 1.45).abs() < 1e-12);
        assert!((agreement(of(1e6, 1e6, 1e6, 6e5)) - 1.6).abs() < 1e-3);
        assert!((agreement(of(1e6, 5e5, 1e6, 3e5)) - 0.8).abs() < 1e-3);
    }

    #[test]
    fn what_was_seen_long_ago_is_forgotten() {
        let (mut foreseen, mut now) = (Foreseen::default(), Foreseen::default());
        now.count(unseen(0.9), true);
        (now.seen, now.known) = (2.0, 1.0);
        foreseen.add(&now, 1e3);
        assert!(foreseen.share() > 1.0 && foreseen.known_share() > 0.4);
        foreseen.fade(1e-6);
        assert!((foreseen.share() - 1.0).abs() < 1e-3, "{}", foreseen.share());
        let Foreseen { expected, found, seen, known } = foreseen;
        assert!([expected, found, seen, known].iter().all(|sum| (0.0..0.01).contains(sum)), "{foreseen:?}");
    }
}
