//! The judge: many random starts of a plain local search over a whole superframe.
//!
//! Positions are drawn anywhere, one for all users or one for each; each user's axes and power are the best of a few random
//! ones there. BFGS on finite differences takes it from there, over all variables. The plan under judgement is tried to be
//! improved as well, by the same search from nearby. Bounded quantities are squared sines of free ones.

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::volume::{Fairness, Ways};
use veilwing::role::Role;
use veilwing::schedule::transit::Router;

use crate::mission::{Superframe, limits};
use crate::world::{Configuration, Look, World};

const LEAST_LOG_POWER: f64 = -20.0;
/// Draws of axes and power for each user of a start.
const DRAWS: usize = 60;
const KEPT: usize = 6;
const STEPS: [usize; 2] = [20, 60];
/// Variables of a user beside the positions: I's and J's axis, J's power.
const OWN: usize = 5;

pub struct Judge<'a> {
    mission: &'a Superframe,
    worlds: Vec<World>,
    router: &'a Router,
    looks: [Vec<Look>; 2],
    /// Whether users at one place follow each other as soon as the guard has passed and both have turned.
    turning: bool,
    /// Of either vehicle.
    turn_rate_rad_s: f64,
}

fn squeeze(t: f64, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * t.sin().powi(2)
}

fn stretch(x: f64, [low, high]: [f64; 2]) -> f64 {
    ((x - low) / (high - low)).clamp(0.0, 1.0).sqrt().asin()
}

/// Rest to rest over a distance: up to a speed and down again, acceleration and its change limited.
fn ride_s(distance: f64, speed: f64) -> f64 {
    let (a, j) = (limits().i.acceleration_m_s2, limits().i.jerk_m_s3.unwrap());
    let ramp = |v: f64| if v * j > a * a { v / a + a / j } else { 2.0 * (v / j).sqrt() };
    if speed * ramp(speed) <= distance {
        return ramp(speed) + distance / speed;
    }
    // The peak that two ramps just reach, by bisection.
    let (mut low, mut high) = (0.0, speed);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if middle * ramp(middle) < distance { low = middle } else { high = middle }
    }
    2.0 * ramp(high)
}

