//! What the autopilot does by itself when something is missing: the stream, the estimate, the ground station, charge; and at its
//! fence (`enclosure`).

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;

use super::super::router::Router;
use super::{Autopilot, Mode, Sensed};
use crate::vehicle::config::Firmware;

/// From losing the position estimate to giving up the mode that needs it.
const ESTIMATOR_GRACE: Duration = Duration::from_millis(500);

/// How far an empty battery has been acted on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) enum Charge {
    #[default]
    Good,
    Low,
    Critical,
    Emergency,
}

/// What a failsafe changes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Action {
    Nothing,
    Go(Mode),
}

impl Autopilot {
    pub(super) fn watch(&mut self, sensed: &Sensed, router: &mut Router) {
        self.watch_stream(sensed, router);
        self.watch_estimator(sensed, router);
        self.watch_attitude(sensed, router);
        self.watch_battery(sensed, router);
        self.watch_ground_station(sensed, router);
        self.watch_fence(sensed, router);
    }

    /// PX4's offboard loss and return. ArduCopter says nothing and does nothing (see `flight`).
    fn watch_stream(&mut self, sensed: &Sensed, router: &mut Router) {
        if self.firmware != Firmware::Px4 || !self.armed {
            return;
        }
        let live = self.offboard.live(sensed.now, self.tuning.stream_timeout);
        if self.mode == Mode::Companion && !live {
            let action = self.parameters.real("COM_OBL_RC_ACT") as i32;
            let mode = match action {
                3 => Mode::ReturnToLaunch,
                0..=2 if self.traps.sticks_missing => Mode::Position,
                // Position, altitude and manual need sticks; without them the vehicle comes down.
                0..=2 | 4 => Mode::Land,
                6 | 7 => return self.terminate("Failsafe: offboard lost, terminating", router),
                _ => Mode::Hold,
            };
            self.enter(mode, sensed);
            if mode == Mode::Position {
                self.flight.drift();
            }
            self.failsafe = true;
            self.resumes = self.traps.resume_takes_over;
            let text = format!("Failsafe: Offboard signal lost, switching to {}", mode.name(self.firmware));
            self.text(MavSeverity::MAV_SEVERITY_CRITICAL, &text, router);
        } else if self.resumes && live && self.offboard.proven(sensed.now) {
            self.enter(Mode::Companion, sensed);
            self.text(MavSeverity::MAV_SEVERITY_INFO, "Offboard signal regained", router);
        }
    }

    fn watch_estimator(&mut self, sensed: &Sensed, router: &mut Router) {
        if self.estimator_ok {
            self.estimator_lost_at = None;
            return;
        }
        let lost_at = *self.estimator_lost_at.get_or_insert(sensed.now);
        let late = sensed.now.saturating_sub(lost_at) >= ESTIMATOR_GRACE;
        if self.armed && late && self.mode != Mode::Land {
            let text = match self.firmware {
                Firmware::Px4 => "Failsafe: position estimate lost, descending",
                Firmware::ArduCopter => "EKF Failsafe: changed to LAND Mode",
            };
            self.fall_back(Action::Go(Mode::Land), text, sensed, router);
        }
    }

    /// PX4's failure detector ends a flight at a tilt beyond FD_FAIL_R or FD_FAIL_P (0 switches it off).
    fn watch_attitude(&mut self, sensed: &Sensed, router: &mut Router) {
        let off = self.tuning.failure_deg.iter().all(|limit| *limit <= 0.0);
        if self.firmware != Firmware::Px4 || off || !self.armed || self.landed {
            return;
        }
        let (roll, pitch, _) = self.frame.attitude_to_ned(&sensed.nominal).euler_angles();
        for (limit_deg, angle) in self.tuning.failure_deg.into_iter().zip([roll, pitch]) {
            if limit_deg > 0.0 && angle.to_degrees().abs() > limit_deg {
                return self.terminate("Critical: attitude failure detected, terminating", router);
            }
        }
    }

    /// Each threshold acts once, in the air, as the charge falls below it.
    fn watch_battery(&mut self, sensed: &Sensed, router: &mut Router) {
        let [low, critical, emergency] = self.tuning.charge;
        let charge = match sensed.battery {
            b if b < emergency => Charge::Emergency,
            b if b < critical => Charge::Critical,
            b if b < low => Charge::Low,
            _ => Charge::Good,
        };
        if !self.armed || self.landed || charge <= self.charge {
            return;
        }
        self.charge = charge;
        let (action, text) = match (self.firmware, charge) {
            (Firmware::Px4, Charge::Low) => (Action::Nothing, "Battery low, consider to return"),
            (Firmware::Px4, _) => {
                let action = match (self.parameters.real("COM_LOW_BAT_ACT") as i32, charge) {
                    (3, Charge::Critical) => Action::Go(Mode::ReturnToLaunch),
                    (2 | 3, _) => Action::Go(Mode::Land),
                    _ => Action::Nothing,
                };
                (action, "Failsafe: battery critically low")
            }
            (Firmware::ArduCopter, _) => {
                let name = if charge == Charge::Low { "BATT_FS_LOW_ACT" } else { "BATT_FS_CRT_ACT" };
                let action = match self.parameters.real(name) as i32 {
                    1 => Action::Go(Mode::Land),
                    2 => Action::Go(Mode::ReturnToLaunch),
                    _ => Action::Nothing,
                };
                (action, "Battery 1 is low: Battery Failsafe")
            }
        };
        self.fall_back(action, text, sensed, router);
    }

    /// Fed by a ground station's heartbeats alone, and only once there has been one: no setpoint counts.
    fn watch_ground_station(&mut self, sensed: &Sensed, router: &mut Router) {
        let (action, timeout, text) = match self.firmware {
            Firmware::Px4 => {
                let action = match self.tuning.ground_station_action {
                    1 => Mode::Hold,
                    2 => Mode::ReturnToLaunch,
                    3 => Mode::Land,
                    _ => return,
                };
                (action, self.tuning.ground_station_timeout, "Failsafe: ground station connection lost")
            }
            Firmware::ArduCopter if self.tuning.ground_station_action == 0 => return,
            Firmware::ArduCopter => {
                (Mode::ReturnToLaunch, self.tuning.ground_station_timeout, "GCS Failsafe")
            }
        };
        let gone = self.ground_station_at.is_some_and(|at| sensed.now.saturating_sub(at) > timeout);
        if gone && self.armed && !self.landed {
            self.ground_station_at = None;
            self.fall_back(Action::Go(action), text, sensed, router);
        }
    }

    pub(super) fn fall_back(&mut self, action: Action, text: &str, sensed: &Sensed, router: &mut Router) {
        self.text(MavSeverity::MAV_SEVERITY_CRITICAL, text, router);
        if let Action::Go(mode) = action
            && self.mode != mode
            && self.mode != Mode::Land
        {
            self.enter(mode, sensed);
            self.failsafe = true;
        }
    }

    pub(super) fn terminate(&mut self, why: &str, router: &mut Router) {
        self.text(MavSeverity::MAV_SEVERITY_EMERGENCY, why, router);
        self.disarm();
    }
}
