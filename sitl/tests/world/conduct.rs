//! S4, S5, F2 and F3 broken on purpose, each by a companion that does what no companion may, and seen from outside.

use crate::common::*;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use veilwing_sitl::*;

/// Both on station, level so that no other mode takes them out of their poses, and on the air for half a second.
fn on_the_air() -> Flight {
    let mut level = config();
    (level.slots[0].poses[0].roll_rad, level.slots[0].poses[0].pitch_rad) = (0.0, 0.0);
    let mut flight = on_station(level);
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    assert_eq!(flight.invariants(), vec![]);
    flight
}

/// Renews the power commands of `on` for `ms`, with setpoints for the vehicles of `steered`.
fn go_on(flight: &mut Flight, ms: u64, on: [bool; 2], steered: [bool; 2]) {
    let goals = flight.goals(0);
    for _ in 0..ms / 20 {
        for k in [1, 0] {
            if steered[k] {
                flight.target(k, goals[k], Some(0));
            }
            if on[k] {
                let dbm = flight.planned_dbm(0, k);
                flight.clients[k].power(&mut flight.world, dbm, 0, 300);
            }
        }
        flight.pass(20);
    }
}

/// The invariants broken, each with a word of its detail.
fn broken(flight: &Flight) -> Vec<String> {
    flight.invariants().into_iter().map(|(name, detail)| format!("{name}: {detail}")).collect()
}

/// The invariants that a radio broke by itself.
fn excused(flight: &Flight) -> Vec<&'static str> {
    let excused = flight.world.report().excused;
    assert!(excused.iter().all(|excused| excused.cause == Cause::RadioOutOfOrder), "{excused:?}");
    excused.iter().map(|excused| excused.violation.invariant().name()).collect()
}

fn assert_broken(flight: &Flight, expected: &[(&str, &str)]) {
    let broken = broken(flight);
    let met =
        |(name, word): &(&str, &str)| broken.iter().any(|line| line.starts_with(name) && line.contains(word));
    assert!(broken.len() == expected.len() && expected.iter().all(met), "{broken:?}, not {expected:?}");
}

#[test]
fn spec_radiating_on_after_the_pilot_took_over_breaks_s4() {
    for (k, name) in [(0, "I"), (1, "J")] {
        let mut flight = on_the_air();
        flight.world.inject(Fault::PilotMode { vehicle: k });
        let mut steered = [true, true];
        steered[k] = false;
        // The next HEARTBEAT comes within a second.
        go_on(&mut flight, 1300, [true, true], steered);
        assert_broken(&flight, &[("S4", &format!("{name} radiates"))]);
    }
}

#[test]
fn spec_silence_within_the_reaction_time_breaks_nothing() {
    let mut flight = on_the_air();
    let heartbeats = |flight: &Flight| {
        flight.clients[0]
            .received
            .iter()
            .filter(|(c, m)| *c == 1 && matches!(m, MavMessage::HEARTBEAT(_)))
            .count()
    };
    flight.world.inject(Fault::PilotMode { vehicle: 0 });
    let before = heartbeats(&flight);
    while heartbeats(&flight) == before {
        go_on(&mut flight, 20, [true, true], [true, true]);
    }
    go_on(&mut flight, 80, [true, true], [true, true]);
    flight.off(0);
    go_on(&mut flight, 500, [false, true], [false, true]);
    assert_broken(&flight, &[]);
}

#[test]
fn spec_setpoints_after_the_pilot_took_over_break_f2() {
    let mut flight = on_the_air();
    flight.world.inject(Fault::PilotMode { vehicle: 0 });
    flight.off(0);
    go_on(&mut flight, 1300, [false, true], [true, true]);
    assert_broken(&flight, &[("F2", "I's companion still sends setpoints")]);
}

