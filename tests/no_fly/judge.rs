//! The planner beside areas, against a judge of another road.

use nalgebra::{Vector2, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::config::{METHODS, Optimise};
use veilwing::planner::problem::{NoFly, Objective, Problem, Uncertainty};
use veilwing::planner::{Options, plan_slot};
use veilwing::planning;
use veilwing::role::Role;

use crate::{obstructed, poses};

/// The paper's rate without jitter, stated again: J's null on the user, so that all its power is free.
struct Judge<'a> {
    problem: &'a Problem,
    rng: ChaCha8Rng,
}

impl Judge<'_> {
    /// Bit/s/Hz of I at `x[..3]` with its axis by the angles `x[3..5]`, and J at `x[5..]`; `None` where that is forbidden.
    fn rate(&self, x: &[f64; 8]) -> Option<f64> {
        let air = &self.problem.airspace;
        let (i, j) = (Vector3::new(x[0], x[1], x[2]), Vector3::new(x[5], x[6], x[7]));
        for at in [&i, &j] {
            let [low, high] = air.altitude_m;
            let outside = at.x.abs() > 500.0 || at.y.abs() > 500.0 || at.z < low || at.z > high;
            if outside || air.no_fly.iter().any(|area| Self::is_inside(area, at)) {
                return None;
            }
        }
        let (sin, cos) = x[3].sin_cos();
        let axis = Vector3::new(sin * x[4].cos(), sin * x[4].sin(), cos);
        let user = self.problem.user_enu_m;
        let null = (j - user).normalize();
        let gain = |at: &Vector3<f64>, axis: &Vector3<f64>, node: &Vector3<f64>| {
            let d = node - at;
            let along = d.normalize().dot(axis);
            (1.0 - along * along) / d.norm_squared()
        };
        let radio = &self.problem.radio;
        let sinr = |node: &Vector3<f64>| {
            let jam = radio.max_power_w.j * gain(&j, &null, node);
            radio.max_power_w.i * gain(&i, &axis, node) / (jam + radio.noise_power_w)
        };
        let heard = self.problem.eavesdroppers.iter().map(|e| sinr(&e.position_enu_m)).fold(0.0, f64::max);
        Some(sinr(&user).ln_1p() / 2f64.ln() - heard.ln_1p() / 2f64.ln())
    }

    /// By the sides that a ray to the east crosses.
    fn is_inside(area: &NoFly, at: &Vector3<f64>) -> bool {
        let n = area.area_enu_m.len();
        let crossed = (0..n).filter(|k| {
            let (a, b) = (area.area_enu_m[*k], area.area_enu_m[(k + 1) % n]);
            (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
        });
        let [floor, ceiling] = area.heights_m();
        crossed.count() % 2 == 1 && floor < at.z && at.z < ceiling
    }

    /// Many random starts over all there is, each improved by random steps that shrink while they fail; whatever is forbidden
    /// is thrown away.
    fn best(&mut self, starts: usize, steps: usize) -> f64 {
        let mut best = f64::NEG_INFINITY;
        let [low, high] = self.problem.airspace.altitude_m;
        for start in 0..starts {
            let reach = [500.0, 120.0, 40.0][start % 3];
            let (mut x, mut value) = loop {
                let user = self.problem.user_enu_m;
                let node =
                    self.problem.eavesdroppers[start % self.problem.eavesdroppers.len()].position_enu_m;
                let mut about = |c: f64| (c + self.rng.random_range(-reach..reach)).clamp(-500.0, 500.0);
                let (ie, in_, je, jn) = (about(user.x), about(user.y), about(node.x), about(node.y));
                let x = [
                    ie,
                    in_,
                    low + (high - low) * self.rng.random::<f64>().powi(3),
                    self.rng.random_range(0.0..std::f64::consts::PI),
                    self.rng.random_range(0.0..std::f64::consts::TAU),
                    je,
                    jn,
                    low + (high - low) * self.rng.random::<f64>().powi(3),
                ];
                if let Some(value) = self.rate(&x) {
                    break (x, value);
                }
            };
            let mut size = 1.0;
            for _ in 0..steps {
                let mut other = x;
                // Some of the variables at a time: along a face the others stay.
                let all = self.rng.random_bool(0.3);
                let one = self.rng.random_range(0..8);
                for (k, c) in other.iter_mut().enumerate() {
                    let unit = if k == 3 || k == 4 { 1.0 } else { 60.0 };
                    if all || k == one || self.rng.random_bool(0.15) {
                        *c += unit * size * self.rng.random_range(-1.0..1.0);
                    }
                }
                // Walls of the band are walked along.
                other[2] = other[2].clamp(low, high);
                other[7] = other[7].clamp(low, high);
                match self.rate(&other).filter(|found| *found > value) {
                    Some(found) => (x, value, size) = (other, found, f64::min(1.0, size * 1.6)),
                    None => size = f64::max(1e-7, size * 0.97),
                }
            }
            best = best.max(value);
        }
        best
    }
}

