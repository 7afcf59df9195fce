//! A quasi-Newton method of limited memory for `min f(x)` subject to `a_k . x <= b_k`, over any number of variables: what
//! [`active_set`](super::active_set) does for the poses of one slot, for those of a whole superframe.
//!
//! Each iteration, with g the gradient, A the active rows, P the projection onto their null space and H the inverse Hessian
//! of the last few steps (Nocedal and Wright, 7.4):
//!
//! 1. The multipliers m of `g + A' m = 0` in the mean square; a row whose multiplier is negative becomes inactive, the most
//!    negative one first, and 1 again.
//! 2. The step `d = -P H P g`.
//! 3. The longest feasible step by the ratio test; a row that blocks at once becomes active, and 1 again.
//! 4. A line search for the weak Wolfe conditions (1e-4, 0.9) within that length.
//!
//! Rows are few numbers each (a vehicle's position, one angle), and few of them are active, so that an iteration costs next
//! to nothing beside the function. The separation of two vehicles is a half-space that is fitted to each iterate, as
//! everywhere in the planner. The best point is always feasible.

use std::collections::VecDeque;

use super::line;

/// Limits of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Most iterations.
    pub iterations: usize,
    /// Converged when the model promises a decrease below this.
    pub tolerance: f64,
    /// Length of the first step.
    pub first_step: f64,
}

/// Steps that are remembered.
const MEMORY: usize = 12;
/// A row is as good as reached from here on.
const REACHED: f64 = 1e-12;

/// The constraint `sum of terms <= b`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SparseRow {
    /// Variable and coefficient.
    pub terms: Vec<(usize, f64)>,
    /// Bound.
    pub b: f64,
}

impl SparseRow {
    fn dot(&self, x: &[f64]) -> f64 {
        self.terms.iter().map(|(k, a)| a * x[*k]).sum()
    }

    fn slack(&self, x: &[f64]) -> f64 {
        self.b - self.dot(x)
    }
}

/// Least distance between two triples of variables, in their unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Apart {
    /// First variable of either triple.
    pub at: [usize; 2],
    /// Least distance.
    pub distance: f64,
}

/// A feasible set.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rows {
    rows: Vec<SparseRow>,
    apart: Vec<Apart>,
    /// The first row that stands for a separation.
    fixed: usize,
}

impl Rows {
    /// Inequalities and separations.
    #[must_use]
    pub fn new(mut rows: Vec<SparseRow>, apart: Vec<Apart>) -> Self {
        let fixed = rows.len();
        rows.extend(apart.iter().map(|_| SparseRow::default()));
        Self { rows, apart, fixed }
    }

    /// Fits the separations' half-spaces to `x`.
    fn refresh(&mut self, x: &[f64]) {
        for (row, Apart { at: [i, j], distance }) in self.rows[self.fixed..].iter_mut().zip(&self.apart) {
            let n = [0, 1, 2].map(|k: usize| x[i + k] - x[j + k]);
            let norm = n.iter().map(|c| c * c).sum::<f64>().sqrt();
            // Coinciding vehicles part along x.
            let n = if norm > 0.0 { n.map(|c| c / norm) } else { [1.0, 0.0, 0.0] };
            row.terms.clear();
            for (k, c) in n.iter().enumerate() {
                row.terms.push((i + k, -c));
                row.terms.push((j + k, *c));
            }
            row.b = -distance;
        }
    }

    /// Moves `x` into the feasible set, row by row; false if that fails.
    #[must_use]
    pub fn repair(&mut self, x: &mut [f64]) -> bool {
        // A rounding's worth inside, so that the point found is not outside by one.
        const INSIDE: f64 = 1e-12;
        for _ in 0..200 {
            self.refresh(x);
            let mut inside = true;
            for row in &self.rows {
                let slack = row.slack(x);
                if slack < 0.0 {
                    inside = false;
                    let square: f64 = row.terms.iter().map(|(_, a)| a * a).sum();
                    for (k, a) in &row.terms {
                        x[*k] += (slack - INSIDE) * a / square;
                    }
                }
            }
            if inside {
                return true;
            }
        }
        self.violation(x) < REACHED
    }

