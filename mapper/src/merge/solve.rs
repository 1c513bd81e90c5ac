//! Weighted linear least squares with few unknowns in each equation.

use rayon::prelude::*;

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

    /// Improves `x` to the least squares solution: conjugate gradients on the
    /// normal equations with a diagonal preconditioner (Hestenes and Stiefel
    /// 1952). Unknowns in no equation stay as they are. Each sum has one order,
    /// on any number of threads.
    pub fn solve(self, x: &mut [f64]) {
        let mut residual = vec![0.0; x.len()];
        for index in 0..self.len() {
            for (column, value) in self.row(index) {
                residual[column] += value * self.weights[index] * self.right[index];
            }
        }
        let normal = Normal::of(&self, x.len());
        drop(self);
        let diagonal = normal.diagonal();
        let precondition = |r: &[f64]| -> Vec<f64> {
            r.iter().zip(&diagonal).map(|(r, d)| if *d > 0.0 { r / d } else { 0.0 }).collect()
        };
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let mut image = vec![0.0; x.len()];
        normal.times(x, &mut image);
        residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= i);
        let mut direction = precondition(&residual);
        let mut size = dot(&residual, &direction);
        let enough = size * TOLERANCE * TOLERANCE;
        for _ in 0..STEPS {
            if size <= enough || size.is_nan() {
                break;
            }
            normal.times(&direction, &mut image);
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

/// `A^T W A` in compressed rows. Many equations tie the same few unknowns, and
/// each pair of these has one entry here.
struct Normal {
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

/// Rows that one thread multiplies at a time.
const ROWS: usize = 4096;

impl Normal {
    /// Row by row (Gustavson 1978): the sum of the equations in which its
    /// unknown stands.
    fn of(equations: &Equations, unknowns: usize) -> Self {
        let mut begins = vec![0_usize; unknowns + 1];
        equations.columns.iter().for_each(|column| begins[*column as usize + 1] += 1);
        for i in 1..begins.len() {
            begins[i] += begins[i - 1];
        }
        // Of each unknown, the equations with it and its factors there.
        let mut within = vec![(0_u32, 0.0); equations.columns.len()];
        let mut next = begins.clone();
        for index in 0..equations.len() {
            for (column, value) in equations.row(index) {
                within[next[column]] = (index as u32, value * equations.weights[index]);
                next[column] += 1;
            }
        }
        let mut normal = Self { starts: vec![0], columns: Vec::new(), values: Vec::new() };
        // Where the entry of a column stands in the present row.
        let mut places = vec![usize::MAX; unknowns];
        for unknown in 0..unknowns {
            let start = normal.columns.len();
            for (index, factor) in &within[begins[unknown]..begins[unknown + 1]] {
                for (column, value) in equations.row(*index as usize) {
                    // Places of earlier rows lie before this one's.
                    if places[column] == usize::MAX || places[column] < start {
                        places[column] = normal.columns.len();
                        normal.columns.push(column as u32);
                        normal.values.push(0.0);
                    }
                    normal.values[places[column]] += factor * value;
                }
            }
            normal.starts.push(normal.columns.len());
        }
        normal
    }

    fn row(&self, index: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[index]..self.starts[index + 1];
        self.columns[range.clone()].iter().map(|column| *column as usize).zip(self.values[range].iter().copied())
    }

    fn diagonal(&self) -> Vec<f64> {
        let own = |index: usize| self.row(index).find(|(column, _)| *column == index).map_or(0.0, |(_, value)| value);
        (0..self.starts.len() - 1).map(own).collect()
    }

    fn times(&self, x: &[f64], out: &mut [f64]) {
        out.par_chunks_mut(ROWS).enumerate().for_each(|(part, out)| {
            for (k, out) in out.iter_mut().enumerate() {
                *out = self.row(part * ROWS + k).map(|(column, value)| value * x[column]).sum();
            }
        });
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
