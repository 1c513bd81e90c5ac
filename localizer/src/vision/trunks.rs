//! Trunks: columns of vegetation that stand free on both sides, under a crown.
//!
//! Networks call trees vegetation, from the crown to the foot, and trunks hardly
//! ever poles. Where a wall, the road or the sky is seen to the left and to the
//! right, the trunk is narrow in its rows and the crown is not, so the rows tell
//! them apart. What is left is measured as poles are.

use super::config::{PoleConfig, TrunkConfig};
use super::regions::{self, Run};
use super::{Class, Plane, ProbabilityMaps, poles};
use crate::features::LineFeature;

/// The trunks of an image, from left to right; none where nothing tells of
/// vegetation. A crown or a hedge hides either end, so both count as cut.
pub fn extract(maps: &ProbabilityMaps, config: &TrunkConfig, poles: &PoleConfig) -> Option<Vec<LineFeature>> {
    let vegetation = maps.plane(Class::Vegetation);
    if vegetation.data().iter().all(|&value| value == 0) {
        return None;
    }
    let mut trunks = poles::measure(&narrow(vegetation, config), maps, &config.as_poles(poles));
    for trunk in &mut trunks {
        (trunk.upper_is_cut, trunk.lower_is_cut) = (true, true);
    }
    Some(trunks)
}

/// What is narrow in its row and free on both sides; zero elsewhere.
fn narrow(vegetation: &Plane, config: &TrunkConfig) -> Plane {
    let width = vegetation.width();
    let mut narrow = Plane::zeros(width, vegetation.height());
    let widest = config.widest_of_width * width as f64;
    let runs = regions::runs(vegetation, regions::level(config.threshold));
    let of_row = |run: Option<&Run>, y: usize| run.copied().filter(|run| run.y == y);
    for (i, run) in runs.iter().enumerate() {
        let own = (run.end - run.start) as f64;
        // What reaches the border of the image may go on beyond it.
        if own > widest || run.start == 0 || run.end == width {
            continue;
        }
        let before = of_row(i.checked_sub(1).and_then(|i| runs.get(i)), run.y).map_or(0, |other| other.end);
        let after = of_row(runs.get(i + 1), run.y).map_or(width, |other| other.start);
        let free = (run.start - before).min(after - run.end) as f64;
        if free >= config.free_share * own {
            let pixels = run.y * width + run.start..run.y * width + run.end;
            narrow.data_mut()[pixels.clone()].copy_from_slice(&vegetation.data()[pixels]);
        }
    }
    narrow
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tree before a wall: a crown over a trunk of `trunk` columns.
    fn tree(trunk: std::ops::Range<usize>, beside: u8) -> ProbabilityMaps {
        let mut maps = ProbabilityMaps::zeros(400, 200);
        let value = |x: usize, y: usize| match y {
            20..80 if (100..300).contains(&x) => 240,
            80..160 if trunk.contains(&x) => 220,
            80..160 => beside,
            _ => 0,
        };
        let data = (0..400 * 200).map(|at| value(at % 400, at / 400)).collect();
        maps.set(Class::Vegetation, Plane::new(400, data).unwrap()).unwrap();
        maps
    }

    fn found(maps: &ProbabilityMaps) -> Vec<LineFeature> {
        extract(maps, &TrunkConfig::default(), &PoleConfig::default()).unwrap()
    }

    #[test]
    fn a_trunk_under_a_crown_is_found_where_it_stands() {
        let trunks = found(&tree(190..202, 20));
        assert_eq!(trunks.len(), 1);
        let trunk = trunks[0];
        assert!((trunk.upper_px.x - 195.5).abs() < 0.1 && (trunk.lower_px.x - 195.5).abs() < 0.1);
        assert!((trunk.upper_px.y - 80.0).abs() < 1.5 && (trunk.lower_px.y - 159.0).abs() < 1.5);
        assert!(trunk.upper_is_cut && trunk.lower_is_cut && (trunk.width_px - 12.0).abs() < 0.5);
    }

    #[test]
    fn what_gaps_leave_of_a_crown_is_no_trunk() {
        let mut maps = tree(190..202, 0);
        let mut leaves = maps.plane(Class::Vegetation).clone();
        for y in 80..160 {
            for x in (205..217).chain(220..232).chain(175..187) {
                leaves.data_mut()[y * 400 + x] = 220;
            }
        }
        maps.set(Class::Vegetation, leaves).unwrap();
        assert!(found(&maps).is_empty());
    }

    #[test]
    fn crowns_hedges_and_what_stands_before_them_are_no_trunks() {
        assert!(found(&tree(0..0, 0)).is_empty(), "a crown");
        assert!(found(&tree(190..202, 200)).is_empty(), "before a hedge");
        assert!(found(&tree(190..260, 0)).is_empty(), "too wide");
        assert!(found(&tree(0..12, 0)).is_empty(), "at the border of the image");
    }

    #[test]
    fn without_vegetation_nothing_is_said_of_trunks() {
        let none = extract(&ProbabilityMaps::zeros(40, 20), &TrunkConfig::default(), &PoleConfig::default());
        assert_eq!(none, None);
    }
}
