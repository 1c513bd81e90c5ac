//! A pole on the grid: where it stands, how high it is, and how it leans.

use nalgebra::Point3;

use super::Pole;
use super::grid::{Grid, GridPoint};
use crate::{Error, Result};

/// What the leans of poles are counted in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Leans {
    /// Quanta from the foot to the top. With a quantum of 1 cm, a post 1 m high
    /// is turned by a fifth of a degree.
    Quanta,
    /// Thousandths of the height: a seventeenth of a degree, however high the
    /// pole and however coarse the grid.
    Thousandths,
}

/// A pole on the grid. Poles at the same place are in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct GridPole {
    /// The lower control point.
    pub foot: GridPoint,
    /// How far the upper one is above it, quanta.
    pub height: i64,
    /// How far it is aside along x and z, in what the [`Leans`] say.
    pub lean: [i64; 2],
}

impl GridPole {
    /// The grid pole nearest to a pole; `name` says which one it is where that
    /// has no place on the grid.
    pub fn of(pole: &Pole, grid: Grid, leans: Leans, name: impl Fn() -> String) -> Result<Self> {
        let (foot, top) = (grid.point(&pole.foot_map, &name)?, grid.point(&pole.top_map, &name)?);
        let refused = |what: &str| Error::MapUnencodable { what: format!("{} {what}", name()) };
        // y points down.
        let height = foot[1] - top[1];
        if height < 0 {
            return Err(refused("has its foot above its top; exchange them"));
        }
        let lean = [0, 2].map(|axis| match leans {
            Leans::Quanta => top[axis] - foot[axis],
            // What has no height on the grid is a point.
            Leans::Thousandths if height == 0 => 0,
            Leans::Thousandths => {
                (1e3 * (pole.top_map[axis] - pole.foot_map[axis]) / grid.metres(height)).round() as i64
            }
        });
        let pole = Self { foot, height, lean };
        match pole.top_m(grid, leans) {
            Some(_) if lean.iter().all(|&lean| i32::try_from(lean).is_ok()) => Ok(pole),
            _ => Err(refused("lies rather than stands; remove it")),
        }
    }

    /// The upper control point, metres; none where it is out of range.
    pub fn top_m(&self, grid: Grid, leans: Leans) -> Option<Point3<f64>> {
        let y = self.foot[1].checked_sub(self.height)?;
        // In thousandths of a quantum.
        let aside = |axis: usize, lean: i64| {
            let lean = match leans {
                Leans::Quanta => lean.checked_mul(1000)?,
                Leans::Thousandths => lean.checked_mul(self.height)?,
            };
            let at = self.foot[axis].checked_mul(1000)?.checked_add(lean)?;
            i32::try_from(at / 1000).ok().map(|_| at)
        };
        let (x, z) = (aside(0, self.lean[0])?, aside(2, self.lean[1])?);
        i32::try_from(y).ok()?;
        Some(Point3::new(grid.thousandths_m(x), grid.metres(y), grid.thousandths_m(z)))
    }
}
