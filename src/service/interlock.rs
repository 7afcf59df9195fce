//! The one place that can raise a transmitter's power above off (S1-S6).
//!
//! `decide` is a pure function of the facts; [`Interlock`] owns the transmitter, so that nothing else can command
//! it, and applies the decision. Every power command carries an expiry: the decision must be renewed or the radio
//! falls silent by itself (S5).

use std::time::Duration;

use crate::role::Role;
use crate::time::Instant;
use crate::transmitter::Transmitter;
use crate::units::Watts;

/// A standing permission is renewed this often.
const RENEW_EVERY: Duration = Duration::from_millis(100);
/// I's command reaches its radio this much later than it is given, or a measured round trip if that is longer: the
/// radio counts its expiry from then. Beyond it the jam lease's own margin (pair::lease) covers.
const COMMAND_LATENCY: Duration = Duration::from_millis(20);

/// What the decision rests on beside the interlock's own state, all as known at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facts {
    /// The committed slot's share of time in which this vehicle may radiate, and the plan's power for it.
    pub window: Option<Window>,
    /// Autopilot state received recently enough.
    pub state_fresh: bool,
    /// Armed and in the companion's mode.
    pub in_control: bool,
    /// The autopilot's estimate is healthy.
    pub estimator_ok: bool,
    /// Arrived, and own pose inside tolerance.
    pub pose_ok: bool,
    /// I: the end of the jam lease in force.
    pub jam_lease: Option<Instant>,
    /// J: vehicle I is on station for the same commitment and was heard within a lease's length.
    pub peer_on_station: bool,
    /// J: I may hold a lease.
    pub leases_outstanding: bool,
}

/// What the interlock itself knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Latches {
    /// Which vehicle this is.
    pub role: Role,
    /// The operator's kill is latched.
    pub killed: bool,
    /// The transmitter is simulated, or the mission's `[emission]` table covers it.
    pub authorised: bool,
    /// J has just fallen silent out of turn.
    pub resting: bool,
    /// The smallest of all ceilings beside the plan's power, in watts.
    pub power_limit_w: f64,
    /// The longest permit.
    pub lease: Duration,
    /// Of a command to the transmitter, as last measured.
    pub round_trip: Duration,
}

/// When a vehicle may radiate in the committed slot, and how strongly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Slot number over superframes.
    pub slot: u16,
    /// First instant.
    pub from: Instant,
    /// First instant after.
    pub until: Instant,
    /// The plan's power in W.
    pub power_w: f64,
}

/// Ceilings beside the plan's power (S6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ceilings {
    /// Of the mission: radio and emission tables.
    pub mission_w: f64,
    /// Of the vehicle file.
    pub vehicle_w: f64,
}

/// Leave to radiate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Permit {
    /// Power in W, above 0.
    pub power_w: f64,
    /// Slot it belongs to.
    pub slot: u16,
    /// The radio must be off from here on unless renewed.
    pub expires_at: Instant,
}

/// Why a vehicle must not radiate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Silence {
    /// The operator's kill is latched.
    #[error("radio kill is latched until the companion restarts")]
    Killed,
    /// The mission does not authorise this transmitter.
    #[error("the mission file has no [emission] table that authorises this transmitter")]
    NotAuthorised,
    /// J has just fallen silent out of turn.
    #[error("the off may still be under way to the transmitter")]
    Resting,
    /// No slot is agreed, or its time has not come or is over.
    #[error("not within a committed slot")]
    NoSlot,
    /// Stale autopilot state.
    #[error("autopilot state is stale")]
    Stale,
    /// Not armed in the companion's mode.
    #[error("the companion is not in control of the autopilot")]
    NotInControl,
    /// Estimator failure.
    #[error("the autopilot's position estimate failed")]
    Estimator,
    /// Pose out of tolerance.
    #[error("own pose is out of tolerance")]
    Pose,
    /// I without a lease.
    #[error("no jam lease in force")]
    NoLease,
    /// J without I.
    #[error("vehicle I is not on station")]
    NoPeer,
    /// The plan's power, or a ceiling, is zero or not a number.
    #[error("no power is allowed")]
    NoPower,
}

/// The decision: a pure function of what is known at `now`.
///
/// # Errors
/// The first reason for silence, in the order of [`Silence`]'s variants; but where nothing is agreed, or its time has
/// not come, that is the reason, whatever the vehicle says of itself.
pub fn decide(latches: &Latches, facts: &Facts, now: Instant) -> Result<Permit, Silence> {
    if latches.killed {
        return Err(Silence::Killed);
    }
    if !latches.authorised {
        return Err(Silence::NotAuthorised);
    }
    if latches.resting {
        return Err(Silence::Resting);
    }
    let window = facts.window.filter(|w| w.from <= now && now < w.until).ok_or(Silence::NoSlot)?;
    if !facts.state_fresh {
        return Err(Silence::Stale);
    }
    if !facts.in_control {
        return Err(Silence::NotInControl);
    }
    if !facts.estimator_ok {
        return Err(Silence::Estimator);
    }
    if !facts.pose_ok {
        return Err(Silence::Pose);
    }
    let longest = (now + latches.lease).min(window.until);
    let expires_at = match latches.role {
        Role::I => {
            let lease_end = facts.jam_lease.ok_or(Silence::NoLease)?;
            longest.min(lease_end - COMMAND_LATENCY.max(latches.round_trip))
        }
        Role::J if facts.peer_on_station || facts.leases_outstanding => longest,
        Role::J => return Err(Silence::NoPeer),
    };
    if expires_at <= now {
        return Err(Silence::NoLease);
    }
    let power_w = window.power_w.min(latches.power_limit_w);
    if !(power_w > 0.0 && power_w.is_finite()) {
        return Err(Silence::NoPower);
    }
    Ok(Permit { power_w, slot: window.slot, expires_at })
}

