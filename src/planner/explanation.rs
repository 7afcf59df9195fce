//! Why a plan's rate is what it is: which limits hold it down, which eavesdropper sets it, and what it would be without
//! jamming.
//!
//! A limit *binds* where the pose or the power stands at it, within [`NEAR_M`], [`NEAR_RAD`] or [`NEAR_POWER`], and the mean
//! rate's gradient pushes against it: with the limit a little wider the rate would be higher. What stands at a limit without
//! that is there by chance, or at the edge of nothing. Where a quantile or a worst case was asked for, the mean's gradient may
//! point elsewhere than theirs, and standing there is enough.
//!
//! The *decisive* eavesdropper is the one without which the same poses and powers would have the largest mean rate. Where the
//! poses balance several against each other, taking away any one of them gains little, and the figure says so.

use nalgebra::{Vector2, Vector3};

use super::error::PlanError;
use super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::expectation::samples::{Samples, Sequence};
use super::expectation::{self, EvaluateOptions, Evaluation};
use super::model::{Memory, Target};
use super::plan::{SlotPlan, VehiclePlan};
use super::problem::{Method, Objective, PowerSteps, Problem};
use super::setup::Setup;
use super::{Options, plan_slot};
use crate::geo::polygon::Polygon;
use crate::radio::pattern;
use crate::role::{PerVehicle, Role};

/// A position this near to a limit stands at it, in metres.
pub const NEAR_M: f64 = 0.05;
/// A tilt this near to its limit stands at it, in radians: a twentieth of a degree.
pub const NEAR_RAD: f64 = 8.8e-4;
/// A power this near to a limit stands at it, as a part of the limit.
pub const NEAR_POWER: f64 = 1e-3;
/// A slope above this pushes, in nats per hertz per metre, per radian, or per e-fold of power. I's power is worth so little
/// where J drowns the eavesdroppers that no larger figure would do.
const PUSHES: f64 = 1e-6;
/// Samples of the gradient, and of a rate without one of the eavesdroppers.
const SAMPLES: usize = 4096;
/// Samples that share a draw of what stays wrong.
const PER_DRAW: usize = 16;
/// The smoothed maximum's sharpness per nat where nothing is random.
const SHARPNESS: f64 = 2e4;
/// Eavesdroppers that are looked at, the strongest ones: each is a rate over all the others.
const LOOKED_AT: usize = 64;
/// How much further a vehicle is tilted to see what that is worth, radians.
const STEP_RAD: f64 = 1e-6;

/// A limit of a mission that holds a plan's rate down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Limit {
    /// The area's edge.
    Fence(Role),
    /// A no-fly area's side, floor or ceiling.
    NoFly(Role),
    /// The lowest altitude.
    Floor(Role),
    /// The highest altitude.
    Ceiling(Role),
    /// The largest tilt.
    Tilt(Role),
    /// The least power that the transmitter can give.
    LeastPower(Role),
    /// The largest power.
    MaxPower(Role),
    /// The least distance between the vehicles.
    Separation,
}

impl Limit {
    /// Its name in documents, such as `i.floor`.
    #[must_use]
    pub fn name(self) -> String {
        let of = |role: Role, what: &str| format!("{}.{what}", role.key());
        match self {
            Self::Fence(role) => of(role, "fence"),
            Self::NoFly(role) => of(role, "no-fly"),
            Self::Floor(role) => of(role, "floor"),
            Self::Ceiling(role) => of(role, "ceiling"),
            Self::Tilt(role) => of(role, "tilt"),
            Self::LeastPower(role) => of(role, "least-power"),
            Self::MaxPower(role) => of(role, "max-power"),
            Self::Separation => "separation".to_owned(),
        }
    }
}

/// The eavesdropper that sets a rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decisive {
    /// Its place in the problem's list.
    pub eavesdropper: usize,
    /// The mean rate of the same poses and powers without it, bit/s; `None` where there is no other one.
    pub without_bps: Option<f64>,
}

