//! How a camera on a road vehicle moves.

use serde::{Deserialize, Serialize};

use crate::odometry::Odometry;

/// How a velocity component wanders.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisMotion {
    /// Standard deviation of its change after one second of free wandering,
    /// m/s or rad/s.
    pub walk: f64,
    /// Time after which it has fallen to 37 % by itself, seconds: springs and
    /// dampers end a swaying, nothing ends driving on.
    pub memory_s: f64,
}

/// Motion of the camera on a road vehicle, in the camera's axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionConfig {
    /// Sideways, beyond what turning and the mounting explain: slipping,
    /// swaying.
    pub right: AxisMotion,
    /// Vertical: bumps of some centimetres at 1 to 2 Hz, mounting pitch times
    /// speed.
    pub down: AxisMotion,
    /// Forward, beyond an acceleration that lasts: shifting gears, a foot that
    /// leaves the pedal.
    pub forward: AxisMotion,
    /// Standard deviation of the forward acceleration, m/s^2: in traffic 1 to 2
    /// where it is sped up or braked, and mostly neither; hard braking is
    /// followed through the images.
    pub acceleration_sigma_m_s2: f64,
    /// Time after which an acceleration has fallen to 37 %, seconds. Shorter
    /// than most last: one that is carried on in the dark must not run away.
    pub acceleration_memory_s: f64,
    /// Pitching: 0.2 degrees from one image to the next, as in KITTI 00 and 07.
    pub pitch: AxisMotion,
    /// Turning: a corner is entered within half a second at up to 0.6 rad/s.
    pub yaw: AxisMotion,
    /// Rolling: as pitching.
    pub roll: AxisMotion,
    /// Distance by which a camera is ahead of the axle that does not steer,
    /// metres: there a vehicle goes where it points.
    pub lever_m: f64,
    /// Standard deviation of that distance among vehicles, metres.
    pub lever_sigma_m: f64,
    /// Standard deviation of the camera's axis against the driving direction
    /// of the vehicle, radians.
    pub mounting_sigma_rad: f64,
    /// Standard deviation of the direction in which that axle goes, radians:
    /// the slip angle of tyres in a bend.
    pub slip_sigma_rad: f64,
    /// The same for speeds near zero, m/s.
    pub slip_sigma_m_s: f64,
    /// Standard deviation of the camera's height over the road against the
    /// survey's, metres: another load, another rig of the same kind.
    pub height_sigma_m: f64,
    /// Time after which springs have taken back 63 % of a sway of pitch or
    /// roll, seconds: with their walks a vehicle sways by 0.6 degrees, as in
    /// KITTI 00.
    pub spring_s: f64,
    /// Standard deviation of what pitch and roll return to, against a level
    /// camera on the survey's path, radians: crossfall and mounting.
    pub rest_sigma_rad: f64,
    /// Time after which that has changed, seconds: the mounting never does, the
    /// crossfall does in another street.
    pub rest_memory_s: f64,
}

impl Default for MotionConfig {
    fn default() -> Self {
        let axis = |walk, memory_s| AxisMotion { walk, memory_s };
        Self {
            right: axis(0.6, 1.0),
            down: axis(0.4, 1.0),
            forward: axis(0.5, 60.0),
            acceleration_sigma_m_s2: 0.7,
            acceleration_memory_s: 1.0,
            pitch: axis(0.1, 0.2),
            yaw: axis(0.8, 3.0),
            roll: axis(0.1, 0.2),
            lever_m: 1.5,
            lever_sigma_m: 0.7,
            mounting_sigma_rad: 0.03,
            slip_sigma_rad: 0.02,
            slip_sigma_m_s: 0.05,
            height_sigma_m: 0.15,
            spring_s: 0.5,
            rest_sigma_rad: 0.026,
            rest_memory_s: 10.0,
        }
    }
}

impl MotionConfig {
    /// The motion over a stretch of which the mean turn rate is known, and what else
    /// is shown: these do not wander.
    pub(super) fn driven(&self, shown: &Odometry) -> Self {
        let unless =
            |is_known: bool, axis: AxisMotion| AxisMotion { walk: if is_known { 0.0 } else { axis.walk }, ..axis };
        let sways = shown.sway_rad_s.is_some();
        Self {
            forward: unless(shown.tells_speed(), self.forward),
            pitch: unless(sways, self.pitch),
            yaw: unless(true, self.yaw),
            roll: unless(sways, self.roll),
            ..*self
        }
    }

    pub(super) fn axes(&self) -> [AxisMotion; 6] {
        [self.right, self.down, self.forward, self.pitch, self.yaw, self.roll]
    }
}
