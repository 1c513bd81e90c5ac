//! Poles: regions of the class pole to centre lines with two ends.
//!
//! Per region, RANSAC finds the lines that its rows support (section IV.B).
//! Better than the paper's: each line is then measured anew in the plane, to
//! a fraction of a pixel and up to its ends; pieces of one pole are joined;
//! and what is short, thick, bent or tilted is no pole.

mod join;
mod ransac;
mod stem;

use crate::features::LineFeature;

use super::config::PoleConfig;
use super::regions::{self, Growth};
use super::{Class, Plane, ProbabilityMaps};
use stem::Stem;

/// Pieces shorter than this share of the shortest pole are not even joined.
const PIECE: f64 = 0.5;

/// The poles of an image, from left to right.
pub fn extract(maps: &ProbabilityMaps, config: &PoleConfig) -> Vec<LineFeature> {
    measure(maps.plane(Class::Pole), maps, config)
}

/// What looks like a pole in `plane`, from left to right; `maps` say what hides it.
pub(super) fn measure(plane: &Plane, maps: &ProbabilityMaps, config: &PoleConfig) -> Vec<LineFeature> {
    let mut stems = join::join(stems(plane, config), maps, config);
    stems.retain(|stem| is_pole(stem, config));
    stems.sort_by(|a, b| a.line.u_px.total_cmp(&b.line.u_px));
    stems.iter().map(|stem| feature(stem, maps, config)).collect()
}

fn stems(plane: &Plane, config: &PoleConfig) -> Vec<Stem> {
    let min_rows = (PIECE * config.min_length_px).max(3.0);
    let growth = Growth { threshold: config.threshold, seed: config.seed, min_area_px: min_rows as usize };
    let mut stems = Vec::new();
    for (number, region) in (0_u64..).zip(regions::grow(plane, &growth)) {
        let mut centres = ransac::centres(plane, &region);
        for _ in 0..config.lines_per_region {
            let Some(support) = ransac::best_line(&centres, min_rows, config, number) else { break };
            ransac::remove(&mut centres, &support.line, support.rows);
            let Some(stem) = Stem::measure(plane, support.line, support.rows, support.width_px) else { continue };
            ransac::remove(&mut centres, &stem.line, (stem.upper_v_px, stem.lower_v_px));
            if stem.coverage() >= config.min_coverage {
                keep_longer(&mut stems, stem);
            }
        }
    }
    stems
}

/// Adds a stem, unless a longer one shows the same pole: measuring follows a
/// pole beyond the rows of its region, so pieces of it can all become whole.
fn keep_longer(stems: &mut Vec<Stem>, stem: Stem) {
    let same = |other: &Stem| {
        let (top, bottom) = (stem.upper_v_px.max(other.upper_v_px), stem.lower_v_px.min(other.lower_v_px));
        let near = 0.5 * stem.width_px.max(other.width_px) + 1.0;
        let close = |v: f64| (stem.line.at(v) - other.line.at(v)).abs() < near;
        2.0 * (bottom - top) > stem.rows().min(other.rows()) && close(top) && close(bottom)
    };
    match stems.iter().position(same) {
        Some(at) if stems[at].rows() < stem.rows() => stems[at] = stem,
        Some(_) => {}
        None => stems.push(stem),
    }
}

fn is_pole(stem: &Stem, config: &PoleConfig) -> bool {
    let across = stem.line.across();
    let (length, width) = (stem.rows() / across, stem.width_px * across);
    length >= config.min_length_px
        && length >= config.min_aspect * width
        && stem.probability() >= config.min_probability
        && stem.line.slope.abs() <= config.max_tilt_deg.to_radians().tan()
        && stem.residual_px() <= config.max_residual_px.max(config.max_residual_width_share * width)
}

fn feature(stem: &Stem, maps: &ProbabilityMaps, config: &PoleConfig) -> LineFeature {
    let across = stem.line.across();
    let (upper_px, lower_px) = (stem.line.point(stem.upper_v_px), stem.line.point(stem.lower_v_px));
    let length = (lower_px - upper_px).norm().max(1.0);
    // Rows repeat each other's error over the correlation length, so this
    // many of them are independent; a line through n points over a length l
    // knows its direction to sigma sqrt(12 / n) / l.
    let independent = (stem.centres.len() as f64 / config.correlation_px).max(1.0);
    let width_px = stem.width_px * across;
    let mask_sigma = config.mask_sigma_px.hypot(config.mask_sigma_width_share * width_px);
    let row_sigma = stem.residual_px().hypot(mask_sigma);
    LineFeature {
        upper_px,
        lower_px,
        offset_sigma_px: (stem.residual_px() / independent.sqrt()).hypot(mask_sigma),
        angle_sigma_rad: row_sigma * (12.0 / independent).sqrt() / length,
        width_px,
        probability: stem.probability(),
        upper_is_cut: is_cut(stem, maps, -1.0) || stem.fades(stem.centres.iter(), stem.upper_v_px),
        lower_is_cut: is_cut(stem, maps, 1.0) || stem.fades(stem.centres.iter().rev(), stem.lower_v_px),
    }
}

/// Whether the end in this direction is certainly not the pole's own: the
/// image ends there, or a sign or a light hides the rest.
fn is_cut(stem: &Stem, maps: &ProbabilityMaps, down: f64) -> bool {
    /// Networks grow uncertain this close to the border.
    const BORDER_PX: f64 = 4.0;
    const HIDING: u8 = 64;
    let end = if down < 0.0 { stem.upper_v_px } else { stem.lower_v_px };
    let beyond = end + down * BORDER_PX;
    let u = stem.line.at(beyond);
    let outside = beyond < -0.5
        || beyond > maps.height() as f64 - 0.5
        || u - 0.5 * stem.width_px < -0.5
        || u + 0.5 * stem.width_px > maps.width() as f64 - 0.5;
    let reach = 2.0 + 0.5 * stem.width_px;
    let steps = (0..=reach.ceil() as usize).map(|step| end + down * step as f64);
    outside || steps.into_iter().any(|v| join::hiding(maps, &stem.line, v) >= HIDING)
}

#[cfg(test)]
mod tests;
