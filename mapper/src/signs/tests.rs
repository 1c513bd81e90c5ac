use nalgebra::Vector3;

use super::*;
use crate::lidar::LidarConfig;
use crate::poles::find_poles;
use crate::testing::{CAMERA_HEIGHT_M, Street};

/// A post with what hangs on it, hit by the beams of a lidar as a real one has
/// them: every 3 mrad across and every 7.3 mrad in height, up to 2 degrees.
struct Post {
    street: Street,
    foot: Point3<f64>,
}

const SHEETING: f32 = 0.99;
const METAL: f32 = 0.4;
const HOUSING: f32 = 0.05;

impl Post {
    fn new(x: f64, z: f64) -> Self {
        Self { street: Street::new(), foot: Point3::new(x, CAMERA_HEIGHT_M, z) }
    }

    /// Hits on a board facing along -z, from a height above ground to another, as
    /// bright as told on its front (seen by the scans before it) and on its back;
    /// `before_m` nearer to the start of the road than the axis.
    fn board(&mut self, width_m: f64, heights_m: (f64, f64), before_m: f64, shades: [Option<f32>; 2]) {
        self.hidden_board(width_m, heights_m, before_m, shades, f64::INFINITY);
    }

    /// The same with leaves before all that is higher above ground than told: a tenth of
    /// the way nearer.
    fn hidden_board(
        &mut self,
        width_m: f64,
        heights_m: (f64, f64),
        before_m: f64,
        shades: [Option<f32>; 2],
        up_to_m: f64,
    ) {
        let lidar = LidarConfig::default();
        for scan in 0..10_u16 {
            let eye = Point3::new(0.0, -lidar.apex_m, 6.0 * f64::from(scan));
            let z = self.foot.z - before_m;
            let range_m = self.foot.x.hypot(z - eye.z);
            let Some(shade) = shades[usize::from(eye.z > z)] else { continue };
            // Beams of each scan fall elsewhere.
            let shift = f64::from(scan) * 0.37 % 1.0;
            for i in -60..=4 {
                let elevation = lidar.highest_rad + (f64::from(i) - 4.0 - shift) * lidar.elevation_step_rad;
                let up_m = CAMERA_HEIGHT_M + lidar.apex_m + range_m * elevation.tan();
                if up_m < heights_m.0 || up_m > heights_m.1 {
                    continue;
                }
                let share = if up_m > up_to_m { 0.9 } else { 1.0 };
                // Steps across the view are longer on a board seen at an angle.
                let step_m = lidar.azimuth_step_rad * range_m.powi(2) / (z - eye.z).abs().max(1.0);
                for k in -60..60 {
                    let x = (f64::from(k) + shift) * step_m;
                    if x.abs() <= width_m / 2.0 {
                        let p = Point3::new(self.foot.x + x, CAMERA_HEIGHT_M - up_m, z);
                        self.street.add(eye + (p - eye) * share, scan, shade, None);
                    }
                }
            }
        }
    }

    fn found(self, top_m: f64) -> Vec<FoundSign> {
        self.found_on(&[(0.0, top_m)])
    }

    /// The same on a post that is bare between some heights above ground only.
    fn found_on(self, bare_m: &[(f64, f64)]) -> Vec<FoundSign> {
        self.built(bare_m).1
    }

    /// The same, and the poles.
    fn built(self, bare_m: &[(f64, f64)]) -> (Vec<(PoleKind, FittedPole)>, Vec<FoundSign>) {
        let (cloud, poles) = self.cloud_and_poles(bare_m);
        let signs = find_signs(&cloud, &poles, &Config::default());
        (poles, signs)
    }

    fn cloud_and_poles(mut self, bare_m: &[(f64, f64)]) -> (Cloud, Vec<(PoleKind, FittedPole)>) {
        for (from_m, to_m) in bare_m {
            let at = |height_m: f64| self.foot - Vector3::new(0.0, height_m, 0.0);
            self.street.add_cylinder(at(*from_m), at(*to_m), 0.038);
        }
        let cloud = self.street.cloud();
        let poles = find_poles(&cloud, &PoleConfig::default(), &LidarConfig::default());
        (cloud, poles)
    }
}

#[test]
fn a_board_as_bright_as_white_plaster_is_no_sign() {
    let signs = |shade: f32| {
        let mut post = Post::new(4.0, 30.0);
        post.board(0.6, (2.0, 2.6), 0.1, [Some(shade), Some(METAL)]);
        find_signs(&post.street.cloud(), &[], &Config::default()).len()
    };
    assert_eq!((signs(SHEETING), signs(0.78)), (1, 0));
}

