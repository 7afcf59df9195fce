//! The slot table: who is served when, from where, and how the vehicles get there.
//!
//! A slot is `slot` long, or as long as the plan says for its user; the transit to its poses lies *before* it. So a superframe is not a fixed period but the sum
//! of its transits and slots:
//!
//! ```text
//! transit_starts        opens  radiate_from         radiate_until  closes = next transit_starts
//!   | transit | settle  | guard/2 |     radiating     | guard/2    |
//! ```
//!
//! A slot that is served through its turns, from where the one before was, carries that one on: both vehicles turn from its last
//! attitude in what is left of the two guards' halves and the silence between them. Should it be agreed on by itself, since the
//! one before ended early, its transit is the turn from that one's last attitude, and the vehicles come to rest. Where both move on
//! the air, they then enter their motion, and no such slot is agreed on before each has come to where that begins, along its own way.
//!
//! All times are since the mission's start instant, which both vehicles agree on. The table is a pure function of its
//! inputs: the same plan, limits and starting positions give the same table on both vehicles, bit for bit.

use std::time::Duration;

pub use super::error::TableError;
use super::legs::Legs;
use super::order::{Order, Tour};
use super::trajectory::{Start, Trajectory};
use super::transit::{Router, Separation, Transit, TransitError};
use crate::geo::Pose;
use crate::planner::slots::Plan;
use crate::planner::track::{Track, Way};
use crate::planner::turning::{Between, Knot, Protected};
use crate::role::{PerVehicle, Role};

/// Slots open on multiples of this: both vehicles' logs and clocks show round figures.
const GRID: Duration = Duration::from_millis(100);

/// Durations of the TDMA scheme.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timing {
    /// Length of a slot, without the transit before it, where a plan does not give each user a length of its own.
    pub slot: Duration,
    /// The part of a slot in which nobody radiates, half of it at each end: it covers clock errors.
    pub guard: Duration,
    /// After both vehicles have arrived by the table, time to come to rest and to catch up.
    pub settle: Duration,
    /// How often every user is served.
    pub superframes: u16,
}

impl Timing {
    /// Settling time where nobody says otherwise.
    pub const DEFAULT_SETTLE: Duration = Duration::from_secs(3);

    /// Timing with the default settling time.
    #[must_use]
    pub const fn new(slot: Duration, guard: Duration, superframes: u16) -> Self {
        Self { slot, guard, settle: Self::DEFAULT_SETTLE, superframes }
    }
}

/// One slot and the way to it. Times are since the mission's start.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Running number over all superframes, from 0.
    pub slot: u16,
    /// The served user, by position in the mission's list.
    pub user_index: usize,
    /// Which of the user's candidate poses, 0 where there is but one.
    pub candidate: usize,
    /// Both vehicles' way to the slot's poses, starting at `transit_starts`.
    pub transit: PerVehicle<Trajectory>,
    /// What keeps the vehicles apart on the way.
    pub separation: Separation,
    /// Where both are when the user's service ends: where the transit has brought them, unless they turn on the air.
    pub leaves: PerVehicle<Start>,
    /// How long the transit and coming to rest take.
    pub lead: Duration,
    /// It carries on the slot before, and opens so long after that one's close; without the lead.
    pub carries_on_after: Option<Duration>,
    /// When both vehicles leave (one of them perhaps with a hold).
    pub transit_starts: Duration,
    /// When the slot begins: both vehicles have arrived and settled.
    pub opens: Duration,
    /// When the slot ends.
    pub closes: Duration,
    /// When radiating may begin.
    pub radiate_from: Duration,
    /// When radiating must have ended.
    pub radiate_until: Duration,
}

