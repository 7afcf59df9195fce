//! What the two ends of a signed link say to each other about the link itself: a challenge, a number that was never used
//! before, and its answer, which only who has the key and hears the challenge can give.
//!
//! Between companions these are messages of the pair's dialect, in the form that the link has. To anybody else it is a
//! TIMESYNC request, which every autopilot answers with the request's own time in it: here, the number.

use mavlink::dialects::ardupilotmega::{MavMessage as Common, TIMESYNC_DATA};
use mavlink::{MavHeader, Message};

use super::aboard::Aboard;
use super::envelope::Enclosed;
use crate::pair::wire::{MavMessage as Pair, VEILWING_CHALLENGE_DATA, VEILWING_RESPONSE_DATA};
use crate::time::Utc;

/// What a message says of the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Said {
    /// It wants this number back.
    Challenge {
        /// The number.
        nonce: u64,
        /// The sender's clock.
        clock: Utc,
    },
    /// It gives this number back.
    Answer {
        /// The number.
        nonce: u64,
        /// The sender's clock, if it says it.
        clock: Option<Utc>,
        /// It has no other meaning, also where nobody has asked.
        nothing_else: bool,
    },
}

/// A dialect in which a link can be spoken of.
pub trait Dialogue: Message + Sized {
    /// The challenge to whoever sent this message: `from` (system, component), to that system.
    #[must_use]
    fn challenge(&self, from: (u8, u8), to: u8, nonce: u64, clock: Utc) -> Self;

    /// The answer to this challenge; `None` where others do that.
    #[must_use]
    fn answer(&self, from: (u8, u8), to: u8, nonce: u64, clock: Utc) -> Option<Self>;

    /// What it says of the link, if anything.
    #[must_use]
    fn said(&self) -> Option<Said>;
}

impl Dialogue for Pair {
    fn challenge(&self, _: (u8, u8), _: u8, nonce: u64, clock: Utc) -> Self {
        Self::VEILWING_CHALLENGE(VEILWING_CHALLENGE_DATA { nonce, utc_us: clock.unix_us })
    }

    fn answer(&self, _: (u8, u8), _: u8, nonce: u64, clock: Utc) -> Option<Self> {
        Some(Self::VEILWING_RESPONSE(VEILWING_RESPONSE_DATA { nonce, utc_us: clock.unix_us }))
    }

    fn said(&self) -> Option<Said> {
        match self {
            Self::VEILWING_CHALLENGE(m) => {
                Some(Said::Challenge { nonce: m.nonce, clock: Utc { unix_us: m.utc_us } })
            }
            Self::VEILWING_RESPONSE(m) => Some(Said::Answer {
                nonce: m.nonce,
                clock: Some(Utc { unix_us: m.utc_us }),
                nothing_else: true,
            }),
            _ => None,
        }
    }
}

impl<M: Dialogue> Enclosed<M>
where
    Self: Message,
{
    /// In the same form as this message.
    fn in_kind(&self, from: (u8, u8), to: u8, message: M) -> Self {
        match self {
            Self::Plain(_) => Self::Plain(message),
            Self::Tunnel { .. } => {
                let header = MavHeader { system_id: from.0.into(), component_id: from.1, sequence: 0 };
                Self::Tunnel { to: (to, 0), header, message }
            }
        }
    }
}

impl Dialogue for Enclosed<Pair> {
    fn challenge(&self, from: (u8, u8), to: u8, nonce: u64, clock: Utc) -> Self {
        self.in_kind(from, to, self.message().challenge(from, to, nonce, clock))
    }

    fn answer(&self, from: (u8, u8), to: u8, nonce: u64, clock: Utc) -> Option<Self> {
        Some(self.in_kind(from, to, self.message().answer(from, to, nonce, clock)?))
    }

    fn said(&self) -> Option<Said> {
        self.message().said()
    }
}

/// A number that TIMESYNC can carry, whose times are signed.
fn as_time(nonce: u64) -> i64 {
    i64::try_from(nonce).unwrap_or(i64::MAX)
}

impl Dialogue for Common {
    fn challenge(&self, _: (u8, u8), _: u8, nonce: u64, _: Utc) -> Self {
        Self::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: as_time(nonce), target_system: 0, target_component: 0 })
    }

    fn answer(&self, _: (u8, u8), _: u8, _: u64, _: Utc) -> Option<Self> {
        None
    }

    fn said(&self) -> Option<Said> {
        match self {
            Self::TIMESYNC(m) if m.tc1 != 0 => {
                let nonce = u64::try_from(m.ts1).ok()?;
                Some(Said::Answer { nonce, clock: None, nothing_else: false })
            }
            _ => None,
        }
    }
}

impl Dialogue for Aboard {
    fn challenge(&self, from: (u8, u8), to: u8, nonce: u64, clock: Utc) -> Self {
        // Whatever was heard: the radio's own dialect has no word for it.
        Self::Common(Common::HEARTBEAT(Default::default()).challenge(from, to, nonce, clock))
    }

    fn answer(&self, _: (u8, u8), _: u8, _: u64, _: Utc) -> Option<Self> {
        None
    }

    fn said(&self) -> Option<Said> {
        match self {
            Self::Common(message) => message.said(),
            Self::Radio(_) => None,
        }
    }
}
