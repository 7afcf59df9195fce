//! The variables of a superframe: for each vehicle the positions that its users share or have for themselves, and for each
//! user both axes and J's power, in the coordinates of the planner's charts.

use super::super::expectation::kernel::{Raw, VEHICLE};
use super::super::powers;
use super::super::search;
use super::super::setup::Setup;
use super::super::solver::limited::{Apart, Rows, SparseRow};
use super::super::solver::{MAX, Vars};
use super::super::variables::{AxisChart, Chart};

/// Unit of positions in metres: with those of angles and of logarithms of a power, what changes a volume about as much.
const UNIT_M: f64 = 50.0;
const UNIT_RAD: f64 = 0.1;
const UNIT_LOG: f64 = 0.5;

/// Which users share a position, by vehicle: users of the same number have one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern(pub [Vec<usize>; 2]);

impl Pattern {
    /// One position for all, of either vehicle.
    #[cfg(test)]
    pub fn shared(users: usize) -> Self {
        Self([vec![0; users], vec![0; users]])
    }

    /// Positions that are the same to the last bit are shared.
    pub fn of(raws: &[Raw]) -> Self {
        let same = |a: &Raw, b: &Raw, at: usize| (0..3).all(|k| a[at + k].to_bits() == b[at + k].to_bits());
        let first = |user: usize, at: usize| {
            (0..user).find(|other| same(&raws[*other], &raws[user], at)).unwrap_or(user)
        };
        Self([0, VEHICLE].map(|at: usize| (0..raws.len()).map(|user| first(user, at)).collect()))
    }
}

/// How far the variables of a search reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axes {
    /// J's null stays on its user.
    Nulled,
    /// J's axis is free, where that can gain anything.
    Free,
}

/// One user's part of the variables.
#[derive(Debug, Clone)]
struct Part {
    chart: Chart,
    /// Where each variable of the chart is among all; none where it is held.
    index: [Option<usize>; MAX],
    /// A chart's variable over the one of the search.
    scale: Vars,
    held: Vars,
}

/// The variables of a search and their feasible set.
#[derive(Debug, Clone)]
pub struct Layout {
    parts: Vec<Part>,
    /// Number of variables.
    pub dimension: usize,
}

impl Part {
    fn new(setup: &Setup, raw: &Raw, axes: Axes) -> Self {
        let chart = chart(setup, raw, axes);
        let mut scale = [1.0; MAX];
        for v in 0..2 {
            let from = chart.offset(v) + 3;
            let powers = from + chart.axes[v].variables();
            scale[from..powers].fill(UNIT_RAD);
            scale[powers..chart.offset(v) + chart.vehicle_dimension(v)].fill(UNIT_LOG);
        }
        Self { chart, index: [None; MAX], scale, held: chart.encode(raw) }
    }

    fn local(&self, x: &[f64]) -> Vars {
        let mut local = self.held;
        for (k, index) in self.index.iter().enumerate() {
            if let Some(index) = index {
                local[k] = self.scale[k] * x[*index];
            }
        }
        local
    }
}

/// The chart of one user.
fn chart(setup: &Setup, raw: &Raw, axes: Axes) -> Chart {
    let power = powers::of(setup, raw);
    let exact = !setup.varies() && setup.nulls_exactly();
    let chart = if exact {
        search::chart(setup, true, search::nulled(setup, power))
    } else {
        search::chart(setup, axes == Axes::Nulled, power)
    };
    Chart { length_m: UNIT_M, ..chart }
}

impl Layout {
    /// Of a superframe in which users share positions by `pattern`, about a configuration of each.
    pub fn new(setups: &[Setup], raws: &[Raw], pattern: &Pattern, axes: Axes) -> Self {
        let mut parts: Vec<Part> =
            setups.iter().zip(raws).map(|(setup, raw)| Part::new(setup, raw, axes)).collect();
        let mut dimension = 0;
        let mut next = || {
            dimension += 1;
            dimension - 1
        };
        for v in 0..2 {
            let mut known: Vec<(usize, [usize; 3])> = Vec::new();
            for (part, group) in parts.iter_mut().zip(&pattern.0[v]) {
                let own = known.iter().find(|(of, _)| of == group).map(|(_, at)| *at);
                let at = own.unwrap_or_else(|| {
                    let at = [next(), next(), next()];
                    known.push((*group, at));
                    at
                });
                for k in 0..3 {
                    part.index[part.chart.offset(v) + k] = Some(at[k]);
                }
            }
        }
        for part in &mut parts {
            Self::free(part, &mut next);
        }
        Self { parts, dimension }
    }

