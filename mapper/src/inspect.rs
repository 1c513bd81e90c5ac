//! What is in a map, for people and for programs.

use std::fmt::Write as _;
use std::path::Path;

use common::map::{LaneKind, PoleKind, SectionSize, SemanticMap, SignKind, decode_with_layout};
use serde::Serialize;

use crate::error::Result;
use crate::register::jumps_text;
use crate::report::{BuildReport, read_beside};

/// What is in a map file, and how it was built if its report lies beside it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// What the map's frame is, for people.
    pub frame_note: String,
    /// Version of the file format.
    pub version: u8,
    /// Step of all coordinates, metres.
    pub quantum_m: f64,
    /// Length of the file, bytes.
    pub bytes: usize,
    /// Smallest and largest coordinates (map frame, metres); none for an
    /// empty map.
    pub bounds_m: Option<[[f64; 3]; 2]>,
    /// Length of all roads, metres.
    pub road_m: f64,
    /// Bytes of the file per kilometre of road; none without a road.
    pub bytes_per_km: Option<f64>,
    /// Landmarks and roads, and the bytes that they take, in file order.
    pub sections: Vec<Section>,
    /// What was estimated while the map was built, and what it gave.
    pub build: Option<BuildReport>,
    /// Why a report that lies beside the map could not be read, or is passed over: no
    /// reason not to look into the map.
    pub build_fault: Option<String>,
}

/// One section of the map file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Section {
    /// What it holds.
    pub name: String,
    /// How many of it.
    pub items: usize,
    /// How many bytes it takes.
    pub bytes: usize,
}

impl Inspection {
    /// Looks into a map file.
    ///
    /// # Errors
    /// A file that cannot be read or is no map.
    pub fn of_file(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(common::Error::io(path))?;
        let (map, layout) = decode_with_layout(&bytes).map_err(common::Error::in_file(path))?;
        let road_m = road_length_m(&map);
        let (build, build_fault) = match read_beside(path, &bytes) {
            Ok(beside) => (beside.own, beside.note),
            Err(error) => (None, Some(error.to_string())),
        };
        Ok(Self {
            frame_note: map.frame_note,
            version: layout.version,
            quantum_m: layout.quantum_m,
            bytes: bytes.len(),
            bounds_m: layout.bounds.map(|b| [b.min_map.into(), b.max_map.into()]),
            road_m,
            bytes_per_km: (road_m > 0.0).then(|| bytes.len() as f64 / road_m * 1000.0),
            sections: layout.sections.into_iter().map(Section::from).collect(),
            build,
            build_fault,
        })
    }

    /// The inspection as lines of text.
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{}, format version {}, quantum {} m", self.frame_note, self.version, self.quantum_m);
        if let Some([min, max]) = self.bounds_m {
            let _ = write!(out, "bounds, metres:");
            for (axis, name) in ["x right", "y down", "z forward"].iter().enumerate() {
                let comma = if axis > 0 { "," } else { "" };
                let _ = write!(out, "{comma} {name} {:.2} to {:.2}", min[axis], max[axis]);
            }
            out.push('\n');
        }
        let _ = write!(out, "{:.1} m of road", self.road_m);
        if let Some(bytes) = self.bytes_per_km {
            let _ = write!(out, ", {bytes:.0} bytes per km");
        }
        let _ = writeln!(out, "\n\n{:<14}{:>6}{:>8}", "section", "items", "bytes");
        for section in &self.sections {
            let _ = writeln!(out, "{:<14}{:>6}{:>8}", section.name, section.items, section.bytes);
        }
        let _ = writeln!(out, "{:<14}{:>6}{:>8}", "file", "", self.bytes);
        if let Some(build) = &self.build {
            let _ = write!(out, "\n{}", build_text(build));
        }
        if let Some(fault) = &self.build_fault {
            let _ = writeln!(out, "\n{fault}");
        }
        out
    }
}

impl From<SectionSize> for Section {
    fn from(size: SectionSize) -> Self {
        Self { name: size.name, items: size.items, bytes: size.bytes }
    }
}

/// What to say of points that their file calls withheld or noise: most files call none so.
fn noise_text(points: usize) -> String {
    if points == 0 { String::new() } else { format!(", {points} as withheld or noise") }
}

