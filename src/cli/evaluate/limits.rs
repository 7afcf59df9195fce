//! What of an edited plan no transmitter could do, and what in it the mission does not allow.

use crate::config::Mission;
use crate::geo::polygon::Polygon;
use crate::planner::document::{EditedPlan, EditedSlot, VehicleDocument};
use crate::planner::plan::VehiclePlan;
use crate::role::Role;
use crate::units::Watts;

/// Larger figures make no sense, and the sums behind a rate overflow.
const LARGEST_POWER_W: f64 = 1e6;
const FARTHEST_M: f64 = 1e6;
/// Less than this beyond a limit is rounding: of an angle written in degrees, of a plan at its bound.
const ROUNDING: f64 = 1e-9;

/// # Errors
/// The first figure that cannot be scored, with its key, value and limit.
pub(super) fn possible(edited: &EditedPlan) -> Result<(), String> {
    edited.slots.iter().enumerate().try_for_each(|(index, slot)| possible_slot(index, slot))
}

fn possible_slot(index: usize, slot: &EditedSlot) -> Result<(), String> {
    for role in Role::BOTH {
        let vehicle = &slot.vehicles[role];
        let path = format!("slots[{index}].vehicles.{}", role.key());
        if !(0.0..=LARGEST_POWER_W).contains(&vehicle.tx_power_w) {
            return Err(format!(
                "{path}.tx_power_w is {:e} W; give a power from 0 to {LARGEST_POWER_W:e} W",
                vehicle.tx_power_w
            ));
        }
        if let Some(far_m) = vehicle.position_enu_m.iter().find(|m| m.abs() > FARTHEST_M) {
            return Err(format!(
                "{path}.position_enu_m holds {far_m:e} m; give metres east, north and up of the mission origin, at most {FARTHEST_M:e}"
            ));
        }
    }
    Ok(())
}

/// What is scored although the mission would not let it be flown.
pub(super) fn exceeded(mission: &Mission, edited: &EditedPlan) -> Vec<String> {
    let mut all = Vec::new();
    if edited.mission_digest.as_ref().is_some_and(|digest| *digest != mission.digest_hex()) {
        all.push("made for another mission, or for this one before it was edited".to_owned());
    }
    let area = Polygon::new(&mission.airspace.area_enu_m).ok();
    for (index, slot) in edited.slots.iter().enumerate() {
        let mut note = |text: String| all.push(format!("slots[{index}] ({}): {text}", slot.user));
        for role in Role::BOTH {
            check_vehicle(mission, area.as_ref(), role, &slot.vehicles[role], &mut note);
        }
        let apart_m = distance_m(&slot.vehicles.i, &slot.vehicles.j);
        let least_m = mission.airspace.min_separation_m;
        if apart_m < least_m - ROUNDING {
            note(format!(
                "the vehicles are {apart_m:.3} m apart, closer than min_separation_m of {least_m} m"
            ));
        }
    }
    all
}

fn check_vehicle(
    mission: &Mission,
    area: Option<&Polygon>,
    role: Role,
    vehicle: &VehicleDocument,
    note: &mut impl FnMut(String),
) {
    let [east, north, up] = vehicle.position_enu_m;
    let [low, high] = mission.airspace.altitude_m;
    if up < low - ROUNDING || up > high + ROUNDING {
        note(format!("{role} is at {up} m, outside altitude_m of {low} to {high} m"));
    }
    let at = nalgebra::Vector2::new(east, north);
    // A plan at the border may lie outside by its last bit.
    if area.is_some_and(|area| !area.contains(at, ROUNDING)) {
        note(format!("{role} is at [{east}, {north}] m, outside area_enu_m"));
    }
    for no_fly in &mission.airspace.no_fly {
        if no_fly.depth_m(&vehicle.position_enu_m.into()) > ROUNDING {
            note(format!("{role} is at [{east}, {north}, {up}] m, inside the no-fly area {:?}", no_fly.name));
        }
    }
    let tilt_rad = VehiclePlan::from(vehicle.clone()).pose.attitude().tilt_rad();
    let limit_rad = mission.vehicles[role].max_tilt_rad.min(mission.airspace_max_tilt_rad);
    if tilt_rad > limit_rad + ROUNDING {
        let [tilt, limit] = [tilt_rad, limit_rad].map(f64::to_degrees);
        note(format!("{role} is tilted by {tilt:.2} deg, more than max_tilt_deg of {limit:.2}"));
    }
    let (limit_w, limit) = mission.power_ceiling(role);
    if vehicle.tx_power_w > limit_w * (1.0 + ROUNDING) {
        note(format!(
            "{role} radiates {}, more than the {} of {}",
            Watts(vehicle.tx_power_w),
            Watts(limit_w),
            limit.key()
        ));
    }
}

fn distance_m(i: &VehicleDocument, j: &VehicleDocument) -> f64 {
    (nalgebra::Vector3::from(i.position_enu_m) - nalgebra::Vector3::from(j.position_enu_m)).norm()
}
