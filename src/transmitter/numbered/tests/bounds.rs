//! What counts as an answer, as a series and as a confirmation, up to the edges of each.

use super::*;

/// A companion whose commands all get lost, just begun.
fn deaf() -> World {
    let mut world = World::new(Way { loss: 1.0, ..Way::steady(1) }, Way::steady(1));
    world.transmitter.handle_timeout(world.now);
    world.send();
    world
}

/// The series in each command that waits to be sent.
fn series_sent(world: &mut World) -> Vec<u32> {
    let series = |message| match message {
        MavMessage::COMMAND_INT(command) => Some(command.param4 as u32),
        _ => None,
    };
    std::iter::from_fn(|| world.transmitter.poll_transmit()).filter_map(series).collect()
}

fn tell(world: &mut World, report: &VEILWING_RADIO_DATA) {
    let header = MavHeader { system_id: RADIO.0.into(), component_id: RADIO.1, sequence: 0 };
    world.transmitter.handle_radio(header, &RadioMessage::VEILWING_RADIO(report.clone()), world.now);
}

/// What a radio says that has obeyed another boot so far.
fn of_another(series: u32) -> VEILWING_RADIO_DATA {
    let mut radio = Radio::new(3);
    (radio.boot, radio.newest, radio.series) = (5, 9, series);
    radio.report(Instant::ZERO)
}

#[test]
fn spec_a_number_beyond_ours_is_ignored_wherever_it_stands() {
    let mut world = deaf();
    for (answers, newest) in [(9, 9), (9, 1), (1, 9), (0, 9)] {
        let report = VEILWING_RADIO_DATA { boot: 78, newest, answers_boot: 78, answers, ..of_another(4) };
        tell(&mut world, &report);
        assert_eq!(world.transmitter.supports_expiry(), None, "answers {answers}, newest {newest}");
    }
    // Another boot's numbers are its own.
    tell(&mut world, &VEILWING_RADIO_DATA { answers_boot: 5, answers: 9, ..of_another(4) });
    assert_eq!(world.transmitter.supports_expiry(), Some(true));
}

#[test]
fn spec_the_series_is_taken_from_a_report_that_nobody_asked_for_until_there_is_an_answer() {
    let mut world = deaf();
    tell(&mut world, &of_another(40));
    world.transmitter.silence(world.now);
    assert_eq!(series_sent(&mut world), [40]);
    // Our command came through and its answer did not: what that drew is told by an answer.
    tell(&mut world, &VEILWING_RADIO_DATA { boot: 78, newest: 1, ..of_another(41) });
    world.transmitter.silence(world.now);
    assert_eq!(series_sent(&mut world), [40]);
    // An answer says that it obeys another by now; an older report comes late.
    tell(&mut world, &VEILWING_RADIO_DATA { answers_boot: 78, answers: 2, ..of_another(42) });
    tell(&mut world, &of_another(40));
    world.transmitter.silence(world.now);
    assert!(series_sent(&mut world).iter().all(|&series| series == 42));
}

#[test]
fn spec_a_boot_that_is_taken_keeps_its_series_whatever_comes_late() {
    let mut world = World::settled(2);
    let series = world.radio.series;
    tell(&mut world, &of_another(series + 1));
    let before = world.radio.received.len();
    world.run(ms(300));
    let sent = &world.radio.received[before..];
    assert!(!sent.is_empty() && sent.iter().all(|c| c.param4 as u32 != series + 1), "{sent:?}");
}

#[test]
fn spec_a_radio_that_obeys_another_is_told_off_anew_but_not_in_a_storm() {
    for (after, again) in [(ms(25) - Duration::from_micros(1), 0), (ms(25), 1)] {
        let mut world = deaf();
        world.now = world.now + after;
        tell(&mut world, &VEILWING_RADIO_DATA { answers_boot: 78, answers: 1, ..of_another(42) });
        assert_eq!(series_sent(&mut world), vec![42; again], "{after:?}");
    }
}

