//! Recorded flights: one directory for each start of a companion or of a radio host, in the log directory.
//!
//! A directory is made and never taken again, so that no start costs an earlier flight. Its name tells UTC, mission and
//! vehicle, and ends in a number that is larger than those of all earlier ones: the order of starts, whatever the clock
//! said. What must outlive a start (orders, kill, timestamps of signatures) stays beside these directories.

pub mod bundle;
mod entry;
mod quota;
mod running;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

pub use entry::{End, Ended, Entry, Record, Verdict};
pub use quota::{Limits, Quota};
pub use running::{Running, Start};

use crate::role::Role;
use crate::time::Utc;

/// What a directory that is being removed is called before it is empty.
const REMOVING: &str = ".removing-";
/// The mission's part of a name has at most so many characters.
const MISSION_CHARS: usize = 32;
/// So many names are tried: those of processes that start at the same time.
const NAMES: u64 = 1000;

/// Why flights cannot be recorded or listed.
#[derive(Debug, thiserror::Error)]
pub enum LogbookError {
    /// The log directory cannot be read.
    #[error("cannot read the log directory {}: {source}; give the directory that [log] dir names", path.display())]
    Read {
        /// The directory.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// No directory can be made, or nothing be written into it.
    #[error(
        "cannot record the flight in {}: {source}; give [log] dir a directory that can be written, with room on its disk",
        path.display()
    )]
    Write {
        /// What could not be written.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Who records.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Writer {
    /// The companion of a vehicle.
    Companion(Role),
    /// A radio host.
    Radio,
}

impl Writer {
    /// Its word in names: `i`, `j`, `radio`.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Companion(role) => role.key(),
            Self::Radio => "radio",
        }
    }

    fn of_key(key: &str) -> Option<Self> {
        [Self::Companion(Role::I), Self::Companion(Role::J), Self::Radio]
            .into_iter()
            .find(|writer| writer.key() == key)
    }
}

/// The flights of a log directory.
#[derive(Debug, Clone)]
pub struct Logbook {
    root: PathBuf,
}

impl Logbook {
    /// Of this directory.
    #[must_use]
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// All flights, in the order of their starts. What has no name of a flight is somebody else's.
    ///
    /// # Errors
    /// [`LogbookError::Read`].
    pub fn entries(&self) -> Result<Vec<Entry>, LogbookError> {
        let fault = |source| LogbookError::Read { path: self.root.clone(), source };
        let mut entries = Vec::new();
        for found in fs::read_dir(&self.root).map_err(fault)? {
            let found = found.map_err(fault)?;
            let Some(name) = found.file_name().to_str().and_then(Name::parse) else { continue };
            // One that is being removed may be gone by now.
            if found.file_type().is_ok_and(|kind| kind.is_dir()) {
                entries.push(Entry::of(&found.path(), name));
            }
        }
        entries.sort_by(|a, b| (a.number, &a.name).cmp(&(b.number, &b.name)));
        Ok(entries)
    }

    /// Makes a directory that nobody had before.
    fn make(&self, utc: Utc, mission: &str, writer: Writer) -> Result<(Name, PathBuf), LogbookError> {
        let fault = |path: &Path, source| LogbookError::Write { path: path.to_owned(), source };
        fs::create_dir_all(&self.root).map_err(|error| fault(&self.root, error))?;
        let numbers = fs::read_dir(&self.root).map_err(|error| fault(&self.root, error))?;
        let numbers =
            numbers.flatten().filter_map(|found| Some(Name::parse(found.file_name().to_str()?)?.number));
        let first = numbers.max().map_or(1, |number| number.saturating_add(1));
        let mut last_fault = None;
        for number in first..first.saturating_add(NAMES) {
            let name = Name::new(utc, mission, writer, number);
            let path = self.root.join(&name.text);
            match fs::create_dir(&path) {
                Ok(()) => {
                    crate::durable::sync_directory_of(&path).map_err(|error| fault(&path, error))?;
                    return Ok((name, path));
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                    last_fault = Some((path, error))
                }
                Err(error) => return Err(fault(&path, error)),
            }
        }
        let (path, error) =
            last_fault.unwrap_or_else(|| (self.root.clone(), io::ErrorKind::AlreadyExists.into()));
        Err(fault(&path, error))
    }

    /// Removes a flight: first its name, so that what a power cut leaves of it is known for what it is.
    fn remove(&self, entry: &Entry) -> io::Result<()> {
        let marked = self.root.join(format!("{REMOVING}{}", entry.name));
        fs::rename(&entry.path, &marked)?;
        fs::remove_dir_all(&marked)
    }

    /// Finishes what a power cut left of a removal.
    fn clear(&self) {
        let Ok(found) = fs::read_dir(&self.root) else { return };
        for found in found.flatten() {
            if found.file_name().to_str().is_some_and(|name| name.starts_with(REMOVING)) {
                // Somebody else may be at it.
                fs::remove_dir_all(found.path()).ok();
            }
        }
    }
}

/// A directory's name: `20261123T113957Z-courtyard-i-0007`.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Name {
    text: String,
    mission: String,
    writer: Writer,
    number: u64,
}

impl Name {
    fn new(utc: Utc, mission: &str, writer: Writer, number: u64) -> Self {
        let mission = plain(mission);
        let text = format!("{}-{mission}-{}-{number:04}", stamp(utc), writer.key());
        Self { text, mission, writer, number }
    }

    fn parse(text: &str) -> Option<Self> {
        let (stamp, rest) = text.split_once('-')?;
        let digits =
            |part: Option<&str>| part.is_some_and(|part| part.bytes().all(|byte| byte.is_ascii_digit()));
        let is_stamp = stamp.len() >= 16
            && stamp.ends_with('Z')
            && stamp.as_bytes().get(stamp.len() - 8) == Some(&b'T')
            && digits(stamp.get(..stamp.len() - 8))
            && digits(stamp.get(stamp.len() - 7..stamp.len() - 1));
        let (rest, number) = rest.rsplit_once('-')?;
        let (mission, writer) = rest.rsplit_once('-')?;
        if !is_stamp || !digits(Some(number)) {
            return None;
        }
        let (writer, number) = (Writer::of_key(writer)?, number.parse().ok()?);
        Some(Self { text: text.to_owned(), mission: mission.to_owned(), writer, number })
    }
}

/// UTC to the second, in digits: `20261123T113957Z`.
fn stamp(utc: Utc) -> String {
    let second = Utc { unix_us: utc.unix_us - utc.unix_us % 1_000_000 };
    second.to_string().chars().filter(|c| !matches!(c, '-' | ':')).collect()
}

/// A mission's name as every file system takes it.
fn plain(mission: &str) -> String {
    let mut plain = String::new();
    for c in mission.chars().take(MISSION_CHARS) {
        match c {
            c if c.is_ascii_alphanumeric() || c == '_' => plain.push(c),
            _ if plain.ends_with('-') => {}
            _ => plain.push('-'),
        }
    }
    let plain = plain.trim_matches('-');
    if plain.is_empty() { "mission".to_owned() } else { plain.to_owned() }
}

#[cfg(test)]
mod tests;
