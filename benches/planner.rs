//! `cargo bench --no-default-features --bench planner`: the objective with its gradient per sample count, planning times by
//! number of eavesdroppers, and the certificate, on one thread.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Vector2, Vector3};
use veilwing::planner::bound::{Budget, best_bound};
use veilwing::planner::expectation::kernel::{Raw, Scene, Workspace};
use veilwing::planner::expectation::samples::{Samples, Sequence};
use veilwing::planner::problem::{
    Airframe, Airspace, Eavesdropper, Jitter, JitterAxes, JitterModel, Objective, Problem, Radio,
    Uncertainty, VehicleModel,
};
use veilwing::planner::{Options, plan_slot};
use veilwing::role::PerVehicle;

/// Eavesdroppers on a spiral about the user: any number, none alike.
fn problem(n: usize, jitter_deg: f64, radius_m: f64) -> Problem {
    let vehicle =
        VehicleModel { airframe: Airframe::Omnidirectional, max_tilt_rad: std::f64::consts::FRAC_PI_2 };
    let node = |k: usize| {
        let (angle, distance) = (2.4 * k as f64 + 0.3, 120.0 + 350.0 * (k as f64 * 0.618).fract());
        Eavesdropper {
            position_enu_m: Vector3::new(distance * angle.cos(), distance * angle.sin(), 0.0),
            uncertainty: if radius_m > 0.0 { Uncertainty::Disc { radius_m } } else { Uncertainty::None },
        }
    };
    let corners = [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]];
    Problem {
        user_enu_m: Vector3::zeros(),
        eavesdroppers: (0..n).map(node).collect(),
        radio: Radio {
            bandwidth_hz: 1e6,
            noise_power_w: 1e-12,
            max_power_w: PerVehicle { i: 0.5, j: 0.5 },
            reference_gain: 1.0,
        },
        airspace: Airspace {
            altitude_m: [80.0, 300.0],
            area_enu_m: corners.iter().map(|c| Vector2::new(c[0], c[1])).collect(),
            min_separation_m: 5.0,
        },
        vehicles: PerVehicle { i: vehicle, j: vehicle },
        jitter: Jitter {
            std_rad: jitter_deg.to_radians(),
            model: JitterModel::Euler,
            axes: JitterAxes::RollPitch,
        },
        objective: Objective::Mean,
        free_yaw: false,
    }
}

fn objective(c: &mut Criterion) {
    let mut group = c.benchmark_group("objective and gradient");
    let raw: Raw = [5.0, 3.0, 80.0, 0.8, -0.3, 0.0, 0.5, 90.0, -210.0, 80.0, 1.1, 0.8, 0.0, 0.006];
    for n in [2, 10, 100] {
        let problem = problem(n, 2.0, 0.0);
        for count in [64, 512, 2048] {
            let samples = Samples::new(&problem, count, 1, 1, Sequence::Sobol);
            let scene = Scene { user: [0.0; 3], budget_m2_w: 1e12 };
            let (mut workspace, mut gradient) = (Workspace::default(), [0.0; 14]);
            group.throughput(Throughput::Elements(count as u64));
            group.bench_function(BenchmarkId::new(format!("N {n}"), count), |b| {
                b.iter(|| workspace.mean(&scene, &samples, black_box(&raw), false, Some(&mut gradient)));
            });
        }
    }
    group.finish();
}

fn planning(c: &mut Criterion) {
    let mut group = c.benchmark_group("plan");
    group.sample_size(20);
    for (name, deg, radius) in
        [("no jitter", 0.0, 0.0), ("2 deg", 2.0, 0.0), ("2 deg, 50 m discs", 2.0, 50.0)]
    {
        for n in [2, 5, 10, 100] {
            let problem = problem(n, deg, radius);
            group.bench_function(BenchmarkId::new(name, n), |b| {
                b.iter(|| plan_slot(black_box(&problem), &Options::default()));
            });
        }
    }
    group.finish();
}

/// The certificate of each plan: without jitter to 0.1%, with it to 2%.
fn certificate(c: &mut Criterion) {
    let mut group = c.benchmark_group("certificate");
    group.sample_size(10);
    for (name, deg) in [("no jitter", 0.0), ("2 deg", 2.0)] {
        let problem = problem(2, deg, 0.0);
        let Ok(plan) = plan_slot(&problem, &Options::default()) else { continue };
        group.bench_function(BenchmarkId::new(name, 2), |b| {
            b.iter(|| best_bound(black_box(&problem), plan.secrecy_rate_bps, Budget::of(&problem)));
        });
    }
    group.finish();
}

criterion_group!(benches, objective, planning, certificate);
criterion_main!(benches);
