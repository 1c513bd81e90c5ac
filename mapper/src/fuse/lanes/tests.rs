use super::*;

fn line(x: f64, from: f64, to: f64, pass: u32) -> Sighting<LaneLine> {
    let points_map = vec![Point3::new(x, 1.6, from), Point3::new(x, 1.6, to)];
    Sighting {
        landmark: LaneLine { kind: LaneKind::Solid, points_map, road: RoadId(0), marks_m: Vec::new() },
        pass,
        covariance_map_m2: None,
    }
}

fn vertices(sightings: &[Sighting<LaneLine>]) -> Vec<Vec<Point3<f64>>> {
    let config = FuseConfig::default();
    fuse_lanes(sightings, &config).iter().map(|lane| lane.vertices(&config)).collect()
}

#[test]
fn a_line_that_one_pass_saw_stays_as_it_is() {
    let mut alone = line(1.5, 0.0, 40.0, 0);
    alone.landmark.points_map.insert(1, Point3::new(1.501, 1.61, 7.3));
    assert_eq!(vertices(std::slice::from_ref(&alone)), [alone.landmark.points_map]);
}

#[test]
fn lines_cut_at_different_places_are_one_between_them() {
    let cut = [line(1.5, 0.0, 50.0, 0), line(1.6, -20.0, 30.0, 1), line(1.6, 30.0, 70.0, 1)];
    let fused = vertices(&cut);
    let [one] = &fused[..] else { panic!("{fused:?}") };
    let (first, last) = (one[0], one[one.len() - 1]);
    assert!((first.z - -20.0).abs() < 1e-9 && (last.z - 70.0).abs() < 1e-9, "{one:?}");
    assert!((first.x - 1.6).abs() < 0.01 && (last.x - 1.6).abs() < 0.01);
    let middle = fuse_lanes(&cut, &FuseConfig::default())[0].samples.iter().find(|s| s.point_map.z > 20.0).cloned();
    let middle = middle.unwrap();
    assert!((middle.point_map.x - 1.55).abs() < 1e-9);
    assert_eq!(middle.passes.len(), 2);
}

#[test]
fn cuts_at_the_ends_of_roads_leave_no_pieces() {
    let cut = [line(1.5, 0.0, 50.0, 0), line(1.5, 50.0, 100.0, 0), line(1.6, 48.0, 100.0, 1), line(1.6, 0.0, 48.0, 1)];
    let fused = vertices(&cut);
    assert_eq!(fused.len(), 1, "{fused:?}");
    assert_eq!((fused[0][0].z, fused[0][fused[0].len() - 1].z), (0.0, 100.0));
    let lone = &fuse_lanes(&cut[..2], &FuseConfig::default())[0];
    assert!(lone.is_lone());
    assert_eq!(lone.sightings, [0, 1]);
    assert_eq!(lone.vertices(&FuseConfig::default()).len(), 3);
}

#[test]
fn a_short_line_that_one_pass_saw_is_kept() {
    assert_eq!(vertices(&[line(1.5, 0.0, 1.0, 0)]).len(), 1);
}

#[test]
fn lines_in_a_ring_are_one_and_end() {
    let corners = [(0.0, 0.0), (0.0, 30.0), (30.0, 30.0), (30.0, 0.0)].map(|(x, z)| Point3::new(x, 1.6, z));
    let side = |i: usize| {
        let mut side = line(0.0, 0.0, 1.0, 0);
        side.landmark.points_map = vec![corners[i], corners[(i + 1) % 4]];
        side
    };
    let fused = vertices(&[0, 1, 2, 3].map(side));
    assert_eq!((fused.len(), fused[0].len()), (1, 5));
}

#[test]
fn a_pass_in_the_other_direction_sees_the_same_line() {
    let mut back = line(1.6, 20.0, 80.0, 1);
    back.landmark.points_map.reverse();
    let fused = vertices(&[line(1.5, 0.0, 70.0, 0), back]);
    assert_eq!(fused.len(), 1);
    let ends = (fused[0][0].z, fused[0][fused[0].len() - 1].z);
    assert!((ends.0, ends.1) == (0.0, 80.0), "{ends:?}");
}

#[test]
fn a_double_line_stays_double() {
    let both = [line(1.5, 0.0, 50.0, 0), line(1.7, 1.0, 50.0, 0), line(1.55, 0.0, 49.0, 1), line(1.75, 0.0, 48.0, 1)];
    let fused = vertices(&both);
    assert_eq!(fused.len(), 2);
    let apart = fused[0][0].x - fused[1][0].x;
    assert!((apart.abs() - 0.2).abs() < 0.02, "{fused:?}");
}

#[test]
fn a_crossing_line_and_one_on_a_bridge_stay_their_own() {
    let mut crossing = line(0.0, 0.0, 0.0, 1);
    crossing.landmark.points_map = vec![Point3::new(-20.0, 1.6, 25.0), Point3::new(20.0, 1.6, 25.0)];
    let mut above = line(1.5, 0.0, 50.0, 2);
    for point in &mut above.landmark.points_map {
        point.y -= 5.0;
    }
    assert_eq!(vertices(&[line(1.5, 0.0, 50.0, 0), crossing, above]).len(), 3);
}

#[test]
fn the_kind_is_that_of_most_of_the_length() {
    let mut short = line(1.5, 0.0, 20.0, 1);
    short.landmark.kind = LaneKind::Dashed;
    let fused = fuse_lanes(&[line(1.5, 0.0, 50.0, 0), short], &FuseConfig::default());
    assert_eq!((fused.len(), fused[0].kind), (1, LaneKind::Solid));
}

#[test]
fn a_kerb_beside_a_line_is_no_other_sighting_of_it() {
    let mut kerb = line(1.6, 0.0, 50.0, 1);
    kerb.landmark.kind = LaneKind::Kerb;
    let fused = fuse_lanes(&[line(1.5, 0.0, 50.0, 0), kerb], &FuseConfig::default());
    assert_eq!(fused.iter().map(|line| line.kind).collect::<Vec<_>>(), [LaneKind::Solid, LaneKind::Kerb]);
}

#[test]
fn the_order_of_sightings_and_the_names_of_passes_do_not_matter() {
    let noise = |i: u32| f64::from(i * 7919 % 101) / 101.0 - 0.5;
    let mut sightings: Vec<Sighting<LaneLine>> = (0..24)
        .map(|i| {
            let from = f64::from(i / 4) * 20.0 + 9.0 * noise(i);
            line(1.5 + 0.3 * noise(i + 50), from, from + 20.0 + 9.0 * noise(i + 7), i % 4)
        })
        .collect();
    let expected = vertices(&sightings);
    assert!(expected.len() < 24);
    sightings.reverse();
    sightings.swap(3, 20);
    for sighting in &mut sightings {
        sighting.pass = 9 - sighting.pass;
    }
    assert_eq!(vertices(&sightings), expected);
}

#[test]
fn what_is_no_line_makes_no_line() {
    let mut point = line(1.5, 3.0, 3.0, 0);
    let mut empty = line(1.5, 3.0, 3.0, 1);
    empty.landmark.points_map.clear();
    assert!(vertices(&[point.clone(), empty]).is_empty());
    point.landmark.points_map[1].x = f64::NAN;
    vertices(&[point]);
}
