//! What a simulation in real time that could not keep up with its own clock has upset; everything else is judged by the
//! world itself.

use std::time::Duration;

use serde::Serialize;
use veilwing_sitl::{self as sim, Invariant, Violation};

/// What the world's lateness has upset is upset for this much longer: S4's reactions and the leases.
const AFTERWARDS: Duration = Duration::from_secs(1);
/// What depends on when something is heard, or on the radio's clock, which stands still while the world does: a command
/// that ends at an instant of it lasts so much longer then (S5). Powers and paths do not.
const TIMED: [Invariant; 7] =
    [Invariant::S1, Invariant::S2, Invariant::S3, Invariant::S4, Invariant::S5, Invariant::F2, Invariant::F3];

/// Why a violation does not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// One of the three that no companion can help.
    Named(sim::Cause),
    /// The world ran late: nothing in it is to be believed for a while. Never so in virtual time.
    WorldLate(Late),
}

impl Cause {
    /// As documents spell it.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Named(cause) => cause.name(),
            Self::WorldLate(_) => "world-late",
        }
    }

    /// Why it does not count, as a clause.
    #[must_use]
    pub fn describe(&self) -> String {
        match self {
            Self::Named(cause) => cause.describe().to_owned(),
            Self::WorldLate(Late { from, by }) => {
                format!("the world ran late by {} ms at {:.3} s", by.as_millis(), from.as_secs_f64())
            }
        }
    }
}

/// A violation that does not count.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(into = "ExcusedLine")]
pub struct Excused {
    /// What was seen.
    pub violation: Violation,
    /// Why it does not count.
    pub cause: Cause,
}

/// As documents have it.
#[derive(Debug, Serialize)]
struct ExcusedLine {
    #[serde(flatten)]
    violation: Violation,
    cause: &'static str,
    /// The same in words.
    why: String,
}

impl From<Excused> for ExcusedLine {
    fn from(Excused { violation, cause }: Excused) -> Self {
        Self { violation, cause: cause.name(), why: cause.describe() }
    }
}

/// A step in which a world in real time fell behind its clock: what it owed in between came all at once, at the end.
/// In virtual time there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Late {
    /// Flight time at which the step began.
    pub from: Duration,
    /// Flight time that it made up for.
    pub by: Duration,
}

/// Takes what a late world has upset out of the violations that count, and names why the others do not.
#[must_use]
pub fn judge(report: &mut sim::FlightReport, late: &[Late]) -> Vec<Excused> {
    let named =
        |excused: sim::Excused| Excused { violation: excused.violation, cause: Cause::Named(excused.cause) };
    let mut excused: Vec<_> = std::mem::take(&mut report.excused).into_iter().map(named).collect();
    report.violations.retain(|violation| {
        let upset = late_world(violation, late);
        excused.extend(upset.map(|late| Excused { violation: *violation, cause: Cause::WorldLate(late) }));
        upset.is_none()
    });
    excused
}

/// State that comes late silences vehicles rightly, one before the other; that it came late was not their doing.
fn late_world(violation: &Violation, late: &[Late]) -> Option<Late> {
    if !TIMED.contains(&violation.invariant()) {
        return None;
    }
    let upset = |step: &&Late| step.from <= violation.at && violation.at <= step.from + step.by + AFTERWARDS;
    late.iter().filter(upset).max_by_key(|step| step.by).copied()
}

#[cfg(test)]
mod tests {
    use veilwing_sitl::Breach;

    use super::*;

    fn report(violations: Vec<Violation>, excused: Vec<sim::Excused>) -> sim::FlightReport {
        let per_vehicle = || sim::PerVehicle { i: 0.0, j: 0.0 };
        sim::FlightReport {
            flight_s: 60.0,
            slots: Vec::new(),
            secrecy_volume_bits: 0.0,
            on_air_s: 0.0,
            outside_slots_s: per_vehicle(),
            unprotected_s: 0.0,
            emitted_out_of_pose_s: per_vehicle(),
            violations,
            excused,
            min_separation_m: None,
            battery_left: per_vehicle(),
        }
    }

    #[test]
    fn spec_a_late_world_excuses_what_depends_on_time_near_its_lateness_and_nothing_else() {
        let late = |from_s: u64, by_ms: u64| Late {
            from: Duration::from_secs(from_s),
            by: Duration::from_millis(by_ms),
        };
        let steps = [late(10, 40), late(30, 90), late(30, 60)];
        let after = Duration::ZERO;
        for (invariant, breach, at_s, expected) in [
            ("S3", Breach::JamLeft, 30.5, Some("the world ran late by 90 ms at 30.000 s")),
            ("S1", Breach::NoSlot, 31.05, Some("the world ran late by 90 ms at 30.000 s")),
            ("F2", Breach::TakesBack, 10.2, Some("the world ran late by 40 ms at 10.000 s")),
            ("S3", Breach::InfoFirst, 29.9, None),
            ("S3", Breach::InfoFirst, 31.2, None),
            ("S6", Breach::Power { power_w: 2.0, allowed_w: 1.0 }, 30.5, None),
            ("S5", Breach::Outlives { after }, 30.5, Some("the world ran late by 90 ms at 30.000 s")),
            ("F1", Breach::Near { distance_m: 1.0, least_m: 2.0 }, 30.5, None),
        ] {
            let at = Duration::from_secs_f64(at_s);
            let violation = Violation { at, vehicle: Some(0), breach, lasted: Duration::ZERO };
            assert_eq!(violation.invariant().name(), invariant);
            let mut judged = report(vec![violation], Vec::new());
            let excused = judge(&mut judged, &steps);
            let why = excused.first().map(|excused| excused.cause.describe());
            assert_eq!(why.as_deref(), expected, "{invariant} {at_s}");
            assert_eq!(judged.violations.len() + excused.len(), 1);
            // Where lateness cannot be, nothing hides behind it.
            let mut judged = report(vec![violation], Vec::new());
            assert_eq!((judge(&mut judged, &[]), judged.violations), (vec![], vec![violation]));
        }
    }

    #[test]
    fn spec_a_named_cause_is_told_with_its_kind_and_its_duration() {
        let violation = Violation {
            at: Duration::from_secs(3),
            vehicle: Some(0),
            breach: Breach::Unprotected,
            lasted: Duration::from_millis(12),
        };
        let mut judged = report(vec![], vec![sim::Excused { violation, cause: sim::Cause::JammerFailed }]);
        let excused = judge(&mut judged, &[]);
        let told = serde_json::to_value(excused).unwrap();
        let expected = serde_json::json!([{
            "invariant": "S1",
            "at_s": 3.0,
            "detail": "I radiates while J does not jam its slot as planned",
            "duration_s": 0.012,
            "cause": "jammer-failed",
            "why": "J's vehicle or radio failed while a lease of I's ran",
        }]);
        assert_eq!(told, expected);
    }
}
