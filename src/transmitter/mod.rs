//! The payload radio's transmit power, by MAVLink, as a state machine without I/O.
//!
//! No MAVLink message sets a radio's power, so there are three ways, all acknowledged with the power achieved.
//! *Numbered* ([`Kind::Numbered`]): each command has a number and expires at an instant of the radio's clock, so that a
//! companion that dies is silent by the radio's own doing (S5) and no delay on the way prolongs a power. *Leased*
//! ([`Kind::Leased`]): the expiry counts from the command's receipt; what is late lasts longer, and the preflight says
//! by how much. *By parameter* ([`Kind::Parameter`]): for radios that know no such command; what never expires is
//! turned off by us alone, and the preflight says so.
//!
//! Whether to radiate at all is not decided here but in the mission's interlock. What is decided here always errs
//! towards silence: an expiry is rounded down, what is vouched for is what certainly is, and off is repeated until it
//! is confirmed.

mod checks;
mod comparison;
mod declared;
mod leased;
mod numbered;
mod parameter;
pub mod parameter_protocol;
mod round_trip;
mod steady;
mod terms;
pub mod wire;

#[cfg(test)]
mod tests;

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, MavCmd, MavFrame, MavMessage, MavResult};
use num_traits::FromPrimitive;

use crate::reply;
use crate::time::Instant;
use crate::units::{Dbm, Watts};
pub use comparison::{Demands, FULL_POWER, Permitted};
use declared::Declared;
use leased::Leased;
use numbered::Numbered;
pub use parameter::{Level, PowerParameter, Unit};
pub use parameter_protocol::Protocol;
use steady::Steady;
use terms::Lease;
pub use terms::{Kind, NotReady, Settings, Trouble, Vouched};

/// A command that has not arrived by now never will.
const LONGEST_TRANSIT: Duration = Duration::from_millis(500);
/// How often off is repeated until it is confirmed: fast at first, so that three commands may be lost one after the
/// other and the fourth still arrives within S4's reaction time, ...
const REPEAT_OFF_FAST: Duration = Duration::from_millis(25);
/// ... for so long, ...
const FAST: Duration = Duration::from_millis(200);
/// ... then like this, ...
const REPEAT_OFF: Duration = Duration::from_millis(50);
/// ... and this often when it has not been confirmed for [`PERSISTENCE`]: by then every lease has run out.
const REPEAT_OFF_SLOWLY: Duration = Duration::from_millis(500);
const PERSISTENCE: Duration = Duration::from_secs(2);
/// A command whose expiry counts from its receipt, or that has none, is given as if it arrived this much later, or two
/// round trips if that is longer.
const COMMAND_LATENCY: Duration = Duration::from_millis(20);
/// What such a radio acknowledged is relied on until this much before its expiry, and two round trips.
const MARGIN: Duration = Duration::from_millis(50);
/// A radio not heard for so long is told off again when it is back: it may be another one, or restarted.
const SILENCE_OF_LINK: Duration = Duration::from_millis(2500);

/// What all ways of setting the power have in common, towards [`Transmitter`].
#[derive(Debug, Clone)]
enum Driver {
    Numbered(Numbered),
    Leased(Leased),
    Parameter(parameter::ByParameter),
    None,
}

/// The companion's side of one transmitter.
#[derive(Debug, Clone)]
pub struct Transmitter {
    settings: Settings,
    driver: Driver,
    outbox: std::collections::VecDeque<MavMessage>,
    heard_at: Option<Instant>,
    declared: Declared,
    steady: Steady,
}

impl Transmitter {
    /// A transmitter that is told to be silent first of all (see [`Settings::first_off_after`]): the companion may have
    /// died and come back.
    #[must_use]
    pub fn new(settings: Settings, now: Instant) -> Self {
        let (own, target, off_at) = (settings.own, settings.target, now + settings.first_off_after);
        let driver = match &settings.kind {
            Kind::Numbered { command } => MavCmd::from_u16(*command).map_or(Driver::None, |command| {
                let Settings { boot, longest_round_trip, .. } = settings;
                Driver::Numbered(Numbered::new(command, target, boot, longest_round_trip, off_at))
            }),
            Kind::Leased { command } => MavCmd::from_u16(*command)
                .map_or(Driver::None, |command| Driver::Leased(Leased::new(command, own, target, off_at))),
            Kind::Parameter(parameter) => {
                Driver::Parameter(parameter::ByParameter::new(parameter.clone(), settings.target))
            }
            Kind::None => Driver::None,
        };
        // A power set by parameter never runs out by itself.
        let runs_out = matches!(driver, Driver::Numbered(_) | Driver::Leased(_));
        let mut transmitter = Self {
            settings,
            driver,
            outbox: std::collections::VecDeque::new(),
            heard_at: None,
            declared: Declared::new(runs_out.then_some(now)),
            steady: Steady::default(),
        };
        if !runs_out || transmitter.settings.first_off_after.is_zero() {
            transmitter.silence(now);
        }
        transmitter
    }

