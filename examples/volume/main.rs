//! What planning for volume gains over planning each slot for its rate, and an independent judge of it.
//!
//! ```text
//! cargo run --release --no-default-features --example volume -- [table|judge] [--missions N] [--first N] [--seed N] [--starts N]
//!     [--draws N] [--max-min]
//! ```
//!
//! `table` plans ten missions in the paper's arena both ways and prints what each delivers, bit/Hz for each second of a
//! superframe, transits and silence included, and the time that planning took on one core. `judge` lets a plain local search
//! of many random starts try the same missions, and prints the plan over the judge's best; the judge shares no code with the
//! planner: rates are `world`'s (of the `judge` example), times of transits are stated again in `search`. Both are scored on
//! draws that neither has seen.

// A measuring program: it reads the clock, and what it cannot plan may stop it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::disallowed_methods)]

mod mission;
mod plans;
mod search;
#[allow(dead_code)]
#[path = "../judge/world.rs"]
mod world;

use plans::{Planned, by_rate, by_volume, stated};
use search::Judge;
use veilwing::planner::volume::Fairness;
use veilwing::schedule::transit::Router;
use world::Configuration;

/// How many positions I and J have.
fn places(plan: &Planned) -> [usize; 2] {
    [0, 1].map(|v| {
        let mut seen: Vec<[f64; 3]> = Vec::new();
        for vehicles in &plan.vehicles {
            let at: [f64; 3] = [&vehicles.i, &vehicles.j][v].pose.position_enu_m.into();
            if !seen.contains(&at) {
                seen.push(at);
            }
        }
        seen.len()
    })
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |name: &str, default: usize| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1)).and_then(|v| v.parse().ok()).unwrap_or(default)
    };
    let judged = arguments.first().is_some_and(|kind| kind == "judge");
    let fairness =
        if arguments.iter().any(|a| a == "--max-min") { Fairness::MaxMin } else { Fairness::Slots };
    let (seed, starts, draws) =
        (number("--seed", 1) as u64, number("--starts", 60), number("--draws", 20_000).max(100));
    println!(
        "mission  users  N  slot_s  by rate  by volume  gain  places I J   judge   plan/judge  rate ms  volume ms"
    );
    let (mut worst, mut gains) = (f64::INFINITY, Vec::new());
    let first = number("--first", 0);
    for index in first..first + number("--missions", mission::COUNT) {
        let mission = mission::draw(index, seed, fairness);
        let limits = mission::limits();
        let router = Router::new(&mission.problems[0].airspace, &limits).unwrap();
        let rate = by_rate(&mission);
        let volume = by_volume(&mission, &router);
        assert!(volume.vehicles.iter().all(|v| router.holds(&v.i.pose.position_enu_m)));
        let [before, after] = [&rate, &volume].map(|plan| stated(&mission, &router, plan));
        gains.push(after / before);
        let mut line = format!(
            "{index:7}  {:5}  {}  {:6}  {before:7.3}  {after:9.3}  {:4.2}  {:8} {} ",
            mission.problems.len(),
            mission.problems[0].eavesdroppers.len(),
            mission.service.slot_s,
            after / before,
            places(&volume)[0],
            places(&volume)[1],
        );
        if judged {
            let judge = Judge::new(&mission, &router);
            let ours: Vec<Configuration> = volume.vehicles.iter().map(Configuration::of).collect();
            let best = judge.best(&ours, starts, seed ^ (index as u64) << 20);
            let [ours, best] = [&ours, &best].map(|xs| judge.score(xs, draws, 0xfeed ^ index as u64));
            worst = worst.min(ours / best);
            line += &format!(" {best:6.3}  {:11.4}", ours / best);
            // The plan's own figure by another road: fresh draws and times stated again.
            line += &format!(" [{ours:.3}]");
        } else {
            line += "      -            -";
        }
        println!("{line}  {:7.1}  {:9.1}", rate.took_ms, volume.took_ms);
    }
    gains.sort_by(f64::total_cmp);
    println!("gain: least {:.2}, most {:.2}", gains[0], gains[gains.len() - 1]);
    if judged {
        println!("plan over the judge's best: least {worst:.4}");
    }
}
