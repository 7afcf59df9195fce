//! Slots that are served through the vehicles' turns, and carry each other on.

use std::sync::OnceLock;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavCmd;
use veilwing::config::{Mode, Optimise};
use veilwing::mission::Outcome;
use veilwing::planner::turning::Between;
use veilwing::role::{PerVehicle, Role};

use crate::harness::*;

/// The small mission, twice round.
fn turning() -> Setup {
    static PLANNED: OnceLock<Planned> = OnceLock::new();
    let planned = PLANNED.get_or_init(|| {
        let mission = yard().mission.changed(|m| {
            (m.planner.optimise, m.planner.mode) = (Optimise::Volume, Mode::Turning);
            (m.tdma.superframes, m.vehicles.i.tilt_rate_deg_s, m.vehicles.j.tilt_rate_deg_s) =
                (2, 30.0, 30.0);
        });
        Planned::new(mission.unwrap())
    });
    let turns = planned.plan.turns.as_ref().unwrap();
    assert!(turns.slots.iter().all(|slot| matches!(slot.between, Between::Turn(_))), "{turns:#?}");
    assert!(turns.slots.iter().any(|slot| slot.knots.len() > 2), "no vehicle turns on the air: {turns:#?}");
    Setup { given: PerVehicle { i: planned.clone(), j: planned.clone() }, ..Setup::default() }
}

#[test]
fn val_a_mission_is_served_through_its_turns_as_planned() {
    let setup = turning();
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
        // A lease's way at most is lost of what is planned.
        let lost_s = planned.on_air_s - slot.radiated_s.i;
        assert!((-0.001..0.1).contains(&lost_s), "{slot:#?} {}", planned.on_air_s);
        assert!(slot.radiated_s.j >= slot.radiated_s.i, "{slot:#?}");
        assert_eq!(slot.jam_out_of_tolerance_s, 0.0, "{slot:#?}");
    }
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
        // The first is agreed on; each of the others begins as the one before closes.
        assert_eq!(
            flight
                .log
                .notices
                .iter()
                .filter(|(_, who, said)| *who == role && said.contains(": agreed"))
                .count(),
            4
        );
    }
}

/// Between two users J is silent: its null is on nobody.
#[test]
fn spec_a_jammer_is_silent_while_it_turns_to_the_next_user() {
    let setup = turning();
    let silences: Vec<f64> =
        setup.given.i.plan.turns.as_ref().unwrap().slots.iter().map(|slot| slot.silence_s).collect();
    let mut flight = Flight::new(setup);
    flight.fly_out();
    let ons = |k: usize| -> Vec<(Duration, bool)> {
        let mut changes: Vec<(Duration, bool)> =
            flight.log.on_air.iter().map(|(at, on)| (*at, on[k])).collect();
        changes.dedup_by_key(|(_, on)| *on);
        changes
    };
    let gaps: Vec<f64> = ons(1)
        .windows(2)
        .filter(|pair| !pair[0].1 && pair[1].1)
        .map(|pair| (pair[1].0 - pair[0].0).as_secs_f64())
        .collect();
    assert_eq!(gaps.len(), 3, "{}", flight.story());
    for (gap_s, silence_s) in gaps.iter().zip(silences.iter().cycle()) {
        // It comes on 0.2 s before the user is served, and is off once I has said that it is.
        assert!(
            (silence_s - 0.3..silence_s - 0.1).contains(gap_s),
            "{gap_s} of {silence_s}\n{}",
            flight.story()
        );
    }
}

/// While both are in the second slot, which nobody has agreed on.
fn carried_on() -> Flight {
    let mut flight = Flight::new(turning());
    let begun = |flight: &Flight| {
        Role::BOTH.iter().all(|role| flight.said(*role, "slot 1 for bravo: agreed").is_some())
    };
    assert!(flight.until(begun), "{}", flight.story());
    flight
}

#[test]
fn spec_a_pause_puts_off_a_slot_that_was_carried_on_to() {
    let mut flight = carried_on();
    flight.command_with(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
    flight.pass(Duration::from_secs(2));
    assert_eq!(flight.radiating(), [false, false], "{}", flight.story());
    assert!(flight.said(Role::I, "slot 1 for bravo: put off").is_some(), "{}", flight.story());
    flight.command_with(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
    flight.fly_out();
    flight.assert_safe();
    assert!(flight.report().slots.iter().all(|slot| slot.radiated_s.i > 4.0), "{}", flight.story());
}

#[test]
fn spec_a_pair_link_that_is_cut_at_the_change_costs_service_and_never_protection() {
    for from in Role::BOTH {
        let mut flight = carried_on();
        flight.set_pair_path(from, Path::CUT);
        flight.pass(Duration::from_secs(1));
        flight.set_pair_path(from, Path::GOOD);
        flight.fly_out();
        flight.assert_safe();
        let [served, others] = [1, 3].map(|slot: usize| flight.report().slots[slot].radiated_s.i);
        assert!(served > 3.0 && others > 4.0, "{served} {others}\n{}", flight.story());
    }
}

#[test]
fn spec_a_kill_at_the_change_is_obeyed_by_both() {
    let mut flight = carried_on();
    flight.command(Role::J, MavCmd::MAV_CMD_USER_2);
    flight.pass(Duration::from_secs(1));
    let since = flight.now;
    flight.fly_out();
    flight.assert_safe();
    assert!(
        flight.log.on_air.iter().all(|(at, on)| *at < since || *on == [false, false]),
        "{}",
        flight.story()
    );
}

/// The user's answers tell of a companion that dies in the turn: the other one goes home, silent.
#[test]
fn spec_a_companion_that_dies_in_the_silent_turn_ends_the_mission() {
    for role in Role::BOTH {
        let mut flight = carried_on();
        flight.kill(role);
        assert!(flight.until(|flight| !flight.lives(role.peer())), "{}", flight.story());
        flight.assert_safe();
        assert!(flight.silent_after(Role::I, flight.now - Duration::from_secs(1)).is_zero());
    }
}
