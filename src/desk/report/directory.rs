//! A flight's directory: writing a [`Timeline`] into it and reading it back.

use std::io;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use super::table::{self, TableError};
use super::timeline::{Event, SCENE_FORMAT, Scene, Summary, Timeline};

/// What does not change.
pub const SCENE: &str = "scene.json";
/// Samples.
pub const TIMELINE: &str = "timeline.csv";
/// Events.
pub const EVENTS: &str = "events.jsonl";
/// The flight document.
pub const SUMMARY: &str = "summary.json";

/// Why a flight's directory cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// A file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// Which one.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// Which one.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A table that is none.
    #[error("{}: {source}", path.display())]
    Table {
        /// Which file.
        path: PathBuf,
        /// Where and what.
        source: TableError,
    },
    /// JSON that is none, or not what it should be.
    #[error("{}:{line}: {message}; the file is damaged or of another version", path.display())]
    Json {
        /// Which file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A scene of another kind.
    #[error("{}: format is {found:?}, should be {SCENE_FORMAT:?}: written by another version", path.display())]
    Format {
        /// Which file.
        path: PathBuf,
        /// Its format.
        found: String,
    },
    /// Files that do not belong together.
    #[error(
        "{}: {found} eavesdroppers, but {SCENE} lists {expected}: the two files are of different flights",
        path.display()
    )]
    Mixed {
        /// Which file.
        path: PathBuf,
        /// In the table.
        found: usize,
        /// In the scene.
        expected: usize,
    },
    /// There is no flight in the directory.
    #[error("{}: no samples: nothing was recorded", path.display())]
    Empty {
        /// Which file.
        path: PathBuf,
    },
}

/// Writes scene, table and events; the flight document has a writer of its own.
///
/// # Errors
/// [`RecordError::Write`].
pub fn store(directory: &Path, timeline: &Timeline) -> Result<(), RecordError> {
    let put = |name: &str, text: String| {
        let path = directory.join(name);
        std::fs::write(&path, text).map_err(|source| RecordError::Write { path, source })
    };
    let no_json = |source: serde_json::Error| RecordError::Write {
        path: directory.to_owned(),
        source: io::Error::other(source),
    };
    put(SCENE, serde_json::to_string_pretty(&timeline.scene).map_err(no_json)? + "\n")?;
    let mut events = String::new();
    for event in &timeline.events {
        // As fine as the table's times, so that what happens at one instant stays at one instant.
        let event = Event { at_s: (event.at_s * 1e4).round() / 1e4, ..event.clone() };
        events.push_str(&serde_json::to_string(&event).map_err(no_json)?);
        events.push('\n');
    }
    put(EVENTS, events)?;
    put(TIMELINE, table::write(&timeline.samples, timeline.scene.eavesdroppers.len()))
}

/// Reads the directory of a flight that was recorded with its timeline.
///
/// # Errors
/// [`RecordError`], with file and line.
pub fn load(directory: &Path) -> Result<Timeline, RecordError> {
    let path = directory.join(SCENE);
    let scene: Scene = json(&path, &read(&path)?, 1)?;
    if scene.format != SCENE_FORMAT {
        return Err(RecordError::Format { path, found: scene.format });
    }
    let path = directory.join(TIMELINE);
    let (samples, eavesdroppers) = match table::read(&read(&path)?) {
        Ok(table) => table,
        Err(source) => return Err(RecordError::Table { path, source }),
    };
    let expected = scene.eavesdroppers.len();
    if eavesdroppers != expected {
        return Err(RecordError::Mixed { path, found: eavesdroppers, expected });
    }
    if samples.is_empty() {
        return Err(RecordError::Empty { path });
    }
    let mut timeline = Timeline { scene, samples, events: events(directory)?, summary: summary(directory)? };
    timeline.events.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Ok(timeline)
}

fn events(directory: &Path) -> Result<Vec<Event>, RecordError> {
    let path = directory.join(EVENTS);
    let text = read(&path)?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    lines.map(|(k, line)| json(&path, line, k + 1)).collect()
}

/// The flight document, which a flight that was cut off does not have.
pub(super) fn summary(directory: &Path) -> Result<Option<Summary>, RecordError> {
    let path = directory.join(SUMMARY);
    match read(&path) {
        Ok(text) => json(&path, &text, 1).map(Some),
        Err(RecordError::Read { source, .. }) if source.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

pub(super) fn read(path: &Path) -> Result<String, RecordError> {
    std::fs::read_to_string(path).map_err(|source| RecordError::Read { path: path.to_owned(), source })
}

pub(super) fn json<T: DeserializeOwned>(
    path: &Path,
    text: &str,
    first_line: usize,
) -> Result<T, RecordError> {
    serde_json::from_str(text).map_err(|error| RecordError::Json {
        path: path.to_owned(),
        line: first_line + error.line().saturating_sub(1),
        message: error.to_string(),
    })
}
