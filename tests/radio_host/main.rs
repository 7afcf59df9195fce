//! The radio host over real sockets and processes: devices of ours that behave as their makers' documents say, and such that
//! do not; a companion that commands it; and somebody who forges, replays and does not sign.

#![cfg(feature = "companion")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod backends;
mod bench;
mod files;
mod garbage;
mod gpio;
mod host;
mod line;
mod misbehaviour;
mod parameter;
mod server;
mod trust;
