//! Vehicle state that is late: what it means for power, well before it means anything for the flight.
//!
//! A vehicle whose state does not come may be anywhere, and one whose state comes from long ago may be as well (S4). So
//! two things are judged: how long the next message is overdue, by receipt, and how old the newest sample is, by the
//! autopilot's own clock, at the most. I is off as soon as a message is [`LATE`] overdue, or the sample nearly as old as
//! may be. J must not leave I uncovered for a hiccup of its own link: then it says that it is about to fall silent,
//! vouches no more, and is off only [`LOST`] after the first message that did not come, or at the limit of age, when I is
//! off already. Over a slow pair link it may not be: while I may rest on a lease, J jams on to the limit (S3).
//!
//! Once state was lost, what comes first may be from long ago, one sample after the other, and the vehicle may have gone without setpoints
//! meanwhile: who is off stays off for [`REGAINED`].
//!
//! Lateness is judged at timeouts alone, never at a message: a process that was not run finds messages at its door, and
//! the state that it misses may be the next of them.

use std::time::Duration;

use crate::role::Role;
use crate::time::Instant;

use super::evidence::Vehicle;

/// Overdue for so long, state is late.
const LATE: Duration = Duration::from_millis(30);
/// Overdue for so long, it is lost: S4's 100 ms less the way of the command.
const LOST: Duration = Duration::from_millis(70);
/// So often I is told of it that may rest on our jamming.
const TOLD_EVERY: Duration = Duration::from_millis(40);
/// State that was lost has to come for so long before this vehicle goes on the air on it: where setpoints failed as well, the track leaves
/// the vehicle behind for as long as it follows late, and one that is within its tolerance then is about to leave it.
const REGAINED: Duration = Duration::from_millis(300);
/// So much before the limit of age a sample counts as late.
const AGEING: Duration = Duration::from_millis(40);

/// State that is overdue for so long silences this vehicle, where nothing else holds it on the air.
#[must_use]
pub fn silences_after(role: Role) -> Duration {
    match role {
        Role::I => LATE,
        Role::J => LOST,
    }
}

/// How old a vehicle's state may become.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Freshness {
    /// State that was taken longer ago, or received, is never used.
    pub limit: Duration,
    /// How much later than planned a busy machine may run the process.
    pub scheduling_allowance: Duration,
}

/// How late state may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Allowed {
    /// Not late.
    InTime,
    /// Late, but not lost.
    Late,
    /// Lost, but not older than it may ever be.
    Lost,
}

/// Judges the age of the vehicle's state.
#[derive(Debug, Clone)]
pub(super) struct Staleness {
    freshness: Freshness,
    received_at: Option<Instant>,
    taken_from: Option<Instant>,
    period: Duration,
    /// When it came again after it was lost.
    regained_at: Option<Instant>,
    /// The last timeout: the instant at which state may count as late.
    judged_at: Instant,
    /// J: when I was told last that our state is late.
    pub told_at: Option<Instant>,
}

impl Staleness {
    pub fn new(freshness: Freshness, now: Instant) -> Self {
        Self {
            freshness,
            received_at: None,
            taken_from: None,
            period: Duration::ZERO,
            regained_at: None,
            judged_at: now,
            told_at: None,
        }
    }

    /// Takes in when the newest state came, and since when it is.
    pub fn feed(&mut self, vehicle: &Vehicle) {
        let lost_from = self.received_at.map(|at| at + self.silence(LOST));
        if vehicle.state_received_at.zip(lost_from).is_some_and(|(at, lost_from)| lost_from <= at) {
            self.regained_at = vehicle.state_received_at;
        }
        self.received_at = vehicle.state_received_at;
        self.taken_from = vehicle.state_taken_from;
        self.period = vehicle.state_period;
    }

    /// Judges from now on at `now`.
    pub fn judge_at(&mut self, now: Instant) {
        self.judged_at = now;
    }

    /// When the newest state becomes later than that; `None` without one. Time overdue counts from when the next message
    /// was due, age from when the sample was taken.
    fn ends_at(&self, allowed: Allowed) -> Option<Instant> {
        let limit = self.freshness.limit;
        let (overdue, age) = match allowed {
            Allowed::InTime => (LATE, limit.saturating_sub(AGEING)),
            Allowed::Late => (LOST, limit),
            Allowed::Lost => (limit, limit),
        };
        Some((self.received_at? + self.silence(overdue)).min(self.taken_from? + age))
    }

    /// How long nothing has come once the next message is so much overdue.
    fn silence(&self, overdue: Duration) -> Duration {
        (self.period + self.freshness.scheduling_allowance + overdue).min(self.freshness.limit)
    }

