//! The phases: what is done in each and when it ends; what a fault leads to.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;

use crate::geo::{Attitude, Enu};
use crate::pair::Readiness;
use crate::pair::wire::VeilwingFlags;
use crate::role::Role;
use crate::schedule::trajectory::{Start, Trajectory};
use crate::time::{Instant, Utc};

use super::executive::{Executive, Motion, Outcome};
use super::homing::HOLD;

/// How close to the end of a climb or a return counts as arrived, in metres.
const ARRIVED_M: f64 = 1.0;
/// After a climb or a return should have ended, how long the vehicle may still take.
const LATE: Duration = Duration::from_secs(30);
/// A slot is proposed no earlier before the time that the agreement takes.
const EARLY: Duration = Duration::from_secs(2);

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Phase {
    /// No autopilot, or no position yet.
    Connecting,
    /// On the ground; something is missing before take-off.
    Standby,
    /// Asking for the companion's mode.
    TakingControl,
    /// Asking to arm.
    Arming,
    /// To the lowest altitude of the band, above home.
    Climbing,
    /// In the air between slots; `since` the first refusal of the present proposal, if any.
    Ready { refused_since: Option<Instant>, propose_at: Instant },
    /// In a committed slot, transit included.
    Slot,
    /// After a fault: hold until then.
    Holding { until: Instant },
    /// To above home.
    Returning,
    /// The autopilot lands.
    Landing,
    /// Control is the pilot's or the autopilot's own; watching.
    Surrendered,
    /// On the ground, over.
    Ended,
}

impl Phase {
    pub fn name(&self) -> &'static str {
        match self {
            Self::Connecting => "connecting",
            Self::Standby => "standby",
            Self::TakingControl => "taking control",
            Self::Arming => "arming",
            Self::Climbing => "climbing",
            Self::Ready { .. } => "ready",
            Self::Slot => "slot",
            Self::Holding { .. } => "holding",
            Self::Returning => "returning",
            Self::Landing => "landing",
            Self::Surrendered => "surrendered",
            Self::Ended => "ended",
        }
    }

    /// In the air on the mission: able to take part in a slot.
    pub fn is_flying(&self) -> bool {
        matches!(self, Self::Ready { .. } | Self::Slot)
    }

    /// Going home under our control, or about to.
    pub fn is_returning(&self) -> bool {
        matches!(self, Self::Holding { .. } | Self::Returning | Self::Landing)
    }

    /// The mission is over for this vehicle, well or badly.
    pub fn is_ending(&self) -> bool {
        matches!(
            self,
            Self::Holding { .. } | Self::Returning | Self::Landing | Self::Surrendered | Self::Ended
        )
    }
}

impl Executive {
    /// Lets the present phase act.
    pub(super) fn step(&mut self, now: Instant) {
        if !self.must_jam_on(now)
            && let Some(cause) = self.pending_abort.take()
        {
            self.abort(cause, now);
        }
        match self.phase {
            Phase::Connecting => {
                if self.autopilot.fresh(now) && self.estimator_ok() {
                    self.enter(Phase::Standby, now);
                }
            }
            Phase::Standby => self.stand_by(now),
            Phase::TakingControl | Phase::Arming | Phase::Landing | Phase::Ended => {}
            Phase::Surrendered => self.end_on_the_ground(now),
            Phase::Climbing => {
                if self.arrived(now) {
                    self.enter(Phase::Ready { refused_since: None, propose_at: now }, now);
                    self.notice(MavSeverity::MAV_SEVERITY_INFO, "airborne, ready for slots".into());
                    // At once: the peer hears that this vehicle is airborne, and may propose on that.
                    self.ready(now, now);
                }
            }
            Phase::Ready { propose_at, .. } => self.ready(propose_at, now),
            Phase::Slot => {
                if self.slot_over(now) {
                    self.end_slot(now);
                } else {
                    self.watch_peer_ending(now);
                    self.keep_turns(now);
                }
            }
            Phase::Holding { until } => {
                if now >= until && self.may_return(now) {
                    self.go_home(now);
                }
            }
            Phase::Returning => {
                if self.arrived(now) {
                    self.motion = None;
                    self.autopilot.land(now);
                    self.enter(Phase::Landing, now);
                }
            }
        }
        let late = |motion: &Motion| now > motion.ends_at() + LATE;
        if matches!(self.phase, Phase::Climbing | Phase::Returning) && self.motion.as_ref().is_some_and(late)
        {
            self.notice(
                MavSeverity::MAV_SEVERITY_ERROR,
                format!("still {} m from where it should be: the autopilot lands here", self.distance_left()),
            );
            self.note_abort(format!("{} did not end where it should", self.phase.name()));
            self.motion = None;
            self.autopilot.land(now);
            self.enter(Phase::Landing, now);
        }
    }

