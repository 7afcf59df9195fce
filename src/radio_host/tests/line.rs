//! A kill line beside the device.

use std::time::Duration;

use proptest::prelude::*;

use super::stand::*;
use crate::radio_host::{Fault, Level, LineTimes, Notice, Order, Outcome, Settings, Silence};
use crate::time::Instant;
use crate::transmitter::wire::VeilwingRadioResult as Is;

const SILENT_MS: u64 = 7;
const HOLDS_MS: u64 = 60;

fn with(silence: Silence, alone: bool) -> Settings {
    Settings { line: Some(LineTimes { silence, alone }), ..settings() }
}

fn at_level() -> Settings {
    with(Silence::AtLevel(ms(SILENT_MS)), false)
}

fn one_shot() -> Settings {
    with(Silence::WithoutEdges(ms(HOLDS_MS)), false)
}

/// Radiating 20 dBm, by a device that says nothing more from now on.
fn hung(settings: Settings) -> Stand {
    let mut stand = Stand::with(settings);
    stand.on(20.0, 500);
    stand.obeys_after = None;
    assert_eq!(stand.power(), 20_000);
    stand
}

fn level(stand: &Stand) -> Option<Level> {
    stand.line.last().map(|(_, level)| *level)
}

#[test]
fn spec_the_line_is_off_before_anything_else_and_lets_through_only_what_was_read_back() {
    let mut stand = Stand::raw(at_level());
    assert_eq!(stand.host.poll_line(), Some(Level::Off), "before the device is told anything");
    stand.host.handle_line(Level::Off, true, stand.now);
    stand.run(1);
    stand.obeys_after = None;
    stand.on(20.0, 500);
    assert!(matches!(stand.orders.last(), Some((_, Order::Set(_)))));
    assert_eq!(stand.line, [], "not before it is read back");
    stand.outcome(Outcome::Set { read_back: Some(20.0) });
    assert_eq!(level(&stand), Some(Level::On));
    assert!(stand.reports.iter().any(|report| report.answers == 1 && report.power_mdbm == 20_000));
    // To another power it stays where it is.
    stand.on(10.0, 500);
    stand.outcome(Outcome::Set { read_back: Some(10.0) });
    assert_eq!((stand.line.len(), stand.power()), (1, 10_000));
    stand.on(15.0, 500);
    stand.outcome(Outcome::Set { read_back: Some(30.0) });
    assert_eq!(level(&stand), Some(Level::Off), "another power than was set");
}

#[test]
fn spec_off_by_the_line_counts_after_its_time_whatever_the_device_does() {
    let mut stand = hung(at_level());
    assert_eq!(stand.off(), None);
    assert_eq!(stand.line.last(), Some(&(stand.now, Level::Off)), "at once");
    stand.run(SILENT_MS - 1);
    assert_eq!(stand.power(), 20_000);
    stand.run(1);
    assert_eq!(stand.power(), OFF);
    let answer = stand.reports.iter().find(|report| report.answers == 2).unwrap();
    assert_eq!((answer.result, answer.power_mdbm), (Is::VEILWING_RADIO_RESULT_ACCEPTED, OFF));
    assert!(stand.host.is_silent() && !stand.host.is_off());
    // The device is still late, is told again, and nothing is tried before it has confirmed.
    stand.run(2000);
    assert!(stand.notices.contains(&Notice::ByLine(Fault::Late)), "{:?}", stand.notices);
    assert!(
        !stand.notices.iter().any(|notice| matches!(notice, Notice::MayRadiate(_))),
        "{:?}",
        stand.notices
    );
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_DEVICE_LATE);
    assert_eq!(result(&stand.off()), Is::VEILWING_RADIO_RESULT_ACCEPTED);
    assert_eq!((stand.power(), level(&stand)), (OFF, Some(Level::Off)));
    stand.outcome(Outcome::Off);
    assert!(stand.host.is_off());
    stand.obeys_after = Some(Duration::ZERO);
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_ACCEPTED);
    assert_eq!((stand.power(), level(&stand)), (20_000, Some(Level::On)));
}

