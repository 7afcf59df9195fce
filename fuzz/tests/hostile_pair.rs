//! A million seeded frames over the pair link: noise, frames of any content, frames that the pair itself has sent with a
//! few bytes changed, whole or cut, plain or in TUNNEL.
//!
//! `cargo test -p veilwing-fuzz --test hostile_pair -- --nocapture` prints what became of them, and how long it took.

// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use arbitrary::Unstructured;
use mavlink::Message;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::link::envelope::PAYLOAD_TYPE;
use veilwing::link::{Clock, Counters, Envelope};
use veilwing::role::Role;
use veilwing_fuzz::targets::slot::Pair;

const FRAMES: u64 = 1_000_000;
/// Frames between two fresh pairs.
const A_PAIR: u64 = 5_000;

/// A frame of system `from` with this message and payload, its checksum right.
fn framed(from: Role, id: u32, payload: &[u8]) -> Vec<u8> {
    let id_bytes = id.to_le_bytes();
    let mut frame = vec![0xFD, u8::try_from(payload.len()).unwrap(), 0, 0, 0, 1 + from as u8, 191];
    frame.extend(&id_bytes[..3]);
    frame.extend(payload);
    let crc = mavlink::calculate_crc(&frame[1..], Envelope::extra_crc(id));
    frame.extend(crc.to_le_bytes());
    frame
}

fn random(rng: &mut ChaCha8Rng, longest: usize) -> Vec<u8> {
    let mut bytes = vec![0; rng.random_range(0..=longest)];
    rng.fill_bytes(&mut bytes);
    bytes
}

/// What `from` has sent, a few bytes of it other than they were.
fn altered(rng: &mut ChaCha8Rng, from: Role, recorded: &[Vec<u8>]) -> Vec<u8> {
    let frame = &recorded[rng.random_range(0..recorded.len())];
    let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    let mut payload = frame[10..frame.len() - 2].to_vec();
    for _ in 0..rng.random_range(0..4) {
        let at = rng.random_range(0..payload.len());
        payload[at] = match rng.random_range(0..4) {
            0 => 0,
            1 => 0xFF,
            2 => payload[at].wrapping_add(1),
            _ => rng.random(),
        };
    }
    framed(from, id, &payload)
}

fn in_tunnel(from: Role, inside: &[u8]) -> Vec<u8> {
    let mut payload = PAYLOAD_TYPE.to_le_bytes().to_vec();
    payload.extend([0, 0, u8::try_from(inside.len()).unwrap()]);
    payload.extend(inside);
    framed(from, 385, &payload)
}

fn datagram(rng: &mut ChaCha8Rng, from: Role, recorded: &[Vec<u8>]) -> Vec<u8> {
    let mut datagram = match rng.random_range(0..10) {
        0 => random(rng, 300),
        1 => {
            let id = rng.random_range(42_099..42_112);
            framed(from, id, &random(rng, 255))
        }
        2 => in_tunnel(from, &random(rng, 128)),
        3 | 4 => in_tunnel(from, &altered(rng, from, recorded)),
        _ => altered(rng, from, recorded),
    };
    match rng.random_range(0..10) {
        0 if !datagram.is_empty() => {
            let at = rng.random_range(0..datagram.len());
            datagram[at] ^= 1 << rng.random_range(0..8);
        }
        1 => datagram.truncate(rng.random_range(0..=datagram.len())),
        2 => datagram.extend(random(rng, 40)),
        _ => {}
    }
    datagram
}

#[test]
fn prop_a_million_random_frames_neither_panic_nor_raise_a_power() {
    let clock = Clock::real();
    let mut rng = ChaCha8Rng::seed_from_u64(42_100);
    let (mut taken, mut turned_away, mut counters) = (0, 0, Counters::default());
    let mut target = Pair::new();
    for number in 0..FRAMES {
        if number % A_PAIR == 0 {
            taken += target.taken;
            turned_away += target.counters.rejected.total();
            counters = std::mem::replace(&mut target, Pair::new()).counters;
        }
        let to = if rng.random_bool(0.5) { Role::I } else { Role::J };
        let bytes = datagram(&mut rng, to.peer(), &target.recorded[to.peer()]);
        if rng.random_range(0..50) == 0 {
            // As the fuzzer feeds it, with time passing.
            let length = u8::try_from(bytes.len()).unwrap_or(255);
            let head = 0xE0 | (rng.random_range(0..16) << 1) | u8::from(to == Role::J);
            let _ = target.take(&mut Unstructured::new(&[&[head, length][..], &bytes].concat()));
        } else {
            target.datagram(to, &bytes);
        }
    }
    taken += target.taken;
    turned_away += target.counters.rejected.total();
    println!(
        "{FRAMES} datagrams in {:.1} s: {taken} messages taken, {turned_away} frames or starts of frames turned away",
        clock.now().since_start().as_secs_f64()
    );
    println!("the last full pair: {counters}");
    assert!(taken > FRAMES / 3 && turned_away > FRAMES / 10, "{taken} {turned_away}");
}

#[test]
fn spec_a_fresh_pair_radiates_and_has_sent_every_kind_of_message_but_orders_and_silences() {
    let target = Pair::new();
    let ids = |role: Role| -> Vec<u32> {
        target.recorded[role].iter().map(|f| u32::from_le_bytes([f[7], f[8], f[9], 0])).collect()
    };
    assert_eq!(ids(Role::I), [42_100, 42_101, 42_103, 42_104, 42_105, 42_110]);
    assert_eq!(ids(Role::J), [42_100, 42_102, 42_104, 42_106, 42_110]);
}