/// The radio may have fallen silent by itself: that says nothing of the commands that are still under way to it.
#[test]
fn spec_off_is_confirmed_by_the_number_of_an_off() {
    let mut world = World::settled(2);
    assert_eq!(world.command(0.1, 1, 600), Ok(()));
    world.run(ms(50));
    world.there.loss = 1.0;
    world.silence();
    world.radio.on = None;
    world.run(ms(300));
    assert!(!world.transmitter.is_off(world.now));
    world.there.loss = 0.0;
    world.run(ms(60));
    assert!(world.transmitter.is_off(world.now));
}

#[test]
fn spec_another_radio_is_off_when_it_has_answered_an_off_of_its_own() {
    let mut world = World::settled(2);
    let mut late = world.radio.report(world.now);
    let last = world.radio.received.last().unwrap().param2 as u32;
    (late.answers_boot, late.answers) = (78, last);
    world.transmitter.adopt_system(OWN.0, world.now);
    world.hear(&late);
    assert!(!world.transmitter.is_off(world.now));
    world.run(ms(10));
    assert!(world.transmitter.is_off(world.now));
}

#[test]
fn spec_an_unanswered_off_is_repeated_after_25_ms() {
    let mut world = World::settled(2);
    world.there.loss = 1.0;
    let number = |world: &World| world.must_end.last_key_value().unwrap().0.1;
    let before = number(&world);
    world.silence();
    world.run(ms(24));
    assert_eq!(number(&world), before + 1);
    world.run(ms(1));
    assert_eq!(number(&world), before + 2);
}

const MICROSECOND: Duration = Duration::from_micros(1);

#[test]
fn spec_a_round_trip_of_the_longest_length_serves_and_a_longer_one_does_not() {
    for (delay_ms, serves) in [(150, true), (151, false)] {
        let world = World::settled(delay_ms);
        assert_eq!(world.transmitter.round_trip(world.now), Some(ms(2 * delay_ms)));
        assert_eq!(world.transmitter.ready(world.now).is_ok(), serves, "{delay_ms}");
    }
}

#[test]
fn spec_a_reading_of_the_clock_serves_for_a_second() {
    let mut world = World::settled(2);
    let report = world.radio.report(world.now);
    world.hear(&report);
    let second_later = world.now + Duration::from_secs(1);
    let ready = |now| world.transmitter.ready(now);
    assert_eq!(ready(second_later), Ok(()));
    let age = Duration::from_secs(1) + MICROSECOND;
    assert_eq!(ready(second_later + MICROSECOND), Err(NotReady::Stale { age }));
    // Heard, and obeying another: its clock is not ours to use, and after a second it has gone silent.
    let mut world = deaf();
    tell(&mut world, &of_another(4));
    let ready = |after| world.transmitter.ready(world.now + after);
    assert_eq!(ready(Duration::from_secs(1)), Err(NotReady::NotTaken));
    assert_eq!(ready(age), Err(NotReady::Stale { age }));
}

#[test]
fn spec_what_is_wrong_with_the_device_is_said_by_the_newest_command_that_was_answered() {
    use VeilwingRadioResult as Is;
    let mut world = World::settled(2);
    world.there.loss = 1.0;
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.silence();
    let newest = world.must_end.last_key_value().unwrap().0.1;
    let mut answer = |answers, result| {
        let report = world.radio.report(world.now);
        world.hear(&VEILWING_RADIO_DATA { answers_boot: report.boot, answers, result, ..report });
        world.transmitter.trouble()
    };
    assert_eq!(answer(newest, Is::VEILWING_RADIO_RESULT_DEVICE_LATE), Some(Trouble::DeviceLate));
    let stays = answer(newest - 1, Is::VEILWING_RADIO_RESULT_ACCEPTED);
    assert_eq!(stays, Some(Trouble::DeviceLate), "an older command's");
    assert_eq!(answer(newest, Is::VEILWING_RADIO_RESULT_DEVICE_ERROR), Some(Trouble::DeviceError));
    assert_eq!(answer(newest, Is::VEILWING_RADIO_RESULT_ACCEPTED), None);
}

#[test]
fn val_a_power_that_falls_is_vouched_for_as_it_is_and_until_the_instant_that_was_said() {
    let mut world = World::settled(2);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(10));
    let full = world.vouched().unwrap();
    let mut report = world.radio.report(world.now);
    report.power_mdbm -= 1000;
    world.hear(&report);
    let less = world.vouched().unwrap();
    assert!((less.power_w / full.power_w - 10f64.powf(-0.1)).abs() < 1e-6, "{full:?}, {less:?}");
    assert!(world.transmitter.on_until_at_least(less.until - MICROSECOND).is_some());
    assert_eq!(world.transmitter.on_until_at_least(less.until), None);
}

