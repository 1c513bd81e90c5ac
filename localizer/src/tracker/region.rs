//! The region in which the camera is by GPS and by the last trusted pose,
//! whatever is tracked: where it is searched for.

use std::f64::consts::PI;

use common::geometry::{PoseParameters, Tangent, local};
use nalgebra::{Cholesky, Matrix3, Matrix6, Point3, Vector3, Vector6};

use super::Tracker;
use super::health::Verdict;
use super::outside::is_beyond_map;
use crate::Result;
use crate::config::Config;
use crate::filter::State;
use crate::gps::{GpsConfig, GpsFix};
use crate::local_map::{LocalMap, RoadKey};
use crate::odometry::Odometry;
use crate::start::{Rough, Stance, keep_on_road};

/// Speed of a vehicle that sets off: the least at which receivers tell a course.
const SETS_OFF_M_S: f64 = 1.0;

/// Largest standard deviation of an angle: beyond, any is as good.
const MOST_TURNED_RAD: f64 = 1.0;

/// Where the camera is by the last trusted pose and by fixes.
#[derive(Debug, Clone, Default)]
pub(super) struct Region {
    /// The last trusted pose, or the first fix, driven on, with the fixes that
    /// agree with it.
    trusted: Option<State>,
    /// The first fix headed against the survey, driven on, where nothing has told yet which
    /// way the road is driven.
    turned: Option<State>,
    /// The pose that was trusted before, driven on, where the one that is now
    /// contradicts it: one of the two was wrong, and only time tells which.
    former: Option<State>,
    /// What fixes say that do not. Reflections hold for some of them, and a pose
    /// that was trusted may be wrong: then the camera may be in either place.
    told: Option<State>,
    /// Fixes in a row that do not agree.
    refused_fixes: usize,
    /// How many of them agree with each other: those of a receiver that is stuck do not,
    /// as the vehicle drives on.
    agreeing_fixes: usize,
    /// Position of the last fix, and the time since then, seconds.
    heard: Option<(Point3<f64>, f64)>,
    /// Variance of the time between two images, s^2. Times that are off do not
    /// add up: it is the first and the last that count.
    time_variance_s2: f64,
}

impl Region {
    /// Begins again at a pose that is trusted. What was trusted before goes on to
    /// count where more than `contradiction` nats of it speak against this pose,
    /// until one of those that follow is back there.
    pub fn trust(&mut self, state: &State, contradiction: f64) {
        let contradicts = |place: &State| half_distance2(place, state, self.time_variance_s2) > contradiction;
        let is_back = self.former.as_ref().is_some_and(|former| !contradicts(former));
        let trusted = self.trusted.replace(state.clone());
        self.turned = None;
        if is_back {
            self.former = None;
        } else if let Some(left) = trusted.filter(contradicts) {
            self.former = Some(left);
        }
    }

    /// Lets go of what fixes said that contradict what is trusted.
    pub fn forget_told(&mut self) {
        (self.told, self.refused_fixes, self.agreeing_fixes) = (None, 0, 0);
    }

    /// Where to search: where the fixes say, once enough of them contradict what
    /// was trusted.
    pub fn searched(&self, gps: &GpsConfig) -> Option<&State> {
        self.contradicting(gps).or(self.trusted.as_ref())
    }

    /// Where to search besides, by the other way to drive the road.
    pub fn searched_turned(&self, gps: &GpsConfig) -> Option<&State> {
        self.turned.as_ref().filter(|_| self.contradicting(gps).is_none())
    }

    fn contradicting(&self, gps: &GpsConfig) -> Option<&State> {
        self.told.as_ref().filter(|_| self.refused_fixes >= gps.believed_after)
    }

    /// What speaks against a state, nats: half the squared Mahalanobis distance in
    /// the plane and in heading from the nearer of the places, but no more than
    /// `most`.
    pub fn against(&self, state: &State, gps: &GpsConfig, most: f64) -> f64 {
        let places = self.trusted.iter().chain(&self.turned).chain(&self.former).chain(self.contradicting(gps));
        let nats = places.map(|place| half_distance2(place, state, self.time_variance_s2)).reduce(f64::min);
        nats.map_or(0.0, |nats| nats.min(most))
    }

