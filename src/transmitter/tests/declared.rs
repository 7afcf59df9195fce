//! What a radio declares, and what is made of it.

use super::super::declared::Fact;
use super::*;
use crate::preflight::Check;
use crate::role::Role;

const DEMANDS: Demands = Demands {
    role: Role::J,
    real: true,
    guard: Duration::from_secs(1),
    lease: Duration::from_millis(500),
    permitted: Some(Permitted { band_hz: [2.4e9, 2.41e9], max_power_w: 0.5 }),
    accept_orphaned: false,
};
/// A radio that nothing is wrong with.
const GOOD: [(Fact, f32); 8] = [
    (Fact::MaxDbm, 20.0),
    (Fact::MinDbm, 10.0),
    (Fact::OffMs, 20.0),
    (Fact::ChangeMs, 300.0),
    (Fact::ReadBack, 1.0),
    (Fact::DeadMs, 20.0),
    (Fact::BandLowKhz, 2_401_000.0),
    (Fact::BandHighKhz, 2_409_000.0),
];
const PLAN: [(&str, f64); 2] = [("alpha", 0.1), ("bravo", 0.02)];

fn value(fact: Fact, param_value: f32) -> MavMessage {
    MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_value,
        param_id: fact.parameter().into(),
        ..PARAM_VALUE_DATA::default()
    })
}

/// A radio that has declared this, and all that it was asked for.
fn declaring(facts: &[(Fact, f32)]) -> World {
    let mut world = World::new(steady(5));
    world.run(ms(50));
    facts.iter().for_each(|(fact, is)| world.give(&value(*fact, *is)));
    world.run(ms(6000));
    world
}

/// The good one, but for this.
fn but(changed: &[(Fact, f32)]) -> World {
    let good = GOOD.map(|(fact, is)| {
        let other = changed.iter().find(|(other, _)| *other == fact);
        (fact, other.map_or(is, |(_, is)| *is))
    });
    declaring(&good)
}

fn compared(world: &World, demands: &Demands) -> Vec<Check> {
    world.transmitter.compare(demands, &PLAN, Watts(0.1))
}

#[test]
fn spec_a_radio_that_can_do_what_is_asked_passes_by_name() {
    let checks = compared(&but(&[]), &DEMANDS);
    assert!(checks.iter().all(|check| check.result == Verdict::Pass), "{checks:?}");
    let names: Vec<&str> = checks.iter().map(|check| check.name).collect();
    let all = [
        "TX_OFF_MS",
        "TX_CHANGE_MS",
        "transmitter power",
        "TX_READ_BACK",
        "TX_DEAD_MS",
        "TX_BAND",
        "TX_MAX_DBM",
    ];
    assert_eq!(names, all);
}

