//! MAVLink 2 message signing aboard, as <https://mavlink.io/en/guide/message_signing.html> describes it: every frame that
//! leaves carries the first 48 bits of SHA-256 over the key, the frame, a link id and a timestamp that only grows; what
//! comes must prove the same key, and be newer than what came before it.

use std::collections::BTreeMap;

use mavlink::dialects::ardupilotmega::{MavMessage, RADIO_STATUS_DATA, SETUP_SIGNING_DATA};
use mavlink::{Message, MessageData};
use sha2::{Digest, Sha256};

use crate::wire::{Frame, SIGNATURE_LEN, SIGNED};

/// 2015-01-01T00:00:00Z, from which timestamps count in tens of microseconds.
const EPOCH_UNIX_US: u64 = 1_420_070_400_000_000;
const MICROSECONDS_PER_TICK: u64 = 10;
/// The first frame of a stream may be so far behind the latest timestamp known: a minute.
const NEW_STREAM_LAG: u64 = 60_000_000 / MICROSECONDS_PER_TICK;
/// Link id and timestamp, which the signature covers.
const COVERED_LEN: usize = 7;

/// A key, and what has been signed and accepted with it. It outlives a restart of the autopilot's program.
#[derive(Debug, Clone, Default)]
pub(crate) struct Signing {
    /// None: nothing is signed, and everything is accepted.
    key: Option<[u8; 32]>,
    /// The latest timestamp used or accepted.
    latest: u64,
    /// The latest timestamp of each stream: link, system, component, link id.
    streams: BTreeMap<(usize, u8, u8, u8), u64>,
}

impl Signing {
    /// Takes up a key with the timestamp to begin from; a key of zeros ends signing.
    pub fn set_up(&mut self, m: &SETUP_SIGNING_DATA) {
        self.key = (m.secret_key != [0; 32]).then_some(m.secret_key);
        self.latest = self.latest.max(m.initial_timestamp);
        self.streams.clear();
    }

    /// UTC as the autopilot has it: timestamps follow it, and never go back.
    pub fn set_utc(&mut self, unix_us: u64) {
        self.latest = self.latest.max(unix_us.saturating_sub(EPOCH_UNIX_US) / MICROSECONDS_PER_TICK);
    }

    /// Whether a frame may be acted on. RADIO_STATUS may without a signature: the radios that send it have no key.
    pub fn admits(&mut self, link: usize, frame: &Frame) -> bool {
        let Some(key) = &self.key else { return true };
        let bytes = &frame.bytes;
        if !frame.signed {
            return frame.message_id == RADIO_STATUS_DATA::ID;
        }
        let Some(at) = bytes.len().checked_sub(SIGNATURE_LEN) else { return false };
        if signature(key, &bytes[..at + COVERED_LEN]) != bytes[at + COVERED_LEN..] {
            return false;
        }
        let mut stamp = [0; 8];
        stamp[..6].copy_from_slice(&bytes[at + 1..at + COVERED_LEN]);
        let stamp = u64::from_le_bytes(stamp);
        let stream = (link, frame.system_id, frame.component_id, bytes[at]);
        let fresh = match self.streams.get(&stream) {
            Some(last) => stamp > *last,
            None => stamp > self.latest.saturating_sub(NEW_STREAM_LAG),
        };
        if fresh {
            self.streams.insert(stream, stamp);
            self.latest = self.latest.max(stamp);
        }
        fresh
    }

    /// A frame of ours as it leaves: signed, if there is a key.
    pub fn seal(&mut self, link: usize, mut frame: Vec<u8>) -> Vec<u8> {
        let Some(key) = &self.key else { return frame };
        let Some(body) = frame.len().checked_sub(2).filter(|body| *body >= 10) else { return frame };
        frame.truncate(body);
        // The flag is part of what the checksum covers.
        frame[2] |= SIGNED;
        let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
        let crc = mavlink::calculate_crc(&frame[1..], MavMessage::extra_crc(id));
        frame.extend_from_slice(&crc.to_le_bytes());
        self.latest += 1;
        frame.push(link as u8);
        frame.extend_from_slice(&self.latest.to_le_bytes()[..6]);
        let signature = signature(key, &frame);
        frame.extend_from_slice(&signature);
        frame
    }
}

