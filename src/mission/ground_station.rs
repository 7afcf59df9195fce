//! What a ground station sees of the companion beside STATUSTEXT and the answers to its commands: a truthful HEARTBEAT,
//! live figures, parameters of our own, and who we are.
//!
//! None of it may delay a setpoint: everything leaves in single messages, at most one a tick.

mod files;
mod information;
mod live;
mod parameters;

use std::collections::VecDeque;

use mavlink::dialects::ardupilotmega::{MavMessage, MavState};

use crate::autopilot;
use crate::time::Instant;

use super::executive::{Executive, Stopping};
use super::phase::Phase;
use crate::service::Tolerance;

pub use live::Scene;
pub use parameters::ParameterRefusal;

/// What is remembered of it.
#[derive(Debug)]
pub(super) struct GroundStation {
    /// Parameters still to be sent, by index.
    listing: VecDeque<usize>,
    /// Position tolerance in metres and attitude tolerance in radians before the jitter's share: the operator's.
    tolerance: [f64; 2],
    /// Live figures a second; 0: none.
    live_hz: f64,
    live_at: Instant,
    /// Which figure is next.
    live_next: usize,
}

impl GroundStation {
    pub fn new(now: Instant) -> Self {
        let widest = Tolerance::widest();
        Self { listing: VecDeque::new(), tolerance: widest, live_hz: 10.0, live_at: now, live_next: 0 }
    }

    /// How far a pose may be off in the slots to come.
    pub fn tolerance(&self, jitter_rad: f64) -> Tolerance {
        let [position_m, attitude_rad] = self.tolerance;
        Tolerance::of(position_m, attitude_rad, jitter_rad)
    }
}

impl Executive {
    /// At every tick: the next parameter of a list, or the next live figure.
    pub(super) fn show(&mut self, now: Instant) {
        if let Some(index) = self.ground_station.listing.pop_front() {
            self.outbox.extend(self.parameter_value(index));
        } else {
            self.show_live(now);
        }
    }

    pub(super) fn heartbeat(&self) -> MavMessage {
        let in_trouble = self.abort_cause.is_some() || self.service.interlock().is_killed();
        autopilot::heartbeat(match self.phase {
            _ if matches!(self.stopping, Stopping::Since(_)) => MavState::MAV_STATE_POWEROFF,
            _ if in_trouble => MavState::MAV_STATE_CRITICAL,
            Phase::Connecting => MavState::MAV_STATE_BOOT,
            Phase::Standby | Phase::Ended => MavState::MAV_STATE_STANDBY,
            _ => MavState::MAV_STATE_ACTIVE,
        })
    }
}
