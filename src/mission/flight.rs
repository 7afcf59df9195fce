//! What is done in each phase and when it ends.

use std::time::Duration;

use crate::geo::Attitude;
use crate::pair::Commitment;
use crate::pair::orders::START_EXPIRES;
use crate::planner::moving;
use crate::planner::track::Track;
use crate::schedule::trajectory::{Sample, Start, Trajectory};
use crate::service::{Served, Silence};
use crate::time::Instant;

use super::cause::Cause;
use super::executive::{Executive, Outcome};
use super::notice::Notice;
use super::phase::{HOLD, Motion, Phase};
use super::start::Void;
use super::turns::Turns;

/// How close to the end of a climb or a return counts as arrived, in metres.
const ARRIVED_M: f64 = 1.0;
/// After a climb or a return should have ended, how long the vehicle may still take.
const LATE: Duration = Duration::from_secs(30);
/// A position of the other that is older says nothing of where it rests.
const HEARD_OF_LATE: Duration = Duration::from_millis(500);

impl Executive {
    /// Lets the present phase act.
    pub(super) fn step(&mut self, now: Instant) {
        self.watch_battery(now);
        if self.phase.is_waiting() && self.autopilot.state().is_armed() {
            self.service.orders_mut().forget_start();
            self.ground.start.void(Void::Armed);
        }
        match &self.phase {
            Phase::Connecting => {
                if self.autopilot.fresh(now) && self.estimator_ok() {
                    self.phase = Phase::Standby;
                    if self.autopilot.state().is_disarmed() {
                        self.service.orders_mut().began_on_the_ground();
                    }
                } else {
                    let (missing, _) = self.ground.judge(&self.autopilot.preflight(now));
                    self.wait_for(&missing, true, now);
                }
            }
            Phase::Standby => self.stand_by(now),
            Phase::TakingControl(motion) => {
                // Long after the START nobody who stands by expects it to arm.
                if now > motion.starts_at + START_EXPIRES && !self.is_recorded() {
                    self.abort(Cause::NotRecorded, now);
                }
            }
            Phase::Arming(_) | Phase::Landing | Phase::Ended => {}
            Phase::Surrendered { since } => self.end_on_the_ground(*since, now),
            Phase::Climbing(motion) => {
                if self.has_arrived(motion, now) {
                    self.join_service(now);
                } else if now > motion.ends_at() + LATE {
                    self.land_astray(now);
                }
            }
            Phase::InService { .. } => {
                self.keep_turns(now);
                self.keep_to_way(now);
                self.keep_to_slot(now);
                self.keep_inside(now);
                self.ask_for_motion(now);
                self.ask_for_poses(now);
            }
            Phase::Holding { since, motion } => {
                let waited = now.saturating_since(*since);
                // What leaves a motion does so to its end.
                let stands = motion.glide.is_none() || motion.is_at_rest(now);
                if waited >= HOLD && stands && self.may_return(waited, now) {
                    self.go_home(now);
                }
            }
            Phase::Returning(motion) => {
                if self.has_arrived(motion, now) {
                    self.land(now);
                } else if now > motion.ends_at() + LATE {
                    self.land_astray(now);
                }
            }
        }
    }

    /// At the end of the climb.
    fn join_service(&mut self, now: Instant) {
        let Phase::Climbing(motion) = &self.phase else { return };
        self.phase = Phase::InService { motion: motion.clone(), turns: None };
        let utc = self.autopilot.utc(now);
        let table_zero = utc.and_then(|utc| self.ground.start.table_zero(utc, now));
        self.service.join(0, table_zero, now);
        self.notice(Notice::Airborne);
        // At once: the peer hears that this vehicle is airborne, and may propose on that.
        self.service.advance(utc, now);
    }

