//! MAVLink 2 message signing: the policy. The arithmetic is the mavlink crate's.
//!
//! A timestamp counts tens of microseconds since 2015. What was accepted or used is never accepted or used again, also
//! after a crash: timestamps are put on record a minute ahead of their use (`reserve`), by a thread of their own
//! (`record`), and the next run begins at the record. Frames never wait for the disk, nor are they turned away for
//! want of it. Who is behind, by its clock or by a crash of ours, is brought up by the first frame of ours that it hears,
//! as the reference implementation of MAVLink has it; [`super::gate`] sends one where nothing else would.

mod key;
mod record;
mod reserve;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use mavlink::{MAVLinkV2MessageRaw, consts};

pub use key::Key;
pub use reserve::{BLOCK, Keeper};

use self::record::Recorder;
use self::reserve::Reserve;
use super::counters::Rejection;
use super::frame::RawFrame;
use crate::time::Utc;

/// RADIO_STATUS: SiK radios put it into the stream themselves, and have no key.
pub const RADIO_STATUS_ID: u32 = 109;

/// 2015-01-01T00:00:00Z, from which signing timestamps count.
const EPOCH_UNIX_US: u64 = 1_420_070_400_000_000;
const MICROSECONDS_PER_TICK: u64 = 10;
const TICKS_PER_SECOND: u64 = 1_000_000 / MICROSECONDS_PER_TICK;
/// 2100-01-01T00:00:00Z, in timestamps: one beyond it is of no clock. They have room for four years more.
const LATEST: u64 = (4_102_444_800_000_000 - EPOCH_UNIX_US) / MICROSECONDS_PER_TICK;
/// 2025-01-01T00:00:00Z, in timestamps: this program is younger, and a clock before it has never been set.
const CLOCK_SET: u64 = (1_735_689_600_000_000 - EPOCH_UNIX_US) / MICROSECONDS_PER_TICK;
/// The first frame of a stream may be this much behind the latest timestamp known.
const NEW_STREAM_LAG: u64 = 60 * TICKS_PER_SECOND;
/// A stream may begin this far ahead of this machine's clock, and the record be so: more is a clock that nobody has set,
/// which would drag every other after it. A stream that goes on may leap (an autopilot's, when it hears GPS).
const CLOCKS_APART: u64 = 30 * 86_400 * TICKS_PER_SECOND;

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
    /// The record of timestamps is of another time.
    #[error(
        "the signing timestamps in {} reach to {recorded}, and this machine's clock says {clock}: set the clock; if it is right, delete the file",
        path.display()
    )]
    StateFileAhead {
        /// Its path.
        path: PathBuf,
        /// What is on record.
        recorded: Utc,
        /// What this machine's clock says.
        clock: Utc,
    },
}

/// No timestamp is left that could sign the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("no signing timestamp is left: this machine's clock, or that of the other end, is beyond 2100")]
pub struct NoTimestamp;

/// One stream of signed frames: MAVLink system, component and link id.
pub type Stream = (u32, u8, u8);

/// Where a proven frame stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// Its stream.
    pub stream: Stream,
    /// Its timestamp.
    pub timestamp: u64,
}

impl Stamp {
    /// The sender's time, which is its clock's or later.
    #[must_use]
    pub fn utc(&self) -> Utc {
        utc_of(self.timestamp)
    }
}

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
    /// The latest timestamp of each stream.
    streams: BTreeMap<Stream, u64>,
    reserve: Reserve,
}

impl Signing {
    /// Takes up signing where the last run left off.
    ///
    /// # Errors
    /// If the record of timestamps can't be read, is of another time, is in use, or cannot be written.
    pub fn open(config: SigningConfig, utc: Utc) -> Result<Self, SigningError> {
        let (recorder, recorded) = Recorder::open(config.state_file.clone(), timestamp(utc))?;
        Ok(Self::with_keeper(config, Box::new(recorder), recorded))
    }

    /// The same on a record of any kind, which `recorded` is the last word of: anything up to there may have been used
    /// and accepted before.
    #[must_use]
    pub fn with_keeper(config: SigningConfig, keeper: Box<dyn Keeper>, recorded: u64) -> Self {
        Self {
            key: config.key,
            link_id: config.link_id,
            unsigned_allowed: config.unsigned_allowed,
            latest: recorded,
            floor: recorded,
            streams: BTreeMap::new(),
            reserve: Reserve::new(keeper),
        }
    }

    /// Fills in the signature of a frame that [`super::codec::Encoder::encode_for_signing`] made.
    ///
    /// # Errors
    /// [`NoTimestamp`]: the frame must not be sent.
    pub fn sign(&mut self, raw: &mut MAVLinkV2MessageRaw, utc: Utc) -> Result<(), NoTimestamp> {
        let next = timestamp(utc).max(self.latest + 1);
        if next > LATEST {
            return Err(NoTimestamp);
        }
        self.use_up_to(next);
        let bytes = next.to_le_bytes();
        raw.signature_timestamp_bytes_mut().copy_from_slice(&bytes[..consts::v2::SIGNATURE_TIMESTAMP_SIZE]);
        *raw.signature_link_id_mut() = self.link_id;
        let signature = self.key.signature(raw);
        raw.signature_value_mut().copy_from_slice(&signature);
        Ok(())
    }

