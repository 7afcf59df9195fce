//! What radiating through the turn gains over silence between slots, an independent judge of it, and what it takes.
//!
//! ```text
//! cargo run --release --no-default-features --example turning -- [table|judge|times] [--missions N] [--first N] [--seed N]
//!     [--starts N] [--draws N] [--max-min] [--guard S] [--turn DEG_S]
//! ```
//!
//! `table` plans ten missions in the paper's arena, and the demo's where the mission file can be read (the default features),
//! each slot by its rate, for volume, with turns through the volume plan's poses, and with poses chosen for the turns; all in
//! bit/s/Hz over the superframe, silence and transits included. `judge` lets many random starts of a plain local search choose
//! poses, and a dense dynamic programme with random bends the attitudes between them, and prints the plan over the judge's
//! best, both on draws that neither has seen, and the largest of what the plan asks of a limit; the judge shares no code with
//! the planner. `times` prints what one core takes for each slot, and how wrong poses may be. `--guard` and `--turn` are other
//! guard times and rates of turning than the missions' 1 s and 45 deg/s.

// A measuring program: it reads the clock, and what it cannot plan may stop it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::disallowed_methods)]

#[path = "../volume/mission.rs"]
mod mission;
mod paths;
#[allow(dead_code)]
#[path = "../volume/plans.rs"]
mod plans;
#[allow(dead_code)]
#[path = "../volume/search.rs"]
mod search;
#[allow(dead_code)]
#[path = "../judge/world.rs"]
mod world;

use std::time::Instant;

use mission::Superframe;
use paths::{Paths, strain};
use plans::{Planned, by_rate, by_volume, stated};
use search::Judge;
use veilwing::planner::Options;
use veilwing::planner::turning::{self, Joint, Protected, Standing};
use veilwing::planner::volume::{Fairness, Ways};
use veilwing::role::Role;
use veilwing::schedule::transit::Router;
use world::Configuration;

/// A mission, by its name.
struct Named {
    name: String,
    mission: Superframe,
    router: Router,
}

fn drawn(
    index: usize,
    seed: u64,
    fairness: Fairness,
    guard_s: Option<f64>,
    turn_deg_s: Option<f64>,
) -> Named {
    let mut mission = mission::draw(index, seed, fairness);
    let mut limits = mission::limits();
    if let Some(turn_deg_s) = turn_deg_s {
        limits.i.tilt_rate_rad_s = turn_deg_s.to_radians();
        limits.j.tilt_rate_rad_s = turn_deg_s.to_radians();
    }
    mission.service.guard_s = guard_s.unwrap_or(mission.service.guard_s);
    let router = Router::new(&mission.problems[0].airspace, &limits).unwrap();
    Named { name: index.to_string(), mission, router }
}

#[cfg(feature = "companion")]
fn demo() -> Option<Named> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/mission.toml");
    let mission = veilwing::config::Mission::load(&path).ok()?;
    let problems = (0..mission.users.len()).filter_map(|user| mission.problem(user)).collect();
    let router = Router::new(&mission.airspace, &mission.transit_limits()).ok()?;
    Some(Named { name: "demo".into(), mission: Superframe { problems, service: mission.service() }, router })
}

#[cfg(not(feature = "companion"))]
fn demo() -> Option<Named> {
    None
}

fn through(named: &Named, plan: &Planned, share: Option<f64>) -> Protected {
    let standing = Standing { vehicles: &plan.vehicles, slots_s: &plan.slots_s, order: None };
    let Superframe { problems, service } = &named.mission;
    turning::through(problems, &standing, service, &named.router, &Options::default(), share).unwrap()
}

fn joint(named: &Named) -> Joint {
    let Superframe { problems, service } = &named.mission;
    turning::plan(problems, service, &named.router, &Options::default(), None).unwrap()
}

/// What counts of a plan, bit/s/Hz over the superframe.
fn worth(named: &Named, plan: &Protected) -> f64 {
    let bandwidth_hz = named.mission.problems[0].radio.bandwidth_hz;
    let bits = match named.mission.service.fairness {
        Fairness::Slots => plan.volume_bits(),
        Fairness::MaxMin => plan.least_user_volume_bits(),
    };
    bits / bandwidth_hz / plan.superframe_s
}