#[test]
fn spec_a_power_that_is_not_answered_is_commanded_again_after_100_ms_and_not_before() {
    let mut world = World::settled(2);
    world.there.loss = 1.0;
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    let told_at = world.now;
    let mut again = |after| {
        world.transmitter.handle_timeout(told_at + after);
        series_sent(&mut world).len()
    };
    assert_eq!((again(ms(99)), again(ms(100)), again(ms(101))), (0, 1, 0));
}

/// What was commanded may still be under way to a radio that we have turned away from.
#[test]
fn spec_a_radio_is_not_off_before_the_last_expiry_whoever_is_spoken_to_now() {
    let turned = |world: &mut World| {
        world.transmitter.adopt_system(9, world.now);
        assert_eq!(series_sent(world), [0], "the other has not said its own");
    };
    let used_up = |world: &mut World| {
        let Driver::Numbered(numbered) = &mut world.transmitter.driver else { panic!("a numbered radio") };
        numbered.commands.skip_to(WHOLE - 1);
        world.transmitter.silence(world.now);
        assert_eq!(series_sent(world), [world.radio.series], "known from the boot that ends");
        assert_eq!(world.transmitter.poll_timeout().map(|(at, _)| at), Some(world.now + ms(25)));
    };
    for away in [turned as fn(&mut World), used_up] {
        let mut world = World::settled(2);
        world.there.loss = 1.0;
        assert_eq!(world.command(0.1, 1, 400), Ok(()));
        away(&mut world);
        assert!(!world.transmitter.is_off(world.off_by - MICROSECOND));
        assert!(world.transmitter.is_off(world.off_by));
    }
}

#[test]
fn spec_nothing_is_vouched_for_once_a_command_after_the_one_in_force_is_forgotten() {
    let mut world = World::settled(2);
    assert_eq!(world.command(0.1, 1, 900), Ok(()));
    world.run(ms(10));
    world.there.loss = 1.0;
    // 256 are remembered: the one in force among them, then all but that one, then all but the first after it.
    for (more, vouched) in [(255, true), (1, true), (1, false)] {
        (0..more).for_each(|_| assert_eq!(world.command(0.1, 1, 800), Ok(())));
        assert_eq!(world.vouched().is_some(), vouched, "{more}");
    }
}

#[test]
fn spec_what_a_refused_command_leaves_in_force_is_vouched_for_and_what_it_may_leave_is_not() {
    use VeilwingRadioResult as Is;
    for lost in [false, true] {
        let mut world = World::settled(2);
        assert_eq!(world.command(0.1, 1, 500), Ok(()));
        world.run(ms(10));
        let before = world.vouched().unwrap();
        if lost {
            // Half the power, and the radio has it: we do not hear so.
            world.back.loss = 1.0;
            assert_eq!(world.command(0.05, 1, 500), Ok(()));
            world.run(ms(10));
            world.back.loss = 0.0;
        }
        world.radio.refuses = Some(Is::VEILWING_RADIO_RESULT_DENIED);
        assert_eq!(world.command(0.02, 1, 500), Ok(()));
        assert_eq!(world.vouched(), None, "not answered yet");
        world.run(ms(10));
        let after_w = world.vouched().map(|vouched| vouched.power_w);
        assert_eq!(after_w, (!lost).then_some(before.power_w));
        world.assert_vouched("refused");
    }
}

#[test]
fn spec_a_boot_s_numbers_reach_to_those_kept_for_its_last_offs() {
    // Three offs: both of these, and the second again.
    for (number, boot) in [(WHOLE / 2, 78), (WHOLE - 19, 78), (WHOLE - 18, 79)] {
        let mut world = World::settled(2);
        let Driver::Numbered(numbered) = &mut world.transmitter.driver else { panic!("a numbered radio") };
        numbered.commands.skip_to(number);
        world.radio.newest = number;
        world.silence();
        world.silence();
        world.run(ms(60));
        assert_eq!(world.radio.boot, boot, "{number}");
    }
}
