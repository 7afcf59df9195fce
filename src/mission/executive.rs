//! One vehicle's mission from power-up to landing.
//!
//! Owns the three state machines below it (autopilot, transmitter behind the interlock, pair) and drives them by
//! the phase it is in. `flight` holds what each phase does and when it ends, `slot` the course of a committed slot,
//! `operator` the commands from outside. Everything happens in `handle_*`, at the instant handed in: if nobody
//! calls, nothing is sent (F3).

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity};

use crate::autopilot::{self, Autopilot};
use crate::geo::{Attitude, Enu};
use crate::pair::{self, Coordinator, PlanTerms, wire};
use crate::planner::problem::Airspace;
use crate::planner::slots::Plan;
use crate::role::{PerVehicle, Role};
use crate::schedule::order::Order;
use crate::schedule::table::{Entry, Table, TableError, Timing};
use crate::schedule::trajectory::{self, Limits, Start as From, Trajectory};
use crate::schedule::transit::{Router, Separation, TransitError};
use crate::time::{Instant, Utc};
use crate::transmitter::Transmitter;

use super::course::{self, AgreementTime, Change, Health};
use super::face::{Face, Scene};
use super::flight::Phase;
use super::interlock::{Ceilings, Interlock, Silence};
use super::slot::SlotRun;
use super::start::Start;
use super::waiting::Waiting;

const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);

/// What the executive is told once.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Our part in the pair.
    pub role: Role,
    /// Our MAVLink system and component id.
    pub own: (u8, u8),
    /// The autopilot's driver.
    pub autopilot: autopilot::Settings,
    /// The pair protocol.
    pub pair: pair::Settings,
    /// Where vehicles may be.
    pub airspace: Airspace,
    /// What the slot table demands of each vehicle.
    pub limits: PerVehicle<Limits>,
    /// Lengths of slots and number of superframes.
    pub timing: Timing,
    /// The order of users.
    pub order: Order,
    /// Standard deviation of the attitude jitter the mission expects, radians per axis.
    pub jitter_rad: f64,
    /// Power ceilings beside the plan's.
    pub ceilings: Ceilings,
    /// The transmitter is simulated, or the mission authorises emission.
    pub emission_authorised: bool,
    /// Nodes and radio, for the live figures.
    pub scene: Scene,
    /// Begin as soon as both vehicles are ready, without waiting for MISSION_START.
    pub start_unasked: bool,
    /// When the transit to the first slot begins, unless the operator decides.
    pub start_utc: Option<Utc>,
}

/// A message for one of the two links.
#[derive(Debug, Clone, PartialEq)]
pub enum Outgoing {
    /// To the autopilot link, from our own system and component.
    Autopilot(Box<MavMessage>),
    /// To the pair link.
    Pair(Box<wire::MavMessage>),
}

/// A line for the operator: goes out as STATUSTEXT and into the log.
#[derive(Debug, Clone, PartialEq)]
pub struct Notice {
    /// MAVLink severity.
    pub severity: MavSeverity,
    /// Plain words with the number that matters.
    pub text: String,
}

/// How the mission ended for this vehicle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// Every slot flown, landed.
    Completed,
    /// Something went wrong; the first cause.
    Aborted(String),
    /// Ended by a signal.
    Interrupted,
}

/// Why the slots cannot be flown one after the other.
#[derive(Debug, thiserror::Error)]
pub(super) enum NoTable {
    #[error("slot table: {0}")]
    Table(#[from] TableError),
    #[error("way home: {0}")]
    Home(#[from] TransitError),
}

/// What the setpoints follow.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    pub trajectory: Trajectory,
    pub starts_at: Instant,
}

impl Motion {
    pub fn sample(&self, now: Instant) -> trajectory::Sample {
        self.trajectory.sample(now.saturating_since(self.starts_at))
    }

