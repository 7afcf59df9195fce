//! MAV_CMD_DO_REPOSITION: fly to a point and stay there. What ground stations send for "go here".
//!
//! Each firmware has its own: PX4 changes to Hold (and refuses a command that does not ask for it), reads the height as
//! above the sea whatever frame COMMAND_INT names, and keeps what is not a number. ArduCopter goes in GUIDED, wants a
//! whole point, and keeps its heading.

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavFrame, MavResult};
use nalgebra::Vector3;

use super::super::router::Router;
use super::commands::Command;
use super::{Autopilot, Mode, Sensed};
use crate::geodesy::Origin;
use crate::vehicle::config::Firmware;

/// MAV_DO_REPOSITION_FLAGS_CHANGE_MODE, the only flag that either firmware knows.
const CHANGE_MODE: u32 = 1;

impl Autopilot {
    pub(super) fn command_reposition(
        &mut self,
        c: &Command,
        now: Duration,
        router: &mut Router,
    ) -> MavResult {
        let Some(sensed) = self.sensed else { return self.refusal() };
        let flags = if c.params[1].is_finite() { c.params[1] as u32 } else { 0 };
        let changes_mode = flags & CHANGE_MODE != 0;
        let mode = match self.firmware {
            Firmware::Px4 if flags != CHANGE_MODE => return MavResult::MAV_RESULT_UNSUPPORTED,
            Firmware::Px4 => Mode::Hold,
            Firmware::ArduCopter if self.mode != Mode::Companion && !changes_mode => {
                return MavResult::MAV_RESULT_DENIED;
            }
            Firmware::ArduCopter => Mode::Companion,
        };
        let Some(point) = self.reposition_point(c, &sensed) else { return MavResult::MAV_RESULT_DENIED };
        if self.firmware == Firmware::ArduCopter && (!self.armed || self.landed) {
            return MavResult::MAV_RESULT_FAILED;
        }
        let result = self.command_mode(mode, now, router);
        if result == MavResult::MAV_RESULT_ACCEPTED {
            let yaw_ned_rad = f64::from(c.params[3]);
            let turns = self.firmware == Firmware::Px4 && yaw_ned_rad.is_finite();
            if self.firmware == Firmware::ArduCopter {
                self.offboard.clear();
            }
            self.flight.go_to(point, turns.then_some(FRAC_PI_2 - yaw_ned_rad));
        }
        result
    }

    /// Mission ENU; `None` for what is no point on the globe.
    fn reposition_point(&self, c: &Command, sensed: &Sensed) -> Option<Vector3<f64>> {
        let here = self.frame.geodetic(sensed.position_enu_m);
        let home_alt_m = self.frame.geodetic(self.home_enu_m).alt_amsl_m;
        let keeps = self.firmware == Firmware::Px4;
        let base_m = match (self.firmware, c.frame) {
            (Firmware::Px4, _) => 0.0,
            (_, Some(MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT)) => 0.0,
            (
                _,
                None
                | Some(MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT),
            ) => home_alt_m,
            _ => return None,
        };
        let alt_amsl_m = match f64::from(c.z) {
            z if z.is_finite() => base_m + z,
            _ if keeps => here.alt_amsl_m,
            _ => return None,
        };
        let [lat_deg, lon_deg] = match c.lat_lon_deg {
            Some(point) => point,
            None if keeps => [here.lat_deg, here.lon_deg],
            None => return None,
        };
        let on_globe = lat_deg.abs() <= 90.0 && lon_deg.abs() <= 180.0;
        let point = Origin { lat_deg, lon_deg, alt_amsl_m };
        on_globe.then(|| self.frame.position_to_enu(self.frame.ned_of(point)))
    }
}
