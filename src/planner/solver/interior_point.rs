//! A primal-dual interior-point method for `min f(x)` subject to `a_k . x <= b_k`: the reference local solver (the
//! paper's phase 4).
//!
//! With slacks `r = b - A x > 0`, multipliers `m > 0` and a barrier parameter u, each iteration solves
//!
//! ```text
//! (B + A' diag(m / r) A) d = -(g + A' (u / r)),    dm = u / r - m + (m / r) (A d),
//! ```
//!
//! B a damped BFGS approximation of the Hessian (Powell 1978), takes at most 0.995 of the way to the boundary
//! (separately for x and m), and backtracks on the barrier function `f - u sum ln r` (Armijo, 1e-4). u falls by a factor
//! of five whenever the residual `|g + A' m|` is below ten times u (Fiacco and McCormick; Nocedal and Wright, chapter 19).
//! Rows have unit normals, variables are of order one. Converged when residual and u are below the tolerance. Fails
//! safely: the iterate is always strictly feasible, and the best one is returned with the status.

use super::dense::{self, Matrix};
use super::{Constraints, MAX, Objective, Outcome, Vars};

/// Limits of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Most iterations.
    pub iterations: usize,
    /// Final barrier parameter and residual.
    pub tolerance: f64,
    /// First barrier parameter.
    pub barrier: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { iterations: 300, tolerance: 1e-7, barrier: 0.1 }
    }
}

const TO_BOUNDARY: f64 = 0.995;
const ARMIJO: f64 = 1e-4;
const BACKTRACKS: usize = 40;
/// Longest step in the scaled variables: keeps the first iterations, without curvature, near the start.
const TRUST: f64 = 1.0;

struct Iterate {
    x: Vars,
    value: f64,
    gradient: Vars,
    hessian: Matrix,
    slack: Vec<f64>,
    multiplier: Vec<f64>,
}

/// Minimises `objective` from `start`, which must be strictly feasible.
pub fn minimise(
    objective: &mut impl Objective,
    constraints: &mut Constraints,
    start: &Vars,
    settings: &Settings,
) -> Outcome {
    let n = constraints.dimension;
    let mut gradient = [0.0; MAX];
    let value = objective.evaluate(start, &mut gradient);
    constraints.refresh(start);
    let slack: Vec<f64> = (0..constraints.rows.len()).map(|k| constraints.slack(k, start)).collect();
    if !value.is_finite() || slack.iter().any(|r| !(*r > 0.0)) {
        return Outcome { x: *start, value, iterations: 0, converged: false, curvature: None };
    }
    let mut barrier = settings.barrier;
    let multiplier = slack.iter().map(|r| barrier / r).collect();
    let mut at = Iterate { x: *start, value, gradient, hessian: dense::identity(1.0), slack, multiplier };
    let mut steps = vec![0.0; at.slack.len()];
    let mut resets = 0;
    for iteration in 0..settings.iterations {
        constraints.refresh(&at.x);
        for (k, r) in at.slack.iter_mut().enumerate() {
            *r = constraints.slack(k, &at.x).max(1e-300);
        }
        let residual = residual(&at, constraints);
        if residual <= settings.tolerance && barrier <= settings.tolerance {
            return Outcome {
                x: at.x,
                value: at.value,
                iterations: iteration,
                converged: true,
                curvature: None,
            };
        }
        if residual <= 10.0 * barrier {
            barrier = (0.2 * barrier).max(0.1 * settings.tolerance);
        }
        let Some(direction) = newton(&at, constraints, barrier) else {
            at.hessian = dense::identity(1.0);
            continue;
        };
        for (step, row) in steps.iter_mut().zip(&constraints.rows) {
            *step = dense::dot(&row.a, &direction);
        }
        if advance(&mut at, objective, n, &direction, &steps, barrier) {
            resets = 0;
        } else {
            // No descent to be had: fresh curvature, then a smaller barrier, then the end.
            at.hessian = dense::identity(1.0);
            barrier = (0.2 * barrier).max(0.1 * settings.tolerance);
            resets += 1;
            if resets > 3 {
                let converged = barrier <= settings.tolerance;
                return Outcome {
                    x: at.x,
                    value: at.value,
                    iterations: iteration,
                    converged,
                    curvature: None,
                };
            }
        }
    }
    Outcome { x: at.x, value: at.value, iterations: settings.iterations, converged: false, curvature: None }
}

/// Largest component of the Lagrangian's gradient.
fn residual(at: &Iterate, constraints: &Constraints) -> f64 {
    let mut g = at.gradient;
    for (row, m) in constraints.rows.iter().zip(&at.multiplier) {
        for (c, a) in g.iter_mut().zip(&row.a) {
            *c += m * a;
        }
    }
    g.iter().fold(0.0, |top, c| top.max(c.abs()))
}

fn newton(at: &Iterate, constraints: &Constraints, barrier: f64) -> Option<Vars> {
    let n = constraints.dimension;
    let mut matrix = at.hessian;
    let mut rhs = at.gradient.map(|c| -c);
    for ((row, r), m) in constraints.rows.iter().zip(&at.slack).zip(&at.multiplier) {
        for k in 0..n {
            if row.a[k] != 0.0 {
                rhs[k] -= row.a[k] * barrier / r;
                for l in 0..n {
                    matrix[k][l] += row.a[k] * row.a[l] * m / r;
                }
            }
        }
    }
    let solved = dense::solve(&mut matrix, &mut rhs, n) && rhs.iter().all(|c| c.is_finite());
    solved.then_some(rhs)
}

