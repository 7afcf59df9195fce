//! The executive of one vehicle: the mission's phases, the reactions to what goes wrong (F1 to F3), the operator. No I/O.

mod arming;
mod asked;
pub mod cause;
mod endurance;
pub mod executive;
mod flight;
mod ground;
mod ground_station;
mod homing;
mod itinerary;
mod lag;
mod lean;
pub mod notice;
mod operator;
mod permission;
mod phase;
mod reaction;
pub mod refusal;
mod reserve;
mod scene;
mod settings;
mod start;
mod stranger;
mod turns;
mod vehicle;
mod waiting;
mod words;

pub use cause::Cause;
pub use endurance::Battery;
pub use executive::{Executive, Outcome, Outgoing};
pub use ground_station::{Figure, Vector, silence_words};
pub use notice::Notice;
pub use permission::Permission;
pub use phase::NAMES as PHASES;
pub use scene::Scene;
pub use settings::{Operators, Settings};
