//! Home in time: what is left in the battery against what is still to be flown.

use std::time::Duration;

use crate::geo::{Attitude, Enu};
use crate::pair::Commitment;
use crate::preflight::Check;
use crate::role::Role;
use crate::time::Instant;

use super::cause::Cause;
use super::endurance::landing;
use super::executive::Executive;
use super::homing::LAND_FIRST;
use super::phase::HOLD;

/// The way home is asked for so much longer than it is planned: wind, and a gauge that counts in percents.
const MARGIN: f64 = 1.1;

/// From the first thrust until the vehicle rises: thrust is raised slowly to find the one that lifts it.
const LIFTS_OFF: Duration = Duration::from_secs(5);

impl Executive {
    /// Takes in what the autopilot says of the battery; gives up, once no more is left than the way home takes.
    pub(super) fn watch_battery(&mut self, now: Instant) {
        let battery = self.autopilot.state().battery.map(|battery| battery.value);
        let said = battery.and_then(|battery| Some((battery.remaining?, battery.lasts)));
        let floor = self.autopilot.simulated_charge_floor();
        self.endurance.feed(said, floor, !self.phase.is_on_the_ground(), now);
        if !self.phase.is_outward() || self.service.is_abandoning() || !self.endurance.is_due(now) {
            return;
        }
        let at = self.phase.motion().map(|motion| motion.sample(now));
        let of_i = self.service.peer().position_enu_m;
        let needed = at.and_then(|at| self.way_down(at.position_enu_m, at.attitude, of_i));
        if let Some(cause) = needed.and_then(|needed| self.too_little(needed, None, now)) {
            self.abort(cause, now);
        }
    }

    /// Why a slot that is agreed on cannot be flown any more; `None`: it can.
    pub(super) fn too_little_for(&self, commitment: &Commitment, now: Instant) -> Option<Cause> {
        let slot = self.service.slot().filter(|slot| slot.commitment.slot == commitment.slot)?;
        let until_then = slot.closes_at.saturating_since(now);
        let needed = until_then + self.way_down_from(commitment.slot)?;
        self.too_little(needed, Some(commitment.slot), now)
    }

    /// Whether the whole mission fits; `None` before it is known what is to be flown.
    pub(super) fn endurance_check(&self, now: Instant) -> Option<Check> {
        let itinerary = self.itinerary.as_ref()?;
        let last = u16::try_from(itinerary.slots().checked_sub(1)?).ok()?;
        let agreements = self.service.agreement_time() * (u32::from(last) + 1);
        let slots = agreements + itinerary.to_the_end(0, false)?;
        let mission = LIFTS_OFF + self.climb_time() + slots + self.way_down_from(last)?;
        Some(self.endurance.check(mission, now))
    }

    fn too_little(&self, needed: Duration, before: Option<u16>, now: Instant) -> Option<Cause> {
        let left = self.endurance.left(now).filter(|left| *left < needed)?;
        Some(Cause::Battery {
            charge_percent: self.endurance.charge(now)? * 100.0,
            reserve_percent: self.endurance.reserve() * 100.0,
            left,
            needed,
            before,
        })
    }

    /// From a slot's pose to the ground, with the other vehicle in its own.
    fn way_down_from(&self, slot: u16) -> Option<Duration> {
        let leaves = &self.itinerary.as_ref()?.entry(slot)?.leaves;
        let own = leaves[self.settings.role];
        self.way_down(own.position_enu_m, own.attitude, Some(leaves.i.position_enu_m))
    }

    /// Whether the battery bears that the other one lands first.
    pub(super) fn may_wait(&self, now: Instant) -> bool {
        let at = self.phase.motion().map(|motion| motion.sample(now));
        let needed = at.and_then(|at| self.way(self.settings.role, at.position_enu_m, at.attitude));
        needed.is_none_or(|needed| self.too_little(needed.mul_f64(MARGIN), None, now).is_none())
    }

    /// From there to the ground as after an abort: the hold, the way of I from `of_i` where it is J that waits for it, the own one.
    fn way_down(&self, at: Enu, attitude: Attitude, of_i: Option<Enu>) -> Option<Duration> {
        let own = self.way(self.settings.role, at, attitude)?;
        let others = match self.settings.role {
            Role::I => Duration::ZERO,
            Role::J => of_i
                .and_then(|at| self.way(Role::I, at, Attitude::level()))
                .map_or(LAND_FIRST, |way| way.min(LAND_FIRST)),
        };
        Some((HOLD + others + own).mul_f64(MARGIN))
    }

    /// A vehicle's way from there to the ground at its home.
    fn way(&self, role: Role, at: Enu, attitude: Attitude) -> Option<Duration> {
        let home = self.home_of(role)?;
        if self.is_in_own_column(at, home) {
            return Some(landing(at.z - home.z));
        }
        let way = self.way_home(role, at, attitude)?;
        Some(way + landing(self.settings.above(home).z - home.z))
    }
}
