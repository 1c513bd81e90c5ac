//! The map model (eq. 1-3): poles, signs and lane lines on roads.

use nalgebra::Point3;

/// Index of a road stretch in [`SemanticMap::roads`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RoadId(pub u32);

/// What a pole is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PoleKind {
    /// A mast: lamp posts, traffic-light and catenary masts, and any other post of
    /// which the upper end was not seen. It may go on above where it is mapped.
    LampPost,
    /// A post that ends at a sign or light.
    SignPost,
    /// A delineator or a bollard, about a metre high.
    Delineator,
    /// A tree trunk.
    Trunk,
}

/// What a sign-like landmark is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum SignKind {
    /// A retro-reflective plate.
    TrafficSign,
    /// A signal head.
    TrafficLight,
}

/// What a lane line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum LaneKind {
    /// Painted without gaps.
    Solid,
    /// Painted with gaps; the polyline runs through them.
    Dashed,
    /// The edge of a carriageway on which nothing is painted, along its kerb or gutter:
    /// networks for lane lines see it.
    Kerb,
}

/// Eq. 1: a pole as the two control points of its axis, the feet of the
/// planes perpendicular to the fitted line through its extreme points.
/// Its rough size is its [length](Pole::length_m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pole {
    /// What it is.
    pub kind: PoleKind,
    /// Lower control point, map frame, metres.
    pub foot_map: Point3<f64>,
    /// Upper control point, map frame, metres.
    pub top_map: Point3<f64>,
    /// The road it stands on.
    pub road: RoadId,
}

impl Pole {
    /// Rough size m of the paper: the distance of the control points, metres.
    pub fn length_m(&self) -> f64 {
        (self.top_map - self.foot_map).norm()
    }
}

/// Eq. 2: a sign as a point with a size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sign {
    /// What it is.
    pub kind: SignKind,
    /// Centroid, map frame, metres.
    pub centroid_map: Point3<f64>,
    /// Largest distance between two of its points, metres.
    pub size_m: f64,
    /// The road it stands on.
    pub road: RoadId,
}

/// Eq. 3: a lane line as a point sequence on the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct LaneLine {
    /// What it is.
    pub kind: LaneKind,
    /// At least two vertices, map frame, metres, in driving order.
    pub points_map: Vec<Point3<f64>>,
    /// The road it is painted on: that of its middle.
    pub road: RoadId,
    /// Where each mark of a dashed line begins and ends, metres along the
    /// polyline from its first vertex; ascending, apart. Where a line is cut
    /// inside a mark, this reaches beyond its end. Empty for any other line, and
    /// where nobody knows.
    pub marks_m: Vec<[f64; 2]>,
}

/// A stretch of the driven road: the path of the reference camera along it.
#[derive(Debug, Clone, PartialEq)]
pub struct Road {
    /// At least one vertex, map frame, metres, in driving order.
    pub path_map: Vec<Point3<f64>>,
}

/// A compact semantic map. Its frame is the reference camera of the first
/// frame of the survey: x right, y down, z forward, metres.
///
/// Every [`RoadId`] in it is an index into `roads`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SemanticMap {
    /// What the frame is, for people: e.g. `kitti 04`. At most 64 bytes.
    pub frame_note: String,
    /// Stretches of driven road, in driving order.
    pub roads: Vec<Road>,
    /// Poles.
    pub poles: Vec<Pole>,
    /// Signs.
    pub signs: Vec<Sign>,
    /// Lane lines.
    pub lanes: Vec<LaneLine>,
}
