//! Power by numbered commands whose expiry is an instant of the radio's clock; docs/radio.md is the radio's side.
//!
//! A command counts the moment at which it is obeyed, not the moment at which it is sent: one that expires "in 500 ms"
//! is prolonged by whatever delays it, and an answer that does not name its command vouches for the wrong one. So:
//!
//! - COMMAND_INT carries the power in dBm (param1; minus infinity: off), its number (param2), our boot (param3), the
//!   radio's series (param4), the slot (x) and the expiry on the radio's clock in ms (y, the clock's 32 bits).
//! - The radio takes a command only if its number is above the newest of the boot in force. A command of another boot
//!   it takes only with the present series, a number that it draws anew at power-up and at each boot taken. A dead
//!   boot's commands therefore end with the first of the living one's: those carry the series before it, and are
//!   refused whether or not that boot was ever heard. The series comes from the radio, so that a boot is taken when it
//!   has heard the radio since the last one was.
//! - The radio answers each command with what it names, its clock, the newest number and the power in force
//!   (VEILWING_RADIO), and says the same unasked. What is believed of it is of the series in which it holds our boot;
//!   which one that is, answers alone say, for only they are known to be younger than the command that they name.
//!
//! *Off by T*: the expiry is what the radio's clock has certainly reached by T ([`clock`]), so that however late the
//! command arrives, the radio is off by T. *On until*: the newest command answered is in force, or one sent after it;
//! the radio stays on until the earliest expiry of them, not before its clock can have reached that. A radio may be
//! off by [`RADIO_STEP`] early, for it looks at its clock in steps, and never late.

mod clock;
mod commands;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage};

use super::round_trip::RoundTrips;
use super::wire::{VEILWING_RADIO_DATA, VeilwingRadioResult};
use super::{NotReady, PERSISTENCE, REPEAT_OFF_FAST, Trouble, Vouched, until_next_off};
use crate::time::Instant;
use crate::units::{Dbm, Watts};
use clock::{RadioClock, RadioTime};
use commands::{Asked, Commands, Sent};

/// What a report states as power when there is none.
const OFF: i32 = i32::MIN;
/// A wanted power that is not answered is commanded again after this.
const REPEAT_ON: Duration = Duration::from_millis(100);
/// A confirmed off is commanded again this often: its answer is a reading of the clock and of the round trip.
const PROBE: Duration = Duration::from_millis(250);
/// The radio may fall silent this much before its expiry.
const RADIO_STEP: Duration = Duration::from_millis(20);

/// What is wanted of the radio.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Wanted {
    Off {
        since: Instant,
        /// The number of the first off: when it or a later one is taken, nothing before it is.
        first_off: u32,
        confirmed: bool,
        repeat_at: Instant,
    },
    On {
        power_w: f64,
        slot: u16,
        off_by: Instant,
        repeat_at: Instant,
    },
}

/// The newest power that the radio has answered.
#[derive(Debug, Clone, Copy, PartialEq)]
struct InForce {
    number: u32,
    power_mdbm: i32,
    /// As commanded, to tell a mere renewal.
    asked_w: f64,
    slot: u16,
    expires: RadioTime,
}

/// The driver of a transmitter that takes numbered commands.
#[derive(Debug, Clone)]
pub(super) struct Numbered {
    commands: Commands,
    longest_round_trip: Duration,
    wanted: Wanted,
    /// The series in which the radio holds our boot.
    taken: Option<u32>,
    /// The number of the newest command whose answer has said so.
    series_by: u32,
    /// The highest number that the radio is known to have taken: nothing before it is taken any more.
    newest_taken: u32,
    clock: RadioClock,
    round_trips: RoundTrips,
    in_force: Option<InForce>,
    /// What is wrong with its device, by the answer to the command of this number: newer ones are not answered yet.
    trouble: Option<(u32, Trouble)>,
    /// The latest instant by which the radio was commanded to be off by itself.
    on_until: Option<Instant>,
    heard_at: Option<Instant>,
    /// It answers by COMMAND_ACK, as a radio of the first form does.
    acknowledged: bool,
}

impl Numbered {
    pub(super) fn new(
        command: MavCmd,
        target: (u8, u8),
        boot: u32,
        longest_round_trip: Duration,
        off_at: Instant,
    ) -> Self {
        Self::commanding(Commands::new(command, target, boot), longest_round_trip, off_at)
    }

    fn commanding(commands: Commands, longest_round_trip: Duration, off_at: Instant) -> Self {
        let first_off = commands.last_number() + 1;
        Self {
            commands,
            longest_round_trip,
            wanted: Wanted::Off { since: off_at, first_off, confirmed: false, repeat_at: off_at },
            taken: None,
            series_by: 0,
            newest_taken: 0,
            clock: RadioClock::default(),
            round_trips: RoundTrips::default(),
            in_force: None,
            trouble: None,
            on_until: None,
            heard_at: None,
            acknowledged: false,
        }
    }

