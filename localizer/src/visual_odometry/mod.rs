//! How fast the vehicle drives and turns, from the images alone: what wheels and
//! a gyroscope would say, for vehicles that have none.
//!
//! Points that are followed from one image to the next tell how the camera
//! turned and in which direction it moved; how far it went, the road does: it
//! lies as deep below the camera as it always does. From one image to the next the points
//! know that better than the road, once their depths are known.
//! The direction of the motion is along the road, and so tells how the camera
//! is pitched against it.

mod config;
mod depths;
mod fading;
mod fall;
mod grade;
mod pitch;
mod road;
mod rotation;
mod scale;
mod speed;
mod tracks;

use common::geometry::PinholeCamera;
use image::GrayImage;
use nalgebra::Rotation3;

pub use config::{LabelConfig, RoadConfig, RotationConfig, TrackConfig, VisualOdometryConfig};
use depths::{known_after, way_of};
use fall::Fall;
use grade::Grade;
use pitch::Pitch;
use road::{Road, Shift, View};
use rotation::{ASIDE, Belief, DOWN, Fit, Motion, Parameters, Track, YAW, fit};
use scale::Scale;
use speed::{Speed, Told};
use tracks::Follower;

use crate::odometry::Odometry;
use crate::pace::Pace;
use crate::vision::Plane;

/// Nearest depth of a point when a vehicle goes back, metres: nearer, the road is
/// below the image.
const NEAR_M: f64 = 3.0;
/// Share of its depth by which a point comes nearer or goes farther off at most,
/// as far as it is looked for.
const MOST_SHARE: f64 = 0.5;
/// Depth at which a point above the horizon is looked for, metres.
const FAR_M: f64 = 30.0;
/// Speeds that are tried while none is known are so far apart, m/s: by how much
/// the points of the road may be off from where they are looked for.
const TRIED_M_S: f64 = 8.0;
/// How much more than in the image before it may have turned, radians a second, where the
/// points cannot be followed otherwise: who enters a bend, or missed an image there.
const TRIED_RAD_S: f64 = 0.6;
/// Turns that are tried then are so far apart, radians: points are found some 50 pixels from
/// where they are looked for.
const TRIED_RAD: f64 = 0.06;
/// So many of them to each side at most.
const MOST_TRIED: f64 = 5.0;
/// Nearest that a way is taken as one, metres: who stands has no direction, and is told no
/// depths.
const LEAST_WAY_M: f64 = 0.1;
/// Sharpest bend, 1/m: a car's turning circle.
const SHARPEST_PER_M: f64 = 0.2;

/// Tells the motion from one image to the next.
pub struct VisualOdometer {
    config: VisualOdometryConfig,
    camera: PinholeCamera,
    camera_height_m: f64,
    /// Whether the images show the road.
    sees_road: bool,
    follower: Follower,
    before: Option<(GrayImage, f64)>,
    /// The last turn about the camera's axes, right, down and forward.
    turn_rad_s: [f64; 3],
    speed: Speed,
    pace: Pace,
    /// Share of the usual time between two images before which one comes too soon.
    soonest: f64,
    /// The last image came too soon: when it was taken is not known.
    time_is_unknown: bool,
    pitch: Pitch,
    grade: Grade,
    fall: Fall,
    scale: Scale,
}

impl VisualOdometer {
    /// For a camera that stands so high over the road, metres; `soonest` as in
    /// [`crate::tracker::ClockConfig`].
    pub fn new(camera: &PinholeCamera, camera_height_m: f64, config: &VisualOdometryConfig, soonest: f64) -> Self {
        Self {
            config: *config,
            camera: *camera,
            camera_height_m,
            sees_road: true,
            follower: Follower::new(config.tracks),
            before: None,
            turn_rad_s: [0.0; 3],
            speed: Speed::default(),
            pace: Pace::default(),
            soonest,
            time_is_unknown: false,
            pitch: Pitch::default(),
            grade: Grade::new(&config.road),
            fall: Fall::new(&config.road),
            scale: Scale::default(),
        }
    }

