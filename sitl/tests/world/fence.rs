//! The autopilots' fence and rally points: how they are given and asked for, and what a vehicle does at its fence that nobody
//! keeps inside.

use crate::common::*;
use mavlink::dialects::ardupilotmega::*;
use veilwing_sitl::*;

const FENCE: MavMissionType = MavMissionType::MAV_MISSION_TYPE_FENCE;
const RALLY: MavMissionType = MavMissionType::MAV_MISSION_TYPE_RALLY;
const CORNER: MavCmd = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION;
/// Half the fence's side, in metres, about the mission's origin.
const HALF_M: f64 = 60.0;

fn item(kind: MavMissionType, seq: u16, param1: f32, [e, n]: [f64; 2]) -> MISSION_ITEM_INT_DATA {
    // By the flat earth at the tests' latitude, a centimetre at these distances: metres a degree of both, at 200 m.
    let (lat_m, lon_m) = (111_232.0, 71_593.0);
    MISSION_ITEM_INT_DATA {
        param1,
        x: ((50.0755 + n / lat_m) * 1e7).round() as i32,
        y: ((14.4378 + e / lon_m) * 1e7).round() as i32,
        seq,
        command: if kind == FENCE { CORNER } else { MavCmd::MAV_CMD_NAV_RALLY_POINT },
        target_system: 1,
        target_component: 1,
        frame: if kind == FENCE {
            MavFrame::MAV_FRAME_GLOBAL
        } else {
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT
        },
        mission_type: kind,
        ..MISSION_ITEM_INT_DATA::DEFAULT
    }
}

fn square() -> Vec<MISSION_ITEM_INT_DATA> {
    let corners = [[-HALF_M, -HALF_M], [HALF_M, -HALF_M], [HALF_M, HALF_M], [-HALF_M, HALF_M]];
    corners.iter().zip(0..).map(|(corner, seq)| item(FENCE, seq, 4.0, *corner)).collect()
}

fn offer(f: &mut Flight, kind: MavMissionType, count: usize) {
    let count = MISSION_COUNT_DATA {
        count: count as u16,
        target_system: 1,
        target_component: 1,
        mission_type: kind,
        ..MISSION_COUNT_DATA::DEFAULT
    };
    f.clients[0].send(&mut f.world, &MavMessage::MISSION_COUNT(count));
}

/// The number of the item that the autopilot asked for last, and whether by MISSION_REQUEST_INT.
fn asked(f: &Flight) -> Option<(u16, bool)> {
    f.clients[0].last(|m| match m {
        MavMessage::MISSION_REQUEST_INT(m) => Some((m.seq, true)),
        MavMessage::MISSION_REQUEST(m) => Some((m.seq, false)),
        _ => None,
    })
}

fn result(client: &Client) -> Option<MavMissionResult> {
    client.last(|m| match m {
        MavMessage::MISSION_ACK(m) => Some(m.mavtype),
        _ => None,
    })
}

/// Gives a list, each item as it is asked for.
fn upload(f: &mut Flight, kind: MavMissionType, items: &[MISSION_ITEM_INT_DATA]) {
    f.clients[0].received.clear();
    offer(f, kind, items.len());
    for (item, seq) in items.iter().zip(0..) {
        f.pass(5);
        assert_eq!(asked(f).map(|(seq, _)| seq), Some(seq));
        assert_eq!(result(&f.clients[0]), None);
        f.clients[0].send(&mut f.world, &MavMessage::MISSION_ITEM_INT(item.clone()));
    }
    f.pass(5);
}

/// Asks for a list.
fn download(f: &mut Flight, kind: MavMissionType) -> Vec<MISSION_ITEM_INT_DATA> {
    f.clients[0].received.clear();
    let list = MISSION_REQUEST_LIST_DATA { target_system: 1, target_component: 1, mission_type: kind };
    f.clients[0].send(&mut f.world, &MavMessage::MISSION_REQUEST_LIST(list));
    f.pass(5);
    let count = f.clients[0].last(|m| match m {
        MavMessage::MISSION_COUNT(m) => Some(m.count),
        _ => None,
    });
    (0..count.expect("a count"))
        .map(|seq| {
            let request =
                MISSION_REQUEST_INT_DATA { seq, target_system: 1, target_component: 1, mission_type: kind };
            f.clients[0].send(&mut f.world, &MavMessage::MISSION_REQUEST_INT(request));
            f.pass(5);
            let item = f.clients[0].last(|m| match m {
                MavMessage::MISSION_ITEM_INT(m) => Some(m.clone()),
                _ => None,
            });
            item.expect("an item")
        })
        .collect()
}

fn of(firmware: Firmware) -> Flight {
    let mut config = config();
    for vehicle in &mut config.vehicles {
        vehicle.firmware = firmware;
    }
    let mut f = Flight::new(config);
    f.pass(1000);
    f
}

fn mode(f: &Flight) -> &'static str {
    f.world.snapshot().vehicles[0].mode
}

