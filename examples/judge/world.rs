//! The rate, stated again from the paper: axis (1.1), dipole (1.4), SINR (1.5), secrecy rate (1.6), Gaussian noise on roll
//! and pitch, eavesdroppers somewhere in a disc or by a Gaussian. Rates in bit/s/Hz.

use std::f64::consts::{LN_2, TAU};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::problem::{Objective, Problem, Uncertainty};
use veilwing::role::PerVehicle;

type Point = [f64; 3];

/// The quantile that is asked for.
const SHARE: f64 = 0.05;

/// Positions, angles (roll, pitch, yaw) and powers in W of I and J.
#[derive(Debug, Clone, Copy)]
pub struct Configuration {
    pub position_m: [Point; 2],
    pub angles_rad: [Point; 2],
    pub power_w: [f64; 2],
}

impl Configuration {
    pub fn of(vehicles: &PerVehicle<VehiclePlan>) -> Self {
        let each = [&vehicles.i, &vehicles.j];
        Self {
            position_m: each.map(|v| v.pose.position_enu_m.into()),
            angles_rad: each.map(|v| [v.pose.roll_rad, v.pose.pitch_rad, v.pose.yaw_rad]),
            power_w: each.map(|v| v.tx_power_w),
        }
    }
}

/// What a mission says, in this model's terms.
#[derive(Debug, Clone)]
pub struct World {
    user: Point,
    nodes: Vec<Point>,
    spread: Vec<Uncertainty>,
    /// `b0 / s^2`, per W.
    budget: f64,
    std_rad: f64,
    pub most_w: [f64; 2],
    pub half_m: f64,
    pub altitude_m: [f64; 2],
    pub separation_m: f64,
    pub free_yaw: bool,
    pub objective: Objective,
}

/// Noise of both attitudes: roll and pitch of I, then of J.
pub type Noise = Vec<[f64; 4]>;

/// What a search looks at: noise, and draws or trial points of each eavesdropper's position.
#[derive(Debug, Clone)]
pub struct Look {
    noise: Noise,
    /// Of each draw all positions (mean, quantile); empty for a worst case.
    draws: Vec<Vec<Point>>,
    /// Of each eavesdropper the points of its disc (worst case).
    points: Vec<Vec<Point>>,
    /// Half the width in rank of the window that stands for the quantile.
    window: f64,
    /// Sharpness of soft maxima and minima, per bit/s/Hz; infinite for true ones.
    sharpness: f64,
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let u: f64 = 1.0 - rng.random_range(0.0..1.0);
    (-2.0 * u.ln()).sqrt() * (TAU * rng.random_range(0.0..1.0)).cos()
}

/// (1.1): the third column of Rz(yaw) Ry(pitch) Rx(roll).
fn axis(roll: f64, pitch: f64, yaw: f64) -> Point {
    let level = [roll.cos() * pitch.sin(), -roll.sin(), roll.cos() * pitch.cos()];
    let (s, c) = yaw.sin_cos();
    [c * level[0] - s * level[1], s * level[0] + c * level[1], level[2]]
}

/// Unit vector from `from` to `to`, and the distance squared.
fn line(from: &Point, to: &Point) -> (Point, f64) {
    let d = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
    let square = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).max(1e-6);
    (d.map(|c| c / square.sqrt()), square)
}

/// Both antennas under every noise, ready to be heard anywhere.
struct Antennas<'a> {
    x: &'a Configuration,
    budget: f64,
    axes: Vec<[Point; 2]>,
}

impl Antennas<'_> {
    /// 1 + SINR at `node` under every noise.
    fn heard(&self, node: &Point, out: &mut Vec<f64>) {
        let far = [0, 1].map(|v: usize| line(node, &self.x.position_m[v]));
        let strength = [0, 1].map(|v: usize| self.budget * self.x.power_w[v] / far[v].1);
        out.clear();
        out.extend(self.axes.iter().map(|axes| {
            let received = |v: usize| {
                let (u, y) = (&far[v].0, &axes[v]);
                let cosine = u[0] * y[0] + u[1] * y[1] + u[2] * y[2];
                strength[v] * (1.0 - cosine * cosine).max(0.0)
            };
            1.0 + received(0) / (1.0 + received(1))
        }));
    }
}