/// A user who is served through the vehicles' turns, in the order of service.
#[derive(Debug, Clone, PartialEq)]
pub struct Turned {
    /// The user, by position in the mission's list.
    pub user_index: usize,
    /// Poses where its service begins, and where it ends.
    pub ends: [PerVehicle<Pose>; 2],
    /// The slot's length.
    pub length: Duration,
    /// From the close of the slot before, which is served from the same positions, to this one's opening; the last one's, of the
    /// first.
    pub carries_on_after: Option<Duration>,
    /// Where the vehicles move while it is served: how long entering the motion takes. The poses above are then those in which they
    /// rest before that, and afterwards.
    pub enters: Option<Duration>,
}

impl Turned {
    /// The users of a plan, where it has the vehicles hold their poses: as listed.
    fn standing(plan: &Plan, usual: Duration) -> Vec<Self> {
        let slots = plan.slots.iter().zip(plan.lengths(usual)).enumerate();
        let users = slots.map(|(user_index, (slot, length))| Self {
            user_index,
            ends: [slot.plan.vehicles.map(|vehicle| vehicle.pose); 2],
            length,
            carries_on_after: None,
            enters: None,
        });
        users.collect()
    }

    /// The users of a plan, where it has the vehicles turn on the air; `None` where they hold their poses.
    fn turning(router: &Router, plan: &Plan, guard: Duration) -> Option<Vec<Self>> {
        let turns = plan.turns.as_ref()?;
        let limits = PerVehicle::from_fn(|role| router.limits(role).of_motion());
        Self::of(turns, &plan.tracks(guard.as_secs_f64(), &limits), guard)
    }

    /// The users of a plan, where it has the vehicles turn on the air.
    fn of(turns: &Protected, tracks: &[PerVehicle<Track>], guard: Duration) -> Option<Vec<Self>> {
        let guard_s = guard.as_secs_f64();
        let before = |place: usize| &turns.slots[(place + turns.slots.len() - 1) % turns.slots.len()];
        let users = turns.slots.iter().zip(tracks).enumerate().map(|(place, (slot, tracks))| {
            let poses = |knot: &Knot, rests_s: fn(&Way) -> f64| {
                PerVehicle::from_fn(|role| {
                    let pose = knot.vehicles[role].pose;
                    let rests = tracks[role].way().map(|way| way.spot(rests_s(way)).position_enu_m);
                    Pose { position_enu_m: rests.unwrap_or(pose.position_enu_m), ..pose }
                })
            };
            let enters = Role::BOTH.iter().filter_map(|role| Some(tracks[*role].way()?.enters_s()));
            let carries_on = matches!(before(place).between, Between::Turn(_));
            let after_s = (before(place).silence_s - guard_s).max(0.0);
            Some(Self {
                user_index: slot.user,
                ends: [poses(slot.knots.first()?, Way::entry_s), poses(slot.knots.last()?, Way::exit_s)],
                length: Duration::try_from_secs_f64(slot.on_air_s + guard_s).ok()?,
                carries_on_after: Duration::try_from_secs_f64(after_s).ok().filter(|_| carries_on),
                enters: enters.reduce(f64::max).and_then(|s| Duration::try_from_secs_f64(s).ok()),
            })
        });
        users.collect()
    }
}

/// All slots of a mission in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// One for each slot.
    pub entries: Vec<Entry>,
    /// When the last slot closes.
    pub ends: Duration,
}

impl Table {
    /// The table of a plan, from `start`.
    ///
    /// # Errors
    /// As [`build`](Self::build).
    pub fn of_plan(
        router: &Router,
        start: &PerVehicle<Start>,
        plan: &Plan,
        timing: &Timing,
        order: Order,
    ) -> Result<Self, TableError> {
        if let Some(users) = Turned::turning(router, plan, timing.guard) {
            return Self::turned(router, start, &users, timing);
        }
        let users: Vec<_> = plan.slots.iter().map(|slot| vec![slot.plan.vehicles.map(|v| v.pose)]).collect();
        Self::with_lengths(router, start, &users, &plan.lengths(timing.slot), timing, order)
    }

