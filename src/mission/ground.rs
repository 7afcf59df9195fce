//! On the ground: what speaks against a take-off.

use crate::geo::Enu;
use crate::planner::slots::Plan;
use crate::preflight::{Check, Verdict, check};
use crate::role::Role;
use crate::schedule::transit::Router;
use crate::service::Tolerance;
use crate::time::Instant;

use super::lean;
use super::notice::Notice;
use super::settings::Settings;
use super::start::Start;
use super::waiting::Waiting;

/// What the time on the ground leaves behind.
#[derive(Debug, Clone)]
pub(super) struct Ground {
    /// What the mission waits for to begin.
    pub start: Start,
    /// Whether the fence holds the plan; `None` without a plan.
    geofence: Option<Check>,
    /// Whether the plan bears a lean, of a vehicle that leans.
    lean: Option<Check>,
    /// Whether the autopilot's own ways home stay out of the no-fly areas, once the home is known.
    returns: Option<Check>,
    preflight_ok: bool,
    /// What a MISSION_START would be refused for; empty: nothing.
    obstacle: String,
    waiting: Waiting,
    /// Warnings told, each once: their text without its figures.
    warnings: Vec<String>,
}

impl Ground {
    /// Nothing is known to speak for a take-off yet.
    pub fn new(start: Start) -> Self {
        Self {
            start,
            geofence: None,
            lean: None,
            returns: None,
            preflight_ok: false,
            obstacle: "the autopilot's state is not known yet".to_owned(),
            waiting: Waiting::default(),
            warnings: Vec::new(),
        }
    }

    /// Whether no check failed when they were made last.
    pub fn preflight_ok(&self) -> bool {
        self.preflight_ok
    }

    /// What a MISSION_START is refused for; empty: nothing.
    pub fn obstacle(&self) -> &str {
        &self.obstacle
    }

    /// What is missing speaks against a MISSION_START, too.
    pub fn set_obstacle(&mut self, missing: &[String]) {
        self.obstacle = missing.join("; ");
    }

    /// Judges a plan that has just come.
    pub fn judge_plan(&mut self, plan: &Plan, settings: &Settings, held: Tolerance) {
        self.geofence = Some(geofence(plan, settings));
        self.lean = lean::check(plan, settings.role, held);
    }

    /// What is known of the plan.
    pub fn plan_checks(&self) -> impl Iterator<Item = Check> {
        let geofence = self.geofence.clone().unwrap_or_else(|| check("plan", Verdict::Fail, "is being made"));
        std::iter::once(geofence).chain(self.lean.clone()).chain(self.returns.clone())
    }

    /// Judges what the autopilot would do by itself, once plan and home are known.
    pub fn judge_returns(&mut self, plan: &Plan, home: Enu, settings: &Settings) {
        self.returns = returns(plan, home, settings);
    }

    /// Takes in all checks: gives back what fails, and what the operator is to be warned of.
    pub fn judge(&mut self, checks: &[Check]) -> (Vec<String>, Vec<Notice>) {
        let worded = |verdict: Verdict| {
            let of_it = checks.iter().filter(move |check| check.result == verdict);
            of_it.map(|check| format!("{}: {}", check.name, check.detail)).collect::<Vec<_>>()
        };
        let failed = worded(Verdict::Fail);
        self.preflight_ok = failed.is_empty();
        let mut warnings = if self.preflight_ok { worded(Verdict::Warn) } else { Vec::new() };
        warnings.retain(|warning| {
            let kind = warning.replace(|c: char| c.is_ascii_digit(), "");
            let new = !self.warnings.contains(&kind);
            if new {
                self.warnings.push(kind);
            }
            new
        });
        (failed, warnings.into_iter().map(Notice::PreflightWarning).collect())
    }

