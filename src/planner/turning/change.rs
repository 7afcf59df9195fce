//! The change of the served user: from the attitudes that serve one to those that serve the next, at the same positions.
//!
//! While nobody radiates either vehicle turns for nothing but time; while both do, what is off the standing attitudes costs
//! rate. With `L` what a user loses against standing, `tau` the silence and `v` what a second of the superframe is worth,
//!
//! ```text
//! minimise  w_a L_a + w_b L_b + v tau,     L = integral over the ramp of (R(standing) - R(s)) ds,
//!           tau = r + max(guard - r, angle of I / rate of I, angle of J / rate of J)
//! ```
//!
//! over both vehicles' ramps on either side (`ramp`) and J's power along them; r is what is left of the silence when both are turned
//! ([`READY_S`](super::READY_S)); the angles are those between the ramps' ends. It
//! is the dynamic programme of cumulative and remaining service over all instants of the switch: each user is on the air for
//! the time that its slot gives it, so that shares stay as they are said, and an earlier or later switch shortens the silence.
//!
//! 1. Nothing to gain where all turns fit into the guard, less r.
//! 2. The integrals by six nodes of Gauss and Legendre, the maxima by norms; quasi-Newton from a few lengths of the ramps.
//! 3. The best by the true maxima and the finest samples on the grid that is flown, J's power at each knot the best that its
//!    transmitter can give. No ramp at all where none pays.
//!
//! A ramp is passed at the limit of the rate and never above it, so the limits hold by construction.

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::model::Memory;
use super::super::powers;
use super::super::solver::limited::{self, Rows, Settings, SparseRow};
use super::super::variables::PowerChart;
use super::super::volume::objective::{COARSE, Case, FINE, MEDIUM, View};
use super::super::volume::ways::Ways;
use super::path::READY_S;
use super::ramp::{CORNERS, Ramp};
use super::turn::{Angles, Course, Held};
use crate::role::Role;

/// Nodes and weights of Gauss and Legendre on [0, 1].
const NODES: [[f64; 2]; 6] = [
    [0.033_765_242_898_423_99, 0.085_662_246_189_585_17],
    [0.169_395_306_766_867_74, 0.180_380_786_524_069_3],
    [0.380_690_406_958_401_55, 0.233_956_967_286_345_52],
    [0.619_309_593_041_598_5, 0.233_956_967_286_345_52],
    [0.830_604_693_233_132_2, 0.180_380_786_524_069_3],
    [0.966_234_757_101_576, 0.085_662_246_189_585_17],
];
/// Knots of a ramp that are flown, its beginning included.
pub const STEPS: usize = 12;
/// Ramps from which the search begins, as shares of what the turn takes beyond the guard.
const BEGINNINGS: [f64; 3] = [0.05, 0.2, 0.4];
/// Units of a search's variables.
const UNIT_RAD: f64 = 0.1;
const UNIT_LOG: f64 = 0.5;
/// Power of the norm that stands for the longer of two ramps, which the integral need only reach.
const REACH: f64 = 8.0;
/// How the last steps are looked at.
const LAST: View = View { power: 48.0, ..MEDIUM };
const BEGIN: Settings = Settings { iterations: 25, tolerance: 1e-3, first_step: 0.3 };
const POLISH: Settings = Settings { iterations: 40, tolerance: 1e-4, first_step: 0.1 };
/// A change of the served user.
pub struct Change<'a, 'b, W> {
    pub case: &'a Case<'b, W>,
    /// Who is left, and who comes.
    pub users: [usize; 2],
    /// Their standing configurations.
    pub raws: [Raw; 2],
    /// What their volumes count.
    pub weights: [f64; 2],
    /// What a second is worth.
    pub price: f64,
    /// The least silence in seconds.
    pub guard_s: f64,
    /// The longest ramp of each in seconds.
    pub longest_s: [f64; 2],
}

/// One interval of a ramp: attitudes where it begins, how long it lasts, J's power and the rate in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Of I and J where the step begins, in order of time.
    pub angles: [Angles; 2],
    pub lasts_s: f64,
    /// Of J in W.
    pub power_w: f64,
    /// In nats per hertz.
    pub rate: f64,
}

/// How the served user changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Changed {
    /// Steps off the one user's standing attitudes, and to the other's.
    pub steps: [Vec<Step>; 2],
    /// Attitudes of I and J where the silence begins and where it ends.
    pub silent: [[Angles; 2]; 2],
    pub courses: [Course; 2],
    pub silence_s: f64,
}

