//! What the two companions must agree on, what an operator may order, and what a bad pair link costs.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};
use veilwing::mission::Outcome;
use veilwing::planner::slots::Plan;
use veilwing::role::{PerVehicle, Role};

use crate::harness::*;

/// Long enough to have taken off, were it not for what is wrong.
const PATIENCE: Duration = Duration::from_secs(60);

fn never_takes_off(mut flight: Flight, complaint: &str) {
    flight.pass(PATIENCE);
    for role in Role::BOTH {
        assert!(flight.landed(role), "{}", flight.story());
        assert!(flight.said(role, complaint).is_some(), "{role}\n{}", flight.story());
        assert_eq!(flight.log.setpoints[role].len(), 0);
    }
    assert!(flight.log.on_air.is_empty(), "{}", flight.story());
    flight.assert_safe();
}

#[test]
fn spec_another_mission_on_the_other_vehicle_never_takes_off() {
    let other = yard().under(|m| m.tdma.slot_s = 5.5);
    let given = PerVehicle { i: yard().clone(), j: other };
    never_takes_off(Flight::new(Setup { given, ..Setup::default() }), "flies another mission");
}

#[test]
fn spec_another_plan_on_the_other_vehicle_never_takes_off() {
    let mut other = yard().clone();
    other.plan.slots[1].plan.vehicles.j.tx_power_w *= 1.0 - f64::EPSILON;
    other.plan = Plan::new(other.plan.slots);
    assert_ne!(other.plan.digest, yard().plan.digest);
    let given = PerVehicle { i: yard().clone(), j: other };
    never_takes_off(Flight::new(Setup { given, ..Setup::default() }), "made another plan");
}

#[test]
fn spec_without_authority_a_real_transmitter_never_radiates() {
    let mut flight = Flight::new(Setup { simulated: false, ..Setup::default() });
    flight.until(|flight| flight.now > Duration::from_secs(120));
    assert!(flight.log.on_air.is_empty(), "{}", flight.story());
    flight.assert_safe();
    for slot in &flight.report().slots {
        assert_eq!((slot.radiated_s.i, slot.radiated_s.j), (0.0, 0.0));
    }
}

fn result(flight: &Flight, role: Role, command: MavCmd) -> Option<MavResult> {
    flight.log.acks.iter().rev().find_map(|(_, who, message)| match message {
        MavMessage::COMMAND_ACK(ack) if *who == role && ack.command == command => {
            assert_eq!((ack.target_system, ack.target_component), (255, 190));
            Some(ack.result)
        }
        _ => None,
    })
}

#[test]
fn spec_either_companion_starts_both() {
    for told in Role::BOTH {
        let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
        flight.pass(Duration::from_secs(30));
        assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "nobody asked for the start");
        assert!(flight.said(told, "MISSION_START").is_some(), "{}", flight.story());
        flight.command(told, MavCmd::MAV_CMD_MISSION_START);
        flight.fly_out();
        assert_eq!(
            result(&flight, told, MavCmd::MAV_CMD_MISSION_START),
            Some(MavResult::MAV_RESULT_ACCEPTED)
        );
        for role in Role::BOTH {
            assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
        }
        flight.assert_safe();
    }
}

#[test]
fn spec_what_cannot_be_obeyed_is_not_accepted() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(10));
    // Nothing is paused.
    flight.command_with(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
    flight.command(Role::I, MavCmd::MAV_CMD_NAV_LOITER_TURNS);
    flight.pass(Duration::from_secs(1));
    let of = |command| result(&flight, Role::I, command);
    assert_eq!(of(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE), Some(MavResult::MAV_RESULT_DENIED));
    assert_eq!(of(MavCmd::MAV_CMD_NAV_LOITER_TURNS), Some(MavResult::MAV_RESULT_UNSUPPORTED));
}

fn ordered_in_mid_slot(command: MavCmd) {
    for told in Role::BOTH {
        let mut flight = Flight::new(Setup::default());
        assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
        flight.pass(Duration::from_millis(500));
        let at = flight.now;
        flight.command(told, command);
        flight.fly_out();
        assert_eq!(result(&flight, told, command), Some(MavResult::MAV_RESULT_ACCEPTED));
        for role in Role::BOTH {
            assert!(flight.silent_after(role, at) <= REACTION, "{role}\n{}", flight.story());
        }
        flight.assert_safe();
        for role in Role::BOTH {
            let ordered = match &flight.outcomes[role] {
                Some(Outcome::Aborted(cause)) => cause.to_string().contains("operator"),
                _ => false,
            };
            assert!(ordered && flight.landed(role), "{role}\n{}", flight.story());
        }
    }
}

#[test]
fn spec_radio_kill_silences_both_and_brings_them_home() {
    ordered_in_mid_slot(MavCmd::MAV_CMD_USER_2);
}

#[test]
fn spec_an_ordered_return_silences_both_and_brings_them_home() {
    ordered_in_mid_slot(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH);
}

#[test]
fn spec_a_radio_kill_before_the_start_lasts() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(10));
    flight.command(Role::J, MavCmd::MAV_CMD_USER_2);
    flight.pass(Duration::from_secs(1));
    flight.command(Role::J, MavCmd::MAV_CMD_MISSION_START);
    flight.until(|flight| flight.now > Duration::from_secs(150));
    assert!(flight.log.on_air.is_empty(), "{}", flight.story());
    flight.assert_safe();
}

fn flies_over(pair: Path) {
    for seed in 1..=3 {
        let mut flight = Flight::new(Setup { pair, seed, ..Setup::default() });
        flight.fly_out();
        flight.assert_safe();
        for role in Role::BOTH {
            assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "seed {seed}\n{}", flight.story());
        }
        for slot in &flight.report().slots {
            assert!(slot.radiated_s.i > 0.0, "seed {seed}\n{}", flight.story());
        }
    }
}

