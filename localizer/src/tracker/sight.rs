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
    odds: UsualOdds,
}

impl Sight {
    /// Nothing is seen yet.
    pub fn new(camera: &PinholeCamera, image: ImageSize, odds: &OddsConfig) -> Self {
        let (features, before) = (Prepared::default(), Prepared::default());
        Self { camera: *camera, image, features, candidates: Candidates::default(), before, odds: UsualOdds::new(odds) }
    }

    /// Takes the features of the next image; says whether they are those of the
    /// image before.
    pub fn look(&mut self, features: &Features) -> bool {
        std::mem::swap(&mut self.features, &mut self.before);
        self.features.fill(features);
        let shows_the_same = self.features == self.before;
        if !shows_the_same {
            self.odds.learn(&self.features);
        }
        shows_the_same
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
