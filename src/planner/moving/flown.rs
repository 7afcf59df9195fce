//! From the variables of a search to what is flown: limits met exactly, knots close enough together to be flown by.
//!
//! 1. *Ways.* Control points are brought into their convex cell of the airspace, and so is the whole way. What still exceeds a
//!    limit of motion is drawn together about the way's centre, by which everything that it asks shrinks alike; and once more as
//!    long as the ways come too near to each other, be it at different times: either vehicle may stop on its own. All this is
//!    verified on the curves themselves ([`Spline::demand`], [`Spline::keeps_apart`]).
//! 2. *Knots* at most [`STEP_S`] apart: between them roll and pitch run evenly, and J's null leads and lags its user by less than a
//!    tenth of a degree. From the middle of a slot outwards no knot is farther from the last than the vehicle turns.
//! 3. *Silences* as long as the turns in them ask for, and never shorter than in the search. Where one is longer, the superframe
//!    is, and the same ways are flown more slowly.
//! 4. *Powers* between knots: the best that the transmitter can give.

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::model::Memory;
use super::super::plan::VehiclePlan;
use super::super::powers;
use super::super::setup::Setup;
use super::super::turning::{Between, Course, Knot, Protected, READY_S, Sizes, Slot, tolerance_of};
use super::super::volume::Fairness;
use super::super::volume::objective::{Case, FINE, MEDIUM, View};
use super::super::volume::ways::Ways;
use super::frame::{Frame, KNOTS, Place, STEPS, UNIT_LOG, UNIT_RAD};
use super::limits::Limits;
use super::objective::NODES;
use super::spline::Spline;
use crate::geo::{Enu, Pose};
use crate::role::{PerVehicle, Role};

/// Longest time between knots that are flown, in seconds.
const STEP_S: f64 = 1.0;
/// How far inside a side a control point is brought, in metres.
const INSIDE_M: f64 = 1e-9;
/// The part of its limits of motion that a way asks for at most: what is left is for whoever enters and leaves it.
const KEPT: f64 = 0.975;
/// Rounding's part of a limit.
const ROUNDING: f64 = 1e-9;
/// How often ways are drawn together for the separation's sake, and to what part.
const APART_ROUNDS: usize = 12;
const APART_FACTOR: f64 = 0.96;
/// How often silences are made longer.
const SILENCE_ROUNDS: usize = 6;

/// What is flown, and what it is worth.
#[derive(Debug, Clone)]
pub struct Flown {
    pub protected: Protected,
    pub ways: [Spline; 2],
    /// What counts of all volumes for each second, nats per hertz and second.
    pub worth: f64,
    /// In each slot, whether a knot is one of the search's: its tolerances are looked at.
    pub of_search: Vec<Vec<bool>>,
}

/// A knot as it is made.
#[derive(Debug, Clone, Copy)]
struct Made {
    /// Seconds from the slot's beginning.
    at_s: f64,
    angles: [[f64; 2]; 2],
    /// Which interval of the search begins here or has begun, and whether it does here.
    step: usize,
    of_search: bool,
}

/// What is needed to make a plan of variables.
pub struct Maker<'a, 'b, W> {
    pub case: &'a Case<'b, W>,
    pub frame: &'a Frame<'b>,
    pub limits: [Limits; 2],
    pub guard_s: f64,
}

impl<W: Ways> Maker<'_, '_, W> {
    fn rate_rad_s(&self, v: usize) -> f64 {
        self.case.ways.turn_rate_rad_s(Role::BOTH[v])
    }

    /// Brings a control point into its vehicle's cell; `None` where that does not settle.
    fn inside(&self, v: usize, point: &Enu) -> Option<Enu> {
        let region = &self.frame.setups[0].region;
        let cell = &region.cells()[self.frame.cells[v]];
        let [low, high] = cell.altitude_m;
        let mut at = Enu::new(point.x, point.y, point.z.clamp(low, high));
        for _ in 0..200 {
            let mut outside = false;
            for side in &cell.sides {
                let out_m = side.normal.dot(&at.xy()) - side.offset_m;
                if out_m > -0.5 * INSIDE_M {
                    outside = true;
                    let by = side.normal * (out_m + INSIDE_M);
                    (at.x, at.y) = (at.x - by.x, at.y - by.y);
                }
            }
            if !outside {
                return Some(at);
            }
        }
        None
    }

