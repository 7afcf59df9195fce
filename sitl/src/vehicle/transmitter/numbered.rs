//! The second form of the power command: numbered, its expiry an instant of the radio's own clock, every answer naming
//! the command that it answers.
//!
//! COMMAND_INT: param1 the power in dBm (minus infinity: off), param2 the number, param3 the commander's boot, param4
//! the series, x the slot, y the low 32 bits of the expiry on the radio's clock in ms. Numbers rise within a boot. A
//! boot other than that in force is taken only with the present series, which is drawn anew whenever one is taken and
//! at power-up; the radio is off then, whatever it did before.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::COMMAND_INT_DATA;

use super::{Emission, Transmitter};
use crate::random::Noise;

/// An expiry further ahead is refused: it is of another clock.
const LONGEST_MS: i32 = 5000;
/// Series are drawn below this: single precision holds whole numbers so far.
const WHOLE: f64 = 16_777_216.0;
/// Crystals differ by at most this.
const DRIFT_PPM: f64 = 60.0;
/// The id of the message in which the radio answers and reports, and the seed of its checksum.
pub(in crate::vehicle) const REPORT_ID: u32 = 42_120;
pub(in crate::vehicle) const REPORT_CRC_EXTRA: u8 = 49;

/// What became of a command, as the answer says it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    Accepted = 0,
    NotNewer = 1,
    OtherSeries = 2,
    Expired = 3,
    Denied = 4,
    Failed = 6,
}

/// A clock that shows milliseconds since some instant before the start, in 32 bits, and is never quite right.
#[derive(Debug, Clone)]
struct Clock {
    began_us: f64,
    rate: f64,
}

impl Clock {
    fn micros(&self, now: Duration) -> f64 {
        self.began_us + now.as_secs_f64() * 1e6 * self.rate
    }

    fn shows_ms(&self, now: Duration) -> u32 {
        // Modulo 2^32 on purpose.
        ((self.micros(now) / 1e3).floor() as u64 & u64::from(u32::MAX)) as u32
    }

    /// How far ahead of the clock `time_ms` is, negative if it is behind.
    fn ahead_ms(&self, time_ms: u32, now: Duration) -> i32 {
        time_ms.wrapping_sub(self.shows_ms(now)) as i32
    }

    /// When the clock will show `time_ms`, which is ahead of it.
    fn reaches(&self, time_ms: u32, now: Duration) -> Duration {
        let shown_us = (self.micros(now) / 1e3).floor() * 1e3;
        let at_us = shown_us + 1e3 * f64::from(self.ahead_ms(time_ms, now));
        let left_us = ((at_us - self.micros(now)) / self.rate).max(0.0);
        now + Duration::from_nanos((left_us * 1e3) as u64)
    }
}

/// Whose commands are taken, and how far they have come.
#[derive(Debug, Clone)]
pub(super) struct Numbered {
    clock: Clock,
    noise: Noise,
    boot: u32,
    newest: u32,
    series: u32,
    /// The first that gave a numbered command since power-up: nobody else is obeyed.
    commander: Option<(u8, u8)>,
}

impl Numbered {
    pub fn new(mut noise: Noise) -> Self {
        let rate = 1.0 + DRIFT_PPM * 1e-6 * (2.0 * noise.uniform() - 1.0);
        let began_us = (noise.uniform() * 4_294_967_296.0).floor() * 1e3;
        let series = draw(&mut noise);
        Self { clock: Clock { began_us, rate }, noise, boot: 0, newest: 0, series, commander: None }
    }

    /// From power-up on: its clock begins anew.
    pub fn start(&mut self, now: Duration) {
        self.clock.began_us = -now.as_secs_f64() * 1e6 * self.clock.rate;
        (self.boot, self.newest, self.commander) = (0, 0, None);
        self.series = draw(&mut self.noise);
    }

    /// Whether it has a commander that numbers its commands: then no others are taken.
    pub fn is_in_use(&self) -> bool {
        self.boot != 0
    }
}

