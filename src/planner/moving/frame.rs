//! A superframe to be flown through: who is served when, and the variables of the search.
//!
//! Variables, in this order: the control points of I's and J's ways, three numbers each (one point for all of a vehicle that
//! stays where it is); then, slot by slot, for each of [`KNOTS`] knots I's roll and pitch and what J's roll and pitch are beside
//! those of its null on the user, and for each interval between them the logarithm of J's power over its ceiling.
//!
//! Knots are closer together where a slot begins and ends, where vehicles turn from one user and to the next.

use nalgebra::Vector3;

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::powers;
use super::super::setup::Setup;
use super::super::turning::Held;
use super::super::variables::PowerChart;
use super::spline::{self, Spline};
use crate::geo::Enu;
use crate::planner::turning::Protected;

/// Knots of a slot in the search.
pub const KNOTS: usize = 13;
/// Intervals between them.
pub const STEPS: usize = KNOTS - 1;
/// Control points of a way for each slot.
pub const CONTROLS: usize = 4;
/// Shares of a turn's time at which knots lie from either end.
const EARLY: [f64; 4] = [0.0, 0.22, 0.52, 1.0];
/// The most of its time on the air that the closer knots at one end of a slot take.
const MOST_OF_A_SLOT: f64 = 0.2;
/// Units of the variables: with these what changes a volume changes it about as much.
pub const UNIT_M: f64 = 20.0;
pub const UNIT_RAD: f64 = 0.1;
pub const UNIT_LOG: f64 = 0.5;
/// A power of J that does not vary is written as this logarithm.
const LEAST_LOG: f64 = -25.0;

/// One user's part of the superframe.
#[derive(Debug, Clone)]
pub struct Place {
    pub user: usize,
    pub begins_s: f64,
    pub on_air_s: f64,
    /// Both are silent afterwards.
    pub silence_s: f64,
    /// The configuration in which a plan that stays serves it: its yaws and I's power are those of this one too.
    pub standing: Raw,
    /// Of each knot, seconds from the slot's beginning.
    pub knots_s: [f64; KNOTS],
    /// Ceiling of J's power in W and its least logarithm; none if it does not vary.
    pub power: Option<(f64, f64)>,
}

impl Place {
    /// Whether anybody radiates for it.
    pub fn is_served(&self) -> bool {
        self.standing[POWER] > 0.0
    }

    pub fn yaw(&self, v: usize) -> f64 {
        self.standing[v * VEHICLE + ANGLES + 2]
    }

    pub fn power_w(&self, log: f64) -> f64 {
        match self.power {
            Some((max_w, floor)) => max_w * libm::exp(log.clamp(floor, 0.0)),
            None => self.standing[VEHICLE + POWER],
        }
    }
}

/// Four control points and their weights.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    pub at: [usize; 4],
    pub weights: [f64; 4],
}

/// A superframe in one order of service.
pub struct Frame<'a> {
    pub setups: &'a [Setup<'a>],
    pub places: Vec<Place>,
    pub superframe_s: f64,
    /// Control points of each way.
    pub controls: usize,
    /// Which of I and J may move.
    pub moves: [bool; 2],
    /// The convex cells of the airspace in which they do.
    pub cells: [usize; 2],
}

/// Instants of a slot's knots, seconds from its beginning.
fn knots_s(on_air_s: f64, turn_s: f64) -> [f64; KNOTS] {
    let end_s = turn_s.min(MOST_OF_A_SLOT * on_air_s);
    let early = EARLY.len() - 1;
    let last = KNOTS - 1;
    std::array::from_fn(|k| {
        if k <= early {
            EARLY[k] * end_s
        } else if k >= last - early {
            on_air_s - EARLY[last - k] * end_s
        } else {
            let share = (k - early) as f64 / (last - 2 * early) as f64;
            end_s + share * (on_air_s - 2.0 * end_s)
        }
    })
}

