//! The rate, stated again from the paper: axis (1.1), dipole (1.4), SINR (1.5), secrecy rate (1.6), Gaussian noise on roll
//! and pitch, eavesdroppers somewhere in a disc or by a Gaussian; and the link as it is: a floor, Rician scattering,
//! headings, mountings and positions that are wrong, a user somewhere else, levels of power. Rates in bit/s/Hz.

use std::f64::consts::{LN_2, TAU};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::problem::{Objective, Pattern, Pointing, PowerSteps, Problem, Uncertainty};
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
    /// Powers that J can give beside none, W; any where there are none.
    pub levels_w: Vec<f64>,
    /// The gain along the axis, of I and J.
    floor: [f64; 2],
    /// K of the user and of every eavesdropper, linear; infinite without scattering.
    rician: [f64; 2],
    pointing: Pointing,
    user_spread: Uncertainty,
    pub objective: Objective,
}

/// All that is random but the eavesdroppers' positions, in one sample.
#[derive(Debug, Clone)]
struct Chance {
    /// Roll and pitch of I, then of J.
    tilt: [f64; 4],
    /// Of I and of J, radians.
    heading: [f64; 2],
    /// Rotation vectors of the mountings about body x and y.
    mount: [[f64; 2]; 2],
    /// True positions of the vehicles and of the user, less those that are known.
    offset_m: [Point; 3],
    /// Scattered waves at the user and every eavesdropper, from I and J: real and imaginary part; none without scattering.
    waves: Vec<[[f64; 2]; 2]>,
}

type Noise = Vec<Chance>;

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

/// Rz(yaw) Ry(pitch) Rx(roll) of the antenna's direction on the body, which is body z turned by the mounting's rotation
/// vector; (1.1) without one.
fn axis(roll: f64, pitch: f64, yaw: f64, [x, y]: [f64; 2]) -> Point {
    let angle = x.hypot(y);
    // Rodrigues' formula for the vertical: a vector of the plane turns it towards (y, -x).
    let lean = if angle > 0.0 { angle.sin() / angle } else { 1.0 };
    let body = [lean * y, -lean * x, angle.cos()];
    let (s, c) = roll.sin_cos();
    let rolled = [body[0], c * body[1] - s * body[2], s * body[1] + c * body[2]];
    let (s, c) = pitch.sin_cos();
    let level = [c * rolled[0] + s * rolled[2], rolled[1], c * rolled[2] - s * rolled[0]];
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
    world: &'a World,
    x: &'a Configuration,
    noise: &'a [Chance],
    axes: Vec<[Point; 2]>,
}

