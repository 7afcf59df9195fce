//! What the settings of the link cannot be together: powers that a radio cannot give, keys that say nothing, and what a
//! planning method does not know of.

use super::document::Document;
use super::draft::{MissionDraft, PlannedVehicleDraft};
use super::mission_checks::refuse;
use super::mission_file::METHODS;
use crate::planner::problem::Method;
use crate::role::Role;

/// Adds what is wrong. Settings already refused are left out.
pub(super) fn check(draft: &MissionDraft, file: &mut Document) {
    for role in Role::BOTH {
        powers(draft, role, file);
    }
    antennas(file);
}

fn powers(draft: &MissionDraft, role: Role, file: &mut Document) {
    let path = |key: &str| format!("vehicles.{}.{key}", role.key());
    let (least, levels) = (path("min_power_w"), path("power_levels_w"));
    if !file.sound(&[&least, &levels, "radio.max_power_w", "emission.max_power_w"]) {
        return;
    }
    let PlannedVehicleDraft { min_power_w, power_levels_w, .. } = &draft.vehicles[role];
    let (ceiling_w, limit) = draft.power_ceiling(role);
    let ceiling = limit.key();
    if let Some(least_w) = min_power_w
        && *least_w > ceiling_w
    {
        let message = format!(
            "`min_power_w` of {least_w} W is above the {ceiling_w} W of {ceiling}: {role} could never radiate"
        );
        refuse(
            file,
            &least,
            message,
            "give the least power that the transmitter can radiate, or raise the ceiling",
        );
    }
    method(draft, file, if power_levels_w.is_some() { &levels } else { &least });
    let Some(levels_w) = power_levels_w else { return };
    if let Some(pair) = levels_w.windows(2).find(|pair| pair[0] >= pair[1]) {
        let message = format!("`power_levels_w` does not rise: {} W comes before {} W", pair[0], pair[1]);
        refuse(file, &levels, message, "list each power once, the least first; off is always possible");
    } else if levels_w.first().is_some_and(|lowest_w| *lowest_w > ceiling_w) {
        let message = format!(
            "the lowest of `power_levels_w`, {} W, is above the {ceiling_w} W of {ceiling}: {role} could never radiate",
            levels_w[0]
        );
        refuse(file, &levels, message, "list a level within the ceiling, or raise it");
    }
}

/// The paper's methods vary powers from 0 to the ceiling.
fn method(draft: &MissionDraft, file: &mut Document, path: &str) {
    const METHOD: &str = "planner.method";
    let method = draft.planner.method;
    if method != Method::Veilwing && file.sound(&[METHOD]) && file.given(path) {
        let name = METHODS.iter().find(|(_, known)| *known == method).map_or("", |(name, _)| name);
        let message = format!("`method` is {name:?}, which knows nothing of `{path}` and plans any power");
        refuse(file, METHOD, message, "plan with \"veilwing\", or leave the key out");
    }
}

fn antennas(file: &mut Document) {
    let both = ["antenna.null_depth_db", "antenna.pattern_file"].into_iter().find(|key| file.given(key));
    if let Some(key) = both
        && file.given("antenna.i")
        && file.given("antenna.j")
    {
        let message = format!("`{key}` has no effect: both vehicles have an antenna of their own");
        refuse(file, key, message, "remove it, or one of [antenna.i] and [antenna.j]");
    }
}