/// Of a frame up to and with its timestamp.
fn signature(key: &[u8; 32], covered: &[u8]) -> [u8; 6] {
    let digest = Sha256::new().chain_update(key).chain_update(covered).finalize();
    std::array::from_fn(|k| digest[k])
}

#[cfg(test)]
mod tests {
    use mavlink::MAVLinkV2MessageRaw;
    use mavlink::dialects::ardupilotmega::SYSTEM_TIME_DATA;

    use super::*;
    use crate::wire::{Decoder, encode};

    const KEY: [u8; 32] = [7; 32];

    fn with_key(key: [u8; 32]) -> Signing {
        let mut signing = Signing::default();
        let m =
            SETUP_SIGNING_DATA { secret_key: key, initial_timestamp: 1000, ..SETUP_SIGNING_DATA::DEFAULT };
        signing.set_up(&m);
        signing
    }

    fn message() -> Vec<u8> {
        let time = MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA { time_unix_usec: 5, time_boot_ms: 6 });
        encode(9, 1, 191, &time)
    }

    fn frame(bytes: &[u8]) -> Frame {
        let mut decoder = Decoder::default();
        decoder.push(bytes);
        decoder.next().unwrap()
    }

    #[test]
    fn val_a_signature_is_the_mavlink_crates() {
        let sealed = with_key(KEY).seal(3, message());
        assert_eq!(sealed.len(), message().len() + SIGNATURE_LEN);
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.as_mut_slice()[..sealed.len()].copy_from_slice(&sealed);
        let mut theirs = [0; 6];
        raw.calculate_signature(&KEY, &mut theirs);
        assert_eq!(theirs, sealed[sealed.len() - 6..]);
        assert!(raw.has_valid_crc::<MavMessage>());
    }

    #[test]
    fn spec_only_the_key_and_only_once() {
        let (mut sender, mut receiver) = (with_key(KEY), with_key(KEY));
        let first = frame(&sender.seal(0, message()));
        let second = frame(&sender.seal(0, message()));
        assert!(receiver.admits(1, &first) && receiver.admits(1, &second));
        assert!(!receiver.admits(1, &second), "a replay");
        assert!(!receiver.admits(1, &first), "an older one");
        assert!(!receiver.admits(1, &frame(&with_key([8; 32]).seal(0, message()))), "another key");
        assert!(!receiver.admits(1, &frame(&message())), "no signature");
        assert!(Signing::default().admits(1, &frame(&message())), "no key to ask for");
    }

    #[test]
    fn spec_a_stream_that_begins_long_after_its_clock_is_refused() {
        let (mut sender, mut receiver) = (with_key(KEY), with_key(KEY));
        let old = frame(&sender.seal(0, message()));
        receiver.set_utc(EPOCH_UNIX_US + 61_000_000);
        assert!(!receiver.admits(1, &old));
        sender.set_utc(EPOCH_UNIX_US + 10_000_000);
        assert!(receiver.admits(1, &frame(&sender.seal(0, message()))));
        // A clock that goes back takes no timestamp back.
        sender.set_utc(EPOCH_UNIX_US);
        assert!(receiver.admits(1, &frame(&sender.seal(0, message()))));
    }

    #[test]
    fn spec_a_key_of_zeros_ends_signing() {
        let mut signing = with_key(KEY);
        signing.set_up(&SETUP_SIGNING_DATA::DEFAULT);
        assert_eq!(signing.seal(0, message()), message());
        assert!(signing.admits(0, &frame(&message())));
    }
}
