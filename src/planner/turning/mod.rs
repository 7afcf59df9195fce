//! Service that goes on while the pair turns from one user to the next.
//!
//! A plan for volume ([`volume`]) has the pair silent between slots: both turn, come to rest, and radiate again.
//! Here users that are served from the same positions follow each other with no more silence than the change of the served user
//! asks for: the vehicles leave their attitudes while the one user is still served, turn the rest of the way in silence, and
//! reach the next ones' while the next is served already.
//!
//! 1. *Standing.* Each user has a pose of both vehicles and powers, a volume plan's or any. On the air it is as long as its slot
//!    gives it, `slot - guard`: shares are as they are said, and what is gained is time.
//! 2. *Turns.* For each change of the served user the ramps on either side of the silence, J's power along them, and the silence
//!    itself, at least the guard and long enough for either axis (`change`). Vehicles never turn faster than their rate, and
//!    never tilt beyond their limit, at the knots and between them (`turn`, `ramp`).
//! 3. *Positions* that change between two slots are changed in silence, as the schedule has it, with the guard and the time to
//!    come to rest.
//! 4. *The standing poses* themselves can be chosen for all this ([`plan`]): the search for a volume's poses is told that a
//!    turn at one place takes the longer of the guard and the turn, that nobody comes to rest there, and that slots are their
//!    time on the air (`ways`). Its best candidates, and the volume plan itself, are given their turns, and the best is kept.
//!
//! The superframe is a cycle, and takes
//!
//! ```text
//! sum of (slot - guard) + sum of silences,    silence = max(guard, turn + 0.2 s) at one place, guard + settling + transit else;
//! ```
//!
//! each turn being what is left of it between the ramps' ends, and 0.2 s what a jammer and a lease need after it ([`READY_S`]). Without ramps that is never more than the volume plan's
//! `sum of slots + users * settling + sum of transits`, and rates are the same: the volume for each second is never below the
//! static plan's. (A vehicle whose tilt is limited turns its angles evenly in the silence, where a transit takes the shortest
//! rotation through any tilt: it may lose by that, where neither guard nor settling makes up for it.)
//!
//! At each knot a plan can say how wrong poses may be there (`tolerance`). Deterministic, like all plans, whatever the number of
//! threads.

mod change;
mod path;
mod ramp;
#[cfg(test)]
mod tests;
mod tolerance;
mod turn;
mod ways;

pub use path::{Between, Knot, Protected, READY_S, Slot, State};
pub use tolerance::{LARGEST_M, LARGEST_RAD, Sizes, TOLERATED, Tolerance};
pub use turn::{Angles, Course};
pub(super) use {tolerance::of as tolerance_of, turn::Held, ways::angles};

use super::error::PlanError;
use super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::model::Memory;
use super::plan::VehiclePlan;
use super::problem::Problem;
use super::setup::Setup;
use super::volume::objective::{Case, FINE, MEDIUM, legs};
use super::volume::shares::{Shares, shares};
use super::volume::{self, Fairness, Service, Ways};
use super::{Options, parallel};
use crate::role::{PerVehicle, Role};
use change::{Change, Changed, STEPS, Step};
use ways::{Turning, at_one_place, on_air};

/// The part of its slot's time on the air that a ramp takes at most.
const MOST_OF_A_SLOT: f64 = 0.45;

/// A static plan that is to be turned through: by user, as listed.
#[derive(Debug, Clone, Copy)]
pub struct Standing<'a> {
    /// Each user's poses and powers.
    pub vehicles: &'a [PerVehicle<VehiclePlan>],
    /// The length of each one's slot in seconds, the guard included.
    pub slots_s: &'a [f64],
    /// In which order they are served; as the service says, where none is given.
    pub order: Option<&'a [usize]>,
}

/// Gives a static plan its turns. `share` is the part of the rate by which the tolerances of knots are measured; none are where
/// it is not given.
///
/// # Errors
/// [`PlanError`] for a problem without meaning, or a method or an objective that knows no volume; and where a way between
/// two users' positions cannot be flown.
pub fn through(
    problems: &[Problem],
    standing: &Standing<'_>,
    service: &Service,
    ways: &impl Ways,
    options: &Options,
    share: Option<f64>,
) -> Result<Protected, PlanError> {
    volume::check(problems, options)?;
    let setups: Vec<Setup> = problems.iter().map(Setup::new).collect::<Result<_, _>>()?;
    let Some(first) = setups.first() else { return Ok(Protected { slots: Vec::new(), superframe_s: 0.0 }) };
    let turning = Turning::new(ways, service, first);
    let service = on_air(service);
    let job = Job::new(&setups, &service, &turning, options);
    let on_air_s: Vec<f64> = standing.slots_s.iter().map(|slot_s| slot_s - turning.guard_s).collect();
    let order = standing.order.map_or_else(|| job.order(standing.vehicles), <[usize]>::to_vec);
    let turns = job.turns(standing.vehicles, &on_air_s, &order, options)?;
    Ok(job.protected(&turns, &on_air_s, share, options))
}

