//! Orders two at a time: a sample of what `cargo run --release --example orders` flies whole.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use veilwing::mission::Outcome;
use veilwing::role::Role;

use crate::harness::*;
use crate::orders_table::{cases, run};

#[test]
fn spec_no_two_orders_lead_to_an_emission_or_a_take_off_after_a_kill_nor_leave_a_vehicle_in_the_air() {
    // A stride that meets every value of every coordinate.
    for case in cases().iter().step_by(133) {
        let seen = run(case);
        assert!(seen.wrong.is_empty(), "{case}: {:#?}", seen.wrong);
    }
}

#[test]
fn spec_a_kill_while_the_pair_link_is_cut_then_a_start_serves_nothing_and_flies_nothing() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(20));
    let cut = Path { loss: 1.0, ..Path::GOOD };
    Role::BOTH.into_iter().for_each(|role| flight.set_pair_path(role, cut));
    flight.command(Role::I, MavCmd::MAV_CMD_USER_2);
    flight.pass(Duration::from_secs(1));
    Role::BOTH.into_iter().for_each(|role| flight.set_pair_path(role, Path::GOOD));
    flight.command(Role::I, MavCmd::MAV_CMD_MISSION_START);
    flight.pass(Duration::from_secs(60));
    assert!(flight.log.on_air.is_empty(), "{}", flight.story());
    for role in Role::BOTH {
        assert!(flight.landed(role) && flight.log.setpoints[role].is_empty(), "{}", flight.story());
        assert!(flight.said(role, "radio kill").is_some(), "{}", flight.story());
    }
    // Lifted by a restart of each companion on the ground, it flies.
    for role in Role::BOTH {
        flight.kill(role);
        flight.start(role);
        flight.pass(Duration::from_secs(15));
        flight.command(role, MavCmd::MAV_CMD_MISSION_START);
        flight.pass(Duration::from_secs(10));
        assert_eq!(flight.landed(Role::I), role == Role::I, "{}", flight.story());
    }
    flight.fly_out();
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
}

#[test]
fn spec_a_kill_is_lifted_by_a_command_at_each_vehicle_and_not_by_one_said_to_all() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(20));
    flight.command(Role::J, MavCmd::MAV_CMD_USER_2);
    flight.pass(Duration::from_secs(1));
    for role in Role::BOTH {
        flight.command_all(role, MavCmd::MAV_CMD_USER_2, 1.0);
    }
    for role in Role::BOTH {
        flight.command(role, MavCmd::MAV_CMD_MISSION_START);
        flight.pass(Duration::from_secs(1));
        assert!(flight.said(role, "start refused").is_some(), "{}", flight.story());
        flight.command_with(role, MavCmd::MAV_CMD_USER_2, 1.0);
        flight.pass(Duration::from_secs(1));
    }
    flight.command(Role::I, MavCmd::MAV_CMD_MISSION_START);
    flight.fly_out();
    for role in Role::BOTH {
        assert!(flight.said(role, "lifted").is_some());
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
}

#[test]
fn spec_kill_pause_and_return_are_obeyed_when_they_are_said_to_all() {
    for command in
        [MavCmd::MAV_CMD_USER_2, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE]
    {
        let mut flight = Flight::new(Setup::default());
        assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
        let at = flight.now;
        flight.command_all(Role::J, command, 0.0);
        flight.pass(Duration::from_secs(5));
        for role in Role::BOTH {
            assert!(flight.silent_after(role, at) <= REACTION, "{command:?} {role}\n{}", flight.story());
        }
        flight.assert_safe();
    }
}

