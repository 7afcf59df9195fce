//! An active-set quasi-Newton method for `min f(x)` subject to `a_k . x <= b_k`.
//!
//! Each iteration, with H the BFGS approximation of the inverse Hessian, g the gradient, A the active rows and r their
//! slacks (0 but for rounding and for a refreshed separation):
//!
//! 1. The step of the equality-constrained model, `d = -H (g + A m)` with `A' H A m = -A' H g - r`.
//! 2. If a multiplier in m is negative, the row with the most negative one becomes inactive, and 1 again.
//! 3. The longest feasible step by the ratio test; a row that blocks at once becomes active, and 1 again.
//! 4. A line search for the weak Wolfe conditions (1e-4, 0.9) within that length.
//! 5. The update of H, skipped where it would lose definiteness (Nocedal and Wright, 6.17).
//!
//! Converged when the model promises less than the tolerance. A step that the line search refuses is tried once more with
//! H reset, that is along the gradient. Fails safely: the best point is always feasible and is returned with the status.
//! Nothing allocates in an iteration.

use super::dense::{self, Matrix};
use super::line;
use super::{Constraints, MAX, Objective, Outcome, Vars};

/// Limits of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Most iterations.
    pub iterations: usize,
    /// Converged when the model promises a decrease below this.
    pub tolerance: f64,
    /// Length of the first step.
    pub first_step: f64,
    /// The inverse Hessian of a problem much like this one, in the same variables; `None` starts from the gradient.
    pub curvature: Option<Matrix>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { iterations: 100, tolerance: 1e-9, first_step: 0.2, curvature: None }
    }
}

/// The working set, at most as many rows as variables.
#[derive(Debug, Clone, Copy)]
struct Active {
    rows: [usize; MAX],
    len: usize,
}

impl Active {
    fn contains(&self, row: usize) -> bool {
        self.rows[..self.len].contains(&row)
    }

    fn push(&mut self, row: usize) {
        if self.len < MAX {
            self.rows[self.len] = row;
            self.len += 1;
        }
    }

    fn remove(&mut self, at: usize) {
        self.rows.copy_within(at + 1..self.len, at);
        self.len -= 1;
    }
}

struct State {
    x: Vars,
    value: f64,
    gradient: Vars,
    inverse_hessian: Matrix,
    /// Whether H has seen curvature yet.
    scaled: bool,
    active: Active,
}

/// Minimises `objective` from `start`, which must be feasible.
pub fn minimise(
    objective: &mut impl Objective,
    constraints: &mut Constraints,
    start: &Vars,
    settings: &Settings,
) -> Outcome {
    let mut gradient = [0.0; MAX];
    let value = objective.evaluate(start, &mut gradient);
    let mut state = State {
        x: *start,
        value,
        gradient,
        inverse_hessian: settings.curvature.unwrap_or_else(|| dense::identity(1.0)),
        scaled: settings.curvature.is_some(),
        active: Active { rows: [0; MAX], len: 0 },
    };
    let mut converged = false;
    let mut iteration = 0;
    if !value.is_finite() {
        return Outcome { x: *start, value: f64::INFINITY, iterations: 0, converged, curvature: None };
    }
    while iteration < settings.iterations {
        iteration += 1;
        constraints.refresh(&state.x);
        if !state.scaled {
            let norm = dense::dot(&state.gradient, &state.gradient).sqrt();
            state.inverse_hessian = dense::identity(settings.first_step / norm.max(1e-12));
        }
        let (direction, slope) = direction(&mut state, constraints);
        let (longest, blocking) = ratio_test(&state, constraints, &direction);
        if longest <= 1e-13 && blocking.is_some() && slope < -settings.tolerance {
            if state.active.len == constraints.dimension {
                break;
            }
            state.active.push(blocking.unwrap_or(0));
            continue;
        }
        let moved = slope < -settings.tolerance
            && line_search(
                &mut state,
                objective,
                constraints.dimension,
                &direction,
                slope,
                longest,
                blocking,
            );
        if !moved {
            converged = slope >= -settings.tolerance;
            if converged || !state.scaled {
                break;
            }
            // The curvature learnt may be stale: once more along the gradient.
            state.scaled = false;
        }
    }
    let curvature = state.scaled.then_some(state.inverse_hessian);
    Outcome { x: state.x, value: state.value, iterations: iteration, converged, curvature }
}

