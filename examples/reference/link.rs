//! The link as it is: what a plan that knows of an imperfection is ahead of the ideal plan under the same truth, and what it
//! takes to make.

use std::sync::Arc;

use veilwing::planner::plan_slot;
use veilwing::planner::problem::{Fading, Method, Objective, Pattern, Problem, Rician, Uncertainty};
use veilwing::radio::measured::Measured;
use veilwing::role::PerVehicle;

use crate::data::{self, Failure};
use crate::tables::{Run, Times, mean, score};

/// What an effect does to the ideal link.
type Effect = fn(&mut Problem);

const EFFECTS: [(&str, Effect); 9] = [
    ("ideal", |_| {}),
    ("floor -25 dB", floor),
    ("measured pattern", measured),
    ("K of 15 dB", scattering),
    ("heading 2 deg", |p| p.pointing.heading_std_rad = f64::to_radians(2.0)),
    ("position 0.5/0.8 m", |p| p.pointing.position_std_m = [0.5, 0.8]),
    ("user within 1 m", |p| p.user_uncertainty = Uncertainty::Disc { radius_m: 1.0 }),
    ("all", all),
    ("all, quantile", |p| {
        all(p);
        p.objective = Objective::Quantile;
    }),
];

fn floor(problem: &mut Problem) {
    problem.antennas = PerVehicle::from_fn(|_| Pattern::with_null_depth(25.0));
}

/// A dipole whose null is 25 dB deep at one end and 20 dB at the other, as a chamber would tell it, every 5 deg.
fn measured(problem: &mut Problem) {
    let rows: Vec<[f64; 2]> = (0..=36)
        .map(|k| {
            let angle_deg = 5.0 * f64::from(k);
            let floor = 10f64.powf(if angle_deg < 90.0 { -2.5 } else { -2.0 });
            let gain = floor + (1.0 - floor) * f64::to_radians(angle_deg).sin().powi(2);
            [angle_deg, 10.0 * gain.log10()]
        })
        .collect();
    if let Ok(pattern) = Measured::new(&rows) {
        let pattern = Pattern::Measured(Arc::new(pattern));
        problem.antennas = PerVehicle { i: pattern.clone(), j: pattern };
    }
}

fn scattering(problem: &mut Problem) {
    let k = Rician::from_db(15.0);
    problem.fading = Fading { user: k, eavesdropper: k };
}

fn all(problem: &mut Problem) {
    for (_, effect) in &EFFECTS[2..7] {
        effect(problem);
    }
    problem.pointing.mounting_std_rad = f64::to_radians(0.5);
}

/// A row an effect and number of eavesdroppers: mean objective of the plan that knows and of the ideal plan (of the same
/// jitter) under the same truth, in bit/s/Hz; how far the first is ahead, on average and at least; planning time, and its
/// ratio to the ideal's.
pub fn table(run: &Run) -> Result<(), Failure> {
    println!(
        "jitter 2 deg; the ideal plan is scored under the same truth; one thread, the least wall time of three: to be run on an idle machine"
    );
    println!("effect              N  plans   knows   ideal   ahead   least      ms  over ideal");
    for n in [2, 5, 10] {
        let mut ideal_ms = f64::NAN;
        for (name, effect) in &EFFECTS {
            let (mut times, mut knows, mut ideal) = (Times::new(), Vec::new(), Vec::new());
            for eavesdroppers in data::eavesdroppers(n)?.iter().step_by(run.every).take(run.first) {
                let without = data::paper(eavesdroppers, 0.5, 2.0);
                let mut truth = without.clone();
                effect(&mut truth);
                let options = run.options(Method::Veilwing);
                let plan = times.least_of_three(|| plan_slot(&truth, &options))?;
                knows.push(score(&truth, &plan.vehicles)?);
                ideal.push(score(&truth, &plan_slot(&without, &options)?.vehicles)?);
            }
            let ahead: Vec<f64> = knows.iter().zip(&ideal).map(|(knows, ideal)| knows - ideal).collect();
            if *name == "ideal" {
                ideal_ms = times.wall_ms();
            }
            println!(
                "{name:18} {n:2} {:6} {:7.3} {:7.3} {:7.3} {:7.3} {:7.1} {:11.2}",
                knows.len(),
                mean(&knows),
                mean(&ideal),
                mean(&ahead),
                ahead.iter().copied().fold(f64::INFINITY, f64::min),
                times.wall_ms(),
                times.wall_ms() / ideal_ms,
            );
        }
    }
    Ok(())
}
