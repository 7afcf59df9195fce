//! What the companions say on the ground.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, MavParamType, PARAM_SET_DATA};
use veilwing::role::Role;

use crate::harness::*;

/// A ground station sets an integer parameter of vehicle I's PX4.
fn set(flight: &mut Flight, name: &str, value: i32) {
    let set = PARAM_SET_DATA {
        param_value: f32::from_le_bytes(value.to_le_bytes()),
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
        param_type: MavParamType::MAV_PARAM_TYPE_INT32,
    };
    flight.tell_autopilot(Role::I, &MavMessage::PARAM_SET(set));
}

fn times(flight: &Flight, text: &str) -> usize {
    flight.log.notices.iter().filter(|(_, role, what)| *role == Role::I && what.contains(text)).count()
}

#[test]
fn spec_a_warning_is_told_once_a_failure_again_and_again_and_neither_once_it_is_put_right() {
    let mut flight = Flight::new(Setup::default());
    set(&mut flight, "FD_FAIL_R", 60);
    set(&mut flight, "NAV_DLL_ACT", 2);
    flight.pass(Duration::from_secs(100));
    assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "{}", flight.story());
    let failure = "FD_FAIL_R: 60, should be 0";
    assert!((3..=5).contains(&times(&flight, failure)), "{}", flight.story());
    assert_eq!(times(&flight, "preflight warning"), 0, "what fails comes first: {}", flight.story());

    set(&mut flight, "FD_FAIL_R", 0);
    let told = times(&flight, failure);
    assert!(flight.until(|flight| !flight.landed(Role::I)), "{}", flight.story());
    assert_eq!(times(&flight, failure), told, "{}", flight.story());
    assert_eq!(times(&flight, "preflight warning: NAV_DLL_ACT: 2, should be 0"), 1, "{}", flight.story());
    flight.fly_out();
    flight.assert_safe();
}
