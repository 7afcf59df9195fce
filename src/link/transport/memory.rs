//! Datagrams inside the process, for tests and simulations.

use std::io;
use std::task::{Context, Poll, ready};

use tokio::sync::mpsc;

use super::{Arrival, Origin, Transport};
use crate::time::Instant;

/// Datagrams under way in one direction; more are lost, as on a network.
const CAPACITY: usize = 256;

/// One end of an in-memory link. Hand it to [`super::super::Link::in_memory`], or be the peer yourself.
#[derive(Debug)]
pub struct MemoryEnd {
    outgoing: mpsc::Sender<Vec<u8>>,
    incoming: mpsc::Receiver<Vec<u8>>,
}

impl MemoryEnd {
    /// Two ends, connected.
    #[must_use]
    pub fn pair() -> (Self, Self) {
        let (a_to_b, from_a) = mpsc::channel(CAPACITY);
        let (b_to_a, from_b) = mpsc::channel(CAPACITY);
        (Self { outgoing: a_to_b, incoming: from_b }, Self { outgoing: b_to_a, incoming: from_a })
    }

    /// Sends a datagram. Returns whether there was room for it and somebody to receive it.
    pub fn send(&self, datagram: Vec<u8>) -> bool {
        self.outgoing.try_send(datagram).is_ok()
    }

    /// The next datagram, or `None` when the other end is gone. Safe to cancel.
    pub async fn recv(&mut self) -> Option<Vec<u8>> {
        self.incoming.recv().await
    }
}

impl Transport for MemoryEnd {
    fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        _: Instant,
        buffer: &mut [u8],
    ) -> Poll<io::Result<Arrival>> {
        let Some(datagram) = ready!(self.incoming.poll_recv(cx)) else {
            // The other end is gone for good: silence, as on a network.
            return Poll::Pending;
        };
        let length = datagram.len().min(buffer.len());
        buffer[..length].copy_from_slice(&datagram[..length]);
        Poll::Ready(Ok(Arrival::Bytes { origin: Origin::Peer, length, ends: true }))
    }

    fn poll_write(&mut self, _: &mut Context<'_>, frame: &[u8]) -> Poll<io::Result<usize>> {
        self.send(frame.to_vec());
        Poll::Ready(Ok(frame.len()))
    }
}
