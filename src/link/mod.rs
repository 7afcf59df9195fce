//! MAVLink over UDP, TCP, serial lines and memory: pinned to one peer, reconnecting, signed, counted, logged.
//!
//! The mavlink crate gives the messages, the frame layouts, checksums and signature arithmetic. Its
//! connections are not used: they answer whoever sent the last datagram, accept replays after a restart, lose
//! a HEARTBEAT with an enum value of tomorrow, share one sequence among components, and never reconnect.

mod aboard;
mod address;
pub mod clock;
pub mod codec;
pub mod counters;
pub mod dialogue;
mod endpoint;
pub mod envelope;
pub mod frame;
pub mod gate;
mod outbox;
pub mod pair;
pub mod signing;
pub mod tlog;
mod transport;

use std::io;

pub use aboard::Aboard;
pub use address::{AddressError, HostPort, LinkAddress};
pub use clock::Clock;
pub use counters::{Counters, Rejection};
pub use endpoint::{Link, LinkConfig};
pub use envelope::{Envelope, Form};
pub use frame::{Frame, RawFrame};
pub use pair::PairLink;
pub use signing::{Key, SigningConfig};
pub use tlog::{TlogReader, TlogWriter};
pub use transport::{LearntPath, MemoryEnd, Origin};

/// Why a link cannot be opened, now or ever. What may heal by itself (a peer not up yet, a device not plugged
/// in, a name that does not resolve) is no error but retried.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The local address cannot be bound.
    #[error(
        "link {name}: cannot listen on {address}: {source}; another program may use the port, or the address may not be this machine's"
    )]
    Bind {
        /// The link's name.
        name: String,
        /// The address.
        address: LinkAddress,
        /// What the operating system said.
        source: io::Error,
    },
    /// Signing cannot be set up.
    #[error("link {name}: {source}")]
    Signing {
        /// The link's name.
        name: String,
        /// Why.
        source: signing::SigningError,
    },
}
