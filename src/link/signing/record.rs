//! The ceiling of a link's timestamps on disk, raised by a thread of its own.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use super::reserve::{BLOCK, Keeper};
use super::{SigningError, furthest, utc_of};
use crate::durable::{replace, sibling};

/// The record of one link.
#[derive(Debug)]
pub(super) struct Recorder {
    /// The ceiling on disk.
    recorded: Arc<AtomicU64>,
    requests: Option<SyncSender<u64>>,
    thread: Option<JoinHandle<()>>,
}

impl Recorder {
    /// Reads the last run's ceiling, puts the first one of this run on disk, and returns the timestamp that this run
    /// starts from: `now` or the last run's ceiling, whichever is later.
    pub(super) fn open(path: PathBuf, now: u64) -> Result<(Self, u64), SigningError> {
        let lock = lock(&path)?;
        let last = read(&path)?;
        if last > furthest(now) {
            return Err(SigningError::StateFileAhead { path, recorded: utc_of(last), clock: utc_of(now) });
        }
        let start = now.max(last);
        let ceiling = start.saturating_add(BLOCK);
        let failed = |path: &Path, source| SigningError::StateFile { path: path.to_owned(), source };
        write(&path, ceiling).map_err(|source| failed(&path, source))?;
        let recorded = Arc::new(AtomicU64::new(ceiling));
        let (requests, queue) = sync_channel(1);
        let result = Arc::clone(&recorded);
        let thread_path = path.clone();
        let thread = std::thread::Builder::new()
            .name("signing".to_owned())
            .spawn(move || {
                // Held as long as this run may write.
                let _lock = lock;
                run(&thread_path, &queue, &result);
            })
            .map_err(|source| failed(&path, source))?;
        Ok((Self { recorded, requests: Some(requests), thread: Some(thread) }, start))
    }
}

impl Keeper for Recorder {
    fn keep(&mut self, ceiling: u64) -> bool {
        self.requests.as_ref().is_some_and(|requests| requests.try_send(ceiling).is_ok())
    }

    fn kept(&self) -> u64 {
        self.recorded.load(Ordering::Acquire)
    }

    fn close(&mut self, latest: u64) {
        if let Some(requests) = &self.requests {
            // Waits for the thread, which does not outlive this either.
            requests.send(latest).ok();
        }
        self.finish();
    }
}

impl Recorder {
    /// Takes no more, and waits until what was taken is on disk or has failed.
    pub(super) fn finish(&mut self) {
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn run(path: &Path, queue: &Receiver<u64>, recorded: &AtomicU64) {
    let mut failing = false;
    while let Ok(ceiling) = queue.recv() {
        match write(path, ceiling) {
            Ok(()) => {
                recorded.store(ceiling, Ordering::Release);
                failing = false;
            }
            Err(error) => {
                if !std::mem::replace(&mut failing, true) {
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
