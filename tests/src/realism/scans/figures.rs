//! The figures of a drive and the table of two.

use std::fmt::Write as _;

use super::landmarks::Seen;
use super::patches::Patch;
use super::view::View;

/// Ends of the range bins, metres.
const RANGE_M: [f64; 9] = [0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0];
/// Ends of the height bins, metres above the ground.
const HEIGHT_M: [f64; 8] = [-5.0, -0.15, 0.15, 0.5, 1.0, 2.0, 4.0, 20.0];
/// Rings that are counted together.
const RINGS_TOGETHER: usize = 8;
/// Farthest apart of neighbours in a ring for the noise, radians: one and a half
/// steps.
const NEIGHBOUR_RAD: f64 = 0.0045;

/// Rows farther apart than this share of the real value are marked.
const WITHIN: f64 = 0.25;
/// The mark.
const BEYOND: &str = "beyond 25 %";
/// Shares below this in both drives are not marked.
const RARE: f64 = 0.01;

/// A list of values for each bin of range.
type Binned = [Vec<f64>; RANGE_M.len() - 1];

/// All that is counted in the scans of a drive.
#[derive(Debug, Default)]
pub struct Figures {
    scans: usize,
    points: usize,
    ground: usize,
    above_sensor: usize,
    range: [usize; RANGE_M.len() - 1],
    height: [usize; HEIGHT_M.len() - 1],
    zero: [usize; RANGE_M.len() - 1],
    rings: [usize; 64 / RINGS_TOGETHER],
    ring_noise_m: Binned,
    ground_reflectance: Binned,
    leaf_reflectance: Binned,
    any_reflectance: Binned,
    wall_m: Vec<f64>,
    leaves: usize,
    solids: usize,
    posts: Binned,
    paint: Binned,
    asphalt: Binned,
}

fn bin(value: f64, ends: &[f64]) -> Option<usize> {
    (value >= ends[0] && value < ends[ends.len() - 1]).then(|| ends.partition_point(|end| *end <= value) - 1)
}

/// The value below which a share of `values` lies; none of fewer than 20.
fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    (sorted.len() >= 20).then(|| sorted[((sorted.len() - 1) as f64 * share).round() as usize])
}