    /// The table of users who are served through the vehicles' turns, in their order, `timing.superframes` times over.
    ///
    /// # Errors
    /// As [`build`](Self::build).
    pub fn turned(
        router: &Router,
        start: &PerVehicle<Start>,
        users: &[Turned],
        timing: &Timing,
    ) -> Result<Self, TableError> {
        check(users.len(), users.len(), users.iter().map(|user| user.length), timing)?;
        let visits = (0..timing.superframes).flat_map(|_| users);
        Self::visiting(Vec::new(), router, start, visits, timing)
    }

    /// The same slots, by another plan from this one on: from where the vehicles rest, with each user served when it would have been.
    /// The plan has the same users, and where it has the vehicles turn on the air it serves them in this table's order.
    ///
    /// # Errors
    /// [`TableError::Transit`] where there is no way.
    pub fn resumed(
        &self,
        slot: u16,
        router: &Router,
        from: &PerVehicle<Start>,
        plan: &Plan,
        timing: &Timing,
    ) -> Result<Self, TableError> {
        let users = Turned::turning(router, plan, timing.guard)
            .unwrap_or_else(|| Turned::standing(plan, timing.slot));
        let (over, left) = self.entries.split_at(self.entries.len().min(slot.into()));
        let visits =
            left.iter().filter_map(|entry| users.iter().find(|user| user.user_index == entry.user_index));
        Self::visiting(over.to_vec(), router, from, visits, timing)
    }

    /// Slots that follow others.
    fn visiting<'a>(
        mut entries: Vec<Entry>,
        router: &Router,
        start: &PerVehicle<Start>,
        visits: impl Iterator<Item = &'a Turned>,
        timing: &Timing,
    ) -> Result<Self, TableError> {
        let hover = |pose: Pose| Start { position_enu_m: pose.position_enu_m, attitude: pose.attitude() };
        let first = u16::try_from(entries.len()).unwrap_or(u16::MAX);
        let mut before: Option<&Turned> = None;
        for (slot, user) in (first..=u16::MAX).zip(visits) {
            let from = match before {
                None => *start,
                Some(before) if user.enters.is_some() => PerVehicle::from_fn(|role| Start {
                    attitude: before.ends[1][role].attitude(),
                    ..hover(user.ends[0][role])
                }),
                Some(before) => before.ends[1].map(hover),
            };
            let transit = router.plan(&from, &user.ends[0]).map_err(|source| TableError::Transit {
                from: before.map(|before| before.user_index),
                to: user.user_index,
                source,
            })?;
            let closed = entries.last().map_or(Duration::ZERO, |entry| entry.closes);
            let leaves = user.ends[1].map(hover);
            let carries_on_after = before.and(user.carries_on_after);
            let enters = user.enters.unwrap_or_default();
            let way = Coming { transit, enters, leaves, carries_on_after };
            entries.push(Entry::new(slot, (user.user_index, 0), way, closed, user.length, timing));
            before = Some(user);
        }
        Ok(Self::ended(entries))
    }

    fn ended(entries: Vec<Entry>) -> Self {
        let ends = entries.last().map_or(Duration::ZERO, |entry| entry.closes);
        Self { entries, ends }
    }

    /// The table of a mission: from `start` through every user's poses, `timing.superframes` times over. `users` are in
    /// the mission's order; a user with several candidates is served from the one that makes transits short.
    ///
    /// # Errors
    /// [`TableError`] if there is nothing to do, a slot has no airtime, or a transit does not exist.
    pub fn build(
        router: &Router,
        start: &PerVehicle<Start>,
        users: &[Vec<PerVehicle<Pose>>],
        timing: &Timing,
        order: Order,
    ) -> Result<Self, TableError> {
        Self::with_lengths(router, start, users, &vec![timing.slot; users.len()], timing, order)
    }

    /// The same with slots of different lengths, one for each user, in place of the timing's.
    ///
    /// # Errors
    /// As [`build`](Self::build).
    pub fn with_lengths(
        router: &Router,
        start: &PerVehicle<Start>,
        users: &[Vec<PerVehicle<Pose>>],
        lengths: &[Duration],
        timing: &Timing,
        order: Order,
    ) -> Result<Self, TableError> {
        let served = users.iter().filter(|candidates| !candidates.is_empty()).count();
        check(users.len(), served, lengths.iter().copied(), timing)?;
        let superframes = timing.superframes;
        let mut legs = Legs::new(router, Some(start), users);
        let tour = legs.tour(superframes, order)?;
        entries(&mut legs, &tour, lengths, timing)
    }

    /// Has a slot served from other poses, to which the vehicles come from where they rest; what is after it begins as much later,
    /// or sooner.
    ///
    /// # Errors
    /// [`TransitError`] where there is no way to these poses, and nothing is changed.
    pub fn reroute(
        &mut self,
        router: &Router,
        slot: u16,
        from: &PerVehicle<Start>,
        poses: &PerVehicle<Pose>,
        timing: &Timing,
    ) -> Result<(), TransitError> {
        let index = usize::from(slot);
        let Some(old) = self.entries.get(index).cloned() else { return Ok(()) };
        let transit = router.plan(from, poses)?;
        let leaves = PerVehicle::from_fn(|role| transit.trajectories[role].end());
        let way = Coming { transit, enters: Duration::ZERO, leaves, carries_on_after: None };
        let user = (old.user_index, old.candidate);
        let length = old.closes.saturating_sub(old.opens);
        let new = Entry::new(slot, user, way, old.transit_starts, length, timing);
        let moved = |t: Duration| (t + new.closes).saturating_sub(old.closes);
        for entry in &mut self.entries[index + 1..] {
            for t in [
                &mut entry.transit_starts,
                &mut entry.opens,
                &mut entry.closes,
                &mut entry.radiate_from,
                &mut entry.radiate_until,
            ] {
                *t = moved(*t);
            }
        }
        self.ends = moved(self.ends);
        self.entries[index] = new;
        Ok(())
    }

    /// The entry of the slot or transit in progress at `t` since the mission's start; `None` after the end.
    #[must_use]
    pub fn at(&self, t: Duration) -> Option<&Entry> {
        self.entries.get(self.entries.partition_point(|entry| entry.closes <= t))
    }
}

