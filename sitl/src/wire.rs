//! MAVLink frames from bytes and back: version 1 and 2 in, version 2 out.

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavlinkVersion, Message};

const STX_V1: u8 = 0xFE;
const STX_V2: u8 = 0xFD;
/// The incompatibility flag of a signed frame.
pub(crate) const SIGNED: u8 = 0x01;
/// Link id, timestamp, signature.
pub(crate) const SIGNATURE_LEN: usize = 13;

/// A frame whose checksum is right.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    pub version: MavlinkVersion,
    pub system_id: u8,
    pub component_id: u8,
    pub message_id: u32,
    /// Its last [`SIGNATURE_LEN`] bytes are a signature.
    pub signed: bool,
    pub payload: Vec<u8>,
    /// The frame as it came, for forwarding.
    pub bytes: Vec<u8>,
}

/// What became of the bytes received.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct WireCounters {
    /// Frames whose checksum was right.
    pub frames: u64,
    /// Bytes that belonged to no frame.
    pub stray_bytes: u64,
    /// Frame starts whose checksum was wrong or whose message is unknown.
    pub bad_checksums: u64,
    /// Frames with a right checksum and contents that cannot be decoded (an unknown enum value).
    pub undecodable: u64,
    /// Frames without the signature that they had to have, or with one that is wrong or old.
    pub unproven: u64,
}

/// Finds frames in a stream of bytes, whatever else is in it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Decoder {
    buffer: Vec<u8>,
    pub counters: WireCounters,
}

impl Decoder {
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// The next whole frame. Bytes that start none are dropped and counted.
    pub fn next(&mut self) -> Option<Frame> {
        let mut at = 0;
        let frame = loop {
            let rest = self.buffer.get(at..).unwrap_or_default();
            let Some(&first) = rest.first() else { break None };
            if first != STX_V1 && first != STX_V2 {
                self.counters.stray_bytes += 1;
                at += 1;
                continue;
            }
            match parse(rest) {
                Parsed::Incomplete => break None,
                Parsed::Bad => {
                    self.counters.bad_checksums += 1;
                    at += 1;
                }
                Parsed::Frame(frame) => {
                    self.counters.frames += 1;
                    at += frame.bytes.len();
                    break Some(frame);
                }
            }
        };
        self.buffer.drain(..at.min(self.buffer.len()));
        frame
    }
}

enum Parsed {
    Incomplete,
    Bad,
    Frame(Frame),
}

/// Reads the frame at the start of `rest`.
fn parse(rest: &[u8]) -> Parsed {
    let v2 = rest[0] == STX_V2;
    let header_len = if v2 { 10 } else { 6 };
    if rest.len() < header_len {
        return Parsed::Incomplete;
    }
    let payload_len = usize::from(rest[1]);
    let (signature_len, message_id, ids) = if v2 {
        if rest[2] & !SIGNED != 0 {
            return Parsed::Bad;
        }
        let signature = if rest[2] & SIGNED != 0 { SIGNATURE_LEN } else { 0 };
        (signature, u32::from_le_bytes([rest[7], rest[8], rest[9], 0]), [rest[5], rest[6]])
    } else {
        (0, u32::from(rest[5]), [rest[3], rest[4]])
    };
    let body = header_len + payload_len;
    let total = body + 2 + signature_len;
    if rest.len() < total {
        return Parsed::Incomplete;
    }
    let wanted = mavlink::calculate_crc(&rest[1..body], MavMessage::extra_crc(message_id));
    if u16::from_le_bytes([rest[body], rest[body + 1]]) != wanted {
        return Parsed::Bad;
    }
    Parsed::Frame(Frame {
        version: if v2 { MavlinkVersion::V2 } else { MavlinkVersion::V1 },
        system_id: ids[0],
        component_id: ids[1],
        message_id,
        signed: signature_len > 0,
        payload: rest[header_len..body].to_vec(),
        bytes: rest[..total].to_vec(),
    })
}

impl Frame {
    /// The message, unless a field holds a value that its enum does not know.
    pub fn message(&self) -> Option<MavMessage> {
        MavMessage::parse(self.version, self.message_id, &self.payload).ok()
    }

    /// For a COMMAND_LONG or COMMAND_INT that cannot be decoded: its command id and target. Even an unknown command
    /// is owed an answer.
    pub fn unknown_command(&self) -> Option<(u16, u8, u8)> {
        const COMMAND_INT: u32 = 75;
        const COMMAND_LONG: u32 = 76;
        if self.message_id != COMMAND_INT && self.message_id != COMMAND_LONG {
            return None;
        }
        // MAVLink 2 cuts trailing zeros off.
        let byte = |at: usize| self.payload.get(at).copied().unwrap_or(0);
        Some((u16::from_le_bytes([byte(28), byte(29)]), byte(30), byte(31)))
    }
}

