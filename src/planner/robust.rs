//! Uncertain eavesdroppers: the 5% quantile and the worst case as objectives. (The mean is part of the expectation: each
//! sixteen samples of attitude noise have a draw of the positions of their own.)
//!
//! *Quantile.* Let `F_d(x)` be the expected rate at draw d of the positions, the same attitude noise for each draw. The
//! 5% quantile of the F_d is smoothed into their mean with a triangular weight over the lowest tenth of the ranks. Few draws
//! matter to it, and many are needed lest a dozen variables fit the few that do: of many draws those that are lowest at
//! the present x are searched over, and those that have become low join them, until the quantile over all gains no more.
//!
//! *Worst case.* `max_x min_e F(x, e)`, e within the discs (for a Gaussian: within the circle that holds 95%). A finite
//! set E of positions stands for the discs; in turn, x maximises the soft minimum of `F(x, e)` over E, and the worst e for
//! that x joins E, until it is no worse than E's own (cutting planes). The best x by its true worst case is kept.
//!
//! *The worst positions* for an x maximise `E max_j ln(1 + Gamma_j(e_j))`: node by node, the others held, by a scan of the
//! disc and a pattern search with halved steps, until a whole round gains nothing; from each node's own worst point and
//! from the worst positions known before.

use nalgebra::Vector3;

use super::expectation::beams::Beams;
use super::expectation::kernel::Raw;
use super::expectation::logarithm::LogSum;
use super::expectation::samples::Samples;
use super::expectation::sobol;
use super::model::{Local, Memory, Solver, Target};
use super::problem::{Eavesdropper, Uncertainty};
use super::setup::Setup;
use super::solver::active_set;
use super::variables::Chart;

/// The quantile that is maximised.
pub const QUANTILE: f64 = 0.05;

/// How finely an objective over draws is resolved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    /// To sort out many candidates.
    Coarse,
    /// To compare few.
    Medium,
    /// For the plan.
    Fine,
}
/// Of so many draws one is among the lowest that a quantile is searched over: these hold its weights twice over.
const LOWEST_SHARE: usize = 5;
/// A gain of the quantile, in nats, that is worth another round.
const WORTH: f64 = 1e-4;
/// Sharpness of the soft minimum, per nat.
const SHARPNESS: [f64; 2] = [30.0, 1000.0];
/// A worst case this near to the set's own, in nats, is settled.
const SETTLED: f64 = 2e-4;
/// Points of a disc's scan: the centre and two rings.
const RING: usize = 12;
/// Rounds over all nodes in one search for the worst positions.
const ROUNDS: usize = 6;

/// How the rates of draws are combined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Combination {
    /// The smoothed quantile of so many draws, of which those present are the lowest.
    Quantile {
        /// All draws.
        of: usize,
    },
    /// The soft minimum of this sharpness.
    SoftMinimum(f64),
}

/// Rates and gradients of draws, and their combination; reusable memory.
#[derive(Debug, Clone, Default)]
pub struct Draws {
    values: Vec<f64>,
    gradients: Vec<Raw>,
    order: Vec<usize>,
}

impl Draws {
    /// Forgets all draws.
    pub fn clear(&mut self) {
        self.values.clear();
        self.gradients.clear();
    }

    /// Adds a draw's rate and gradient.
    pub fn push(&mut self, value: f64, gradient: &Raw) {
        self.values.push(value);
        self.gradients.push(*gradient);
    }

    /// The combined rate and its gradient.
    pub fn combine(&mut self, combination: Combination, gradient: &mut Raw) -> f64 {
        gradient.fill(0.0);
        let mut add = |weight: f64, of: &Raw| {
            for (g, c) in gradient.iter_mut().zip(of) {
                *g += weight * c;
            }
        };
        match combination {
            Combination::Quantile { of } => {
                self.order.clear();
                self.order.extend(0..self.values.len());
                self.order
                    .sort_unstable_by(|a, b| self.values[*a].total_cmp(&self.values[*b]).then(a.cmp(b)));
                let n = of as f64;
                let weight =
                    |rank: usize| (1.0 - ((rank as f64 + 0.5) / n - QUANTILE).abs() / QUANTILE).max(0.0);
                let total: f64 = (0..self.order.len()).map(weight).sum::<f64>().max(f64::MIN_POSITIVE);
                let mut value = 0.0;
                for (rank, draw) in self.order.iter().enumerate().take_while(|(rank, _)| weight(*rank) > 0.0)
                {
                    value += weight(rank) / total * self.values[*draw];
                    add(weight(rank) / total, &self.gradients[*draw]);
                }
                value
            }
            Combination::SoftMinimum(q) => {
                let least = self.values.iter().copied().fold(f64::INFINITY, f64::min);
                let weight = |value: f64| libm::exp(-q * (value - least));
                let total: f64 = self.values.iter().map(|v| weight(*v)).sum();
                for (value, of) in self.values.iter().zip(&self.gradients) {
                    add(weight(*value) / total, of);
                }
                least - libm::log(total) / q
            }
        }
    }
}

