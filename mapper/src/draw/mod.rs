//! A picture of a map from above, as SVG.

mod marks;
mod view;

use std::fmt::Write as _;

use common::map::{LaneKind, LaneLine, MapLayout, PoleKind, SemanticMap, SignKind};
use nalgebra::{Point2, Vector2};

use marks::{MARK_STROKE, lane_stroke, legend, legend_entries, pole_mark, sign_mark};
use view::View;

/// Width of the picture, pixels: that of a page on GitHub.
const WIDTH_PX: f64 = 960.0;
/// Space around everything, pixels.
const MARGIN_PX: f64 = 24.0;
/// Height of the title's line, pixels.
const TITLE_PX: f64 = 44.0;
/// Height of a line of the legend, pixels.
const LEGEND_LINE_PX: f64 = 26.0;
/// Width of an entry of the legend, pixels.
const LEGEND_ENTRY_PX: f64 = 228.0;
/// Width of the driven path, metres: that of a car.
const CAR_M: f64 = 1.8;

/// Colours for light pages, then for dark ones. The picture brings its own
/// background, for a page's theme and a viewer's may differ.
const STYLE: &str = "\
.card{fill:#fff;stroke:#d1d9e0}.text{fill:#1f2328}.soft{fill:#59636e}.line{stroke:#59636e}\
.road{stroke:#818b98}.solid-line,.dashed-line,.kerb{stroke:#1f2328}.lamp-post{fill:#bf8700}.sign-post{fill:#0969da}\
.delineator{fill:#8250df}.trunk{fill:#1a7f37}.traffic-sign{fill:#cf222e}.traffic-light{fill:#bc4c00}\
@media(prefers-color-scheme:dark){\
.card{fill:#0d1117;stroke:#3d444d}.text{fill:#f0f6fc}.soft{fill:#9198a1}.line{stroke:#9198a1}\
.road{stroke:#9198a1}.solid-line,.dashed-line,.kerb{stroke:#f0f6fc}.lamp-post{fill:#e3b341}.sign-post{fill:#4493f8}\
.delineator{fill:#ab7df8}.trunk{fill:#3fb950}.traffic-sign{fill:#f85149}.traffic-light{fill:#f0883e}}";

/// Draws a map from above, the drive running from left to right, with a
/// legend of what it holds in how many bytes. The same map gives the same
/// bytes.
pub fn svg(map: &SemanticMap, layout: &MapLayout) -> String {
    let view = View::of(map);
    let entries = legend_entries(layout);
    let per_line = ((WIDTH_PX - 2.0 * MARGIN_PX) / LEGEND_ENTRY_PX) as usize;
    let legend_px = entries.len().div_ceil(per_line) as f64 * LEGEND_LINE_PX;
    let height = 2.0 * MARGIN_PX + TITLE_PX + view.height_px + MARGIN_PX + legend_px;

    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH_PX} {height:.0}\" font-family=\"ui-sans-serif,system-ui,Helvetica,Arial,sans-serif\" font-size=\"14\">\n\
         <title>{}: {} bytes</title>\n<style>{STYLE}</style>\n\
         <rect class=\"card\" x=\".5\" y=\".5\" width=\"{}\" height=\"{:.0}\" rx=\"8\"/>\n",
        escaped(&map.frame_note),
        layout.total_bytes(),
        WIDTH_PX - 1.0,
        height - 1.0,
    );
    title(&mut out, map, layout, &view);
    roads(&mut out, map, &view);
    lanes(&mut out, map, &view);
    points(&mut out, map, &view);
    let top = MARGIN_PX + TITLE_PX + view.height_px + MARGIN_PX + LEGEND_LINE_PX / 2.0;
    for (i, entry) in entries.iter().enumerate() {
        let (column, line) = (i % per_line, i / per_line);
        let at = Point2::new(MARGIN_PX + 12.0 + column as f64 * LEGEND_ENTRY_PX, top + line as f64 * LEGEND_LINE_PX);
        legend(&mut out, entry, &at);
    }
    out.push_str("</svg>\n");
    out
}

