//! The map as text, one landmark per line, in the manner of the paper's
//! 4 KB text maps.

use std::fmt::Write as _;

use super::{LaneKind, PoleKind, SemanticMap, SignKind};

/// The map as text: `kind road numbers..`, metres with two decimals in the
/// map frame; a pole's two control points (eq. 1), a sign's centroid and size
/// (eq. 2), a lane line's vertices (eq. 3).
pub fn ascii(map: &SemanticMap) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    for pole in &map.poles {
        let (a, b) = (pole.foot_map, pole.top_map);
        let _ = writeln!(
            out,
            "{} {} {:.2} {:.2} {:.2} {:.2} {:.2} {:.2}",
            pole.kind.name(),
            pole.road.0,
            a.x,
            a.y,
            a.z,
            b.x,
            b.y,
            b.z
        );
    }
    for sign in &map.signs {
        let c = sign.centroid_map;
        let _ =
            writeln!(out, "{} {} {:.2} {:.2} {:.2} {:.2}", sign.kind.name(), sign.road.0, c.x, c.y, c.z, sign.size_m);
    }
    for lane in &map.lanes {
        let _ = write!(out, "{} {}", lane.kind.name(), lane.road.0);
        for p in &lane.points_map {
            let _ = write!(out, " {:.2} {:.2} {:.2}", p.x, p.y, p.z);
        }
        out.push('\n');
    }
    out
}

impl PoleKind {
    /// All kinds, in the order of the map file.
    pub const ALL: [Self; 4] = [Self::LampPost, Self::SignPost, Self::Delineator, Self::Trunk];

    /// Its name, one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::LampPost => "lamp-post",
            Self::SignPost => "sign-post",
            Self::Delineator => "delineator",
            Self::Trunk => "trunk",
        }
    }
}

impl SignKind {
    /// All kinds, in the order of the map file.
    pub const ALL: [Self; 2] = [Self::TrafficSign, Self::TrafficLight];

    /// Its name, one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::TrafficSign => "traffic-sign",
            Self::TrafficLight => "traffic-light",
        }
    }
}

impl LaneKind {
    /// All kinds, in the order of the map file.
    pub const ALL: [Self; 2] = [Self::Solid, Self::Dashed];

    /// Its name, one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Solid => "solid-line",
            Self::Dashed => "dashed-line",
        }
    }
}
