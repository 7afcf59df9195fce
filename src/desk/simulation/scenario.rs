//! Whole flights of one mission in virtual time, each with its seed and its faults.

use std::sync::Arc;
use std::time::Duration;

use veilwing_sitl::{self as sim, World};

use crate::config::Mission;
use crate::link::counters::Counters;
use crate::mission::Outcome;
use crate::planner::slots::Plan;
use crate::role::{PerVehicle, Role};

use super::excuse::{Excused, judge};
use super::fault::{Change, Fault, FaultKind, Lengths, Schedule};
use super::flight::{Flight, FlightError, Setup};
use super::observer::Observer;
use super::path::Path;
use super::process::Given;
use super::{index, vehicle, world_config};

/// A companion whose peer has ended may take this much longer before it is asked to stop ...
const LAST_ONE: Duration = Duration::from_secs(300);
/// ... and this much if its vehicle neither obeys it nor comes down: it has nothing left to do.
const LAST_ONE_IDLE: Duration = Duration::from_secs(15);
/// After being asked to stop, a companion has this long before it is killed.
const STOP_WITHIN: Duration = Duration::from_secs(5);
/// What is on the air when the last companion ends has this long to fall silent.
const SETTLE: Duration = Duration::from_secs(1);
/// A flight as planned takes no longer than this.
pub const LONGEST: Duration = Duration::from_secs(4 * 3600);
/// A flight with faults takes at most twice its planned time and this.
const SPARE: Duration = Duration::from_secs(300);

/// A mission, its plan, and the world in which they are flown.
#[derive(Debug, Clone)]
pub struct Scenario {
    given: PerVehicle<Arc<Given>>,
    world: sim::WorldConfig,
    lengths: Lengths,
}

