//! What docs/radio.md says that a radio does, rule by rule.

use mavlink::dialects::ardupilotmega::*;

use super::stand::*;
use crate::radio_host::{Notice, Order};
use crate::transmitter::wire::{VeilwingRadioResult as Is, WHOLE};

#[test]
fn spec_its_clock_is_monotonic_in_ms_and_wraps() {
    let mut stand = Stand::with(crate::radio_host::Settings { clock_began_ms: u32::MAX - 20, ..settings() });
    assert_eq!(stand.clock_ms(), u32::MAX - 20 + 11);
    let answer = stand.on(20.0, 400).unwrap();
    assert!(answer.expires_ms < 400, "the expiry is past the wrap");
    stand.run(300);
    assert_eq!((stand.power(), stand.clock_ms()), (20_000, 290));
    stand.run(100);
    assert_eq!(stand.power(), OFF);
}

#[test]
fn spec_a_series_is_drawn_at_the_start_and_with_every_boot_taken() {
    let mut seen = std::collections::BTreeSet::new();
    let mut stand = Stand::new();
    for boot in 1..100 {
        seen.insert(stand.host.report(stand.now).series);
        (stand.boot, stand.number) = (boot, 0);
        assert_eq!(result(&stand.off()), Is::VEILWING_RADIO_RESULT_ACCEPTED);
    }
    assert!(seen.len() > 97 && seen.iter().all(|series| (1..WHOLE).contains(series)));
    let other = Stand::with(crate::radio_host::Settings { seed: 8, ..settings() });
    assert_ne!(other.host.report(other.now).series, *seen.first().unwrap());
}

#[test]
fn spec_the_first_of_its_system_is_the_commander_and_nobody_else_is_heard() {
    let mut stand = Stand::new();
    let on = stand.command(20.0, 500);
    assert_eq!(stand.give_by((2, 191), on.clone()), None, "of another system");
    assert!(stand.give(on).is_some());
    let theirs = stand.command(30.0, 500);
    assert_eq!(stand.give_by((1, 190), theirs), None);
    assert_eq!((stand.power(), stand.host.counters().strangers), (20_000, 2));
    assert!(stand.notices.contains(&Notice::Commander { system: 1, component: 191 }));
}

#[test]
fn spec_who_is_not_on_the_list_of_commanders_is_not_pinned() {
    let mut stand = Stand::with(crate::radio_host::Settings { commanders: vec![191], ..settings() });
    let theirs = stand.command(30.0, 500);
    assert_eq!(stand.give_by((1, 190), theirs), None);
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_ACCEPTED);
}

#[test]
fn spec_a_number_that_is_not_above_the_newest_changes_nothing() {
    let mut stand = Stand::new();
    let (on, off) = (stand.command(20.0, 500), stand.command(f32::NEG_INFINITY, 0));
    stand.give(off.clone());
    let late = stand.give(on.clone()).unwrap();
    assert_eq!((late.result, late.answers, late.newest), (Is::VEILWING_RADIO_RESULT_NOT_NEWER, 1, 2));
    assert_eq!(stand.power(), OFF);
    stand.number = 2;
    stand.on(20.0, 500);
    // Recorded, and sent again.
    assert_eq!(result(&stand.give(off)), Is::VEILWING_RADIO_RESULT_NOT_NEWER);
    assert_eq!((stand.power(), stand.host.counters().not_newer), (20_000, 2));
}

#[test]
fn spec_another_boot_counts_with_the_present_series_alone_and_finds_the_radio_off() {
    let mut stand = Stand::new();
    let first = stand.command(20.0, 500);
    stand.give(first.clone());
    // It has heard the series of before the first was taken.
    let stale = COMMAND_INT_DATA { param2: 9.0, param3: 6.0, ..first.clone() };
    let refused = stand.give(stale).unwrap();
    assert_eq!(
        (refused.result, refused.boot, refused.answers_boot),
        (Is::VEILWING_RADIO_RESULT_OTHER_SERIES, 5, 6)
    );
    assert_eq!(stand.power(), 20_000);
    (stand.boot, stand.number) = (6, 0);
    let taken = stand.on(10.0, 500).unwrap();
    assert_eq!((taken.boot, taken.newest, taken.power_mdbm), (6, 1, 10_000));
    assert!(stand.orders.iter().any(|(_, order)| *order == Order::Off), "off in between");
    // What the first still had under way.
    let dead = COMMAND_INT_DATA { param2: 7.0, ..first };
    assert_eq!(result(&stand.give(dead)), Is::VEILWING_RADIO_RESULT_OTHER_SERIES);
    assert_eq!((stand.power(), stand.host.counters().other_series), (10_000, 2));
}

