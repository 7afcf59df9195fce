//! What any station may ask, in any mode.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;

use super::super::router::{Router, Sender, To};
use super::{Autopilot, COMPONENT};

impl Autopilot {
    pub(super) fn answer(&self, from: Sender, question: MavMessage, now: Duration, router: &mut Router) {
        match question {
            MavMessage::TIMESYNC(m) if m.tc1 == 0 => {
                let reply = TIMESYNC_DATA {
                    tc1: self.uptime(now).as_nanos() as i64,
                    ts1: m.ts1,
                    target_system: from.system_id,
                    target_component: from.component_id,
                };
                router.send(To::Link(from.link), COMPONENT, &MavMessage::TIMESYNC(reply));
            }
            MavMessage::PING(m) if m.target_system == 0 => {
                let reply =
                    PING_DATA { target_system: from.system_id, target_component: from.component_id, ..m };
                router.send(To::Link(from.link), COMPONENT, &MavMessage::PING(reply));
            }
            _ => {}
        }
    }
}
