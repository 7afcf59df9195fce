//! How often the planner's own number of starts misses what ten times as many find, on random scenarios of every kind.

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

type Kind = (&'static str, usize, f64, fn(&mut Problem, &mut ChaCha8Rng));

/// Name, eavesdroppers, jitter in degrees, and what else differs from the paper's setup.
const KINDS: [Kind; 29] = [
    ("plain", 2, 0.0, |_, _| {}),
    ("plain", 10, 0.0, |_, _| {}),
    ("jitter 1", 2, 1.0, |_, _| {}),
    ("jitter 2", 2, 2.0, |_, _| {}),
    ("jitter 5", 5, 5.0, |_, _| {}),
    ("jitter 10", 2, 10.0, |_, _| {}),
    ("jitter 10", 10, 10.0, |_, _| {}),
    ("body 2", 3, 2.0, |p, _| p.jitter.model = JitterModel::Body),
    ("yaw 5", 3, 5.0, |p, _| p.jitter.axes = JitterAxes::RollPitchYaw),
    ("tilt 15", 2, 0.0, |p, _| tilt(p, 15.0)),
    ("tilt 45", 5, 0.0, |p, _| tilt(p, 45.0)),
    ("tilt 15", 2, 2.0, |p, _| tilt(p, 15.0)),
    ("tilt 30", 4, 2.0, |p, _| tilt(p, 30.0)),
    ("tilt 60", 2, 2.0, |p, _| tilt(p, 60.0)),
    ("user off, heights", 4, 2.0, user_off),
    ("link budget", 3, 0.0, |p, _| p.radio.reference_gain = 1e-4),
    ("link budget", 3, 2.0, |p, _| p.radio.reference_gain = 1e-4),
    ("L, 60 m apart", 3, 2.0, l_shape),
    ("triangle", 3, 0.0, triangle),
    ("tilt 30, 150 m apart", 3, 2.0, |p, _| {
        tilt(p, 30.0);
        p.airspace.min_separation_m = 150.0;
    }),
    ("30 eavesdroppers", 30, 2.0, |_, _| {}),
    ("I level", 2, 2.0, |p, _| p.vehicles.i.airframe = Airframe::Conventional),
    ("J level", 3, 2.0, |p, _| p.vehicles.j.airframe = Airframe::Conventional),
    ("both level", 2, 0.0, |p, _| {
        p.vehicles.i.airframe = Airframe::Conventional;
        p.vehicles.j.airframe = Airframe::Conventional;
    }),
    ("discs, mean", 2, 2.0, |p, _| uncertain(p, Objective::Mean, Uncertainty::Disc { radius_m: 50.0 })),
    ("discs, mean", 3, 0.0, |p, _| uncertain(p, Objective::Mean, Uncertainty::Disc { radius_m: 50.0 })),
    ("discs, worst case", 2, 2.0, |p, _| {
        uncertain(p, Objective::WorstCase, Uncertainty::Disc { radius_m: 50.0 })
    }),
    ("Gaussian, quantile", 10, 2.0, |p, _| {
        uncertain(p, Objective::Quantile, Uncertainty::Gaussian { std_m: 20.0 })
    }),
    ("unequal powers", 3, 2.0, |p, _| p.radio.max_power_w = PerVehicle { i: 1.0, j: 0.1 }),
];

fn tilt(problem: &mut Problem, limit_deg: f64) {
    problem.vehicles.i.max_tilt_rad = limit_deg.to_radians();
    problem.vehicles.j.max_tilt_rad = limit_deg.to_radians();
}

fn uncertain(problem: &mut Problem, objective: Objective, uncertainty: Uncertainty) {
    problem.objective = objective;
    problem.eavesdroppers.iter_mut().for_each(|e| e.uncertainty = uncertainty);
}

fn user_off(problem: &mut Problem, rng: &mut ChaCha8Rng) {
    problem.user_enu_m = Vector3::new(rng.random_range(-400.0..400.0), rng.random_range(-400.0..400.0), 12.0);
    for eavesdropper in &mut problem.eavesdroppers {
        eavesdropper.position_enu_m.z = rng.random_range(0.0..35.0);
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

fn triangle(problem: &mut Problem, _: &mut ChaCha8Rng) {
    area(problem, &[[-60.0, -40.0], [420.0, -300.0], [180.0, 450.0]]);
}

/// Prints, kind by kind, the shortfall of the planner's own number of starts.
pub fn table(run: &Run) -> Result<(), Failure> {
    let scenarios = (40 / run.every).max(1);
    let many = if run.starts > 0 { run.starts } else { 600 };
    println!("{scenarios} random scenarios of each kind: own number of starts against {many}; bit/s/Hz");
    println!("kind                   N  deg   mean rate  short by > 0.1%  > 0.05 bit   mean short     worst");
    for (name, n, deg, change) in KINDS {
        let (mut rates, mut short) = (vec![], vec![]);
        for scenario in 0..scenarios {
            let mut rng = ChaCha8Rng::seed_from_u64(run.seed * 1000 + scenario as u64);
            let eavesdroppers: Vec<_> = (0..n)
                .map(|_| Vector3::new(rng.random_range(-500.0..500.0), rng.random_range(-500.0..500.0), 0.0))
                .collect();
            let mut problem = data::paper(&eavesdroppers, 0.5, deg);
            problem.airspace.min_separation_m = 5.0;
            change(&mut problem, &mut rng);
            let options = Options { method: Method::Veilwing, threads: run.threads, ..Options::default() };
            let own = score(&problem, &plan_slot(&problem, &options)?.vehicles)?;
            let options = Options { starts: Some(many), seed: 1, ..options };
            let best = score(&problem, &plan_slot(&problem, &options)?.vehicles)?;
            rates.push(own);
            short.push(best - own);
        }
        let count = |limit: &dyn Fn(f64) -> f64| {
            short.iter().zip(&rates).filter(|(s, rate)| **s > limit(**rate)).count()
        };
        println!(
            "{name:20} {n:3} {deg:4.0} {:11.3} {:16} {:11} {:12.5} {:9.4}",
            rates.iter().sum::<f64>() / rates.len() as f64,
            count(&|rate| 1e-3 * rate),
            count(&|_| 0.05),
            short.iter().sum::<f64>() / short.len() as f64,
            short.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        );
    }
    Ok(())
}
