//! Operator's orders taken two at a time (tests/flight/orders_table.rs), each case a flight in virtual time: a table of what
//! each two did, and every case in which something happened that must never.
//!
//! `cargo run --release --example orders`; with `--every N` only each Nth case.

// The harness is shared with tests.
#![allow(dead_code, clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../tests/flight/harness.rs"]
mod harness;
#[path = "../tests/flight/orders_table.rs"]
mod orders_table;

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use clap::Parser;

use orders_table::{Case, Seen, cases, run};
use veilwing::desk::Order;

#[derive(Debug, Parser)]
struct Args {
    /// Fly only each Nth case.
    #[arg(long, default_value_t = 1)]
    every: usize,
    /// Threads.
    #[arg(long, default_value_t = 2)]
    threads: usize,
}

#[derive(Debug, Default)]
struct Row {
    cases: usize,
    accepted: [usize; 2],
    took_off: usize,
    completed: usize,
    in_the_air: usize,
    alone: Duration,
    wrong: usize,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let cases: Vec<Case> = cases().into_iter().step_by(args.every.max(1)).collect();
    let (next, seen) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..args.threads.max(1) {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let came = run(case);
                    seen.lock().unwrap().push((*case, came));
                }
            });
        }
    });
    let mut rows: BTreeMap<(bool, Order, Order), Row> = BTreeMap::new();
    let mut wrong = Vec::new();
    for (case, came) in seen.into_inner().unwrap() {
        count(rows.entry((case.in_slot, case.first.0, case.second.0)).or_default(), &came);
        if !came.wrong.is_empty() {
            wrong.push((case, came.wrong));
        }
    }
    println!(
        "place   first     second    cases  accepted 1st, 2nd  took off  completed  in the air  alone s  wrong"
    );
    for ((in_slot, first, second), row) in &rows {
        println!(
            "{:<7} {:<9} {:<9} {:>5} {:>9} {:>8} {:>9} {:>10} {:>11} {:>8.1} {:>6}",
            if *in_slot { "slot" } else { "ground" },
            format!("{first:?}"),
            format!("{second:?}"),
            row.cases,
            row.accepted[0],
            row.accepted[1],
            row.took_off,
            row.completed,
            row.in_the_air,
            row.alone.as_secs_f64(),
            row.wrong
        );
    }
    for (case, what) in &wrong {
        println!("{case}");
        what.iter().for_each(|what| println!("    {what}"));
    }
    println!(
        "{} cases, {} with what must never be",
        rows.values().map(|row| row.cases).sum::<usize>(),
        wrong.len()
    );
    if wrong.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn count(row: &mut Row, came: &Seen) {
    row.cases += 1;
    for (count, accepted) in row.accepted.iter_mut().zip(came.accepted) {
        *count += usize::from(accepted);
    }
    row.took_off += usize::from(came.took_off > 0);
    row.completed += came.completed;
    row.in_the_air += usize::from(came.in_the_air > 0);
    row.alone = row.alone.max(came.alone);
    row.wrong += usize::from(!came.wrong.is_empty());
}
