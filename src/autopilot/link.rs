//! Whether the autopilot is still heard.

use std::time::Duration;

use super::event::Event;
use super::outbox::Outbox;
use crate::time::Instant;

/// Heartbeats come once a second. When five in a row are missing, the autopilot's mode counts as unknown. Five, because a
/// link that loses one message in ten may well lose three in a row during a flight, but hardly ever five.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_millis(5500);

/// When the autopilot was last heard.
#[derive(Debug, Clone)]
pub(super) struct LinkWatch {
    timeout: Duration,
    heard_at: Option<Instant>,
    heartbeat_at: Option<Instant>,
    streaming: bool,
    lost: bool,
}

impl LinkWatch {
    pub(super) fn new(timeout: Duration) -> Self {
        Self { timeout, heard_at: None, heartbeat_at: None, streaming: false, lost: false }
    }

    /// Takes note of a message of the autopilot. `true` if the link was lost and is back with it. Only a heartbeat brings it
    /// back, since only a heartbeat says which mode the autopilot is in.
    pub(super) fn heard(
        &mut self,
        is_heartbeat: bool,
        is_stream: bool,
        now: Instant,
        out: &mut Outbox,
    ) -> bool {
        self.heard_at = Some(now);
        self.streaming |= is_stream;
        if !is_heartbeat {
            return false;
        }
        self.heartbeat_at = Some(now);
        let restored = std::mem::take(&mut self.lost);
        if restored {
            self.streaming = false;
            out.tell(Event::LinkRestored);
        }
        restored
    }

    /// `true` if the link is lost just now.
    pub(super) fn advance(&mut self, now: Instant, out: &mut Outbox) -> bool {
        if self.lost || self.timeout().is_none_or(|at| now < at) {
            return false;
        }
        self.lost = true;
        let silent_for = self.silent_for(now);
        // Telemetry without heartbeats is a lost link too, and its age is the heartbeat's.
        out.tell(if silent_for < self.timeout {
            Event::LinkLost { missing: "no heartbeat", silent_for: since(self.heartbeat_at, now) }
        } else {
            Event::LinkLost { missing: "nothing", silent_for }
        });
        true
    }

    /// Since when the autopilot has said nothing.
    pub(super) fn silent_for(&self, now: Instant) -> Duration {
        since(self.heard_at, now)
    }

    pub(super) fn is_lost(&self) -> bool {
        self.lost
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        if self.lost {
            return None;
        }
        let silent = self.heard_at.filter(|_| self.streaming).map(|at| at + self.timeout);
        let headless = self.heartbeat_at.map(|at| at + HEARTBEAT_TIMEOUT);
        [silent, headless].into_iter().flatten().min()
    }
}

fn since(at: Option<Instant>, now: Instant) -> Duration {
    at.map_or(Duration::ZERO, |at| now.saturating_since(at))
}