/// Why a plan's rate is what it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// What binds, I's first.
    pub limits: Vec<Limit>,
    /// Who sets the rate. Of a slot in which nothing is radiated: who would, with I at its largest power and J silent.
    pub decisive: Decisive,
    /// The mean rate of the same poses with J off, bit/s.
    pub unprotected_bps: f64,
}

/// Explains poses and powers.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn explain(
    problem: &Problem,
    vehicles: &PerVehicle<VehiclePlan>,
    options: &EvaluateOptions,
) -> Result<Explanation, PlanError> {
    let setup = Setup::new(problem)?;
    let mut alone = *vehicles;
    alone.j.tx_power_w = 0.0;
    Ok(Explanation {
        limits: limits(&setup, vehicles, options.seed),
        decisive: decisive(&setup, vehicles, options)?,
        unprotected_bps: expectation::score(&setup, &alone, options).secrecy_rate_bps,
    })
}

/// The best plan in which J is silent: what jamming is to be compared with.
///
/// # Errors
/// As [`plan_slot`].
pub fn unprotected(problem: &Problem, options: &Options) -> Result<SlotPlan, PlanError> {
    let mut silent = problem.clone();
    silent.radio.max_power_w.j = 0.0;
    plan_slot(&silent, &Options { method: Method::Veilwing, ..*options })
}

fn decisive(
    setup: &Setup,
    vehicles: &PerVehicle<VehiclePlan>,
    options: &EvaluateOptions,
) -> Result<Decisive, PlanError> {
    let problem = setup.problem;
    let mut vehicles = *vehicles;
    if vehicles.i.tx_power_w <= 0.0 {
        vehicles.i.tx_power_w = setup.highest_w[0];
        vehicles.j.tx_power_w = 0.0;
    }
    let options = EvaluateOptions { samples: options.samples.min(SAMPLES), ..*options };
    let all = expectation::score(setup, &vehicles, &options);
    let mut strongest: Vec<usize> = (0..problem.eavesdroppers.len()).collect();
    strongest.sort_by(|a, b| all.eavesdropper_sinr[*b].total_cmp(&all.eavesdropper_sinr[*a]));
    let first = Decisive { eavesdropper: strongest.first().copied().unwrap_or_default(), without_bps: None };
    if strongest.len() < 2 {
        return Ok(first);
    }
    let mut best: Option<(Decisive, Evaluation)> = None;
    for index in strongest.into_iter().take(LOOKED_AT) {
        let mut without = problem.clone();
        without.eavesdroppers.remove(index);
        let found = expectation::score(&Setup::new(&without)?, &vehicles, &options);
        // Where nothing is left with [.]^+ inside, the signed rate still tells who is the worst. The stronger one comes
        // first, and of equals it stays.
        let better = best.as_ref().is_none_or(|(_, best)| {
            (found.secrecy_rate_bps, found.signed_rate_bps) > (best.secrecy_rate_bps, best.signed_rate_bps)
        });
        if better {
            let without_bps = Some(found.secrecy_rate_bps);
            best = Some((Decisive { eavesdropper: index, without_bps }, found));
        }
    }
    Ok(best.map_or(first, |(decisive, _)| decisive))
}

/// What binds, I's first.
fn limits(setup: &Setup, vehicles: &PerVehicle<VehiclePlan>, seed: u64) -> Vec<Limit> {
    // A slot in which nothing is radiated is held down by what makes it so, which is no limit of a pose.
    if vehicles.i.tx_power_w <= 0.0 {
        return Vec::new();
    }
    let slope = Slope::new(setup, vehicles, seed);
    let mut found = Vec::new();
    for role in Role::BOTH {
        of_vehicle(setup, &vehicles[role], &slope, role, &mut found);
    }
    let apart = vehicles.i.pose.position_enu_m - vehicles.j.pose.position_enu_m;
    let (distance_m, least_m) = (apart.norm(), setup.problem.airspace.min_separation_m);
    let along = if distance_m > 0.0 { apart / distance_m } else { Vector3::x() };
    let nearer = slope.position(Role::J).map_or(0.0, |j| j.dot(&along))
        - slope.position(Role::I).map_or(0.0, |i| i.dot(&along));
    if least_m > 0.0 && distance_m <= least_m + NEAR_M && slope.pushes(nearer) {
        found.push(Limit::Separation);
    }
    found
}

