//! The pair link through TUNNEL: a flight like any other, and what happens when only one side is set so.

use std::time::Duration;

use veilwing::link::Rejection;
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};

use crate::harness::*;

const THROUGH: PerVehicle<bool> = PerVehicle { i: true, j: true };

#[test]
fn spec_a_flight_through_tunnel_is_the_flight_without_it() {
    let fly = |tunnel| {
        let pair = Path { loss: 0.2, duplication: 0.2, delay: Duration::from_millis(30), ..Path::GOOD };
        let mut flight = Flight::new(Setup { tunnel, pair, ..Setup::default() });
        flight.fly_out();
        flight.assert_safe();
        for role in Role::BOTH {
            assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
        }
        (format!("{:?}", flight.report()), format!("{:?}", flight.log))
    };
    // The same losses and delays meet the same messages, whatever their form.
    assert_eq!(fly(PerVehicle::default()), fly(THROUGH));
}

#[test]
fn spec_two_forms_of_one_link_never_take_off_and_are_counted() {
    for plain in Role::BOTH {
        let mut tunnel = THROUGH;
        tunnel[plain] = false;
        let mut flight = Flight::new(Setup { tunnel, ..Setup::default() });
        flight.pass(Duration::from_secs(60));
        for role in Role::BOTH {
            assert!(flight.landed(role), "{}", flight.story());
            assert_eq!(flight.log.setpoints[role].len(), 0);
            let peer = format!("vehicle {} is not heard", role.peer());
            assert!(flight.said(role, &peer).is_some(), "{}", flight.story());
            let rejected = &flight.counters(role).rejected;
            assert!(rejected.get(Rejection::OtherForm) > 100, "{}", flight.counters(role));
            assert_eq!(rejected.total(), rejected.get(Rejection::OtherForm));
        }
        flight.assert_safe();
    }
}
