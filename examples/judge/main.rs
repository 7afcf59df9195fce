//! An independent judge of the planner: fresh missions by seed, the plan against many starts of a plain local search,
//! both scored on draws that neither has seen.
//!
//! ```text
//! cargo run --release --no-default-features --example judge -- KIND [--missions N] [--first N] [--seed N] [--starts N]
//!     [--draws N] [--threads N]
//! ```
//!
//! KIND is `worst-case`, `quantile`, `wide-gaussians`, `ten` (ten eavesdroppers, nothing random), `free-yaw`, or of the link
//! as it is `floors`, `scattering`, `pointing` or `levels`; `--first N` begins with the mission of that number. The judge
//! shares no code with the planner: `world` states rate, noise, errors and positions again, `search` is a quasi-Newton
//! method on finite differences and a random walk after it, without any knowledge of what good configurations look like.
//! Loss: the judge's best less the plan's, bit/s/Hz; negative where the plan is the better one.

// A measuring program: it reads the clock, and what it cannot plan may stop it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::disallowed_methods)]

mod mission;
mod search;
mod world;

use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use mission::Kind;
use veilwing::planner::{Options, plan_slot};
use world::World;

/// One mission's judgement, bit/s/Hz.
struct Verdict {
    index: usize,
    mission: String,
    status: String,
    planned: f64,
    best: f64,
    planning_ms: f64,
}

impl Verdict {
    fn loss(&self) -> f64 {
        self.best - self.planned
    }
}

/// How much is judged.
struct Run {
    kind: Kind,
    missions: usize,
    first: usize,
    seed: u64,
    starts: usize,
    draws: usize,
    threads: usize,
}

fn judge(run: &Run, index: usize) -> Verdict {
    let problem = mission::draw(run.kind, run.seed, index);
    let begun = Instant::now();
    let plan = plan_slot(&problem, &Options { score_samples: 2048, ..Options::default() }).unwrap();
    let planning_ms = 1e3 * begun.elapsed().as_secs_f64();
    let world = World::new(&problem);
    let best = search::best(&world, run.starts, run.seed ^ ((index as u64) << 20));
    // Draws that neither search has seen.
    let score = |x: &world::Configuration| world.score(x, run.draws, 0xfeed ^ index as u64);
    Verdict {
        index,
        mission: mission::describe(&problem),
        status: format!("{:?}", plan.status),
        planned: score(&world::Configuration::of(&plan.vehicles)),
        best: score(&best),
        planning_ms,
    }
}

fn print(run: &Run, verdicts: &[Verdict]) {
    let mut losses: Vec<f64> = verdicts.iter().map(Verdict::loss).collect();
    losses.sort_by(f64::total_cmp);
    let count = losses.len();
    let within = |limit: f64| losses.iter().filter(|loss| **loss <= limit).count();
    let mut times: Vec<f64> = verdicts.iter().map(|v| v.planning_ms).collect();
    times.sort_by(f64::total_cmp);
    println!(
        "{}: {count} missions, seed {}, {} starts each, scored on {} draws",
        run.kind.name(),
        run.seed,
        run.starts,
        run.draws
    );
    println!(
        "within 0.01: {}, 0.05: {}, 0.2: {} of {count}; loss: median {:.4}, largest {:.4}, least {:.4}; planning: median {:.1} ms, most {:.1} ms",
        within(0.01),
        within(0.05),
        within(0.2),
        losses[count / 2],
        losses[count - 1],
        losses[0],
        times[count / 2],
        times[count - 1],
    );
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str, default: usize| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1)).and_then(|v| v.parse().ok()).unwrap_or(default)
    };
    let Some(kind) = arguments.first().and_then(|name| Kind::named(name)) else {
        eprintln!(
            "usage: judge worst-case|quantile|wide-gaussians|ten|free-yaw|floors|scattering|pointing|levels [--missions N] [--first N] [--seed N] [--starts N] [--draws N] [--threads N]"
        );
        return ExitCode::from(2);
    };
    let run = Run {
        kind,
        missions: number("--missions", 100).max(1),
        first: number("--first", 0),
        seed: number("--seed", 1) as u64,
        starts: number("--starts", 400).max(1),
        draws: number("--draws", 20_000).max(100),
        threads: number("--threads", 1).max(1),
    };
    println!(
        "mission  what                                   status            plan     judge      loss  plan ms"
    );
    let (next, verdicts) = (AtomicUsize::new(run.first), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..run.threads {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= run.first + run.missions {
                        return;
                    }
                    let v = judge(&run, index);
                    println!(
                        "{:7}  {:38} {:15} {:8.4}  {:8.4}  {:8.4} {:8.1}",
                        v.index,
                        v.mission,
                        v.status,
                        v.planned,
                        v.best,
                        v.loss(),
                        v.planning_ms
                    );
                    verdicts.lock().unwrap().push(v);
                }
            });
        }
    });
    print(&run, &verdicts.into_inner().unwrap());
    ExitCode::SUCCESS
}
