//! What ways, attitudes and powers are worth: the volume that counts over the superframe's length, less what exceeds a limit.
//!
//! Rates are taken at the two nodes of Gauss and Legendre in each interval between knots, positions there by the ways, angles
//! between those of its ends (J's as its null on the user from there and what is beside it): at one node, angles that go to and
//! fro between knots would pass unseen. Limits are weighed by squares of what
//! exceeds [`PART`] of each: exterior penalties, so what is found is verified and drawn inside afterwards (`flown`). Altitudes
//! and powers are bounds of variables, tilts are held by construction ([`Held`](super::super::turning::Held)).

use nalgebra::Vector3;

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::expectation::samples::Samples;
use super::super::model::{Memory, Target};
use super::super::turning::{Course, Held, READY_S};
use super::super::volume::Fairness;
use super::super::volume::objective::{Case, View};
use super::super::volume::ways::Ways;
use super::frame::{Frame, KNOTS, Place, STEPS, Spot, UNIT_LOG, UNIT_M, UNIT_RAD};
use super::limits::Limits;
use super::spline;
use crate::geo::Enu;
use crate::role::Role;

/// The part of each limit that the search keeps to.
const PART: f64 = 0.95;
/// The same of rates of turning, which are drawn inside knot by knot.
const PART_OF_TURNS: f64 = 0.98;
/// How far from the area's sides, in metres, and how much farther apart than they must be, the search keeps vehicles.
const ASIDE_M: f64 = 0.3;
/// What a metre beyond a side counts, over a limit that is exceeded by all of it.
const BY_METRE: f64 = 0.1;
/// How often distances between the vehicles are looked at.
const OFTEN_HZ: f64 = 6.0;
/// Nodes of Gauss and Legendre on [0, 1], of equal weights.
pub(in crate::planner) const NODES: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// Sharpness of the least of all volumes, for each nat per hertz and second.
const SHARPNESS: f64 = 20.0;

/// A knot of a slot, or a node of an interval with its part of that.
struct Instant {
    spot: Spot,
    lasts_s: f64,
}

/// A superframe's worth as a function of its variables.
pub struct Objective<'a, 'b, W> {
    case: &'a Case<'b, W>,
    frame: &'a Frame<'b>,
    limits: [Limits; 2],
    rates_rad_s: [f64; 2],
    courses: [Course; 2],
    nodes: Vec<[[Instant; 2]; STEPS]>,
    knots: Vec<[Instant; KNOTS]>,
    /// Instants at which distances are looked at.
    together: Vec<Spot>,
}

/// How a superframe is looked at.
pub struct Look {
    view: View,
    /// What a limit counts.
    stiffness: f64,
    /// Each user's samples, which its slot's nodes take in turns: what one node does not meet its neighbours do, and a volume is
    /// a sum over all of them.
    parts: Vec<Vec<Samples>>,
}

impl Look {
    /// One at which each node takes one of `turns` parts of the samples.
    pub fn new<W: Ways>(case: &Case<'_, W>, view: View, turns: usize, stiffness: f64) -> Self {
        let parts = case.samples.iter().map(|of_user| of_user[view.resolution].parts(turns)).collect();
        Self { view, stiffness, parts }
    }

    /// What is averaged for a user at one of its slot's nodes.
    fn target<W: Ways>(&self, case: &Case<'_, W>, user: usize, node: usize) -> Target<'_> {
        match case.target(user, self.view, true) {
            Target::Mean { clip, .. } => {
                let parts = &self.parts[user];
                Target::Mean { samples: &parts[node % parts.len()], clip }
            }
            _ => Target::Exact(self.view.sharpness),
        }
    }
}

/// What is exceeded, squared, and twice it.
pub(in crate::planner) fn hinge(ratio: f64, part: f64) -> (f64, f64) {
    let beyond = (ratio - part).max(0.0);
    (beyond * beyond, 2.0 * beyond)
}

/// Angles at a knot and what they depend on.
#[derive(Clone, Copy)]
struct Turned {
    held: [Held; 2],
    by_position: [[f64; 3]; 2],
}

impl<'a, 'b, W: Ways> Objective<'a, 'b, W> {
    pub fn new(case: &'a Case<'b, W>, frame: &'a Frame<'b>, limits: [Limits; 2]) -> Self {
        let instant = |t_s: f64, lasts_s: f64| Instant { spot: frame.spot(t_s), lasts_s };
        let nodes = frame.places.iter().map(|place| {
            std::array::from_fn(|k| {
                let [from, to] = [place.knots_s[k], place.knots_s[k + 1]];
                NODES.map(|share| instant(place.begins_s + from + share * (to - from), 0.5 * (to - from)))
            })
        });
        let knots = frame
            .places
            .iter()
            .map(|place| std::array::from_fn(|k| instant(place.begins_s + place.knots_s[k], 0.0)));
        let segment_s = frame.superframe_s / frame.controls as f64;
        // Often enough that no vehicle at full speed passes by unseen.
        let fine = (OFTEN_HZ * segment_s).ceil().clamp(2.0, 64.0) as usize;
        let together = (0..fine * frame.controls).map(|k| frame.spot(k as f64 * segment_s / fine as f64));
        Self {
            limits,
            rates_rad_s: Role::BOTH.map(|role| case.ways.turn_rate_rad_s(role)),
            courses: [0, 1].map(|v: usize| Course::within(frame.setups[0].tilt_rad[v])),
            nodes: nodes.collect(),
            knots: knots.collect(),
            together: together.collect(),
            case,
            frame,
        }
    }