    /// Everything aboard shares the autopilot's MAVLink system, which is known once the autopilot is found. Starts
    /// over, silent.
    pub fn adopt_system(&mut self, system: u8, now: Instant) {
        let settings = self.settings.clone();
        let radio_system = if settings.system_is_given { settings.target.0 } else { system };
        let (own, target) = ((system, settings.own.1), (radio_system, settings.target.1));
        let off_at = now + settings.first_off_after;
        let fresh = Self::new(Settings { own, target, ..settings }, now);
        let before = std::mem::replace(self, fresh);
        if let Driver::Numbered(mut numbered) = before.driver {
            // It may be the same radio: what was commanded before is to be older than what is commanded now.
            numbered.turn_to(target, off_at);
            self.outbox.clear();
            self.driver = Driver::Numbered(numbered);
            if self.settings.first_off_after.is_zero() {
                self.silence(now);
            }
        }
    }

    /// Commands this power in watts, or renews it, so that the radio is off by `off_by` unless it is renewed. A power
    /// that is not above zero is off, and what ends within a millisecond may be: expiries are whole ones, rounded down.
    ///
    /// # Errors
    /// Why there is no command that certainly ends in time: it is told to be silent then.
    pub fn command(
        &mut self,
        power_w: f64,
        slot: u16,
        off_by: Instant,
        now: Instant,
    ) -> Result<(), NotReady> {
        let late = match &self.driver {
            Driver::Leased(_) | Driver::Parameter(_) => {
                COMMAND_LATENCY.max(2 * self.round_trip(now).unwrap_or_default())
            }
            Driver::Numbered(_) | Driver::None => Duration::ZERO,
        };
        // It is told to be off by then as much earlier as it takes to be.
        let done = self.set(power_w, slot, off_by - late - self.declared.off(), now);
        self.note(now);
        done
    }

    /// The same, and where an expiry counts from receipt, as if it were received at once.
    fn set(&mut self, power_w: f64, slot: u16, expires_at: Instant, now: Instant) -> Result<(), NotReady> {
        if !(power_w.is_finite() && power_w > 0.0) || expires_at <= now {
            self.tell_off(now);
            return Ok(());
        }
        let out = &mut self.outbox;
        match &mut self.driver {
            Driver::Numbered(numbered) => return numbered.radiate(power_w, slot, expires_at, now, out),
            Driver::Leased(leased) => leased.radiate(power_w, slot, expires_at, now, out),
            Driver::Parameter(parameter) => parameter.radiate(power_w, slot, expires_at, now, out),
            Driver::None => {}
        }
        Ok(())
    }

    /// What the radio certainly radiates, and until when, whatever becomes of us; `None` from the moment it is told to
    /// be silent.
    #[must_use]
    pub fn on_until_at_least(&self, now: Instant) -> Option<Vouched> {
        let vouched = self.answered_until(now)?;
        self.steady.has_been_on(self.declared.settling(), now).then_some(vouched)
    }

    /// The same, by the answers alone.
    fn answered_until(&self, now: Instant) -> Option<Vouched> {
        let Some(lease) = self.acknowledged() else {
            let Driver::Numbered(numbered) = &self.driver else { return None };
            return numbered.on_until_at_least(now);
        };
        let late = MARGIN + 2 * self.round_trip(now).unwrap_or_default();
        let vouched = Vouched { slot: lease.slot, power_w: lease.power_w, until: lease.expires_at - late };
        (vouched.until > now).then_some(vouched)
    }

    /// Whether its answers name the commands that they answer.
    #[must_use]
    pub fn tells_commands_apart(&self) -> bool {
        matches!(self.driver, Driver::Numbered(_))
    }

    /// Whether a slot can be served, as far as is known beforehand.
    ///
    /// # Errors
    /// Why not.
    pub fn ready(&self, now: Instant) -> Result<(), NotReady> {
        match &self.driver {
            Driver::Numbered(numbered) => numbered.ready(now),
            Driver::Leased(leased) => match leased.supported() {
                Some(true) => Ok(()),
                Some(false) => Err(NotReady::Unsupported),
                None => Err(NotReady::NotHeard),
            },
            Driver::Parameter(_) | Driver::None => Ok(()),
        }
    }

