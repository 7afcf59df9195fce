//! How far a vehicle may lean in a slot.
//!
//! A conventional vehicle stands against the wind by leaning into it: some 5 deg in a wind of 5 m/s. How much of that a slot
//! bears is a question to its plan: a level dipole that stands aside loses next to nothing by it, a jammer above its user moves
//! its null off that user. So a slot is served up to the tilt, in whatever direction, that
//!
//! - leaves half of the slot's rate, and the mission's target where the plan reaches that: less is worth less than silence;
//! - leaves the null of J's antenna on the user: 13 dB below the largest gain, or at most twice what the plan has there (S2). 13 dB is what
//!   a pose may be off by where the jitter is 10 deg (13 deg), as deep as S2 has ever asked for.
//!
//! Each vehicle is asked by itself, the other one in its pose. A vehicle that tilts without moving has no reason to lean: of
//! such a one nothing is said here, and what it may be off is what control and estimator leave
//! ([`Tolerance`](crate::service::Tolerance)).

use nalgebra::Vector3;

use crate::planner::plan::VehiclePlan;
use crate::planner::problem::{Airframe, Objective, Problem};
use crate::planner::{EvaluateOptions, PlanError, evaluate};
use crate::radio::pattern::canonical_angles;
use crate::role::{PerVehicle, Role};

/// No lean is allowed beyond this, deg: in a wind that asks for more a vehicle has little left to hold its place by.
pub const MOST_DEG: u32 = 15;
/// The share of the slot's rate that is left.
pub const LEAST_SHARE: f64 = 0.5;
/// What is still a null: 13 dB below the largest gain ...
const NULL_GAIN: f64 = 0.050_118_723_362_727_23;
/// ... or so many times what the plan has there.
const NULL_RATIO: f64 = 2.0;
/// Tilts are looked at in so many directions.
const DIRECTIONS: u32 = 8;
/// Samples of a rate: half of it is not a matter of a hundredth.
const SAMPLES: usize = 512;

/// The largest tilt from its pose that the slot bears of each vehicle, radians, in whole degrees; `None` of one that does not lean.
/// `target_bps`: a rate that is counted on.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn borne(
    problem: &Problem,
    vehicles: &PerVehicle<VehiclePlan>,
    target_bps: Option<f64>,
) -> Result<PerVehicle<Option<f64>>, PlanError> {
    let mut borne = PerVehicle { i: None, j: None };
    let leaning = |role: &Role| problem.vehicles[*role].airframe == Airframe::Conventional;
    if !Role::BOTH.iter().any(leaning) {
        return Ok(borne);
    }
    // The rate alone is asked for, not what a quantile or a worst case would be.
    let problem = Problem { objective: Objective::Mean, ..problem.clone() };
    let options = EvaluateOptions { samples: SAMPLES, ..EvaluateOptions::default() };
    let rate = |vehicles: &PerVehicle<VehiclePlan>| {
        evaluate(&problem, vehicles, &options).map(|found| found.secrecy_rate_bps)
    };
    let planned_bps = rate(vehicles)?;
    let target_bps = target_bps.filter(|target_bps| *target_bps <= planned_bps).unwrap_or(0.0);
    let least_bps = target_bps.max(LEAST_SHARE * planned_bps);
    let heard = |vehicles: &PerVehicle<VehiclePlan>| {
        let pose = &vehicles.j.pose;
        problem.antennas.j.gain(&(problem.user_enu_m - pose.position_enu_m), &pose.antenna_axis())
    };
    let most_heard = NULL_GAIN.max(NULL_RATIO * heard(vehicles));
    for role in Role::BOTH.into_iter().filter(leaning) {
        let bears = |deg: u32| -> Result<bool, PlanError> {
            for direction in 0..DIRECTIONS {
                let tilted = tilted(vehicles, role, f64::from(deg).to_radians(), direction);
                if heard(&tilted) > most_heard || rate(&tilted)? < least_bps {
                    return Ok(false);
                }
            }
            Ok(true)
        };
        let mut most = 0;
        // A slot of no rate is radiated by nobody.
        while planned_bps > 0.0 && most < MOST_DEG && bears(most + 1)? {
            most += 1;
        }
        borne[role] = Some(f64::from(most).to_radians());
    }
    Ok(borne)
}