/// `(sum of t^p)^(1/p)` and its slopes.
fn norm<const N: usize>(times: [f64; N], power: f64) -> (f64, [f64; N]) {
    let largest = times.iter().fold(0.0, |a: f64, b| a.max(*b));
    if largest <= 0.0 {
        return (0.0, [0.0; N]);
    }
    let sum: f64 = times.iter().map(|t| libm::pow(t / largest, power)).sum();
    let norm = largest * libm::pow(sum, 1.0 / power);
    (norm, times.map(|t| libm::pow(t / norm, power - 1.0)))
}

fn angles(raw: &Raw, v: usize) -> Angles {
    let at = v * VEHICLE + ANGLES;
    [raw[at], raw[at + 1], raw[at + 2]]
}

fn with_yaw([roll, pitch]: [f64; 2], standing: &Angles) -> Angles {
    [roll, pitch, standing[2]]
}

/// One side's ramps as the variables have them.
struct Side {
    ramps: [Ramp; 2],
    held: [[Held; CORNERS]; 2],
    powers_w: [f64; NODES.len()],
}

impl<W: Ways> Change<'_, '_, W> {
    fn rate_of_turn(&self, v: usize) -> f64 {
        self.case.ways.turn_rate_rad_s(Role::BOTH[v])
    }

    fn tilt_rad(&self, v: usize) -> f64 {
        self.case.setups[self.users[0]].tilt_rad[v]
    }

    fn course(&self, v: usize) -> Course {
        Course::within(self.tilt_rad(v))
    }

    fn standing(&self, side: usize, v: usize) -> [f64; 2] {
        let [roll, pitch, _] = angles(&self.raws[side], v);
        [roll, pitch]
    }

    /// How J's power may vary on one side: `(highest, least logarithm)`.
    fn power(&self, side: usize) -> Option<(f64, f64)> {
        let raw = &self.raws[side];
        // Nobody radiates whom no rate is promised.
        if raw[POWER] <= 0.0 || raw[VEHICLE + POWER] <= 0.0 {
            return None;
        }
        match powers::of(&self.case.setups[self.users[side]], raw) {
            PowerChart::Log { max_w, floor } => Some((max_w, floor)),
            PowerChart::Fixed(_) | PowerChart::Linear { .. } => None,
        }
    }

    /// Where the variables of one side's vehicle begin; those of powers as a third vehicle's.
    fn offset(&self, side: usize, v: usize) -> usize {
        side * (4 * CORNERS + NODES.len()) + v * 2 * CORNERS
    }

    fn dimension(&self) -> usize {
        self.offset(2, 0)
    }

    fn side(&self, x: &[f64], side: usize) -> Side {
        let held = [0, 1].map(|v: usize| {
            let (at, standing) = (self.offset(side, v), self.standing(side, v));
            [0, 1].map(|corner: usize| {
                let given = [0, 1].map(|k: usize| standing[k] + UNIT_RAD * x[at + 2 * corner + k]);
                if self.tilt_rad(v) > 0.0 {
                    Held::new(given, self.tilt_rad(v))
                } else {
                    Held::new([0.0; 2], 0.0)
                }
            })
        });
        let ramps = [0, 1].map(|v: usize| {
            // A level vehicle has nowhere to turn.
            if self.tilt_rad(v) > 0.0 {
                Ramp::new(self.standing(side, v), held[v].map(|held| held.at))
            } else {
                Ramp::none(self.standing(side, v))
            }
        });
        let at = self.offset(side, 2);
        let standing_w = self.raws[side][VEHICLE + POWER];
        let powers_w = std::array::from_fn(|node| match self.power(side) {
            Some((max_w, floor)) => max_w * libm::exp((UNIT_LOG * x[at + node]).clamp(floor, 0.0)),
            None => standing_w,
        });
        Side { ramps, held, powers_w }
    }

    fn configuration(&self, side: usize, ramps: &[Ramp; 2], back_s: f64, power_w: f64) -> Raw {
        let mut raw = self.raws[side];
        for v in 0..2 {
            let [roll, pitch] = ramps[v].at(self.rate_of_turn(v) * back_s);
            raw[v * VEHICLE + ANGLES] = roll;
            raw[v * VEHICLE + ANGLES + 1] = pitch;
        }
        raw[VEHICLE + POWER] = power_w;
        raw
    }

    /// A user's rate, never below 0, and its gradient.
    fn rate(&self, side: usize, view: View, raw: &Raw, memory: &mut Memory, by: &mut Raw) -> f64 {
        let rate = self.case.rate(self.users[side], view, raw, memory, by);
        if rate > 0.0 {
            return rate;
        }
        by.fill(0.0);
        0.0
    }

