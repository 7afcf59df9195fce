//! Power by lease: expiry, off and off again, a bad wire.

use super::*;

#[test]
fn spec_a_companion_that_starts_tells_the_radio_off_and_learns_that_it_expires() {
    let mut world = World::new(steady(7));
    world.radio.on = Some((20.0, 1, Instant::from_start(Duration::from_secs(100))));
    assert_eq!(world.transmitter.supports_expiry(), None);
    assert!(!world.transmitter.is_off(world.now));
    world.run(ms(20));
    assert_eq!(world.radio.on, None);
    assert_eq!(world.transmitter.supports_expiry(), Some(true));
    assert!(world.transmitter.is_off(world.now));
    world.run(ms(500));
    assert_eq!(world.radio.received.len(), 1, "confirmed: not repeated");
    assert_eq!(world.asked[0].param_id.to_str(), Ok("TX_MAX_DBM"));
    let limit = PARAM_VALUE_DATA {
        param_value: 27.0,
        param_count: 1,
        param_index: 0,
        param_id: "TX_MAX_DBM".into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    };
    world.give(&MavMessage::PARAM_VALUE(limit));
    assert!((world.transmitter.limit_w().unwrap() - 0.501_187).abs() < 1e-6);
    let checks = world.transmitter.preflight(world.now);
    let (warned, rest): (Vec<_>, Vec<_>) =
        checks.into_iter().partition(|check| check.result == Verdict::Warn);
    assert!(rest.len() == 3 && rest.iter().all(|check| check.result == Verdict::Pass), "{rest:?}");
    let [delay] = &warned[..] else { panic!("{warned:?}") };
    assert!(delay.name == "transmitter delay" && delay.detail.contains("after 15 ms"), "{delay:?}");
}

#[test]
fn val_power_and_expiry_on_the_wire_are_rounded_down_and_the_lease_counts_from_the_sending() {
    let mut world = World::new(steady(10));
    world.run(ms(100));
    let sent_at = world.now;
    let expires_at = world.now + Duration::from_micros(400_999);
    world.transmitter.set(0.123_456, 9, expires_at, world.now).unwrap();
    world.run(ms(25));
    let command = world.radio.received.last().unwrap();
    assert_eq!((command.x, command.y), (9, 400));
    let power_w = 1e-3 * 10f64.powf(f64::from(command.param1) / 10.0);
    assert!(power_w <= 0.123_456 && power_w > 0.1234, "{power_w}");
    let lease = world.transmitter.acknowledged().unwrap();
    assert_eq!(lease.expires_at, sent_at + ms(400));
    assert_eq!(lease.slot, 9);
    assert!((lease.power_w - power_w).abs() < 1e-7);
    assert_eq!(world.transmitter.round_trip(world.now), Some(ms(20) + STEP));
    // Not renewed: off by itself and by us.
    world.run(ms(450));
    assert_eq!(world.radio.on, None);
    assert_eq!(world.transmitter.acknowledged(), None);
    assert!(world.transmitter.is_off(world.now));
}

#[test]
fn spec_what_expires_at_once_or_is_no_power_is_off() {
    for (power_w, ahead) in [(0.1, 0), (0.1, 999), (0.0, 500_000), (-1.0, 500_000), (f64::NAN, 500_000)] {
        let mut world = World::new(steady(1));
        world.run(ms(50));
        let at = world.now + Duration::from_micros(ahead);
        world.transmitter.set(power_w, 1, at, world.now).unwrap();
        world.run(ms(50));
        assert_eq!(world.radio.received.len(), 2);
        assert!(world.radio.received.iter().all(|c| c.y == 0 && c.param1 == f32::NEG_INFINITY));
    }
}

#[test]
fn spec_off_is_sent_in_the_same_call_and_repeated_until_confirmed() {
    let mut world = World::new(steady(3));
    world.run(ms(50));
    world.transmitter.set(0.1, 1, world.now + ms(500), world.now).unwrap();
    world.run(ms(50));
    world.transmitter.silence(world.now);
    let first = world.transmitter.poll_transmit();
    assert!(matches!(&first, Some(MavMessage::COMMAND_INT(c)) if c.y == 0), "{first:?}");
    // That one was lost. The radio goes on, and so does the driver.
    assert!(!world.transmitter.is_off(world.now));
    assert_eq!(world.transmitter.acknowledged(), None);
    world.run(ms(50) + STEP * 5);
    assert_eq!(world.radio.on, None);
    world.run(ms(10));
    assert!(world.transmitter.is_off(world.now));
}