    pub fn ends_at(&self) -> Instant {
        self.starts_at + self.trajectory.duration()
    }
}

/// See the module.
#[derive(Debug)]
pub struct Executive {
    pub(super) settings: Settings,
    pub(super) autopilot: Autopilot,
    pub(super) pair: Coordinator,
    pub(super) interlock: Interlock,
    pub(super) phase: Phase,
    pub(super) phase_since: Instant,
    pub(super) plan: Option<Plan>,
    pub(super) table: Option<Table>,
    /// From the last slot's poses to above the homes, where both can fly at once.
    pub(super) home_trajectory: Option<Trajectory>,
    pub(super) preflight_ok: bool,
    pub(super) motion: Option<Motion>,
    pub(super) slot: Option<SlotRun>,
    pub(super) next_slot: u16,
    /// I: the instant the table counts from, known from the first proposal on.
    pub(super) table_zero: Option<Instant>,
    pub(super) home_enu_m: Option<Enu>,
    pub(super) start: Start,
    /// By the operator's order.
    pub(super) paused: bool,
    pub(super) agreement_time: AgreementTime,
    pub(super) abort_cause: Option<String>,
    /// J: an abort that waits until I is off (S3).
    pub(super) pending_abort: Option<String>,
    /// J: asked to end, which waits likewise.
    pub(super) stop_wanted: bool,
    pub(super) outcome: Option<Outcome>,
    pub(super) waiting: Waiting,
    pub(super) shutting_down: Option<Instant>,
    pub(super) face: Face,
    /// J: I has been told that our state is late.
    pub(super) told_late: bool,
    /// The last timeout: the instant at which state may count as late.
    pub(super) judged_at: Instant,
    next_tick: Instant,
    next_heartbeat: Instant,
    notices: VecDeque<Notice>,
    /// Messages of our own for the autopilot link.
    pub(super) outbox: VecDeque<MavMessage>,
}

impl Executive {
    /// An executive that has heard nothing yet.
    #[must_use]
    pub fn new(settings: Settings, transmitter: Transmitter, now: Instant) -> Self {
        let interlock = Interlock::new(
            settings.role,
            transmitter,
            settings.ceilings,
            settings.pair.lease,
            settings.emission_authorised,
        );
        Self {
            autopilot: Autopilot::new(settings.autopilot.clone(), now),
            pair: Coordinator::new(settings.pair.clone(), now),
            interlock,
            phase: Phase::Connecting,
            phase_since: now,
            plan: None,
            table: None,
            home_trajectory: None,
            preflight_ok: false,
            motion: None,
            slot: None,
            next_slot: 0,
            table_zero: None,
            home_enu_m: None,
            start: Start::new(settings.start_unasked, settings.start_utc),
            paused: false,
            agreement_time: AgreementTime::default(),
            abort_cause: None,
            pending_abort: None,
            stop_wanted: false,
            outcome: None,
            waiting: Waiting::default(),
            shutting_down: None,
            face: Face::new(now),
            told_late: false,
            judged_at: now,
            next_tick: now,
            next_heartbeat: now,
            notices: VecDeque::new(),
            outbox: VecDeque::new(),
            settings,
        }
    }

    /// The plan, made elsewhere (planning never blocks the loop).
    pub fn handle_plan(&mut self, plan: Plan) {
        self.notice(MavSeverity::MAV_SEVERITY_INFO, format!("planned {} slots", plan.slots.len()));
        self.plan = Some(plan);
    }

    /// A message from the autopilot link, whoever on it sent it.
    pub fn handle_autopilot(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        self.autopilot.handle_message(header, message, now);
        self.interlock.handle_message(header, message, now);
        self.handle_operator(header, message, now);
        self.handle_parameters(header, message);
        self.handle_files(header, message);
        self.react(now);
    }

    /// A message from the pair link.
    pub fn handle_pair(&mut self, message: &wire::MavMessage, now: Instant) {
        self.pair.handle_message(message, now);
        self.react(now);
    }

