//! Weighted linear least squares with few unknowns in each equation.

/// Equations `sum_k value_k x_(column_k) = right`, each with a weight, in
/// compressed rows.
#[derive(Debug, Default)]
pub struct Equations {
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
    right: Vec<f64>,
    weights: Vec<f64>,
}

/// Most steps of the solver.
const STEPS: usize = 500;
/// Largest residual of the normal equations over that of the start.
const TOLERANCE: f64 = 1e-7;

impl Equations {
    /// Adds an equation.
    pub fn add(&mut self, terms: impl IntoIterator<Item = (usize, f64)>, right: f64, weight: f64) {
        self.starts.push(self.columns.len());
        for (column, value) in terms {
            self.columns.push(column as u32);
            self.values.push(value);
        }
        self.right.push(right);
        self.weights.push(weight);
    }

    /// Number of equations.
    pub fn len(&self) -> usize {
        self.right.len()
    }

    fn row(&self, index: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let end = self.starts.get(index + 1).copied().unwrap_or(self.columns.len());
        let range = self.starts[index]..end;
        self.columns[range.clone()].iter().map(|&column| column as usize).zip(self.values[range].iter().copied())
    }

    /// `A^T W (A x - right * with_right)`.
    fn gradient(&self, x: &[f64], with_right: f64, out: &mut [f64]) {
        out.fill(0.0);
        for index in 0..self.len() {
            let product: f64 = self.row(index).map(|(column, value)| value * x[column]).sum();
            let residual = self.weights[index] * (product - with_right * self.right[index]);
            for (column, value) in self.row(index) {
                out[column] += value * residual;
            }
        }
    }

    /// Improves `x` to the least squares solution: conjugate gradients on the
    /// normal equations with a diagonal preconditioner (Hestenes and Stiefel
    /// 1952). Unknowns in no equation stay as they are. On one thread, so that
    /// sums have one order.
    pub fn solve(&self, x: &mut [f64]) {
        let mut diagonal = vec![0.0; x.len()];
        for index in 0..self.len() {
            for (column, value) in self.row(index) {
                diagonal[column] += self.weights[index] * value * value;
            }
        }
        let precondition = |r: &[f64]| -> Vec<f64> {
            r.iter().zip(&diagonal).map(|(r, d)| if *d > 0.0 { r / d } else { 0.0 }).collect()
        };
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let mut residual = vec![0.0; x.len()];
        self.gradient(x, 1.0, &mut residual);
        for r in &mut residual {
            *r = -*r;
        }
        let mut direction = precondition(&residual);
        let mut size = dot(&residual, &direction);
        let enough = size * TOLERANCE * TOLERANCE;
        let mut image = vec![0.0; x.len()];
        for _ in 0..STEPS {
            if size <= enough || size.is_nan() {
                break;
            }
            self.gradient(&direction, 0.0, &mut image);
            let step = size / dot(&direction, &image);
            for index in 0..x.len() {
                x[index] += step * direction[index];
                residual[index] -= step * image[index];
            }
            let preconditioned = precondition(&residual);
            let next = dot(&residual, &preconditioned);
            for (d, p) in direction.iter_mut().zip(&preconditioned) {
                *d = p + *d * (next / size);
            }
            size = next;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_chain_with_both_ends_held_is_straight() {
        let mut equations = Equations::default();
        let n = 200;
        equations.add([(0, 1.0)], 1.0, 1e6);
        equations.add([(n - 1, 1.0)], 3.0, 1e6);
        for i in 1..n {
            equations.add([(i - 1, -1.0), (i, 1.0)], 0.0, 1.0);
        }
        // One unknown in no equation.
        let mut x = vec![0.0; n + 1];
        equations.solve(&mut x);
        for (i, value) in x[..n].iter().enumerate() {
            assert!((value - (1.0 + 2.0 * i as f64 / (n - 1) as f64)).abs() < 1e-4, "{i} {value}");
        }
        assert!(x[n].abs() < 1e-12);
    }

    #[test]
    fn weights_decide_between_contradictions() {
        let mut equations = Equations::default();
        equations.add([(0, 2.0)], 2.0, 3.0);
        equations.add([(0, 2.0)], 6.0, 1.0);
        let mut x = vec![9.0];
        equations.solve(&mut x);
        assert!((x[0] - 1.5).abs() < 1e-9);
        Equations::default().solve(&mut x);
    }
}
