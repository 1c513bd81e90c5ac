//! Points in the order of the beams.
//!
//! Lane paint is told by comparing a point with its neighbours on the beam,
//! which KITTI stores one after the other. Other recorders store column by
//! column, and stitched clouds in no order at all.

use common::kitti::ScanPoint;
use nalgebra::Point3;

use crate::lidar::LidarConfig;

/// The share of a beam's spacing within which two elevations are one beam's.
const SHARE_OF_STEP: f32 = 0.25;
/// How far a beam may have risen or fallen since its last point, as a share of the
/// distance of two: half of that is another's.
const MOST_RISE: f32 = 0.4;
/// A beam has no two points closer together than this share of its points' distance.
const LEAST_ON: f32 = 0.5;
/// Beams that met nothing over so many steps begin anew.
const MOST_STEPS: f32 = 30.0;

/// How far apart the points of a lidar are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Of neighbouring beams, radians.
    elevation_rad: f32,
    /// Of neighbouring points of one, radians.
    azimuth_rad: f32,
    /// The place that they are seen from, in their own frame, metres.
    from_m: [f32; 3],
}

impl Steps {
    /// Those of a lidar, in the frame of its scans.
    pub fn of(lidar: &LidarConfig) -> Self {
        Self {
            elevation_rad: lidar.elevation_step_rad as f32,
            azimuth_rad: lidar.azimuth_step_rad as f32,
            from_m: lidar.at_m.map(|v| v as f32),
        }
    }

    /// The same in the frame of the lidar.
    pub fn seen_from_origin(self) -> Self {
        Self { from_m: [0.0; 3], ..self }
    }

    /// Whether points are in the order of the beams.
    pub fn are_in_order(self, points: &[Point3<f64>]) -> bool {
        self.are_along(points.iter().map(|p| self.elevation(p.x as f32, p.y as f32, p.z as f32)))
    }

    /// Whether a quarter of the points lies on the beam of the one before: in another order
    /// hardly any does, and where points scatter by 2 cm half of them do.
    fn are_along(self, elevations: impl Iterator<Item = f32> + Clone) -> bool {
        let width_rad = self.elevation_rad * SHARE_OF_STEP;
        let (mut along, mut count) = (0, 0);
        for (before, this) in elevations.clone().zip(elevations.skip(1)) {
            along += usize::from((before - this).abs() < width_rad);
            count += 1;
        }
        4 * along >= count
    }

    /// Whether points are in an order in which a lidar may have taken them: along beams, and
    /// [straight on](goes_straight) rather than to and fro in cells.
    pub fn are_as_taken(self, points: &[ScanPoint]) -> bool {
        self.are_along(points.iter().map(|p| self.elevation_of(p))) && goes_straight(points)
    }

    /// The places of points in the order of the beams, which are [followed](Self::beams), and
    /// on each of the azimuth.
    pub fn followed(self, points: &[ScanPoint]) -> Vec<usize> {
        self.by_beam(points, |round, points| self.beams(round, points))
    }

    /// Puts the points of a scan into the order of the beams and,
    /// on each, of the azimuth, unless they are in the order of the beams already.
    /// `ring` is the beam of each point, where the file says it; otherwise beams
    /// are [followed](Self::beams).
    pub fn put_in_order(self, points: &mut [ScanPoint], ring: &[u16]) {
        self.arrange(points, |round, points| {
            if ring.len() == points.len() {
                round.iter().map(|(_, i)| i64::from(ring[*i])).collect()
            } else {
                self.beams(round, points)
            }
        });
    }

    /// Cuts a piece of a stitched cloud as beams would from the place that it is seen
    /// from (its origin): four for each one, as it is so much denser than a scan.
    pub fn cut(self, points: &mut [ScanPoint]) {
        self.arrange(points, |round, points| round.iter().map(|(_, i)| self.piece_of_beam(&points[*i])).collect());
    }

    /// The places of the points of such a piece in that order.
    pub fn as_cut(self, points: &[ScanPoint]) -> Vec<usize> {
        self.by_beam(points, |round, points| round.iter().map(|(_, i)| self.piece_of_beam(&points[*i])).collect())
    }

    /// Which quarter of a beam a point is in, from the highest down, as the beams of KITTI.
    fn piece_of_beam(self, p: &ScanPoint) -> i64 {
        -(self.elevation_of(p) / (self.elevation_rad * SHARE_OF_STEP)).floor() as i64
    }

