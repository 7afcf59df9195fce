//! What a ground station sees of the companions, and what it may ask of them.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use strum::VariantArray;
use veilwing::config::{Vehicle, VehicleDraft};
use veilwing::desk::simulation::{Flight, Given, Observer, Path, Setup, index, vehicle_draft, world_config};
use veilwing::link::codec::Encoder;
use veilwing::mission::{Figure, Outgoing, Vector};
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::World;

use crate::harness::{LONGEST, Planned, yard};

/// A ground station on both vehicles.
#[derive(Default)]
pub(super) struct Station {
    pub(super) encoder: Encoder,
    on_air: Vec<(Duration, [bool; 2])>,
    pub(super) heard: Vec<(Duration, Role, MavMessage)>,
}

impl Observer for Station {
    fn sent(&mut self, at: Duration, role: Role, message: &Outgoing) {
        let Outgoing::Autopilot(message) = message else { return };
        let shown = matches!(
            **message,
            MavMessage::HEARTBEAT(_)
                | MavMessage::NAMED_VALUE_FLOAT(_)
                | MavMessage::DEBUG_VECT(_)
                | MavMessage::PARAM_VALUE(_)
                | MavMessage::PARAM_ERROR(_)
                | MavMessage::STATUSTEXT(_)
                | MavMessage::COMMAND_ACK(_)
                | MavMessage::COMPONENT_INFORMATION_BASIC(_)
                | MavMessage::COMPONENT_METADATA(_)
                | MavMessage::FILE_TRANSFER_PROTOCOL(_)
                | MavMessage::AUTOPILOT_VERSION(_)
        );
        if shown {
            self.heard.push((at, role, (**message).clone()));
        }
    }

    fn on_air(&mut self, at: Duration, on: [bool; 2]) {
        self.on_air.push((at, on));
    }
}

pub(super) struct Watched {
    pub(super) flight: Flight,
    pub(super) station: Station,
}

impl Watched {
    pub(super) fn new(start_unasked: bool) -> Self {
        Self::of(start_unasked, |_| {})
    }

    /// With other vehicle files.
    pub(super) fn of(start_unasked: bool, change: impl Fn(&mut VehicleDraft)) -> Self {
        Self::flying(yard(), start_unasked, change)
    }

    /// With another mission, too.
    pub(super) fn flying(planned: &Planned, start_unasked: bool, change: impl Fn(&mut VehicleDraft)) -> Self {
        let world = World::new(world_config(&planned.mission, &planned.plan).unwrap()).unwrap();
        let given = PerVehicle::from_fn(|role| {
            let mut draft = vehicle_draft(&planned.mission, role, [1, 2]);
            change(&mut draft);
            let vehicle = Vehicle::new(draft).unwrap();
            Arc::new(Given { mission: planned.mission.clone(), plan: planned.plan.clone(), vehicle })
        });
        let setup = Setup { given, start_unasked, autopilot: Path::GOOD, pair: Path::GOOD, seed: 1 };
        Self { flight: Flight::new(world, setup), station: Station::default() }
    }

    pub(super) fn pass(&mut self, time: Duration) {
        let end = self.flight.now() + time;
        while self.flight.now() < end {
            self.flight.step(end, &mut self.station).unwrap();
        }
    }

    pub(super) fn until(&mut self, mut done: impl FnMut(&Self) -> bool) {
        while !done(self) {
            assert!(self.flight.now() < LONGEST);
            self.flight.step(LONGEST, &mut self.station).unwrap();
        }
    }

    /// Sends a message to the companion of `role` and returns what it says within 50 ms that is not of its own accord.
    pub(super) fn ask(&mut self, role: Role, message: &MavMessage) -> Vec<MavMessage> {
        let frame = self.station.encoder.encode((255, 190), message);
        self.flight.send_to_companion(role, frame.raw_bytes());
        let since = self.station.heard.len();
        self.pass(Duration::from_millis(50));
        let spontaneous = |m: &MavMessage| {
            let figures = matches!(m, MavMessage::NAMED_VALUE_FLOAT(_) | MavMessage::DEBUG_VECT(_));
            figures || matches!(m, MavMessage::HEARTBEAT(_))
        };
        let said = self.station.heard[since..].iter().filter(|(_, who, m)| *who == role && !spontaneous(m));
        said.map(|(.., m)| m.clone()).collect()
    }