    /// Off, at once, and again until the radio confirms it.
    pub fn silence(&mut self, now: Instant) {
        self.tell_off(now);
        self.note(now);
    }

    fn tell_off(&mut self, now: Instant) {
        match &mut self.driver {
            Driver::Numbered(numbered) => numbered.silence(now, &mut self.outbox),
            Driver::Leased(leased) => leased.silence(now, &mut self.outbox),
            Driver::Parameter(parameter) => parameter.silence(now, &mut self.outbox),
            Driver::None => {}
        }
    }

    /// Keeps track of what is known of the radio, since when.
    fn note(&mut self, now: Instant) {
        // A radio that takes no time needs no memory.
        if self.declared.settling().is_zero() && self.declared.off().is_zero() {
            return;
        }
        self.steady.note(self.answered_until(now), self.is_said_off(now), now);
    }

    /// Whether it is the radio that speaks; notes that it does.
    fn hears(&mut self, header: MavHeader, now: Instant) -> bool {
        if (header.system_id, header.component_id)
            != (u32::from(self.settings.target.0), self.settings.target.1)
        {
            return false;
        }
        let before = self.heard_at.replace(now);
        let silent_for = before.map_or(Duration::ZERO, |at| now.saturating_since(at));
        let asks = matches!(self.driver, Driver::Numbered(_) | Driver::Leased(_));
        if asks && (before.is_none() || silent_for > SILENCE_OF_LINK) {
            self.declared.ask_again(now);
        }
        if silent_for > SILENCE_OF_LINK {
            match &mut self.driver {
                Driver::Numbered(numbered) => numbered.link_is_back(now, &mut self.outbox),
                Driver::Leased(leased) => leased.link_is_back(now, &mut self.outbox),
                Driver::Parameter(parameter) => parameter.link_is_back(now, &mut self.outbox),
                Driver::None => {}
            }
        }
        true
    }

    /// Takes the radio's own message; another's is ignored.
    pub fn handle_radio(&mut self, header: MavHeader, message: &wire::MavMessage, now: Instant) {
        let wire::MavMessage::VEILWING_RADIO(report) = message;
        if self.hears(header, now)
            && let Driver::Numbered(numbered) = &mut self.driver
        {
            numbered.handle_report(report, now, &mut self.outbox);
        }
        self.note(now);
    }

    /// Takes a message of the common dialect from the link; what is not the radio's is ignored.
    pub fn handle_message(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        if !self.hears(header, now) {
            return;
        }
        match (&mut self.driver, message) {
            // So asks a radio that learns where we are from what we send, and whose link is signed (`link::dialogue`).
            (Driver::Numbered(_), MavMessage::TIMESYNC(asked)) if asked.tc1 == 0 => {
                self.outbox.push_back(reply::time(self.settings.target, asked, now));
            }
            (Driver::Leased(leased), MavMessage::COMMAND_ACK(ack)) => {
                leased.handle_ack(ack, now, &mut self.outbox)
            }
            (Driver::Numbered(numbered), MavMessage::COMMAND_ACK(ack)) => numbered.handle_ack(ack),
            (Driver::Numbered(_) | Driver::Leased(_), MavMessage::PARAM_VALUE(value)) => {
                self.declared.take(value)
            }
            (Driver::Parameter(parameter), _) => parameter.handle_message(message, now, &mut self.outbox),
            _ => {}
        }
        self.note(now);
    }

