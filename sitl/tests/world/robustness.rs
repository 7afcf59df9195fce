//! Whatever comes over the wire, the world goes on.

use crate::common::*;
use mavlink::Message;
use mavlink::dialects::ardupilotmega::MavMessage;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing_sitl::*;

/// A frame with a right checksum.
fn frame(id: u32, payload: &[u8], system: u8, component: u8) -> Vec<u8> {
    let [a, b, c, _] = id.to_le_bytes();
    let mut frame = vec![0xFD, payload.len() as u8, 0, 0, 0, system, component, a, b, c];
    frame.extend_from_slice(payload);
    let crc = mavlink::calculate_crc(&frame[1..], MavMessage::extra_crc(id));
    frame.extend(crc.to_le_bytes());
    frame
}

fn sound(world: &World) -> bool {
    world.snapshot().vehicles.iter().all(|v| {
        v.position_enu_m.iter().chain(&v.velocity_enu_m_s).chain(&v.attitude_wxyz).all(|x| x.is_finite())
    })
}

#[test]
fn prop_a_million_random_bytes_change_nothing() {
    let mut flight = Flight::new(config());
    flight.take_off();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut bytes = [0u8; 500];
    let goals = [0, 1].map(|k| flight.position(k));
    for _ in 0..1000 {
        for vehicle in 0..2 {
            rng.fill_bytes(&mut bytes);
            flight.world.handle(vehicle, rng.random_range(1..20), &bytes);
        }
        flight.stream(20, goals, None, |_| {});
    }
    assert!(sound(&flight.world) && flight.invariants().is_empty());
    assert_eq!(flight.world.snapshot().vehicles[0].mode, "OFFBOARD");
}

#[test]
fn prop_well_formed_nonsense_does_no_harm() {
    // The commands and setpoints that a vehicle acts on, with random contents, right checksums and real targets.
    let acted_on: [(u32, usize, usize); 12] = [
        (4, 14, 12),
        (11, 6, 4),
        (20, 20, 2),
        (21, 2, 0),
        (23, 23, 4),
        (43, 2, 0),
        (75, 35, 30),
        (76, 33, 30),
        (82, 39, 36),
        (84, 53, 50),
        (86, 53, 50),
        (111, 16, 16),
    ];
    for firmware in [Firmware::Px4, Firmware::ArduCopter] {
        let mut config = config();
        config.vehicles.iter_mut().for_each(|v| v.firmware = firmware);
        let mut world = World::new(config).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        for round in 0..30_000u64 {
            let (id, len, target) = acted_on[rng.random_range(0..acted_on.len())];
            let mut payload = vec![0u8; len];
            rng.fill_bytes(&mut payload);
            if let Some(field) = payload.get_mut(target..target + 2) {
                field.copy_from_slice(&[1, [0, 1, 68][rng.random_range(0..3)]]);
            }
            if (75..=76).contains(&id) {
                let commands = [20u16, 21, 22, 176, 400, 510, 511, 512, 520, 31_010];
                payload[28..30].copy_from_slice(&commands[rng.random_range(0..commands.len())].to_le_bytes());
                // Floats that mean something, among those that do not.
                let value =
                    [0.0f32, 1.0, 4.0, 6.0, 32.0, 1e9, f32::NAN, f32::INFINITY][rng.random_range(0..8)];
                payload[..4].copy_from_slice(&value.to_le_bytes());
            }
            world.handle(0, rng.random_range(0..3), &frame(id, &payload, 255, 190));
            world.advance(std::time::Duration::from_millis(round));
            while world.poll_transmit().is_some() {}
        }
        assert!(sound(&world), "{:?}", world.snapshot());
        let wire = world.counters()[0].wire;
        assert_eq!((wire.frames, wire.bad_checksums), (30_000, 0));
        assert!(wire.undecodable < 25_000, "enough of it was understood: {wire:?}");
    }
}

#[test]
fn prop_every_message_of_the_dialect_is_survived() {
    let mut world = World::new(config()).unwrap();
    let mut known = 0;
    for id in 0..60_000u32 {
        if let Some(message) = MavMessage::default_message_from_id(id) {
            known += 1;
            let mut payload = [0u8; 255];
            let len = message.ser(mavlink::MavlinkVersion::V2, &mut payload);
            world.handle(0, 0, &frame(id, &payload[..len], 1, 191));
            world.advance(world.now() + std::time::Duration::from_millis(3));
        }
    }
    assert!(known > 250 && sound(&world), "{known}");
}