    /// For label images, of which the brightness is how likely something is: they
    /// tell the turn alone.
    pub fn of_labels(
        camera: &PinholeCamera,
        camera_height_m: f64,
        config: &VisualOdometryConfig,
        soonest: f64,
    ) -> Self {
        let LabelConfig { sigma_px, fewest, aside_sigma_rad, .. } = config.labels;
        let rotation = RotationConfig { sigma_px, aside_sigma_rad, fewest, ..config.rotation };
        let config = VisualOdometryConfig { rotation, ..*config };
        Self { sees_road: false, ..Self::new(camera, camera_height_m, &config, soonest) }
    }

    /// Time of the last image that was another one than that before it, seconds.
    pub fn last_s(&self) -> Option<f64> {
        self.before.as_ref().map(|(_, time_s)| *time_s)
    }

    /// The mean motion since [`Self::last_s`]; none for the first, for an image that
    /// comes again (cameras deliver an old one where they miss one, and no two are
    /// the same, not even of one that stands), for one that comes too soon and the next,
    /// for images of different sizes, and where too few points agree. The speed is
    /// missing where the road does not tell it.
    pub fn step(&mut self, grey: &Plane, time_s: f64) -> Option<Odometry> {
        let size = |pixels: usize| u32::try_from(pixels).ok().filter(|pixels| *pixels > 0);
        let image = GrayImage::from_raw(size(grey.width())?, size(grey.height())?, grey.data().to_vec())?;
        if self.before.as_ref().is_some_and(|(before, _)| before.dimensions() != image.dimensions()) {
            let sees_road = self.sees_road;
            *self = Self { sees_road, ..Self::new(&self.camera, self.camera_height_m, &self.config, self.soonest) };
        }
        if self.before.as_ref().is_some_and(|(before, _)| *before == image) {
            return None;
        }
        self.follower.advance(&image);
        let (before, before_s) = self.before.replace((image, time_s))?;
        let dt_s = time_s - before_s;
        let is_too_soon = self.pace.missing_s(dt_s, self.soonest) > 0.0;
        self.pace.tick(dt_s);
        let is_timed = !(std::mem::replace(&mut self.time_is_unknown, is_too_soon) || is_too_soon);
        let Some((fit, tracks)) = self.turn_from_any(&before, dt_s) else {
            self.turn_rad_s = [0.0; 3];
            self.speed.lose();
            return None;
        };
        let parameters = fit.parameters;
        self.turn_rad_s = std::array::from_fn(|i| parameters[i] / dt_s);
        self.speed.advance(dt_s, &self.config.road);
        let shift = self.drive(&before, &parameters, dt_s);
        let road = &self.config.road;
        let way_m = self.speed.known_m_s().unwrap_or(0.0) * dt_s;
        self.grade.advance(way_m, road);
        self.fall.advance(way_m, road);
        let road_m = shift.filter(|shift| self.is_believed(shift, time_s, dt_s)).map(|shift| {
            let (height_m, road) = (self.camera_height_m, &self.config.road);
            let stretch = self.grade.stretch(&shift, height_m, road) * self.fall.stretch(&shift, height_m, road);
            shift.forward_m / stretch
        });
        let speed_m_s = self.way_m(&fit, tracks, road_m).map(|way_m| way_m / dt_s);
        let speed_m_s = speed_m_s.filter(|speed_m_s| self.speed.is_next(*speed_m_s, &self.config.road));
        if let Some(speed_m_s) = speed_m_s {
            self.speed.know(speed_m_s);
        }
        if let Some(speed_m_s) = self.speed.known_m_s() {
            self.pitch.learn(-parameters[DOWN], speed_m_s, dt_s, &self.config.rotation);
        }
        let [pitch_rad_s, yaw_rad_s, roll_rad_s] = self.turn_rad_s;
        let sway_rad_s = Some([pitch_rad_s, roll_rad_s]);
        is_timed.then_some(Odometry { speed_m_s, yaw_rate_rad_s: -yaw_rad_s, sway_rad_s })
    }