/// Why a mission cannot be flown in simulation.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// In words.
    #[error("{0}")]
    World(String),
    /// The world's own complaint.
    #[error(transparent)]
    Config(#[from] sim::Error),
    /// The flight without faults cannot be flown.
    #[error(transparent)]
    Flight(#[from] FlightError),
}

/// What became of one flight.
#[derive(Debug, Clone)]
pub struct Flown {
    /// The world's account; its violations are those that nothing excuses.
    pub report: sim::FlightReport,
    /// Violations that are nobody's aboard.
    pub excused: Vec<Excused>,
    /// How each companion ended; `None`: killed.
    pub outcomes: PerVehicle<Option<Outcome>>,
    /// Faults that came about, with their times.
    pub faults: Vec<(Duration, Fault)>,
    /// Datagrams that companions have sent.
    pub sent: u64,
    /// Datagrams that vehicles have sent to companions.
    pub received: u64,
    /// Datagrams that paths or dead and frozen processes have lost.
    pub lost: u64,
    /// Records that the disks under the companions' logs did not take.
    pub unlogged: PerVehicle<u64>,
    /// What the companions' decoders have turned away.
    pub counters: PerVehicle<Counters>,
    /// As it was left.
    pub world: World,
}

impl Flown {
    /// Both companions flew every slot and landed.
    #[must_use]
    pub fn completed(&self) -> bool {
        Role::BOTH.into_iter().all(|role| self.outcomes[role] == Some(Outcome::Completed))
    }

    /// Achieved over planned secrecy rate, over the time in which I radiated; `None` if it never did.
    #[must_use]
    pub fn achieved_over_planned(&self) -> Option<f64> {
        let weighed = |rate: fn(&sim::SlotReport) -> f64| -> f64 {
            self.report.slots.iter().map(|slot| slot.radiated_s.i * rate(slot)).sum()
        };
        let planned = weighed(|slot| slot.planned_secrecy_rate_bps);
        (planned > 0.0).then(|| weighed(|slot| slot.achieved_secrecy_rate_bps) / planned)
    }
}

/// An observer that is told of faults as well.
pub trait Witness: Observer {
    /// A fault begins or ends.
    fn fault(&mut self, _at: Duration, _change: &Change) {}
}

impl Witness for () {}

impl Scenario {
    /// Makes the world of a mission and its plan, and flies it once, without faults, to know its length.
    ///
    /// # Errors
    /// A plan that cannot be flown.
    pub fn new(mission: &Mission, plan: &Plan) -> Result<Self, ScenarioError> {
        let mut given = Vec::new();
        for role in Role::BOTH {
            let vehicle = vehicle(mission, role).map_err(|e| ScenarioError::World(e.to_string()))?;
            given.push(Arc::new(Given { mission: mission.clone(), plan: plan.clone(), vehicle }));
        }
        let world = world_config(mission, plan).map_err(ScenarioError::World)?;
        let given = PerVehicle::from_fn(|role| Arc::clone(&given[index(role)]));
        let lengths =
            Lengths { flight_s: LONGEST.as_secs_f64(), slot_s: mission.tdma.slot_s - mission.tdma.guard_s };
        let mut scenario = Self { given, world, lengths };
        let nominal = scenario.fly(mission.seed, Vec::new(), &mut ())?;
        scenario.lengths.flight_s = nominal.report.flight_s;
        Ok(scenario)
    }

    /// What times of faults are drawn from.
    #[must_use]
    pub fn lengths(&self) -> Lengths {
        self.lengths
    }

    /// A flight with faults takes no longer: what leaves a vehicle or its companion hanging goes on for ever.
    #[must_use]
    pub fn longest(&self) -> Duration {
        LONGEST.min(2 * Duration::from_secs_f64(self.lengths.flight_s) + SPARE)
    }

    /// UTC at the beginning of every flight, microseconds since 1970.
    #[must_use]
    pub fn utc_start_us(&self) -> u64 {
        self.world.utc_start_us
    }

    /// Flies once. The same seed and faults give the same flight, bit for bit.
    ///
    /// # Errors
    /// A world that cannot be made, a companion that cannot be run.
    pub fn fly(
        &self,
        seed: u64,
        faults: Vec<Fault>,
        witness: &mut impl Witness,
    ) -> Result<Flown, ScenarioError> {
        let world = World::new(sim::WorldConfig { seed, ..self.world.clone() })?;
        let given = PerVehicle::from_fn(|role| Arc::clone(&self.given[role]));
        let setup = Setup { given, start_unasked: true, autopilot: Path::GOOD, pair: Path::GOOD, seed };
        let mut run = Run {
            flight: Flight::new(world, setup),
            schedule: Schedule::new(faults),
            happened: Vec::new(),
            restarts: PerVehicle::default(),
            first_end: None,
            asked_to_stop: PerVehicle::default(),
            longest: self.longest(),
        };
        run.fly(witness)?;
        Ok(run.finish())
    }
}

/// A flight under way.
struct Run {
    flight: Flight,
    schedule: Schedule,
    happened: Vec<(Duration, Fault)>,
    /// Killed, to be started again.
    restarts: PerVehicle<bool>,
    first_end: Option<Duration>,
    asked_to_stop: PerVehicle<Option<Duration>>,
    longest: Duration,
}

impl Run {
    fn fly(&mut self, witness: &mut impl Witness) -> Result<(), FlightError> {
        loop {
            self.change(witness);
            if Role::BOTH.into_iter().all(|role| self.has_ended(role)) {
                break;
            }
            self.watch_companions();
            let limit = self.schedule.next().unwrap_or(Duration::MAX);
            self.flight.step(limit, witness)?;
        }
        let end = self.flight.now() + SETTLE;
        while self.flight.now() < end {
            self.flight.step(end, witness)?;
        }
        Ok(())
    }

    fn has_ended(&self, role: Role) -> bool {
        !self.flight.lives(role) && !self.restarts[role]
    }

    /// Lets faults begin and end.
    fn change(&mut self, witness: &mut impl Witness) {
        let now = self.flight.now();
        if !self.schedule.waits_for_no_slot() {
            self.schedule.watch(now, &self.flight.world.snapshot());
        }
        while let Some(change) = self.schedule.poll(now) {
            witness.fault(now, &change);
            match change {
                Change::Begins(fault) => {
                    self.apply(&fault, true);
                    self.happened.push((now, fault));
                }
                Change::Ends(fault) => self.apply(&fault, false),
            }
        }
    }

    fn apply(&mut self, fault: &Fault, on: bool) {
        for &role in &fault.roles {
            match fault.kind {
                FaultKind::CompanionKill if on => {
                    self.flight.kill(role);
                    self.restarts[role] = false;
                }
                FaultKind::CompanionRestart if on => {
                    self.restarts[role] |= self.flight.lives(role);
                    self.flight.kill(role);
                }
                FaultKind::CompanionRestart if self.restarts[role] => {
                    self.restarts[role] = false;
                    self.flight.start(role);
                }
                FaultKind::CompanionStop => {
                    let frozen = self.schedule.runs(FaultKind::CompanionStop, role);
                    self.flight.freeze(role, frozen);
                }
                FaultKind::PairLoss | FaultKind::PairDegraded => {
                    let path = self.schedule.path(&[FaultKind::PairLoss, FaultKind::PairDegraded], role);
                    self.flight.set_pair_path(role, path.unwrap_or(Path::GOOD));
                }
                FaultKind::LinkDegraded => {
                    let path = self.schedule.path(&[FaultKind::LinkDegraded], role);
                    self.flight.set_autopilot_path(role, path.unwrap_or(Path::GOOD));
                }
                FaultKind::LinkLoss | FaultKind::GpsLoss if !on && self.schedule.runs(fault.kind, role) => {}
                FaultKind::DiskFull => {
                    let full = self.schedule.runs(FaultKind::DiskFull, role);
                    self.flight.fill_disk(role, full);
                }
                _ => {
                    if let Some(fault) = fault.in_the_world(role, on) {
                        self.flight.world.inject(fault);
                    }
                }
            }
        }
    }

    /// Ends what would not end by itself, as the host of a simulated flight in real time does.
    fn watch_companions(&mut self) {
        let now = self.flight.now();
        if self.first_end.is_none() && Role::BOTH.into_iter().any(|role| self.has_ended(role)) {
            self.first_end = Some(now);
        }
        if self.first_end.is_none() && now <= self.longest {
            return;
        }
        let snapshot = self.flight.world.snapshot();
        for role in Role::BOTH {
            let vehicle = &snapshot.vehicles[index(role)];
            let coming_down = ["LAND", "RTL"].iter().any(|mode| vehicle.mode.contains(mode));
            let patience = if vehicle.companion_controlled || coming_down { LAST_ONE } else { LAST_ONE_IDLE };
            let too_late = self.first_end.is_some_and(|at| now > at + patience) || now > self.longest;
            match self.asked_to_stop[role] {
                None if too_late => {
                    self.asked_to_stop[role] = Some(now);
                    self.flight.freeze(role, false);
                    self.flight.stop(role);
                    self.restarts[role] = false;
                }
                Some(at) if now > at + STOP_WITHIN => self.flight.kill(role),
                _ => {}
            }
        }
    }

    fn finish(self) -> Flown {
        let mut report = self.flight.world.report();
        let (violations, excused) = judge(std::mem::take(&mut report.violations), &self.happened, &[]);
        report.violations = violations;
        let (sent, received, lost) = self.flight.datagrams();
        Flown {
            report,
            excused,
            outcomes: PerVehicle::from_fn(|role| self.flight.outcomes[role].clone()),
            faults: self.happened,
            sent,
            received,
            lost,
            unlogged: PerVehicle::from_fn(|role| self.flight.unlogged(role)),
            counters: PerVehicle::from_fn(|role| self.flight.counters(role).clone()),
            world: self.flight.world,
        }
    }
}
