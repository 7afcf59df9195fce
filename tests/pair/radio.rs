//! A payload radio with leased power that falls silent by itself. It states the command's meaning anew.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, COMMAND_INT_DATA, MavMessage, MavResult};

/// What a radio emits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Emission {
    pub power_w: f64,
    pub slot: i32,
    pub until: Duration,
}

#[derive(Debug, Clone, Default)]
pub struct Radio {
    emission: Option<Emission>,
}

impl Radio {
    pub fn emission(&self, t: Duration) -> Option<Emission> {
        self.emission.filter(|e| t < e.until)
    }

    pub fn expires_at(&self) -> Option<Duration> {
        self.emission.map(|e| e.until)
    }

    pub fn command(&mut self, command: &COMMAND_INT_DATA, t: Duration) -> MavMessage {
        let on = command.param1.is_finite() && command.y > 0;
        let dbm = (f64::from(command.param1) * 1e3).round() / 1e3;
        self.emission = on.then(|| Emission {
            power_w: 10f64.powf(dbm / 10.0) * 1e-3,
            slot: command.x,
            until: t + Duration::from_millis(command.y.unsigned_abs().into()),
        });
        MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command: command.command,
            result: MavResult::MAV_RESULT_ACCEPTED,
            result_param2: if on { (dbm * 1e3).round() as i32 } else { i32::MIN },
            ..COMMAND_ACK_DATA::DEFAULT
        })
    }
}