    /// Turns to another radio, silent; the numbers go on, in case it is the same.
    pub(super) fn turn_to(&mut self, target: (u8, u8), off_at: Instant) {
        let commands = self.commands.to_another(target);
        let fresh = Self::commanding(commands, self.longest_round_trip, off_at);
        *self = Self { on_until: self.on_until, ..fresh };
    }

    /// Commands this power, or renews it; off by `off_by`.
    pub(super) fn radiate(
        &mut self,
        power_w: f64,
        slot: u16,
        off_by: Instant,
        now: Instant,
        out: &mut VecDeque<MavMessage>,
    ) -> Result<(), NotReady> {
        let able = if self.commands.are_used_up() { Err(NotReady::NotTaken) } else { self.read_lately(now) };
        if let Err(reason) = able {
            if matches!(self.wanted, Wanted::On { .. }) {
                self.silence(now, out);
            }
            return Err(reason);
        }
        self.wanted = Wanted::On { power_w, slot, off_by, repeat_at: now + REPEAT_ON };
        self.send_on(now, out);
        Ok(())
    }

    pub(super) fn silence(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        self.in_force = None;
        let first_off = match self.wanted {
            Wanted::Off { first_off, .. } => first_off,
            Wanted::On { .. } => self.commands.last_number() + 1,
        };
        let repeat_at = now + until_next_off(Duration::ZERO);
        self.wanted = Wanted::Off { since: now, first_off, confirmed: false, repeat_at };
        self.send(Asked::Off, now, out);
    }

    pub(super) fn link_is_back(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        if matches!(self.wanted, Wanted::Off { .. }) {
            self.silence(now, out);
        }
    }

    /// COMMAND_ACK names no command and vouches for nothing; it tells a radio that knows no better.
    pub(super) fn handle_ack(&mut self, ack: &COMMAND_ACK_DATA) {
        self.acknowledged |= ack.command == self.commands.command();
    }

    pub(super) fn has_acknowledged(&self) -> bool {
        self.acknowledged
    }

    /// Takes what the radio says.
    pub(super) fn handle_report(
        &mut self,
        report: &VEILWING_RADIO_DATA,
        now: Instant,
        out: &mut VecDeque<MavMessage>,
    ) {
        let (boot, given) = (self.commands.boot(), self.commands.last_number());
        let names_ours = report.answers != 0 && report.answers_boot == boot;
        let beyond_ours =
            names_ours && report.answers > given || report.boot == boot && report.newest > given;
        if beyond_ours {
            return; // What was never sent was never answered.
        }
        self.heard_at = Some(now);
        let named = names_ours.then(|| self.commands.answered(report.answers)).flatten();
        if let Some((sent, true)) = named {
            self.round_trips.add(sent.at, now);
        }
        self.follow_series(report, names_ours, now, out);
        if report.boot != boot || self.taken != Some(report.series) {
            return;
        }
        self.clock.read(report.time_ms, named.map(|(sent, _)| sent.at), now);
        self.newest_taken = self.newest_taken.max(report.newest);
        self.follow_power(report);
        if let Some((sent, _)) = named {
            self.take_answer(report, &sent);
        }
        self.commands.forget_settled(self.newest_taken, self.in_force.map(|known| known.number));
        self.confirm_off(report, now, out);
    }

    /// Finds out in which series the radio holds our boot. What is not an answer to a command of ours may be older
    /// than everything that we know.
    fn follow_series(
        &mut self,
        report: &VEILWING_RADIO_DATA,
        names_ours: bool,
        now: Instant,
        out: &mut VecDeque<MavMessage>,
    ) {
        let newest_word = names_ours && report.answers >= self.series_by;
        let ours = report.boot == self.commands.boot();
        if newest_word {
            self.series_by = report.answers;
            let taken = ours.then_some(report.series);
            if self.taken != taken {
                self.clock = RadioClock::default();
                (self.in_force, self.newest_taken) = (None, 0);
            }
            self.taken = taken;
        }
        if newest_word && !ours {
            self.commands.name_series(report.series);
            // It was switched off and on, or obeys another: off either way, and to be taken anew.
            let last = self.commands.last().map(|sent| sent.at);
            if last.is_none_or(|at| at + REPEAT_OFF_FAST <= now) || matches!(self.wanted, Wanted::On { .. }) {
                self.silence(now, out);
            }
        } else if !names_ours && !ours && self.taken.is_none() && self.series_by == 0 {
            self.commands.name_series(report.series);
        }
    }