impl Antennas<'_> {
    /// 1 + SINR at a place under every noise: of the user (0), who may be elsewhere, or of an eavesdropper.
    fn heard(&self, index: usize, place: &Point, out: &mut Vec<f64>) {
        let world = self.world;
        let still = [0, 1].map(|v: usize| line(place, &self.x.position_m[v]));
        let k = world.rician[usize::from(index > 0)];
        out.clear();
        out.extend(self.axes.iter().zip(self.noise).map(|(axes, chance)| {
            let received = |v: usize| {
                let (u, square) = if world.moves() {
                    let add = |a: &Point, b: &Point| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
                    let place = if index == 0 { add(place, &chance.offset_m[2]) } else { *place };
                    line(&place, &add(&self.x.position_m[v], &chance.offset_m[v]))
                } else {
                    still[v]
                };
                let y = &axes[v];
                let cosine = u[0] * y[0] + u[1] * y[1] + u[2] * y[2];
                let rest = 1.0 - world.floor[v];
                let gain = (1.0 - rest * cosine * cosine).max(0.0);
                let faded = match chance.waves.get(index) {
                    Some(waves) if k.is_finite() => {
                        let [re, im] = waves[v];
                        let all = ((1.0 - rest / 3.0) / (k + 1.0)).sqrt();
                        ((k / (k + 1.0) * gain).sqrt() + all * re).powi(2) + (all * im).powi(2)
                    }
                    _ => gain,
                };
                world.budget * self.x.power_w[v] / square * faded
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

/// A point drawn about another; on the rim of a disc, if so asked.
fn spread_about(centre: &Point, spread: Uncertainty, rim: bool, rng: &mut ChaCha8Rng) -> Point {
    let at = |radius: f64, angle: f64| {
        [centre[0] + radius * angle.cos(), centre[1] + radius * angle.sin(), centre[2]]
    };
    let angle = rng.random_range(0.0..TAU);
    match spread {
        Uncertainty::None => *centre,
        Uncertainty::Disc { radius_m } if rim => at(radius_m, angle),
        Uncertainty::Disc { radius_m } => at(radius_m * rng.random_range(0.0f64..1.0).sqrt(), angle),
        Uncertainty::Gaussian { std_m } => {
            let (x, y) = (std_m * normal(rng), std_m * normal(rng));
            [centre[0] + x, centre[1] + y, centre[2]]
        }
    }
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
            levels_w: match &problem.power_steps.j {
                PowerSteps::Levels(levels_w) => levels_w.clone(),
                _ => Vec::new(),
            },
            floor: [&problem.antennas.i, &problem.antennas.j].map(Pattern::least),
            rician: [problem.fading.user, problem.fading.eavesdropper].map(|rician| rician.factor()),
            pointing: problem.pointing,
            user_spread: problem.user_uncertainty,
            objective: problem.objective,
        }
    }

    /// Whether vehicles or the user may be elsewhere than they are said to be.
    fn moves(&self) -> bool {
        self.pointing.position_std_m != [0.0; 2] || self.user_spread != Uncertainty::None
    }

    /// Whether anything but the eavesdroppers' positions is random.
    fn varies(&self) -> bool {
        let scatters = self.rician.iter().any(|k| k.is_finite());
        self.std_rad > 0.0 || scatters || self.moves() || self.pointing.is_present()
    }

    fn noise(&self, count: usize, rng: &mut ChaCha8Rng) -> Noise {
        let count = if self.varies() { count } else { 1 };
        (0..count).map(|_| self.chance(rng)).collect()
    }

    fn chance(&self, rng: &mut ChaCha8Rng) -> Chance {
        let Pointing { heading_std_rad, mounting_std_rad, position_std_m: [wide, high] } = self.pointing;
        let tilt = [0; 4].map(|_| self.std_rad * normal(rng));
        if !self.moves() && !self.pointing.is_present() && self.rician.iter().all(|k| k.is_infinite()) {
            return Chance {
                tilt,
                heading: [0.0; 2],
                mount: [[0.0; 2]; 2],
                offset_m: [[0.0; 3]; 3],
                waves: Vec::new(),
            };
        }
        let mut vehicle = || [wide * normal(rng), wide * normal(rng), high * normal(rng)];
        let vehicles = [vehicle(), vehicle()];
        let user = spread_about(&[0.0; 3], self.user_spread, false, rng);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        Chance {
            tilt,
            heading: [0; 2].map(|_| heading_std_rad * normal(rng)),
            mount: [[0; 2]; 2].map(|both| both.map(|_| mounting_std_rad * normal(rng))),
            offset_m: [vehicles[0], vehicles[1], user],
            waves: (0..=self.nodes.len())
                .map(|_| [[0; 2]; 2].map(|wave| wave.map(|_| half * normal(rng))))
                .collect(),
        }
    }

    /// A draw of an eavesdropper's position; for a worst case as often on the rim of where it may be.
    fn place(&self, node: usize, rim: bool, rng: &mut ChaCha8Rng) -> Point {
        spread_about(&self.nodes[node], self.spread[node], rim, rng)
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

    fn antennas<'a>(&'a self, x: &'a Configuration, noise: &'a [Chance]) -> Antennas<'a> {
        let angles = &x.angles_rad;
        let axes = noise
            .iter()
            .map(|n| {
                [0, 1].map(|v: usize| {
                    let [roll, pitch, yaw] = angles[v];
                    axis(roll + n.tilt[2 * v], pitch + n.tilt[2 * v + 1], yaw + n.heading[v], n.mount[v])
                })
            })
            .collect();
        Antennas { world: self, x, noise, axes }
    }

    /// The objective of a configuration as a look sees it.
    pub fn value(&self, x: &Configuration, look: &Look) -> f64 {
        let antennas = self.antennas(x, &look.noise);
        let mut user = Vec::new();
        antennas.heard(0, &self.user, &mut user);
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
            for (index, node) in draw.iter().enumerate() {
                antennas.heard(index + 1, node, &mut heard);
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
                    antennas.heard(node + 1, &point, &mut heard);
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
        antennas.heard(0, &self.user, &mut user);
        let each = draws / (2 * self.nodes.len());
        let fresh = |node| (0..each).map(|k| self.place(node, k % 4 != 0, &mut rng)).collect();
        self.worst(&antennas, &user, f64::INFINITY, fresh)
    }
}
