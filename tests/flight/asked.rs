//! What is asked of a companion in other forms and by others, and what it says of itself.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use veilwing::planner::slots::PlannedSlot;
use veilwing::role::Role;
use veilwing_sitl::Fault;

use crate::face::{Watched, error, results, value};
use crate::harness::*;
use crate::start::distance;

const GROUND: (u8, u8) = (255, 190);

/// What the companion of I has said of its own accord or not, since `since`.
pub fn said(watched: &Watched, since: usize) -> impl Iterator<Item = &MavMessage> {
    watched.station.heard[since..].iter().filter(|(_, who, _)| *who == Role::I).map(|(.., m)| m)
}

/// The answers of the companion of I to commands, within 50 ms.
fn answers(watched: &mut Watched, from: (u8, u8), message: &MavMessage) -> Vec<(MavCmd, MavResult)> {
    let frame = watched.station.encoder.encode(from, message);
    watched.flight.send_to_companion(Role::I, frame.raw_bytes());
    let since = watched.station.heard.len();
    watched.pass(Duration::from_millis(50));
    let answer = |m: &MavMessage| match m {
        MavMessage::COMMAND_ACK(ack) => Some((ack.command, ack.result)),
        _ => None,
    };
    said(watched, since).filter_map(answer).collect()
}

pub fn command(command: MavCmd, param1: f32) -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA {
        command,
        param1,
        target_system: 1,
        target_component: 191,
        ..COMMAND_LONG_DATA::DEFAULT
    }
}

/// The same as the other message.
fn as_int(c: &COMMAND_LONG_DATA) -> MavMessage {
    MavMessage::COMMAND_INT(COMMAND_INT_DATA {
        command: c.command,
        param1: c.param1,
        target_system: c.target_system,
        target_component: c.target_component,
        ..COMMAND_INT_DATA::DEFAULT
    })
}

pub fn phase(watched: &Watched) -> Option<f32> {
    said(watched, 0).filter_map(|m| named(m, "VW_PHASE")).last()
}

fn named(message: &MavMessage, name: &str) -> Option<f32> {
    match message {
        MavMessage::NAMED_VALUE_FLOAT(m) if m.name.to_str() == Ok(name) => Some(m.value),
        _ => None,
    }
}

fn vector(message: &MavMessage, name: &str) -> Option<[f64; 3]> {
    match message {
        MavMessage::DEBUG_VECT(m) if m.name.to_str() == Ok(name) => Some([m.x, m.y, m.z].map(f64::from)),
        _ => None,
    }
}

/// Whether the companion of I has said a text with this in it.
pub fn told(watched: &Watched, what: &str) -> bool {
    said(watched, 0).any(|m| match m {
        MavMessage::STATUSTEXT(m) => m.text.to_str().is_ok_and(|text| text.contains(what)),
        _ => false,
    })
}