    /// Sorts points by their beams and, on each, by their azimuth, unless they are in the
    /// order of the beams already. `beams` gives the beam of each of the points whose
    /// azimuths and places it gets, ascending.
    fn arrange(self, points: &mut [ScanPoint], beams: impl FnOnce(&[(f32, usize)], &[ScanPoint]) -> Vec<i64>) {
        if self.are_along(points.iter().map(|p| self.elevation_of(p))) {
            return;
        }
        let ordered: Vec<ScanPoint> = self.by_beam(points, beams).into_iter().map(|i| points[i]).collect();
        points.copy_from_slice(&ordered);
    }

    /// The places of points by their beams and, on each, by their azimuth; `beams` as in
    /// [`Self::arrange`].
    fn by_beam(
        self,
        points: &[ScanPoint],
        beams: impl FnOnce(&[(f32, usize)], &[ScanPoint]) -> Vec<i64>,
    ) -> Vec<usize> {
        let mut round: Vec<(f32, usize)> = points.iter().map(|p| self.azimuth(p)).zip(0..).collect();
        round.sort_by(|a, b| a.0.total_cmp(&b.0));
        let places = round.iter().map(|(_, i)| *i);
        let mut by_beam: Vec<(i64, usize)> = beams(&round, points).into_iter().zip(places).collect();
        // Stable: those of a beam stay in the order of the azimuth.
        by_beam.sort_by_key(|(beam, _)| *beam);
        by_beam.into_iter().map(|(_, i)| i).collect()
    }

    /// The beam of each point of a scan, a number of no meaning; `round` are the azimuths
    /// and places of the points, ascending. Beams are followed round the horizon, and each
    /// point is of the one that came nearest to its height just before: those of many a
    /// lidar come from several places over its origin, so that one has another elevation
    /// where it meets a car before the road.
    fn beams(self, round: &[(f32, usize)], points: &[ScanPoint]) -> Vec<i64> {
        // Sorted by elevation.
        let mut followed = Vec::<Followed>::new();
        let mut count = 0;
        let (most_rad, least_on_rad) = (MOST_RISE * self.elevation_rad, LEAST_ON * self.azimuth_rad);
        let beam = |&(azimuth, i): &(f32, usize)| {
            let elevation = self.elevation_of(&points[i]);
            let first = followed.partition_point(|beam| beam.elevation < elevation - most_rad);
            let near = followed[first..].iter().take_while(|beam| beam.elevation < elevation + most_rad);
            let free = (first..).zip(near).filter(|(_, beam)| azimuth - beam.azimuth >= least_on_rad);
            let off = |beam: &Followed| (beam.elevation - elevation).abs();
            let nearest = free.min_by(|(_, a), (_, b)| off(a).total_cmp(&off(b))).map(|(k, _)| k);
            let before = nearest.map(|k| followed.remove(k));
            let goes_on = before.filter(|beam| azimuth - beam.azimuth < MOST_STEPS * self.azimuth_rad);
            let number = goes_on.map_or(count, |beam| beam.number);
            count = count.max(number + 1);
            let at = followed.partition_point(|beam| beam.elevation < elevation);
            followed.insert(at, Followed { number, azimuth, elevation });
            number
        };
        round.iter().map(beam).collect()
    }

    fn azimuth(self, p: &ScanPoint) -> f32 {
        (p.y_m - self.from_m[1]).atan2(p.x_m - self.from_m[0])
    }

    fn elevation_of(self, p: &ScanPoint) -> f32 {
        self.elevation(p.x_m, p.y_m, p.z_m)
    }

    fn elevation(self, x_m: f32, y_m: f32, z_m: f32) -> f32 {
        let [x0_m, y0_m, z0_m] = self.from_m;
        (z_m - z0_m).atan2((x_m - x0_m).hypot(y_m - y0_m))
    }
}

/// Points of a piece of a cloud whose way is looked at: along a beam a metre at 10 m, and
/// several runs of beams through a cell of 25 cm.
const PIECE: usize = 32;
/// Share of its way that a piece leads away, at least: along beams it is 0.7 and more, and 0.36
/// where points scatter by 2 cm; to and fro in such cells 0.26 and less.
const LEAST_STRAIGHT: f32 = 0.3;