/// A joint plan: the poses in which users are served, how long their slots are, and the turns between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// By user, as listed.
    pub slots: Vec<super::plan::SlotPlan>,
    /// The length of each one's slot in seconds, the guard included.
    pub slots_s: Vec<f64>,
    /// The turns.
    pub protected: Protected,
    /// Whether the poses are those of the static volume plan.
    pub is_static: bool,
}

/// Plans poses and turns together.
///
/// # Errors
/// As [`through`], without ways that cannot be flown: such poses are not chosen, unless there are no others.
pub fn plan(
    problems: &[Problem],
    service: &Service,
    ways: &impl Ways,
    options: &Options,
    share: Option<f64>,
) -> Result<Joint, PlanError> {
    volume::check(problems, options)?;
    let setups: Vec<Setup> = problems.iter().map(Setup::new).collect::<Result<_, _>>()?;
    let nothing = Protected { slots: Vec::new(), superframe_s: 0.0 };
    let empty = Joint { slots: Vec::new(), slots_s: Vec::new(), protected: nothing.clone(), is_static: true };
    let Some(first) = setups.first() else { return Ok(empty) };
    let turning = Turning::new(ways, service, first);
    let air = on_air(service);
    let job = Job::new(&setups, &air, &turning, options);
    let known = volume::plan(problems, service, ways, options)?;
    let chosen = volume::choices(problems, &air, &turning, options)?;
    let choices = std::iter::once((true, known.slots, None))
        .chain(chosen.into_iter().map(|choice| (false, choice.slots, Some(choice.order))));
    let mut best: Option<(f64, Joint, Turns)> = None;
    let mut refused = None;
    for (is_static, slots, order) in choices {
        let vehicles: Vec<_> = slots.iter().map(|slot| slot.vehicles).collect();
        let rates: Vec<f64> =
            slots.iter().zip(problems).map(|(slot, problem)| volume::nats(slot, problem)).collect();
        let mut on_air_s = volume::lengths_s(&air, &slots, &rates);
        let order = order.unwrap_or_else(|| job.order(&vehicles));
        let turns = match job.turns(&vehicles, &on_air_s, &order, options) {
            Ok(turns) => turns,
            Err(error) => {
                refused = Some(error);
                continue;
            }
        };
        if air.fairness == Fairness::MaxMin {
            // By what is left of each rate, turns counted.
            let left: Vec<f64> =
                turns.volumes(&on_air_s).iter().zip(&on_air_s).map(|(volume, s)| volume / s).collect();
            on_air_s = volume::lengths_s(&air, &slots, &left);
        }
        let worth = job.worth(&turns, &on_air_s);
        if best.as_ref().is_none_or(|(known, ..)| worth > *known) {
            let slots_s = on_air_s.iter().map(|s| s + turning.guard_s).collect();
            let protected = nothing.clone();
            best = Some((worth, Joint { slots, slots_s, protected, is_static }, turns));
        }
    }
    let Some((_, joint, turns)) = best else { return refused.map_or(Ok(empty), Err) };
    let on_air_s: Vec<f64> = joint.slots_s.iter().map(|s| s - turning.guard_s).collect();
    Ok(Joint { protected: job.protected(&turns, &on_air_s, share, options), ..joint })
}

/// A superframe's users and how they are served.
struct Job<'a, W> {
    case: Case<'a, Turning<'a, W>>,
}

/// The changes of the served user, by leg.
struct Turns {
    order: Vec<usize>,
    raws: Vec<Raw>,
    /// Each user's standing rate in nats per hertz.
    rates: Vec<f64>,
    legs: Vec<Leg>,
}

/// From one user to the next.
enum Leg {
    Turn(Changed),
    Transit { silence_s: f64 },
}

impl Leg {
    fn silence_s(&self) -> f64 {
        match self {
            Self::Turn(changed) => changed.silence_s,
            Self::Transit { silence_s } => *silence_s,
        }
    }

    fn steps(&self, side: usize) -> &[Step] {
        match self {
            Self::Turn(changed) => &changed.steps[side],
            Self::Transit { .. } => &[],
        }
    }
}

impl Turns {
    /// The legs before and after a user's slot.
    fn about(&self, place: usize) -> [&Leg; 2] {
        [&self.legs[(place + self.legs.len() - 1) % self.legs.len()], &self.legs[place]]
    }

    fn silences_s(&self) -> f64 {
        self.legs.iter().map(Leg::silence_s).sum()
    }

