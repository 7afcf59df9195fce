//! `cargo bench --no-default-features --bench planner`: the objective with its gradient per sample count, planning times by
//! number of eavesdroppers, and the certificate, on one thread.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use veilwing::planner::bound::{Budget, best_bound};
use veilwing::planner::expectation::kernel::{Raw, Scene, Workspace};
use veilwing::planner::expectation::samples::{Samples, Sequence};
use veilwing::planner::problem::{Problem, Uncertainty};
use veilwing::planner::{Options, plan_slot};

/// Eavesdroppers on a spiral about the user: any number, none alike.
fn problem(n: usize, jitter_deg: f64, radius_m: f64) -> Problem {
    let node = |k: usize| {
        let (angle, distance) = (2.4 * k as f64 + 0.3, 120.0 + 350.0 * (k as f64 * 0.618).fract());
        [distance * angle.cos(), distance * angle.sin()]
    };
    let mut problem = Problem::paper((0..n).map(node), 0.5, jitter_deg.to_radians());
    problem.airspace.min_separation_m = 5.0;
    if radius_m > 0.0 {
        for eavesdropper in &mut problem.eavesdroppers {
            eavesdropper.uncertainty = Uncertainty::Disc { radius_m };
        }
    }
    problem
}

fn objective(c: &mut Criterion) {
    let mut group = c.benchmark_group("objective and gradient");
    let raw: Raw = [5.0, 3.0, 80.0, 0.8, -0.3, 0.0, 0.5, 90.0, -210.0, 80.0, 1.1, 0.8, 0.0, 0.006];
    for n in [2, 10, 100] {
        let problem = problem(n, 2.0, 0.0);
        for count in [64, 512, 2048] {
            let samples = Samples::new(&problem, count, 1, 1, Sequence::Sobol);
            let scene = Scene::of(&problem);
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
