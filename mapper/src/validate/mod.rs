//! What a careful reader of a map would ask about.
//!
//! A map file that decodes is well formed; whether it makes sense is another
//! question. Nothing here is wrong by itself beyond doubt: every finding names
//! the landmark, its place and the measure, so that one can go and look.

mod doubles;
mod lines;
mod points;
#[cfg(test)]
mod tests;

use std::fmt::Write as _;

use common::config::{Limits, range};
use common::map::SemanticMap;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// What the numbers of [`ValidateConfig`] may be.
pub const LIMITS: &[Limits] = &[range("sign_sizes_m", 0.0, 1000.0)];

/// From where on something is worth a question.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ValidateConfig {
    /// Shortest pole, metres: less is no direction.
    pub shortest_pole_m: f64,
    /// Tallest pole, metres: floodlights of junctions.
    pub tallest_pole_m: f64,
    /// Largest lean of a pole, radians.
    pub largest_lean_rad: f64,
    /// Smallest and largest sign, metres: a house number, a gantry.
    pub sign_sizes_m: [f64; 2],
    /// How far above the path of the camera a landmark may reach, metres.
    pub highest_m: f64,
    /// How far below it, metres: an embankment.
    pub lowest_m: f64,
    /// Farthest landmark from the path of its road, metres: farther ones no
    /// localizer looks for.
    pub off_road_m: f64,
    /// How much nearer another road may be than a landmark's own, metres.
    pub wrong_road_m: f64,
    /// Two poles nearer to each other than this are one, metres.
    pub same_pole_m: f64,
    /// Two signs of one kind nearer to each other than this are one, metres.
    pub same_sign_m: f64,
    /// Two lane lines nearer to each other than this are one, metres: double
    /// lines are farther apart.
    pub same_line_m: f64,
    /// From this length on, metres.
    pub same_line_length_m: f64,
    /// Shortest lane line, metres: less than a dash.
    pub shortest_line_m: f64,
    /// Largest turn at a vertex of a lane line or a path, radians: nothing that
    /// is driven along turns at a right angle at once.
    pub largest_turn_rad: f64,
    /// Steepest lane line or path, radians: a third more than the steepest
    /// street.
    pub steepest_rad: f64,
    /// Longest step between two vertices of a path, metres: roads are cut far
    /// shorter.
    pub longest_step_m: f64,
}

impl Default for ValidateConfig {
    fn default() -> Self {
        Self {
            shortest_pole_m: 0.2,
            tallest_pole_m: 25.0,
            largest_lean_rad: 0.35,
            sign_sizes_m: [0.1, 8.0],
            highest_m: 25.0,
            lowest_m: 10.0,
            off_road_m: 60.0,
            wrong_road_m: 20.0,
            same_pole_m: 0.25,
            same_sign_m: 0.15,
            same_line_m: 0.1,
            same_line_length_m: 3.0,
            shortest_line_m: 0.5,
            largest_turn_rad: 1.5,
            steepest_rad: 0.45,
            longest_step_m: 200.0,
        }
    }
}

/// What is asked about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// A pole, line or road without length, or a sign without size.
    NoLength,
    /// A height or size that nothing on a road has.
    AbsurdSize,
    /// A pole that leans as none that stands.
    Lean,
    /// Farther from its road than anyone looks.
    OffRoad,
    /// On a road though another is much nearer.
    WrongRoad,
    /// Twice at one place.
    Duplicate,
    /// A line or path that turns back at a vertex.
    FoldsBack,
    /// A line that crosses itself.
    CrossesItself,
    /// A line or path steeper than a street.
    Steep,
    /// A path with a step that no frame makes.
    Jump,
}

/// One finding.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What is asked about.
    pub fault: Fault,
    /// The landmark: its kind and its place among all of its kind in the file,
    /// from 0.
    pub landmark: String,
    /// Where it is, map frame, metres.
    pub at_map_m: [f64; 3],
    /// What about it, with its measure.
    pub what: String,
}

/// Findings, by fault and in the order of the map.
#[derive(Debug, Default)]
struct Findings(Vec<Finding>);

impl Findings {
    fn add(&mut self, fault: Fault, landmark: &str, at: &Point3<f64>, what: String) {
        self.0.push(Finding { fault, landmark: landmark.to_owned(), at_map_m: (*at).into(), what });
    }
}

/// Everything in a map that is worth a question.
pub fn validate(map: &SemanticMap, config: &ValidateConfig) -> Vec<Finding> {
    let mut findings = Findings::default();
    points::check(map, config, &mut findings);
    lines::check(map, config, &mut findings);
    doubles::check(map, config, &mut findings);
    findings.0.sort_by_key(|finding| finding.fault);
    findings.0
}

/// One line for each finding, and one with their number.
pub fn text(findings: &[Finding]) -> String {
    let mut out = String::new();
    for Finding { landmark, at_map_m: [x, y, z], what, .. } in findings {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{landmark:<18} x {x:9.2}  y {y:7.2}  z {z:9.2}  {what}");
    }
    let _ = match findings.len() {
        0 => writeln!(out, "nothing found"),
        1 => writeln!(out, "1 finding"),
        count => writeln!(out, "{count} findings"),
    };
    out
}

/// Names landmarks by kind and their place among all of their kind.
struct Names(Vec<(&'static str, usize)>);

impl Names {
    fn next(&mut self, kind: &'static str) -> String {
        if let Some(known) = self.0.iter_mut().find(|known| known.0 == kind) {
            known.1 += 1;
            return format!("{kind} {}", known.1);
        }
        self.0.push((kind, 0));
        format!("{kind} 0")
    }
}