#[test]
fn spec_what_cannot_be_carried_out_takes_its_number_and_changes_nothing_else() {
    let mut stand = Stand::new();
    stand.on(20.0, 500);
    for (dbm, ahead_ms) in [(30.1, 500), (f32::NAN, 500), (20.0, 5001), (f32::INFINITY, 500)] {
        let before = stand.host.report(stand.now);
        let answer = stand.on(dbm, ahead_ms).unwrap();
        assert_eq!(
            (answer.result, answer.newest),
            (Is::VEILWING_RADIO_RESULT_DENIED, stand.number),
            "{dbm} {ahead_ms}"
        );
        assert_eq!((answer.power_mdbm, answer.expires_ms), (before.power_mdbm, before.expires_ms));
    }
    assert_eq!(stand.host.counters().denied, 4);
}

#[test]
fn spec_past_its_expiry_on_arrival_is_off() {
    for ahead_ms in [0, -1, -100_000] {
        let mut stand = Stand::new();
        stand.on(20.0, 500);
        let answer = stand.on(20.0, ahead_ms).unwrap();
        assert_eq!((answer.result, stand.power()), (Is::VEILWING_RADIO_RESULT_EXPIRED, OFF), "{ahead_ms}");
    }
}

#[test]
fn spec_a_power_is_rounded_down_and_below_the_least_it_stays_off_and_says_so() {
    let mut stand = Stand::new();
    for (asked, given) in [(20.0, 20_000), (20.999, 21_000), (20.998, 20_000), (0.0, 0), (29.5, 29_000)] {
        let answer = stand.on(asked, 500).unwrap();
        assert_eq!(
            (answer.result, answer.power_mdbm),
            (Is::VEILWING_RADIO_RESULT_ACCEPTED, given),
            "{asked}"
        );
    }
    let answer = stand.on(-0.5, 500).unwrap();
    assert_eq!((answer.result, stand.power()), (Is::VEILWING_RADIO_RESULT_TOO_LOW, OFF));
}

#[test]
fn spec_it_is_off_at_the_expiry_by_its_own_clock_or_at_most_20_ms_before() {
    let mut stand = Stand::new();
    let expires_ms = stand.on(20.0, 500).unwrap().expires_ms;
    let mut last_on = stand.clock_ms();
    for _ in 0..600 {
        stand.run(1);
        if stand.power() != OFF {
            last_on = stand.clock_ms();
        }
    }
    assert!(
        (expires_ms - 20..expires_ms).contains(&last_on),
        "on until {last_on}, to expire at {expires_ms}"
    );
    assert_eq!(stand.host.counters().ran_out, 1);
    assert!(stand.notices.contains(&Notice::RanOut));
}

#[test]
fn spec_a_renewal_needs_no_device_and_is_answered_at_once() {
    let mut stand = Stand::new();
    stand.on(20.0, 300);
    stand.forget();
    stand.obeys_after = None;
    for _ in 0..20 {
        assert_eq!(result(&stand.on(20.0, 300)), Is::VEILWING_RADIO_RESULT_ACCEPTED);
        stand.run(100);
        assert_eq!(stand.power(), 20_000);
    }
    assert!(stand.orders.is_empty(), "{:?}", stand.orders);
}

