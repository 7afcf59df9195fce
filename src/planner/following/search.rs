//! What a motion from now on is worth.
//!
//! Rates are taken at the two nodes of Gauss and Legendre of each segment, positions there by the ways, angles and power between
//! those of its ends (J's angles as its null on the user from there and what is beside it). Limits are weighed by squares of what
//! exceeds [`PART`] of each: exterior penalties, so what is found is verified afterwards. Altitudes of control points and powers are
//! bounds of variables, tilts are held by construction ([`Held`]).

use nalgebra::Vector3;

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::expectation::samples::{Samples, Sequence};
use super::super::model::{Memory, Target};
use super::super::moving::spline::{self, bends, slopes, weights};
use super::super::moving::{NODES, hinge};
use super::super::setup::Setup;
use super::super::turning::Held;
use super::frame::{Frame, UNIT_LOG, UNIT_M, UNIT_RAD};
use super::motion::held;
use super::{HORIZON_S, SEGMENT_S, SEGMENTS};
use crate::geo::Enu;
use crate::role::Role;

/// The part of each limit that the search keeps to.
const PART: f64 = 0.95;
/// How far from the airspace's sides and their own, in metres, the search keeps vehicles.
pub const ASIDE_M: f64 = 0.3;
/// What a metre beyond a side counts, over a limit that is exceeded by all of it.
const BY_METRE: f64 = 0.1;
/// Instants of a segment at which turns and places are looked at.
const LOOKS: usize = 4;
/// From here on a motion counts less and less, to nothing at its end, in shares of it.
const COUNTS_UNTIL: f64 = 0.6;
/// Samples of each node.
const SAMPLES: usize = 128;
/// Where nothing is random, the sharpness of the maximum over eavesdroppers.
const SHARPNESS: f64 = 2e3;

/// An instant: its segment and the share of it that has passed.
#[derive(Clone, Copy)]
struct Spot {
    segment: usize,
    share: f64,
}

impl Spot {
    /// The k-th of `count` in each segment.
    fn of(k: usize, count: usize) -> Self {
        let segment = (k / count).min(SEGMENTS - 1);
        Self { segment, share: (k - segment * count) as f64 / count as f64 }
    }

    /// Its segment's knots and their weights.
    fn knots(&self) -> [(usize, f64); 2] {
        [(self.segment, 1.0 - self.share), (self.segment + 1, self.share)]
    }
}

/// Where both are at an instant, their roll and pitch, and what those depend on: I's on those of the knots about it, J's on what
/// they would be without a limit of its tilt, and through its null on where it is.
#[derive(Clone, Copy)]
struct Posed {
    spot: Spot,
    positions: [Enu; 2],
    angles: [[f64; 2]; 2],
    i_knots: [Held; 2],
    j: Held,
    by_position: [[f64; 3]; 2],
}

/// See the module.
pub struct Objective<'a> {
    frame: &'a Frame<'a>,
    samples: Vec<Samples>,
    /// Each node's part of the mean.
    counts: Vec<f64>,
}

/// What a node's rate is averaged over.
pub fn samples(setup: &Setup<'_>, seed: u64) -> Samples {
    let draws = if setup.heeds_uncertainty() { SAMPLES / 8 } else { 1 };
    Samples::new(setup.problem, SAMPLES, draws, seed, Sequence::Sobol)
}

/// What is taken for a node's rate.
pub fn target<'a>(setup: &Setup<'_>, samples: &'a Samples) -> Target<'a> {
    if setup.varies() || setup.heeds_uncertainty() {
        Target::Mean { samples, clip: true }
    } else {
        Target::Exact(SHARPNESS)
    }
}

impl<'a> Objective<'a> {
    pub fn new(frame: &'a Frame<'a>, seed: u64) -> Self {
        let counts: Vec<f64> = Frame::nodes_s(0.0)
            .map(|t_s| ((1.0 - t_s / HORIZON_S) / (1.0 - COUNTS_UNTIL)).min(1.0))
            .collect();
        let all: f64 = counts.iter().sum();
        Self {
            samples: frame.setups.iter().map(|setup| samples(setup, seed)).collect(),
            counts: counts.iter().map(|count| count / all).collect(),
            frame,
        }
    }