#[test]
fn spec_taking_the_vehicle_back_breaks_f2_unless_an_operator_asked_for_it() {
    // At the vehicle itself, or at the other one, whose companion tells it.
    for asked in [None, Some(0), Some(1)] {
        let mut flight = on_the_air();
        flight.world.inject(Fault::PilotMode { vehicle: 0 });
        flight.off(0);
        if let Some(vehicle) = asked {
            let mut station = Client::ground_station(vehicle, 1);
            let start = COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_MISSION_START,
                target_system: station.system(),
                target_component: 191,
                ..COMMAND_LONG_DATA::DEFAULT
            };
            station.send(&mut flight.world, &MavMessage::COMMAND_LONG(start));
            go_on(&mut flight, 1300, [false, true], [true, true]);
        }
        flight.clients[0].command(&mut flight.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 6.0]);
        go_on(&mut flight, 1300, [false, true], [true, true]);
        assert!(flight.world.snapshot().vehicles[0].companion_controlled);
        let expected: &[_] = if asked.is_some() { &[] } else { &[("F2", "took the vehicle back")] };
        assert_broken(&flight, expected);
    }
}

#[test]
fn spec_a_failed_estimate_that_changes_nothing_breaks_s4() {
    let mut flight = on_the_air();
    flight.world.inject(Fault::EstimatorFailure { vehicle: 1 });
    go_on(&mut flight, 1300, [true, true], [true, true]);
    let broken = broken(&flight);
    assert!(
        broken.iter().any(|line| line.starts_with("S4: J radiates") && line.contains("estimate")),
        "{broken:?}"
    );
}

#[test]
fn spec_radiating_without_state_breaks_s4() {
    let mut flight = on_the_air();
    flight.world.inject(Fault::AutopilotRestart { vehicle: 1 });
    go_on(&mut flight, 700, [true, true], [true, true]);
    let broken = broken(&flight);
    assert!(
        broken.iter().any(|line| line.starts_with("S4: J radiates") && line.contains("was due")),
        "{broken:?}"
    );
}

/// What J granted may reach a silent I at any moment where it may be late: J jams on, on state that is not old (S2, S3).
#[test]
fn regress_j_without_state_jams_on_for_what_it_granted_and_no_longer() {
    let late = Circumstances {
        from_peer: Passage::Impaired,
        peer_way: std::time::Duration::from_millis(700),
        ..Circumstances::default()
    };
    // What was granted before a link was mended is under way yet.
    for (k, told, mended, may) in [
        (0, Circumstances::default(), false, false),
        (0, late, false, true),
        (1, late, false, true),
        (0, late, true, true),
    ] {
        let mut flight = on_the_air();
        flight.off(0);
        go_on(&mut flight, 280, [false, true], [true, true]);
        flight.world.set_circumstances(k, told);
        go_on(&mut flight, 20, [false, true], [true, true]);
        if mended {
            flight.world.set_circumstances(k, Circumstances::default());
        }
        flight.world.inject(Fault::AutopilotRestart { vehicle: 1 });
        go_on(&mut flight, 240, [false, true], [true, true]);
        let words = [("S4", "was due")];
        assert_broken(&flight, if may { &[] } else { &words });
        go_on(&mut flight, 200, [false, true], [true, true]);
        assert_broken(&flight, &words);
    }
}

#[test]
fn spec_a_cut_link_must_end_the_emission_by_its_lease() {
    for endless in [false, true] {
        let mut flight = on_the_air();
        if endless {
            flight.world.inject(Fault::TransmitterIgnoresExpiry { vehicle: 0 });
        }
        flight.world.inject(Fault::LinkLoss { vehicle: 0, on: true });
        go_on(&mut flight, 900, [true, true], [true, true]);
        assert_broken(&flight, &[]);
        assert_eq!(excused(&flight), if endless { vec!["S4"] } else { vec![] });
    }
}

#[test]
fn spec_a_peer_that_is_not_heard_must_end_the_emission() {
    for (k, name) in [(0, "I"), (1, "J")] {
        let mut flight = on_the_air();
        let cut = Circumstances { from_peer: Passage::Cut, ..Circumstances::default() };
        flight.world.set_circumstances(k, cut);
        go_on(&mut flight, 500, [true, true], [true, true]);
        assert_broken(&flight, &[]);
        go_on(&mut flight, 300, [true, true], [true, true]);
        assert_broken(&flight, &[("S4", &format!("{name} radiates"))]);
    }
}