    /// Does what is due at `now`.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.judged_at = now;
        self.autopilot.handle_timeout(now);
        self.pair.handle_timeout(now);
        self.interlock.handle_timeout(now);
        if self.overdue_at().is_some_and(|at| at <= now) {
            self.react(now);
        }
        if self.next_tick <= now {
            let period = Duration::from_secs_f64(1.0 / self.settings.autopilot.rate_hz);
            self.next_tick = (self.next_tick + period).max(now);
            self.react(now);
            self.feed_setpoint(now);
            self.show(now);
        }
        if self.next_heartbeat <= now {
            self.next_heartbeat = now + HEARTBEAT_EVERY;
            let heartbeat = self.heartbeat();
            self.outbox.push_back(heartbeat);
        }
    }

    /// When `handle_timeout` must be called next, and why.
    #[must_use]
    pub fn poll_timeout(&self) -> (Instant, &'static str) {
        let own = [(self.next_tick, "tick"), (self.next_heartbeat, "heartbeat"), self.pair.poll_timeout()];
        let overdue = self.overdue_at().map(|at| (at, "late state"));
        let lower = [self.autopilot.poll_timeout(), self.interlock.poll_timeout(), overdue];
        own.into_iter().chain(lower.into_iter().flatten()).min_by_key(|(at, _)| *at).unwrap_or(own[0])
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<Outgoing> {
        // Power first: nothing may delay an off.
        let radio = self.interlock.poll_transmit().map(|m| Outgoing::Autopilot(Box::new(m)));
        radio
            .or_else(|| self.pair.poll_transmit().map(|m| Outgoing::Pair(Box::new(m))))
            .or_else(|| self.outbox.pop_front().map(|m| Outgoing::Autopilot(Box::new(m))))
            .or_else(|| self.autopilot.poll_transmit().map(|m| Outgoing::Autopilot(Box::new(m))))
    }

    /// The next line for the log; it has gone out as STATUSTEXT already.
    pub fn poll_notice(&mut self) -> Option<Notice> {
        self.notices.pop_front()
    }

    /// The process is asked to end: silent, the peer told, the autopilot left in its own hold. J first lets I go
    /// off, for a lease's length at most.
    pub fn shutdown(&mut self, now: Instant) {
        if self.shutting_down.is_some() {
            return;
        }
        if self.must_jam_on(now) {
            if !self.stop_wanted {
                self.stop_wanted = true;
                self.pair.silent(wire::VeilwingSilence::VEILWING_SILENCE_SHUTDOWN, now);
            }
            return;
        }
        self.shutting_down = Some(now);
        self.interlock.silence(now);
        self.pair.silent(wire::VeilwingSilence::VEILWING_SILENCE_SHUTDOWN, now);
        self.motion = None;
        if self.autopilot.in_control() {
            self.autopilot.hold(now);
        }
        self.autopilot.release(now);
        self.notice(MavSeverity::MAV_SEVERITY_WARNING, "companion is ending: silent, autopilot holds".into());
    }

    /// Set once the process may end: landed, or asked to end and known to be silent (or a second has passed).
    #[must_use]
    pub fn outcome(&self, now: Instant) -> Option<Outcome> {
        match self.shutting_down {
            Some(since) => {
                let silent = self.interlock.is_off(now) && now > since;
                (silent || now.saturating_since(since) >= Duration::from_secs(1))
                    .then(|| self.outcome.clone().unwrap_or(Outcome::Interrupted))
            }
            None => self.outcome.clone(),
        }
    }

    /// The MAVLink system and component we speak as: the autopilot's system, once it is found.
    #[must_use]
    pub fn own(&self) -> (u8, u8) {
        self.settings.own
    }

    /// A name of the present phase, for logs and progress.
    #[must_use]
    pub fn phase_name(&self) -> &'static str {
        self.phase.name()
    }

    pub(super) fn notice(&mut self, severity: MavSeverity, text: String) {
        self.autopilot.statustext(severity, &text);
        self.notices.push_back(Notice { severity, text });
    }

    pub(super) fn enter(&mut self, phase: Phase, now: Instant) {
        self.phase = phase;
        self.phase_since = now;
    }

