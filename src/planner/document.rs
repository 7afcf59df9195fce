//! The plan as JSON (`veilwing-plan/1`), as `plan --json` writes and `evaluate` reads it.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::geo::Pose;
use crate::planner::assessment::Assessment;
use crate::planner::explanation::{Explanation, Limit};
use crate::planner::moving::{Demand, Spline};
use crate::planner::plan::{SlotPlan, Status, VehiclePlan};
use crate::planner::turning::{self, Knot};
use crate::role::PerVehicle;

/// The document's `format`.
pub const FORMAT: &str = "veilwing-plan/1";

/// A whole plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanDocument {
    /// [`FORMAT`].
    pub format: &'static str,
    /// SHA-256 of the mission's meaning, hexadecimal.
    pub mission_digest: String,
    /// SHA-256 of poses and powers, hexadecimal.
    pub plan_digest: String,
    /// The mission's seed.
    pub seed: u64,
    /// The method's name.
    pub method: String,
    /// Secret bits that a superframe delivers, by the plan's expectation.
    pub secrecy_volume_bits: f64,
    /// How long a superframe takes that follows another, its transits included; `null` where it cannot be flown.
    pub superframe_s: Option<f64>,
    /// In how much of it I radiates.
    pub on_air_s: f64,
    /// What the user gets who gets least of it, bits.
    pub least_user_volume_bits: f64,
    /// One per user.
    pub slots: Vec<SlotDocument>,
    /// How the vehicles move, where they do (`mode = "moving"`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionDocument>,
}

/// Both vehicles' ways round a superframe, each a periodic uniform cubic B-spline: n control points c_k,
/// `p(t) = sum over k of B(n t / period_s - k) c_k`, t from the beginning of the first user's service, indices modulo n.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MotionDocument {
    /// After which both repeat, seconds.
    pub period_s: f64,
    /// Control points, east, north, up in metres.
    pub control_enu_m: PerVehicle<Vec<[f64; 3]>>,
    /// What each asks for at most.
    pub demand: PerVehicle<DemandDocument>,
}

/// What a way asks of a vehicle at most.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DemandDocument {
    /// Horizontal speed, m/s.
    pub speed_m_s: f64,
    /// Vertical speed, m/s.
    pub climb_m_s: f64,
    /// Acceleration, m/s^2.
    pub acceleration_m_s2: f64,
    /// Change of acceleration, m/s^3.
    pub jerk_m_s3: f64,
}

impl MotionDocument {
    /// The document of both ways.
    #[must_use]
    pub fn new(ways: &PerVehicle<Spline>) -> Self {
        let of = |way: &Spline| way.control_enu_m.iter().map(|point| (*point).into()).collect();
        let demand = |way: &Spline| {
            let Demand { speed_m_s, climb_m_s, acceleration_m_s2, jerk_m_s3 } = way.demand();
            DemandDocument { speed_m_s, climb_m_s, acceleration_m_s2, jerk_m_s3 }
        };
        Self {
            period_s: ways.i.period_s,
            control_enu_m: PerVehicle { i: of(&ways.i), j: of(&ways.j) },
            demand: PerVehicle { i: demand(&ways.i), j: demand(&ways.j) },
        }
    }
}

