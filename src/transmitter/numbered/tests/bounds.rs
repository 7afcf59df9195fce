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
