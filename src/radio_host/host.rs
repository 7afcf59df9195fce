//! The radio host: see the module above.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    COMMAND_INT_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavResult, MavState, MavType,
    STATUSTEXT_DATA,
};

use super::Said;
use super::answers::{Answers, Waiting};
use super::clock::RadioClock;
use super::counters::Counters;
use super::facts::Facts;
use super::kill::Kill;
use super::line::{Level, LineTimes};
use super::notice::Notice;
use super::rig::{Fault, Order, OrderId, Outcome, Rig, Times, Turn};
use super::scale::Scale;
use super::series::{Place, Series, Standing};
use crate::reply::acknowledgement;
use crate::time::Instant;
use crate::transmitter::wire::{VEILWING_RADIO_DATA, VeilwingRadioResult as Result};

/// What a report states as power when there is none.
const OFF: i32 = i32::MIN;
/// An expiry further ahead is of another clock.
const LONGEST_MS: i32 = 5000;
/// The radio may fall silent this much before its expiry, and a little less is used: clocks show whole milliseconds.
const EARLY_AT_MOST: Duration = Duration::from_millis(19);
/// Unasked reports: five a second and more.
const REPORT_EVERY: Duration = Duration::from_millis(150);
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
/// A stranger is told of once in this time.
const STRANGER_EVERY: Duration = Duration::from_secs(10);

/// The largest power is declared in single precision, and asked for in thousandths of a dB.
const LIMIT_SLACK_DB: f64 = 1e-3;

/// What a host is told.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The (system, component) that the radio is.
    pub own: (u8, u8),
    /// Components of its system that may command power; empty: any.
    pub commanders: Vec<u8>,
    /// Systems beside its own whose kill is obeyed though it is not signed.
    pub operators: Vec<u8>,
    /// The link proves who speaks: then every kill is obeyed.
    pub signed: bool,
    /// The command that sets power (MAV_CMD_USER_1).
    pub command: u16,
    /// What the radio declares.
    pub facts: Facts,
    /// Its settings and their powers.
    pub scale: Scale,
    /// How far below the power that was set it may be read back, in dB.
    pub below_db: f64,
    /// Its kill line, if it has one.
    pub line: Option<LineTimes>,
    /// A radio kill of an earlier process holds.
    pub killed: bool,
    /// What series are drawn by; another at each start.
    pub seed: u64,
    /// What the radio's clock shows at [`Instant::ZERO`].
    pub clock_began_ms: u32,
}

/// A power, as far as its end goes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lease {
    /// As commanded, on the radio's clock.
    expires_ms: u32,
    /// When off is told.
    ends_at: Instant,
}

/// The state machine.
#[derive(Debug, Clone)]
pub struct Host {
    pub(super) settings: Settings,
    clock: RadioClock,
    series: Series,
    pub(super) rig: Rig,
    lease: Option<Lease>,
    pub(super) kill: Kill,
    answers: Answers,
    stopping: bool,
    was_silent: bool,
    counters: Counters,
    out: VecDeque<Said>,
    notices: VecDeque<Notice>,
    report_at: Instant,
    heartbeat_at: Instant,
    stranger_told_at: Option<Instant>,
}

impl Host {
    /// A host whose device is told off first of all.
    #[must_use]
    pub fn new(settings: Settings, now: Instant) -> Self {
        let times = Times { off: settings.facts.off, change: settings.facts.change };
        Self {
            clock: RadioClock::new(settings.clock_began_ms),
            series: Series::new(settings.seed),
            rig: Rig::new(settings.scale.clone(), times, settings.below_db, settings.line, now),
            lease: None,
            kill: Kill::new(settings.killed),
            answers: Answers::default(),
            stopping: false,
            was_silent: false,
            counters: Counters::default(),
            out: VecDeque::new(),
            notices: VecDeque::new(),
            report_at: now,
            heartbeat_at: now,
            stranger_told_at: None,
            settings,
        }
    }

