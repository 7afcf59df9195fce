//! What went wrong with commands that count from receipt and answers that name nothing.

use super::*;

#[test]
fn regress_a_late_answer_does_not_confirm_another_command() {
    let mut world = World::settled(2);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    let (_, first) = world.commands.last().cloned().unwrap();
    world.run(ms(20));
    let late = {
        let mut radio = world.radio.clone();
        radio.newest -= 1;
        radio.command(&first, world.now)
    };
    world.silence();
    world.run(ms(20));
    // On again, and the command is lost: the answer to the first says on, and names the first.
    world.there.loss = 1.0;
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.hear(&late);
    assert_eq!(world.vouched(), None);
    assert_eq!(world.radio.on, None);
    world.there.loss = 0.0;
    world.run(ms(120));
    assert!(world.vouched().is_some(), "commanded again, and answered");
    world.assert_vouched("again");
}

#[test]
fn regress_copies_and_overtaken_commands_change_nothing() {
    let mut world = World::settled(2);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    let on = world.commands.clone();
    world.run(ms(10));
    world.silence();
    let off = world.commands.clone();
    world.run(ms(10));
    assert!(world.transmitter.is_off(world.now));
    // A copy of on after off.
    world.commands.extend(on.iter().map(|(_, c)| (world.now + ms(1), c.clone())));
    world.run(ms(5));
    assert!(world.radio.on.is_none() && world.transmitter.is_off(world.now));
    // A copy of off after the next on: what is vouched for goes on.
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(10));
    world.commands.extend(off.iter().map(|(_, c)| (world.now + ms(1), c.clone())));
    world.run(ms(5));
    assert!(world.radio.on.is_some() && world.vouched().is_some());
    world.assert_vouched("after a copy of off");
}

#[test]
fn regress_answers_repeated_after_the_commands_are_cut_vouch_for_nothing_more() {
    let mut world = World::settled(2);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(3));
    let (_, answer) = world.reports.last().cloned().unwrap();
    assert!(answer.answers != 0 && answer.power_mdbm != OFF);
    world.run(ms(7));
    let until = world.vouched().unwrap().until;
    world.there.loss = 1.0;
    for _ in 0..20 {
        world.run(ms(50));
        world.hear(&answer);
        if let Some(vouched) = world.vouched() {
            assert!(vouched.until <= until, "{vouched:?}");
            let _ = world.command(0.1, 1, 500);
        }
        world.assert_vouched("repeated");
    }
    assert_eq!(world.radio.on, None);
}

#[test]
fn regress_a_constant_delay_of_half_a_second_costs_service_and_never_protection() {
    let mut world = World::settled(500);
    assert!(matches!(world.transmitter.ready(world.now), Err(NotReady::TooSlow { .. })));
    // The world asserts at each step that what is commanded is off in time.
    for _ in 0..40 {
        assert_eq!(world.command(0.1, 1, 450), Ok(()));
        world.run(ms(100));
        assert_eq!((world.radio.on, world.vouched()), (None, None));
    }
    let expired = world.radio.received.iter().filter(|c| c.param1.is_finite()).count();
    assert!(expired > 30, "{expired} arrived, and none of them in time");
    // Longer leave, and it is on for what the delay does not take.
    let mut on_ms = 0;
    for _ in 0..40 {
        assert_eq!(world.command(0.1, 1, 2000), Ok(()));
        for _ in 0..100 {
            world.step();
            on_ms += u32::from(world.radio.on.is_some());
        }
        world.assert_vouched("far");
    }
    assert!(on_ms > 3000, "{on_ms}");
}

#[test]
fn regress_a_stall_at_the_start_is_forgotten() {
    let mut world = World::new(Way::steady(5), Way::steady(5));
    (world.there.frozen_until, world.back.frozen_until) = (world.now + ms(900), world.now + ms(950));
    world.run(ms(960));
    assert!(matches!(world.transmitter.ready(world.now), Err(NotReady::TooSlow { .. } | NotReady::NotTaken)));
    world.run(ms(4000));
    assert_eq!(world.transmitter.ready(world.now), Ok(()));
    assert_eq!(world.command(0.1, 1, 300), Ok(()));
    world.run(ms(20));
    assert!(world.vouched().is_some_and(|vouched| vouched.until >= world.now + ms(230)));
}