#[test]
fn spec_a_lease_and_a_kill_end_at_the_line_while_the_device_hangs() {
    let mut stand = hung(at_level());
    stand.run(482);
    assert_eq!(level(&stand), Some(Level::Off), "20 ms before the lease's end at the earliest");
    stand.run(20);
    assert_eq!(stand.power(), OFF);
    let mut stand = hung(at_level());
    stand.say_by(COMPANION, &kill(OWN, 0.0));
    assert_eq!(level(&stand), Some(Level::Off));
    stand.run(SILENT_MS);
    let results: Vec<_> = stand
        .common
        .iter()
        .filter_map(|message| match message {
            mavlink::dialects::ardupilotmega::MavMessage::COMMAND_ACK(ack) => Some(ack.result),
            _ => None,
        })
        .collect();
    use mavlink::dialects::ardupilotmega::MavResult;
    assert_eq!(results, [MavResult::MAV_RESULT_IN_PROGRESS, MavResult::MAV_RESULT_ACCEPTED]);
}

#[test]
fn spec_a_line_whose_time_is_not_declared_is_driven_and_proves_nothing() {
    let mut stand = hung(with(Silence::Unknown, false));
    stand.off();
    assert_eq!(level(&stand), Some(Level::Off));
    stand.run(3000);
    assert_eq!(stand.power(), 20_000);
    assert!(stand.notices.contains(&Notice::MayRadiate(Fault::Late)));
    stand.outcome(Outcome::Off);
    assert_eq!(stand.power(), OFF);
}

#[test]
fn spec_a_device_without_an_off_is_off_when_its_line_has_had_its_time() {
    let mut stand = Stand::raw(with(Silence::AtLevel(ms(SILENT_MS)), true));
    stand.run(SILENT_MS - 1);
    assert!(!stand.host.is_off() && stand.power() != OFF, "the device alone does not count");
    stand.run(1);
    assert!(stand.host.is_off() && stand.power() == OFF);
    assert!(stand.notices.contains(&Notice::Silent));
    stand.on(20.0, 500);
    assert_eq!(stand.power(), 20_000);
    assert_eq!(stand.off(), None);
    stand.run(SILENT_MS);
    assert_eq!(stand.power(), OFF);
}

#[test]
fn spec_a_line_that_does_not_obey_is_told_of_tried_again_and_nothing_is_radiated_meanwhile() {
    let mut stand = Stand::with(at_level());
    stand.line_obeys = false;
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_DEVICE_ERROR);
    assert_eq!((stand.line[0].1, stand.line[1].1), (Level::On, Level::Off));
    assert_eq!(stand.power(), OFF, "the device was told off, and is");
    stand.run(1000);
    assert_eq!(stand.line.len(), 7, "off, five times a second");
    assert!(stand.line[1..].iter().all(|(_, level)| *level == Level::Off));
    let told = stand.notices.iter().filter(|notice| **notice == Notice::Fault(Fault::Line)).count();
    assert_eq!(told, 1, "{:?}", stand.notices);
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_DEVICE_ERROR);
    stand.line_obeys = true;
    stand.run(200);
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_ACCEPTED);
    // The device confirmed, but the line is all that makes it off.
    let mut stand = Stand::raw(with(Silence::AtLevel(ms(SILENT_MS)), true));
    stand.line_obeys = false;
    stand.run(1000);
    assert!(
        stand.power() != OFF && stand.notices.contains(&Notice::MayRadiate(Fault::Line)),
        "{:?}",
        stand.notices
    );
}

#[test]
fn spec_a_one_shot_is_fed_while_it_radiates_and_not_any_more() {
    let mut stand = Stand::with(one_shot());
    // Whatever it was at before, it holds for its time after the start.
    stand.run(HOLDS_MS);
    stand.on(20.0, 400);
    stand.run(300);
    let edges: Vec<Instant> =
        stand.line.iter().filter(|(_, level)| *level == Level::On).map(|(at, _)| *at).collect();
    assert!(edges.len() > 10, "{edges:?}");
    for pair in edges.windows(2) {
        assert!(pair[1].saturating_since(pair[0]) <= ms(HOLDS_MS / 2), "{pair:?}");
    }
    assert_eq!(stand.power(), 20_000);
    stand.obeys_after = None;
    stand.off();
    let (off_at, last) = *stand.line.last().unwrap();
    assert_eq!((off_at, last), (stand.now, Level::Off));
    stand.run(HOLDS_MS - 1);
    assert_eq!(stand.power(), 20_000, "an edge just before holds so long");
    stand.run(1);
    assert_eq!((stand.power(), level(&stand)), (OFF, Some(Level::Off)));
    assert_eq!(stand.line.last().unwrap().0, off_at, "no edge more");
}

