//! The payload radio: transmit power by command (MAV_CMD_USER_1), silent again by itself.
//!
//! The command has two forms. In the first its expiry counts from its receipt (y, in ms) and COMMAND_ACK answers it; the
//! second is `numbered`. A radio that knows both takes no more of the first once it was given the second, until it is
//! switched off.

mod device;
mod numbered;
mod outside;

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, MavCmd, MavResult};

use super::config::PowerForm;
use super::parameters::{Encoding, Parameters, Value};
use crate::random::Noise;
use device::Device;
pub use device::RadioDevice;
use numbered::Numbered;
pub(super) use numbered::{REPORT_CRC_EXTRA, REPORT_ID, Report};
pub use outside::DevicePower;

/// The component id of a payload radio (MAV_COMP_ID_TELEMETRY_RADIO).
pub const COMPONENT: u8 = 68;
/// The default id of the leased power command.
pub const POWER_COMMAND: MavCmd = MavCmd::MAV_CMD_USER_1;

/// What is radiated, and until when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Emission {
    pub power_dbm: f64,
    /// The slot number that came with the command.
    pub slot: i32,
    pub expires_at: Duration,
    /// The same on the radio's clock, where a numbered command says it.
    pub expires_ms: u32,
}

impl Emission {
    fn new(asked_dbm: f64, slot: i32, expires_at: Duration, expires_ms: u32) -> Self {
        // The synthesiser's step is a thousandth of a decibel.
        Self { power_dbm: (asked_dbm * 1000.0).round() / 1000.0, slot, expires_at, expires_ms }
    }
}

/// Counters of the power command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TransmitterCounters {
    /// Commands carried out.
    pub accepted: u64,
    /// Commands refused: not finite, or above the limit.
    pub denied: u64,
    /// Times that the power fell to off because nobody renewed it.
    pub expired: u64,
}

/// The transmitter of one vehicle.
#[derive(Debug, Clone)]
pub(crate) struct Transmitter {
    pub parameters: Parameters,
    pub counters: TransmitterCounters,
    hardware_max_dbm: f64,
    model: RadioDevice,
    device: Device,
    /// What the device is told to radiate.
    told: Option<Emission>,
    /// What a radio in order would tell it by the same commands.
    due: Option<Emission>,
    numbered: Numbered,
    /// Nothing ends by itself: by a fault, or because the radio knows no expiry.
    pub endless: bool,
    /// A fault: neither expiry nor command changes what is radiated.
    pub stuck: bool,
    /// A fault: it has no power, and so is off and silent.
    pub dark: bool,
    /// Another device radiates in place of its own.
    outside: Option<DevicePower>,
}

impl Transmitter {
    /// `noise` draws its clock and its series. One that does not expire says so.
    pub fn new(max_dbm: f64, expires: bool, model: RadioDevice, noise: Noise) -> Self {
        let mut table =
            vec![("TX_MAX_DBM", Value::Real(max_dbm as f32)), ("TX_EXPIRY_OK", Value::Int(expires.into()))];
        table.extend(model.parameters());
        let counters = TransmitterCounters::default();
        Self {
            parameters: Parameters::new(Encoding::Cast, &table),
            counters,
            hardware_max_dbm: max_dbm,
            model,
            device: Device::new(&model),
            told: None,
            due: None,
            numbered: Numbered::new(noise),
            endless: !expires,
            stuck: false,
            dark: false,
            outside: None,
        }
    }

    /// It has no power any more.
    pub fn lose_power(&mut self) {
        self.dark = true;
        self.told = None;
        self.device.cut();
    }

    /// It has power again, and remembers nothing.
    pub fn start(&mut self, now: Duration) {
        (self.dark, self.told, self.due) = (false, None, None);
        self.device.cut();
        self.numbered.start(now);
    }

    /// What is on the air.
    pub fn emission(&self) -> Option<Emission> {
        self.outside.map_or_else(|| self.device.emission(), DevicePower::emission)
    }

