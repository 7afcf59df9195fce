//! The pair in the simulated world, in virtual time: two companions' own code, the world, and the links between them,
//! with no socket, no sleep and no clock. Every message crosses as bytes.
//!
//! `world` tells the world of a mission and its plan, `imperfections` what the mission says of its link; `path` is a link that may lose, delay, repeat and reorder;
//! `process` is one companion as its operating system would run it; `flight` moves all of them from event to event;
//! `hosted` is a radio host and its device; `fault` draws what goes wrong; `supervisor` lets it befall the companions, and gives them up; `excuse` tells what does
//! not count; `scenario` flies a mission again and again, each time with a seed and its faults.

mod disk;
mod excuse;
pub mod fault;
mod flight;
mod hindsight;
mod hosted;
mod imperfections;
mod observer;
mod path;
mod process;
mod scenario;
mod station;
mod supervisor;
mod tracks;
mod turning;
mod vehicle;
mod world;

pub use excuse::{Cause, Excused, Late, judge};
pub use fault::{Change, Fault, FaultKind, Faults, Lengths, RadioFault, Schedule, draw};
pub use flight::{Flight, FlightError, Setup};
pub use hindsight::{Agreements, Hindsight, Seer};
pub use hosted::{Asked, DeviceModel, Hosted, Manners, OTHER_DB, OneShot, SimulatedDevice};
pub use imperfections::{Imperfections, Towards};
pub use observer::{Observer, Wire};
pub use path::Path;
pub(crate) use path::Pipe;
pub use process::Given;
pub use scenario::{Flown, LONGEST, Scenario, ScenarioError, Witness};
pub use station::STATION_LINK;
pub use supervisor::{Host, Supervisor};
pub use tracks::Tracks;
pub use turning::Proposals;
pub use vehicle::{on_this_machine, vehicle, vehicle_draft};
pub use world::{flown, world_config};

use std::time::Duration;

use crate::role::Role;

/// The vehicle's number in the simulated world.
#[must_use]
pub const fn index(role: Role) -> usize {
    match role {
        Role::I => 0,
        Role::J => 1,
    }
}

/// The first instant of a companion's own time; a process's time does not begin at zero, nor the two together.
#[must_use]
pub const fn reads_at_start(role: Role) -> Duration {
    match role {
        Role::I => Duration::from_secs(1),
        Role::J => Duration::from_secs(7),
    }
}