    pub(super) fn read(&mut self, role: Role, name: &str, param_index: i16) -> Vec<MavMessage> {
        self.ask(
            role,
            &MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                param_index,
                target_system: 1 + index(role) as u8,
                target_component: 191,
                param_id: name.into(),
            }),
        )
    }

    pub(super) fn write(&mut self, role: Role, name: &str, param_value: f32) -> Vec<MavMessage> {
        self.ask(
            role,
            &MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_value,
                target_system: 1 + index(role) as u8,
                target_component: 191,
                param_id: name.into(),
                param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
            }),
        )
    }

    pub(super) fn command(&mut self, role: Role, command: MavCmd, param1: f32) -> Vec<MavMessage> {
        self.ask(
            role,
            &MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                param1,
                command,
                target_system: 1 + index(role) as u8,
                target_component: 191,
                ..COMMAND_LONG_DATA::DEFAULT
            }),
        )
    }
}

pub(super) fn value(message: &MavMessage) -> (&str, f32, u16, u16) {
    match message {
        MavMessage::PARAM_VALUE(m) => {
            assert_eq!(m.param_type, MavParamType::MAV_PARAM_TYPE_REAL32);
            (m.param_id.to_str().unwrap(), m.param_value, m.param_index, m.param_count)
        }
        other => panic!("{other:?}"),
    }
}

pub(super) fn error(message: &MavMessage) -> MavParamError {
    match message {
        MavMessage::PARAM_ERROR(m) => {
            assert_eq!((m.target_system, m.target_component), (255, 190));
            m.error
        }
        other => panic!("{other:?}"),
    }
}

pub(super) fn results(said: &[MavMessage]) -> Vec<MavResult> {
    let result = |m: &MavMessage| match m {
        MavMessage::COMMAND_ACK(ack) => Some(ack.result),
        _ => None,
    };
    said.iter().filter_map(result).collect()
}

#[test]
fn val_the_live_figures_are_what_the_world_measures() {
    let mut watched = Watched::new(true);
    watched.until(|w| Role::BOTH.iter().all(|role| w.flight.outcomes[*role].is_some()));
    let report = watched.flight.world.report();
    assert_eq!(report.violations, vec![]);
    let both_on = |at: Duration| {
        let last = watched.station.on_air.iter().rev().find(|(since, _)| *since <= at);
        last.is_some_and(|(_, on)| *on == [true, true])
    };
    for role in Role::BOTH {
        let figures: Vec<_> = watched
            .station
            .heard
            .iter()
            .filter_map(|(at, who, m)| match m {
                MavMessage::NAMED_VALUE_FLOAT(m) if *who == role => {
                    Some((*at, m.name.to_str().unwrap().to_owned(), f64::from(m.value)))
                }
                _ => None,
            })
            .collect();
        let names = ["SEC_RATE", "SINR_USER", "SINR_EVE", "TX_DBM", "SINR_E1", "SINR_E2"];
        for name in names {
            assert!(figures.iter().any(|(_, n, _)| n == name), "{role}: no {name}");
        }
        let known = |name: &str| names.contains(&name) || name.parse::<Figure>().is_ok();
        assert!(figures.iter().all(|(_, n, v)| known(n) && v.is_finite()), "{figures:?}");
        let rates = |on: bool| {
            let of = figures.iter().filter(move |(at, n, _)| n == "SEC_RATE" && both_on(*at) == on);
            of.map(|(.., rate)| *rate).collect::<Vec<_>>()
        };
        // A figure a moment after the change may show the moment before it.
        let silent = rates(false);
        let idle = silent.iter().filter(|rate| **rate == 0.0).count();
        assert!(idle * 10 >= silent.len() * 8, "{role}: {silent:?}");
        let live = rates(true);
        let mean = live.iter().sum::<f64>() / live.len() as f64;
        let slots = report.slots.iter().map(|slot| slot.achieved_secrecy_rate_bps);
        let achieved = slots.sum::<f64>() / report.slots.len() as f64;
        println!("{role}: {} live rates, mean {mean:.4e} bit/s; achieved {achieved:.4e}", live.len());
        // A dozen samples of a rate that jitters by a fifth, and the peer's mean for its own.
        assert!(live.len() >= 8 && (mean / achieved - 1.0).abs() < 0.2, "{role}: {mean} {achieved}");
    }
}