    /// A device that is not simulated here radiates this from now on, in place of its own.
    pub fn radiate_by(&mut self, power: DevicePower) {
        self.outside = Some(power);
    }

    /// What is left of the command in force, as far as it is known: nobody here knows what another device was told.
    pub fn lasts(&self, now: Duration) -> Option<Duration> {
        let known = self.emission().filter(|_| self.outside.is_none());
        known.map(|emission| emission.expires_at.saturating_sub(now))
    }

    /// Radiated power in watts; `None` when silent.
    pub fn power_w(&self) -> Option<f64> {
        self.emission().map(|e| 10f64.powf((e.power_dbm - 30.0) / 10.0))
    }

    fn limit_dbm(&self) -> f64 {
        f64::from(self.parameters.real("TX_MAX_DBM")).min(self.hardware_max_dbm)
    }

    /// Whether a power may be radiated.
    fn allows(&self, asked_dbm: f64) -> bool {
        asked_dbm.is_finite() && asked_dbm <= self.limit_dbm() + DBM_ROUNDING
    }

    /// A power below the least is none.
    fn is_too_weak(&self, asked_dbm: f64) -> bool {
        asked_dbm < self.model.least_dbm - DBM_ROUNDING
    }

    fn emit(&mut self, emission: Option<Emission>, now: Duration) {
        self.due = emission;
        if !self.stuck {
            self.tell(emission, now);
        }
    }

    fn tell(&mut self, emission: Option<Emission>, now: Duration) {
        self.told = emission;
        self.device.tell(emission, now);
    }

    /// Whether it radiates otherwise than a radio in order would by the same commands.
    pub fn is_out_of_order(&self) -> bool {
        if let Some(outside) = self.outside {
            return outside.astray;
        }
        let what = |emission: Option<Emission>| emission.map(|e| (e.power_dbm, e.slot));
        what(self.told) != what(self.due)
    }

    /// Which form of the command a radio that knows `known` takes a command for.
    pub fn form_of(&self, known: PowerForm, command: &COMMAND_INT_DATA) -> PowerForm {
        let second = Self::is_numbered(command) || self.numbered.is_in_use();
        if second { known } else { PowerForm::First }
    }

    /// Carries out the power command in its first form; returns the result and the achieved power in milli-dBm (`i32::MIN` = off).
    pub fn command(&mut self, command: &COMMAND_INT_DATA, now: Duration) -> (MavResult, i32) {
        let asked = f64::from(command.param1);
        let off = command.y <= 0 || asked == f64::NEG_INFINITY;
        let refused = !off && !self.allows(asked);
        if refused {
            self.counters.denied += 1;
            return (MavResult::MAV_RESULT_DENIED, self.achieved_mdbm());
        }
        if !off && self.is_too_weak(asked) {
            self.counters.denied += 1;
            self.emit(None, now);
            return (MavResult::MAV_RESULT_DENIED, self.achieved_mdbm());
        }
        let expires_at = now + Duration::from_millis(command.y.unsigned_abs().into());
        self.emit((!off).then(|| Emission::new(asked, command.x, expires_at, 0)), now);
        if self.stuck {
            self.counters.denied += 1;
            return (MavResult::MAV_RESULT_FAILED, self.achieved_mdbm());
        }
        self.counters.accepted += 1;
        (MavResult::MAV_RESULT_ACCEPTED, self.achieved_mdbm())
    }

    /// What it says that it radiates.
    fn stated(&self) -> Option<Emission> {
        if self.model.read_back { self.device.emission() } else { self.told }
    }

    fn achieved_mdbm(&self) -> i32 {
        self.stated().map_or(i32::MIN, |e| (e.power_dbm * 1000.0).round() as i32)
    }

    /// When what it radiates next changes by itself, or would if the radio were in order.
    pub fn changes_at(&self) -> Option<Duration> {
        [self.expires_at(), self.device.turns_at()].into_iter().flatten().min()
    }

