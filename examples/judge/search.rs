//! Many starts of a plain local search: BFGS on finite differences, then a random walk that takes what is better.
//!
//! Starts are uniform in positions, axes and the logarithm of J's power; half of them have J's null on the user, without
//! which next to none is worth following. Bounded quantities are squared sines of free ones, so that an optimum at a
//! bound is an ordinary one; J's axis is counted from its null on the user, about which everything changes fast. Maxima and
//! minima are soft at first.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::world::{Configuration, Look, World};
use veilwing::planner::problem::Objective;

/// Least P_J over its cap, as a logarithm.
const LEAST_LOG_POWER: f64 = -20.0;
/// Candidates that are followed further, and those that are walked from.
const FOLLOWED: usize = 24;
const REFINED: usize = 3;
const STEPS: [usize; 3] = [25, 60, 30];
const WALK: usize = 400;

fn squeeze(t: f64, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * t.sin().powi(2)
}

fn stretch(x: f64, [low, high]: [f64; 2]) -> f64 {
    ((x - low) / (high - low)).clamp(0.0, 1.0).sqrt().asin()
}

fn configuration(world: &World, t: &DVector<f64>) -> Configuration {
    let area = [-world.half_m, world.half_m];
    let position =
        |at: usize| [squeeze(t[at], area), squeeze(t[at + 1], area), squeeze(t[at + 2], world.altitude_m)];
    let yaw = |at: usize| if world.free_yaw { t[at] } else { 0.0 };
    // J's null on the user, at its own yaw.
    let j = position(5);
    let (sin, cos) = yaw(12).sin_cos();
    let null = along([cos * j[0] + sin * j[1], cos * j[1] - sin * j[0], j[2]]);
    let share = squeeze(t[10], [0.0, 1.0]);
    let j_w = if world.levels_w.is_empty() {
        world.most_w[1] * (LEAST_LOG_POWER * (1.0 - share)).exp()
    } else {
        // None, or one of the levels: a step that the climb does not see and the starts do.
        let level = (share * (world.levels_w.len() + 1) as f64) as usize;
        level.checked_sub(1).map_or(0.0, |level| world.levels_w[level.min(world.levels_w.len() - 1)])
    };
    Configuration {
        position_m: [position(0), j],
        angles_rad: [[t[3], t[4], yaw(11)], [null[0] + t[8], null[1] + t[9], yaw(12)]],
        power_w: [world.most_w[0], j_w],
    }
}

/// What is searched: minus infinity where the vehicles are too near one another.
fn value(world: &World, look: &Look, t: &DVector<f64>) -> f64 {
    let x = configuration(world, t);
    let [i, j] = x.position_m;
    let apart = (0..3).map(|k| (i[k] - j[k]).powi(2)).sum::<f64>().sqrt();
    if apart < world.separation_m { f64::NEG_INFINITY } else { world.value(&x, look) }
}

/// Roll and pitch of the axis along a line from the user, who is at the origin.
fn along(d: [f64; 3]) -> [f64; 2] {
    let up = if d[2] < 0.0 { -1.0 } else { 1.0 };
    [(-up * d[1]).atan2((d[0] * d[0] + d[2] * d[2]).sqrt()), (up * d[0]).atan2(up * d[2])]
}

fn start(world: &World, nulled: bool, rng: &mut ChaCha8Rng) -> DVector<f64> {
    let mut t = DVector::zeros(if world.free_yaw { 13 } else { 11 });
    let turn = std::f64::consts::PI;
    for k in 0..t.len() {
        t[k] = rng.random_range(-turn..turn);
    }
    // Uniform in what is bounded.
    for at in [0, 1, 2, 5, 6, 7, 10] {
        t[at] = stretch(rng.random_range(0.0..1.0), [0.0, 1.0]);
    }
    if nulled {
        (t[8], t[9]) = (0.0, 0.0);
    }
    t
}

fn gradient(world: &World, look: &Look, t: &DVector<f64>) -> DVector<f64> {
    const STEP: f64 = 1e-6;
    let mut at = t.clone();
    DVector::from_fn(t.len(), |k, _| {
        let mut side = |step: f64| {
            at[k] = t[k] + step;
            let value = value(world, look, &at);
            at[k] = t[k];
            value
        };
        (side(STEP) - side(-STEP)) / (2.0 * STEP)
    })
}