    fn push(&self, v: usize, spot: &Spot, by: &Vector3<f64>, gradient: &mut [f64]) {
        for (control, weight) in spot.at.iter().zip(spot.weights) {
            let at = self.frame.point(v, *control);
            for k in 0..3 {
                gradient[at + k] += UNIT_M * weight * by[k];
            }
        }
    }

    fn given(&self, x: &[f64], slot: usize, knot: usize, v: usize) -> [f64; 2] {
        let at = self.frame.angles(slot, knot, v);
        [UNIT_RAD * x[at], UNIT_RAD * x[at + 1]]
    }

    fn turned(&self, place: &Place, j: &Enu, given: [[f64; 2]; 2]) -> Turned {
        let (null, by_position) = self.frame.null(place, j);
        let j = [null[0] + given[1][0], null[1] + given[1][1]];
        Turned { held: [self.frame.held(0, given[0]), self.frame.held(1, j)], by_position }
    }

    /// Carries a gradient by a vehicle's angles at an instant to the angles' variables at knots, by their weights, and to J's
    /// position.
    fn pull(
        &self,
        (slot, knots): (usize, &[(usize, f64)]),
        v: usize,
        (turned, spot): (&Turned, &Spot),
        by: [f64; 2],
        gradient: &mut [f64],
    ) {
        if self.frame.setups[0].tilt_rad[v] <= 0.0 {
            return;
        }
        let by = turned.held[v].pull(by);
        for (knot, weight) in knots {
            let at = self.frame.angles(slot, *knot, v);
            gradient[at] += UNIT_RAD * weight * by[0];
            gradient[at + 1] += UNIT_RAD * weight * by[1];
        }
        if v == 1 {
            let [roll, pitch] = turned.by_position;
            let by = Vector3::from_fn(|k, _| by[0] * roll[k] + by[1] * pitch[k]);
            self.push(1, spot, &by, gradient);
        }
    }

    /// The configuration at a node of an interval, and the angles in it.
    fn configuration(&self, x: &[f64], slot: usize, step: usize, node: usize) -> (Raw, Turned) {
        let place = &self.frame.places[slot];
        let spot = &self.nodes[slot][step][node].spot;
        let positions = [0, 1].map(|v: usize| self.frame.position(x, v, spot));
        let given = [0, 1].map(|v: usize| {
            let [a, b] = [step, step + 1].map(|knot| self.given(x, slot, knot, v));
            [0, 1].map(|k: usize| a[k] + NODES[node] * (b[k] - a[k]))
        });
        let turned = self.turned(place, &positions[1], given);
        let mut raw = place.standing;
        for v in 0..2 {
            raw[v * VEHICLE..v * VEHICLE + 3].copy_from_slice(positions[v].as_slice());
            raw[v * VEHICLE + ANGLES..v * VEHICLE + ANGLES + 2].copy_from_slice(&turned.held[v].at);
        }
        raw[VEHICLE + POWER] = place.power_w(UNIT_LOG * x[self.frame.power(slot, step)]);
        (raw, turned)
    }