    /// Largest violation at `x`, 0 if feasible.
    pub fn violation(&mut self, x: &[f64]) -> f64 {
        self.refresh(x);
        self.rows.iter().map(|row| -row.slack(x)).fold(0.0, f64::max)
    }
}

/// Where a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct End {
    /// The best point.
    pub x: Vec<f64>,
    /// Its value.
    pub value: f64,
    /// Whether the tolerance was met.
    pub converged: bool,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adds `scale * b` to `a`.
fn add(a: &mut [f64], scale: f64, b: &[f64]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += scale * b;
    }
}

/// A step and the change of the gradient along it, with the inverse of their product.
struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
    rho: f64,
}

struct State {
    x: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
    pairs: VecDeque<Pair>,
    active: Vec<usize>,
}

/// Orthonormal directions that span the active rows, and how each row is made of them.
struct Basis {
    directions: Vec<Vec<f64>>,
    /// Row by row: the coefficients of its own and the earlier directions.
    coefficients: Vec<Vec<f64>>,
}

impl Basis {
    /// Of the active rows; one that says nothing new is taken out of `active`.
    fn of(rows: &[SparseRow], active: &mut Vec<usize>, n: usize) -> Self {
        let mut basis = Self { directions: Vec::new(), coefficients: Vec::new() };
        active.retain(|row| {
            let mut rest = vec![0.0; n];
            for (k, a) in &rows[*row].terms {
                rest[*k] += a;
            }
            let length = dot(&rest, &rest).sqrt();
            let mut own = Vec::with_capacity(basis.directions.len() + 1);
            for direction in &basis.directions {
                let along = dot(direction, &rest);
                add(&mut rest, -along, direction);
                own.push(along);
            }
            let left = dot(&rest, &rest).sqrt();
            if !(left > 1e-9 * length) {
                return false;
            }
            rest.iter_mut().for_each(|c| *c /= left);
            own.push(left);
            basis.directions.push(rest);
            basis.coefficients.push(own);
            true
        });
        basis
    }

    fn project(&self, v: &mut [f64]) {
        for direction in &self.directions {
            let along = dot(direction, v);
            add(v, -along, direction);
        }
    }

    /// m of `g + A' m = 0`, in the mean square.
    fn multipliers(&self, gradient: &[f64]) -> Vec<f64> {
        let mut m: Vec<f64> = self.directions.iter().map(|direction| -dot(direction, gradient)).collect();
        for row in (0..m.len()).rev() {
            m[row] /= self.coefficients[row][row];
            let own = m[row];
            for (earlier, coefficient) in self.coefficients[row][..row].iter().enumerate() {
                m[earlier] -= own * coefficient;
            }
        }
        m
    }
}

/// Minimises `objective`, which writes its gradient, from `start`, which must be feasible.
pub fn minimise(
    objective: &mut impl FnMut(&[f64], &mut [f64]) -> f64,
    rows: &mut Rows,
    start: &[f64],
    settings: &Settings,
) -> End {
    let n = start.len();
    let mut gradient = vec![0.0; n];
    let value = objective(start, &mut gradient);
    let mut state = State { x: start.to_vec(), value, gradient, pairs: VecDeque::new(), active: Vec::new() };
    if !value.is_finite() {
        return End { x: state.x, value: f64::INFINITY, converged: false };
    }
    let mut converged = false;
    let mut iteration = 0;
    while iteration < settings.iterations {
        iteration += 1;
        rows.refresh(&state.x);
        // A separation that has turned away with its half-space is no longer reached.
        state.active.retain(|row| rows.rows[*row].slack(&state.x) <= 1e-9);
        let (direction, slope) = direction(&mut state, &rows.rows, settings);
        let (longest, blocking) = ratio_test(&state, &rows.rows, &direction);
        let blocked = blocking.filter(|_| longest <= 1e-13 && slope < -settings.tolerance);
        if let Some(row) = blocked {
            if state.active.len() >= n {
                break;
            }
            state.active.push(row);
            continue;
        }
        let moved = slope < -settings.tolerance
            && line_search(&mut state, objective, &direction, slope, longest, blocking);
        if !moved {
            converged = slope >= -settings.tolerance;
            if converged || state.pairs.is_empty() {
                break;
            }
            // What was learnt may be stale: once more along the gradient.
            state.pairs.clear();
        }
    }
    End { x: state.x, value: state.value, converged }
}

