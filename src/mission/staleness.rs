//! Autopilot state that is late: what it means for power, well before it means anything for the flight.
//!
//! A vehicle whose state does not come may be anywhere (S4). I is off as soon as a message is [`LATE`] overdue. J must
//! not leave I uncovered for a hiccup of its own link: then it says that it is about to fall silent, vouches no more,
//! and is off only [`LOST`] after the first message that did not come, when I is off already.
//!
//! Lateness is judged at timeouts alone, never at a message: a process that was not run finds messages at its door, and
//! the state that it misses may be the next of them.

use std::time::Duration;

use crate::pair::wire::VeilwingSilence;
use crate::role::Role;
use crate::time::Instant;

use super::executive::Executive;

/// Overdue for so long, state is late.
const LATE: Duration = Duration::from_millis(30);
/// Overdue for so long, it is lost: S4's 100 ms less the way of the command.
const LOST: Duration = Duration::from_millis(70);

/// How old state may be: before it is late, and before it is lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Ages {
    late: Duration,
    lost: Duration,
}

impl Executive {
    /// Ages count from the last message that came, overdue time from when the next was due.
    fn ages(&self) -> Ages {
        let autopilot = &self.settings.autopilot;
        let allowed = self.autopilot.state_period() + autopilot.scheduling_allowance;
        let limit = |overdue: Duration| (allowed + overdue).min(autopilot.freshness);
        Ages { late: limit(LATE), lost: limit(LOST) }
    }

    /// Whether the newest state is recent enough to radiate on it.
    pub(super) fn may_radiate_on_state(&self) -> bool {
        let Ages { late, lost } = self.ages();
        let limit = if self.settings.role == Role::I { late } else { lost };
        self.autopilot.state_age(self.judged_at).is_some_and(|age| age < limit)
    }

    /// When late or lost state will have to be acted on, if none comes.
    pub(super) fn overdue_at(&self) -> Option<Instant> {
        let Ages { late, lost } = self.ages();
        let limit = if self.told_late { lost } else { late };
        self.autopilot.state_since().filter(|_| self.interlock.is_on()).map(|since| since + limit)
    }

    /// J: tells I that the jamming may end, as soon as state is late.
    pub(super) fn warn_if_late(&mut self, now: Instant) {
        let is_late = self.autopilot.state_age(self.judged_at).is_none_or(|age| age >= self.ages().late);
        if !is_late || !self.interlock.is_on() {
            self.told_late = false;
            return;
        }
        self.pair.set_vouch(None);
        if !std::mem::replace(&mut self.told_late, true) {
            self.pair.silent(VeilwingSilence::VEILWING_SILENCE_LINK, now);
        }
    }
}
