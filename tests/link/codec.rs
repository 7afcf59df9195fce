use mavlink::dialects::ardupilotmega::{MavAutopilot, MavState, MavType};
use proptest::prelude::*;
use veilwing::link::codec::{Decoder, Encoder};
use veilwing::link::{Counters, RawFrame, Rejection};

use crate::common::*;

#[test]
fn val_both_versions_read_as_pymavlink_wrote_them() {
    for (hex, expected_id) in [
        (HEARTBEAT_V1, 0),
        (HEARTBEAT_V2, 0),
        (STATUSTEXT_HELLO, 253),
        (RADIO_STATUS_V1, 109),
        (SCALED_IMU2_V1, 116),
        (SCALED_IMU2_V2, 116),
        (HEARTBEAT_SIGNED, 0),
        (PARAM_VALUE_SIGNED, 22),
    ] {
        let (frames, counters) = decode(&bytes(hex));
        assert_eq!(frames.len(), 1, "{hex}");
        assert_eq!(frames[0].bytes(), bytes(hex));
        assert_eq!(frames[0].message_id(), expected_id);
        assert_eq!((counters.rejected.total(), counters.noise_bytes), (0, 0), "{hex}");
        frames[0].parse::<M>().unwrap();
    }
    let frame = decode(&bytes(HEARTBEAT_V2)).0[0].parse::<M>().unwrap();
    let M::HEARTBEAT(heartbeat) = &frame.message else { panic!("{frame:?}") };
    assert_eq!((frame.header.system_id, frame.header.component_id, frame.header.sequence), (1, 1, 7));
    assert_eq!(
        (heartbeat.mavtype, heartbeat.autopilot),
        (MavType::MAV_TYPE_QUADROTOR, MavAutopilot::MAV_AUTOPILOT_PX4)
    );
    assert_eq!((heartbeat.custom_mode, heartbeat.system_status), (0x0403_0201, MavState::MAV_STATE_ACTIVE));
    assert!(!frame.signed && !frame.neutralised);
}

#[test]
fn val_frames_are_written_as_pymavlink_writes_them() {
    let message = decode(&bytes(HEARTBEAT_V2)).0[0].parse::<M>().unwrap().message;
    let mut encoder = Encoder::default();
    for _ in 0..7 {
        encoder.encode((1, 1), &message);
    }
    assert_eq!(encoder.encode((1, 1), &message).raw_bytes(), bytes(HEARTBEAT_V2));
}

#[test]
fn spec_each_component_has_its_own_sequence_and_it_wraps() {
    let mut encoder = Encoder::default();
    for round in 0..600_u32 {
        for from in [(1, 191), (1, 68), (2, 191)] {
            let raw = encoder.encode(from, &heartbeat(0));
            assert_eq!(u32::from(raw.sequence()), round % 256);
        }
    }
}

#[test]
fn spec_an_unknown_enum_value_does_not_lose_the_heartbeat() {
    let frame = decode(&bytes(HEARTBEAT_UNKNOWN)).0[0].parse::<M>().unwrap();
    let M::HEARTBEAT(heartbeat) = &frame.message else { panic!("{frame:?}") };
    assert!(frame.neutralised);
    assert_eq!(
        (heartbeat.mavtype, heartbeat.autopilot),
        (MavType::MAV_TYPE_GENERIC, MavAutopilot::MAV_AUTOPILOT_GENERIC)
    );
    assert_eq!((heartbeat.system_status, heartbeat.custom_mode), (MavState::MAV_STATE_UNINIT, 0x0403_0201));
    assert_eq!(heartbeat.base_mode.bits(), 81);
}

#[test]
fn spec_every_neutral_field_is_where_the_table_says() {
    // One byte at a time is set to a value that no enum has; whatever is then refused as an unknown enum
    // value must not be one of those that read as neutral.
    for (id, length, neutral) in
        [(0, 9, vec![4, 5, 7]), (24, 52, vec![28]), (147, 54, vec![33, 34, 40, 49]), (245, 2, vec![0, 1])]
    {
        for at in 0..length {
            let mut payload = vec![0; length];
            payload[at] = 249;
            let raw = RawFrame::from_bytes(&frame_v2(id, 0, &payload)).unwrap();
            match raw.parse::<M>() {
                Ok(frame) => assert_eq!(frame.neutralised, neutral.contains(&at), "message {id}, byte {at}"),
                Err(reason) => panic!("message {id}, byte {at}: {reason:?}"),
            }
        }
    }
}

#[test]
fn spec_an_unknown_enum_value_that_matters_loses_the_message() {
    let frame = decode(&bytes(COMMAND_ACK_UNKNOWN)).0[0];
    assert_eq!(frame.parse::<M>(), Err(Rejection::UnknownEnum));
}

/// A MAVLink 2 frame of any kind, with the checksum that it should have.
fn frame_v2(id: u32, flags: u8, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xFD, u8::try_from(payload.len()).unwrap(), flags, 0, 9, 1];
    if flags & 2 != 0 {
        frame.extend([0, 0, 1]);
    }
    frame.push(1);
    frame.extend(&id.to_le_bytes()[..3]);
    frame.extend(payload);
    let crc = mavlink::calculate_crc(&frame[1..], <M as mavlink::Message>::extra_crc(id));
    frame.extend(crc.to_le_bytes());
    frame
}

