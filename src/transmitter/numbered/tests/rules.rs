//! What goes over the wire, and what is believed of what comes back.

use super::*;
use crate::preflight::Verdict;

#[test]
fn spec_a_companion_that_starts_is_taken_and_the_radio_is_off_by_its_own_clock() {
    let mut world = World::new(Way::steady(7), Way::steady(7));
    // A former boot left it on.
    world.radio.boot = 5;
    world.radio.newest = 99;
    let expires_ms = world.radio.clock_ms(world.now + ms(400));
    world.radio.on = Some(Emission { number: 99, boot: 5, dbm: 20.0, slot: 1, expires_ms });
    world.must_end.insert((5, 99), world.now + ms(400));
    assert_eq!(world.transmitter.supports_expiry(), None);
    assert_eq!(world.transmitter.ready(world.now), Err(NotReady::NotHeard));
    world.run(ms(60));
    assert_eq!(world.radio.on, None);
    assert!(world.transmitter.is_off(world.now));
    assert_eq!(world.transmitter.supports_expiry(), Some(true));
    assert_eq!(world.transmitter.ready(world.now), Ok(()));
    assert_eq!((world.radio.boot, world.asked), (78, 8));
    world.run(ms(1000));
    let checks = world.transmitter.preflight(world.now);
    let delay = checks.iter().find(|check| check.name == "transmitter delay").unwrap();
    assert_eq!(delay.result, Verdict::Pass, "{delay:?}");
    assert!(delay.detail.contains("after 14 ms"), "{delay:?}");
}

#[test]
fn val_what_is_on_the_wire_is_rounded_down_numbered_and_on_the_radios_clock() {
    let mut world = World::settled(10);
    let (number, boot, series) = {
        let last = world.radio.received.last().unwrap();
        (last.param2, last.param3, last.param4)
    };
    assert_eq!((boot, world.command(0.123_456, 9, 400)), (78.0, Ok(())));
    world.run(ms(25));
    let command = world.radio.received.last().unwrap().clone();
    assert_eq!((command.param2, command.param3, command.param4), (number + 1.0, boot, series));
    assert_eq!(command.x, 9);
    // The last reading was 10 ms old when it was heard: that much is given away, and no more than the rounding beside.
    let wanted = world.radio.clock_ms(world.off_by);
    let short_ms = wanted.wrapping_sub(command.y.cast_unsigned());
    assert!((10..=12).contains(&short_ms), "{short_ms}");
    let power_w = 1e-3 * 10f64.powf(f64::from(command.param1) / 10.0);
    assert!(power_w <= 0.123_456 && power_w > 0.1234, "{power_w}");
    let vouched = world.vouched().unwrap();
    assert_eq!(vouched.slot, 9);
    assert!((vouched.power_w - power_w).abs() < 1e-7);
    // Of the 400 ms: a round trip, the radio's step, the rounding.
    let short = world.off_by.saturating_since(vouched.until);
    assert!(short >= ms(20 + 20) && short <= ms(20 + 20 + 5), "{short:?}");
    world.assert_vouched("steady");
    // Not renewed: off by itself and by us.
    world.run(ms(450));
    assert_eq!((world.radio.on, world.vouched()), (None, None));
    assert!(world.transmitter.is_off(world.now));
}

#[test]
fn spec_off_goes_out_in_the_same_call_and_again_until_it_is_confirmed() {
    let mut world = World::settled(3);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(50));
    assert!(world.vouched().is_some());
    world.there.loss = 1.0;
    let before = world.radio.received.len();
    world.silence();
    assert_eq!(world.vouched(), None);
    assert!(!world.transmitter.is_off(world.now), "not on no evidence");
    world.run(ms(30));
    world.there.loss = 0.0;
    world.run(ms(40));
    assert!(world.radio.on.is_none() && world.radio.received.len() > before);
    assert!(world.transmitter.is_off(world.now));
}