/// A vehicle whose own link is cut, too, cannot be told: what it was told before expires, within a cut link's bound.
#[test]
fn regress_a_peer_that_is_not_heard_ends_nothing_over_a_cut_link() {
    for (endless, expected) in [(false, &[][..]), (true, &["S4"])] {
        let mut flight = on_the_air();
        let cut = Circumstances { from_peer: Passage::Cut, ..Circumstances::default() };
        flight.world.set_circumstances(1, cut);
        go_on(&mut flight, 400, [true, true], [true, true]);
        flight.off(0);
        go_on(&mut flight, 40, [false, true], [true, true]);
        if endless {
            flight.world.inject(Fault::TransmitterIgnoresExpiry { vehicle: 1 });
        }
        flight.world.inject(Fault::LinkLoss { vehicle: 1, on: true });
        go_on(&mut flight, 900, [false, true], [true, true]);
        assert_broken(&flight, &[]);
        assert_eq!(excused(&flight), expected);
    }
}

/// Nor can one be told that leaves its pose over a cut link: a fifth of a second is longer than is forgiven over a good one.
#[test]
fn regress_over_a_cut_link_who_is_out_of_pose_is_off_by_what_it_was_told() {
    for (cut, expected) in [(true, &[][..]), (false, &[("S2", "J radiates out of its pose")][..])] {
        let mut flight = on_the_air();
        flight.off(0);
        go_on(&mut flight, 20, [false, true], [true, true]);
        flight.world.inject(Fault::LinkLoss { vehicle: 1, on: cut });
        flight.world.inject(Fault::EstimatorReset { vehicle: 1, jump_enu_m: [4.0, 0.0, 0.0] });
        go_on(&mut flight, 240, [false, true], [true, false]);
        flight.world.inject(Fault::LinkLoss { vehicle: 1, on: false });
        flight.off(1);
        go_on(&mut flight, 400, [false, false], [true, false]);
        assert_broken(&flight, expected);
        assert_eq!(excused(&flight), Vec::<&str>::new());
    }
}

/// J's companion dies, is started again a third of a second later, and is blown out of its pose before it has heard its
/// vehicle: what the dead one granted I may run yet, to the end of its lease and no longer. I has granted nobody anything.
#[test]
fn regress_what_j_s_former_process_left_on_the_air_ends_with_its_lease() {
    for (vehicle, renewed, expected) in [
        (1, false, &[][..]),
        (1, true, &[("S2", "J radiates out of its pose")][..]),
        (0, false, &[("S1", "I radiates out of its pose")][..]),
    ] {
        let mut flight = on_the_air();
        let both = |on: bool| [vehicle == 0 && on, true];
        if vehicle == 1 {
            flight.off(0);
        }
        go_on(&mut flight, 20, both(true), [true, true]);
        let dbm = flight.planned_dbm(0, vehicle);
        flight.clients[vehicle].power(&mut flight.world, dbm, 0, 490);
        flight.world.inject(Fault::CompanionLost { vehicle });
        let steers = [vehicle == 1, vehicle == 0];
        let others = [false, vehicle == 0];
        go_on(&mut flight, 140, others, steers);
        flight.world.inject(Fault::EstimatorReset { vehicle, jump_enu_m: [4.0, 0.0, 0.0] });
        go_on(&mut flight, 20, others, steers);
        flight.world.set_circumstances(vehicle, Circumstances { life: 1, ..Circumstances::default() });
        go_on(&mut flight, 300, others, steers);
        if renewed {
            flight.clients[vehicle].power(&mut flight.world, dbm, 0, 300);
        }
        go_on(&mut flight, 400, others, steers);
        assert_broken(&flight, expected);
    }
}

#[test]
fn spec_i_follows_a_jammer_that_falls_silent_out_of_turn() {
    for (from_peer, expected) in
        [(Passage::Good, &[("S4", "after J fell silent out of turn")][..]), (Passage::Impaired, &[])]
    {
        let mut flight = on_the_air();
        flight.world.set_circumstances(0, Circumstances { from_peer, ..Circumstances::default() });
        // A failure gives J a reason.
        flight.world.inject(Fault::RotorLoss { vehicle: 1, rotor: 99 });
        flight.off(1);
        go_on(&mut flight, 300, [true, false], [true, true]);
        flight.off(0);
        go_on(&mut flight, 100, [false, false], [true, true]);
        assert_broken(&flight, expected);
    }
}

