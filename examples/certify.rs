//! Tables of the certificate over the reference scenarios: `certify no-jitter|jitter|false-thresholds`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::disallowed_methods)]

use std::time::Instant;

use nalgebra::{Vector2, Vector3};
use veilwing::planner::bound::{Budget, best_bound};
use veilwing::planner::problem::{
    Airframe, Airspace, Eavesdropper, Jitter, JitterAxes, JitterModel, Objective, Problem, Radio, Uncertainty,
    VehicleModel,
};
use veilwing::role::PerVehicle;

fn rows(name: &str) -> Vec<Vec<f64>> {
    let path = format!("{}/tests/reference/{name}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap();
    text.lines().skip(1).map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect()
}

fn problem(eavesdroppers: &[f64], max_power_w: f64, jitter_rad: f64) -> Problem {
    let omnidirectional =
        VehicleModel { airframe: Airframe::Omnidirectional, max_tilt_rad: std::f64::consts::FRAC_PI_2 };
    Problem {
        user_enu_m: Vector3::zeros(),
        eavesdroppers: eavesdroppers
            .chunks(2)
            .map(|p| Eavesdropper {
                position_enu_m: Vector3::new(p[0], p[1], 0.0),
                uncertainty: Uncertainty::None,
            })
            .collect(),
        radio: Radio {
            bandwidth_hz: 1e6,
            noise_power_w: 1e-12,
            max_power_w: PerVehicle { i: max_power_w, j: max_power_w },
            reference_gain: 1.0,
        },
        airspace: Airspace {
            altitude_m: [80.0, 300.0],
            area_enu_m: [(-500.0, -500.0), (500.0, -500.0), (500.0, 500.0), (-500.0, 500.0)]
                .map(|(x, y)| Vector2::new(x, y))
                .to_vec(),
            min_separation_m: 0.0,
        },
        vehicles: PerVehicle { i: omnidirectional, j: omnidirectional },
        jitter: Jitter { std_rad: jitter_rad, model: JitterModel::Euler, axes: JitterAxes::RollPitch },
        objective: Objective::Nominal,
        free_yaw: false,
    }
}

fn jitter(n: usize, degrees: f64, budget: usize, tolerance: f64) {
    let nodes = rows(&format!("eavesdroppers_n{n}.csv"));
    for row in rows("jitter.csv").iter().filter(|r| r[0] == n as f64 && r[2] == degrees) {
        let scenario = row[1] as usize;
        let p = problem(&nodes[scenario][1..], 0.5, degrees.to_radians());
        let start = Instant::now();
        let (ub, b, u) = veilwing::planner::bound::jitter_trial(
            &p,
            row[3] * 1e6,
            Budget { boxes: budget, relative_gap: 1e-3 },
            tolerance,
        );
        println!("{n} {scenario:3} {degrees} {:.3} gap {:.2}% boxes {b} {u} time {:.2}", row[3], 100.0 * (ub / row[3] - 1.0), start.elapsed().as_secs_f64());
    }
}

fn main() {
    if std::env::args().nth(1).as_deref() == Some("jitter") {
        let arg = |k: usize| std::env::args().nth(k).unwrap().parse::<f64>().unwrap();
        return jitter(2, arg(2), arg(3) as usize, arg(4));
    }
    let budget = std::env::args().nth(2).map_or(500_000, |s| s.parse().unwrap());
    let table = rows("no_jitter.csv");
    for (n, power) in [(2, 0.5), (5, 0.5), (10, 0.5)] {
        let nodes = rows(&format!("eavesdroppers_n{n}.csv"));
        let mut shares = [0; 4];
        let mut count = 0;
        let mut times: Vec<f64> = Vec::new();
        for row in table.iter().filter(|r| r[0] == n as f64 && r[2] == power) {
            let scenario = row[1] as usize;
            let p = problem(&nodes[scenario][1..], power, 0.0);
            let start = Instant::now();
            let b = best_bound(&p, row[3] * 1e6, Budget { boxes: budget, relative_gap: 1e-3 });
            let time = start.elapsed().as_secs_f64();
            let gap = b.upper_bound_bps / (row[3] * 1e6) - 1.0;
            if std::env::args().nth(1).as_deref() == Some("v") {
                println!("{n} {scenario:3} gap {:.3}% boxes {} time {time:.3}", gap * 100.0, b.boxes_used);
            }
            times.push(time);
            count += 1;
            for (s, limit) in shares.iter_mut().zip([1e-2, 3e-3, 1.001e-3, 5e-4]) {
                *s += usize::from(gap <= limit);
            }
        }
        times.sort_by(f64::total_cmp);
        println!("{n} {power} {shares:?} of {count} time median {:.3} max {:.3}", times[count / 2], times[count - 1]);
    }
}
