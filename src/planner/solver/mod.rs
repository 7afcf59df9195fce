//! Local solvers: minimise a smooth function of up to [`MAX`] variables subject to linear inequalities.
//!
//! The planner's charts ([`super::variables`]) make every constraint of a mission linear, but for the separation of the
//! two vehicles, which is not convex: it is replaced at each iterate by the half-space `n . (p_I - p_J) >= s` with n the
//! current direction, an inner approximation (`|v| >= n . v`), so that iterates stay feasible.

pub mod active_set;
pub mod boxed;
pub mod dense;
pub mod interior_point;
pub mod limited;
mod line;

/// Most variables of a problem.
pub const MAX: usize = 14;

/// A vector of variables; entries beyond the problem's dimension are 0.
pub type Vars = [f64; MAX];

/// A smooth function.
pub trait Objective {
    /// The value at `x`, its gradient written to `gradient`.
    fn evaluate(&mut self, x: &Vars, gradient: &mut Vars) -> f64;
}

impl<F: FnMut(&Vars, &mut Vars) -> f64> Objective for F {
    fn evaluate(&mut self, x: &Vars, gradient: &mut Vars) -> f64 {
        self(x, gradient)
    }
}

/// The constraint `a . x <= b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Coefficients.
    pub a: Vars,
    /// Bound.
    pub b: f64,
}

/// Least distance between two triples of variables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separation {
    /// First variable of either triple.
    pub at: [usize; 2],
    /// Least distance.
    pub distance: f64,
}

/// A feasible set.
#[derive(Debug, Clone, PartialEq)]
pub struct Constraints {
    /// Number of variables.
    pub dimension: usize,
    /// Inequalities; the last one stands for the separation if there is one.
    pub rows: Vec<Row>,
    separation: Option<Separation>,
}

impl Constraints {
    /// Inequalities over `dimension` variables, and a separation.
    #[must_use]
    pub fn new(dimension: usize, mut rows: Vec<Row>, separation: Option<Separation>) -> Self {
        if separation.is_some() {
            rows.push(Row { a: [0.0; MAX], b: 0.0 });
        }
        Self { dimension, rows, separation }
    }

    /// Fits the separation's half-space to `x`.
    pub fn refresh(&mut self, x: &Vars) {
        let (Some(Separation { at: [i, j], distance }), Some(row)) = (self.separation, self.rows.last_mut())
        else {
            return;
        };
        let mut n = [0, 1, 2].map(|k: usize| x[i + k] - x[j + k]);
        let norm = n.iter().map(|c| c * c).sum::<f64>().sqrt();
        // Coinciding vehicles part along x.
        n = if norm > 0.0 { n.map(|c| c / norm) } else { [1.0, 0.0, 0.0] };
        row.a = [0.0; MAX];
        for k in 0..3 {
            row.a[i + k] = -n[k];
            row.a[j + k] = n[k];
        }
        row.b = -distance;
    }

    /// `b - a . x` of a row.
    #[must_use]
    pub fn slack(&self, row: usize, x: &Vars) -> f64 {
        self.rows[row].b - dense::dot(&self.rows[row].a, x)
    }

    /// Largest violation at `x`, 0 if feasible.
    pub fn violation(&mut self, x: &Vars) -> f64 {
        self.refresh(x);
        (0..self.rows.len()).map(|row| -self.slack(row, x)).fold(0.0, f64::max)
    }
}

/// Where a local solver ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// The best point.
    pub x: Vars,
    /// Its value.
    pub value: f64,
    /// Iterations spent.
    pub iterations: usize,
    /// Whether the tolerance was met.
    pub converged: bool,
    /// The inverse Hessian as it was learnt, if the method learns one and has.
    pub curvature: Option<dense::Matrix>,
}