/// Mean of `log2 max(1, user / strongest)`.
fn mean_rate(user: &[f64], strongest: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (users, others) in user.chunks(8).zip(strongest.chunks(8)) {
        sum += users.iter().zip(others).map(|(u, o)| (u / o).max(1.0)).product::<f64>().ln();
    }
    sum / (user.len() as f64 * LN_2)
}

/// The least of some rates, softened by a sum of exponentials unless the sharpness is infinite.
fn soft_minimum(rates: &[f64], sharpness: f64) -> f64 {
    let least = rates.iter().copied().fold(f64::INFINITY, f64::min);
    if sharpness.is_infinite() {
        return least;
    }
    let sum: f64 = rates.iter().map(|rate| (-sharpness * (rate - least)).exp()).sum();
    least - sum.ln() / sharpness
}

fn join(strongest: &mut [f64], other: &[f64]) {
    for (s, o) in strongest.iter_mut().zip(other) {
        *s = s.max(*o);
    }
}

impl World {
    pub fn new(problem: &Problem) -> Self {
        Self {
            user: problem.user_enu_m.into(),
            nodes: problem.eavesdroppers.iter().map(|e| e.position_enu_m.into()).collect(),
            spread: problem.eavesdroppers.iter().map(|e| e.uncertainty).collect(),
            budget: problem.radio.reference_gain / problem.radio.noise_power_w,
            std_rad: problem.jitter.std_rad,
            most_w: [problem.radio.max_power_w.i, problem.radio.max_power_w.j],
            half_m: problem.airspace.area_enu_m.iter().map(|v| v.x.abs()).fold(0.0, f64::max),
            altitude_m: problem.airspace.altitude_m,
            separation_m: problem.airspace.min_separation_m,
            free_yaw: problem.free_yaw,
            objective: problem.objective,
        }
    }

    fn noise(&self, count: usize, rng: &mut ChaCha8Rng) -> Noise {
        let count = if self.std_rad > 0.0 { count } else { 1 };
        (0..count).map(|_| [0; 4].map(|_| self.std_rad * normal(rng))).collect()
    }

    /// A draw of an eavesdropper's position; for a worst case as often on the rim of where it may be.
    fn place(&self, node: usize, rim: bool, rng: &mut ChaCha8Rng) -> Point {
        let centre = self.nodes[node];
        let at = |radius: f64, angle: f64| {
            [centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin(), centre[2]]
        };
        let angle = rng.random_range(0.0..TAU);
        match self.spread[node] {
            Uncertainty::None => centre,
            Uncertainty::Disc { radius_m } if rim => at(radius_m, angle),
            Uncertainty::Disc { radius_m } => at(radius_m * rng.random_range(0.0f64..1.0).sqrt(), angle),
            Uncertainty::Gaussian { std_m } => {
                let (x, y) = (std_m * normal(rng), std_m * normal(rng));
                [centre[0] + x, centre[1] + y, centre[2]]
            }
        }
    }

    /// A look of so many noises and draws (worst case: points of each disc).
    pub fn look(&self, [noises, draws]: [usize; 2], window: f64, sharpness: f64, seed: u64) -> Look {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let noise = self.noise(noises, &mut rng);
        let nodes = 0..self.nodes.len();
        if self.objective == Objective::WorstCase {
            let points = nodes.map(|node| self.disc(node, draws)).collect();
            return Look { noise, draws: Vec::new(), points, window, sharpness };
        }
        let certain = self.spread.iter().all(|s| *s == Uncertainty::None);
        let draws = if certain { 1 } else { draws };
        let draw = |rng: &mut ChaCha8Rng| nodes.clone().map(|node| self.place(node, false, rng)).collect();
        let draws = (0..draws).map(|_| draw(&mut rng)).collect();
        Look { noise, draws, points: Vec::new(), window, sharpness }
    }

    /// The centre of a disc, `count` points of its rim and half as many at half its radius.
    fn disc(&self, node: usize, count: usize) -> Vec<Point> {
        let centre = self.nodes[node];
        let Uncertainty::Disc { radius_m } = self.spread[node] else { return vec![centre] };
        let ring = |radius: f64, count: usize| {
            (0..count).map(move |k| {
                let angle = TAU * k as f64 / count as f64;
                [centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin(), centre[2]]
            })
        };
        std::iter::once(centre).chain(ring(radius_m, count)).chain(ring(0.5 * radius_m, count / 2)).collect()
    }

