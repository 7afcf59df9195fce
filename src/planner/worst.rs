//! The worst positions of uncertain eavesdroppers.
//!
//! For a configuration x they minimise the mean rate over the attitudes' noise, signed or with `[.]^+` inside: node by node,
//! the others held, by a scan of the disc and a pattern search with halved steps, until a whole round gains nothing; from
//! each node's own worst point and from the worst positions known before.

use nalgebra::Vector3;

use super::draws::QUANTILE;
use super::expectation::beams::{Beams, mean_rate};
use super::expectation::kernel::Raw;
use super::expectation::samples::Samples;
use super::problem::{Eavesdropper, Uncertainty};
use super::setup::Setup;

/// A worst case this near to the set's own, in nats, is settled.
pub const SETTLED: f64 = 2e-4;
/// Points of a disc's scan: the centre and two rings.
const RING: usize = 12;
/// [`Look::about_user`] of a search.
const ABOUT_USER: f64 = 0.05;
/// Rounds over all nodes in one search for the worst positions, and those of them that scan the whole discs.
const ROUNDS: usize = 6;
const SCANS: usize = 2;

/// How closely the worst positions are looked for.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    /// Whether a sample without secrecy counts as 0.
    pub clip: bool,
    /// Least step, as a share of a disc's radius. The rate is flat about a worst point: its error is of second order.
    pub least_step: f64,
    /// Places of a disc that holds the user which are nearer to it than this share of the radius are passed over. There the
    /// rate is 0 whatever the poses, and a search that knew of it would have nothing to climb.
    pub about_user: f64,
}

impl Look {
    /// For a figure that is given out.
    pub const FINAL: Self = Self { clip: true, least_step: 1e-3, about_user: 0.0 };

    /// For a search.
    pub fn of_search(clip: bool, least_step: f64) -> Self {
        Self { clip, least_step, about_user: ABOUT_USER }
    }
}

/// The radius of the circle in which a node is taken to be, in metres.
pub fn radius_m(node: &Eavesdropper) -> f64 {
    match node.uncertainty {
        Uncertainty::None => 0.0,
        Uncertainty::Disc { radius_m } => radius_m,
        Uncertainty::Gaussian { std_m } => std_m * (-2.0 * libm::log(QUANTILE)).sqrt(),
    }
}

/// The worst positions found for a configuration and the mean rate there, in nats per hertz.
pub fn worst_positions(
    setup: &Setup,
    raw: &Raw,
    samples: &Samples,
    known: &[Vec<Vector3<f64>>],
    look: &Look,
) -> (Vec<Vector3<f64>>, f64) {
    let nodes = &setup.problem.eavesdroppers;
    let beams = Beams::new(&setup.scene, samples, raw);
    let mut user = Vec::with_capacity(beams.len());
    beams.user_sinr(&mut user);
    let sinr = vec![Vec::new(); nodes.len()];
    let place = setup.problem.user_enu_m;
    let mut search = Worst { beams: &beams, nodes, place, user, look, sinr, trial: Vec::new() };
    let mut best: Option<(Vec<Vector3<f64>>, f64)> = None;
    // From each node's own worst point, and from the newest positions known.
    for from in [None, known.last()] {
        let mut positions: Vec<_> = match from {
            Some(positions) => positions.clone(),
            None => nodes.iter().map(|e| e.position_enu_m).collect(),
        };
        let rate = search.run(&mut positions, from.is_none());
        if best.as_ref().is_none_or(|(_, least)| rate < *least) {
            best = Some((positions, rate));
        }
    }
    best.unwrap_or_default()
}

/// A search for the worst positions: SINR of every node at every sample, at its current position.
struct Worst<'a> {
    beams: &'a Beams,
    nodes: &'a [Eavesdropper],
    /// Where the user is.
    place: Vector3<f64>,
    /// The user's SINR at every sample.
    user: Vec<f64>,
    look: &'a Look,
    sinr: Vec<Vec<f64>>,
    trial: Vec<f64>,
}

impl Worst<'_> {
    /// Moves `positions` to a local minimum of the mean rate, which is returned; `alone` begins with each node's own worst
    /// point.
    fn run(&mut self, positions: &mut [Vector3<f64>], alone: bool) -> f64 {
        for node in 0..self.nodes.len() {
            self.sinr[node].clear();
            if !alone {
                self.beams.sinr(node, &positions[node], &mut self.sinr[node]);
            }
        }
        let mut others = Vec::new();
        let mut rate = f64::INFINITY;
        for round in 0..ROUNDS {
            let before = rate;
            for node in 0..self.nodes.len() {
                self.strongest_other(node, alone && round == 0, &mut others);
                rate = self.move_node(node, &mut positions[node], &others, alone && round < SCANS);
            }
            if before - rate < 0.1 * SETTLED && round > 0 {
                break;
            }
        }
        rate
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

    /// Scans the node's disc, if asked to, and refines the best point; leaves its SINR in place.
    fn move_node(&mut self, node: usize, position: &mut Vector3<f64>, others: &[f64], scan: bool) -> f64 {
        let (centre, radius) = (self.nodes[node].position_enu_m, radius_m(&self.nodes[node]));
        let place = self.place;
        let near = self.look.about_user * radius;
        let passed_over = |at: &Vector3<f64>| (at - place).norm() < near && (centre - place).norm() < radius;
        let rate_at = |search: &mut Self, at: &Vector3<f64>| match passed_over(at) {
            true => f64::INFINITY,
            false => search.rate_at(node, at, others),
        };
        let mut best = (*position, rate_at(self, position));
        let consider = |search: &mut Self, at: Vector3<f64>, best: &mut (Vector3<f64>, f64)| {
            let rate = rate_at(search, &at);
            let better = rate < best.1;
            if better {
                *best = (at, rate);
            }
            better
        };
        if radius > 0.0 && scan {
            consider(self, centre, &mut best);
            for k in 0..2 * RING {
                let angle = std::f64::consts::TAU * (k % RING) as f64 / RING as f64;
                let r = if k < RING { radius } else { 0.5 * radius };
                let (sin, cos) = libm::sincos(angle);
                consider(self, centre + r * Vector3::new(cos, sin, 0.0), &mut best);
            }
        }
        if radius > 0.0 {
            // Without a scan it is a point that was the worst of other poses, or beside other nodes: near by.
            let mut step = if scan { 0.25 } else { 0.1 } * radius;
            while step > self.look.least_step * radius {
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
        self.beams.sinr(node, position, &mut sinr);
        self.sinr[node] = sinr;
        best.1
    }

    fn rate_at(&mut self, node: usize, position: &Vector3<f64>, others: &[f64]) -> f64 {
        self.trial.clear();
        self.beams.sinr(node, position, &mut self.trial);
        mean_rate(&self.user, [&self.trial, others], self.look.clip)
    }
}