fn rates_rad_s(router: &Router) -> [f64; 2] {
    Role::BOTH.map(|role| router.turn_rate_rad_s(role))
}

/// Each user's share of all that is delivered, in percent, as listed.
fn shares(plan: &Protected) -> Vec<String> {
    let mut shares = vec![0.0; plan.slots.len()];
    for slot in &plan.slots {
        shares[slot.user] = 100.0 * slot.volume_bits / plan.volume_bits();
    }
    shares.into_iter().map(|share: f64| format!("{share:.0}")).collect()
}

fn head(named: &Named) -> String {
    let Superframe { problems, service } = &named.mission;
    format!(
        "{:7}  {:5}  {}  {:6}",
        named.name,
        problems.len(),
        problems[0].eavesdroppers.len(),
        service.slot_s
    )
}

fn table(all: &[Named]) {
    println!(
        "mission  users  N  slot_s  by rate  by volume  turning   joint  gain static joint  on air %  silence s  least user  shares %"
    );
    let mut gains = Vec::new();
    for named in all {
        let (rate, volume) = (by_rate(&named.mission), by_volume(&named.mission, &named.router));
        let [today, still] = [&rate, &volume].map(|plan| stated(&named.mission, &named.router, plan));
        let turned = through(named, &volume, None);
        let both = joint(named);
        let [turned_worth, worth] = [worth(named, &turned), worth(named, &both.protected)];
        gains.push((turned_worth / still, worth / turned_worth));
        let plan = &both.protected;
        let silence_s: f64 = plan.slots.iter().map(|slot| slot.silence_s).sum();
        let least = plan.least_user_volume_bits() / named.mission.problems[0].radio.bandwidth_hz;
        println!(
            "{}  {today:7.3}  {still:9.3}  {turned_worth:7.3}  {worth:6.3}  {:11.3} {:5.3}  {:8.1}  {:9.2}  {:10.3}  {}{}",
            head(named),
            turned_worth / still,
            worth / turned_worth,
            100.0 * plan.share_on_air(),
            silence_s / plan.slots.len() as f64,
            least / plan.superframe_s,
            shares(plan).join(" "),
            if both.is_static { "  (the static plan's poses)" } else { "" },
        );
    }
    let mean =
        |of: fn(&(f64, f64)) -> f64| gains.iter().map(|gain| of(gain).ln()).sum::<f64>() / gains.len() as f64;
    println!(
        "turning over static, geometric mean: {:.3}; joint over turning: {:.3}",
        mean(|gain| gain.0).exp(),
        mean(|gain| gain.1).exp()
    );
}

fn judge(all: &[Named], starts: usize, draws: usize, seed: u64) {
    println!(
        "mission  users  N  slot_s  the plan's word   the plan   the judge   plan/judge   asked/allowed"
    );
    let (mut worst, mut hardest) = (f64::INFINITY, 0.0f64);
    for (index, named) in all.iter().enumerate() {
        let Superframe { problems, service } = &named.mission;
        let plan = joint(named);
        let rates_rad_s = rates_rad_s(&named.router);
        let judge = Judge::of_turning(&named.mission, &named.router);
        let ours: Vec<Configuration> =
            plan.slots.iter().map(|slot| Configuration::of(&slot.vehicles)).collect();
        let theirs = judge.best(&ours, starts, seed ^ (index as u64) << 20);
        let paths = Paths::new(&named.mission, rates_rad_s);
        let seed = 0xfeed ^ index as u64;
        let said = worth(named, &plan.protected);
        // The judge's own poses, and ours with the judge's turns.
        let best = [&theirs, &ours].map(|xs| {
            let order = judge.order(xs);
            let n = xs.len();
            let turns: Vec<_> = (0..n)
                .map(|k| {
                    let users = [order[k], order[(k + 1) % n]];
                    paths.best(users, &users.map(|user| xs[user]), said, seed + k as u64)
                })
                .collect();
            let one_place = xs.iter().all(|x| x.position_m == xs[0].position_m);
            // Turns are between users at one place.
            if one_place {
                paths.score(xs, &order, &turns, draws, seed)
            } else {
                judge.score(xs, draws, seed)
            }
        });
        let best = best[0].max(best[1]);
        let found = paths.score_of(&plan.protected, draws, seed);
        let strain = strain(problems, &plan.protected, service.guard_s, rates_rad_s, 0.003);
        worst = worst.min(found / best);
        hardest = hardest.max(strain);
        println!(
            "{}  {said:15.3}  {found:9.3}  {best:10.3}  {:11.4}  {strain:14.9}",
            head(named),
            found / best
        );
    }
    println!("plan over the judge's best: least {worst:.4}; asked of a limit: at most {hardest:.9}");
}