/// One slot.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SlotDocument {
    /// The user's name.
    pub user: String,
    /// How long the slot is, seconds.
    pub slot_s: f64,
    /// How the search ended.
    pub status: &'static str,
    /// `E[R]` in bit/s.
    pub secrecy_rate_bps: f64,
    /// Its standard error as an estimate.
    pub standard_error_bps: f64,
    /// The value of the objective that was asked for, bit/s: `secrecy_rate_bps` itself, or over what stays wrong during a slot
    /// the rate with nothing wrong, the 5% quantile or the worst case.
    pub objective_bps: f64,
    /// The rate that a slot exceeds with a probability of 95%, over what stays wrong during it; the mean where nothing does.
    pub quantile_5pct_bps: f64,
    /// The probability that a slot's rate is below the mission's target, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub miss_probability: Option<f64>,
    /// By cause, how much higher the mean rate of the same poses and powers would be without it alone, bit/s; `all`: without
    /// all of them.
    pub loss_bps: BTreeMap<&'static str, f64>,
    /// The mean rate of the same poses with J off, bit/s.
    pub unprotected_rate_bps: f64,
    /// The mean rate of the best plan in which J is off, bit/s, where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub best_unprotected_rate_bps: Option<f64>,
    /// What binds: names such as `i.floor`, as [`Limit::name`] has them.
    pub limits: Vec<String>,
    /// The eavesdropper that sets the rate, by its name in the mission file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decisive_eavesdropper: Option<String>,
    /// The mean rate of the same poses and powers without that eavesdropper, bit/s, where there is another one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub without_decisive_bps: Option<f64>,
    /// Upper bound on the secrecy rate of any poses and powers, bit/s.
    pub upper_bound_bps: f64,
    /// What that bounds and how firmly: [`BoundKind::name`](crate::planner::plan::BoundKind::name).
    pub upper_bound_kind: &'static str,
    /// At the desired attitude and estimated positions.
    pub sinr: SinrDocument,
    /// Poses and powers.
    pub vehicles: PerVehicle<VehicleDocument>,
    /// How far each vehicle's attitude may be off its pose while the slot is served, degrees.
    pub attitude_tolerance_deg: PerVehicle<f64>,
    /// How the user is served where the vehicles turn on the air (`mode = "turning"` or `"moving"`).
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub turning: Option<TurningDocument>,
    /// The search alone, seconds; of all slots in one, this one's share.
    pub planning_time_s: f64,
    /// The search for a bound better than the cap alone, seconds; 0 if none was asked for.
    pub bound_time_s: f64,
}

/// One user's part of a superframe in which the vehicles turn on the air. `vehicles` of its slot is the pose in which it is served
/// between two turns, and the slot's rates are those of that pose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TurningDocument {
    /// How long the user is served, seconds.
    pub on_air_s: f64,
    /// How long both vehicles are silent afterwards, seconds.
    pub silence_s: f64,
    /// Secret bits that the user gets, turns included.
    pub secrecy_volume_bits: f64,
    /// In order of time, from where the user's service begins to where the silence after it does.
    pub knots: Vec<KnotDocument>,
}

/// Poses and powers at an instant of a superframe.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KnotDocument {
    /// Seconds from the superframe's beginning, which is that of the first user's service.
    pub at_s: f64,
    /// The user who is served from here to the next knot; `null`: both vehicles are silent.
    pub served: Option<String>,
    /// `E[R]` from here to the next knot, bit/s.
    pub secrecy_rate_bps: f64,
    /// Poses here, and powers from here to the next knot. Roll and pitch run evenly to the next knot's while a user is served.
    pub vehicles: PerVehicle<VehicleDocument>,
    /// What may be wrong here at a cost of 2% of the rate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<ToleranceDocument>,
}

/// Errors of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ToleranceDocument {
    /// Of each vehicle's antenna axis, degrees.
    pub pointing_deg: PerVehicle<f64>,
    /// Of each vehicle's position, metres.
    pub position_m: PerVehicle<f64>,
}

impl TurningDocument {
    /// The document of one user's part. `users`: the mission's names.
    #[must_use]
    pub fn new(slot: &turning::Slot, users: &[&str]) -> Self {
        let knot = |knot: &Knot| KnotDocument {
            at_s: knot.at_s,
            served: knot.served.and_then(|user| users.get(user)).map(ToString::to_string),
            secrecy_rate_bps: knot.rate_bps,
            vehicles: knot.vehicles.map(VehicleDocument::from),
            tolerance: knot.tolerance.map(|tolerance| ToleranceDocument {
                pointing_deg: tolerance.pointing_rad.map(f64::to_degrees),
                position_m: tolerance.position_m,
            }),
        };
        Self {
            on_air_s: slot.on_air_s,
            silence_s: slot.silence_s,
            secrecy_volume_bits: slot.volume_bits,
            knots: slot.knots.iter().map(knot).collect(),
        }
    }
}

/// SINRs, linear.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SinrDocument {
    /// At the user.
    pub user: f64,
    /// At each eavesdropper.
    pub eavesdroppers: Vec<EavesdropperDocument>,
}

/// One eavesdropper's SINR.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EavesdropperDocument {
    /// Name in the mission file.
    pub name: String,
    /// Linear.
    pub sinr: f64,
}