    /// What a report says of the power in force, if it is as young.
    fn follow_power(&mut self, report: &VEILWING_RADIO_DATA) {
        let Some(in_force) = self.in_force.as_mut().filter(|known| report.newest >= known.number) else {
            return;
        };
        if report.power_mdbm == OFF {
            self.in_force = None;
        } else if report.newest == in_force.number {
            in_force.power_mdbm = in_force.power_mdbm.min(report.power_mdbm);
        }
    }

    fn take_answer(&mut self, report: &VEILWING_RADIO_DATA, sent: &Sent) {
        use VeilwingRadioResult as Is;
        self.follow_trouble(report.result, sent.number);
        match report.result {
            Is::VEILWING_RADIO_RESULT_ACCEPTED => {
                // A late answer names a command that is forgotten by now.
                if let Asked::On { power_w, slot, expires } = sent.asked
                    && report.newest == sent.number
                    && report.power_mdbm != OFF
                    && matches!(self.wanted, Wanted::On { .. })
                {
                    let expires = expires.min(self.clock.unwrap(report.expires_ms));
                    let power_mdbm = report.power_mdbm;
                    self.in_force =
                        Some(InForce { number: sent.number, power_mdbm, asked_w: power_w, slot, expires });
                }
            }
            Is::VEILWING_RADIO_RESULT_DENIED
            | Is::VEILWING_RADIO_RESULT_NOT_NOW
            | Is::VEILWING_RADIO_RESULT_FAILED => {
                self.commands.refused(sent.number);
            }
            // Not as it was before: it is off, or told to be.
            Is::VEILWING_RADIO_RESULT_TOO_LOW
            | Is::VEILWING_RADIO_RESULT_DEVICE_LATE
            | Is::VEILWING_RADIO_RESULT_DEVICE_ERROR
            | Is::VEILWING_RADIO_RESULT_OTHER_POWER => self.in_force = None,
            // A copy of one that was taken is not newer either: that it is not in force does not follow.
            Is::VEILWING_RADIO_RESULT_NOT_NEWER
            | Is::VEILWING_RADIO_RESULT_OTHER_SERIES
            | Is::VEILWING_RADIO_RESULT_EXPIRED => {}
        }
    }

    /// What the answer says of the radio's device, unless a newer one has been heard.
    fn follow_trouble(&mut self, result: VeilwingRadioResult, number: u32) {
        use VeilwingRadioResult as Is;
        if self.trouble.is_some_and(|(said_by, _)| number < said_by) {
            return;
        }
        let trouble = match result {
            Is::VEILWING_RADIO_RESULT_TOO_LOW => Trouble::TooLow,
            Is::VEILWING_RADIO_RESULT_DEVICE_LATE => Trouble::DeviceLate,
            Is::VEILWING_RADIO_RESULT_DEVICE_ERROR => Trouble::DeviceError,
            Is::VEILWING_RADIO_RESULT_OTHER_POWER => Trouble::OtherPower,
            Is::VEILWING_RADIO_RESULT_ACCEPTED => {
                self.trouble = None;
                return;
            }
            // Of the command, and not of the device.
            Is::VEILWING_RADIO_RESULT_DENIED
            | Is::VEILWING_RADIO_RESULT_NOT_NOW
            | Is::VEILWING_RADIO_RESULT_FAILED
            | Is::VEILWING_RADIO_RESULT_NOT_NEWER
            | Is::VEILWING_RADIO_RESULT_OTHER_SERIES
            | Is::VEILWING_RADIO_RESULT_EXPIRED => return,
        };
        self.trouble = Some((number, trouble));
    }

    /// What is wrong with the radio's device, as far as its answers say.
    pub(super) fn trouble(&self) -> Option<Trouble> {
        self.trouble.map(|(_, trouble)| trouble)
    }

    fn confirm_off(&mut self, report: &VEILWING_RADIO_DATA, now: Instant, out: &mut VecDeque<MavMessage>) {
        let off = report.power_mdbm == OFF;
        match &mut self.wanted {
            Wanted::Off { first_off, confirmed, .. } if report.newest >= *first_off => {
                let came_on = *confirmed && !off;
                *confirmed = off;
                if came_on {
                    self.silence(now, out);
                }
            }
            Wanted::Off { .. } | Wanted::On { .. } => {}
        }
    }