    /// The rotation and the direction of the motion since `before`: from another turn than
    /// the last if it has to be, and at worst without the points that were followed on.
    fn turn_from_any(&mut self, before: &GrayImage, dt_s: f64) -> Option<(Fit, Vec<Track>)> {
        let is_later = dt_s > 0.0;
        if is_later {
            self.follower.find(before);
            let speed_m_s = self.speed.known_m_s().unwrap_or(self.config.road.usual_m_s);
            let found = self.turn(dt_s);
            let mut tried = tried_turns_rad(dt_s);
            let found = found.or_else(|| tried.find_map(|more_rad| self.turn_at(speed_m_s, more_rad, dt_s)));
            if found.is_some() {
                return found;
            }
        }
        self.scale = Scale::default();
        if !(self.follower.forget() && is_later) {
            return None;
        }
        self.follower.find(before);
        self.turn(dt_s)
    }

    /// The same from the last turn, as at the last speed, or at that of some on which most
    /// points agree.
    fn turn(&mut self, dt_s: f64) -> Option<(Fit, Vec<Track>)> {
        if let Some(speed_m_s) = self.speed.known_m_s() {
            return self.turn_at(speed_m_s, 0.0, dt_s);
        }
        let tried = (self.config.road.fastest_m_s / TRIED_M_S) as u32;
        let found = (0..=tried).filter_map(|i| self.turn_at(f64::from(i) * TRIED_M_S, 0.0, dt_s));
        found.max_by_key(|(fit, _)| fit.agree)
    }

    /// The same at about this speed, from a turn that is so much more than the last.
    fn turn_at(&mut self, speed_m_s: f64, more_rad: f64, dt_s: f64) -> Option<(Fit, Vec<Track>)> {
        let config = &self.config.rotation;
        let way_m = speed_m_s * dt_s;
        let [pitch, yaw, roll] = self.turn_rad_s.map(|rad_s| rad_s * dt_s);
        let yaw = yaw + more_rad;
        let expected = Motion::new(&Parameters::from_column_slice(&[pitch, yaw, roll, 0.0, -self.pitch.mean_rad]));
        let tracks = self.follower.follow(&self.camera, |point, depth| {
            let of_road = || ((point.y + self.pitch.mean_rad) / self.camera_height_m).max(FAR_M.recip());
            let per_m = depth.map_or_else(of_road, |depth| depth.per_m);
            expected.at(point, (way_m * per_m).clamp(-MOST_SHARE, MOST_SHARE))
        });
        // A camera ahead of the axle moves to the side that it turns to, and the chord of
        // an arc half of the turn to the side that it begins with.
        let step_m = least_way_m(way_m);
        let aside = ((config.lever_m / step_m + 0.5) * yaw).clamp(-0.3, 0.3);
        let [pitch_sigma, yaw_sigma, roll_sigma] = config.turn_sigma_rad;
        let bump = config.bump_sigma_m_s * dt_s / step_m.abs();
        let belief = Belief {
            mean: Parameters::from_column_slice(&[0.0, yaw, 0.0, aside, -self.pitch.mean_rad]),
            sigma: Parameters::from_column_slice(&[
                pitch_sigma,
                yaw_sigma,
                roll_sigma,
                config.aside_sigma_rad,
                config.pitch_sigma_rad.hypot(bump),
            ]),
            farthest: 0.0,
        };
        // Back only where the points do not go forward: one that may do both tells less.
        let back = (self.speed.most_back_m(dt_s, &self.config.road) / NEAR_M).min(MOST_SHARE);
        let ways = if back > 0.0 { &[0.0, back][..] } else { &[0.0] };
        let sigma = config.sigma_px / self.camera.fx_px;
        for &farthest in ways {
            let fit = fit(&tracks, &Belief { farthest, ..belief }, sigma)?;
            if fit.agree >= config.fewest && 2 * fit.agree >= tracks.len() {
                return Some((fit, tracks));
            }
        }
        None
    }

