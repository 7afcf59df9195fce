//! Faults over real sockets as a table: `cargo run --release --example udp_faults -- [SPEED]`. Kills, stops and cuts off
//! either companion at ten points of a slot, sixty flights, which take minutes; ends with a panic that tells the story of
//! the flight if an invariant (S1 to S5, F1) is broken. SPEED: simulated seconds per second, by the wall's clock (4 asks
//! enough of most machines); without it the world and the companions are in step, as fast as the machine can.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

#[path = "../tests/udp_faults/flights.rs"]
mod flights;

use std::process::ExitCode;

fn main() -> ExitCode {
    let argument = std::env::args().nth(1);
    let speed = argument.as_ref().map(|text| text.parse::<f64>());
    // This program is the command too, so that both are built together: `sitl`, and `fly` as `sitl` starts it.
    let Ok(speed) = speed.transpose() else { return veilwing::cli::main() };
    let setup = flights::Setup {
        program: std::env::current_exe().expect("this program's path"),
        directory: std::env::temp_dir().join("veilwing-udp-faults"),
        speed,
    };
    flights::faults_at(&setup, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    ExitCode::SUCCESS
}