fn of_vehicle(setup: &Setup, plan: &VehiclePlan, slope: &Slope, role: Role, found: &mut Vec<Limit>) {
    let problem = setup.problem;
    let at = plan.pose.position_enu_m;
    let by_position = slope.position(role).unwrap_or_else(Vector3::zeros);
    let fenced = edges_at(setup, at.xy())
        .any(|outward| slope.pushes(outward.x * by_position.x + outward.y * by_position.y));
    let [low, high] = problem.airspace.altitude_m;
    let index = usize::from(role == Role::J);
    let tilt_rad = setup.tilt_rad[index];
    let tilted = plan.pose.attitude().tilt_rad() >= tilt_rad - NEAR_RAD
        && tilt_rad < std::f64::consts::FRAC_PI_2
        && slope.pushes(slope.tilt(role, plan));
    let (power_w, by_power) = (plan.tx_power_w, slope.power(role));
    let near = |limit_w: f64| limit_w > 0.0 && (power_w / limit_w - 1.0).abs() <= NEAR_POWER;
    let least_w = match &problem.power_steps[role] {
        PowerSteps::Any => None,
        PowerSteps::AtLeast(least_w) => Some(*least_w),
        PowerSteps::Levels(levels_w) => levels_w.first().copied(),
    };
    let binding = [
        (fenced, Limit::Fence(role)),
        (faces_at(setup, at).any(|inward| slope.pushes(inward.dot(&by_position))), Limit::NoFly(role)),
        (at.z <= low + NEAR_M && slope.pushes(-by_position.z), Limit::Floor(role)),
        (at.z >= high - NEAR_M && slope.pushes(by_position.z), Limit::Ceiling(role)),
        (tilted, Limit::Tilt(role)),
        (least_w.is_some_and(near) && slope.pushes(-by_power), Limit::LeastPower(role)),
        (near(setup.highest_w[index]) && slope.pushes(by_power), Limit::MaxPower(role)),
    ];
    found.extend(binding.into_iter().filter_map(|(binds, limit)| binds.then_some(limit)));
}

/// The outward normals of the area's edges at which a point stands.
fn edges_at(setup: &Setup, at: Vector2<f64>) -> impl Iterator<Item = Vector2<f64>> {
    // The corners go round counterclockwise, so that outward is to the right of an edge.
    setup.region.polygon().edges().filter_map(move |[from, to]| {
        let edge = to - from;
        let length_m = edge.norm();
        if length_m <= 0.0 {
            return None;
        }
        let along_m = ((at - from).dot(&edge) / length_m).clamp(0.0, length_m);
        let nearest = from + edge * (along_m / length_m);
        ((at - nearest).norm() <= NEAR_M).then(|| Vector2::new(edge.y, -edge.x) / length_m)
    })
}

/// The inward normals of the no-fly areas' faces at which a point stands.
fn faces_at(setup: &Setup, at: Vector3<f64>) -> impl Iterator<Item = Vector3<f64>> {
    setup.problem.airspace.no_fly.iter().filter_map(move |area| {
        let polygon = Polygon::new(&area.area_enu_m).ok()?;
        let [floor, ceiling] = area.heights_m();
        let nearest = polygon.nearest_on_boundary(at.xy());
        let inward = if polygon.encloses(at.xy()) { at.xy() - nearest } else { nearest - at.xy() };
        if inward.norm() <= NEAR_M && (floor..=ceiling).contains(&at.z) {
            let beside = inward.try_normalize(0.0).unwrap_or_else(|| facing(&polygon, nearest));
            return Some(beside.push(0.0));
        }
        if !polygon.encloses(at.xy()) {
            return None;
        }
        let under = (at.z - floor).abs() <= NEAR_M;
        (under || (at.z - ceiling).abs() <= NEAR_M).then(|| if under { Vector3::z() } else { -Vector3::z() })
    })
}