#[test]
fn spec_what_a_dead_boot_sent_is_refused_once_the_living_one_is_taken() {
    for heard_before in [true, false] {
        let mut world = World::settled(2);
        if !heard_before {
            // This boot was never taken: all that it sends is under way for long.
            world.restart_companion();
            world.there.delay = ms(700);
            world.run(ms(300));
        }
        assert_eq!(world.command(0.1, 3, 900).is_ok(), heard_before);
        let (old, at) = (world.boot, world.now + ms(400));
        world.commands.iter_mut().for_each(|(arrives, _)| *arrives = at);
        let dead_orders = world.commands.len();
        assert!(dead_orders > 0);
        world.there.delay = ms(2);
        world.restart_companion();
        world.run(ms(100));
        assert!(world.transmitter.is_off(world.now));
        assert_eq!(world.command(0.05, 4, 900), Ok(()));
        world.run(ms(50));
        assert_eq!(world.radio.boot, world.boot % (WHOLE - 1) + 1);
        let vouched = world.vouched().unwrap();
        world.assert_vouched("beyond the dead boot's commands");
        assert!(vouched.until > at + ms(50), "they arrive while it is vouched for");
        world.run(ms(300));
        let from_the_dead = world.radio.received.iter().filter(|c| c.param3 == (old + 1) as f32).count();
        assert!(from_the_dead >= dead_orders);
        assert_eq!(world.radio.on.map(|on| on.slot), Some(4));
    }
}

#[test]
fn spec_a_radio_that_restarts_is_off_is_taken_anew_and_its_old_clock_means_nothing() {
    let mut world = World::settled(5);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(30));
    assert!(world.vouched().is_some());
    // On its way when the radio restarts: an expiry of a clock that is no more.
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.radio.restart();
    world.run(ms(5));
    assert_eq!(world.radio.on, None);
    world.run(ms(6));
    assert_eq!(world.vouched(), None);
    assert_eq!(world.command(0.1, 1, 500), Err(NotReady::NotTaken));
    world.run(ms(60));
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(30));
    assert!(world.vouched().is_some() && world.radio.on.is_some());
    world.assert_vouched("taken anew");
}

#[test]
fn spec_a_report_of_before_the_radios_restart_tells_nothing_of_its_clock() {
    let mut world = World::settled(5);
    let mut stale = world.radio.report(world.now);
    world.radio.restart();
    world.run(ms(600));
    assert_eq!(world.transmitter.ready(world.now), Ok(()));
    // The clock that is no more was ahead of the one that is.
    stale.time_ms = world.radio.clock_ms(world.now).wrapping_add(10_000);
    assert_eq!((stale.boot, world.radio.boot), (78, 78));
    let mut told = world.clone();
    told.hear(&stale);
    for world in [&mut world, &mut told] {
        assert_eq!(world.command(0.1, 1, 500), Ok(()));
    }
    let expiry = |world: &World| world.commands.last().map(|(_, c)| c.y);
    assert_eq!(expiry(&told), expiry(&world));
}

#[test]
fn spec_a_refusal_of_before_it_was_taken_changes_nothing_when_it_comes_late() {
    let mut world = World::new(Way::steady(2), Way::steady(2));
    world.run(ms(3));
    let (_, refusal) = world.reports.iter().find(|(_, report)| report.answers == 1).cloned().unwrap();
    assert_eq!(refusal.result, VeilwingRadioResult::VEILWING_RADIO_RESULT_OTHER_SERIES);
    world.run(ms(500));
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(10));
    let before = world.vouched();
    assert!(before.is_some());
    world.hear(&refusal);
    assert_eq!(world.vouched(), before);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
}

#[test]
fn regress_a_clock_that_has_gone_back_vouches_for_no_more_than_was_asked_for() {
    let mut world = World::settled(2);
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(4));
    let number = world.radio.on.unwrap().number;
    let mut answer = world.radio.report(world.now);
    (answer.answers_boot, answer.answers) = (78, number);
    answer.time_ms = answer.time_ms.wrapping_sub(4000);
    world.hear(&answer);
    let vouched = world.vouched().unwrap();
    assert!(vouched.until <= world.off_by, "{vouched:?}, off by {:?}", world.off_by);
}

#[test]
fn spec_an_answer_that_contradicts_itself_vouches_for_nothing() {
    let mut world = World::settled(2);
    world.back.loss = 1.0;
    assert_eq!(world.command(0.1, 1, 500), Ok(()));
    world.run(ms(4));
    let on = world.radio.on.unwrap();
    let mut answer = world.radio.report(world.now);
    (answer.answers_boot, answer.answers) = (78, on.number);
    for newest in [0, on.number - 1] {
        world.hear(&VEILWING_RADIO_DATA { newest, ..answer.clone() });
        assert_eq!(world.vouched(), None, "{newest}");
    }
    world.hear(&answer);
    assert!(world.vouched().is_some());
}

