//! Whole flights in virtual time: two executives, the simulated world, the bytes between them.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod agreement;
mod apart;
mod asked;
mod devices;
mod emission;
mod endurance;
mod face;
mod faults;
mod fence;
mod following;
mod forged;
mod guard;
mod harness;
mod hosts;
mod kinds;
mod manners;
mod metadata;
mod moments;
mod moving;
mod mutations;
mod nominal;
mod orders;
mod orders_table;
mod preflight;
mod radio_table;
mod reaction;
mod reaction_table;
mod renewal;
mod setpoints;
mod sightings;
mod signed;
mod start;
mod tunnel;
mod turning;
mod turns;
mod words;
