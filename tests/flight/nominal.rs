//! The mission as it should go.

use veilwing::mission::Outcome;
use veilwing::role::Role;

use crate::harness::*;

#[test]
fn val_a_flight_serves_every_slot_as_planned() {
    let mut flight = Flight::new(Setup::default());
    flight.fly_out();
    flight.assert_safe();
    let report = flight.report();
    assert_eq!(report.slots.len(), 2);
    for slot in &report.slots {
        let difference = (slot.achieved_secrecy_rate_bps - slot.planned_secrecy_rate_bps).abs();
        let allowed = (0.03 * slot.planned_secrecy_rate_bps).max(4.0 * slot.standard_error_bps);
        assert!(difference <= allowed, "{slot:#?}");
        assert!(slot.radiated_s.i > 2.5 && slot.radiated_s.j >= slot.radiated_s.i, "{slot:#?}");
        assert_eq!(slot.jam_out_of_tolerance_s, 0.0, "{slot:#?}");
    }
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
        assert!(flight.landed(role));
    }
    assert!(report.min_separation_m.unwrap() > 5.0);
}

#[test]
fn spec_a_flight_is_its_seed_bit_for_bit() {
    let fly = |seed| {
        let pair = Path { loss: 0.1, duplication: 0.1, ..Path::GOOD };
        let mut flight = Flight::new(Setup { seed, pair, ..Setup::default() });
        flight.fly_out();
        // `{:?}` prints each number so that it reads back the same, to the last bit.
        (format!("{:?}", flight.report()), format!("{:?}", flight.log))
    };
    let (first, again, other) = (fly(5), fly(5), fly(6));
    assert_eq!(first, again);
    assert_ne!(first.0, other.0);
}
