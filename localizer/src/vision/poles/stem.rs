//! One pole in the making: a line near the vertical, and for each row the
//! measured centre.

use nalgebra::{Matrix2, Point2, Vector2};

use crate::vision::Plane;
use crate::vision::centre::{Centre, median};

/// `u = u_px + slope (v - v_px)`: a line that is no horizontal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct UprightLine {
    pub(super) u_px: f64,
    pub(super) v_px: f64,
    pub(super) slope: f64,
}

impl UprightLine {
    pub(super) fn at(&self, v: f64) -> f64 {
        self.u_px + self.slope * (v - self.v_px)
    }

    /// Distances across the line per distance along a row.
    pub(super) fn across(&self) -> f64 {
        1.0 / self.slope.hypot(1.0)
    }

    pub(super) fn point(&self, v: f64) -> Point2<f64> {
        Point2::new(self.at(v), v)
    }
}

/// A line and the rows that it was fitted to.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stem {
    pub(super) line: UprightLine,
    /// From top to bottom.
    pub(super) centres: Vec<Centre>,
    /// Median width along a row.
    pub(super) width_px: f64,
    /// Where it begins and ends: rows, to a fraction.
    pub(super) upper_v_px: f64,
    pub(super) lower_v_px: f64,
}

/// Rows beyond an end that may show nothing before the pole has ended.
const END_GAP_ROWS: usize = 2;

/// Share of the usual sum of a row that still counts as the pole.
const FAINT: f64 = 0.25;

impl Stem {
    /// Measures the pole around `line` between two rows anew, follows it
    /// beyond them, and finds its ends. None where nothing is left.
    pub(super) fn measure(plane: &Plane, line: UprightLine, rows: (f64, f64), width_px: f64) -> Option<Self> {
        let mut stem = Self { line, centres: Vec::new(), width_px, upper_v_px: rows.0, lower_v_px: rows.1 };
        // The window follows the line and the line follows the window; three
        // rounds bring the rest below a hundredth of a pixel.
        for _ in 0..3 {
            stem.collect(plane);
            stem.fit()?;
        }
        stem.find_ends();
        Some(stem)
    }

    /// Measures rows from the middle outwards until the pole ends.
    fn collect(&mut self, plane: &Plane) {
        let (line, width) = (self.line, self.width_px);
        let (first, last) = (self.upper_v_px.round().max(0.0) as usize, self.lower_v_px.round().max(0.0) as usize);
        let mut centres: Vec<Centre> = (first..=last).filter_map(|row| measure_row(plane, &line, row, width)).collect();
        let usual = median(centres.iter().map(|c| c.mass));
        let is_pole = |centre: &Centre| centre.mass >= FAINT * usual;
        let follow = |rows: &mut dyn Iterator<Item = usize>| {
            let mut found = Vec::new();
            let mut gap = 0;
            for row in rows {
                match measure_row(plane, &line, row, width).filter(is_pole) {
                    Some(centre) => {
                        gap = 0;
                        found.push(centre);
                    }
                    None => gap += 1,
                }
                if gap > END_GAP_ROWS {
                    break;
                }
            }
            found
        };
        let above = follow(&mut (0..first).rev());
        let below = follow(&mut (last + 1..plane.height()));
        centres.retain(is_pole);
        self.centres = above.into_iter().rev().chain(centres).chain(below).collect();
        self.width_px = median(self.centres.iter().map(|c| c.width_px));
        if let Some((top, bottom)) = self.centres.first().zip(self.centres.last()) {
            (self.upper_v_px, self.lower_v_px) = (top.v_px, bottom.v_px);
        }
    }

    /// Weighted least squares with Huber weights; none with fewer than 3 rows.
    pub(super) fn fit(&mut self) -> Option<()> {
        if self.centres.len() < 3 {
            return None;
        }
        for _ in 0..3 {
            let scale = median(self.centres.iter().map(|c| (c.u_px - self.line.at(c.v_px)).abs())).max(0.05);
            let v_px = self.centres.iter().map(|c| c.v_px).sum::<f64>() / self.centres.len() as f64;
            let mut normal = Matrix2::zeros();
            let mut right = Vector2::zeros();
            for c in &self.centres {
                let residual = (c.u_px - self.line.at(c.v_px)).abs();
                // 1.5 standard deviations, one being 1.48 median residuals.
                let huber = (2.2 * scale / residual.max(1e-9)).min(1.0);
                let row = Vector2::new(1.0, c.v_px - v_px);
                normal += row * row.transpose() * huber;
                right += row * (c.u_px * huber);
            }
            let solution = normal.try_inverse()? * right;
            self.line = UprightLine { u_px: solution.x, v_px, slope: solution.y };
        }
        Some(())
    }

