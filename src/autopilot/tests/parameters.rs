//! Parameters as the preflight needs them: none overlooked, and what someone puts right on the ground is seen.

use super::*;

fn find(world: &World, name: &str) -> crate::preflight::Check {
    world.autopilot.preflight(world.now).into_iter().find(|check| check.name == name).unwrap()
}

#[test]
fn spec_nothing_passes_before_the_parameters_are_read() {
    let mut world =
        World::new(Fake::new(Firmware::Px4), |settings| settings.actuation = Actuation::ThrustVector);
    world.until(10.0, |event| matches!(event, Event::Discovered { .. }));
    let checks = world.autopilot.preflight(world.now);
    for name in ["FD_FAIL_R", "FD_FAIL_P", "COM_OBL_RC_ACT", "thrust scales"] {
        let check = checks.iter().find(|check| check.name == name).unwrap();
        assert!(check.result == Verdict::Fail && check.detail.contains("not read yet"), "{check:?}");
    }
}

#[test]
fn spec_what_is_put_right_on_the_ground_is_seen() {
    let mut fake = Fake::new(Firmware::Px4);
    fake.parameters.insert("FD_FAIL_R".into(), int(60, Firmware::Px4));
    fake.parameters.remove("COM_OF_LOSS_T");
    let mut world = World::new(fake, |_| {});
    world.connect();
    assert_eq!(find(&world, "FD_FAIL_R").result, Verdict::Fail);
    assert_eq!(find(&world, "COM_OF_LOSS_T").result, Verdict::Warn);
    // Asking again does not make what is known, or known to be silent, unknown.
    for _ in 0..100 {
        world.run(0.1);
        assert!(find(&world, "FD_FAIL_R").detail.contains("60"));
        assert_eq!(find(&world, "COM_OF_LOSS_T").result, Verdict::Warn);
    }
    world.fake.parameters.insert("FD_FAIL_R".into(), int(0, Firmware::Px4));
    world.fake.parameters.insert("COM_OF_LOSS_T".into(), real(0.5));
    world.run(8.0);
    assert_eq!(find(&world, "FD_FAIL_R").result, Verdict::Pass);
    assert_eq!(find(&world, "COM_OF_LOSS_T").result, Verdict::Pass);
}

#[test]
fn spec_in_flight_no_parameter_is_asked_for() {
    let mut world = World::new(Fake::new(Firmware::Px4), |_| {});
    world.launch();
    let reads = |world: &World| {
        let all = world.fake.received.iter();
        all.filter(|(_, message)| matches!(message, MavMessage::PARAM_REQUEST_READ(_))).count()
    };
    let before = reads(&world);
    world.run(30.0);
    assert_eq!(reads(&world), before);
}
