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

    /// Each figure with its name; none where there is too little to measure.
    fn rows(&self) -> Vec<(String, Option<f64>)> {
        let share = |count: usize, of: usize| (of > 0).then(|| count as f64 / of as f64);
        let mut rows = vec![
            ("points per scan".into(), share(self.points, self.scans)),
            ("share of ground".into(), share(self.ground, self.points)),
            ("share above the sensor".into(), share(self.above_sensor, self.points)),
        ];
        let names = |ends: &[f64], unit: &str| -> Vec<String> {
            ends.windows(2).map(|e| format!("{} to {} {unit}", e[0], e[1])).collect()
        };
        let ranges = names(&RANGE_M, "m");
        for (name, count) in ranges.iter().zip(self.range) {
            rows.push((format!("share at {name}"), share(count, self.points)));
        }
        for (name, count) in names(&HEIGHT_M, "m above the ground").iter().zip(self.height) {
            rows.push((format!("share {name}"), share(count, self.points)));
        }
        for (group, count) in self.rings.iter().enumerate() {
            let first = group * RINGS_TOGETHER;
            let name = format!("points per ring, rings {first} to {}", first + RINGS_TOGETHER - 1);
            rows.push((name, share(*count, self.scans * RINGS_TOGETHER)));
        }
        for (i, name) in ranges.iter().enumerate().skip(1).take(5) {
            rows.push((format!("points per metre of a post at {name}"), quantile(&self.posts[i], 0.5)));
        }
        for (i, name) in ranges.iter().enumerate().skip(1).take(4) {
            let contrast = mean(&self.paint[i]).zip(mean(&self.asphalt[i])).map(|(paint, asphalt)| paint - asphalt);
            rows.push((format!("paint brighter than asphalt at {name}"), contrast));
        }
        rows.push(("wall, spread across, p5 (m)".into(), quantile(&self.wall_m, 0.05)));
        rows.push(("wall, spread across, median (m)".into(), quantile(&self.wall_m, 0.5)));
        rows.push(("wall, spread across, p95 (m)".into(), quantile(&self.wall_m, 0.95)));
        rows.push(("share of cells that are wall".into(), share(self.wall_m.len(), self.solids)));
        rows.push(("share of cells that are leaves".into(), share(self.leaves, self.solids)));
        for (i, name) in ranges.iter().enumerate().skip(1).take(4) {
            // A median of absolute values is 0.6745 standard deviations.
            let noise = quantile(&self.ring_noise_m[i], 0.5).map(|noise| noise / 0.6745);
            rows.push((format!("noise along a ring on the ground at {name} (m)"), noise));
        }
        for (i, name) in ranges.iter().enumerate().take(7) {
            rows.push((format!("share without reflectance at {name}"), share(self.zero[i], self.range[i])));
        }
        for (what, bins, count) in [
            ("ground", &self.ground_reflectance, 6),
            ("leaves", &self.leaf_reflectance, 4),
            ("all", &self.any_reflectance, 6),
        ] {
            for (i, name) in ranges.iter().enumerate().skip(1).take(count) {
                rows.push((format!("reflectance of {what} at {name}"), quantile(&bins[i], 0.5)));
            }
        }
        rows
    }
}

/// Both drives side by side, in Markdown.
pub fn table(real: &Figures, made: &Figures) -> String {
    let mut text = format!("| {} real scans, {} generated | real | generated | ratio | |\n", real.scans, made.scans);
    text.push_str("|---|---:|---:|---:|---|\n");
    let mut beyond = 0;
    let rows: Vec<_> = real.rows().into_iter().zip(made.rows()).collect();
    for ((name, real), (_, made)) in &rows {
        let ratio = real.zip(*made).map(|(real, made)| made / real);
        let far = ratio.is_none_or(|ratio| (ratio - 1.0).abs() > 0.25);
        let absent = real.is_none() && made.is_none();
        // What is rare in both drives is a few points in each.
        let rare = name.contains("share") && real.zip(*made).is_some_and(|(real, made)| real.max(made) < 0.01);
        let remark = if rare {
            "rare"
        } else if absent {
            "in neither"
        } else if far {
            "beyond 25 %"
        } else {
            ""
        };
        beyond += usize::from(far && !rare && !absent);
        let ratio = ratio.map_or_else(|| "-".into(), |ratio| format!("{ratio:.2}"));
        // Writing to a string does not fail.
        let _ = writeln!(text, "| {name} | {} | {} | {ratio} | {remark} |", number(*real), number(*made));
    }
    let _ = writeln!(text, "\n{beyond} of {} rows beyond 25 %", rows.len());
    text
}

fn number(value: Option<f64>) -> String {
    match value {
        None => "-".into(),
        Some(value) if value.abs() >= 100.0 => format!("{value:.0}"),
        Some(value) if value.abs() >= 1.0 => format!("{value:.2}"),
        Some(value) => format!("{value:.4}"),
    }
}
