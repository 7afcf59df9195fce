//! The course of one committed slot as far as power goes: when to ask, vouch, radiate and stop, and what the peer is
//! told of it. Pure: the executive feeds it, and the pair simulations run the very same code.

use std::time::Duration;

use crate::pair::wire::{VeilwingAnswer, VeilwingFlags, VeilwingSilence};
use crate::pair::{Commitment, Coordinator, Vouch};
use crate::role::Role;
use crate::time::Instant;

use super::interlock::{Facts, Interlock, Permit, Silence, Window};

/// I asks for leases this long before it may radiate, so that it holds one when its time comes.
const ASK_EARLY: Duration = Duration::from_millis(200);
/// J vouches only for the plan's power, less what a radio's steps and the wire's rounding take away.
const FULL_POWER: f64 = 0.99;

/// A committed slot: its times on our monotonic clock and our power in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// What was agreed on.
    pub commitment: Commitment,
    /// The plan's power in watts.
    pub power_w: f64,
    /// I may radiate from here ...
    pub radiate_from: Instant,
    /// ... to here; J from the opening until I is off, at most to the close.
    pub radiate_until: Instant,
    /// The slot's end.
    pub closes_at: Instant,
    /// To be ended early, in order: I is off at once, J vouches no more and is off once I is.
    pub closing: bool,
}

/// What the vehicle itself says for and against radiating.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// Autopilot state received recently enough.
    pub state_fresh: bool,
    /// Armed and in the companion's mode.
    pub in_control: bool,
    /// The autopilot's estimate is healthy.
    pub estimator_ok: bool,
    /// Arrived, and own pose inside tolerance.
    pub pose_ok: bool,
}

/// The transmitter went on or off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// It may radiate from now on.
    On(Permit),
    /// It was told to be silent.
    Off(Silence),
}

impl Course {
    fn window(&self, role: Role, leases_outstanding: bool, now: Instant) -> Window {
        let (from, until) = match role {
            Role::I if self.closing => (self.radiate_from, now),
            Role::I => (self.radiate_from, self.radiate_until),
            // Once I has said that it is off and holds nothing, J has no more to protect.
            Role::J if (self.closing || now >= self.radiate_until) && !leases_outstanding => {
                (self.commitment.opens_at, now)
            }
            Role::J => (self.commitment.opens_at, self.closes_at),
        };
        Window { slot: self.commitment.slot, from, until, power_w: self.power_w }
    }
}

/// Decides on what is known at `now`, commands the transmitter, tells the peer of a silence out of turn, and asks for
/// leases (I) or vouches (J) as far as the decision allows. To be called at every input.
pub fn drive(
    role: Role,
    course: Option<&Course>,
    health: &Health,
    interlock: &mut Interlock,
    pair: &mut Coordinator,
    now: Instant,
) -> Option<Change> {
    let leases_outstanding = pair.leases_outstanding(now);
    let facts = Facts {
        window: course.map(|course| course.window(role, leases_outstanding, now)),
        state_fresh: health.state_fresh,
        in_control: health.in_control,
        estimator_ok: health.estimator_ok,
        pose_ok: health.pose_ok,
        jam_lease: pair.lease(now),
        peer_on_station: course.is_some_and(|course| peer_on_station(course, pair, now)),
        leases_outstanding,
    };
    let was_on = interlock.is_on();
    let change = match interlock.apply(&facts, now) {
        Ok(permit) => (!was_on).then_some(Change::On(permit)),
        Err(silence) => was_on.then_some(Change::Off(silence)),
    };
    if let Some(Change::Off(silence)) = change
        && let Some(reason) = silence_reason(silence)
    {
        pair.silent(reason, now);
    }
    match course {
        None => {
            pair.want_lease(false, now);
            pair.set_vouch(None);
        }
        Some(course) => tell(role, course, health, interlock, pair, now),
    }
    change
}

fn peer_on_station(course: &Course, pair: &Coordinator, now: Instant) -> bool {
    let peer = pair.peer();
    peer.heard_within(pair.longest_lease(), now)
        && peer.committed == Some(course.commitment.proposal)
        && peer.says(VeilwingFlags::VEILWING_FLAGS_ON_STATION)
}

/// I: asks for leases while it could use one. J: vouches while its transmitter is acknowledged on and its own
/// interlock agrees.
fn tell(
    role: Role,
    course: &Course,
    health: &Health,
    interlock: &Interlock,
    pair: &mut Coordinator,
    now: Instant,
) {
    match role {
        Role::I => {
            let in_time = course.radiate_from <= now + ASK_EARLY && now < course.radiate_until;
            let able = health.pose_ok && health.state_fresh && health.in_control && health.estimator_ok;
            pair.want_lease(in_time && able && interlock.may_radiate() && !course.closing, now);
        }
        Role::J => {
            let on = interlock.is_on() && now < course.radiate_until && !course.closing;
            let lease = interlock.transmitter().acknowledged().filter(|lease| {
                on && lease.slot == course.commitment.slot && lease.power_w >= FULL_POWER * course.power_w
            });
            pair.set_vouch(lease.map(|lease| Vouch {
                transmitter_expires_at: lease.expires_at,
                round_trip: interlock.round_trip(),
                closes_at: course.closes_at,
            }));
        }
    }
}

/// What the peer is told of a silence out of turn; `None` for those that are its own news or in turn.
fn silence_reason(silence: Silence) -> Option<VeilwingSilence> {
    match silence {
        Silence::Killed | Silence::NotAuthorised => Some(VeilwingSilence::VEILWING_SILENCE_OPERATOR),
        Silence::Stale => Some(VeilwingSilence::VEILWING_SILENCE_LINK),
        Silence::NotInControl => Some(VeilwingSilence::VEILWING_SILENCE_CONTROL),
        Silence::Estimator => Some(VeilwingSilence::VEILWING_SILENCE_ESTIMATOR),
        Silence::Pose => Some(VeilwingSilence::VEILWING_SILENCE_POSE),
        Silence::NoPower => Some(VeilwingSilence::VEILWING_SILENCE_TRANSMITTER),
        Silence::NoSlot | Silence::NoLease | Silence::NoPeer | Silence::Resting => None,
    }
}

/// How long before its transit a slot is proposed: time for the agreement. Longer on a slow link, and doubled each
/// time it was not enough.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct AgreementTime {
    doublings: u32,
}

impl AgreementTime {
    const SHORTEST: Duration = Duration::from_secs(1);
    const LONGEST: Duration = Duration::from_secs(16);

    /// The time to leave.
    #[must_use]
    pub fn time(&self, pair: &Coordinator) -> Duration {
        // Twice the round trip, which is twice the uncertainty of the best comparison of clocks.
        let link = pair.clock_offset().map_or(Duration::ZERO, |offset| 4 * offset.uncertainty);
        (Self::SHORTEST * (1 << self.doublings) + link).min(Self::LONGEST)
    }

    /// The proposal was refused, or not agreed on in time.
    pub fn refused(&mut self, answer: VeilwingAnswer) {
        if answer == VeilwingAnswer::VEILWING_ANSWER_TOO_LATE {
            self.doublings = (self.doublings + 1).min(4);
        }
    }

    /// A slot was agreed on.
    pub fn agreed(&mut self) {
        self.doublings = self.doublings.saturating_sub(1);
    }
}
