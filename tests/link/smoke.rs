//! What a fuzzer would do for the first minute, from one seed.

use std::time::Instant;

use mavlink::Message;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::link::codec::{Decoder, Encoder};
use veilwing::link::{Counters, Key, RawFrame, SigningConfig, TlogReader};
use veilwing::time::Utc;

use crate::common::*;
use crate::tlog::directory;

/// A frame that is well formed except, as the case may be, for its content: any message of the dialect with any
/// payload, of either version, signed or not, with a system id of either width.
fn well_formed(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let ids = M::all_ids();
    let id = ids[rng.random_range(0..ids.len())];
    let v1 = rng.random_bool(0.3) && id < 256;
    let message = M::default_message_from_id(id).unwrap();
    let length =
        if v1 { message.ser(mavlink::MavlinkVersion::V1, &mut [0; 255]) } else { rng.random_range(0..256) };
    let mut payload = vec![0; length];
    rng.fill_bytes(&mut payload);
    let length = u8::try_from(length).unwrap();
    let id_bytes = id.to_le_bytes();
    let mut frame = if v1 {
        vec![0xFE, length, rng.random(), rng.random(), rng.random(), id_bytes[0]]
    } else {
        let flags = rng.random_range(0..4_u8);
        let mut frame = vec![0xFD, length, flags, rng.random(), rng.random(), rng.random(), rng.random()];
        if flags & 2 != 0 {
            frame.extend([0, 0, rng.random()]);
        }
        frame.extend(&id_bytes[..3]);
        frame
    };
    frame.extend(payload);
    let crc = mavlink::calculate_crc(&frame[1..], M::extra_crc(id));
    frame.extend(crc.to_le_bytes());
    if !v1 && frame[2] & 1 != 0 {
        frame.extend(rng.random::<[u8; 13]>());
    }
    frame
}

fn hostile(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut datagram = match rng.random_range(0..4) {
        0 => {
            let mut noise = vec![0; rng.random_range(0..300)];
            rng.fill_bytes(&mut noise);
            noise
        }
        _ => well_formed(rng),
    };
    match rng.random_range(0..4) {
        0 if !datagram.is_empty() => {
            let at = rng.random_range(0..datagram.len());
            datagram[at] ^= 1 << rng.random_range(0..8);
        }
        1 => datagram.truncate(rng.random_range(0..=datagram.len())),
        2 => datagram.extend(well_formed(rng)),
        _ => {}
    }
    datagram
}

/// `cargo test --test link smoke -- --nocapture` prints what became of them.
#[test]
fn prop_a_million_hostile_datagrams_do_no_harm() {
    const DATAGRAMS: u64 = 1_000_000;
    let mut rng = ChaCha8Rng::seed_from_u64(20_260_101);
    let state_file = directory("smoke").join("state");
    let config = SigningConfig { key: Key::new(KEY), link_id: 0, state_file, unsigned_allowed: vec![] };
    let mut signing =
        veilwing::link::signing::Signing::open(config, Utc { unix_us: SIGNED_UNIX_US }).unwrap();
    let (mut datagrams, mut stream) = (Decoder::<M>::default(), Decoder::<M>::default());
    let (mut counters, mut stream_counters) = (Counters::default(), Counters::default());
    let mut frames = 0_u64;
    for _ in 0..DATAGRAMS {
        let datagram = hostile(&mut rng);
        counters.received_bytes += datagram.len() as u64;
        datagrams.feed(&datagram);
        datagrams.end();
        while let Some(raw) = datagrams.next_frame(&mut counters) {
            frames += raw.bytes().len() as u64;
            counters.received += 1;
            assert!(signing.verify(&raw, Utc { unix_us: SIGNED_UNIX_US }).is_err(), "{raw:?}");
            if let Err(reason) = raw.parse::<M>() {
                counters.rejected.count(reason);
            }
            let unsigned = raw.without_signature::<M>();
            assert!(
                unsigned.has_valid_crc::<M>() && RawFrame::from_bytes(unsigned.bytes()) == Some(unsigned)
            );
        }
        // The same bytes as a stream: the boundaries are lost, the counting is not.
        stream.feed(&datagram);
        while let Some(raw) = stream.next_frame(&mut stream_counters) {
            stream_counters.received_bytes += raw.bytes().len() as u64;
        }
        TlogReader::new(datagram.as_slice()).for_each(drop);
    }
    println!("{counters}");
    assert_eq!(counters.received_bytes, frames + counters.noise_bytes, "each byte is a frame's or noise");
    let held = counters.received_bytes - stream_counters.received_bytes - stream_counters.noise_bytes;
    assert!(held <= 283, "{held} bytes held");
    assert!(counters.received > DATAGRAMS / 4);
}

/// Not a test of speed, but the place that prints it.
#[test]
fn spec_decoding_speed_is_printed() {
    let mut encoder = Encoder::default();
    let stream: Vec<u8> =
        (0..1000).flat_map(|mode| encoder.encode((1, 1), &heartbeat(mode)).raw_bytes().to_vec()).collect();
    let noise: Vec<u8> = {
        let mut noise = vec![0; stream.len()];
        ChaCha8Rng::seed_from_u64(1).fill_bytes(&mut noise);
        noise
    };
    for (name, bytes, expected) in [("HEARTBEATs", &stream, 1000), ("noise", &noise, 0)] {
        #[allow(clippy::disallowed_methods, reason = "a figure for people, not for an assertion")]
        let started = Instant::now();
        let (mut decoder, mut counters) = (Decoder::<M>::default(), Counters::default());
        let mut frames = 0;
        for _ in 0..20 {
            decoder.feed(bytes);
            while let Some(raw) = decoder.next_frame(&mut counters) {
                frames += usize::from(raw.parse::<M>().is_ok());
            }
        }
        let megabytes = 20.0 * bytes.len() as f64 / 1e6;
        println!("{name}: {:.0} MB/s", megabytes / started.elapsed().as_secs_f64());
        assert_eq!(frames, 20 * expected);
    }
}
