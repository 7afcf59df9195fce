//! Files that grow record by record, from a thread of their own: neither a slow nor a full disk holds up the caller.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Records that wait for the disk: some seconds of a busy link.
const QUEUE_RECORDS: usize = 4096;
/// What is written at once, about.
const BATCH_BYTES: usize = 64 * 1024;

/// A record, as it stands in its file.
pub trait Append: Send + 'static {
    /// Appends it to what is written next.
    fn append_to(&self, batch: &mut Vec<u8>);
}

/// Text is its own record.
impl Append for Vec<u8> {
    fn append_to(&self, batch: &mut Vec<u8>) {
        batch.extend_from_slice(self);
    }
}

/// Who keeps room on the disk: asked from the files' own threads.
pub trait Room: Send + Sync + fmt::Debug {
    /// A file has grown by so many bytes.
    fn grown(&self, bytes: u64);
    /// The disk is full: makes room, if that can be done. Whether it was.
    fn make(&self) -> bool;
}

/// How a file is kept.
#[derive(Debug, Clone, Default)]
pub struct Keeping {
    /// An earlier file of that name is an error, and not emptied.
    pub new: bool,
    /// On disk for good after about so many bytes: what a power cut costs at the most. `None`: when the system likes.
    pub sync_bytes: Option<u64>,
    /// Told of growth, asked for room.
    pub room: Option<Arc<dyn Room>>,
}

/// Told when the disk begins to take nothing, with why, and when it takes records again.
pub type Told = fn(&Path, Option<&io::Error>);

/// Appends records to a file. Dropping it writes what is still queued.
#[derive(Debug)]
pub struct Appender<T> {
    queue: Option<SyncSender<T>>,
    dropped: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl<T: Append> Appender<T> {
    /// Creates the file, or empties the one that is there unless it must be new.
    ///
    /// # Errors
    /// The file cannot be created, or no thread be started.
    pub fn start(path: &Path, keeping: Keeping, told: Told) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.write(true);
        if keeping.new {
            options.create_new(true)
        } else {
            options.create(true).truncate(true)
        };
        let file = options.open(path)?;
        if keeping.sync_bytes.is_some() {
            // Its name is on disk when the directory is.
            super::sync_directory_of(path)?;
        }
        let (queue, records) = sync_channel(QUEUE_RECORDS);
        let dropped = Arc::new(AtomicU64::new(0));
        let disk =
            Disk { file, path: path.to_owned(), keeping, told, good_bytes: 0, unsynced: 0, failing: false };
        let lost = Arc::clone(&dropped);
        let thread =
            std::thread::Builder::new().name("append".to_owned()).spawn(move || disk.run(&records, &lost))?;
        Ok(Self { queue: Some(queue), dropped, thread: Some(thread) })
    }

    /// Queues a record. Never waits.
    pub fn push(&self, record: T) {
        let queued = self.queue.as_ref().is_some_and(|queue| queue.try_send(record).is_ok());
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

impl<T> Drop for Appender<T> {
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
    keeping: Keeping,
    told: Told,
    /// Up to here the file holds whole records.
    good_bytes: u64,
    /// Written, and perhaps not on disk yet.
    unsynced: u64,
    failing: bool,
}

impl Disk {
    fn run<T: Append>(mut self, records: &Receiver<T>, lost: &AtomicU64) {
        let mut batch = Vec::with_capacity(BATCH_BYTES + 1024);
        while let Ok(first) = records.recv() {
            batch.clear();
            let mut count = 0;
            let mut next = Some(first);
            while let Some(record) = next {
                record.append_to(&mut batch);
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
        if self.keeping.sync_bytes.is_some() {
            // Nobody is left to be told.
            self.file.sync_data().ok();
        }
    }

    fn write(&mut self, batch: &[u8]) -> io::Result<()> {
        let mut written = self.write_whole(batch);
        if let (Err(error), Some(room)) = (&written, &self.keeping.room)
            && matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
            && room.make()
        {
            written = self.write_whole(batch);
        }
        written?;
        let bytes = batch.len() as u64;
        self.unsynced += bytes;
        if self.keeping.sync_bytes.is_some_and(|most| self.unsynced >= most) {
            self.file.sync_data()?;
            self.unsynced = 0;
        }
        if let Some(room) = &self.keeping.room {
            room.grown(bytes);
        }
        Ok(())
    }

    /// Writes all of `batch` or, as far as the disk lets us, nothing: half a record would hide all that follow.
    fn write_whole(&mut self, batch: &[u8]) -> io::Result<()> {
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
            (self.told)(&self.path, Some(error));
        }
    }

    fn report_recovery(&mut self) {
        if self.failing {
            self.failing = false;
            (self.told)(&self.path, None);
        }
    }
}