    /// Takes a message of the common dialect from the link. What is not for the radio is ignored.
    pub fn handle_message(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        let Ok(system) = u8::try_from(header.system_id) else { return };
        let sender = (system, header.component_id);
        self.run_out(now);
        match message {
            MavMessage::COMMAND_INT(c)
                if u32::from(self.settings.command) == c.command as u32
                    && (c.target_system, c.target_component) == self.settings.own =>
            {
                self.handle_power(sender, c, now);
            }
            MavMessage::COMMAND_INT(c) => {
                self.handle_command(sender, (c.target_system, c.target_component), c.command, c.param1, now);
            }
            MavMessage::COMMAND_LONG(c) => {
                self.handle_command(sender, (c.target_system, c.target_component), c.command, c.param1, now);
            }
            MavMessage::TIMESYNC(m) if m.tc1 == 0 => self.answer_time(sender, m, now),
            MavMessage::PARAM_REQUEST_LIST(m) => {
                self.answer_parameters((m.target_system, m.target_component), message)
            }
            MavMessage::PARAM_REQUEST_READ(m) => {
                self.answer_parameters((m.target_system, m.target_component), message)
            }
            MavMessage::PARAM_SET(m) => {
                self.answer_parameters((m.target_system, m.target_component), message)
            }
            _ => {}
        }
    }

    /// Takes what became of a device's order.
    pub fn handle_outcome(&mut self, id: OrderId, outcome: Outcome, now: Instant) {
        self.run_out(now);
        let turn = self.rig.handle_outcome(id, outcome, now);
        self.follow(turn, now);
    }

    /// Takes whether the kill line was driven as [`Self::poll_line`] said, and read back where that can be.
    pub fn handle_line(&mut self, level: Level, obeyed: bool, now: Instant) {
        self.run_out(now);
        let turn = self.rig.handle_line(level, obeyed, now);
        self.follow(turn, now);
    }