    fn antennas<'a>(&self, x: &'a Configuration, noise: &[[f64; 4]]) -> Antennas<'a> {
        let angles = &x.angles_rad;
        let axes = noise
            .iter()
            .map(|n| {
                [0, 1]
                    .map(|v: usize| axis(angles[v][0] + n[2 * v], angles[v][1] + n[2 * v + 1], angles[v][2]))
            })
            .collect();
        Antennas { x, budget: self.budget, axes }
    }

    /// The objective of a configuration as a look sees it.
    pub fn value(&self, x: &Configuration, look: &Look) -> f64 {
        let antennas = self.antennas(x, &look.noise);
        let mut user = Vec::new();
        antennas.heard(&self.user, &mut user);
        if self.objective == Objective::WorstCase {
            return self.worst(&antennas, &user, look.sharpness, |node| look.points[node].clone());
        }
        let mut rates = self.rates(&antennas, &user, look);
        if self.objective != Objective::Quantile {
            return rates.iter().sum::<f64>() / rates.len() as f64;
        }
        rates.sort_by(f64::total_cmp);
        let rank = |share: f64| ((share * rates.len() as f64) as usize).min(rates.len() - 1);
        let window = &rates[rank(SHARE - look.window)..=rank(SHARE + look.window)];
        window.iter().sum::<f64>() / window.len() as f64
    }

    fn rates(&self, antennas: &Antennas, user: &[f64], look: &Look) -> Vec<f64> {
        let (mut heard, mut strongest) = (Vec::new(), Vec::new());
        let rate = |draw: &Vec<Point>| {
            strongest.clear();
            strongest.resize(user.len(), 1.0);
            let mut single = Vec::new();
            for node in draw {
                antennas.heard(node, &mut heard);
                join(&mut strongest, &heard);
                single.push(-heard[0].log2());
            }
            // Without noise the maximum is a kink, unless it is softened.
            if user.len() == 1 && look.sharpness.is_finite() {
                return (user[0].log2() + soft_minimum(&single, look.sharpness)).max(0.0);
            }
            mean_rate(user, &strongest)
        };
        look.draws.iter().map(rate).collect()
    }

    /// The least mean rate over the points of each eavesdropper's disc, node by node, twice round; softly over all points
    /// of the second.
    fn worst(
        &self,
        antennas: &Antennas,
        user: &[f64],
        sharpness: f64,
        mut points: impl FnMut(usize) -> Vec<Point>,
    ) -> f64 {
        let count = self.nodes.len();
        let mut chosen = vec![vec![1.0; user.len()]; count];
        let (mut rates, mut heard) = (Vec::new(), Vec::new());
        for _ in 0..2 {
            rates.clear();
            for node in 0..count {
                let mut others = vec![1.0; user.len()];
                (0..count).filter(|o| *o != node).for_each(|o| join(&mut others, &chosen[o]));
                let mut worst = f64::INFINITY;
                for point in points(node) {
                    antennas.heard(&point, &mut heard);
                    let own = heard.clone();
                    join(&mut heard, &others);
                    let rate = mean_rate(user, &heard);
                    rates.push(rate);
                    if rate < worst {
                        worst = rate;
                        chosen[node] = own;
                    }
                }
            }
        }
        soft_minimum(&rates, sharpness)
    }

    /// The objective on fresh draws of everything: `draws` of the positions.
    pub fn score(&self, x: &Configuration, draws: usize, seed: u64) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        if self.objective != Objective::WorstCase {
            let certain = self.spread.iter().all(|s| *s == Uncertainty::None);
            let noises = if certain { draws } else { 128 };
            return self.value(x, &self.look([noises, draws], 0.0, f64::INFINITY, seed));
        }
        let noise = self.noise(1024, &mut rng);
        let antennas = self.antennas(x, &noise);
        let mut user = Vec::new();
        antennas.heard(&self.user, &mut user);
        let each = draws / (2 * self.nodes.len());
        let fresh = |node| (0..each).map(|k| self.place(node, k % 4 != 0, &mut rng)).collect();
        self.worst(&antennas, &user, f64::INFINITY, fresh)
    }
}
