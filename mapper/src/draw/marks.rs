//! What the landmarks look like, on the map and in its legend.

use std::fmt::Write as _;

use common::map::{LaneKind, MapLayout, PoleKind, SignKind};
use nalgebra::Point2;

/// Shapes differ as much as colours do, for those who see no colours.
pub fn pole_mark(kind: PoleKind, at: &Point2<f64>, size: f64) -> String {
    let square = |half: f64, turn: &str| {
        let (x, y, edge) = (at.x - half, at.y - half, 2.0 * half);
        format!("<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{edge:.1}\" height=\"{edge:.1}\"{turn}/>")
    };
    match kind {
        PoleKind::LampPost => format!("<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{size:.1}\"/>", at.x, at.y),
        PoleKind::SignPost => square(0.7 * size, ""),
        PoleKind::Delineator => square(0.6 * size, &format!(" transform=\"rotate(45 {:.1} {:.1})\"", at.x, at.y)),
        PoleKind::Trunk => {
            let a = 0.6 * size;
            let (x, y) = (at.x - a / 2.0, at.y - 1.5 * a);
            let d = format!(
                "M{x:.1} {y:.1}h{a:.1}v{a:.1}h{a:.1}v{a:.1}h-{a:.1}v{a:.1}h-{a:.1}v-{a:.1}h-{a:.1}v-{a:.1}h{a:.1}z"
            );
            format!("<path d=\"{d}\"/>")
        }
    }
}

/// A triangle.
pub fn sign_mark(kind: SignKind, at: &Point2<f64>, size: f64) -> String {
    let (half, height) = (1.25 * size, 2.1 * size);
    // Standing on its tip for a light, so that it is told from a sign.
    let up = if kind == SignKind::TrafficSign { 1.0 } else { -1.0 };
    let base = at.y + up * height / 3.0;
    format!("<path d=\"M{:.1} {base:.1}h{:.1}L{:.1} {:.1}z\"/>", at.x - half, 2.0 * half, at.x, base - up * height)
}

/// How a lane line is drawn.
pub fn lane_stroke(kind: LaneKind) -> &'static str {
    match kind {
        LaneKind::Solid => "fill=\"none\" stroke-width=\"1.2\"",
        LaneKind::Dashed => "fill=\"none\" stroke-width=\"1.2\" stroke-dasharray=\"6 5\"",
        LaneKind::Kerb => "fill=\"none\" stroke-width=\"2\" stroke-opacity=\".4\"",
    }
}

/// How a mark of a dashed line is drawn, over the line.
pub const MARK_STROKE: &str = "fill=\"none\" stroke-width=\"3\"";

/// What the legend says about one section of the file.
pub struct Entry {
    mark: Mark,
    text: String,
    bytes: usize,
}

enum Mark {
    None,
    Road,
    Pole(PoleKind),
    Sign(SignKind),
    Lane(LaneKind),
    Dash,
}

/// One entry for every section that holds something; head and checksum last.
pub fn legend_entries(layout: &MapLayout) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut frame_bytes = 0;
    for section in &layout.sections {
        let name = section.name.as_str();
        let mark = PoleKind::ALL
            .into_iter()
            .find(|k| k.name() == name)
            .map(Mark::Pole)
            .or_else(|| SignKind::ALL.into_iter().find(|k| k.name() == name).map(Mark::Sign))
            .or_else(|| LaneKind::ALL.into_iter().find(|k| k.name() == name).map(Mark::Lane))
            .or_else(|| (name == "roads").then_some(Mark::Road))
            .or_else(|| (name == "marks").then_some(Mark::Dash));
        match mark {
            Some(mark) if section.items > 0 => {
                let one = section.items == 1;
                let what = match (name, one) {
                    ("roads", true) => "stretch of road".into(),
                    ("roads", false) => "stretches of road".into(),
                    ("marks", true) => "mark".into(),
                    ("marks", false) => "marks".into(),
                    _ => name.replace('-', " ") + if one { "" } else { "s" },
                };
                let text = format!("{} {what}", section.items);
                entries.push(Entry { mark, text, bytes: section.bytes });
            }
            _ => frame_bytes += section.bytes,
        }
    }
    entries.push(Entry { mark: Mark::None, text: "header, checksum".into(), bytes: frame_bytes });
    entries
}

/// Draws an entry with its mark at a place.
pub fn legend(out: &mut String, entry: &Entry, at: &Point2<f64>) {
    let size = 5.0;
    let bar = |class: &str, stroke: &str| {
        format!("<path class=\"{class}\" {stroke} d=\"M{:.1} {:.1}h22\"/>", at.x - 11.0, at.y)
    };
    let mark = match entry.mark {
        Mark::None => String::new(),
        Mark::Road => bar("road", "stroke-width=\"8\" stroke-opacity=\".25\""),
        Mark::Lane(kind) => bar(kind.name(), lane_stroke(kind)),
        Mark::Dash => bar(LaneKind::Dashed.name(), MARK_STROKE),
        Mark::Pole(kind) => format!("<g class=\"{}\">{}</g>", kind.name(), pole_mark(kind, at, size)),
        Mark::Sign(kind) => format!("<g class=\"{}\">{}</g>", kind.name(), sign_mark(kind, at, size)),
    };
    let indent = if matches!(entry.mark, Mark::None) { -12.0 } else { 18.0 };
    let _ = writeln!(
        out,
        "{mark}<text x=\"{:.1}\" y=\"{:.1}\" class=\"text\">{}<tspan dx=\"6\" class=\"soft\">{} B</tspan></text>",
        at.x + indent,
        at.y + 5.0,
        entry.text,
        entry.bytes
    );
}
