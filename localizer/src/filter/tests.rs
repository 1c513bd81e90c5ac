use super::*;
use common::geometry::PoseParameters;

pub(super) fn state() -> State {
    let pose = PoseParameters { x_m: 1.0, y_m: 0.0, z_m: 5.0, yaw_rad: 0.5, pitch_rad: 0.01, roll_rad: 0.0 };
    let velocity = Tangent::new(0.1, 0.0, 12.0, 0.0, 0.2, 0.0);
    let (motion, odometry) = (MotionConfig::default(), OdometryConfig::default());
    let unsure = Matrix6::identity();
    State::new(pose.to_pose(), &(unsure * 0.01), velocity, &(unsure * 0.25), &motion, &odometry)
}

#[test]
fn the_transition_is_the_derivative_of_the_motion() {
    let motion = MotionConfig::default();
    let moved_on = |mut state: State| {
        state.move_on(0.1, &motion);
        state
    };
    let base = moved_on(state()).map_from_camera;
    // Without noise and velocity covariance the predicted covariance is
    // F P F^T; probe it column by column with a thin covariance.
    for axis in 0..6 {
        let mut delta = Tangent::zeros();
        delta[axis] = 1e-5;
        let mut moved = state();
        moved.map_from_camera = retract(&moved.map_from_camera, &delta);
        let numeric = local(&base, &moved_on(moved).map_from_camera) / 1e-5;
        let mut thin = state();
        thin.covariance = MatrixN::zeros();
        let noise = moved_on(thin.clone()).covariance;
        thin.covariance[(axis, axis)] = 1.0;
        let spread = moved_on(thin).covariance - noise;
        for i in 0..6 {
            for j in 0..6 {
                assert!((spread[(i, j)] - numeric[i] * numeric[j]).abs() < 1e-3, "axis {axis} ({i}, {j})");
            }
        }
    }
}

#[test]
fn poses_along_a_drive_teach_the_velocity() {
    let motion = MotionConfig::default();
    let mut truth = state();
    let mut filter = state();
    filter.velocity = Tangent::zeros();
    filter.covariance.fixed_view_mut::<6, 6>(6, 6).copy_from(&(Matrix6::identity() * 100.0));
    for _ in 0..20 {
        truth.map_from_camera = retract(&truth.map_from_camera, &(truth.velocity * 0.1));
        filter = filter.predicted(0.1, &motion);
        let seen = truth.map_from_camera;
        filter.update(&seen, &(Matrix6::identity() * 1e-4));
    }
    assert!((filter.velocity - truth.velocity).norm() < 0.05, "{}", filter.velocity);
    assert!(Cholesky::new(filter.covariance).is_some());
}

/// 12 m/s at first, and 1.5 m/s^2 more all along.
#[test]
fn who_speeds_up_goes_on_to_do_so_for_a_while() {
    let motion = MotionConfig::default();
    let mut truth = state();
    let mut filter = state();
    let mut step = || {
        truth.velocity[2] += 0.15;
        truth.map_from_camera = retract(&truth.map_from_camera, &(truth.velocity * 0.1));
        truth.map_from_camera
    };
    for _ in 0..30 {
        filter = filter.predicted(0.1, &motion);
        filter.update(&step(), &(Matrix6::identity() * 1e-4));
    }
    // Some of it may be chance, that the walk explains as well.
    assert!((0.6..1.6).contains(&filter.acceleration_m_s2), "{}", filter.acceleration_m_s2);
    let speed_m_s = filter.velocity[2];
    let mut steady = State { acceleration_m_s2: 0.0, ..filter.clone() };
    let mut seen = filter.map_from_camera;
    for _ in 0..10 {
        seen = step();
        filter = filter.predicted(0.1, &motion);
        steady = steady.predicted(0.1, &motion);
    }
    let behind_m = |state: &State| local(&state.map_from_camera, &seen)[2];
    assert!(behind_m(&filter) > 0.0 && behind_m(&filter) < 0.7 * behind_m(&steady), "{}", behind_m(&filter));
    for _ in 0..100 {
        filter = filter.predicted(0.1, &motion);
    }
    assert!(filter.acceleration_m_s2.abs() < 1e-3 && filter.velocity[2] < speed_m_s + 2.0, "{}", filter.velocity);
    assert!(Cholesky::new(filter.covariance).is_some());
}

#[test]
fn an_update_that_says_nothing_new_changes_nothing() {
    let mut filter = state().predicted(0.1, &MotionConfig::default());
    let before = filter.clone();
    filter.update(&before.map_from_camera, &before.pose_covariance());
    assert!((filter.covariance - before.covariance).norm() < 1e-9);
    assert!((filter.velocity - before.velocity).norm() < 1e-9);
}

#[test]
fn uncertainty_grows_without_images() {
    let motion = MotionConfig::default();
    let soon = state().predicted(0.1, &motion).covariance[(2, 2)];
    let later = state().predicted(2.0, &motion).covariance[(2, 2)];
    assert!(later > 10.0 * soon);
}
