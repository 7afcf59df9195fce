//! The mission's area is in the autopilot before anything arms, and keeps a vehicle inside that has lost its companion.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMessage, MavMissionType, MavParamType,
    PARAM_SET_DATA,
};
use veilwing::autopilot::{FENCE_MARGIN_M, FenceDuty};
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::Fault;

use crate::harness::*;

const FENCE: MavMissionType = MavMissionType::MAV_MISSION_TYPE_FENCE;

fn with(duty: FenceDuty) -> Setup {
    Setup { fence: PerVehicle { i: duty, j: FenceDuty::Upload }, ..Setup::default() }
}

/// How many lists of this kind a companion offered, and when it said the last of them.
fn offered(flight: &Flight, role: Role, kind: MavMissionType) -> (usize, Option<Duration>) {
    let of_it = flight.log.plans.iter().filter(|(_, who, m)| {
        *who == role && matches!(m, MavMessage::MISSION_COUNT(m) if m.mission_type == kind)
    });
    (of_it.clone().count(), of_it.map(|(at, ..)| *at).max())
}

#[test]
fn spec_the_fence_goes_up_before_the_vehicle_arms_and_nothing_of_it_is_said_in_flight() {
    let mut flight = Flight::new(Setup::default());
    flight.fly_out();
    flight.assert_safe();
    for role in Role::BOTH {
        assert_eq!(flight.outcomes[role], Some(Outcome::Completed), "{}", flight.story());
        let takes_off = flight.said(role, "taking off").unwrap();
        for kind in [FENCE, MavMissionType::MAV_MISSION_TYPE_RALLY] {
            let (count, last) = offered(&flight, role, kind);
            assert!(count == 1 && last.unwrap() < takes_off, "{role} {kind:?} {count}\n{}", flight.story());
        }
        let airborne = takes_off + Duration::from_millis(100)..takes_off + Duration::from_secs(40);
        let said = flight.log.plans.iter().filter(|(at, who, _)| *who == role && airborne.contains(at));
        assert_eq!(said.count(), 0, "{}", flight.story());
        assert_eq!(flight.said(role, "preflight warning: fence"), None, "{}", flight.story());
        assert_eq!(flight.said(role, "GF_"), None, "{}", flight.story());
    }
}

#[test]
fn spec_without_a_fence_the_preflight_warns_and_with_check_it_waits_until_somebody_uploads_it() {
    let mut flight = Flight::new(with(FenceDuty::None));
    assert!(flight.until(|flight| flight.said(Role::I, "taking off").is_some()), "{}", flight.story());
    assert!(flight.said(Role::I, "preflight warning: fence: not in the autopilot").is_some());
    assert_eq!(flight.said(Role::J, "preflight warning: fence"), None);
    assert_eq!(offered(&flight, Role::I, FENCE).0, 0);

    let mut flight = Flight::new(with(FenceDuty::Check));
    flight.pass(Duration::from_secs(30));
    assert!(
        flight.said(Role::I, "fence: the autopilot's is not the mission's").is_some(),
        "{}",
        flight.story()
    );
    assert!(flight.landed(Role::I) && offered(&flight, Role::I, FENCE).0 == 0);
}

#[test]
fn spec_another_stations_fence_is_put_right_before_the_start() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(12));
    assert_eq!(offered(&flight, Role::I, FENCE).0, 1);
    // A ground station writes a triangle far away.
    let count = MISSION_COUNT_DATA {
        count: 3,
        target_system: 1,
        target_component: 1,
        mission_type: FENCE,
        ..MISSION_COUNT_DATA::DEFAULT
    };
    flight.tell_autopilot(Role::I, &MavMessage::MISSION_COUNT(count));
    for (seq, (x, y)) in [(0, 0), (10_000, 0), (0, 10_000)].into_iter().enumerate() {
        flight.pass(Duration::from_millis(20));
        let item = MISSION_ITEM_INT_DATA {
            param1: 3.0,
            x: 400_000_000 + x,
            y: 140_000_000 + y,
            seq: seq as u16,
            command: MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
            target_system: 1,
            target_component: 1,
            frame: MavFrame::MAV_FRAME_GLOBAL,
            mission_type: FENCE,
            ..MISSION_ITEM_INT_DATA::DEFAULT
        };
        flight.tell_autopilot(Role::I, &MavMessage::MISSION_ITEM_INT(item));
    }
    flight.pass(Duration::from_secs(15));
    assert_eq!(offered(&flight, Role::I, FENCE).0, 2, "{}", flight.story());
    flight.command(Role::I, MavCmd::MAV_CMD_MISSION_START);
    flight.fly_out();
    flight.assert_safe();
    assert_eq!(flight.outcomes[Role::I], Some(Outcome::Completed), "{}", flight.story());
}