#[test]
fn spec_without_an_answer_it_is_off_when_every_expiry_is_past_and_not_before() {
    let mut world = World::settled(3);
    assert_eq!(world.command(0.1, 1, 300), Ok(()));
    world.run(ms(50));
    world.there.loss = 1.0;
    world.silence();
    world.run(ms(249));
    assert!(!world.transmitter.is_off(world.now));
    world.run(ms(1));
    assert!(world.transmitter.is_off(world.now) && world.radio.on.is_none());
}

#[test]
fn spec_what_ends_at_once_or_is_no_power_is_off() {
    for (power_w, for_ms) in [(0.1, 0), (0.0, 500), (-1.0, 500), (f64::NAN, 500), (f64::INFINITY, 500)] {
        let mut world = World::settled(1);
        let before = world.radio.received.len();
        assert_eq!(world.command(power_w, 1, for_ms), Ok(()));
        world.run(ms(10));
        let sent = &world.radio.received[before..];
        assert!(
            !sent.is_empty() && sent.iter().all(|c| c.param1 == f32::NEG_INFINITY),
            "{power_w}: {sent:?}"
        );
    }
}

#[test]
fn spec_no_power_expires_at_or_before_the_reading_that_it_counts_from() {
    for (micros, on) in [(1, false), (999, false), (1000, false), (1002, true), (2000, true)] {
        let mut world = World::settled(1);
        let reading = world.radio.report(world.now);
        world.hear(&reading);
        let before = world.radio.received.len();
        world.off_by = world.now + Duration::from_micros(micros);
        assert_eq!(world.transmitter.command(0.1, 1, world.off_by, world.now), Ok(()));
        world.send();
        world.run(ms(1));
        let [sent] = &world.radio.received[before..] else { panic!("{micros}: not one command") };
        assert_eq!(sent.param1.is_finite(), on, "{micros} us: {sent:?}");
        let ahead_ms = sent.y.cast_unsigned().wrapping_sub(reading.time_ms) as i32;
        assert!(!on || ahead_ms > 0, "{micros} us: {ahead_ms} ms");
    }
}

#[test]
fn spec_a_reading_older_than_a_second_is_not_used_and_its_age_is_said() {
    let mut world = World::settled(2);
    world.back.loss = 1.0;
    world.run(ms(780));
    assert_eq!(world.command(0.1, 1, 300), Ok(()));
    world.run(ms(250));
    let Err(NotReady::Stale { age }) = world.command(0.1, 1, 300) else { panic!("no reading for a second") };
    assert!(age > ms(1000) && age <= ms(1250), "{age:?}");
    let last = world.commands.last().map(|(_, c)| c.param1);
    assert_eq!(last, Some(f32::NEG_INFINITY), "told to be silent at once");
    world.back.loss = 0.0;
    world.run(ms(300));
    assert_eq!(world.command(0.1, 1, 300), Ok(()));
}

#[test]
fn spec_a_radio_too_far_away_is_refused_beforehand_with_the_number() {
    let mut world = World::settled(200);
    let Err(NotReady::TooSlow { round_trip, longest }) = world.transmitter.ready(world.now) else {
        panic!("{:?}", world.transmitter.ready(world.now))
    };
    assert!((round_trip.as_millis(), longest.as_millis()) == (400, 300), "{round_trip:?}");
    let words = NotReady::TooSlow { round_trip, longest }.to_string();
    assert!(words.contains("400 ms") && words.contains("300 ms"), "{words}");
    let checks = world.transmitter.preflight(world.now);
    assert!(checks.iter().any(|check| check.result == Verdict::Fail && check.detail == words), "{checks:?}");
    // The way is short again: in time that is what counts.
    (world.there, world.back) = (Way::steady(5), Way::steady(5));
    world.run(ms(3500));
    assert_eq!(world.transmitter.ready(world.now), Ok(()));
    // And nothing answers any more.
    world.there.loss = 1.0;
    world.run(ms(3100));
    assert_eq!(world.transmitter.ready(world.now), Err(NotReady::NotAnswered));
}

