//! Scenarios that nobody has looked at, of every kind that `variants.jsonl` knows and of some more: the plan against a
//! search many times as large, half of whose starts are drawn uniformly.

use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::problem::{
    Airframe, JitterAxes, JitterModel, Method, Objective, Problem, Uncertainty,
};
use veilwing::planner::{Options, plan_slot};
use veilwing::role::PerVehicle;

use crate::data::{self, Failure};
use crate::tables::{Run, score};

/// Name, least and most eavesdroppers, jitter in degrees, and what else differs from the paper's setup.
type Kind = (&'static str, [usize; 2], f64, fn(&mut Problem, &mut ChaCha8Rng));

const KINDS: [Kind; 44] = [
    ("plain", [1, 10], 0.0, |_, _| {}),
    ("jitter 1", [1, 10], 1.0, |_, _| {}),
    ("jitter 2", [1, 10], 2.0, |_, _| {}),
    ("jitter 5", [1, 10], 5.0, |_, _| {}),
    ("jitter 10", [1, 10], 10.0, |_, _| {}),
    ("body 1", [2, 10], 1.0, |p, _| p.jitter.model = JitterModel::Body),
    ("body 2", [2, 10], 2.0, |p, _| p.jitter.model = JitterModel::Body),
    ("body 5", [2, 10], 5.0, |p, _| p.jitter.model = JitterModel::Body),
    ("body, three axes 5", [2, 5], 5.0, |p, _| {
        p.jitter.model = JitterModel::Body;
        p.jitter.axes = JitterAxes::RollPitchYaw;
    }),
    ("tilt 15", [2, 5], 0.0, |p, _| tilt(p, 15.0)),
    ("tilt 30", [2, 5], 0.0, |p, _| tilt(p, 30.0)),
    ("tilt 45", [2, 5], 0.0, |p, _| tilt(p, 45.0)),
    ("tilt 60", [2, 5], 0.0, |p, _| tilt(p, 60.0)),
    ("tilt 15", [2, 5], 2.0, |p, _| tilt(p, 15.0)),
    ("tilt 30", [2, 5], 2.0, |p, _| tilt(p, 30.0)),
    ("tilt 45", [2, 5], 2.0, |p, _| tilt(p, 45.0)),
    ("tilt 60", [2, 5], 2.0, |p, _| tilt(p, 60.0)),
    ("tilt 75", [2, 5], 2.0, |p, _| tilt(p, 75.0)),
    ("tilts unequal", [2, 5], 2.0, |p, rng| {
        p.vehicles.i.max_tilt_rad = rng.random_range(0.1..1.57);
        p.vehicles.j.max_tilt_rad = rng.random_range(0.1..1.57);
    }),
    ("tilt 30, ten", [10, 10], 2.0, |p, _| tilt(p, 30.0)),
    ("user off, heights", [2, 5], 2.0, user_off),
    ("user off, heights", [2, 5], 0.0, user_off),
    ("link budget", [2, 5], 0.0, |p, _| p.radio.reference_gain = 1e-4),
    ("link budget", [2, 5], 2.0, |p, _| p.radio.reference_gain = 1e-4),
    ("link budget, any", [2, 5], 2.0, |p, rng| {
        p.radio.reference_gain = 10f64.powf(rng.random_range(-6.0..-2.0));
    }),
    ("L, 60 m apart", [2, 5], 2.0, l_shape),
    ("strip, 60 m apart", [2, 5], 2.0, strip),
    ("triangle, 60 m apart", [2, 5], 2.0, triangle),
    ("any polygon", [2, 5], 2.0, star),
    ("tilt 30, 60 m apart", [2, 5], 0.0, |p, _| {
        tilt(p, 30.0);
        p.airspace.min_separation_m = 60.0;
    }),
    ("thirty, 150 m apart", [30, 30], 2.0, |p, _| p.airspace.min_separation_m = 150.0),
    ("a hundred", [100, 100], 2.0, |_, _| {}),
    ("three axes 2", [2, 5], 2.0, |p, _| p.jitter.axes = JitterAxes::RollPitchYaw),
    ("three axes 5", [2, 5], 5.0, |p, _| p.jitter.axes = JitterAxes::RollPitchYaw),
    ("yaw free", [2, 5], 2.0, |p, _| p.free_yaw = true),
    ("I level", [2, 5], 2.0, |p, _| p.vehicles.i.airframe = Airframe::Conventional),
    ("J level", [2, 5], 2.0, |p, _| p.vehicles.j.airframe = Airframe::Conventional),
    ("both level", [2, 5], 0.0, |p, _| {
        p.vehicles.i.airframe = Airframe::Conventional;
        p.vehicles.j.airframe = Airframe::Conventional;
    }),
    ("unequal powers", [2, 5], 2.0, |p, rng| {
        let [i, j] = [0, 0].map(|_: u8| 10f64.powf(rng.random_range(-1.5..0.5)));
        p.radio.max_power_w = PerVehicle { i, j };
    }),
    ("discs, mean", [2, 5], 2.0, |p, rng| uncertain(p, rng, Objective::Mean)),
    ("discs, mean", [2, 5], 0.0, |p, rng| uncertain(p, rng, Objective::Mean)),
    ("discs, quantile", [2, 5], 2.0, |p, rng| uncertain(p, rng, Objective::Quantile)),
    ("discs, worst case", [2, 5], 2.0, |p, rng| uncertain(p, rng, Objective::WorstCase)),
    ("all at once", [1, 12], 2.0, everything),
];

fn tilt(problem: &mut Problem, limit_deg: f64) {
    problem.vehicles.i.max_tilt_rad = limit_deg.to_radians();
    problem.vehicles.j.max_tilt_rad = limit_deg.to_radians();
}

/// Discs of 10 to 80 m, or, for a mean or quantile, as often Gaussians.
fn uncertain(problem: &mut Problem, rng: &mut ChaCha8Rng, objective: Objective) {
    problem.objective = objective;
    let disc = objective == Objective::WorstCase || rng.random_range(0..2) == 0;
    for eavesdropper in &mut problem.eavesdroppers {
        eavesdropper.uncertainty = if disc {
            Uncertainty::Disc { radius_m: rng.random_range(10.0..80.0) }
        } else {
            Uncertainty::Gaussian { std_m: rng.random_range(5.0..40.0) }
        };
    }
}

fn user_off(problem: &mut Problem, rng: &mut ChaCha8Rng) {
    let place = |rng: &mut ChaCha8Rng| rng.random_range(-400.0..400.0);
    problem.user_enu_m = Vector3::new(place(rng), place(rng), rng.random_range(0.0..30.0));
    for eavesdropper in &mut problem.eavesdroppers {
        eavesdropper.position_enu_m.z = rng.random_range(0.0..40.0);
    }
}

fn area(problem: &mut Problem, corners: &[[f64; 2]]) {
    problem.airspace.area_enu_m = corners.iter().map(|c| Vector2::new(c[0], c[1])).collect();
    problem.airspace.min_separation_m = 60.0;
}

fn l_shape(problem: &mut Problem, _: &mut ChaCha8Rng) {
    let l = [[-500.0, -500.0], [500.0, -500.0], [500.0, 20.0], [20.0, 20.0], [20.0, 500.0], [-500.0, 500.0]];
    area(problem, &l);
}

fn strip(problem: &mut Problem, rng: &mut ChaCha8Rng) {
    let (low, wide) = (rng.random_range(-200.0..100.0), rng.random_range(30.0..120.0));
    area(problem, &[[-500.0, low], [500.0, low], [500.0, low + wide], [-500.0, low + wide]]);
}

fn triangle(problem: &mut Problem, _: &mut ChaCha8Rng) {
    area(problem, &[[-60.0, -40.0], [420.0, -300.0], [180.0, 450.0]]);
}

/// A star about the origin: any polygon, often concave.
fn star(problem: &mut Problem, rng: &mut ChaCha8Rng) {
    let n = rng.random_range(4..10);
    let corners: Vec<_> = (0..n)
        .map(|k| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(n);
            let radius = rng.random_range(80.0..500.0);
            [radius * angle.cos(), radius * angle.sin()]
        })
        .collect();
    area(problem, &corners);
}