    fn drive(&mut self, dt_s: f64, mut drive: impl FnMut(&mut State)) {
        if let Some((_, since_s)) = &mut self.heard {
            *since_s += dt_s;
        }
        let others = self.former.iter_mut().chain(&mut self.told);
        self.trusted.iter_mut().chain(&mut self.turned).chain(others).for_each(&mut drive);
    }

    /// How fast the vehicle went from the last fix to this one, m/s. Before
    /// there are two, it may have just set off.
    fn speed_to(&self, fix: &GpsFix) -> f64 {
        let way_m = |from: &Point3<f64>| (fix.position_map - from).xz().norm();
        self.heard.filter(|(_, since_s)| *since_s > 0.0).map_or(SETS_OFF_M_S, |(from, since_s)| way_m(&from) / since_s)
    }

    /// Takes in a fix: `turned` where it leaves it open which way the road is driven.
    fn take(&mut self, fix: &GpsFix, rough: &Rough, turned: Option<&Rough>, config: &Config) {
        self.heard = Some((fix.position_map, 0.0));
        self.take_turned(rough, turned, config);
        let agrees = |place: &State| fix.offset(place, &config.gps).is_some();
        match &mut self.trusted {
            Some(trusted) if agrees(trusted) => {
                take_in(trusted, rough);
                self.former = self.former.take().filter(agrees);
                self.forget_told();
            }
            Some(_) => {
                self.refused_fixes += 1;
                self.agreeing_fixes += 1;
                match &mut self.told {
                    Some(told) if agrees(told) => take_in(told, rough),
                    told => {
                        *told = Some(unknown_speed(rough, config));
                        self.agreeing_fixes = 1;
                    }
                }
            }
            trusted => *trusted = Some(unknown_speed(rough, config)),
        }
    }

    /// Takes in which way the road is driven, or that a fix leaves it open.
    fn take_turned(&mut self, rough: &Rough, turned: Option<&Rough>, config: &Config) {
        match (turned, &mut self.turned) {
            (Some(turned), Some(place)) => take_in(place, turned),
            (Some(turned), place) if self.trusted.is_none() => *place = Some(unknown_speed(turned, config)),
            // Beside no road it tells no heading, either.
            (None, _) if rough.sigmas[4] <= config.start.path_heading_sigma_rad => self.decide_heading(rough),
            _ => {}
        }
    }

    /// Keeps the way to drive the road that a heading is nearer to.
    fn decide_heading(&mut self, rough: &Rough) {
        let off_rad = |place: &State| local(&place.map_from_camera, &rough.map_from_camera)[4].abs();
        if let (Some(trusted), Some(turned)) = (&mut self.trusted, self.turned.take())
            && off_rad(&turned) < off_rad(trusted)
        {
            *trusted = turned;
        }
    }
}

/// Takes a fix in. What a receiver is off by lasts: more fixes do not tell more.
fn take_in(place: &mut State, rough: &Rough) {
    for component in [0, 2, 4] {
        // What one says of the others, too, is not said again.
        let off = local(&place.map_from_camera, &rough.map_from_camera);
        place.constrain(component, off[component], rough.sigmas[component]);
    }
}

