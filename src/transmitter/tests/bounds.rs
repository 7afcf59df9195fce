//! The instants at which a leased radio's driver, and what all drivers share, changes its mind: the last moment before
//! each, and the moment itself.

use super::*;

const MICROSECOND: Duration = Duration::from_micros(1);

/// A companion whose commands all get lost, one second after it began; nothing is left to be sent.
fn deaf() -> World {
    let mut world = World::new(Vec::new);
    world.now = world.now + Duration::from_secs(1);
    drain(&mut world.transmitter);
    world
}

fn ack(result_param2: i32, (target_system, target_component): (u8, u8)) -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command: MavCmd::MAV_CMD_USER_1,
        result: MavResult::MAV_RESULT_ACCEPTED,
        progress: 0,
        result_param2,
        target_system,
        target_component,
    })
}

/// The expiries of the power commands that wait to be sent, 0 for off.
fn commanded(transmitter: &mut Transmitter) -> Vec<i32> {
    let expiry = |message| match message {
        MavMessage::COMMAND_INT(command) => Some(command.y),
        _ => None,
    };
    drain(transmitter).into_iter().filter_map(expiry).collect()
}

#[test]
fn spec_a_renewal_waits_for_the_answer_to_the_last_command_and_a_change_does_not() {
    let mut world = deaf();
    let sent_at = world.now;
    world.transmitter.set(0.1, 1, sent_at + ms(500), sent_at).unwrap();
    assert_eq!(commanded(&mut world.transmitter), [500]);
    world.transmitter.set(0.1, 1, sent_at + ms(550), sent_at + ms(50)).unwrap();
    assert!(commanded(&mut world.transmitter).is_empty(), "the first may still be answered");
    world.transmitter.handle_timeout(sent_at + ms(99));
    assert!(commanded(&mut world.transmitter).is_empty());
    world.transmitter.handle_timeout(sent_at + ms(100));
    assert_eq!(commanded(&mut world.transmitter), [450]);
    // Its time over, a renewal goes out in the same call; another power or slot does so at any time.
    world.transmitter.set(0.1, 1, sent_at + ms(700), sent_at + ms(200)).unwrap();
    assert_eq!(commanded(&mut world.transmitter), [500]);
    world.transmitter.set(0.1, 1, sent_at + ms(800), sent_at + ms(350)).unwrap();
    assert_eq!(commanded(&mut world.transmitter), [450]);
    world.transmitter.set(0.2, 1, sent_at + ms(800), sent_at + ms(351)).unwrap();
    assert_eq!(commanded(&mut world.transmitter), [449]);
    world.transmitter.set(0.2, 2, sent_at + ms(800), sent_at + ms(352)).unwrap();
    assert_eq!(commanded(&mut world.transmitter), [448]);
}

#[test]
fn spec_a_power_that_is_not_answered_is_commanded_again() {
    let mut world = deaf();
    let sent_at = world.now;
    world.transmitter.set(0.1, 1, sent_at + ms(500), sent_at).unwrap();
    commanded(&mut world.transmitter);
    world.transmitter.handle_timeout(sent_at + ms(100));
    assert_eq!(commanded(&mut world.transmitter), [400]);
}

#[test]
fn spec_a_lease_lasts_over_a_renewal_and_not_over_a_change() {
    let mut world = deaf();
    let sent_at = world.now;
    world.transmitter.set(0.1, 1, sent_at + ms(500), sent_at).unwrap();
    world.give(&ack(20_000, OWN));
    let lease = world.transmitter.acknowledged();
    assert_eq!(lease.map(|lease| (lease.slot, lease.expires_at)), Some((1, sent_at + ms(500))));
    world.transmitter.set(0.1, 1, sent_at + ms(600), sent_at + ms(200)).unwrap();
    assert_eq!(world.transmitter.acknowledged(), lease, "the radio follows one of the two");
    for (power_w, slot) in [(0.2, 1), (0.1, 2)] {
        let mut changed = Transmitter { outbox: VecDeque::new(), ..world.transmitter.clone() };
        changed.set(power_w, slot, sent_at + ms(600), sent_at + ms(250)).unwrap();
        assert_eq!(changed.acknowledged(), None);
    }
}

#[test]
fn spec_an_answer_to_all_or_to_us_counts_and_one_to_another_component_does_not() {
    for (target, counts) in [((0, 0), true), ((1, 0), true), ((0, 191), true), (OWN, true), ((1, 77), false)]
    {
        let mut world = deaf();
        world.give(&ack(i32::MIN, target));
        assert_eq!(world.transmitter.supports_expiry(), counts.then_some(true), "{target:?}");
    }
}

