//! The script that sets the body offsets of ArduPilot's 6DoF frame: asked, refusing, silent, gone level by itself.

use super::*;

fn tilted() -> Attitude {
    Attitude::from_euler(0.5, 0.0, 0.0)
}

/// At 10 m on the 6DoF frame, asked to roll.
fn rolling(change: impl FnOnce(&mut Fake)) -> World {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |settings| settings.planned_tilt_rad = 0.6);
    world.launch();
    change(&mut world.fake);
    world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude: tilted(), ..setpoint });
    world
}

fn angle_off(world: &World) -> f64 {
    Attitude::from_mavlink(world.fake.attitude.map(f64::from)).unwrap().angle_to(&tilted())
}

fn refusals(world: &World) -> Vec<Option<MavResult>> {
    let refusal = |event: &Event| match event {
        Event::Refused { what: "body offsets", result, .. } => Some(*result),
        _ => None,
    };
    world.events.iter().filter_map(|(_, event)| refusal(event)).collect()
}

fn switches(world: &World) -> Vec<f32> {
    world.fake.commands(MavCmd::MAV_CMD_USER_5).iter().map(|c| c.param1).collect()
}

#[test]
fn spec_offsets_follow_the_agreed_switch_at_20_hz_and_no_faster() {
    let mut world = rolling(|_| {});
    let on = |(_, m): &(_, MavMessage)| matches!(m, MavMessage::COMMAND_LONG(c) if c.command == MavCmd::MAV_CMD_USER_5);
    let angles = |m: &MavMessage| match m {
        MavMessage::COMMAND_LONG(c) if c.command == MavCmd::MAV_CMD_USER_4 => Some((c.param1, c.param2)),
        _ => None,
    };
    let switched = world.fake.received.iter().position(on).unwrap();
    let early = world.fake.received[..switched].iter().filter_map(|(_, m)| angles(m));
    assert!(early.into_iter().all(|angles| angles == (0.0, 0.0)), "an offset before the switch");
    world.run(5.0);
    assert!(angle_off(&world) < 1e-6, "heading, roll and pitch: {}", angle_off(&world));
    let before = world.fake.commands(MavCmd::MAV_CMD_USER_4).len();
    world.run(10.0);
    let sent = world.fake.commands(MavCmd::MAV_CMD_USER_4).len() - before;
    assert!((160..=201).contains(&sent), "{sent} in 10 s");
    assert_eq!(switches(&world), [1.0]);
    assert!(refusals(&world).is_empty());
}

#[test]
fn spec_a_script_that_is_gone_is_told_once_and_asked_again() {
    let mut world = rolling(|fake| fake.without_bridge = true);
    world.run(5.0);
    // The autopilot answers, and knows nothing of it: scripting was stopped.
    assert_eq!(deaths(&world), 1);
    world.fake.without_bridge = false;
    world.run(3.0);
    assert!(angle_off(&world) < 1e-6);
    assert_eq!((deaths(&world), refusals(&world).len()), (1, 0));
}

fn deaths(world: &World) -> usize {
    world.count(|event| matches!(event, Event::BridgeDead { .. }))
}

#[test]
fn spec_offsets_without_an_answer_are_told_within_a_second() {
    let mut world = rolling(|_| {});
    world.run(3.0);
    world.fake.mute_bridge = true;
    world.run(0.4);
    assert_eq!(deaths(&world), 0);
    world.run(0.3);
    assert_eq!(deaths(&world), 1);
    world.fake.mute_bridge = false;
    world.run(1.0);
    world.fake.mute_bridge = true;
    world.run(1.2);
    assert_eq!(deaths(&world), 2, "each time anew");
}

#[test]
fn spec_a_gap_in_the_autopilots_link_is_no_dead_script() {
    let mut world = rolling(|_| {});
    world.run(3.0);
    world.fake.silent = true;
    world.run(0.8);
    world.fake.silent = false;
    world.run(1.0);
    assert_eq!(deaths(&world), 0);
    assert_eq!(world.count(|event| matches!(event, Event::LinkLost { .. })), 0);
    assert!(world.autopilot.in_control());
}

#[test]
fn spec_the_preflight_asks_again_whether_the_script_answers() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |settings| settings.planned_tilt_rad = 0.6);
    let verdict = |world: &World| {
        let checks = world.autopilot.preflight(world.now);
        checks.into_iter().find(|check| check.name == "bridge script").unwrap().result
    };
    world.run(5.0);
    assert_eq!(verdict(&world), Verdict::Pass);
    world.fake.mute_bridge = true;
    world.run(5.0);
    assert_eq!(verdict(&world), Verdict::Fail, "it has died meanwhile");
    world.fake.mute_bridge = false;
    world.run(5.0);
    assert_eq!(verdict(&world), Verdict::Pass);
}

#[test]
fn spec_a_script_with_few_instructions_is_refused() {
    for (count, verdict) in [(10_000, Verdict::Pass), (9_000, Verdict::Fail)] {
        let mut fake = Fake::new(Firmware::ArduPilot);
        fake.parameters.insert("SCR_VM_I_COUNT".into(), int(count, Firmware::ArduPilot));
        let mut world = World::new(fake, |settings| settings.planned_tilt_rad = 0.6);
        world.run(5.0);
        let checks = world.autopilot.preflight(world.now);
        let check = checks.into_iter().find(|check| check.name == "SCR_VM_I_COUNT").unwrap();
        assert_eq!(check.result, verdict, "{check:?}");
    }
}

#[test]
fn spec_a_script_that_went_level_by_itself_is_switched_on_again_while_we_are_in_control() {
    let mut world = rolling(|_| {});
    world.run(3.0);
    // Restarted by itself, say.
    world.fake.offsets_on = false;
    world.run(0.1);
    assert_eq!(refusals(&world), [Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED)]);
    world.run(2.0);
    assert_eq!(switches(&world), [1.0, 1.0]);
    assert!(world.fake.offsets_on && angle_off(&world) < 1e-6);
}

#[test]
fn spec_after_the_pilot_took_over_nothing_is_asked_of_the_script() {
    let mut world = rolling(|_| {});
    world.run(3.0);
    world.fake.custom_mode = 5;
    world.fake.beat();
    world.until(1.0, |event| matches!(event, Event::ControlLost { .. }));
    world.run(0.05);
    let asked = world.fake.commands(MavCmd::MAV_CMD_USER_4).len();
    // Back in GUIDED by the pilot's hand: not an order to fly on.
    world.fake.custom_mode = 4;
    world.run(5.0);
    assert_eq!(world.fake.commands(MavCmd::MAV_CMD_USER_4).len(), asked);
    assert_eq!(switches(&world), [1.0]);
    assert!(!world.fake.offsets_on);
}
