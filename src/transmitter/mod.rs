//! The payload radio's transmit power, by MAVLink, as a state machine without I/O.
//!
//! No MAVLink message sets a radio's power, so there are two ways, both acknowledged with the power achieved.
//! *Leased* ([`Kind::Leased`]): each command carries an expiry, and a companion that dies is silent by the radio's
//! own doing (S5). *By parameter* ([`Kind::Parameter`]): for radios that know no such command; what never expires
//! is turned off by us alone, and the preflight says so.
//!
//! Whether to radiate at all is not decided here but in the mission's interlock. What is decided here always errs
//! towards silence: an expiry is rounded down, a lease counts from when its command was sent, an acknowledgement
//! that may belong to an older command is taken for the older command's, and off is repeated until it is confirmed.

mod leased;
mod parameter;

#[cfg(test)]
mod tests;

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};
use num_traits::FromPrimitive;

use crate::preflight::{Check, Verdict, check};
use crate::time::Instant;
use leased::Leased;
pub use parameter::{Level, PowerParameter, Protocol, Unit};

/// The parameter in which a radio says its largest power in dBm.
const LIMIT_PARAMETER: &str = "TX_MAX_DBM";
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
/// A radio not heard for so long is told off again when it is back: it may be another one, or restarted.
const SILENCE_OF_LINK: Duration = Duration::from_millis(2500);

/// How the power is set.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// By COMMAND_INT with this command id: power in dBm in param1, slot in x, expiry in milliseconds in y.
    Leased {
        /// The MAV_CMD.
        command: u16,
    },
    /// By a parameter of the radio component, which does not expire.
    Parameter(PowerParameter),
    /// There is no radio: nothing is ever sent, and no power achieved.
    None,
}

/// The transmitter's settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Our own (system, component).
    pub own: (u8, u8),
    /// The radio's (system, component).
    pub target: (u8, u8),
    /// How its power is set.
    pub kind: Kind,
    /// How long after the start the first off is sent, if nothing else is commanded before. Not at once where a
    /// companion that died and came back may have promised the peer to radiate until its lease runs out (S3).
    pub first_off_after: Duration,
}

/// A power that the radio has acknowledged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lease {
    /// The power achieved, as the radio reports it, in watts.
    pub power_w: f64,
    /// The slot that came with the command.
    pub slot: u16,
    /// The radio may be silent from here on: counted from when the command was sent, not from when it was answered.
    pub expires_at: Instant,
}

/// What both ways of setting the power have in common, towards [`Transmitter`].
#[derive(Debug, Clone)]
enum Driver {
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
    limit: Limit,
}

/// The largest power, asked for at the start.
#[derive(Debug, Clone, Default)]
struct Limit {
    limit_w: Option<f64>,
    asked: u8,
    ask_at: Option<Instant>,
}

impl Transmitter {
    /// A transmitter that is told to be silent first of all (see [`Settings::first_off_after`]): the companion may have
    /// died and come back.
    #[must_use]
    pub fn new(settings: Settings, now: Instant) -> Self {
        let driver = match &settings.kind {
            Kind::Leased { command } => MavCmd::from_u16(*command).map_or(Driver::None, |command| {
                Driver::Leased(Leased::new(
                    command,
                    settings.own,
                    settings.target,
                    now + settings.first_off_after,
                ))
            }),
            Kind::Parameter(parameter) => {
                Driver::Parameter(parameter::ByParameter::new(parameter.clone(), settings.target))
            }
            Kind::None => Driver::None,
        };
        let limit = Limit { ask_at: matches!(driver, Driver::Leased(_)).then_some(now), ..Limit::default() };
        let mut transmitter =
            Self { settings, driver, outbox: std::collections::VecDeque::new(), heard_at: None, limit };
        // A power set by parameter never runs out by itself.
        let runs_out = matches!(transmitter.driver, Driver::Leased(_));
        if !runs_out || transmitter.settings.first_off_after.is_zero() {
            transmitter.silence(now);
        }
        transmitter
    }

