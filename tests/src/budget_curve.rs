//! Accuracy against bytes: what a smaller map is expected to localize to, and
//! what it does.

use common::map::{EncodeOptions, SemanticMap};
use localizer::cli::input::simulated;
use localizer::eval::{FrameError, START_FRAMES};
use mapper::budget::{Coder, Detail, Known};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;

use crate::trial::Trial;

/// Measured errors, pooled over all starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Root mean square of the position error, metres.
    pub position_m: f64,
    /// To the right, metres.
    pub lateral_m: f64,
    /// Forward, metres.
    pub longitudinal_m: f64,
    /// Of the angle, radians.
    pub angle_rad: f64,
    /// Largest position error, metres.
    pub worst_m: f64,
    /// Share of frames off by less than half a metre.
    pub under_half_metre: f64,
}

/// Localizes a drive in a map from so many simulated GPS starts, with the seeds 0, 1, ...;
/// none where no frame is after the start.
///
/// # Errors
/// What the localizer says; a map in memory gives it no reason.
pub fn measure(trial: &Trial, map: &SemanticMap, starts: u64) -> localizer::Result<Option<Measured>> {
    let mut errors: Vec<FrameError> = Vec::new();
    for seed in 0..starts {
        let fixes = simulated(&trial.frames.iter().map(|seen| seen.frame), &trial.truth, &trial.config, seed)?;
        let results = trial.run_in(map, &fixes)?;
        errors.extend(trial.errors(results.get(START_FRAMES..).unwrap_or_default()));
    }
    if errors.is_empty() {
        return Ok(None);
    }
    let count = errors.len() as f64;
    let rms = |value: &dyn Fn(&FrameError) -> f64| {
        (errors.iter().map(|error| value(error).powi(2)).sum::<f64>() / count).sqrt()
    };
    Ok(Some(Measured {
        position_m: rms(&FrameError::position_m),
        lateral_m: rms(&|error| error.lateral_m),
        longitudinal_m: rms(&|error| error.longitudinal_m),
        angle_rad: rms(&|error| error.angle_rad),
        worst_m: errors.iter().map(FrameError::position_m).fold(0.0, f64::max),
        under_half_metre: errors.iter().filter(|error| error.position_m() < 0.5).count() as f64 / count,
    }))
}

/// What one would keep without thinking of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Naive {
    /// The longest poles and lines, the largest signs.
    BySize,
    /// As many as possible: what takes fewest bytes.
    ByCount,
    /// Whatever comes.
    Random,
}

/// Fills a map of this detail with landmarks in a naive order while they fit.
///
/// # Errors
/// As [`SemanticMap::encode`].
pub fn naive(whole: Known<'_>, detail: &Detail, budget_bytes: usize, order: Naive) -> mapper::Result<SemanticMap> {
    let (map, _) = detail.applied(whole);
    let coder = Coder::new(&map, detail.quantum_m);
    let sizes =
        map.poles.iter().map(common::map::Pole::length_m).chain(map.signs.iter().map(|sign| sign.size_m)).chain(
            map.lanes.iter().map(|lane| lane.points_map.windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum()),
        );
    let mut landmarks: Vec<(f64, usize)> = sizes.enumerate().map(|(landmark, size_m)| (size_m, landmark)).collect();
    match order {
        Naive::BySize => landmarks.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1))),
        Naive::Random => landmarks.shuffle(&mut Pcg64::seed_from_u64(1)),
        Naive::ByCount => {
            for (cost, landmark) in &mut landmarks {
                *cost = coder.file_bytes(&[*landmark])? as f64;
            }
            landmarks.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        }
    }
    let mut kept = Vec::new();
    for (_, landmark) in landmarks {
        kept.push(landmark);
        if coder.file_bytes(&kept)? > budget_bytes {
            kept.pop();
        }
    }
    let options = EncodeOptions { quantum_m: detail.quantum_m };
    Ok(SemanticMap::decode(&coder.map_of(&kept).encode(&options)?)?)
}
