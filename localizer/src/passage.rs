//! Where the camera was at the last image, and how it moved there: what a fix of another time
//! than an image is moved on by.

use nalgebra::{Point3, Vector3};

use crate::estimate::Status;
use crate::gps::GpsFix;
use crate::run::FrameResult;

/// What is known of the way to the last image.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Passage {
    before: Option<Before>,
}

#[derive(Debug, Clone, Copy)]
struct Before {
    time_s: f64,
    position_map: Point3<f64>,
    /// Since the image before, metres per second.
    velocity_map: Vector3<f64>,
}

impl Passage {
    /// A fix at the time of its image; as it is where nothing is known of the motion.
    pub fn moved_on(&self, fix: GpsFix) -> GpsFix {
        fix.moved_on(&self.before.map_or_else(Vector3::zeros, |before| before.velocity_map))
    }

    /// Takes in what came of an image.
    pub fn pass(&mut self, result: Option<&FrameResult>) {
        self.before = result.and_then(|result| self.now(result));
    }

    /// Where it is, and how it moved there; none where that is not known.
    fn now(&self, result: &FrameResult) -> Option<Before> {
        let FrameResult { time_s, estimate, .. } = result;
        if estimate.status == Status::Lost {
            return None;
        }
        let position_map = Point3::from(estimate.map_from_camera.translation.vector);
        let velocity_map = match self.before {
            Some(before) if *time_s > before.time_s => (position_map - before.position_map) / (time_s - before.time_s),
            Some(before) => before.velocity_map,
            None => Vector3::zeros(),
        };
        Some(Before { time_s: *time_s, position_map, velocity_map })
    }
}