/// What a driver sends in each of these spans after off, while no answer comes.
fn offs_unanswered(transmitter: &mut Transmitter, off_at: Instant, spans: &[u64]) -> Vec<usize> {
    let mut now = off_at;
    let mut count = |from: Instant, to: Instant| {
        let mut sent = 0;
        now = from;
        while now < to {
            if transmitter.poll_timeout().is_some_and(|(at, _)| at <= now) {
                transmitter.handle_timeout(now);
            }
            sent += std::iter::from_fn(|| transmitter.poll_transmit())
                .filter(|m| !matches!(m, MavMessage::PARAM_REQUEST_READ(_)))
                .count();
            now = now + STEP;
        }
        sent
    };
    let mut from = off_at;
    let counts = spans.iter().map(|&span| {
        let to = from + ms(span);
        let sent = count(from, to);
        from = to;
        sent
    });
    counts.collect()
}

#[test]
fn spec_off_is_repeated_fast_within_the_reaction_time_then_slower() {
    // Within 100 ms, to 200 ms, to 2 s, and 2 s more.
    let spans = [100, 100, 1800, 2000];
    let now = Instant::from_start(Duration::from_secs(9));
    let mut world = World::new(Vec::new);
    world.transmitter.set(0.1, 1, now + ms(500), now).unwrap();
    drain(&mut world.transmitter);
    world.transmitter.silence(now);
    assert_eq!(offs_unanswered(&mut world.transmitter, now, &spans), [4, 4, 36, 4]);

    let kinds = [
        (Protocol::Classic, classic(5.0), [4, 4, 36, 4]),
        // Long messages: no faster than a slow line carries them.
        (Protocol::Extended, extended(5), [2, 2, 36, 4]),
    ];
    for (protocol, report, expected) in kinds {
        let mut transmitter = by_parameter(Unit::Milliwatt, protocol);
        give(&mut transmitter, &report, Instant::ZERO);
        drain(&mut transmitter);
        transmitter.silence(now);
        assert_eq!(offs_unanswered(&mut transmitter, now, &spans), expected, "{protocol:?}");
    }
}

#[test]
fn spec_three_offs_in_a_row_may_be_lost_within_the_reaction_time() {
    for lost in 0..=3 {
        let (way, mut sent) = (ms(8), 0);
        // On, its answer, then the offs.
        let mut world = World::new(move || {
            sent += 1;
            if (5..5 + lost).contains(&sent) { Vec::new() } else { vec![way] }
        });
        world.run(ms(50));
        world.transmitter.set(0.1, 1, world.now + ms(500), world.now).unwrap();
        world.run(ms(50));
        assert!(world.radio.on.is_some(), "{lost}");
        let at = world.now;
        world.transmitter.silence(at);
        while world.radio.on.is_some() {
            world.step();
        }
        let silent_after = world.now.saturating_since(at);
        assert!(silent_after <= ms(100), "{lost} lost: {silent_after:?}");
    }
}

#[test]
fn spec_a_late_acknowledgement_never_lengthens_a_lease() {
    let mut world = World::new(steady(1));
    world.run(ms(50));
    let ack = |result_param2| {
        MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command: MavCmd::MAV_CMD_USER_1,
            result: MavResult::MAV_RESULT_ACCEPTED,
            progress: 0,
            result_param2,
            target_system: OWN.0,
            target_component: OWN.1,
        })
    };
    let first = world.now;
    world.transmitter.set(0.1, 1, first + ms(300), first).unwrap();
    world.now = first + ms(150);
    let second = world.now;
    world.transmitter.set(0.1, 1, second + ms(300), second).unwrap();
    // One answer, late: it may be the first's.
    world.give(&ack(20_000));
    assert_eq!(world.transmitter.acknowledged().map(|lease| lease.expires_at), Some(first + ms(300)));
    world.give(&ack(20_000));
    assert_eq!(world.transmitter.acknowledged().map(|lease| lease.expires_at), Some(second + ms(300)));
    // An answer to nothing, and one to an older off.
    world.give(&ack(20_000));
    world.give(&ack(i32::MIN));
    assert_eq!(world.transmitter.acknowledged().map(|lease| lease.expires_at), Some(second + ms(300)));
    // Told off, an old answer does not bring the lease back.
    world.transmitter.silence(world.now);
    world.give(&ack(20_000));
    assert_eq!(world.transmitter.acknowledged(), None);
}

/// Loses and delays; in order, or with duplicates and overtaking.
fn bad_wire(seed: u64, loss: f64, slowest: u64, in_order: bool) -> impl FnMut() -> Vec<Duration> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // One delay a run keeps the order.
    let fixed = rng.random_range(1..=slowest);
    move || {
        if rng.random_bool(loss) {
            return Vec::new();
        }
        let copies = if !in_order && rng.random_bool(0.1) { 2 } else { 1 };
        (0..copies).map(|_| ms(if in_order { fixed } else { rng.random_range(1..=slowest) })).collect()
    }
}

