//! A problem checked and prepared: what every method starts from.

use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::error::PlanError;
use super::expectation::kernel::{ANGLES, POWER, Raw, Scene, VEHICLE};
use super::plan::VehiclePlan;
use super::problem::{Airframe, Objective, Pattern, Pointing, PowerSteps, Problem, Uncertainty};
use super::region::Region;
use super::variables::AxisChart;
use crate::geo::Pose;
use crate::geo::polygon::Polygon;
use crate::radio::pattern;
use crate::role::{PerVehicle, Role};

/// Coordinates beyond this are no mission: distances squared would lose their accuracy.
pub const FARTHEST_M: f64 = 1e6;

/// So many ways out of a no-fly area are worth a start, the nearest ones.
const WAYS_OUT: usize = 8;

/// A checked problem with what is derived from it once.
#[derive(Debug, Clone)]
pub struct Setup<'a> {
    /// The question.
    pub problem: &'a Problem,
    /// The geofence.
    pub region: Region,
    /// The link budget as the kernel takes it.
    pub scene: Scene,
    /// Least distance from the user to where a vehicle may be, in metres: the unit of positions in a search.
    pub length_m: f64,
    /// Largest tilt of I and J in radians; 0 for a level vehicle.
    pub tilt_rad: [f64; 2],
    /// The largest power in W that I and J can give within their ceilings.
    pub highest_w: [f64; 2],
}

impl<'a> Setup<'a> {
    /// Checks `problem`.
    ///
    /// # Errors
    /// [`PlanError`] names the first value that makes the question meaningless, and the remedy.
    pub fn new(problem: &'a Problem) -> Result<Self, PlanError> {
        check_numbers(problem)?;
        let air = &problem.airspace;
        let region = Region::new(air).ok_or_else(|| {
            if Polygon::new(&air.area_enu_m).is_ok() && !air.no_fly.is_empty() {
                PlanError::NothingLeft { areas: air.no_fly.len() }
            } else {
                PlanError::EmptyArea { vertices: air.area_enu_m.len() }
            }
        })?;
        if region.cells().is_empty() {
            return Err(PlanError::NothingLeft { areas: air.no_fly.len() });
        }
        let reach_m = if region.has_gaps() {
            let [a, b] = farthest_apart(&region);
            (a - b).norm()
        } else {
            libm::hypot(region.polygon().diameter_m(), air.altitude_m[1] - air.altitude_m[0])
        };
        if reach_m < air.min_separation_m {
            return Err(PlanError::SeparationImpossible { separation_m: air.min_separation_m, reach_m });
        }
        let user = problem.user_enu_m;
        let nearest = region.nearest(user.xy());
        let height = user.z.clamp(air.altitude_m[0], air.altitude_m[1]) - user.z;
        let tilt = |role: Role| match problem.vehicles[role].airframe {
            Airframe::Omnidirectional => problem.vehicles[role].max_tilt_rad,
            Airframe::Conventional => 0.0,
        };
        Ok(Self {
            problem,
            scene: Scene::of(problem),
            length_m: libm::hypot((nearest - user.xy()).norm(), height).clamp(10.0, 1000.0),
            region,
            tilt_rad: [tilt(Role::I), tilt(Role::J)],
            highest_w: Role::BOTH.map(|role| highest_w(problem, role)),
        })
    }

    /// The eavesdroppers' estimated positions.
    pub fn eavesdroppers(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        self.problem
            .eavesdroppers
            .iter()
            .map(|e| [e.position_enu_m.x, e.position_enu_m.y, e.position_enu_m.z])
    }

    /// Whether attitudes jitter.
    #[must_use]
    pub fn jitters(&self) -> bool {
        self.problem.jitter.std_rad > 0.0
    }

    /// Whether anything changes within a slot, over which every objective is a mean: attitudes, or what is scattered.
    #[must_use]
    pub fn varies(&self) -> bool {
        self.jitters() || self.problem.fading.is_present()
    }

    /// Whether anything stays wrong during a slot: a node's position, or a vehicle's pose.
    #[must_use]
    pub fn is_uncertain(&self) -> bool {
        self.problem.eavesdroppers.iter().any(|e| e.uncertainty.is_present()) || self.problem.errs()
    }

    /// Whether a search takes what stays wrong into account.
    #[must_use]
    pub fn heeds_uncertainty(&self) -> bool {
        self.is_uncertain() && self.problem.objective != Objective::Nominal
    }