/// The same with one vehicle's antenna tilted by `angle_rad` towards one of the directions.
fn tilted(
    vehicles: &PerVehicle<VehiclePlan>,
    role: Role,
    angle_rad: f64,
    direction: u32,
) -> PerVehicle<VehiclePlan> {
    let mut tilted = *vehicles;
    let pose = &mut tilted[role].pose;
    let axis = pose.antenna_axis();
    let aside = axis.cross(&Vector3::y()).normalize();
    let (sin, cos) = libm::sincos(f64::from(direction) * std::f64::consts::TAU / f64::from(DIRECTIONS));
    let towards = aside * cos + axis.cross(&aside) * sin;
    let (sin, cos) = libm::sincos(angle_rad);
    (pose.roll_rad, pose.pitch_rad) = canonical_angles(&(axis * cos + towards * sin));
    pose.yaw_rad = 0.0;
    tilted
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Pose;
    use crate::radio::antenna::Pattern;

    fn level(x: f64, tx_power_w: f64) -> VehiclePlan {
        let position_enu_m = Vector3::new(x, 0.0, 100.0);
        VehiclePlan { pose: Pose { position_enu_m, roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 }, tx_power_w }
    }

    fn conventional() -> Problem {
        let mut problem = Problem::paper([[1e5, 0.0]], 0.5, 0.0);
        problem.vehicles.i.airframe = Airframe::Conventional;
        problem.vehicles.j.airframe = Airframe::Conventional;
        problem
    }

    fn degrees(borne: PerVehicle<Option<f64>>) -> [f64; 2] {
        [borne.i, borne.j].map(|rad| rad.unwrap().to_degrees().round())
    }

    #[test]
    fn spec_a_vehicle_that_tilts_without_moving_has_no_reason_to_lean() {
        let problem = Problem::paper([[1e5, 0.0]], 0.5, 0.0);
        let vehicles = PerVehicle { i: level(100.0, 0.5), j: level(0.0, 1e-6) };
        assert_eq!(borne(&problem, &vehicles, None).unwrap(), PerVehicle { i: None, j: None });
    }

    /// J above its user, a null without a floor: what the user hears of it goes with the square of the sine of its lean.
    #[test]
    fn val_a_jammer_above_its_user_may_lean_until_half_of_the_rate_is_gone() {
        let problem = conventional();
        let vehicles = PerVehicle { i: level(100.0, 0.5), j: level(0.0, 1e-3) };
        let rate = |deg: f64| {
            let heard = 1e9 / 1e4 * deg.to_radians().sin().powi(2);
            (1.0 + 1.25e7 / (1.0 + heard)).log2()
        };
        // The eavesdropper, a hundred kilometres away, takes I's own share alone, which leaning J does not change.
        let eavesdropper = (1.0f64 + 0.5e12 / 1e10 / (1.0 + 1e9 / 1e10)).log2();
        let share = |deg| (rate(deg) - eavesdropper) / (rate(0.0) - eavesdropper);
        let expected = (1..=15).map(f64::from).filter(|deg| share(*deg) >= 0.5).fold(0.0, f64::max);
        assert!((2.0..8.0).contains(&expected), "{expected}");
        let found = degrees(borne(&problem, &vehicles, None).unwrap());
        assert_eq!(found[1], expected, "{found:?}");
        // I, aside of its user, loses a quarter of its gain at most: its lean is bounded by what holds for all.
        assert_eq!(found[0], f64::from(MOST_DEG), "{found:?}");
    }

    /// A jammer of next to no power costs no rate; its null is kept all the same.
    #[test]
    fn val_the_null_stays_13_db_deep_or_within_twice_of_what_it_was() {
        let mut problem = conventional();
        let vehicles = PerVehicle { i: level(100.0, 0.5), j: level(0.0, 1e-12) };
        // 10 lg sin^2(12.94 deg) = -13.
        assert_eq!(degrees(borne(&problem, &vehicles, None).unwrap())[1], 12.0);
        // A floor of 20 dB takes its share: 11.6 deg.
        problem.antennas.j = Pattern::with_null_depth(20.0);
        assert_eq!(degrees(borne(&problem, &vehicles, None).unwrap())[1], 11.0);
        // One that stands aside has no null there to lose.
        let aside = PerVehicle { j: level(-100.0, 1e-12), ..vehicles };
        assert_eq!(degrees(borne(&problem, &aside, None).unwrap())[1], f64::from(MOST_DEG));
    }

    #[test]
    fn spec_a_rate_that_is_counted_on_is_kept_where_the_plan_has_it() {
        let problem = conventional();
        let vehicles = PerVehicle { i: level(100.0, 0.5), j: level(0.0, 1e-3) };
        let planned_bps =
            evaluate(&problem, &vehicles, &EvaluateOptions::default()).unwrap().secrecy_rate_bps;
        let lean = |target_bps| degrees(borne(&problem, &vehicles, Some(target_bps)).unwrap())[1];
        let without = degrees(borne(&problem, &vehicles, None).unwrap())[1];
        assert_eq!(lean(0.99 * planned_bps), 0.0);
        assert!((1.0..without).contains(&lean(0.7 * planned_bps)));
        assert_eq!(lean(1.01 * planned_bps), without);
    }

    #[test]
    fn val_a_tilt_is_by_the_angle_that_was_asked_for_and_each_direction_another() {
        let vehicles = PerVehicle { i: level(100.0, 0.5), j: level(0.0, 1e-3) };
        let axes: Vec<_> =
            (0..DIRECTIONS).map(|k| tilted(&vehicles, Role::J, 0.1, k).j.pose.antenna_axis()).collect();
        for (k, axis) in axes.iter().enumerate() {
            assert!((axis.angle(&Vector3::z()) - 0.1).abs() < 1e-12);
            assert!(axes[..k].iter().all(|other| other.angle(axis) > 0.07), "{axes:?}");
        }
        assert_eq!(tilted(&vehicles, Role::J, 0.1, 0).i, vehicles.i);
    }
}