    /// Nothing is left to do for a vehicle that another hand has, and that stands on the ground, disarmed.
    fn end_on_the_ground(&mut self, now: Instant) {
        let state = self.autopilot.state();
        // Said since then: what was known before may have been overtaken by what led to the surrender.
        let disarmed = state.armed.is_some_and(|armed| !armed.value && armed.received_at > self.phase_since);
        if disarmed && state.is_airborne() == Some(false) {
            self.notice(MavSeverity::MAV_SEVERITY_INFO, "on the ground and disarmed".into());
            self.end(now);
        }
    }

    fn ready(&mut self, propose_at: Instant, now: Instant) {
        self.watch_peer_ending(now);
        if !matches!(self.phase, Phase::Ready { .. }) {
            return;
        }
        let Some(entry) = self.entry(self.next_slot) else { return self.finish(now) };
        let lead = entry.opens.saturating_sub(entry.transit_starts);
        let opens = entry.opens;
        if self.paused {
            return self.pair.set_readiness(None);
        }
        match self.settings.role {
            Role::J => self.pair.set_readiness(Some(Readiness { next_slot: self.next_slot, needs: lead })),
            Role::I => {
                let peer = self.pair.peer();
                let peer_ready = peer.says(VeilwingFlags::VEILWING_FLAGS_AIRBORNE)
                    && !peer.says(VeilwingFlags::VEILWING_FLAGS_PAUSED);
                if !peer_ready || self.pair.is_proposing() || now < propose_at {
                    return;
                }
                let Some(utc) = self.autopilot.utc(now) else { return };
                let earliest = now + self.agreement_time.time(&self.pair) + lead;
                let zero = self.table_zero.or_else(|| self.start.table_zero(utc, now));
                let opens_at = zero.map_or(earliest, |zero| (zero + opens).max(earliest));
                // Before a start at a given time both hover: a proposal now would be agreed on too early.
                if opens_at <= earliest + EARLY {
                    self.table_zero = Some(opens_at - opens);
                    let opens: Utc = utc + opens_at.saturating_since(now);
                    self.pair.propose(self.next_slot, opens, lead, now);
                }
            }
        }
    }

    /// A slot's time is over, served or not.
    fn end_slot(&mut self, now: Instant) {
        if let Some(slot) = self.slot.take() {
            self.next_slot = slot.course.commitment.slot + 1;
            let (severity, how) = if slot.announced {
                (MavSeverity::MAV_SEVERITY_INFO, "over")
            } else {
                self.note_abort(format!("slot {} was not served", slot.course.commitment.slot));
                (MavSeverity::MAV_SEVERITY_WARNING, "not served")
            };
            self.notice(severity, format!("slot {} for {}: {how}", slot.course.commitment.slot, slot.user));
        }
        self.pair.release(now);
        self.enter(Phase::Ready { refused_since: None, propose_at: now }, now);
    }

    /// The peer ends its mission while ours goes on.
    fn watch_peer_ending(&mut self, now: Instant) {
        let last = usize::from(self.next_slot) + 1 >= self.table.as_ref().map_or(0, |t| t.entries.len());
        let winding_up = last && self.slot.as_ref().is_none_or(|slot| now >= slot.course.radiate_until);
        if self.pair.peer().says(VeilwingFlags::VEILWING_FLAGS_ENDED) && !winding_up {
            self.abort(format!("vehicle {} has ended its mission", self.settings.role.peer()), now);
        }
    }

    /// J jams while I may radiate, whatever ends the mission, unless a fault of its own silences it (S3).
    pub(super) fn must_jam_on(&self, now: Instant) -> bool {
        self.settings.role == Role::J
            && self.phase == Phase::Slot
            && self.interlock.is_on()
            && self.pair.leases_outstanding(now)
    }

