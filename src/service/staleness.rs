//! Vehicle state that is late: what it means for power, well before it means anything for the flight.
//!
//! A vehicle whose state does not come may be anywhere (S4). I is off as soon as a message is [`LATE`] overdue. J must
//! not leave I uncovered for a hiccup of its own link: then it says that it is about to fall silent, vouches no more,
//! and is off only [`LOST`] after the first message that did not come, when I is off already.
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

/// How old a vehicle's state may become.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Freshness {
    /// State that is older is never used.
    pub limit: Duration,
    /// How much later than planned a busy machine may run the process.
    pub scheduling_allowance: Duration,
}

/// Judges the age of the vehicle's state.
#[derive(Debug, Clone)]
pub(super) struct Staleness {
    freshness: Freshness,
    since: Option<Instant>,
    period: Duration,
    /// The last timeout: the instant at which state may count as late.
    judged_at: Instant,
    /// J: I has been told that our state is late.
    pub told: bool,
}

impl Staleness {
    pub fn new(freshness: Freshness, now: Instant) -> Self {
        Self { freshness, since: None, period: Duration::ZERO, judged_at: now, told: false }
    }

    /// Takes in when the newest state came.
    pub fn feed(&mut self, vehicle: &Vehicle) {
        self.since = vehicle.state_since;
        self.period = vehicle.state_period;
    }

    /// Judges from now on at `now`.
    pub fn judge_at(&mut self, now: Instant) {
        self.judged_at = now;
    }

    /// Ages count from the last message that came, overdue time from when the next was due.
    fn limit(&self, overdue: Duration) -> Duration {
        (self.period + self.freshness.scheduling_allowance + overdue).min(self.freshness.limit)
    }

    fn is_younger_than(&self, limit: Duration) -> bool {
        self.since.is_some_and(|since| self.judged_at.saturating_since(since) < limit)
    }

    /// Whether the newest state is recent enough to radiate on it.
    pub fn may_radiate(&self, role: Role) -> bool {
        let overdue = match role {
            Role::I => LATE,
            Role::J => LOST,
        };
        self.is_younger_than(self.limit(overdue))
    }

    /// Whether a message is overdue.
    pub fn is_late(&self) -> bool {
        !self.is_younger_than(self.limit(LATE))
    }

    /// Whether the state may be used for anything at `now`.
    pub fn is_fresh(&self, now: Instant) -> bool {
        self.since.is_some_and(|since| now.saturating_since(since) <= self.freshness.limit)
    }

    /// When late or lost state will have to be acted on, if none comes.
    pub fn overdue_at(&self) -> Option<Instant> {
        let limit = self.limit(if self.told { LOST } else { LATE });
        self.since.map(|since| since + limit)
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
        Vehicle { state_since: Some(at(ms)), state_period: period, ..Vehicle::default() }
    }

    #[test]
    fn spec_i_is_off_30_ms_and_j_70_ms_after_the_message_that_did_not_come() {
        let limit = Duration::from_millis(250);
        let mut staleness = Staleness::new(Freshness { limit, scheduling_allowance: Duration::ZERO }, at(0));
        assert!(staleness.is_late() && !staleness.may_radiate(Role::J), "nothing has come yet");
        staleness.feed(&state_at(100));
        let mut judge = |ms| {
            staleness.judge_at(at(ms));
            (staleness.may_radiate(Role::I), staleness.may_radiate(Role::J), staleness.is_late())
        };
        assert_eq!(judge(149), (true, true, false));
        assert_eq!(judge(150), (false, true, true));
        assert_eq!(judge(189), (false, true, true));
        assert_eq!(judge(190), (false, false, true));
        assert_eq!(staleness.overdue_at(), Some(at(150)));
        staleness.told = true;
        assert_eq!(staleness.overdue_at(), Some(at(190)));
        // A message does not make the present instant one at which lateness is judged.
        staleness.feed(&state_at(180));
        assert!(staleness.may_radiate(Role::I));
    }

    #[test]
    fn spec_no_allowance_makes_state_older_than_the_limit_fresh() {
        let limit = Duration::from_millis(250);
        let freshness = Freshness { limit, scheduling_allowance: Duration::from_secs(1) };
        let mut staleness = Staleness::new(freshness, at(0));
        staleness.feed(&state_at(0));
        staleness.judge_at(at(249));
        assert!(staleness.may_radiate(Role::I) && staleness.is_fresh(at(250)));
        staleness.judge_at(at(250));
        assert!(!staleness.may_radiate(Role::J) && !staleness.is_fresh(at(251)));
    }
}