#[test]
fn spec_after_a_second_a_command_is_lost_and_its_answer_is_another_s() {
    let mut world = deaf();
    let sent_at = world.now;
    world.transmitter.set(0.1, 1, sent_at + ms(3000), sent_at).unwrap();
    world.transmitter.handle_timeout(sent_at + ms(100));
    world.now = sent_at + ms(1000);
    world.give(&ack(20_000, OWN));
    assert_eq!(world.transmitter.round_trip(world.now), Some(ms(900)));
}

/// The delivery may take half a second, and the expiry counts from it.
#[test]
fn spec_what_was_commanded_is_over_when_its_expiry_and_the_longest_way_are() {
    let mut world = deaf();
    let sent_at = world.now;
    world.transmitter.set(0.1, 1, sent_at + ms(400), sent_at).unwrap();
    world.transmitter.silence(sent_at + ms(10));
    assert!(!world.transmitter.is_off(sent_at + ms(900) - MICROSECOND));
    assert!(world.transmitter.is_off(sent_at + ms(900)));
}

#[test]
fn spec_what_an_earlier_process_commanded_is_over_after_two_seconds_if_the_radio_lets_it_run_out() {
    let mut world = deaf();
    let later = world.now + Duration::from_secs(60);
    assert!(!world.transmitter.is_off(later), "nothing is known of this radio");
    world.give(&ack(i32::MIN, OWN));
    world.transmitter.silence(world.now);
    assert!(!world.transmitter.is_off(world.now + ms(2000) - MICROSECOND));
    assert!(world.transmitter.is_off(world.now + ms(2000)));
}

#[test]
fn val_a_leased_power_is_given_less_time_than_it_may_last_and_vouched_for_less_than_it_was_given() {
    let mut world = deaf();
    let now = world.now;
    world.transmitter.command(0.1, 1, now + ms(500), now).unwrap();
    assert_eq!(commanded(&mut world.transmitter), [480], "20 ms on the way");
    assert_eq!(world.transmitter.on_until_at_least(now), None);
    world.now = now + ms(15);
    world.give(&ack(20_000, OWN));
    // 480 from the sending on, less 50 and two round trips of 15.
    let until = now + ms(400);
    let vouched = world.transmitter.on_until_at_least(until - MICROSECOND).unwrap();
    assert_eq!((vouched.slot, vouched.until), (1, until));
    assert!((vouched.power_w - 0.1).abs() < 1e-12);
    assert_eq!(world.transmitter.on_until_at_least(until), None);
    // Two round trips are longer than 20 ms.
    world.transmitter.command(0.2, 1, now + ms(500), now + ms(15)).unwrap();
    assert_eq!(commanded(&mut world.transmitter), [500 - 15 - 30]);
}

/// It would go on for ever.
#[test]
fn spec_a_parameter_is_never_set_to_a_power_whose_time_is_over() {
    let mut transmitter = by_parameter(Unit::Milliwatt, Protocol::Classic);
    give(&mut transmitter, &classic(0.0), Instant::ZERO);
    drain(&mut transmitter);
    let now = Instant::from_start(ms(100));
    transmitter.set(0.1, 1, now, now).unwrap();
    let sent = drain(&mut transmitter);
    assert!(matches!(&sent[..], [MavMessage::PARAM_SET(set)] if set.param_value == 0.0), "{sent:?}");
}

fn beginning(kind: Kind, first_off_after: Duration, now: Instant) -> Transmitter {
    let settings = Settings {
        own: OWN,
        target: RADIO,
        kind,
        boot: 1,
        longest_round_trip: ms(150),
        apart: false,
        system_is_given: false,
        first_off_after,
    };
    Transmitter::new(settings, now)
}

fn kinds() -> [Kind; 3] {
    let name = "TX_POWER".to_owned();
    let parameter =
        PowerParameter { name, protocol: Protocol::Classic, unit: Unit::Milliwatt, off_value: 0.0 };
    [Kind::Numbered { command: 31010 }, Kind::Leased { command: 31010 }, Kind::Parameter(parameter)]
}