#[test]
fn spec_commands_come_as_command_long_or_command_int_and_a_stranger_s_are_refused_in_both() {
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    let who_are_you = command(MavCmd::MAV_CMD_REQUEST_MESSAGE, 396.0);
    let may_it_arm = command(MavCmd::MAV_CMD_ARM_AUTHORIZATION_REQUEST, 0.0);
    let kill = command(MavCmd::MAV_CMD_USER_2, 0.0);
    for int in [false, true] {
        let form = |c: &COMMAND_LONG_DATA| if int { as_int(c) } else { MavMessage::COMMAND_LONG(c.clone()) };
        assert_eq!(answers(&mut watched, GROUND, &form(&who_are_you)), [(who_are_you.command, accepted)]);
        assert_eq!(answers(&mut watched, (1, 1), &form(&may_it_arm)), [(may_it_arm.command, accepted)]);
        let denied = MavResult::MAV_RESULT_DENIED;
        assert_eq!(answers(&mut watched, (254, 190), &form(&kill)), [(kill.command, denied)]);
        // Not addressed to us alone: perhaps another's to answer.
        let to_all = COMMAND_LONG_DATA { target_system: 0, target_component: 0, ..kill.clone() };
        assert_eq!(answers(&mut watched, (254, 190), &form(&to_all)), []);
        // Another vehicle's companion is killed, another component is asked: no business of ours.
        for (target_system, target_component) in [(2, 191), (2, 0), (1, 5), (0, 5)] {
            for (from, command) in [(GROUND, &kill), ((1, 1), &may_it_arm)] {
                let other = COMMAND_LONG_DATA { target_system, target_component, ..command.clone() };
                assert_eq!(answers(&mut watched, from, &form(&other)), []);
            }
        }
    }
    assert_eq!(value(&watched.read(Role::I, "VW_KILLED", -1)[0]).1, 0.0);
    let said = watched.command(Role::I, MavCmd::MAV_CMD_REQUEST_MESSAGE, 148.0);
    let can = |m: &MavMessage| match m {
        MavMessage::AUTOPILOT_VERSION(m) => Some(m.capabilities),
        _ => None,
    };
    let ftp = MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FTP;
    assert_eq!(said.iter().find_map(can).map(|can| can.contains(ftp)), Some(true));
    assert_eq!(results(&watched.ask(Role::I, &as_int(&kill))).last(), Some(&accepted));
    assert_eq!(value(&watched.read(Role::I, "VW_KILLED", -1)[0]).1, 1.0);
    let since = watched.station.heard.len();
    watched.pass(Duration::from_secs(2));
    let status = |m: &MavMessage| match m {
        MavMessage::HEARTBEAT(m) => Some(m.system_status),
        _ => None,
    };
    assert_eq!(self::said(&watched, since).filter_map(status).last(), Some(MavState::MAV_STATE_CRITICAL));
}

#[test]
fn spec_an_autopilot_may_arm_while_the_companion_asks_it_to_and_not_in_flight() {
    let mut watched = Watched::new(true);
    let may_it_arm = MavMessage::COMMAND_LONG(command(MavCmd::MAV_CMD_ARM_AUTHORIZATION_REQUEST, 0.0));
    for (phases, result) in
        [(2.0..=3.0, MavResult::MAV_RESULT_ACCEPTED), (6.0..=6.0, MavResult::MAV_RESULT_DENIED)]
    {
        watched.until(|watched| phase(watched).is_some_and(|phase| phases.contains(&phase)));
        let answers = answers(&mut watched, (1, 1), &may_it_arm);
        assert_eq!(answers, [(MavCmd::MAV_CMD_ARM_AUTHORIZATION_REQUEST, result)], "{phases:?}");
    }
}