/// Owns the transmitter and applies the decisions.
#[derive(Debug, Clone)]
pub struct Interlock {
    role: Role,
    transmitter: Transmitter,
    ceilings: Ceilings,
    lease: Duration,
    authorised: bool,
    killed: bool,
    /// The shortest round trip to the transmitter measured so far. Not the last: an answer that may belong to an
    /// older, lost command is counted for it, and looks late by as much.
    round_trip: Option<Duration>,
    standing: Option<(Permit, Instant)>,
    /// J: no permit before this. On a link that delays and reorders, an off may reach the transmitter after the on that
    /// followed it, and the answer to an older on be taken for the new one's; then J would vouch for a jammer that is
    /// off. After a lease's length nothing of the old is under way.
    rests_until: Option<Instant>,
}

impl Interlock {
    /// Starts silent. `authorised`: the transmitter is simulated, or the mission's `[emission]` table covers it.
    #[must_use]
    pub fn new(
        role: Role,
        transmitter: Transmitter,
        ceilings: Ceilings,
        lease: Duration,
        authorised: bool,
    ) -> Self {
        Self {
            role,
            transmitter,
            ceilings,
            lease,
            authorised,
            killed: false,
            round_trip: None,
            standing: None,
            rests_until: None,
        }
    }

    /// Radio kill, latched until the process restarts.
    pub fn kill(&mut self, now: Instant) {
        self.killed = true;
        self.silence(now);
    }

    /// Whether the kill is latched.
    #[must_use]
    pub fn is_killed(&self) -> bool {
        self.killed
    }

    /// Off, now.
    pub fn silence(&mut self, now: Instant) {
        if self.standing.take().is_some() && self.role == Role::J {
            self.rests_until = Some(now + self.lease);
        }
        self.transmitter.silence(now);
    }

    /// Decides on the facts and commands the transmitter accordingly.
    ///
    /// # Errors
    /// Why the transmitter is (now) off.
    pub fn apply(&mut self, facts: &Facts, now: Instant) -> Result<Permit, Silence> {
        let decision = decide(&self.latches(now), facts, now);
        match decision {
            Ok(permit) => {
                let renew = self.standing.is_none_or(|(standing, at)| {
                    standing.power_w != permit.power_w
                        || standing.slot != permit.slot
                        || permit.expires_at < standing.expires_at
                        || now.saturating_since(at) >= RENEW_EVERY
                });
                if renew {
                    self.standing = Some((permit, now));
                    self.transmitter.radiate(permit.power_w, permit.slot, permit.expires_at, now);
                }
            }
            Err(_) if self.standing.is_some() => self.silence(now),
            Err(_) => {}
        }
        decision
    }

    fn latches(&self, now: Instant) -> Latches {
        Latches {
            role: self.role,
            killed: self.killed,
            authorised: self.authorised,
            resting: self.rests_until.is_some_and(|until| now < until),
            power_limit_w: self.ceiling().0,
            lease: self.lease,
            round_trip: self.round_trip(),
        }
    }

    /// Whether the transmitter is known to be off: never commanded on since it last acknowledged off, or every
    /// command's expiry is past.
    #[must_use]
    pub fn is_off(&self, now: Instant) -> bool {
        self.standing.is_none() && self.transmitter.is_off(now)
    }

    /// Whether a permit is standing.
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.standing.is_some()
    }

    /// Whether neither the operator nor the mission forbids this vehicle to radiate at all.
    #[must_use]
    pub fn may_radiate(&self) -> bool {
        self.authorised && !self.killed
    }

    /// See [`Transmitter::adopt_system`]; silent afterwards.
    pub fn adopt_system(&mut self, system: u8, now: Instant) {
        self.standing = None;
        self.transmitter.adopt_system(system, now);
    }

    /// The transmitter, for everything but power.
    #[must_use]
    pub fn transmitter(&self) -> &Transmitter {
        &self.transmitter
    }

    /// Hands a message of the autopilot link to the transmitter's driver.
    pub fn handle_message(
        &mut self,
        header: mavlink::MavHeader,
        message: &mavlink::dialects::ardupilotmega::MavMessage,
        now: Instant,
    ) {
        self.transmitter.handle_message(header, message, now);
        if let Some(measured) = self.transmitter.round_trip() {
            self.round_trip = Some(self.round_trip.map_or(measured, |shortest| shortest.min(measured)));
        }
    }

    /// The time to allow for a command to the transmitter and back: twice the shortest measured.
    #[must_use]
    pub fn round_trip(&self) -> Duration {
        2 * self.round_trip.unwrap_or_default()
    }

    /// The next message for the autopilot link.
    pub fn poll_transmit(&mut self) -> Option<mavlink::dialects::ardupilotmega::MavMessage> {
        self.transmitter.poll_transmit()
    }

    /// When `handle_timeout` must be called next.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<(Instant, &'static str)> {
        self.transmitter.poll_timeout()
    }

    /// Repeats what was not acknowledged.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.transmitter.handle_timeout(now);
    }

    /// The smallest ceiling known.
    #[must_use]
    pub fn ceiling(&self) -> Watts {
        let transmitter_w = self.transmitter.limit_w().unwrap_or(f64::INFINITY);
        Watts(transmitter_w.min(self.ceilings.mission_w).min(self.ceilings.vehicle_w))
    }
}
