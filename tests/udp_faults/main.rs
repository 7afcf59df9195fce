//! Faults over real sockets are safe (S1 to S5, F1).
//!
//! `cargo test --test udp_faults -- --nocapture` flies two points of a slot for each fault and prints a table;
//! `cargo run --release --example udp_faults` flies ten. World and companions are in step, so that nothing depends on what
//! else the machine has to do; `UDP_FAULTS_SPEED=4` in the environment flies by the wall's clock, four times as fast.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod flights;

use std::path::Path;

#[test]
fn spec_faults_over_real_udp_in_transit_and_on_the_air_are_safe() {
    let speed = std::env::var("UDP_FAULTS_SPEED").ok().map(|speed| speed.parse::<f64>().unwrap());
    let setup = flights::Setup {
        program: env!("CARGO_BIN_EXE_veilwing").into(),
        directory: Path::new(env!("CARGO_TARGET_TMPDIR")).join("udp-faults"),
        speed,
    };
    flights::faults_at(&setup, &[1, 6]);
}