    /// What a user loses on its ramps, and the gradient by the variables.
    fn loss(
        &self,
        side: usize,
        of: &Side,
        (view, standing): (View, f64),
        memory: &mut Memory,
        gradient: &mut [f64],
    ) -> f64 {
        let weight = self.weights[side];
        let lengths_s = [0, 1].map(|v: usize| of.ramps[v].length_rad() / self.rate_of_turn(v));
        let (reach_s, by_length) = norm(lengths_s, REACH);
        let mut corners = [[[0.0; 2]; CORNERS]; 2];
        let (mut mean, mut by_reach) = (0.0, 0.0);
        for (node, [at, share]) in NODES.iter().enumerate() {
            let back_s = reach_s * at;
            let raw = self.configuration(side, &of.ramps, back_s, of.powers_w[node]);
            let mut by = [0.0; 14];
            let lost = standing - self.rate(side, view, &raw, memory, &mut by);
            mean += share * lost;
            let scale = -weight * share * reach_s;
            for v in 0..2 {
                let slope = [0, 1].map(|k: usize| scale * by[v * VEHICLE + ANGLES + k]);
                let rate = self.rate_of_turn(v);
                by_reach += at * rate * of.ramps[v].pull(rate * back_s, slope, &mut corners[v]);
            }
            if self.power(side).is_some() {
                gradient[self.offset(side, 2) + node] += scale * UNIT_LOG * by[VEHICLE + POWER];
            }
        }
        by_reach += weight * mean;
        // A ramp is no longer than its user's time on the air.
        let beyond_s = (reach_s - self.longest_s[side]).max(0.0);
        let stiff = 10.0 * self.price / self.longest_s[side].max(1e-3);
        by_reach += 2.0 * stiff * beyond_s;
        for v in 0..2 {
            of.ramps[v].pull_length(by_reach * by_length[v] / self.rate_of_turn(v), &mut corners[v]);
            self.add_corners(side, v, of, &corners[v], gradient);
        }
        weight * reach_s * mean + stiff * beyond_s * beyond_s
    }

    fn add_corners(&self, side: usize, v: usize, of: &Side, by: &[[f64; 2]; CORNERS], gradient: &mut [f64]) {
        if self.tilt_rad(v) <= 0.0 {
            return;
        }
        let at = self.offset(side, v);
        for (corner, by) in by.iter().enumerate() {
            let by_given = of.held[v][corner].pull(*by);
            for k in 0..2 {
                gradient[at + 2 * corner + k] += UNIT_RAD * by_given[k];
            }
        }
    }

    /// The turn between the ends of both ramps: I's, J's, and the least.
    fn times_s(&self, sides: [&[Ramp; 2]; 2]) -> ([f64; 3], [[Angles; 2]; 2]) {
        let mut times = [0.0, 0.0, self.case.ways.least_s()];
        let mut by = [[[0.0; 3]; 2]; 2];
        for v in 0..2 {
            let ends = [0, 1].map(|side: usize| with_yaw(sides[side][v].end(), &angles(&self.raws[side], v)));
            let (angle, slopes) = self.course(v).angle_rad(&ends[0], &ends[1]);
            times[v] = angle / self.rate_of_turn(v);
            by[v] = slopes.map(|slope| slope.map(|c| c / self.rate_of_turn(v)));
        }
        (times, by)
    }

    /// What the change costs, and the gradient.
    fn value(
        &self,
        x: &[f64],
        (view, standing): (View, [f64; 2]),
        memory: &mut Memory,
        gradient: &mut [f64],
    ) -> f64 {
        gradient.fill(0.0);
        let sides = [self.side(x, 0), self.side(x, 1)];
        let (times, by) = self.times_s([&sides[0].ramps, &sides[1].ramps]);
        let (turn_s, by_time) = norm(times, view.power);
        let mut cost = self.price * (READY_S + turn_s);
        for (side, of) in sides.iter().enumerate() {
            cost += self.loss(side, of, (view, standing[side]), memory, gradient);
            for v in 0..2 {
                let slope = [0, 1].map(|k: usize| self.price * by_time[v] * by[v][side][k]);
                let mut corners = [[0.0; 2]; CORNERS];
                corners[CORNERS - 1] = slope;
                self.add_corners(side, v, of, &corners, gradient);
            }
        }
        cost
    }

    fn rows(&self) -> Rows {
        let mut rows = Vec::new();
        for side in 0..2 {
            if let Some((_, floor)) = self.power(side) {
                for node in 0..NODES.len() {
                    let at = self.offset(side, 2) + node;
                    rows.push(SparseRow { terms: vec![(at, 1.0)], b: 0.0 });
                    rows.push(SparseRow { terms: vec![(at, -1.0)], b: -floor / UNIT_LOG });
                }
            }
        }
        Rows::new(rows, Vec::new())
    }