    /// The table's entry of a slot.
    pub(super) fn entry(&self, slot: u16) -> Option<&Entry> {
        self.table.as_ref().and_then(|table| table.entries.get(usize::from(slot)))
    }

    /// Makes the table once the plan and both homes are known, and tells the pair protocol.
    pub(super) fn make_table(&mut self) -> Result<(), NoTable> {
        let (Some(plan), Some(own), Some(peer)) = (&self.plan, self.home_enu_m, self.pair.peer().home_enu_m)
        else {
            return Ok(());
        };
        if self.table.is_some() {
            return Ok(());
        }
        let homes = PerVehicle::from_fn(|role| if role == self.settings.role { own } else { peer });
        let start = homes.map(|home| From { position_enu_m: self.above(home), attitude: Attitude::level() });
        let router = Router::new(&self.settings.airspace, &self.settings.limits)?;
        let users: Vec<_> = plan.slots.iter().map(|slot| vec![slot.plan.vehicles.map(|v| v.pose)]).collect();
        let table = Table::build(&router, &start, &users, &self.settings.timing, self.settings.order)?;
        if let Some(last) = table.entries.last() {
            let from = PerVehicle::from_fn(|role| last.transit[role].end());
            let home = router.home(&from, &homes)?;
            let together = home.separation == Separation::Paths;
            self.home_trajectory = together.then(|| home.trajectories[self.settings.role].clone());
        }
        let slots =
            table.entries.iter().filter_map(|e| plan.slots.get(e.user_index)).map(|s| s.plan.vehicles);
        self.pair.set_plan(PlanTerms { digest: plan.digest, slots: slots.collect() });
        self.table = Some(table);
        Ok(())
    }

    /// Takes in what has changed, lets the phase act on it, then lets the interlock decide. Every input ends here,
    /// so that a fault silences the transmitter at the message that shows it (S4).
    fn react(&mut self, now: Instant) {
        self.pair.set_utc(self.autopilot.utc(now), now);
        while let Some(event) = self.autopilot.poll_event() {
            self.on_autopilot(event, now);
        }
        while let Some(event) = self.pair.poll_event() {
            self.on_pair(event, now);
        }
        if self.stop_wanted {
            self.shutdown(now);
        }
        if self.shutting_down.is_none() {
            self.step(now);
        }
        self.watch_pose();
        self.drive(now);
        self.tell_pair(now);
    }

    /// Lets the course of the slot decide, and says when the transmitter goes on and off, and why.
    fn drive(&mut self, now: Instant) {
        let health = Health {
            state_fresh: self.may_radiate_on_state(),
            in_control: self.autopilot.in_control() && self.shutting_down.is_none(),
            estimator_ok: self.estimator_ok(),
            pose_ok: self.pose_ok(now),
        };
        if let Some(slot) = self.slot.as_mut() {
            slot.course.closing |= self.stop_wanted || self.pending_abort.is_some();
        }
        let course = self.slot.as_ref().map(|slot| &slot.course);
        let role = self.settings.role;
        match course::drive(role, course, &health, &mut self.interlock, &mut self.pair, now) {
            Some(Change::On(permit)) => {
                if let Some(slot) = self.slot.as_mut() {
                    slot.announced = true;
                }
                let power = crate::units::Watts(permit.power_w);
                self.notice(MavSeverity::MAV_SEVERITY_INFO, format!("slot {}: on, {power}", permit.slot));
            }
            Some(Change::Off(silence)) if silence != Silence::NoSlot => {
                self.notice(MavSeverity::MAV_SEVERITY_WARNING, format!("silent: {silence}"));
            }
            Some(Change::Off(_)) | None => {}
        }
        self.warn_if_late(now);
    }

    /// No word against the estimate: an autopilot that does not report its health is judged by its state's freshness.
    pub(super) fn estimator_ok(&self) -> bool {
        self.autopilot.state().estimator_ok.is_none_or(|ok| ok.value)
    }

    /// The autopilot's newest position.
    pub(super) fn position(&self) -> Option<Enu> {
        self.autopilot.state().position_enu_m.map(|p| p.value)
    }
}
