//! The map as text, one landmark per line, in the manner of the paper's
//! 4 KB text maps.

use std::fmt::Write as _;

use super::{LaneKind, PoleKind, SemanticMap, SignKind};

/// The landmarks as text: `kind road numbers..`, metres with two decimals in
/// the map frame; a pole's two control points (eq. 1; its rough size is their
/// distance), a sign's centroid and size (eq. 2), a lane line's vertices
/// (eq. 3). The paths of the roads are left out, as in the paper.
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
    pub const ALL: [Self; 3] = [Self::Solid, Self::Dashed, Self::Kerb];

    /// Those that are painted, likewise.
    pub const PAINTED: [Self; 2] = [Self::Solid, Self::Dashed];

    /// Whether it is painted.
    pub fn is_painted(self) -> bool {
        Self::PAINTED.contains(&self)
    }

    /// Its name, one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Solid => "solid-line",
            Self::Dashed => "dashed-line",
            Self::Kerb => "kerb",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{LaneLine, Pole, RoadId, Sign};
    use nalgebra::Point3;

    #[test]
    fn a_landmark_is_a_line() {
        let road = RoadId(2);
        let map = SemanticMap {
            poles: vec![Pole {
                kind: PoleKind::LampPost,
                foot_map: Point3::new(-4.5, 1.6, 30.0),
                top_map: Point3::new(-4.47, -4.6, 29.98),
                road,
            }],
            signs: vec![Sign {
                kind: SignKind::TrafficSign,
                centroid_map: Point3::new(4.2, -0.6, 20.0),
                size_m: 0.85,
                road,
            }],
            lanes: vec![LaneLine {
                kind: LaneKind::Dashed,
                points_map: vec![Point3::new(-1.8, 1.65, 5.0), Point3::new(-1.8, 1.65, 15.0)],
                road,
                marks_m: Vec::new(),
            }],
            ..SemanticMap::default()
        };
        let expected = "\
lamp-post 2 -4.50 1.60 30.00 -4.47 -4.60 29.98
traffic-sign 2 4.20 -0.60 20.00 0.85
dashed-line 2 -1.80 1.65 5.00 -1.80 1.65 15.00
";
        assert_eq!(ascii(&map), expected);
    }
}
