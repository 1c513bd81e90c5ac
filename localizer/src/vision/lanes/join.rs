//! Pieces of one lane line: dashes, and what crossings and gaps in the mask
//! have parted.

use nalgebra::{Point2, Vector2};

use super::fit::{StraightLine, straight_line};
use super::trace::Track;
use crate::vision::config::LaneConfig;

/// Joins pieces, those that fit best first, until none fit.
pub(super) fn join(mut tracks: Vec<Track>, config: &LaneConfig) -> Vec<Track> {
    let mut ends: Vec<Ends> = tracks.iter().map(|track| Ends::of(track, config)).collect();
    loop {
        let mut best: Option<(f64, usize, usize)> = None;
        for far in 0..tracks.len() {
            for near in (0..tracks.len()).filter(|&near| near != far) {
                let Some(cost) = ends[far].cost_of_joining(&ends[near], config) else { continue };
                if best.is_none_or(|(least, ..)| cost < least) {
                    best = Some((cost, far, near));
                }
            }
        }
        let Some((_, far, near)) = best else { return tracks };
        let points = std::mem::take(&mut tracks[near].points);
        // Where the pieces overlap, the far one has the say.
        let last = tracks[far].points.last().map_or(f64::MIN, |p| p.at_px.y);
        tracks[far].points.extend(points.into_iter().filter(|p| p.at_px.y > last));
        ends[far] = Ends::of(&tracks[far], config);
        tracks.remove(near);
        ends.remove(near);
    }
}

/// How a piece begins and ends.
struct Ends {
    far: End,
    near: End,
    length_px: f64,
}

struct End {
    at_px: Point2<f64>,
    /// Where the line goes, towards the camera.
    line: Option<StraightLine>,
}

impl Ends {
    fn of(track: &Track, config: &LaneConfig) -> Self {
        let points: Vec<Point2<f64>> = track.points.iter().map(|p| p.at_px).collect();
        let end = |tip: Option<&Point2<f64>>| {
            let at_px = tip.copied().unwrap_or_else(Point2::origin);
            let near: Vec<Point2<f64>> =
                points.iter().filter(|p| (*p - at_px).norm() <= config.direction_px).copied().collect();
            End { at_px, line: straight_line(&near) }
        };
        Self { far: end(points.first()), near: end(points.last()), length_px: track.length_px() }
    }

    /// Small where `nearer` continues this piece well; none where it does not.
    fn cost_of_joining(&self, nearer: &Self, config: &LaneConfig) -> Option<f64> {
        const OVERLAP_PX: f64 = 4.0;
        let gap: Vector2<f64> = nearer.far.at_px - self.near.at_px;
        let length = gap.norm();
        let longer = self.length_px.max(nearer.length_px);
        if length > config.min_gap_px.max(config.max_gap_share * longer) {
            return None;
        }
        let (out, into) = (self.near.line.as_ref()?, nearer.far.line.as_ref()?);
        if out.direction.dot(&gap) < -OVERLAP_PX || into.direction.dot(&gap) < -OVERLAP_PX {
            return None;
        }
        // Each end must lie on the other's extension, as far as that is known.
        let allowed = |line: &StraightLine| {
            config.max_offset_px + length * config.max_offset_per_gap.max(line.direction_noise_rad(config))
        };
        let (ahead, back) = (out.off_px(&nearer.far.at_px).abs(), into.off_px(&self.near.at_px).abs());
        let bend = out.direction.angle(&into.direction);
        let allowed_bend =
            config.max_bend_deg.to_radians() + out.direction_noise_rad(config) + into.direction_noise_rad(config);
        let fits = ahead <= allowed(out) && back <= allowed(into) && bend <= allowed_bend;
        fits.then_some(length + 5.0 * (ahead + back))
    }
}
