//! What each firmware needs of its own: preflight, landing, modes and frames.

use super::*;

#[test]
fn spec_preflight_names_parameter_value_and_remedy_and_silence_is_not_known() {
    let find = |world: &World, name: &str| {
        world.autopilot.preflight(world.now).into_iter().find(|check| check.name == name).unwrap()
    };
    let mut world =
        World::new(Fake::new(Firmware::Px4), |settings| settings.actuation = Actuation::ThrustVector);
    world.connect();
    let checks = world.autopilot.preflight(world.now);
    assert!(checks.iter().all(|check| check.result == Verdict::Pass), "{checks:#?}");

    // The default of PX4: 23 m sideways and 10 m down in 15 s.
    let mut fake = Fake::new(Firmware::Px4);
    fake.parameters.insert("COM_OBL_RC_ACT".into(), int(0, Firmware::Px4));
    let mut world = World::new(fake, |_| {});
    world.connect();
    let loss = find(&world, "COM_OBL_RC_ACT");
    assert!(loss.result == Verdict::Fail && loss.detail.contains("drifts"), "{loss:?}");

    let mut fake = Fake::new(Firmware::Px4);
    fake.parameters.insert("FD_FAIL_R".into(), int(60, Firmware::Px4));
    fake.parameters.insert("COM_OBL_RC_ACT".into(), int(6, Firmware::Px4));
    fake.parameters.remove("COM_OF_LOSS_T");
    let mut world = World::new(fake, |_| {});
    world.connect();
    let tilt = find(&world, "FD_FAIL_R");
    assert!(tilt.result == Verdict::Fail && tilt.detail.contains("60"), "{tilt:?}");
    let loss = find(&world, "COM_OBL_RC_ACT");
    assert!(loss.result == Verdict::Fail && loss.detail.contains("should be 5"), "{loss:?}");
    let unknown = find(&world, "COM_OF_LOSS_T");
    assert!(unknown.result == Verdict::Warn && unknown.detail.contains("not known"), "{unknown:?}");

    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.parameters.insert("FRAME_CLASS".into(), int(1, Firmware::ArduPilot));
    fake.parameters.insert("FS_GCS_ENABLE".into(), int(1, Firmware::ArduPilot));
    let mut world = World::new(fake, |_| {});
    world.connect();
    assert_eq!(find(&world, "FRAME_CLASS").result, Verdict::Fail);
    assert_eq!(find(&world, "FS_GCS_ENABLE").result, Verdict::Warn);
}

#[test]
fn spec_a_battery_that_px4_simulates_is_known_by_its_parameter_and_a_real_one_has_none() {
    let of = |firmware, percent: Option<f32>| {
        let mut fake = Fake::new(firmware);
        fake.parameters.extend(percent.map(|percent| ("SIM_BAT_MIN_PCT".into(), real(percent))));
        let mut world = World::new(fake, |_| {});
        world.connect();
        let said =
            world.autopilot.preflight(world.now).into_iter().any(|check| check.name == "SIM_BAT_MIN_PCT");
        (world.autopilot.simulated_charge_floor(), said)
    };
    assert_eq!(of(Firmware::Px4, Some(50.0)), (Some(0.5), true));
    assert_eq!(of(Firmware::Px4, None), (None, false));
    assert_eq!(of(Firmware::ArduPilot, Some(50.0)), (None, false));
}