#[test]
fn spec_parameters_are_for_who_asks_us_or_every_component_and_an_index_is_ours_alone() {
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    let list = |to: (u8, u8)| {
        MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system: to.0,
            target_component: to.1,
        })
    };
    for (to, listed) in
        [((1, 191), 12), ((1, 0), 12), ((0, 0), 12), ((0, 191), 0), ((1, 1), 0), ((2, 191), 0), ((2, 0), 0)]
    {
        let since = watched.station.heard.len();
        watched.ask(Role::I, &list(to));
        watched.pass(Duration::from_secs(1));
        let values = said(&watched, since).filter(|m| matches!(m, MavMessage::PARAM_VALUE(_)));
        assert_eq!(values.count(), listed, "{to:?}");
    }
    let read = |to: (u8, u8), name: &str, param_index: i16| {
        MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index,
            target_system: to.0,
            target_component: to.1,
            param_id: name.into(),
        })
    };
    for (to, name, index, answered) in [
        ((1, 191), "VW_ROLE", -1, true),
        ((1, 191), "", 0, true),
        ((1, 191), "", 11, true),
        ((1, 0), "VW_ROLE", -1, true),
        ((0, 0), "VW_ROLE", -1, true),
        // Everybody has a parameter 0.
        ((1, 0), "VW_ROLE", 0, false),
        ((0, 0), "", 3, false),
        ((2, 191), "VW_ROLE", -1, false),
        ((1, 1), "VW_ROLE", -1, false),
        ((0, 0), "COM_OF_LOSS_T", -1, false),
    ] {
        let said = watched.ask(Role::I, &read(to, name, index));
        assert_eq!(said.len(), usize::from(answered), "{to:?} {name} {index}: {said:?}");
        assert!(said.iter().all(|m| matches!(m, MavMessage::PARAM_VALUE(_))), "{said:?}");
    }
    let set = |to: (u8, u8), name: &str, param_type: MavParamType| {
        MavMessage::PARAM_SET(PARAM_SET_DATA {
            param_value: 0.5,
            target_system: to.0,
            target_component: to.1,
            param_id: name.into(),
            param_type,
        })
    };
    let real = MavParamType::MAV_PARAM_TYPE_REAL32;
    for to in [(0, 0), (1, 0), (2, 191), (1, 1)] {
        assert_eq!(watched.ask(Role::I, &set(to, "VW_POS_TOL_M", real)), [], "{to:?}");
    }
    let said = watched.ask(Role::I, &set((1, 191), "VW_POS_TOL_M", MavParamType::MAV_PARAM_TYPE_INT32));
    assert_eq!(value(&said[0]).1, 1.0, "it stays");
    assert_eq!(error(&said[1]), MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH);
    let said = watched.ask(Role::I, &set((1, 191), "VW_NONE", real));
    assert_eq!(error(&said[0]), MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST);
    assert!(matches!(&said[0], MavMessage::PARAM_ERROR(m) if m.param_index == -1), "{said:?}");
    let said = watched.ask(Role::I, &set((1, 191), "VW_POS_TOL_M", real));
    assert_eq!(value(&said[0]).1, 0.5);
}

#[test]
fn spec_heartbeats_come_each_second_and_figures_as_often_as_is_set() {
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    let in_ten_seconds = |watched: &mut Watched| {
        let (since, began) = (watched.station.heard.len(), watched.flight.now());
        watched.pass(Duration::from_secs(10));
        let times = |is: fn(&MavMessage) -> bool| said(watched, since).filter(|m| is(m)).count();
        let shown =
            |m: &MavMessage| matches!(m, MavMessage::NAMED_VALUE_FLOAT(_) | MavMessage::DEBUG_VECT(_));
        for m in said(watched, since) {
            if let MavMessage::NAMED_VALUE_FLOAT(m) = m {
                let ago = watched.flight.now().saturating_sub(Duration::from_millis(m.time_boot_ms.into()));
                assert!(ago <= watched.flight.now() - began + Duration::from_secs(60), "{m:?}");
            }
        }
        (times(|m| matches!(m, MavMessage::HEARTBEAT(_))), times(shown))
    };
    let (heartbeats, figures) = in_ten_seconds(&mut watched);
    assert!((9..=11).contains(&heartbeats), "{heartbeats}");
    assert!((90..=110).contains(&figures), "{figures}");
    watched.write(Role::I, "VW_LIVE_HZ", 2.0);
    let (_, figures) = in_ten_seconds(&mut watched);
    assert!((18..=24).contains(&figures), "{figures}");
    watched.write(Role::I, "VW_LIVE_HZ", 0.0);
    watched.pass(Duration::from_millis(600));
    assert_eq!(in_ten_seconds(&mut watched).1, 0);
}