    /// Both ways within all limits of place and motion.
    fn ways(&self, x: &[f64]) -> Option<[Spline; 2]> {
        let mut ways = [self.frame.way(x, 0), self.frame.way(x, 1)];
        for v in 0..2 {
            if self.frame.moves[v] {
                for point in &mut ways[v].control_enu_m {
                    *point = self.inside(v, point)?;
                }
            }
            let strain = self.limits[v].strain(&ways[v].demand());
            if strain > KEPT {
                ways[v] = ways[v].shrunk(KEPT / strain);
            }
        }
        let least_m = self.frame.setups[0].problem.airspace.min_separation_m;
        for _ in 0..=APART_ROUNDS {
            if least_m <= 0.0 || ways[0].keeps_apart(&ways[1], least_m) {
                let kept = (0..2).all(|v| self.limits[v].strain(&ways[v].demand()) <= 1.0);
                return kept.then_some(ways);
            }
            ways = ways.map(|way| way.shrunk(APART_FACTOR));
        }
        None
    }

    /// A slot's knots, with ways as long as `ways` and the slot beginning so late.
    fn made(&self, x: &[f64], slot: usize, begins_s: f64, ways: &[Spline; 2]) -> Vec<Made> {
        let frame = self.frame;
        let place = &frame.places[slot];
        let given = |knot: usize, v: usize| {
            let at = frame.angles(slot, knot, v);
            [UNIT_RAD * x[at], UNIT_RAD * x[at + 1]]
        };
        let at = |at_s: f64, step: usize, share: f64, of_search: bool| {
            let ends = [step, (step + 1).min(KNOTS - 1)];
            let between = |v: usize| {
                let [a, b] = ends.map(|knot| given(knot, v));
                [0, 1].map(|k: usize| a[k] + share * (b[k] - a[k]))
            };
            // What is allowed between two allowed attitudes: I's angles as they are held, J's about its null.
            let [a, b] = ends.map(|knot| frame.held(0, given(knot, 0)).at);
            let i = [0, 1].map(|k: usize| a[k] + share * (b[k] - a[k]));
            let (null, _) = frame.null(place, &ways[1].position(begins_s + at_s));
            let beside = between(1);
            let j = frame.held(1, [null[0] + beside[0], null[1] + beside[1]]).at;
            Made { at_s, angles: [i, j], step, of_search }
        };
        let mut knots = Vec::new();
        for step in 0..STEPS {
            let [from, to] = [place.knots_s[step], place.knots_s[step + 1]];
            let parts = ((to - from) / STEP_S).ceil().max(1.0) as usize;
            for part in 0..parts {
                let share = part as f64 / parts as f64;
                knots.push(at(from + share * (to - from), step, share, part == 0));
            }
        }
        knots.push(at(place.knots_s[KNOTS - 1], STEPS, 0.0, true));
        self.keep_rates(&mut knots);
        knots
    }

    /// From the middle on nobody turns faster than it can.
    fn keep_rates(&self, knots: &mut [Made]) {
        let (middle, count) = (knots.len() / 2, knots.len());
        let mut draw = |from: usize, to: usize| {
            let lasts_s = (knots[to].at_s - knots[from].at_s).abs();
            for v in 0..2 {
                let [a, b] = [from, to].map(|k| knots[k].angles[v]);
                let way = [b[0] - a[0], b[1] - a[1]];
                let angle = libm::hypot(way[0], way[1]);
                let may = (1.0 - ROUNDING) * self.rate_rad_s(v) * lasts_s;
                if angle > may {
                    knots[to].angles[v] = [0, 1].map(|k: usize| a[k] + way[k] * may / angle);
                }
            }
        };
        for k in middle + 1..count {
            draw(k - 1, k);
        }
        for k in (0..middle).rev() {
            draw(k + 1, k);
        }
    }

    fn course(&self, v: usize) -> Course {
        Course::within(self.frame.setups[0].tilt_rad[v])
    }