fn title(out: &mut String, map: &SemanticMap, layout: &MapLayout, view: &View) {
    let baseline = MARGIN_PX + 18.0;
    let road_m = crate::inspect::road_length_m(map);
    let _ = writeln!(
        out,
        "<text x=\"{MARGIN_PX}\" y=\"{baseline}\" class=\"text\"><tspan font-size=\"20\" font-weight=\"600\">{} bytes</tspan>\
         <tspan dx=\"10\" class=\"soft\">{}, {road_m:.0} m driven</tspan></text>",
        layout.total_bytes(),
        escaped(&map.frame_note),
    );
    let bar_m = bar_length_m(view.px_per_m);
    let (end, y) = (WIDTH_PX - MARGIN_PX, baseline - 5.0);
    let start = end - bar_m * view.px_per_m;
    let _ = writeln!(
        out,
        "<path class=\"line\" stroke-width=\"1.5\" fill=\"none\" d=\"M{start:.1} {a:.1}v6H{end:.1}v-6\"/>\
         <text class=\"soft\" text-anchor=\"end\" x=\"{:.1}\" y=\"{baseline}\">{bar_m} m</text>",
        start - 8.0,
        a = y - 3.0,
    );
}

/// A length of 1, 2 or 5 times a power of ten that takes 60 to 150 pixels.
fn bar_length_m(px_per_m: f64) -> f64 {
    let longest = 150.0 / px_per_m;
    let power = 10_f64.powf(longest.log10().floor());
    [5.0, 2.0].into_iter().map(|k| k * power).find(|m| *m <= longest).unwrap_or(power)
}

fn roads(out: &mut String, map: &SemanticMap, view: &View) {
    let width = (CAR_M * view.px_per_m).max(2.0);
    let _ = write!(
        out,
        "<g class=\"road\" fill=\"none\" stroke-width=\"{width:.1}\" stroke-opacity=\".25\" stroke-linejoin=\"round\">"
    );
    let mut driven = map.roads.iter().filter(|road| road.path_map.len() > 1);
    for road in driven.clone() {
        let _ = write!(out, "<path d=\"{}\"/>", view.path(&road.path_map));
    }
    out.push_str("</g>\n");
    if let Some([.., before, end]) = driven.next_back().map(|road| road.path_map.as_slice()) {
        arrow(out, &view.at(before), &view.at(end), width.max(8.0));
    }
}

/// The head of an arrow at the end of the drive.
fn arrow(out: &mut String, before: &Point2<f64>, end: &Point2<f64>, width: f64) {
    let Some(along) = (end - before).try_normalize(1e-6) else { return };
    let across = Vector2::new(-along.y, along.x) * (width / 2.0);
    let (left, right, tip) = (end - across, end + across, end + along * width);
    let _ = writeln!(
        out,
        "<path class=\"soft\" fill-opacity=\".45\" d=\"M{:.1} {:.1}L{:.1} {:.1}L{:.1} {:.1}z\"/>",
        left.x, left.y, tip.x, tip.y, right.x, right.y
    );
}

fn lanes(out: &mut String, map: &SemanticMap, view: &View) {
    for kind in LaneKind::ALL {
        let _ = write!(out, "<g class=\"{}\" {}>", kind.name(), lane_stroke(kind));
        for lane in map.lanes.iter().filter(|lane| lane.kind == kind) {
            let _ = write!(out, "<path d=\"{}\"/>", view.path(&lane.points_map));
        }
        out.push_str("</g>\n");
    }
    let mut marks = map.lanes.iter().flat_map(LaneLine::marks_map).peekable();
    if marks.peek().is_some() {
        let _ = write!(out, "<g class=\"{}\" {MARK_STROKE}>", LaneKind::Dashed.name());
        for mark in marks {
            let _ = write!(out, "<path d=\"{}\"/>", view.path(&mark));
        }
        out.push_str("</g>\n");
    }
}

fn points(out: &mut String, map: &SemanticMap, view: &View) {
    let size = view.mark_px();
    for kind in SignKind::ALL {
        let marks = map.signs.iter().filter(|s| s.kind == kind).map(|s| view.at(&s.centroid_map));
        group(out, kind.name(), marks.map(|at| sign_mark(kind, &at, size)));
    }
    for kind in PoleKind::ALL {
        let marks = map.poles.iter().filter(|p| p.kind == kind).map(|p| view.at(&p.foot_map));
        group(out, kind.name(), marks.map(|at| pole_mark(kind, &at, size)));
    }
}