#[test]
fn prop_a_lossy_slow_repeating_pair_link_costs_time_on_the_air_and_nothing_else() {
    // 200 ms there and back.
    let delay = Duration::from_millis(100);
    flies_over(Path { loss: 0.2, duplication: 0.3, delay, ..Path::GOOD });
}

#[test]
fn spec_a_pair_link_too_slow_for_leases_is_safe_and_says_that_slots_go_unserved() {
    // There and back in 480 ms: a grant is counted from its request (S1), so nothing is left of 500 ms when it
    // arrives, less the margins of the jammer's own lease.
    let pair = Path { loss: 0.2, duplication: 0.3, delay: Duration::from_millis(240), ..Path::GOOD };
    let mut flight = Flight::new(Setup { pair, ..Setup::default() });
    flight.fly_out();
    flight.assert_safe();
    assert!(flight.said(Role::I, "not served").is_some(), "{}", flight.story());
    assert!(matches!(flight.outcomes.i, Some(Outcome::Aborted(_))), "{}", flight.story());
    assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "{}", flight.story());
}

/// `cargo test --test flight in_vain -- --nocapture` prints how long each was on the air over how slow a link.
#[test]
fn spec_j_does_not_jam_in_vain() {
    println!("one way  slots  I on s  J on s  J in the longest slot s");
    for ms in [20, 100, 150, 200, 250, 400] {
        let pair = Path { delay: Duration::from_millis(ms), ..Path::GOOD };
        let mut flight = Flight::new(Setup { pair, ..Setup::default() });
        flight.fly_out();
        flight.assert_safe();
        let slots = flight.report().slots;
        let i = slots.iter().map(|slot| slot.radiated_s.i).sum::<f64>();
        let j = slots.iter().map(|slot| slot.radiated_s.j).sum::<f64>();
        let longest = slots.iter().map(|slot| slot.radiated_s.j).fold(0.0, f64::max);
        println!("{ms:>4} ms {:>6} {i:>7.3} {j:>7.3} {longest:>7.3}", slots.len());
        // Of 8.8 s. With 400 ms there and back too little is left of a lease of 500 ms when it arrives; how much I is on then
        // depends on the beat of its own state.
        assert_eq!(i > 8.5, ms <= 150, "{ms}\n{}", flight.story());
        assert_eq!(flight.said(Role::J, "ended early").is_none(), ms <= 150, "{ms}\n{}", flight.story());
        // Until I was off for 1.5 s more than twice the time it was on; it is on first, and says so late.
        for slot in &slots {
            assert!(slot.radiated_s.j < 2.5 + 3.0 * slot.radiated_s.i, "{ms}\n{}", flight.story());
        }
    }
}

#[test]
fn spec_a_companion_told_to_end_in_mid_slot_ends_silent_and_in_order() {
    for told in Role::BOTH {
        let mut flight = Flight::new(Setup::default());
        assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
        flight.pass(Duration::from_millis(500));
        let at = flight.now;
        flight.stop(told);
        flight.fly_out();
        flight.assert_safe();
        for role in Role::BOTH {
            assert!(flight.silent_after(role, at) <= REACTION, "{role}\n{}", flight.story());
        }
        assert_eq!(flight.outcomes[told], Some(Outcome::Interrupted), "{}", flight.story());
        assert!(flight.landed(told.peer()));
    }
}

#[test]
fn prop_a_reordering_pair_link_costs_time_on_the_air_and_nothing_else() {
    let (delay, spread) = (Duration::from_millis(20), Duration::from_millis(150));
    flies_over(Path { loss: 0.2, duplication: 0.3, delay, spread, ..Path::GOOD });
}

#[test]
fn spec_only_listed_operators_are_obeyed_and_each_stranger_is_named_once() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(30));
    for system in [254, 1, 254, 2] {
        flight.command_from((system, 190), Role::I, MavCmd::MAV_CMD_MISSION_START);
        flight.command_from((system, 190), Role::I, MavCmd::MAV_CMD_USER_2);
        flight.pass(Duration::from_secs(1));
    }
    flight.write_from((254, 190), Role::I, "VW_POS_TOL_M", 0.2);
    flight.pass(PATIENCE);
    assert!(Role::BOTH.into_iter().all(|role| flight.landed(role)), "{}", flight.story());
    for system in [254, 1, 2] {
        let named = flight.log.notices.iter().filter(|(_, role, text)| {
            *role == Role::I && text.contains(&format!("commands of system {system} are refused"))
        });
        assert_eq!(named.count(), 1, "{}", flight.story());
    }
    let denied = flight.log.acks.iter().filter(|(_, _, message)| {
        matches!(message, MavMessage::COMMAND_ACK(ack) if ack.result == MavResult::MAV_RESULT_DENIED)
    });
    assert_eq!(denied.count(), 8, "each is answered");
    assert!(
        flight.said(Role::I, "radio kill").is_none() && flight.said(Role::I, "VW_POS_TOL_M is now").is_none()
    );
    // The operator's own is obeyed as ever, and its written parameter taken.
    flight.write_from((255, 190), Role::I, "VW_POS_TOL_M", 0.4);
    flight.command(Role::I, MavCmd::MAV_CMD_MISSION_START);
    flight.fly_out();
    assert!(flight.said(Role::I, "VW_POS_TOL_M is now 0.4").is_some(), "{}", flight.story());
    assert_eq!(flight.outcomes[Role::I], Some(Outcome::Completed), "{}", flight.story());
}