#[test]
fn val_where_it_is_said_to_be_is_where_the_world_has_it_and_the_plan_is_near() {
    let mut watched = Watched::new(true);
    watched.until(|watched| watched.flight.radiating() == [true, true]);
    let since = watched.station.heard.len();
    watched.pass(Duration::from_secs(4));
    let true_enu_m = watched.flight.world.snapshot().vehicles[0].position_enu_m;
    let all = |name: &str| said(&watched, since).filter_map(|m| vector(m, name)).collect::<Vec<_>>();
    let (positions, planned) = (all("VW_POS"), all("VW_PLAN"));
    let (turned, planned_turned) = (all("VW_RPY"), all("VW_PLANRPY"));
    for of in [&positions, &planned, &turned, &planned_turned] {
        assert!(!of.is_empty());
    }
    assert!(
        positions.iter().chain(&planned).all(|at| distance(*at, true_enu_m) < 1.0),
        "{positions:?} {true_enu_m:?}"
    );
    assert!(
        turned.iter().all(|rpy| distance(*rpy, planned_turned[0]) < 10.0),
        "{turned:?} {planned_turned:?}"
    );
    // On the air, which takes more than a command.
    let radio = said(&watched, 0).filter_map(|m| named(m, "VW_RADIO")).collect::<Vec<_>>();
    assert!(radio.contains(&0.0) && radio.contains(&2.0), "{radio:?}");
    let figures = |name: &str| said(&watched, since).filter_map(|m| named(m, name)).collect::<Vec<_>>();
    assert_eq!(figures("VW_ROLE")[0], 0.0);
    assert_eq!(figures("VW_SLOTS")[0], 2.0);
    assert!(figures("VW_RTT").iter().all(|ms| (0.5..150.0).contains(ms)), "{:?}", figures("VW_RTT"));
    let slots = &yard().plan.slots;
    let nearest = |value: f32, of: &dyn Fn(&PlannedSlot) -> f64| {
        let db = |ratio: f64| 10.0 * ratio.log10();
        slots.iter().map(|slot| (f64::from(value) - db(of(slot))).abs()).fold(f64::INFINITY, f64::min)
    };
    for name in ["VW_DBM", "VW_PLANDBM", "TX_DBM"] {
        let off = |dbm: &f32| nearest(*dbm, &|slot| slot.plan.vehicles.i.tx_power_w * 1e3);
        assert!(figures(name).iter().all(|dbm| off(dbm) < 0.1), "{name} {:?}", figures(name));
    }
    let sinr = figures("SINR_USER");
    let mean = sinr.iter().sum::<f32>() / sinr.len() as f32;
    // What the jitter leaves of the plan's.
    let plans = slots.iter().map(|slot| 10.0 * slot.plan.user_sinr.log10()).fold(0.0, f64::max);
    assert!(f64::from(mean) > 50.0 && f64::from(mean) < plans, "{sinr:?}");
    // On state that is old it reckons nothing.
    watched.flight.set_telemetry_path(Role::I, Path::CUT);
    watched.pass(Duration::from_millis(300));
    let since = watched.station.heard.len();
    watched.pass(Duration::from_millis(500));
    assert!(!said(&watched, since).any(|m| named(m, "SINR_USER").is_some()));
    watched.flight.set_telemetry_path(Role::I, Path::GOOD);
    watched.until(|watched| watched.flight.radiating() == [true, true]);
    // Cut off, it does not know whether its radio is off.
    watched.flight.set_autopilot_path(Role::I, Path::CUT);
    let since = watched.station.heard.len();
    watched.pass(Duration::from_millis(300));
    assert!(said(&watched, since).filter_map(|m| named(m, "VW_RADIO")).any(|radio| radio == 1.0));
}

#[test]
fn spec_a_start_is_answered_when_it_has_come_about_and_one_that_is_taken_back_never_flies() {
    let ack = |watched: &Watched, since: usize| {
        let of_start = |m: &MavMessage| match m {
            MavMessage::COMMAND_ACK(m) if m.command == MavCmd::MAV_CMD_MISSION_START => Some(m.result),
            _ => None,
        };
        said(watched, since).filter_map(of_start).collect::<Vec<_>>()
    };
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    let since = watched.station.heard.len();
    watched.command(Role::I, MavCmd::MAV_CMD_MISSION_START, 0.0);
    watched.pass(Duration::from_secs(5));
    assert_eq!(ack(&watched, since), [MavResult::MAV_RESULT_ACCEPTED]);
    // Nothing is paused on the ground: what was asked for is taken back.
    for while_arming in [false, true] {
        let mut watched = Watched::new(false);
        watched.pass(Duration::from_secs(15));
        let since = watched.station.heard.len();
        watched.command(Role::I, MavCmd::MAV_CMD_MISSION_START, 0.0);
        if while_arming {
            watched.until(|watched| phase(watched).is_some_and(|phase| phase >= 2.0));
        }
        let pause = watched.command(Role::I, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0);
        assert!(!results(&pause).contains(&MavResult::MAV_RESULT_DENIED), "{pause:?}");
        watched.pass(Duration::from_secs(30));
        let vehicles = watched.flight.world.snapshot().vehicles;
        assert!(vehicles.iter().all(|vehicle| vehicle.landed && !vehicle.armed), "{while_arming}");
        assert_eq!(phase(&watched), Some(1.0), "{while_arming}");
        assert!(ack(&watched, since).len() <= 2, "{:?}", ack(&watched, since));
    }
}