#[test]
fn spec_a_command_is_answered_with_the_device_where_it_is_then() {
    let mut stand = Stand::new();
    stand.obeys_after = Some(ms(30));
    assert_eq!(stand.on(20.0, 500), None);
    // Reports go on meanwhile, and do not vouch.
    stand.run(29);
    assert_eq!(stand.power(), OFF);
    stand.run(1);
    let answer = stand.reports.iter().find(|report| report.answers == 1).unwrap();
    assert_eq!((answer.power_mdbm, answer.result), (20_000, Is::VEILWING_RADIO_RESULT_ACCEPTED));
    assert_eq!(answer.time_ms, stand.clock_ms());
    stand.off();
    stand.run(29);
    assert_eq!(stand.power(), 20_000, "not off before it was read back so");
    stand.run(1);
    assert_eq!(stand.power(), OFF);
    assert_eq!(stand.reports.iter().filter(|report| report.answers == 2).count(), 1);
}

#[test]
fn spec_it_speaks_unasked_five_times_a_second_and_more_and_its_heart_beats() {
    let mut stand = Stand::new();
    stand.run(10_000);
    assert!((50..100).contains(&stand.reports.len()), "{}", stand.reports.len());
    assert!(stand.reports.windows(2).all(|pair| pair[1].time_ms - pair[0].time_ms <= 200));
    let beats: Vec<_> =
        stand.common.iter().filter(|message| matches!(message, MavMessage::HEARTBEAT(_))).collect();
    assert_eq!(beats.len(), 10);
    let MavMessage::HEARTBEAT(beat) = beats[0] else { unreachable!() };
    assert_eq!(
        (beat.mavtype, beat.autopilot),
        (MavType::MAV_TYPE_RADIO, MavAutopilot::MAV_AUTOPILOT_INVALID)
    );
}

#[test]
fn spec_the_first_form_is_not_spoken_and_pins_nobody() {
    let mut stand = Stand::new();
    let unnumbered = COMMAND_INT_DATA { param2: 0.0, y: 500, ..stand.command(20.0, 0) };
    assert_eq!(stand.give_by((1, 190), unnumbered), None);
    let [MavMessage::COMMAND_ACK(ack)] = stand.common.as_slice() else { panic!("{:?}", stand.common) };
    assert_eq!((ack.result, stand.power()), (MavResult::MAV_RESULT_UNSUPPORTED, OFF));
    assert!(stand.on(20.0, 500).is_some(), "the companion is heard");
}

fn parameters(said: &[MavMessage]) -> Vec<(String, f32, u16, u16)> {
    let value = |message: &MavMessage| match message {
        MavMessage::PARAM_VALUE(v) => {
            Some((v.param_id.to_str().unwrap().to_owned(), v.param_value, v.param_index, v.param_count))
        }
        _ => None,
    };
    said.iter().filter_map(value).collect()
}

#[test]
fn spec_it_declares_itself_by_parameters_that_nobody_can_set() {
    let mut stand = Stand::new();
    let (target_system, target_component) = OWN;
    let list = PARAM_REQUEST_LIST_DATA { target_system, target_component };
    stand.say_by(COMPANION, &MavMessage::PARAM_REQUEST_LIST(list));
    let all = parameters(&stand.common);
    let values: Vec<(&str, f32)> = all.iter().map(|(name, value, ..)| (name.as_str(), *value)).collect();
    let expected = [
        ("TX_MAX_DBM", 30.0),
        ("TX_MIN_DBM", 0.0),
        ("TX_OFF_MS", 50.0),
        ("TX_CHANGE_MS", 80.0),
        ("TX_READ_BACK", 1.0),
        ("TX_DEAD_MS", -1.0),
        ("TX_BAND_LO_KHZ", 902_000.0),
        ("TX_BAND_HI_KHZ", 928_000.0),
    ];
    assert_eq!(values, expected);
    assert!(
        all.iter().enumerate().all(|(index, (_, _, at, count))| (usize::from(*at), *count) == (index, 8))
    );
    stand.forget();
    let (name, by_index) = ("TX_MAX_DBM".into(), "".into());
    let set = PARAM_SET_DATA {
        param_value: 40.0,
        target_system,
        target_component,
        param_id: name,
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    };
    stand.say_by(COMPANION, &MavMessage::PARAM_SET(set));
    let read =
        PARAM_REQUEST_READ_DATA { param_index: 2, target_system, target_component, param_id: by_index };
    stand.say_by(COMPANION, &MavMessage::PARAM_REQUEST_READ(read.clone()));
    let none = PARAM_REQUEST_READ_DATA { param_index: 8, ..read };
    stand.say_by(COMPANION, &MavMessage::PARAM_REQUEST_READ(none));
    let answered = parameters(&stand.common);
    let answered: Vec<(&str, f32)> =
        answered.iter().map(|(name, value, ..)| (name.as_str(), *value)).collect();
    assert_eq!(answered, [("TX_MAX_DBM", 30.0), ("TX_OFF_MS", 50.0)]);
}

