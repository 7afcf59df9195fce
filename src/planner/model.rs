//! The objective of a search on a chart: which expectation, over which samples, in which variables.

use super::draws::{Combination, Draws};
use super::expectation::exact::Exact;
use super::expectation::kernel::{Raw, Workspace};
use super::expectation::samples::Samples;
use super::setup::Setup;
use super::solver::dense::Matrix;
use super::solver::{self, Constraints, Outcome, Vars, active_set, interior_point};
use super::variables::Chart;

/// What is maximised.
#[derive(Debug, Clone, Copy)]
pub enum Target<'a> {
    /// No jitter, estimated positions, the maximum smoothed with this sharpness.
    Exact(f64),
    /// The mean over samples; with `clip`, of [.]^+.
    Mean {
        /// The samples.
        samples: &'a Samples,
        /// Whether [.]^+ is inside.
        clip: bool,
    },
    /// A combination of the means of draws of the positions.
    OverDraws {
        /// The samples.
        samples: &'a Samples,
        /// How draws are combined.
        combination: Combination,
        /// Whether [.]^+ is inside each draw's mean.
        clip: bool,
    },
}

/// The local solver of a search.
// Copied once a start; a box would allocate in the search.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy)]
pub enum Solver {
    /// [`active_set`].
    ActiveSet(active_set::Settings),
    /// [`interior_point`].
    InteriorPoint(interior_point::Settings),
}

/// A local solution.
#[derive(Debug, Clone, Copy)]
pub struct Local {
    /// The configuration.
    pub raw: Raw,
    /// Its objective in nats per hertz.
    pub value: f64,
    /// Whether the solver's tolerance was met.
    pub converged: bool,
    /// The inverse Hessian that its solver learnt, in the chart's variables.
    pub curvature: Option<Matrix>,
}

/// Memory of evaluations, one per thread.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    sampled: Workspace,
    exact: Exact,
    pub(super) draws: Draws,
}

/// Crossings of a cut between cells that one search may make.
const MOST_CROSSINGS: usize = 4;
/// A position this deep in a cut (in units of the chart's length) lies on it.
const ON_CUT: f64 = 1e-9;
/// How far, in the same units, the rounding of many steps along an active limit may lead over it before it is taken back.
const DRIFT: f64 = 1e-13;

impl Memory {
    /// The objective in nats per hertz, its gradient written to `gradient`.
    pub fn value(&mut self, setup: &Setup, target: Target, raw: &Raw, gradient: &mut Raw) -> f64 {
        let scene = &setup.scene;
        match target {
            Target::Exact(q) => self.exact.value(scene, setup.eavesdroppers(), raw, q, Some(gradient)),
            Target::Mean { samples, clip } => self.sampled.mean(scene, samples, raw, clip, Some(gradient)),
            Target::OverDraws { samples, combination, clip } => {
                let value = self.over_draws(setup, raw, samples, combination, clip);
                let weights = self.draws.weights();
                self.sampled.weighted_gradient(scene, samples, raw, clip, weights, gradient);
                value
            }
        }
    }

    /// The same of a mean or of nothing random, without its gradient.
    pub fn value_alone(&mut self, setup: &Setup, target: Target, raw: &Raw) -> f64 {
        let scene = &setup.scene;
        match target {
            Target::Exact(q) => self.exact.value(scene, setup.eavesdroppers(), raw, q, None),
            Target::Mean { samples, clip } => self.sampled.mean(scene, samples, raw, clip, None),
            Target::OverDraws { samples, combination, clip } => {
                self.over_draws(setup, raw, samples, combination, clip)
            }
        }
    }

    /// A combination of the draws' means, without its gradient.
    pub(super) fn over_draws(
        &mut self,
        setup: &Setup,
        raw: &Raw,
        samples: &Samples,
        combination: Combination,
        clip: bool,
    ) -> f64 {
        self.draws.values.clear();
        self.sampled.means_of_draws(&setup.scene, samples, raw, clip, &mut self.draws.values);
        self.draws.combine(combination)
    }

    /// A local maximum from `start`, which is moved into the feasible set first, or from the setup's resort if that
    /// fails; `None` without a finite value.
    pub fn maximise(
        &mut self,
        setup: &Setup,
        chart: &Chart,
        target: Target,
        start: &Raw,
        solver: &Solver,
    ) -> Option<Local> {
        self.climb(setup, chart, target, start, solver)
            .or_else(|| self.climb(setup, chart, target, &setup.resort(start), solver))
    }

