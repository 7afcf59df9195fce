//! One recorded flight as it is found, and what it says of itself.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::running::LOCK;
use super::{Name, Writer};
use crate::link::TlogReader;
use crate::time::Utc;

/// What a flight says of itself, in `log-<writer>.json`: at its start, and again with its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// `veilwing-log/1`.
    pub format: String,
    /// `i`, `j` or `radio`.
    pub writer: String,
    /// The mission's name.
    #[serde(default)]
    pub mission: Option<String>,
    /// The mission's digest, in hex.
    #[serde(default)]
    pub mission_digest: Option<String>,
    /// When it began, by this computer's clock.
    pub started_utc: String,
    /// The same, in microseconds since 1970.
    pub started_unix_us: u64,
    /// Whose version wrote it.
    pub version: String,
    /// How it ended; `None` while it runs, and if it was cut off.
    #[serde(default)]
    pub end: Option<End>,
}

impl Record {
    /// The format's name and version.
    pub const FORMAT: &str = "veilwing-log/1";

    /// Its file in a flight's directory.
    #[must_use]
    pub fn file_name(writer: Writer) -> String {
        format!("log-{}.json", writer.key())
    }
}

/// How a flight ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct End {
    /// In a word.
    pub result: Ended,
    /// Why, where it was not completed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// From its start, by a clock that nobody sets.
    pub duration_s: f64,
}

/// In a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ended {
    /// The mission was completed.
    Completed,
    /// It was given up.
    Aborted,
    /// Somebody asked the process to stop.
    Interrupted,
    /// The process could not do its work.
    Failed,
}

/// How a flight stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It said how it ended.
    Ended(Ended),
    /// It is being recorded now.
    Running,
    /// Its writer was killed, or the power went: it said nothing.
    CutOff,
}

impl Verdict {
    /// In a word or two.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ended(Ended::Completed) => "completed",
            Self::Ended(Ended::Aborted) => "aborted",
            Self::Ended(Ended::Interrupted) => "interrupted",
            Self::Ended(Ended::Failed) => "failed",
            Self::Running => "running",
            Self::CutOff => "cut off",
        }
    }
}

/// A recorded flight.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Its directory.
    pub path: PathBuf,
    /// The directory's name.
    pub name: String,
    /// The mission's name, or the radio's system, as the directory's name has it.
    pub mission: String,
    /// Who recorded it.
    pub writer: Writer,
    /// The order of starts.
    pub number: u64,
    /// What it says of itself; `None`: a power cut came before that.
    pub record: Option<Record>,
    /// Somebody holds its lock.
    pub running: bool,
    /// On disk.
    pub bytes: u64,
}

impl Entry {
    pub(super) fn of(path: &Path, name: Name) -> Self {
        let Name { text, mission, writer, number } = name;
        let record = fs::read_to_string(path.join(Record::file_name(writer)));
        let record = record.ok().and_then(|text| serde_json::from_str(&text).ok());
        let bytes =
            files(path).iter().filter_map(|file| fs::metadata(file).ok()).map(|data| data.len()).sum();
        Self {
            path: path.to_owned(),
            name: text,
            mission,
            writer,
            number,
            record,
            running: is_locked(path),
            bytes,
        }
    }

    /// How it stands.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        match self.record.as_ref().and_then(|record| record.end.as_ref()) {
            Some(end) => Verdict::Ended(end.result),
            None if self.running => Verdict::Running,
            None => Verdict::CutOff,
        }
    }

    /// Why it was not completed, if it says so.
    #[must_use]
    pub fn cause(&self) -> Option<&str> {
        self.record.as_ref()?.end.as_ref()?.cause.as_deref()
    }

    /// How long it was; of one that said no end, as far as its telemetry goes.
    #[must_use]
    pub fn duration(&self) -> Option<Duration> {
        if let Some(end) = self.record.as_ref().and_then(|record| record.end.as_ref()) {
            return Duration::try_from_secs_f64(end.duration_s).ok();
        }
        let spans = files(&self.path).into_iter().filter_map(|file| span(&file));
        let [first, last] = spans.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
        Some(last.saturating_since(first))
    }

    /// Its start and its end, by its computer's clock.
    #[must_use]
    pub fn interval(&self) -> Option<[Utc; 2]> {
        let start = Utc { unix_us: self.record.as_ref()?.started_unix_us };
        Some([start, start + self.duration().unwrap_or_default()])
    }
}

/// The files of a flight, by name; its lock is none of them.
pub(super) fn files(path: &Path) -> Vec<PathBuf> {
    let Ok(found) = fs::read_dir(path) else { return Vec::new() };
    let files = found.flatten().filter(|file| file.file_name() != LOCK);
    let mut files: Vec<PathBuf> = files.map(|file| file.path()).filter(|path| path.is_file()).collect();
    files.sort();
    files
}

/// The stamps of a telemetry log's first and last record: as far as it can be read.
fn span(file: &Path) -> Option<[Utc; 2]> {
    if file.extension()? != "tlog" {
        return None;
    }
    let mut stamps = TlogReader::open(file).ok()?.map_while(Result::ok).map(|(utc, _)| utc);
    let first = stamps.next()?;
    Some([first, stamps.last().unwrap_or(first)])
}

fn is_locked(path: &Path) -> bool {
    File::open(path.join(LOCK))
        .is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
}
