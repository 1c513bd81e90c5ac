//! The stitched cloud as LAZ: every point once, the landmarks' points marked.

use std::collections::BTreeMap;

use crate::support::{DEMO, build, text};

#[test]
fn points_on_the_landmarks_of_the_map_carry_their_class() {
    let folder = tempfile::tempdir().unwrap();
    let (map, cloud) = (folder.path().join("a.csm"), folder.path().join("a.laz"));
    build(&DEMO.file("drive"), "00", &map, &["--cloud", text(&cloud)]).ok();
    let map = common::map::read(&map).unwrap();
    let points = las::Reader::from_path(&cloud).unwrap().read_all().unwrap();
    let points: Vec<las::Point> = points.points().map(|p| p.unwrap()).collect();
    let mut classes: BTreeMap<u8, usize> = BTreeMap::new();
    for p in &points {
        *classes.entry(u8::from(p.classification)).or_default() += 1;
        assert!(p.point_source_id % 5 == 0, "only every fifth frame was stitched");
    }
    for class in [1, 2, 11, 70] {
        assert!(classes.get(&class).is_some_and(|n| *n > 500), "{classes:?}");
    }
    // Map x, z, -y: a pole's points stand around its axis.
    for pole in &map.poles {
        let middle = nalgebra::center(&pole.foot_map, &pole.top_map);
        let marked =
            points.iter().filter(|p| u8::from(p.classification) >= 64 && (p.x - middle.x).hypot(p.y - middle.z) < 0.4);
        assert!(marked.count() >= 5, "{pole:?}");
    }
}
