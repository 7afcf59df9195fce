//! A socket of the simulation, through which a companion reaches its vehicle or its peer, so that faults can come
//! between.

use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

use veilwing_sitl::Passage;

use crate::desk::simulation::{Path, Pipe};

/// Loopback itself: nothing lost, and no delay beside the operating system's.
pub(super) const DIRECT: Path = Path { delay: Duration::ZERO, ..Path::GOOD };

/// One socket of ours and the companion that was heard on it.
pub(super) struct Port {
    /// The operating system is asked each time: what was sent before is heard now, whatever the event loop knows of it.
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    from_companion: Pipe,
    to_companion: Pipe,
    /// Datagrams of the companion.
    pub sent: u64,
    /// Datagrams to the companion.
    pub received: u64,
    /// Datagrams of either that a fault swallowed.
    pub swallowed: u64,
}

impl Port {
    /// `stream` tells apart the ports of one seed.
    pub fn bind(seed: u64, stream: u64) -> Result<Self, String> {
        let failed = |error: std::io::Error| format!("loopback UDP: {error}");
        let socket = UdpSocket::bind(("127.0.0.1", 0)).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(Self {
            socket,
            peer: None,
            from_companion: Pipe::new(DIRECT, seed, 2 * stream),
            to_companion: Pipe::new(DIRECT, seed, 2 * stream + 1),
            sent: 0,
            received: 0,
            swallowed: 0,
        })
    }

    pub fn number(&self) -> Result<u16, String> {
        self.socket
            .local_addr()
            .map(|address| address.port())
            .map_err(|error| format!("loopback UDP: {error}"))
    }

    /// Changes what happens to what the companion sends from now on.
    pub fn set_path_from(&mut self, path: Path) {
        self.from_companion.path = path;
    }

    /// Changes what happens to what the companion is sent from now on.
    pub fn set_path_to(&mut self, path: Path) {
        self.to_companion.path = path;
    }

    /// How what the companion sends fares.
    pub fn passage(&self) -> Passage {
        self.from_companion.path.passage()
    }

    /// For how long at most what the companion sends is held up here.
    pub fn longest_way(&self) -> Duration {
        self.from_companion.path.longest_way()
    }

    /// Takes in what the companion has sent.
    pub fn listen(&mut self, now: Duration) {
        let mut buffer = [0; 2048];
        while let Ok((length, from)) = self.socket.recv_from(&mut buffer) {
            self.peer = Some(from);
            self.sent += 1;
            self.swallowed += self.from_companion.send(&buffer[..length], now);
        }
    }

    /// The next datagram of the companion that has come through.
    pub fn receive(&mut self, now: Duration) -> Option<Vec<u8>> {
        self.from_companion.receive(now)
    }

    /// Sends a datagram to the companion.
    pub fn send(&mut self, bytes: &[u8], now: Duration) {
        self.received += 1;
        self.swallowed += self.to_companion.send(bytes, now);
    }

    /// Hands over what has come through to the companion.
    pub fn deliver(&mut self, now: Duration) {
        while let Some(bytes) = self.to_companion.receive(now) {
            if let Some(peer) = self.peer {
                // A full buffer or a companion that is gone: lost, as on any radio link.
                let _ = self.socket.send_to(&bytes, peer);
            }
        }
    }
}
