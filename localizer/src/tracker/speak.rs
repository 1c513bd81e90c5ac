//! What is said of a frame: which pose, how well it is known, and how far to trust it.

use common::geometry::local;

use super::clock::Interval;
use super::health::{self, Context};
use super::outside::Standing;
use super::{Tracker, mean};
use crate::estimate::{PoseEstimate, Status};

impl Tracker<'_> {
    /// What is made of a frame in which the best is so far ahead of its rivals, and the pose.
    pub(super) fn speak(&mut self, margin: f64) -> Option<&PoseEstimate> {
        for (i, hypothesis) in self.bank.iter_mut().enumerate() {
            hypothesis.led_frames = if i == 0 { hypothesis.led_frames + 1 } else { 0 };
        }
        let best = self.bank.first()?;
        let lead = self.lead();
        // The pose is that of the image: what its time says is off by so much.
        let late = best.state.time_covariance(self.clock.image_variance_s2());
        let contradiction = |interval: Interval| interval.contradiction_sigmas(self.time_variance_s2);
        let contradiction_sigmas = best.interval.map_or(0.0, contradiction);
        let shows_the_same = self.sight.shows_the_same;
        if !shows_the_same {
            self.strangers.see(&best.now);
        }
        let context = Context {
            lead,
            margin,
            contradiction_sigmas,
            late,
            shows_the_same,
            is_strange: self.strangers.are_all(&self.config.health),
            is_contradicted: self.is_contradicted(),
        };
        let verdict = health::judge(best, &context, self.verdict, &self.config.health);
        self.verdict = Some(verdict);
        let status = self.unseen.judged(verdict.status, shows_the_same);
        // One of many that may be right: it is still being searched.
        let is_candidate = best.standing.is_from_afar && status != Status::Ok;
        let status = if is_candidate { Status::Lost } else { status };
        // What shows the same again confirms nothing.
        if verdict.is_followed && !shows_the_same {
            self.unfollowed_s = 0.0;
        }
        let is_well = verdict.well_frames > 0 && !shows_the_same && !self.unseen.is_open();
        let position_map = best.state.map_from_camera.translation.vector.into();
        if self.sweep.trusts(status, is_well, position_map, &self.config.sweep) {
            // Should it be lost from here on, it is searched around here.
            self.region.trust(&best.state, self.config.bank.contradiction);
            if self.contradicting_fixes == 0 {
                self.region.forget_told();
            }
        }
        self.say(status, margin.min(lead))?;
        if let Some(best) = self.bank.first_mut().filter(|_| status == Status::Ok) {
            best.standing = Standing { was_ok: true, is_from_afar: false, ..best.standing };
        }
        self.said.as_ref()
    }

    /// Writes down the pose of the image, which is so far ahead of what else it may be.
    fn say(&mut self, status: Status, margin: f64) -> Option<()> {
        let best = self.bank.first()?;
        let said = if status == Status::Ok { std::slice::from_ref(best) } else { self.bank.as_slice() };
        let (map_from_camera, mut covariance) = mean::mean_of(said, self.config.bank.doubt)?;
        // The pose is that of the image: what its time says is off by so much.
        covariance += best.state.time_covariance(self.clock.image_variance_s2());
        if let Some(unseen) = self.unseen.covariance(&map_from_camera, &self.config.unseen) {
            covariance += unseen;
        }
        let is_candidate = best.standing.is_from_afar && status != Status::Ok;
        if let Some(region) = self.region.searched(&self.config.gps).filter(|_| is_candidate) {
            let off = local(&map_from_camera, &region.map_from_camera);
            covariance += region.pose_covariance() + off * off.transpose();
        }
        let mut correspondences = self.said.take().map_or_else(Vec::new, |said| said.correspondences);
        correspondences.clone_from(&best.correspondences);
        self.said = Some(PoseEstimate {
            map_from_camera,
            covariance,
            correspondences,
            residual_rms_px: best.rms_px,
            iterations: best.iterations,
            converged: best.converged,
            status,
            support: best.support,
            margin,
            time_sigma_s: self.clock.variance_s2().sqrt(),
        });
        Some(())
    }
}
