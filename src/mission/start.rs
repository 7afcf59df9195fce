//! What begins the mission without an operator's MISSION_START: `--start`, or a time in the mission file. Each counts
//! once, for a vehicle that has not flown since (F4). Pure.

use std::time::Duration;

use crate::time::{Instant, Utc};

/// On the ground until this long before the start, besides the climb: time to take control, to arm, to come to rest.
pub(super) const AHEAD: Duration = Duration::from_secs(20);
/// `--start` waits for both vehicles to be ready for this long.
const UNASKED_EXPIRES: Duration = Duration::from_secs(600);

/// Why nothing but a MISSION_START begins the mission any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Void {
    #[error("this vehicle has flown, or was recalled, since --start or start_utc were set")]
    Spent,
    #[error("the vehicle has been armed since the last one")]
    Armed,
    #[error("the start was taken back")]
    TakenBack,
    #[error("--start came to nothing within {} s", UNASKED_EXPIRES.as_secs())]
    Expired,
}

/// What a vehicle on which nothing else is missing waits for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Awaited {
    /// A MISSION_START, in words.
    Order(String),
    /// A time, in words that do not change by the second: a MISSION_START is refused before it.
    Time(String),
}

/// See the module.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    unasked_until: Option<Instant>,
    at: Option<Utc>,
    /// Whether the time was past when the companion first knew the time.
    missed: Option<bool>,
    void: Option<Void>,
}

impl Start {
    /// `unasked`: as soon as both vehicles are ready; `at`: at that time; `spent`: not so, for it was done before.
    pub fn new(unasked: bool, at: Option<Utc>, spent: bool, now: Instant) -> Self {
        let unasked_until = unasked.then(|| now + UNASKED_EXPIRES);
        let mut start = Self { unasked_until, at, missed: None, void: None };
        if spent && (unasked || at.is_some()) {
            start.void(Void::Spent);
        }
        start
    }

    /// Only a MISSION_START begins the mission from now on.
    pub fn void(&mut self, why: Void) {
        *self = Self { unasked_until: None, at: None, missed: None, void: Some(why) };
    }

    /// Whether the mission is to begin. `utc` is the present time, and `climb` how long it takes to be where the first
    /// transit begins.
    ///
    /// # Errors
    /// What is waited for.
    pub fn is_due(&mut self, utc: Option<Utc>, climb: Duration, now: Instant) -> Result<(), Awaited> {
        if self.unasked_until.is_some_and(|until| now > until) {
            self.void(Void::Expired);
        }
        if let Some(why) = self.void {
            return Err(Awaited::Order(format!("MISSION_START: {why}")));
        }
        let Some(at) = self.at else {
            return self.unasked_until.map(|_| ()).ok_or_else(|| Awaited::Order("MISSION_START".into()));
        };
        let Some(utc) = utc else { return Err(Awaited::Time(format!("UTC, for the start at {at}"))) };
        if *self.missed.get_or_insert(utc > at) {
            let past = format!("MISSION_START: the start at {at} was past when this companion started");
            return self.unasked_until.map(|_| ()).ok_or(Awaited::Order(past));
        }
        let ahead = AHEAD + climb;
        if utc + ahead >= at {
            return Ok(());
        }
        let seconds = ahead.as_secs();
        Err(Awaited::Time(format!("the start at {at}, with take-off {seconds} s before")))
    }

    /// When the first transit begins, if that is a matter of time: now, later, or before where the pair is late.
    pub fn table_zero(&self, utc: Utc, now: Instant) -> Option<Instant> {
        let at = self.at.filter(|_| self.missed == Some(false))?;
        Some(now + at.saturating_since(utc) - utc.saturating_since(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: Utc = Utc { unix_us: 1_800_000_000_000_000 };
    const CLIMB: Duration = Duration::from_secs(5);
    const NOW: Instant = Instant::ZERO;

    fn before(seconds: u64) -> Option<Utc> {
        Some(Utc { unix_us: AT.unix_us - seconds * 1_000_000 })
    }

    fn order(awaited: Result<(), Awaited>) -> String {
        match awaited {
            Err(Awaited::Order(text)) if text.starts_with("MISSION_START") => text,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn spec_without_a_time_the_operator_s_word_counts_or_the_flag() {
        let mut start = Start::new(false, None, false, NOW);
        assert_eq!(order(start.is_due(before(0), CLIMB, NOW)), "MISSION_START");
        assert_eq!(start.table_zero(AT, NOW), None);
        let mut start = Start::new(true, None, false, NOW);
        assert_eq!(start.is_due(None, CLIMB, NOW + UNASKED_EXPIRES), Ok(()));
        let late = start.is_due(None, CLIMB, NOW + UNASKED_EXPIRES + Duration::from_millis(1));
        assert!(order(late).contains("600 s"));
        assert!(start.is_due(None, CLIMB, NOW).is_err(), "once is once");
    }

    #[test]
    fn spec_what_was_voided_or_spent_waits_for_an_order_whatever_was_set() {
        for at in [None, Some(AT)] {
            let mut start = Start::new(true, at, false, NOW);
            start.void(Void::Armed);
            let mut spent = Start::new(true, at, true, NOW);
            for start in [&mut start, &mut spent] {
                assert!(order(start.is_due(before(10), CLIMB, NOW)).contains("since"));
                assert_eq!(start.table_zero(AT, NOW), None);
            }
        }
        assert_eq!(order(Start::new(false, None, true, NOW).is_due(None, CLIMB, NOW)), "MISSION_START");
    }

    #[test]
    fn spec_with_a_time_take_off_is_in_time_for_it_whatever_the_flag() {
        for unasked in [false, true] {
            let mut start = Start::new(unasked, Some(AT), false, NOW);
            let awaited = start.is_due(None, CLIMB, NOW);
            assert!(matches!(awaited, Err(Awaited::Time(text)) if text.starts_with("UTC")));
            let early = start.is_due(before(3600), CLIMB, NOW);
            let Err(Awaited::Time(text)) = &early else { panic!("{early:?}") };
            assert!(text.contains("2027-01-15T08:00:00Z") && text.contains("25 s before"), "{text}");
            assert_eq!(start.is_due(before(26), CLIMB, NOW), early, "the same words all the time");
            assert_eq!(start.is_due(before(25), CLIMB, NOW), Ok(()));
            // A preflight that took too long begins late.
            assert_eq!(start.is_due(Some(AT + CLIMB), CLIMB, NOW), Ok(()));
            let now = Instant::from_start(Duration::from_secs(100));
            assert_eq!(start.table_zero(before(10).unwrap(), now), Some(now + Duration::from_secs(10)));
            assert_eq!(start.table_zero(AT + CLIMB, now), Some(now - CLIMB));
        }
    }

    #[test]
    fn spec_a_time_in_the_past_takes_the_operator_s_word() {
        assert_eq!(
            Start::new(false, Some(AT), false, NOW).is_due(Some(AT), CLIMB, NOW),
            Ok(()),
            "not past yet"
        );
        let mut start = Start::new(false, Some(AT), false, NOW);
        let late = Some(AT + Duration::from_micros(1));
        assert!(order(start.is_due(late, CLIMB, NOW)).contains("past"));
        assert_eq!(start.table_zero(AT + CLIMB, NOW), None, "as without a time");
    }
}