    fn target(&self, node: usize) -> Target<'_> {
        target(&self.frame.setups[node], &self.samples[node])
    }

    /// Carries a gradient by a weighted sum of a segment's control points to those that are free.
    fn push(&self, v: usize, segment: usize, weights: [f64; 4], by: &Vector3<f64>, gradient: &mut [f64]) {
        for (k, weight) in weights.into_iter().enumerate() {
            if let Some(at) = self.frame.free(v, segment + k) {
                for axis in 0..3 {
                    gradient[at + axis] += UNIT_M * weight * by[axis];
                }
            }
        }
    }

    /// The same of one by a vehicle's angles: to the angles' variables, and of J to its position.
    fn pull(&self, posed: &Posed, v: usize, by: [f64; 2], gradient: &mut [f64]) {
        if !self.frame.moves[v] {
            return;
        }
        let j = posed.j.pull(by);
        for (k, (knot, weight)) in posed.spot.knots().into_iter().enumerate() {
            if let Some(at) = self.frame.angle(knot, v) {
                let by = if v == 0 { posed.i_knots[k].pull(by) } else { j };
                gradient[at] += UNIT_RAD * weight * by[0];
                gradient[at + 1] += UNIT_RAD * weight * by[1];
            }
        }
        if v == 1 {
            let [roll, pitch] = posed.by_position;
            let by = Vector3::from_fn(|k, _| j[0] * roll[k] + j[1] * pitch[k]);
            self.push(1, posed.spot.segment, weights(posed.spot.share), &by, gradient);
        }
    }

    fn posed(&self, x: &[f64], spot: Spot) -> Posed {
        let frame = self.frame;
        let Spot { segment, share } = spot;
        let positions = [0, 1].map(|v: usize| frame.sum(x, v, segment, weights(share)));
        let between = |[a, b]: [[f64; 2]; 2]| [0, 1].map(|k: usize| a[k] + share * (b[k] - a[k]));
        let knots = [segment, segment + 1];
        let i_knots = knots.map(|knot| frame.i_held(x, knot));
        let beside = between(knots.map(|knot| frame.j_beside(x, knot)));
        let t_s = frame.begins_s + SEGMENT_S * (segment as f64 + share);
        let (null, by_position) = frame.null(t_s, &positions[1]);
        let j = held([null[0] + beside[0], null[1] + beside[1]], frame.setups[0].tilt_rad[1]);
        let angles = [between(i_knots.map(|held| held.at)), j.at];
        Posed { spot, positions, angles, i_knots, j, by_position }
    }

    /// The configuration of a node, and what it depends on.
    fn configuration(&self, x: &[f64], node: usize) -> (Raw, Posed) {
        let spot = Spot { segment: node / NODES.len(), share: NODES[node % NODES.len()] };
        let posed = self.posed(x, spot);
        let mut raw = self.frame.standing;
        for v in 0..2 {
            let at = v * VEHICLE;
            raw[at..at + 3].copy_from_slice(posed.positions[v].as_slice());
            raw[at + ANGLES..at + ANGLES + 2].copy_from_slice(&posed.angles[v]);
        }
        raw[VEHICLE + POWER] =
            spot.knots().into_iter().map(|(knot, weight)| weight * self.frame.power_w(x, knot)).sum();
        (raw, posed)
    }

    /// The weighted mean of the rate, bit/s/Hz.
    pub fn rate_bps_hz(&self, x: &[f64], memory: &mut Memory) -> f64 {
        let rate = |node: usize| {
            let (raw, _) = self.configuration(x, node);
            self.counts[node] * memory.value_alone(&self.frame.setups[node], self.target(node), &raw)
        };
        (0..self.counts.len()).map(rate).sum::<f64>() * std::f64::consts::LOG2_E
    }

    /// The cost, which is to be as small as it can, and its gradient; `stiffness` is what limits count.
    pub fn cost(&self, x: &[f64], stiffness: f64, memory: &mut Memory, gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        let mut worth = 0.0;
        let mut by = [0.0; 14];
        for (node, count) in self.counts.iter().enumerate() {
            let (raw, posed) = self.configuration(x, node);
            let rate = memory.value(&self.frame.setups[node], self.target(node), &raw, &mut by);
            if !(rate > 0.0) {
                continue;
            }
            worth += count * rate;
            by.iter_mut().for_each(|c| *c *= -count);
            for v in 0..2 {
                let at = v * VEHICLE;
                let moved = Vector3::new(by[at], by[at + 1], by[at + 2]);
                self.push(v, posed.spot.segment, weights(posed.spot.share), &moved, gradient);
                self.pull(&posed, v, [by[at + ANGLES], by[at + ANGLES + 1]], gradient);
            }
            // The kernel's derivative is by the power's logarithm.
            let by_w = by[VEHICLE + POWER] / raw[VEHICLE + POWER].max(f64::MIN_POSITIVE);
            for (knot, weight) in posed.spot.knots() {
                if let Some(at) = self.frame.log(knot) {
                    gradient[at] += UNIT_LOG * weight * self.frame.power_w(x, knot) * by_w;
                }
            }
        }
        let stiff = stiffness / SEGMENTS as f64;
        let beyond = self.turns(x, stiff, gradient)
            + self.motion(x, stiff, gradient)
            + self.places(x, stiff, gradient);
        stiff * beyond - worth
    }

    /// Squares of what the rates of turning exceed.
    fn turns(&self, x: &[f64], scale: f64, gradient: &mut [f64]) -> f64 {
        let mut sum = 0.0;
        let mut before = self.posed(x, Spot::of(0, LOOKS));
        for look in 1..=SEGMENTS * LOOKS {
            let now = self.posed(x, Spot::of(look, LOOKS));
            for (v, role) in Role::BOTH.into_iter().enumerate() {
                let way = [0, 1].map(|k: usize| now.angles[v][k] - before.angles[v][k]);
                let angle = libm::hypot(way[0], way[1]);
                let may = self.frame.scene.turn_rate_rad_s[role] * SEGMENT_S / LOOKS as f64;
                let (square, slope) = hinge(angle / may, PART);
                if slope > 0.0 {
                    sum += square;
                    let by = way.map(|c| scale * slope * c / (angle * may));
                    self.pull(&now, v, by, gradient);
                    self.pull(&before, v, by.map(|c| -c), gradient);
                }
            }
            before = now;
        }
        sum
    }

    /// Squares of what motion exceeds.
    fn motion(&self, x: &[f64], scale: f64, gradient: &mut [f64]) -> f64 {
        let h = SEGMENT_S;
        let mut sum = 0.0;
        for (v, role) in Role::BOTH.into_iter().enumerate().filter(|(v, _)| self.frame.moves[*v]) {
            let limits = &self.frame.scene.limits[role];
            for segment in 0..SEGMENTS {
                let of = |weights: [f64; 4], per: f64| {
                    let weights = weights.map(|w| w / per);
                    (self.frame.sum(x, v, segment, weights), weights)
                };
                let mut over = |value: Vector3<f64>, weights: [f64; 4], limit: f64| {
                    let size = value.norm();
                    let (square, slope) = hinge(size / limit, PART);
                    if slope > 0.0 {
                        sum += square;
                        self.push(v, segment, weights, &(value * (scale * slope / (size * limit))), gradient);
                    }
                };
                for share in [0.5, 1.0] {
                    let (velocity, weights) = of(slopes(share), h);
                    over(Vector3::new(velocity.x, velocity.y, 0.0), weights, limits.speed_m_s);
                    over(Vector3::new(0.0, 0.0, velocity.z), weights, limits.climb_m_s);
                }
                let (acceleration, weights) = of(bends(1.0), h * h);
                over(acceleration, weights, limits.acceleration_m_s2);
                if let Some(limit) = limits.jerk_m_s3 {
                    let (jerk, weights) = of(spline::JERKS, h * h * h);
                    over(jerk, weights, limit);
                }
            }
        }
        sum
    }

    /// Squares of what lies beyond the sides of vehicles' cells, and beyond what keeps them apart.
    fn places(&self, x: &[f64], scale: f64, gradient: &mut [f64]) -> f64 {
        let frame = self.frame;
        let mut sum = 0.0;
        for v in (0..2).filter(|v| frame.moves[*v]) {
            let cell = &frame.setups[0].region.cells()[frame.cells[v]];
            let [low_m, high_m] = cell.altitude_m;
            let apart = &frame.sides[Role::BOTH[v]];
            for Spot { segment, share } in (1..=SEGMENTS * LOOKS).map(|look| Spot::of(look, LOOKS)) {
                let at = frame.sum(x, v, segment, weights(share));
                let mut over = |out_m: f64, aside_m: f64, outwards: Vector3<f64>| {
                    let (square, slope) = hinge(BY_METRE * out_m, -BY_METRE * aside_m);
                    if slope > 0.0 {
                        sum += square;
                        let by = outwards * (scale * slope * BY_METRE);
                        self.push(v, segment, weights(share), &by, gradient);
                    }
                };
                for side in &cell.sides {
                    let outwards = Vector3::new(side.normal.x, side.normal.y, 0.0);
                    over(outwards.dot(&at) - side.offset_m, ASIDE_M, outwards);
                }
                over(apart.outside_m(&at), ASIDE_M, apart.outwards);
                // Control points are within the band but for those that are given.
                over(low_m - at.z, 0.0, -Vector3::z());
                over(at.z - high_m, 0.0, Vector3::z());
            }
        }
        sum
    }
}
