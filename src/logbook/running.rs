//! A flight that is being recorded.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::entry::{End, Ended, Record};
use super::quota::{Limits, Quota};
use super::{Logbook, LogbookError, Writer};
use crate::durable::append::{Keeping, Room};
use crate::durable::replace;
use crate::time::Utc;

/// Whoever holds this file's lock records the flight.
pub(super) const LOCK: &str = "lock";
/// What a power cut may cost of a log: a second or two of a busy link.
const SYNC_BYTES: u64 = 16 * 1024;

/// What begins.
#[derive(Debug, Clone)]
pub struct Start<'a> {
    /// Who records.
    pub writer: Writer,
    /// The mission's name, or a radio's number.
    pub mission: &'a str,
    /// The mission's digest, where there is one.
    pub mission_digest: Option<String>,
    /// By this computer's clock.
    pub utc: Utc,
}

/// A flight that is being recorded. Nobody removes it before this is dropped; without [`Running::end`] it is one that was cut
/// off.
#[derive(Debug)]
pub struct Running {
    root: PathBuf,
    path: PathBuf,
    writer: Writer,
    record: Record,
    quota: Arc<Quota>,
    /// Work that ends before the flight's record does.
    work: Mutex<Vec<JoinHandle<()>>>,
    _lock: File,
}

impl Running {
    /// Makes room, and a directory for a flight that begins.
    ///
    /// # Errors
    /// [`LogbookError`]; earlier flights are as they were.
    pub fn begin(root: &Path, limits: Limits, start: &Start<'_>) -> Result<Self, LogbookError> {
        let book = Logbook::new(root);
        book.clear();
        let quota = Arc::new(Quota::new(book.clone(), limits));
        // Before, since a disk may be full.
        quota.keep();
        let (name, path) = book.make(start.utc, start.mission, start.writer)?;
        let fault = |source| LogbookError::Write { path: path.clone(), source };
        let lock = File::create_new(path.join(LOCK)).map_err(fault)?;
        lock.lock().map_err(fault)?;
        let record = Record {
            format: Record::FORMAT.to_owned(),
            writer: name.writer.key().to_owned(),
            mission: start.mission_digest.is_some().then(|| start.mission.to_owned()),
            mission_digest: start.mission_digest.clone(),
            started_utc: start.utc.to_string(),
            started_unix_us: start.utc.unix_us,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            end: None,
        };
        let root = root.to_owned();
        let running =
            Self { root, path, writer: start.writer, record, quota, work: Mutex::default(), _lock: lock };
        running
            .write(&running.record)
            .map_err(|source| LogbookError::Write { path: running.path.clone(), source })?;
        Ok(running)
    }

    /// The flight's directory.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How its logs are kept: new, on disk within a second or two, room made for them.
    #[must_use]
    pub fn keeping(&self) -> Keeping {
        let room: Arc<dyn Room> = Arc::<Quota>::clone(&self.quota);
        Keeping { new: true, sync_bytes: Some(SYNC_BYTES), room: Some(room) }
    }

    /// Keeps a file of this content, on disk when this returns.
    ///
    /// # Errors
    /// [`LogbookError::Write`].
    pub fn keep(&self, name: &str, content: &str) -> Result<(), LogbookError> {
        let path = self.path.join(name);
        replace(&path, content).map_err(|source| LogbookError::Write { path, source })
    }

    /// Shows a log of the flight in the log directory itself, where one of that name was before there were directories. One
    /// that is still there is kept, under another name.
    ///
    /// # Errors
    /// The file system has no links, or takes none: nothing depends on them.
    pub fn show(&self, log: &str) -> io::Result<()> {
        let shown = self.root.join(log);
        if shown.symlink_metadata().is_ok_and(|data| data.is_file()) {
            let (stem, ending) = log.rsplit_once('.').unwrap_or((log, "log"));
            let names = (1..).map(|number| self.root.join(format!("{stem}.{number}.{ending}")));
            if let Some(free) = names.into_iter().find(|path| path.symlink_metadata().is_err()) {
                std::fs::rename(&shown, free)?;
            }
        }
        let directory = self.path.file_name().map(Path::new).unwrap_or(&self.path);
        let beside = self.root.join(format!(".{log}.{}", std::process::id()));
        std::os::unix::fs::symlink(directory.join(log), &beside)?;
        std::fs::rename(&beside, &shown)
    }

    /// Has work done on the flight's files that the end waits for.
    pub fn add_work(&self, work: JoinHandle<()>) {
        self.work.lock().unwrap_or_else(PoisonError::into_inner).push(work);
    }

    /// Says how it ended. The disk may be full: then it stays one that was cut off.
    ///
    /// # Errors
    /// [`LogbookError::Write`].
    pub fn end(&self, result: Ended, cause: Option<String>, duration: Duration) -> Result<(), LogbookError> {
        for work in self.work.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
            // What it could not do, it has said.
            drop(work.join());
        }
        let end = Some(End { result, cause, duration_s: duration.as_secs_f64() });
        self.write(&Record { end, ..self.record.clone() })
            .map_err(|source| LogbookError::Write { path: self.path.clone(), source })
    }

    fn write(&self, record: &Record) -> io::Result<()> {
        let text = serde_json::to_string_pretty(record).map_err(io::Error::other)?;
        replace(&self.path.join(Record::file_name(self.writer)), &format!("{text}\n"))
    }
}
