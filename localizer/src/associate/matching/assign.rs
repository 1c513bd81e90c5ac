//! Which of the pairs within the gates are taken: the one-to-one set that says most together.

use super::{NONE, Pair};

/// Weight of a pair in the sum: a nat more than its support, about what it costs that a landmark
/// is unseen. Never below 0, and less for less: what says little is taken where nothing else
/// is, for a wide gate says little of any pair.
fn weight(pair: &Pair) -> f64 {
    if pair.support > 0.0 { 1.0 + pair.support } else { 1.0 / (1.0 - pair.support) }
}

/// Makes a buffer hold a value so many times.
fn refill<T: Clone>(buffer: &mut Vec<T>, count: usize, value: T) {
    buffer.clear();
    buffer.resize(count, value);
}

/// The two best pairs of a feature or candidate.
#[derive(Debug, Clone, Copy)]
struct Best {
    pair: usize,
    weight: f64,
    next: f64,
}

impl Best {
    const NO: Self = Self { pair: NONE, weight: 0.0, next: 0.0 };

    fn offer(&mut self, pair: usize, weight: f64) {
        if self.pair == NONE || weight > self.weight {
            *self = Self { pair, weight, next: self.weight };
        } else if weight > self.next {
            self.next = weight;
        }
    }
}

/// One side of the assignment: features, or candidates.
#[derive(Debug, Clone, Default)]
struct Side {
    best: Vec<Best>,
    /// What each is charged for being wanted (the dual variables of the Hungarian method).
    price: Vec<f64>,
}

/// A candidate on a way of exchanges.
#[derive(Debug, Clone, Copy)]
struct Reached {
    candidate: usize,
    /// How much is lost by the best way to it, over the least that must be.
    loss: f64,
    /// The pair that it is reached by.
    by: usize,
    is_done: bool,
}

/// Buffers of the assignment, and its result.
#[derive(Debug, Clone, Default)]
pub(super) struct Assignment {
    of_candidate: Vec<usize>,
    of_feature: Vec<usize>,
    /// Pairs that are not decided yet.
    open: Vec<usize>,
    features: Side,
    candidates: Side,
    reached: Vec<Reached>,
}

impl Assignment {
    /// The pair of each candidate, or [`NONE`].
    pub fn of_candidates(&self) -> &[usize] {
        &self.of_candidate
    }

    /// Finds the pairs, no two of one feature or candidate, that are worth most together.
    pub fn find(&mut self, pairs: &[Pair], features: usize, candidates: usize) {
        refill(&mut self.of_feature, features, NONE);
        refill(&mut self.of_candidate, candidates, NONE);
        self.open.clear();
        self.open.extend(0..pairs.len());
        while !self.open.is_empty() && self.take_undisputed(pairs) {}
        if !self.open.is_empty() {
            self.settle_disputes(pairs);
        }
    }

    /// Takes what is worth at least as much as the best that both could have instead
    /// together: that is part of a best set. Returns whether there was any.
    fn take_undisputed(&mut self, pairs: &[Pair]) -> bool {
        let (features, candidates) = (&mut self.features.best, &mut self.candidates.best);
        refill(features, self.of_feature.len(), Best::NO);
        refill(candidates, self.of_candidate.len(), Best::NO);
        for &i in &self.open {
            let weight = weight(&pairs[i]);
            features[pairs[i].feature].offer(i, weight);
            candidates[pairs[i].candidate].offer(i, weight);
        }
        let open = self.open.len();
        let (of_feature, of_candidate) = (&mut self.of_feature, &mut self.of_candidate);
        for (candidate, best) in candidates.iter().enumerate() {
            let Some(&Pair { feature, .. }) = pairs.get(best.pair) else { continue };
            let its = &features[feature];
            if its.pair == best.pair && best.weight >= its.next + best.next {
                (of_feature[feature], of_candidate[candidate]) = (best.pair, best.pair);
            }
        }
        self.open.retain(|&i| of_feature[pairs[i].feature] == NONE && of_candidate[pairs[i].candidate] == NONE);
        self.open.len() < open
    }

    /// Decides the rest by the Hungarian method (Kuhn, 1955): one feature after the other
    /// comes in, by the way of exchanges that loses least.
    fn settle_disputes(&mut self, pairs: &[Pair]) {
        refill(&mut self.features.price, self.of_feature.len(), 0.0);
        refill(&mut self.candidates.price, self.of_candidate.len(), 0.0);
        // What each may have at most is what it is charged before anyone else comes.
        for &i in &self.open {
            let price = &mut self.features.price[pairs[i].feature];
            *price = price.max(weight(&pairs[i]));
        }
        for feature in 0..self.of_feature.len() {
            if self.of_feature[feature] == NONE && self.features.price[feature] > 0.0 {
                self.let_in(pairs, feature);
            }
        }
    }