#[test]
fn spec_limits_tighter_than_the_transits_are_named_with_both_numbers_by_whatever_name() {
    let find = |world: &World, name: &str| {
        world.autopilot.preflight(world.now).into_iter().find(|check| check.name == name)
    };
    let transits = |settings: &mut Settings| settings.transit.jerk_m_s3 = Some(4.0);
    let mut world = World::new(Fake::new(Firmware::ArduPilot), transits);
    world.connect();
    for name in ["PSC_JERK_XY", "PSC_JERK_Z", "WPNAV_ACCEL", "WPNAV_SPEED"] {
        assert_eq!(find(&world, name).unwrap().result, Verdict::Pass, "{name}");
    }
    let overshoot = find(&world, "overshoot").unwrap();
    assert!(
        overshoot.result == Verdict::Warn && overshoot.detail.contains("2.5 m/s^2: it flies past"),
        "{overshoot:?}"
    );
    // 4.7 calls them otherwise, and counts in metres.
    let mut fake = Fake::new(Firmware::ArduPilot);
    for (old, new, value) in [
        ("PSC_JERK_XY", "PSC_NE_JERK", 3.0),
        ("PSC_JERK_Z", "PSC_D_JERK", 5.0),
        ("WPNAV_ACCEL", "WP_ACC", 2.0),
        ("WPNAV_SPEED", "WP_SPD", 10.0),
    ] {
        fake.parameters.remove(old);
        fake.parameters.insert(new.into(), real(value));
    }
    let mut world = World::new(fake, transits);
    world.connect();
    world.run(6.0);
    let jerk = find(&world, "PSC_NE_JERK").unwrap();
    assert!(jerk.result == Verdict::Fail && jerk.detail.starts_with("3 m/s^3"), "{jerk:?}");
    assert!(jerk.detail.contains("the mission's 4"), "{jerk:?}");
    let acceleration = find(&world, "WP_ACC").unwrap();
    assert!(acceleration.result == Verdict::Warn && acceleration.detail.contains("2.5"), "{acceleration:?}");
    assert_eq!(find(&world, "PSC_D_JERK").unwrap().result, Verdict::Pass);
    assert_eq!(find(&world, "WP_SPD").unwrap().result, Verdict::Pass);
    assert_eq!(find(&world, "PSC_JERK_XY"), None);

    // PX4 cuts the speed of a position target; where the companion closes the loop it has none.
    for (actuation, result) in [(Actuation::Position, Some(Verdict::Fail)), (Actuation::ThrustVector, None)] {
        let mut world = World::new(Fake::new(Firmware::Px4), |settings| {
            settings.actuation = actuation;
            settings.transit.climb_m_s = 4.0;
        });
        world.connect();
        assert_eq!(find(&world, "MPC_Z_VEL_MAX_UP").map(|check| check.result), result);
    }
}

#[test]
fn spec_auto_is_what_the_airframe_s_parameters_say_and_refuses_what_they_leave_open() {
    let judged = |fake: Fake, tilt_rad: f64| {
        let mut world = World::new(fake, |settings| {
            settings.actuation = Actuation::Auto;
            settings.planned_tilt_rad = tilt_rad;
        });
        world.connect();
        world.run(6.0);
        let checks = world.autopilot.preflight(world.now);
        let mut named = checks.into_iter().filter(|check| check.name == "actuation");
        let check = named.next().unwrap();
        assert_eq!(named.next(), None);
        (world, check)
    };
    let (_, check) = judged(Fake::new(Firmware::Px4), 1.5);
    assert!(check.result == Verdict::Pass && check.detail.starts_with("thrust_vector"), "{check:?}");
    assert!(check.detail.contains("CA_AIRFRAME 0"), "{check:?}");

    let flat = || {
        let mut fake = Fake::new(Firmware::Px4);
        for rotor in 0..8 {
            for (field, value) in [("AX", 0.0), ("AY", 0.0), ("AZ", -1.0)] {
                fake.parameters.insert(format!("CA_ROTOR{rotor}_{field}"), real(value));
            }
        }
        fake
    };
    let (_, check) = judged(flat(), 0.0);
    assert!(check.result == Verdict::Pass && check.detail.starts_with("position"), "{check:?}");
    // The plan is for another vehicle.
    let (_, check) = judged(flat(), 1.5);
    assert!(check.result == Verdict::Fail && check.detail.contains("conventional"), "{check:?}");

    for (name, value, why) in
        [("CA_AIRFRAME", Some(8), "CA_AIRFRAME is 8"), ("CA_AIRFRAME", None, "not known")]
    {
        let mut fake = Fake::new(Firmware::Px4);
        match value {
            Some(value) => _ = fake.parameters.insert(name.into(), int(value, Firmware::Px4)),
            None => _ = fake.parameters.remove(name),
        }
        let (mut world, check) = judged(fake, 1.5);
        assert!(check.result == Verdict::Fail && check.detail.contains(why), "{check:?}");
        world.autopilot.take_control(world.now);
        world.until(0.1, |event| matches!(event, Event::Refused { .. }));
    }
    for (class, tilt_rad, result, says) in [
        (16, 0.6, Verdict::Pass, "pose"),
        (1, 0.0, Verdict::Pass, "position"),
        (1, 0.6, Verdict::Fail, "conventional"),
        (6, 0.0, Verdict::Fail, "FRAME_CLASS is 6"),
    ] {
        let mut fake = Fake::new(Firmware::ArduPilot);
        fake.parameters.insert("FRAME_CLASS".into(), int(class, Firmware::ArduPilot));
        let (world, check) = judged(fake, tilt_rad);
        assert!(check.result == result && check.detail.contains(says), "{check:?}");
        let bridge = world.autopilot.preflight(world.now).iter().any(|check| check.name == "bridge script");
        assert_eq!(bridge, class == 16);
    }
}