/// The model's step on the working set, which loses rows with negative multipliers, and the slope along it.
fn direction(state: &mut State, constraints: &Constraints) -> (Vars, f64) {
    let n = constraints.dimension;
    let newton = dense::symmetric_times(&state.inverse_hessian, &state.gradient, n);
    loop {
        let len = state.active.len;
        let mut images = [[0.0; MAX]; MAX];
        let mut schur = [[0.0; MAX]; MAX];
        let mut multipliers = [0.0; MAX];
        for k in 0..len {
            let row = &constraints.rows[state.active.rows[k]];
            images[k] = dense::symmetric_times(&state.inverse_hessian, &row.a, n);
            for (l, image) in images.iter().enumerate().take(k + 1) {
                schur[k][l] = dense::dot(&row.a, image);
                schur[l][k] = schur[k][l];
            }
            let slack = constraints.slack(state.active.rows[k], &state.x).max(0.0);
            multipliers[k] = -dense::dot(&row.a, &newton) - slack;
        }
        if !dense::solve(&mut schur, &mut multipliers, len) {
            // Dependent rows: the newest says nothing new.
            state.active.len -= 1;
            continue;
        }
        let worst = (0..len).min_by(|a, b| multipliers[*a].total_cmp(&multipliers[*b]));
        if let Some(worst) = worst.filter(|k| multipliers[*k] < 0.0) {
            state.active.remove(worst);
            continue;
        }
        let mut step = newton.map(|c| -c);
        for (image, multiplier) in images.iter().zip(multipliers).take(len) {
            for (s, c) in step.iter_mut().zip(image) {
                *s -= multiplier * c;
            }
        }
        return (step, dense::dot(&step, &state.gradient));
    }
}

/// The longest feasible multiple of `direction` and the row that limits it.
fn ratio_test(state: &State, constraints: &Constraints, direction: &Vars) -> (f64, Option<usize>) {
    let mut longest = 1e6;
    let mut blocking = None;
    for (index, row) in constraints.rows.iter().enumerate() {
        let rate = dense::dot(&row.a, direction);
        let slack = constraints.slack(index, &state.x).max(0.0);
        // An active row with slack left (a refreshed separation) is reached at a length of one, and not to be passed.
        let active = state.active.contains(index);
        if rate > 1e-14 && !(active && slack <= 1e-12) {
            let length = slack / rate;
            if length < longest {
                longest = length;
                blocking = (!active).then_some(index);
            }
        }
    }
    (longest, blocking)
}

/// Moves along `direction`; false if no acceptable point was found.
fn line_search(
    state: &mut State,
    objective: &mut impl Objective,
    n: usize,
    direction: &Vars,
    slope: f64,
    longest: f64,
    blocking: Option<usize>,
) -> bool {
    let at = |length: f64| {
        let mut x = state.x;
        for k in 0..n {
            x[k] += length * direction[k];
        }
        let mut gradient = [0.0; MAX];
        (objective.evaluate(&x, &mut gradient), (x, gradient))
    };
    let slope_of = |(_, gradient): &(Vars, Vars)| dense::dot(gradient, direction);
    let best = line::search((state.value, slope), longest, at, slope_of);
    let Some((value, (x, gradient), length)) = best else { return false };
    if let Some(row) = blocking.filter(|_| length >= longest) {
        state.active.push(row);
    }
    update(state, &x, &gradient, n);
    (state.x, state.value, state.gradient) = (x, value, gradient);
    true
}