/// The radius of the circle in which a node is taken to be, in metres.
fn radius_m(node: &Eavesdropper) -> f64 {
    match node.uncertainty {
        Uncertainty::None => 0.0,
        Uncertainty::Disc { radius_m } => radius_m,
        Uncertainty::Gaussian { std_m } => std_m * (-2.0 * libm::log(QUANTILE)).sqrt(),
    }
}

/// Maximises the quantile from a start; the value is the smoothed quantile over all draws.
pub fn maximise_quantile(
    setup: &Setup,
    chart: &Chart,
    start: Local,
    seed: u64,
    resolution: Resolution,
    memory: &mut Memory,
) -> Local {
    let (draws, count, rounds) = match resolution {
        Resolution::Coarse => (256, 32, 1),
        Resolution::Medium => (512, 32, 2),
        Resolution::Fine => (2048, 64, 4),
    };
    let positions = Samples::positions(setup.problem, draws, sobol::mix(seed, 2));
    let shared = |positions| Samples::shared(setup.problem, count, positions, sobol::mix(seed, 1));
    let all = shared(positions.clone());
    let combination = Combination::Quantile { of: draws };
    let mut is_low = vec![false; draws];
    let mut best = Local { value: memory.quantile(setup, &all, &start.raw, &mut is_low), ..start };
    let mut at = best;
    for _ in 0..rounds {
        let low = positions.iter().zip(&is_low).filter(|(_, low)| **low).map(|(draw, _)| draw.clone());
        let samples = shared(low.collect());
        let target = Target::OverDraws { samples: &samples, combination };
        at = memory.maximise(setup, chart, target, &at.raw, &settings(60)).unwrap_or(at);
        let value = memory.quantile(setup, &all, &at.raw, &mut is_low);
        let gain = value - best.value;
        if gain > 0.0 {
            best = Local { value, ..at };
        }
        if gain < WORTH && gain > -WORTH {
            break;
        }
    }
    best
}

impl Memory {
    /// The smoothed quantile over all draws of `samples`; the lowest of them join `is_low`.
    fn quantile(&mut self, setup: &Setup, samples: &Samples, raw: &Raw, is_low: &mut [bool]) -> f64 {
        let combination = Combination::Quantile { of: is_low.len() };
        let value = self.value(setup, Target::OverDraws { samples, combination }, raw, &mut [0.0; 14]);
        self.draws.order.iter().take(is_low.len() / LOWEST_SHARE).for_each(|draw| is_low[*draw] = true);
        value
    }
}

fn settings(iterations: usize) -> Solver {
    Solver::ActiveSet(active_set::Settings { iterations, tolerance: 1e-6, ..active_set::Settings::default() })
}

/// Maximises the worst case from a start; the value is the true worst case.
pub fn maximise_worst_case(
    setup: &Setup,
    chart: &Chart,
    start: Local,
    seed: u64,
    resolution: Resolution,
    memory: &mut Memory,
) -> Local {
    let (count, rounds) = match resolution {
        Resolution::Coarse | Resolution::Medium => (64, 6),
        Resolution::Fine => (256, 10),
    };
    let estimates: Vec<_> = setup.problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect();
    let mut known = vec![estimates];
    let mut samples = Samples::shared(setup.problem, count, known.clone(), sobol::mix(seed, 1));
    let (worst, value) = worst_positions(setup, &start.raw, &samples, &known);
    samples.push_draw(worst.clone());
    known.push(worst);
    let mut best = Local { value, ..start };
    let mut at = best;
    for _ in 0..rounds {
        for q in SHARPNESS {
            let target = Target::OverDraws { samples: &samples, combination: Combination::SoftMinimum(q) };
            at = memory.maximise(setup, chart, target, &at.raw, &settings(40)).unwrap_or(at);
        }
        let (worst, value) = worst_positions(setup, &at.raw, &samples, &known);
        let promised = at.value;
        if value > best.value {
            best = Local { value, ..at };
        }
        if value >= promised - SETTLED {
            break;
        }
        samples.push_draw(worst.clone());
        known.push(worst);
    }
    best
}

/// The worst positions found for a configuration and the mean signed rate there, in nats per hertz.
pub fn worst_positions(
    setup: &Setup,
    raw: &Raw,
    samples: &Samples,
    known: &[Vec<Vector3<f64>>],
) -> (Vec<Vector3<f64>>, f64) {
    let nodes = &setup.problem.eavesdroppers;
    let beams = Beams::new(&setup.scene, samples, raw);
    let mut search = Worst { beams: &beams, nodes, sinr: vec![Vec::new(); nodes.len()], trial: Vec::new() };
    let mut best: Option<(Vec<Vector3<f64>>, f64)> = None;
    // From each node's own worst point, and from the newest positions known.
    for from in [None, known.last()] {
        let mut positions: Vec<_> = match from {
            Some(positions) => positions.clone(),
            None => nodes.iter().map(|e| e.position_enu_m).collect(),
        };
        let loss = search.run(&mut positions, from.is_none());
        if best.as_ref().is_none_or(|(_, least)| loss > *least) {
            best = Some((positions, loss));
        }
    }
    let (positions, loss) = best.unwrap_or_default();
    (positions, beams.user_mean() - loss)
}

