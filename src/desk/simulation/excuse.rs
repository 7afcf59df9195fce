//! Violations that are nobody's aboard: what a transmitter out of order does by itself, and what a simulation does that
//! could not keep up with its own clock.

use std::time::Duration;

use serde::Serialize;
use veilwing_sitl::Violation;

use crate::role::Role;

use super::Fault;

/// What the world's lateness has upset is upset for this much longer: S4's reactions and the leases.
const AFTERWARDS: Duration = Duration::from_secs(1);
/// What depends on when something is heard. Powers, paths, and what a radio does by itself do not.
const TIMED: [&str; 6] = ["S1", "S2", "S3", "S4", "F2", "F3"];

/// A violation that does not count.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Excused {
    /// What was seen.
    #[serde(flatten)]
    pub violation: Violation,
    /// Why it does not count, as a clause.
    pub why: String,
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

/// Parts the violations that count from those that do not.
#[must_use]
pub fn judge(
    violations: Vec<Violation>,
    faults: &[(Duration, Fault)],
    late: &[Late],
) -> (Vec<Violation>, Vec<Excused>) {
    let (mut count, mut excused) = (Vec::new(), Vec::new());
    for violation in violations {
        match broken_radio(&violation, faults).or_else(|| late_world(&violation, late)) {
            Some(why) => excused.push(Excused { violation, why }),
            None => count.push(violation),
        }
    }
    (count, excused)
}

/// A transmitter that no longer obeys: no companion can silence it, and what it emits by itself breaks S1 to S6 by
/// construction. The rest is held to the invariants as ever: a transmitter of I excuses nothing that J does, nor a
/// vehicle's path (F), nor anything before it broke.
fn broken_radio(violation: &Violation, faults: &[(Duration, Fault)]) -> Option<String> {
    let of = if violation.detail.starts_with("J radiates") { Role::J } else { Role::I };
    let broken = faults.iter().any(|(at, fault)| {
        fault.kind.is_of_the_transmitter() && fault.roles.contains(&of) && at.as_secs_f64() <= violation.at_s
    });
    (broken && violation.invariant.starts_with('S'))
        .then(|| format!("vehicle {of}'s transmitter was out of order"))
}

/// State that comes late silences vehicles rightly, one before the other; that it came late was not their doing.
fn late_world(violation: &Violation, late: &[Late]) -> Option<String> {
    if !TIMED.contains(&violation.invariant) {
        return None;
    }
    let at = Duration::try_from_secs_f64(violation.at_s).ok()?;
    let upset = |step: &&Late| step.from <= at && at <= step.from + step.by + AFTERWARDS;
    let worst = late.iter().filter(upset).max_by_key(|step| step.by)?;
    Some(format!("the world ran late by {} ms at {:.3} s", worst.by.as_millis(), worst.from.as_secs_f64()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::desk::simulation::FaultKind;

    fn violation(invariant: &'static str, at_s: f64, detail: &str) -> Violation {
        Violation { invariant, at_s, detail: detail.into() }
    }

    #[test]
    fn val_a_broken_transmitter_excuses_its_own_emission_and_nothing_else() {
        let broken = |role| {
            let fault = Fault {
                kind: FaultKind::TransmitterStuck,
                roles: vec![role],
                slot: None,
                after: Duration::from_secs(30),
                duration: None,
                sizes: Vec::new(),
                direction_rad: 0.0,
            };
            vec![(Duration::from_secs(30), fault)]
        };
        let unprotected = violation("S1", 31.0, "I radiates while J does not jam its slot");
        let jam = violation("S2", 31.0, "J radiates in no slot of the plan");
        let near = violation("F1", 31.0, "the vehicles are 3.00 m apart; 5.00 m is the least");
        let before = violation("S1", 29.0, "I radiates while J does not jam its slot");
        for (violation, of_i, of_j) in
            [(unprotected, true, false), (jam, false, true), (near, false, false), (before, false, false)]
        {
            let excused = |faults: &[_]| judge(vec![violation.clone()], faults, &[]).1.len() == 1;
            assert_eq!(excused(&broken(Role::I)), of_i, "{violation:?}");
            assert_eq!(excused(&broken(Role::J)), of_j, "{violation:?}");
            assert!(!excused(&[]));
        }
    }

    #[test]
    fn val_a_late_world_excuses_what_depends_on_time_near_its_lateness_and_nothing_else() {
        let late = |from_s: u64, by_ms: u64| Late {
            from: Duration::from_secs(from_s),
            by: Duration::from_millis(by_ms),
        };
        let steps = [late(10, 40), late(30, 90), late(30, 60)];
        for (invariant, at_s, expected) in [
            ("S3", 30.5, Some("the world ran late by 90 ms at 30.000 s")),
            ("S1", 31.05, Some("the world ran late by 90 ms at 30.000 s")),
            ("F2", 10.2, Some("the world ran late by 40 ms at 10.000 s")),
            ("S3", 29.9, None),
            ("S3", 31.2, None),
            ("S6", 30.5, None),
            ("S5", 30.5, None),
            ("F1", 30.5, None),
        ] {
            let (count, excused) = judge(vec![violation(invariant, at_s, "x")], &[], &steps);
            assert_eq!(excused.first().map(|excused| excused.why.as_str()), expected, "{invariant} {at_s}");
            assert_eq!(count.len() + excused.len(), 1);
            // Where lateness cannot be, nothing hides behind it.
            assert_eq!(judge(vec![violation(invariant, at_s, "x")], &[], &[]).0.len(), 1);
        }
    }
}