    /// Silent, hold, then home. On the ground: over. J first lets I go off, for a lease's length at most.
    pub(super) fn abort(&mut self, cause: String, now: Instant) {
        if self.must_jam_on(now) {
            self.pending_abort.get_or_insert(cause);
            return;
        }
        self.notice(MavSeverity::MAV_SEVERITY_ERROR, format!("mission aborted: {cause}"));
        self.note_abort(cause);
        self.slot = None;
        self.pair.release(now);
        self.pair.set_readiness(None);
        match self.phase {
            Phase::Connecting | Phase::Standby => {}
            Phase::TakingControl | Phase::Arming => {
                self.motion = None;
                self.autopilot.release(now);
                self.autopilot.disarm(now);
                self.end(now);
            }
            Phase::Climbing | Phase::Ready { .. } | Phase::Slot => {
                self.hold_here(now);
                self.enter(Phase::Holding { until: now + HOLD }, now);
            }
            Phase::Holding { .. } | Phase::Returning | Phase::Landing | Phase::Surrendered | Phase::Ended => {
            }
        }
    }

    pub(super) fn note_abort(&mut self, cause: String) {
        self.abort_cause.get_or_insert(cause);
    }

    pub(super) fn end(&mut self, now: Instant) {
        let outcome = self.abort_cause.clone().map_or(Outcome::Completed, Outcome::Aborted);
        self.outcome.get_or_insert(outcome);
        self.enter(Phase::Ended, now);
    }

    /// The autopilot's present pose.
    pub(super) fn here(&self) -> Option<Start> {
        let attitude = self.autopilot.state().attitude?.value;
        Some(Start { position_enu_m: self.position()?, attitude })
    }

    /// The point above `home` at the bottom of the altitude band.
    pub(super) fn above(&self, home: Enu) -> Enu {
        Enu::new(home.x, home.y, self.settings.airspace.altitude_m[0])
    }

    /// Stops where the setpoint is.
    pub(super) fn hold_here(&mut self, now: Instant) {
        if let Some(motion) = self.motion.take() {
            let sample = motion.sample(now);
            let start = Start { position_enu_m: sample.position_enu_m, attitude: sample.attitude };
            let mut trajectory = Trajectory::rest(&start);
            trajectory.turn(Attitude::level(), 0.0, &self.settings.limits[self.settings.role]);
            self.motion = Some(Motion { trajectory, starts_at: now });
        }
    }

    /// From here to the bottom of the altitude band.
    fn way_up(&self, home: Enu) -> Option<Trajectory> {
        let limits = self.settings.limits[self.settings.role];
        let mut trajectory = Trajectory::rest(&self.here()?);
        trajectory.fly(&[self.above(home)], &limits);
        // The turn to the mission's heading waits until the vehicle is clear of the ground.
        trajectory.turn(Attitude::level(), 2.0, &limits);
        Some(trajectory)
    }

    pub(super) fn climb_time(&self) -> Duration {
        self.home_enu_m.and_then(|home| self.way_up(home)).map_or(Duration::ZERO, |way| way.duration())
    }

    pub(super) fn climb(&mut self, now: Instant) {
        let Some((home, trajectory)) = self.home_enu_m.and_then(|home| Some((home, self.way_up(home)?)))
        else {
            return;
        };
        self.motion = Some(Motion { trajectory, starts_at: now });
        self.autopilot.take_off(self.above(home).z - home.z, now);
        self.enter(Phase::Climbing, now);
    }

    fn distance_left(&self) -> String {
        let target = self.motion.as_ref().map(|m| m.trajectory.end().position_enu_m);
        let position = self.position();
        target.zip(position).map_or("?".into(), |(t, p)| format!("{:.1}", (t - p).norm()))
    }

    fn arrived(&self, now: Instant) -> bool {
        let Some(motion) = self.motion.as_ref().filter(|motion| now >= motion.ends_at()) else {
            return false;
        };
        let target = motion.trajectory.end().position_enu_m;
        self.position().is_some_and(|p| (p - target).norm() < ARRIVED_M)
    }
}
