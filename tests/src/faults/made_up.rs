//! A made-up drive for the tests, which nobody can localize in.

use common::geometry::{PinholeCamera, Pose};
use common::map::{Pole, PoleKind, Road, RoadId, SemanticMap, SignKind};
use localizer::config::Config;
use localizer::features::{Features, LaneFeature, LineFeature, PointFeature};
use localizer::gps::{GpsConfig, simulate};
use localizer::odometry::{Odometry, OdometryLog};
use localizer::projection::ImageSize;
use localizer::run::{FrameFeatures, Method};
use nalgebra::{Isometry3, Point2, Point3, Vector2, Vector3};

use crate::trial::Trial;

/// Size of its images.
pub const IMAGE: ImageSize = ImageSize { width_px: 1200.0, height_px: 360.0 };

fn line(u_px: f64, length_px: f64) -> LineFeature {
    LineFeature {
        upper_px: Point2::new(u_px, 100.0),
        lower_px: Point2::new(u_px + 3.0, 100.0 + length_px),
        offset_sigma_px: 0.5,
        angle_sigma_rad: 0.01,
        width_px: 5.0,
        probability: 0.8,
        upper_is_cut: false,
        lower_is_cut: false,
    }
}

/// What a frame shows, marked with its number.
pub fn seen(frame: usize) -> Features {
    let lane = |u_px| LaneFeature {
        points_px: vec![Point2::new(u_px, 200.0), Point2::new(u_px - 90.0, 300.0)],
        line: line(u_px, 100.0),
        edges: Vec::new(),
    };
    let sign = |u_px| PointFeature {
        kind: SignKind::TrafficSign,
        centre_px: Point2::new(u_px, 90.0),
        extent_px: Vector2::new(20.0, 22.0),
        // By which a frame's features can be told.
        sigma_px: frame as f64,
        probability: 0.9,
        is_cut: false,
    };
    Features {
        poles: [100.0, 300.0, 700.0, 1100.0].map(|u_px| line(u_px, 0.1 * u_px)).to_vec(),
        trunks: Some(vec![line(600.0, 60.0), line(1000.0, 40.0)]),
        lanes: [400.0, 800.0].map(lane).to_vec(),
        signs: [200.0, 500.0, 900.0].map(sign).to_vec(),
    }
}

/// 300 frames straight ahead, 1 m apart, 0.1 s apart.
pub fn clean() -> Trial {
    let frames = (0..300)
        .map(|frame| FrameFeatures {
            frame,
            time_s: frame as f64 * 0.1,
            features: seen(frame),
            maps_ms: 0.0,
            features_ms: 0.0,
        })
        .collect();
    let truth: Vec<Pose> = (0..300).map(|i| Isometry3::translation(2.0, 0.0, f64::from(i))).collect();
    let fixes = (0..2).zip(simulate(&truth[..2], &GpsConfig::default(), 0)).collect();
    let mut odometry = OdometryLog::default();
    for i in 0..300 {
        let [began_s, ended_s] = [i, i + 1].map(|i| f64::from(i) * 0.1);
        odometry.push(began_s, ended_s, Odometry { sway_rad_s: Some([0.01, 0.0]), ..Odometry::of_wheels(10.0, 0.0) });
    }
    let foot_map = Point3::new(5.0, 1.6, 250.0);
    let pole =
        Pole { kind: PoleKind::LampPost, foot_map, top_map: foot_map - Vector3::new(0.0, 6.0, 0.0), road: RoadId(0) };
    let map = SemanticMap {
        roads: vec![Road { path_map: [0.0, 150.0, 300.0].map(|z_m| Point3::new(0.0, 0.0, z_m)).to_vec() }],
        poles: vec![pole],
        ..SemanticMap::default()
    };
    let camera = PinholeCamera {
        fx_px: 700.0,
        fy_px: 700.0,
        cx_px: 600.0,
        cy_px: 180.0,
        from_reference_m: Vector3::new(0.06, 0.0, 0.0),
    };
    Trial {
        map,
        camera,
        image: IMAGE,
        frames,
        fixes,
        odometry,
        images: None,
        truth,
        config: Config::default(),
        method: Method::Robust,
    }
}