/// The inward normal of the side on which a point of the boundary lies.
fn facing(polygon: &Polygon, at: Vector2<f64>) -> Vector2<f64> {
    let apart = |[p, q]: &[Vector2<f64>; 2]| (at - p).norm() + (at - q).norm() - (q - p).norm();
    let side = polygon.edges().min_by(|a, b| apart(a).total_cmp(&apart(b)));
    // The corners go round counterclockwise, so that inward is to the left of a side.
    side.map_or_else(Vector2::zeros, |[p, q]| Vector2::new(p.y - q.y, q.x - p.x) / (q - p).norm())
}

/// The gradient of the mean rate, nats per hertz, the signed rate's: with `[.]^+` inside it would vanish where there is none.
/// `None` where standing at a limit is enough.
struct Slope(Option<Raw>);

impl Slope {
    fn new(setup: &Setup, vehicles: &PerVehicle<VehiclePlan>, seed: u64) -> Self {
        let asked = setup.problem.objective;
        if setup.is_uncertain() && matches!(asked, Objective::Quantile | Objective::WorstCase) {
            return Self(None);
        }
        let mut gradient = [0.0; 14];
        let raw = Setup::raw(vehicles);
        let mut memory = Memory::default();
        if setup.varies() || setup.heeds_uncertainty() {
            let draws = if setup.heeds_uncertainty() { SAMPLES / PER_DRAW } else { 1 };
            let samples = Samples::new(setup.problem, SAMPLES, draws, seed, Sequence::Sobol);
            let target = Target::Mean { samples: &samples, clip: false };
            memory.value(setup, target, &raw, &mut gradient);
        } else {
            memory.value(setup, Target::Exact(SHARPNESS), &raw, &mut gradient);
        }
        Self(Some(gradient))
    }

    fn pushes(&self, slope: f64) -> bool {
        self.0.is_none() || slope > PUSHES
    }

    fn of(&self, role: Role) -> Option<&[f64]> {
        let at = if role == Role::I { 0 } else { VEHICLE };
        self.0.as_ref().map(|gradient| &gradient[at..at + VEHICLE])
    }

    /// By the position, in metres.
    fn position(&self, role: Role) -> Option<Vector3<f64>> {
        self.of(role).map(|part| Vector3::new(part[0], part[1], part[2]))
    }

    /// By the logarithm of the power.
    fn power(&self, role: Role) -> f64 {
        self.of(role).map_or(0.0, |part| part[POWER])
    }

    /// By the tilt, the azimuth held.
    fn tilt(&self, role: Role, plan: &VehiclePlan) -> f64 {
        let Some(part) = self.of(role) else { return 0.0 };
        let axis = pattern::antenna_axis(plan.pose.roll_rad, plan.pose.pitch_rad, 0.0);
        let axis = if axis.z < 0.0 { -axis } else { axis };
        let (horizontal, azimuth) = (libm::hypot(axis.x, axis.y), libm::atan2(axis.y, axis.x));
        if horizontal <= STEP_RAD {
            // Upright there is no azimuth, and any will do.
            return libm::hypot(part[ANGLES], part[ANGLES + 1]);
        }
        let tilt = libm::atan2(horizontal, axis.z);
        let angles = |tilt: f64| {
            let ((st, ct), (sa, ca)) = (libm::sincos(tilt), libm::sincos(azimuth));
            pattern::canonical_angles(&Vector3::new(st * ca, st * sa, ct))
        };
        let ((roll, pitch), (more_roll, more_pitch)) = (angles(tilt), angles(tilt + STEP_RAD));
        (part[ANGLES] * (more_roll - roll) + part[ANGLES + 1] * (more_pitch - pitch)) / STEP_RAD
    }
}
