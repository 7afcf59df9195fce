//! Slots that are served while both vehicles move.

use std::sync::OnceLock;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavCmd;
use veilwing::config::{Mission, Mode, Optimise};
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};

use crate::harness::*;

/// The demonstration's mission in motion, twice round.
fn moving() -> Setup {
    static PLANNED: OnceLock<Planned> = OnceLock::new();
    with_guard(1.0, &PLANNED)
}

fn with_guard(guard_s: f64, planned: &'static OnceLock<Planned>) -> Setup {
    let planned = planned.get_or_init(|| {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/mission.toml");
        let mission = Mission::load(&path).unwrap().changed(|m| {
            (m.planner.optimise, m.planner.mode) = (Optimise::Volume, Mode::Moving);
            (m.tdma.superframes, m.tdma.guard_s) = (2, guard_s);
        });
        Planned::new(mission.unwrap())
    });
    assert!(planned.plan.ways.is_some(), "nobody moves: {:#?}", planned.plan.turns);
    Setup { given: PerVehicle { i: planned.clone(), j: planned.clone() }, ..Setup::default() }
}

/// How far both vehicles come in so long.
fn moved_m(flight: &mut Flight, time: Duration) -> f64 {
    let before = Role::BOTH.map(|role| flight.place(role));
    flight.pass(time);
    Role::BOTH
        .iter()
        .zip(before)
        .map(|(role, before)| (flight.place(*role) - before).norm())
        .fold(0.0, f64::max)
}

/// Both have begun the slot of this number, and are in the midst of it.
fn amid(slot: usize) -> Flight {
    let mut flight = on_the_air(moving(), slot);
    flight.pass(Duration::from_secs(2));
    assert!(moved_m(&mut flight, Duration::from_secs(1)) > 1.0);
    flight
}

fn served_s(flight: &Flight) -> Vec<f64> {
    flight.report().slots.iter().map(|slot| slot.radiated_s.i).collect()
}

#[test]
fn val_a_mission_is_served_in_motion_as_planned() {
    let setup = moving();
    let plan = setup.given.i.plan.clone();
    let mut flight = Flight::new(setup);
    flight.fly_out();
    flight.assert_safe();
    let report = flight.report();
    assert_eq!(report.slots.len(), 4);
    for (slot, planned) in report.slots.iter().zip(plan.turns.unwrap().slots.iter().cycle()) {
        let difference = (slot.achieved_secrecy_rate_bps - slot.planned_secrecy_rate_bps).abs();
        let allowed = (0.02 * slot.planned_secrecy_rate_bps).max(4.0 * slot.standard_error_bps);
        assert!(difference <= allowed, "{slot:#?}");
        let lost_s = planned.on_air_s - slot.radiated_s.i;
        assert!((-0.001..0.1).contains(&lost_s), "{slot:#?} {}", planned.on_air_s);
        assert_eq!(slot.jam_out_of_tolerance_s, 0.0, "{slot:#?}");
    }
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
}

