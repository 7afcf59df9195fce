//! The link between the two companions: a [`Link`] that knows both forms of a pair message and takes one of them.

use mavlink::MavHeader;

use super::clock::Clock;
use super::counters::{Counters, Rejection};
use super::endpoint::{Link, LinkConfig};
use super::envelope::{Envelope, Form};
use super::{LinkError, MemoryEnd};
use crate::link::LinkAddress;
use crate::pair::wire::MavMessage;

/// A pair message and who sent it.
#[derive(Debug, Clone, PartialEq)]
pub struct PairFrame {
    /// Of the outer frame, which is the one that is signed.
    pub header: MavHeader,
    /// What it says.
    pub message: MavMessage,
}

/// One end of the pair link.
pub struct PairLink {
    link: Link<Envelope>,
    form: Form,
    sequence: u8,
}

impl PairLink {
    /// Opens a pair link whose messages go out, and are accepted, in `form` alone.
    ///
    /// # Errors
    /// As [`Link::open`].
    pub async fn open(
        address: LinkAddress,
        config: LinkConfig,
        form: Form,
        clock: Clock,
    ) -> Result<Self, LinkError> {
        Ok(Self::of(Link::open(address, config, clock).await?, form))
    }

    /// A pair link inside the process.
    ///
    /// # Errors
    /// As [`Link::in_memory`].
    pub fn in_memory(
        end: MemoryEnd,
        config: LinkConfig,
        form: Form,
        clock: Clock,
    ) -> Result<Self, LinkError> {
        Ok(Self::of(Link::in_memory(end, config, clock)?, form))
    }

    fn of(mut link: Link<Envelope>, form: Form) -> Self {
        link.admit_only(match form {
            Form::Plain => |envelope| only(!envelope.is_tunnelled()),
            Form::Tunnel { .. } => |envelope| only(envelope.is_tunnelled()),
        });
        Self { link, form, sequence: 0 }
    }

    /// The peer's next message; as [`Link::recv`], to be called all the time and safe to cancel.
    pub async fn recv(&mut self) -> PairFrame {
        let frame = self.link.recv().await;
        let message = match frame.message {
            Envelope::Plain(message) | Envelope::Tunnel { message, .. } => message,
        };
        PairFrame { header: frame.header, message }
    }

    /// Sends `message` from `(system, component)`; as [`Link::send`].
    pub fn send(&mut self, from: (u8, u8), message: &MavMessage) {
        let envelope = Envelope::new(self.form, from, self.sequence, message.clone());
        self.sequence = self.sequence.wrapping_add(1);
        self.link.send(from, &envelope);
    }

    /// See [`Link::counters`].
    #[must_use]
    pub fn counters(&self) -> &Counters {
        self.link.counters()
    }

    /// See [`Link::is_connected`].
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.link.is_connected()
    }

    /// See [`Link::local_address`].
    #[must_use]
    pub fn local_address(&self) -> Option<std::net::SocketAddr> {
        self.link.local_address()
    }
}

fn only(expected: bool) -> Result<(), Rejection> {
    if expected { Ok(()) } else { Err(Rejection::OtherForm) }
}