/// What could not be known counts from when it can be, not from before: a link or a radio in order again is no breach.
#[test]
fn regress_i_follows_from_when_it_can_know_that_j_is_silent() {
    let restart = |flight: &mut Flight, on| {
        flight.world.inject(Fault::TransmitterRestart { vehicle: 1, on });
    };
    let link = |flight: &mut Flight, from_peer| {
        flight.world.set_circumstances(0, Circumstances { from_peer, ..Circumstances::default() });
    };
    for (of_radio, known_ms) in [(true, 200), (false, 0)] {
        for (follows, expected) in [(true, &[][..]), (false, &[("S4", "after J fell silent out of turn")])] {
            let mut flight = on_the_air();
            // A failure gives J a reason.
            flight.world.inject(Fault::RotorLoss { vehicle: 1, rotor: 99 });
            if of_radio {
                restart(&mut flight, true)
            } else {
                link(&mut flight, Passage::Impaired)
            }
            flight.off(1);
            go_on(&mut flight, 300, [true, false], [true, true]);
            if of_radio {
                restart(&mut flight, false)
            } else {
                link(&mut flight, Passage::Good)
            }
            go_on(&mut flight, known_ms + 100, [true, false], [true, true]);
            if follows {
                flight.off(0);
            }
            go_on(&mut flight, 100, [!follows, false], [true, true]);
            flight.off(0);
            go_on(&mut flight, 100, [false, false], [true, true]);
            // The lease of before has run out meanwhile: of that S1 says so.
            let broken = broken(&flight);
            let s4: Vec<_> = broken.iter().filter(|line| line.starts_with("S4")).collect();
            assert_eq!(s4.len(), expected.len(), "{of_radio} {broken:?}");
            assert!(s4.iter().zip(expected).all(|(line, (_, word))| line.contains(word)), "{broken:?}");
        }
    }
}

#[test]
fn spec_what_outlives_its_companion_breaks_s5() {
    for endless in [false, true] {
        let mut flight = on_the_air();
        if endless {
            flight.world.inject(Fault::TransmitterIgnoresExpiry { vehicle: 1 });
        }
        flight.world.inject(Fault::CompanionLost { vehicle: 1 });
        flight.off(0);
        go_on(&mut flight, 800, [false, false], [true, false]);
        assert_broken(&flight, &[]);
        assert_eq!(excused(&flight), if endless { vec!["S5"] } else { vec![] });
    }
    // Somebody renews what a dead companion left on the air.
    let mut flight = on_the_air();
    flight.world.inject(Fault::CompanionLost { vehicle: 1 });
    flight.off(0);
    go_on(&mut flight, 800, [false, true], [true, false]);
    assert_broken(&flight, &[("S5", "J radiates 55")]);
}

#[test]
fn spec_a_power_command_without_a_near_end_breaks_s5() {
    let mut flight = on_the_air();
    let dbm = flight.planned_dbm(0, 1);
    flight.clients[1].power(&mut flight.world, dbm, 0, 5000);
    flight.pass(20);
    assert_broken(&flight, &[("S5", "lasts for 5000 ms")]);
}

#[test]
fn spec_setpoints_of_a_companion_that_is_gone_break_f3() {
    for (steered, expected) in [(false, &[][..]), (true, &[("F3", "I's companion")])] {
        let mut flight = on_the_air();
        flight.world.inject(Fault::CompanionLost { vehicle: 0 });
        flight.off(0);
        flight.off(1);
        go_on(&mut flight, 500, [false, false], [steered, true]);
        assert_broken(&flight, expected);
    }
    // Stopped, and going on.
    let mut flight = on_the_air();
    let (stopped, well) =
        (Circumstances { runs: false, ..Circumstances::default() }, Circumstances::default());
    flight.off(0);
    flight.off(1);
    flight.world.set_circumstances(0, stopped);
    go_on(&mut flight, 500, [false, false], [false, true]);
    flight.world.set_circumstances(0, well);
    go_on(&mut flight, 500, [false, false], [true, true]);
    assert_broken(&flight, &[]);
}
