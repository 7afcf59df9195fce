//! How the scripted autopilot answers commands, and does what they ask.

use super::*;

impl Fake {
    pub(super) fn command(&mut self, c: &COMMAND_LONG_DATA, now: Instant) {
        let to_bridge = matches!(c.command, MavCmd::MAV_CMD_USER_4 | MavCmd::MAV_CMD_USER_5);
        let manners = match c.command {
            _ if to_bridge && self.mute_bridge => Manners::Ignore,
            MavCmd::MAV_CMD_DO_SET_MODE => self.set_mode.clone(),
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self.arming.clone(),
            MavCmd::MAV_CMD_NAV_TAKEOFF => self.takeoff.clone(),
            _ => Manners::Obey,
        };
        let result = match manners {
            Manners::Ignore => return,
            Manners::PayLipService => MavResult::MAV_RESULT_ACCEPTED,
            Manners::Refuse(result, text) => {
                self.say(text);
                result
            }
            Manners::ObeyInSilence => {
                self.obey(c, now);
                return;
            }
            Manners::TakeTime(needed_ms) => {
                if self.under_way.is_none() {
                    self.under_way = Some((now + Duration::from_millis(needed_ms), c.clone()));
                }
                MavResult::MAV_RESULT_IN_PROGRESS
            }
            Manners::Obey => self.obey(c, now),
        };
        self.answer(c.command, result);
    }

    pub(super) fn answer(&mut self, command: MavCmd, result: MavResult) {
        self.out.push_back(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result,
            progress: 0,
            result_param2: 0,
            target_system: OWN.0,
            target_component: OWN.1,
        }));
    }

    pub(super) fn obey(&mut self, c: &COMMAND_LONG_DATA, now: Instant) -> MavResult {
        match c.command {
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let interval = Duration::from_secs_f64(f64::from(c.param2) * 1e-6);
                if interval.as_secs_f64() < 1.0 / self.fastest_hz {
                    return MavResult::MAV_RESULT_DENIED;
                }
                self.intervals.insert(c.param1 as u32, (interval, now));
            }
            MavCmd::MAV_CMD_REQUEST_MESSAGE => {
                let message = self.telemetry(c.param1 as u32, now);
                self.out.extend(message);
            }
            MavCmd::MAV_CMD_DO_SET_MODE => {
                let wanted = match self.firmware {
                    Firmware::Px4 => (c.param2 as u32) << 16 | (c.param3 as u32) << 24,
                    Firmware::ArduPilot => c.param2 as u32,
                };
                if self.missing_mode == Some(wanted) {
                    return MavResult::MAV_RESULT_UNSUPPORTED;
                }
                if wanted == PX4_OFFBOARD && !self.streaming(now) {
                    return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
                }
                self.custom_mode = wanted;
                self.lapsed = false;
                self.climb_to = None;
            }
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => {
                let flying = self.landed != MavLandedState::MAV_LANDED_STATE_ON_GROUND;
                if c.param1 == 0.0 && flying {
                    return MavResult::MAV_RESULT_FAILED;
                }
                self.armed = c.param1 == 1.0;
            }
            MavCmd::MAV_CMD_NAV_TAKEOFF => {
                if self.firmware == Firmware::Px4 || !self.armed || self.custom_mode != 4 {
                    return MavResult::MAV_RESULT_FAILED;
                }
                self.climb_to = Some(f64::from(-c.param7));
            }
            MavCmd::MAV_CMD_USER_4 | MavCmd::MAV_CMD_USER_5
                if self.firmware == Firmware::ArduPilot && !self.without_bridge =>
            {
                return self.bridge(c);
            }
            _ => return MavResult::MAV_RESULT_UNSUPPORTED,
        }
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// The bridge script, as `ardupilot/veilwing.lua` answers.
    fn bridge(&mut self, c: &COMMAND_LONG_DATA) -> MavResult {
        let zero = c.param1 == 0.0 && c.param2 == 0.0;
        if c.command == MavCmd::MAV_CMD_USER_5 {
            let flown_by_us = self.armed && self.custom_mode == 4;
            if !(zero || flown_by_us) {
                return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
            }
            self.offsets_on = !zero;
        } else if !zero && !self.offsets_on {
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        } else if self.offsets_on {
            let (_, _, heading) = quaternion(self.attitude).euler_angles();
            let (roll, pitch) = (f64::from(c.param1).to_radians(), f64::from(c.param2).to_radians());
            let turned = UnitQuaternion::from_euler_angles(roll, pitch, heading);
            self.attitude = [turned.w, turned.i, turned.j, turned.k].map(|c| c as f32);
        }
        MavResult::MAV_RESULT_ACCEPTED
    }
}