/// A mission of the field.
fn everything(problem: &mut Problem, rng: &mut ChaCha8Rng) {
    user_off(problem, rng);
    star(problem, rng);
    problem.airspace.min_separation_m = rng.random_range(2.0..100.0);
    let low = rng.random_range(30.0..100.0);
    problem.airspace.altitude_m = [low, low + rng.random_range(0.0..200.0)];
    problem.radio.reference_gain = 10f64.powf(rng.random_range(-5.0..0.0));
    problem.vehicles.i.max_tilt_rad = rng.random_range(0.3..2.0);
    problem.vehicles.j.max_tilt_rad = rng.random_range(0.3..2.0);
    problem.jitter.std_rad = rng.random_range(0.5f64..8.0).to_radians();
    if rng.random_range(0..2) == 0 {
        problem.jitter.model = JitterModel::Body;
    }
    match rng.random_range(0..6) {
        0 => problem.vehicles.i.airframe = Airframe::Conventional,
        1 => problem.vehicles.j.airframe = Airframe::Conventional,
        2 => uncertain(problem, rng, Objective::Mean),
        _ => {}
    }
}

/// Scenario `index` of a kind.
fn scenario(kind: &Kind, seed: u64, index: usize) -> Problem {
    let (name, [least, most], deg, change) = kind;
    // A stream for each kind, so that a table with more kinds has the same scenarios.
    let stream = name.bytes().fold(seed.wrapping_mul(1000) + deg.to_bits(), |sum, byte| {
        sum.wrapping_mul(31).wrapping_add(u64::from(byte))
    });
    let mut rng = ChaCha8Rng::seed_from_u64(stream.wrapping_add(index as u64));
    let n = rng.random_range(*least..=*most);
    let place = |rng: &mut ChaCha8Rng| rng.random_range(-500.0..500.0);
    let eavesdroppers: Vec<_> = (0..n).map(|_| Vector3::new(place(&mut rng), place(&mut rng), 0.0)).collect();
    let mut problem = data::paper(&eavesdroppers, 0.5, *deg);
    problem.airspace.min_separation_m = 5.0;
    change(&mut problem, &mut rng);
    problem
}

