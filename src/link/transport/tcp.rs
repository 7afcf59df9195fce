//! TCP, as a client of a known address or as a server of one peer.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};

use super::{Arrival, Origin, PEER_TIMEOUT, Transport};
use crate::link::HostPort;
use crate::time::Instant;

/// A client that a cable was pulled from hears nothing and gets no error. After this long it connects anew.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(10);
/// Connections that may try at the same time to prove that they are the peer; the oldest gives way.
const CANDIDATES: usize = 8;
/// How long, and for how many bytes, a connection may try.
const CANDIDATE_TIME: Duration = Duration::from_secs(5);
const CANDIDATE_BYTES: usize = 16 * 1024;
/// How long accepting rests when the system has no room for a connection, rather than ask again at once.
const ACCEPT_PAUSE: Duration = Duration::from_secs(1);

/// Reads what is there. The connection's end is an error.
pub(super) fn poll_read_stream<S: AsyncRead + Unpin>(
    stream: &mut S,
    cx: &mut Context<'_>,
    buffer: &mut [u8],
) -> Poll<io::Result<usize>> {
    let mut buffer = ReadBuf::new(buffer);
    ready!(Pin::new(stream).poll_read(cx, &mut buffer))?;
    Poll::Ready(match buffer.filled().len() {
        0 => Err(io::ErrorKind::UnexpectedEof.into()),
        length => Ok(length),
    })
}

/// `tcpout:`.
pub struct TcpOut {
    stream: TcpStream,
    /// When something was last read; `None` before the first look.
    heard: Option<Instant>,
}

impl TcpOut {
    /// Resolves the host and connects.
    pub async fn connect(to: &HostPort) -> io::Result<Self> {
        let stream = TcpStream::connect((to.host.as_str(), to.port)).await?;
        stream.set_nodelay(true)?;
        Ok(Self { stream, heard: None })
    }
}

impl Transport for TcpOut {
    fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        now: Instant,
        buffer: &mut [u8],
    ) -> Poll<io::Result<Arrival>> {
        let Poll::Ready(read) = poll_read_stream(&mut self.stream, cx, buffer) else {
            let heard = *self.heard.get_or_insert(now);
            if now.saturating_since(heard) < SILENCE_TIMEOUT {
                return Poll::Pending;
            }
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        };
        self.heard = Some(now);
        Poll::Ready(Ok(Arrival::Bytes { origin: Origin::Peer, length: read?, ends: false }))
    }

    fn poll_write(&mut self, cx: &mut Context<'_>, frame: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, frame)
    }

    fn local_address(&self) -> Option<SocketAddr> {
        self.stream.local_addr().ok()
    }
}

/// `tcpin:`. Whoever connects is a candidate until a frame of the peer's comes over its connection; a peer in
/// good health is not disturbed by further connections.
pub struct TcpIn {
    listener: TcpListener,
    peer: Option<(TcpStream, Instant)>,
    candidates: Vec<Candidate>,
    next_id: u64,
    /// Before this, no connection is accepted.
    paused_until: Instant,
}

struct Candidate {
    id: u64,
    stream: TcpStream,
    since: Instant,
    bytes: usize,
}

impl TcpIn {
    /// Binds to the host's port and listens.
    pub async fn bind(at: &HostPort) -> io::Result<Self> {
        let listener = TcpListener::bind((at.host.as_str(), at.port)).await?;
        Ok(Self { listener, peer: None, candidates: Vec::new(), next_id: 0, paused_until: Instant::ZERO })
    }

    fn peer_is_alive(&self, now: Instant) -> bool {
        self.peer.as_ref().is_some_and(|(_, heard)| now.saturating_since(*heard) < PEER_TIMEOUT)
    }

    fn poll_accept(&mut self, cx: &mut Context<'_>, now: Instant) -> Poll<io::Result<Arrival>> {
        if now < self.paused_until {
            return Poll::Pending;
        }
        let (stream, _) = match ready!(self.listener.poll_accept(cx)) {
            Ok(connection) => connection,
            // Out of file descriptors, or a connection gone before it was accepted: not the listener's end.
            Err(error) => {
                tracing::warn!(%error, "tcpin: a connection could not be accepted");
                self.paused_until = now + ACCEPT_PAUSE;
                return Poll::Ready(Ok(Arrival::Headway));
            }
        };
        if self.peer_is_alive(now) || stream.set_nodelay(true).is_err() {
            return Poll::Ready(Ok(Arrival::Stranger { length: 0 }));
        }
        let evicted = (self.candidates.len() == CANDIDATES).then(|| self.candidates.remove(0));
        self.candidates.push(Candidate { id: self.next_id, stream, since: now, bytes: 0 });
        self.next_id += 1;
        Poll::Ready(Ok(evicted.map_or(Arrival::Headway, Candidate::gone)))
    }