    /// How far it went since `before`; none where that may be more than the road that is in
    /// both images: the best of what is left would be a wrong way.
    fn drive(&self, before: &GrayImage, parameters: &Parameters, dt_s: f64) -> Option<Shift> {
        let (image, _) = self.before.as_ref().filter(|_| self.sees_road)?;
        let road = &self.config.road;
        let ways_m = [-self.speed.most_back_m(dt_s, road), self.speed.most_m(dt_s, road)];
        let config = &road.for_shifts_of(ways_m[1])?.seen_from(self.nearest_road_m(image.height()));
        let after_from_before = Motion::new(parameters).after_from_before;
        let shift = |speed_m_s: f64| {
            let bend_per_m = parameters[YAW] / least_way_m(speed_m_s * dt_s);
            let road = Road {
                height_m: self.camera_height_m,
                rise: self.pitch.now_rad(-parameters[DOWN], speed_m_s, &self.config.rotation),
                bend_per_m: bend_per_m.clamp(-SHARPEST_PER_M, SHARPEST_PER_M),
                sag_per_m: self.grade.sag_per_m(),
                fall: self.fall.per_m(),
            };
            let view = |image, turned: &Rotation3<f64>, road| View::new(image, &self.camera, turned, road, config);
            // What of the direction of the motion is no pitch is a bump.
            let lower_m = (parameters[DOWN] + road.rise) * speed_m_s * dt_s;
            let later = Road { height_m: road.height_m - lower_m, ..road };
            view(before, &Rotation3::identity(), &road).shift_to(
                &view(image, &after_from_before, &later),
                parameters[ASIDE],
                ways_m,
                config,
            )
        };
        match self.speed.known_m_s() {
            Some(speed_m_s) => shift(speed_m_s),
            // How far to believe the direction, the speed says.
            None => shift(shift(config.usual_m_s)?.forward_m / dt_s),
        }
    }

    /// Distance of the nearest road in an image of so many rows, metres.
    fn nearest_road_m(&self, rows: u32) -> f64 {
        let below_rad = ((f64::from(rows) - self.camera.cy_px) / self.camera.fy_px).atan() + self.pitch.mean_rad;
        if below_rad > 0.0 { self.camera_height_m / below_rad.tan() } else { f64::INFINITY }
    }

    /// How far it went, as points of known depth and the road say, metres; those that agree
    /// are followed on, with what is known of their depths then.
    fn way_m(&mut self, fit: &Fit, mut tracks: Vec<Track>, road_m: Option<f64>) -> Option<f64> {
        if !self.sees_road {
            return None;
        }
        let sigma = self.config.rotation.sigma_px / self.camera.fx_px;
        let motion = Motion::new(&fit.parameters);
        tracks.retain(|track| motion.agrees(track, 0.0, sigma));
        let told = self.scale.way(way_of(&tracks, fit, sigma), road_m, &self.config.road);
        let Some((way_m, factor)) = told else {
            self.follower.forget();
            return None;
        };
        let on = |track: &Track| (track.after_px, known_after(track, &motion, way_m, factor, sigma));
        self.follower.keep(tracks.iter().map(on));
        Some(way_m)
    }

    /// Whether a speed that the road shows is believed: where the last was wrong, so are the
    /// depths of the points that told it.
    fn is_believed(&mut self, shift: &Shift, time_s: f64, dt_s: f64) -> bool {
        let told = self.speed.hear(shift, time_s, dt_s, &self.config.road);
        if told == Told::AnotherSpeed {
            self.scale = Scale::default();
        }
        told != Told::Nothing
    }
}

/// How much more than in the image before it is tried to have turned in such a time, radians,
/// the least first.
fn tried_turns_rad(dt_s: f64) -> impl Iterator<Item = f64> {
    let steps = (TRIED_RAD_S * dt_s / TRIED_RAD).round().clamp(1.0, MOST_TRIED);
    let both = |step: i32| [f64::from(step) * TRIED_RAD, -f64::from(step) * TRIED_RAD];
    (1..=steps as i32).flat_map(both)
}

/// The way as one that has a direction.
fn least_way_m(way_m: f64) -> f64 {
    way_m.abs().max(LEAST_WAY_M).copysign(way_m)
}

#[cfg(test)]
mod tests;