#[test]
fn spec_each_version_is_asked_for_its_own_parameters_and_one_that_is_not_known_is_named() {
    let judged = |fake: Fake| {
        let mut world = World::new(fake, |settings| settings.actuation = Actuation::ThrustVector);
        world.connect();
        let checks = world.autopilot.preflight(world.now);
        move |name: &str| checks.iter().find(|check| check.name == name).cloned()
    };
    let px4 = |version: u32, parameters: &[(&str, (f32, MavParamType))]| {
        let mut fake = Fake::new(Firmware::Px4);
        fake.version = version;
        fake.parameters.remove("COM_RC_OVERRIDE");
        for (name, value) in parameters {
            fake.parameters.insert((*name).to_owned(), *value);
        }
        fake
    };
    let whole = |value| int(value, Firmware::Px4);
    let verdict = |check: Option<crate::preflight::Check>| check.map(|check| check.result);

    let old = judged(px4(0x0110_00ff, &[("COM_RC_OVERRIDE", whole(3)), ("NAV_RCL_ACT", whole(7))]));
    let version = old("firmware version").unwrap();
    assert!(version.result == Verdict::Pass && version.detail.contains("does not sign"), "{version:?}");
    assert!(old("COM_RC_OVERRIDE").unwrap().detail.contains("moved sticks"));
    assert_eq!(verdict(old("NAV_RCL_ACT")), Some(Verdict::Warn), "7 came later");
    assert_eq!([old("MAN_OVERRIDE_SPD"), old("FD_ALT_LOSS")], [None, None]);

    let new = [("MAN_OVERRIDE_SPD", real(-1.0)), ("FD_ALT_LOSS", real(5.0)), ("NAV_RCL_ACT", whole(7))];
    let newer = judged(px4(0x0112_00ff, &new));
    assert_eq!(verdict(newer("firmware version")), Some(Verdict::Pass));
    assert!(newer("MAN_OVERRIDE_SPD").unwrap().detail.contains("mode switch"));
    assert_eq!(verdict(newer("NAV_RCL_ACT")), Some(Verdict::Pass));
    assert_eq!(verdict(newer("FD_ALT_LOSS")), Some(Verdict::Fail));
    assert_eq!(newer("COM_RC_OVERRIDE"), None);

    let newest = judged(px4(0x0113_00ff, &new));
    let version = newest("firmware version").unwrap();
    assert!(version.result == Verdict::Warn && version.detail.contains("1.19.0"), "{version:?}");
    let deadly = judged(px4(0x010f_00ff, &[("COM_RC_OVERRIDE", whole(1)), ("NAV_RCL_ACT", whole(6))]));
    assert_eq!(verdict(deadly("NAV_RCL_ACT")), Some(Verdict::Fail));
    assert!(deadly("COM_RC_OVERRIDE").unwrap().detail.contains("mode switch"));
}

#[test]
fn spec_a_return_outside_its_own_altitudes_is_a_warning_with_the_numbers() {
    for (firmware, name, value, result) in [
        (Firmware::Px4, "RTL_RETURN_ALT", 40.0, Verdict::Pass),
        (Firmware::Px4, "RTL_RETURN_ALT", 60.0, Verdict::Warn),
        (Firmware::ArduPilot, "RTL_ALT", 4000.0, Verdict::Pass),
        (Firmware::ArduPilot, "RTL_ALT", 1500.0, Verdict::Warn),
        (Firmware::ArduPilot, "RTL_ALT_M", 40.0, Verdict::Pass),
    ] {
        let mut fake = Fake::new(firmware);
        fake.parameters.insert(name.into(), real(value));
        fake.parameters.insert("RTL_CONE_ANG".into(), int(45, firmware));
        // Its home lies 3 m above the mission's origin.
        let mut world = World::new(fake, |settings| settings.return_altitude_m = Some([30.0, 50.0]));
        world.connect();
        world.run(3.0);
        let checks = world.autopilot.preflight(world.now);
        let check = checks.iter().find(|check| check.name == name).unwrap();
        assert_eq!(check.result, result, "{check:?}");
        assert!(result == Verdict::Pass || check.detail.contains("27 to 47 m"), "{check:?}");
        let cone = checks.iter().find(|check| check.name == "RTL_CONE_ANG").map(|check| check.result);
        assert_eq!(cone, (firmware == Firmware::Px4).then_some(Verdict::Warn));
    }
}

#[test]
fn spec_thrust_vector_is_refused_on_arducopter_with_the_reason() {
    let mut world =
        World::new(Fake::new(Firmware::ArduPilot), |settings| settings.actuation = Actuation::ThrustVector);
    world.connect();
    world.autopilot.take_control(world.now);
    let event = world.until(0.1, |event| matches!(event, Event::Refused { .. }));
    let Event::Refused { statustext, .. } = event else { unreachable!() };
    assert!(statustext.unwrap().contains("thrust_body"));
    assert_eq!(world.fake.commands(MavCmd::MAV_CMD_DO_SET_MODE).len(), 0);
}

