//! One companion as far as the pair protocol goes: the real coordinator, interlock, transmitter driver and course of
//! a slot, under an executive reduced to phases, with a clock of its own.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage as RadioMessage;
use nalgebra::Vector3;
use veilwing::geo::Pose;
use veilwing::mission::course::{AgreementTime, Change, Course, Health, drive};
use veilwing::mission::interlock::{Ceilings, Interlock, Silence};
use veilwing::pair::wire::{MavMessage, VeilwingFlags, VeilwingSilence};
use veilwing::pair::{Coordinator, Event, Local, PlanTerms, Readiness, Settings};
use veilwing::planner::plan::VehiclePlan;
use veilwing::role::{PerVehicle, Role};
use veilwing::time::{Instant, Utc};
use veilwing::transmitter::{Kind, Transmitter};

/// From the start of a transit to the opening of its slot; the vehicle has arrived after half of it.
pub const LEAD: Duration = Duration::from_secs(2);
pub const SLOT: Duration = Duration::from_secs(3);
pub const GUARD: Duration = Duration::from_secs(1);
pub const LEASE: Duration = Duration::from_millis(500);
pub const SLOTS: u16 = 8;
/// Planned powers; I's vehicle file allows less (S6).
pub const PLANNED_W: PerVehicle<f64> = PerVehicle { i: 0.5, j: 0.25 };
pub const CAP_W: PerVehicle<f64> = PerVehicle { i: 0.4, j: 1.0 };
const TICK: Duration = Duration::from_millis(20);
const REFUSED_TOO_LONG: Duration = Duration::from_secs(30);
const PROPOSE_AGAIN: Duration = Duration::from_millis(500);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    Ready,
    Slot,
    Aborted,
}

/// Monotonic time and UTC of one vehicle, in terms of true time.
#[derive(Debug, Clone, Copy)]
pub struct Clocks {
    /// True time of the companion's start.
    pub started: Duration,
    /// Rate against true time.
    pub rate: f64,
    /// Error of UTC, microseconds.
    pub utc_error_us: i64,
}

impl Clocks {
    pub fn local(&self, t: Duration) -> Instant {
        Instant::from_start(t.saturating_sub(self.started).mul_f64(self.rate))
    }

    /// True time of a local instant, rounded up so that a wake is never too early.
    pub fn true_time(&self, at: Instant) -> Duration {
        self.started + at.since_start().div_f64(self.rate) + Duration::from_nanos(2)
    }

    fn utc(&self, t: Duration) -> Utc {
        let us = 1_800_000_000_000_000 + t.as_micros() as i64 + self.utc_error_us;
        Utc { unix_us: us as u64 }
    }
}

#[derive(Debug, Clone)]
pub struct Companion {
    pub role: Role,
    pub clocks: Clocks,
    pub pair: Coordinator,
    pub interlock: Interlock,
    pub course: Option<Course>,
    pub phase: Phase,
    pub next_slot: u16,
    pub pose_lost: bool,
    pub slot_length: Duration,
    /// Slots given up or flown, for the counting: their numbers.
    pub finished: Vec<u16>,
    pub aborted_by: Option<String>,
    agreement_time: AgreementTime,
    refused_since: Option<Instant>,
    propose_at: Instant,
    pending_abort: Option<String>,
    next_tick: Instant,
}

pub fn plan() -> PlanTerms {
    let vehicle = |x: f64, tx_power_w| VehiclePlan {
        pose: Pose {
            position_enu_m: Vector3::new(x, 10.0, 80.0),
            roll_rad: 0.7,
            pitch_rad: -0.2,
            yaw_rad: 0.0,
        },
        tx_power_w,
    };
    let slots = (0..SLOTS)
        .map(|slot| PerVehicle {
            i: vehicle(f64::from(slot) * 7.1, PLANNED_W.i),
            j: vehicle(100.0 + f64::from(slot) * 3.3, PLANNED_W.j),
        })
        .collect();
    PlanTerms { digest: [7; 32], slots }
}