    /// Whether a vehicle that is off may go on the air on the newest state: it has not been lost just before.
    pub fn may_begin(&self, now: Instant) -> bool {
        self.regained_at.is_none_or(|at| at + REGAINED <= now)
    }

    fn is(&self, allowed: Allowed) -> bool {
        self.ends_at(allowed).is_some_and(|end| self.judged_at < end)
    }

    /// Whether the newest state is recent enough to radiate on it. `owed`: I may rest on our jamming.
    pub fn may_radiate(&self, role: Role, owed: bool) -> bool {
        self.is(match role {
            Role::I => Allowed::InTime,
            Role::J if owed => Allowed::Lost,
            Role::J => Allowed::Late,
        })
    }

    /// Whether the state is late.
    pub fn is_late(&self) -> bool {
        !self.is(Allowed::InTime)
    }

    /// Whether the state may be used for anything at `now`.
    pub fn is_fresh(&self, now: Instant) -> bool {
        let recent =
            |at: Option<Instant>| at.is_some_and(|at| now.saturating_since(at) <= self.freshness.limit);
        recent(self.received_at) && recent(self.taken_from)
    }

    /// J: whether I is to be told that the state is late: at once, and again while it may rest on our jamming.
    pub fn is_to_be_told(&self, owed: bool, now: Instant) -> bool {
        self.told_at.is_none_or(|told_at| owed && told_at + TOLD_EVERY <= now)
    }

