//! MAVLink 2 message signing: the policy. The arithmetic is the mavlink crate's, the record on disk `record`'s.
//!
//! A timestamp counts tens of microseconds since 2015. What was accepted or used is never accepted or used
//! again, also after a crash: a link's timestamps, received and sent, stay below a ceiling that is on disk
//! before they are used, and the next run starts above it. A peer whose clock is behind that start is turned
//! away until it has caught up, which a signing peer does as soon as it hears from us.

mod key;
mod record;

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use mavlink::{MAVLinkV2MessageRaw, consts};

pub use key::Key;

use self::record::Record;
use super::counters::Rejection;
use super::frame::RawFrame;
use crate::time::Utc;

/// RADIO_STATUS: SiK radios put it into the stream themselves, and have no key.
pub const RADIO_STATUS_ID: u32 = 109;

/// 2015-01-01T00:00:00Z, from which signing timestamps count.
const EPOCH_UNIX_US: u64 = 1_420_070_400_000_000;
const MICROSECONDS_PER_TICK: u64 = 10;
const TICKS_PER_SECOND: u64 = 1_000_000 / MICROSECONDS_PER_TICK;
/// Timestamps have 48 bits.
const TIMESTAMP_MAX: u64 = (1 << 48) - 1;
/// The first frame of a stream may be this much behind the latest timestamp known.
const NEW_STREAM_LAG: u64 = 60 * TICKS_PER_SECOND;

/// How a link signs, and what it accepts.
#[derive(Debug, Clone)]
pub struct SigningConfig {
    /// The secret that both ends share. Each link should have its own: a frame recorded on one link could
    /// otherwise be replayed on another.
    pub key: Key,
    /// The link id in what is sent; it tells apart the links over which one component speaks with one key.
    pub link_id: u8,
    /// Where the timestamps are on record. One file for each link, kept across restarts.
    pub state_file: PathBuf,
    /// Message ids accepted without a signature, such as [`RADIO_STATUS_ID`]. They never tell where the peer is.
    pub unsigned_allowed: Vec<u32>,
}

/// Why signing cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum SigningError {
    /// The key file cannot be read.
    #[error("cannot read the key file {}: {source}", path.display())]
    KeyFile {
        /// Its path.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// Others than the owner can read or change the key file.
    #[error("the key file {0} has mode {mode:03o}, so others than its owner may read or change it: run `chmod 600 {0}`", path.display())]
    KeyFileMode {
        /// Its path.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// The key file does not hold a key.
    #[error("the key file {} holds {bytes} bytes that are no key: write 64 hexadecimal digits or 32 bytes, not all of them zero", path.display())]
    KeyFileContent {
        /// Its path.
        path: PathBuf,
        /// Its size.
        bytes: usize,
    },
    /// The record of timestamps cannot be kept.
    #[error("cannot keep the signing timestamps in {}: {source}; check that the directory exists and can be written to", path.display())]
    StateFile {
        /// Its path.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The record of timestamps is used by another link or process.
    #[error("the signing timestamps in {} are in use by another link: give each link a state file of its own", path.display())]
    StateFileInUse {
        /// Its path.
        path: PathBuf,
    },
    /// The record of timestamps cannot be read.
    #[error("the signing timestamps in {} are damaged: if this machine's clock is right, delete the file", path.display())]
    StateFileContent {
        /// Its path.
        path: PathBuf,
    },
}

/// No timestamp is on record that could sign the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("no signing timestamp is left: the disk does not record new ones")]
pub struct NoTimestamp;

/// Signs and verifies one link's frames.
#[derive(Debug)]
pub struct Signing {
    key: Key,
    link_id: u8,
    unsigned_allowed: Vec<u32>,
    /// The latest timestamp used or accepted.
    latest: u64,
    /// What this run started from: anything up to here may have been accepted before.
    floor: u64,
    /// The latest timestamp of each stream: (system, component, link id).
    streams: BTreeMap<(u32, u8, u8), u64>,
    record: Record,
}

impl Signing {
    /// Takes up signing where the last run left off.
    ///
    /// # Errors
    /// If the record of timestamps can't be read, is in use, or cannot be written.
    pub fn open(config: SigningConfig, utc: Utc) -> Result<Self, SigningError> {
        let (record, recorded) = Record::open(config.state_file, timestamp(utc))?;
        Ok(Self {
            key: config.key,
            link_id: config.link_id,
            unsigned_allowed: config.unsigned_allowed,
            latest: recorded,
            floor: recorded,
            streams: BTreeMap::new(),
            record,
        })
    }

    /// Fills in the signature of a frame that [`super::codec::Encoder::encode_for_signing`] made.
    ///
    /// # Errors
    /// [`NoTimestamp`]: the frame must not be sent.
    pub fn sign(&mut self, raw: &mut MAVLinkV2MessageRaw, utc: Utc) -> Result<(), NoTimestamp> {
        let by_clock = timestamp(utc).max(self.latest + 1);
        self.record.extend_beyond(by_clock);
        // While a slow disk lags behind the clock, counting up goes a long way on what is on record.
        let recorded = [by_clock, self.latest + 1].into_iter().find(|&next| self.record.covers(next));
        let next = recorded.or(self.record.is_unable().then_some(by_clock));
        self.latest = next.filter(|&next| next <= TIMESTAMP_MAX).ok_or(NoTimestamp)?;
        let bytes = self.latest.to_le_bytes();
        raw.signature_timestamp_bytes_mut().copy_from_slice(&bytes[..consts::v2::SIGNATURE_TIMESTAMP_SIZE]);
        *raw.signature_link_id_mut() = self.link_id;
        let signature = self.key.signature(raw);
        raw.signature_value_mut().copy_from_slice(&signature);
        Ok(())
    }

    /// Judges a received frame. `Ok(true)`: its sender has the key and it is new. `Ok(false)`: accepted without
    /// proof, by the allow-list.
    ///
    /// # Errors
    /// Why the frame must be ignored. A frame turned away changes nothing here.
    pub fn verify(&mut self, frame: &RawFrame, utc: Utc) -> Result<bool, Rejection> {
        let raw = match frame {
            RawFrame::V2(raw) if frame.is_signed() => raw,
            _ if self.unsigned_allowed.contains(&frame.message_id()) => return Ok(false),
            _ => return Err(Rejection::Unsigned),
        };
        if self.key.signature(raw) != raw.signature_value() {
            return Err(Rejection::WrongSignature);
        }
        let stream = (raw.system_id(), raw.component_id(), raw.signature_link_id());
        let received = raw.signature_timestamp();
        let now = timestamp(utc).max(self.latest);
        match self.streams.get(&stream) {
            Some(&last) if received <= last => return Err(Rejection::Replayed),
            None if received <= self.floor.max(now.saturating_sub(NEW_STREAM_LAG)) => {
                return Err(Rejection::TooOld);
            }
            _ => {}
        }
        self.record.extend_beyond(received.max(now));
        if !self.record.covers(received) && !self.record.is_unable() {
            return Err(Rejection::TooNew);
        }
        self.streams.insert(stream, received);
        self.latest = self.latest.max(received);
        Ok(true)
    }
}

impl Drop for Signing {
    fn drop(&mut self) {
        self.record.close(self.latest);
    }
}

/// The signing timestamp of an instant, 0 before 2015.
fn timestamp(utc: Utc) -> u64 {
    utc.unix_us.saturating_sub(EPOCH_UNIX_US) / MICROSECONDS_PER_TICK
}
