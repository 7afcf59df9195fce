//! What a mission waits for before it begins: the operator's word, or a time. Pure.

use std::time::Duration;

use crate::time::{Instant, Utc};

/// On the ground until this long before the start, besides the climb: time to take control, to arm, to come to rest.
const AHEAD: Duration = Duration::from_secs(20);

/// The start by an order or at a given time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    asked: bool,
    at: Option<Utc>,
    /// Whether the time was past when the companion first knew the time.
    missed: Option<bool>,
    /// The vehicle has been armed since whatever was asked for before.
    flown: bool,
}

impl Start {
    /// Waits for an order unless `asked` is true, or for the time.
    pub fn new(asked: bool, at: Option<Utc>) -> Self {
        Self { asked, at, missed: None, flown: false }
    }

    /// The operator wants the mission to begin. A time that is yet to come still holds.
    pub fn ask(&mut self) {
        self.asked = true;
    }

    /// The vehicle is armed, and not by this mission: the pilot flies it, or a companion that is no more did. What was
    /// asked for before, by an order, at the start of the process or by the clock, counts no more (F4).
    pub fn forget(&mut self) {
        *self = Self { flown: true, ..Self::new(false, None) };
    }

    /// What is waited for on the ground, in words that do not change by the second; `None`: take off. `utc` is the
    /// present time, and `climb` how long it takes to be where the first transit begins.
    pub fn waits_for(&mut self, utc: Option<Utc>, climb: Duration) -> Option<String> {
        let again = if self.flown { ": the vehicle has been armed since the last one" } else { "" };
        let order = (!self.asked).then(|| format!("MISSION_START{again}"));
        let Some(at) = self.at else { return order };
        let Some(utc) = utc else { return Some(format!("UTC, for the start at {at}")) };
        if *self.missed.get_or_insert(utc > at) {
            let past = |order| format!("{order}: the start at {at} was past when this companion started");
            return order.map(past);
        }
        let ahead = AHEAD + climb;
        let seconds = ahead.as_secs();
        (utc + ahead < at).then(|| format!("the start at {at}, with take-off {seconds} s before"))
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

    fn before(seconds: u64) -> Option<Utc> {
        Some(Utc { unix_us: AT.unix_us - seconds * 1_000_000 })
    }

    #[test]
    fn spec_without_a_time_the_operator_s_word_counts() {
        let mut start = Start::new(false, None);
        assert_eq!(start.waits_for(before(0), CLIMB).as_deref(), Some("MISSION_START"));
        start.ask();
        assert_eq!(start.waits_for(None, CLIMB), None);
        assert_eq!(start.table_zero(AT, Instant::ZERO), None);
        assert_eq!(Start::new(true, None).waits_for(None, CLIMB), None);
    }

    #[test]
    fn spec_a_vehicle_that_was_armed_by_another_hand_waits_for_a_new_order() {
        for at in [None, Some(AT)] {
            let mut start = Start::new(true, at);
            start.forget();
            let text = start.waits_for(before(3600), CLIMB).unwrap();
            assert!(text.contains("MISSION_START") && text.contains("armed"), "{text}");
            assert_eq!(start.table_zero(AT, Instant::ZERO), None);
            start.ask();
            assert_eq!(start.waits_for(before(3600), CLIMB), None);
        }
    }

    #[test]
    fn spec_with_a_time_take_off_is_in_time_for_it_whoever_asks() {
        for asked in [false, true] {
            let mut start = Start::new(asked, Some(AT));
            assert!(start.waits_for(None, CLIMB).is_some_and(|text| text.starts_with("UTC")));
            let text = start.waits_for(before(3600), CLIMB).unwrap();
            assert!(text.contains("2027-01-15T08:00:00Z") && text.contains("25 s before"), "{text}");
            assert_eq!(start.waits_for(before(26), CLIMB), Some(text), "the same words all the time");
            assert_eq!(start.waits_for(before(25), CLIMB), None);
            // A preflight that took too long begins late.
            assert_eq!(start.waits_for(Some(AT + CLIMB), CLIMB), None);
            let now = Instant::from_start(Duration::from_secs(100));
            assert_eq!(start.table_zero(before(10).unwrap(), now), Some(now + Duration::from_secs(10)));
            assert_eq!(start.table_zero(AT + CLIMB, now), Some(now - CLIMB));
        }
    }

    #[test]
    fn spec_a_time_in_the_past_takes_the_operator_s_word() {
        let mut start = Start::new(false, Some(AT));
        let late = Some(AT + Duration::from_micros(1));
        let text = start.waits_for(late, CLIMB).unwrap();
        assert!(text.contains("MISSION_START") && text.contains("past"), "{text}");
        start.ask();
        assert_eq!(start.waits_for(late, CLIMB), None);
        assert_eq!(start.table_zero(AT + CLIMB, Instant::ZERO), None, "as without a time");
    }
}