/// Whether there is anything to do, and time to do it in.
fn check(
    users: usize,
    served: usize,
    mut lengths: impl Iterator<Item = Duration>,
    timing: &Timing,
) -> Result<(), TableError> {
    let superframes = timing.superframes;
    if served == 0 || served < users || superframes == 0 {
        return Err(TableError::Empty { users: served, superframes });
    }
    let slots = users.saturating_mul(usize::from(superframes));
    if slots > usize::from(u16::MAX) {
        return Err(TableError::TooMany { slots, limit: u16::MAX });
    }
    if let Some(slot) = lengths.find(|slot| timing.guard >= *slot) {
        let (slot_s, guard_s) = (slot.as_secs_f64(), timing.guard.as_secs_f64());
        return Err(TableError::NoAirtime { slot_s, guard_s });
    }
    Ok(())
}

/// Strings the tour's transits and slots together.
fn entries(legs: &mut Legs, tour: &Tour, lengths: &[Duration], timing: &Timing) -> Result<Table, TableError> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut before = None;
    let visits = (0..timing.superframes).flat_map(|_| &tour.visits);
    for (slot, &(user_index, place)) in (0..=u16::MAX).zip(visits) {
        let transit = legs.transit(before, place)?;
        let leaves = PerVehicle::from_fn(|role| transit.trajectories[role].end());
        let way = Coming { transit, enters: Duration::ZERO, leaves, carries_on_after: None };
        let closed = entries.last().map_or(Duration::ZERO, |entry| entry.closes);
        let length = lengths.get(user_index).copied().unwrap_or(timing.slot);
        let user = (user_index, legs.candidate(user_index, place));
        entries.push(Entry::new(slot, user, way, closed, length, timing));
        before = Some(place);
    }
    Ok(Table::ended(entries))
}