    /// Mean gain of J's antenna towards the user when its null is on it, from a distance: by its floor, by attitude noise, by
    /// what is scattered about the user and, where a search takes them into account, by errors of both poses.
    #[must_use]
    pub fn leak(&self, distance_m: f64) -> f64 {
        let problem = self.problem;
        let antenna = &problem.antennas.j;
        let (angle2, across_m2) = if self.heeds_uncertainty() { errors_squared(problem) } else { (0.0, 0.0) };
        let angle2 = problem.jitter.std_rad * problem.jitter.std_rad + angle2;
        let turned = 2.0 * angle2 + 2.0 * across_m2 / (distance_m * distance_m).max(1.0);
        let floor = antenna.least();
        problem.fading.user.mean_gain(floor + (1.0 - floor) * turned, antenna.mean())
    }

    /// The chart of a free axis. Of an antenna whose ends differ, the axis that counts is the upper end of its line: the angles
    /// of a plan know no other.
    #[must_use]
    pub fn free_axis(&self, v: usize, yaw: bool) -> AxisChart {
        let limit_rad = self.tilt_rad[v];
        if limit_rad >= std::f64::consts::FRAC_PI_2 && !self.scene.antennas[v].pattern.is_symmetric() {
            return AxisChart::Tilt { yaw, limit_rad: std::f64::consts::FRAC_PI_2 };
        }
        AxisChart::free(limit_rad, yaw)
    }

    /// Whether J's exact null on the user leaves nothing there, so that no power of J costs anything.
    #[must_use]
    pub fn nulls_exactly(&self) -> bool {
        self.leak(self.length_m) <= 0.0
    }

    /// The nearest allowed position to `p`.
    #[must_use]
    pub fn allowed(&self, p: Vector3<f64>) -> Vector3<f64> {
        let ground = self.region.nearest(p.xy());
        let [low, high] = self.problem.airspace.altitude_m;
        self.outside(Vector3::new(ground.x, ground.y, p.z.clamp(low, high)))
    }

    /// `p`, which is over the area and in the band, or the nearest position outside the no-fly areas.
    #[must_use]
    pub fn outside(&self, p: Vector3<f64>) -> Vector3<f64> {
        if self.region.has_gaps() && !self.region.allows(&p) { self.region.nearest_allowed(&p) } else { p }
    }

    /// As [`allowed`](Self::allowed), but for a position in a no-fly area by one of the ways out of it, drawn from `rng`: the
    /// best place beside it need not be the nearest. Without such areas nothing is drawn.
    #[must_use]
    pub fn allowed_by_some_way(&self, p: Vector3<f64>, rng: &mut ChaCha8Rng) -> Vector3<f64> {
        let ground = self.region.nearest(p.xy());
        let [low, high] = self.problem.airspace.altitude_m;
        let p = Vector3::new(ground.x, ground.y, p.z.clamp(low, high));
        if !self.region.has_gaps() || self.region.allows(&p) {
            return p;
        }
        let ways = self.region.ways_out(&p);
        let way = rng.random_range(0..ways.len().min(WAYS_OUT));
        ways.get(way).copied().unwrap_or(p)
    }

