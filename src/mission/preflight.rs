//! On the ground: what speaks against a take-off, in words for the operator, and the take-off once nothing does.

use mavlink::dialects::ardupilotmega::MavSeverity;

use crate::pair::wire::VeilwingFlags;
use crate::planner::slots::Plan;
use crate::preflight::{Check, Verdict, check};
use crate::schedule::trajectory::Trajectory;
use crate::schedule::transit::Router;
use crate::time::Instant;

use super::executive::{Executive, Motion, Settings};
use super::flight::Phase;
use super::waiting::Waiting;

/// What the time on the ground leaves behind.
#[derive(Debug, Default)]
pub(super) struct Preflight {
    /// Whether the fence holds the plan; `None` without a plan.
    geofence: Option<Check>,
    waiting: Waiting,
    /// Warnings told, each once: their text without its figures.
    warnings: Vec<String>,
}

impl Executive {
    /// Takes off once nothing is missing.
    pub(super) fn stand_by(&mut self, now: Instant) {
        // A companion that comes back in flight knows neither its home nor who flies: it takes nothing over (F2).
        if self.home_enu_m.is_none() && !self.autopilot.state().is_armed() {
            self.home_enu_m = self.position();
        }
        if let Err(error) = self.make_table() {
            return self.wait_for(&[error.to_string()], true, now);
        }
        let checks = self.checks(now);
        let worded = |verdict: Verdict| {
            let of_it = checks.iter().filter(move |check| check.result == verdict);
            of_it.map(|check| format!("{}: {}", check.name, check.detail)).collect::<Vec<_>>()
        };
        let mut missing = worded(Verdict::Fail);
        self.preflight_ok = missing.is_empty();
        if self.preflight_ok {
            self.warn(worded(Verdict::Warn));
        }
        let failed = !self.preflight_ok;
        missing.extend(self.peer_missing(now));
        if missing.is_empty() {
            let (utc, climb) = (self.autopilot.utc(now), self.climb_time());
            missing.extend(self.start.waits_for(utc, climb));
        }
        if !missing.is_empty() {
            return self.wait_for(&missing, failed, now);
        }
        self.notice(MavSeverity::MAV_SEVERITY_INFO, "preflight passed, taking off".into());
        self.motion =
            self.here().map(|start| Motion { trajectory: Trajectory::rest(&start), starts_at: now });
        self.autopilot.take_control(now);
        self.enter(Phase::TakingControl, now);
    }

    /// Judges a plan that has just come.
    pub(super) fn check_plan(&mut self, plan: &Plan) {
        self.preflight.geofence = Some(geofence(plan, &self.settings));
    }

    /// Our own checks.
    fn checks(&self, now: Instant) -> Vec<Check> {
        let mut checks = self.autopilot.preflight(now);
        checks.extend(self.interlock.transmitter().preflight());
        let planned = self.preflight.geofence.clone();
        checks.push(planned.unwrap_or_else(|| check("plan", Verdict::Fail, "is being made")));
        if self.autopilot.state().is_armed() {
            let detail = "the vehicle is armed already: land and disarm it first";
            checks.push(check("disarmed", Verdict::Fail, detail));
        }
        checks
    }

    /// What the other vehicle owes.
    fn peer_missing(&self, now: Instant) -> Option<String> {
        let (peer, role) = (self.pair.peer(), self.settings.role.peer());
        if !peer.heard_within(self.settings.pair.peer_timeout, now) {
            Some(format!("vehicle {role} is not heard"))
        } else if !self.pair.agrees() {
            Some("missions and plans of both vehicles are not yet known to be the same".into())
        } else if !peer.says(VeilwingFlags::VEILWING_FLAGS_PREFLIGHT_OK)
            && !peer.says(VeilwingFlags::VEILWING_FLAGS_AIRBORNE)
        {
            Some(format!("vehicle {role} is not ready"))
        } else {
            None
        }
    }

    /// Says what is waited for when it has changed, and what fails again and again.
    fn wait_for(&mut self, missing: &[String], failed: bool, now: Instant) {
        let waiting = &mut self.preflight.waiting;
        let (severity, text) = match waiting.news(&missing.join("; "), now) {
            Some(text) => (MavSeverity::MAV_SEVERITY_INFO, Some(text)),
            None if failed => (MavSeverity::MAV_SEVERITY_WARNING, waiting.again(now)),
            None => return,
        };
        if let Some(text) = text {
            self.notice(severity, format!("waiting: {text}"));
        }
    }

    fn warn(&mut self, warnings: Vec<String>) {
        for warning in warnings {
            let kind = warning.replace(|c: char| c.is_ascii_digit(), "");
            if !self.preflight.warnings.contains(&kind) {
                self.preflight.warnings.push(kind);
                let text = format!("preflight warning: {warning}");
                self.notice(MavSeverity::MAV_SEVERITY_WARNING, text);
            }
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