#[test]
fn spec_a_one_shot_that_was_fed_too_late_is_a_fault_as_it_may_have_been_silent() {
    let mut stand = Stand::with(one_shot());
    stand.on(20.0, 500);
    stand.run(100);
    assert_eq!(stand.power(), 20_000);
    // The process stood still.
    stand.now = stand.now + ms(HOLDS_MS);
    stand.run(1);
    assert!(stand.notices.contains(&Notice::Fault(Fault::Line)), "{:?}", stand.notices);
    assert_eq!((stand.power(), level(&stand)), (OFF, Some(Level::Off)));
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_ACCEPTED, "and it may try again");
}

proptest! {
    /// Whatever device and line do and whenever: what is said to be off was read back off by the device, or cut for its time; and
    /// the line lets nothing through past a lease, or but a power that was read back.
    #[test]
    fn prop_off_is_off_by_one_of_two_and_nothing_passes_the_line_unread(
        kind in 0..4u8,
        steps in prop::collection::vec((0..8u8, 0..90u64, 0..6u8, 0..31i32), 1..80),
    ) {
        let (silence, alone) = match kind {
            0 => (Silence::Unknown, false),
            1 => (Silence::AtLevel(ms(SILENT_MS)), false),
            2 => (Silence::AtLevel(ms(SILENT_MS)), true),
            _ => (Silence::WithoutEdges(ms(HOLDS_MS)), true),
        };
        let mut stand = Stand::raw(with(silence, alone));
        stand.obeys_after = None;
        stand.drain();
        let (mut ends_at, mut device_off, mut read_back) = (0, false, false);
        let mut driven = 0;
        for (what, millis, how, dbm) in steps {
            match what {
                0 => { stand.off(); }
                1 | 2 => {
                    stand.on(dbm as f32, 300);
                    ends_at = stand.now.since_start().as_millis() + 300;
                }
                3 | 4 => stand.run(millis),
                5 => stand.line_obeys = how > 0,
                _ if stand.orders.is_empty() => {}
                _ => {
                    let (_, order) = *stand.orders.last().unwrap();
                    let outcome = match how {
                        0 => Outcome::Failed(Fault::Refused),
                        1 => Outcome::Set { read_back: Some(f64::from(dbm)) },
                        _ => obeyed(order),
                    };
                    let told = stand.orders.len();
                    stand.outcome(outcome);
                    let last = stand.orders.last().map(|(_, order)| *order);
                    device_off |= outcome == Outcome::Off && order == Order::Off;
                    read_back |= matches!(outcome, Outcome::Set { .. }) && matches!(order, Order::Set(_));
                    prop_assert!(told > 0 && last.is_some());
                }
            }
            if matches!(stand.orders.last(), Some((_, Order::Set(_)))) && !stand.host.is_silent() {
                device_off = false;
            }
            for (at, level) in &stand.line[driven..] {
                prop_assert!(*level == Level::Off || read_back, "let through, unread");
                prop_assert!(*level == Level::Off || at.since_start().as_millis() < ends_at, "let through past the lease");
            }
            driven = stand.line.len();
            if stand.power() == OFF {
                let last_on = stand.line.iter().rev().find(|(_, level)| *level == Level::On).map(|(at, _)| *at);
                let cut = silence.after().is_some_and(|after| {
                    let offs = stand.line.iter().rev().take_while(|(_, level)| *level == Level::Off);
                    offs.last().is_some_and(|(at, _)| *at + after <= stand.now)
                });
                prop_assert!(cut || device_off && !alone, "said to be off; on last at {last_on:?}, {:?}", stand.line);
            }
        }
    }
}
