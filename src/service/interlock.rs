//! The one place that can raise a transmitter's power above off (S1-S6).
//!
//! [`decide`] says whether; [`Interlock`] owns the transmitter, so that nothing else can command it, and applies the
//! decision. Every power command carries an expiry: the decision must be renewed or the radio
//! falls silent by itself (S5).

mod decision;

use std::time::Duration;

use crate::role::Role;
use crate::time::Instant;
use crate::transmitter::Transmitter;
use crate::units::Watts;

pub use decision::{Facts, Latches, Permit, Silence, Window, decide};

/// A standing permission is renewed this often ...
const RENEW_EVERY: Duration = Duration::from_millis(100);
/// ... and whenever it can be lengthened, if it ends within this: over a slow pair link leases reach I with little left.
const ENDS_SOON: Duration = Duration::from_millis(200);

/// Ceilings beside the plan's power (S6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ceilings {
    /// Of the mission: radio and emission tables.
    pub mission_w: f64,
    /// Of the vehicle file.
    pub vehicle_w: f64,
}

/// Owns the transmitter and applies the decisions.
#[derive(Debug, Clone)]
pub struct Interlock {
    role: Role,
    transmitter: Transmitter,
    ceilings: Ceilings,
    lease: Duration,
    authorised: bool,
    /// The permission's time.
    permitted: bool,
    killed: bool,
    standing: Option<(Permit, Instant)>,
    /// J, where answers do not name their commands: no permit before this. On a link that delays and reorders, an off
    /// may reach the transmitter after the on that followed it, and the answer to an older on be taken for the new
    /// one's; then J would vouch for a jammer that is off. After a lease's length nothing of the old is under way.
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
            permitted: true,
            killed: false,
            standing: None,
            rests_until: None,
        }
    }

    /// Whether the operator's kill holds; off at once where it does.
    pub fn set_killed(&mut self, killed: bool, now: Instant) {
        let killed_now = killed && !self.killed;
        self.killed = killed;
        if killed_now {
            self.silence(now);
        }
    }

    /// Whether the permission holds at present. The next decision acts on it.
    pub fn set_permitted(&mut self, permitted: bool) {
        self.permitted = permitted;
    }

    /// Off, now.
    pub fn silence(&mut self, now: Instant) {
        let was_on = self.standing.take().is_some();
        if was_on && self.role == Role::J && !self.transmitter.tells_commands_apart() {
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
                        || standing.expires_at < permit.expires_at.min(now + ENDS_SOON)
                        || now.saturating_since(at) >= RENEW_EVERY
                });
                let Permit { power_w, slot, expires_at } = permit;
                if renew && let Err(reason) = self.transmitter.command(power_w, slot, expires_at, now) {
                    if self.standing.is_some() {
                        self.silence(now);
                    }
                    return Err(Silence::Transmitter(reason));
                }
                if renew {
                    self.standing = Some((permit, now));
                }
            }
            Err(_) if self.standing.is_some() => self.silence(now),
            Err(_) => {}
        }
        decision
    }

    /// Why the transmitter must be off, by these facts; `None` where it may be on. Commands nothing.
    #[must_use]
    pub fn silence_for(&self, facts: &Facts, now: Instant) -> Option<Silence> {
        let radio = || self.transmitter.ready(now).err().filter(|_| self.standing.is_none());
        decide(&self.latches(now), facts, now).err().or_else(|| radio().map(Silence::Transmitter))
    }

    fn latches(&self, now: Instant) -> Latches {
        Latches {
            role: self.role,
            killed: self.killed,
            authorised: self.authorised && self.permitted,
            resting: self.rests_until.is_some_and(|until| now < until),
            power_limit_w: self.ceiling().0,
            lease: self.lease,
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
        self.authorised && self.permitted && !self.killed
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
    }

    /// Hands the radio's own message to the transmitter's driver.
    pub fn handle_radio(
        &mut self,
        header: mavlink::MavHeader,
        message: &crate::transmitter::wire::MavMessage,
        now: Instant,
    ) {
        self.transmitter.handle_radio(header, message, now);
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

#[cfg(test)]
mod tests;
