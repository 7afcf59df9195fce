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