/// A dead companion's promise to the peer runs out by itself, but for a parameter's.
#[test]
fn spec_the_first_off_waits_as_it_was_told_unless_the_power_never_runs_out() {
    let now = Instant::from_start(Duration::from_secs(5));
    let [numbered, leased, parameter] = kinds();
    for kind in [numbered, leased] {
        let mut transmitter = beginning(kind, ms(1000), now);
        for adopted in [false, true] {
            if adopted {
                transmitter.adopt_system(7, now);
            }
            transmitter.handle_timeout(now);
            transmitter.handle_timeout(now + ms(999));
            assert!(commanded(&mut transmitter).is_empty(), "{adopted}");
        }
        transmitter.handle_timeout(now + ms(1000));
        let sent = drain(&mut transmitter);
        let off_to_it =
            |m: &MavMessage| matches!(m, MavMessage::COMMAND_INT(c) if c.y == 0 && c.target_system == 7);
        assert_eq!(sent.iter().filter(|m| off_to_it(m)).count(), 1, "{sent:?}");
    }
    assert_eq!(drain(&mut beginning(parameter, ms(1000), now)).len(), 1);
}

#[test]
fn spec_numbered_commands_alone_are_told_apart() {
    let told_apart =
        kinds().map(|kind| beginning(kind, Duration::ZERO, Instant::ZERO).tells_commands_apart());
    assert_eq!(told_apart, [true, false, false]);
}

#[test]
fn spec_a_radio_is_told_off_again_after_more_than_two_and_a_half_seconds_of_silence() {
    for kind in kinds() {
        for (silent_for, again) in [(ms(2500), false), (ms(2500) + MICROSECOND, true)] {
            let mut transmitter = beginning(kind.clone(), Duration::ZERO, Instant::ZERO);
            let stranger_to_it = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
            give(&mut transmitter, &stranger_to_it, Instant::ZERO);
            drain(&mut transmitter);
            give(&mut transmitter, &stranger_to_it, Instant::from_start(silent_for));
            assert_eq!(!drain(&mut transmitter).is_empty(), again, "{kind:?} {silent_for:?}");
        }
    }
}

#[test]
fn spec_what_a_radio_declares_is_asked_for_five_times_and_its_limit_taken_from_its_own_parameter() {
    let mut world = deaf();
    let asked = |transmitter: &mut Transmitter| {
        drain(transmitter).iter().filter(|m| matches!(m, MavMessage::PARAM_REQUEST_READ(_))).count()
    };
    let counts = (0..8).map(|second| {
        world.transmitter.handle_timeout(world.now + ms(1000 * second));
        asked(&mut world.transmitter)
    });
    assert_eq!(counts.collect::<Vec<_>>(), [8, 8, 8, 8, 8, 0, 0, 0]);
    let value = |name: &str, param_value| {
        MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value,
            param_id: name.into(),
            ..PARAM_VALUE_DATA::default()
        })
    };
    for no_limit in [value("TX_POWER", 10.0), value("TX_MAX_DBM", f32::NAN)] {
        world.give(&no_limit);
        assert_eq!(world.transmitter.limit_w(), None);
    }
    world.give(&value("TX_MAX_DBM", 20.0));
    assert!((world.transmitter.limit_w().unwrap() - 0.1).abs() < 1e-12);
}

#[test]
fn spec_the_preflight_names_a_radio_that_is_not_there_and_a_command_that_is_none() {
    let first = |kind| beginning(kind, Duration::ZERO, Instant::ZERO).preflight(Instant::ZERO).swap_remove(0);
    let none = first(Kind::None);
    assert!(none.result == Verdict::Warn && none.detail.contains("nothing radiates"), "{none:?}");
    for kind in [Kind::Numbered { command: u16::MAX }, Kind::Leased { command: u16::MAX }] {
        let check = first(kind);
        assert!(check.result == Verdict::Fail && check.detail.contains("65535 is no MAV_CMD"), "{check:?}");
    }
    let numbered = beginning(Kind::Numbered { command: 31010 }, Duration::ZERO, Instant::ZERO);
    let checks = numbered.preflight(Instant::ZERO);
    assert!(checks.iter().any(|check| check.detail == "the radio has not answered yet"), "{checks:?}");
}

#[test]
fn spec_an_answer_is_ours_by_the_system_that_was_adopted() {
    let mut world = deaf();
    world.transmitter.adopt_system(7, world.now);
    let header = MavHeader { system_id: 7, component_id: RADIO.1, sequence: 0 };
    world.transmitter.handle_message(header, &ack(i32::MIN, OWN), world.now);
    assert_eq!(world.transmitter.supports_expiry(), None, "another's");
    world.transmitter.handle_message(header, &ack(i32::MIN, (7, OWN.1)), world.now);
    assert_eq!(world.transmitter.supports_expiry(), Some(true));
}