fn mean(values: &[f64]) -> Option<f64> {
    (values.len() >= 20).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

impl Figures {
    /// Adds a scan.
    pub fn add(&mut self, view: &View, seen: &Seen) {
        self.scans += 1;
        self.points += view.points.len();
        for i in 0..view.points.len() {
            self.add_point(view, i);
        }
        for (ring, members) in view.each_ring().enumerate() {
            let group = (ring / RINGS_TOGETHER).min(self.rings.len() - 1);
            self.rings[group] += members.len();
            self.add_noise(view, members);
        }
        for patch in view.patches.all() {
            match patch {
                Patch::Wall(across_m) => self.wall_m.push(across_m),
                Patch::Leaves => self.leaves += 1,
                Patch::Other => {}
            }
            self.solids += 1;
        }
        for (found, bins) in
            [(&seen.posts, &mut self.posts), (&seen.paint, &mut self.paint), (&seen.asphalt, &mut self.asphalt)]
        {
            for (distance_m, value) in found {
                if let Some(i) = bin(*distance_m, &RANGE_M) {
                    bins[i].push(*value);
                }
            }
        }
    }

    fn add_point(&mut self, view: &View, i: usize) {
        self.ground += usize::from(view.is_ground(i));
        self.above_sensor += usize::from(view.points[i].z > 0.0);
        if let Some(k) = bin(view.height_m[i], &HEIGHT_M) {
            self.height[k] += 1;
        }
        let Some(k) = bin(view.range_m[i], &RANGE_M) else { return };
        self.range[k] += 1;
        let reflectance = view.reflectance[i];
        if reflectance <= 0.0 {
            self.zero[k] += 1;
            return;
        }
        self.any_reflectance[k].push(reflectance);
        if view.is_ground(i) {
            self.ground_reflectance[k].push(reflectance);
        } else if view.patches.of(&view.points[i]) == Some(Patch::Leaves) {
            self.leaf_reflectance[k].push(reflectance);
        }
    }

    /// Second differences of the range along a ring on the ground: what is left
    /// of a smooth surface is noise.
    fn add_noise(&mut self, view: &View, ring: std::ops::Range<usize>) {
        let azimuth = |i: usize| view.points[i].y.atan2(view.points[i].x);
        for i in ring.start + 1..ring.end.saturating_sub(1) {
            if !(i - 1..=i + 1).all(|j| view.is_ground(j)) {
                continue;
            }
            let (before, after) = (azimuth(i) - azimuth(i - 1), azimuth(i + 1) - azimuth(i));
            if before.abs() < NEIGHBOUR_RAD && after.abs() < NEIGHBOUR_RAD {
                let bend_m = view.range_m[i - 1] - 2.0 * view.range_m[i] + view.range_m[i + 1];
                if let Some(k) = bin(view.range_m[i], &RANGE_M) {
                    // Of three equal noises the second difference has six times
                    // the variance.
                    self.ring_noise_m[k].push(bend_m.abs() / 6.0_f64.sqrt());
                }
            }
        }
    }

    /// Each figure; none where there is too little to measure.
    fn rows(&self) -> Vec<Row> {
        let mut rows = self.places();
        rows.extend(self.landmarks());
        rows.extend(self.surfaces());
        rows.extend(self.reflectances());
        rows
    }

    /// Where the points are.
    fn places(&self) -> Vec<Row> {
        let mut rows = vec![
            row(Source::Both, "points per scan", share(self.points, self.scans)),
            row(Source::World, "share of ground", share(self.ground, self.points)),
            row(Source::World, "share above the sensor", share(self.above_sensor, self.points)),
        ];
        for (name, count) in names(&RANGE_M, "m").iter().zip(self.range) {
            rows.push(row(Source::World, format!("share at {name}"), share(count, self.points)));
        }
        for (name, count) in names(&HEIGHT_M, "m above the ground").iter().zip(self.height) {
            rows.push(row(Source::World, format!("share {name}"), share(count, self.points)));
        }
        for (group, count) in self.rings.iter().enumerate() {
            let first = group * RINGS_TOGETHER;
            let name = format!("points per ring, rings {first} to {}", first + RINGS_TOGETHER - 1);
            // Below, all rays meet the road or the car; above, the sky is open or not.
            let source = if group < 2 { Source::World } else { Source::Sensor };
            rows.push(row(source, name, share(*count, self.scans * RINGS_TOGETHER)));
        }
        rows
    }

    /// Posts and paint.
    fn landmarks(&self) -> Vec<Row> {
        let ranges = names(&RANGE_M, "m");
        let posts = ranges.iter().zip(&self.posts).skip(1).take(5).map(|(name, points)| {
            row(Source::Both, format!("points per metre of a post at {name}"), quantile(points, 0.5))
        });
        let contrast = |i: usize| Some(mean(&self.paint[i])? - mean(&self.asphalt[i])?);
        let paint =
            (1..5).map(|i| row(Source::Sensor, format!("paint brighter than asphalt at {}", ranges[i]), contrast(i)));
        posts.chain(paint).collect()
    }

    /// Walls, leaves, and the noise on the ground.
    fn surfaces(&self) -> Vec<Row> {
        let mut rows: Vec<Row> = [("p5", 0.05), ("median", 0.5), ("p95", 0.95)]
            .map(|(name, part)| {
                row(Source::Both, format!("wall, spread across, {name} (m)"), quantile(&self.wall_m, part))
            })
            .into();
        rows.push(row(Source::World, "share of cells that are wall", share(self.wall_m.len(), self.solids)));
        rows.push(row(Source::World, "share of cells that are leaves", share(self.leaves, self.solids)));
        for (name, noise_m) in names(&RANGE_M, "m").iter().zip(&self.ring_noise_m).skip(1).take(4) {
            // A median of absolute values is 0.6745 standard deviations.
            let noise_m = quantile(noise_m, 0.5).map(|noise| noise / 0.6745);
            rows.push(row(Source::Sensor, format!("noise along a ring on the ground at {name} (m)"), noise_m));
        }
        rows
    }

    /// What is reported of surfaces.
    fn reflectances(&self) -> Vec<Row> {
        let ranges = names(&RANGE_M, "m");
        let mut rows: Vec<Row> = (0..7)
            .map(|i| {
                let name = format!("share without reflectance at {}", ranges[i]);
                row(Source::Sensor, name, share(self.zero[i], self.range[i]))
            })
            .collect();
        for (what, bins, count) in [
            ("ground", &self.ground_reflectance, 6),
            ("leaves", &self.leaf_reflectance, 4),
            ("all", &self.any_reflectance, 6),
        ] {
            for (name, values) in ranges.iter().zip(bins).skip(1).take(count) {
                rows.push(row(Source::Sensor, format!("reflectance of {what} at {name}"), quantile(values, 0.5)));
            }
        }
        rows
    }
}

/// What decides a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// The lidar and its materials.
    Sensor,
    /// What stands beside the road.
    World,
    /// Both.
    Both,
}