    /// Whether a frame proves that its sender has the key: where it stands then, whatever its time; `None` for what is
    /// accepted without proof, by the allow-list.
    ///
    /// # Errors
    /// [`Rejection::Unsigned`], [`Rejection::WrongSignature`].
    pub fn prove(&self, frame: &RawFrame) -> Result<Option<Stamp>, Rejection> {
        let raw = match frame {
            RawFrame::V2(raw) if frame.is_signed() => raw,
            _ if self.unsigned_allowed.contains(&frame.message_id()) => return Ok(None),
            _ => return Err(Rejection::Unsigned),
        };
        if self.key.signature(raw) != raw.signature_value() {
            return Err(Rejection::WrongSignature);
        }
        let stream = (raw.system_id(), raw.component_id(), raw.signature_link_id());
        Ok(Some(Stamp { stream, timestamp: raw.signature_timestamp() }))
    }

    /// Judges the time of a proven frame. One that answers a challenge of ours is no replay of this run's, and may be as
    /// far behind as it likes, but for what an earlier run has accepted.
    ///
    /// # Errors
    /// Why the frame must be ignored.
    pub fn judge(&self, stamp: Stamp, answers: bool, utc: Utc) -> Result<(), Rejection> {
        let Stamp { stream, timestamp: received } = stamp;
        let now = timestamp(utc).max(self.latest);
        let lag = if answers { now } else { NEW_STREAM_LAG };
        match self.streams.get(&stream) {
            _ if received > LATEST => Err(Rejection::TooNew),
            Some(&last) if received <= last => Err(Rejection::Replayed),
            Some(_) => Ok(()),
            None if received <= self.floor.max(now.saturating_sub(lag)) => Err(Rejection::TooOld),
            None if received > furthest(now) => Err(Rejection::TooNew),
            None => Ok(()),
        }
    }

    /// Takes the time of a frame that passed: what we sign from now on is later, so that its sender hears us.
    pub fn keep_up(&mut self, stamp: Stamp) {
        if stamp.timestamp > self.latest {
            self.use_up_to(stamp.timestamp);
        }
    }

    /// Accepts a frame that passed: it is old from now on.
    pub fn accept(&mut self, stamp: Stamp) {
        self.keep_up(stamp);
        self.streams.insert(stamp.stream, stamp.timestamp);
    }

    /// Judges a received frame, and accepts it. `Ok(true)`: its sender has the key and it is new. `Ok(false)`: accepted
    /// without proof, by the allow-list.
    ///
    /// # Errors
    /// Why the frame must be ignored. A frame turned away changes nothing here.
    pub fn verify(&mut self, frame: &RawFrame, utc: Utc) -> Result<bool, Rejection> {
        let Some(stamp) = self.prove(frame)? else { return Ok(false) };
        self.judge(stamp, false, utc)?;
        self.accept(stamp);
        Ok(true)
    }

    /// How many timestamps went into use before they were on record.
    #[must_use]
    pub fn unrecorded(&self) -> u64 {
        self.reserve.unrecorded()
    }

    /// How far this machine's clock is behind what it has signed for before; zero if a crash explains it.
    #[must_use]
    pub fn clock_behind(&self, utc: Utc) -> Duration {
        let explained = timestamp(utc) + BLOCK + NEW_STREAM_LAG;
        if self.floor <= explained {
            return Duration::ZERO;
        }
        Duration::from_micros((self.floor - timestamp(utc)) * MICROSECONDS_PER_TICK)
    }

    fn use_up_to(&mut self, timestamp: u64) {
        self.latest = timestamp;
        self.reserve.use_up_to(timestamp);
    }
}

impl Drop for Signing {
    fn drop(&mut self) {
        self.reserve.close(self.latest);
    }
}

/// The furthest timestamp that makes sense to whoever has this one: any, to a clock that has never been set.
fn furthest(now: u64) -> u64 {
    if now < CLOCK_SET { LATEST } else { LATEST.min(now.saturating_add(CLOCKS_APART)) }
}

/// The signing timestamp of an instant, 0 before 2015.
#[must_use]
pub fn timestamp(utc: Utc) -> u64 {
    utc.unix_us.saturating_sub(EPOCH_UNIX_US) / MICROSECONDS_PER_TICK
}

fn utc_of(timestamp: u64) -> Utc {
    Utc { unix_us: EPOCH_UNIX_US.saturating_add(timestamp.saturating_mul(MICROSECONDS_PER_TICK)) }
}