#[test]
fn spec_both_firmwares_keep_what_they_are_given_and_give_it_back() {
    for firmware in [Firmware::Px4, Firmware::ArduCopter] {
        let mut f = of(firmware);
        assert!(download(&mut f, FENCE).is_empty() && download(&mut f, RALLY).is_empty());
        upload(&mut f, FENCE, &square());
        assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
        assert_eq!(asked(&f).map(|(_, int)| int), Some(firmware == Firmware::Px4));
        upload(&mut f, RALLY, &[item(RALLY, 0, 0.0, [5.0, 5.0])]);
        let back = download(&mut f, FENCE);
        let told = |items: &[MISSION_ITEM_INT_DATA]| {
            items.iter().map(|i| (i.seq, i.command, i.param1, i.x, i.y)).collect::<Vec<_>>()
        };
        assert_eq!(told(&back), told(&square()));
        assert!(back.iter().all(|i| (i.target_system, i.target_component) == (1, 191)));
        assert_eq!(download(&mut f, RALLY).len(), 1);
        // Another one in its place, and none.
        upload(
            &mut f,
            FENCE,
            &square().into_iter().map(|i| MISSION_ITEM_INT_DATA { x: i.x + 9, ..i }).collect::<Vec<_>>(),
        );
        assert_eq!(download(&mut f, FENCE)[0].x, square()[0].x + 9);
        let clear = MISSION_CLEAR_ALL_DATA { target_system: 1, target_component: 1, mission_type: FENCE };
        f.clients[0].send(&mut f.world, &MavMessage::MISSION_CLEAR_ALL(clear));
        assert!(download(&mut f, FENCE).is_empty());
        assert_eq!(download(&mut f, RALLY).len(), 1);
    }
}

#[test]
fn spec_what_does_not_fit_or_comes_in_between_is_refused_in_the_firmwares_words() {
    for (firmware, busy) in [
        (Firmware::Px4, MavMissionResult::MAV_MISSION_ERROR),
        (Firmware::ArduCopter, MavMissionResult::MAV_MISSION_DENIED),
    ] {
        let mut f = of(firmware);
        // Another station begins, and says nothing more.
        let mut station = Client::ground_station(0, 1);
        let count = MISSION_COUNT_DATA {
            count: 4,
            target_system: 1,
            target_component: 1,
            mission_type: FENCE,
            ..MISSION_COUNT_DATA::DEFAULT
        };
        station.send(&mut f.world, &MavMessage::MISSION_COUNT(count));
        f.clients[0].received.clear();
        offer(&mut f, FENCE, 4);
        f.pass(5);
        assert_eq!(result(&f.clients[0]), Some(busy), "{firmware:?}");
        // It is asked again and again, and forgotten.
        f.pass(9000);
        upload(&mut f, FENCE, &square());
        assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_ACCEPTED));

        f.clients[0].received.clear();
        offer(&mut f, FENCE, 256);
        f.pass(5);
        assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_NO_SPACE));
        let bad = MISSION_ITEM_INT_DATA { frame: MavFrame::MAV_FRAME_LOCAL_NED, ..square()[0].clone() };
        upload(&mut f, FENCE, &[bad]);
        assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME));
        let bad = MISSION_ITEM_INT_DATA { command: MavCmd::MAV_CMD_NAV_WAYPOINT, ..square()[0].clone() };
        upload(&mut f, FENCE, &[bad]);
        assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_UNSUPPORTED));
        // What was there is there still.
        assert_eq!(download(&mut f, FENCE).len(), 4);
    }
    // Of a polygon with fewer corners than it says ArduCopter keeps nothing.
    let mut f = of(Firmware::ArduCopter);
    upload(&mut f, FENCE, &square()[..3]);
    assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_ERROR));
    assert!(download(&mut f, FENCE).is_empty());
}

#[test]
fn spec_an_orphan_that_drifts_comes_home_from_its_fence_and_not_without_one() {
    // 25 m high and sinking at 0.67 m/s, it is down after 56 m of drift; from 30 m it leaves the fence before.
    let mut config = config();
    config.vehicles[0].home_enu_m = [30.0, 10.0, 0.0];
    let drifts = |fenced: bool, action: u32| {
        let mut f = Flight::new(config.clone());
        f.pass(1000);
        f.set_int("COM_OBL_RC_ACT", 0);
        f.set_int("GF_ACTION", action);
        if fenced {
            upload(&mut f, FENCE, &square());
            assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
        }
        f.take_off();
        let mut east_m = f64::NEG_INFINITY;
        for _ in 0..1200 {
            f.pass(100);
            east_m = east_m.max(f.position(0)[0]);
        }
        let vehicle = f.world.snapshot().vehicles[0].clone();
        (east_m, vehicle, f)
    };
    let (east_m, ..) = drifts(false, 3);
    assert!(east_m > HALF_M + 8.0, "{east_m}");
    let (east_m, vehicle, f) = drifts(true, 3);
    assert!((HALF_M..HALF_M + 3.0).contains(&east_m), "{east_m}");
    assert!(f.clients[0].texts().iter().any(|text| text.contains("Geofence")));
    assert!(vehicle.landed && (vehicle.position_enu_m[0] - 30.0).abs() < 1.0, "{vehicle:?}");
    // Hold stays where it is, a warning is nothing but one.
    let (east_m, vehicle, _) = drifts(true, 2);
    assert!(east_m < HALF_M + 3.0 && vehicle.mode == "HOLD", "{east_m} {vehicle:?}");
    let (east_m, ..) = drifts(true, 1);
    assert!(east_m > HALF_M + 8.0, "{east_m}");
}

