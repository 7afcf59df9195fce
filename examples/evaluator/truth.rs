//! The link as it is, by plain Monte Carlo: stated again from the model, with rotations by nalgebra, normals by Box and
//! Muller and a generator of its own. Nothing of the planner's expectation is in it.

use nalgebra::{Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::problem::{JitterAxes, JitterModel, Pattern, Problem, Uncertainty};
use veilwing::role::{PerVehicle, Role};

/// A generator with normal draws.
pub struct Dice(ChaCha8Rng);

impl Dice {
    /// From a seed.
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn uniform(&mut self) -> f64 {
        self.0.random::<f64>()
    }

    /// Two independent standard normals.
    fn normals(&mut self) -> [f64; 2] {
        let size = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        [size * cos, size * sin]
    }

    fn shift(&mut self, uncertainty: Uncertainty) -> Vector3<f64> {
        let [x, y] = match uncertainty {
            Uncertainty::None => [0.0; 2],
            Uncertainty::Gaussian { std_m } => self.normals().map(|n| std_m * n),
            Uncertainty::Disc { radius_m } => loop {
                let [x, y] = [2.0 * self.uniform() - 1.0, 2.0 * self.uniform() - 1.0];
                if x * x + y * y <= 1.0 {
                    break [radius_m * x, radius_m * y];
                }
            },
        };
        Vector3::new(x, y, 0.0)
    }
}

/// What stays wrong during one slot.
pub struct Slot {
    user: Vector3<f64>,
    eavesdroppers: Vec<Vector3<f64>>,
    /// True position, turn of the heading and mounting of each vehicle.
    vehicles: [(Vector3<f64>, f64, Rotation3<f64>); 2],
}

/// Draws a slot.
pub fn slot(problem: &Problem, vehicles: &PerVehicle<VehiclePlan>, dice: &mut Dice) -> Slot {
    let pointing = &problem.pointing;
    Slot {
        user: problem.user_enu_m + dice.shift(problem.user_uncertainty),
        eavesdroppers: problem
            .eavesdroppers
            .iter()
            .map(|e| e.position_enu_m + dice.shift(e.uncertainty))
            .collect(),
        vehicles: Role::BOTH.map(|role| {
            let [h, _] = dice.normals();
            let [mx, my] = dice.normals().map(|n| pointing.mounting_std_rad * n);
            let ([x, y], [z, _]) = (dice.normals(), dice.normals());
            let [horizontal_m, vertical_m] = pointing.position_std_m;
            let offset = Vector3::new(horizontal_m * x, horizontal_m * y, vertical_m * z);
            (
                vehicles[role].pose.position_enu_m + offset,
                pointing.heading_std_rad * h,
                Rotation3::new(Vector3::new(mx, my, 0.0)),
            )
        }),
    }
}

/// The secrecy rate in bit/s/Hz, never negative, at one draw of what changes within the slot.
pub fn rate(problem: &Problem, vehicles: &PerVehicle<VehiclePlan>, slot: &Slot, dice: &mut Dice) -> f64 {
    let axes = [0, 1].map(|v| {
        let pose = vehicles[Role::BOTH[v]].pose;
        let ([a, b], [c, _]) = (dice.normals(), dice.normals());
        let yaw_jitters = problem.jitter.axes == JitterAxes::RollPitchYaw;
        let w = [a, b, if yaw_jitters { c } else { 0.0 }].map(|n| problem.jitter.std_rad * n);
        let (_, heading, mount) = &slot.vehicles[v];
        let euler = |w: [f64; 3]| {
            Rotation3::from_euler_angles(pose.roll_rad + w[0], pose.pitch_rad + w[1], pose.yaw_rad + w[2])
        };
        let attitude = match problem.jitter.model {
            JitterModel::Euler => euler(w),
            JitterModel::Body => euler([0.0; 3]) * Rotation3::new(Vector3::from(w)),
        };
        Rotation3::from_axis_angle(&Vector3::z_axis(), *heading) * attitude * mount * Vector3::z()
    });
    let mut efficiency = |node: &Vector3<f64>, k: f64| {
        let [a, b] = [0, 1].map(|v| {
            let role = Role::BOTH[v];
            let path = node - slot.vehicles[v].0;
            let (gain, mean) = gain(&problem.antennas[role], path.dot(&axes[v]) / path.norm());
            let (direct, scattered) =
                if k.is_finite() { (k / (k + 1.0), 1.0 / (k + 1.0)) } else { (1.0, 0.0) };
            let wave = dice.normals().map(|n| n * (scattered * mean / 2.0).sqrt());
            let field = (direct * gain).sqrt() + wave[0];
            let received = field * field + wave[1] * wave[1];
            problem.radio.reference_gain * vehicles[role].tx_power_w * received / path.norm_squared()
        });
        (1.0 + a / (b + problem.radio.noise_power_w)).log2()
    };
    let own = efficiency(&slot.user, problem.fading.user.factor());
    let k = problem.fading.eavesdropper.factor();
    let heard = slot.eavesdroppers.iter().map(|node| efficiency(node, k)).fold(0.0, f64::max);
    (own - heard).max(0.0)
}

/// Gain at a cosine from the axis, and its mean over the sphere.
fn gain(pattern: &Pattern, cosine: f64) -> (f64, f64) {
    match pattern {
        Pattern::Dipole { floor } => {
            ((1.0 - (1.0 - floor) * cosine * cosine).max(0.0), 2.0 / 3.0 + floor / 3.0)
        }
        // Its interpolation and its mean are tested against another program's.
        Pattern::Measured(measured) => {
            (measured.gain_and_slope(cosine.clamp(-1.0, 1.0).acos()).0, measured.mean())
        }
    }
}

/// Mean of the rate over everything, a slot for each draw, and its standard error, in bit/s/Hz.
pub fn mean(problem: &Problem, vehicles: &PerVehicle<VehiclePlan>, draws: u64, seed: u64) -> (f64, f64) {
    let mut dice = Dice::new(seed);
    let (mut sum, mut square) = (0.0, 0.0);
    for _ in 0..draws {
        let slot = slot(problem, vehicles, &mut dice);
        let rate = rate(problem, vehicles, &slot, &mut dice);
        sum += rate;
        square += rate * rate;
    }
    let n = draws as f64;
    let mean = sum / n;
    (mean, ((square / n - mean * mean).max(0.0) / n).sqrt())
}