    /// The turn after a slot and what follows it in silence, in seconds.
    fn turn_s(&self, slots: &[Vec<Made>], slot: usize) -> f64 {
        let next = (slot + 1) % slots.len();
        let [Some(last), Some(first)] = [slots[slot].last(), slots[next].first()] else { return 0.0 };
        let places = [slot, next].map(|slot| &self.frame.places[slot]);
        let turn_s = |v: usize| {
            let [a, b] = [(last, places[0]), (first, places[1])]
                .map(|(made, place)| [made.angles[v][0], made.angles[v][1], place.yaw(v)]);
            self.course(v).angle_rad(&a, &b).0 / self.rate_rad_s(v)
        };
        READY_S + turn_s(0).max(turn_s(1)) * (1.0 + ROUNDING)
    }

    /// What is flown by some variables; `None` where limits cannot be met.
    pub fn flown(&self, x: &[f64], memory: &mut Memory) -> Option<Flown> {
        let mut ways = self.ways(x)?;
        let places = &self.frame.places;
        let mut silences_s: Vec<f64> = places.iter().map(|place| place.silence_s.max(self.guard_s)).collect();
        for _ in 0..SILENCE_ROUNDS {
            let mut begins_s = Vec::with_capacity(places.len());
            let mut at_s = 0.0;
            for (place, silence_s) in places.iter().zip(&silences_s) {
                begins_s.push(at_s);
                at_s += place.on_air_s + silence_s;
            }
            ways.iter_mut().for_each(|way| way.period_s = at_s);
            let slots: Vec<Vec<Made>> =
                (0..places.len()).map(|slot| self.made(x, slot, begins_s[slot], &ways)).collect();
            let mut kept = true;
            for slot in 0..places.len() {
                let turn_s = self.turn_s(&slots, slot);
                if turn_s > silences_s[slot] {
                    silences_s[slot] = turn_s * (1.0 + 1e-6);
                    kept = false;
                }
            }
            if kept {
                return Some(self.rated(x, &slots, (&begins_s, &silences_s, at_s), ways, memory));
            }
        }
        None
    }

    fn configuration(&self, place: &Place, ways: &[Spline; 2], at_s: f64, angles: &[[f64; 2]; 2]) -> Raw {
        let mut raw = place.standing;
        for v in 0..2 {
            let at = v * VEHICLE;
            raw[at..at + 3].copy_from_slice(ways[v].position(at_s).as_slice());
            raw[at + ANGLES..at + ANGLES + 2].copy_from_slice(&angles[v]);
        }
        raw
    }

    /// J's power and the mean rate from a knot to the next.
    fn service(
        &self,
        x: &[f64],
        (slot, begins_s): (usize, f64),
        ways: &[Spline; 2],
        [from, to]: [&Made; 2],
        memory: &mut Memory,
    ) -> (f64, f64) {
        let place = &self.frame.places[slot];
        if !place.is_served() {
            return (0.0, 0.0);
        }
        let mut nodes = NODES.map(|share| {
            let angles = [0, 1].map(|v: usize| {
                [0, 1].map(|k: usize| from.angles[v][k] + share * (to.angles[v][k] - from.angles[v][k]))
            });
            let at_s = begins_s + from.at_s + share * (to.at_s - from.at_s);
            self.configuration(place, ways, at_s, &angles)
        });
        let near_w = place.power_w(UNIT_LOG * x[self.frame.power(slot, from.step)]);
        let setup = &self.frame.setups[place.user];
        let mut mean = |view: View, power_w: f64| {
            let target = self.case.target(place.user, view, true);
            let rates = nodes.each_mut().map(|raw| {
                raw[VEHICLE + POWER] = power_w;
                memory.value_alone(setup, target, raw).max(0.0)
            });
            0.5 * (rates[0] + rates[1])
        };
        let power_w = powers::best_w(setup, near_w, place.power, |power_w| mean(MEDIUM, power_w));
        (power_w, mean(FINE, power_w))
    }