    /// Does what is due at `now`: repeats what is not confirmed, turns off what was not renewed.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.declared.advance(now, self.settings.target, &mut self.outbox);
        match &mut self.driver {
            Driver::Numbered(numbered) => numbered.advance(now, &mut self.outbox),
            Driver::Leased(leased) => leased.advance(now, &mut self.outbox),
            Driver::Parameter(parameter) => parameter.advance(now, &mut self.outbox),
            Driver::None => {}
        }
        self.note(now);
    }

    /// The next message to send, addressed; the caller stamps our own (system, component).
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.outbox.pop_front()
    }

    /// When [`Self::handle_timeout`] is next to be called, and for what.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<(Instant, &'static str)> {
        let driver = match &self.driver {
            Driver::Numbered(numbered) => numbered.timeout(),
            Driver::Leased(leased) => leased.timeout(),
            Driver::Parameter(parameter) => parameter.timeout(),
            Driver::None => None,
        };
        [driver, self.declared.timeout()].into_iter().flatten().min().map(|at| (at, "transmitter"))
    }

    /// The power that the radio has acknowledged; `None` from the moment it is told to be silent. Compare its expiry
    /// with the present before relying on it. Never of a radio that takes numbered commands.
    fn acknowledged(&self) -> Option<Lease> {
        match &self.driver {
            Driver::Leased(leased) => leased.lease(),
            Driver::Parameter(parameter) => parameter.lease(),
            Driver::Numbered(_) | Driver::None => None,
        }
    }

    /// Whether the radio is known to be off: it confirmed, or every command's expiry is past, late delivery included.
    /// A confirmation is taken at its word on a link that keeps the order of messages, as serial lines and the
    /// loopback do; where a command to radiate overtakes off, its answer gives it away and off is sent again.
    #[must_use]
    pub fn is_off(&self, now: Instant) -> bool {
        // What says that it is off may still take its time to be.
        self.is_said_off(now) && self.steady.has_been_off(self.declared.off(), now)
    }

    fn is_said_off(&self, now: Instant) -> bool {
        match &self.driver {
            Driver::Numbered(numbered) => numbered.is_off(now),
            Driver::Leased(leased) => leased.is_off(now),
            Driver::Parameter(parameter) => parameter.is_off(),
            Driver::None => true,
        }
    }

    /// Time from a command to its answer, as of late.
    #[must_use]
    pub fn round_trip(&self, now: Instant) -> Option<Duration> {
        match &self.driver {
            Driver::Numbered(numbered) => numbered.round_trip(now),
            Driver::Leased(leased) => leased.round_trip(now),
            Driver::Parameter(parameter) => parameter.round_trip(),
            Driver::None => None,
        }
    }

    /// Whether the radio falls silent by itself (S5): known once it has answered a command that expires, or said its
    /// clock.
    #[must_use]
    pub fn supports_expiry(&self) -> Option<bool> {
        match &self.driver {
            Driver::Numbered(numbered) => numbered.is_heard().then_some(true),
            Driver::Leased(leased) => leased.supported(),
            Driver::Parameter(_) => Some(false),
            Driver::None => None,
        }
    }

    /// The radio's own largest power in watts, if it says.
    #[must_use]
    pub fn limit_w(&self) -> Option<f64> {
        match &self.driver {
            Driver::Numbered(_) | Driver::Leased(_) => self.declared.limit_w(),
            Driver::Parameter(parameter) => parameter.limit_w(),
            Driver::None => None,
        }
    }

    /// What is wrong with the radio's device, by its answer to the newest command that it answered.
    #[must_use]
    pub fn trouble(&self) -> Option<Trouble> {
        match &self.driver {
            Driver::Numbered(numbered) => numbered.trouble(),
            Driver::Leased(_) | Driver::Parameter(_) | Driver::None => None,
        }
    }

    /// What the radio last refused, until it accepts something.
    #[must_use]
    pub fn refusal(&self) -> Option<MavResult> {
        match &self.driver {
            Driver::Leased(leased) => leased.refusal(),
            Driver::Numbered(_) | Driver::Parameter(_) | Driver::None => None,
        }
    }
}

/// Time to the next repetition of an off that has been wanted for `wanted_for`.
fn until_next_off(wanted_for: Duration) -> Duration {
    if wanted_for < FAST {
        REPEAT_OFF_FAST
    } else if wanted_for < PERSISTENCE {
        REPEAT_OFF
    } else {
        REPEAT_OFF_SLOWLY
    }
}

/// A command that sets the power, as both forms of it begin.
fn power_command(
    command: MavCmd,
    (target_system, target_component): (u8, u8),
    power_dbm: f32,
    slot: u16,
    expiry_ms: i32,
) -> COMMAND_INT_DATA {
    COMMAND_INT_DATA {
        param1: power_dbm,
        param2: 0.0,
        param3: 0.0,
        param4: 0.0,
        x: slot.into(),
        y: expiry_ms,
        z: 0.0,
        command,
        target_system,
        target_component,
        frame: MavFrame::MAV_FRAME_GLOBAL,
        current: 0,
        autocontinue: 0,
    }
}

/// A power as commands say it: rounded down to the thousandth of a decibel in which the radio answers (S6).
fn power_dbm(power_w: f64) -> f32 {
    at_most((Dbm::from(Watts(power_w)).0 * 1e3).floor() * 1e-3)
}

/// `value` in single precision, never rounded up (S6).
fn at_most(value: f64) -> f32 {
    let rounded = value as f32;
    if f64::from(rounded) > value { rounded.next_down() } else { rounded }
}
