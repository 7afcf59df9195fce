//! The flight of a whole mission, once plan and both homes are known: the slot table and the way home after it.

use std::time::Duration;

use sha2::{Digest, Sha256};

use crate::geo::{Attitude, Enu};
use crate::pair::wire::{self, ShortDigest};
use crate::pair::{PlanTerms, Rest, SlotTerms};
use crate::planner::plan::VehiclePlan;
use crate::planner::slots::{Plan, PlannedSlot};
use crate::planner::track::{Followed, Track};
use crate::role::{PerVehicle, Role};
use crate::schedule::table::{Entry, Table, TableError};
use crate::schedule::trajectory::{Limits, Start, Trajectory};
use crate::schedule::transit::{Router, Separation, TransitError};

use super::settings::Settings;

/// Shorter ways take no time beside coming to rest, metres.
const FAR_M: f64 = 5.0;

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
    homes: PerVehicle<Enu>,
    table: Table,
    /// From the last slot's poses to above the homes, where both can fly at once.
    pub ways_home: Option<PerVehicle<Trajectory>>,
    /// By slot, where the plan has the vehicles turn on the air.
    tracks: Vec<PerVehicle<Track>>,
    /// Whether a vehicle has far to go from slot to slot, or in one: whether its speed counts.
    pub flies: PerVehicle<bool>,
}

impl Itinerary {
    /// The same on both vehicles, bit for bit.
    pub fn new(plan: &Plan, homes: &PerVehicle<Enu>, settings: &Settings) -> Result<Self, NoItinerary> {
        let start =
            homes.map(|home| Start { position_enu_m: settings.above(home), attitude: Attitude::level() });
        let router = Router::new(&settings.airspace, &settings.limits)?;
        let table = Table::of_plan(&router, &start, plan, &settings.timing, settings.order)?;
        let ways_home = ways_home(&table, &router, homes)?;
        let tracks = match &settings.following {
            Some(_) => {
                let slots = table.entries.iter().filter_map(|entry| plan.slots.get(entry.user_index));
                slots.map(|slot| followed(&slot.plan.vehicles)).collect()
            }
            None => flown(&table, plan, (settings, &settings.limits)),
        };
        Ok(Self { homes: *homes, flies: flies(&table, &tracks), table, ways_home, tracks })
    }

    /// Flies another plan from this slot on, by ways and motions within these limits; both vehicles rest `from` there. `None` where
    /// there is no such slot, or no way. The same on both vehicles, bit for bit.
    pub fn renewed(
        &self,
        slot: u16,
        from: &PerVehicle<Rest>,
        plan: &Plan,
        (settings, limits): (&Settings, &PerVehicle<Limits>),
    ) -> Option<Self> {
        let router = Router::new(&settings.airspace, limits).ok()?;
        let table = self.table.resumed(slot, &router, &starts(from)?, plan, &settings.timing).ok()?;
        let tracks = flown(&table, plan, (settings, limits));
        let ways_home = ways_home(&table, &router, &self.homes).ok()?;
        Some(Self { homes: self.homes, flies: flies(&table, &tracks), table, ways_home, tracks })
    }

    /// The order of users in a superframe.
    pub fn order(&self, users: usize) -> Vec<usize> {
        self.table.entries.iter().take(users).map(|entry| entry.user_index).collect()
    }

    /// What the two companions agree on from a slot on, in a plan that was made anew.
    pub fn terms_anew(
        &self,
        slot: u16,
        from: &PerVehicle<Rest>,
        plan: &Plan,
        limits: &PerVehicle<Limits>,
    ) -> Option<Vec<SlotTerms>> {
        let first = plan.slots.get(self.entry(slot)?.user_index)?;
        let anew = Some(digest(&plan.digest, slot, (from, limits), &first.plan.vehicles));
        let terms = |entry: &Entry| {
            let slot = plan.slots.get(entry.user_index)?;
            Some(self.slot_terms(entry, slot, &slot.plan.vehicles, anew))
        };
        self.table.entries.get(usize::from(slot)..)?.iter().map(terms).collect()
    }

    /// How both vehicles turn and move in a slot, where they do on the air.
    pub fn tracks(&self, slot: u16) -> Option<&PerVehicle<Track>> {
        self.tracks.get(usize::from(slot))
    }

    /// What the two companions agree on, slot by slot.
    pub fn terms(&self, plan: &Plan) -> PlanTerms {
        let terms = |entry: &Entry| {
            let slot = plan.slots.get(entry.user_index)?;
            Some(self.slot_terms(entry, slot, &slot.plan.vehicles, None))
        };
        PlanTerms { digest: plan.digest, slots: self.table.entries.iter().filter_map(terms).collect() }
    }

    fn slot_terms(
        &self,
        entry: &Entry,
        slot: &PlannedSlot,
        vehicles: &PerVehicle<VehiclePlan>,
        anew: Option<ShortDigest>,
    ) -> SlotTerms {
        let after_opening = |t: Duration| t.saturating_sub(entry.opens);
        SlotTerms {
            anew,
            vehicles: *vehicles,
            tracks: self.tracks.get(usize::from(entry.slot)).cloned(),
            lean_rad: slot.lean_rad.map(Option::unwrap_or_default),
            jitter: None,
            opens: entry.opens,
            lead: entry.lead,
            carries_on_after: entry.carries_on_after,
            radiate_from: after_opening(entry.radiate_from),
            radiate_until: after_opening(entry.radiate_until),
            length: after_opening(entry.closes),
        }
    }