    /// Ramps along the way to the other's attitudes, of so much of what the turn takes beyond the least.
    fn beginning(&self, share: f64, times: &[f64; 3]) -> Vec<f64> {
        let mut x = vec![0.0; self.dimension()];
        for side in 0..2 {
            for v in 0..2 {
                let [from, to] = [self.standing(side, v), self.standing(1 - side, v)];
                let way = [to[0] - from[0], to[1] - from[1]];
                let length = libm::hypot(way[0], way[1]);
                let beyond = (times[v] - self.case.ways.least_s()).max(0.0) * self.rate_of_turn(v);
                if length <= 1e-9 || beyond <= 0.0 {
                    continue;
                }
                let at = self.offset(side, v);
                for corner in 0..CORNERS {
                    let far = share * beyond * (corner + 1) as f64 / CORNERS as f64 / length;
                    x[at + 2 * corner] = far * way[0] / UNIT_RAD;
                    x[at + 2 * corner + 1] = far * way[1] / UNIT_RAD;
                }
            }
            if let Some((max_w, floor)) = self.power(side) {
                let log = libm::log(self.raws[side][VEHICLE + POWER] / max_w).clamp(floor, 0.0);
                let at = self.offset(side, 2);
                x[at..at + NODES.len()].fill(log / UNIT_LOG);
            }
        }
        x
    }

    /// The best change that is found.
    pub fn best(&self, memory: &mut Memory) -> Changed {
        let none = [0, 1].map(|side: usize| [0, 1].map(|v: usize| Ramp::none(self.standing(side, v))));
        let (times, _) = self.times_s([&none[0], &none[1]]);
        let still = self.changed(&none, &[[None; NODES.len()]; 2], memory);
        // The guard is long enough: nobody need turn while anybody is served.
        if times[0].max(times[1]) <= self.case.ways.least_s() {
            return still;
        }
        let standing = |view: View, memory: &mut Memory| {
            [0, 1].map(|side: usize| self.rate(side, view, &self.raws[side], memory, &mut [0.0; 14]))
        };
        let mut rows = self.rows();
        let mut ends: Vec<limited::End> = Vec::new();
        let coarse = (COARSE, standing(COARSE, memory));
        for share in BEGINNINGS {
            let x = self.beginning(share, &times);
            let mut objective = |x: &[f64], gradient: &mut [f64]| self.value(x, coarse, memory, gradient);
            ends.push(limited::minimise(&mut objective, &mut rows, &x, &BEGIN));
        }
        ends.sort_by(|a, b| a.value.total_cmp(&b.value));
        let last = (LAST, standing(LAST, memory));
        let mut best = (self.cost(&still, memory), still);
        if let Some(end) = ends.first() {
            let mut objective = |x: &[f64], gradient: &mut [f64]| self.value(x, last, memory, gradient);
            let end = limited::minimise(&mut objective, &mut rows, &end.x, &POLISH);
            let sides = [self.side(&end.x, 0), self.side(&end.x, 1)];
            let ramps = [0, 1].map(|side: usize| self.fitted(side, &sides[side].ramps));
            let powers = [0, 1].map(|side: usize| sides[side].powers_w.map(Some));
            let changed = self.changed(&ramps, &powers, memory);
            let cost = self.cost(&changed, memory);
            if cost < best.0 {
                best = (cost, changed);
            }
        }
        best.1
    }

    fn lasts_s(&self, ramps: &[Ramp; 2]) -> f64 {
        (0..2).map(|v| ramps[v].length_rad() / self.rate_of_turn(v)).fold(0.0, f64::max)
    }

    /// Ramps that fit into their user's time on the air.
    fn fitted(&self, side: usize, ramps: &[Ramp; 2]) -> [Ramp; 2] {
        let (lasts_s, longest_s) = (self.lasts_s(ramps), self.longest_s[side]);
        if lasts_s <= longest_s {
            *ramps
        } else {
            ramps.map(|ramp| ramp.shrunk(longest_s / lasts_s * (1.0 - 1e-6)))
        }
    }

    /// What a change costs by the rates of its steps.
    fn cost(&self, changed: &Changed, memory: &mut Memory) -> f64 {
        let mut cost = self.price * changed.silence_s;
        for (side, steps) in changed.steps.iter().enumerate() {
            let standing = self.rate(side, FINE, &self.raws[side], memory, &mut [0.0; 14]);
            cost += self.weights[side]
                * steps.iter().map(|step| step.lasts_s * (standing - step.rate)).sum::<f64>();
        }
        cost
    }