    /// Both sides have agreed: the transit begins at the table's time before the opening.
    pub(super) fn begin_transit(&mut self, commitment: Commitment, now: Instant) {
        self.renewal.agreed();
        let transit = self.itinerary.as_ref().and_then(|i| i.transit(commitment.slot, self.settings.role));
        let Some((trajectory, peer)) = transit.filter(|_| self.phase.is_in_service()) else { return };
        let is_anew = self.settings.following.is_some() || self.may_replan();
        if is_anew && !self.begins_here(&trajectory, now) {
            return self.abort(Cause::Astray(self.phase_name()), now);
        }
        if let Some(cause) = self.too_little_for(&commitment, now) {
            return self.abort(cause, now);
        }
        let track = self.track();
        let limits = &self.settings.limits[self.settings.role];
        let attitude = self.phase.motion().map(|motion| motion.sample(now).attitude);
        let trajectory = match attitude.filter(|_| track.is_some()) {
            // Where a slot ended early, the vehicle is between two attitudes.
            Some(attitude) => trajectory.from_attitude(attitude, limits),
            None => trajectory,
        };
        let motion = Motion::on_track(trajectory, commitment.leaves_at, track);
        self.phase = Phase::InService { motion, turns: peer.map(Turns::new) };
        self.agreed(&commitment, now);
    }

    /// The slot that is over is carried on by the next: the vehicle stays, and turns on.
    pub(super) fn carry_on(&mut self, commitment: Commitment, now: Instant) {
        let Phase::InService { motion, .. } = &self.phase else { return };
        if let Some(cause) = self.too_little_for(&commitment, now) {
            return self.abort(cause, now);
        }
        let mut motion = motion.clone();
        // Who is late is still on its way to where both slots are served.
        if motion.is_over(now) {
            let Sample { position_enu_m, attitude, .. } = motion.sample(now);
            motion = Motion::new(Trajectory::rest(&Start { position_enu_m, attitude }), now);
        }
        motion.track = self.track();
        self.phase = Phase::InService { motion, turns: None };
        self.agreed(&commitment, now);
    }

    /// How the vehicle turns in the slot that is agreed on.
    pub(super) fn track(&self) -> Option<(Track, Instant)> {
        let slot = self.service.slot()?;
        slot.track.clone().map(|track| (track, slot.commitment.opens_at))
    }

    fn agreed(&mut self, commitment: &Commitment, now: Instant) {
        let user = self.user(commitment.slot);
        let opens_in = commitment.opens_at.saturating_since(now);
        self.notice(Notice::SlotAgreed { slot: commitment.slot, user, opens_in });
    }

    /// Between two slots the vehicle stays as it is, once it has come to rest: one that ended early has left it on its way from one
    /// attitude to another.
    fn stop_turning(&mut self, now: Instant) {
        let limits = self.motion_limits();
        if let Phase::InService { motion, .. } = &mut self.phase
            && motion.track.is_some()
        {
            // Who is late goes on to where the next slot's way begins.
            *motion = if motion.is_over(now) {
                motion.stopped(now, &limits)
            } else {
                motion.clone().without_track()
            };
        }
    }

    /// What bounds the vehicle's motion on a way.
    pub(super) fn motion_limits(&self) -> moving::Limits {
        self.settings.limits[self.settings.role].of_motion()
    }

    /// In a plan that moves: leaves the motion as soon as the slot is to end early; and between slots goes along its own way to where
    /// the next one is entered.
    fn keep_to_way(&mut self, now: Instant) {
        let limits = self.motion_limits();
        let closing = self.service.slot().map(|slot| slot.is_closing());
        let next = self.service.slot_number();
        let role = self.settings.role;
        let tracks = self.itinerary.as_ref().and_then(|itinerary| itinerary.tracks(next));
        let Some(way) = tracks.and_then(|tracks| tracks[role].way()) else { return };
        let renews = self.renews();
        let Phase::InService { motion, .. } = &mut self.phase else { return };
        match closing {
            Some(false) => {}
            Some(true) if motion.is_on_track(now) => *motion = motion.stopped(now, &limits),
            Some(true) if motion.track.is_some() => *motion = motion.clone().without_track(),
            Some(true) => {}
            // Another plan begins where both rest.
            None if renews || self.service.orders().is_paused() || !motion.is_at_rest(now) => {}
            None => {
                if let Some(glide) = motion.rests_s.and_then(|rests_s| way.approach(rests_s, &limits)) {
                    *motion = Motion::along(glide, motion.sample(now).attitude, now);
                }
            }
        }
    }

