//! What holds for any map and any bytes.

use nalgebra::Point3;
use proptest::prelude::*;

use super::super::*;
use super::{encode, form, resealed};

fn point(range_m: f64) -> impl Strategy<Value = Point3<f64>> {
    prop::array::uniform3(-range_m..range_m).prop_map(Point3::from)
}

fn landmarks() -> impl Strategy<Value = SemanticMap> {
    let road = || (0..3_u32).prop_map(RoadId);
    let path = |least| prop::collection::vec(point(500.0), least..6);
    let pole = (0..4_usize, point(500.0), 0.0..12.0_f64, road()).prop_map(|(kind, foot_map, height, road)| Pole {
        kind: PoleKind::ALL[kind],
        foot_map,
        top_map: Point3::new(foot_map.x + 0.1, foot_map.y - height, foot_map.z - 0.3),
        road,
    });
    let sign = (0..2_usize, point(500.0), 0.0..3.0_f64, road()).prop_map(|(kind, centroid_map, size_m, road)| Sign {
        kind: SignKind::ALL[kind],
        centroid_map,
        size_m,
        road,
    });
    let steps = prop::collection::vec((0.3..9.0_f64, 0.3..9.0_f64), 0..5);
    let lane = (0..3_usize, path(2), road(), steps).prop_map(|(kind, points_map, road, steps)| {
        let kind = LaneKind::ALL[kind];
        let mut end_m = 0.0;
        let marks = steps.into_iter().map(|(gap_m, mark_m)| {
            end_m += gap_m + mark_m;
            [end_m - mark_m, end_m]
        });
        let marks_m = if kind == LaneKind::Dashed { marks.collect() } else { Vec::new() };
        LaneLine { kind, points_map, road, marks_m }
    });
    (
        "[ -~]{0,20}",
        prop::collection::vec(path(1).prop_map(|path_map| Road { path_map }), 3),
        prop::collection::vec(pole, 0..12),
        prop::collection::vec(sign, 0..12),
        prop::collection::vec(lane, 0..6),
    )
        .prop_map(|(frame_note, roads, poles, signs, lanes)| SemanticMap {
            frame_note,
            roads,
            poles,
            signs,
            lanes,
        })
}

/// Everything in a map as numbers, in an order that rounding does not change
/// often: compared only where it did not.
fn is_near(a: &Point3<f64>, b: &Point3<f64>, quantum_m: f64) -> bool {
    (a - b).amax() <= 0.5 * quantum_m + 1e-9
}

proptest! {
    #[test]
    fn every_landmark_survives_within_half_a_quantum(map in landmarks(), quantum_mm in 1..200_u32) {
        let quantum_m = f64::from(quantum_mm) / 1e3;
        let bytes = map.encode(&EncodeOptions { quantum_m }).unwrap();
        let back = SemanticMap::decode(&bytes).unwrap();
        prop_assert_eq!(&back.frame_note, &map.frame_note);
        prop_assert_eq!(back.poles.len(), map.poles.len());
        prop_assert_eq!(back.signs.len(), map.signs.len());
        prop_assert_eq!(back.lanes.len(), map.lanes.len());
        for (a, b) in map.roads.iter().zip(&back.roads) {
            prop_assert_eq!(a.path_map.len(), b.path_map.len());
            prop_assert!(a.path_map.iter().zip(&b.path_map).all(|(a, b)| is_near(a, b, quantum_m)));
        }
        for a in &map.poles {
            let is_same = |b: &Pole| {
                let (axis, stored) = (a.top_map - a.foot_map, b.top_map - b.foot_map);
                // A point where it has no height on the grid.
                let aside_m = if stored.y == 0.0 { axis.xz().amax() } else { -0.5e-3 * stored.y + 1e-9 };
                is_near(&a.foot_map, &b.foot_map, quantum_m)
                    && (a.top_map.y - b.top_map.y).abs() <= 0.5 * quantum_m + 1e-9
                    && (axis - stored).xz().amax() <= aside_m
            };
            prop_assert!(back.poles.iter().any(|b| (a.kind, a.road) == (b.kind, b.road) && is_same(b)));
        }
        for a in &map.signs {
            prop_assert!(back.signs.iter().any(|b| (a.kind, a.road) == (b.kind, b.road)
                && is_near(&a.centroid_map, &b.centroid_map, quantum_m)
                && (a.size_m - b.size_m).abs() <= 0.5 * quantum_m + 1e-9));
        }
        for a in &map.lanes {
            prop_assert!(back.lanes.iter().any(|b| (a.kind, a.road) == (b.kind, b.road)
                && a.points_map.len() == b.points_map.len()
                && a.points_map.iter().zip(&b.points_map).all(|(a, b)| is_near(a, b, quantum_m))
                && a.marks_m.len() == b.marks_m.len()
                && a.marks_m.iter().flatten().zip(b.marks_m.iter().flatten())
                    .all(|(a, b)| (a - b).abs() <= 0.5 * quantum_m + 1e-9)));
        }
        prop_assert_eq!(back.encode(&EncodeOptions { quantum_m }).unwrap(), bytes);
    }

    #[test]
    fn the_order_of_landmarks_does_not_change_the_bytes(mut map in landmarks(), tied in any::<bool>()) {
        // Side by side, only their other values can tell landmarks apart.
        let anchors = map.poles.iter_mut().map(|pole| &mut pole.foot_map);
        let anchors = anchors.chain(map.signs.iter_mut().map(|sign| &mut sign.centroid_map));
        for anchor in anchors.chain(map.lanes.iter_mut().map(|lane| &mut lane.points_map[0])).filter(|_| tied) {
            (anchor.x, anchor.z) = (0.0, 0.0);
        }
        let mut turned = map.clone();
        turned.poles.reverse();
        turned.signs.reverse();
        turned.lanes.reverse();
        prop_assert_eq!(encode(&turned), encode(&map));
    }

    #[test]
    fn what_is_accepted_is_what_would_be_written(version in 1..=5_u8, body in prop::collection::vec(any::<u8>(), 0..80)) {
        let bytes = envelope::seal(form(version), &body).unwrap();
        if let Ok(map) = SemanticMap::decode(&bytes) {
            let quantum_m = layout(&bytes).unwrap().quantum_m;
            prop_assert_eq!(map.encode_with(form(version).leans, EncodeOptions { quantum_m }).unwrap(), bytes);
        }
    }

    #[test]
    fn a_changed_body_never_panics(map in landmarks(), at in any::<prop::sample::Index>(), byte in any::<u8>()) {
        let mut bytes = encode(&map);
        let at = envelope::PREFIX_BYTES + at.index(bytes.len() - envelope::PREFIX_BYTES);
        bytes[at] = byte;
        let _ = SemanticMap::decode(&resealed(&bytes));
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(SemanticMap::decode(&bytes).is_err());
    }
}