fn draw(noise: &mut Noise) -> u32 {
    1 + (noise.uniform() * (WHOLE - 2.0)) as u32
}

/// What the radio says of itself; with a command that it answers, or unasked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Report {
    pub time_ms: u32,
    pub boot: u32,
    pub newest: u32,
    /// Boot and number of the command answered; zeros: unasked.
    pub answers: (u32, u32),
    pub series: u32,
    pub expires_ms: u32,
    pub power_mdbm: i32,
    pub outcome: Outcome,
}

impl Report {
    /// As it goes over the wire: MAVLink's order of fields, the widest first.
    pub fn payload(&self) -> [u8; 33] {
        let words = [
            self.time_ms,
            self.boot,
            self.newest,
            self.answers.0,
            self.answers.1,
            self.series,
            self.expires_ms,
            self.power_mdbm.cast_unsigned(),
        ];
        let mut payload = [0; 33];
        for (bytes, word) in payload.chunks_exact_mut(4).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        payload[32] = self.outcome as u8;
        payload
    }
}

/// A whole number from a float of the command; zero for what is none.
fn whole(value: f32) -> u32 {
    if value >= 0.0 && f64::from(value) < WHOLE && value.fract() == 0.0 { value as u32 } else { 0 }
}

impl Transmitter {
    /// Whether a command is of this form, as its number says.
    pub(in crate::vehicle) fn is_numbered(command: &COMMAND_INT_DATA) -> bool {
        command.param2 != 0.0
    }

    /// Carries out a numbered command of `commander`'s and answers it; `None` to somebody else's, which is not heard.
    pub(in crate::vehicle) fn numbered_command(
        &mut self,
        commander: (u8, u8),
        command: &COMMAND_INT_DATA,
        now: Duration,
    ) -> Option<Report> {
        if *self.numbered.commander.get_or_insert(commander) != commander {
            self.counters.denied += 1;
            return None;
        }
        self.expire(now);
        let [number, boot, series] = [command.param2, command.param3, command.param4].map(whole);
        let outcome = self.carry_out(command, number, boot, series, now);
        match outcome {
            Outcome::Accepted => self.counters.accepted += 1,
            _ => self.counters.denied += 1,
        }
        let report = self.report(now);
        Some(Report { answers: (boot, number), outcome, ..report })
    }

    fn carry_out(
        &mut self,
        command: &COMMAND_INT_DATA,
        number: u32,
        boot: u32,
        series: u32,
        now: Duration,
    ) -> Outcome {
        if boot != self.numbered.boot || boot == 0 {
            if series != self.numbered.series || boot == 0 {
                return Outcome::OtherSeries;
            }
            (self.numbered.boot, self.numbered.newest) = (boot, 0);
            self.numbered.series = draw(&mut self.numbered.noise);
            self.emit(None, now);
        }
        if number <= self.numbered.newest {
            return Outcome::NotNewer;
        }
        self.numbered.newest = number;
        match self.switch(command, now) {
            _ if self.stuck => Outcome::Failed,
            outcome => outcome,
        }
    }

    /// Radiates what a command that is newer asks for.
    fn switch(&mut self, command: &COMMAND_INT_DATA, now: Duration) -> Outcome {
        let asked_dbm = f64::from(command.param1);
        if asked_dbm == f64::NEG_INFINITY {
            self.emit(None, now);
            return Outcome::Accepted;
        }
        let expires_ms = command.y.cast_unsigned();
        let ahead_ms = self.numbered.clock.ahead_ms(expires_ms, now);
        if !self.allows(asked_dbm) || ahead_ms > LONGEST_MS {
            return Outcome::Denied;
        }
        if self.is_too_weak(asked_dbm) {
            self.emit(None, now);
            return Outcome::Denied;
        }
        if ahead_ms <= 0 {
            self.emit(None, now);
            return Outcome::Expired;
        }
        let expires_at = self.numbered.clock.reaches(expires_ms, now);
        self.emit(Some(Emission::new(asked_dbm, command.x, expires_at, expires_ms)), now);
        Outcome::Accepted
    }