#[test]
fn spec_what_it_cannot_do_is_refused_by_name_with_the_value_and_what_it_should_be() {
    use Verdict::{Fail, Pass, Warn};
    let simulated = Demands { real: false, ..DEMANDS };
    let accepted = Demands { accept_orphaned: true, ..DEMANDS };
    let i = Demands { role: Role::I, ..DEMANDS };
    for (fact, is, demands, name, verdict, says) in [
        (Fact::OffMs, 100.0, simulated, "TX_OFF_MS", Pass, "100 ms"),
        (Fact::OffMs, 101.0, simulated, "TX_OFF_MS", Fail, "101 ms, should be 0 to 100"),
        (Fact::OffMs, -1.0, simulated, "TX_OFF_MS", Fail, "-1 ms, should be 0 to 100"),
        (Fact::ChangeMs, 500.0, simulated, "TX_CHANGE_MS", Pass, "begins 0 ms later"),
        (Fact::ChangeMs, 1000.0, simulated, "TX_CHANGE_MS", Pass, "begins 500 ms later"),
        (Fact::ChangeMs, 1000.0, i, "TX_CHANGE_MS", Pass, "begins 1000 ms later"),
        (Fact::ChangeMs, 3000.0, simulated, "TX_CHANGE_MS", Fail, "3000 ms, should be 0 to 1000"),
        (Fact::MinDbm, 13.01, simulated, "transmitter power", Pass, "20.000 mW"),
        (
            Fact::MinDbm,
            // What is commanded for 20 mW, 13.0103 dBm, is 13.010.
            13.011,
            simulated,
            "transmitter power",
            Fail,
            "for bravo, should be at least 20.003 mW",
        ),
        (Fact::ReadBack, 0.0, simulated, "TX_READ_BACK", Warn, "0, should be 1"),
        (Fact::DeadMs, 500.0, DEMANDS, "TX_DEAD_MS", Pass, "500 ms"),
        (Fact::DeadMs, 501.0, DEMANDS, "TX_DEAD_MS", Fail, "501 ms, should be at most 500 ms (a lease)"),
        // J is off when its lease and I's time to off are over.
        (Fact::DeadMs, 20.0, i, "TX_DEAD_MS", Pass, "20 ms"),
        (Fact::DeadMs, 21.0, i, "TX_DEAD_MS", Fail, "21 ms, should be at most 20 ms (its TX_OFF_MS)"),
        (Fact::DeadMs, -1.0, DEMANDS, "TX_DEAD_MS", Fail, "accept_orphaned_radio = true"),
        (Fact::DeadMs, -1.0, accepted, "TX_DEAD_MS", Warn, "never by itself"),
        (Fact::DeadMs, -1.0, simulated, "TX_DEAD_MS", Warn, "never by itself"),
        (Fact::BandLowKhz, 2_399_000.0, DEMANDS, "TX_BAND", Fail, "should be within 2400000 to 2410000 kHz"),
        (Fact::BandHighKhz, 2_411_000.0, DEMANDS, "TX_BAND", Fail, "2401000 to 2411000 kHz"),
        (Fact::BandLowKhz, -1.0, DEMANDS, "TX_BAND", Warn, "not known"),
        (Fact::BandHighKhz, -1.0, DEMANDS, "TX_BAND", Warn, "not known"),
        (Fact::BandLowKhz, 0.0, DEMANDS, "TX_BAND", Fail, "0 to 2409000 kHz"),
        (Fact::BandHighKhz, 0.0, DEMANDS, "TX_BAND", Fail, "2401000 to 0 kHz"),
        // Its edges, and what single precision makes of them.
        (Fact::BandLowKhz, 2_400_000.0, DEMANDS, "TX_BAND", Pass, "2400000 to 2409000 kHz"),
        (Fact::BandHighKhz, 2_410_000.0, DEMANDS, "TX_BAND", Pass, "2401000 to 2410000 kHz"),
        (Fact::BandHighKhz, 2_410_002.0, DEMANDS, "TX_BAND", Pass, "2401000 to 2410002 kHz"),
        (Fact::BandHighKhz, 2_410_003.0, DEMANDS, "TX_BAND", Fail, "2401000 to 2410003 kHz"),
        (Fact::MaxDbm, 27.0, DEMANDS, "TX_MAX_DBM", Fail, "should be at most 500.000 mW"),
        (Fact::MaxDbm, 26.9, DEMANDS, "TX_MAX_DBM", Pass, "within emission.max_power_w"),
        // Half a watt, as single precision has it: a little more.
        (Fact::MaxDbm, 26.9897, DEMANDS, "TX_MAX_DBM", Pass, "within emission.max_power_w"),
    ] {
        let checks = compared(&but(&[(fact, is)]), &demands);
        let check = checks.iter().find(|check| check.name == name);
        assert!(
            check.is_some_and(|c| c.result == verdict && c.detail.contains(says)),
            "{fact:?} {is}: {checks:?}"
        );
        assert!(checks.iter().all(|check| check.name == name || check.result == Pass), "{checks:?}");
    }
    // Nothing is permitted, or forbidden, to what radiates nothing real.
    let far = compared(&but(&[(Fact::BandLowKhz, 1.0), (Fact::MaxDbm, 50.0)]), &simulated);
    assert!(far.iter().all(|check| !check.name.contains("BAND") && check.result == Pass), "{far:?}");
}

