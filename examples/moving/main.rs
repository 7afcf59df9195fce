//! What moving while radiating gains over turning, an independent judge of it, and what it takes.
//!
//! ```text
//! cargo run --release --no-default-features --example moving -- [table|judge|times] [--missions N] [--first N] [--seed N]
//!     [--starts N] [--draws N] [--max-min] [--turn DEG_S]
//! ```
//!
//! `table` plans ten missions in the paper's arena, and the demo's where the mission file can be read (the default features), for
//! volume, with poses chosen for turns, and with both vehicles in motion; all in bit/s/Hz over the superframe, silence and
//! transits included, and what of its limits the motion asks for. `judge` lets a plain local search of its own move waypoints and
//! attitudes from many random starts, and prints the plan over the judge's best, both on draws that neither has seen, and the
//! largest of what the plan asks of a limit, instant by instant; the judge shares no code with the planner. `times` prints what
//! one core takes for each slot. `--turn` is another rate of turning than the missions' 45 deg/s.

// A measuring program: it reads the clock, and what it cannot plan may stop it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::disallowed_methods)]

mod judge;
#[path = "../volume/mission.rs"]
mod mission;
#[allow(dead_code)]
#[path = "../volume/plans.rs"]
mod plans;
#[allow(dead_code)]
#[path = "../judge/world.rs"]
mod world;

use std::time::Instant;

use mission::Superframe;
use plans::{by_volume, stated};
use veilwing::planner::Options;
use veilwing::planner::moving::{self, Flight, Limits, Moving, Planned, Spline};
use veilwing::planner::turning::{self, Joint, Protected};
use veilwing::planner::volume::{Fairness, Ways};
use veilwing::role::{PerVehicle, Role};
use veilwing::schedule::transit::Router;

/// A mission, by its name.
struct Named {
    name: String,
    mission: Superframe,
    router: Router,
    limits: PerVehicle<Limits>,
}

fn drawn(index: usize, seed: u64, fairness: Fairness, turn_deg_s: Option<f64>) -> Named {
    let mission = mission::draw(index, seed, fairness);
    let mut limits = mission::limits();
    if let Some(turn_deg_s) = turn_deg_s {
        limits.i.tilt_rate_rad_s = turn_deg_s.to_radians();
        limits.j.tilt_rate_rad_s = turn_deg_s.to_radians();
    }
    let router = Router::new(&mission.problems[0].airspace, &limits).unwrap();
    Named { name: index.to_string(), mission, router, limits: limits.map(|limits| limits.of_motion()) }
}

#[cfg(feature = "companion")]
fn demo() -> Option<Named> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/mission.toml");
    let mission = veilwing::config::Mission::load(&path).ok()?;
    let problems = (0..mission.users.len()).filter_map(|user| mission.problem(user)).collect();
    let limits = mission.transit_limits();
    let router = Router::new(&mission.airspace, &limits).ok()?;
    let limits = limits.map(|limits| limits.of_motion());
    let mission = Superframe { problems, service: mission.service() };
    Some(Named { name: "demo".into(), mission, router, limits })
}

#[cfg(not(feature = "companion"))]
fn demo() -> Option<Named> {
    None
}

fn turned(named: &Named) -> Joint {
    let Superframe { problems, service } = &named.mission;
    turning::plan(problems, service, &named.router, &Options::default(), None).unwrap()
}