/// A MAVLink 2 frame of a message.
pub(crate) fn encode(sequence: u8, system_id: u8, component_id: u8, message: &MavMessage) -> Vec<u8> {
    let mut payload = [0u8; 255];
    let len = message.ser(MavlinkVersion::V2, &mut payload);
    let id = message.message_id();
    encode_payload(
        sequence,
        [system_id, component_id],
        id,
        &payload[..len.min(255)],
        MavMessage::extra_crc(id),
    )
}

/// COMMAND_ACK for a command id that the message crate has no name for.
pub(crate) fn encode_unsupported(sequence: u8, from: [u8; 2], command: u16, to: [u8; 2]) -> Vec<u8> {
    const COMMAND_ACK: u32 = 77;
    const MAV_RESULT_UNSUPPORTED: u8 = 3;
    let [low, high] = command.to_le_bytes();
    let payload = [low, high, MAV_RESULT_UNSUPPORTED, 0, 0, 0, 0, 0, to[0], to[1]];
    encode_payload(sequence, from, COMMAND_ACK, &payload, MavMessage::extra_crc(COMMAND_ACK))
}

/// A MAVLink 2 frame of a payload, whose trailing zeros are cut off as MAVLink 2 wants it.
pub(crate) fn encode_payload(sequence: u8, from: [u8; 2], id: u32, payload: &[u8], crc_extra: u8) -> Vec<u8> {
    let [id0, id1, id2, _] = id.to_le_bytes();
    let len = payload.iter().rposition(|&byte| byte != 0).map_or(1, |last| last + 1);
    let payload = &payload[..len.min(payload.len())];
    let mut frame = Vec::with_capacity(12 + payload.len());
    frame.extend_from_slice(&[STX_V2, payload.len() as u8, 0, 0, sequence, from[0], from[1], id0, id1, id2]);
    frame.extend_from_slice(payload);
    let crc = mavlink::calculate_crc(&frame[1..], crc_extra);
    frame.extend_from_slice(&crc.to_le_bytes());
    frame
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::MavHeader;
    use mavlink::dialects::ardupilotmega::{SYSTEM_TIME_DATA, TIMESYNC_DATA};
    use rand::{Rng, SeedableRng};

    fn sync(ts1: i64) -> MavMessage {
        MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 77, ts1, target_system: 3, target_component: 9 })
    }

    #[test]
    fn val_frames_agree_with_the_mavlink_crate() {
        let ours = encode(5, 1, 68, &sync(9));
        let mut raw = mavlink::MAVLinkV2MessageRaw::new();
        raw.serialize_message(MavHeader { system_id: 1, component_id: 68, sequence: 5 }, &sync(9));
        assert_eq!(ours, raw.raw_bytes());
    }

    #[test]
    fn spec_frames_are_found_between_garbage_and_across_calls() {
        let mut decoder = Decoder::default();
        let mut v1 = mavlink::MAVLinkV1MessageRaw::new();
        let time = MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA { time_unix_usec: 1, time_boot_ms: 2 });
        v1.serialize_message(MavHeader { system_id: 255, component_id: 190, sequence: 0 }, &time);
        let mut stream = vec![0xFD, 3, 0];
        stream.extend(encode(0, 7, 191, &sync(1)));
        stream.extend([1, 2, 3, 0xFE]);
        stream.extend(v1.raw_bytes());
        stream.extend(encode(1, 7, 191, &sync(2)));
        // What follows a false start may be held back until its supposed length has arrived.
        stream.extend(vec![0; 300]);
        let mut found = Vec::new();
        for byte in stream {
            decoder.push(&[byte]);
            while let Some(frame) = decoder.next() {
                found.push(frame.message());
            }
        }
        assert_eq!(found, vec![Some(sync(1)), Some(time), Some(sync(2))]);
        assert_eq!(decoder.counters.bad_checksums, 2);
    }

    #[test]
    fn prop_a_million_random_bytes_do_no_harm() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut decoder = Decoder::default();
        let mut bytes = [0u8; 1000];
        for _ in 0..1000 {
            rng.fill_bytes(&mut bytes);
            decoder.push(&bytes);
            while let Some(frame) = decoder.next() {
                let _ = frame.message();
                let _ = frame.unknown_command();
            }
            assert!(decoder.buffer.len() <= 280);
        }
        assert!(decoder.counters.stray_bytes > 900_000);
    }
}