    /// Does what is due at `now`.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.run_out(now);
        let turn = self.rig.handle_timeout(now);
        self.follow(turn, now);
        if self.heartbeat_at <= now {
            self.heartbeat_at = now + HEARTBEAT_EVERY;
            self.say(self.heartbeat());
        }
        if self.report_at <= now {
            self.report_at = now + REPORT_EVERY;
            let report = self.report(now);
            self.out.push_back(Said::Report(report));
        }
    }

    /// Off, for good: whatever is commanded from now on is refused.
    pub fn stop(&mut self, now: Instant) {
        self.stopping = true;
        self.silence(now);
    }

    /// Whether the device was read back off, and is not wanted on.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.rig.is_off()
    }

    /// Whether nothing is radiated, by the device's word or by the kill line.
    #[must_use]
    pub fn is_silent(&self) -> bool {
        self.rig.is_silent()
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<Said> {
        self.out.pop_front()
    }

    /// The next order for the device: it pre-empts the one before.
    pub fn poll_order(&mut self) -> Option<(OrderId, Order)> {
        self.rig.poll_order()
    }

    /// The next level of the kill line, before any order for the device.
    pub fn poll_line(&mut self) -> Option<Level> {
        self.rig.poll_line()
    }

    /// What the operator should know; it is also sent as STATUSTEXT.
    pub fn poll_notice(&mut self) -> Option<Notice> {
        self.notices.pop_front()
    }

    /// Whether a kill is to be on record for the next process, if that has changed.
    pub fn poll_kill_record(&mut self) -> Option<bool> {
        self.kill.poll_record()
    }

    /// When [`Self::handle_timeout`] is next to be called, and for what.
    #[must_use]
    pub fn poll_timeout(&self) -> (Instant, &'static str) {
        let lease = self.lease.map(|lease| (lease.ends_at, "lease"));
        let device = self.rig.timeout().map(|at| (at, "device"));
        let regular = (self.report_at.min(self.heartbeat_at), "report");
        [lease, device]
            .into_iter()
            .flatten()
            .fold(regular, |first, other| if other.0 < first.0 { other } else { first })
    }

    /// What became of all commands.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// What it says of itself, unasked.
    #[must_use]
    pub fn report(&self, now: Instant) -> VEILWING_RADIO_DATA {
        let power_mdbm = self.rig.power_dbm().map_or(OFF, thousandths);
        VEILWING_RADIO_DATA {
            time_ms: self.clock.shows_ms(now),
            boot: self.series.boot,
            newest: self.series.newest,
            answers_boot: 0,
            answers: 0,
            series: self.series.series,
            expires_ms: self.lease.map_or(0, |lease| lease.expires_ms),
            power_mdbm,
            result: Result::VEILWING_RADIO_RESULT_ACCEPTED,
        }
    }

    /// A command that sets power.
    fn handle_power(&mut self, sender: (u8, u8), command: &COMMAND_INT_DATA, now: Instant) {
        let allowed = &self.settings.commanders;
        let may = sender.0 == self.settings.own.0 && (allowed.is_empty() || allowed.contains(&sender.1));
        if !may {
            return self.is_stranger(sender, now);
        }
        if command.param2 == 0.0 {
            // The form whose expiry counts from receipt: not spoken here.
            return self.say(acknowledgement(sender, command.command, MavResult::MAV_RESULT_UNSUPPORTED));
        }
        let newcomer = !self.series.has_commander();
        if !self.series.is_heard(sender) {
            return self.is_stranger(sender, now);
        }
        if newcomer {
            self.tell(Notice::Commander { system: sender.0, component: sender.1 });
        }
        let place = Place::of([command.param2, command.param3, command.param4]);
        let standing = self.series.take(place);
        if matches!(standing, Standing::BeginsBoot | Standing::BeginsBootNotNewer) {
            self.silence(now);
        }
        let waiting =
            Waiting { boot: place.boot, number: place.number, off: command.param1 == f32::NEG_INFINITY };
        let result = match standing {
            Standing::NotNewer | Standing::BeginsBootNotNewer => {
                Some(Result::VEILWING_RADIO_RESULT_NOT_NEWER)
            }
            Standing::OtherSeries => Some(Result::VEILWING_RADIO_RESULT_OTHER_SERIES),
            Standing::Counts | Standing::BeginsBoot => self.carry_out(command, now),
        };
        match result {
            Some(result) => self.answer(waiting, result, now),
            None => self.answers.wait(waiting),
        }
        self.answer_settled(now);
    }

    /// Carries out a command that counts: what became of it, if that does not wait for the device.
    fn carry_out(&mut self, command: &COMMAND_INT_DATA, now: Instant) -> Option<Result> {
        let asked_dbm = f64::from(command.param1);
        if asked_dbm == f64::NEG_INFINITY {
            self.silence(now);
            return self.rig.fault().filter(|_| !self.rig.is_silent()).map(result_of);
        }
        let expires_ms = command.y.cast_unsigned();
        let ahead_ms = self.clock.ahead_ms(expires_ms, now);
        // Not at most: also what is no number.
        let within = asked_dbm <= self.settings.facts.most_dbm + LIMIT_SLACK_DB;
        if !within || ahead_ms > LONGEST_MS {
            return Some(Result::VEILWING_RADIO_RESULT_DENIED);
        }
        let ends_at = self.clock.reaches(expires_ms, now) - self.settings.facts.off.min(EARLY_AT_MOST);
        if ahead_ms <= 0 || ends_at <= now {
            self.silence(now);
            return Some(Result::VEILWING_RADIO_RESULT_EXPIRED);
        }
        if self.kill.holds() || self.stopping {
            return Some(Result::VEILWING_RADIO_RESULT_NOT_NOW);
        }
        let Some(setting) = self.rig.scale().at_most(asked_dbm) else {
            self.silence(now);
            return Some(Result::VEILWING_RADIO_RESULT_TOO_LOW);
        };
        match self.rig.want(setting, now) {
            Ok(()) => {
                self.lease = Some(Lease { expires_ms, ends_at });
                None
            }
            Err(fault) => Some(result_of(fault)),
        }
    }

    /// The end of the lease, by the radio's clock.
    fn run_out(&mut self, now: Instant) {
        if self.lease.is_none_or(|lease| now < lease.ends_at) {
            return;
        }
        if self.rig.is_wanted_on() {
            self.counters.ran_out += 1;
            self.tell(Notice::RanOut);
        }
        self.silence(now);
    }

    pub(super) fn silence(&mut self, now: Instant) {
        self.lease = None;
        self.rig.want_off(now);
        // What was to be radiated is not any more.
        for waiting in self.answers.take(|waiting| !waiting.off) {
            self.answer(waiting, Result::VEILWING_RADIO_RESULT_EXPIRED, now);
        }
    }

    /// Acts on what the device or the time has brought about.
    fn follow(&mut self, turn: Turn, now: Instant) {
        match turn {
            Turn::Nothing => {}
            Turn::Stale => self.counters.stale_outcomes += 1,
            Turn::Cut if self.rig.fault().is_some_and(|fault| fault != Fault::Line) => self.tell_of_line(),
            Turn::Silent | Turn::Cut if !self.was_silent => {
                self.was_silent = true;
                self.tell(Notice::Silent);
            }
            Turn::Silent | Turn::Cut | Turn::Reached => {}
            Turn::Failed(fault) => {
                let was_on = self.lease.take().is_some();
                match fault {
                    _ if was_on => self.tell(Notice::Fault(fault)),
                    Fault::Line if self.rig.is_silent() => self.tell(Notice::Fault(fault)),
                    _ if self.rig.is_cut() => self.tell_of_line(),
                    _ => self.tell(Notice::MayRadiate(fault)),
                }
                for waiting in self.answers.take(|_| true) {
                    self.answer(waiting, result_of(fault), now);
                }
            }
        }
        self.answer_settled(now);
    }

    /// Says that the line alone keeps the radio silent, and why it has to.
    fn tell_of_line(&mut self) {
        if let Some(fault) = self.rig.fault() {
            self.tell(Notice::ByLine(fault));
        }
    }

    /// Answers what waited for the device to be where it is.
    pub(super) fn answer_settled(&mut self, now: Instant) {
        let (reached, off) = (self.rig.is_reached(), self.rig.is_silent());
        for waiting in self.answers.take(|waiting| reached || off && waiting.off) {
            self.answer(waiting, Result::VEILWING_RADIO_RESULT_ACCEPTED, now);
        }
        if self.rig.is_silent() && !self.rig.is_wanted_on() {
            for answer in self.kill.answers() {
                self.say(answer);
            }
        }
    }

    fn answer(&mut self, command: Waiting, result: Result, now: Instant) {
        self.counters.count(result);
        let report = self.report(now);
        self.out.push_back(Said::Report(VEILWING_RADIO_DATA {
            answers_boot: command.boot,
            answers: command.number,
            result,
            ..report
        }));
    }

    pub(super) fn is_stranger(&mut self, (system, component): (u8, u8), now: Instant) {
        self.counters.strangers += 1;
        if self.stranger_told_at.is_none_or(|at| at + STRANGER_EVERY <= now) {
            self.stranger_told_at = Some(now);
            self.tell(Notice::Stranger { system, component });
        }
    }

    fn heartbeat(&self) -> MavMessage {
        let system_status = match (self.rig.fault(), self.rig.is_off()) {
            (Some(_), _) => MavState::MAV_STATE_CRITICAL,
            (None, true) => MavState::MAV_STATE_STANDBY,
            (None, false) => MavState::MAV_STATE_ACTIVE,
        };
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: MavType::MAV_TYPE_RADIO,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status,
            mavlink_version: 3,
        })
    }

    pub(super) fn tell(&mut self, notice: Notice) {
        let text = notice.to_string();
        self.say(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity: notice.severity(),
            text: text.as_str().into(),
            ..STATUSTEXT_DATA::default()
        }));
        self.notices.push_back(notice);
    }

    pub(super) fn say(&mut self, message: MavMessage) {
        self.out.push_back(Said::Common(Box::new(message)));
    }
}

fn result_of(fault: Fault) -> Result {
    match fault {
        Fault::Late => Result::VEILWING_RADIO_RESULT_DEVICE_LATE,
        Fault::Unreachable | Fault::Refused | Fault::Garbled | Fault::Line => {
            Result::VEILWING_RADIO_RESULT_DEVICE_ERROR
        }
        Fault::OtherPower | Fault::StillOn => Result::VEILWING_RADIO_RESULT_OTHER_POWER,
    }
}

/// A power in thousandths of a dBm, to the nearest: what is read back is printed in decimals.
fn thousandths(dbm: f64) -> i32 {
    // Saturates; the least is kept for off.
    ((dbm * 1e3).round() as i32).max(OFF + 1)
}