#[test]
fn spec_a_refusal_vouches_for_nothing_and_what_was_in_force_goes_on() {
    let mut world = World::settled(2);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(20));
    let before = world.vouched().unwrap();
    world.radio.refuses = Some(VeilwingRadioResult::VEILWING_RADIO_RESULT_DENIED);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(20));
    let after = world.vouched().unwrap();
    assert!(after.until <= before.until + ms(1), "{before:?} {after:?}");
    world.assert_vouched("denied");
    // It falls silent on its own account: heard of, it is vouched for no longer.
    world.radio.on = None;
    world.run(ms(210));
    assert_eq!(world.vouched(), None);
}

#[test]
fn spec_what_is_wrong_with_the_radios_device_is_told_until_a_command_is_carried_out_again() {
    use VeilwingRadioResult as Is;
    for (result, trouble) in [
        (Is::VEILWING_RADIO_RESULT_TOO_LOW, Trouble::TooLow),
        (Is::VEILWING_RADIO_RESULT_DEVICE_LATE, Trouble::DeviceLate),
        (Is::VEILWING_RADIO_RESULT_DEVICE_ERROR, Trouble::DeviceError),
        (Is::VEILWING_RADIO_RESULT_OTHER_POWER, Trouble::OtherPower),
    ] {
        let mut world = World::settled(2);
        assert_eq!(world.command(0.1, 1, 500), Ok(()));
        world.run(ms(20));
        assert!(world.vouched().is_some() && world.transmitter.trouble().is_none());
        (world.radio.refuses, world.radio.on) = (Some(result), None);
        assert_eq!(world.command(0.1, 1, 500), Ok(()));
        world.run(ms(20));
        assert_eq!((world.vouched(), world.transmitter.trouble()), (None, Some(trouble)));
        assert_eq!(world.transmitter.ready(world.now), Err(NotReady::Trouble(trouble)));
        // What is refused for another reason does not hide it.
        world.radio.refuses = Some(Is::VEILWING_RADIO_RESULT_DENIED);
        assert_eq!(world.command(0.1, 1, 500), Ok(()));
        world.run(ms(20));
        assert_eq!(world.transmitter.trouble(), Some(trouble));
        world.radio.refuses = None;
        world.silence();
        world.run(ms(20));
        assert_eq!((world.transmitter.trouble(), world.transmitter.ready(world.now)), (None, Ok(())));
    }
}

#[test]
fn spec_a_power_asked_for_anew_is_vouched_for_when_it_is_answered() {
    let mut world = World::settled(5);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(20));
    assert_eq!(world.command(0.05, 1, 500), Ok(()));
    assert_eq!(world.vouched(), None, "it may be either");
    world.run(ms(20));
    assert!((world.vouched().unwrap().power_w - 0.05).abs() < 1e-4);
    // A shorter expiry counts from its sending on.
    let long = world.vouched().unwrap().until;
    assert_eq!(world.command(0.05, 1, 200), Ok(()));
    assert!(world.vouched().unwrap().until < long);
    world.assert_vouched("shortened");
}

#[test]
fn spec_a_radio_of_the_first_form_is_named_in_the_preflight() {
    let mut transmitter = transmitter(1, Instant::ZERO);
    let ack = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command: MavCmd::MAV_CMD_USER_1,
        ..COMMAND_ACK_DATA::DEFAULT
    });
    let header = MavHeader { system_id: RADIO.0.into(), component_id: RADIO.1, sequence: 0 };
    transmitter.handle_message(header, &ack, Instant::ZERO);
    let checks = transmitter.preflight(Instant::ZERO);
    let expiry = checks.iter().find(|check| check.name == "transmitter expiry").unwrap();
    assert!(expiry.result == Verdict::Fail && expiry.detail.contains("form = 1"), "{expiry:?}");
    assert_eq!(transmitter.on_until_at_least(Instant::ZERO), None);
    let given = transmitter.command(0.1, 1, Instant::from_start(ms(500)), Instant::ZERO);
    assert_eq!(given, Err(NotReady::NotHeard), "an instant of a clock is a long time to it");
}

