//! Would the plain flight's test find a slip? Each of three is planted between companion and autopilot of one vehicle,
//! which is the same slip in either: a wrong sign, a swapped frame, radians for degrees.

use veilwing::mission::Outcome;
use veilwing::role::Role;
use veilwing_sitl::Slip;

use crate::harness::*;

/// Which of the plain flight's expectations fail.
fn failures(slip: Option<(Role, Slip)>) -> Vec<&'static str> {
    let mut flight = Flight::new(Setup { slip, ..Setup::default() });
    let ended = flight.until(|flight| Role::BOTH.into_iter().all(|role| !flight.lives(role)));
    let report = flight.report();
    let served = report.slots.iter().all(|slot| {
        let ratio = slot.achieved_secrecy_rate_bps / slot.planned_secrecy_rate_bps;
        slot.radiated_s.i > 2.5 && (ratio - 1.0).abs() < 0.03
    });
    let completed = Role::BOTH.into_iter().all(|role| flight.outcomes[role] == Some(Outcome::Completed));
    let expectations = [
        ("ends", ended),
        ("completed", completed),
        ("served", served),
        ("safe", report.violations.is_empty()),
    ];
    expectations.into_iter().filter(|(_, met)| !met).map(|(name, _)| name).collect()
}

#[test]
fn spec_a_wrong_sign_a_swapped_frame_and_radians_for_degrees_each_fail_the_plain_flight() {
    assert_eq!(failures(None), Vec::<&str>::new());
    for slip in [Slip::RollSign, Slip::SwappedAxes, Slip::RadiansForDegrees] {
        for role in Role::BOTH {
            let failed = failures(Some((role, slip)));
            println!("{slip:?} on {role}: {failed:?}");
            assert!(failed.contains(&"served"), "{slip:?} on {role} goes unnoticed: {failed:?}");
        }
    }
}