#[test]
fn spec_a_pair_that_is_paused_in_motion_comes_to_rest_on_its_way_and_is_served_again_afterwards() {
    for slot in [0, 1] {
        let mut flight = amid(slot);
        flight.command_with(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
        flight.pass(Duration::from_millis(500));
        assert_eq!(flight.radiating(), [false, false], "{}", flight.story());
        // To rest, and no farther: not to where the next slot is entered.
        flight.pass(Duration::from_secs(2));
        assert!(moved_m(&mut flight, Duration::from_secs(12)) < 0.3, "{}", flight.story());
        flight.command_with(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
        flight.fly_out();
        flight.assert_safe();
        let served_s = served_s(&flight);
        let after = &served_s[slot + 1..];
        assert!(after.iter().all(|s| *s > 6.5), "{served_s:?}\n{}", flight.story());
        assert_eq!(flight.outcomes.i, Some(Outcome::Completed), "{}", flight.story());
    }
}

/// The table's way home begins where the last slot is left in motion.
#[test]
fn spec_a_pair_that_is_paused_in_its_last_slot_holds_and_then_goes_home_from_where_it_rests() {
    for paused in [false, true] {
        let mut flight = amid(3);
        if paused {
            flight.command_with(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
            flight.pass(Duration::from_secs(4));
            assert!(moved_m(&mut flight, Duration::from_secs(20)) < 0.3, "{}", flight.story());
            flight.command_with(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
        }
        flight.fly_out();
        flight.assert_safe();
        for role in Role::BOTH {
            assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
        }
        // Said by who has come to rest first.
        assert_eq!(flight.said(Role::I, "returning home").is_some(), paused, "{}", flight.story());
    }
}

/// One of the two does not hear the other at the change, and leaves the motion: the other one follows, and both come back.
#[test]
fn spec_a_slot_that_one_of_them_does_not_carry_on_to_is_agreed_on_again() {
    for from in Role::BOTH {
        let mut flight = amid(0);
        let over = |flight: &Flight| flight.said(from, "slot 1 for bravo: agreed").is_some();
        assert!(flight.until(over), "{}", flight.story());
        flight.command_with(from, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
        flight.pass(Duration::from_secs(12));
        flight.command_with(from, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
        flight.fly_out();
        flight.assert_safe();
        let served_s = served_s(&flight);
        assert!(served_s[1..].iter().all(|s| *s > 6.5), "{served_s:?}\n{}", flight.story());
    }
}

/// I is paused at the change, and J does not hear of it before it has jammed for the next user already.
#[test]
fn spec_a_jammer_that_was_carried_on_alone_comes_back_for_what_its_leader_asks_for() {
    static PLANNED: OnceLock<Planned> = OnceLock::new();
    let setup = || with_guard(0.3, &PLANNED);
    let mut flight = Flight::new(setup());
    let over = |flight: &Flight| flight.said(Role::J, "slot 1 for bravo: agreed").is_some();
    assert!(flight.until(over), "{}", flight.story());
    let change = flight.now;
    let mut flight = Flight::new(setup());
    flight.pass(change - Duration::from_millis(30));
    flight.set_pair_path(Role::I, Path::CUT);
    flight.command_with(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
    flight.pass(Duration::from_millis(1500));
    assert!(flight.said(Role::J, "slot 1: on").is_some(), "{}", flight.story());
    flight.set_pair_path(Role::I, Path::GOOD);
    flight.pass(Duration::from_secs(12));
    flight.command_with(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
    flight.fly_out();
    flight.assert_safe();
    let served_s = served_s(&flight);
    assert!(served_s[1..].iter().all(|s| *s > 6.5), "{served_s:?}\n{}", flight.story());
}

#[test]
fn spec_a_pair_that_goes_home_out_of_its_motion_comes_to_rest_first() {
    for (command, role) in
        [(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, Role::I), (MavCmd::MAV_CMD_USER_2, Role::J)]
    {
        let mut flight = amid(1);
        flight.command(role, command);
        flight.assert_goes_home();
    }
}

#[test]
fn spec_a_companion_that_dies_in_motion_leaves_nobody_on_the_air_nor_in_the_way() {
    for role in Role::BOTH {
        let mut flight = amid(1);
        flight.kill(role);
        assert!(flight.until(|flight| !flight.lives(role.peer())), "{}", flight.story());
        flight.assert_safe();
        assert!(flight.silent_after(Role::I, flight.now - Duration::from_secs(1)).is_zero());
    }
}

/// Whoever is behind its motion is silent until it has caught up.
#[test]
fn spec_a_vehicle_that_was_not_told_where_to_be_for_a_while_is_silent_until_it_has_caught_up() {
    for role in Role::BOTH {
        let mut flight = amid(0);
        flight.set_autopilot_path(role, Path::CUT);
        flight.pass(Duration::from_millis(700));
        flight.set_autopilot_path(role, Path::GOOD);
        flight.fly_out();
        flight.assert_safe();
        let served_s = served_s(&flight);
        assert!(served_s.iter().all(|s| *s > 3.5), "{served_s:?}\n{}", flight.story());
    }
}

/// All that a link held up comes at once, what is old first: nobody goes on the air on that, before it has heard where it is by now.
#[test]
fn regress_nobody_comes_on_the_air_on_what_a_link_has_held_up() {
    for role in Role::BOTH {
        let mut flight = amid(0);
        flight.set_autopilot_path(role, Path::FROZEN);
        flight.pass(Duration::from_millis(736));
        assert_eq!(flight.radiating(), [false, false], "{}", flight.story());
        flight.set_autopilot_path(role, Path::GOOD);
        for _ in 0..58 {
            flight.pass(Duration::from_millis(5));
            assert!(!flight.radiating()[index(role)], "{}", flight.story());
        }
        flight.pass(Duration::from_secs(1));
        assert!(flight.radiating()[index(role)], "{}", flight.story());
        flight.fly_out();
        flight.assert_safe();
    }
}
