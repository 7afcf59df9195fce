//! Numbers as a reader wants them.

use super::said::{Silence, lasting};
use super::timeline::{Event, EventKind};
use crate::desk::simulation::FaultKind;
use crate::role::Role;
use crate::time::Utc;

/// A length of time: milliseconds below one second.
#[must_use]
pub fn span(seconds: f64) -> String {
    if seconds < 0.9995 { format!("{:.0} ms", seconds * 1e3) } else { format!("{seconds:.2} s") }
}

/// An instant of the flight.
#[must_use]
pub fn instant(seconds: f64) -> String {
    format!("{seconds:.1} s")
}

/// A power with three significant figures.
#[must_use]
pub fn power(watts: f64) -> String {
    let (value, unit) = match watts {
        w if w >= 1.0 => (w, "W"),
        w if w >= 1e-3 => (w * 1e3, "mW"),
        w => (w * 1e6, "\u{b5}W"),
    };
    let decimals = match value {
        v if v >= 99.95 => 0,
        v if v >= 9.995 => 1,
        _ => 2,
    };
    format!("{value:.decimals$} {unit}")
}

/// `1 slot`, `2 slots`.
#[must_use]
pub fn count(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// First letter large.
#[must_use]
pub fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// A companion's reason for silence, for readers who do not know its words.
#[must_use]
pub fn gloss(why: Silence<'_>) -> String {
    match why {
        Silence::NoLease => {
            "no jam lease in force, for vehicle J had not renewed its promise to jam".to_owned()
        }
        Silence::OffStation => "vehicle I is not on station, or is not heard".to_owned(),
        Silence::Plain(why) => why.to_owned(),
    }
}

/// What happened, as a clause in the past.
#[must_use]
pub fn clause(event: &Event) -> String {
    let whose = event.vehicle.map_or("both vehicles'".to_owned(), |role| format!("vehicle {role}'s"));
    let lasting = lasting(&event.text).map_or(String::new(), |time| format!(" for {time}"));
    match event.fault() {
        Some(FaultKind::CompanionKill) => format!("{whose} companion was killed"),
        Some(FaultKind::CompanionStop) => format!("{whose} companion was frozen{lasting}"),
        Some(FaultKind::LinkLoss) => {
            format!("the link between {whose} autopilot and companion was cut{lasting}")
        }
        Some(FaultKind::PairLoss) => format!("the link between the two companions was cut{lasting}"),
        Some(FaultKind::CompanionRestart) => format!("{whose} companion was killed, to be started again"),
        Some(FaultKind::LinkDegraded) => {
            format!("the link between {whose} autopilot and companion became poor{lasting}")
        }
        Some(FaultKind::PairDegraded) => format!("the link between the two companions became poor{lasting}"),
        Some(FaultKind::DiskFull) => format!("the disk under {whose} logs was full{lasting}"),
        Some(FaultKind::WindStep) => format!("the wind at {} changed", whom(event.vehicle)),
        Some(FaultKind::TransmitterStuck) => format!("{whose} transmitter stuck"),
        Some(FaultKind::PilotMode) => format!("{whose} pilot took over"),
        Some(FaultKind::EstimatorFailure) => format!("{whose} position estimate failed"),
        _ if event.kind == EventKind::Fault => {
            format!("a fault struck {}: {}", whom(event.vehicle), event.text)
        }
        _ => format!("{} said: \u{201c}{}\u{201d}", speaker(event.vehicle), event.text),
    }
}

/// UTC as a date and a time of day, from microseconds since 1970.
#[must_use]
pub fn utc(unix_us: u64) -> String {
    // Without decimals of the second.
    let whole = Utc { unix_us: unix_us - unix_us % 1_000_000 };
    whole.to_string().replace('T', " ").replace('Z', " UTC")
}

/// Who says a notice.
#[must_use]
pub fn speaker(vehicle: Option<Role>) -> String {
    vehicle.map_or("both companions".to_owned(), |role| format!("vehicle {role}'s companion"))
}

fn whom(vehicle: Option<Role>) -> String {
    vehicle.map_or("both vehicles".to_owned(), |role| format!("vehicle {role}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_spans_and_counts() {
        assert_eq!(span(0.355), "355 ms");
        assert_eq!(span(0.9999), "1.00 s");
        assert_eq!((count(1, "slot"), count(0, "slot")), ("1 slot".into(), "0 slots".into()));
        assert_eq!(sentence("i fell"), "I fell");
        assert_eq!(
            (power(0.499_919), power(0.003_244_9), power(1.5)),
            ("500 mW".into(), "3.24 mW".into(), "1.50 W".into())
        );
        assert_eq!(sentence(""), "");
    }

    #[test]
    fn val_dates_of_known_instants() {
        assert_eq!(utc(0), "1970-01-01 00:00:00 UTC");
        assert_eq!(utc(951_827_696_000_000), "2000-02-29 12:34:56 UTC");
        assert_eq!(utc(1_800_014_400_000_000), "2027-01-15 12:00:00 UTC");
    }
}