#[test]
fn a_post_that_ends_at_no_sign_may_go_on_above_and_is_no_sign_post() {
    let kinds = |has_sign: bool| {
        let mut post = Post::new(5.0, 56.0);
        if has_sign {
            post.board(0.6, (2.2, 2.8), 0.05, [Some(SHEETING), Some(METAL)]);
        }
        let (mut poles, signs) = post.built(&[(0.0, 2.2)]);
        let [(before, _)] = poles[..] else { panic!("{poles:?}") };
        name_posts(&mut poles, &signs, &PoleConfig::default());
        (before, poles[0].0)
    };
    assert_eq!(kinds(true), (PoleKind::SignPost, PoleKind::SignPost));
    assert_eq!(kinds(false), (PoleKind::SignPost, PoleKind::LampPost));
}

#[test]
fn a_thin_stem_with_a_plate_is_a_post_and_a_thick_one_stays_a_tree() {
    let kind = |radius_m: f64| {
        let mut post = Post::new(5.0, 10.0);
        post.board(0.6, (1.9, 2.4), 0.05, [None, Some(METAL)]);
        let (cloud, mut poles) = post.cloud_and_poles(&[(0.0, 1.85)]);
        let [(kind, pole)] = &mut poles[..] else { panic!("{poles:?}") };
        (*kind, pole.radius_m) = (PoleKind::Trunk, radius_m);
        let config = Config::default();
        let signs = find_signs(&cloud, &poles, &config);
        name_posts(&mut poles, &signs, &config.poles);
        (poles[0].0, signs.len())
    };
    assert_eq!((kind(0.04), kind(0.12)), ((PoleKind::SignPost, 1), (PoleKind::Trunk, 0)));
}

#[test]
fn the_middle_of_a_plate_is_not_that_of_its_bright_hits() {
    let mut post = Post::new(5.0, 56.0);
    // Near scans see the lower edge only.
    post.board(0.6, (2.2, 2.8), 0.05, [Some(SHEETING), Some(METAL)]);
    let signs = post.found(2.1);
    assert_eq!(signs.len(), 1, "{signs:?}");
    let sign = &signs[0];
    assert!((sign.centroid - Point3::new(5.0, CAMERA_HEIGHT_M - 2.5, 55.95)).norm() < 0.05, "{sign:?}");
    assert!((sign.size_m - 0.6 * 2.0_f64.sqrt()).abs() < 0.12, "{sign:?}");
    assert!(sign.facing.is_some_and(|f| f.y < -0.9), "{sign:?}");
}

#[test]
fn plates_seen_from_behind_are_found_and_face_away() {
    let mut post = Post::new(5.0, 10.0);
    post.board(0.6, (1.9, 2.4), 0.05, [None, Some(METAL)]);
    let signs = post.found(1.85);
    assert_eq!(signs.len(), 1, "{signs:?}");
    assert!((signs[0].centroid - Point3::new(5.0, CAMERA_HEIGHT_M - 2.15, 9.95)).norm() < 0.06, "{:?}", signs[0]);
    assert!(signs[0].facing.is_some_and(|f| f.y < -0.9), "{:?}", signs[0]);
}

#[test]
fn a_plate_of_which_leaves_hide_the_upper_half_is_as_high_as_it_is_wide() {
    // And one that ends there, in a square as wide.
    let middle_m = |width_m: f64, heights_m: (f64, f64), up_to_m: f64| {
        let mut post = Post::new(5.0, 10.0);
        post.hidden_board(width_m, heights_m, 0.05, [None, Some(METAL)], up_to_m);
        let signs = post.found(1.85);
        let [sign] = &signs[..] else { panic!("{signs:?}") };
        CAMERA_HEIGHT_M - sign.centroid.y
    };
    let (hidden, whole) = (middle_m(0.6, (1.9, 2.5), 2.2), middle_m(0.6, (1.9, 2.2), f64::INFINITY));
    assert!((hidden - 2.2).abs() < 0.05 && (whole - 2.05).abs() < 0.05, "{hidden} {whole}");
}

#[test]
fn a_plate_is_a_sign_though_all_of_its_post_is_hidden_and_a_low_one_is_not() {
    let found = |heights_m: (f64, f64)| {
        let mut post = Post::new(5.0, 30.0);
        post.board(0.45, heights_m, 0.0, [Some(METAL); 2]);
        post.found_on(&[])
    };
    let signs = found((1.55, 2.65));
    let [sign] = &signs[..] else { panic!("{signs:?}") };
    assert!((sign.centroid - Point3::new(5.0, CAMERA_HEIGHT_M - 2.0, 30.0)).norm() < 0.2, "{sign:?}");
    assert!(found((0.6, 1.8)).is_empty());
}

#[test]
fn a_low_board_is_a_sign_below_another_one_only() {
    let found = |is_stop: bool| {
        let mut post = Post::new(5.0, 40.0);
        if is_stop {
            post.board(0.45, (2.4, 2.85), 0.05, [Some(METAL), Some(METAL)]);
        }
        post.board(0.35, (1.25, 1.75), 0.05, [Some(METAL); 2]);
        let mut heights: Vec<f64> =
            post.found_on(&[(0.0, 1.25), (1.75, 2.4)]).iter().map(|sign| CAMERA_HEIGHT_M - sign.centroid.y).collect();
        heights.sort_by(f64::total_cmp);
        heights
    };
    assert!(found(false).is_empty());
    let [lower, upper] = found(true)[..] else { panic!("{:?}", found(true)) };
    assert!((lower - 1.5).abs() < 0.05 && (upper - 2.62).abs() < 0.1, "{lower} {upper}");
}

