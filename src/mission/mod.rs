//! The executive of one vehicle: the mission's phases, the interlock (S1-S6) and the failsafe (F1-F3). No I/O.

pub mod course;
pub mod executive;
mod face;
mod flight;
mod homing;
pub mod interlock;
mod operator;
pub mod pose_monitor;
mod preflight;
mod reaction;
mod slot;
mod staleness;
mod standing;
mod start;
mod turns;
mod waiting;

pub use executive::{Executive, Notice, Outcome, Outgoing, Settings};
pub use face::Scene;