/// How both vehicles come to a slot, and where they leave it.
struct Coming {
    transit: Transit,
    /// What entering a motion takes, after the transit and the time to settle.
    enters: Duration,
    leaves: PerVehicle<Start>,
    carries_on_after: Option<Duration>,
}

impl Entry {
    /// A slot after one that has closed at `closed`.
    fn new(
        slot: u16,
        (user_index, candidate): (usize, usize),
        way: Coming,
        closed: Duration,
        length: Duration,
        timing: &Timing,
    ) -> Self {
        let Coming { transit, enters, leaves, carries_on_after } = way;
        let rested = closed.saturating_add(transit.duration()).saturating_add(timing.settle);
        let rested = rested.saturating_add(enters);
        let opens = carries_on_after.map_or_else(|| rounded_up(rested), |after| closed.saturating_add(after));
        let closes = opens.saturating_add(length);
        Self {
            slot,
            user_index,
            candidate,
            lead: rounded_up(rested).saturating_sub(closed),
            transit: transit.trajectories,
            separation: transit.separation,
            leaves,
            carries_on_after,
            transit_starts: closed,
            opens,
            closes,
            radiate_from: opens.saturating_add(timing.guard / 2),
            radiate_until: closes.saturating_sub(timing.guard / 2),
        }
    }
}

