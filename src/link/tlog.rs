//! Telemetry logs as ground stations read them: before each frame its UTC in microseconds, 8 bytes, big-endian.
//! Frames of both directions, without signatures (a signed log could be replayed, and is larger).

use std::fs::{File, OpenOptions};
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use mavlink::{MAV_STX, MAV_STX_V2, consts};

use super::frame::RawFrame;
use crate::mission::Notice;
use crate::time::Utc;

/// Records that wait for the disk: some seconds of a busy link.
const QUEUE_RECORDS: usize = 4096;
/// What is written at once, about.
const BATCH_BYTES: usize = 64 * 1024;
const STAMP_BYTES: usize = 8;
/// What is said when the disk takes no more, and when it does again.

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

/// Writes a telemetry log from a thread of its own: neither a slow nor a full disk holds up the caller.
/// Dropping it writes what is still queued.
#[derive(Debug)]
pub struct TlogWriter {
    queue: Option<SyncSender<Record>>,
    dropped: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl TlogWriter {
    /// Creates the log, or empties the one that is there.
    ///
    /// # Errors
    /// [`TlogError::Create`].
    pub fn create(path: &Path) -> Result<Self, TlogError> {
        let failed = |source| TlogError::Create { path: path.to_owned(), source };
        let file = OpenOptions::new().write(true).create(true).truncate(true).open(path).map_err(failed)?;
        let (queue, records) = sync_channel(QUEUE_RECORDS);
        let dropped = Arc::new(AtomicU64::new(0));
        let disk = Disk { file, path: path.to_owned(), good_bytes: 0, failing: false };
        let lost = Arc::clone(&dropped);
        let thread = std::thread::Builder::new()
            .name("tlog".to_owned())
            .spawn(move || disk.run(&records, &lost))
            .map_err(failed)?;
        Ok(Self { queue: Some(queue), dropped, thread: Some(thread) })
    }

    /// Queues a frame, whose signature must be gone ([`RawFrame::without_signature`]). Never waits.
    pub fn record(&self, utc: Utc, frame: RawFrame) {
        let queued = self.queue.as_ref().is_some_and(|queue| queue.try_send((utc, frame)).is_ok());
        if !queued {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Records lost so far: the disk was slow or full.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

impl Drop for TlogWriter {
    fn drop(&mut self) {
        // Without its sender the queue ends, and then the thread.
        self.queue = None;
        if let Some(thread) = self.thread.take() {
            // It cannot have panicked, and if it had, there would be nothing left to save.
            drop(thread.join());
        }
    }
}

/// The thread's side.
struct Disk {
    file: File,
    path: PathBuf,
    /// Up to here the file holds whole records.
    good_bytes: u64,
    failing: bool,
}

impl Disk {
    fn run(mut self, records: &Receiver<Record>, lost: &AtomicU64) {
        let mut batch = Vec::with_capacity(BATCH_BYTES + STAMP_BYTES + consts::MAX_FRAME_SIZE);
        while let Ok(first) = records.recv() {
            batch.clear();
            let mut count = 0;
            let mut next = Some(first);
            while let Some((utc, frame)) = next {
                append_record(&mut batch, utc, frame.bytes());
                count += 1;
                next = if batch.len() < BATCH_BYTES { records.try_recv().ok() } else { None };
            }
            match self.write(&batch) {
                Ok(()) => self.report_recovery(),
                Err(error) => {
                    lost.fetch_add(count, Ordering::Relaxed);
                    self.report_failure(&error);
                }
            }
        }
    }

    /// Writes all of `batch` or, as far as the disk lets us, nothing: half a record would hide all that follow.
    fn write(&mut self, batch: &[u8]) -> io::Result<()> {
        let written = self.file.write_all(batch);
        if written.is_err() {
            // On a disk that takes neither, the next write fails as well, and is as well reported.
            self.file.set_len(self.good_bytes).ok();
            self.file.seek(SeekFrom::Start(self.good_bytes)).ok();
        } else {
            self.good_bytes += batch.len() as u64;
        }
        written
    }

    fn report_failure(&mut self, error: &io::Error) {
        if !self.failing {
            self.failing = true;
            tracing::warn!(path = %self.path.display(), %error, "{}", Notice::LosingLog);
        }
    }

    fn report_recovery(&mut self) {
        if self.failing {
            self.failing = false;
            tracing::info!(path = %self.path.display(), "{}", Notice::LogTakenAgain);
        }
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
