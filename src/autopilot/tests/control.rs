//! Taking control and keeping it: the pilot, refusals, repeated commands.

use super::*;

#[test]
fn spec_the_pilot_wins_at_the_very_heartbeat_and_nothing_resumes_unasked() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.6);
        world.launch();
        world.fake.custom_mode = if firmware == Firmware::Px4 { PX4_POSCTL } else { 5 };
        world.fake.beat();
        let overridden = world.now;
        let event = world.until(1.0, |event| matches!(event, Event::ControlLost { .. }));
        let mode = if firmware == Firmware::Px4 { "POSCTL" } else { "LOITER" };
        assert_eq!(event, Event::ControlLost { mode: mode.into() });
        assert!(
            world.now.saturating_since(overridden) <= Duration::from_millis(20),
            "at the heartbeat itself"
        );
        assert!(!world.autopilot.in_control());
        // The executive goes on setting setpoints; the mode flaps back: still nothing is sent.
        let lost = world.now + Duration::from_millis(20);
        let set_mode = world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len();
        world.fake.custom_mode = if firmware == Firmware::Px4 { PX4_OFFBOARD } else { 4 };
        world.fake.beat();
        world.run(0.9);
        assert!(!world.autopilot.in_control());
        world.run(20.0);
        assert_eq!(world.fake.setpoints_since(lost), 0, "{firmware}");
        assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), set_mode);
        // Asked for, it is taken again.
        world.hold_here();
        world.autopilot.take_control(world.now);
        world.until(10.0, |event| *event == Event::ControlTaken);
        assert!(world.autopilot.in_control());
    }
}

#[test]
fn spec_a_mode_that_is_acknowledged_but_not_entered_is_refused_and_never_retried_after() {
    for firmware in BOTH {
        let mut fake = Fake::new(firmware);
        fake.set_mode = Manners::PayLipService;
        let mut world = World::new(fake, |settings| settings.readiness_timeout = Duration::from_secs(12));
        world.connect();
        world.autopilot.take_control(world.now);
        let event = world.until(15.0, |event| matches!(event, Event::Refused { .. }));
        let what = if firmware == Firmware::Px4 { "OFFBOARD" } else { "GUIDED" };
        assert_eq!(
            event,
            Event::Refused { what, result: Some(MavResult::MAV_RESULT_ACCEPTED), statustext: None },
            "{firmware}"
        );
        assert!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len() > 2);
        let asked = world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len();
        world.run(10.0);
        assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), asked);
        assert_eq!(world.count(|event| *event == Event::ControlTaken), 0);
    }
}

#[test]
fn spec_refused_arming_is_reported_with_its_reason_and_asked_again_until_ready() {
    for firmware in BOTH {
        let mut fake = Fake::new(firmware);
        let reason = "Arming denied: heading estimate invalid";
        fake.arming = Manners::Refuse(MavResult::MAV_RESULT_TEMPORARILY_REJECTED, reason);
        let mut world = World::new(fake, |_| {});
        world.connect();
        world.autopilot.take_control(world.now);
        world.until(10.0, |event| *event == Event::ControlTaken);
        world.autopilot.arm(world.now);
        let event = world.until(2.0, |event| matches!(event, Event::NotReady { .. }));
        let Event::NotReady { what, result, statustext, .. } = event else { unreachable!() };
        assert_eq!((what, result), ("arming", MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
        assert_eq!(statustext.as_deref(), Some(reason));
        world.run(38.0);
        assert!(world.count(|event| matches!(event, Event::NotReady { .. })) > 10);
        world.fake.arming = Manners::Obey;
        world.until(5.0, |event| *event == Event::Armed);
    }
}

#[test]
fn spec_arming_that_never_comes_ends_in_a_refusal() {
    let mut fake = Fake::new(Firmware::Px4);
    fake.arming = Manners::Refuse(MavResult::MAV_RESULT_DENIED, "Arming denied: safety switch");
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(10.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    let event = world.until(61.0, |event| matches!(event, Event::Refused { .. }));
    let Event::Refused { what, result, statustext } = event else { unreachable!() };
    assert_eq!((what, result), ("arming", Some(MavResult::MAV_RESULT_DENIED)));
    assert_eq!(statustext.as_deref(), Some("Arming denied: safety switch"));
    assert!(!world.autopilot.state().is_armed());
}

#[test]
fn spec_an_unsupported_command_is_not_asked_again() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.set_mode = Manners::Refuse(MavResult::MAV_RESULT_UNSUPPORTED, "no");
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(1.0, |event| matches!(event, Event::Refused { .. }));
    world.run(5.0);
    assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), 1);
}

#[test]
fn spec_unanswered_commands_are_repeated_with_rising_confirmation() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.set_mode = Manners::Ignore;
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.run(1.9);
    let confirmations: Vec<u8> =
        world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).iter().map(|command| command.confirmation).collect();
    assert_eq!(confirmations, [0, 1, 2, 3]);
    world.fake.set_mode = Manners::Obey;
    world.until(5.0, |event| *event == Event::ControlTaken);
}

#[test]
fn spec_a_takeoff_that_is_acknowledged_but_not_flown_is_refused() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.takeoff = Manners::PayLipService;
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(10.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    world.until(10.0, |event| *event == Event::Armed);
    world.autopilot.take_off(10.0, world.now);
    let event = world.until(45.0, |event| matches!(event, Event::Refused { .. }));
    let Event::Refused { what, result, .. } = event else { unreachable!() };
    assert_eq!((what, result), ("take-off", Some(MavResult::MAV_RESULT_ACCEPTED)));
}