/// The step on the active rows, of which those with negative multipliers are let go, and the slope along it.
fn direction(state: &mut State, rows: &[SparseRow], settings: &Settings) -> (Vec<f64>, f64) {
    let basis = loop {
        let basis = Basis::of(rows, &mut state.active, state.x.len());
        let multipliers = basis.multipliers(&state.gradient);
        let worst = (0..multipliers.len()).min_by(|a, b| multipliers[*a].total_cmp(&multipliers[*b]));
        match worst.filter(|k| multipliers[*k] < 0.0) {
            Some(worst) => state.active.remove(worst),
            None => break basis,
        };
    };
    let mut step = state.gradient.clone();
    basis.project(&mut step);
    let mut shares = Vec::with_capacity(state.pairs.len());
    for pair in state.pairs.iter().rev() {
        let share = pair.rho * dot(&pair.s, &step);
        add(&mut step, -share, &pair.y);
        shares.push(share);
    }
    let scale = match state.pairs.back() {
        Some(pair) => 1.0 / (pair.rho * dot(&pair.y, &pair.y)),
        None => settings.first_step / dot(&step, &step).sqrt().max(1e-12),
    };
    step.iter_mut().for_each(|c| *c *= scale);
    for (pair, share) in state.pairs.iter().zip(shares.iter().rev()) {
        let back = pair.rho * dot(&pair.y, &step);
        add(&mut step, share - back, &pair.s);
    }
    basis.project(&mut step);
    step.iter_mut().for_each(|c| *c = -*c);
    let slope = dot(&step, &state.gradient);
    (step, slope)
}

/// The longest feasible multiple of `direction` and the row that limits it.
fn ratio_test(state: &State, rows: &[SparseRow], direction: &[f64]) -> (f64, Option<usize>) {
    let mut longest = 1e6;
    let mut blocking = None;
    for (index, row) in rows.iter().enumerate() {
        let rate = row.dot(direction);
        if rate > 1e-14 && !state.active.contains(&index) {
            let length = row.slack(&state.x).max(0.0) / rate;
            if length < longest {
                longest = length;
                blocking = Some(index);
            }
        }
    }
    (longest, blocking)
}

/// Moves along `direction`; false if no acceptable point was found.
fn line_search(
    state: &mut State,
    objective: &mut impl FnMut(&[f64], &mut [f64]) -> f64,
    direction: &[f64],
    slope: f64,
    longest: f64,
    blocking: Option<usize>,
) -> bool {
    let at = |length: f64| {
        let mut x = state.x.clone();
        add(&mut x, length, direction);
        let mut gradient = vec![0.0; x.len()];
        (objective(&x, &mut gradient), (x, gradient))
    };
    let slope_of = |(_, gradient): &(Vec<f64>, Vec<f64>)| dot(gradient, direction);
    let best = line::search((state.value, slope), longest, at, slope_of);
    let Some((value, (x, gradient), length)) = best else { return false };
    if let Some(row) = blocking.filter(|_| length >= longest) {
        state.active.push(row);
    }
    remember(state, &x, &gradient);
    (state.x, state.value, state.gradient) = (x, value, gradient);
    true
}

