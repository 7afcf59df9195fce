//! The payload radio on the wire: numbered commands, what it says by itself, and the hop to it.

use crate::common::*;
use veilwing_sitl::*;

const OFF: f32 = f32::NEG_INFINITY;

/// Both radios, heard for a while.
fn heard(change: impl Fn(&mut VehicleConfig)) -> Flight {
    let mut config = config();
    config.vehicles.iter_mut().for_each(change);
    let mut flight = Flight::new(config);
    flight.pass(1000);
    flight
}

fn power_w(f: &Flight) -> Option<f64> {
    f.world.snapshot().vehicles[0].tx_power_w
}

#[test]
fn spec_the_radio_states_its_clock_by_itself_in_either_form() {
    for (place, behind) in [(RadioPlace::BehindAutopilot, true), (RadioPlace::OnTheWire, false)] {
        let f = heard(|v| v.radio_place = place);
        let reports = &f.clients[0].reports;
        assert!((5..=8).contains(&reports.len()), "{}", reports.len());
        assert!(reports.iter().all(|(report, tunnelled)| report.answers == (0, 0) && *tunnelled == behind));
        let (first, last) = (reports[0].0, reports[reports.len() - 1].0);
        let passed_ms = last.time_ms.wrapping_sub(first.time_ms);
        assert!((800..=1000).contains(&passed_ms), "{passed_ms}");
    }
    // One that knows the first form alone says nothing of the kind.
    assert!(heard(|v| v.power_form = PowerForm::First).clients[0].reports.is_empty());
}

#[test]
fn spec_a_numbered_power_is_answered_by_name_and_ends_by_the_radios_clock() {
    let mut f = heard(|_| {});
    f.clients[0].numbered(&mut f.world, OFF, 1, 0);
    f.pass(5);
    f.clients[0].numbered(&mut f.world, 20.25, 2, 300);
    f.pass(5);
    let (answer, _) = *f.clients[0].reports.last().unwrap();
    assert_eq!((answer.answers, answer.result, answer.newest), ((5, 2), 0, 2));
    assert_eq!((answer.boot, answer.power_mdbm), (5, 20_250));
    assert!((power_w(&f).unwrap() - 0.105_925).abs() < 1e-6);
    assert_eq!(f.world.snapshot().vehicles[0].slot, Some(2));
    // A copy, and one of before.
    for number in [2, 1] {
        f.clients[0].numbered(&mut f.world, OFF, number, 0);
        f.pass(5);
        let (answer, _) = *f.clients[0].reports.last().unwrap();
        assert_eq!((answer.answers, answer.result), ((5, number), 1));
    }
    assert!(power_w(&f).is_some());
    f.pass(270);
    assert!(power_w(&f).is_some());
    f.pass(20);
    assert_eq!(power_w(&f), None);
}

#[test]
fn spec_only_the_commander_aboard_is_obeyed() {
    let mut f = heard(|_| {});
    let mut stranger = Client::ground_station(0, 0);
    stranger.reports.clone_from(&f.clients[0].reports);
    stranger.numbered(&mut f.world, OFF, 1, 0);
    stranger.numbered(&mut f.world, 20.0, 2, 300);
    f.pass(5);
    assert_eq!(power_w(&f), None);
    assert!(f.clients[0].reports.iter().all(|(report, _)| report.boot == 0));
}

#[test]
fn spec_the_hop_to_the_radio_has_faults_of_its_own_in_each_direction() {
    let mut f = heard(|_| {});
    let manners = |f: &mut Flight, toward, manners| {
        f.world.inject(Fault::RadioHop { vehicle: 0, toward, manners });
    };
    f.clients[0].numbered(&mut f.world, OFF, 1, 0);
    f.pass(5);
    // Frozen commands burst when it thaws; an expiry on the radio's clock is none the later for it.
    let freeze = |f: &mut Flight, toward, on| {
        f.world.inject(Fault::RadioHopFrozen { vehicle: 0, toward, on });
    };
    freeze(&mut f, Toward::Radio, true);
    f.clients[0].numbered(&mut f.world, 20.0, 2, 300);
    f.clients[0].numbered(&mut f.world, 21.0, 3, 300);
    f.pass(200);
    assert_eq!(power_w(&f), None);
    freeze(&mut f, Toward::Radio, false);
    f.pass(5);
    assert!(power_w(&f).is_some_and(|power_w| (power_w - 0.125_893).abs() < 1e-6));
    f.pass(100);
    assert_eq!(power_w(&f), None, "300 ms after it was sent, not after it arrived");
    // Answers are held up without the commands being so.
    freeze(&mut f, Toward::Companion, true);
    let said = f.clients[0].reports.len();
    f.clients[0].numbered(&mut f.world, 20.0, 4, 500);
    f.pass(150);
    assert!(power_w(&f).is_some());
    assert_eq!(f.clients[0].reports.len(), said);
    freeze(&mut f, Toward::Companion, false);
    f.pass(5);
    assert!(f.clients[0].reports[said..].iter().any(|(report, _)| report.answers == (5, 4)));
    // Everything doubled: the copy is not newer.
    manners(&mut f, Toward::Radio, Manners { duplication: 1.0, ..Manners::default() });
    let said = f.clients[0].reports.len();
    f.clients[0].numbered(&mut f.world, OFF, 5, 0);
    f.pass(5);
    let results: Vec<u8> = f.clients[0].reports[said..]
        .iter()
        .filter(|(report, _)| report.answers.1 == 5)
        .map(|(report, _)| report.result)
        .collect();
    assert_eq!(results, [0, 1]);
    // Late, lost.
    manners(&mut f, Toward::Radio, Manners { delay_s: 0.1, ..Manners::default() });
    f.clients[0].numbered(&mut f.world, 20.0, 6, 500);
    f.pass(95);
    assert_eq!(power_w(&f), None);
    f.pass(10);
    assert!(power_w(&f).is_some());
    manners(&mut f, Toward::Radio, Manners { loss: 1.0, ..Manners::default() });
    f.clients[0].numbered(&mut f.world, OFF, 7, 0);
    f.pass(50);
    assert!(power_w(&f).is_some());
}
