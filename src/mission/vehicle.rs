//! Where this vehicle should be, for the autopilot, and how it stands, for the service.

use crate::autopilot::Setpoint;
use crate::service::{Slot, Vehicle};
use crate::time::Instant;

use super::executive::Executive;

impl Executive {
    pub(super) fn feed_setpoint(&mut self, now: Instant) {
        if self.is_stopping() {
            return;
        }
        let heard = self.autopilot.position(now);
        if let Some(((position, measured_at), motion)) = heard.zip(self.phase.motion_that_waits()) {
            motion.wait_for(&position, measured_at, now);
        }
        if let Some(motion) = self.phase.motion() {
            if let Some((attitude, measured_at)) = self.autopilot.attitude() {
                if self.autopilot.commands_as_asked() {
                    self.lag.hear(motion, &attitude, measured_at, now);
                } else {
                    self.lag.hold_up();
                }
                if self.is_open(measured_at) {
                    let meant = motion.sample(measured_at).attitude;
                    self.jitter.hear(&attitude, &meant, measured_at);
                }
            }
            if let Some((position, measured_at)) = heard {
                self.place_lag.hear(motion, &position, measured_at, now);
                if self.phase.is_in_service() && self.autopilot.commands_as_asked() {
                    let on_air = self.is_open(measured_at);
                    self.progress.hear(motion, &position, measured_at, on_air);
                } else {
                    self.progress.keep_up();
                }
            }
            let sample = motion.commanded(now, [self.lag.lead(), self.place_lag.lead()]);
            let setpoint = Setpoint {
                position_enu_m: sample.position_enu_m,
                velocity_enu_m_s: sample.velocity_enu_m_s,
                acceleration_enu_m_s2: sample.acceleration_enu_m_s2,
                attitude: sample.attitude,
            };
            self.autopilot.set_setpoint(setpoint, now);
        }
    }

    /// Whether a slot is open then.
    fn is_open(&self, at: Instant) -> bool {
        let open = |slot: &Slot| (slot.commitment.opens_at..slot.radiate_until).contains(&at);
        self.service.slot().is_some_and(open)
    }

    pub(super) fn vehicle(&self, now: Instant) -> Vehicle {
        let state = self.autopilot.state();
        let in_service = self.phase.motion().filter(|_| self.phase.is_in_service());
        Vehicle {
            state_received_at: self.autopilot.state_received_at(),
            state_taken_from: self.autopilot.state_taken_from(now),
            state_period: self.autopilot.state_period(),
            position: self.autopilot.position(now),
            attitude: self.autopilot.attitude(),
            turns_ahead: self.lag.lead(),
            in_control: self.autopilot.in_control() && !self.is_stopping(),
            lost_at: self.autopilot.lost_at(),
            estimator_ok: self.estimator_ok(),
            arrived: in_service.is_some_and(|motion| motion.is_over(now)),
            at_rest: in_service.is_some_and(|motion| motion.is_at_rest(now)),
            rests_for: self.rests_for(now),
            rests: self.rests(now),
            jitter: self.told_jitter(),
            pace: if self.may_replan() { self.progress.would_be() } else { self.progress.pace() },
            home_enu_m: self.home_enu_m,
            preflight_ok: self.ground.preflight_ok(),
            ended: self.phase.is_ending(),
            returning: self.phase.is_returning(),
            landed: state.is_airborne() == Some(false),
            guarding: self.autopilot.is_guarding(),
        }
    }
}