    /// What it says unasked.
    pub(in crate::vehicle) fn report(&self, now: Duration) -> Report {
        let Numbered { clock, boot, newest, series, .. } = &self.numbered;
        Report {
            time_ms: clock.shows_ms(now),
            boot: *boot,
            newest: *newest,
            answers: (0, 0),
            series: *series,
            expires_ms: self.told.map_or(0, |emission| emission.expires_ms),
            power_mdbm: self.achieved_mdbm(),
            outcome: Outcome::Accepted,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;
    use crate::vehicle::transmitter::RadioDevice;

    const COMMANDER: (u8, u8) = (1, 191);
    const NOW: Duration = Duration::from_millis(123_456);

    fn transmitter() -> Transmitter {
        Transmitter::new(30.0, true, RadioDevice::default(), Noise::new(7, Purpose::Radio, 0))
    }

    /// A command that is obeyed, unless a field is changed.
    fn command(tx: &Transmitter, number: u32, dbm: f32, ahead_ms: i32) -> COMMAND_INT_DATA {
        let expires_ms = tx.report(NOW).time_ms.wrapping_add_signed(ahead_ms);
        COMMAND_INT_DATA {
            param1: dbm,
            param2: number as f32,
            param3: 9.0,
            param4: tx.report(NOW).series as f32,
            x: 4,
            y: expires_ms.cast_signed(),
            ..COMMAND_INT_DATA::DEFAULT
        }
    }

    fn give(tx: &mut Transmitter, command: &COMMAND_INT_DATA) -> Report {
        tx.numbered_command(COMMANDER, command, NOW).unwrap()
    }

    #[test]
    fn spec_a_power_ends_when_the_radios_own_clock_shows_its_expiry() {
        let mut tx = transmitter();
        let on = command(&tx, 1, 26.5, 500);
        let answer = give(&mut tx, &on);
        assert_eq!((answer.outcome, answer.answers, answer.newest), (Outcome::Accepted, (9, 1), 1));
        assert_eq!((answer.power_mdbm, answer.expires_ms), (26_500, on.y.cast_unsigned()));
        let end = tx.expires_at().unwrap();
        let before = end - Duration::from_micros(2);
        assert_eq!(tx.report(before).time_ms, answer.expires_ms.wrapping_sub(1));
        assert_eq!(tx.report(end + Duration::from_micros(2)).time_ms, answer.expires_ms);
        let (least, most) = (Duration::from_micros(498_900), Duration::from_micros(500_100));
        assert!(end - NOW > least && end - NOW < most, "{:?}", end - NOW);
        tx.expire(end);
        assert_eq!((tx.emission(), tx.report(end).power_mdbm), (None, i32::MIN));
    }

    #[test]
    fn spec_what_is_not_newer_is_answered_and_changes_nothing() {
        let mut tx = transmitter();
        let (on, off) = (command(&tx, 1, 20.0, 500), command(&tx, 2, f32::NEG_INFINITY, 0));
        assert_eq!(give(&mut tx, &off).outcome, Outcome::Accepted);
        let late = give(&mut tx, &on);
        assert_eq!((late.outcome, late.answers, late.newest), (Outcome::NotNewer, (9, 1), 2));
        assert_eq!(tx.emission(), None);
        // On again, and a copy of off.
        give(&mut tx, &COMMAND_INT_DATA { param2: 3.0, ..on });
        assert_eq!(give(&mut tx, &off).outcome, Outcome::NotNewer);
        assert!(tx.emission().is_some());
    }

    #[test]
    fn spec_a_new_boot_needs_the_present_series_and_finds_the_radio_off() {
        let mut tx = transmitter();
        let first = command(&tx, 5, 20.0, 500);
        assert_eq!(give(&mut tx, &first).outcome, Outcome::Accepted);
        // The next boot has heard the series of before the first was taken.
        let stale = COMMAND_INT_DATA { param2: 1.0, param3: 10.0, ..first.clone() };
        let refused = give(&mut tx, &stale);
        assert_eq!((refused.outcome, refused.boot, refused.answers), (Outcome::OtherSeries, 9, (10, 1)));
        assert!(tx.emission().is_some(), "nothing changes");
        let off = command(&tx, 1, f32::NEG_INFINITY, 0);
        let taken = give(&mut tx, &COMMAND_INT_DATA { param3: 10.0, ..off });
        assert_eq!((taken.boot, taken.newest, taken.power_mdbm), (10, 1, i32::MIN));
        // What the first still had under way.
        let dead = COMMAND_INT_DATA { param2: 6.0, ..first };
        assert_eq!(give(&mut tx, &dead).outcome, Outcome::OtherSeries);
        assert_eq!(tx.emission(), None);
    }

    #[test]
    fn spec_what_cannot_be_carried_out_takes_its_number_alone() {
        let mut tx = transmitter();
        let on = command(&tx, 1, 20.0, 500);
        give(&mut tx, &on);
        let before = tx.emission();
        for (number, dbm, ahead_ms) in
            [(2, 31.0, 500), (3, f32::NAN, 500), (4, 20.0, 5001), (5, f32::INFINITY, 500)]
        {
            let bad = command(&tx, number, dbm, ahead_ms);
            let answer = give(&mut tx, &bad);
            assert_eq!((answer.outcome, answer.newest), (Outcome::Denied, number), "{bad:?}");
            assert_eq!(tx.emission(), before);
        }
        // Too late to be on at all: off.
        let late = command(&tx, 6, 20.0, 0);
        assert_eq!((give(&mut tx, &late).outcome, tx.emission()), (Outcome::Expired, None));
    }

    #[test]
    fn spec_nobody_but_the_commander_is_heard_and_no_field_may_be_no_number() {
        let mut tx = transmitter();
        let on = command(&tx, 1, 20.0, 500);
        give(&mut tx, &on);
        assert_eq!(tx.numbered_command((1, 190), &COMMAND_INT_DATA { param2: 2.0, ..on.clone() }, NOW), None);
        for bad in [f32::NAN, f32::INFINITY, -1.0, 1.5, 3e7] {
            for change in [
                |c: &mut COMMAND_INT_DATA, bad| c.param2 = bad,
                |c: &mut COMMAND_INT_DATA, bad| c.param3 = bad,
            ] {
                let mut c = COMMAND_INT_DATA { param1: f32::NEG_INFINITY, param2: 2.0, ..on.clone() };
                change(&mut c, bad);
                assert_ne!(give(&mut tx, &c).outcome, Outcome::Accepted, "{c:?}");
            }
        }
        assert!(tx.emission().is_some());
        assert_eq!(tx.report(NOW).newest, 1);
    }

    #[test]
    fn spec_the_clock_wraps_and_the_series_is_another_each_time() {
        let mut tx = transmitter();
        tx.numbered.clock.began_us = (f64::from(u32::MAX) - 123_456.0 - 100.0) * 1e3;
        let on = command(&tx, 1, 20.0, 400);
        assert!(on.y >= 0 && on.y < 400, "{}", on.y);
        assert_eq!(give(&mut tx, &on).outcome, Outcome::Accepted);
        let end = tx.expires_at().unwrap();
        assert!(end > NOW + Duration::from_millis(398) && end <= NOW + Duration::from_millis(401));
        let mut seen = std::collections::BTreeSet::new();
        for boot in 1..100 {
            let off = command(&tx, 1, f32::NEG_INFINITY, 0);
            give(&mut tx, &COMMAND_INT_DATA { param3: boot as f32, ..off });
            let series = tx.report(NOW).series;
            assert!(series > 0 && f64::from(series) < WHOLE);
            seen.insert(series);
        }
        assert!(seen.len() > 95);
    }
}
