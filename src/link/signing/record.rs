//! The ceiling of a link's timestamps on disk, raised ahead of use by a thread of its own.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

use super::{SigningError, TICKS_PER_SECOND};
use crate::durable::{replace, sibling};

/// How far the ceiling is raised above what is in use. After a crash, a peer that we cannot call is turned away
/// until its clock has passed the ceiling: no more than this. The file is written each half of it.
const WINDOW: u64 = 4 * TICKS_PER_SECOND;

/// What the thread has achieved.
#[derive(Debug, Default)]
struct Shared {
    /// The ceiling on disk.
    recorded: AtomicU64,
    /// The last attempt to raise it failed.
    failing: AtomicBool,
}

/// The record of one link.
#[derive(Debug)]
pub struct Record {
    shared: Arc<Shared>,
    requests: Option<SyncSender<u64>>,
    thread: Option<JoinHandle<()>>,
    /// The ceiling last asked for.
    requested: u64,
    /// The thread was still busy when the ceiling had to be raised again.
    stalled: bool,
}

impl Record {
    /// Reads the last run's ceiling, puts the first one of this run on disk, and returns the timestamp that
    /// this run starts from: `now` or the last run's ceiling, whichever is later.
    pub fn open(path: PathBuf, now: u64) -> Result<(Self, u64), SigningError> {
        let lock = lock(&path)?;
        let start = now.max(read(&path)?);
        let requested = start.saturating_add(WINDOW);
        let failed = |path: &Path, source| SigningError::StateFile { path: path.to_owned(), source };
        write(&path, requested).map_err(|source| failed(&path, source))?;
        let shared = Arc::new(Shared { recorded: requested.into(), failing: false.into() });
        let (requests, queue) = sync_channel(1);
        let result = Arc::clone(&shared);
        let thread_path = path.clone();
        let thread = std::thread::Builder::new()
            .name("signing".to_owned())
            .spawn(move || {
                // Held as long as this run may write.
                let _lock = lock;
                run(&thread_path, &queue, &result);
            })
            .map_err(|source| failed(&path, source))?;
        let record =
            Self { shared, requests: Some(requests), thread: Some(thread), requested, stalled: false };
        Ok((record, start))
    }

    /// Has the ceiling raised in good time for `timestamp`. Never waits.
    pub fn extend_beyond(&mut self, timestamp: u64) {
        if timestamp.saturating_add(WINDOW / 2) <= self.requested {
            return;
        }
        let ceiling = timestamp.saturating_add(WINDOW);
        match self.requests.as_ref().map(|requests| requests.try_send(ceiling)) {
            Some(Ok(())) => {
                self.requested = ceiling;
                self.stalled = false;
            }
            Some(Err(TrySendError::Full(_))) if !self.stalled => {
                self.stalled = true;
                tracing::warn!(
                    "signing: the disk is too slow to record timestamps; after a crash, only the clock protects from replay"
                );
            }
            _ => {}
        }
    }

    /// Whether `timestamp` is below the ceiling on disk.
    pub fn covers(&self, timestamp: u64) -> bool {
        timestamp <= self.shared.recorded.load(Ordering::Acquire)
    }

    /// Whether the disk fails or is too slow, so that timestamps must do without a record: a link that fell
    /// silent over a full disk would be the greater danger.
    pub fn is_unable(&self) -> bool {
        self.stalled || self.shared.failing.load(Ordering::Acquire)
    }

    /// Leaves `latest` on record, after which the next run need not skip anything.
    pub fn close(&mut self, latest: u64) {
        if let Some(requests) = self.requests.take() {
            // Waits for the thread, which does not outlive this either.
            requests.send(latest).ok();
        }
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn run(path: &Path, queue: &Receiver<u64>, result: &Shared) {
    while let Ok(ceiling) = queue.recv() {
        match write(path, ceiling) {
            Ok(()) => {
                result.recorded.store(ceiling, Ordering::Release);
                result.failing.store(false, Ordering::Release);
            }
            Err(error) => {
                if !result.failing.swap(true, Ordering::AcqRel) {
                    tracing::warn!(path = %path.display(), %error, "signing: timestamps cannot be recorded; after a crash, only the clock protects from replay");
                }
            }
        }
    }
}

fn lock(path: &Path) -> Result<File, SigningError> {
    let failed = |source| SigningError::StateFile { path: path.to_owned(), source };
    let options = OpenOptions::new().write(true).create(true).truncate(false).clone();
    let file = options.open(sibling(path, ".lock")).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(SigningError::StateFileInUse { path: path.to_owned() }),
        Err(TryLockError::Error(source)) => Err(failed(source)),
    }
}

fn read(path: &Path) -> Result<u64, SigningError> {
    match fs::read_to_string(path) {
        Ok(text) => text.trim().parse().map_err(|_| SigningError::StateFileContent { path: path.to_owned() }),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
        Err(source) => Err(SigningError::StateFile { path: path.to_owned(), source }),
    }
}

fn write(path: &Path, ceiling: u64) -> io::Result<()> {
    replace(path, &format!("{ceiling}\n"))
}