    /// Of one user's axes and power, at held positions.
    pub fn in_place(setup: &Setup, raw: &Raw) -> Self {
        let mut part = Part::new(setup, raw, Axes::Nulled);
        let mut dimension = 0;
        Self::free(&mut part, &mut || {
            dimension += 1;
            dimension - 1
        });
        Self { parts: vec![part], dimension }
    }

    /// Gives axes and powers variables of their own.
    fn free(part: &mut Part, next: &mut impl FnMut() -> usize) {
        for v in 0..2 {
            let from = part.chart.offset(v);
            for k in from + 3..from + part.chart.vehicle_dimension(v) {
                part.index[k] = Some(next());
            }
        }
    }

    /// The variables at a configuration of each user; of a shared position the last one's.
    pub fn encode(&self, raws: &[Raw]) -> Vec<f64> {
        let mut x = vec![0.0; self.dimension];
        for (part, raw) in self.parts.iter().zip(raws) {
            let local = part.chart.encode(raw);
            for (k, index) in part.index.iter().enumerate() {
                if let Some(index) = index {
                    x[*index] = local[k] / part.scale[k];
                }
            }
        }
        x
    }

    /// The configurations at `x`.
    pub fn raws(&self, x: &[f64]) -> Vec<Raw> {
        self.parts.iter().map(|part| part.chart.raw(&part.local(x))).collect()
    }

    /// Carries gradients by the configurations `raws` at `x` to the variables.
    pub fn pull(&self, x: &[f64], raws: &[Raw], by_raws: &[Raw], out: &mut [f64]) {
        out.fill(0.0);
        for ((part, raw), by_raw) in self.parts.iter().zip(raws).zip(by_raws) {
            let mut by_local = [0.0; MAX];
            part.chart.pull(&part.local(x), raw, by_raw, &mut by_local);
            for (k, index) in part.index.iter().enumerate() {
                if let Some(index) = index {
                    out[*index] += part.scale[k] * by_local[k];
                }
            }
        }
    }

    /// The feasible set, with each user's vehicles in the given cells of the region.
    pub fn rows(&self, setups: &[Setup], cells: &[[usize; 2]]) -> Rows {
        let mut rows: Vec<SparseRow> = Vec::new();
        let mut apart: Vec<Apart> = Vec::new();
        for ((part, setup), cells) in self.parts.iter().zip(setups).zip(cells) {
            let (air, chart) = (&setup.problem.airspace, &part.chart);
            let mut all = chart.constraints(&setup.region, *cells, 0.0).rows;
            for v in 0..2 {
                if let AxisChart::Angles { .. } = chart.axes[v] {
                    all.extend(quarter_turns(chart.offset(v) + 3));
                }
            }
            for row in all {
                let mut sparse = SparseRow { terms: Vec::new(), b: row.b };
                for (k, a) in row.a.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                    match part.index[k] {
                        Some(index) => sparse.terms.push((index, a * part.scale[k])),
                        None => sparse.b -= a * part.held[k],
                    }
                }
                // Users that share a position share its limits.
                if !sparse.terms.is_empty() && !rows.contains(&sparse) {
                    rows.push(sparse);
                }
            }
            let at = [0, 1].map(|v: usize| part.index[chart.offset(v)]);
            if let [Some(i), Some(j)] = at
                && air.min_separation_m > 0.0
                && !apart.iter().any(|known| known.at == [i, j])
            {
                apart.push(Apart { at: [i, j], distance: air.min_separation_m / UNIT_M });
            }
        }
        Rows::new(rows, apart)
    }
}

/// Roll and pitch within a quarter turn: beyond, the same antenna is another attitude, and a turn from one to the other takes
/// its time.
fn quarter_turns(at: usize) -> impl Iterator<Item = super::super::solver::Row> {
    (0..2).flat_map(move |k| {
        [-1.0, 1.0].map(|sign| {
            let mut a = [0.0; MAX];
            a[at + k] = sign;
            super::super::solver::Row { a, b: std::f64::consts::FRAC_PI_2 }
        })
    })
}
