//! What a battery bears is flown, and no more: the pair is home with its reserve.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavCmd;
use veilwing::config::BatteryDraft;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::Fault;

use crate::harness::*;

const RESERVE: f64 = 0.2;

fn of(endurance_s: Option<f64>) -> Setup {
    Setup { battery: Some(BatteryDraft { endurance_s, reserve: RESERVE }), ..Setup::default() }
}

/// How a flight ended in which one battery is so many times too weak, with the charges left.
fn weak(role: Role, times: f64, setup: Setup) -> (Flight, PerVehicle<f64>) {
    let mut flight = Flight::new(setup);
    flight.world.inject(Fault::BatteryWeak { vehicle: index(role), times });
    flight.fly_out();
    flight.assert_safe();
    assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "{}", flight.story());
    let left = flight.report().battery_left;
    (flight, PerVehicle { i: left.i, j: left.j })
}

#[test]
fn spec_a_weak_battery_brings_both_home_with_the_reserve_whether_or_not_the_file_knows_one() {
    for endurance_s in [None, Some(1800.0)] {
        for role in Role::BOTH {
            let (flight, left) = weak(role, 18.0, of(endurance_s));
            assert!(left[role] >= RESERVE && left[role] < 0.6, "{role}: {left:?}\n{}", flight.story());
            let decided = flight.said(role, "mission aborted: the battery: ").unwrap();
            // The other does not go on alone.
            let followed = flight.said(role.peer(), &format!("vehicle {role}")).unwrap();
            assert!(followed <= decided + Duration::from_secs(3), "{followed:?}\n{}", flight.story());
        }
    }
}

#[test]
fn spec_a_battery_that_is_enough_changes_nothing() {
    let (flight, left) = weak(Role::I, 2.0, of(Some(900.0)));
    assert!(flight.said(Role::I, "aborted").is_none(), "{}", flight.story());
    assert!(left.i > RESERVE && left.i < left.j, "{left:?}");
}

#[test]
fn spec_a_mission_that_does_not_fit_is_not_begun_and_one_that_nobody_can_tell_is_warned_of() {
    let mut flight = Flight::new(of(Some(60.0)));
    flight.pass(Duration::from_secs(60));
    assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "{}", flight.story());
    for role in Role::BOTH {
        assert!(
            flight.said(role, "waiting: endurance: the mission takes up to ").is_some(),
            "{}",
            flight.story()
        );
    }
    let mut flight = Flight::new(of(None));
    flight.pass(Duration::from_secs(5));
    let told = "preflight warning: endurance: [battery] endurance_s is not stated in the vehicle file";
    assert!(flight.said(Role::I, told).is_some(), "{}", flight.story());
}

#[test]
fn spec_a_gauge_that_stands_still_does_not_keep_a_vehicle_in_the_air() {
    let mut flight = Flight::new(of(Some(200.0)));
    flight.world.inject(Fault::BatteryWeak { vehicle: 1, times: 9.0 });
    flight.world.inject(Fault::BatteryLies { vehicle: 1 });
    // A pause that nobody ends.
    flight.pass(Duration::from_secs(20));
    flight.command(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE);
    flight.fly_out();
    flight.assert_safe();
    assert!(flight.said(Role::J, "mission aborted: the battery: ").is_some(), "{}", flight.story());
    let left = flight.report().battery_left;
    assert!(left.j >= RESERVE && left.j < 0.6, "{left:?}\n{}", flight.story());
}

#[test]
fn regress_a_vehicle_whose_peer_gave_up_before_the_last_slot_follows_it_at_once() {
    let mut flight = Flight::new(of(Some(1800.0)));
    // J's battery loses half of its charge while slot 0 is served.
    assert!(flight.until(|flight| flight.said(Role::J, "slot 0: on").is_some()), "{}", flight.story());
    flight.world.inject(Fault::BatteryWeak { vehicle: 1, times: 24.0 });
    flight.fly_out();
    flight.assert_safe();
    let gave_up = flight.said(Role::J, "mission aborted: the battery: ").expect("too little for slot 1");
    let followed = flight.said(Role::I, "aborted").unwrap();
    assert!(followed <= gave_up + Duration::from_secs(1), "{followed:?}\n{}", flight.story());
    assert!(flight.said(Role::I, "returning home") < flight.said(Role::J, "returning home"), "I first");
}

#[test]
fn spec_what_the_preflight_lets_begin_is_flown_to_the_end() {
    let begun = (10..60).map(|tens| f64::from(tens) * 10.0).find_map(|endurance_s| {
        let mut flight = Flight::new(of(Some(endurance_s)));
        for vehicle in 0..2 {
            flight.world.inject(Fault::BatteryWeak { vehicle, times: 1800.0 / endurance_s });
        }
        flight.pass(Duration::from_secs(10));
        flight.said(Role::I, "taking off").is_some().then_some((flight, endurance_s))
    });
    let (mut flight, endurance_s) = begun.expect("ten minutes are enough");
    assert!(endurance_s > 100.0, "the shortest of them is not");
    flight.fly_out();
    flight.assert_safe();
    assert!(flight.said(Role::J, "aborted").is_none(), "{endurance_s} s:\n{}", flight.story());
    let left = flight.report().battery_left;
    assert!(left.i.min(left.j) >= RESERVE, "{endurance_s} s: {left:?}");
}

#[test]
fn spec_j_does_not_wait_until_i_is_down_where_its_battery_does_not_bear_that() {
    let [waited, at_once] = [1.0, 30.0].map(|times| {
        let mut flight = in_mid_slot(of(Some(1800.0)));
        flight.command(Role::I, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH);
        flight.world.inject(Fault::BatteryWeak { vehicle: 1, times });
        flight.fly_out();
        flight.assert_safe();
        flight.said(Role::J, "returning home").unwrap()
    });
    assert!(at_once + Duration::from_secs(2) < waited, "{at_once:?} {waited:?}");
}

#[test]
fn spec_a_slot_that_does_not_fit_any_more_is_not_flown_to() {
    let mut flight = in_mid_slot(of(Some(200.0)));
    flight.command(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE);
    // So long that the way home fits and the slot before it does not.
    let taken_off = flight.said(Role::J, "taking off").unwrap();
    flight.pass(taken_off + Duration::from_secs(88) - flight.now);
    flight.command_with(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
    flight.fly_out();
    flight.assert_safe();
    let aborted =
        flight.log.notices.iter().find(|(_, role, text)| *role == Role::J && text.contains("aborted"));
    let (_, _, text) = aborted.unwrap();
    assert!(text.contains("slot 1 with the way home takes"), "{text}");
    assert!(text.ends_with("takes 1.5"), "{text}");
    // Of 200 s 88 are flown.
    assert!(text.contains("56% are left") && text.contains("the reserve of 20%"), "{text}");
}