    /// Gives a feature its pair, or none, by the shortest way of exchanges (Dijkstra, with
    /// prices by which no exchange gains anything).
    fn let_in(&mut self, pairs: &[Pair], feature: usize) {
        self.reached.clear();
        let mut at = feature;
        let mut lost = 0.0;
        // The way that ends with a feature that goes without.
        let (mut without, mut without_loss) = (feature, f64::INFINITY);
        let end = loop {
            let loss = lost + self.features.price[at];
            if loss < without_loss {
                (without, without_loss) = (at, loss);
            }
            for &i in self.open.iter().filter(|&&i| pairs[i].feature == at) {
                let candidate = pairs[i].candidate;
                let charged = self.features.price[at] + self.candidates.price[candidate];
                let loss = lost + (charged - weight(&pairs[i])).max(0.0);
                match self.reached.iter_mut().find(|reached| reached.candidate == candidate) {
                    None => self.reached.push(Reached { candidate, loss, by: i, is_done: false }),
                    Some(known) if !known.is_done && loss < known.loss => (known.loss, known.by) = (loss, i),
                    Some(_) => {}
                }
            }
            let open = self.reached.iter_mut().filter(|reached| !reached.is_done);
            let nearest = open.min_by(|a, b| a.loss.total_cmp(&b.loss)).filter(|nearest| nearest.loss < without_loss);
            let Some(nearest) = nearest else { break None };
            nearest.is_done = true;
            lost = nearest.loss;
            match pairs.get(self.of_candidate[nearest.candidate]) {
                Some(held) => at = held.feature,
                None => break Some(nearest.candidate),
            }
        };
        let total = if end.is_some() { lost } else { without_loss };
        self.charge(pairs, feature, total);
        let mut free = end;
        if end.is_none() {
            // Whose place the way ends with; none where it is the newcomer itself.
            free = pairs.get(self.of_feature[without]).map(|left| left.candidate);
            self.of_feature[without] = NONE;
        }
        while let Some(candidate) = free {
            let Some(taken) = self.reached.iter().find(|reached| reached.candidate == candidate) else { break };
            let by = pairs[taken.by].feature;
            free = pairs.get(self.of_feature[by]).map(|left| left.candidate);
            self.of_feature[by] = taken.by;
            self.of_candidate[candidate] = taken.by;
        }
    }

    /// Keeps the prices such that no exchange gains anything after a way that lost `total`.
    fn charge(&mut self, pairs: &[Pair], feature: usize, total: f64) {
        self.features.price[feature] -= total;
        for reached in self.reached.iter().filter(|reached| reached.is_done) {
            let less = total - reached.loss;
            self.candidates.price[reached.candidate] += less;
            if let Some(held) = pairs.get(self.of_candidate[reached.candidate]) {
                self.features.price[held.feature] -= less;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn pair(feature: usize, candidate: usize, support: f64) -> Pair {
        Pair { feature, candidate, distance2: 0.0, support }
    }

    fn taken(pairs: &[Pair], features: usize, candidates: usize) -> Vec<usize> {
        let mut assignment = Assignment::default();
        assignment.find(pairs, features, candidates);
        assignment.of_candidates().to_vec()
    }

    fn sum_of(pairs: &[Pair], of_candidates: &[usize]) -> f64 {
        of_candidates.iter().filter_map(|&i| pairs.get(i)).map(weight).sum()
    }

    /// The most that any set of these pairs is worth, all tried.
    fn most(pairs: &[Pair], used: &mut Vec<(usize, usize)>) -> f64 {
        let Some((first, rest)) = pairs.split_first() else { return 0.0 };
        let mut best = most(rest, used);
        if used.iter().all(|(f, c)| *f != first.feature && *c != first.candidate) {
            used.push((first.feature, first.candidate));
            best = best.max(weight(first) + most(rest, used));
            used.pop();
        }
        best
    }

    #[test]
    fn two_that_say_more_together_are_taken_before_the_one_that_says_most() {
        // Two lines seen, two in the map: the first seen lies nearer to the second mapped.
        let pairs = [pair(0, 0, 8.0), pair(0, 1, 9.0), pair(1, 1, 7.0)];
        assert_eq!(taken(&pairs, 2, 2), [0, 2]);
        // Where the other says nearly nothing, the best is.
        let pairs = [pair(0, 0, -6.0), pair(0, 1, 9.0), pair(1, 1, 7.0)];
        assert_eq!(taken(&pairs, 2, 2), [NONE, 1]);
    }

    #[test]
    fn what_nothing_else_wants_is_taken_though_it_says_little() {
        assert_eq!(taken(&[pair(0, 0, -3.0)], 1, 1), [0]);
        assert_eq!(taken(&[], 2, 1), [NONE]);
    }

    #[test]
    fn a_support_that_is_no_number_stops_nothing() {
        let pairs = [pair(0, 0, f64::NAN), pair(0, 1, 2.0), pair(1, 1, f64::INFINITY), pair(1, 0, f64::NEG_INFINITY)];
        assert_eq!(taken(&pairs, 2, 2)[1], 2);
    }

    proptest! {
        #[test]
        fn no_other_set_is_worth_more(
            supports in prop::collection::vec((0..5_usize, 0..5_usize, -4.0..12.0_f64), 0..12), ties in any::<bool>(),
        ) {
            let mut pairs: Vec<Pair> = Vec::new();
            for (feature, candidate, support) in supports {
                let support = if ties { support.round() } else { support };
                if pairs.iter().all(|known| known.feature != feature || known.candidate != candidate) {
                    pairs.push(pair(feature, candidate, support));
                }
            }
            let of_candidates = taken(&pairs, 5, 5);
            for (candidate, &i) in of_candidates.iter().enumerate() {
                let own = pairs.get(i);
                prop_assert!(own.is_none_or(|own| own.candidate == candidate));
                let twice = of_candidates.iter().filter(|&&j| own.is_some_and(|own| pairs.get(j).is_some_and(|p| p.feature == own.feature)));
                prop_assert!(twice.count() <= 1);
            }
            let (found, best) = (sum_of(&pairs, &of_candidates), most(&pairs, &mut Vec::new()));
            prop_assert!((found - best).abs() < 1e-9, "{found} of {best}: {pairs:?} {of_candidates:?}");
        }
    }
}