#[test]
fn two_plates_with_a_gap_of_a_hand_are_two() {
    let mut post = Post::new(5.0, 44.0);
    post.board(0.6, (2.1, 2.5), 0.05, [Some(SHEETING), Some(METAL)]);
    post.board(0.4, (1.65, 2.0), 0.05, [Some(SHEETING), Some(METAL)]);
    assert_eq!(post.found(2.05).len(), 2);
}

#[test]
fn bright_points_of_a_part_hide_no_plate_of_which_its_post_tells_all() {
    let mut post = Post::new(5.0, 56.0);
    // Its front is sheeting at its lower edge only.
    post.board(0.6, (2.2, 2.4), 0.05, [Some(SHEETING), Some(METAL)]);
    post.board(0.6, (2.4, 2.8), 0.05, [Some(METAL), Some(METAL)]);
    let signs = post.found(2.1);
    assert_eq!(signs.len(), 1, "{signs:?}");
    assert!((signs[0].centroid.y - (CAMERA_HEIGHT_M - 2.5)).abs() < 0.05, "{:?}", signs[0]);
}

#[test]
fn leaves_far_below_a_board_without_a_post_are_none_of_it() {
    let mut post = Post::new(5.0, 56.0);
    post.board(0.8, (2.1, 2.7), 0.05, [Some(SHEETING), Some(METAL)]);
    post.board(0.3, (1.7, 1.74), 0.05, [Some(METAL), Some(METAL)]);
    let signs = post.found_on(&[]);
    assert_eq!(signs.len(), 1, "{signs:?}");
    assert!((signs[0].centroid.y - (CAMERA_HEIGHT_M - 2.4)).abs() < 0.05, "{:?}", signs[0]);
}

#[test]
fn a_dark_box_before_a_mast_is_a_light_and_a_low_one_is_not() {
    let boxed = |heights_m: (f64, f64)| {
        let mut post = Post::new(5.0, 40.0);
        post.board(0.3, heights_m, 0.3, [Some(HOUSING), None]);
        post.board(0.3, heights_m, 0.06, [None, Some(HOUSING)]);
        post.found(2.7)
    };
    let signs = boxed((2.0, 2.9));
    assert_eq!(signs.len(), 1, "{signs:?}");
    assert_eq!(signs[0].kind, SignKind::TrafficLight);
    assert!((signs[0].centroid - Point3::new(5.0, CAMERA_HEIGHT_M - 2.45, 39.82)).norm() < 0.1, "{:?}", signs[0]);
    assert!(boxed((0.7, 1.1)).is_empty());
}

#[test]
fn a_light_whose_upper_half_is_out_of_sight_has_its_middle_where_lights_have_it() {
    let mut post = Post::new(5.0, 40.0);
    post.board(0.3, (2.2, 2.7), 0.3, [Some(HOUSING), None]);
    post.board(0.3, (2.2, 2.7), 0.06, [None, Some(HOUSING)]);
    let signs = post.found(2.7);
    assert_eq!(signs.len(), 1, "{signs:?}");
    assert!((-signs[0].centroid.y + CAMERA_HEIGHT_M - 2.65).abs() < 0.1, "{:?}", signs[0]);
}

#[test]
fn a_post_alone_and_a_hedge_around_it_carry_no_sign() {
    assert!(Post::new(5.0, 30.0).found(2.8).is_empty());
    let mut post = Post::new(5.0, 30.0);
    for depth in 0..6 {
        post.board(4.0, (0.0, 2.0), 0.3 - 0.1 * f64::from(depth), [Some(METAL), Some(METAL)]);
    }
    assert!(post.found(2.8).is_empty());
}

/// A lamp as large as a van's, 1.4 m above the road, that three scans saw beside them;
/// whether the others look through where that was.
fn lamp_of_a_vehicle(is_looked_through: bool) -> Vec<FoundSign> {
    let mut post = Post::new(5.0, 28.0);
    let foot = post.foot;
    for (scan, up, aside) in (2..5).flat_map(|scan| (0..30).map(move |k| (scan, k / 6, k % 6))) {
        let off = Vector3::new(0.04 * f64::from(aside) - 0.1, -1.3 - 0.05 * f64::from(up), 0.0);
        post.street.add(foot + off, scan, SHEETING, None);
    }
    for scan in (0..2).chain(5..9).filter(|_| is_looked_through) {
        post.street.add_behind(foot, 1.9, scan);
    }
    post.found_on(&[])
}

#[test]
fn what_other_scans_look_through_has_moved_and_is_no_sign() {
    assert_eq!(lamp_of_a_vehicle(false).len(), 1, "nothing says that it moved");
    assert_eq!(lamp_of_a_vehicle(true), []);
}