#[test]
fn prop_over_a_bad_wire_the_lease_is_never_longer_than_the_radios_and_off_is_off() {
    let mut leased = 0u32;
    for seed in 0..300 {
        let in_order = seed % 3 != 0;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let loss = rng.random_range(0.0..0.5);
        let slowest = rng.random_range(2..120);
        let mut world = World::new(bad_wire(seed ^ 0xabcd, loss, slowest, in_order));
        let mut allowed_until = world.now;
        for _ in 0..60 {
            if rng.random_range(0..4) == 0 {
                world.transmitter.silence(world.now);
            } else {
                let expires_at = world.now + ms(rng.random_range(1..500));
                allowed_until = allowed_until.max(expires_at);
                world.transmitter.set(0.1, 3, expires_at, world.now).unwrap();
            }
            for _ in 0..rng.random_range(1..100) {
                world.step();
                let on_until = world.radio.on.map(|(.., until)| until);
                // Late delivery included, the radio never outlives what it was allowed.
                assert!(
                    on_until.is_none_or(|until| until <= allowed_until + ms(slowest) + STEP),
                    "seed {seed}"
                );
                if !in_order {
                    continue;
                }
                if world.transmitter.is_off(world.now) {
                    assert_eq!(on_until, None, "seed {seed}: believed off");
                }
                if let Some(lease) =
                    world.transmitter.acknowledged().filter(|lease| lease.expires_at > world.now)
                {
                    leased += 1;
                    assert!(
                        on_until.is_some_and(|until| until >= lease.expires_at),
                        "seed {seed}: {on_until:?}"
                    );
                }
            }
        }
        world.transmitter.silence(world.now);
        world.run(Duration::from_secs(4));
        assert!(world.radio.on.is_none() && world.transmitter.is_off(world.now), "seed {seed}");
    }
    assert!(leased > 10_000, "{leases}", leases = leased);
}

#[test]
fn spec_a_radio_that_does_not_know_the_command_is_named_in_the_preflight() {
    let mut world = World::new(steady(2));
    world.radio.refuses = Some(MavResult::MAV_RESULT_UNSUPPORTED);
    world.run(ms(100));
    assert_eq!(world.transmitter.supports_expiry(), Some(false));
    assert_eq!(world.transmitter.refusal(), Some(MavResult::MAV_RESULT_UNSUPPORTED));
    assert!(!world.transmitter.is_off(world.now), "never believed off on no evidence");
    let expiry = world
        .transmitter
        .preflight(world.now)
        .into_iter()
        .find(|check| check.name == "transmitter expiry")
        .unwrap();
    assert!(expiry.result == Verdict::Fail && expiry.detail.contains("parameter"), "{expiry:?}");
}

#[test]
fn spec_a_silent_radio_is_told_off_again_when_it_is_back() {
    let mut world = World::new(steady(2));
    world.run(ms(100));
    let told = world.radio.received.len();
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_RADIO,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    });
    for _ in 0..3 {
        world.run(Duration::from_secs(1));
        world.give(&heartbeat);
    }
    assert_eq!(world.radio.received.len(), told);
    world.run(Duration::from_secs(4));
    world.give(&heartbeat);
    world.run(ms(20));
    assert_eq!(world.radio.received.len(), told + 1);
    assert!(world.transmitter.is_off(world.now));
}

#[test]
fn spec_strangers_and_answers_to_others_change_nothing() {
    let mut world = World::new(Vec::new);
    let ack = |target| COMMAND_ACK_DATA {
        command: MavCmd::MAV_CMD_USER_1,
        result: MavResult::MAV_RESULT_ACCEPTED,
        progress: 0,
        result_param2: i32::MIN,
        target_system: target,
        target_component: 191,
    };
    world.give(&MavMessage::COMMAND_ACK(ack(2)));
    let stranger = MavHeader { system_id: 2, component_id: 68, sequence: 0 };
    world.transmitter.handle_message(stranger, &MavMessage::COMMAND_ACK(ack(1)), world.now);
    assert_eq!(world.transmitter.supports_expiry(), None);
}

#[test]
fn spec_the_round_trip_of_a_radio_that_is_off_is_what_was_measured_last() {
    let mut world = World::new(steady(7));
    world.run(ms(5000));
    assert_eq!(world.transmitter.round_trip(world.now), Some(ms(15)));
}