    /// The ends lie where the sum of a row has fallen to half of what the
    /// rows next to the end have: there half of the pixel shows the pole.
    fn find_ends(&mut self) {
        const NEAR_END: usize = 8;
        let fallen = |near: &mut dyn Iterator<Item = &Centre>| {
            let near: Vec<Centre> = near.take(NEAR_END).copied().collect();
            let half = 0.5 * median(near.iter().map(|c| c.mass));
            let first = near.iter().position(|c| c.mass >= half).unwrap_or(0);
            let full = near[first];
            // Beyond the last measured row there is nothing.
            let (fainter, step) = match first.checked_sub(1) {
                Some(before) => (near[before].mass, (near[before].v_px - full.v_px).abs()),
                None => (0.0, 1.0),
            };
            (full.v_px, step * (full.mass - half) / (full.mass - fainter).max(1e-9))
        };
        if self.centres.is_empty() {
            return;
        }
        let (v, beyond) = fallen(&mut self.centres.iter());
        self.upper_v_px = v - beyond;
        let (v, beyond) = fallen(&mut self.centres.iter().rev());
        self.lower_v_px = v + beyond;
    }

    /// Root mean square distance of the centres from the line, pixels.
    pub(super) fn residual_px(&self) -> f64 {
        let squares: f64 = self.centres.iter().map(|c| (c.u_px - self.line.at(c.v_px)).powi(2)).sum();
        (squares / self.centres.len().max(1) as f64).sqrt() * self.line.across()
    }

    /// Whether the network loses the pole slowly towards an end instead of
    /// seeing it end: there it goes on behind a fence or in front of
    /// something like it. `rows` start at that end.
    pub(super) fn fades<'a>(&self, mut rows: impl Iterator<Item = &'a Centre>, end_v_px: f64) -> bool {
        const FULL: f64 = 0.75;
        // A mask is as soft at its ends as at its sides, about the stride of
        // the network's last layers; and feet stand in grass and shadow.
        const SOFT_ROWS: f64 = 6.0;
        const SOFT_SHARE: f64 = 0.12;
        let peak = |c: &Centre| c.mass / c.width_px;
        let full = FULL * median(self.centres.iter().map(peak));
        let soft = SOFT_ROWS.max(self.width_px).max(SOFT_SHARE * self.rows());
        rows.find(|c| peak(c) >= full).is_some_and(|c| (c.v_px - end_v_px).abs() > soft)
    }

    /// Rows between its ends.
    pub(super) fn rows(&self) -> f64 {
        self.lower_v_px - self.upper_v_px
    }

    /// Largest probability of a row, averaged over its pixels.
    pub(super) fn probability(&self) -> f64 {
        let sum = |of: fn(&Centre) -> f64| self.centres.iter().map(of).sum::<f64>();
        sum(|c| c.mass) / sum(|c| c.width_px).max(1e-9)
    }

    /// Share of the rows between the ends in which it is seen.
    pub(super) fn coverage(&self) -> f64 {
        self.centres.len() as f64 / self.rows().max(1.0)
    }
}

/// What a row shows in a window around the line; none where it shows nothing,
/// or as much again beside the window: an arm, a crossbar, another pole.
fn measure_row(plane: &Plane, line: &UprightLine, row: usize, width_px: f64) -> Option<Centre> {
    let values = plane.row(row);
    let v_px = row as f64;
    let centre = line.at(v_px);
    let half = 0.5 * width_px + 1.5;
    let beside = half + 0.5 * width_px + 1.0;
    let first = (centre - beside).ceil().max(0.0) as usize;
    let last = ((centre + beside).floor().max(-1.0) + 1.0) as usize;
    let window = values.get(first..last.min(values.len()))?;
    let (mut mass, mut moment, mut outside, mut peak) = (0.0, 0.0, 0.0, 0.0_f64);
    for (u, &value) in (first..).zip(window) {
        let probability = f64::from(value) / 255.0;
        let offset = u as f64 - centre;
        // Share of the pixel that the window covers, so that the sum does
        // not jump when the window moves.
        let inside = (half + 0.5 - offset.abs()).clamp(0.0, 1.0);
        mass += probability * inside;
        moment += probability * inside * offset;
        outside += probability * (1.0 - inside);
        if inside > 0.5 {
            peak = peak.max(probability);
        }
    }
    (mass > 0.1 && outside <= 0.5 * mass).then(|| Centre {
        u_px: centre + moment / mass,
        v_px,
        width_px: mass / peak.max(0.05),
        mass,
    })
}