    /// The slot that is entered from where the vehicle rests, in a plan that moves.
    pub(super) fn rests_for(&self, now: Instant) -> Option<u16> {
        let next = self.service.slot_number();
        if self.settings.following.is_some() {
            return Some(next);
        }
        let way = self.itinerary.as_ref()?.tracks(next)?[self.settings.role].way()?;
        let Phase::InService { motion, .. } = &self.phase else { return None };
        if self.renewal.begins_with(next) {
            return motion.is_at_rest(now).then_some(next);
        }
        let rests_s = motion.rests_s.filter(|_| motion.is_at_rest(now))?;
        way.is_entered_from(rests_s).then_some(next)
    }

    /// On a transit in turns: waits for the other, and gives up once that costs the slot's opening.
    fn keep_turns(&mut self, now: Instant) {
        let peer = self.service.peer();
        let peer_at = peer.position_enu_m.filter(|_| peer.heard_within(HEARD_OF_LATE, now));
        let opens_at = self.service.slot().map(|slot| slot.commitment.opens_at);
        let Phase::InService { motion, turns: Some(turns) } = &mut self.phase else { return };
        let starts_at = turns.started(&motion.trajectory, motion.starts_at, peer_at, now);
        let is_kept = std::mem::replace(&mut motion.starts_at, starts_at) < starts_at;
        if is_kept && opens_at.is_some_and(|opens_at| motion.ends_at() > opens_at) {
            self.abort(Cause::OutOfTurn(self.settings.role.peer()), now);
        }
    }

    /// A slot that carried on the one before ended early, and is agreed on again.
    pub(super) fn put_off(&mut self, slot: u16, now: Instant) {
        self.stop_turning(now);
        let user = self.user(slot);
        self.notice(Notice::SlotPutOff(slot, user));
    }

    /// A slot's time is over, served or not.
    pub(super) fn slot_over(&mut self, slot: u16, served: Served, now: Instant) {
        self.stop_turning(now);
        let user = self.user(slot);
        match served {
            Served::Yes => self.notice(Notice::SlotOver(slot, user)),
            Served::No(silence) => self.slot_not_served(slot, user, silence),
        }
        if let Some(measured_rad) = self.jitter.slot_over() {
            let stated_rad = self.settings.jitter.std_rad;
            self.notice(Notice::Jitter { measured_rad, stated_rad });
        }
        if let Some(made_m_s) = self.progress.slot_over() {
            let counted_on_m_s = self.settings.limits[self.settings.role].speed_m_s;
            self.notice(Notice::Slow { made_m_s, counted_on_m_s });
        }
        self.rest_where_it_got(now);
    }

    fn slot_not_served(&mut self, slot: u16, user: String, silence: Option<Silence>) {
        self.note_abort(Cause::NotServed { slot, silence });
        self.notice(Notice::SlotNotServed { slot, user, silence });
    }

    /// The name of a slot's user.
    pub(super) fn user(&self, slot: u16) -> String {
        let entry = self.itinerary.as_ref().and_then(|itinerary| itinerary.entry(slot));
        let planned = entry.zip(self.plan.as_ref()).and_then(|(e, plan)| plan.slots.get(e.user_index));
        planned.map(|slot| slot.user.clone()).unwrap_or_default()
    }

    /// Nothing is left to do for a vehicle that another hand has, and that stands on the ground, disarmed.
    fn end_on_the_ground(&mut self, since: Instant, now: Instant) {
        let state = self.autopilot.state();
        // Said since then: what was known before may have been overtaken by what led to the surrender.
        let disarmed = state.armed.is_some_and(|armed| !armed.value && armed.received_at > since);
        if disarmed && state.is_airborne() == Some(false) {
            self.notice(Notice::OnTheGround);
            self.end(now);
        }
    }

