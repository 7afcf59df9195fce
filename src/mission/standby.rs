//! On the ground, with an autopilot: everything is looked at, and nothing is asked of it before nothing is missing.

use crate::pair::orders::Order;
use crate::pair::wire::VeilwingFlags;
use crate::preflight::{Check, Verdict, check};
use crate::role::PerVehicle;
use crate::schedule::trajectory::Trajectory;
use crate::time::Instant;

use super::executive::Executive;
use super::itinerary::Itinerary;
use super::notice::Notice;
use super::permission::emits_until;
use super::phase::{Motion, Phase};
use super::start::{AHEAD, Awaited};

impl Executive {
    /// Takes off once nothing is missing.
    pub(super) fn stand_by(&mut self, now: Instant) {
        // A companion that comes back in flight knows neither its home nor who flies: it takes nothing over (F2).
        if self.home_enu_m.is_none() && !self.autopilot.state().is_armed() {
            self.home_enu_m = self.position();
        }
        if self.itinerary.is_none()
            && let Err(error) = self.make_itinerary()
        {
            self.ground.set_obstacle(std::slice::from_ref(&error));
            return self.wait_for(&[error], true, now);
        }
        let (mut missing, warnings) = self.ground.judge(&self.checks(now));
        warnings.into_iter().for_each(|warning| self.notice(warning));
        let failed = !self.ground.preflight_ok();
        missing.extend(self.peer_missing(now));
        missing.extend(self.await_start(&missing, now));
        let start = self.here().filter(|_| missing.is_empty());
        let Some(start) = start else { return self.wait_for(&missing, failed, now) };
        self.service.orders_mut().begin();
        self.notice(Notice::Emission(self.settings.permission.statement.clone()));
        self.notice(Notice::TakingOff);
        self.phase = Phase::TakingControl(Motion::new(Trajectory::rest(&start), now));
        self.autopilot.take_control(now);
    }

    /// Once nothing else is missing: has the mission begin if its time has come, and stands by a START that is pending.
    /// What is waited for.
    fn await_start(&mut self, missing: &[String], now: Instant) -> Option<String> {
        let pending = |e: &Self| e.service.orders().pending_start().is_some();
        let mut awaited = None;
        if missing.is_empty() && !pending(self) {
            let (utc, climb) = (self.autopilot.utc(now), self.climb_time());
            match self.ground.start.is_due(utc, climb, now) {
                Ok(()) => {
                    self.service.orders_mut().give(Order::Start, now);
                }
                Err(why) => awaited = Some(why),
            }
        }
        let ready = missing.is_empty() && awaited.is_none() && pending(self);
        self.service.orders_mut().set_ready(ready);
        match awaited {
            Some(Awaited::Time(text)) => {
                self.ground.set_obstacle(std::slice::from_ref(&text));
                return Some(text);
            }
            Some(Awaited::Order(text)) => {
                self.ground.set_obstacle(&[]);
                return Some(text);
            }
            None => self.ground.set_obstacle(missing),
        }
        let unconfirmed = ready && !self.service.orders().is_start_confirmed();
        unconfirmed.then(|| format!("vehicle {} to confirm the start", self.settings.role.peer()))
    }

    /// Once plan and both homes are known.
    fn make_itinerary(&mut self) -> Result<(), String> {
        let (Some(plan), Some(own), Some(peer)) =
            (&self.plan, self.home_enu_m, self.service.peer().home_enu_m)
        else {
            return Ok(());
        };
        let homes = PerVehicle::from_fn(|role| if role == self.settings.role { own } else { peer });
        let itinerary = Itinerary::new(plan, &homes, &self.settings).map_err(|error| error.to_string())?;
        self.service.set_plan(itinerary.terms(plan));
        self.ground.judge_returns(plan, own, &self.settings);
        self.itinerary = Some(itinerary);
        Ok(())
    }

    pub(super) fn wait_for(&mut self, missing: &[String], failed: bool, now: Instant) {
        if let Some(notice) = self.ground.wait_for(missing, failed, now) {
            self.notice(notice);
        }
    }