/// What a build estimated and what it gave, as lines of text.
pub fn build_text(build: &BuildReport) -> String {
    let mut out = String::new();
    let scans = &build.scans;
    let _ = writeln!(
        out,
        "{} scans stitched, frames {} to {} of {}: {} points, {} dropped as not finite, {} as no return or too far{}",
        scans.scans,
        scans.first_frame,
        scans.last_frame,
        build.frames,
        scans.points,
        scans.dropped_not_finite,
        scans.dropped_out_of_range,
        noise_text(scans.dropped_as_noise),
    );
    let r = &build.registration;
    match build.poses {
        crate::PoseSource::Given => out.push_str("poses as given\n"),
        crate::PoseSource::Refine => {
            let turned = r.misalignment_rad.map(f64::to_degrees);
            let _ = writeln!(
                out,
                "poses refined: survey axes turned by ({:.3}, {:.3}, {:.3}) deg, lidar raised by {:.3} deg,\n\
                 positions moved by {:.3} m rms, {:.3} m at most; scan surfaces lie {:.3} m rms apart (given poses: {:.3} m)",
                turned[0],
                turned[1],
                turned[2],
                r.vertical_angle_rad.to_degrees(),
                r.moved_rms_m,
                r.moved_max_m,
                r.rms_refined_m,
                r.rms_given_m,
            );
            let given_sigma_m = build.setting("/refine/graph/survey_sigma_m");
            if let Some(given_sigma_m) = given_sigma_m.filter(|given_sigma_m| r.survey_sigma_m > *given_sigma_m) {
                let _ = writeln!(
                    out,
                    "the survey contradicts the scans: its positions count as accurate to {:.2} m, not {given_sigma_m:.2} m",
                    r.survey_sigma_m,
                );
            }
            if r.survey_doubted_frames > 0 {
                let _ = writeln!(
                    out,
                    "around {} of the stitched frames the survey's motion contradicts the scans: \
                     there it counts as up to {:.0} times less accurate",
                    r.survey_doubted_frames, r.survey_doubt_most,
                );
            }
            let seen = &r.revisits;
            if seen.places > 0 {
                let _ = writeln!(
                    out,
                    "{} places seen again, {} of them tie the passes: {:.3} m rms apart there, untied {:.3} m",
                    seen.places, seen.kept, seen.apart_after_m, seen.apart_before_m,
                );
            }
        }
    }
    for line in jumps_text(&build.survey_jumps) {
        let _ = writeln!(out, "{line}");
    }
    out
}

/// Length of all roads of a map, metres.
pub fn road_length_m(map: &SemanticMap) -> f64 {
    let steps_m = map.roads.iter().flat_map(|road| road.path_map.windows(2)).map(|pair| (pair[1] - pair[0]).norm());
    // From 0 on: `sum` of nothing is -0, and printed so.
    steps_m.fold(0.0, |sum_m, step_m| sum_m + step_m)
}

/// How many landmarks a map has, as in "2 lamp posts, 1 traffic sign".
pub fn count_text(map: &SemanticMap) -> String {
    let poles = PoleKind::ALL.map(|kind| (kind.name(), map.poles.iter().filter(|p| p.kind == kind).count()));
    let signs = SignKind::ALL.map(|kind| (kind.name(), map.signs.iter().filter(|s| s.kind == kind).count()));
    let lanes = LaneKind::ALL.map(|kind| (kind.name(), map.lanes.iter().filter(|l| l.kind == kind).count()));
    let counted: Vec<String> = poles
        .into_iter()
        .chain(signs)
        .chain(lanes)
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| format!("{count} {}{}", name.replace('-', " "), if count == 1 { "" } else { "s" }))
        .collect();
    if counted.is_empty() { "no landmarks".into() } else { counted.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::map::{EncodeOptions, Pole, Road, RoadId};
    use nalgebra::Point3;

    fn map() -> SemanticMap {
        let pole = |z: f64| Pole {
            kind: PoleKind::LampPost,
            foot_map: Point3::new(4.0, 1.6, z),
            top_map: Point3::new(4.0, -3.4, z),
            road: RoadId(0),
        };
        SemanticMap {
            frame_note: "kitti 04".into(),
            roads: vec![Road { path_map: vec![Point3::origin(), Point3::new(0.0, 0.0, 50.0)] }],
            poles: vec![pole(10.0), pole(30.0)],
            ..SemanticMap::default()
        }
    }

    #[test]
    fn the_sections_add_up_to_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csm");
        let bytes = common::map::write(&path, &map(), &EncodeOptions::default()).unwrap();
        let inspection = Inspection::of_file(&path).unwrap();
        assert_eq!(inspection.bytes, bytes);
        assert_eq!(inspection.sections.iter().map(|s| s.bytes).sum::<usize>(), bytes);
        assert_eq!(inspection.sections.iter().find(|s| s.name == "lamp-post").unwrap().items, 2);
        assert!((inspection.bytes_per_km.unwrap() - bytes as f64 * 20.0).abs() < 1e-9);
        assert_eq!(inspection.bounds_m, Some([[0.0, -3.4, 0.0], [4.0, 1.6, 50.0]]));
        let text = inspection.text();
        assert!(text.contains("50.0 m of road") && text.contains("lamp-post"), "{text}");
    }

    #[test]
    fn a_faulty_report_does_not_hide_the_map() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csm");
        common::map::write(&path, &map(), &EncodeOptions::default()).unwrap();
        std::fs::write(crate::report::path_beside(&path), "{}").unwrap();
        let text = Inspection::of_file(&path).unwrap().text();
        assert!(text.contains("lamp-post") && text.contains("a.build.json"), "{text}");
    }

    #[test]
    fn an_empty_map_can_be_looked_at() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csm");
        common::map::write(&path, &SemanticMap::default(), &EncodeOptions::default()).unwrap();
        let inspection = Inspection::of_file(&path).unwrap();
        assert_eq!((inspection.bounds_m, inspection.bytes_per_km), (None, None));
        let text = inspection.text();
        assert!(text.contains("0.0 m of road\n") && !text.contains("-0.0"), "{text}");
    }

    #[test]
    fn landmarks_are_counted_in_words() {
        assert_eq!(count_text(&map()), "2 lamp posts");
        assert_eq!(count_text(&SemanticMap::default()), "no landmarks");
    }
}