#[test]
fn spec_each_malformation_is_counted_by_its_reason() {
    let good = bytes(HEARTBEAT_V2);
    let mut bad_crc = good.clone();
    *bad_crc.last_mut().unwrap() ^= 1;
    let mut short_v1 = bytes(HEARTBEAT_V1);
    short_v1[1] = 8;
    for (datagram, reason) in [
        (good[..good.len() - 1].to_vec(), Rejection::Truncated),
        (vec![0xFD], Rejection::Truncated),
        (bad_crc, Rejection::BadCrc),
        (frame_v2(0, 4, &[1; 9]), Rejection::UnknownFlags),
        (frame_v2(0xAB_CDEF, 0, &[1; 9]), Rejection::UnknownMessage),
        (short_v1, Rejection::WrongLength),
    ] {
        let (frames, counters) = decode(&datagram);
        assert_eq!((frames.len(), reasons(&counters)), (0, vec![(reason, 1)]), "{datagram:02x?}");
        assert_eq!(counters.noise_bytes, datagram.len() as u64);
    }
}

#[test]
fn spec_a_32_bit_system_id_is_read() {
    let (frames, _) = decode(&frame_v2(0, 2, &[1, 2, 3, 4, 2, 12, 81, 4, 3]));
    let frame = frames[0].parse::<M>().unwrap();
    assert_eq!(frame.header.system_id, 0x0100_0001);
    assert_eq!(mode_of(&frame), 0x0403_0201);
}

#[test]
fn prop_no_frame_of_the_dialect_is_too_long_or_refused() {
    // Every message, all zeros and unsigned: the smallest payload; then its MAVLink 1 form.
    for &id in M::all_ids() {
        let message = <M as mavlink::Message>::default_message_from_id(id).unwrap();
        let raw = RawFrame::V2(Encoder::default().encode((1, 1), &message));
        let (frames, counters) = decode(raw.bytes());
        assert_eq!((frames, counters.rejected.total()), (vec![raw], 0), "{id}");
        if id < 256 {
            let mut v1 = mavlink::MAVLinkV1MessageRaw::new();
            v1.serialize_message(mavlink::MavHeader::default(), &message);
            assert_eq!(decode(v1.raw_bytes()).0, vec![RawFrame::V1(v1)], "{id}");
        }
    }
}

#[test]
fn spec_noise_does_not_hold_up_the_frame_behind_it() {
    // A stream, so nothing says that the noise is over: a start marker in it must be seen through at once.
    for noise in [
        vec![0xFD, 0xFF, 0xFF],
        vec![0xFE; 20],
        vec![0xFD; 20],
        b"login: \xfd\xfd\xfe".to_vec(),
        vec![0xFE, 200],
    ] {
        let (mut decoder, mut counters) = (Decoder::<M>::default(), Counters::default());
        decoder.feed(&noise);
        assert_eq!(decoder.next_frame(&mut counters), None);
        decoder.feed(&bytes(HEARTBEAT_V2));
        let frame = decoder.next_frame(&mut counters).unwrap_or_else(|| panic!("held up by {noise:02x?}"));
        assert_eq!(frame.bytes(), bytes(HEARTBEAT_V2));
        assert_eq!(counters.noise_bytes, noise.len() as u64);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    #[test]
    fn prop_no_frame_is_lost_in_noise_however_the_bytes_are_cut(
        parts in prop::collection::vec((prop::collection::vec(any::<u8>(), 0..40), 0..6_usize), 1..8),
        cut in 1..50_usize,
    ) {
        let frames = [HEARTBEAT_V1, HEARTBEAT_V2, STATUSTEXT_HELLO, SCALED_IMU2_V1, HEARTBEAT_SIGNED, PARAM_VALUE_SIGNED];
        let mut stream = Vec::new();
        let mut sent = Vec::new();
        for (noise, index) in parts {
            stream.extend(noise);
            sent.push(bytes(frames[index]));
            stream.extend(bytes(frames[index]));
        }
        let (mut decoder, mut counters) = (Decoder::<M>::default(), Counters::default());
        let mut found = Vec::new();
        for piece in stream.chunks(cut) {
            decoder.feed(piece);
            found.extend(std::iter::from_fn(|| decoder.next_frame(&mut counters)).map(|raw| raw.bytes().to_vec()));
        }
        decoder.end();
        found.extend(std::iter::from_fn(|| decoder.next_frame(&mut counters)).map(|raw| raw.bytes().to_vec()));
        prop_assert_eq!(&found, &sent);
        let in_frames: usize = sent.iter().map(Vec::len).sum();
        prop_assert_eq!(counters.noise_bytes, (stream.len() - in_frames) as u64);
    }

    #[test]
    fn prop_a_flipped_bit_never_passes(index in 0..6_usize, bit in any::<prop::sample::Index>()) {
        let frames = [HEARTBEAT_V1, HEARTBEAT_V2, STATUSTEXT_HELLO, SCALED_IMU2_V1, SCALED_IMU2_V2, RADIO_STATUS_V1];
        let mut frame = bytes(frames[index]);
        let bit = bit.index(8 * frame.len());
        frame[bit / 8] ^= 1 << (bit % 8);
        let (found, counters) = decode(&frame);
        prop_assert_eq!(found, vec![]);
        prop_assert!(counters.noise_bytes == frame.len() as u64);
    }
}