#[test]
fn spec_strangers_and_words_to_others_change_nothing() {
    let mut world = World::new(Way { loss: 1.0, ..Way::steady(1) }, Way::steady(1));
    let mut report = world.radio.report(world.now);
    (report.boot, report.newest) = (78, 1);
    let stranger = MavHeader { system_id: 2, component_id: 68, sequence: 0 };
    let message = RadioMessage::VEILWING_RADIO(report.clone());
    world.transmitter.handle_radio(stranger, &message, world.now);
    assert_eq!(world.transmitter.supports_expiry(), None);
    // What answers a number that was never given answers nothing.
    (report.newest, report.answers_boot, report.answers) = (9, 78, 9);
    world.hear(&report);
    assert_eq!(world.transmitter.supports_expiry(), None);
    assert_eq!(world.command(0.1, 1, 300), Err(NotReady::NotHeard));
}

#[test]
fn spec_a_radio_whose_device_failed_vouches_for_nothing() {
    use crate::transmitter::wire::VeilwingRadioResult as Is;
    for result in [
        Is::VEILWING_RADIO_RESULT_TOO_LOW,
        Is::VEILWING_RADIO_RESULT_DEVICE_LATE,
        Is::VEILWING_RADIO_RESULT_DEVICE_ERROR,
        Is::VEILWING_RADIO_RESULT_OTHER_POWER,
    ] {
        let mut world = World::settled(10);
        assert_eq!(world.command(0.1, 9, 400), Ok(()));
        world.run(ms(25));
        assert_eq!(world.command(0.1, 9, 400), Ok(()));
        assert!(world.vouched().is_some());
        let number = world.radio.received.last().unwrap().param2 as u32 + 1;
        // What it may radiate is not what it certainly radiates.
        let report = VEILWING_RADIO_DATA {
            time_ms: world.radio.clock_ms(world.now),
            boot: 78,
            newest: number,
            answers_boot: 78,
            answers: number,
            series: world.radio.series,
            expires_ms: world.radio.clock_ms(world.now + ms(400)),
            power_mdbm: 20_000,
            result,
        };
        let header = mavlink::MavHeader { system_id: RADIO.0.into(), component_id: RADIO.1, sequence: 0 };
        let message = crate::transmitter::wire::MavMessage::VEILWING_RADIO(report);
        world.transmitter.handle_radio(header, &message, world.now);
        assert_eq!(world.vouched(), None, "{result:?}");
    }
}

#[test]
fn spec_a_radio_that_asks_whether_we_are_there_is_answered() {
    use mavlink::dialects::ardupilotmega::TIMESYNC_DATA;
    let mut world = World::settled(10);
    while world.transmitter.poll_transmit().is_some() {}
    let ask = |component_id, tc1| {
        let header = mavlink::MavHeader { system_id: RADIO.0.into(), component_id, sequence: 0 };
        (header, MavMessage::TIMESYNC(TIMESYNC_DATA { tc1, ts1: 4711, ..TIMESYNC_DATA::default() }))
    };
    for (component, tc1, answered) in [(RADIO.1, 0, true), (RADIO.1, 5, false), (1, 0, false)] {
        let (header, message) = ask(component, tc1);
        world.transmitter.handle_message(header, &message, world.now);
        let answer = world.transmitter.poll_transmit();
        let is_answer = matches!(&answer, Some(MavMessage::TIMESYNC(m)) if m.ts1 == 4711 && m.tc1 > 0);
        assert_eq!(is_answer, answered, "{answer:?}");
    }
}