/// Keeps what a step has taught, if it is curved the right way.
fn remember(state: &mut State, x: &[f64], gradient: &[f64]) {
    let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
    let (s, y) = (difference(x, &state.x), difference(gradient, &state.gradient));
    let sy = dot(&s, &y);
    if sy > 1e-10 * (dot(&s, &s) * dot(&y, &y)).sqrt() {
        if state.pairs.len() == MEMORY {
            state.pairs.pop_front();
        }
        state.pairs.push_back(Pair { s, y, rho: 1.0 / sy });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: Settings = Settings { iterations: 200, tolerance: 1e-10, first_step: 0.2 };

    fn row(terms: &[(usize, f64)], b: f64) -> SparseRow {
        SparseRow { terms: terms.to_vec(), b }
    }

    /// Rosenbrock's function of each pair of neighbours.
    fn rosenbrock(x: &[f64], g: &mut [f64]) -> f64 {
        g.fill(0.0);
        (0..x.len() - 1)
            .map(|k| {
                let (a, b) = (1.0 - x[k], x[k + 1] - x[k] * x[k]);
                g[k] += -2.0 * a - 400.0 * x[k] * b;
                g[k + 1] += 200.0 * b;
                a * a + 100.0 * b * b
            })
            .sum()
    }

    #[test]
    fn val_rosenbrock_of_thirty_variables() {
        let end = minimise(&mut rosenbrock, &mut Rows::default(), &[0.3; 30], &SETTINGS);
        assert!(end.converged && end.value < 1e-8, "{end:?}");
    }

    #[test]
    fn val_rosenbrock_in_a_half_plane() {
        // On x + y <= 1 the minimum is at x = 0.618794, y = 0.381206, value 0.145607 (Lagrange, to six digits).
        let mut half = Rows::new(vec![row(&[(0, 1.0), (1, 1.0)], 1.0)], vec![]);
        let end = minimise(&mut rosenbrock, &mut half, &[-1.2, 1.0], &SETTINGS);
        assert!(end.converged && (end.value - 0.145_607).abs() < 1e-6, "{end:?}");
        assert!(half.violation(&end.x) < 1e-12);
    }

    #[test]
    fn val_a_linear_programme_ends_in_its_corner() {
        let mut corner = |x: &[f64], g: &mut [f64]| {
            g.copy_from_slice(&[1.0, -2.0, 3.0]);
            x[0] - 2.0 * x[1] + 3.0 * x[2]
        };
        let rows = (0..3).flat_map(|k| [row(&[(k, 1.0)], 1.0), row(&[(k, -1.0)], 1.0)]).collect();
        let end = minimise(&mut corner, &mut Rows::new(rows, vec![]), &[0.1; 3], &SETTINGS);
        assert!((end.value + 6.0).abs() < 1e-12 && end.converged, "{end:?}");
    }

    #[test]
    fn val_separations_hold_three_points_apart() {
        // One point is held 1 from each of two others; all want the origin.
        let mut pull = |x: &[f64], g: &mut [f64]| {
            x.iter()
                .zip(g)
                .map(|(x, g)| {
                    *g = 2.0 * x;
                    x * x
                })
                .sum::<f64>()
        };
        let apart = [3, 6].map(|other| Apart { at: [0, other], distance: 1.0 });
        let mut rows = Rows::new(vec![], apart.to_vec());
        let start = [2.0, 0.3, 0.1, -1.0, 0.5, 1.0, -1.0, -0.5, 0.7];
        let end = minimise(&mut pull, &mut rows, &start, &SETTINGS);
        assert!(rows.violation(&end.x) < 1e-9);
        // Both others together at 1/3, the one at 2/3: 4/9 + 2/9.
        assert!((end.value - 2.0 / 3.0).abs() < 1e-5, "{end:?}");
    }

    #[test]
    fn spec_a_point_outside_is_moved_in() {
        let rows = vec![row(&[(0, 1.0)], 1.0), row(&[(0, -1.0)], 0.0), row(&[(1, 2.0), (0, 1.0)], 1.0)];
        let mut rows = Rows::new(rows, vec![]);
        let mut x = [3.0, 3.0];
        assert!(rows.repair(&mut x) && rows.violation(&x) <= 0.0, "{x:?}");
        let mut impossible = Rows::new(vec![row(&[(0, 1.0)], 0.0), row(&[(0, -1.0)], -1.0)], vec![]);
        assert!(!impossible.repair(&mut [0.5]));
    }

    #[test]
    fn spec_a_function_that_is_not_finite_ends_at_its_start() {
        let mut bad = |_: &[f64], _: &mut [f64]| f64::NAN;
        let end = minimise(&mut bad, &mut Rows::default(), &[1.0, 2.0], &SETTINGS);
        assert!(!end.converged && end.x == [1.0, 2.0]);
    }
}