#[test]
fn spec_the_land_detector_is_off_before_the_vehicle_tilts_and_back_before_it_lands() {
    let parameter = |world: &World| world.fake.parameters["LNDMC_Z_VEL_MAX"].0;
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    world.launch();
    assert_eq!(parameter(&world), 0.0);
    let tilted = Attitude::from_euler(1.5, 0.0, 0.0);
    world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude: tilted, ..setpoint });
    world.run(10.0);
    let flown = Attitude::from_mavlink(world.fake.attitude.map(f64::from)).unwrap();
    assert!(flown.angle_to(&tilted) < 1e-6);
    // The pilot takes over: put back, but not while the vehicle still lies on its side.
    world.fake.custom_mode = PX4_POSCTL;
    world.fake.beat();
    world.until(1.0, |event| matches!(event, Event::ControlLost { .. }));
    world.run(2.0);
    assert_eq!(parameter(&world), 0.0);
    world.fake.attitude = Attitude::level().to_mavlink().map(|c| c as f32);
    world.run(1.0);
    assert_eq!(parameter(&world), 0.3);
}

#[test]
fn spec_no_tilt_while_the_land_detector_may_still_disarm() {
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    world.launch();
    // From now on the write is never confirmed.
    world.fake.custom_mode = PX4_POSCTL;
    world.fake.beat();
    world.run(3.0);
    assert_eq!(world.fake.parameters["LNDMC_Z_VEL_MAX"].0, 0.3);
    world.fake.parameters.remove("LNDMC_Z_VEL_MAX");
    let since = world.now;
    world.hold_here();
    let tilted = Attitude::from_euler(1.5, 0.0, 0.0);
    world.setpoint = world.setpoint.map(|setpoint| Setpoint { attitude: tilted, ..setpoint });
    world.autopilot.take_control(world.now);
    world.until(10.0, |event| *event == Event::ControlTaken);
    world.run(5.0);
    let tilts = world.fake.received.iter().filter_map(|(at, m)| match m {
        MavMessage::SET_ATTITUDE_TARGET(a) if *at > since => Attitude::from_mavlink(a.q.map(f64::from)),
        _ => None,
    });
    assert!(tilts.map(|attitude| attitude.tilt_rad()).fold(0.0, f64::max) < 1e-3);
}

#[test]
fn spec_arducopter_without_brake_is_asked_to_loiter() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |_| {});
    world.fake.missing_mode = Some(17);
    world.launch();
    world.autopilot.hold(world.now);
    let event = world.until(3.0, |event| matches!(event, Event::HandedOver { .. }));
    assert_eq!(event, Event::HandedOver { mode: "LOITER" });
    assert_eq!(world.count(|event| matches!(event, Event::NotReady { what: "BRAKE", .. })), 1);
    assert_eq!(world.count(|event| matches!(event, Event::ControlLost { .. })), 0);
}

#[test]
fn spec_arducopter_gets_no_setpoint_before_it_is_airborne() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |_| {});
    world.connect();
    world.autopilot.take_control(world.now);
    world.until(5.0, |event| *event == Event::ControlTaken);
    world.autopilot.arm(world.now);
    world.until(5.0, |event| *event == Event::Armed);
    world.autopilot.take_off(10.0, world.now);
    world.until(30.0, |event| *event == Event::Airborne);
    assert_eq!(world.fake.setpoints_since(crate::time::Instant::ZERO), 0);
    world.hold_here();
    world.run(1.0);
    assert!(world.fake.setpoints_since(crate::time::Instant::ZERO) > 45);
}

#[test]
fn spec_a_6dof_frame_without_its_bridge_is_named_and_offsets_are_off_for_the_landing() {
    let mut world = World::new(Fake::new(Firmware::ArduPilot), |settings| settings.planned_tilt_rad = 0.6);
    let bridge = |world: &World| {
        world.autopilot.preflight(world.now).into_iter().find(|check| check.name == "bridge script").unwrap()
    };
    world.launch();
    assert_eq!(bridge(&world).result, Verdict::Pass);
    let switched = |world: &World| world.fake.commands(MavCmd::MAV_CMD_USER_5).last().map(|c| c.param1);
    assert_eq!(switched(&world), Some(1.0));
    world.autopilot.land(world.now);
    world.run(0.1);
    assert_eq!(switched(&world), Some(0.0));

    // A stock autopilot knows no 31013.
    let mut fake = Fake::new(Firmware::ArduPilot);
    fake.without_bridge = true;
    let mut world = World::new(fake, |_| {});
    world.connect();
    assert!(bridge(&world).result == Verdict::Fail && bridge(&world).detail.contains("UNSUPPORTED"));
}