    /// A slot's volume in nats per hertz, each rate's part in the gradient scaled.
    fn volume(
        &self,
        x: &[f64],
        slot: usize,
        scale: f64,
        look: &Look,
        memory: &mut Memory,
        gradient: &mut [f64],
    ) -> f64 {
        let place = &self.frame.places[slot];
        if !place.is_served() {
            return 0.0;
        }
        let mut volume = 0.0;
        let mut by = [0.0; 14];
        for step in 0..STEPS {
            for (node, instant) in self.nodes[slot][step].iter().enumerate() {
                let (raw, turned) = self.configuration(x, slot, step, node);
                let target = look.target(self.case, place.user, step * NODES.len() + node);
                let rate = memory.value(&self.case.setups[place.user], target, &raw, &mut by);
                if !(rate > 0.0) {
                    continue;
                }
                volume += instant.lasts_s * rate;
                let scale = scale * instant.lasts_s;
                let knots = [(step, 1.0 - NODES[node]), (step + 1, NODES[node])];
                for v in 0..2 {
                    let at = v * VEHICLE;
                    let moved = Vector3::new(by[at], by[at + 1], by[at + 2]) * scale;
                    self.push(v, &instant.spot, &moved, gradient);
                    let angles = [scale * by[at + ANGLES], scale * by[at + ANGLES + 1]];
                    self.pull((slot, &knots), v, (&turned, &instant.spot), angles, gradient);
                }
                if place.power.is_some() {
                    gradient[self.frame.power(slot, step)] += scale * UNIT_LOG * by[VEHICLE + POWER];
                }
            }
        }
        volume
    }

    /// Squares of what the rates of turning exceed.
    fn turns(&self, x: &[f64], scale: f64, gradient: &mut [f64]) -> f64 {
        let mut sum = 0.0;
        let places = &self.frame.places;
        let at = |slot: usize, knot: usize| {
            let spot = &self.knots[slot][knot].spot;
            let j = self.frame.position(x, 1, spot);
            self.turned(&places[slot], &j, [0, 1].map(|v: usize| self.given(x, slot, knot, v)))
        };
        for slot in 0..places.len() {
            let place = &places[slot];
            let first = at(slot, 0);
            let mut before = first;
            for knot in 1..KNOTS {
                let now = at(slot, knot);
                for v in 0..2 {
                    let way = [0, 1].map(|k: usize| now.held[v].at[k] - before.held[v].at[k]);
                    let angle = libm::hypot(way[0], way[1]);
                    let may = self.rates_rad_s[v] * (place.knots_s[knot] - place.knots_s[knot - 1]);
                    let (square, slope) = hinge(angle / may, PART_OF_TURNS);
                    if slope <= 0.0 {
                        continue;
                    }
                    sum += square;
                    let by = way.map(|c| scale * slope * c / (angle * may));
                    let spots = [knot - 1, knot].map(|k| &self.knots[slot][k].spot);
                    self.pull((slot, &[(knot, 1.0)]), v, (&now, spots[1]), by, gradient);
                    self.pull((slot, &[(knot - 1, 1.0)]), v, (&before, spots[0]), by.map(|c| -c), gradient);
                }
                before = now;
            }
            let next = (slot + 1) % places.len();
            if next == slot {
                continue;
            }
            let after = at(next, 0);
            for v in 0..2 {
                let full = |turned: &Turned, place: &Place| {
                    [turned.held[v].at[0], turned.held[v].at[1], place.yaw(v)]
                };
                let (angle, by) =
                    self.courses[v].angle_rad(&full(&before, place), &full(&after, &places[next]));
                let may = self.rates_rad_s[v] * (place.silence_s - READY_S).max(1e-6);
                let (square, slope) = hinge(angle / may, PART_OF_TURNS);
                if slope <= 0.0 {
                    continue;
                }
                sum += square;
                let by = by.map(|by| [scale * slope / may * by[0], scale * slope / may * by[1]]);
                let spots = [&self.knots[slot][KNOTS - 1].spot, &self.knots[next][0].spot];
                self.pull((slot, &[(KNOTS - 1, 1.0)]), v, (&before, spots[0]), by[0], gradient);
                self.pull((next, &[(0, 1.0)]), v, (&after, spots[1]), by[1], gradient);
            }
        }
        sum
    }

