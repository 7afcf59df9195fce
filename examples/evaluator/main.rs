//! `cargo run --release --example evaluator -- [DRAWS] [SAMPLES]`: what `evaluate` says of plans under the link as it is,
//! against plain Monte Carlo of other hands, on a grid of sixty cases: each effect alone at three strengths and all of them
//! together, for a plan without jitter and one under jitter about the body's axes.
//!
//! Prints a row a case, in bit/s/Hz, and how many agree within three standard errors of their difference.

mod truth;

use std::sync::Arc;

use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::problem::{Fading, JitterModel, Pattern, Problem, Rician, Uncertainty};
use veilwing::planner::{EvaluateOptions, Options, PlanError, evaluate, plan_slot};
use veilwing::radio::measured::Measured;
use veilwing::role::PerVehicle;

/// What a case does to the ideal link, at strength 0, 1 or 2.
type Effect = fn(&mut Problem, usize);

const EFFECTS: [(&str, Effect); 10] = [
    ("floor of -40, -30, -20 dB", |p, s| {
        p.antennas = PerVehicle::from_fn(|_| Pattern::with_null_depth([40.0, 30.0, 20.0][s]));
    }),
    ("measured pattern", |p, s| {
        if let Some(pattern) = lopsided([30.0, 25.0, 15.0][s]) {
            p.antennas = PerVehicle { i: pattern.clone(), j: pattern };
        }
    }),
    ("K of 20, 15, 10 dB", |p, s| {
        let k = Rician::from_db([20.0, 15.0, 10.0][s]);
        p.fading = Fading { user: k, eavesdropper: k };
    }),
    ("K about eavesdroppers", |p, s| p.fading.eavesdropper = Rician::from_db([20.0, 15.0, 10.0][s])),
    ("heading 0.5, 2, 5 deg", |p, s| p.pointing.heading_std_rad = [0.5, 2.0, 5.0][s] * DEG),
    ("mounting 0.25, 0.5, 2 deg", |p, s| p.pointing.mounting_std_rad = [0.25, 0.5, 2.0][s] * DEG),
    ("position 0.2, 0.5, 2 m", |p, s| {
        p.pointing.position_std_m = [[0.2, 0.3], [0.5, 0.8], [2.0, 3.0]][s];
    }),
    ("user 0.3, 1.5, 5 m", |p, s| {
        p.user_uncertainty = Uncertainty::Gaussian { std_m: [0.3, 1.5, 5.0][s] };
    }),
    ("eavesdroppers 10, 25, 50 m", |p, s| {
        for e in &mut p.eavesdroppers {
            e.uncertainty = Uncertainty::Disc { radius_m: [10.0, 25.0, 50.0][s] };
        }
    }),
    ("all together", together),
];

/// All effects but the first, in whose place the measured pattern stands.
fn together(problem: &mut Problem, strength: usize) {
    for (_, effect) in &EFFECTS[1..9] {
        effect(problem, strength);
    }
}

const DEG: f64 = std::f64::consts::PI / 180.0;

/// A pattern whose ends differ: a null of this depth along the axis, and one half as deep, in dB, against it.
fn lopsided(depth_db: f64) -> Option<Pattern> {
    let point = |k: u32| {
        let deg = 5.0 * f64::from(k);
        let floor = 10f64.powf(-(if k < 18 { depth_db } else { 0.5 * depth_db }) / 10.0);
        [deg, if k == 18 { 0.0 } else { 10.0 * (1.0 - (1.0 - floor) * (deg * DEG).cos().powi(2)).log10() }]
    };
    let points: Vec<[f64; 2]> = (0..=36).map(point).collect();
    Measured::new(&points).ok().map(|measured| Pattern::Measured(Arc::new(measured)))
}

/// An ideal mission by name, with its plan.
type Base = (&'static str, Problem, PerVehicle<VehiclePlan>);

fn bases() -> Result<[Base; 2], PlanError> {
    let steady = Problem::paper([[21.4, 103.8], [-29.1, -296.8]], 0.5, 0.0);
    let mut jittered = Problem::paper([[120.0, -40.0], [-300.0, 210.0], [50.0, 400.0]], 0.5, 2.0 * DEG);
    jittered.jitter.model = JitterModel::Body;
    let plan = |problem: &Problem| plan_slot(problem, &Options::default()).map(|plan| plan.vehicles);
    let plans = [plan(&steady)?, plan(&jittered)?];
    Ok([("no jitter, N = 2", steady, plans[0]), ("2 deg about the body, N = 3", jittered, plans[1])])
}

fn main() -> Result<(), PlanError> {
    let mut numbers = std::env::args().skip(1).filter_map(|text| text.parse::<u64>().ok());
    let (draws, samples) = (numbers.next().unwrap_or(10_000_000), numbers.next().unwrap_or(65_536));
    let options = EvaluateOptions { samples: samples as usize, seed: 7, ..EvaluateOptions::default() };
    println!("evaluate by {samples} samples, plain Monte Carlo by {draws} draws; bit/s/Hz\n");
    let (mut cases, mut agree) = (0, 0);
    for (name, base, vehicles) in bases()? {
        println!("{name}");
        println!(
            "{:>28}  {:>8}  {:>8}  {:>8}  {:>8}  {:>5}",
            "", "evaluate", "error", "draws", "error", "off"
        );
        for (effect, apply) in EFFECTS {
            for strength in 0..3 {
                let mut problem = base.clone();
                apply(&mut problem, strength);
                let found = evaluate(&problem, &vehicles, &options)?;
                let [rate, error] = [found.secrecy_rate_bps, found.standard_error_bps].map(|r| r / 1e6);
                let (mean, mean_error) = truth::mean(&problem, &vehicles, draws, 1 + cases);
                // Without anything random both are exact: what is left is rounding.
                let off = (rate - mean) / error.hypot(mean_error).max(1e-9);
                cases += 1;
                agree += u64::from(off.abs() <= 3.0);
                println!(
                    "{effect:>28}  {rate:>8.4}  {error:>8.4}  {mean:>8.4}  {mean_error:>8.4}  {off:>5.1}"
                );
            }
        }
        println!();
    }
    println!("{agree} of {cases} within three standard errors");
    Ok(())
}
