use super::*;
use common::geometry::PoseParameters;
use nalgebra::{Point3, Vector2};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::projection::tests::camera;

fn truth() -> Pose {
    PoseParameters { x_m: 4.0, y_m: -1.5, z_m: 100.0, yaw_rad: 0.3, pitch_rad: 0.02, roll_rad: -0.01 }.to_pose()
}

/// Points around the camera seen on lines of random direction.
fn observations(count: usize, noise_px: f64, seed: u64) -> Vec<Observation> {
    let mut random = Pcg64::seed_from_u64(seed);
    let view = View::new(&camera(), &truth());
    (0..count)
        .map(|_| {
            let point = truth()
                * Point3::new(
                    random.random_range(-10.0..10.0),
                    random.random_range(-4.0..2.0),
                    random.random_range(6.0..50.0),
                );
            let angle: f64 = random.random_range(0.0..3.0);
            let normal = Vector2::new(angle.cos(), angle.sin());
            let (pixel, _) = view.project(&point).unwrap();
            let off = normal * random.random_range(-noise_px..=noise_px);
            Observation::on_line(point, normal, &(pixel + off), 1.5)
        })
        .collect()
}

fn pairs(count: usize) -> Vec<Group> {
    (0..count / 2).map(|i| Group::new(2 * i, 2 * i + 2)).collect()
}

fn displaced() -> Pose {
    retract(&truth(), &Tangent::new(0.8, -0.2, 1.5, 0.01, -0.04, 0.02))
}

#[test]
fn exact_observations_lead_back_to_the_pose_in_a_few_steps() {
    let observations = observations(24, 0.0, 1);
    let problem = Problem { camera: &camera(), observations: &observations, prior: None };
    let solution =
        solve(&problem, &mut pairs(24), &SolverConfig { loss: Loss::Quadratic, ..Default::default() }, &displaced());
    assert!(solution.converged && solution.iterations <= 8, "{}", solution.iterations);
    assert!(local(&truth(), &solution.map_from_camera).norm() < 1e-6);
}

#[test]
fn gross_errors_do_not_move_the_robust_pose() {
    let mut observations = observations(30, 0.5, 2);
    let clean = {
        let problem = Problem { camera: &camera(), observations: &observations, prior: None };
        solve(&problem, &mut pairs(30), &SolverConfig::default(), &displaced()).map_from_camera
    };
    for wrong in [0, 1, 6, 7, 12, 13] {
        observations[wrong].offset_px += 60.0;
    }
    let problem = Problem { camera: &camera(), observations: &observations, prior: None };
    let mut groups = pairs(30);
    let start = retract(&truth(), &Tangent::new(0.1, 0.0, 0.2, 0.0, 0.002, 0.0));
    let config = SolverConfig { loss: Loss::GemanMcclure, ..Default::default() };
    let robust = solve(&problem, &mut groups, &config, &start).map_from_camera;
    assert!(local(&clean, &robust).norm() < 0.08, "{}", local(&clean, &robust));
    assert!(groups[0].weight < 0.01 && groups[1].weight > 0.5);
}

#[test]
fn a_prior_alone_is_returned_with_its_covariance() {
    let information = Matrix6::from_diagonal(&Vector6::new(1.0, 4.0, 9.0, 100.0, 200.0, 300.0));
    let prior = Prior { map_from_camera: truth(), information };
    let problem = Problem { camera: &camera(), observations: &[], prior: Some(&prior) };
    let solution = solve(&problem, &mut [], &SolverConfig::default(), &displaced());
    assert!(local(&truth(), &solution.map_from_camera).norm() < 1e-6);
    assert!((solution.covariance().unwrap() * information - Matrix6::identity()).norm() < 1e-6);
}

#[test]
fn without_anything_the_start_is_returned_and_no_covariance() {
    let problem = Problem { camera: &camera(), observations: &[], prior: None };
    let solution = solve(&problem, &mut [], &SolverConfig::default(), &displaced());
    assert!(local(&displaced(), &solution.map_from_camera).norm() < 1e-9);
    assert!(solution.covariance().is_none());
}

