//! Signs.

use nalgebra::Vector2;

use super::poles::EDGE_PX;
use super::{Look, Matcher, Pair};
use crate::estimate::LandmarkId;
use crate::measurement::pair_sign;

impl Matcher {
    pub(super) fn match_signs(&mut self, look: &Look<'_>, matched: &mut f64) -> f64 {
        let scene = look.scene;
        let (view, noise, signs) = (&look.view, scene.noise, &scene.candidates.signs);
        let focal_px = scene.camera.fx_px;
        let clutter_ln = look.clutter.signs_per_px2().ln();
        for (candidate, sign) in signs.iter().enumerate() {
            let Some((pixel, depth_m)) = view.project(&sign.centroid_map) else { continue };
            let p = view.to_camera(&sign.centroid_map);
            // No less than the standard deviations of pose and pair together.
            let landmark_px = (noise.sign_sigma_m + noise.sign_sigma_of_size * sign.size_m) * focal_px / depth_m;
            let own_px = landmark_px + noise.calibration_px(focal_px);
            let most_x_px = look.most_sigma_px(&p, &Vector2::x()) + own_px;
            let most_y_px = look.most_sigma_px(&p, &Vector2::y()) + own_px;
            let mut known = None;
            for (i, (_, feature)) in scene.features.signs.iter().enumerate() {
                let off = pixel - feature.centre_px;
                // First by a bound, which costs less.
                let allowed_px = |most_px: f64| 4.0 * (most_px + feature.sigma_px) * (1.0 + 1e-9);
                if off.x.abs() > allowed_px(most_x_px) || off.y.abs() > allowed_px(most_y_px) {
                    continue;
                }
                let Some([first, last]) = pair_sign(sign, depth_m, feature, noise, focal_px) else { continue };
                let own_px = first.sigma_px;
                let (sigma, log_probability) = *known.get_or_insert_with(|| {
                    let sigma = Vector2::new(look.sigma_px(&p, &Vector2::x()), look.sigma_px(&p, &Vector2::y()));
                    (sigma, scene.detection.sign(sign.kind, depth_m, sign.sight_m).ln())
                });
                if off.x.abs() > 4.0 * (sigma.x + own_px) || off.y.abs() > 4.0 * (sigma.y + own_px) {
                    continue;
                }
                let Some((distance2, log_density)) = look.judge(&first, &last) else { continue };
                let support = log_probability + log_density - clutter_ln;
                self.pairs.push(Pair { feature: i, candidate, distance2, support });
            }
        }
        self.assignment.find(&self.pairs, scene.features.signs.len(), signs.len());
        self.close(
            look.wanted,
            true,
            matched,
            |candidate| {
                let sign = &signs[candidate];
                let seen = view.project(&sign.centroid_map).filter(|(p, _)| scene.image.contains(p, -EDGE_PX));
                seen.map_or(0.0, |(_, depth_m)| (1.0 - scene.detection.sign(sign.kind, depth_m, sign.sight_m)).ln())
            },
            |pair| {
                let (sign, (index, feature)) = signs.get(pair.candidate).zip(scene.features.signs.get(pair.feature))?;
                let (_, depth_m) = view.project(&sign.centroid_map)?;
                let pairing = pair_sign(sign, depth_m, feature, noise, focal_px)?;
                Some((LandmarkId::Sign(sign.index), *index, pairing.into()))
            },
        )
    }
}
