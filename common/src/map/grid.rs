//! Coordinates as whole numbers of quanta, and the order of landmarks on a
//! road.

use nalgebra::Point3;

use super::Bounds;
use crate::{Error, Result};

/// A point in quanta: x, y, z.
pub(super) type GridPoint = [i64; 3];

/// The finest quantum is a micrometre, the coarsest a metre.
const QUANTA_UM: std::ops::RangeInclusive<u64> = 1..=1_000_000;

/// The grid on which all coordinates of a map lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Grid {
    quantum_um: u64,
}

impl Grid {
    /// The grid of so many micrometres; none outside 1 um to 1 m.
    pub fn from_um(quantum_um: u64) -> Option<Self> {
        QUANTA_UM.contains(&quantum_um).then_some(Self { quantum_um })
    }

    /// The grid of the nearest whole number of micrometres.
    pub fn from_m(quantum_m: f64) -> Result<Self> {
        let quantum_um = (quantum_m * 1e6).round();
        // A float that is NaN or negative becomes 0, which no grid has.
        Self::from_um(quantum_um as u64).ok_or_else(|| Error::MapUnencodable {
            what: format!("the quantum is {quantum_m} m, and must be from 0.000001 to 1 m"),
        })
    }

    /// Its step, micrometres.
    pub fn quantum_um(self) -> u64 {
        self.quantum_um
    }

    /// Its step, metres.
    pub fn quantum_m(self) -> f64 {
        self.metres(1)
    }

    /// The whole number of quanta nearest to a length in metres; `what` names
    /// it if it is not finite or takes more than 32 bits.
    pub fn quanta(self, metres: f64, what: impl Fn() -> String) -> Result<i64> {
        let quanta = (metres * 1e6 / self.quantum_um as f64).round();
        if (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&quanta) {
            Ok(quanta as i64)
        } else {
            Err(Error::MapUnencodable {
                what: format!(
                    "{} is {metres} m, which is not within {:.0} m; remove it or use a coarser quantum",
                    what(),
                    self.metres(i64::from(i32::MAX)),
                ),
            })
        }
    }

    /// The grid point nearest to a point (metres).
    pub fn point(self, point: &Point3<f64>, what: impl Fn() -> String) -> Result<GridPoint> {
        let axis = |index: usize, name| self.quanta(point[index], || format!("{name} of {}", what()));
        Ok([axis(0, "x")?, axis(1, "y")?, axis(2, "z")?])
    }

    /// The box of the nearest grid points; none where one does not fit.
    pub fn around(self, bounds: &Bounds) -> Option<Bounds> {
        let corner = |point: &Point3<f64>| self.point(point, String::new).ok().map(|point| self.point_m(point));
        Some(Bounds { min_map: corner(&bounds.min_map)?, max_map: corner(&bounds.max_map)? })
    }

    /// A length in metres. One rounding only, so that 1.23 m on a grid of 1 cm
    /// reads 1.23.
    pub fn metres(self, quanta: i64) -> f64 {
        (quanta * self.quantum_um.cast_signed()) as f64 / 1e6
    }

    /// As [`Self::metres`], of thousandths of a quantum.
    pub fn thousandths_m(self, thousandths: i64) -> f64 {
        (thousandths * self.quantum_um.cast_signed()) as f64 / 1e9
    }

    /// A point in metres.
    pub fn point_m(self, point: GridPoint) -> Point3<f64> {
        Point3::from(point.map(|quanta| self.metres(quanta)))
    }
}

/// Where the landmarks of a road are counted from, and in which order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RoadFrame {
    /// The first vertex of its path.
    pub origin: GridPoint,
    /// The axis (0 x, 2 z) along which it mainly runs.
    axis: usize,
    /// It runs towards smaller coordinates.
    reverse: bool,
}

impl RoadFrame {
    /// The frame of a road with this path; none without a vertex.
    pub fn of(path: &[GridPoint]) -> Option<Self> {
        let (origin, last) = (*path.first()?, path.last()?);
        let (dx, dz) = (last[0] - origin[0], last[2] - origin[2]);
        let axis = if dz.abs() >= dx.abs() { 2 } else { 0 };
        Some(Self { origin, axis, reverse: last[axis] < origin[axis] })
    }

    /// How far along the road a point is: landmarks stand in this order.
    pub fn along(&self, point: GridPoint) -> i64 {
        if self.reverse { -point[self.axis] } else { point[self.axis] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decimal_length_stays_that_decimal() {
        let grid = Grid::from_m(0.01).unwrap();
        for quanta in -30_000..30_000 {
            let metres: f64 = format!("{quanta}e-2").parse().unwrap();
            assert_eq!(grid.metres(quanta).to_bits(), metres.to_bits());
        }
    }

    #[test]
    fn what_is_no_length_is_refused_by_name() {
        let grid = Grid::from_m(0.01).unwrap();
        for wrong in [f64::NAN, f64::INFINITY, 3e7, -3e7] {
            let said = grid.quanta(wrong, || "x of pole 3".into()).unwrap_err().to_string();
            assert!(said.contains("x of pole 3 is ") && said.contains("within 21474836 m"), "{said}");
        }
        for wrong in [f64::NAN, 0.0, -0.01, 4e-7, 1.1] {
            assert!(Grid::from_m(wrong).is_err());
        }
    }

    #[test]
    fn landmarks_are_ordered_as_they_are_driven_past() {
        let west = RoadFrame::of(&[[0, 0, 0], [-50, 0, 20]]).unwrap();
        assert!(west.along([-10, 0, 9]) < west.along([-20, 0, 0]));
        let ahead = RoadFrame::of(&[[0, 0, 0], [-20, 0, 20]]).unwrap();
        assert!(ahead.along([5, 0, 1]) < ahead.along([0, 0, 2]));
    }
}
