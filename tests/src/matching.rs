//! Which found things are which true ones.

use nalgebra::Point2;

/// One-to-one pairs `(found, wanted)` of points at most `within_m` apart, as
/// many as there can be, near ones first; by ascending `found`.
///
/// Augmenting paths (Kuhn 1955) over the near pairs.
pub fn one_to_one(found: &[Point2<f64>], wanted: &[Point2<f64>], within_m: f64) -> Vec<(usize, usize)> {
    let near: Vec<Vec<usize>> = found
        .iter()
        .map(|f| {
            let distance = |w: &usize| (wanted[*w] - f).norm();
            let mut near: Vec<usize> = (0..wanted.len()).filter(|w| distance(w) <= within_m).collect();
            near.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            near
        })
        .collect();
    // Those with the nearest partner choose first, so that the pairs are the
    // obvious ones where nobody has to give way.
    let mut order: Vec<usize> = (0..found.len()).filter(|f| !near[*f].is_empty()).collect();
    let nearest = |f: usize| (wanted[near[f][0]] - found[f]).norm();
    order.sort_by(|a, b| nearest(*a).total_cmp(&nearest(*b)));
    let mut taken_by: Vec<Option<usize>> = vec![None; wanted.len()];
    for f in order {
        place(f, &near, &mut taken_by, &mut vec![false; wanted.len()]);
    }
    let mut pairs: Vec<(usize, usize)> = taken_by.iter().enumerate().filter_map(|(w, f)| f.map(|f| (f, w))).collect();
    pairs.sort_unstable();
    pairs
}

/// Finds a partner for `f`, asking those in the way to move on.
fn place(f: usize, near: &[Vec<usize>], taken_by: &mut [Option<usize>], asked: &mut [bool]) -> bool {
    for &w in &near[f] {
        if std::mem::replace(&mut asked[w], true) {
            continue;
        }
        let is_free = match taken_by[w] {
            None => true,
            Some(other) => place(other, near, taken_by, asked),
        };
        if is_free {
            taken_by[w] = Some(f);
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_is_paired_twice_and_whoever_can_give_way_does() {
        let line = |xs: &[f64]| xs.iter().map(|&x| Point2::new(x, 0.0)).collect::<Vec<_>>();
        assert_eq!(one_to_one(&line(&[0.0, 0.1]), &line(&[0.05]), 1.0).len(), 1);
        // The first would take 0.5, and the second has nothing else.
        assert_eq!(one_to_one(&line(&[0.4, 1.4]), &line(&[-0.5, 0.5]), 1.0), [(0, 0), (1, 1)]);
        assert_eq!(one_to_one(&line(&[0.0, 5.0]), &line(&[5.2, 0.3, 9.0]), 1.0), [(0, 1), (1, 0)]);
        assert!(one_to_one(&[], &line(&[1.0]), 1.0).is_empty());
    }
}
