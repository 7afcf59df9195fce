//! What goes out unasked: HEARTBEAT, and at every tick one more of a list, or a piece of a file, or one live figure, or one
//! of where we stand.

use mavlink::dialects::ardupilotmega::{MavMessage, MavState};

use crate::autopilot;
use crate::mission::executive::Executive;
use crate::mission::phase::Phase;
use crate::time::Instant;

impl Executive {
    /// At every tick: the next parameter of a list, or of a file, or the next live figure, or the next of where we stand.
    pub(in crate::mission) fn show(&mut self, now: Instant) {
        if let Some(index) = self.ground_station.listing.pop_front() {
            self.outbox.extend(self.parameter_value(index));
            return;
        }
        if let Some(piece) = self.file_piece(now) {
            self.outbox.push_back(piece);
            return;
        }
        // By turns, so that neither takes every tick of a slow vehicle.
        let before = self.outbox.len();
        let live_first = self.ground_station.live_first;
        if live_first {
            self.show_live(now);
        } else {
            self.show_standing(now);
        }
        if self.outbox.len() != before {
            self.ground_station.live_first = !live_first;
        } else if live_first {
            self.show_standing(now);
        } else {
            self.show_live(now);
        }
    }

    pub(in crate::mission) fn heartbeat(&self) -> MavMessage {
        let in_trouble = self.abort_cause.is_some() || self.service.orders().is_killed();
        autopilot::heartbeat(match self.phase {
            _ if self.is_stopping() => MavState::MAV_STATE_POWEROFF,
            _ if in_trouble => MavState::MAV_STATE_CRITICAL,
            Phase::Connecting => MavState::MAV_STATE_BOOT,
            Phase::Standby | Phase::Ended => MavState::MAV_STATE_STANDBY,
            _ => MavState::MAV_STATE_ACTIVE,
        })
    }
}
