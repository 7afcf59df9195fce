//! Telemetry logs as ground stations read them: before each frame its UTC in microseconds, 8 bytes, big-endian.
//! Frames of both directions, without signatures (a signed log could be replayed, and is larger).

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use mavlink::{MAV_STX, MAV_STX_V2, consts};

use super::frame::RawFrame;
use crate::durable::append::{Append, Appender, Keeping};
use crate::mission::Notice;
use crate::time::Utc;

const STAMP_BYTES: usize = 8;

/// Why a telemetry log cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum TlogError {
    /// The file cannot be created.
    #[error("cannot create the telemetry log {}: {source}; check that its directory exists and can be written to", path.display())]
    Create {
        /// Its path.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The file cannot be read.
    #[error("cannot read the telemetry log: {0}")]
    Read(#[from] io::Error),
    /// The log ends inside a record: whoever wrote it was cut off. The records before are good.
    #[error(
        "the telemetry log ends inside the record at byte {offset}: its writer was cut off; the records before are good"
    )]
    Truncated {
        /// Where the record begins.
        offset: u64,
    },
    /// There is no frame where one should be.
    #[error("the telemetry log is damaged at byte {offset}: no MAVLink frame follows the time stamp")]
    Damaged {
        /// Where the record begins.
        offset: u64,
    },
}

type Record = (Utc, RawFrame);

impl Append for Record {
    fn append_to(&self, batch: &mut Vec<u8>) {
        append_record(batch, self.0, self.1.bytes());
    }
}

/// Writes a telemetry log from a thread of its own: neither a slow nor a full disk holds up the caller.
/// Dropping it writes what is still queued.
#[derive(Debug)]
pub struct TlogWriter(Appender<Record>);

impl TlogWriter {
    /// Creates the log, or empties the one that is there.
    ///
    /// # Errors
    /// [`TlogError::Create`].
    pub fn create(path: &Path) -> Result<Self, TlogError> {
        Self::keep(path, Keeping::default())
    }

    /// Creates the log, to be kept like this.
    ///
    /// # Errors
    /// [`TlogError::Create`].
    pub fn keep(path: &Path, keeping: Keeping) -> Result<Self, TlogError> {
        let failed = |source| TlogError::Create { path: path.to_owned(), source };
        Appender::start(path, keeping, told).map(Self).map_err(failed)
    }

    /// Queues a frame, whose signature must be gone ([`RawFrame::without_signature`]). Never waits.
    pub fn record(&self, utc: Utc, frame: RawFrame) {
        self.0.push((utc, frame));
    }

    /// Records lost so far: the disk was slow or full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.0.dropped()
    }
}

/// Says in the log that a file's disk takes nothing, and that it takes records again.
pub fn told(path: &Path, error: Option<&io::Error>) {
    let path = path.display();
    match error {
        Some(error) => tracing::warn!(%path, %error, "{}", Notice::LosingLog),
        None => tracing::info!(%path, "{}", Notice::LogTakenAgain),
    }
}

/// Appends one record: the bytes of a frame without a signature, and its time.
pub fn append_record(batch: &mut Vec<u8>, utc: Utc, frame: &[u8]) {
    batch.extend_from_slice(&utc.unix_us.to_be_bytes());
    batch.extend_from_slice(frame);
}

/// Reads a telemetry log, record by record. After an error it ends.
#[derive(Debug)]
pub struct TlogReader<R> {
    source: R,
    offset: u64,
    ended: bool,
}

impl TlogReader<BufReader<File>> {
    /// Opens a log.
    ///
    /// # Errors
    /// [`TlogError::Read`].
    pub fn open(path: &Path) -> Result<Self, TlogError> {
        Ok(Self::new(BufReader::new(File::open(path)?)))
    }
}

impl<R: Read> TlogReader<R> {
    /// Reads a log from its beginning.
    pub fn new(source: R) -> Self {
        Self { source, offset: 0, ended: false }
    }

    fn read_record(&mut self) -> Result<Option<Record>, TlogError> {
        let mut stamp = [0; STAMP_BYTES];
        match self.read_some(&mut stamp)? {
            0 => return Ok(None),
            STAMP_BYTES => {}
            _ => return Err(TlogError::Truncated { offset: self.offset }),
        }
        let mut frame = [0; consts::MAX_FRAME_SIZE];
        // Both versions' marker, payload length and incompatibility flags (MAVLink 1: sequence) tell the length.
        const PREFIX: usize = consts::v2::INCOMPAT_FLAGS_OFFSET + 1;
        self.read_whole(&mut frame[..PREFIX])?;
        let payload = usize::from(frame[consts::PAYLOAD_LEN_OFFSET]);
        let rest = match frame[0] {
            MAV_STX => consts::v1::HEADER_SIZE,
            MAV_STX_V2 if frame[2] & consts::v2::IFLAG_SYSID32 != 0 => consts::v2::MAX_HEADER_SIZE,
            MAV_STX_V2 => consts::v2::MIN_HEADER_SIZE,
            _ => return Err(TlogError::Damaged { offset: self.offset }),
        };
        let signed = frame[0] == MAV_STX_V2 && frame[2] & consts::v2::IFLAG_SIGNED != 0;
        let signature = if signed { consts::v2::SIGNATURE_SIZE } else { 0 };
        let length = consts::STX_SIZE + rest + payload + consts::CHECKSUM_SIZE + signature;
        self.read_whole(&mut frame[PREFIX..length])?;
        let raw = RawFrame::from_bytes(&frame[..length]).ok_or(TlogError::Damaged { offset: self.offset })?;
        self.offset += (STAMP_BYTES + length) as u64;
        Ok(Some((Utc { unix_us: u64::from_be_bytes(stamp) }, raw)))
    }

    fn read_whole(&mut self, buffer: &mut [u8]) -> Result<(), TlogError> {
        match self.read_some(buffer)? {
            read if read == buffer.len() => Ok(()),
            _ => Err(TlogError::Truncated { offset: self.offset }),
        }
    }

    /// Fills `buffer` as far as the source goes.
    fn read_some(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.source.read(&mut buffer[filled..]) {
                Ok(0) => break,
                Ok(read) => filled += read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(filled)
    }
}

impl<R: Read> Iterator for TlogReader<R> {
    type Item = Result<Record, TlogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let record = self.read_record().transpose();
        self.ended = !matches!(record, Some(Ok(_)));
        record
    }
}