fn acknowledged(stand: &Stand) -> Vec<MavResult> {
    let result = |message: &MavMessage| match message {
        MavMessage::COMMAND_ACK(ack) => Some(ack.result),
        _ => None,
    };
    stand.common.iter().filter_map(result).collect()
}

#[test]
fn spec_a_kill_is_obeyed_also_when_it_is_said_to_all_and_holds_until_it_is_lifted_here() {
    for target in [OWN, (0, 0), (1, 0), (0, 68)] {
        let mut stand = Stand::new();
        stand.on(20.0, 500);
        stand.obeys_after = Some(ms(30));
        stand.say_by((1, 190), &kill(target, 0.0));
        assert_eq!(acknowledged(&stand), [MavResult::MAV_RESULT_IN_PROGRESS], "{target:?}");
        stand.run(40);
        assert_eq!(acknowledged(&stand)[1..], [MavResult::MAV_RESULT_ACCEPTED], "when it is off");
        assert_eq!((stand.power(), stand.host.poll_kill_record()), (OFF, Some(true)));
        assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_NOT_NOW);
        stand.forget();
        stand.say_by((1, 190), &kill((0, 0), 1.0));
        assert_eq!(
            result(&stand.on(20.0, 500)),
            Is::VEILWING_RADIO_RESULT_NOT_NOW,
            "lifted for nobody in particular"
        );
        stand.say_by((1, 190), &kill(OWN, 1.0));
        assert_eq!(
            (acknowledged(&stand), stand.host.poll_kill_record()),
            (vec![MavResult::MAV_RESULT_ACCEPTED], Some(false))
        );
        stand.on(20.0, 500);
        stand.run(30);
        assert_eq!(stand.power(), 20_000);
    }
}

#[test]
fn spec_a_kill_of_an_earlier_process_holds() {
    let mut stand = Stand::with(crate::radio_host::Settings { killed: true, ..settings() });
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_NOT_NOW);
}

#[test]
fn spec_a_kill_of_a_stranger_is_refused_unless_it_is_signed_or_listed() {
    for (signed, operators, obeyed) in
        [(false, vec![], false), (true, vec![], true), (false, vec![255], true)]
    {
        let mut stand = Stand::with(crate::radio_host::Settings { signed, operators, ..settings() });
        stand.on(20.0, 500);
        stand.say_by((255, 190), &kill(OWN, 0.0));
        assert_eq!(stand.power() == OFF, obeyed);
        assert_eq!(stand.host.counters().strangers, u64::from(!obeyed));
    }
}

#[test]
fn spec_it_answers_whether_it_is_alive() {
    let mut stand = Stand::new();
    let question = TIMESYNC_DATA { tc1: 0, ts1: 1234, ..TIMESYNC_DATA::DEFAULT };
    stand.say_by(COMPANION, &MavMessage::TIMESYNC(question));
    let [MavMessage::TIMESYNC(answer)] = stand.common.as_slice() else { panic!("{:?}", stand.common) };
    assert!(answer.ts1 == 1234 && answer.tc1 > 0);
}

#[test]
fn spec_once_it_stops_it_is_off_for_good() {
    let mut stand = Stand::new();
    stand.on(20.0, 500);
    stand.host.stop(stand.now);
    stand.drain();
    assert!(stand.host.is_off());
    assert_eq!(result(&stand.on(20.0, 500)), Is::VEILWING_RADIO_RESULT_NOT_NOW);
}
