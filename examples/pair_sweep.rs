//! Sweeps the pair protocol over loss, delay, duplication and faults in virtual time, and prints one line a cell.
//!
//! `cargo run --release --example pair_sweep` runs the whole grid, 500 slots a cell; with `--fault RadioHop` that
//! fault's 40 cells. With `--loss 0.3 --delay-ms 100
//! --duplication 0.2 --fault Restart --slots 500 --seed 1042` it runs one cell: what a failing line prints.

#[path = "../tests/pair/clocks.rs"]
mod clocks;
#[path = "../tests/pair/companion.rs"]
mod companion;
#[path = "../tests/pair/observer.rs"]
mod observer;
#[path = "../tests/pair/radio.rs"]
mod radio;
#[path = "../tests/pair/setup.rs"]
mod setup;
#[path = "../tests/pair/sweep.rs"]
mod sweep;
#[path = "../tests/pair/world.rs"]
mod world;

use std::time::Duration;

use clap::Parser;

fn main() -> std::process::ExitCode {
    let args = sweep::Args::parse();
    println!("{}", sweep::HEADER);
    let (mut slots, mut served, mut violations, mut unserved) = (0, 0, 0, 0);
    let (mut exposed, mut dead, mut out) = (Duration::ZERO, Duration::ZERO, Duration::ZERO);
    for case in args.cases() {
        let row = sweep::Row { case, seen: world::run(case) };
        println!("{}", sweep::print(&row));
        for violation in &row.seen.violations {
            println!("  {violation}");
        }
        let missing = if row.must_serve() { row.seen.slots - row.seen.served } else { 0 };
        if missing > 0 || !row.seen.violations.is_empty() {
            println!("  replay: {}", row.replay());
        }
        slots += row.seen.slots;
        served += row.seen.served;
        violations += row.seen.violations.len();
        unserved += missing;
        exposed = exposed.max(row.seen.exposed);
        dead = dead.max(row.seen.dead);
        out = out.max(row.seen.out_of_pose);
    }
    println!(
        "{slots} slots, {served} served; {violations} violations; {unserved} slots not served that had to be"
    );
    println!(
        "longest: I without J after a fault of J's {exposed:?}; on after its companion's death {dead:?}; on out of pose {out:?}"
    );
    u8::from(violations + unserved > 0).into()
}