fn moved(named: &Named, joint: Joint, share: Option<f64>) -> Planned {
    let Superframe { problems, service } = &named.mission;
    let options = Options::default();
    moving::beyond(problems, joint, service, &named.router, &named.limits, &options, share).unwrap()
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

/// The largest demand over limit of both ways.
fn asked(named: &Named, planned: &Planned) -> f64 {
    let Flight::Moving(moving) = &planned.flight else { return 0.0 };
    let strain = |way: &moving::Spline, limits: &Limits| limits.strain(&way.demand());
    strain(&moving.ways.i, &named.limits.i).max(strain(&moving.ways.j, &named.limits.j))
}

fn table(all: &[Named]) {
    println!(
        "mission  users  N  slot_s  by volume  turning  moving  gain turning moving  on air %  silence s  least user  asked/allowed  ms a slot"
    );
    let mut gains = Vec::new();
    for named in all {
        let volume = by_volume(&named.mission, &named.router);
        let still = stated(&named.mission, &named.router, &volume);
        let joint = turned(named);
        let turning = worth(named, &joint.protected);
        let begun = Instant::now();
        let planned = moved(named, joint, None);
        let ms = 1e3 * begun.elapsed().as_secs_f64() / named.mission.problems.len() as f64;
        let plan = planned.flight.protected();
        let moving = worth(named, plan);
        gains.push((turning / still, moving / turning));
        let silence_s: f64 = plan.slots.iter().map(|slot| slot.silence_s).sum();
        let least = plan.least_user_volume_bits() / named.mission.problems[0].radio.bandwidth_hz;
        println!(
            "{}  {still:9.3}  {turning:7.3}  {moving:6.3}  {:12.3} {:6.3}  {:8.1}  {:9.2}  {:10.3}  {:13.6}  {ms:9.0}{}",
            head(named),
            turning / still,
            moving / turning,
            100.0 * plan.share_on_air(),
            silence_s / plan.slots.len() as f64,
            least / plan.superframe_s,
            asked(named, &planned),
            if matches!(planned.flight, Flight::Turning(_)) { "  (stays)" } else { "" },
        );
    }
    let mean =
        |of: fn(&(f64, f64)) -> f64| gains.iter().map(|gain| of(gain).ln()).sum::<f64>() / gains.len() as f64;
    println!(
        "geometric means: turning over static {:.3}; moving over turning {:.3}",
        mean(|gain| gain.0).exp(),
        mean(|gain| gain.1).exp()
    );
}

fn judged(all: &[Named], starts: usize, draws: usize, seed: u64) {
    println!(
        "mission  users  N  slot_s  the plan's word  the plan  judge alone  judge from the plan  plan/judge  asked/allowed"
    );
    let (mut worst, mut hardest) = (f64::INFINITY, 0.0f64);
    for (index, named) in all.iter().enumerate() {
        let planned = moved(named, turned(named), None);
        // Where it stays it is a motion of one control point.
        let moving = match planned.flight {
            Flight::Moving(moving) => moving,
            Flight::Turning(protected) => {
                let at = protected.slots[0].knots[0].vehicles;
                let period_s = protected.superframe_s;
                let ways = at.map(|vehicle| Spline::still(vehicle.pose.position_enu_m, period_s, 1));
                Moving { protected, ways }
            }
        };
        let rate_rad_s = named.router.turn_rate_rad_s(Role::I);
        let judge = judge::Judge::new(&named.mission, &named.limits, rate_rad_s, &moving.protected);
        let [own, free, near] = judge.compare(&moving, starts, draws, seed ^ (index as u64) << 20);
        let strain = judge::strain(&named.mission, &moving, &named.limits, rate_rad_s);
        let ratio = own / free.max(near);
        (worst, hardest) = (worst.min(ratio), hardest.max(strain));
        println!(
            "{}  {:15.3}  {own:8.3}  {free:11.3}  {near:19.3}  {ratio:10.4}  {strain:13.6}",
            head(named),
            worth(named, &moving.protected),
        );
    }
    println!("plan over the judge's best: least {worst:.4}; asked of a limit: at most {hardest:.6}");
}

fn times(all: &[Named]) {
    println!("mission  users  N  slot_s  turning ms a slot  motion ms a slot  tolerances ms a slot");
    let mut most = 0.0f64;
    for named in all {
        let users = named.mission.problems.len() as f64;
        let clock = |work: &mut dyn FnMut()| {
            let begun = Instant::now();
            work();
            1e3 * begun.elapsed().as_secs_f64() / users
        };
        let mut joint = None;
        let turning_ms = clock(&mut || joint = Some(turned(named)));
        let joint = joint.unwrap();
        let moving_ms = clock(&mut || drop(moved(named, joint.clone(), None)));
        let all_ms = clock(&mut || drop(moved(named, joint.clone(), Some(0.02))));
        most = most.max(moving_ms);
        println!("{}  {turning_ms:17.1}  {moving_ms:16.1}  {:20.1}", head(named), all_ms - moving_ms);
    }
    println!("motion: at most {most:.1} ms a slot");
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let given = |name: &str| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1))
    };
    let number = |name: &str, default: usize| given(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let turn_deg_s = given("--turn").and_then(|v| v.parse().ok());
    let fairness =
        if arguments.iter().any(|a| a == "--max-min") { Fairness::MaxMin } else { Fairness::Slots };
    let (seed, first) = (number("--seed", 1) as u64, number("--first", 0));
    let mut all: Vec<Named> = (first..first + number("--missions", mission::COUNT))
        .map(|index| drawn(index, seed, fairness, turn_deg_s))
        .collect();
    all.extend(demo().filter(|_| fairness == Fairness::Slots && turn_deg_s.is_none()));
    match arguments.first().map(String::as_str) {
        Some("judge") => judged(&all, number("--starts", 12), number("--draws", 4_000).max(100), seed),
        Some("times") => times(&all),
        _ => table(&all),
    }
}