/// BFGS update of the inverse Hessian.
fn update(state: &mut State, x: &Vars, gradient: &Vars, n: usize) {
    let (mut s, mut y) = ([0.0; MAX], [0.0; MAX]);
    for k in 0..n {
        s[k] = x[k] - state.x[k];
        y[k] = gradient[k] - state.gradient[k];
    }
    let (sy, yy) = (dense::dot(&s, &y), dense::dot(&y, &y));
    if !(sy > 1e-12 * (dense::dot(&s, &s) * yy).sqrt()) {
        return;
    }
    if !state.scaled {
        state.inverse_hessian = dense::identity(sy / yy);
        state.scaled = true;
    }
    let hy = dense::symmetric_times(&state.inverse_hessian, &y, n);
    let scale = (1.0 + dense::dot(&y, &hy) / sy) / sy;
    for r in 0..n {
        let (a, b) = (scale * s[r] - hy[r] / sy, s[r] / sy);
        for c in 0..MAX {
            state.inverse_hessian[r][c] += a * s[c] - b * hy[c];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::solver::{Row, Separation};

    fn row(entries: &[(usize, f64)], b: f64) -> Row {
        let mut a = [0.0; MAX];
        for (k, v) in entries {
            a[*k] = *v;
        }
        Row { a, b }
    }

    fn rosenbrock(x: &Vars, g: &mut Vars) -> f64 {
        let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
        g[0] = -2.0 * a - 400.0 * x[0] * b;
        g[1] = 200.0 * b;
        a * a + 100.0 * b * b
    }

    fn start(x: &[f64]) -> Vars {
        let mut v = [0.0; MAX];
        v[..x.len()].copy_from_slice(x);
        v
    }

    #[test]
    fn val_rosenbrock() {
        let mut free = Constraints::new(2, vec![], None);
        let end = minimise(&mut rosenbrock, &mut free, &start(&[-1.2, 1.0]), &Settings::default());
        assert!(end.converged && end.value < 1e-9, "{end:?}");
    }

    #[test]
    fn val_rosenbrock_in_a_half_plane() {
        // On x + y <= 1 the minimum is at x = 0.618794, y = 0.381206, value 0.145607 (Lagrange, to six digits).
        let mut half = Constraints::new(2, vec![row(&[(0, 1.0), (1, 1.0)], 1.0)], None);
        let end = minimise(&mut rosenbrock, &mut half, &start(&[-1.2, 1.0]), &Settings::default());
        assert!(end.converged && (end.value - 0.145_607).abs() < 1e-6, "{end:?}");
        assert!(half.violation(&end.x) < 1e-12);
    }

    #[test]
    fn val_linear_programme_in_a_box() {
        let mut corner = |x: &Vars, g: &mut Vars| {
            (g[0], g[1], g[2]) = (1.0, -2.0, 3.0);
            x[0] - 2.0 * x[1] + 3.0 * x[2]
        };
        let rows = (0..3).flat_map(|k| [row(&[(k, 1.0)], 1.0), row(&[(k, -1.0)], 1.0)]).collect();
        let end = minimise(
            &mut corner,
            &mut Constraints::new(3, rows, None),
            &start(&[0.1; 3]),
            &Settings::default(),
        );
        assert!((end.value + 6.0).abs() < 1e-12 && end.converged, "{end:?}");
    }

    #[test]
    fn val_separation_holds_two_points_apart() {
        // Both want the origin: they end diametrically opposed at distance 1, each at 1/2.
        let mut pull = |x: &Vars, g: &mut Vars| {
            (0..6)
                .map(|k| {
                    g[k] = 2.0 * x[k];
                    x[k] * x[k]
                })
                .sum::<f64>()
        };
        let separation = Separation { at: [0, 3], distance: 1.0 };
        let mut apart = Constraints::new(6, vec![], Some(separation));
        let end =
            minimise(&mut pull, &mut apart, &start(&[2.0, 0.3, 0.0, -1.0, 0.5, 1.0]), &Settings::default());
        assert!((end.value - 0.5).abs() < 1e-6, "{end:?}");
        assert!(apart.violation(&end.x) < 1e-9);
    }

    #[test]
    fn spec_a_function_that_is_not_finite_ends_at_its_start() {
        let mut bad = |_: &Vars, _: &mut Vars| f64::NAN;
        let end = minimise(
            &mut bad,
            &mut Constraints::new(2, vec![], None),
            &start(&[1.0, 2.0]),
            &Settings::default(),
        );
        assert!(!end.converged && end.x[0] == 1.0 && end.x[1] == 2.0);
    }
}
