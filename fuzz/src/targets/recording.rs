//! What the companions of a small flight in the simulated world have heard, from power-up to landing.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use veilwing::config::{Mission, Vehicle};
use veilwing::desk::simulation::{self, Flight, Given, Observer, Path, Setup, Wire, vehicle, world_config};
use veilwing::link::RawFrame;
use veilwing::planner::slots::Plan;
use veilwing::planning;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::World;

/// The mission of the flight.
pub const MISSION: &str = include_str!("../../../tests/flight/yard.toml");
/// No such flight takes longer.
const LONGEST: Duration = Duration::from_secs(200);
/// The component that companions speak as.
const COMPANION: u8 = 191;

/// A frame that reached a companion.
#[derive(Debug, Clone)]
pub struct Heard {
    /// Simulation time.
    pub at: Duration,
    /// On which of its links.
    pub wire: Wire,
    /// The frame.
    pub bytes: Vec<u8>,
}

/// A flight and all that was heard in it.
#[derive(Debug)]
pub struct Recording {
    /// Its mission.
    pub mission: Mission,
    /// Its plan.
    pub plan: Plan,
    /// The vehicle files.
    pub vehicles: PerVehicle<Vehicle>,
    /// What each companion heard.
    pub heard: PerVehicle<Vec<Heard>>,
}

#[derive(Default)]
struct Recorder(PerVehicle<Vec<Heard>>);

impl Observer for Recorder {
    fn frame(&mut self, at: Duration, role: Role, wire: Wire, bytes: &[u8]) {
        let Some(header) = RawFrame::from_bytes(bytes).map(|frame| frame.header()) else { return };
        let own = header.component_id == COMPANION && header.system_id == 1 + simulation::index(role) as u32;
        if !own {
            self.0[role].push(Heard { at, wire, bytes: bytes.to_vec() });
        }
    }
}

fn fly() -> Option<Recording> {
    let mission = Mission::parse("yard.toml", MISSION).ok()?;
    let plan = planning::plan(&mission).ok()?;
    let vehicles = PerVehicle { i: vehicle(&mission, Role::I).ok()?, j: vehicle(&mission, Role::J).ok()? };
    let given = PerVehicle::from_fn(|role| {
        let vehicle = vehicles[role].clone();
        Arc::new(Given { mission: mission.clone(), plan: plan.clone(), vehicle })
    });
    let world = World::new(world_config(&mission, &plan).ok()?).ok()?;
    let setup = Setup { given, start_unasked: true, autopilot: Path::GOOD, pair: Path::GOOD, seed: 1 };
    let mut flight = Flight::new(world, setup);
    let mut recorder = Recorder::default();
    while Role::BOTH.iter().any(|role| flight.outcomes[*role].is_none()) && flight.now() < LONGEST {
        flight.step(LONGEST, &mut recorder).ok()?;
    }
    Some(Recording { mission, plan, vehicles, heard: recorder.0 })
}

/// The flight, flown once a process.
///
/// # Panics
/// If it cannot be flown.
#[must_use]
#[allow(clippy::expect_used, reason = "without it there is nothing to fuzz")]
pub fn recording() -> &'static Recording {
    static FLOWN: OnceLock<Recording> = OnceLock::new();
    FLOWN.get_or_init(|| fly().expect("the small mission cannot be flown"))
}