impl Tracker<'_> {
    /// Takes in times without an image, seconds: one of which nothing tells how fast it
    /// went, and one of which `shown` does.
    pub(super) fn go_unseen(&mut self, untold_s: f64, told_s: f64, shown: Option<&Odometry>) {
        let bank = &self.config.bank;
        let speed_m_s = self.bank.first().map_or(0.0, |best| best.state.velocity[2]);
        let speed_m_s = speed_m_s.clamp(-bank.max_reverse_m_s, bank.max_speed_m_s);
        let config = &self.config.unseen;
        self.sweep.drive(untold_s * speed_m_s.abs().max(config.least_m_s));
        let mut is_elsewhere = self.unseen.drive(untold_s, None, speed_m_s, config);
        if let Some(shown_m_s) = shown.and_then(|shown| shown.speed_m_s) {
            self.sweep.drive(told_s * shown_m_s.abs());
            is_elsewhere |= self.unseen.drive(told_s, Some(shown_m_s), speed_m_s, config);
        }
        if is_elsewhere {
            // What spoke for a place before says nothing of where it went since.
            self.begin_again();
        }
    }

    /// Keeps the region up in which the camera is, whatever is tracked.
    pub(super) fn follow_region(&mut self, dt_s: f64, odometry: Option<&Odometry>, fix: Option<&GpsFix>) -> Result<()> {
        let config = &self.config;
        self.course.drive(dt_s);
        self.region.time_variance_s2 = self.clock.variance_s2();
        self.region.drive(dt_s, |place| {
            *place = place.driven(dt_s, odometry, &config.motion, &config.odometry);
            stay_possible(place, config);
            let position = Point3::from(place.map_from_camera.translation.vector);
            let roads = &self.sight.candidates.roads;
            let path = self.map.nearest_path(roads, &position);
            if let Some(path) = path.filter(|_| !is_beyond_map(place, 0.0, self.map, roads, config)) {
                keep_on_road(place, &path, &config.start);
            }
        });
        if let Some(fix) = fix {
            self.sweep.know(fix.position_map);
            if self.unseen.hear(fix, self.config.gps.refused_sigmas * fix.horizontal_sigma_m) {
                // Nor does where it would be, had it gone on.
                self.region = Region::default();
                self.begin_again();
            }
            let fix = &self.with_right_heading(fix);
            let shown_m_s = odometry.and_then(|shown| shown.speed_m_s);
            let speed_m_s = shown_m_s.unwrap_or_else(|| self.region.speed_to(fix));
            let heading = fix.heading_at(speed_m_s, &self.config.gps);
            let rough = self.rough_from(fix, heading)?;
            let turned = if heading.is_none() { self.rough_turned(fix, &rough)? } else { None };
            self.region.take(fix, &rough, turned.as_ref(), &self.config);
            self.hold_against(fix);
        }
        Ok(())
    }

    /// Counts the fixes in a row that say that the best hypothesis is elsewhere; after enough
    /// of them the images decide anew between there and here.
    fn hold_against(&mut self, fix: &GpsFix) {
        let Some(best) = self.bank.first() else { return };
        let gps = &self.config.gps;
        let agrees = fix.offset(&best.state, gps).is_some();
        self.contradicting_fixes = if agrees { 0 } else { self.contradicting_fixes + 1 };
        if self.is_contradicted() {
            let before = self.bank.first().map_or(0.0, |best| best.past_weight);
            self.bank.iter_mut().for_each(|hypothesis| hypothesis.forget(before));
        }
    }

    /// Whether enough fixes that agree with each other say that the best hypothesis is
    /// elsewhere.
    pub(super) fn is_contradicted(&self) -> bool {
        self.contradicting_fixes.min(self.region.agreeing_fixes) >= self.config.gps.believed_after
    }

    /// Takes nothing from before as speaking for a place.
    fn begin_again(&mut self) {
        let before = self.bank.first().map_or(0.0, |best| best.past_weight);
        self.bank.iter_mut().for_each(|hypothesis| hypothesis.forget(before));
        self.verdict = self.verdict.map(Verdict::lost);
    }

    /// The belief of a fix that tells no heading, if the road beside it is driven against the
    /// survey; none beside no road, where every heading is as good.
    fn rough_turned(&mut self, fix: &GpsFix, rough: &Rough) -> Result<Option<Rough>> {
        let start = &self.config.start;
        if self.map.path_within(&self.sight.candidates.roads, &fix.position_map, start.path_reach_m).is_none() {
            return Ok(None);
        }
        let along_rad = PoseParameters::from_pose(&rough.map_from_camera).yaw_rad;
        self.rough_from(fix, Some((along_rad + PI, start.path_heading_sigma_rad))).map(Some)
    }

    fn rough_from(&mut self, fix: &GpsFix, heading: Option<(f64, f64)>) -> Result<Rough> {
        let reach_m = self.config.start.path_reach_m;
        self.map.roads_near(&fix.position_map, reach_m, &mut self.sight.candidates.roads)?;
        Ok(Rough::from_fix(
            self.map,
            &self.sight.candidates.roads,
            &fix.position_map,
            fix.horizontal_sigma_m,
            heading,
            &self.config.start,
        ))
    }
}