/// BFGS with a backtracking line search, upwards.
fn climb(world: &World, look: &Look, start: &DVector<f64>, steps: usize) -> (DVector<f64>, f64) {
    let n = start.len();
    let (mut t, mut best) = (start.clone(), value(world, look, start));
    if !best.is_finite() {
        return (t, best);
    }
    let mut g = gradient(world, look, &t);
    let mut h = DMatrix::<f64>::identity(n, n) * (0.1 / g.norm().max(1e-9));
    for _ in 0..steps {
        let mut d = &h * &g;
        if d.dot(&g) <= 0.0 {
            h = DMatrix::identity(n, n) * (0.1 / g.norm().max(1e-9));
            d = &h * &g;
        }
        let mut length = (1.0f64).min(1.0 / d.norm().max(1e-12));
        let mut moved = None;
        for _ in 0..12 {
            let to = &t + &d * length;
            let there = value(world, look, &to);
            if there > best + 1e-4 * length * d.dot(&g) {
                moved = Some((to, there));
                break;
            }
            length *= 0.4;
        }
        let Some((to, there)) = moved else { break };
        let g_there = gradient(world, look, &to);
        let (s, y) = (&to - &t, &g - &g_there);
        let gained = there - best;
        (t, best, g) = (to, there, g_there);
        let sy = s.dot(&y);
        if sy > 1e-12 {
            let left = DMatrix::identity(n, n) - &s * y.transpose() / sy;
            h = &left * &h * left.transpose() + &s * s.transpose() / sy;
        }
        if gained < 1e-6 {
            break;
        }
    }
    (t, best)
}

/// A random walk that takes what is better, its step growing with success (Rechenberg's fifth).
fn walk(world: &World, look: &Look, from: (DVector<f64>, f64), rng: &mut ChaCha8Rng) -> (DVector<f64>, f64) {
    let (mut t, mut best) = from;
    let mut step = 0.02;
    for _ in 0..WALK {
        let to = t.map(|c| c + step * (rng.random_range(-1.0..1.0) + rng.random_range(-1.0..1.0)));
        let there = value(world, look, &to);
        if there > best {
            (t, best) = (to, there);
            step *= 1.5;
        } else {
            step = (step * 0.9f64).max(1e-6);
        }
    }
    (t, best)
}

/// The best configuration of `starts` local searches.
pub fn best(world: &World, starts: usize, seed: u64) -> Configuration {
    // Noises and draws (for a worst case, points of a rim), the quantile's window and the sharpness, stage by stage.
    let look =
        |counts, window, sharpness, stage| world.look(counts, window, sharpness, seed.wrapping_add(stage));
    let sharp = f64::INFINITY;
    let looks = match world.objective {
        Objective::WorstCase => {
            [look([32, 8], 0.0, 10.0, 1), look([64, 12], 0.0, 60.0, 2), look([256, 16], 0.0, sharp, 3)]
        }
        Objective::Quantile => {
            [look([16, 128], 0.03, 10.0, 1), look([32, 300], 0.02, 60.0, 2), look([32, 1500], 0.01, sharp, 3)]
        }
        _ => [look([64, 1], 0.0, 10.0, 1), look([512, 1], 0.0, 100.0, 2), look([2048, 1], 0.0, sharp, 3)],
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut ends: Vec<_> = (0..starts)
        .map(|k| {
            let start = start(world, k % 2 == 0, &mut rng);
            climb(world, &looks[0], &start, STEPS[0])
        })
        .collect();
    for (stage, kept) in [(1, FOLLOWED), (2, REFINED)] {
        ends.sort_by(|a, b| b.1.total_cmp(&a.1));
        ends.truncate(kept);
        for end in &mut ends {
            *end = climb(world, &looks[stage], &end.0, STEPS[stage]);
            if stage == 2 {
                *end = walk(world, &looks[stage], end.clone(), &mut rng);
                *end = climb(world, &looks[stage], &end.0, STEPS[stage]);
            }
        }
    }
    ends.sort_by(|a, b| b.1.total_cmp(&a.1));
    configuration(world, &ends[0].0)
}
