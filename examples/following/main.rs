//! What following a moving user, or a moving eavesdropper, is worth, and what replanning takes.
//!
//! ```text
//! cargo run --release --no-default-features --example following -- [table|speeds|times] [--missions N] [--first N]
//!     [--seeds N] [--replan S]
//! ```
//!
//! Users and eavesdroppers walk or drive over straight legs and round corners in the paper's arena, and are heard of once a second,
//! with 3 m of noise, a fifth of the reports lost. A minute is flown, replanned every second; the rate is that of the true places
//! along what is flown, by the evaluator, in bit/s/Hz. `table` prints it for the tracker and for two that plan alike and are told the
//! truth: where everybody is and how fast, each time that they plan, or all tracks to come, corners and all. Then what is lost
//! against the first by the tracker, and against the second by the tracker, by holding the poses planned at the beginning, and by
//! believing each last report as it is; means over missions and seeds with their standard errors. `speeds` prints the tracker's
//! losses against both over the user's speed. `times` prints what one core takes to plan a motion from rest and from the last one,
//! and to say how wrong poses may be on it.

// A measuring program: it reads the clock, and what it cannot plan may stop it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::disallowed_methods)]

mod tracks;
#[allow(dead_code)]
#[path = "../volume/mission.rs"]
mod volume;

use std::time::Instant;

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tracks::{Last, Now, Track};
use veilwing::planner::expectation::{EvaluateOptions, evaluate};
use veilwing::planner::following::{
    self, Estimate, Flying, Foresight, HORIZON_S, Motion, Report, Scene, Unrest,
};
use veilwing::planner::moving::Limits;
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::problem::Problem;
use veilwing::planner::turning::{LARGEST_RAD, Sizes};
use veilwing::planner::{Options, plan_slot};
use veilwing::role::PerVehicle;

/// How long they are heard of before, and how long it is flown, in seconds.
const BEFORE_S: f64 = 10.0;
const FLOWN_S: f64 = 60.0;
/// How often the rate is looked at, per second.
const LOOKS_HZ: usize = 5;
/// Errors that are looked at: of poses that are held as a companion asks for.
const ERRORS: Sizes = Sizes { pointing_rad: [0.05, LARGEST_RAD], position_m: [1.0; 2] };

/// Who moves, and how fast in m/s.
#[derive(Debug, Clone, Copy)]
struct Case {
    user_m_s: Option<f64>,
    eavesdropper_m_s: Option<f64>,
}

/// A mission of one user, and how everybody in it moves.
struct Mission {
    problem: Problem,
    /// The user's and the first eavesdropper's.
    tracks: [Option<Track>; 2],
    reports: [Vec<Report>; 2],
    unrest: [Unrest; 2],
    limits: PerVehicle<Limits>,
    turn_rate_rad_s: PerVehicle<f64>,
}

/// Who it is that plans.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Knows {
    Tracks,
    Now,
    Filter,
    LastReport,
}

/// What has been flown.
struct Flown {
    rate_bps_hz: f64,
    /// Milliseconds of each motion that was planned, the first from rest.
    plans_ms: Vec<f64>,
    /// And of its tolerances.
    tolerances_ms: Vec<f64>,
    not_made: usize,
}

fn mission(index: usize, eavesdroppers: usize, case: Case, seed: u64) -> Mission {
    let mut rng = ChaCha8Rng::seed_from_u64(0x5eed_0000 + 1000 * index as u64 + eavesdroppers as u64);
    let nodes: Vec<[f64; 2]> =
        (0..eavesdroppers).map(|_| [0; 2].map(|_| rng.random_range(-400.0..400.0))).collect();
    let mut problem = Problem::paper(nodes, 0.5, 2f64.to_radians());
    problem.airspace.min_separation_m = 5.0;
    problem.user_enu_m = Vector3::new(rng.random_range(-250.0..250.0), rng.random_range(-250.0..250.0), 0.0);
    let span_s = [-BEFORE_S, FLOWN_S + HORIZON_S + 1.0];
    let places = [problem.user_enu_m, problem.eavesdroppers[0].position_enu_m];
    let speeds = [case.user_m_s, case.eavesdropper_m_s];
    let own = |who: usize| seed * 64 + 8 * index as u64 + who as u64;
    let tracks =
        [0, 1].map(|who: usize| speeds[who].map(|speed| Track::new(places[who], speed, span_s, own(who))));
    let reports = [0, 1].map(|who: usize| {
        tracks[who].as_ref().map_or(Vec::new(), |track| track.reports(FLOWN_S, own(who) + 4))
    });
    let unrest = speeds.map(|speed| if speed.unwrap_or(0.0) < 4.0 { Unrest::WALKS } else { Unrest::DRIVES });
    let vehicles = volume::limits();
    let limits = vehicles.map(|own| Limits {
        speed_m_s: own.speed_m_s,
        climb_m_s: own.climb_m_s,
        acceleration_m_s2: own.acceleration_m_s2,
        jerk_m_s3: own.jerk_m_s3,
    });
    let turn_rate_rad_s = vehicles.map(|own| own.tilt_rate_rad_s);
    Mission { problem, tracks, reports, unrest, limits, turn_rate_rad_s }
}

