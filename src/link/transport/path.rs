//! Where a peer is whose address is learnt from its datagrams.

use std::net::SocketAddr;

use super::{Origin, PEER_TIMEOUT};
use crate::time::Instant;

/// The way to a peer that is to be found: the first address that it proves to be at, until it has been silent there for
/// three seconds and proves to be elsewhere.
#[derive(Debug, Clone, Copy, Default)]
pub struct LearntPath(Option<(SocketAddr, Instant)>);

impl LearntPath {
    /// Where the peer is.
    #[must_use]
    pub fn peer(&self) -> Option<SocketAddr> {
        self.0.map(|(peer, _)| peer)
    }

    /// What a datagram from there is; `None`: a stranger's, while the peer is alive.
    #[must_use]
    pub fn origin(&self, from: SocketAddr, now: Instant) -> Option<Origin> {
        match self.0 {
            Some((peer, _)) if peer == from => Some(Origin::Peer),
            Some((_, heard)) if now.saturating_since(heard) < PEER_TIMEOUT => None,
            _ => Some(Origin::Address(from)),
        }
    }

    /// The peer was heard from there. Whether it was not there before.
    pub fn heard(&mut self, origin: Origin, now: Instant) -> bool {
        match origin {
            Origin::Peer => {
                if let Some((_, heard)) = &mut self.0 {
                    *heard = now;
                }
                false
            }
            Origin::Address(address) => {
                self.0 = Some((address, now));
                true
            }
            Origin::Connection(_) => false,
        }
    }
}
