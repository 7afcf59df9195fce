//! MAVLink 2 signing at a vehicle: set up, enforced, kept, and refused when it is too late for it.

use crate::common::*;
use mavlink::dialects::ardupilotmega::*;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, consts};
use veilwing_sitl::*;

const KEY: [u8; 32] = [0x5A; 32];
/// Tens of microseconds from 2015 to the world's start.
const START: u64 = (1_790_000_000_000_000 - 1_420_070_400_000_000) / 10;

fn setup(world: &mut World, client: &mut Client) {
    let setup = SETUP_SIGNING_DATA {
        secret_key: KEY,
        initial_timestamp: 0,
        target_system: client.system(),
        target_component: 1,
    };
    client.send(world, &MavMessage::SETUP_SIGNING(setup));
}

/// Sends a frame with the mavlink crate's signature.
fn send_signed(world: &mut World, from: MavHeader, message: &MavMessage, stamp: u64, key: &[u8; 32]) {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message_for_signing(from, message);
    let stamp = stamp.to_le_bytes();
    raw.signature_timestamp_bytes_mut().copy_from_slice(&stamp[..consts::v2::SIGNATURE_TIMESTAMP_SIZE]);
    *raw.signature_link_id_mut() = 1;
    let mut signature = [0; consts::v2::SIGNATURE_VALUE_SIZE];
    raw.calculate_signature(key, &mut signature);
    raw.signature_value_mut().copy_from_slice(&signature);
    world.handle(0, 0, raw.raw_bytes());
}

/// Whether the autopilot answers a request for its version.
fn is_heard(flight: &mut Flight, send: impl FnOnce(&mut World, &MavMessage)) -> bool {
    let request = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
        param1: 148.0,
        target_system: 1,
        target_component: 1,
        ..COMMAND_LONG_DATA::DEFAULT
    });
    let acks = |flight: &Flight| {
        let all = flight.clients[0].received.iter();
        all.filter(|(_, m)| matches!(m, MavMessage::COMMAND_ACK(_))).count()
    };
    let before = acks(flight);
    send(&mut flight.world, &request);
    flight.pass(50);
    acks(flight) > before
}

#[test]
fn spec_with_a_key_only_signed_frames_are_heard() {
    let mut flight = Flight::new(config());
    flight.pass(100);
    let header = flight.clients[0].header;
    let unsigned = |world: &mut World, message: &MavMessage| Client::companion(0).send(world, message);
    assert!(is_heard(&mut flight, unsigned));
    setup(&mut flight.world, &mut Client::companion(0));
    assert!(!is_heard(&mut flight, unsigned));
    let signed = |stamp: u64, key: [u8; 32]| {
        move |world: &mut World, message: &MavMessage| send_signed(world, header, message, stamp, &key)
    };
    // The test's clock is the world's at its start: within the minute that a stream may begin late.
    assert!(is_heard(&mut flight, signed(START, KEY)));
    assert!(!is_heard(&mut flight, signed(START, KEY)), "once is enough");
    assert!(!is_heard(&mut flight, signed(START + 1, [1; 32])), "another key");
    assert!(is_heard(&mut flight, signed(START + 2, KEY)));
    let unproven = flight.world.counters()[0].wire.unproven;
    assert_eq!(unproven, 3);
    // The key is not forgotten with the autopilot's program.
    flight.world.inject(Fault::AutopilotRestart { vehicle: 0 });
    flight.pass(5000);
    assert!(!is_heard(&mut flight, unsigned));
    assert!(is_heard(&mut flight, signed(START + 600_000, KEY)));
}

#[test]
fn spec_what_leaves_is_signed_with_growing_timestamps() {
    let mut flight = Flight::new(config());
    setup(&mut flight.world, &mut Client::companion(0));
    let mut last = 0;
    let mut seen = 0;
    for ms in 1..500u64 {
        flight.world.advance(std::time::Duration::from_millis(ms));
        while let Some((vehicle, link, frame)) = flight.world.poll_transmit() {
            if vehicle != 0 {
                assert_eq!(frame[2] & 1, 0, "the other vehicle has no key");
                continue;
            }
            let mut raw = MAVLinkV2MessageRaw::new();
            raw.as_mut_slice()[..frame.len()].copy_from_slice(&frame);
            let mut signature = [0; consts::v2::SIGNATURE_VALUE_SIZE];
            raw.calculate_signature(&KEY, &mut signature);
            assert_eq!((signature, link), (raw.signature_value().try_into().unwrap(), 0));
            assert!(raw.signature_timestamp() > last);
            last = raw.signature_timestamp();
            seen += 1;
        }
    }
    assert!(seen > 5 && last > START + 20_000 && last < START + 50_000, "{seen} frames, {last}");
}

#[test]
fn spec_a_key_is_refused_while_armed() {
    for (firmware, trap, taken) in [
        (Firmware::ArduCopter, true, false),
        (Firmware::ArduCopter, false, true),
        (Firmware::Px4, true, true),
    ] {
        let mut config = config();
        config.vehicles[0].firmware = firmware;
        config.vehicles[0].traps.signing_refused_while_armed = trap;
        let mut flight = Flight::new(config);
        flight.pass(5000);
        if firmware == Firmware::ArduCopter {
            flight.clients[0].command(&mut flight.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 4.0]);
        }
        flight.clients[0].command(&mut flight.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
        flight.pass(100);
        assert!(flight.world.snapshot().vehicles[0].armed);
        setup(&mut flight.world, &mut Client::companion(0));
        let heard = is_heard(&mut flight, |world, message| Client::companion(0).send(world, message));
        assert_eq!(heard, !taken, "{firmware:?}");
        let refused = flight.clients[0].texts().iter().any(|text| text.contains("signing when armed"));
        assert_eq!(refused, !taken, "{firmware:?}");
    }
}