    /// Everything aboard shares the autopilot's MAVLink system, which is known once the autopilot is found. Starts
    /// over, silent.
    pub fn adopt_system(&mut self, system: u8, now: Instant) {
        let settings = self.settings.clone();
        let (own, target) = ((system, settings.own.1), (system, settings.target.1));
        *self = Self::new(Settings { own, target, ..settings }, now);
    }

    /// Commands this power in watts, or renews it. From `expires_at` on the radio must be off; what expires within a
    /// millisecond is off, as is a power that is not above zero.
    pub fn radiate(&mut self, power_w: f64, slot: u16, expires_at: Instant, now: Instant) {
        if !(power_w.is_finite() && power_w > 0.0) || expires_at <= now {
            return self.silence(now);
        }
        match &mut self.driver {
            Driver::Leased(leased) => leased.radiate(power_w, slot, expires_at, now, &mut self.outbox),
            Driver::Parameter(parameter) => {
                parameter.radiate(power_w, slot, expires_at, now, &mut self.outbox)
            }
            Driver::None => {}
        }
    }

    /// Off, at once, and again until the radio confirms it.
    pub fn silence(&mut self, now: Instant) {
        match &mut self.driver {
            Driver::Leased(leased) => leased.silence(now, &mut self.outbox),
            Driver::Parameter(parameter) => parameter.silence(now, &mut self.outbox),
            Driver::None => {}
        }
    }

    /// Takes a message from the link; what is not the radio's is ignored.
    pub fn handle_message(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        if (header.system_id, header.component_id)
            != (u32::from(self.settings.target.0), self.settings.target.1)
        {
            return;
        }
        let silent_for = self.heard_at.replace(now).map_or(Duration::ZERO, |at| now.saturating_since(at));
        if silent_for > SILENCE_OF_LINK {
            match &mut self.driver {
                Driver::Leased(leased) => leased.link_is_back(now, &mut self.outbox),
                Driver::Parameter(parameter) => parameter.link_is_back(now, &mut self.outbox),
                Driver::None => {}
            }
        }
        match (&mut self.driver, message) {
            (Driver::Leased(leased), MavMessage::COMMAND_ACK(ack)) => {
                leased.handle_ack(ack, now, &mut self.outbox)
            }
            (Driver::Leased(_), MavMessage::PARAM_VALUE(value))
                if value.param_id.to_str() == Ok(LIMIT_PARAMETER) =>
            {
                self.limit.take(value.param_value);
            }
            (Driver::Parameter(parameter), _) => parameter.handle_message(message, now, &mut self.outbox),
            _ => {}
        }
    }

