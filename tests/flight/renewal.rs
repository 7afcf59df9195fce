//! Plans that are made anew between two slots, for what was measured.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavCmd;
use veilwing::config::{Mission, MissionDraft, Mode, NodeDraft, Optimise};
use veilwing::geo::Enu;
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::{Fault, SlotReport};

use crate::harness::*;

const MODES: [Mode; 3] = [Mode::Static, Mode::Turning, Mode::Moving];

/// The demonstration's mission three times round with ideal nulls and headings, as jitter moves the optimum most there.
fn renewing(change: impl Fn(&mut MissionDraft)) -> Setup {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/mission.toml");
    let mission = Mission::load(&path).unwrap().changed(|m| {
        m.antenna.both.null_depth_db = None;
        m.pointing.heading_std_deg = None;
        m.tdma.superframes = 3;
        m.planner.replan = true;
        change(m);
    });
    let planned = Planned::new(mission.unwrap());
    Setup { given: PerVehicle { i: planned.clone(), j: planned }, ..Setup::default() }
}

/// What is delivered in these slots, bit.
fn volume_bits(slots: &[SlotReport]) -> f64 {
    slots.iter().map(|slot| slot.achieved_secrecy_rate_bps * slot.radiated_s.i).sum()
}

fn assert_completed(flight: &Flight) {
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
    }
    assert_eq!(flight.report().slots.len(), 6);
}

/// A pair that jitters twice as much as stated flies its last superframe by a plan for that, whatever it does while it radiates, and
/// delivers what one delivers that was told; one that does not replan loses its poses to the end.
#[test]
fn val_a_plan_is_made_anew_for_the_jitter_that_was_measured() {
    for mode in MODES {
        let fly = |stated_deg: f64, replan: bool| {
            let setup = renewing(|m| {
                (m.planner.mode, m.planner.replan, m.jitter.std_deg) = (mode, replan, stated_deg);
            });
            let mut flight = Flight::new(Setup { jitter_deg: Some(4.0), ..setup });
            flight.fly_out();
            flight
        };
        let [unknown, known, stubborn] =
            [(2.0, true), (4.0, true), (2.0, false)].map(|(deg, on)| fly(deg, on));
        known.assert_safe();
        assert!(known.said(Role::I, "planned anew").is_none(), "{}", known.story());
        let anew = Role::BOTH.map(|role| unknown.said(role, "planned anew").unwrap());
        assert!(anew[0].abs_diff(anew[1]) < Duration::from_secs(1), "{anew:?}");
        for violation in &unknown.report().violations {
            let brief = violation.lasted <= Duration::from_millis(1);
            assert!(brief && violation.at < anew[0], "{violation:?}\n{}", unknown.story());
        }
        assert_completed(&unknown);
        let volumes = [&unknown, &known, &stubborn].map(|flight| volume_bits(&flight.report().slots[4..]));
        assert!(
            volumes[0] > 0.97 * volumes[1] && volumes[0] > volumes[2],
            "{mode:?}: {volumes:?}\n{}",
            unknown.story()
        );
    }
}

/// In a gale the vehicle that bears it is late for its slots, or loses its motion in them: for what it makes the ones that are left are
/// planned. One that is behind on its ways and in time for its slots is not planned for.
#[test]
fn val_a_plan_is_made_anew_for_the_speed_that_the_wind_allows_where_that_costs_anything() {
    for (mode, optimise, role, mean_enu_m_s, gain) in [
        (Mode::Moving, Optimise::Volume, Role::I, [-16.0, 0.0, 0.0], Some(1.3)),
        (Mode::Static, Optimise::Rate, Role::I, [-16.0, 0.0, 0.0], Some(1.05)),
        (Mode::Moving, Optimise::Volume, Role::J, [0.0, 16.0, 0.0], None),
    ] {
        let fly = |replan: bool| {
            let setup = renewing(|m| {
                (m.planner.mode, m.planner.optimise, m.planner.replan) = (mode, optimise, replan);
            });
            let mut flight = Flight::new(setup);
            flight.until(|flight| flight.said(role, "airborne").is_some());
            flight.world.inject(Fault::WindStep { vehicle: index(role), mean_enu_m_s });
            flight.fly_out();
            flight.assert_safe();
            assert_completed(&flight);
            flight
        };
        let [with, without] = [true, false].map(fly);
        for role in Role::BOTH {
            assert_eq!(with.said(role, "planned anew").is_some(), gain.is_some(), "{}", with.story());
        }
        let [with_bits, without_bits] = [&with, &without].map(|flight| volume_bits(&flight.report().slots));
        let least_bits = gain.unwrap_or(0.99) * without_bits;
        assert!(with_bits > least_bits, "{mode:?}: {with_bits} {without_bits}\n{}", with.story());
    }
}

/// Three users in turning: whoever would have been served is, and slots carry each other on again.
#[test]
fn spec_users_are_served_in_their_order_by_another_plan_too() {
    let setup = renewing(|m| {
        m.planner.mode = Mode::Turning;
        m.tdma.superframes = 2;
        let third = NodeDraft {
            name: "charlie".into(),
            enu_m: Some(Enu::new(-60.0, 70.0, 1.5)),
            ..m.users[0].clone()
        };
        m.users.push(third);
    });
    let planned: Vec<_> =
        setup.given.i.plan.turns.iter().flat_map(|turns| &turns.slots).map(|s| s.user).collect();
    let users = setup.given.i.mission.users.clone();
    let mut flight = Flight::new(Setup { jitter_deg: Some(0.4), ..setup });
    flight.fly_out();
    flight.assert_safe();
    let report = flight.report();
    assert_eq!(report.slots.len(), 6);
    for (slot, user) in report.slots.iter().zip(planned.iter().cycle()) {
        assert_eq!(slot.user, users[*user].name);
        assert!(slot.radiated_s.i > 8.5, "{slot:#?}\n{}", flight.story());
    }
    for role in Role::BOTH {
        assert!(flight.said(role, "planned anew from slot 1 on").is_some(), "{}", flight.story());
    }
}

/// The pair's link is cut as the slot ends after which both would plan anew, the pair is paused then, or both at once: they do so later.
#[test]
fn spec_a_plan_that_cannot_be_agreed_on_at_once_is_agreed_on_later() {
    for mode in MODES {
        for (cut, paused) in [(true, false), (false, true), (true, true)] {
            let setup = renewing(|m| {
                (m.planner.mode, m.tdma.wait_for_peer_s) = (mode, Some(15.0));
            });
            let mut flight = on_the_air(Setup { jitter_deg: Some(0.4), ..setup }, 0);
            flight.pass(Duration::from_millis(8_800));
            if paused {
                flight.command_with(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
            }
            if cut {
                Role::BOTH.into_iter().for_each(|role| flight.set_pair_path(role, Path::CUT));
            }
            flight.pass(Duration::from_secs(8));
            assert_eq!(flight.radiating(), [false, false], "{}", flight.story());
            Role::BOTH.into_iter().for_each(|role| flight.set_pair_path(role, Path::GOOD));
            flight.pass(Duration::from_secs(2));
            if paused {
                flight.command_with(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
            }
            flight.fly_out();
            flight.assert_safe();
            assert_completed(&flight);
            for role in Role::BOTH {
                assert!(
                    flight.said(role, "planned anew").is_some(),
                    "{mode:?} {cut} {paused}\n{}",
                    flight.story()
                );
            }
            let report = flight.report();
            assert!(
                report.slots[2..].iter().all(|slot| slot.radiated_s.i > 8.9),
                "{mode:?} {cut} {paused}\n{report:#?}\n{}",
                flight.story()
            );
        }
    }
}