#[test]
fn val_where_a_companion_says_that_it_stands_is_where_it_is() {
    let mut watched = Watched::new(true);
    watched.until(|w| Role::BOTH.iter().all(|role| w.flight.outcomes[*role].is_some()));
    // On for half a second, which is longer than a change takes to be said.
    let long_on = |at: Duration| {
        let last = watched.station.on_air.iter().rev().find(|(since, _)| *since <= at);
        last.is_some_and(|(since, on)| *on == [true, true] && *since + Duration::from_millis(500) <= at)
    };
    for role in Role::BOTH {
        let said = |figure: Figure| {
            let name: &'static str = figure.into();
            let of = watched.station.heard.iter().filter(|(_, who, _)| *who == role);
            let of = of.filter_map(move |(at, _, m)| match m {
                MavMessage::NAMED_VALUE_FLOAT(m) if m.name.to_str() == Ok(name) => {
                    Some((*at, f64::from(m.value)))
                }
                _ => None,
            });
            of.collect::<Vec<_>>()
        };
        for figure in Figure::VARIANTS {
            assert!(!said(*figure).is_empty(), "{role}: {figure:?} is never said");
        }
        let mut phases: Vec<u8> = said(Figure::Phase).iter().map(|(_, phase)| *phase as u8).collect();
        phases.dedup();
        // Two slots, from the ground to the ground.
        let slots: BTreeSet<u8> = said(Figure::Slot).iter().map(|(_, slot)| *slot as u8).collect();
        assert_eq!(slots, BTreeSet::from([0, 1]), "{role}");
        for (first, then) in [(1, 2), (4, 6), (6, 8), (8, 9)] {
            let place = |phase| phases.iter().position(|other| *other == phase);
            assert!(place(first) < place(then) && place(first).is_some(), "{role}: {phases:?}");
        }
        for (figure, least, most) in [
            (Figure::Radio, 2.0, 2.0),
            (Figure::Silent, 0.0, 0.0),
            (Figure::PositionOff, 0.0, 1.0),
            (Figure::Lease, 0.01, 0.51),
            (Figure::Peer, 0.0, 0.2),
            (Figure::State, 0.0, 0.25),
            (Figure::Orders, 0.0, 0.0),
        ] {
            let on_air: Vec<_> = said(figure).into_iter().filter(|(at, _)| long_on(*at)).collect();
            assert!(!on_air.is_empty(), "{role}: {figure:?}");
            let astray: Vec<_> = on_air.iter().filter(|(_, v)| !(least..=most).contains(v)).collect();
            assert!(astray.is_empty(), "{role}: {figure:?} {astray:?}");
        }
        // What runs down does so at the rate of time: one instant for each slot's opening, and one for the landing's beginning.
        let opens: Vec<f64> = said(Figure::Opens).iter().map(|(at, left)| at.as_secs_f64() + left).collect();
        let leaps = opens.windows(2).filter(|pair| (pair[1] - pair[0]).abs() > 0.05).count();
        assert_eq!(leaps, 1, "{role}: two slots open at {opens:?}");
        let lands = |m: &MavMessage| match m {
            MavMessage::NAMED_VALUE_FLOAT(m) => m.name.to_str() == Ok("VW_PHASE") && m.value == 9.0,
            _ => false,
        };
        let landing = watched.station.heard.iter().find(|(_, who, m)| *who == role && lands(m));
        let landing_s = landing.map(|(at, ..)| at.as_secs_f64()).unwrap();
        let in_slot: Vec<_> = said(Figure::Left).into_iter().filter(|(at, _)| long_on(*at)).collect();
        for (at, left) in &in_slot {
            assert!((at.as_secs_f64() + left - landing_s).abs() < 10.0, "{role}: {at:?} {left} {landing_s}");
        }
        assert!(!in_slot.is_empty());
        for vector in Vector::VARIANTS {
            let name: &'static str = vector.into();
            let is_it = |m: &MavMessage| match m {
                MavMessage::DEBUG_VECT(m) => m.name.to_str() == Ok(name),
                _ => false,
            };
            assert!(
                watched.station.heard.iter().any(|(_, who, m)| *who == role && is_it(m)),
                "{role}: {name}"
            );
        }
    }
}