    pub(super) fn advance(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        match &mut self.wanted {
            Wanted::Off { confirmed, since, repeat_at, .. } if *repeat_at <= now => {
                let unconfirmed = until_next_off(now.saturating_since(*since)).min(PROBE);
                *repeat_at = now + if *confirmed { PROBE } else { unconfirmed };
                self.send(Asked::Off, now, out);
            }
            Wanted::On { off_by, .. } if *off_by <= now => self.silence(now, out),
            Wanted::On { repeat_at, .. } if *repeat_at <= now => {
                *repeat_at = now + REPEAT_ON;
                if self.commands.last().is_none_or(|last| !last.answered) {
                    self.send_on(now, out);
                }
            }
            Wanted::Off { .. } | Wanted::On { .. } => {}
        }
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        match self.wanted {
            Wanted::Off { repeat_at, .. } => Some(repeat_at),
            Wanted::On { off_by, repeat_at, .. } => Some(off_by.min(repeat_at)),
        }
    }

    /// What the radio certainly radiates, and until when: see the module.
    pub(super) fn on_until_at_least(&self, now: Instant) -> Option<Vouched> {
        let known = self.in_force?;
        let Wanted::On { slot, off_by, .. } = self.wanted else { return None };
        if slot != known.slot {
            return None;
        }
        let mut expires = known.expires;
        for later in self.commands.not_refused_since(known.number) {
            match later.asked {
                Asked::On { power_w, slot, expires: its }
                    if power_w == known.asked_w && slot == known.slot =>
                {
                    expires = expires.min(its);
                }
                Asked::On { .. } | Asked::Off => return None,
            }
        }
        // A clock that has gone back would promise more than anybody asked for.
        let until = (self.clock.not_before(expires, now)? - RADIO_STEP).min(off_by);
        let power_w = Watts::from(Dbm(f64::from(known.power_mdbm) * 1e-3)).0;
        (until > now).then_some(Vouched { slot: known.slot, power_w, until })
    }

    pub(super) fn is_off(&self, now: Instant) -> bool {
        match self.wanted {
            Wanted::On { .. } => false,
            Wanted::Off { confirmed: true, .. } => true,
            // Whatever may still be under way has expired. What a former boot commanded has as well after a while.
            Wanted::Off { since, .. } => match self.on_until {
                Some(until) => until <= now,
                None => self.heard_at.is_some() && since + PERSISTENCE <= now,
            },
        }
    }

    /// Whether a slot can be served.
    pub(super) fn ready(&self, now: Instant) -> Result<(), NotReady> {
        self.read_lately(now)?;
        if let Some(trouble) = self.trouble() {
            return Err(NotReady::Trouble(trouble));
        }
        let round_trip = self.round_trips.median(now).ok_or(NotReady::NotAnswered)?;
        let longest = self.longest_round_trip;
        if round_trip > longest { Err(NotReady::TooSlow { round_trip, longest }) } else { Ok(()) }
    }

    /// Whether a command can be given: the radio's clock must be known of late.
    fn read_lately(&self, now: Instant) -> Result<(), NotReady> {
        let heard_at = self.heard_at.ok_or(NotReady::NotHeard)?;
        match self.clock.age(now) {
            Some(age) if age > clock::OLDEST => Err(NotReady::Stale { age }),
            Some(_) => Ok(()),
            None if now.saturating_since(heard_at) > clock::OLDEST => {
                Err(NotReady::Stale { age: now.saturating_since(heard_at) })
            }
            None => Err(NotReady::NotTaken),
        }
    }

    pub(super) fn round_trip(&self, now: Instant) -> Option<Duration> {
        self.round_trips.median(now)
    }

    pub(super) fn is_heard(&self) -> bool {
        self.heard_at.is_some()
    }

    fn send_on(&mut self, now: Instant, out: &mut VecDeque<MavMessage>) {
        let Wanted::On { power_w, slot, off_by, .. } = self.wanted else { return };
        // Nothing is sent by a reading too old; the next report brings a new one, or the time runs out.
        let Some(expires) = self.clock.reached_by(off_by, now) else { return };
        if Some(expires) <= self.clock.reached_by(now, now) {
            return self.silence(now, out);
        }
        self.on_until = self.on_until.max(Some(off_by));
        self.send(Asked::On { power_w, slot, expires }, now, out);
    }

    fn send(&mut self, asked: Asked, now: Instant, out: &mut VecDeque<MavMessage>) {
        if asked == Asked::Off && self.commands.are_used_up() {
            self.begin_anew(now);
        }
        let (message, forgotten) = self.commands.give(asked, now);
        if let Some(forgotten) = forgotten {
            // What is no longer known may be in force as well.
            self.in_force = self.in_force.filter(|known| forgotten <= known.number);
        }
        out.push_back(message);
    }

    /// The numbers are used up, after weeks: as if we had started again.
    fn begin_anew(&mut self, now: Instant) {
        let commands = self.commands.begun_anew(self.taken);
        let fresh = Self::commanding(commands, self.longest_round_trip, now + REPEAT_OFF_FAST);
        *self = Self { on_until: self.on_until, ..fresh };
    }
}