    /// What each user gets, nats per hertz, by user.
    fn volumes(&self, on_air_s: &[f64]) -> Vec<f64> {
        let mut volumes = vec![0.0; on_air_s.len()];
        for (place, &user) in self.order.iter().enumerate() {
            let [before, after] = self.about(place);
            let lost: f64 = before
                .steps(1)
                .iter()
                .chain(after.steps(0))
                .map(|step| step.lasts_s * (self.rates[user] - step.rate))
                .sum();
            volumes[user] = on_air_s[user] * self.rates[user] - lost;
        }
        volumes
    }
}

impl<'a, W: Ways> Job<'a, W> {
    fn new(
        setups: &'a [Setup<'a>],
        service: &'a Service,
        turning: &'a Turning<'a, W>,
        options: &Options,
    ) -> Self {
        let samples = parallel::map(options.threads, setups.len(), |(): &mut (), user| {
            volume::samples(&setups[user], options)
        });
        let counts = vec![true; setups.len()];
        Self { case: Case { setups, samples, service, ways: turning, counts } }
    }

    /// The order of service of given poses.
    fn order(&self, vehicles: &[PerVehicle<VehiclePlan>]) -> Vec<usize> {
        let n = vehicles.len();
        if !self.case.service.may_reorder || n < 4 {
            return (0..n).collect();
        }
        let poses = |user: usize| vehicles[user].map(|vehicle| vehicle.pose);
        let time = |from: usize, to: usize| {
            self.case.ways.transit_s(&poses(from), &poses(to)).unwrap_or(f64::INFINITY)
        };
        let between_s: Vec<f64> =
            (0..n * n).map(|k| if k / n == k % n { 0.0 } else { time(k / n, k % n) }).collect();
        self.case.ways.shortest(n, &between_s)
    }

    /// What counts of rates over times on the air, and how it changes with them.
    fn shares(&self, rates: &[f64]) -> Shares {
        let counts: Vec<bool> = rates.iter().map(|rate| *rate > 0.0).collect();
        shares(self.case.service, rates, &counts)
    }

    /// The turns of a static plan.
    fn turns(
        &self,
        vehicles: &[PerVehicle<VehiclePlan>],
        on_air_s: &[f64],
        order: &[usize],
        options: &Options,
    ) -> Result<Turns, PlanError> {
        let raws: Vec<Raw> = vehicles.iter().map(Setup::raw).collect();
        let rates = parallel::map(options.threads, raws.len(), |memory: &mut Memory, user| {
            self.case.rate(user, FINE, &raws[user], memory, &mut [0.0; 14]).max(0.0)
        });
        let poses = |user: usize| vehicles[user].map(|vehicle| vehicle.pose);
        let ends: Vec<(usize, usize)> = if order.len() > 1 {
            legs(order).collect()
        } else {
            order.iter().map(|user| (*user, *user)).collect()
        };
        let mut silences_s = Vec::with_capacity(ends.len());
        for &(from, to) in &ends {
            let silence_s = self.case.ways.transit_s(&poses(from), &poses(to));
            silences_s.push(silence_s.ok_or(PlanError::NoTransit { from, to })?);
        }
        // What a second is worth, and a user's volume, where nobody turns while it serves.
        let shared = self.shares(&rates);
        let length_s = on_air_s.iter().chain(&silences_s).sum::<f64>();
        let value = shared.volume / length_s;
        let weight = |user: usize| {
            let slot_s = shared.slots_s[user].max(1e-9);
            ((shared.by_rate[user] - value * shared.length_by_rate[user]) / slot_s).max(0.0)
        };
        let legs = parallel::map(options.threads, ends.len(), |memory: &mut Memory, leg| {
            let (from, to) = ends[leg];
            if !at_one_place(&poses(from), &poses(to)) {
                return Leg::Transit { silence_s: silences_s[leg] };
            }
            let change = Change {
                case: &self.case,
                users: [from, to],
                raws: [raws[from], raws[to]],
                weights: [weight(from), weight(to)],
                price: value,
                guard_s: self.case.ways.guard_s,
                longest_s: [from, to].map(|user| MOST_OF_A_SLOT * on_air_s[user]),
            };
            Leg::Turn(change.best(memory))
        });
        Ok(Turns { order: order.to_vec(), raws, rates, legs })
    }

    /// What counts of all users' volumes, for each second of the superframe: nats per hertz and second.
    fn worth(&self, turns: &Turns, on_air_s: &[f64]) -> f64 {
        let volumes = turns.volumes(on_air_s);
        let length_s = on_air_s.iter().sum::<f64>() + turns.silences_s();
        let counted = match self.case.service.fairness {
            Fairness::Slots => volumes.iter().sum::<f64>(),
            Fairness::MaxMin => {
                let served = volumes.iter().zip(&turns.rates).filter(|(_, rate)| **rate > 0.0);
                served.map(|(volume, _)| *volume).reduce(f64::min).unwrap_or(0.0)
            }
        };
        counted / length_s
    }

    /// A standing pair with J's power, and I's where it is served.
    fn vehicles(&self, raw: &Raw, angles: &[Angles; 2], power_w: f64) -> PerVehicle<VehiclePlan> {
        let mut at = *raw;
        for v in 0..2 {
            at[v * VEHICLE + ANGLES..v * VEHICLE + POWER].copy_from_slice(&angles[v]);
        }
        at[VEHICLE + POWER] = power_w;
        PerVehicle::from_fn(|role| {
            let part = &at[if role == Role::I { 0 } else { VEHICLE }..][..VEHICLE];
            VehiclePlan {
                pose: crate::geo::Pose {
                    position_enu_m: nalgebra::Vector3::new(part[0], part[1], part[2]),
                    roll_rad: part[ANGLES],
                    pitch_rad: part[ANGLES + 1],
                    yaw_rad: part[ANGLES + 2],
                },
                tx_power_w: part[POWER],
            }
        })
    }

    /// All knots in their order.
    fn protected(&self, turns: &Turns, on_air_s: &[f64], share: Option<f64>, options: &Options) -> Protected {
        let bits = |user: usize| self.case.setups[user].problem.radio.bandwidth_hz / std::f64::consts::LN_2;
        let volumes = turns.volumes(on_air_s);
        let mut begins_s = 0.0;
        let mut slots = Vec::with_capacity(turns.order.len());
        for (place, &user) in turns.order.iter().enumerate() {
            let [before, after] = turns.about(place);
            let raw = &turns.raws[user];
            let knot = |at_s: f64, step: &Step, served: bool| {
                let mut vehicles = self.vehicles(raw, &step.angles, step.power_w);
                // Nobody radiates for a user whom no poses serve.
                let served = served && raw[POWER] > 0.0;
                if !served {
                    vehicles.i.tx_power_w = 0.0;
                    vehicles.j.tx_power_w = 0.0;
                }
                let served = served.then_some(user);
                Knot { at_s, vehicles, served, rate_bps: step.rate * bits(user), tolerance: None }
            };
            let standing = [0, VEHICLE].map(|at: usize| [raw[at + 3], raw[at + 4], raw[at + 5]]);
            let lasts = |steps: &[Step]| steps.iter().map(|step| step.lasts_s).sum::<f64>();
            let (arrives_s, leaves_s) = (lasts(before.steps(1)), on_air_s[user] - lasts(after.steps(0)));
            let still = Step {
                angles: standing,
                lasts_s: leaves_s - arrives_s,
                power_w: raw[VEHICLE + POWER],
                rate: turns.rates[user],
            };
            let mut knots = Vec::with_capacity(2 * STEPS + 2);
            let mut at_s = begins_s;
            for step in before.steps(1).iter().chain(std::iter::once(&still)).chain(after.steps(0)) {
                knots.push(knot(at_s, step, true));
                at_s += step.lasts_s;
            }
            let (end, between) = match after {
                Leg::Turn(changed) => {
                    let [i, j] = changed.courses;
                    (changed.silent[0], Between::Turn(PerVehicle { i, j }))
                }
                Leg::Transit { .. } => (standing, Between::Transit),
            };
            let end = Step { angles: end, lasts_s: 0.0, power_w: 0.0, rate: 0.0 };
            knots.push(knot(begins_s + on_air_s[user], &end, false));
            let silence_s = after.silence_s();
            let volume_bits = volumes[user] * bits(user);
            slots.push(Slot { user, on_air_s: on_air_s[user], silence_s, between, volume_bits, knots });
            begins_s += on_air_s[user] + silence_s;
        }
        if let Some(share) = share {
            self.add_tolerances(&mut slots, share, options);
        }
        Protected { slots, superframe_s: begins_s }
    }

    fn add_tolerances(&self, slots: &mut [Slot], share: f64, options: &Options) {
        let wanted: Vec<(usize, usize)> = slots
            .iter()
            .enumerate()
            .flat_map(|(slot, of)| (0..of.knots.len()).map(move |knot| (slot, knot)))
            .collect();
        let found = parallel::map(options.threads, wanted.len(), |memory: &mut Memory, index| {
            let (slot, knot) = wanted[index];
            let knot = &slots[slot].knots[knot];
            let user = knot.served?;
            let setup = &self.case.setups[user];
            let target = self.case.target(user, MEDIUM, true);
            tolerance::of(setup, &Setup::raw(&knot.vehicles), share, &Sizes::ALL, |raw| {
                memory.value_alone(setup, target, raw)
            })
        });
        for ((slot, knot), tolerance) in wanted.into_iter().zip(found) {
            slots[slot].knots[knot].tolerance = tolerance;
        }
    }
}
