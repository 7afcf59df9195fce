//! What a ground station sees of the companion beside STATUSTEXT and the answers to its commands: a truthful HEARTBEAT,
//! live figures, where we stand, parameters of our own and what they mean, and who we are.
//!
//! None of it may delay a setpoint: everything leaves in single messages, at most one a tick.

mod files;
mod information;
mod live;
mod metadata;
mod parameters;
mod showing;
mod standing;

use std::collections::VecDeque;

use crate::time::Instant;

use crate::service::Tolerance;

pub use standing::{Figure, Vector, silence_words};

use files::FileServer;
use parameters::LIVE_HZ;
use standing::Saying;

/// What is remembered of it.
#[derive(Debug, Clone)]
pub(super) struct GroundStation {
    /// Parameters still to be sent, by index.
    listing: VecDeque<usize>,
    files: FileServer,
    /// Position tolerance in metres and attitude tolerance in radians before the jitter's share: the operator's.
    tolerance: [f64; 2],
    /// Live figures a second; 0: none.
    live_hz: f64,
    live_at: Instant,
    /// Which figure is next.
    live_next: usize,
    saying: Saying,
    /// Which of the two goes first.
    live_first: bool,
}

impl GroundStation {
    pub fn new(now: Instant) -> Self {
        let widest = Tolerance::widest();
        Self {
            listing: VecDeque::new(),
            files: FileServer::new(now),
            tolerance: widest,
            live_hz: LIVE_HZ,
            live_at: now,
            live_next: 0,
            saying: Saying::new(now),
            live_first: true,
        }
    }

    /// How far a pose may be off in the slots to come.
    pub fn tolerance(&self, jitter_rad: f64) -> Tolerance {
        let [position_m, attitude_rad] = self.tolerance;
        Tolerance::of(position_m, attitude_rad, jitter_rad)
    }
}