#[test]
fn spec_a_pause_in_the_last_slot_holds_until_it_is_continued_or_called_home_or_too_long() {
    for ended_by in
        [Some(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE), Some(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH), None]
    {
        let mut flight = on_the_air(Setup::default(), 1);
        flight.command_with(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
        flight.pass(Duration::from_secs(5));
        let at = Role::BOTH.map(|role| flight.place(role));
        flight.pass(Duration::from_secs(60));
        for (role, at) in Role::BOTH.into_iter().zip(at) {
            assert!((flight.place(role) - at).norm() < 0.3, "{role}: {}", flight.story());
            assert!(flight.silent_after(role, flight.now).is_zero());
        }
        let since = flight.now;
        match ended_by {
            Some(command) => flight.command_with(Role::I, command, 1.0),
            // Ten minutes at most.
            None => flight.pass(Duration::from_secs(600)),
        }
        flight.fly_out();
        flight.assert_safe();
        assert!(flight.log.on_air.iter().all(|(at, on)| *at < since || *on == [false, false]));
        let completed = ended_by == Some(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE);
        for role in Role::BOTH {
            assert_eq!(flight.outcomes[role] == Some(Outcome::Completed), completed, "{}", flight.story());
            assert!(flight.landed(role), "{}", flight.story());
        }
    }
}

#[test]
fn spec_start_and_continue_are_obeyed_when_they_are_said_to_the_companion_and_not_to_all() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(20));
    for role in Role::BOTH {
        flight.command_all(role, MavCmd::MAV_CMD_MISSION_START, 0.0);
    }
    flight.pass(Duration::from_secs(10));
    for role in Role::BOTH {
        assert!(flight.landed(role) && flight.said(role, "start ordered").is_none(), "{}", flight.story());
    }
    flight.command(Role::J, MavCmd::MAV_CMD_MISSION_START);
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    flight.command_all(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
    flight.pass(Duration::from_secs(3));
    flight.command_all(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
    flight.pass(Duration::from_secs(3));
    assert!(flight.said(Role::J, "going on").is_none(), "{}", flight.story());
    flight.command_with(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
    flight.pass(Duration::from_secs(3));
    for role in Role::BOTH {
        assert!(flight.said(role, "going on by the operator's order").is_some(), "{}", flight.story());
    }
    flight.fly_out();
    flight.assert_safe();
}

#[test]
fn spec_every_order_that_is_refused_is_refused_in_words() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    let refused = |flight: &mut Flight, command: MavCmd, param1: f32, words: &str| {
        flight.command_with(Role::I, command, param1);
        flight.pass(Duration::from_millis(200));
        assert!(flight.said(Role::I, words).is_some(), "{words}\n{}", flight.story());
    };
    refused(&mut flight, MavCmd::MAV_CMD_MISSION_START, 0.0, "start refused: ");
    flight.pass(Duration::from_secs(20));
    refused(&mut flight, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0, "continue refused: nothing is paused");
    flight.command(Role::I, MavCmd::MAV_CMD_MISSION_START);
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    refused(&mut flight, MavCmd::MAV_CMD_MISSION_START, 0.0, "start refused: in flight");
    refused(
        &mut flight,
        MavCmd::MAV_CMD_USER_2,
        1.0,
        "lifting the kill refused: only on the ground, disarmed",
    );
    flight.command(Role::I, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH);
    flight.pass(Duration::from_secs(2));
    let home = "refused: this vehicle is on its way home";
    refused(&mut flight, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0, &format!("pause {home}"));
    refused(&mut flight, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0, &format!("continue {home}"));
    // In the pilot's hand.
    let mut flight = Flight::new(Setup::default());
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    let land = COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_NAV_LAND,
        target_system: 1,
        target_component: 1,
        ..COMMAND_LONG_DATA::DEFAULT
    };
    flight.tell_autopilot(Role::I, &MavMessage::COMMAND_LONG(land));
    flight.pass(Duration::from_secs(2));
    let hand = "refused: this vehicle is in another hand";
    refused(&mut flight, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, 0.0, &format!("return {hand}"));
    refused(&mut flight, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0, &format!("pause {hand}"));
}

#[test]
fn spec_an_order_that_the_other_vehicle_does_not_confirm_is_said_so_in_words() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(20));
    // J is heard, and hears nothing.
    flight.set_pair_path(Role::I, Path { loss: 1.0, ..Path::GOOD });
    flight.command(Role::I, MavCmd::MAV_CMD_USER_2);
    flight.pass(Duration::from_secs(30));
    assert!(flight.said(Role::I, "vehicle J has not confirmed it in time").is_some(), "{}", flight.story());
}

#[test]
fn regress_a_return_ordered_just_after_lift_off_lands_below_the_band_and_blames_no_airspace() {
    let mut flight = Flight::new(Setup::default());
    let aloft = |flight: &Flight| {
        flight.world.snapshot().vehicles.iter().all(|vehicle| vehicle.position_enu_m[2] > 0.5)
    };
    assert!(flight.until(aloft), "{}", flight.story());
    flight.command(Role::I, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH);
    flight.fly_out();
    flight.assert_safe();
    for role in Role::BOTH {
        assert!(flight.said(role, "landing where it took off").is_some(), "{}", flight.story());
        assert!(flight.said(role, "no way home").is_none(), "{}", flight.story());
        assert!(flight.landed(role), "{}", flight.story());
    }
}

#[test]
fn spec_a_vehicle_that_flies_again_by_another_hand_is_not_started_by_what_was_ordered_before() {
    // The companion of I dies in a slot and comes back, its vehicle is landed by the pilot; --start is still set.
    let mut flight = Flight::new(Setup::default());
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    flight.kill(Role::I);
    flight.start(Role::I);
    flight.pass(Duration::from_secs(1));
    let land = COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_NAV_LAND,
        target_system: 1,
        target_component: 1,
        ..COMMAND_LONG_DATA::DEFAULT
    };
    flight.tell_autopilot(Role::I, &MavMessage::COMMAND_LONG(land));
    let both_landed = |flight: &Flight| Role::BOTH.into_iter().all(|role| flight.landed(role));
    assert!(flight.until(both_landed), "{}", flight.story());
    // And once more, on the ground.
    flight.kill(Role::I);
    flight.start(Role::I);
    flight.kill(Role::J);
    flight.start(Role::J);
    flight.pass(Duration::from_secs(60));
    assert!(both_landed(&flight), "{}", flight.story());
    for role in Role::BOTH {
        assert!(flight.said(role, "has flown, or was recalled").is_some(), "{}", flight.story());
    }
    flight.command(Role::J, MavCmd::MAV_CMD_MISSION_START);
    flight.fly_out();
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
}

#[test]
fn spec_a_pause_that_nobody_ends_ends_with_both_at_home() {
    let mut flight = Flight::new(Setup::default());
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    flight.command(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE);
    flight.pass(Duration::from_secs(590));
    assert!(Role::BOTH.into_iter().all(|role| !flight.landed(role)), "{}", flight.story());
    flight.pass(Duration::from_secs(90));
    assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "{}", flight.story());
    flight.assert_safe();
}