    /// Has a slot served from other poses, in a plan that follows; both vehicles rest `from` there. `None` where there is no such
    /// slot, or no way there. The same on both vehicles, bit for bit.
    pub fn serve_from(
        &mut self,
        slot: u16,
        from: &PerVehicle<Rest>,
        vehicles: Option<PerVehicle<VehiclePlan>>,
        plan: &Plan,
        (settings, limits): (&Settings, &PerVehicle<Limits>),
    ) -> Option<SlotTerms> {
        let planned = plan.slots.get(self.entry(slot)?.user_index)?;
        let vehicles = vehicles.unwrap_or(planned.plan.vehicles);
        let starts = starts(from)?;
        let router = Router::new(&settings.airspace, limits).ok()?;
        let poses = vehicles.map(|vehicle| vehicle.pose);
        self.table.reroute(&router, slot, &starts, &poses, &settings.timing).ok()?;
        *self.tracks.get_mut(usize::from(slot))? = followed(&vehicles);
        let anew = Some(digest(&plan.digest, slot, (from, limits), &vehicles));
        Some(self.slot_terms(self.entry(slot)?, planned, &vehicles, anew))
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

/// Of a slot in which motions are made anew: at rest like this until then.
fn followed(vehicles: &PerVehicle<VehiclePlan>) -> PerVehicle<Track> {
    PerVehicle::from_fn(|role| Track::Followed(Followed::new(role, vehicles[role])))
}

/// First bytes of SHA-256 over what a slot is served from, and from where, and how fast, the vehicles come to it.
fn digest(
    plan: &[u8; 32],
    slot: u16,
    (from, limits): (&PerVehicle<Rest>, &PerVehicle<Limits>),
    vehicles: &PerVehicle<VehiclePlan>,
) -> ShortDigest {
    let mut hash = Sha256::new();
    hash.update(plan);
    hash.update(slot.to_le_bytes());
    for role in Role::BOTH {
        let Rest { position_enu_m, wxyz } = &from[role];
        position_enu_m.iter().chain(wxyz).for_each(|number| hash.update(number.to_bits().to_le_bytes()));
        let VehiclePlan { pose, tx_power_w } = &vehicles[role];
        let others = [pose.roll_rad, pose.pitch_rad, pose.yaw_rad, *tx_power_w, limits[role].speed_m_s];
        let numbers = pose.position_enu_m.iter().chain(&others);
        numbers.for_each(|number| hash.update(number.to_bits().to_le_bytes()));
    }
    wire::short(&hash.finalize().into())
}

/// Who has far to go.
fn flies(table: &Table, tracks: &[PerVehicle<Track>]) -> PerVehicle<bool> {
    PerVehicle::from_fn(|role| {
        let is_far = |entry: &Entry| {
            let way = &entry.transit[role];
            (way.end().position_enu_m - way.sample(Duration::ZERO).position_enu_m).norm() > FAR_M
        };
        table.entries.iter().skip(1).any(is_far) || tracks.iter().any(|tracks| tracks[role].is_in_motion())
    })
}

/// Home from the last slot's poses, where both can fly at once.
fn ways_home(
    table: &Table,
    router: &Router,
    homes: &PerVehicle<Enu>,
) -> Result<Option<PerVehicle<Trajectory>>, TransitError> {
    let Some(last) = table.entries.last() else { return Ok(None) };
    let home = router.home(&last.leaves, homes)?;
    Ok((home.separation == Separation::Paths).then_some(home.trajectories))
}

/// Where both set out.
fn starts(from: &PerVehicle<Rest>) -> Option<PerVehicle<Start>> {
    let start = |rest: &Rest| {
        let (position_enu_m, attitude) = rest.pose()?;
        Some(Start { position_enu_m, attitude })
    };
    Some(PerVehicle { i: start(&from.i)?, j: start(&from.j)? })
}

/// The tracks of all the table's slots; none of a plan whose poses are held. A slot that no other one carries on ends at rest.
fn flown(
    table: &Table,
    plan: &Plan,
    (settings, limits): (&Settings, &PerVehicle<Limits>),
) -> Vec<PerVehicle<Track>> {
    let limits = limits.map(|limits| limits.of_motion());
    let superframe = plan.tracks(settings.timing.guard.as_secs_f64(), &limits);
    let served = plan.turns.iter().flat_map(|turns| &turns.slots).map(|slot| slot.user);
    let served: Vec<_> = served.zip(superframe).collect();
    let tracks = table.entries.iter().filter_map(|entry| {
        let (_, tracks) = served.iter().find(|(user, _)| *user == entry.user_index)?;
        let next = table.entries.get(usize::from(entry.slot) + 1);
        Some(match next.is_some_and(|next| next.carries_on_after.is_some()) {
            true => tracks.clone(),
            false => tracks.clone().map(Track::to_rest),
        })
    });
    tracks.collect()
}