    /// Powers, rates and volumes of knots.
    fn rated(
        &self,
        x: &[f64],
        slots: &[Vec<Made>],
        (begins_s, silences_s, superframe_s): (&[f64], &[f64], f64),
        ways: [Spline; 2],
        memory: &mut Memory,
    ) -> Flown {
        let mut out = Vec::with_capacity(slots.len());
        let mut volumes = Vec::with_capacity(slots.len());
        for (slot, made) in slots.iter().enumerate() {
            let place = &self.frame.places[slot];
            let problem = self.frame.setups[place.user].problem;
            let bits = problem.radio.bandwidth_hz / std::f64::consts::LN_2;
            let mut volume = 0.0;
            let mut knots = Vec::with_capacity(made.len());
            for (k, from) in made.iter().enumerate() {
                let (power_w, rate, served) = match made.get(k + 1) {
                    Some(to) => {
                        let (power_w, rate) =
                            self.service(x, (slot, begins_s[slot]), &ways, [from, to], memory);
                        volume += (to.at_s - from.at_s) * rate;
                        (power_w, rate, place.is_served())
                    }
                    None => (0.0, 0.0, false),
                };
                let at_s = begins_s[slot] + from.at_s;
                let mut raw = self.configuration(place, &ways, at_s, &from.angles);
                raw[VEHICLE + POWER] = power_w;
                if !served {
                    raw[POWER] = 0.0;
                }
                knots.push(Knot {
                    at_s,
                    vehicles: vehicles(&raw),
                    served: served.then_some(place.user),
                    rate_bps: rate * bits,
                    tolerance: None,
                });
            }
            if place.is_served() {
                volumes.push(volume);
            }
            out.push(Slot {
                user: place.user,
                on_air_s: place.on_air_s,
                silence_s: silences_s[slot],
                between: Between::Turn(PerVehicle { i: self.course(0), j: self.course(1) }),
                volume_bits: volume * bits,
                knots,
            });
        }
        let counted = match self.case.service.fairness {
            Fairness::Slots => volumes.iter().sum::<f64>(),
            Fairness::MaxMin => volumes.iter().copied().reduce(f64::min).unwrap_or(0.0),
        };
        Flown {
            protected: Protected { slots: out, superframe_s },
            ways,
            worth: counted / superframe_s,
            of_search: slots.iter().map(|made| made.iter().map(|knot| knot.of_search).collect()).collect(),
        }
    }

    /// The tolerances of knots, for losses of a share of the rate: those of the search's knots are looked at, and between two of
    /// them what the stricter one allows.
    pub fn add_tolerances(&self, flown: &mut Flown, share: f64, threads: usize) {
        let wanted: Vec<(usize, usize)> = flown
            .of_search
            .iter()
            .enumerate()
            .flat_map(|(slot, all)| (0..all.len()).filter(|k| all[*k]).map(move |knot| (slot, knot)))
            .collect();
        let slots = &flown.protected.slots;
        let found = super::super::parallel::map(threads, wanted.len(), |memory: &mut Memory, index| {
            let (slot, knot) = wanted[index];
            // Where the silence begins it is the last that is served.
            let knots = &slots[slot].knots;
            let user = knots[knot].served?;
            let setup = &self.frame.setups[user];
            let target = self.case.target(user, MEDIUM, true);
            tolerance_of(setup, &Setup::raw(&knots[knot].vehicles), share, &Sizes::ALL, |raw| {
                memory.value_alone(setup, target, raw)
            })
        });
        for ((slot, knot), tolerance) in wanted.into_iter().zip(found) {
            flown.protected.slots[slot].knots[knot].tolerance = tolerance;
        }
        for (slot, of_search) in flown.protected.slots.iter_mut().zip(&flown.of_search) {
            let mut before = None;
            for k in 0..slot.knots.len() {
                if of_search[k] {
                    before = slot.knots[k].tolerance;
                    continue;
                }
                let next = (k..of_search.len()).find(|other| of_search[*other]);
                let after = next.and_then(|next| slot.knots[next].tolerance);
                slot.knots[k].tolerance = match (before, after) {
                    (Some(a), Some(b)) => Some(a.and(&b)),
                    (one, other) => one.or(other),
                };
            }
        }
    }
}

fn vehicles(raw: &Raw) -> PerVehicle<VehiclePlan> {
    PerVehicle::from_fn(|role| {
        let part = &raw[if role == Role::I { 0 } else { VEHICLE }..][..VEHICLE];
        VehiclePlan {
            pose: Pose {
                position_enu_m: Enu::new(part[0], part[1], part[2]),
                roll_rad: part[ANGLES],
                pitch_rad: part[ANGLES + 1],
                yaw_rad: part[ANGLES + 2],
            },
            tx_power_w: part[POWER],
        }
    })
}