    fn climb(
        &mut self,
        setup: &Setup,
        chart: &Chart,
        target: Target,
        start: &Raw,
        solver: &Solver,
    ) -> Option<Local> {
        let air = &setup.problem.airspace;
        let mut x = chart.encode(start);
        let mut best: Option<Local> = None;
        for _ in 0..=MOST_CROSSINGS {
            let raw = chart.raw(&x);
            let cells = self.cells(setup, &raw, best.is_some());
            let mut constraints = chart.constraints(&setup.region, cells, air.min_separation_m);
            let strictly =
                matches!(solver, Solver::InteriorPoint(_)) && repair(&mut constraints, &mut x, true);
            if !strictly && !repair(&mut constraints, &mut x, false) {
                return None;
            }
            // A feasible set without an interior (a band of one altitude) is for the active-set method alone.
            let solver = if strictly { *solver } else { active(solver) };
            let mut outcome = self.solve(setup, chart, target, &mut constraints, &x, &solver);
            if constraints.violation(&outcome.x) > DRIFT {
                repair(&mut constraints, &mut outcome.x, false);
            }
            let value = -outcome.value;
            let gained = best.as_ref().is_none_or(|b| value > b.value + 1e-9);
            if gained {
                best = Some(Local {
                    raw: chart.raw(&outcome.x),
                    value,
                    converged: outcome.converged,
                    curvature: outcome.curvature,
                });
            }
            x = outcome.x;
            if !gained || !on_cut(setup, cells, &chart.raw(&x), chart.length_m) {
                break;
            }
        }
        best.filter(|b| b.value.is_finite())
    }

    fn solve(
        &mut self,
        setup: &Setup,
        chart: &Chart,
        target: Target,
        constraints: &mut Constraints,
        x: &Vars,
        solver: &Solver,
    ) -> Outcome {
        let mut by_raw = [0.0; 14];
        let mut objective = |x: &Vars, gradient: &mut Vars| {
            let raw = chart.raw(x);
            let value = self.value(setup, target, &raw, &mut by_raw);
            chart.pull(x, &raw, &by_raw, gradient);
            for c in gradient.iter_mut() {
                *c = -*c;
            }
            -value
        };
        match solver {
            Solver::ActiveSet(settings) => active_set::minimise(&mut objective, constraints, x, settings),
            Solver::InteriorPoint(settings) => {
                interior_point::minimise(&mut objective, constraints, x, settings)
            }
        }
    }

    /// The cells of both positions; `other` asks for the neighbour across a cut.
    fn cells(&self, setup: &Setup, raw: &Raw, other: bool) -> [usize; 2] {
        [0, 7].map(|at| {
            let p = nalgebra::Vector3::new(raw[at], raw[at + 1], raw[at + 2]);
            let home = setup.region.cell_of(&p);
            let tolerance = ON_CUT * setup.length_m;
            let across = (0..setup.region.cells().len())
                .find(|c| *c != home && setup.region.depth_m(*c, &p) >= -tolerance);
            if other { across.unwrap_or(home) } else { home }
        })
    }
}

/// Whether a position is on a cut of its cell.
fn on_cut(setup: &Setup, cells: [usize; 2], raw: &Raw, length_m: f64) -> bool {
    [0, 7].iter().zip(cells).any(|(at, cell)| {
        let p = nalgebra::Vector2::new(raw[*at], raw[at + 1]);
        setup.region.cells()[cell]
            .sides
            .iter()
            .any(|h| h.cut && (h.offset_m - h.normal.dot(&p)).abs() <= ON_CUT * length_m)
    })
}

/// The active-set method in place of `solver`.
fn active(solver: &Solver) -> Solver {
    match solver {
        Solver::ActiveSet(_) => *solver,
        Solver::InteriorPoint(_) => Solver::ActiveSet(active_set::Settings::default()),
    }
}

/// Moves `x` into the feasible set by projections, strictly inside if so asked; false if they do not settle.
fn repair(constraints: &mut Constraints, x: &mut Vars, strictly: bool) -> bool {
    let mut margin = if strictly { 1e-3 } else { 0.0 };
    for round in 0..200 {
        // The margin shrinks where the feasible set is too thin for it.
        margin *= if round > 0 && round % 2 == 0 { 0.9 } else { 1.0 };
        constraints.refresh(x);
        let mut inside = true;
        for k in 0..constraints.rows.len() {
            let slack = constraints.slack(k, x);
            if slack < 0.5 * margin || slack < 0.0 {
                inside = false;
                let row = constraints.rows[k];
                let square = solver::dense::dot(&row.a, &row.a);
                for (c, a) in x.iter_mut().zip(&row.a) {
                    *c += (slack - margin) * a / square;
                }
            }
        }
        if inside {
            return true;
        }
    }
    constraints.refresh(x);
    !strictly && constraints.violation(x) < 1e-12
}
