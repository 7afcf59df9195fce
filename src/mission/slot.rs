//! A committed slot: transit, on station; `course` has what concerns power.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;

use crate::pair::Commitment;
use crate::schedule::transit::Separation;
use crate::time::Instant;

use super::course::Course;
use super::executive::{Executive, Motion};
use super::flight::Phase;
use super::pose_monitor::PoseMonitor;
use super::turns::Turns;

/// A position of the other that is older says nothing of where it rests.
const HEARD_OF_LATE: Duration = Duration::from_millis(500);

/// A committed slot.
#[derive(Debug, Clone)]
pub(super) struct SlotRun {
    pub course: Course,
    pub monitor: PoseMonitor,
    pub user: String,
    /// The switching on has been said.
    pub announced: bool,
    /// On a transit in turns.
    pub turns: Option<Turns>,
}

impl Executive {
    /// Both sides have agreed: the transit begins at the table's time before the opening.
    pub(super) fn begin_slot(&mut self, commitment: Commitment, now: Instant) {
        let role = self.settings.role;
        let Some((entry, plan)) = self.entry(commitment.slot).zip(self.plan.as_ref()) else { return };
        let Some(planned) = plan.slots.get(entry.user_index) else { return };
        let vehicle = planned.plan.vehicles[role];
        let after_opening = |t: Duration| commitment.opens_at + t.saturating_sub(entry.opens);
        let motion = Motion {
            trajectory: entry.transit[role].clone(),
            starts_at: commitment.opens_at - entry.opens.saturating_sub(entry.transit_starts),
        };
        let slot = SlotRun {
            course: Course {
                commitment,
                power_w: vehicle.tx_power_w,
                radiate_from: after_opening(entry.radiate_from),
                radiate_until: after_opening(entry.radiate_until),
                closes_at: after_opening(entry.closes),
                closing: false,
            },
            monitor: PoseMonitor::new(vehicle.pose, self.face.tolerance(self.settings.jitter_rad)),
            user: planned.user.clone(),
            announced: false,
            turns: (entry.separation == Separation::Time)
                .then(|| Turns::new(entry.transit[role.peer()].clone())),
        };
        let opens_in = commitment.opens_at.saturating_since(now).as_secs_f64();
        let text = format!("slot {} for {}: agreed, opens in {opens_in:.1} s", commitment.slot, slot.user);
        self.motion = Some(motion);
        self.slot = Some(slot);
        self.enter(Phase::Slot, now);
        self.notice(MavSeverity::MAV_SEVERITY_INFO, text);
    }

    /// On a transit in turns: waits for the other, and gives up once that costs the slot's opening.
    pub(super) fn keep_turns(&mut self, now: Instant) {
        let peer = self.pair.peer();
        let peer_at = peer.position_enu_m.filter(|_| peer.heard_within(HEARD_OF_LATE, now));
        let Some((slot, motion)) = self.slot.as_mut().zip(self.motion.as_mut()) else { return };
        let Some(turns) = slot.turns.as_mut() else { return };
        motion.starts_at = turns.started(&motion.trajectory, motion.starts_at, peer_at, now);
        if motion.ends_at() > slot.course.commitment.opens_at {
            let peer = self.settings.role.peer();
            self.abort(format!("vehicle {peer} is not where it should be for its turn to pass"), now);
        }
    }

    /// Whether the slot's time is over, or it was ended early and all is quiet: silent, and the transit flown to its
    /// end, where the next one begins.
    pub(super) fn slot_over(&self, now: Instant) -> bool {
        let quiet = self.interlock.is_off(now) && self.has_arrived(now);
        self.slot.as_ref().is_none_or(|slot| now >= slot.course.closes_at || slot.course.closing && quiet)
    }

    fn has_arrived(&self, now: Instant) -> bool {
        self.motion.as_ref().is_some_and(|motion| now >= motion.ends_at())
    }

    /// Feeds the pose monitor with the newest state.
    pub(super) fn watch_pose(&mut self) {
        let state = self.autopilot.state();
        if let Some(slot) = self.slot.as_mut() {
            if let Some(position) = state.position_enu_m {
                slot.monitor.position(position.value);
            }
            if let Some(attitude) = state.attitude {
                slot.monitor.attitude(&attitude.value, attitude.received_at);
            }
        }
    }

    /// Whether own pose is the slot's, and meant to be.
    pub(super) fn pose_ok(&self, now: Instant) -> bool {
        self.has_arrived(now) && self.slot.as_ref().is_some_and(|slot| slot.monitor.check().is_ok())
    }
}