/// Prints, kind by kind, how far the plan stays behind the larger search.
pub fn table(run: &Run) -> Result<(), Failure> {
    let scenarios = (20 / run.every).max(1);
    let many = if run.starts > 0 { run.starts } else { 600 };
    println!(
        "{scenarios} random scenarios of each kind, seed {}: the plan against {many} starts; bit/s/Hz",
        run.seed
    );
    println!(
        "kind                      N  deg   mean rate  short by > limit  mean short    worst  infeasible by"
    );
    let (mut all, mut losses, mut infeasible) = (0, vec![], 0.0f64);
    for kind in KINDS.iter().filter(|kind| run.kind.as_ref().is_none_or(|wanted| kind.0.contains(wanted))) {
        let (mut rates, mut short, mut violation, mut limit) = (vec![], vec![], 0.0f64, 0.05);
        for index in 0..scenarios {
            let problem = scenario(kind, run.seed, index);
            limit = if problem.objective == Objective::WorstCase { 0.1 } else { 0.05 };
            let options = Options { method: Method::Veilwing, threads: run.threads, ..Options::default() };
            let plan = plan_slot(&problem, &options)?;
            violation = violation.max(data::violation(&problem, &plan.vehicles));
            let own = score(&problem, &plan.vehicles)?;
            let options = Options { starts: Some(many), seed: 1, ..options };
            let best = score(&problem, &plan_slot(&problem, &options)?.vehicles)?;
            rates.push(own);
            short.push(best - own);
            if best - own > limit {
                let n = problem.eavesdroppers.len();
                losses.push(format!(
                    "  {} {:.0} deg, scenario {index}, N {n}: {own:.4} of {best:.4}",
                    kind.0, kind.2
                ));
            }
        }
        all += scenarios;
        infeasible = infeasible.max(violation);
        println!(
            "{:22} {:>2}-{:<3} {:2.0} {:11.3} {:17} {:11.5} {:8.4} {violation:14.1e}",
            kind.0,
            kind.1[0],
            kind.1[1],
            kind.2,
            rates.iter().sum::<f64>() / rates.len() as f64,
            short.iter().filter(|s| **s > limit).count(),
            short.iter().sum::<f64>() / short.len() as f64,
            short.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        );
    }
    println!(
        "short by more than 0.05 (worst case: 0.1): {} of {all}; infeasible by at most {infeasible:.1e}",
        losses.len()
    );
    losses.iter().for_each(|line| println!("{line}"));
    Ok(())
}