#[test]
fn spec_a_start_that_the_other_vehicle_does_not_hear_comes_to_nothing_and_is_said_to() {
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    for from in Role::BOTH {
        watched.flight.set_pair_path(from, Path::CUT);
    }
    let since = watched.station.heard.len();
    watched.command(Role::I, MavCmd::MAV_CMD_MISSION_START, 0.0);
    watched.pass(Duration::from_secs(40));
    let answered = said(&watched, since).filter_map(|m| match m {
        MavMessage::COMMAND_ACK(m) => Some(m.result),
        _ => None,
    });
    let expected = [MavResult::MAV_RESULT_IN_PROGRESS, MavResult::MAV_RESULT_FAILED];
    assert_eq!(answered.collect::<Vec<_>>(), expected);
    assert_eq!(phase(&watched), Some(1.0));
}

#[test]
fn spec_a_tolerance_that_is_set_holds_in_the_slots_to_come() {
    for (tight, silenced) in [(false, false), (true, true)] {
        let mut watched = Watched::new(true);
        watched.pass(Duration::from_secs(8));
        if tight {
            watched.write(Role::I, "VW_POS_TOL_M", 0.1);
        }
        watched.until(|watched| watched.flight.radiating() == [true, true]);
        // The wind pushes it further than that for a moment, and not out of a metre.
        watched.flight.world.inject(Fault::WindStep { vehicle: 0, mean_enu_m_s: [12.0, 0.0, 0.0] });
        watched.pass(Duration::from_secs(3));
        let pose = said(&watched, 0).filter_map(|m| named(m, "VW_SILENT")).any(|silence| silence == 8.0);
        assert_eq!(pose, silenced, "{tight}");
    }
}

#[test]
fn spec_a_kill_that_nobody_confirms_is_answered_once_the_other_must_have_lost_us_too() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(15));
    for from in Role::BOTH {
        flight.set_pair_path(from, Path::CUT);
    }
    let at = flight.now;
    flight.command(Role::I, MavCmd::MAV_CMD_USER_2);
    flight.pass(Duration::from_secs(8));
    let accepted = flight.log.acks.iter().find_map(|(when, role, m)| match m {
        MavMessage::COMMAND_ACK(m) if m.result == MavResult::MAV_RESULT_ACCEPTED && *role == Role::I => {
            Some(*when)
        }
        _ => None,
    });
    // Unheard for three seconds, and three leases more.
    let after = accepted.unwrap() - at;
    assert!(after.abs_diff(Duration::from_millis(4500)) < Duration::from_millis(200), "{after:?}");
}

#[test]
fn spec_a_slow_vehicle_says_where_it_stands_beside_its_live_figures() {
    let mut watched = Watched::of(true, |draft| draft.autopilot.rate_hz = 20.0);
    watched.until(|watched| watched.flight.radiating() == [true, true]);
    watched.write(Role::I, "VW_LIVE_HZ", 20.0);
    let since = watched.station.heard.len();
    watched.pass(Duration::from_secs(3));
    let of = |standing: bool| {
        let is = |m: &&MavMessage| match m {
            MavMessage::NAMED_VALUE_FLOAT(m) => m.name.to_str().unwrap().starts_with("VW_") == standing,
            MavMessage::DEBUG_VECT(_) => standing,
            _ => false,
        };
        said(&watched, since).filter(is).count()
    };
    assert!(of(true) > 20 && of(false) > 20, "{} {}", of(true), of(false));
}
