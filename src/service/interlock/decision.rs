//! Whether a vehicle may radiate: a pure function of what is known at one instant (S1, S2, S4, S6).

use std::time::Duration;

use crate::role::Role;
use crate::time::Instant;
use crate::transmitter::NotReady;

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
    /// J: vehicle I is on station for the same commitment, and said so within a lease's length.
    pub peer_on_station: bool,
    /// J: I may hold a lease.
    pub leases_outstanding: bool,
}

/// What the interlock itself knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Latches {
    /// Which vehicle this is.
    pub role: Role,
    /// The operator's kill holds.
    pub killed: bool,
    /// The transmitter is simulated, or the mission's `[emission]` table covers it, at this time.
    pub authorised: bool,
    /// J has just fallen silent out of turn.
    pub resting: bool,
    /// The smallest of all ceilings beside the plan's power, in watts.
    pub power_limit_w: f64,
    /// The longest permit.
    pub lease: Duration,
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

/// Leave to radiate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Permit {
    /// Power in W, above 0.
    pub power_w: f64,
    /// Slot it belongs to.
    pub slot: u16,
    /// The radio must be off by then unless renewed.
    pub expires_at: Instant,
}

/// Why a vehicle must not radiate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error, strum::IntoStaticStr, strum::VariantNames)]
pub enum Silence {
    /// The operator's kill holds.
    #[error("the radio kill holds")]
    Killed,
    /// The mission does not authorise this transmitter, or not at this time.
    #[error("the mission's [emission] table does not authorise this transmitter, or not at this time")]
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
    /// The transmitter cannot be told when to be off: not of the decision, but of what became of it.
    #[error("{0}")]
    Transmitter(NotReady),
}

/// The decision: a pure function of what is known at `now`.
///
/// # Errors
/// The first reason for silence, in the order of [`Silence`]'s variants.
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
            longest.min(lease_end)
        }
        Role::J if facts.peer_on_station || facts.leases_outstanding => longest,
        Role::J => return Err(Silence::NoPeer),
    };
    if expires_at <= now {
        return Err(Silence::NoLease);
    }
    // Not a number is above nothing, and `min` would pass it over.
    let allowed = window.power_w > 0.0 && window.power_w.is_finite() && latches.power_limit_w > 0.0;
    if !allowed {
        return Err(Silence::NoPower);
    }
    Ok(Permit { power_w: window.power_w.min(latches.power_limit_w), slot: window.slot, expires_at })
}

#[cfg(test)]
mod tests;
