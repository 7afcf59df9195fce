//! What is said of how far this vehicle may lean in the wind.

use crate::planner::slots::Plan;
use crate::preflight::{self, Check, Verdict};
use crate::role::Role;
use crate::service::Tolerance;

/// A wind of 5 m/s leans a multirotor by 4 to 6 deg: a slot that bears less is not served in a breeze.
const BREEZE_DEG: f64 = 6.0;

/// By user, the largest tilt from its pose in degrees with which `role` serves the slot; empty for a vehicle that does not lean.
fn leans(plan: &Plan, role: Role, held: Tolerance) -> impl Iterator<Item = (&str, f64)> {
    let leaning = plan.slots.iter().filter_map(move |slot| Some((slot, slot.lean_rad[role]?)));
    leaning
        .map(move |(slot, lean_rad)| (slot.user.as_str(), held.leaning(lean_rad).attitude_rad.to_degrees()))
}

fn worded<'a>(leans: impl Iterator<Item = (&'a str, f64)>) -> Option<String> {
    let words: Vec<_> = leans.map(|(user, deg)| format!("{deg:.1} deg for {user}")).collect();
    (!words.is_empty()).then(|| words.join(", "))
}

/// By how much the vehicle may lean in each slot; `None` of one that has no reason to.
pub(super) fn told(plan: &Plan, role: Role, held: Tolerance) -> Option<String> {
    worded(leans(plan, role, held))
}

/// Whether the plan bears a breeze; `None` of a vehicle that does not lean.
pub(super) fn check(plan: &Plan, role: Role, held: Tolerance) -> Option<Check> {
    let all = told(plan, role, held)?;
    Some(match worded(leans(plan, role, held).filter(|(_, deg)| *deg < BREEZE_DEG)) {
        None => preflight::check("lean", Verdict::Pass, format!("the plan bears {all}")),
        Some(few) => {
            let detail = format!(
                "the plan bears {few}; a wind of 5 m/s leans a vehicle by 4 to 6: wait for calm air, or place the nodes otherwise"
            );
            preflight::check("lean", Verdict::Warn, detail)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Enu, Pose};
    use crate::planner::plan::{BoundKind, SlotPlan, Status, VehiclePlan};
    use crate::planner::slots::PlannedSlot;
    use crate::role::PerVehicle;

    fn plan(leans_deg: [Option<f64>; 2]) -> Plan {
        let pose = Pose { position_enu_m: Enu::zeros(), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        let vehicle = VehiclePlan { pose, tx_power_w: 0.5 };
        let plan = SlotPlan {
            status: Status::Converged,
            vehicles: PerVehicle { i: vehicle, j: vehicle },
            secrecy_rate_bps: 1.0,
            standard_error_bps: 0.0,
            objective_bps: 1.0,
            upper_bound_bps: 2.0,
            upper_bound_kind: BoundKind::Cap,
            user_sinr: 1.0,
            eavesdropper_sinr: vec![],
        };
        let slot = |user: &str, deg: Option<f64>| PlannedSlot {
            user: user.into(),
            plan: plan.clone(),
            lean_rad: PerVehicle { i: None, j: deg.map(f64::to_radians) },
            length: None,
        };
        Plan::new(vec![slot("alpha", leans_deg[0]), slot("bravo", leans_deg[1])])
    }

    #[test]
    fn spec_a_vehicle_is_told_how_far_it_may_lean_and_warned_where_a_breeze_is_more() {
        let held = Tolerance::for_jitter(2f64.to_radians());
        let wide = plan([Some(12.0), Some(9.0)]);
        assert_eq!(told(&wide, Role::J, held).unwrap(), "12.0 deg for alpha, 9.0 deg for bravo");
        assert_eq!(check(&wide, Role::J, held).unwrap().result, Verdict::Pass);
        // What holds for every vehicle holds for one whose plan bears no lean.
        let narrow = plan([Some(0.0), Some(9.0)]);
        assert_eq!(told(&narrow, Role::J, held).unwrap(), "5.0 deg for alpha, 9.0 deg for bravo");
        let warned = check(&narrow, Role::J, held).unwrap();
        assert_eq!(warned.result, Verdict::Warn);
        assert!(warned.detail.starts_with("the plan bears 5.0 deg for alpha;"), "{}", warned.detail);
        assert!(told(&wide, Role::I, held).is_none() && check(&wide, Role::I, held).is_none());
    }
}