    /// A point drawn uniformly from the geofence: by rejection from its bounding box, at most so often.
    #[must_use]
    pub fn uniform(&self, rng: &mut ChaCha8Rng) -> (f64, f64) {
        let polygon = self.region.polygon().corners();
        let bounds = |axis: usize| {
            polygon.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
                (low.min(p[axis]), high.max(p[axis]))
            })
        };
        let ((x0, x1), (y0, y1)) = (bounds(0), bounds(1));
        let mut p = polygon[0];
        for _ in 0..100 {
            p = nalgebra::Vector2::new(rng.random_range(x0..=x1), rng.random_range(y0..=y1));
            if self.region.contains(p, 0.0) {
                break;
            }
        }
        let p = self.region.nearest(p);
        (p.x, p.y)
    }

    /// `raw` with positions that always keep the separation: at the two corners of the airspace farthest apart.
    #[must_use]
    pub fn resort(&self, raw: &Raw) -> Raw {
        if self.region.has_gaps() {
            let [a, b] = farthest_apart(&self.region);
            let mut out = *raw;
            out[..3].copy_from_slice(a.as_slice());
            out[VEHICLE..VEHICLE + 3].copy_from_slice(b.as_slice());
            return out;
        }
        let polygon = self.region.polygon().corners();
        let pairs = polygon.iter().flat_map(|a| polygon.iter().map(move |b| (a, b)));
        let longer = |x: &(_, _), y: &(_, _)| {
            let length = |p: &(&Vector2<f64>, &Vector2<f64>)| (p.0 - p.1).norm_squared();
            length(x).total_cmp(&length(y))
        };
        let mut out = *raw;
        if let Some((a, b)) = pairs.max_by(longer) {
            let [low, high] = self.problem.airspace.altitude_m;
            out[..3].copy_from_slice(&[a.x, a.y, low]);
            out[VEHICLE..VEHICLE + 3].copy_from_slice(&[b.x, b.y, high]);
        }
        out
    }

    /// A configuration from poses and powers.
    #[must_use]
    pub fn raw(vehicles: &PerVehicle<VehiclePlan>) -> Raw {
        let mut raw = [0.0; 14];
        for (at, plan) in [(0, &vehicles.i), (VEHICLE, &vehicles.j)] {
            let p = &plan.pose.position_enu_m;
            let part =
                [p.x, p.y, p.z, plan.pose.roll_rad, plan.pose.pitch_rad, plan.pose.yaw_rad, plan.tx_power_w];
            raw[at..at + VEHICLE].copy_from_slice(&part);
        }
        raw
    }

    /// Poses and powers of a configuration: angles canonical, bounds met to the last bit.
    #[must_use]
    pub fn vehicles(&self, raw: &Raw) -> PerVehicle<VehiclePlan> {
        PerVehicle::from_fn(|role| {
            let at = if role == Role::I { 0 } else { VEHICLE };
            let part = &raw[at..at + VEHICLE];
            let (roll_rad, pitch_rad) = pattern::canonical_attitude(part[ANGLES], part[ANGLES + 1]);
            let [low, high] = self.problem.airspace.altitude_m;
            let position_enu_m = self.outside(Vector3::new(part[0], part[1], part[2].clamp(low, high)));
            let yaw_rad =
                part[ANGLES + 2] - std::f64::consts::TAU * (part[ANGLES + 2] / std::f64::consts::TAU).round();
            let cap = self.problem.radio.max_power_w[role];
            let tx_power_w = match self.problem.power_steps[role] {
                // A logarithm's rounding may have fallen short of the least power.
                PowerSteps::AtLeast(least_w) if part[POWER] > 0.0 => part[POWER].clamp(least_w, cap),
                _ => part[POWER].clamp(0.0, cap),
            };
            VehiclePlan { pose: Pose { position_enu_m, roll_rad, pitch_rad, yaw_rad }, tx_power_w }
        })
    }
}

/// The two allowed positions that are farthest from each other: corners of cells, at either end of their altitudes.
fn farthest_apart(region: &Region) -> [Vector3<f64>; 2] {
    let ends: Vec<Vector3<f64>> =
        region.corners().flat_map(|(corner, altitude_m)| altitude_m.map(|z| corner.push(z))).collect();
    let mut best = [Vector3::zeros(); 2];
    for (k, a) in ends.iter().enumerate() {
        for b in &ends[k + 1..] {
            if (a - b).norm_squared() > (best[0] - best[1]).norm_squared() {
                best = [*a, *b];
            }
        }
    }
    best
}

/// Variances of the angle between J's axis and the user, per axis across it, by what is wrong with J's attitude (rad^2), and
/// of its position and the user's (m^2).
fn errors_squared(problem: &Problem) -> (f64, f64) {
    let Pointing { heading_std_rad, mounting_std_rad, position_std_m: [horizontal_m, vertical_m] } =
        problem.pointing;
    let user_m = match problem.user_uncertainty {
        Uncertainty::None => 0.0,
        // The deviation per axis of a point drawn evenly from a disc.
        Uncertainty::Disc { radius_m } => 0.5 * radius_m,
        Uncertainty::Gaussian { std_m } => std_m,
    };
    let angle2 = mounting_std_rad * mounting_std_rad + 0.5 * heading_std_rad * heading_std_rad;
    (angle2, user_m * user_m + horizontal_m * horizontal_m + 0.5 * vertical_m * vertical_m)
}

/// The largest power that a vehicle can give within its ceiling, in W; 0 where that is none.
fn highest_w(problem: &Problem, role: Role) -> f64 {
    let cap = problem.radio.max_power_w[role];
    match &problem.power_steps[role] {
        PowerSteps::Any => cap,
        PowerSteps::AtLeast(least_w) => {
            if *least_w <= cap {
                cap
            } else {
                0.0
            }
        }
        PowerSteps::Levels(levels_w) => levels_w.iter().copied().filter(|w| *w <= cap).fold(0.0, f64::max),
    }
}