impl Companion {
    pub fn new(role: Role, boot_id: u32, clocks: Clocks, lease: Duration) -> Self {
        let now = Instant::ZERO;
        let settings = Settings {
            role,
            boot_id,
            mission_digest: [3; 32],
            lease,
            peer_timeout: Duration::from_secs(3),
            clock_tolerance: GUARD / 4,
        };
        let system = match role {
            Role::I => 1,
            Role::J => 2,
        };
        let transmitter = Transmitter::new(
            veilwing::transmitter::Settings {
                own: (system, 191),
                target: (system, 68),
                kind: Kind::Leased { command: 31010 },
                first_off_after: if role == Role::J { LEASE } else { Duration::ZERO },
            },
            now,
        );
        let ceilings = Ceilings { mission_w: 1.0, vehicle_w: CAP_W[role] };
        let mut pair = Coordinator::new(settings, now);
        pair.set_plan(plan());
        Self {
            role,
            clocks,
            pair,
            interlock: Interlock::new(role, transmitter, ceilings, lease, true),
            course: None,
            phase: Phase::Ready,
            next_slot: 0,
            pose_lost: false,
            slot_length: SLOT,
            finished: Vec::new(),
            aborted_by: None,
            agreement_time: AgreementTime::default(),
            refused_since: None,
            propose_at: now,
            pending_abort: None,
            next_tick: now,
        }
    }

    pub fn handle_pair(&mut self, message: &MavMessage, t: Duration) {
        let now = self.clocks.local(t);
        self.pair.handle_message(message, now);
        self.react(t);
    }

    pub fn handle_radio(&mut self, message: &RadioMessage, t: Duration) {
        let system = if self.role == Role::I { 1 } else { 2 };
        let header = MavHeader { system_id: system, component_id: 68, sequence: 0 };
        self.interlock.handle_message(header, message, self.clocks.local(t));
        self.react(t);
    }

    pub fn handle_timeout(&mut self, t: Duration) {
        let now = self.clocks.local(t);
        self.pair.handle_timeout(now);
        self.interlock.handle_timeout(now);
        if self.next_tick <= now {
            self.next_tick = now + TICK;
            self.react(t);
        }
    }

    /// True time of the next timeout.
    pub fn wake_at(&self) -> Duration {
        let others = self.interlock.poll_timeout().map(|(at, _)| at);
        let next = self.pair.poll_timeout().0.min(self.next_tick);
        self.clocks.true_time(others.map_or(next, |at| at.min(next)))
    }

    /// The mission begins (again).
    pub fn begin(&mut self, t: Duration) {
        self.phase = Phase::Ready;
        self.next_slot = 0;
        self.pose_lost = false;
        self.aborted_by = None;
        self.refused_since = None;
        self.propose_at = self.clocks.local(t);
        self.pair.set_readiness(None);
    }

    pub fn react(&mut self, t: Duration) {
        let now = self.clocks.local(t);
        self.pair.set_utc(Some(self.clocks.utc(t)), now);
        while let Some(event) = self.pair.poll_event() {
            self.on_event(event, now);
        }
        self.step(t, now);
        let arrived = self.course.as_ref().is_some_and(|c| now >= c.commitment.leaves_at + LEAD / 2);
        let health = Health {
            state_fresh: true,
            in_control: true,
            estimator_ok: true,
            pose_ok: arrived && !self.pose_lost,
        };
        let course = self.course.as_ref();
        let change = drive(self.role, course, &health, &mut self.interlock, &mut self.pair, now);
        debug_assert!(!matches!(change, Some(Change::Off(Silence::NoPower))));
        let local = Local {
            home_enu_m: Some(Vector3::zeros()),
            position_enu_m: Some(Vector3::zeros()),
            preflight_ok: true,
            airborne: self.phase != Phase::Aborted,
            on_station: health.pose_ok,
            radiating: !self.interlock.is_off(now),
            ended: self.phase == Phase::Aborted,
            ..Local::default()
        };
        self.pair.set_local(local, now);
    }

