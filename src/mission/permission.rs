//! The mission's permission to radiate: what is said of it, and whether it holds, now and to the mission's end.

use std::time::Duration;

use crate::preflight::{Check, Verdict, check};
use crate::time::Utc;

/// See the module.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Permission {
    /// Something real is radiated; else nothing needs a permission.
    pub real: bool,
    /// From when, and until when, it holds, if the mission says.
    pub valid: Option<[Utc; 2]>,
    /// All that the mission says of it, for the log.
    pub statement: String,
}

impl Permission {
    /// Whether anything may be radiated, by the time of the autopilot's clock.
    #[must_use]
    pub fn holds(&self, utc: Option<Utc>) -> bool {
        let within = |[from, until]: [Utc; 2]| utc.is_some_and(|utc| (from..until).contains(&utc));
        !self.real || self.valid.is_some_and(within)
    }

    /// The preflight's check, where something real is radiated. `emits_until`: when the last slot's airtime ends at the
    /// earliest, as far as that is known.
    pub(super) fn check(&self, utc: Option<Utc>, emits_until: Option<Utc>) -> Option<Check> {
        if !self.real {
            return None;
        }
        let fail = |detail: String| Some(check("emission", Verdict::Fail, detail));
        let Some([from, until]) = self.valid else {
            return fail("does not say when it is valid: give [emission] valid = [from, until]".to_owned());
        };
        let Some(utc) = utc else {
            return fail(format!(
                "is valid from {from} to {until}, and the time is not known: no UTC in SYSTEM_TIME, wait for GPS"
            ));
        };
        if utc < from {
            return fail(format!("is not valid before {from}"));
        }
        if utc >= until {
            return fail(format!("expired at {until}"));
        }
        match emits_until.filter(|end| *end > until) {
            Some(end) => fail(format!(
                "expires at {until}, should be valid to the end of the last slot, at {} at the earliest",
                Utc { unix_us: end.unix_us / MINUTE_US * MINUTE_US }
            )),
            None => Some(check("emission", Verdict::Pass, format!("valid until {until}"))),
        }
    }
}

/// Told by the minute, so that the text does not change with every look.
const MINUTE_US: u64 = 60_000_000;

/// When the last slot's airtime ends: `airtime` after the table begins, which is at `start`, or once the vehicles have
/// climbed.
pub(super) fn emits_until(utc: Utc, start: Option<Utc>, climb: Duration, airtime: Duration) -> Utc {
    start.unwrap_or(utc).max(utc + climb) + airtime
}

#[cfg(test)]
mod tests {
    use super::*;

    const FROM: Utc = Utc { unix_us: 1_800_000_000_000_000 };

    fn after(seconds: u64) -> Utc {
        FROM + Duration::from_secs(seconds)
    }

    fn permission(real: bool, valid: Option<[Utc; 2]>) -> Permission {
        Permission { real, valid, statement: String::new() }
    }

    #[test]
    fn spec_nothing_real_is_radiated_without_a_permission_that_holds_by_a_known_time() {
        let valid = Some([FROM, after(100)]);
        let before = Utc { unix_us: FROM.unix_us - 1 };
        for (real, valid, utc, holds) in [
            (false, None, None, true),
            (true, None, Some(after(1)), false),
            (true, valid, None, false),
            (true, valid, Some(before), false),
            (true, valid, Some(FROM), true),
            (true, valid, Some(after(99)), true),
            (true, valid, Some(after(100)), false),
        ] {
            assert_eq!(permission(real, valid).holds(utc), holds, "{real} {valid:?} {utc:?}");
        }
    }

    #[test]
    fn spec_the_preflight_says_why_and_an_expiry_during_the_mission_is_refused_beforehand() {
        let valid = permission(true, Some([FROM, after(100)]));
        let says = |utc, end| {
            let check = valid.check(utc, end).unwrap();
            (check.result, check.detail)
        };
        for (utc, end, text) in [
            (None, None, "the time is not known"),
            (Some(Utc { unix_us: FROM.unix_us - 1 }), None, "is not valid before 2027-01-15T08:00:00Z"),
            (Some(after(100)), None, "expired at 2027-01-15T08:01:40Z"),
            (
                Some(after(1)),
                Some(after(101)),
                "should be valid to the end of the last slot, at 2027-01-15T08:01:00Z",
            ),
        ] {
            let (result, detail) = says(utc, end);
            assert!(result == Verdict::Fail && detail.contains(text), "{detail}");
        }
        assert_eq!(says(Some(FROM), Some(after(100))).0, Verdict::Pass);
        assert_eq!(permission(false, None).check(None, None), None);
        assert!(
            permission(true, None).check(None, None).is_some_and(|check| check.detail.contains("valid = ["))
        );
    }

    #[test]
    fn val_the_last_airtime_is_counted_from_the_start_or_from_the_climb() {
        let (climb, airtime) = (Duration::from_secs(25), Duration::from_secs(60));
        assert_eq!(emits_until(after(0), None, climb, airtime), after(85));
        assert_eq!(emits_until(after(0), Some(after(300)), climb, airtime), after(360));
        // A start that cannot be met any more.
        assert_eq!(emits_until(after(290), Some(after(300)), climb, airtime), after(375));
    }
}