/// `t` rounded up to the grid.
fn rounded_up(t: Duration) -> Duration {
    let grid_ns = GRID.as_nanos();
    let cells = t.as_nanos().div_ceil(grid_ns);
    u64::try_from(cells * grid_ns).map_or(Duration::MAX, Duration::from_nanos)
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::geo::{Attitude, Enu};
    use crate::schedule::testing;
    use crate::schedule::transit::End;

    const S: fn(f64) -> Duration = Duration::from_secs_f64;
    const TIMING: Timing = Timing::new(Duration::from_secs(20), Duration::from_secs(1), 2);

    fn start() -> PerVehicle<Start> {
        let at = |x| Start { position_enu_m: Enu::new(x, 0.0, 40.0), attitude: Attitude::level() };
        PerVehicle { i: at(0.0), j: at(20.0) }
    }

    /// Both vehicles level, I at `x`, J 20 m further east.
    fn poses(x: f64) -> PerVehicle<Pose> {
        let at =
            |x| Pose { position_enu_m: Enu::new(x, 0.0, 40.0), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        PerVehicle { i: at(x), j: at(x + 20.0) }
    }

    fn built(users: &[Vec<PerVehicle<Pose>>], timing: &Timing, order: Order) -> Result<Table, TableError> {
        Table::build(&testing::router(), &start(), users, timing, order)
    }

    /// Other poses from the second slot of four on: those before are as they were, those after serve the same users, in time.
    #[test]
    fn val_a_table_goes_on_by_another_plan_from_where_the_vehicles_rest() {
        let plan = |metres: f64| {
            let slot = |user: &str, y: f64| {
                let pose = |p: Pose| Pose { position_enu_m: p.position_enu_m + Enu::new(0.0, y, 0.0), ..p };
                crate::planner::slots::testing::slot(user, &poses(0.0).map(pose))
            };
            Plan::new(vec![slot("a", metres), slot("b", metres + 50.0)])
        };
        let table =
            Table::of_plan(&testing::router(), &start(), &plan(100.0), &TIMING, Order::Listed).unwrap();
        let rest = PerVehicle::from_fn(|role| table.entries[0].leaves[role]);
        let other = table.resumed(1, &testing::router(), &rest, &plan(0.0), &TIMING).unwrap();
        assert_eq!(other.entries[0], table.entries[0]);
        let (of, was) = (&other.entries[1..], &table.entries[1..]);
        let users = |entries: &[Entry]| entries.iter().map(|e| (e.slot, e.user_index)).collect::<Vec<_>>();
        assert_eq!((of.len(), users(of)), (3, users(was)));
        assert_eq!(of[0].transit_starts, table.entries[0].closes);
        assert_eq!(of[0].transit.i.sample(Duration::ZERO).position_enu_m, rest.i.position_enu_m);
        // 50 m south instead of 50 m north.
        assert_eq!((of[0].opens, of[0].leaves.i.position_enu_m.y), (was[0].opens, 50.0));
        assert_eq!(other.ends, table.ends);
        // The same plan from where its own slot ended is no other table.
        assert_eq!(table.resumed(1, &testing::router(), &rest, &plan(100.0), &TIMING).unwrap(), table);
        assert_eq!(table.resumed(9, &testing::router(), &rest, &plan(0.0), &TIMING).unwrap(), table);
    }

    #[test]
    fn val_times_of_two_users_in_two_superframes() {
        // North, so that the vehicles fly side by side: 100 m take 4 + 10 s, 50 m take 4 + 5 s.
        let north = |y: f64| {
            vec![poses(0.0).map(|p| Pose { position_enu_m: p.position_enu_m + Enu::new(0.0, y, 0.0), ..p })]
        };
        let table = built(&[north(100.0), north(150.0)], &TIMING, Order::Listed).unwrap();
        let times: Vec<_> =
            table.entries.iter().map(|e| (e.slot, e.user_index, e.transit_starts, e.opens)).collect();
        let expected = [
            (0, 0, S(0.0), S(17.0)),
            (1, 1, S(37.0), S(49.0)),
            (2, 0, S(69.0), S(81.0)),
            (3, 1, S(101.0), S(113.0)),
        ];
        assert_eq!(times, expected);
        for entry in &table.entries {
            assert_eq!(entry.closes, entry.opens + S(20.0));
            assert_eq!(
                (entry.radiate_from, entry.radiate_until),
                (entry.opens + S(0.5), entry.closes - S(0.5))
            );
        }
        assert_eq!(table.ends, S(133.0));
        let slot_at = |t| table.at(S(t)).map(|e| e.slot);
        assert_eq!(
            [slot_at(0.0), slot_at(36.9), slot_at(37.0), slot_at(132.9), slot_at(133.0)],
            [Some(0), Some(0), Some(1), Some(3), None]
        );
    }

    #[test]
    fn val_slots_of_different_lengths() {
        let north = |y: f64| {
            vec![poses(0.0).map(|p| Pose { position_enu_m: p.position_enu_m + Enu::new(0.0, y, 0.0), ..p })]
        };
        let users = [north(100.0), north(150.0)];
        let built = |lengths: &[f64]| {
            let lengths: Vec<_> = lengths.iter().map(|s| S(*s)).collect();
            Table::with_lengths(&testing::router(), &start(), &users, &lengths, &TIMING, Order::Listed)
        };
        let table = built(&[30.0, 5.0]).unwrap();
        let times: Vec<_> = table.entries.iter().map(|e| (e.opens, e.radiate_until, e.closes)).collect();
        let expected = [(17.0, 47.0), (59.0, 64.0), (76.0, 106.0), (118.0, 123.0)];
        assert_eq!(times, expected.map(|(opens, closes)| (S(opens), S(closes - 0.5), S(closes))));
        assert_eq!(table.ends, S(123.0));
        assert_eq!(built(&[30.0, 1.0]), Err(TableError::NoAirtime { slot_s: 1.0, guard_s: 1.0 }));
    }

    #[test]
    fn spec_openings_are_rounded_up_to_a_tenth() {
        for (t_s, expected_s) in [(0.0, 0.0), (0.1, 0.1), (0.100_000_001, 0.2), (17.03, 17.1)] {
            assert_eq!(rounded_up(S(t_s)), S(expected_s));
        }
        assert_eq!(rounded_up(Duration::MAX), Duration::MAX);
    }

    #[test]
    fn spec_the_shortest_order_and_the_nearest_candidate() {
        let users = [vec![poses(300.0)], vec![poses(100.0)], vec![poses(-400.0), poses(200.0)]];
        let users_of =
            |table: &Table| table.entries.iter().map(|e| (e.user_index, e.candidate)).collect::<Vec<_>>();
        let once = Timing { superframes: 1, ..TIMING };
        let shortest = built(&users, &once, Order::Shortest).unwrap();
        assert_eq!(users_of(&shortest), [(1, 0), (2, 1), (0, 0)]);
        let listed = built(&users, &once, Order::Listed).unwrap();
        assert_eq!(users_of(&listed), [(0, 0), (1, 0), (2, 1)]);
        assert!(shortest.ends < listed.ends);
    }

    #[test]
    fn spec_what_cannot_be_scheduled_is_refused_with_numbers() {
        let users = [vec![poses(0.0)], vec![poses(495.0)]];
        assert_eq!(built(&[], &TIMING, Order::Listed), Err(TableError::Empty { users: 0, superframes: 2 }));
        assert_eq!(
            built(&[vec![]], &TIMING, Order::Shortest),
            Err(TableError::Empty { users: 0, superframes: 2 })
        );
        let timing = Timing { superframes: 40_000, ..TIMING };
        assert_eq!(
            built(&users, &timing, Order::Listed),
            Err(TableError::TooMany { slots: 80_000, limit: 65_535 })
        );
        let timing = Timing { guard: S(20.0), ..TIMING };
        assert_eq!(
            built(&users, &timing, Order::Listed),
            Err(TableError::NoAirtime { slot_s: 20.0, guard_s: 20.0 })
        );
        for order in [Order::Listed, Order::Shortest] {
            let Err(TableError::Transit { to: 1, source, .. }) = built(&users, &TIMING, order) else {
                panic!("user 1's J lies 15 m outside");
            };
            assert!(
                matches!(source, TransitError::Outside { role: Role::J, end: End::Goal, .. }),
                "{source}"
            );
        }
        let error = built(&users, &TIMING, Order::Listed).unwrap_err().to_string();
        assert!(
            error.starts_with("from user 0 to user 1: vehicle J: the goal (515.00, 0.00, 40.00) is 15.00 m"),
            "{error}"
        );
    }

    #[test]
    fn prop_tables_hang_together_and_are_the_same_twice() {
        let mut rng = testing::rng(9);
        for _ in 0..40 {
            let users: Vec<_> = (0..rng.random_range(1..6))
                .map(|_| {
                    let mut place = || Pose {
                        position_enu_m: Enu::from_fn(|k, _| {
                            rng.random_range(if k == 2 { 30.0..100.0 } else { -300.0..300.0 })
                        }),
                        roll_rad: rng.random_range(-1.5..1.5),
                        pitch_rad: rng.random_range(-1.5..1.5),
                        yaw_rad: 0.0,
                    };
                    vec![PerVehicle { i: place(), j: place() }]
                })
                .collect();
            let timing = Timing { superframes: rng.random_range(1..4), ..TIMING };
            for order in [Order::Listed, Order::Shortest] {
                let table = built(&users, &timing, order).unwrap();
                assert_eq!(built(&users, &timing, order), Ok(table.clone()));
                assert_eq!(table.entries.len(), users.len() * usize::from(timing.superframes));
                let mut at = start();
                let mut now = Duration::ZERO;
                for (k, entry) in table.entries.iter().enumerate() {
                    assert_eq!((usize::from(entry.slot), entry.transit_starts), (k, now));
                    for role in Role::BOTH {
                        let trajectory = &entry.transit[role];
                        let first = trajectory.sample(Duration::ZERO);
                        assert_eq!(
                            (first.position_enu_m, first.attitude),
                            (at[role].position_enu_m, at[role].attitude)
                        );
                        assert!(entry.transit_starts + trajectory.duration() + timing.settle <= entry.opens);
                        let pose = users[entry.user_index][0][role];
                        at[role] = trajectory.end();
                        assert_eq!(
                            (at[role].position_enu_m, at[role].attitude),
                            (pose.position_enu_m, pose.attitude())
                        );
                    }
                    now = entry.closes;
                }
                assert_eq!(table.ends, now);
            }
        }
    }
}