/// The angle between two attitudes, by the trace of the rotation between them.
pub fn turn_rad(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let matrix =
        |[roll, pitch, yaw]: &[f64; 3]| *nalgebra::Rotation3::from_euler_angles(*roll, *pitch, *yaw).matrix();
    let trace = (matrix(a).transpose() * matrix(b)).trace();
    (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos()
}

/// The same antenna within a quarter turn.
fn canonical([roll, pitch]: [f64; 2]) -> [f64; 3] {
    let axis = [roll.cos() * pitch.sin(), -roll.sin(), roll.cos() * pitch.cos()];
    let [roll, pitch] = along(axis);
    [roll, pitch, 0.0]
}

/// Roll and pitch of an axis along a line.
fn along(d: [f64; 3]) -> [f64; 2] {
    let up = if d[2] < 0.0 { -1.0 } else { 1.0 };
    [(-up * d[1]).atan2(d[0].hypot(d[2])), (up * d[0]).atan2(up * d[2])]
}

fn transit_s(a: &Configuration, b: &Configuration, turn_rate_rad_s: f64) -> f64 {
    let limits = limits().i;
    (0..2)
        .map(|v| {
            let d: Vec<f64> = (0..3).map(|k| b.position_m[v][k] - a.position_m[v][k]).collect();
            let (level, all) = (d[0].hypot(d[1]), (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt());
            let ride = if all > 1e-9 {
                ride_s(all, (limits.speed_m_s * all / level).min(limits.climb_m_s * all / d[2].abs()))
            } else {
                0.0
            };
            ride.max(turn_rad(&a.angles_rad[v], &b.angles_rad[v]) / turn_rate_rad_s)
        })
        .fold(0.0, f64::max)
}

impl<'a> Judge<'a> {
    pub fn new(mission: &'a Superframe, router: &'a Router) -> Self {
        let worlds: Vec<World> = mission.problems.iter().map(World::new).collect();
        let look = |noises: usize, stage: u64| {
            worlds
                .iter()
                .enumerate()
                .map(|(k, world)| world.look([noises, 1], 0.0, f64::INFINITY, 77 * stage + k as u64))
                .collect()
        };
        let looks = [look(96, 1), look(1024, 2)];
        let turn_rate_rad_s = router.turn_rate_rad_s(Role::I);
        Self { mission, looks, worlds, router, turning: false, turn_rate_rad_s }
    }

    /// A judge of plans whose turns at one place cost no more than the guard or the turn.
    #[allow(dead_code)]
    pub fn of_turning(mission: &'a Superframe, router: &'a Router) -> Self {
        Self { turning: true, ..Self::new(mission, router) }
    }

    /// What lies between two slots beside the guard.
    fn between_s(&self, a: &Configuration, b: &Configuration) -> f64 {
        let service = &self.mission.service;
        let transit_s = transit_s(a, b, self.turn_rate_rad_s);
        if self.turning && a.position_m == b.position_m {
            (transit_s - service.guard_s).max(0.0)
        } else {
            transit_s + service.settle_s
        }
    }

    pub fn order(&self, xs: &[Configuration]) -> Vec<usize> {
        let n = xs.len();
        if !self.mission.service.may_reorder || n < 4 {
            return (0..n).collect();
        }
        let between: Vec<f64> = xs.iter().flat_map(|a| xs.iter().map(|b| self.between_s(a, b))).collect();
        self.router.shortest(n, &between)
    }

    /// The volume that counts for each second of the superframe.
    fn worth(&self, rates: &[f64], xs: &[Configuration], order: &[usize]) -> f64 {
        let service = &self.mission.service;
        let n = xs.len();
        let fixed: f64 = (0..n).map(|k| self.between_s(&xs[order[k]], &xs[order[(k + 1) % n]])).sum();
        match service.fairness {
            Fairness::Slots => {
                (service.slot_s - service.guard_s) * rates.iter().sum::<f64>()
                    / (n as f64 * service.slot_s + fixed)
            }
            Fairness::MaxMin => {
                // The largest least volume, by bisection over it.
                let [shortest, longest] = service.slot_limits_s;
                let least = rates.iter().copied().fold(f64::INFINITY, f64::min).max(1e-9);
                let sum = |m: f64| -> f64 {
                    rates.iter().map(|r| (service.guard_s + m / r.max(1e-9)).max(shortest)).sum()
                };
                let (mut low, mut high) = (0.0, (longest - service.guard_s) * least);
                if sum(high) <= n as f64 * service.slot_s {
                    return high / (sum(high) + fixed);
                }
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if sum(middle) <= n as f64 * service.slot_s { low = middle } else { high = middle }
                }
                low / (sum(low) + fixed)
            }
        }
    }

    /// By fresh draws.
    pub fn score(&self, xs: &[Configuration], draws: usize, seed: u64) -> f64 {
        let rates: Vec<f64> =
            xs.iter().zip(&self.worlds).map(|(x, world)| world.score(x, draws, seed)).collect();
        self.worth(&rates, xs, &self.order(xs))
    }

    fn positions(&self, t: &[f64]) -> [[f64; 3]; 2] {
        let world = &self.worlds[0];
        let area = [-world.half_m, world.half_m];
        [0, 3].map(|at: usize| {
            [squeeze(t[at], area), squeeze(t[at + 1], area), squeeze(t[at + 2], world.altitude_m)]
        })
    }

    fn configuration(&self, user: usize, places: &[f64], own: &[f64]) -> Configuration {
        let [i, j] = self.positions(places);
        let node = self.mission.problems[user].user_enu_m;
        let null = along([j[0] - node.x, j[1] - node.y, j[2] - node.z]);
        let power = (LEAST_LOG_POWER * (1.0 - squeeze(own[4], [0.0, 1.0]))).exp();
        let most_w = self.worlds[user].most_w;
        Configuration {
            position_m: [i, j],
            angles_rad: [canonical([own[0], own[1]]), canonical([null[0] + own[2], null[1] + own[3]])],
            power_w: [most_w[0], most_w[1] * power],
        }
    }

    /// Variables: one pair of positions, or one for each user, then each user's own.
    fn configurations(&self, t: &DVector<f64>) -> Vec<Configuration> {
        let n = self.worlds.len();
        let t = t.as_slice();
        let pairs = (t.len() - OWN * n) / 6;
        (0..n)
            .map(|user| {
                let places = if pairs == 1 { &t[..6] } else { &t[6 * user..6 * user + 6] };
                let at = 6 * pairs + OWN * user;
                self.configuration(user, places, &t[at..at + OWN])
            })
            .collect()
    }

    fn rate(&self, user: usize, x: &Configuration, stage: usize) -> f64 {
        let [i, j] = x.position_m;
        let apart = (0..3).map(|k| (i[k] - j[k]).powi(2)).sum::<f64>().sqrt();
        if apart < self.worlds[user].separation_m {
            return f64::NEG_INFINITY;
        }
        self.worlds[user].value(x, &self.looks[stage][user])
    }

    fn value(&self, t: &DVector<f64>, order: &[usize], stage: usize) -> f64 {
        let xs = self.configurations(t);
        let rates: Vec<f64> = xs.iter().enumerate().map(|(user, x)| self.rate(user, x, stage)).collect();
        self.worth(&rates, &xs, order)
    }

    /// Central differences; of a user's own variables only that user's rate changes.
    fn gradient(&self, t: &DVector<f64>, order: &[usize], stage: usize) -> DVector<f64> {
        const STEP: f64 = 1e-5;
        let n = self.worlds.len();
        let pairs = (t.len() - OWN * n) / 6;
        let xs = self.configurations(t);
        let rates: Vec<f64> = xs.iter().enumerate().map(|(user, x)| self.rate(user, x, stage)).collect();
        let mut at = t.clone();
        DVector::from_fn(t.len(), |k, _| {
            let touched = if k >= 6 * pairs {
                Some((k - 6 * pairs) / OWN)
            } else if pairs > 1 {
                Some(k / 6)
            } else {
                None
            };
            let mut side = |step: f64| {
                at[k] = t[k] + step;
                let xs = self.configurations(&at);
                at[k] = t[k];
                let mut rates = rates.clone();
                for (user, x) in xs.iter().enumerate().filter(|(user, _)| touched.is_none_or(|t| t == *user))
                {
                    rates[user] = self.rate(user, x, stage);
                }
                self.worth(&rates, &xs, order)
            };
            (side(STEP) - side(-STEP)) / (2.0 * STEP)
        })
    }

    /// BFGS with a backtracking line search, upwards.
    fn climb(&self, start: &DVector<f64>, stage: usize, steps: usize) -> (DVector<f64>, f64) {
        let n = start.len();
        let order = self.order(&self.configurations(start));
        let (mut t, mut best) = (start.clone(), self.value(start, &order, stage));
        if !best.is_finite() {
            return (t, best);
        }
        let mut g = self.gradient(&t, &order, stage);
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
                let there = self.value(&to, &order, stage);
                if there > best + 1e-4 * length * d.dot(&g) {
                    moved = Some((to, there));
                    break;
                }
                length *= 0.4;
            }
            let Some((to, there)) = moved else { break };
            let g_there = self.gradient(&to, &order, stage);
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

    /// A random start: one pair of positions for all, or one for each.
    fn start(&self, shared: bool, rng: &mut ChaCha8Rng) -> DVector<f64> {
        let n = self.worlds.len();
        let pairs = if shared { 1 } else { n };
        let mut t = Vec::new();
        for _ in 0..6 * pairs {
            t.push(stretch(rng.random_range(0.0..1.0), [0.0, 1.0]));
        }
        for user in 0..n {
            let places = if shared { t[..6].to_vec() } else { t[6 * user..6 * user + 6].to_vec() };
            let mut best: Option<(f64, Vec<f64>)> = None;
            for _ in 0..DRAWS {
                let own = vec![
                    rng.random_range(-PI / 2.0..PI / 2.0),
                    rng.random_range(-PI / 2.0..PI / 2.0),
                    0.0,
                    0.0,
                    stretch(rng.random_range(0.4..1.0), [0.0, 1.0]),
                ];
                let rate = self.rate(user, &self.configuration(user, &places, &own), 0);
                if best.as_ref().is_none_or(|(known, _)| rate > *known) {
                    best = Some((rate, own));
                }
            }
            t.extend(best.unwrap().1);
        }
        DVector::from_vec(t)
    }

    /// The variables of given configurations, each with positions of its own or, if they are the same, shared ones.
    fn encode(&self, xs: &[Configuration]) -> DVector<f64> {
        let world = &self.worlds[0];
        let area = [-world.half_m, world.half_m];
        let shared = xs.iter().all(|x| x.position_m == xs[0].position_m);
        let mut t = Vec::new();
        for x in &xs[..if shared { 1 } else { xs.len() }] {
            for [e, n, u] in x.position_m {
                t.extend([stretch(e, area), stretch(n, area), stretch(u, world.altitude_m)]);
            }
        }
        for (user, x) in xs.iter().enumerate() {
            let ([i, j], node) = (x.angles_rad, self.mission.problems[user].user_enu_m);
            let p = x.position_m[1];
            let null = along([p[0] - node.x, p[1] - node.y, p[2] - node.z]);
            let share = 1.0 - (x.power_w[1] / world.most_w[1]).max(1e-9).ln() / LEAST_LOG_POWER;
            t.extend([i[0], i[1], j[0] - null[0], j[1] - null[1], stretch(share, [0.0, 1.0])]);
        }
        DVector::from_vec(t)
    }

    /// The best configurations of `starts` local searches, and of some from near `ours`.
    pub fn best(&self, ours: &[Configuration], starts: usize, seed: u64) -> Vec<Configuration> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut ends: Vec<_> =
            (0..starts).map(|k| self.climb(&self.start(k % 3 != 2, &mut rng), 0, STEPS[0])).collect();
        ends.sort_by(|a, b| b.1.total_cmp(&a.1));
        ends.truncate(KEPT);
        let near = self.encode(ours);
        for size in [0.0, 0.02, 0.1] {
            ends.push((near.map(|c| c + size * rng.random_range(-1.0..1.0)), 0.0));
        }
        let mut ends: Vec<_> = ends.iter().map(|(t, _)| self.climb(t, 1, STEPS[1])).collect();
        ends.sort_by(|a, b| b.1.total_cmp(&a.1));
        self.configurations(&ends[0].0)
    }
}