    /// A change by its ramps, on the grid that is flown. `powers_w` are where J's power is looked for, by node.
    fn changed(
        &self,
        ramps: &[[Ramp; 2]; 2],
        powers_w: &[[Option<f64>; NODES.len()]; 2],
        memory: &mut Memory,
    ) -> Changed {
        let (times, _) = self.times_s([&ramps[0], &ramps[1]]);
        let steps = [0, 1].map(|side: usize| self.steps(side, &ramps[side], &powers_w[side], memory));
        let silent = [0, 1].map(|side: usize| {
            [0, 1].map(|v: usize| with_yaw(ramps[side][v].end(), &angles(&self.raws[side], v)))
        });
        let silence_s = (times[0].max(times[1]) + READY_S).max(self.guard_s);
        Changed { steps, silent, courses: [self.course(0), self.course(1)], silence_s }
    }

    /// One side's ramp in steps, in order of time.
    fn steps(
        &self,
        side: usize,
        ramps: &[Ramp; 2],
        powers_w: &[Option<f64>; NODES.len()],
        memory: &mut Memory,
    ) -> Vec<Step> {
        let lasts_s = self.lasts_s(ramps);
        if lasts_s <= 0.0 {
            return Vec::new();
        }
        let step_s = lasts_s / STEPS as f64;
        let mut steps: Vec<Step> = (0..STEPS)
            .map(|k| {
                // Counted from the silence.
                let middle_s = step_s * (k as f64 + 0.5);
                let near =
                    self.power_near(middle_s / lasts_s, powers_w).unwrap_or(self.raws[side][VEHICLE + POWER]);
                let power_w = self.best_power(side, &self.configuration(side, ramps, middle_s, near), memory);
                let raw = self.configuration(side, ramps, middle_s, power_w);
                let rate = self.rate(side, FINE, &raw, memory, &mut [0.0; 14]);
                // The earlier end of the step: after the silence the one that is nearer to it.
                let begins_s = step_s * if side == 0 { k as f64 + 1.0 } else { k as f64 };
                let at = self.configuration(side, ramps, begins_s, power_w);
                Step { angles: [angles(&at, 0), angles(&at, 1)], lasts_s: step_s, power_w, rate }
            })
            .collect();
        if side == 0 {
            steps.reverse();
        }
        steps
    }

    fn power_near(&self, share: f64, powers_w: &[Option<f64>; NODES.len()]) -> Option<f64> {
        let near = |k: &usize| (NODES[*k][0] - share).abs();
        let node = (0..NODES.len()).min_by(|a, b| near(a).total_cmp(&near(b)))?;
        powers_w[node]
    }

    /// The best power of J at a configuration whose power is nearly so.
    fn best_power(&self, side: usize, raw: &Raw, memory: &mut Memory) -> f64 {
        let setup = &self.case.setups[self.users[side]];
        let value = |power_w: f64| {
            let mut raw = *raw;
            raw[VEHICLE + POWER] = power_w;
            self.rate(side, MEDIUM, &raw, memory, &mut [0.0; 14])
        };
        let own_w = raw[VEHICLE + POWER];
        if raw[POWER] <= 0.0 {
            return own_w;
        }
        powers::best_w(setup, own_w, self.power(side), value)
    }
}

#[cfg(test)]
impl<W: Ways> Change<'_, '_, W> {
    /// Central differences of the cost against its gradient, off the beginning.
    pub fn check_gradient(&self) {
        let none = [0, 1].map(|side: usize| [0, 1].map(|v: usize| Ramp::none(self.standing(side, v))));
        let (times, _) = self.times_s([&none[0], &none[1]]);
        let mut x = self.beginning(0.4, &times);
        for (k, c) in x.iter_mut().enumerate() {
            *c += 0.1 * libm::sin(3.0 * k as f64);
        }
        let mut memory = Memory::default();
        let standing = [9.0, 8.0];
        let mut gradient = vec![0.0; x.len()];
        self.value(&x, (COARSE, standing), &mut memory, &mut gradient);
        for k in 0..x.len() {
            let mut at = |step: f64| {
                let mut y = x.clone();
                y[k] += step;
                self.value(&y, (COARSE, standing), &mut memory, &mut vec![0.0; x.len()])
            };
            let numeric = (8.0 * (at(1e-4) - at(-1e-4)) - (at(2e-4) - at(-2e-4))) / 12e-4;
            assert!(
                (numeric - gradient[k]).abs() < 2e-4 * (1.0 + gradient[k].abs()),
                "variable {k}: {numeric} {}",
                gradient[k]
            );
        }
    }
}
