//! Radio hosts and their devices in whole flights, as processes over loopback, and what becomes of them when something dies:
//! `cargo run --release --example radio_faults -- [--instants N] [--at-once N] [--only WORD]`.
//!
//! First a table by backend: each kind of device with its times, a flight as it should go, and what the preflight said. Then
//! faults: companion, host and device are killed (SIGKILL), stopped (SIGSTOP), or cut off, of either vehicle, at N instants of a
//! slot (20 without `--instants`), and the host once more beside a device with a dead-man's switch. Flights live by the wall's
//! clock, each about half a minute; `--at-once` of them fly together (4 without it), and how late the world was
//! at worst, because the machine had more to do, is in the last column. `--only` flies the rows that have this word in their name.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

#[path = "radio_faults/flights.rs"]
mod flights;

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    // This program is the command too, so that all are built together: `sitl`, and what it starts.
    if arguments.first().is_some_and(|first| !["--instants", "--at-once", "--only"].contains(&first.as_str()))
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
    let only = given("--only").unwrap_or_default();
    flights::by_backend(&setup, &only);
    flights::by_fault(&setup, number("--instants", 20).max(1), &only);
    // What is not wanted any more: each flight's logs.
    let _ = std::fs::remove_dir_all(&setup.directory);
    ExitCode::SUCCESS
}
