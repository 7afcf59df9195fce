//! The mission as it should go.

use std::time::Duration;

use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};

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

/// Altitudes are the mission's, whatever the vehicles stand on.
#[test]
fn spec_vehicles_that_stand_on_a_roof_climb_to_the_bottom_of_the_band_and_land_on_it() {
    let bottom_m = yard().mission.airspace.altitude_m[0];
    let mut flight = Flight::new(Setup { roof_m: 6.0, ..Setup::default() });
    let mut highest_m = PerVehicle { i: 0.0_f64, j: 0.0 };
    while Role::BOTH.iter().any(|role| flight.said(*role, "airborne").is_none()) {
        flight.pass(Duration::from_millis(100));
        for role in Role::BOTH {
            if flight.said(role, "airborne").is_none() {
                highest_m[role] = highest_m[role].max(flight.place(role).z);
            }
        }
        assert!(flight.now < Duration::from_secs(60), "{}", flight.story());
    }
    for role in Role::BOTH {
        let highest_m = highest_m[role];
        assert!(highest_m > bottom_m - 1.0 && highest_m < bottom_m + 1.0, "{role}: {highest_m}");
    }
    flight.fly_out();
    flight.assert_safe();
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
        assert!(flight.landed(role) && (flight.place(role).z - 6.0).abs() < 0.1);
    }
}

#[test]
fn spec_jitter_that_the_mission_does_not_know_of_is_told_once() {
    let (calm, rough) = (1.0, 4.0);
    for (stated_deg, true_deg, told) in
        [(calm, calm, None), (rough, rough, None), (calm, rough, Some(rough)), (rough, calm, Some(calm))]
    {
        let yard = yard().under(|m| m.jitter.std_deg = stated_deg);
        let given = PerVehicle { i: yard.clone(), j: yard };
        let mut flight = Flight::new(Setup { given, jitter_deg: Some(true_deg), ..Setup::default() });
        flight.fly_out();
        for role in Role::BOTH {
            let said =
                flight.log.notices.iter().filter(|(_, by, text)| *by == role && text.contains("jitters"));
            let said: Vec<_> = said.map(|(_, _, text)| text).collect();
            assert_eq!(said.len(), usize::from(told.is_some()), "{stated_deg} {true_deg}: {said:?}");
            for text in said {
                let words: Vec<&str> = text.split(' ').collect();
                let measured_deg: f64 = words[3].parse().unwrap();
                assert!((0.9..1.1).contains(&(measured_deg / true_deg)), "{text}");
                assert!(
                    text.ends_with(&format!("the mission says {stated_deg:.2}: set [jitter] std_deg so"))
                );
            }
        }
    }
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