    /// What is missing, if that has changed; again and again where `failed`.
    pub fn wait_for(&mut self, missing: &[String], failed: bool, now: Instant) -> Option<Notice> {
        match self.waiting.news(&missing.join("; "), now) {
            Some(text) => Some(Notice::Waiting { text, again: false }),
            None if failed => self.waiting.again(now).map(|text| Notice::Waiting { text, again: true }),
            None => None,
        }
    }
}

/// Whether the fence and the altitude band hold every pose that the plan has for us.
fn geofence(plan: &Plan, settings: &Settings) -> Check {
    let router = match Router::new(&settings.airspace, &settings.limits) {
        Ok(router) => router,
        Err(error) => return check("geofence", Verdict::Fail, error.to_string()),
    };
    let poses = plan.slots.iter().map(|slot| (slot, slot.plan.vehicles[settings.role].pose.position_enu_m));
    let outside = poses.into_iter().find(|(_, at)| !router.holds(at));
    match outside {
        None => check("geofence", Verdict::Pass, format!("holds all {} poses", plan.slots.len())),
        Some((slot, at)) => {
            let [low_m, high_m] = settings.airspace.altitude_m;
            let detail = format!(
                "the pose for {} at {:.1}, {:.1}, {:.1} m is outside; it should be within the area and {low_m} to {high_m} m",
                slot.user, at.x, at.y, at.z
            );
            check("geofence", Verdict::Fail, detail)
        }
    }
}

/// Whether the autopilot's own ways, straight home and straight down, stay out of the no-fly areas, which it knows little or
/// nothing of; `None` where there are no such areas.
pub(super) fn returns(plan: &Plan, home: Enu, settings: &Settings) -> Option<Check> {
    if settings.airspace.no_fly.is_empty() {
        return None;
    }
    let router = Router::new(&settings.airspace, &settings.limits).ok()?;
    let [low_m, high_m] = settings.airspace.altitude_m;
    // The half of the band in which this vehicle's autopilot is to return.
    let middle_m = 0.5 * (low_m + high_m);
    let return_m = if settings.role == Role::I { [low_m, middle_m] } else { [middle_m, high_m] };
    let mut told: Vec<String> = Vec::new();
    for slot in &plan.slots {
        let at = slot.plan.vehicles[settings.role].pose.position_enu_m;
        let altitude_m = return_m.map(|altitude_m| altitude_m.max(at.z));
        let home_ways = router.crossed_straight_home(&at, &home, altitude_m).into_iter();
        let ways = home_ways.map(|area| format!("straight home from the pose for {} {area:?}", slot.user));
        let down = router.crossed_straight_down(&at).into_iter();
        told.extend(ways.chain(down.map(|area| format!("straight down from it for {} {area:?}", slot.user))));
    }
    if told.is_empty() {
        let detail = "the autopilot's own ways home and down from all poses stay out of the no-fly areas";
        return Some(check("own return", Verdict::Pass, detail));
    }
    let detail = format!(
        "without its companion the autopilot would cross no-fly areas, {}; should be none: move a home, or see that this may be",
        told.join(", ")
    );
    Some(check("own return", Verdict::Warn, detail))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_a_warning_is_told_once_whatever_its_figures_and_never_while_a_check_fails() {
        let mut ground = Ground::new(Start::new(false, None, false, Instant::ZERO));
        let warn = |mw: u32| check("transmitter", Verdict::Warn, format!("{mw} mW"));
        let fail = check("plan", Verdict::Fail, "is being made");
        let (failed, told) = ground.judge(&[warn(1), fail]);
        assert_eq!((failed, told), (vec!["plan: is being made".to_owned()], vec![]));
        assert!(!ground.preflight_ok());
        let (failed, told) = ground.judge(&[warn(2)]);
        assert!(failed.is_empty() && ground.preflight_ok());
        assert_eq!(told, [Notice::PreflightWarning("transmitter: 2 mW".into())]);
        assert_eq!(ground.judge(&[warn(3)]).1, []);
    }
}
