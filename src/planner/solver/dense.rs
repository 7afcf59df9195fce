//! Small dense linear algebra on the stack.

use super::{MAX, Vars};

/// A square matrix; rows and columns beyond the dimension are unused.
pub type Matrix = [Vars; MAX];

/// Inner product.
#[must_use]
#[inline]
pub fn dot(a: &Vars, b: &Vars) -> f64 {
    let mut lanes = [0.0; 2];
    for k in 0..MAX / 2 {
        lanes[0] += a[2 * k] * b[2 * k];
        lanes[1] += a[2 * k + 1] * b[2 * k + 1];
    }
    lanes[0] + lanes[1]
}

/// `m v` over the first `n` rows of a symmetric matrix.
#[must_use]
#[inline]
pub fn symmetric_times(m: &Matrix, v: &Vars, n: usize) -> Vars {
    let mut out = [0.0; MAX];
    for (row, factor) in m.iter().zip(v).take(n) {
        for (o, c) in out.iter_mut().zip(row) {
            *o += c * factor;
        }
    }
    out
}

/// `scale` times the identity.
#[must_use]
pub fn identity(scale: f64) -> Matrix {
    let mut m = [[0.0; MAX]; MAX];
    for (k, row) in m.iter_mut().enumerate() {
        row[k] = scale;
    }
    m
}

/// Solves `m x = v` for a symmetric positive definite `m` of order `n` by Cholesky; false if it is not.
pub fn solve(m: &mut Matrix, v: &mut Vars, n: usize) -> bool {
    for column in 0..n {
        let mut pivot = m[column][column];
        for k in 0..column {
            pivot -= m[column][k] * m[column][k];
        }
        // Not `pivot <= limit`: NaN must fail too.
        if !(pivot > 1e-14 * m[column][column].abs()) {
            return false;
        }
        let root = pivot.sqrt();
        m[column][column] = root;
        for row in column + 1..n {
            let mut value = m[row][column];
            for k in 0..column {
                value -= m[row][k] * m[column][k];
            }
            m[row][column] = value / root;
        }
    }
    for row in 0..n {
        for k in 0..row {
            v[row] -= m[row][k] * v[k];
        }
        v[row] /= m[row][row];
    }
    for row in (0..n).rev() {
        for k in row + 1..n {
            v[row] -= m[k][row] * v[k];
        }
        v[row] /= m[row][row];
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_solves_a_known_system() {
        let mut m = identity(0.0);
        for (r, row) in [[4.0, 2.0, 0.6], [2.0, 5.0, 1.0], [0.6, 1.0, 3.0]].iter().enumerate() {
            m[r][..3].copy_from_slice(row);
        }
        let x = [1.0, -2.0, 3.0];
        let mut v = [0.0; MAX];
        for r in 0..3 {
            v[r] = (0..3).map(|k| m[r][k] * x[k]).sum();
        }
        assert!(solve(&mut m, &mut v, 3));
        assert!(v.iter().zip(x).all(|(a, b)| (a - b).abs() < 1e-14));
    }

    #[test]
    fn spec_refuses_the_indefinite() {
        let mut m = identity(1.0);
        m[1][1] = -1.0;
        assert!(!solve(&mut m, &mut [1.0; MAX], 2));
        let mut m = identity(f64::NAN);
        assert!(!solve(&mut m, &mut [1.0; MAX], 2));
    }
}
