//! Violations that are nobody's aboard: what a transmitter out of order does by itself, and what a simulation does that
//! could not keep up with its own clock.

use std::time::Duration;

use serde::Serialize;
use veilwing_sitl::{Invariant, Violation};

use crate::role::Role;

use super::{Fault, index};

/// What the world's lateness has upset is upset for this much longer: S4's reactions and the leases.
const AFTERWARDS: Duration = Duration::from_secs(1);
/// What depends on when something is heard, or on the radio's clock, which stands still while the world does: a command
/// that ends at an instant of it lasts so much longer then (S5). Powers and paths do not.
const TIMED: [Invariant; 7] =
    [Invariant::S1, Invariant::S2, Invariant::S3, Invariant::S4, Invariant::S5, Invariant::F2, Invariant::F3];

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
    let of = Role::BOTH.into_iter().find(|role| violation.vehicle == Some(index(*role)))?;
    let broken = faults.iter().any(|(at, fault)| {
        fault.kind.is_of_the_transmitter() && fault.roles.contains(&of) && *at <= violation.at
    });
    (broken && violation.invariant().is_of_emission())
        .then(|| format!("vehicle {of}'s transmitter was out of order"))
}

/// State that comes late silences vehicles rightly, one before the other; that it came late was not their doing.
fn late_world(violation: &Violation, late: &[Late]) -> Option<String> {
    if !TIMED.contains(&violation.invariant()) {
        return None;
    }
    let upset = |step: &&Late| step.from <= violation.at && violation.at <= step.from + step.by + AFTERWARDS;
    let worst = late.iter().filter(upset).max_by_key(|step| step.by)?;
    Some(format!("the world ran late by {} ms at {:.3} s", worst.by.as_millis(), worst.from.as_secs_f64()))
}

#[cfg(test)]
mod tests {
    use veilwing_sitl::Breach;

    use super::*;
    use crate::desk::simulation::FaultKind;

    fn violation(vehicle: Option<usize>, at_s: f64, breach: Breach) -> Violation {
        Violation { at: Duration::from_secs_f64(at_s), vehicle, breach }
    }

    #[test]
    fn spec_a_broken_transmitter_excuses_its_own_emission_and_nothing_else() {
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
        let (i, j) = (Some(index(Role::I)), Some(index(Role::J)));
        let unprotected = violation(i, 31.0, Breach::Unprotected);
        let left = violation(i, 31.0, Breach::JamLeft);
        let jam = violation(j, 31.0, Breach::NoSlot);
        let near = violation(None, 31.0, Breach::Near { distance_m: 3.0, least_m: 5.0 });
        let fence = violation(j, 31.0, Breach::Fence { beyond_m: 3.0, position_m: [0.0; 2] });
        let before = violation(i, 29.0, Breach::Unprotected);
        for (violation, of_i, of_j) in [
            (unprotected, true, false),
            (left, true, false),
            (jam, false, true),
            (near, false, false),
            (fence, false, false),
            (before, false, false),
        ] {
            let excused = |faults: &[_]| judge(vec![violation], faults, &[]).1.len() == 1;
            assert_eq!(excused(&broken(Role::I)), of_i, "{violation:?}");
            assert_eq!(excused(&broken(Role::J)), of_j, "{violation:?}");
            assert!(!excused(&[]));
        }
    }

    #[test]
    fn spec_a_late_world_excuses_what_depends_on_time_near_its_lateness_and_nothing_else() {
        let late = |from_s: u64, by_ms: u64| Late {
            from: Duration::from_secs(from_s),
            by: Duration::from_millis(by_ms),
        };
        let steps = [late(10, 40), late(30, 90), late(30, 60)];
        let (i, after) = (Some(index(Role::I)), Duration::ZERO);
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
            let violation = violation(i, at_s, breach);
            assert_eq!(violation.invariant().name(), invariant);
            let (count, excused) = judge(vec![violation], &[], &steps);
            assert_eq!(excused.first().map(|excused| excused.why.as_str()), expected, "{invariant} {at_s}");
            assert_eq!(count.len() + excused.len(), 1);
            // Where lateness cannot be, nothing hides behind it.
            assert_eq!(judge(vec![violation], &[], &[]).0.len(), 1);
        }
    }
}
