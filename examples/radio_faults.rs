//! Radio hosts and their devices in whole flights, and what becomes of them when something dies:
//! `cargo run --release --example radio_faults -- [--table NAME] [--instants N] [--at-once N] [--only WORD]`.
//!
//! Three tables, or the one that `--table` names:
//! - `backends`: each kind of device with its times, a flight of processes over loopback as it should go, and what the preflight
//!   said.
//! - `virtual`: for each kind of device, companion, host and device are killed (SIGKILL), stopped (SIGSTOP), or cut off, of either
//!   vehicle, at N instants of its time on the air (20 without `--instants`), in virtual time: the same each time. Ends with 1
//!   where something is broken that no preflight refuses.
//! - `processes`: the same with an attenuator's processes over loopback, and the host once more beside a device with a dead-man's
//!   switch.
//!
//! Flights of processes live by the wall's clock, each about half a minute; `--at-once` of them fly together (4 without it), and
//! how late the world was at worst, because the machine had more to do, is in the last column. `--only` flies the rows of the
//! first and the last table that have this word in their name.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

#[path = "radio_faults/flights.rs"]
mod flights;
#[path = "../tests/flight/radio_table.rs"]
mod radio_table;

use std::process::ExitCode;

use veilwing::config::Mission;
use veilwing::desk::simulation::{Given, vehicle};
use veilwing::planning;
use veilwing::role::Role;

use radio_table::{BACKENDS, Base, What, table};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    // This program is the command too, so that all are built together: `sitl`, and what it starts.
    if arguments
        .first()
        .is_some_and(|first| !["--table", "--instants", "--at-once", "--only"].contains(&first.as_str()))
    {
        return veilwing::cli::main();
    }
    let given = |name: &str| {
        let at = arguments.iter().position(|argument| argument == name)?;
        Some(arguments.get(at + 1).unwrap_or_else(|| panic!("{name} wants a value")).clone())
    };
    let number = |name: &str, otherwise: usize| {
        given(name)
            .map_or(otherwise, |text| text.parse().unwrap_or_else(|error| panic!("{name} {text}: {error}")))
    };
    let setup = flights::Setup {
        program: std::env::current_exe().expect("this program's path"),
        directory: std::env::temp_dir().join(format!("veilwing-radio-faults-{}", std::process::id())),
        at_once: number("--at-once", 4).max(1),
    };
    let (only, which) = (given("--only").unwrap_or_default(), given("--table"));
    let wanted = |name: &str| which.as_ref().is_none_or(|which| which == name);
    let (instants, at_once) = (number("--instants", 20).max(1), setup.at_once);
    let mut broken = false;
    if wanted("backends") {
        flights::by_backend(&setup, &only);
    }
    if wanted("virtual") {
        let mission = Mission::parse("yard.toml", include_str!("../tests/flight/yard.toml"));
        let mission = mission.unwrap_or_else(|errors| panic!("{errors}"));
        let plan = planning::plan(&mission).expect("a plan");
        let vehicle = vehicle(&mission, Role::I).expect("the simulated vehicle's file");
        let table =
            table(&Base::new(&Given { mission, plan, vehicle }), BACKENDS, &What::ALL, instants, at_once);
        println!("{table}");
        let open = table.open();
        println!("{} of {} rows neither hold nor are refused", open.len(), table.rows.len());
        broken = table.rows.iter().any(|row| !row.violations().is_empty());
    }
    if wanted("processes") {
        flights::by_fault(&setup, instants, &only);
    }
    // What is not wanted any more: each flight's logs.
    let _ = std::fs::remove_dir_all(&setup.directory);
    if broken { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
