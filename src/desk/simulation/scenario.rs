//! Whole flights of one mission in virtual time, each with its seed and its faults.

use std::sync::Arc;
use std::time::Duration;

use veilwing_sitl::{self as sim, World};

use crate::autopilot::Actuation;
use crate::config::{Mission, Vehicle};
use crate::link::counters::Counters;
use crate::mission::Outcome;
use crate::planner::PlanError;
use crate::planner::slots::Plan;
use crate::role::{PerVehicle, Role};

use super::excuse::{Excused, judge};
use super::fault::{Change, Fault, FaultKind, Lengths, RadioFault};
use super::flight::{Flight, FlightError, Setup};
use super::hindsight::{Agreements, Hindsight, Seer};
use super::imperfections::Imperfections;
use super::observer::Observer;
use super::path::Path;
use super::process::Given;
use super::supervisor::{Host, Supervisor};
use super::tracks::Tracks;
use super::world::world_over;
use super::{index, vehicle_draft};

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
    /// What could have been flown cannot be planned.
    #[error(transparent)]
    Hindsight(#[from] PlanError),
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
    /// Where users or eavesdroppers move, and nothing goes wrong: each slot with hindsight, and what became of the motions that were made anew.
    pub followed: Option<(Vec<Hindsight>, Agreements)>,
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

impl<A: Witness, B: Witness> Witness for (&mut A, &mut B) {
    fn fault(&mut self, at: Duration, change: &Change) {
        self.0.fault(at, change);
        self.1.fault(at, change);
    }
}

impl Scenario {
    /// Makes the world of a mission and its plan, and flies it once, without faults, to know its length. `actuation`: how
    /// both vehicles are commanded, if not as their airframes ask for.
    ///
    /// # Errors
    /// A plan that cannot be flown.
    pub fn new(mission: &Mission, plan: &Plan, actuation: Option<Actuation>) -> Result<Self, ScenarioError> {
        Self::over(&Imperfections::of(mission), mission, plan, actuation)
    }

    /// The same world, in which those that move go along these tracks.
    #[must_use]
    pub fn along(mut self, tracks: &Tracks) -> Self {
        tracks.lay(&mut self.world);
        self
    }

    /// The same world, in which those that go as they like go so fast, in m/s, whatever the mission says of it.
    #[must_use]
    pub fn at_speed(mut self, speed_m_s: f64) -> Self {
        let nodes = self.world.users.iter_mut().chain(&mut self.world.eavesdroppers);
        nodes.filter_map(|node| node.roams.as_mut()).for_each(|roams| roams.speed_m_s = speed_m_s);
        self
    }

    /// The same over a link with other imperfections than the mission states: a plan in a world that it does not know.
    ///
    /// # Errors
    /// A plan that cannot be flown.
    pub fn over(
        link: &Imperfections,
        mission: &Mission,
        plan: &Plan,
        actuation: Option<Actuation>,
    ) -> Result<Self, ScenarioError> {
        let mut given = Vec::new();
        for role in Role::BOTH {
            let mut draft = vehicle_draft(mission, role, [1, 2]);
            draft.autopilot.actuation = actuation.unwrap_or(draft.autopilot.actuation);
            let vehicle = Vehicle::new(draft).map_err(|e| ScenarioError::World(e.to_string()))?;
            given.push(Arc::new(Given { mission: mission.clone(), plan: plan.clone(), vehicle }));
        }
        let world = world_over(link, mission, plan).map_err(ScenarioError::World)?;
        let given = PerVehicle::from_fn(|role| Arc::clone(&given[index(role)]));
        // Of slots of different lengths a fault may fall into any part of the longest.
        let timing = mission.timing();
        let slot = plan.lengths(timing.slot).into_iter().max().unwrap_or(timing.slot);
        let slot_s = slot.saturating_sub(timing.guard).as_secs_f64();
        let lengths = Lengths { flight_s: LONGEST.as_secs_f64(), slot_s };
        let mut scenario = Self { given, world, lengths };
        let mut nominal = scenario.run(mission.seed, Vec::new())?;
        nominal.fly(&mut ())?;
        scenario.lengths.flight_s = nominal.flight.world.report().flight_s;
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
        let faulty = !faults.is_empty();
        let mut run = self.run(seed, faults)?;
        let given = &self.given.i;
        if given.mission.movers.is_empty() || faulty {
            run.fly(witness)?;
            return Ok(run.finish());
        }
        let mut seer = Seer::default();
        run.fly(&mut (witness, &mut seer))?;
        let mut flown = run.finish();
        let hindsight = seer.hindsight(&given.mission, &given.plan, &flown.world)?;
        flown.followed = Some((hindsight, seer.agreements()));
        Ok(flown)
    }

    fn run(&self, seed: u64, faults: Vec<Fault>) -> Result<Run, ScenarioError> {
        let world = World::new(sim::WorldConfig { seed, ..self.world.clone() })?;
        let given = PerVehicle::from_fn(|role| Arc::clone(&self.given[role]));
        let setup = Setup { given, start_unasked: true, autopilot: Path::GOOD, pair: Path::GOOD, seed };
        let supervisor = Supervisor::new(faults, self.longest());
        Ok(Run { flight: Flight::new(world, setup), supervisor })
    }
}

/// A flight under way.
struct Run {
    flight: Flight,
    supervisor: Supervisor,
}

impl Run {
    fn fly(&mut self, witness: &mut impl Witness) -> Result<(), FlightError> {
        loop {
            while let Some(change) = self.supervisor.due(&self.flight.world) {
                witness.fault(self.flight.now(), &change);
                self.supervisor.apply(change, &mut self.flight);
            }
            if Role::BOTH.into_iter().all(|role| self.supervisor.has_ended(role, &self.flight)) {
                break;
            }
            self.supervisor.watch(&mut self.flight);
            let limit = self.supervisor.next().unwrap_or(Duration::MAX);
            self.flight.step(limit, witness)?;
        }
        let end = self.flight.now() + SETTLE;
        while self.flight.now() < end {
            self.flight.step(end, witness)?;
        }
        Ok(())
    }

    fn finish(self) -> Flown {
        let mut report = self.flight.world.report();
        let excused = judge(&mut report, &[]);
        let (sent, received, lost) = self.flight.datagrams();
        Flown {
            report,
            excused,
            outcomes: PerVehicle::from_fn(|role| self.flight.outcomes[role].clone()),
            faults: self.supervisor.happened().to_vec(),
            sent,
            received,
            lost,
            unlogged: PerVehicle::from_fn(|role| self.flight.unlogged(role)),
            counters: PerVehicle::from_fn(|role| self.flight.counters(role).clone()),
            followed: None,
            world: self.flight.world,
        }
    }
}

impl Host for Flight {
    /// A cut is the world's.
    const LINK: &'static [FaultKind] = &[FaultKind::LinkDegraded, FaultKind::LinkFrozen];

    fn world(&mut self) -> &mut World {
        &mut self.world
    }

    fn lives(&self, role: Role) -> bool {
        Self::lives(self, role)
    }

    fn kill(&mut self, role: Role) {
        Self::kill(self, role);
    }

    fn start(&mut self, role: Role) -> bool {
        Self::start(self, role);
        true
    }

    fn freeze(&mut self, role: Role, frozen: bool) {
        Self::freeze(self, role, frozen);
    }

    fn stop(&mut self, role: Role) {
        Self::stop(self, role);
    }

    fn stop_within(&self) -> Duration {
        STOP_WITHIN
    }

    fn fill_disk(&mut self, role: Role, full: bool) {
        Self::fill_disk(self, role, full);
    }

    fn stall_disk(&mut self, role: Role, stalled: bool) {
        Self::stall_disk(self, role, stalled);
    }

    fn set_pair_path(&mut self, from: Role, path: Option<Path>) {
        Self::set_pair_path(self, from, path.unwrap_or(Path::GOOD));
    }

    fn set_autopilot_path(&mut self, role: Role, path: Option<Path>) {
        Self::set_autopilot_path(self, role, path.unwrap_or(Path::GOOD));
    }

    fn befall_radio(&mut self, fault: RadioFault, role: Role, on: bool) {
        Self::befall_radio(self, fault, role, on);
    }
}