#[test]
fn spec_acknowledgements_to_others_end_nothing_of_ours() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.arming = Manners::Ignore;
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(5.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    let ack = COMMAND_ACK_DATA {
        command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        result: MavResult::MAV_RESULT_DENIED,
        progress: 0,
        result_param2: 0,
        target_system: 255,
        target_component: 190,
    };
    world.inject((1, 1), &MavMessage::COMMAND_ACK(ack.clone()));
    // Nor do those of strangers.
    world.inject(
        (2, 1),
        &MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { target_system: 1, target_component: 191, ..ack }),
    );
    world.run(0.4);
    assert_eq!(world.count(|event| matches!(event, Event::NotReady { .. })), 0);
}

#[test]
fn spec_in_progress_extends_the_wait_and_nothing_is_repeated() {
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.arming = Manners::TakeTime(3000);
    let mut world = World::new(fake, |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(5.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    world.until(5.0, |event| *event == Event::Armed);
    assert_eq!(world.fake.commands(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM).len(), 1);
}

#[test]
fn spec_a_repeated_mode_command_never_takes_the_mode_back_from_the_pilot() {
    for firmware in BOTH {
        let mut fake = Fake::new(firmware);
        // Done, but the answer is lost: the command would be repeated.
        fake.set_mode = Manners::ObeyInSilence;
        let mut world = World::new(fake, |_| {});
        world.connect();
        world.autopilot.take_control(world.now);
        world.until(5.0, |event| *event == Event::ControlTaken);
        let asked = world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len();
        world.fake.custom_mode = if firmware == Firmware::Px4 { PX4_POSCTL } else { 0 };
        world.fake.beat();
        world.until(1.0, |event| matches!(event, Event::ControlLost { .. }));
        world.run(10.0);
        assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), asked, "{firmware}");
        assert_ne!(world.autopilot.state().mode(), Some(Mode::Companion));
    }
}

#[test]
fn spec_a_pilot_who_acts_while_the_mode_is_being_taken_in_flight_wins() {
    let mut world = World::new(Fake::new(Firmware::Px4), |settings| settings.planned_tilt_rad = 0.3);
    world.launch();
    world.fake.custom_mode = PX4_POSCTL;
    world.fake.beat();
    world.run(0.5);
    world.fake.set_mode = Manners::PayLipService;
    world.autopilot.take_control(world.now);
    world.run(0.5);
    world.fake.custom_mode = PX4_LAND;
    world.fake.beat();
    let event = world.until(0.1, |event| matches!(event, Event::ControlLost { .. }));
    assert_eq!(event, Event::ControlLost { mode: "AUTO.LAND".into() });
    world.fake.set_mode = Manners::Obey;
    world.run(5.0);
    assert_eq!(world.autopilot.state().mode(), Some(Mode::Land));
}

#[test]
fn spec_modes_that_flap_on_the_ground_do_not_stop_the_taking() {
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    world.connect();
    world.fake.set_mode = Manners::Refuse(MavResult::MAV_RESULT_TEMPORARILY_REJECTED, "not yet");
    world.autopilot.take_control(world.now);
    for mode in [PX4_LOITER, PX4_POSCTL, PX4_LOITER] {
        world.fake.custom_mode = mode;
        world.fake.beat();
        world.run(1.5);
    }
    assert_eq!(world.count(|event| matches!(event, Event::ControlLost { .. })), 0);
    assert!(world.count(|event| matches!(event, Event::NotReady { what: "OFFBOARD", .. })) > 0);
    world.fake.set_mode = Manners::Obey;
    world.until(5.0, |event| *event == Event::ControlTaken);
}

#[test]
fn spec_a_refused_landing_leaves_the_vehicle_held_by_the_companion() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.3);
        world.launch();
        world.fake.set_mode = Manners::Refuse(MavResult::MAV_RESULT_DENIED, "no landing here");
        world.autopilot.land(world.now);
        let event = world.until(8.0, |event| matches!(event, Event::Refused { .. }));
        let Event::Refused { statustext, .. } = event else { unreachable!() };
        assert_eq!(statustext.as_deref(), Some("no landing here"));
        assert!(world.autopilot.in_control());
        let since = world.now;
        world.run(2.0);
        assert!(world.fake.setpoints_since(since) > 95, "{firmware}");
    }
}

#[test]
fn spec_a_companion_that_restarts_in_flight_takes_control_again_when_asked() {
    for firmware in BOTH {
        let mut world = World::new(Fake::new(firmware), |settings| settings.planned_tilt_rad = 0.3);
        world.launch();
        let settings = world.autopilot.settings().clone();
        world.autopilot = Autopilot::new(settings, world.now);
        world.setpoint = None;
        let since = world.now + Duration::from_millis(20);
        world.until(3.0, |event| matches!(event, Event::Discovered { .. }));
        world.run(4.0);
        assert_eq!(world.fake.setpoints_since(since), 0, "nothing unasked");
        assert!(!world.autopilot.in_control());
        world.hold_here();
        world.autopilot.take_control(world.now);
        world.until(6.0, |event| *event == Event::ControlTaken);
        let since = world.now;
        world.run(1.0);
        assert!(world.autopilot.in_control() && world.fake.setpoints_since(since) > 45, "{firmware}");
    }
}