/// Backtracks along `direction` and updates slacks' multipliers and curvature; false if nothing was gained.
fn advance(
    at: &mut Iterate,
    objective: &mut impl Objective,
    n: usize,
    direction: &Vars,
    steps: &[f64],
    barrier: f64,
) -> bool {
    let norm = dense::dot(direction, direction).sqrt();
    let mut length = (TRUST / norm.max(1e-300)).min(1.0);
    let mut dual_length: f64 = 1.0;
    let dual_step = |m: f64, r: f64, step: f64| barrier / r - m + m / r * step;
    for ((r, m), step) in at.slack.iter().zip(&at.multiplier).zip(steps) {
        if *step > 0.0 {
            length = length.min(TO_BOUNDARY * r / step);
        }
        let change = dual_step(*m, *r, *step);
        if change < 0.0 {
            dual_length = dual_length.min(-TO_BOUNDARY * m / change);
        }
    }
    let slope = dense::dot(&at.gradient, direction)
        + at.slack.iter().zip(steps).map(|(r, step)| barrier * step / r).sum::<f64>();
    let mut trial = [0.0; MAX];
    for _ in 0..BACKTRACKS {
        let mut x = at.x;
        for k in 0..n {
            x[k] += length * direction[k];
        }
        let value = objective.evaluate(&x, &mut trial);
        let barriers: f64 =
            at.slack.iter().zip(steps).map(|(r, step)| libm::log(1.0 - length * step / r)).sum();
        let change = value - at.value - barrier * barriers;
        if change <= ARMIJO * length * slope && change < 0.0 {
            damped_bfgs(&mut at.hessian, &x, &at.x, &trial, &at.gradient, n);
            for ((m, r), step) in at.multiplier.iter_mut().zip(&at.slack).zip(steps) {
                let moved = *m + dual_length * dual_step(*m, *r, *step);
                // Kept within a factor of the central path, so that a poor B cannot strand them.
                let central = barrier / (r - length * step).max(1e-300);
                *m = moved.clamp(1e-4 * central, 1e4 * central);
            }
            (at.x, at.value, at.gradient) = (x, value, trial);
            return true;
        }
        length *= 0.5;
    }
    false
}

fn damped_bfgs(hessian: &mut Matrix, x: &Vars, from: &Vars, gradient: &Vars, gradient_from: &Vars, n: usize) {
    let (mut s, mut y) = ([0.0; MAX], [0.0; MAX]);
    for k in 0..n {
        s[k] = x[k] - from[k];
        y[k] = gradient[k] - gradient_from[k];
    }
    let bs = dense::symmetric_times(hessian, &s, n);
    let (sbs, sy) = (dense::dot(&s, &bs), dense::dot(&s, &y));
    if !(sbs > 1e-300) {
        return;
    }
    let theta = if sy >= 0.2 * sbs { 1.0 } else { 0.8 * sbs / (sbs - sy) };
    for k in 0..n {
        y[k] = theta * y[k] + (1.0 - theta) * bs[k];
    }
    let sy = dense::dot(&s, &y);
    for r in 0..n {
        for c in 0..n {
            hessian[r][c] += y[r] * y[c] / sy - bs[r] * bs[c] / sbs;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::solver::Row;

    fn boxed(n: usize, bound: f64) -> Constraints {
        let rows = (0..n).flat_map(|k| {
            [1.0, -1.0].map(|sign| {
                let mut a = [0.0; MAX];
                a[k] = sign;
                Row { a, b: bound }
            })
        });
        Constraints::new(n, rows.collect(), None)
    }

    #[test]
    fn val_rosenbrock_in_a_box() {
        let mut f = |x: &Vars, g: &mut Vars| {
            let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
            g[0] = -2.0 * a - 400.0 * x[0] * b;
            g[1] = 200.0 * b;
            a * a + 100.0 * b * b
        };
        let mut start = [0.0; MAX];
        start[0] = -1.0;
        let end = minimise(&mut f, &mut boxed(2, 2.0), &start, &Settings::default());
        assert!(end.converged && end.value < 1e-6, "{end:?}");
        // With x <= 1/2 the minimum is at (1/2, 1/4), value 1/4.
        let end = minimise(&mut f, &mut boxed(2, 0.5), &[0.0; MAX], &Settings::default());
        assert!(end.converged && (end.value - 0.25).abs() < 1e-5, "{end:?}");
    }

    #[test]
    fn val_linear_programme_ends_in_a_corner() {
        let mut f = |x: &Vars, g: &mut Vars| {
            (g[0], g[1]) = (1.0, -2.0);
            x[0] - 2.0 * x[1]
        };
        let end = minimise(&mut f, &mut boxed(2, 1.0), &[0.0; MAX], &Settings::default());
        assert!(end.converged && (end.value + 3.0).abs() < 1e-5, "{end:?}");
    }

    #[test]
    fn spec_a_start_on_the_boundary_is_returned() {
        let mut f = |_: &Vars, _: &mut Vars| 0.0;
        let end = minimise(&mut f, &mut boxed(1, 0.0), &[0.0; MAX], &Settings::default());
        assert!(!end.converged && end.iterations == 0);
    }
}