    /// The mission is over before its time: silent, hold, then home; on the ground, over. J first lets I go off, for a
    /// lease's length at most.
    pub(super) fn abort(&mut self, cause: Cause, now: Instant) {
        if self.service.is_abandoning() {
            return self.note_abort(cause);
        }
        self.notice(Notice::Aborted(cause.clone()));
        self.note_abort(cause);
        if self.service.abandon(now) {
            self.break_off(now);
        }
    }

    /// The vehicle's part of an abort, once the service has let go.
    pub(super) fn break_off(&mut self, now: Instant) {
        match &self.phase {
            Phase::TakingControl(_) | Phase::Arming(_) => {
                self.autopilot.release(now);
                self.autopilot.disarm(now);
                self.end(now);
            }
            Phase::Climbing(_) | Phase::InService { .. } => self.hold_here(now),
            Phase::Connecting
            | Phase::Standby
            | Phase::Holding { .. }
            | Phase::Returning(_)
            | Phase::Landing
            | Phase::Surrendered { .. }
            | Phase::Ended => {}
        }
    }

    pub(super) fn note_abort(&mut self, cause: Cause) {
        self.abort_cause.get_or_insert(cause);
    }

    pub(super) fn end(&mut self, _now: Instant) {
        let outcome = self.abort_cause.clone().map_or(Outcome::Completed, Outcome::Aborted);
        self.outcome.get_or_insert(outcome);
        self.phase = Phase::Ended;
    }

    /// The autopilot's present pose.
    pub(super) fn here(&self) -> Option<Start> {
        let attitude = self.autopilot.state().attitude?.value;
        Some(Start { position_enu_m: self.position()?, attitude })
    }

    /// Stops where the setpoint is, and levels.
    pub(super) fn hold_here(&mut self, now: Instant) {
        let limits = self.motion_limits();
        let Some(mut motion) = self.phase.motion().map(|motion| motion.stopped(now, &limits)) else { return };
        motion.trajectory.turn(Attitude::level(), 0.0, &self.settings.limits[self.settings.role]);
        self.phase = Phase::Holding { motion, since: now };
    }

    /// From here to the bottom of the altitude band.
    fn way_up(&self) -> Option<Trajectory> {
        let home = self.home_enu_m?;
        let limits = self.settings.limits[self.settings.role];
        let mut trajectory = Trajectory::rest(&self.here()?);
        trajectory.fly(&[self.settings.above(home)], &limits);
        // The turn to the mission's heading waits until the vehicle is clear of the ground.
        trajectory.turn(Attitude::level(), 2.0, &limits);
        Some(trajectory)
    }

    pub(super) fn climb_time(&self) -> Duration {
        self.way_up().map_or(Duration::ZERO, |way| way.duration())
    }

    pub(super) fn climb(&mut self, now: Instant) {
        let (Some(home), Some(trajectory)) = (self.home_enu_m, self.way_up()) else { return };
        self.autopilot.take_off(self.settings.above(home).z - home.z, now);
        self.phase = Phase::Climbing(Motion::new(trajectory, now));
    }

    fn has_arrived(&self, motion: &Motion, now: Instant) -> bool {
        motion.is_over(now) && self.distance_m(motion).is_some_and(|distance| distance < ARRIVED_M)
    }

    /// From the end of a motion.
    fn distance_m(&self, motion: &Motion) -> Option<f64> {
        self.position().map(|position| (position - motion.trajectory.end().position_enu_m).norm())
    }

    /// The autopilot lands, here.
    pub(super) fn land(&mut self, now: Instant) {
        self.autopilot.land(now);
        self.phase = Phase::Landing;
    }

    fn land_astray(&mut self, now: Instant) {
        let left_m = self.phase.motion().and_then(|motion| self.distance_m(motion));
        self.notice(Notice::Astray(left_m));
        self.note_abort(Cause::Astray(self.phase_name()));
        self.land(now);
    }
}