impl<'a> Frame<'a> {
    /// Of users in `order`, each on the air and silent as long as in a plan that turns. `standing` are configurations by user;
    /// `turn_s` is how long a turn takes that must be made on the air.
    pub fn new(
        setups: &'a [Setup<'a>],
        turning: &Protected,
        standing: &[Raw],
        order: &[usize],
        (turn_s, least_silence_s): (f64, f64),
    ) -> Self {
        let mut begins_s = 0.0;
        let same = turning.slots.iter().zip(order).all(|(slot, user)| slot.user == *user);
        let mut places = Vec::with_capacity(order.len());
        for (index, &user) in order.iter().enumerate() {
            let own = turning.slots.iter().find(|slot| slot.user == user);
            let on_air_s = own.map_or(0.0, |slot| slot.on_air_s);
            // In another order nobody knows yet how long the turns will be; and a transit is flown on the air.
            let is_turn = |slot: &&super::super::turning::Slot| {
                same && matches!(slot.between, super::super::turning::Between::Turn(_))
            };
            let silence_s =
                turning.slots.get(index).filter(is_turn).map_or(least_silence_s, |slot| slot.silence_s);
            let power = match powers::of(&setups[user], &standing[user]) {
                PowerChart::Log { max_w, floor } if standing[user][VEHICLE + POWER] > 0.0 => {
                    Some((max_w, floor))
                }
                _ => None,
            };
            let knots_s = knots_s(on_air_s, turn_s);
            let standing = standing[user];
            places.push(Place { user, begins_s, on_air_s, silence_s, standing, knots_s, power });
            begins_s += on_air_s + silence_s;
        }
        let setup = &setups[0];
        let cell = |v: usize| {
            let at = |raw: &Raw| Vector3::new(raw[v * VEHICLE], raw[v * VEHICLE + 1], raw[v * VEHICLE + 2]);
            let all: Vec<usize> = standing.iter().map(|raw| setup.region.cell_of(&at(raw))).collect();
            all.first().copied().unwrap_or(0)
        };
        Self {
            setups,
            controls: CONTROLS * places.len(),
            places,
            superframe_s: begins_s,
            // A level vehicle leans to move, and is not level then.
            moves: [0, 1].map(|v: usize| setup.tilt_rad[v] > 0.0),
            cells: [cell(0), cell(1)],
        }
    }

    fn points(&self, v: usize) -> usize {
        if self.moves[v] { self.controls } else { 1 }
    }

    /// First variable of a control point of a vehicle.
    pub fn point(&self, v: usize, control: usize) -> usize {
        let before = if v == 0 { 0 } else { 3 * self.points(0) };
        before + if self.moves[v] { 3 * control } else { 0 }
    }

    fn slot(&self, slot: usize) -> usize {
        3 * (self.points(0) + self.points(1)) + slot * (4 * KNOTS + STEPS)
    }

    /// First of the variables of a vehicle's roll and pitch at a knot.
    pub fn angles(&self, slot: usize, knot: usize, v: usize) -> usize {
        self.slot(slot) + 4 * knot + 2 * v
    }

    /// The variable of J's power in an interval.
    pub fn power(&self, slot: usize, step: usize) -> usize {
        self.slot(slot) + 4 * KNOTS + step
    }

    pub fn dimension(&self) -> usize {
        self.slot(self.places.len())
    }

    /// Lowest and highest of each variable.
    pub fn bounds(&self) -> Vec<[f64; 2]> {
        let mut bounds = vec![[f64::NEG_INFINITY, f64::INFINITY]; self.dimension()];
        for v in 0..2 {
            let altitude_m = self.setups[0].region.cells()[self.cells[v]].altitude_m;
            for control in 0..self.points(v) {
                bounds[self.point(v, control) + 2] = altitude_m.map(|z| z / UNIT_M);
            }
        }
        for (slot, place) in self.places.iter().enumerate() {
            let floor = place.power.map_or(LEAST_LOG, |(_, floor)| floor);
            for step in 0..STEPS {
                bounds[self.power(slot, step)] = [floor / UNIT_LOG, 0.0];
            }
        }
        bounds
    }

    /// The control points and weights of an instant of the superframe.
    pub fn spot(&self, t_s: f64) -> Spot {
        let (segment, share) = spline::locate(t_s, self.superframe_s, self.controls);
        Spot { at: spline::about(segment, self.controls), weights: spline::weights(share) }
    }

    pub fn position(&self, x: &[f64], v: usize, spot: &Spot) -> Enu {
        let mut sum = Enu::zeros();
        for (control, weight) in spot.at.iter().zip(spot.weights) {
            let at = self.point(v, *control);
            sum += Vector3::new(x[at], x[at + 1], x[at + 2]) * (weight * UNIT_M);
        }
        sum
    }

    /// A vehicle's way.
    pub fn way(&self, x: &[f64], v: usize) -> Spline {
        let point = |control: usize| {
            let at = self.point(v, control);
            Vector3::new(x[at], x[at + 1], x[at + 2]) * UNIT_M
        };
        Spline { period_s: self.superframe_s, control_enu_m: (0..self.controls).map(point).collect() }
    }

    /// I's roll and pitch from two variables.
    pub fn held(&self, v: usize, given: [f64; 2]) -> Held {
        if self.setups[0].tilt_rad[v] > 0.0 {
            Held::new(given, self.setups[0].tilt_rad[v])
        } else {
            Held::new([0.0; 2], 0.0)
        }
    }

    /// J's roll and pitch with its null on a slot's user, and how they change with its position.
    pub fn null(&self, place: &Place, position: &Enu) -> ([f64; 2], [[f64; 3]; 2]) {
        null(&(position - self.setups[place.user].problem.user_enu_m), place.yaw(1))
    }

    /// The variables of ways and of what vehicles hold all through each slot: configurations by slot, whose positions are not
    /// asked for.
    pub fn encode(&self, ways: &[Vec<Enu>; 2], held: &[Raw]) -> Vec<f64> {
        let mut x = vec![0.0; self.dimension()];
        for v in 0..2 {
            let centre = ways[v].iter().sum::<Enu>() / ways[v].len() as f64;
            for control in 0..self.controls {
                let p = if self.moves[v] { ways[v][control] } else { centre };
                let at = self.point(v, control);
                for k in 0..3 {
                    x[at + k] = p[k] / UNIT_M;
                }
            }
        }
        for (slot, place) in self.places.iter().enumerate() {
            let raw = &held[slot];
            let own = Vector3::new(raw[VEHICLE], raw[VEHICLE + 1], raw[VEHICLE + 2]);
            let (null, _) = self.null(place, &own);
            for knot in 0..KNOTS {
                for k in 0..2 {
                    x[self.angles(slot, knot, 0) + k] = raw[ANGLES + k] / UNIT_RAD;
                    x[self.angles(slot, knot, 1) + k] = (raw[VEHICLE + ANGLES + k] - null[k]) / UNIT_RAD;
                }
            }
            let log = place.power.map_or(0.0, |(max_w, floor)| {
                libm::log((raw[VEHICLE + POWER] / max_w).max(1e-30)).clamp(floor, 0.0)
            });
            for step in 0..STEPS {
                x[self.power(slot, step)] = log / UNIT_LOG;
            }
        }
        x
    }
}

