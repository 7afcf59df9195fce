//! S4 as a table: `cargo run --release --example reaction -- [MISSION] [--faults N] [--threads N]`. Ends with 1 if a
//! reaction is beyond the bound.

#![allow(clippy::expect_used, clippy::panic, missing_docs)]

#[path = "../tests/flight/reaction_table.rs"]
mod reaction_table;

use std::process::ExitCode;

use veilwing::config::Mission;
use veilwing::desk::simulation::{Given, vehicle};
use veilwing::planning;
use veilwing::role::Role;

use reaction_table::{Base, table};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str, default: usize| {
        let at = arguments.iter().position(|argument| argument == name);
        let text = at.and_then(|at| arguments.get(at + 1));
        text.map_or(default, |text| text.parse().expect("a number"))
    };
    let mission = match arguments.first().filter(|argument| !argument.starts_with("--")) {
        Some(path) => Mission::load(path.as_ref()),
        None => Mission::parse("yard.toml", include_str!("../tests/flight/yard.toml")),
    };
    let mission = mission.unwrap_or_else(|errors| panic!("{errors}"));
    let plan = planning::plan(&mission).expect("a plan");
    let vehicle = vehicle(&mission, Role::I).expect("the simulated vehicle's file");
    let base = Base::new(&Given { mission, plan, vehicle });
    let table = table(&base, number("--faults", 1000), number("--threads", 2).max(1));
    println!("{table}");
    if table.beyond().is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
