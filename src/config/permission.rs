//! Whether a mission's permission to radiate holds when it is used, as far as files and this machine's clock can tell. On
//! the vehicle the preflight asks again, by the autopilot's clock.

use crate::time::Utc;

const RENEW: &str = "give [emission] valid = [from, until] of a permission that holds then, on both vehicles";
/// 2025-01-01T00:00:00Z: a clock that shows less was never set.
const NEVER_SET: Utc = Utc { unix_us: 1_735_689_600_000_000 };

/// What is wrong with the permission of a real transmitter, and what to do about it.
pub(super) fn fault(valid: Option<[Utc; 2]>, start: Option<Utc>) -> Option<(String, String)> {
    let Some([from, until]) = valid else {
        let message = "the transmitter is real, but the mission's [emission] does not say when it is valid";
        let help = "add valid = [from, until] to [emission], such as valid = [2026-01-01T00:00:00Z, 2026-12-31T23:59:59Z]";
        return Some((message.to_owned(), help.to_owned()));
    };
    let start = start.filter(|start| !(from..until).contains(start))?;
    let message = format!(
        "the transmitter is real, and the mission starts at {start}, but [emission] is valid from {from} to {until}"
    );
    Some((message, RENEW.to_owned()))
}

/// What is wrong with it at `now`, or at the mission's start.
pub(super) fn fault_at([from, until]: [Utc; 2], start: Option<Utc>, now: Utc) -> Option<(String, String)> {
    let period = format!("[emission] is valid from {from} to {until}");
    if now < NEVER_SET {
        let message = format!(
            "the transmitter is real, and {period}, but this machine's clock was never set: it shows {now}"
        );
        return Some((message, "set the clock, and check again".to_owned()));
    }
    if now >= until {
        let message = format!("the transmitter is real, but {period}: it has expired, it is {now}");
        return Some((message, RENEW.to_owned()));
    }
    // A start that is given was compared already.
    (now < from && start.is_none()).then(|| {
        let message = format!("the transmitter is real, but {period}: that has not begun, it is {now}");
        let help = "give tdma.start_utc if the mission is for later, or check again then".to_owned();
        (message, help)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY_US: u64 = 86_400_000_000;
    const FROM: Utc = Utc { unix_us: 1_767_225_600_000_000 };

    fn day(days: u64) -> Utc {
        Utc { unix_us: FROM.unix_us + days * DAY_US }
    }

    #[test]
    fn spec_a_permission_holds_from_its_first_instant_and_not_at_its_last() {
        let valid = [FROM, day(10)];
        let says = |start, now| fault_at(valid, start, now).map(|(message, _)| message).unwrap_or_default();
        assert_eq!([FROM, day(9)].map(|now| says(None, now)), ["", ""]);
        assert!(
            says(None, day(10)).contains("has expired")
                && says(Some(day(1)), day(11)).contains("has expired")
        );
        let early = Utc { unix_us: FROM.unix_us - 1 };
        assert!(says(None, early).contains("has not begun"));
        assert_eq!(says(Some(day(1)), early), "");
        assert!(says(Some(day(1)), Utc { unix_us: 1 }).contains("was never set"));
    }

    #[test]
    fn spec_a_start_outside_or_no_validity_is_refused_whatever_the_clock_says() {
        assert!(fault(None, None).is_some_and(
            |(message, help)| message.contains("when it is valid") && help.contains("valid = [")
        ));
        let valid = Some([FROM, day(10)]);
        assert_eq!(fault(valid, None), None);
        assert_eq!(fault(valid, Some(day(9))), None);
        for start in [Utc { unix_us: FROM.unix_us - 1 }, day(10)] {
            assert!(
                fault(valid, Some(start))
                    .is_some_and(|(message, _)| message.contains("the mission starts at"))
            );
        }
    }
}