/// One vehicle's pose and power.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "an object with `position_enu_m`, `roll_rad`, `pitch_rad`, `yaw_rad` and `tx_power_w`")]
pub struct VehicleDocument {
    /// East, north, up in metres.
    pub position_enu_m: [f64; 3],
    /// The paper's roll.
    pub roll_rad: f64,
    /// The paper's pitch.
    pub pitch_rad: f64,
    /// The paper's yaw.
    #[serde(default)]
    pub yaw_rad: f64,
    /// Transmit power in W.
    pub tx_power_w: f64,
    /// Follows from the angles; not read.
    #[serde(default, skip_deserializing)]
    pub antenna_axis_enu: [f64; 3],
}

impl SlotDocument {
    /// The document of one planned slot.
    #[must_use]
    pub fn new(
        user: &str,
        eavesdroppers: &[String],
        slot: &SlotPlan,
        (assessment, explanation): (&Assessment, &Explanation),
        attitude_tolerance_deg: PerVehicle<f64>,
        slot_s: f64,
        [planning_time_s, bound_time_s]: [f64; 2],
    ) -> Self {
        let sinrs = eavesdroppers.iter().zip(&slot.eavesdropper_sinr);
        Self {
            user: user.to_owned(),
            slot_s,
            status: status_name(slot.status),
            secrecy_rate_bps: slot.secrecy_rate_bps,
            standard_error_bps: slot.standard_error_bps,
            objective_bps: slot.objective_bps,
            quantile_5pct_bps: assessment.quantile_5pct_bps,
            miss_probability: assessment.miss_probability,
            loss_bps: losses(assessment),
            unprotected_rate_bps: explanation.unprotected_bps,
            best_unprotected_rate_bps: None,
            limits: explanation.limits.iter().copied().map(Limit::name).collect(),
            decisive_eavesdropper: eavesdroppers.get(explanation.decisive.eavesdropper).cloned(),
            without_decisive_bps: explanation.decisive.without_bps,
            upper_bound_bps: slot.upper_bound_bps,
            upper_bound_kind: slot.upper_bound_kind.name(),
            sinr: SinrDocument {
                user: slot.user_sinr,
                eavesdroppers: sinrs
                    .map(|(name, &sinr)| EavesdropperDocument { name: name.clone(), sinr })
                    .collect(),
            },
            vehicles: slot.vehicles.map(VehicleDocument::from),
            attitude_tolerance_deg,
            turning: None,
            planning_time_s,
            bound_time_s,
        }
    }
}

fn losses(assessment: &Assessment) -> BTreeMap<&'static str, f64> {
    let each = assessment.losses_bps.iter().map(|(cause, loss_bps)| (cause.name(), *loss_bps));
    each.chain([("all", assessment.loss_to_ideal_bps)]).collect()
}

impl From<VehiclePlan> for VehicleDocument {
    fn from(vehicle: VehiclePlan) -> Self {
        let pose = vehicle.pose;
        Self {
            position_enu_m: pose.position_enu_m.into(),
            roll_rad: pose.roll_rad,
            pitch_rad: pose.pitch_rad,
            yaw_rad: pose.yaw_rad,
            tx_power_w: vehicle.tx_power_w,
            antenna_axis_enu: pose.antenna_axis().into(),
        }
    }
}

impl From<VehicleDocument> for VehiclePlan {
    fn from(vehicle: VehicleDocument) -> Self {
        let pose = Pose {
            position_enu_m: Vector3::from(vehicle.position_enu_m),
            roll_rad: vehicle.roll_rad,
            pitch_rad: vehicle.pitch_rad,
            yaw_rad: vehicle.yaw_rad,
        };
        Self { pose, tx_power_w: vehicle.tx_power_w }
    }
}

/// The part of a plan document that `evaluate` needs; the rest may have been edited away.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(expecting = "an object with `format` and `slots`")]
pub struct EditedPlan {
    /// Must be [`FORMAT`].
    pub format: String,
    /// Of the mission it was made for.
    #[serde(default)]
    pub mission_digest: Option<String>,
    /// One per user to score.
    pub slots: Vec<EditedSlot>,
}

/// One slot to score.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(expecting = "an object with `user` and `vehicles`")]
pub struct EditedSlot {
    /// A user of the mission.
    pub user: String,
    /// How long the slot is, seconds: where the mission leaves that to the plan.
    #[serde(default)]
    pub slot_s: Option<f64>,
    /// Poses and powers.
    pub vehicles: PerVehicle<VehicleDocument>,
}

fn status_name(status: Status) -> &'static str {
    match status {
        Status::Evaluated => "evaluated",
        Status::Converged => "converged",
        Status::IterationLimit => "iteration-limit",
        Status::NoPositiveRate => "no-positive-rate",
    }
}