/// Keeps a place that nothing has confirmed for long where linear updates hold, and
/// its speed one that vehicles have.
fn stay_possible(place: &mut State, config: &Config) {
    place.velocity[2] = place.velocity[2].clamp(-config.bank.max_reverse_m_s, config.bank.max_speed_m_s);
    for i in 0..6 {
        let most = if i < 3 { config.health.max_lost_sigma_m } else { MOST_TURNED_RAD };
        let sigma = place.covariance[(i, i)].max(0.0).sqrt();
        if sigma > most {
            place.sharpen(i, most / sigma);
        }
    }
}

/// Half the squared Mahalanobis distance of two states in the plane and in
/// heading, both as uncertain as they are, at times that are known to a variance.
fn half_distance2(a: &State, b: &State, time_variance_s2: f64) -> f64 {
    const OF_ROAD: [usize; 3] = [0, 2, 4];
    let off = local(&a.map_from_camera, &b.map_from_camera);
    let off = Vector3::from_fn(|i, _| off[OF_ROAD[i]]);
    let late = a.time_covariance(time_variance_s2);
    let both = Matrix3::from_fn(|i, j| {
        let at = (OF_ROAD[i], OF_ROAD[j]);
        a.covariance[at] + b.covariance[at] + late[at]
    });
    Cholesky::new(both).map_or(0.0, |factor| 0.5 * off.dot(&factor.solve(&off)))
}

/// The state of a camera of which only a rough pose is known.
fn unknown_speed(rough: &Rough, config: &Config) -> State {
    let bank = &config.bank;
    // Forward at any speed up to the highest; little of it sideways.
    let (mean_m_s, sigma_m_s) = (bank.max_speed_m_s / 3.0, bank.max_speed_m_s / 3.0);
    let side_m_s = mean_m_s * config.motion.mounting_sigma_rad;
    let sigmas = Vector6::new(side_m_s, side_m_s, sigma_m_s, 0.05, 0.3, 0.05);
    let velocity = Tangent::new(0.0, 0.0, mean_m_s, 0.0, 0.0, 0.0);
    let covariance = Matrix6::from_diagonal(&sigmas.component_mul(&sigmas));
    State::new(rough.map_from_camera, &rough.covariance(), velocity, &covariance, &config.motion, &config.odometry)
}

/// The region of a state, at least as wide as is worth a search; as high and as
/// level as the survey's path there, where that is near and it knows that less well.
pub(super) fn rough_of(region: &State, map: &LocalMap, roads: &[RoadKey], config: &Config) -> Rough {
    let own = region.pose_covariance();
    let (health, start) = (&config.health, &config.start);
    let least = Vector6::new(
        health.search_sigma_m,
        start.height_sigma_m,
        health.search_sigma_m,
        start.tilt_sigma_rad,
        health.search_sigma_rad,
        start.tilt_sigma_rad,
    );
    let mut sigmas = Vector6::from_fn(|i, _| {
        let most = if i < 3 { health.max_search_sigma_m } else { MOST_TURNED_RAD };
        own[(i, i)].max(0.0).sqrt().min(most).max(least[i])
    });
    let position = Point3::from(region.map_from_camera.translation.vector);
    let Some(place) = map.path_within(roads, &position, start.path_reach_m) else {
        return Rough { map_from_camera: region.map_from_camera, sigmas };
    };
    let mut pose = PoseParameters::from_pose(&region.map_from_camera);
    let there = Stance::of_vehicle(region, start).on(&place, &pose);
    let on_path = [
        (1, &mut pose.y_m, there.y_m),
        (3, &mut pose.pitch_rad, there.pitch_rad),
        (5, &mut pose.roll_rad, there.roll_rad),
    ];
    for (component, value, there) in on_path {
        if sigmas[component] > least[component] {
            (*value, sigmas[component]) = (there, least[component]);
        }
    }
    Rough { map_from_camera: pose.to_pose(), sigmas }
}

#[cfg(test)]
mod tests;