fn group(out: &mut String, class: &str, marks: impl Iterator<Item = String>) {
    let mut marks = marks.peekable();
    if marks.peek().is_some() {
        let _ = write!(out, "<g class=\"{class}\">");
        out.extend(marks);
        out.push_str("</g>\n");
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use common::map::{EncodeOptions, Pole, Road, RoadId, Sign, layout};
    use nalgebra::{Point3, Vector3};

    fn picture(map: &SemanticMap) -> String {
        let bytes = map.encode(&EncodeOptions::default()).unwrap();
        svg(map, &layout(&bytes).unwrap())
    }

    fn street() -> SemanticMap {
        let road = RoadId(0);
        let at = |x: f64, z: f64| Point3::new(x, 1.6, z);
        SemanticMap {
            frame_note: "<made> & \"up\"".into(),
            roads: vec![Road { path_map: vec![at(0.0, 0.0), at(1.0, 50.0), at(0.0, 100.0)] }],
            poles: PoleKind::ALL
                .into_iter()
                .zip([5.0, 20.0, 40.0, 80.0])
                .map(|(kind, z)| Pole { kind, foot_map: at(6.0, z), top_map: at(6.0, z) - Vector3::y() * 3.0, road })
                .collect(),
            signs: vec![Sign { kind: SignKind::TrafficSign, centroid_map: at(-5.0, 60.0), size_m: 0.8, road }],
            lanes: vec![LaneLine {
                kind: LaneKind::Dashed,
                points_map: vec![at(-2.0, 0.0), at(-2.0, 90.0)],
                road,
                marks_m: vec![[12.0, 15.0], [24.0, 27.0]],
            }],
        }
    }

    #[test]
    fn every_landmark_is_drawn_once_and_once_in_the_legend() {
        let picture = picture(&street());
        for kind in PoleKind::ALL {
            assert_eq!(picture.matches(&format!("<g class=\"{}\">", kind.name())).count(), 2);
        }
        assert_eq!(picture.matches("<g class=\"traffic-sign\">").count(), 2);
        assert!(!picture.contains("<g class=\"traffic-light\">"));
        assert!(picture.contains("1 dashed line<") && picture.contains("stroke-dasharray"));
        // Two marks, and one in the legend.
        assert_eq!(picture.matches(MARK_STROKE).count(), 2);
        assert!(picture.contains("2 marks<"));
        assert!(picture.contains("&lt;made&gt; &amp; &quot;up&quot;") && !picture.contains("<made>"));
    }

    #[test]
    fn every_kind_has_a_colour_on_light_pages_and_on_dark_ones() {
        let kinds = PoleKind::ALL.iter().map(|kind| kind.name());
        let kinds = kinds.chain(SignKind::ALL.iter().map(|kind| kind.name()));
        for name in kinds.chain(LaneKind::ALL.iter().map(|kind| kind.name())) {
            assert_eq!(STYLE.matches(&format!(".{name}")).count(), 2, "{name}");
        }
        let mut map = street();
        map.lanes[0] = LaneLine { kind: LaneKind::Kerb, marks_m: Vec::new(), ..map.lanes[0].clone() };
        let picture = picture(&map);
        assert!(picture.contains("1 kerb<") && picture.contains("stroke-opacity=\".4\"><path"), "{picture}");
    }

    #[test]
    fn what_is_on_the_right_of_the_drive_is_below_it() {
        let map = street();
        let view = View::of(&map);
        let (start, end) = (view.at(&map.roads[0].path_map[0]), view.at(&map.roads[0].path_map[2]));
        assert!(start.x < end.x);
        assert!(view.at(&map.poles[0].foot_map).y > start.y);
        assert!(view.at(&map.signs[0].centroid_map).y < start.y);
    }

    #[test]
    fn an_empty_map_has_a_picture() {
        let picture = picture(&SemanticMap::default());
        assert!(picture.ends_with("</svg>\n") && !picture.contains("NaN") && !picture.contains("inf"));
    }
}