    /// Our own checks.
    fn checks(&self, now: Instant) -> Vec<Check> {
        let mut checks = self.autopilot.preflight(now);
        checks.extend(self.radio_checks(now));
        checks.extend(self.ground.plan_checks());
        checks.extend(self.settings.given_checks.iter().cloned());
        checks.extend(self.permission_check(now));
        checks.extend(self.endurance_check(now));
        if self.autopilot.state().is_armed() {
            let detail = "the vehicle is armed already: land and disarm it first";
            checks.push(check("disarmed", Verdict::Fail, detail));
        }
        checks.extend(self.kill_check());
        checks
    }

    /// Those of the radio: whether it is there, and whether it can do what the flight asks of it.
    fn radio_checks(&self, now: Instant) -> Vec<Check> {
        let interlock = self.service.interlock();
        let role = self.settings.role;
        let powers: Vec<(&str, f64)> = self.plan.iter().flat_map(|plan| plan.powers_w(role)).collect();
        let mut checks = interlock.transmitter().preflight(now);
        checks.extend(interlock.transmitter().compare(&self.settings.demands, &powers, interlock.ceiling()));
        checks
    }

    /// Whether the permission to radiate holds to the mission's end.
    fn permission_check(&self, now: Instant) -> Option<Check> {
        let utc = self.autopilot.utc(now);
        let emits_until = self.itinerary.as_ref().zip(utc).map(|(itinerary, utc)| {
            let climb = AHEAD + self.climb_time();
            emits_until(utc, self.settings.start_utc, climb, itinerary.airtime_ends())
        });
        self.settings.permission.check(utc, emits_until)
    }

    fn kill_check(&self) -> Option<Check> {
        let orders = self.service.orders();
        if !orders.is_killed() {
            return None;
        }
        let role = self.settings.role.peer();
        let detail = if orders.is_lifted_here_alone() {
            format!(
                "is lifted here and holds for vehicle {role}'s sake: lift it there too, or restart its companion on the ground"
            )
        } else {
            "holds: lift it at each vehicle (31011 with param1 = 1), or restart both companions on the ground"
                .to_owned()
        };
        Some(check("radio kill", Verdict::Fail, detail))
    }

    /// What the other vehicle owes.
    fn peer_missing(&self, now: Instant) -> Option<String> {
        let (peer, role) = (self.service.peer(), self.settings.role.peer());
        if !peer.heard_within(self.settings.pair.peer_timeout, now) {
            Some(format!("vehicle {role} is not heard"))
        } else if peer.says(VeilwingFlags::VEILWING_FLAGS_ENDED) {
            Some(format!("vehicle {role} has ended its mission: start its companion again"))
        } else if !self.service.agrees() {
            Some(self.disagreement())
        } else if !peer.says(VeilwingFlags::VEILWING_FLAGS_PREFLIGHT_OK)
            && !peer.says(VeilwingFlags::VEILWING_FLAGS_AIRBORNE)
        {
            Some(format!("vehicle {role} is not ready"))
        } else if !self.service.clocks_agree() {
            Some(self.clocks_apart())
        } else {
            None
        }
    }

    /// Why slots cannot be agreed on by the two autopilots' clocks.
    fn clocks_apart(&self) -> String {
        let (own, peer) = (self.settings.role, self.settings.role.peer());
        match self.service.clock_offset_s() {
            None => format!("the autopilot's clock of vehicle {peer} is not compared with this one's yet"),
            Some(s) => {
                let (late, early) = if s < 0.0 { (peer, own) } else { (own, peer) };
                format!(
                    "the autopilot's clock of vehicle {late} is {:.2} s behind that of vehicle {early}: one of them has no GPS time yet",
                    s.abs()
                )
            }
        }
    }

    /// Why missions and plans of both are not known to be the same.
    fn disagreement(&self) -> String {
        let (peer, role) = (self.service.peer(), self.settings.role.peer());
        match (peer.mission_digest, peer.plan_digest, &self.itinerary) {
            (None, ..) => format!("vehicle {role} has not said yet which mission it flies"),
            (Some(digest), ..) if digest != self.settings.pair.mission_digest => {
                Notice::MissionDiffers(role).to_string()
            }
            _ if peer.home_enu_m.is_none() => format!("vehicle {role} does not know yet where it stands"),
            (_, None, _) => format!("vehicle {role} has not made its plan yet"),
            (.., None) => "this vehicle has not made its plan yet".to_owned(),
            _ => Notice::PlanDiffers(role).to_string(),
        }
    }
}