    /// When late or lost state will have to be acted on, if none comes. `owed_until`: I may rest on our jamming.
    pub fn overdue_at(&self, owed_until: Option<Instant>) -> Option<Instant> {
        let Some(told_at) = self.told_at else { return self.ends_at(Allowed::InTime) };
        let off_at = self.ends_at(Allowed::Late).max(owed_until)?.min(self.ends_at(Allowed::Lost)?);
        let again_at =
            owed_until.map(|_| told_at + TOLD_EVERY).filter(|again_at| Some(*again_at) < owed_until);
        Some(again_at.map_or(off_at, |again_at| off_at.min(again_at)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    fn state_at(ms: u64) -> Vehicle {
        let period = Duration::from_millis(20);
        Vehicle {
            state_received_at: Some(at(ms)),
            state_taken_from: Some(at(ms)),
            state_period: period,
            ..Vehicle::default()
        }
    }

    /// Received at `ms`, taken `age_ms` before.
    fn aged_state_at(ms: u64, age_ms: u64) -> Vehicle {
        Vehicle { state_taken_from: Some(at(ms - age_ms)), ..state_at(ms) }
    }

    #[test]
    fn spec_i_is_off_30_ms_and_j_70_ms_after_the_message_that_did_not_come() {
        let limit = Duration::from_millis(250);
        let mut staleness = Staleness::new(Freshness { limit, scheduling_allowance: Duration::ZERO }, at(0));
        assert!(staleness.is_late() && !staleness.may_radiate(Role::J, false), "nothing has come yet");
        staleness.feed(&state_at(100));
        let mut judge = |ms| {
            staleness.judge_at(at(ms));
            (
                staleness.may_radiate(Role::I, false),
                staleness.may_radiate(Role::J, false),
                staleness.is_late(),
            )
        };
        assert_eq!(judge(149), (true, true, false));
        assert_eq!(judge(150), (false, true, true));
        assert_eq!(judge(189), (false, true, true));
        assert_eq!(judge(190), (false, false, true));
        assert_eq!(staleness.overdue_at(None), Some(at(150)));
        staleness.told_at = Some(at(150));
        assert_eq!(staleness.overdue_at(None), Some(at(190)));
        // A message does not make the present instant one at which lateness is judged.
        staleness.feed(&state_at(180));
        assert!(staleness.may_radiate(Role::I, false));
    }

    #[test]
    fn spec_state_that_was_lost_has_to_come_for_300_ms_before_a_vehicle_begins_on_it() {
        let limit = Duration::from_millis(250);
        let allowance = Duration::from_millis(10);
        for (gap_ms, regained) in [(20, false), (99, false), (100, true), (736, true)] {
            let mut staleness = Staleness::new(Freshness { limit, scheduling_allowance: allowance }, at(0));
            staleness.feed(&state_at(1000));
            assert!(staleness.may_begin(at(1000)), "the first one is none that was lost");
            let again_ms = 1000 + gap_ms;
            for (ms, begins) in [(0, !regained), (299, !regained), (300, true)] {
                staleness.feed(&state_at(again_ms));
                assert_eq!(staleness.may_begin(at(again_ms + ms)), begins, "{gap_ms} {ms}");
            }
        }
    }

    #[test]
    fn spec_no_allowance_makes_state_older_than_the_limit_fresh() {
        let limit = Duration::from_millis(250);
        let freshness = Freshness { limit, scheduling_allowance: Duration::from_secs(1) };
        let mut staleness = Staleness::new(freshness, at(0));
        staleness.feed(&state_at(0));
        staleness.judge_at(at(209));
        assert!(staleness.may_radiate(Role::I, false) && !staleness.is_late());
        staleness.judge_at(at(249));
        assert!(staleness.may_radiate(Role::J, false) && staleness.is_fresh(at(250)));
        staleness.judge_at(at(250));
        assert!(!staleness.may_radiate(Role::J, false) && !staleness.is_fresh(at(251)));
    }

    #[test]
    fn spec_state_that_comes_from_long_ago_silences_as_state_that_does_not_come() {
        let limit = Duration::from_millis(250);
        let mut staleness = Staleness::new(Freshness { limit, scheduling_allowance: Duration::ZERO }, at(0));
        for (age_ms, i, j) in [(0, true, true), (209, true, true), (210, false, true), (249, false, true)] {
            staleness.feed(&aged_state_at(1000, age_ms));
            staleness.judge_at(at(1000));
            assert_eq!(
                (staleness.may_radiate(Role::I, false), staleness.may_radiate(Role::J, false)),
                (i, j),
                "{age_ms}"
            );
            assert_eq!(staleness.is_late(), !i);
            assert!(staleness.is_fresh(at(1000)));
        }
        staleness.feed(&aged_state_at(1000, 250));
        assert!(!staleness.may_radiate(Role::J, false) && staleness.is_fresh(at(1000)));
        staleness.feed(&aged_state_at(1000, 251));
        assert!(!staleness.is_fresh(at(1000)));
        // Of unknown age it is of no use, however promptly it comes.
        staleness.feed(&Vehicle { state_taken_from: None, ..state_at(1000) });
        assert!(
            !staleness.may_radiate(Role::J, false) && staleness.is_late() && !staleness.is_fresh(at(1000))
        );
    }

    #[test]
    fn spec_age_is_acted_on_when_it_is_reached() {
        let limit = Duration::from_millis(250);
        let mut staleness = Staleness::new(Freshness { limit, scheduling_allowance: Duration::ZERO }, at(0));
        staleness.feed(&aged_state_at(1000, 190));
        assert_eq!(staleness.overdue_at(None), Some(at(1020)), "sooner than the next message is overdue");
        staleness.told_at = Some(at(1020));
        assert_eq!(staleness.overdue_at(None), Some(at(1060)));
    }

    #[test]
    fn spec_j_jams_on_to_the_limit_of_age_while_i_may_rest_on_it() {
        let limit = Duration::from_millis(250);
        let mut staleness = Staleness::new(Freshness { limit, scheduling_allowance: Duration::ZERO }, at(0));
        staleness.feed(&state_at(100));
        staleness.told_at = Some(at(150));
        for (ms, i, j) in [(149, true, true), (190, false, true), (349, false, true), (350, false, false)] {
            staleness.judge_at(at(ms));
            assert_eq!(
                (staleness.may_radiate(Role::I, true), staleness.may_radiate(Role::J, true)),
                (i, j),
                "{ms}"
            );
        }
        // It is told again meanwhile.
        for (told_ms, owed_ms, due_ms) in
            [(150, 120, 190), (150, 190, 190), (150, 500, 190), (250, 500, 290), (310, 500, 350)]
        {
            staleness.told_at = Some(at(told_ms));
            assert_eq!(staleness.overdue_at(Some(at(owed_ms))), Some(at(due_ms)));
        }
        for (owed, ms, told) in [(true, 349, false), (true, 350, true), (false, 350, false)] {
            assert_eq!(staleness.is_to_be_told(owed, at(ms)), told, "{owed} {ms}");
        }
    }

    #[test]
    fn val_state_that_does_not_come_silences_i_after_30_ms_and_j_after_70() {
        let limit = Duration::from_millis(250);
        for (role, ms) in [(Role::I, 30), (Role::J, 70)] {
            assert_eq!(silences_after(role), Duration::from_millis(ms));
            let mut staleness =
                Staleness::new(Freshness { limit, scheduling_allowance: Duration::ZERO }, at(0));
            staleness.feed(&state_at(100));
            for (late_ms, may) in [(ms - 1, true), (ms, false)] {
                staleness.judge_at(at(120 + late_ms));
                assert_eq!(staleness.may_radiate(role, false), may, "{role:?} {late_ms}");
            }
        }
    }
}