#[test]
fn spec_a_jammer_that_cannot_give_its_power_is_told_of_and_vehicle_i_is_not() {
    let world = but(&[]);
    let of = |role| world.transmitter.compare(&Demands { role, ..DEMANDS }, &PLAN, Watts(0.05));
    let short = of(Role::J).into_iter().find(|check| check.name == "transmitter power").unwrap();
    assert!(short.result == Verdict::Warn && short.detail.contains("50.000 mW"), "{short:?}");
    assert!(of(Role::I).iter().all(|check| check.result == Verdict::Pass));
    // Levels are rounded down, and below the first there is nothing.
    let levels = [0.0, 0.025, 0.1].map(|power_w| Level { value: power_w * 1e3, power_w });
    let mut by_levels = by_parameter(Unit::Levels(levels.to_vec()), Protocol::Classic);
    give(&mut by_levels, &classic(0.0), Instant::ZERO);
    let plan = |plan: &[(&str, f64)]| {
        let checks = by_levels.compare(&Demands { real: false, ..DEMANDS }, plan, Watts(1.0));
        assert!(
            checks.iter().all(|check| check.result == Verdict::Warn || check.detail.contains("25.000 mW"))
        );
        checks.into_iter().map(|check| (check.name, check.result)).collect::<Vec<_>>()
    };
    assert_eq!(plan(&[("a", 0.1)]), [("transmitter power", Verdict::Pass)]);
    assert_eq!(plan(&[("a", 0.09)]), [("transmitter power", Verdict::Warn)]);
    assert_eq!(plan(&[("a", 0.1), ("b", 0.02)]), [("transmitter power", Verdict::Fail)]);
}

#[test]
fn spec_a_radio_is_asked_until_it_answers_and_one_that_declares_nothing_is_taken_as_ever() {
    let mut world = World::new(steady(5));
    world.run(ms(50));
    let facts = |world: &World, demands| {
        let checks = compared(world, demands);
        checks.into_iter().find(|check| check.name == "transmitter facts")
    };
    let asked = facts(&world, &DEMANDS).unwrap();
    assert!(asked.result == Verdict::Fail && asked.detail.contains("asked for 8"), "{asked:?}");
    world.give(&value(Fact::MaxDbm, 20.0));
    world.run(ms(7000));
    let simulated = Demands { real: false, ..DEMANDS };
    assert_eq!(compared(&world, &simulated), []);
    // No radio jams with picowatts, whatever it says of itself.
    let [faint] = &world.transmitter.compare(&simulated, &[("alpha", 0.1), ("bravo", 7e-12)], Watts(1.0))[..]
    else {
        panic!("one check is wanted");
    };
    assert!(
        (faint.name, faint.result) == ("transmitter power", Verdict::Warn)
            && faint.detail.contains("for bravo"),
        "{faint:?}"
    );
    let undeclared = facts(&world, &DEMANDS).unwrap();
    assert!(
        undeclared.result == Verdict::Warn && undeclared.detail.contains("TX_MIN_DBM, TX_OFF_MS"),
        "{undeclared:?}"
    );
    assert!(compared(&world, &DEMANDS).iter().all(|check| check.result != Verdict::Fail));
    // One that says something is to say everything.
    world.give(&value(Fact::ChangeMs, 10.0));
    world.run(ms(7000));
    assert_eq!(facts(&world, &simulated).map(|check| check.result), Some(Verdict::Warn));
}

#[test]
fn val_a_radio_that_takes_its_time_to_be_off_is_told_so_much_earlier_and_believed_so_much_later() {
    let [prompt, slow] = [0.0, 80.0].map(|off_ms| {
        let mut world = but(&[(Fact::OffMs, off_ms), (Fact::MinDbm, 0.0)]);
        let now = world.now;
        world.transmitter.command(0.05, 3, now + ms(400), now).unwrap();
        world.run(ms(1));
        let expiry_ms = u64::try_from(world.there.last().unwrap().1.y).unwrap();
        world.run(ms(30));
        world.transmitter.silence(world.now);
        let told_at = world.now;
        while !world.transmitter.is_off(world.now) {
            world.step();
        }
        (ms(expiry_ms), world.now.saturating_since(told_at))
    });
    assert!(prompt.0 > ms(370) && prompt.1 < ms(20), "{prompt:?}");
    assert_eq!((slow.0 + ms(80), slow.1), (prompt.0, prompt.1 + ms(80)));
}