fn times(all: &[Named]) {
    println!(
        "mission  users  N  slot_s  turns ms a slot  tolerances ms a slot  joint ms a slot   I deg  J deg   I m   J m  user dB"
    );
    let mut most = 0.0f64;
    for named in all {
        let volume = by_volume(&named.mission, &named.router);
        let users = volume.slots.len() as f64;
        let clock = |work: &mut dyn FnMut()| {
            let begun = Instant::now();
            work();
            1e3 * begun.elapsed().as_secs_f64() / users
        };
        let turns_ms = clock(&mut || drop(through(named, &volume, None)));
        let mut plan = None;
        let all_ms = clock(&mut || plan = Some(through(named, &volume, Some(0.02))));
        let joint_ms = clock(&mut || drop(joint(named)));
        most = most.max(turns_ms);
        let plan = plan.unwrap();
        let found: Vec<_> = plan.knots().filter_map(|knot| knot.tolerance).collect();
        let median = |of: &dyn Fn(&turning::Tolerance) -> f64| {
            let mut all: Vec<f64> = found.iter().map(of).collect();
            all.sort_by(f64::total_cmp);
            all.get(all.len() / 2).copied().unwrap_or(f64::NAN)
        };
        println!(
            "{}  {turns_ms:15.1}  {:20.1}  {joint_ms:15.1}  {:6.2} {:6.2}  {:4.1}  {:4.1}  {:7.2}",
            head(named),
            all_ms - turns_ms,
            median(&|t| t.pointing_rad.i.to_degrees()),
            median(&|t| t.pointing_rad.j.to_degrees()),
            median(&|t| t.position_m.i),
            median(&|t| t.position_m.j),
            median(&|t| 10.0 * t.user_sinr_ratio.log10()),
        );
    }
    println!("turns: at most {most:.1} ms a slot");
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let given = |name: &str| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1))
    };
    let number = |name: &str, default: usize| given(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let [guard_s, turn_deg_s] = ["--guard", "--turn"].map(|name| given(name).and_then(|v| v.parse().ok()));
    let fairness =
        if arguments.iter().any(|a| a == "--max-min") { Fairness::MaxMin } else { Fairness::Slots };
    let (seed, first) = (number("--seed", 1) as u64, number("--first", 0));
    let mut all: Vec<Named> = (first..first + number("--missions", mission::COUNT))
        .map(|index| drawn(index, seed, fairness, guard_s, turn_deg_s))
        .collect();
    let judged = arguments.first().is_some_and(|kind| kind == "judge");
    if judged && fairness != Fairness::Slots {
        eprintln!("turning judge: it weighs the sum of what all users get; leave --max-min out");
        std::process::exit(2);
    }
    // The judge knows square areas alone.
    let as_they_are = guard_s.is_none() && turn_deg_s.is_none();
    all.extend(demo().filter(|_| fairness == Fairness::Slots && as_they_are && !judged));
    match arguments.first().map(String::as_str) {
        Some("judge") => judge(&all, number("--starts", 60), number("--draws", 20_000).max(100), seed),
        Some("times") => times(&all),
        _ => table(&all),
    }
}