/// One line of the table.
struct Row {
    source: Source,
    name: String,
    value: Option<f64>,
}

fn row(source: Source, name: impl Into<String>, value: Option<f64>) -> Row {
    Row { source, name: name.into(), value }
}

fn share(count: usize, of: usize) -> Option<f64> {
    (of > 0).then(|| count as f64 / of as f64)
}

fn names(ends: &[f64], unit: &str) -> Vec<String> {
    ends.windows(2).map(|e| format!("{} to {} {unit}", e[0], e[1])).collect()
}

/// Both drives side by side, in Markdown.
pub fn table(real: &Figures, made: &Figures) -> String {
    let mut text =
        format!("| {} real scans, {} generated | decided by | real | generated | ratio | |\n", real.scans, made.scans);
    text.push_str("|---|---|---:|---:|---:|---|\n");
    let mut beyond = 0;
    let (real, made) = (real.rows(), made.rows());
    for (real, made) in real.iter().zip(&made) {
        let ratio = real.value.zip(made.value).map(|(real, made)| made / real);
        let remark = remark(&real.name, real.value, made.value);
        beyond += usize::from(remark == BEYOND);
        let source = match real.source {
            Source::Sensor => "sensor",
            Source::World => "world",
            Source::Both => "both",
        };
        let (left, right) = (number(real.value), number(made.value));
        let ratio = ratio.map_or_else(|| "-".into(), |ratio| format!("{ratio:.2}"));
        // Writing to a string does not fail.
        let _ = writeln!(text, "| {} | {source} | {left} | {right} | {ratio} | {remark} |", real.name);
    }
    let _ = writeln!(text, "\n{beyond} of {} rows beyond {:.0} %", real.len(), 100.0 * WITHIN);
    text
}

/// What the last column says of a row.
fn remark(name: &str, real: Option<f64>, made: Option<f64>) -> &'static str {
    match real.zip(made) {
        None if real.is_none() && made.is_none() => "in neither",
        None => "in one only",
        // What is rare in both drives is a few points in each.
        Some((real, made)) if name.starts_with("share") && real.max(made) < RARE => "rare",
        Some((real, made)) if (made / real - 1.0).abs() > WITHIN => BEYOND,
        Some(_) => "",
    }
}

fn number(value: Option<f64>) -> String {
    match value {
        None => "-".into(),
        Some(value) if value.abs() >= 100.0 => format!("{value:.0}"),
        Some(value) if value.abs() >= 1.0 => format!("{value:.2}"),
        Some(value) => format!("{value:.4}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_far_apart_is_marked_and_what_is_rare_is_not() {
        assert_eq!(remark("points per scan", Some(100.0), Some(124.0)), "");
        assert_eq!(remark("points per scan", Some(100.0), Some(126.0)), BEYOND);
        assert_eq!(remark("points per scan", Some(100.0), Some(74.0)), BEYOND);
        assert_eq!(remark("share at 60 to 80 m", Some(0.001), Some(0.005)), "rare");
        assert_eq!(remark("points per scan", Some(1.0), None), "in one only");
        assert_eq!(remark("points per scan", None, None), "in neither");
    }

    #[test]
    fn bins_hold_their_lower_end() {
        assert_eq!(bin(5.0, &RANGE_M), Some(1));
        assert_eq!((bin(80.0, &RANGE_M), bin(-1.0, &RANGE_M)), (None, None));
    }

    #[test]
    fn a_drive_beside_itself_has_no_row_beyond() {
        let text = table(&Figures::default(), &Figures::default());
        assert!(
            text.contains("\n0 of ") && text.lines().nth(2).is_some_and(|line| line.contains("in neither")),
            "{text}"
        );
    }
}
