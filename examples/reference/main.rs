//! Plans the reference scenarios and prints the figures beside the known ones.
//!
//! ```text
//! cargo run --release --no-default-features --example reference -- TABLE [--every K] [--threads N] [--starts N]
//! ```
//!
//! TABLE is `no-jitter`, `methods`, `methods-jitter`, `paper`, `jitter`, `variants`, `robust`, `times`, `link`, `fresh` or
//! `plans` (CSV). `--every K` takes every K-th scenario, `paper --first K` the first K only (MODEL's figures for N = 5 are of the first 20), and
//! `fresh --kind TEXT` the kinds with TEXT in their name.
//! Rates are in bit/s/Hz (the scenarios' bandwidth is 1 MHz).

mod data;
mod fresh;
mod link;
mod methods;
mod tables;

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str, default: usize| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1)).and_then(|v| v.parse().ok()).unwrap_or(default)
    };
    let run = tables::Run {
        every: number("--every", 1).max(1),
        first: number("--first", usize::MAX),
        threads: number("--threads", 1),
        starts: number("--starts", 0),
        seed: number("--seed", 0) as u64,
        kind: arguments.iter().position(|a| a == "--kind").and_then(|at| arguments.get(at + 1)).cloned(),
    };
    let table = match arguments.first().map(String::as_str) {
        Some("no-jitter") => tables::no_jitter,
        Some("methods") => methods::steady,
        Some("methods-jitter") => methods::jitter,
        Some("paper") => methods::against_paper,
        Some("jitter") => tables::jitter,
        Some("variants") => tables::variants,
        Some("robust") => tables::robust,
        Some("times") => tables::times,
        Some("link") => link::table,
        Some("fresh") => fresh::table,
        Some("plans") => tables::plans,
        _ => {
            eprintln!(
                "usage: reference no-jitter|methods|methods-jitter|paper|jitter|variants|robust|times|link|fresh|plans [--every K] [--first K] [--threads N] [--starts N] [--seed N] [--kind TEXT]"
            );
            return ExitCode::from(2);
        }
    };
    match table(&run) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