/// A square of 20 m that is not to be entered, east of where the vehicles start, behind the fence's four corners.
fn with_a_zone() -> Vec<MISSION_ITEM_INT_DATA> {
    let corners = [[35.0, -20.0], [55.0, -20.0], [55.0, 40.0], [35.0, 40.0]];
    let zone = corners.iter().zip(4..).map(|(corner, seq)| MISSION_ITEM_INT_DATA {
        command: MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
        ..item(FENCE, seq, 4.0, *corner)
    });
    square().into_iter().chain(zone).collect()
}

#[test]
fn spec_an_exclusion_zone_is_kept_and_turns_both_firmwares_back() {
    let mut config = config();
    config.vehicles[0].home_enu_m = [10.0, 10.0, 0.0];
    for zoned in [true, false] {
        let mut f = Flight::new(config.clone());
        f.pass(1000);
        f.set_int("COM_OBL_RC_ACT", 0);
        f.set_int("GF_ACTION", 3);
        let items = if zoned { with_a_zone() } else { square() };
        upload(&mut f, FENCE, &items);
        assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
        let commands = |items: &[MISSION_ITEM_INT_DATA]| items.iter().map(|i| i.command).collect::<Vec<_>>();
        assert_eq!(commands(&download(&mut f, FENCE)), commands(&items));
        f.take_off();
        // An orphan drifts east with the wind.
        let mut east_m = f64::NEG_INFINITY;
        for _ in 0..1200 {
            f.pass(100);
            east_m = east_m.max(f.position(0)[0]);
        }
        assert_eq!((35.0..38.0).contains(&east_m), zoned, "{east_m}");
    }
    // ArduCopter, driven by another hand.
    for zoned in [true, false] {
        let mut f = of(Firmware::ArduCopter);
        f.set_real("FENCE_ENABLE", 1.0);
        upload(&mut f, FENCE, &if zoned { with_a_zone() } else { square() });
        assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
        f.pass(2000);
        let east_m = driven_east(&mut f);
        let limits = if zoned { 35.0..43.0 } else { HALF_M..HALF_M + 8.0 };
        assert!(limits.contains(&east_m), "{zoned}: {east_m}");
    }
}

#[test]
fn spec_a_fence_without_home_in_it_px4_drops_in_silence() {
    let mut f = of(Firmware::Px4);
    let elsewhere: Vec<_> =
        square().into_iter().map(|i| MISSION_ITEM_INT_DATA { x: i.x + 50_000, ..i }).collect();
    upload(&mut f, FENCE, &elsewhere);
    assert_eq!(result(&f.clients[0]), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
    f.take_off();
    assert_eq!(mode(&f), "OFFBOARD");
}

/// Takes the first vehicle off and drives it eastward by velocity for half a minute; how far it gets.
fn driven_east(f: &mut Flight) -> f64 {
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 4.0]);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
    let climb = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 25.0];
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_NAV_TAKEOFF, &climb);
    f.pass(14_000);
    let mut east_m = f64::NEG_INFINITY;
    for _ in 0..300 {
        let message = MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
            vy: 5.0,
            type_mask: PositionTargetTypemask::from_bits_truncate(0b1101_1100_0111),
            target_system: 1,
            target_component: 1,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        });
        f.clients[0].send(&mut f.world, &message);
        f.pass(100);
        east_m = east_m.max(f.position(0)[0]);
    }
    east_m
}

#[test]
fn spec_arducopter_that_another_hand_drives_out_returns_from_its_fence() {
    // Another hand drives eastward by velocity, and does not stop. How far it gets, and where it ends.
    let driven = |fenced: bool, enabled: f32| {
        let mut f = of(Firmware::ArduCopter);
        f.set_real("FENCE_ENABLE", enabled);
        if fenced {
            upload(&mut f, FENCE, &square());
        }
        f.pass(2000);
        let east_m = driven_east(&mut f);
        f.pass(90_000);
        (east_m, f)
    };
    let (east_m, _) = driven(false, 1.0);
    assert!(east_m > HALF_M + 20.0, "{east_m}");
    let (east_m, _) = driven(true, 0.0);
    assert!(east_m > HALF_M + 20.0, "{east_m}");
    let (east_m, f) = driven(true, 1.0);
    assert!((HALF_M..HALF_M + 8.0).contains(&east_m), "{east_m}");
    let vehicle = &f.world.snapshot().vehicles[0];
    assert!(vehicle.landed && (vehicle.position_enu_m[0] + 30.0).abs() < 1.0, "{vehicle:?}");
}