#[test]
fn spec_parameters_are_listed_read_and_written_within_their_limits() {
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    for (role, number) in [(Role::I, 0.0), (Role::J, 1.0)] {
        let list = MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system: 1 + index(role) as u8,
            target_component: 0,
        });
        let mut listed = watched.ask(role, &list);
        assert!(listed.len() <= 3, "a burst of {} would hold up setpoints", listed.len());
        let since = watched.station.heard.len();
        watched.pass(Duration::from_secs(1));
        let later = watched.station.heard[since..].iter().filter(|(_, who, _)| *who == role);
        listed.extend(later.map(|(.., m)| m.clone()).filter(|m| matches!(m, MavMessage::PARAM_VALUE(_))));
        let all: Vec<_> = listed.iter().map(value).collect();
        assert!(
            all.iter().enumerate().all(|(k, (.., i, count))| k == usize::from(*i) && *count == 12),
            "{all:?}"
        );
        assert_eq!(all.len(), 12);
        assert_eq!(all[0], ("VW_ROLE", number, 0, 12));

        assert_eq!(value(&watched.read(role, "VW_LEASE_MS", -1)[0]).1, 500.0);
        assert_eq!(value(&watched.read(role, "", 9)[0]), ("VW_POS_TOL_M", 1.0, 9, 12));
        let unknown = watched.read(role, "COM_OF_LOSS_T", -1);
        assert_eq!(error(&unknown[0]), MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST);
        let beyond = watched.read(role, "", 12);
        assert_eq!(error(&beyond[0]), MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST);

        assert_eq!(value(&watched.write(role, "VW_POS_TOL_M", 0.4)[0]).1, 0.4);
        assert_eq!(value(&watched.read(role, "VW_POS_TOL_M", -1)[0]).1, 0.4);
        for (name, bad, stays, reason) in [
            ("VW_POS_TOL_M", 1.5, 0.4, MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
            ("VW_POS_TOL_M", f32::NAN, 0.4, MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
            ("VW_ATT_TOL_DEG", 5.0, 3.0, MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
            ("VW_ROLE", 1.0 - number, number, MavParamError::MAV_PARAM_ERROR_READ_ONLY),
            ("VW_PMAX_W", 100.0, 0.5, MavParamError::MAV_PARAM_ERROR_READ_ONLY),
            ("VW_KILLED", 0.0, 0.0, MavParamError::MAV_PARAM_ERROR_READ_ONLY),
        ] {
            let said = watched.write(role, name, bad);
            assert_eq!(value(&said[0]).1, stays, "{name} stays");
            assert_eq!(error(&said[1]), reason, "{name}");
            let text = |m: &MavMessage| matches!(m, MavMessage::STATUSTEXT(t) if t.text.to_str().unwrap().contains(name));
            assert!(said.iter().any(text), "{name}: {said:?}");
        }
    }
}

#[test]
fn spec_who_we_are_is_told_on_request_and_what_we_cannot_do_is_unsupported() {
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    let said = watched.command(Role::J, MavCmd::MAV_CMD_REQUEST_MESSAGE, 396.0);
    assert_eq!(results(&said), [MavResult::MAV_RESULT_ACCEPTED]);
    let basic = said.iter().find_map(|m| match m {
        MavMessage::COMPONENT_INFORMATION_BASIC(m) => Some(m),
        _ => None,
    });
    let basic = basic.unwrap();
    assert_eq!(basic.vendor_name.to_str().unwrap(), "veilwing");
    assert_eq!(basic.model_name.to_str().unwrap(), "companion of vehicle J");
    assert_eq!(basic.software_version.to_str().unwrap(), env!("CARGO_PKG_VERSION"));
    let said = watched.command(Role::J, MavCmd::MAV_CMD_REQUEST_MESSAGE, 148.0);
    assert!(said.iter().any(|m| matches!(m, MavMessage::AUTOPILOT_VERSION(v) if v.flight_sw_version != 0)));
    // ATTITUDE is the autopilot's; NaN is no message.
    for (command, param1) in [
        (MavCmd::MAV_CMD_REQUEST_MESSAGE, 30.0),
        (MavCmd::MAV_CMD_REQUEST_MESSAGE, f32::NAN),
        (MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, 30.0),
        (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0),
        (MavCmd::MAV_CMD_DO_SET_MODE, 1.0),
        (MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 7.0),
    ] {
        let said = watched.command(Role::J, command, param1);
        assert_eq!(results(&said), [MavResult::MAV_RESULT_UNSUPPORTED], "{command:?} {param1}");
        assert_eq!(said.len(), 1, "{said:?}");
    }
}

#[test]
fn spec_the_heartbeat_tells_the_truth() {
    let status = |watched: &Watched, role: Role| {
        let last = watched.station.heard.iter().rev().find_map(|(_, who, m)| match m {
            MavMessage::HEARTBEAT(m) if *who == role => Some(m),
            _ => None,
        });
        let last = last.unwrap();
        assert_eq!(last.mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
        assert_eq!(last.autopilot, MavAutopilot::MAV_AUTOPILOT_INVALID);
        last.system_status
    };
    let mut watched = Watched::new(true);
    watched.pass(Duration::from_millis(100));
    assert_eq!(status(&watched, Role::I), MavState::MAV_STATE_BOOT);
    watched.until(|w| w.station.heard.iter().any(|(_, who, m)| matches!(m, MavMessage::HEARTBEAT(h) if *who == Role::I && h.system_status == MavState::MAV_STATE_STANDBY)));
    watched.until(|w| w.flight.radiating() == [true, true]);
    assert_eq!(status(&watched, Role::I), MavState::MAV_STATE_ACTIVE);
    let said = watched.command(Role::J, MavCmd::MAV_CMD_USER_2, 0.0);
    assert_eq!(results(&said), [MavResult::MAV_RESULT_ACCEPTED]);
    watched.pass(Duration::from_secs(2));
    for role in Role::BOTH {
        assert_eq!(status(&watched, role), MavState::MAV_STATE_CRITICAL, "{role}");
        assert_eq!(value(&watched.read(role, "VW_KILLED", -1)[0]).1, 1.0);
    }
    watched.flight.stop(Role::I);
    watched.pass(Duration::from_millis(900));
    assert!(watched.station.heard.iter().rev().any(|(_, who, m)| *who == Role::I
        && matches!(m, MavMessage::HEARTBEAT(h) if h.system_status == MavState::MAV_STATE_POWEROFF
            || h.system_status == MavState::MAV_STATE_CRITICAL)));
}

#[test]
fn spec_an_autopilot_that_asks_before_it_arms_is_answered_by_the_preflight() {
    let mut watched = Watched::new(false);
    let asks = |watched: &mut Watched, from: (u8, u8), (target_system, target_component): (u8, u8)| {
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_ARM_AUTHORIZATION_REQUEST,
            target_system,
            target_component,
            ..COMMAND_LONG_DATA::DEFAULT
        });
        let frame = watched.station.encoder.encode(from, &message);
        watched.flight.send_to_companion(Role::I, frame.raw_bytes());
        let since = watched.station.heard.len();
        watched.pass(Duration::from_millis(50));
        let answers = watched.station.heard[since..].iter().filter_map(|(_, who, m)| match m {
            MavMessage::COMMAND_ACK(ack) if *who == Role::I => {
                assert_eq!((ack.target_system, ack.target_component), (1, 1));
                Some((ack.result, ack.progress, ack.result_param2))
            }
            _ => None,
        });
        answers.collect::<Vec<_>>()
    };
    watched.pass(Duration::from_secs(1));
    // The reason goes out in words, as the answer says: MAV_ARM_AUTH_DENIED_REASON_NONE.
    let denied = (MavResult::MAV_RESULT_DENIED, 1, 0);
    assert_eq!(asks(&mut watched, (1, 1), (1, 0)), [denied]);
    watched.pass(Duration::from_secs(14));
    // For five seconds, whichever way it is addressed.
    let granted = (MavResult::MAV_RESULT_ACCEPTED, 0, 5);
    for to in [(1, 191), (1, 0), (0, 0)] {
        assert_eq!(asks(&mut watched, (1, 1), to), [granted]);
    }
    // Another vehicle's autopilot, and a component that is none, are not answered.
    assert_eq!(asks(&mut watched, (2, 1), (1, 0)), []);
    assert_eq!(asks(&mut watched, (1, 100), (1, 0)), []);
    watched.until(|w| w.flight.now() > Duration::from_secs(16));
    let said = |watched: &Watched, what: &str| {
        watched.station.heard.iter().any(|(_, who, m)| match m {
            MavMessage::STATUSTEXT(m) => {
                *who == Role::I && m.text.to_str().is_ok_and(|text| text.contains(what))
            }
            _ => false,
        })
    };
    assert!(said(&watched, "arming refused: "));
    let kill = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_USER_2,
        target_system: 1,
        target_component: 191,
        ..COMMAND_LONG_DATA::DEFAULT
    });
    watched.ask(Role::I, &kill);
    watched.pass(Duration::from_secs(2));
    assert_eq!(asks(&mut watched, (1, 1), (1, 0)), [denied]);
}