    /// Does what is due at `now`: repeats what is not confirmed, turns off what was not renewed.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.limit.advance(now, self.settings.target, &mut self.outbox);
        match &mut self.driver {
            Driver::Leased(leased) => leased.advance(now, &mut self.outbox),
            Driver::Parameter(parameter) => parameter.advance(now, &mut self.outbox),
            Driver::None => {}
        }
    }

    /// The next message to send, addressed; the caller stamps our own (system, component).
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.outbox.pop_front()
    }

    /// When [`Self::handle_timeout`] is next to be called, and for what.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<(Instant, &'static str)> {
        let driver = match &self.driver {
            Driver::Leased(leased) => leased.timeout(),
            Driver::Parameter(parameter) => parameter.timeout(),
            Driver::None => None,
        };
        [driver, self.limit.ask_at].into_iter().flatten().min().map(|at| (at, "transmitter"))
    }

    /// The power that the radio has acknowledged; `None` from the moment it is told to be silent. Compare its expiry
    /// with the present before relying on it.
    #[must_use]
    pub fn acknowledged(&self) -> Option<Lease> {
        match &self.driver {
            Driver::Leased(leased) => leased.lease(),
            Driver::Parameter(parameter) => parameter.lease(),
            Driver::None => None,
        }
    }

    /// Whether the radio is known to be off: it confirmed, or every command's expiry is past, late delivery included.
    /// A confirmation is taken at its word on a link that keeps the order of messages, as serial lines and the
    /// loopback do; where a command to radiate overtakes off, its answer gives it away and off is sent again.
    #[must_use]
    pub fn is_off(&self, now: Instant) -> bool {
        match &self.driver {
            Driver::Leased(leased) => leased.is_off(now),
            Driver::Parameter(parameter) => parameter.is_off(),
            Driver::None => true,
        }
    }

    /// Time from the last answered command to its answer.
    #[must_use]
    pub fn round_trip(&self) -> Option<Duration> {
        match &self.driver {
            Driver::Leased(leased) => leased.round_trip(),
            Driver::Parameter(parameter) => parameter.round_trip(),
            Driver::None => None,
        }
    }

    /// Whether the radio falls silent by itself (S5): known once it has answered a leased command.
    #[must_use]
    pub fn supports_expiry(&self) -> Option<bool> {
        match &self.driver {
            Driver::Leased(leased) => leased.supported(),
            Driver::Parameter(_) => Some(false),
            Driver::None => None,
        }
    }

    /// The radio's own largest power in watts, if it says.
    #[must_use]
    pub fn limit_w(&self) -> Option<f64> {
        match &self.driver {
            Driver::Leased(_) => self.limit.limit_w,
            Driver::Parameter(parameter) => parameter.limit_w(),
            Driver::None => None,
        }
    }

    /// What the radio last refused, until it accepts something.
    #[must_use]
    pub fn refusal(&self) -> Option<MavResult> {
        match &self.driver {
            Driver::Leased(leased) => leased.refusal(),
            Driver::Parameter(_) | Driver::None => None,
        }
    }

    /// What speaks for or against radiating.
    #[must_use]
    pub fn preflight(&self) -> Vec<Check> {
        let (system, component) = self.settings.target;
        match (&self.settings.kind, &self.driver) {
            (Kind::None, _) => {
                return vec![check("transmitter", Verdict::Warn, "none configured: nothing radiates")];
            }
            (Kind::Leased { command }, Driver::None) => {
                let detail = format!("command {command} is no MAV_CMD; use 31010 (MAV_CMD_USER_1) to 31014");
                return vec![check("transmitter", Verdict::Fail, detail)];
            }
            _ => {}
        }
        let expiry = match self.supports_expiry() {
            Some(true) => check("transmitter expiry", Verdict::Pass, "the radio falls silent by itself"),
            Some(false) if matches!(self.settings.kind, Kind::Parameter(_)) => check(
                "transmitter expiry",
                Verdict::Warn,
                "not supported by a power parameter: a dead companion leaves the radio on (S5)",
            ),
            Some(false) => check(
                "transmitter expiry",
                Verdict::Fail,
                "the radio does not know the leased power command: use kind = \"parameter\"",
            ),
            None => check("transmitter expiry", Verdict::Fail, "the radio has not answered yet"),
        };
        let heard = match self.heard_at {
            Some(_) => {
                check("transmitter", Verdict::Pass, format!("component {component} of system {system}"))
            }
            None => {
                let detail = format!(
                    "component {component} of system {system} was never heard on the autopilot's link"
                );
                check("transmitter", Verdict::Fail, detail)
            }
        };
        let limit = match self.limit_w() {
            Some(limit_w) => {
                check("transmitter limit", Verdict::Pass, crate::units::Watts(limit_w).to_string())
            }
            None => check(
                "transmitter limit",
                Verdict::Warn,
                "the radio does not say; the configured caps alone hold",
            ),
        };
        vec![heard, expiry, limit]
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

/// `value` in single precision, never rounded up (S6).
fn at_most(value: f64) -> f32 {
    let rounded = value as f32;
    if f64::from(rounded) > value { rounded.next_down() } else { rounded }
}

impl Limit {
    const ATTEMPTS: u8 = 5;
    const INTERVAL: Duration = Duration::from_secs(1);

    fn take(&mut self, dbm: f32) {
        if dbm.is_finite() {
            self.limit_w = Some(crate::units::Watts::from(crate::units::Dbm(dbm.into())).0);
            self.ask_at = None;
        }
    }

    fn advance(&mut self, now: Instant, target: (u8, u8), out: &mut std::collections::VecDeque<MavMessage>) {
        if self.ask_at.is_none_or(|at| now < at) {
            return;
        }
        out.push_back(parameter::read(LIMIT_PARAMETER, target));
        self.asked += 1;
        self.ask_at = (self.asked < Self::ATTEMPTS).then_some(now + Self::INTERVAL);
    }
}
