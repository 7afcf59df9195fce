//! Where this vehicle should be, for the autopilot, and how it stands, for the peer.

use crate::autopilot::Setpoint;
use crate::pair::Local;
use crate::time::Instant;

use super::executive::Executive;

impl Executive {
    pub(super) fn feed_setpoint(&mut self, now: Instant) {
        if self.shutting_down.is_some() {
            return;
        }
        if let Some(motion) = &self.motion {
            let sample = motion.sample(now);
            let setpoint = Setpoint {
                position_enu_m: sample.position_enu_m,
                velocity_enu_m_s: sample.velocity_enu_m_s,
                attitude: sample.attitude,
            };
            self.autopilot.set_setpoint(setpoint, now);
        }
    }

    pub(super) fn tell_pair(&mut self, now: Instant) {
        let on_station = self.slot.as_ref().is_some_and(|slot| slot.monitor.check().is_ok())
            && self.autopilot.fresh(now)
            && self.autopilot.in_control();
        let state = self.autopilot.state();
        let local = Local {
            home_enu_m: self.home_enu_m,
            position_enu_m: state.position_enu_m.map(|p| p.value),
            preflight_ok: self.preflight_ok,
            airborne: self.phase.is_flying() && self.autopilot.in_control(),
            on_station,
            radiating: !self.interlock.is_off(now),
            ended: self.phase.is_ending(),
            returning: self.phase.is_returning(),
            paused: self.paused,
            landed: state.is_airborne() == Some(false),
        };
        self.pair.set_local(local, now);
    }
}
