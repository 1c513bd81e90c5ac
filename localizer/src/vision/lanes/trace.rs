//! Regions to curves: the centres of a region's rows, or of its columns where
//! it lies flat, followed from one to the next.

use nalgebra::Point2;

use super::fit::straight_line;
use crate::vision::Plane;
use crate::vision::centre::{Centre, median};
use crate::vision::regions::{Region, Run, runs};

/// A curve, from far (top) to near.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Track {
    pub(super) points: Vec<TrackPoint>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TrackPoint {
    pub(super) at_px: Point2<f64>,
    /// Width along the row or the column, pixels.
    pub(super) width_px: f64,
    /// Mean probability over the width.
    pub(super) probability: f64,
    /// Measured along a column.
    pub(super) is_column: bool,
}

impl Track {
    /// Distance of its ends, pixels.
    pub(super) fn length_px(&self) -> f64 {
        self.points.first().zip(self.points.last()).map_or(0.0, |(a, b)| (a.at_px - b.at_px).norm())
    }
}

/// How much more than rows columns must explain in a region that does not lie
/// flat. Paint ends across the road, so in the image its ends lie along rows:
/// there the centres of rows stay on the line to the last, and those of
/// columns run into the corners.
const ROWS_PREFERRED: f64 = 3.0;

/// Inclination below which a region lies flat, degrees: its rows are so long
/// that each raggedness of the mask breaks them.
const FLAT_DEG: f64 = 20.0;

/// The curves of a region of at least `min_piece_px`, along its rows or along
/// its columns, whichever explains more of it by smooth lines: rows part lines
/// that meet at the horizon, and columns follow lines that lie flat. Where
/// lines cross, merge or part, all of them end: which ones belong together
/// shows when their directions are compared.
pub(super) fn trace(plane: &Plane, region: &Region, min_piece_px: f64) -> Vec<Track> {
    let along_rows = tracks(follow(plane, &region.runs), min_piece_px, |c| point(c.u_px, c.v_px, c, false));
    let (flipped, (left, top)) = transposed(plane, region);
    // All that is left in the copy is this region.
    let along_columns =
        tracks(follow(&flipped, &runs(&flipped, 1)), min_piece_px, |c| point(left + c.v_px, top + c.u_px, c, true));
    let explained = |tracks: &[Track]| tracks.iter().map(explained_px).sum::<f64>();
    let rows_preferred = if inclination_rad(region) < FLAT_DEG.to_radians() { 1.0 } else { ROWS_PREFERRED };
    if explained(&along_columns) > rows_preferred * explained(&along_rows) { along_columns } else { along_rows }
}

/// Length of a curve, less where it is no straight line.
fn explained_px(track: &Track) -> f64 {
    /// What a bend of a real lane within one region leaves, pixels.
    const STRAIGHT_PX: f64 = 2.0;
    let points: Vec<Point2<f64>> = track.points.iter().map(|p| p.at_px).collect();
    straight_line(&points).map_or(0.0, |line| line.length_px * (STRAIGHT_PX / line.residual_px.max(STRAIGHT_PX)))
}

fn tracks(chains: Vec<Vec<Centre>>, min_piece_px: f64, point: impl Fn(&Centre) -> TrackPoint) -> Vec<Track> {
    let track = |chain: Vec<Centre>| {
        let mut points: Vec<TrackPoint> = without_ends(&chain).iter().map(&point).collect();
        if points.first().zip(points.last()).is_some_and(|(a, b)| a.at_px.y > b.at_px.y) {
            points.reverse();
        }
        Track { points }
    };
    chains.into_iter().map(track).filter(|track| track.length_px() >= min_piece_px).collect()
}

/// A chain without the rows at its ends that are cut askew: a bar of width w
/// along the row and inclination m = du/dv ends within w m / (1 + m^2) rows,
/// and there its centre moves aside. At most half of the chain goes.
fn without_ends(chain: &[Centre]) -> &[Centre] {
    let Some((a, b)) = chain.first().zip(chain.last()) else { return chain };
    let inclination = (b.u_px - a.u_px).abs() / (b.v_px - a.v_px).abs().max(1.0);
    let askew = median(chain.iter().map(|c| c.width_px)) * inclination / (1.0 + inclination * inclination);
    let cut = (askew.round() as usize).min(chain.len() / 4);
    &chain[cut..chain.len() - cut]
}

