//! UDP, as a client of a known address or as a server that learns its one peer's.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::task::{Context, Poll, ready};

use tokio::io::ReadBuf;
use tokio::net::{UdpSocket, lookup_host};

use super::path::LearntPath;
use super::{Arrival, Origin, Transport};
use crate::link::HostPort;
use crate::time::Instant;

/// `udpout:`: a socket connected to its peer, so that the kernel turns away everybody else.
pub struct UdpOut {
    socket: UdpSocket,
}

impl UdpOut {
    /// Resolves the host and connects to its first address that can be reached at all.
    pub async fn connect(to: &HostPort) -> io::Result<Self> {
        let mut last = io::Error::from(io::ErrorKind::AddrNotAvailable);
        for address in lookup_host((to.host.as_str(), to.port)).await? {
            let any: SocketAddr = match address {
                SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
                SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
            };
            let socket = UdpSocket::bind(any).await?;
            match socket.connect(address).await {
                Ok(()) => return Ok(Self { socket }),
                Err(error) => last = error,
            }
        }
        Err(last)
    }
}

impl Transport for UdpOut {
    fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        _: Instant,
        buffer: &mut [u8],
    ) -> Poll<io::Result<Arrival>> {
        let mut buffer = ReadBuf::new(buffer);
        ready!(self.socket.poll_recv(cx, &mut buffer))?;
        let length = buffer.filled().len();
        Poll::Ready(Ok(Arrival::Bytes { origin: Origin::Peer, length, ends: true }))
    }

    fn poll_write(&mut self, cx: &mut Context<'_>, frame: &[u8]) -> Poll<io::Result<usize>> {
        match ready!(self.socket.poll_send(cx, frame)) {
            // The refusal of an earlier datagram, reported now; this one has not been tried.
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
                self.socket.poll_send(cx, frame)
            }
            result => Poll::Ready(result),
        }
    }

    fn local_address(&self) -> Option<SocketAddr> {
        self.socket.local_addr().ok()
    }
}

/// `udpin:`: a bound socket whose peer is whoever proves to be it.
pub struct UdpIn {
    socket: UdpSocket,
    path: LearntPath,
}

impl UdpIn {
    /// Binds to the host's port.
    pub async fn bind(at: &HostPort) -> io::Result<Self> {
        Ok(Self { socket: UdpSocket::bind((at.host.as_str(), at.port)).await?, path: LearntPath::default() })
    }
}

impl Transport for UdpIn {
    fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        now: Instant,
        buffer: &mut [u8],
    ) -> Poll<io::Result<Arrival>> {
        let mut buffer = ReadBuf::new(buffer);
        let from = ready!(self.socket.poll_recv_from(cx, &mut buffer))?;
        let length = buffer.filled().len();
        Poll::Ready(Ok(match self.path.origin(from, now) {
            Some(origin) => Arrival::Bytes { origin, length, ends: true },
            None => Arrival::Stranger { length },
        }))
    }

    fn poll_write(&mut self, cx: &mut Context<'_>, frame: &[u8]) -> Poll<io::Result<usize>> {
        let Some(peer) = self.path.peer() else { return Poll::Ready(Ok(frame.len())) };
        // Unreachable today may be reachable tomorrow, and rebinding would forget who the peer is.
        let written = ready!(self.socket.poll_send_to(cx, frame, peer));
        Poll::Ready(written.map_err(|error| io::Error::new(io::ErrorKind::ConnectionRefused, error)))
    }

    fn has_peer(&self) -> bool {
        self.path.peer().is_some()
    }

    fn send_to(&mut self, origin: Origin, frame: &[u8]) -> bool {
        let Origin::Address(to) = origin else { return false };
        self.socket.try_send_to(frame, to).is_ok_and(|sent| sent == frame.len())
    }

    fn peer_address(&self) -> Option<SocketAddr> {
        self.path.peer()
    }

    fn peer_heard(&mut self, origin: Origin, now: Instant) -> bool {
        self.path.heard(origin, now)
    }

    fn local_address(&self) -> Option<SocketAddr> {
        self.socket.local_addr().ok()
    }
}
