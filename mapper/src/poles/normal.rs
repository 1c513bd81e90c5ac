//! The normal equations of an axis, summed up without what is alike in them.

use nalgebra::{Matrix2, Matrix5, Vector2, Vector3, Vector5};

/// The sums that the normal equations are made of: all rows are
/// `(a, a t, s)` of a direction `a`, a height `t` and a number `s`, and so most
/// of the entries of their products are alike.
#[derive(Default)]
pub(super) struct Sums {
    /// Of the entries xx, xy and yy of `a a^T`, times 1, `t` and `t^2`.
    directions: [Vector3<f64>; 3],
    /// Of `a s`, times 1 and `t`.
    surface: [Vector2<f64>; 2],
    /// Of `s^2`.
    surface_squared: f64,
    /// Of `a` and the value, times 1 and `t`.
    values: [Vector2<f64>; 2],
    /// Of `s` and the value.
    surface_value: f64,
}

impl Sums {
    /// Adds the rows of a hit with their values and weights: along a direction,
    /// where `s` is -1, and across it, where it is 0.
    #[inline]
    pub fn add(&mut self, along: &Vector2<f64>, t: f64, values: [f64; 2], weights: [f64; 2]) {
        let (x, y) = (along.x, along.y);
        let [of_along, of_across] = weights;
        let product = Vector3::new(
            of_along * x * x + of_across * y * y,
            (of_along - of_across) * x * y,
            of_along * y * y + of_across * x * x,
        );
        self.directions[0] += product;
        self.directions[1] += product * t;
        self.directions[2] += product * (t * t);
        let value = along * (of_along * values[0]) + Vector2::new(-y, x) * (of_across * values[1]);
        self.values[0] += value;
        self.values[1] += value * t;
        let surface = along * of_along;
        self.surface[0] -= surface;
        self.surface[1] -= surface * t;
        self.surface_squared += of_along;
        self.surface_value -= of_along * values[0];
    }

    /// The normal matrix and its right-hand side.
    pub fn equations(&self) -> (Matrix5<f64>, Vector5<f64>) {
        let (mut h, mut g) = (Matrix5::zeros(), Vector5::zeros());
        for (row, column, block) in [(0, 0, 0), (0, 2, 1), (2, 0, 1), (2, 2, 2)] {
            let [xx, xy, yy] = self.directions[block].into();
            h.fixed_view_mut::<2, 2>(row, column).copy_from(&Matrix2::new(xx, xy, xy, yy));
        }
        for k in 0..2 {
            h.fixed_view_mut::<2, 1>(2 * k, 4).copy_from(&self.surface[k]);
            h.fixed_view_mut::<1, 2>(4, 2 * k).copy_from(&self.surface[k].transpose());
            g.fixed_rows_mut::<2>(2 * k).copy_from(&self.values[k]);
        }
        h[(4, 4)] = self.surface_squared;
        g[4] = self.surface_value;
        (h, g)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_equations_are_those_of_the_whole_rows() {
        let (mut sums, mut h, mut g) = (Sums::default(), Matrix5::zeros(), Vector5::zeros());
        for k in 0..40 {
            let (angle, t) = (0.3 * f64::from(k), 0.1 * f64::from(k % 11) - 0.4);
            let along = Vector2::new(angle.cos(), angle.sin());
            let (values, weights) = ([angle.sin() + t, 0.7 - t], [1.0 + 0.2 * f64::from(k % 5), 0.6]);
            let rows = [(along, -1.0), (Vector2::new(-along.y, along.x), 0.0)];
            for (((axis, of_surface), value), weight) in rows.into_iter().zip(values).zip(weights) {
                let row = Vector5::new(axis.x, axis.y, axis.x * t, axis.y * t, of_surface);
                h += row * row.transpose() * weight;
                g += row * (value * weight);
            }
            sums.add(&along, t, values, weights);
        }
        let (matrix, right) = sums.equations();
        assert!((matrix - h).amax() < 1e-12 && (right - g).amax() < 1e-12, "{matrix} {h}");
    }
}