    /// When the power falls to off by itself, or would if the radio were in order.
    pub fn expires_at(&self) -> Option<Duration> {
        self.due.map(|e| e.expires_at)
    }

    /// Falls silent if the lease has run out; the device does what is due.
    pub fn expire(&mut self, now: Duration) {
        if self.expires_at().is_some_and(|at| at <= now) {
            self.due = None;
            if !self.stuck && !self.endless && self.told.is_some() {
                self.counters.expired += 1;
                self.tell(None, now);
            }
        }
        self.device.turn(now);
    }
}

/// A limit written as a float and read back must admit itself: f32 carries 27 dBm to 2e-6.
const DBM_ROUNDING: f64 = 1e-5;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;

    fn transmitter(max_dbm: f64) -> Transmitter {
        Transmitter::new(max_dbm, true, RadioDevice::default(), Noise::new(1, Purpose::Radio, 0))
    }

    fn power(dbm: f32, slot: i32, expiry_ms: i32) -> COMMAND_INT_DATA {
        COMMAND_INT_DATA { param1: dbm, x: slot, y: expiry_ms, ..COMMAND_INT_DATA::DEFAULT }
    }

    #[test]
    fn spec_lease_expires_to_the_millisecond() {
        let mut tx = transmitter(30.0);
        let t0 = Duration::from_micros(1_234_567);
        let reply = tx.command(&power(26.5, 4, 500), t0);
        assert_eq!(reply, (MavResult::MAV_RESULT_ACCEPTED, 26_500));
        assert!((tx.power_w().unwrap() - 0.446_684).abs() < 1e-6);
        tx.expire(t0 + Duration::from_micros(499_999));
        assert_eq!(tx.emission().map(|e| e.slot), Some(4));
        tx.expire(t0 + Duration::from_millis(500));
        assert_eq!((tx.emission(), tx.counters.expired), (None, 1));
    }

    #[test]
    fn spec_bad_powers_are_denied_and_change_nothing() {
        let mut tx = transmitter(27.0);
        tx.command(&power(20.0, 1, 500), Duration::ZERO);
        let before = tx.emission();
        for bad in [f32::NAN, f32::INFINITY, 27.1, 1e9] {
            let reply = tx.command(&power(bad, 2, 500), Duration::from_millis(1));
            assert_eq!(reply, (MavResult::MAV_RESULT_DENIED, 20_000));
            assert_eq!(tx.emission(), before);
        }
        assert_eq!(tx.counters.denied, 4);
        tx.parameters.set("TX_MAX_DBM", Value::Real(10.0));
        assert_eq!(tx.command(&power(11.0, 2, 500), Duration::ZERO).0, MavResult::MAV_RESULT_DENIED);
        tx.parameters.set("TX_MAX_DBM", Value::Real(90.0));
        assert_eq!(tx.command(&power(27.5, 2, 500), Duration::ZERO).0, MavResult::MAV_RESULT_DENIED);
    }

    #[test]
    fn spec_what_is_below_the_least_is_off_and_refused() {
        let model = RadioDevice { least_dbm: 10.0, ..RadioDevice::default() };
        let mut tx = Transmitter::new(27.0, true, model, Noise::new(1, Purpose::Radio, 0));
        assert_eq!(tx.command(&power(10.0, 1, 500), Duration::ZERO).0, MavResult::MAV_RESULT_ACCEPTED);
        let reply = tx.command(&power(9.999, 1, 500), Duration::from_millis(1));
        assert_eq!((reply, tx.power_w()), ((MavResult::MAV_RESULT_DENIED, i32::MIN), None));
    }

    #[test]
    fn spec_only_a_radio_that_reads_back_says_what_its_device_does() {
        for read_back in [true, false] {
            let model = RadioDevice { off_s: 0.05, change_s: 0.2, read_back, ..RadioDevice::default() };
            let mut tx = Transmitter::new(27.0, true, model, Noise::new(1, Purpose::Radio, 0));
            let said = |tx: &mut Transmitter, ms| {
                tx.expire(Duration::from_millis(ms));
                (tx.achieved_mdbm() != i32::MIN, tx.power_w().is_some())
            };
            tx.command(&power(20.0, 1, 500), Duration::ZERO);
            assert_eq!(said(&mut tx, 199), (!read_back, false));
            assert_eq!(said(&mut tx, 200), (true, true));
            assert_eq!(said(&mut tx, 500), (read_back, true));
            assert_eq!(said(&mut tx, 549), (read_back, true));
            assert_eq!((said(&mut tx, 550), tx.changes_at()), ((false, false), None));
        }
    }

    #[test]
    fn spec_off_is_off_at_once() {
        for off in [power(f32::NEG_INFINITY, 1, 500), power(20.0, 1, 0), power(f32::NAN, 1, -3)] {
            let mut tx = transmitter(27.0);
            tx.command(&power(20.0, 1, 500), Duration::ZERO);
            assert_eq!(
                tx.command(&off, Duration::from_millis(1)),
                (MavResult::MAV_RESULT_ACCEPTED, i32::MIN)
            );
            assert_eq!(tx.power_w(), None);
        }
    }

    #[test]
    fn spec_a_stuck_transmitter_ignores_expiry_and_orders() {
        let mut tx = transmitter(27.0);
        tx.command(&power(20.0, 1, 100), Duration::ZERO);
        tx.stuck = true;
        assert_eq!(tx.command(&power(20.0, 1, 0), Duration::ZERO).0, MavResult::MAV_RESULT_FAILED);
        assert!(tx.is_out_of_order());
        tx.expire(Duration::from_secs(9));
        assert!(tx.power_w().is_some() && tx.is_out_of_order());
    }

    #[test]
    fn spec_a_stuck_transmitter_is_in_order_while_it_does_what_it_is_told() {
        let mut tx = transmitter(27.0);
        tx.command(&power(20.0, 1, 100), Duration::ZERO);
        tx.stuck = true;
        tx.command(&power(20.0, 1, 100), Duration::from_millis(50));
        assert!(!tx.is_out_of_order());
        tx.expire(Duration::from_millis(149));
        assert!(!tx.is_out_of_order());
        tx.expire(Duration::from_millis(150));
        assert!(tx.is_out_of_order());
    }

    #[test]
    fn spec_a_transmitter_without_expiry_still_obeys() {
        let mut tx = transmitter(27.0);
        tx.endless = true;
        tx.command(&power(20.0, 1, 100), Duration::ZERO);
        tx.expire(Duration::from_secs(9));
        assert_eq!((tx.expires_at(), tx.emission().map(|e| e.slot)), (None, Some(1)));
        assert!(tx.is_out_of_order());
        tx.command(&power(20.0, 1, 0), Duration::from_secs(9));
        assert_eq!(tx.power_w(), None);
    }

    #[test]
    fn spec_once_commands_are_numbered_no_others_are_taken() {
        let mut tx = transmitter(27.0);
        let first = power(20.0, 1, 100);
        assert_eq!(tx.form_of(PowerForm::Second, &first), PowerForm::First);
        let numbered = COMMAND_INT_DATA { param2: 1.0, param3: 1.0, ..first.clone() };
        assert_eq!(tx.form_of(PowerForm::Second, &numbered), PowerForm::Second);
        // One that knows no better takes the time of a clock for a duration.
        assert_eq!(tx.form_of(PowerForm::First, &numbered), PowerForm::First);
        let off = COMMAND_INT_DATA {
            param1: f32::NEG_INFINITY,
            param4: tx.report(Duration::ZERO).series as f32,
            ..numbered
        };
        tx.numbered_command((1, 191), &off, Duration::ZERO);
        assert_eq!(tx.form_of(PowerForm::Second, &first), PowerForm::Second);
        let answer = tx.numbered_command((1, 191), &first, Duration::ZERO).unwrap();
        assert_eq!((answer.answers.1, tx.emission()), (0, None));
    }
}