/// A problem of the paper's kind with areas where its plan without them has the vehicles.
fn hindered(seed: u64) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let nodes: Vec<[f64; 2]> = (0..2 + seed as usize % 3)
        .map(|_| [rng.random_range(-250.0..250.0), rng.random_range(-250.0..250.0)])
        .collect();
    let mut problem = Problem::paper(nodes, 0.5, 0.0);
    let ideal = plan_slot(&problem, &Options::default()).unwrap().vehicles;
    for (k, vehicle) in [ideal.i, ideal.j].into_iter().enumerate() {
        let at = vehicle.pose.position_enu_m;
        let mut side = || rng.random_range(8.0..60.0);
        let (west, east, south, north) = (side(), side(), side(), side());
        // An L for one of them.
        let corners = if (seed as usize + k).is_multiple_of(2) {
            vec![[-west, -south], [east, -south], [east, north], [-west, north]]
        } else {
            vec![
                [-west, -south],
                [2.0 * east, -south],
                [2.0 * east, 4.0],
                [4.0, 4.0],
                [4.0, 2.0 * north],
                [-west, 2.0 * north],
            ]
        };
        problem.airspace.no_fly.push(NoFly {
            name: format!("area {k}"),
            area_enu_m: corners.into_iter().map(|c| at.xy() + Vector2::from(c)).collect(),
            floor_m: None,
            ceiling_m: seed.is_multiple_of(2).then_some(at.z + 5.0 + 8.0 * (seed % 5) as f64),
        });
    }
    problem
}

#[test]
fn val_the_plan_beside_areas_is_as_good_as_that_of_a_dense_search_that_throws_away_what_is_forbidden() {
    let mut weakest = f64::INFINITY;
    for seed in 0..8 {
        let problem = hindered(seed);
        let plan = plan_slot(&problem, &Options::default()).unwrap();
        for role in Role::BOTH {
            let at = plan.vehicles[role].pose.position_enu_m;
            assert!(
                problem.airspace.no_fly.iter().all(|area| !Judge::is_inside(area, &at)),
                "{seed} {role} {at}"
            );
        }
        let planned = plan.secrecy_rate_bps / problem.radio.bandwidth_hz;
        let mut judge = Judge { problem: &problem, rng: ChaCha8Rng::seed_from_u64(1000 + seed) };
        let judged = judge.best(90, 6000);
        println!("{seed}: planned {planned:.4}, judged {judged:.4} bit/s/Hz");
        assert!(judged - planned <= 0.05, "{seed}: planned {planned}, judged {judged}");
        weakest = weakest.min(judged - planned);
    }
    // A judge that finds nothing judges nothing.
    assert!(weakest > -0.3, "the judge's search is too weak: {weakest}");
}

#[test]
fn spec_every_method_every_objective_and_a_plan_for_volume_keep_out_of_the_areas() {
    let keeps_out = |problem: &Problem, options: &Options, what: &str| {
        let plan = plan_slot(problem, options).unwrap();
        for role in Role::BOTH {
            let at = plan.vehicles[role].pose.position_enu_m;
            let areas = &problem.airspace.no_fly;
            assert!(areas.iter().all(|area| !Judge::is_inside(area, &at)), "{what} {role} {at}");
        }
    };
    for seed in [1, 2] {
        let problem = hindered(seed);
        for (name, method) in METHODS {
            keeps_out(&problem, &Options { method: *method, ..Options::default() }, name);
        }
        let mut jittered = problem.clone();
        jittered.jitter.std_rad = 2f64.to_radians();
        keeps_out(&jittered, &Options::default(), "under jitter");
        for eavesdropper in &mut jittered.eavesdroppers {
            eavesdropper.uncertainty = Uncertainty::Disc { radius_m: 20.0 };
        }
        jittered.objective = Objective::WorstCase;
        keeps_out(&jittered, &Options::default(), "in the worst case");
    }
    let (mission, ..) = obstructed();
    let volume = mission.changed(|draft| draft.planner.optimise = Optimise::Volume).unwrap();
    let plan = planning::plan(&volume).unwrap();
    for role in Role::BOTH {
        for at in poses(&plan, role) {
            assert!(volume.airspace.no_fly.iter().all(|area| area.depth_m(&at) == 0.0), "{role} {at}");
        }
    }
}