fn check_numbers(problem: &Problem) -> Result<(), PlanError> {
    let radio = &problem.radio;
    let air = &problem.airspace;
    let within = |what: &'static str, value: f64, least: f64, most: f64| {
        // Not `value < least || value > most`: NaN must be refused too.
        if (least..=most).contains(&value) {
            Ok(())
        } else {
            Err(PlanError::OutOfRange { what, value, least, most })
        }
    };
    if problem.eavesdroppers.is_empty() {
        return Err(PlanError::NoEavesdropper);
    }
    let place = |what, p: &Vector3<f64>| p.iter().try_for_each(|c| within(what, *c, -FARTHEST_M, FARTHEST_M));
    let spread = |[radius, std]: [&'static str; 2], uncertainty| match uncertainty {
        Uncertainty::None => Ok(()),
        Uncertainty::Disc { radius_m } => within(radius, radius_m, 0.0, FARTHEST_M),
        Uncertainty::Gaussian { std_m } => within(std, std_m, 0.0, FARTHEST_M),
    };
    place("user position in m", &problem.user_enu_m)?;
    for eavesdropper in &problem.eavesdroppers {
        place("eavesdropper position in m", &eavesdropper.position_enu_m)?;
        spread(["eavesdropper radius in m", "eavesdropper std in m"], eavesdropper.uncertainty)?;
    }
    spread(["user radius in m", "user std in m"], problem.user_uncertainty)?;
    for antenna in [&problem.antennas.i, &problem.antennas.j] {
        if let Pattern::Dipole { floor } = antenna {
            within("gain in an antenna's null", *floor, 0.0, 1.0)?;
        }
    }
    for rician in [problem.fading.user, problem.fading.eavesdropper].into_iter().filter(|k| k.is_present()) {
        within("Rician factor", rician.factor(), 1e-30, 1e30)?;
    }
    within("heading error in rad", problem.pointing.heading_std_rad, 0.0, std::f64::consts::PI)?;
    within("mounting error in rad", problem.pointing.mounting_std_rad, 0.0, std::f64::consts::PI)?;
    for std_m in problem.pointing.position_std_m {
        within("position error in m", std_m, 0.0, FARTHEST_M)?;
    }
    within("bandwidth in Hz", radio.bandwidth_hz, f64::MIN_POSITIVE, 1e15)?;
    if radio.noise_power_w == 0.0 {
        return Err(PlanError::NoNoise);
    }
    within("noise power in W", radio.noise_power_w, 1e-30, 1e6)?;
    within("reference gain", radio.reference_gain, 1e-30, 1e12)?;
    within("maximum power in W", radio.max_power_w.i, 0.0, 1e9)?;
    within("maximum power in W", radio.max_power_w.j, 0.0, 1e9)?;
    for steps in [&problem.power_steps.i, &problem.power_steps.j] {
        match steps {
            PowerSteps::Any => {}
            PowerSteps::AtLeast(least_w) => within("least power in W", *least_w, f64::MIN_POSITIVE, 1e9)?,
            PowerSteps::Levels(levels_w) => {
                let mut below = 0.0;
                for level in levels_w {
                    within("power level in W", *level, f64::next_up(below), 1e9)?;
                    below = *level;
                }
            }
        }
    }
    // Eight factors of the objective must fit into a floating-point number.
    let strongest = radio.max_power_w.i.max(radio.max_power_w.j) * radio.reference_gain / radio.noise_power_w;
    within("reference gain times power over noise", strongest, 0.0, 1e30)?;
    within("lowest altitude in m", air.altitude_m[0], -FARTHEST_M, FARTHEST_M)?;
    within("highest altitude in m", air.altitude_m[1], air.altitude_m[0], FARTHEST_M)?;
    within("separation in m", air.min_separation_m, 0.0, FARTHEST_M)?;
    for area in &air.no_fly {
        for vertex in &area.area_enu_m {
            vertex.iter().try_for_each(|c| within("no-fly vertex in m", *c, -FARTHEST_M, FARTHEST_M))?;
        }
        for height in [area.floor_m, area.ceiling_m].into_iter().flatten() {
            within("no-fly height in m", height, -FARTHEST_M, FARTHEST_M)?;
        }
    }
    for vertex in &air.area_enu_m {
        vertex.iter().try_for_each(|c| within("area vertex in m", *c, -FARTHEST_M, FARTHEST_M))?;
    }
    for vehicle in [&problem.vehicles.i, &problem.vehicles.j] {
        within("tilt limit in rad", vehicle.max_tilt_rad, 0.0, std::f64::consts::PI)?;
    }
    within("attitude jitter in rad", problem.jitter.std_rad, 0.0, std::f64::consts::PI)
}

/// The horizontal positions of the eavesdroppers from the user.
#[must_use]
pub fn from_user(problem: &Problem) -> Vec<Vector2<f64>> {
    problem.eavesdroppers.iter().map(|e| (e.position_enu_m - problem.user_enu_m).xy()).collect()
}