proptest! {
    #[test]
    fn the_gradient_is_the_derivative_of_the_cost(seed in 0..200_u64, axis in 0..6_usize) {
        let observations = observations(8, 3.0, seed);
        let prior = Prior { map_from_camera: displaced(), information: Matrix6::identity() * 50.0 };
        let problem = Problem { camera: &camera(), observations: &observations, prior: Some(&prior) };
        let config = SolverConfig::default();
        let mut groups = pairs(8);
        let gradient = linearise(&problem, &mut groups, &config, &truth()).gradient[axis];
        let mut delta = Tangent::zeros();
        delta[axis] = 1e-6;
        let up = linearise(&problem, &mut groups, &config, &retract(&truth(), &delta)).cost;
        let down = linearise(&problem, &mut groups, &config, &retract(&truth(), &-delta)).cost;
        let numeric = (up - down) / 2e-6;
        prop_assert!((numeric - gradient).abs() < 1e-3 * (1.0 + gradient.abs()), "{numeric} {gradient}");
    }
}

/// The same problem for the `levenberg-marquardt` crate, which brings an older
/// nalgebra.
mod oracle {
    use super::*;
    use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
    use nalgebra34 as na;

    struct Crate<'a> {
        observations: &'a [Observation],
        start: Pose,
        x: na::Vector6<f64>,
    }

    impl Crate<'_> {
        fn delta(&self) -> Tangent {
            Tangent::from_column_slice(self.x.as_slice())
        }

        fn values(&self, delta: &Tangent) -> Vec<f64> {
            let view = View::new(&camera(), &retract(&self.start, delta));
            self.observations.iter().map(|o| o.distance_px(&view).unwrap() / o.sigma_px).collect()
        }
    }

    impl LeastSquaresProblem<f64, na::Dyn, na::U6> for Crate<'_> {
        type ResidualStorage = na::storage::Owned<f64, na::Dyn>;
        type JacobianStorage = na::storage::Owned<f64, na::Dyn, na::U6>;
        type ParameterStorage = na::storage::Owned<f64, na::U6>;

        fn set_params(&mut self, x: &na::Vector6<f64>) {
            self.x = *x;
        }

        fn params(&self) -> na::Vector6<f64> {
            self.x
        }

        fn residuals(&self) -> Option<na::DVector<f64>> {
            Some(na::DVector::from_vec(self.values(&self.delta())))
        }

        fn jacobian(&self) -> Option<na::OMatrix<f64, na::Dyn, na::U6>> {
            let mut jacobian = na::OMatrix::<f64, na::Dyn, na::U6>::zeros(self.observations.len());
            for axis in 0..6 {
                let (mut up, mut down) = (self.delta(), self.delta());
                up[axis] += 1e-6;
                down[axis] -= 1e-6;
                let rows = self.values(&up).into_iter().zip(self.values(&down));
                for (i, (plus, minus)) in rows.enumerate() {
                    jacobian[(i, axis)] = (plus - minus) / 2e-6;
                }
            }
            Some(jacobian)
        }
    }

    #[test]
    fn the_solver_agrees_with_the_levenberg_marquardt_crate() {
        for seed in 0..20 {
            let observations = observations(20, 2.0, seed);
            let config = SolverConfig { loss: Loss::Quadratic, ..Default::default() };
            let problem = Problem { camera: &camera(), observations: &observations, prior: None };
            let ours = solve(&problem, &mut pairs(20), &config, &displaced()).map_from_camera;
            let theirs = Crate { observations: &observations, start: displaced(), x: na::Vector6::zeros() };
            let (theirs, report) = LevenbergMarquardt::new().minimize(theirs);
            assert!(report.termination.was_successful());
            let theirs = retract(&displaced(), &theirs.delta());
            assert!(local(&theirs, &ours).norm() < 1e-4, "seed {seed}: {}", local(&theirs, &ours));
        }
    }
}