/// A search for the worst positions: SINR of every node at every sample, at its current position.
struct Worst<'a> {
    beams: &'a Beams,
    nodes: &'a [Eavesdropper],
    sinr: Vec<Vec<f64>>,
    trial: Vec<f64>,
}

impl Worst<'_> {
    /// Moves `positions` to a local maximum of `E max_j ln(1 + Gamma_j)`, which is returned; `alone` begins with each
    /// node's own worst point.
    fn run(&mut self, positions: &mut [Vector3<f64>], alone: bool) -> f64 {
        for node in 0..self.nodes.len() {
            self.sinr[node].clear();
            if !alone {
                self.beams.sinr(&positions[node], &mut self.sinr[node]);
            }
        }
        let mut others = Vec::new();
        let mut loss = f64::NEG_INFINITY;
        for round in 0..ROUNDS {
            let before = loss;
            for node in 0..self.nodes.len() {
                self.strongest_other(node, alone && round == 0, &mut others);
                loss = self.move_node(node, &mut positions[node], &others);
            }
            if loss - before < 0.1 * SETTLED && round > 0 {
                break;
            }
        }
        loss
    }

    /// Largest SINR of the other nodes per sample; zeros when `alone`.
    fn strongest_other(&self, node: usize, alone: bool, out: &mut Vec<f64>) {
        out.clear();
        out.resize(self.beams.len(), 0.0);
        if !alone {
            for (_, sinr) in self.sinr.iter().enumerate().filter(|(other, _)| *other != node) {
                for (o, s) in out.iter_mut().zip(sinr) {
                    *o = o.max(*s);
                }
            }
        }
    }

    /// Scans the node's disc and refines the best point; leaves its SINR in place.
    fn move_node(&mut self, node: usize, position: &mut Vector3<f64>, others: &[f64]) -> f64 {
        let (centre, radius) = (self.nodes[node].position_enu_m, radius_m(&self.nodes[node]));
        let mut best = (*position, self.loss_at(position, others));
        let consider = |search: &mut Self, at: Vector3<f64>, best: &mut (Vector3<f64>, f64)| {
            let loss = search.loss_at(&at, others);
            let better = loss > best.1;
            if better {
                *best = (at, loss);
            }
            better
        };
        if radius > 0.0 {
            consider(self, centre, &mut best);
            for k in 0..2 * RING {
                let angle = std::f64::consts::TAU * (k % RING) as f64 / RING as f64;
                let r = if k < RING { radius } else { 0.5 * radius };
                let (sin, cos) = libm::sincos(angle);
                consider(self, centre + r * Vector3::new(cos, sin, 0.0), &mut best);
            }
            let mut step = 0.25 * radius;
            while step > 1e-3 * radius {
                let mut moved = false;
                for (dx, dy) in [(step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step)] {
                    let offset = best.0 + Vector3::new(dx, dy, 0.0) - centre;
                    let length = offset.norm();
                    // Back onto the disc along its radius: a step off the rim slides along it.
                    let offset = if length > radius { offset * (radius / length) } else { offset };
                    moved |= consider(self, centre + offset, &mut best);
                }
                if !moved {
                    step *= 0.5;
                }
            }
        }
        *position = best.0;
        self.sinr[node].clear();
        let mut sinr = std::mem::take(&mut self.sinr[node]);
        self.beams.sinr(position, &mut sinr);
        self.sinr[node] = sinr;
        best.1
    }

    fn loss_at(&mut self, position: &Vector3<f64>, others: &[f64]) -> f64 {
        self.trial.clear();
        self.beams.sinr(position, &mut self.trial);
        // Eight factors at a time, as in the kernel.
        let products = self.trial.chunks(8).zip(others.chunks(8));
        let mut total = LogSum::default();
        products.for_each(|(t, o)| total.push(t.iter().zip(o).map(|(a, b)| 1.0 + a.max(*b)).product()));
        total.value() / self.beams.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_soft_minimum_and_quantile_of_known_values() {
        let mut draws = Draws::default();
        for k in 0..40 {
            let mut gradient = [0.0; 14];
            gradient[0] = f64::from(k);
            draws.push(f64::from(k), &gradient);
        }
        let mut gradient = [0.0; 14];
        // Ranks 0 to 3 of 40, weights 1/4, 3/4, 3/4, 1/4: symmetric about the 5% point, 1.5.
        assert!((draws.combine(Combination::Quantile { of: 40 }, &mut gradient) - 1.5).abs() < 1e-12);
        assert!((gradient[0] - 1.5).abs() < 1e-12);
        assert!(draws.combine(Combination::SoftMinimum(1e3), &mut gradient).abs() < 1e-12);
        assert!(gradient[0].abs() < 1e-12);
        let soft = draws.combine(Combination::SoftMinimum(1.0), &mut gradient);
        assert!((soft + (1.0 / (1.0 - (-1f64).exp())).ln()).abs() < 1e-12);
    }
}