impl Mission {
    /// What is known at an instant.
    fn known(&self, who: usize, knows: Knows, t_s: f64) -> Option<Box<dyn Foresight>> {
        let track = self.tracks[who].as_ref()?;
        let heard: Vec<&Report> = self.reports[who].iter().filter(|report| report.at_s <= t_s).collect();
        Some(match knows {
            Knows::Tracks => Box::new(track.clone()),
            Knows::Now => Box::new(Now(track.at(t_s), t_s)),
            Knows::LastReport => Box::new(Last(**heard.last()?)),
            Knows::Filter => {
                let mut estimate = Estimate::new(heard.first()?, self.unrest[who]);
                for report in &heard[1..] {
                    estimate.take(report);
                }
                Box::new(estimate)
            }
        })
    }

    /// The scene at an instant, given to `use_it`.
    fn with_scene<T>(&self, knows: Knows, t_s: f64, use_it: impl FnOnce(&Scene<'_>) -> T) -> T {
        let known = [0, 1].map(|who| self.known(who, knows, t_s));
        use_it(&Scene {
            problem: &self.problem,
            user: known[0].as_deref(),
            eavesdroppers: vec![known[1].as_deref()],
            limits: self.limits,
            turn_rate_rad_s: self.turn_rate_rad_s,
            apart_m: self.problem.airspace.min_separation_m,
        })
    }

    /// The rate in truth, bit/s/Hz.
    fn rate_bps_hz(&self, vehicles: &PerVehicle<VehiclePlan>, t_s: f64) -> f64 {
        let mut problem = self.problem.clone();
        let [user, eavesdropper] = &self.tracks;
        if let Some(track) = user {
            problem.user_enu_m = track.position(t_s);
        }
        if let Some(track) = eavesdropper {
            problem.eavesdroppers[0].position_enu_m = track.position(t_s);
        }
        let options = EvaluateOptions { samples: 1024, ..EvaluateOptions::default() };
        evaluate(&problem, vehicles, &options).unwrap().secrecy_rate_bps / problem.radio.bandwidth_hz
    }

    /// The poses that suit the beginning.
    fn rest(&self, knows: Knows) -> PerVehicle<VehiclePlan> {
        let problem = self.with_scene(knows, 0.0, |scene| scene.problem_at(0.0, 0.0));
        plan_slot(&problem, &Options::default()).unwrap().vehicles
    }

    /// The mean rate of poses that are held.
    fn held(&self, knows: Knows) -> f64 {
        let rest = self.rest(knows);
        self.mean(|t_s| self.rate_bps_hz(&rest, t_s), 0.0, FLOWN_S)
    }

    fn mean(&self, at: impl Fn(f64) -> f64, from_s: f64, lasts_s: f64) -> f64 {
        let looks = (lasts_s * LOOKS_HZ as f64).round().max(1.0) as usize;
        let look = |k: usize| at(from_s + lasts_s * (k as f64 + 0.5) / looks as f64);
        (0..looks).map(look).sum::<f64>() / looks as f64
    }

    fn fly(&self, knows: Knows, replan_s: f64) -> Flown {
        let rest = self.rest(knows);
        let mut flown =
            Flown { rate_bps_hz: 0.0, plans_ms: Vec::new(), tolerances_ms: Vec::new(), not_made: 0 };
        let mut motion: Option<Motion> = None;
        let steps = (FLOWN_S / replan_s).round() as usize;
        for step in 0..steps {
            let t_s = replan_s * step as f64;
            let begun = Instant::now();
            let mut planned_ms = 0.0;
            let next = self.with_scene(knows, t_s, |scene| {
                let from = motion.as_ref().map_or(Flying::rest(&rest), Flying::motion);
                let mut next = following::plan(scene, &from, t_s, 1).unwrap();
                planned_ms = 1e3 * begun.elapsed().as_secs_f64();
                if let Some(motion) = &mut next {
                    motion.add_tolerances(scene, &ERRORS, 1).unwrap();
                }
                next
            });
            flown.plans_ms.push(planned_ms);
            flown.tolerances_ms.push(1e3 * begun.elapsed().as_secs_f64() - planned_ms);
            flown.not_made += usize::from(next.is_none());
            motion = next.or(motion);
            let vehicles = |t_s: f64| motion.as_ref().map_or(rest, |motion| motion.at(t_s).vehicles);
            flown.rate_bps_hz +=
                self.mean(|t_s| self.rate_bps_hz(&vehicles(t_s), t_s), t_s, replan_s) / steps as f64;
        }
        flown
    }
}

/// Mean and standard error.
fn summed(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, (square / n).sqrt())
}

/// Which missions are flown how often.
struct Range {
    missions: std::ops::Range<usize>,
    seeds: u64,
    replan_s: f64,
}