    fn step(&mut self, t: Duration, now: Instant) {
        if !self.must_jam_on(now)
            && let Some(cause) = self.pending_abort.take()
        {
            self.abort(cause, now);
        }
        let peer = self.pair.peer();
        let peer_ended = peer.says(VeilwingFlags::VEILWING_FLAGS_ENDED);
        match self.phase {
            Phase::Ready if peer_ended && self.finished.is_empty() && self.pair.commitment().is_none() => {}
            Phase::Ready | Phase::Slot if peer_ended => self.abort("the peer has ended".into(), now),
            Phase::Ready if self.role == Role::J => {
                self.pair.set_readiness(Some(Readiness { next_slot: self.next_slot, needs: LEAD }));
            }
            Phase::Ready => {
                let ready = peer.says(VeilwingFlags::VEILWING_FLAGS_AIRBORNE) && self.pair.agrees();
                if ready && !self.pair.is_proposing() && now >= self.propose_at {
                    let notice = self.agreement_time.time(&self.pair) + LEAD;
                    self.pair.propose(self.next_slot, self.clocks.utc(t) + notice, LEAD, now);
                }
            }
            Phase::Slot => {
                if self.course.as_ref().is_none_or(|course| now >= course.closes_at) {
                    self.end_slot(now);
                }
            }
            Phase::Aborted => {}
        }
    }

    fn end_slot(&mut self, now: Instant) {
        if let Some(course) = self.course.take() {
            self.finished.push(course.commitment.slot);
            self.next_slot = (course.commitment.slot + 1) % SLOTS;
        }
        self.pair.release(now);
        self.phase = Phase::Ready;
        self.refused_since = None;
    }

    /// As the executive's: J jams while I may radiate, unless a fault of its own silences it.
    fn must_jam_on(&self, now: Instant) -> bool {
        self.role == Role::J
            && self.phase == Phase::Slot
            && self.interlock.is_on()
            && self.pair.leases_outstanding(now)
    }

    pub fn abort(&mut self, cause: String, now: Instant) {
        if self.phase == Phase::Aborted {
            return;
        }
        if self.must_jam_on(now) {
            if let Some(course) = self.course.as_mut() {
                course.closing = true;
            }
            self.pending_abort.get_or_insert(cause);
            return;
        }
        let slot = self.course.take().map_or(self.next_slot, |course| course.commitment.slot);
        self.finished.push(slot);
        self.pair.release(now);
        self.pair.set_readiness(None);
        self.aborted_by = Some(cause);
        self.phase = Phase::Aborted;
    }

    fn on_event(&mut self, event: Event, now: Instant) {
        match event {
            Event::PeerLost(_) | Event::PeerRestarted => self.abort(format!("{event:?}"), now),
            Event::PeerLeft => {
                if self.course.as_ref().is_some_and(|c| now < c.commitment.opens_at) {
                    self.abort("the peer left".into(), now);
                }
            }
            Event::PeerSilent(reason) => {
                if reason != VeilwingSilence::VEILWING_SILENCE_POSE {
                    self.abort(format!("{reason:?}"), now);
                }
            }
            Event::Refused(slot, answer) => {
                self.agreement_time.refused(answer);
                let since = *self.refused_since.get_or_insert(now);
                self.propose_at = now + PROPOSE_AGAIN;
                if now.saturating_since(since) > REFUSED_TOO_LONG {
                    self.abort(format!("slot {slot} refused: {answer:?}"), now);
                }
            }
            Event::Committed(commitment) if self.phase == Phase::Ready => {
                self.agreement_time.agreed();
                self.pair.set_readiness(None);
                let opens = commitment.opens_at;
                self.course = Some(Course {
                    commitment,
                    power_w: PLANNED_W[self.role],
                    radiate_from: opens + GUARD / 2,
                    radiate_until: opens + self.slot_length - GUARD / 2,
                    closes_at: opens + self.slot_length,
                    closing: false,
                });
                self.phase = Phase::Slot;
            }
            Event::Committed(_) => self.pair.release(now),
            Event::PeerFound
            | Event::MissionDiffers
            | Event::PlanDiffers
            | Event::SameRole
            | Event::Ordered(_) => {}
        }
    }
}