#[test]
fn val_what_is_not_read_back_is_vouched_for_once_the_device_has_had_its_time() {
    let vouched_after = [(1.0, 0), (0.0, 200)].map(|(read_back, waits_ms)| {
        let facts = [(Fact::ReadBack, read_back), (Fact::ChangeMs, 200.0), (Fact::MinDbm, 0.0)];
        let mut world = but(&facts);
        let told_at = world.now;
        let mut renew_at = world.now;
        while world.transmitter.on_until_at_least(world.now).is_none() {
            if renew_at <= world.now {
                world.transmitter.command(0.05, 3, world.now + ms(500), world.now).unwrap();
                renew_at = world.now + ms(100);
            }
            world.step();
        }
        let after = world.now.saturating_since(told_at);
        // A break begins it anew.
        world.transmitter.silence(world.now);
        world.transmitter.command(0.05, 3, world.now + ms(500), world.now).unwrap();
        world.run(ms(20));
        assert_eq!(world.transmitter.on_until_at_least(world.now).is_none(), waits_ms > 0);
        after
    });
    assert!(vouched_after[0] < ms(20), "{vouched_after:?}");
    assert_eq!(vouched_after[1], vouched_after[0] + ms(200));
}

#[test]
fn spec_nothing_is_compared_of_a_radio_that_was_never_heard() {
    assert_eq!(compared(&World::new(steady(5)), &DEMANDS), []);
}

#[test]
fn spec_a_slot_without_power_asks_nothing_of_the_radio_and_a_jammer_is_full_to_the_last_bit() {
    let world = but(&[]);
    let verdict = |plan: &[(&str, f64)], ceiling_w| {
        let checks = world.transmitter.compare(&DEMANDS, plan, Watts(ceiling_w));
        checks.into_iter().find(|check| check.name == "transmitter power").map(|check| check.result)
    };
    assert_eq!(verdict(&[("alpha", 0.1), ("bravo", 0.0)], 0.1), Some(Verdict::Pass));
    assert_eq!(verdict(&[("bravo", 0.0)], 0.1), None);
    let full_w = FULL_POWER * 0.1;
    assert_eq!(verdict(&[("alpha", 0.1)], full_w), Some(Verdict::Pass));
    assert_eq!(verdict(&[("alpha", 0.1)], full_w.next_down()), Some(Verdict::Warn));
}

#[test]
fn spec_a_radio_that_is_heard_late_is_asked_as_often_as_one_that_is_there() {
    let rounds = |heard_ms| {
        let mut world = World::new(Vec::new);
        world.run(ms(heard_ms));
        world.give(&MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
        world.run(ms(10_000));
        (world.asked.len() / GOOD.len(), world.asked.len() % GOOD.len())
    };
    assert_eq!(rounds(500), (5, 0), "that has just begun");
    assert_eq!(rounds(2500), (3 + 5, 0));
}

#[test]
fn spec_a_radio_that_was_not_heard_for_long_is_asked_for_everything_anew() {
    let mut world = World::new(steady(5));
    world.run(ms(50));
    GOOD.iter().for_each(|(fact, is)| world.give(&value(*fact, *is)));
    assert_eq!(world.transmitter.poll_timeout(), None, "off, and asked for nothing");
    world.run(ms(6000));
    let asked_anew = |world: &mut World, silent: Duration| {
        world.now = world.now + silent;
        let before = world.asked.len();
        world.give(&value(Fact::MaxDbm, 20.0));
        world.run(ms(50));
        // Its answer ends it.
        world.give(&value(Fact::MaxDbm, 20.0));
        world.asked.len() - before
    };
    assert_eq!(asked_anew(&mut world, ms(0)), GOOD.len(), "it has had nothing to say for seconds");
    assert_eq!(asked_anew(&mut world, SILENCE_OF_LINK), 0);
    assert_eq!(asked_anew(&mut world, SILENCE_OF_LINK + STEP), GOOD.len());
    world.run(ms(5000));
    assert_eq!(world.transmitter.poll_timeout(), None);
}