#[test]
fn spec_clocks_that_drift_end_in_time_and_hold_what_is_vouched_for() {
    for fast_ppm in [-100, 0, 100] {
        let mut world = World::new(Way::steady(3), Way::steady(3));
        world.radio.fast_ppm = fast_ppm;
        // An hour of drift has nothing to say, one reading a second has.
        world.now = Instant::from_start(Duration::from_secs(3600));
        world.transmitter = transmitter(77, world.now);
        world.report_at = world.now;
        world.run(ms(1000));
        for _ in 0..50 {
            assert_eq!(world.command(0.1, 1, 480), Ok(()), "{fast_ppm}");
            world.run(ms(15));
            let vouched = world.vouched().unwrap();
            let short = world.off_by.saturating_since(vouched.until);
            assert!(short < ms(3 * 2 + 20 + 4), "{fast_ppm}: {short:?}");
            world.assert_vouched("drift");
            world.back.loss = 1.0;
            world.run(ms(600));
            world.back.loss = 0.0;
            world.run(ms(300));
        }
    }
}

#[test]
fn spec_the_clock_wraps_in_the_middle_of_a_slot() {
    let mut world = World::new(Way::steady(3), Way::steady(3));
    // In 1.2 s: 2^32 ms.
    let true_us = i64::try_from(world.now.since_start().as_micros()).unwrap();
    world.radio.began_us = (i64::from(u32::MAX) - 1200) * 1000 - true_us;
    world.run(ms(900));
    for _ in 0..10 {
        assert_eq!(world.command(0.1, 1, 450), Ok(()));
        world.run(ms(100));
        assert!(world.radio.on.is_some() && world.vouched().is_some());
        world.assert_vouched("wrap");
    }
    assert!(world.radio.clock_ms(world.now) < 1000);
}

#[test]
fn spec_numbers_that_are_used_up_begin_a_boot_of_their_own() {
    let mut world = World::settled(2);
    let Driver::Numbered(numbered) = &mut world.transmitter.driver else { panic!("a numbered radio") };
    numbered.commands.skip_to(WHOLE - 20);
    world.radio.newest = WHOLE - 20;
    for _ in 0..10 {
        let _ = world.command(0.1, 1, 300);
        world.run(ms(100));
    }
    assert_eq!((world.radio.boot, world.transmitter.ready(world.now)), (79, Ok(())));
    assert_eq!(world.command(0.1, 1, 300), Ok(()));
    world.run(ms(20));
    assert!(world.radio.on.is_some() && world.vouched().is_some());
    world.assert_vouched("a boot of its own");
}

#[test]
fn prop_garbage_in_every_field_is_survived_and_vouches_for_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut word = move |near: u32| match rng.random_range(0..6) {
        0 => 0,
        1 => u32::MAX,
        2 => near,
        3 => near.wrapping_add(rng.random_range(0..3)),
        4 => WHOLE,
        _ => rng.random(),
    };
    for results in 0..=6 {
        let mut world = World::settled(2);
        assert_eq!(world.command(0.1, 1, 500), Ok(()));
        world.there.loss = 1.0;
        world.commands.clear();
        for _ in 0..2000 {
            let known = world.radio.report(world.now);
            let report = VEILWING_RADIO_DATA {
                time_ms: word(known.time_ms),
                boot: word(78),
                newest: word(known.newest),
                answers_boot: word(78),
                answers: word(known.newest),
                series: word(known.series),
                expires_ms: word(known.time_ms),
                power_mdbm: word(20_000).cast_signed(),
                result: num_traits::FromPrimitive::from_u32(results).unwrap(),
            };
            world.hear(&report);
            let now = world.now;
            if let Ok(()) = world.command(0.1, 1, 500) {
                // A power is only vouched for by an answer that says so, and never beyond what was asked for.
                let vouched = world.transmitter.on_until_at_least(now);
                assert!(
                    vouched.is_none_or(|v| v.until <= world.off_by && v.power_w.is_finite()),
                    "{vouched:?}"
                );
            }
            world.now = world.now + ms(3);
            world.transmitter.handle_timeout(world.now);
            world.send();
        }
    }
}
