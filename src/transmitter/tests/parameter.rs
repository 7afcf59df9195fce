//! Power by parameter.

use super::*;

#[test]
fn spec_a_level_table_gives_the_strongest_level_within_the_power_and_is_turned_off_by_us() {
    let levels = [(1.0, 0.01), (2.0, 0.025), (5.0, 0.1)].map(|(value, power_w)| Level { value, power_w });
    let mut transmitter = by_parameter(Unit::Levels(levels.to_vec()), Protocol::Classic);
    assert_eq!(transmitter.supports_expiry(), Some(false));
    assert_eq!(transmitter.limit_w(), Some(0.1));
    let expiry = transmitter
        .preflight(Instant::ZERO)
        .into_iter()
        .find(|check| check.name == "transmitter expiry")
        .unwrap();
    assert!(expiry.result == Verdict::Warn && expiry.detail.contains("S5"), "{expiry:?}");
    // The type first.
    assert!(matches!(drain(&mut transmitter).as_slice(), [MavMessage::PARAM_REQUEST_READ(_)]));
    let mut now = Instant::from_start(ms(10));
    give(&mut transmitter, &classic(5.0), now);
    let set = |messages: &[MavMessage]| match messages.last() {
        Some(MavMessage::PARAM_SET(p)) => p.param_value,
        other => panic!("{other:?}"),
    };
    assert_eq!(set(&drain(&mut transmitter)), 0.0, "found on: told off");
    assert!(!transmitter.is_off(now));
    for _ in 0..2 {
        give(&mut transmitter, &classic(0.0), now);
        now = now + ms(60);
        transmitter.handle_timeout(now);
    }
    assert!(transmitter.is_off(now));
    drain(&mut transmitter);

    transmitter.set(0.05, 4, now + ms(300), now).unwrap();
    assert_eq!(set(&drain(&mut transmitter)), 2.0);
    assert_eq!(transmitter.acknowledged(), None);
    let expires_at = now + ms(300);
    give(&mut transmitter, &classic(2.0), now + ms(8));
    assert_eq!(transmitter.acknowledged(), Some(Lease { power_w: 0.025, slot: 4, expires_at }));
    assert_eq!(transmitter.round_trip(now + ms(8)), Some(ms(8)));
    assert_eq!(transmitter.poll_timeout().map(|(at, _)| at), Some(expires_at), "nothing to repeat");
    // Nobody renews: we turn it off ourselves.
    transmitter.handle_timeout(expires_at);
    assert_eq!(set(&drain(&mut transmitter)), 0.0);
    assert!(transmitter.acknowledged().is_none() && !transmitter.is_off(expires_at));
    // Too weak for every level: off, not more than was asked for.
    transmitter.set(0.001, 4, expires_at + ms(300), expires_at).unwrap();
    transmitter.handle_timeout(expires_at + ms(60));
    assert_eq!(set(&drain(&mut transmitter)), 0.0);
}

#[test]
fn val_extended_parameters_carry_their_own_type_and_unit() {
    for (unit, kind, expected) in [
        (
            Unit::Watt,
            MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32,
            0.0504f32.next_down().to_le_bytes().to_vec(),
        ),
        (Unit::Milliwatt, MavParamExtType::MAV_PARAM_EXT_TYPE_UINT16, vec![50, 0]),
        (Unit::Dbm, MavParamExtType::MAV_PARAM_EXT_TYPE_INT8, vec![17]),
    ] {
        let mut transmitter = by_parameter(unit, Protocol::Extended);
        drain(&mut transmitter);
        let value = PARAM_EXT_VALUE_DATA {
            param_count: 1,
            param_index: 0,
            param_id: "TX_POWER".into(),
            param_value: [0u8; 128].into(),
            param_type: kind,
        };
        give(&mut transmitter, &MavMessage::PARAM_EXT_VALUE(value), Instant::ZERO);
        transmitter.set(0.0504, 1, Instant::from_start(ms(500)), Instant::ZERO).unwrap();
        let Some(MavMessage::PARAM_EXT_SET(set)) = drain(&mut transmitter).pop() else { panic!() };
        assert_eq!(set.param_type, kind);
        let sent = &set.param_value[..expected.len()];
        if kind == MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32 {
            let value = f32::from_le_bytes([sent[0], sent[1], sent[2], sent[3]]);
            assert!(f64::from(value) <= 0.0504 && value > 0.050_399, "{value}");
        } else {
            assert_eq!(sent, expected);
        }
        let ack = PARAM_EXT_ACK_DATA {
            param_id: set.param_id,
            param_value: set.param_value,
            param_type: kind,
            param_result: ParamAck::PARAM_ACK_ACCEPTED,
        };
        give(&mut transmitter, &MavMessage::PARAM_EXT_ACK(ack), Instant::from_start(ms(5)));
        let lease = transmitter.acknowledged().unwrap();
        assert!(lease.power_w <= 0.0504 && lease.power_w > 0.0498, "{lease:?}");
    }
}

#[test]
fn spec_an_adopted_system_is_the_one_commanded_and_the_first_word_is_off() {
    let now = Instant::from_start(Duration::from_secs(5));
    let settings = Settings {
        own: OWN,
        target: (OWN.0, 68),
        kind: Kind::Leased { command: 31010 },
        boot: 1,
        longest_round_trip: Duration::from_millis(150),
        apart: false,
        system_is_given: false,
        first_off_after: Duration::ZERO,
    };
    let mut transmitter = Transmitter::new(settings, now);
    while transmitter.poll_transmit().is_some() {}
    transmitter.adopt_system(OWN.0 + 6, now);
    let commands: Vec<_> = std::iter::from_fn(|| transmitter.poll_transmit())
        .filter_map(|message| match message {
            MavMessage::COMMAND_INT(command) => Some(command),
            _ => None,
        })
        .collect();
    assert!(!commands.is_empty());
    for command in commands {
        assert_eq!((command.target_system, command.target_component), (OWN.0 + 6, 68));
        assert!(command.y <= 0 || command.param1 == f32::NEG_INFINITY, "not an off: {command:?}");
    }
}

/// A radio of two levels, the first of which radiates nothing either; told off, and of a known type.
fn of_two_levels() -> (Transmitter, Instant) {
    let levels = [(1.0, 0.0), (2.0, 0.1)].map(|(value, power_w)| Level { value, power_w });
    let mut transmitter = by_parameter(Unit::Levels(levels.to_vec()), Protocol::Classic);
    let now = Instant::from_start(ms(10));
    (0..2).for_each(|_| give(&mut transmitter, &classic(0.0), now));
    assert!(transmitter.is_off(now));
    drain(&mut transmitter);
    (transmitter, now)
}

#[test]
fn spec_a_level_without_power_is_no_power_in_force() {
    let (mut transmitter, now) = of_two_levels();
    transmitter.set(0.05, 4, now + ms(300), now).unwrap();
    give(&mut transmitter, &classic(1.0), now + ms(8));
    assert_eq!(transmitter.acknowledged(), None);
}

#[test]
fn val_the_round_trip_of_a_value_that_was_set_twice_counts_from_the_first_time() {
    let (mut transmitter, now) = of_two_levels();
    transmitter.set(0.1, 4, now + ms(300), now).unwrap();
    transmitter.handle_timeout(now + ms(50));
    assert_eq!(drain(&mut transmitter).len(), 2);
    give(&mut transmitter, &classic(2.0), now + ms(80));
    assert_eq!(transmitter.round_trip(now + ms(80)), Some(ms(80)));
}
