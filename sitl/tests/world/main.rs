//! The simulated world, seen from outside: by MAVLink bytes, by its snapshot and by its report.

// Helpers of tests may fail the test; ground stations still speak the superseded frame names, ArduPilot MISSION_REQUEST.
#![allow(clippy::unwrap_used, clippy::expect_used, deprecated)]

mod autopilot;
mod cli;
mod common;
mod conduct;
mod excuses;
mod faults;
mod fence;
mod flight;
mod monitor;
mod mutations;
mod radio;
mod real_link;
mod record;
mod robustness;
mod signing;
mod thrust;
mod traps;
