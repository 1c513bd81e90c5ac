//! Localizes a camera against a compact semantic map: from an image's features
//! to a 6-DOF pose with a covariance and a word on how far to trust it.
//!
//! One frame goes through [`prepare`] (features in a comparable form),
//! [`preselect`] (section IV.A: which landmarks may be seen), the association
//! ([`associate`], section IV.E) with the [`solver`] (IV.D) inside, and
//! [`tracker`] carries several hypotheses from frame to frame.
//!
//! # In a vehicle
//!
//! What sensors say is given to a [`live::LiveLocalizer`] as it comes, and each image is
//! answered with a pose, its covariance and a status:
//!
//! ```no_run
//! use common::kitti::Calibration;
//! use localizer::camera::{ScaledCamera, Source};
//! use localizer::config::Config;
//! use localizer::gps::GpsFix;
//! use localizer::live::LiveLocalizer;
//! use localizer::local_map::LocalMap;
//! use localizer::vision::network::Runtime;
//! use localizer::watch::Sensors;
//!
//! # fn main() -> localizer::Result<()> {
//! let config = Config::default();
//! let mut map = LocalMap::open("04.csm".as_ref(), &config.local_map)?;
//! let camera = Calibration::read_camera("calib.txt", 2)?;
//! let camera = ScaledCamera::new(&camera, (1226, 370), config.vision.widest_px);
//! let networks = Source::open(&["poles.onnx".as_ref(), "lanes.onnx".as_ref()], Runtime::default(), None)?;
//! let sensors = Sensors { images: true, wheels: true };
//! let mut localizer = LiveLocalizer::new(&mut map, &camera, sensors, &config);
//! // A rough position, wheels and gyroscope, an image, each once it is there.
//! if let Some((time_s, fix)) = GpsFix::of_row(&[0.0, 1.2, 0.1, -0.4], &config.gps) {
//!     localizer.received.gps(time_s, fix);
//! }
//! localizer.received.odometry(0.02, 13.5, 0.005);
//! let seen = camera.look(&networks, 0, Some("000000.png".as_ref()), &config.vision)?;
//! if let Some(answer) = localizer.image(0, 0.02, seen)? {
//!     println!("{}: {}", answer.estimate.status, answer.estimate.map_from_camera);
//! }
//! # Ok(())
//! # }
//! ```
//!
//! Who has images in memory, or probabilities from a network of their own, gives them to
//! [`camera::ScaledCamera::see`]; who writes no Rust talks with `localizer live`.

pub mod associate;
pub mod camera;
pub mod cli;
pub mod config;
pub mod drive;
pub mod error;
pub mod estimate;
pub mod eval;
pub mod features;
pub mod filter;
pub mod gps;
pub mod live;
pub mod local_map;
pub mod measurement;
pub mod odometry;
pub mod output;
pub mod overlay;
mod pace;
pub mod paper_tracker;
mod passage;
pub mod prepare;
pub mod preselect;
pub mod projection;
pub mod residual;
pub mod road_index;
pub mod run;
pub mod solver;
pub mod start;
pub mod tracker;
pub mod vision;
pub mod visual_odometry;
pub mod watch;

pub use error::{Error, Result};

#[cfg(test)]
pub(crate) mod testing;
