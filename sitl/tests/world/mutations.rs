//! Would a flight test find a slip? Each of three is planted in what one vehicle hears, and the flight that passes
//! without it must fail.

use crate::common::*;
use veilwing_sitl::*;

/// A slot flown as in `flight.rs`: the violations, and the rate over that of a flight without a slip.
fn fly(vehicle: usize, slip: Option<Slip>) -> (Vec<&'static str>, f64) {
    let mut config = config();
    config.slots[0].poses[1].roll_rad = 0.5;
    // North and east of their origins differ.
    config.slots[0].poses[0].position_enu_m = [-5.0, 20.0, 30.0];
    config.slots[0].poses[1].position_enu_m = [15.0, -30.0, 40.0];
    config.vehicles[vehicle].slip = slip;
    let mut flight = Flight::at_slot(config);
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 3000, [true, true]);
    let report = flight.world.report();
    (
        report.violations.iter().map(|v| v.invariant().name()).collect(),
        report.slots[0].achieved_secrecy_rate_bps,
    )
}

#[test]
fn spec_a_wrong_sign_a_swapped_frame_and_radians_for_degrees_are_found_on_either_vehicle() {
    let (none, rate) = fly(0, None);
    assert_eq!(none, Vec::<&str>::new());
    for vehicle in [0, 1] {
        for slip in [Slip::RollSign, Slip::SwappedAxes, Slip::RadiansForDegrees] {
            let (violations, with) = fly(vehicle, Some(slip));
            assert!(violations.contains(&["S1", "S2"][vehicle]), "{slip:?} {vehicle}: {violations:?}");
            assert!((with / rate - 1.0).abs() > 0.05, "{slip:?} {vehicle}: {with} {rate}");
        }
    }
}
