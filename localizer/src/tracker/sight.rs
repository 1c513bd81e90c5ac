//! What a frame shows, and what it may show.

use common::geometry::PinholeCamera;

use crate::associate::matching::Scene;
use crate::associate::odds::{OddsConfig, UsualOdds};
use crate::config::Config;
use crate::features::Features;
use crate::prepare::Prepared;
use crate::preselect::Candidates;
use crate::projection::ImageSize;

/// What a frame shows, and what it may show.
#[derive(Debug)]
pub(super) struct Sight {
    pub camera: PinholeCamera,
    pub image: ImageSize,
    pub features: Prepared,
    pub candidates: Candidates,
    /// The features of the image before.
    before: Prepared,
    /// They are the same: an old image again, for no two of a camera are, not even
    /// of one that stands.
    pub shows_the_same: bool,
    odds: UsualOdds,
}

impl Sight {
    /// Nothing is seen yet.
    pub fn new(camera: &PinholeCamera, image: ImageSize, odds: &OddsConfig) -> Self {
        let (features, before) = (Prepared::default(), Prepared::default());
        Self {
            camera: *camera,
            image,
            features,
            candidates: Candidates::default(),
            before,
            shows_the_same: false,
            odds: UsualOdds::new(odds),
        }
    }

    /// Takes the features of the next image.
    pub fn look(&mut self, features: &Features) {
        std::mem::swap(&mut self.features, &mut self.before);
        self.features.fill(features);
        self.shows_the_same = !self.features.is_empty() && self.features == self.before;
        if !self.shows_the_same {
            self.odds.learn(&self.features);
        }
    }

    /// Whether it shows nothing, or nothing new.
    pub fn shows_nothing(&self) -> bool {
        self.features.is_empty() || self.shows_the_same
    }

    /// As it is matched.
    pub fn scene<'a>(&'a self, config: &'a Config) -> Scene<'a> {
        Scene {
            camera: &self.camera,
            image: self.image,
            features: &self.features,
            candidates: &self.candidates,
            noise: &config.noise,
            detection: &config.detection,
            odds: self.odds,
        }
    }
}
