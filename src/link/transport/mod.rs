//! Ways to carry bytes. A transport knows addresses and connections; whether a frame is the peer's, and so
//! where the peer is, is for [`super::Link`] to judge.

mod memory;
mod path;
#[cfg(feature = "serial")]
mod serial;
mod tcp;
mod udp;

use std::io;
use std::net::SocketAddr;
use std::task::{Context, Poll};
use std::time::Duration;

pub use memory::MemoryEnd;
pub use path::LearntPath;

use super::clock::Clock;
use crate::link::LinkAddress;
use crate::time::Instant;

/// A peer silent for longer gives way to whoever proves to be the peer at another address (by signature and challenge
/// where there is a key): an autopilot that was restarted comes back from another port. Three HEARTBEATs.
const PEER_TIMEOUT: Duration = Duration::from_secs(3);
/// A connection attempt that takes longer is given up.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// Where bytes came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Origin {
    /// The peer's address.
    Peer,
    /// A connection of somebody who may yet prove to be the peer.
    Connection(u64),
    /// An address of the same.
    Address(SocketAddr),
}

/// What a transport has read.
#[derive(Debug)]
pub(super) enum Arrival {
    /// So many bytes from `origin`. With `ends`, nothing that follows completes them: a datagram's end, or a
    /// connection's.
    Bytes { origin: Origin, length: usize, ends: bool },
    /// Something other than bytes, such as a connection: read again.
    Headway,
    /// So many bytes from an address that is not the peer's while the peer is alive, or a connection refused.
    Stranger { length: usize },
}

/// A way to the peer. Polled, so that nothing is lost when a caller gives up waiting.
pub(super) trait Transport: Send {
    /// Reads into `buffer`. An error ends the transport, except [`io::ErrorKind::ConnectionRefused`].
    fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        now: Instant,
        buffer: &mut [u8],
    ) -> Poll<io::Result<Arrival>>;

    /// Writes a frame, or a part of one where bytes are a stream. Errors as with [`Self::poll_read`].
    fn poll_write(&mut self, cx: &mut Context<'_>, frame: &[u8]) -> Poll<io::Result<usize>>;

    /// Whether there is a peer to write to.
    fn has_peer(&self) -> bool {
        true
    }

    /// Sends a frame to somebody who may yet prove to be the peer, at once or not at all. Whether it went out.
    fn send_to(&mut self, _origin: Origin, _frame: &[u8]) -> bool {
        false
    }

    /// A frame from `origin` was the peer's. Returns whether this makes a candidate the peer.
    fn peer_heard(&mut self, _origin: Origin, _now: Instant) -> bool {
        false
    }

    /// Where the peer is, if it was learnt.
    fn peer_address(&self) -> Option<SocketAddr> {
        None
    }

    /// The local end, if it has an address.
    fn local_address(&self) -> Option<SocketAddr> {
        None
    }
}

/// Opens the transport for `address`, once.
pub(super) async fn open(address: LinkAddress, clock: Clock) -> io::Result<Box<dyn Transport>> {
    Ok(match address {
        LinkAddress::UdpIn(at) => Box::new(udp::UdpIn::bind(&at).await?),
        LinkAddress::UdpOut(to) => Box::new(udp::UdpOut::connect(&to).await?),
        LinkAddress::TcpIn(at) => Box::new(tcp::TcpIn::bind(&at).await?),
        LinkAddress::TcpOut(to) => {
            let deadline = clock.now() + CONNECT_TIMEOUT;
            tokio::select! {
                connected = tcp::TcpOut::connect(&to) => Box::new(connected?),
                () = clock.sleep_until(deadline) => return Err(io::ErrorKind::TimedOut.into()),
            }
        }
        #[cfg(feature = "serial")]
        LinkAddress::Serial { path, baud } => Box::new(serial::Serial::open(&path, baud)?),
        #[cfg(not(feature = "serial"))]
        LinkAddress::Serial { .. } => {
            return Err(io::Error::new(
                io::ErrorKind::Unsupported,
                "this program was built without serial ports: build it with the feature `serial`",
            ));
        }
    })
}