fn point(u: f64, v: f64, centre: &Centre, is_column: bool) -> TrackPoint {
    TrackPoint {
        at_px: Point2::new(u, v),
        width_px: centre.width_px,
        probability: centre.mass / centre.width_px,
        is_column,
    }
}

/// Angle of the region's longer axis of inertia from the image's horizontal,
/// 0 to pi/2.
fn inclination_rad(region: &Region) -> f64 {
    let (mut n, mut x, mut y, mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for run in &region.runs {
        let (length, row) = ((run.end - run.start) as f64, run.y as f64);
        let middle = 0.5 * (run.start + run.end - 1) as f64;
        n += length;
        x += length * middle;
        y += length * row;
        xx += length * (middle * middle + (length * length - 1.0) / 12.0);
        xy += length * middle * row;
        yy += length * row * row;
    }
    let (xx, xy, yy) = (xx - x * x / n, xy - x * y / n, yy - y * y / n);
    (0.5 * (2.0 * xy).atan2(xx - yy)).abs()
}

/// The region's bounding box with columns as rows, and its corner.
fn transposed(plane: &Plane, region: &Region) -> (Plane, (f64, f64)) {
    let (left, top, right, bottom) = region.bounds();
    let height = bottom - top + 1;
    let mut flipped = Plane::zeros(height, right - left + 1);
    let data = flipped.data_mut();
    for run in &region.runs {
        for (x, &value) in (run.start..).zip(&plane.row(run.y)[run.start..run.end]) {
            data[(x - left) * height + run.y - top] = value;
        }
    }
    (flipped, (left as f64, top as f64))
}

/// Widths of neighbouring rows of one line differ by less than this share or
/// by less than this many pixels.
const WIDTH_JUMP: f64 = 0.5;
const WIDTH_JUMP_PX: f64 = 3.0;

/// Chains of runs that touch exactly one run above and one below.
fn follow(plane: &Plane, runs: &[Run]) -> Vec<Vec<Centre>> {
    let mut done = Vec::new();
    // Chains that reach the row before, with their last run there.
    let mut open: Vec<(Run, Vec<Centre>)> = Vec::new();
    for row in runs.chunk_by(|a, b| a.y == b.y) {
        let above = std::mem::take(&mut open);
        let touches = |a: &Run, b: &Run| a.y + 1 == b.y && a.start <= b.end && b.start <= a.end;
        let mut chains: Vec<Option<(Run, Vec<Centre>)>> = above.into_iter().map(Some).collect();
        for run in row {
            let Some(centre) = Centre::of(&plane.row(run.y)[run.start..run.end], run.start, run.y) else { continue };
            let is_touching = |chain: &Option<(Run, Vec<Centre>)>| chain.as_ref().is_some_and(|(a, _)| touches(a, run));
            let mut touching = (0..chains.len()).filter(|&i| is_touching(&chains[i]));
            let only = match (touching.next(), touching.next()) {
                (Some(i), None) => Some(i),
                _ => None,
            };
            let continued = only.filter(|&i| {
                chains[i].as_ref().is_some_and(|(last, chain)| {
                    let branches = row.iter().filter(|other| touches(last, other)).count() > 1;
                    let width = chain.last().map_or(0.0, |c| c.width_px);
                    let jump = (width - centre.width_px).abs();
                    !branches && jump <= WIDTH_JUMP_PX.max(WIDTH_JUMP * width.min(centre.width_px))
                })
            });
            match continued.and_then(|i| chains[i].take()) {
                Some((_, mut chain)) => {
                    chain.push(centre);
                    open.push((*run, chain));
                }
                None => open.push((*run, vec![centre])),
            }
        }
        done.extend(chains.into_iter().flatten().map(|(_, chain)| chain));
    }
    done.extend(open.into_iter().map(|(_, chain)| chain));
    done
}