impl Range {
    fn all(&self, eavesdroppers: usize, case: Case) -> Vec<Mission> {
        let seeds = move |index| (0..self.seeds).map(move |seed| mission(index, eavesdroppers, case, seed));
        self.missions.clone().flat_map(seeds).collect()
    }
}

fn percent(values: &[f64]) -> String {
    let (mean, error) = summed(values);
    format!("{:6.2} +- {:4.2}", 100.0 * mean, 100.0 * error)
}

/// Parts that are lost.
fn lost(rates: &[f64], of: &[f64]) -> Vec<f64> {
    rates.iter().zip(of).map(|(rate, of)| 1.0 - rate / of).collect()
}

fn table(range: &Range) {
    println!(
        "who moves         m/s  N  runs  all tracks  where and how fast  tracker  loss % to that   to all tracks  no replanning    last report  not made"
    );
    for (name, user, eavesdropper) in
        [("the user", true, false), ("an eavesdropper", false, true), ("both", true, true)]
    {
        for (speed, n) in [(1.5, 2), (1.5, 5), (8.0, 2), (8.0, 5)] {
            let case =
                Case { user_m_s: user.then_some(speed), eavesdropper_m_s: eavesdropper.then_some(speed) };
            let missions = range.all(n, case);
            let mut not_made = 0;
            let mut fly = |knows| {
                let flown = missions.iter().map(|mission| mission.fly(knows, range.replan_s));
                let note = |flown: Flown| {
                    not_made += if knows == Knows::Filter { flown.not_made } else { 0 };
                    flown.rate_bps_hz
                };
                flown.map(note).collect::<Vec<f64>>()
            };
            let [all, now, own, last] =
                [Knows::Tracks, Knows::Now, Knows::Filter, Knows::LastReport].map(&mut fly);
            let held: Vec<f64> = missions.iter().map(|mission| mission.held(Knows::Filter)).collect();
            println!(
                "{name:15}  {speed:4.1}  {n}  {:4}  {:10.3}  {:18.3}  {:7.3}  {}  {}  {}  {}  {not_made:8}",
                missions.len(),
                summed(&all).0,
                summed(&now).0,
                summed(&own).0,
                percent(&lost(&own, &now)),
                percent(&lost(&own, &all)),
                percent(&lost(&held, &all)),
                percent(&lost(&last, &all)),
            );
        }
    }
}

fn speeds(range: &Range) {
    println!("user m/s  N  loss % to where and how fast  to all tracks");
    for speed in [0.0, 1.5, 3.0, 5.0, 8.0, 12.0] {
        for n in [2, 5] {
            let missions = range.all(n, Case { user_m_s: Some(speed), eavesdropper_m_s: None });
            let [all, now, own] = [Knows::Tracks, Knows::Now, Knows::Filter].map(|knows| {
                let rate = |mission: &Mission| mission.fly(knows, range.replan_s).rate_bps_hz;
                missions.iter().map(rate).collect::<Vec<f64>>()
            });
            println!("{speed:8.1}  {n}  {:>28}  {}", percent(&lost(&own, &now)), percent(&lost(&own, &all)));
        }
    }
}

fn times(range: &Range) {
    println!("N  m/s  cold ms median    p99  warm ms median    p99  tolerances ms median    p99");
    for (n, speed) in [(2, 1.5), (2, 8.0), (5, 1.5), (5, 8.0)] {
        let case = Case { user_m_s: Some(speed), eavesdropper_m_s: Some(speed) };
        let (mut cold, mut warm, mut tolerances) = (Vec::new(), Vec::new(), Vec::new());
        for mission in range.all(n, case) {
            let flown = mission.fly(Knows::Filter, range.replan_s);
            cold.push(flown.plans_ms[0]);
            warm.extend_from_slice(&flown.plans_ms[1..]);
            tolerances.extend(flown.tolerances_ms);
        }
        let quantile = |values: &mut Vec<f64>, share: f64| {
            values.sort_by(f64::total_cmp);
            values[((values.len() - 1) as f64 * share).round() as usize]
        };
        println!(
            "{n}  {speed:3.1}  {:14.1}  {:5.1}  {:14.1}  {:5.1}  {:20.1}  {:5.1}",
            quantile(&mut cold, 0.5),
            quantile(&mut cold, 0.99),
            quantile(&mut warm, 0.5),
            quantile(&mut warm, 0.99),
            quantile(&mut tolerances, 0.5),
            quantile(&mut tolerances, 0.99),
        );
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let given = |name: &str| {
        let at = arguments.iter().position(|a| a == name);
        at.and_then(|at| arguments.get(at + 1))
    };
    let number = |name: &str, default: usize| given(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let first = number("--first", 0);
    let range = Range {
        missions: first..first + number("--missions", 8),
        seeds: number("--seeds", 3) as u64,
        replan_s: given("--replan").and_then(|v| v.parse().ok()).unwrap_or(1.0),
    };
    match arguments.first().map(String::as_str) {
        Some("times") => times(&range),
        Some("speeds") => speeds(&range),
        _ => table(&range),
    }
}
