//! The normal equations of an axis, summed up without what is alike in them.

use nalgebra::{Matrix2, Matrix5, Vector2, Vector5};

/// The sums that the normal equations are made of: all rows are
/// `(a, a t, s)` of a direction `a`, a height `t` and a number `s`, and so most
/// of the entries of their products are alike.
#[derive(Default)]
pub(super) struct Sums {
    /// Of `a a^T`, times 1, `t` and `t^2`.
    directions: [Matrix2<f64>; 3],
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
    /// Adds a row. `weighted` is the direction times the weight of the row.
    pub fn add(&mut self, axis: &Vector2<f64>, weighted: &Vector2<f64>, t: f64, of_surface: f64, value: f64) {
        let product = weighted * axis.transpose();
        self.directions[0] += product;
        self.directions[1] += product * t;
        self.directions[2] += product * (t * t);
        self.values[0] += weighted * value;
        self.values[1] += weighted * (value * t);
        if of_surface != 0.0 {
            let surface = weighted * of_surface;
            self.surface[0] += surface;
            self.surface[1] += surface * t;
            // The direction has length 1.
            let weight = surface.dot(axis);
            self.surface_squared += weight * of_surface;
            self.surface_value += weight * value;
        }
    }

    /// The normal matrix and its right-hand side.
    pub fn equations(&self) -> (Matrix5<f64>, Vector5<f64>) {
        let (mut h, mut g) = (Matrix5::zeros(), Vector5::zeros());
        for (row, column, block) in [(0, 0, 0), (0, 2, 1), (2, 0, 1), (2, 2, 2)] {
            h.fixed_view_mut::<2, 2>(row, column).copy_from(&self.directions[block]);
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
            let (axis, of_surface) = (Vector2::new(angle.cos(), angle.sin()), f64::from(k % 2) - 1.0);
            let (weight, value) = (1.0 + 0.2 * f64::from(k % 5), angle.sin() + t);
            let row = Vector5::new(axis.x, axis.y, axis.x * t, axis.y * t, of_surface);
            h += row * row.transpose() * weight;
            g += row * (value * weight);
            sums.add(&axis, &(axis * weight), t, of_surface, value);
        }
        let (matrix, right) = sums.equations();
        assert!((matrix - h).amax() < 1e-12 && (right - g).amax() < 1e-12, "{matrix} {h}");
    }
}