    fn poll_candidates(&mut self, cx: &mut Context<'_>, now: Instant, buffer: &mut [u8]) -> Poll<Arrival> {
        let no_vacancy = self.peer_is_alive(now);
        for index in 0..self.candidates.len() {
            let candidate = &mut self.candidates[index];
            let spent = no_vacancy
                || candidate.bytes > CANDIDATE_BYTES
                || now.saturating_since(candidate.since) > CANDIDATE_TIME;
            if spent {
                return Poll::Ready(self.candidates.remove(index).gone());
            }
            match poll_read_stream(&mut candidate.stream, cx, buffer) {
                Poll::Pending => {}
                Poll::Ready(Err(_)) => return Poll::Ready(self.candidates.remove(index).gone()),
                Poll::Ready(Ok(length)) => {
                    candidate.bytes += length;
                    let origin = Origin::Connection(candidate.id);
                    return Poll::Ready(Arrival::Bytes { origin, length, ends: false });
                }
            }
        }
        Poll::Pending
    }
}

impl Candidate {
    /// Says that nothing more will come of it.
    fn gone(self) -> Arrival {
        Arrival::Bytes { origin: Origin::Connection(self.id), length: 0, ends: true }
    }
}

impl Transport for TcpIn {
    fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        now: Instant,
        buffer: &mut [u8],
    ) -> Poll<io::Result<Arrival>> {
        if let Some((stream, _)) = &mut self.peer {
            match poll_read_stream(stream, cx, buffer) {
                Poll::Pending => {}
                Poll::Ready(Ok(length)) => {
                    return Poll::Ready(Ok(Arrival::Bytes { origin: Origin::Peer, length, ends: false }));
                }
                Poll::Ready(Err(error)) => {
                    tracing::info!(%error, "tcpin: the peer's connection is gone");
                    self.peer = None;
                    return Poll::Ready(Ok(Arrival::Bytes { origin: Origin::Peer, length: 0, ends: true }));
                }
            }
        }
        if let Poll::Ready(accepted) = self.poll_accept(cx, now) {
            return Poll::Ready(accepted);
        }
        self.poll_candidates(cx, now, buffer).map(Ok)
    }

    fn poll_write(&mut self, cx: &mut Context<'_>, frame: &[u8]) -> Poll<io::Result<usize>> {
        let Some((stream, _)) = &mut self.peer else { return Poll::Ready(Ok(frame.len())) };
        let written = ready!(Pin::new(stream).poll_write(cx, frame));
        if written.is_err() {
            self.peer = None;
            return Poll::Ready(Ok(frame.len()));
        }
        Poll::Ready(written)
    }

    fn has_peer(&self) -> bool {
        self.peer.is_some()
    }

    fn send_to(&mut self, origin: Origin, frame: &[u8]) -> bool {
        let candidate = self.candidates.iter().find(|candidate| origin == Origin::Connection(candidate.id));
        // Nothing else was ever written there, so that a frame has room, or the peer does not read.
        candidate.is_some_and(|c| c.stream.try_write(frame).is_ok_and(|written| written == frame.len()))
    }

    fn peer_address(&self) -> Option<SocketAddr> {
        self.peer.as_ref().and_then(|(stream, _)| stream.peer_addr().ok())
    }

    fn peer_heard(&mut self, origin: Origin, now: Instant) -> bool {
        match origin {
            Origin::Peer => {
                if let Some((_, heard)) = &mut self.peer {
                    *heard = now;
                }
                false
            }
            Origin::Address(_) => false,
            Origin::Connection(id) => {
                let Some(index) = self.candidates.iter().position(|candidate| candidate.id == id) else {
                    return false;
                };
                self.peer = Some((self.candidates.remove(index).stream, now));
                // The others had their chance.
                self.candidates.clear();
                true
            }
        }
    }

    fn local_address(&self) -> Option<SocketAddr> {
        self.listener.local_addr().ok()
    }
}