/// Roll and pitch at a yaw of the antenna line along `d`, the upper end, and their derivatives by `d`
/// ([`canonical_angles`](crate::radio::pattern::canonical_angles)).
pub(in crate::planner) fn null(d: &Vector3<f64>, yaw: f64) -> ([f64; 2], [[f64; 3]; 2]) {
    let (sin, cos) = libm::sincos(yaw);
    let up = if d.z < 0.0 { -1.0 } else { 1.0 };
    let [x, y, z] = [up * (cos * d.x + sin * d.y), up * (cos * d.y - sin * d.x), up * d.z];
    let plane2 = (x * x + z * z).max(1e-12);
    let plane = plane2.sqrt();
    let square = plane2 + y * y;
    let roll = libm::atan2(-y, plane);
    let pitch = libm::atan2(x, z);
    let by_roll = [y * x / (plane * square), -plane / square, y * z / (plane * square)];
    let by_pitch = [z / plane2, 0.0, -x / plane2];
    let turned =
        |by: [f64; 3]| [up * (cos * by[0] - sin * by[1]), up * (sin * by[0] + cos * by[1]), up * by[2]];
    ([roll, pitch], [turned(by_roll), turned(by_pitch)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::pattern;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn val_the_null_is_along_the_line_and_its_slopes_those_of_differences(
            d in prop::array::uniform3(-100.0..100.0f64),
            yaw in -3.0..3.0f64,
        ) {
            let d = Vector3::from(d);
            prop_assume!(d.z.abs() > 1.0 && d.norm() > 10.0);
            let ([roll, pitch], by) = null(&d, yaw);
            let axis = pattern::antenna_axis(roll, pitch, yaw);
            prop_assert!(axis.cross(&d).norm() < 1e-9 * d.norm());
            for k in 0..3 {
                let at = |step: f64| {
                    let mut moved = d;
                    moved[k] += step;
                    null(&moved, yaw).0
                };
                for angle in 0..2 {
                    let numeric = (at(1e-4)[angle] - at(-1e-4)[angle]) / 2e-4;
                    prop_assert!((numeric - by[angle][k]).abs() < 1e-5, "{} {}", numeric, by[angle][k]);
                }
            }
        }
    }

    #[test]
    fn val_knots_reach_from_end_to_end_and_are_closer_there() {
        let knots = knots_s(9.0, 1.0);
        assert!(knots[0] == 0.0 && knots[KNOTS - 1] == 9.0);
        assert!(knots.windows(2).all(|pair| pair[0] < pair[1]));
        assert!((knots[3] - 1.0).abs() < 1e-12 && (knots[KNOTS - 4] - 8.0).abs() < 1e-12);
    }
}