/// Vehicle I loses its companion in a slot, and with it its stream; a parameter that somebody changed in flight lets it drift.
/// The farthest east that it gets, and whether it has come home.
fn orphaned(duty: FenceDuty) -> (f64, bool) {
    // High enough that it does not come down before the fence.
    let high = yard().mission.changed(|draft| draft.airspace.altitude_m = [30.0, 60.0]).unwrap();
    let given = PerVehicle::from_fn(|_| Planned::new(high.clone()));
    let mut flight = in_mid_slot(Setup { given, ..with(duty) });
    let drifts = PARAM_SET_DATA {
        param_value: f32::from_bits(0),
        target_system: 1,
        target_component: 1,
        param_id: "COM_OBL_RC_ACT".into(),
        param_type: MavParamType::MAV_PARAM_TYPE_INT32,
    };
    flight.tell_autopilot(Role::I, &MavMessage::PARAM_SET(drifts));
    flight.kill(Role::I);
    let end = flight.now + Duration::from_secs(120);
    let mut east_m = f64::NEG_INFINITY;
    flight.until(|flight| {
        east_m = east_m.max(flight.world.snapshot().vehicles[0].position_enu_m[0]);
        flight.now >= end
    });
    // Down, if not disarmed: its companion has left the land detector off.
    let [east, north, up] = flight.world.snapshot().vehicles[0].position_enu_m;
    (east_m, (east + 8.0).hypot(north) < 1.0 && up < 0.5)
}

#[test]
fn spec_an_orphan_that_drifts_stays_inside_by_the_autopilots_fence_and_not_without_it() {
    // The yard reaches 40 m east of its origin.
    let (without_m, _) = orphaned(FenceDuty::None);
    let (with_m, home) = orphaned(FenceDuty::Upload);
    println!("an orphan drifts to {without_m:.1} m east without a fence, to {with_m:.1} m with it");
    let fence_m = 40.0 + FENCE_MARGIN_M;
    assert!(without_m > fence_m + 2.0, "{without_m}");
    assert!(with_m < fence_m + 2.0 && home, "{with_m} {home}");
}

/// Gusts that no controller stands blow both away in the first slot.
fn blown_away(duty: FenceDuty) -> Flight {
    let mut flight = in_mid_slot(Setup { fence: PerVehicle { i: duty, j: duty }, ..Setup::default() });
    for vehicle in 0..2 {
        flight.world.inject(Fault::WindStep { vehicle, mean_enu_m_s: [40.0, 0.0, 0.0] });
    }
    let end = flight.now + Duration::from_secs(100);
    flight.until(|flight| flight.now >= end);
    flight
}

#[test]
fn spec_the_fence_takes_a_vehicle_that_is_blown_away_from_a_companion_that_would_go_on() {
    let without = blown_away(FenceDuty::None);
    let with = blown_away(FenceDuty::Upload);
    let said =
        |flight: &Flight, text: &str| Role::BOTH.into_iter().any(|role| flight.said(role, text).is_some());
    assert!(said(&without, "the autopilot lands here"), "{}", without.story());
    assert!(!said(&with, "the autopilot lands here"), "{}", with.story());
    assert!(said(&with, "by another hand"), "{}", with.story());
}
