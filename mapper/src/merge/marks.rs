//! What maps are aligned by: poles and signs as points, lane lines as pieces.

use nalgebra::{Point3, Vector3};

use super::config::AlignConfig;
use super::field::{Field, Held};
use super::source::Source;

/// The class of poles.
const POLE: u32 = 0;

/// A pole's foot or a sign's centroid.
#[derive(Debug, Clone, Copy)]
pub struct Mark {
    /// The map that it is in.
    pub source: usize,
    /// Poles, or one kind of signs.
    pub class: u32,
    /// The point and what it moves with.
    pub held: Held,
}

impl Mark {
    /// Whether it is a pole's foot, on the ground.
    pub fn is_pole(&self) -> bool {
        self.class == POLE
    }
}

/// A short straight piece of a lane line.
#[derive(Debug, Clone, Copy)]
pub struct Piece {
    /// The map that it is in.
    pub source: usize,
    /// Its middle and what it moves with.
    pub held: Held,
    /// From its first to its last point, metres.
    pub way: Vector3<f64>,
}

/// The poles and signs of all maps, map by map.
pub fn marks(sources: &[Source], field: &Field) -> Vec<Mark> {
    let mut marks = Vec::new();
    for (source, Source { map, .. }) in sources.iter().enumerate() {
        let poles = map.poles.iter().map(|pole| (POLE, pole.road, pole.foot_map));
        let signs = map.signs.iter().map(|sign| (POLE + 1 + sign.kind as u32, sign.road, sign.centroid_map));
        marks.extend(
            poles.chain(signs).filter_map(|(class, road, point)| {
                Some(Mark { source, class, held: field.hold(source, road, &point)? })
            }),
        );
    }
    marks
}

/// The lane lines of all maps in pieces, map by map.
pub fn pieces(sources: &[Source], field: &Field, config: &AlignConfig) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for (source, Source { map, .. }) in sources.iter().enumerate() {
        for lane in &map.lanes {
            for pair in lane.points_map.windows(2) {
                let whole = pair[1] - pair[0];
                let count = (whole.norm() / config.lane_step_m).ceil().clamp(1.0, 1e6);
                let way = whole / count;
                for k in 0..count as usize {
                    let middle: Point3<f64> = pair[0] + way * (k as f64 + 0.5);
                    if let Some(held) = field.hold(source, lane.road, &middle)
                        && way.norm() > 1e-3
                    {
                        pieces.push(Piece { source, held, way });
                    }
                }
            }
        }
    }
    pieces
}
