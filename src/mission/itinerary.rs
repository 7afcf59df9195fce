//! The flight of a whole mission, once plan and both homes are known: the slot table and the way home after it.

use std::time::Duration;

use crate::geo::{Attitude, Enu};
use crate::pair::{PlanTerms, SlotTerms};
use crate::planner::slots::{Plan, PlannedSlot};
use crate::planner::track::{Followed, Track};
use crate::role::{PerVehicle, Role};
use crate::schedule::table::{Entry, Table, TableError};
use crate::schedule::trajectory::{Start, Trajectory};
use crate::schedule::transit::{Router, Separation, TransitError};

use super::settings::Settings;

/// Why the slots cannot be flown one after the other.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum NoItinerary {
    #[error("slot table: {0}")]
    Table(#[from] TableError),
    #[error("way home: {0}")]
    Home(#[from] TransitError),
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Itinerary {
    table: Table,
    /// From the last slot's poses to above the homes, where both can fly at once.
    pub way_home: Option<Trajectory>,
    /// By slot, where the plan has the vehicles turn on the air.
    tracks: Vec<PerVehicle<Track>>,
}

impl Itinerary {
    /// The same on both vehicles, bit for bit.
    pub fn new(plan: &Plan, homes: &PerVehicle<Enu>, settings: &Settings) -> Result<Self, NoItinerary> {
        let start =
            homes.map(|home| Start { position_enu_m: settings.above(home), attitude: Attitude::level() });
        let router = Router::new(&settings.airspace, &settings.limits)?;
        let table = Table::of_plan(&router, &start, plan, &settings.timing, settings.order)?;
        let way_home = match table.entries.last() {
            Some(last) => {
                let home = router.home(&last.leaves, homes)?;
                let together = home.separation == Separation::Paths;
                together.then(|| home.trajectories[settings.role].clone())
            }
            None => None,
        };
        let limits = settings.limits.map(|limits| limits.of_motion());
        let tracks = match &settings.following {
            Some(_) => followed(&table, plan),
            None => flown(&table, &plan.tracks(settings.timing.guard.as_secs_f64(), &limits)),
        };
        Ok(Self { table, way_home, tracks })
    }

    /// How both vehicles turn and move in a slot, where they do on the air.
    pub fn tracks(&self, slot: u16) -> Option<&PerVehicle<Track>> {
        self.tracks.get(usize::from(slot))
    }

    /// What the two companions agree on, slot by slot.
    pub fn terms(&self, plan: &Plan) -> PlanTerms {
        let terms = |entry: &Entry| {
            let after_opening = |t: Duration| t.saturating_sub(entry.opens);
            let slot = plan.slots.get(entry.user_index)?;
            Some(SlotTerms {
                vehicles: slot.plan.vehicles,
                tracks: self.tracks.get(usize::from(entry.slot)).cloned(),
                lean_rad: slot.lean_rad.map(Option::unwrap_or_default),
                opens: entry.opens,
                lead: entry.lead,
                carries_on_after: entry.carries_on_after,
                radiate_from: after_opening(entry.radiate_from),
                radiate_until: after_opening(entry.radiate_until),
                length: after_opening(entry.closes),
            })
        };
        PlanTerms { digest: plan.digest, slots: self.table.entries.iter().filter_map(terms).collect() }
    }

    /// From the table's beginning to the end of the last slot's airtime.
    pub fn airtime_ends(&self) -> Duration {
        self.table.entries.last().map_or(Duration::ZERO, |entry| entry.radiate_until)
    }

    /// From a slot's opening, or before it from the beginning of its transit, to the end of the last one.
    pub fn to_the_end(&self, slot: u16, from_opening: bool) -> Option<Duration> {
        let entry = self.entry(slot)?;
        let from = if from_opening { entry.opens } else { entry.transit_starts };
        Some(self.table.ends.saturating_sub(from))
    }

    /// How many slots there are.
    pub fn slots(&self) -> usize {
        self.table.entries.len()
    }

    /// The table's entry of a slot.
    pub fn entry(&self, slot: u16) -> Option<&Entry> {
        self.table.entries.get(usize::from(slot))
    }

    /// A vehicle's way to a slot; of the other one's too where time alone keeps them apart.
    pub fn transit(&self, slot: u16, role: Role) -> Option<(Trajectory, Option<Trajectory>)> {
        let entry = self.entry(slot)?;
        let in_turns = entry.separation == Separation::Time;
        Some((entry.transit[role].clone(), in_turns.then(|| entry.transit[role.peer()].clone())))
    }
}

/// Of all the table's slots, where motions are made anew: at rest as planned until then.
fn followed(table: &Table, plan: &Plan) -> Vec<PerVehicle<Track>> {
    let slots = table.entries.iter().filter_map(|entry| plan.slots.get(entry.user_index));
    let track =
        |role: Role, slot: &PlannedSlot| Track::Followed(Followed::new(role, slot.plan.vehicles[role]));
    slots.map(|slot| PerVehicle::from_fn(|role| track(role, slot))).collect()
}

/// The tracks of all the table's slots, from those of a superframe: a slot that no other one carries on ends at rest.
fn flown(table: &Table, superframe: &[PerVehicle<Track>]) -> Vec<PerVehicle<Track>> {
    let entries = table.entries.iter().zip(superframe.iter().cycle());
    let tracks = entries.map(|(entry, tracks)| {
        let next = table.entries.get(usize::from(entry.slot) + 1);
        match next.is_some_and(|next| next.carries_on_after.is_some()) {
            true => tracks.clone(),
            false => tracks.clone().map(Track::to_rest),
        }
    });
    tracks.collect()
}
