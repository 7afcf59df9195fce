//! A payload radio that takes power commands in both forms and falls silent by itself. It states their meaning anew.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, COMMAND_INT_DATA, MavMessage as Common, MavResult};
use veilwing::service::SlotService;
use veilwing::time::Instant;
use veilwing::transmitter::wire::{MavMessage, VEILWING_RADIO_DATA, VeilwingRadioResult as Result};

/// What the radio's clock shows at the start.
const BEGAN_MS: u32 = 4_000_000_000;

/// What a radio says.
#[derive(Debug, Clone, PartialEq)]
pub enum Said {
    /// To a command whose expiry counts from its receipt.
    Acknowledgement(Box<Common>),
    /// To a numbered one, and unasked.
    Report(MavMessage),
}

impl Said {
    pub fn reach(&self, service: &mut SlotService, from: MavHeader, now: Instant) {
        match self {
            Self::Acknowledgement(message) => service.handle_radio(from, message, now),
            Self::Report(message) => service.handle_report(from, message, now),
        }
    }
}

/// What a radio emits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Emission {
    pub power_w: f64,
    pub slot: i32,
    pub until: Duration,
    expires_ms: u32,
    mdbm: i32,
}

#[derive(Debug, Clone)]
pub struct Radio {
    emission: Option<Emission>,
    /// By how much its clock is fast.
    pub fast_ppm: f64,
    /// How much less than it is told to it radiates, as its answers say.
    pub weak_mdb: i32,
    boot: u32,
    newest_taken: u32,
    series: u32,
}

impl Default for Radio {
    fn default() -> Self {
        Self { emission: None, fast_ppm: 0.0, weak_mdb: 0, boot: 0, newest_taken: 0, series: 1 }
    }
}

impl Radio {
    pub fn emission(&self, t: Duration) -> Option<Emission> {
        self.emission.filter(|e| t < e.until)
    }

    pub fn expires_at(&self) -> Option<Duration> {
        self.emission.map(|e| e.until)
    }

    fn clock_ms(&self, t: Duration) -> f64 {
        t.as_secs_f64() * 1e3 * (1.0 + self.fast_ppm * 1e-6)
    }

    pub fn command(&mut self, command: &COMMAND_INT_DATA, t: Duration) -> Said {
        if command.param2 == 0.0 { self.first_form(command, t) } else { self.second_form(command, t) }
    }

    /// What becomes of the power that is asked for.
    fn achieved_mdbm(&self, command: &COMMAND_INT_DATA) -> f64 {
        (f64::from(command.param1) * 1e3).round() - f64::from(self.weak_mdb)
    }

    fn first_form(&mut self, command: &COMMAND_INT_DATA, t: Duration) -> Said {
        let on = command.param1.is_finite() && command.y > 0;
        let mdbm = self.achieved_mdbm(command);
        self.emission = on.then(|| Emission {
            power_w: 10f64.powf(mdbm / 1e4) * 1e-3,
            slot: command.x,
            until: t + Duration::from_millis(command.y.unsigned_abs().into()),
            expires_ms: 0,
            mdbm: mdbm as i32,
        });
        Said::Acknowledgement(Box::new(Common::COMMAND_ACK(COMMAND_ACK_DATA {
            command: command.command,
            result: MavResult::MAV_RESULT_ACCEPTED,
            result_param2: if on { mdbm as i32 } else { i32::MIN },
            ..COMMAND_ACK_DATA::DEFAULT
        })))
    }

    fn second_form(&mut self, command: &COMMAND_INT_DATA, t: Duration) -> Said {
        let [number, boot, series] =
            [command.param2, command.param3, command.param4].map(|whole| whole as u32);
        let result = self.carry_out(command, [number, boot, series], t);
        let mut report = self.state(t);
        (report.answers_boot, report.answers, report.result) = (boot, number, result);
        Said::Report(MavMessage::VEILWING_RADIO(report))
    }

    fn carry_out(
        &mut self,
        command: &COMMAND_INT_DATA,
        [number, boot, series]: [u32; 3],
        t: Duration,
    ) -> Result {
        if boot != self.boot {
            if series != self.series {
                return Result::VEILWING_RADIO_RESULT_OTHER_SERIES;
            }
            (self.boot, self.newest_taken, self.series, self.emission) = (boot, 0, self.series + 1, None);
        }
        if number <= self.newest_taken {
            return Result::VEILWING_RADIO_RESULT_NOT_NEWER;
        }
        (self.newest_taken, self.emission) = (number, None);
        if !command.param1.is_finite() {
            return Result::VEILWING_RADIO_RESULT_ACCEPTED;
        }
        let expires_ms = command.y.cast_unsigned();
        // The clock wraps; so far from now nothing expires.
        let left_ms = f64::from(expires_ms.wrapping_sub(BEGAN_MS).cast_signed()) - self.clock_ms(t);
        if left_ms <= 0.0 {
            return Result::VEILWING_RADIO_RESULT_EXPIRED;
        }
        let mdbm = self.achieved_mdbm(command);
        self.emission = Some(Emission {
            power_w: 10f64.powf(mdbm / 1e4) * 1e-3,
            slot: command.x,
            until: t + Duration::from_secs_f64(left_ms * 1e-3 / (1.0 + self.fast_ppm * 1e-6)),
            expires_ms,
            mdbm: mdbm as i32,
        });
        Result::VEILWING_RADIO_RESULT_ACCEPTED
    }

    /// What it says unasked.
    pub fn report(&self, t: Duration) -> Said {
        Said::Report(MavMessage::VEILWING_RADIO(self.state(t)))
    }

    fn state(&self, t: Duration) -> VEILWING_RADIO_DATA {
        let on = self.emission(t);
        VEILWING_RADIO_DATA {
            time_ms: BEGAN_MS.wrapping_add(self.clock_ms(t) as u32),
            boot: self.boot,
            newest: self.newest_taken,
            series: self.series,
            expires_ms: on.map_or(0, |on| on.expires_ms),
            power_mdbm: on.map_or(i32::MIN, |on| on.mdbm),
            ..VEILWING_RADIO_DATA::DEFAULT
        }
    }
}