/// Whether most pieces of points that follow each other lead away from where they begin.
fn goes_straight(points: &[ScanPoint]) -> bool {
    let apart_m = |a: &ScanPoint, b: &ScanPoint| {
        let [x, y, z] = [a.x_m - b.x_m, a.y_m - b.y_m, a.z_m - b.z_m];
        (x * x + y * y + z * z).sqrt()
    };
    let share = |piece: &[ScanPoint]| {
        let way_m: f32 = piece.windows(2).map(|w| apart_m(&w[0], &w[1])).sum();
        (way_m > 0.0).then(|| apart_m(&piece[0], &piece[PIECE - 1]) / way_m)
    };
    let (mut straight, mut count) = (0, 0);
    for share in points.chunks_exact(PIECE).filter_map(share) {
        straight += usize::from(share >= LEAST_STRAIGHT);
        count += 1;
    }
    2 * straight >= count
}

/// A beam and its last point, radians.
struct Followed {
    number: i64,
    azimuth: f32,
    elevation: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Beams of a lidar 1.7 m above a plain.
    fn beams() -> Vec<Vec<ScanPoint>> {
        (0..20)
            .map(|beam| {
                let range = 4.0 + 0.7 * beam as f32;
                (0..600)
                    .map(|i| {
                        let azimuth = (i as f32 - 300.0) * 0.01;
                        let (sin, cos) = azimuth.sin_cos();
                        ScanPoint { x_m: range * cos, y_m: range * sin, z_m: -1.7, reflectance: beam as f32 }
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn columns_become_beams_and_beams_stay() {
        let beams = beams();
        let by_beam: Vec<ScanPoint> = beams.iter().flatten().copied().collect();
        let by_column: Vec<ScanPoint> = (0..600).flat_map(|i| beams.iter().map(move |b| b[i])).collect();
        let steps = Steps { elevation_rad: 0.0073, azimuth_rad: 0.01, from_m: [0.0; 3] };
        let mut kept = by_beam.clone();
        steps.put_in_order(&mut kept, &[]);
        assert_eq!(kept, by_beam);
        let rings: Vec<u16> = by_column.iter().map(|p| p.reflectance as u16).collect();
        for rings in [&rings[..], &[]] {
            let mut ordered = by_column.clone();
            steps.put_in_order(&mut ordered, rings);
            let same = ordered.windows(2).filter(|w| (w[0].reflectance - w[1].reflectance).abs() < 0.5).count();
            assert!(same >= ordered.len() - 20, "{same} of {}", ordered.len());
        }
    }

    #[test]
    fn beams_are_followed_past_a_vehicle_that_they_meet_in_any_order() {
        let steps = Steps { elevation_rad: 0.0073, azimuth_rad: 0.003, from_m: [0.0; 3] };
        // Of a lidar 1.7 m above a plain whose beams come from 0.2 m over its origin; a
        // vehicle hides some of it 4 m ahead. The reflectance is the beam's number.
        let hit = |beam: u16, i: u16| {
            let ((sin, cos), rise) = ((f32::from(i) * 0.003 - 3.0).sin_cos(), 0.06 + 0.0073 * f32::from(beam));
            let level_m = if (900..1100).contains(&i) { 4.0 } else { 1.9 / rise };
            ScanPoint { x_m: level_m * cos, y_m: level_m * sin, z_m: 0.2 - level_m * rise, reflectance: beam.into() }
        };
        let by_column: Vec<ScanPoint> = (0..2000).flat_map(|i| (0..24).map(move |beam| hit(beam, i))).collect();
        let mut stirred = by_column.clone();
        // 7919 is prime, and so is every place met once.
        stirred.iter_mut().enumerate().for_each(|(i, p)| *p = by_column[i * 7919 % by_column.len()]);
        for mut points in [by_column, stirred] {
            steps.put_in_order(&mut points, &[]);
            let near_m = |w: &[ScanPoint]| (w[0].x_m - w[1].x_m).hypot(w[0].y_m - w[1].y_m);
            let along = points
                .windows(2)
                .filter(|w| (w[0].reflectance - w[1].reflectance).abs() < 0.5 && near_m(w) < 0.2)
                .count();
            // A beam begins and ends where the vehicle does.
            assert!(along > points.len() - 400, "{along} of {}", points.len());
        }
    }
}