    /// Squares of what motion exceeds.
    fn motion(&self, x: &[f64], scale: f64, gradient: &mut [f64]) -> f64 {
        let n = self.frame.controls;
        let h = self.frame.superframe_s / n as f64;
        let mut sum = 0.0;
        for v in (0..2).filter(|v| self.frame.moves[*v]) {
            let limits = &self.limits[v];
            for segment in 0..n {
                let at = spline::about(segment, n);
                let of = |weights: [f64; 4], per: f64| {
                    let spot = Spot { at, weights: weights.map(|w| w / per) };
                    (self.frame.position(x, v, &spot), spot)
                };
                let mut over = |value: Vector3<f64>, spot: &Spot, limit: f64| {
                    let size = value.norm();
                    let (square, slope) = hinge(size / limit, PART);
                    if slope > 0.0 {
                        sum += square;
                        self.push(v, spot, &(value * (scale * slope / (size * limit))), gradient);
                    }
                };
                for share in [0.0, 0.5] {
                    let (velocity, spot) = of(spline::slopes(share), h);
                    over(Vector3::new(velocity.x, velocity.y, 0.0), &spot, limits.speed_m_s);
                    over(Vector3::new(0.0, 0.0, velocity.z), &spot, limits.climb_m_s);
                }
                let (acceleration, spot) = of(spline::bends(0.0), h * h);
                over(acceleration, &spot, limits.acceleration_m_s2);
                if let Some(limit) = limits.jerk_m_s3 {
                    let (jerk, spot) = of(spline::JERKS, h * h * h);
                    over(jerk, &spot, limit);
                }
            }
        }
        sum
    }

    /// Squares of what lies beyond the area's sides, and of what vehicles are too near to each other.
    fn places(&self, x: &[f64], scale: f64, gradient: &mut [f64]) -> f64 {
        let mut sum = 0.0;
        let setup = &self.frame.setups[0];
        for v in 0..2 {
            let sides = &setup.region.cells()[self.frame.cells[v]].sides;
            for control in 0..self.frame.controls {
                let at = self.frame.point(v, control);
                for side in sides {
                    let out = UNIT_M * (side.normal.x * x[at] + side.normal.y * x[at + 1]) - side.offset_m;
                    let (square, slope) = hinge(BY_METRE * out, -BY_METRE * ASIDE_M);
                    if slope > 0.0 {
                        sum += square;
                        gradient[at] += scale * slope * BY_METRE * UNIT_M * side.normal.x;
                        gradient[at + 1] += scale * slope * BY_METRE * UNIT_M * side.normal.y;
                    }
                }
            }
        }
        let least_m = setup.problem.airspace.min_separation_m;
        if least_m > 0.0 {
            for spot in &self.together {
                let between = self.frame.position(x, 0, spot) - self.frame.position(x, 1, spot);
                let size = between.norm().max(1e-6);
                let (square, slope) = hinge((least_m - size) / least_m, -ASIDE_M / least_m);
                if slope > 0.0 {
                    sum += square;
                    let by = between * (-scale * slope / (size * least_m));
                    self.push(0, spot, &by, gradient);
                    self.push(1, spot, &-by, gradient);
                }
            }
        }
        sum
    }

    /// The cost, which is to be as small as it can, and its gradient.
    pub fn cost(&self, x: &[f64], look: &Look, memory: &mut Memory, gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        let worth = match self.case.service.fairness {
            Fairness::Slots => {
                let per_s = 1.0 / self.frame.superframe_s;
                (0..self.frame.places.len())
                    .map(|slot| per_s * self.volume(x, slot, -per_s, look, memory, gradient))
                    .sum()
            }
            Fairness::MaxMin => self.least(x, look, memory, gradient),
        };
        let stiff = look.stiffness / self.frame.places.len() as f64;
        let beyond = self.turns(x, stiff, gradient)
            + self.motion(x, stiff, gradient)
            + self.places(x, stiff, gradient);
        stiff * beyond - worth
    }

    /// A smooth stand-in for the least of all volumes for each second, from below.
    fn least(&self, x: &[f64], look: &Look, memory: &mut Memory, gradient: &mut [f64]) -> f64 {
        let served: Vec<usize> =
            (0..self.frame.places.len()).filter(|slot| self.frame.places[*slot].is_served()).collect();
        let per_s = 1.0 / self.frame.superframe_s;
        let mut parts = vec![vec![0.0; gradient.len()]; served.len()];
        let volumes: Vec<f64> = served
            .iter()
            .zip(&mut parts)
            .map(|(slot, part)| per_s * self.volume(x, *slot, -per_s, look, memory, part))
            .collect();
        let Some(least) = volumes.iter().copied().reduce(f64::min) else { return 0.0 };
        let weights: Vec<f64> = volumes.iter().map(|v| libm::exp(-SHARPNESS * (v - least))).collect();
        let sum: f64 = weights.iter().sum();
        for (part, weight) in parts.iter().zip(&weights) {
            for (g, p) in gradient.iter_mut().zip(part) {
                *g += weight / sum * p;
            }
        }
        least - libm::log(sum) / SHARPNESS
    }
}
