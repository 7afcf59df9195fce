//! A recorded flight: the telemetry logs of a directory, or such a log itself.

use std::path::{Path, PathBuf};
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;

use crate::link::tlog::{TlogError, TlogReader};
use crate::link::{Aboard, Frame};
use crate::mission::Figure;
use crate::role::Role;
use crate::time::Utc;

/// Why there is nothing to be shown.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// Neither a directory nor a log.
    #[error("{}: {source}", path.display())]
    Unreadable {
        /// What was given.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A log that is none.
    #[error("{}: {source}", path.display())]
    Log {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        source: TlogError,
    },
    /// No logs.
    #[error(
        "{}: no telemetry log of a companion's autopilot link (i-autopilot.tlog, j-autopilot.tlog, or any .tlog): give the directory that `veilwing sitl --out` or a companion's [log] dir wrote, or a ground station's .tlog",
        path.display()
    )]
    Nothing {
        /// Where they should be.
        path: PathBuf,
    },
}

/// A message of a flight.
#[derive(Debug, Clone)]
pub(super) struct Record {
    /// Since the flight's first.
    pub at: Duration,
    /// Which log.
    pub channel: usize,
    pub header: MavHeader,
    pub message: MavMessage,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Recording {
    /// When it begins.
    pub began: Utc,
    /// What is to be said of its logs.
    pub remarks: Vec<String>,
    /// Whose logs they are, as far as their names say.
    pub(super) roles: Vec<Option<Role>>,
    pub(super) records: Vec<Record>,
}

impl Recording {
    /// Reads the logs of a directory, or one.
    ///
    /// # Errors
    /// [`RecordingError`]. A log whose writer was cut off is read as far as it goes, which is remarked on.
    pub fn load(path: &Path) -> Result<Self, RecordingError> {
        let logs = logs_of(path)?;
        let mut frames: Vec<(Utc, usize, Frame<Aboard>)> = Vec::new();
        let mut remarks = Vec::new();
        for (channel, (log, _)) in logs.iter().enumerate() {
            let failed = |source| RecordingError::Log { path: log.clone(), source };
            let before = frames.len();
            for record in TlogReader::open(log).map_err(failed)? {
                match record {
                    Ok((utc, frame)) => {
                        frames.extend(frame.parse::<Aboard>().ok().map(|frame| (utc, channel, frame)));
                    }
                    Err(error) if frames.len() > before => {
                        remarks.push(format!("{}: {error}", log.display()));
                    }
                    Err(error) => return Err(failed(error)),
                }
            }
        }
        frames.sort_by_key(|(utc, ..)| *utc);
        let Some(began) = frames.first().map(|(utc, ..)| *utc) else {
            return Err(RecordingError::Nothing { path: path.to_owned() });
        };
        let records: Vec<Record> = frames
            .into_iter()
            .filter_map(|(utc, channel, frame)| match frame.message {
                Aboard::Common(message) if is_shown(&message) => {
                    Some(Record { at: utc.saturating_since(began), channel, header: frame.header, message })
                }
                Aboard::Common(_) | Aboard::Radio(_) => None,
            })
            .collect();
        let figures = |record: &Record| match &record.message {
            MavMessage::NAMED_VALUE_FLOAT(m) => {
                m.name.to_str().is_ok_and(|name| name.parse::<Figure>().is_ok())
            }
            _ => false,
        };
        if !records.iter().any(figures) {
            remarks.push(
                "these logs have no figures of a companion's phase, pose and lease (VW_...): of another version, or of no companion; `veilwing report` reads more from them"
                    .into(),
            );
        }
        Ok(Self { began, remarks, roles: logs.into_iter().map(|(_, role)| role).collect(), records })
    }

    /// From the first message to the last.
    #[must_use]
    pub fn length(&self) -> Duration {
        self.records.last().map_or(Duration::ZERO, |record| record.at)
    }
}

/// The rest, telemetry at 50 Hz above all, is nothing to look at.
fn is_shown(message: &MavMessage) -> bool {
    matches!(
        message,
        MavMessage::HEARTBEAT(_)
            | MavMessage::NAMED_VALUE_FLOAT(_)
            | MavMessage::DEBUG_VECT(_)
            | MavMessage::STATUSTEXT(_)
            | MavMessage::SYS_STATUS(_)
            | MavMessage::BATTERY_STATUS(_)
            | MavMessage::GPS_RAW_INT(_)
            | MavMessage::ONBOARD_COMPUTER_STATUS(_)
            | MavMessage::COMMAND_ACK(_)
            | MavMessage::COMMAND_LONG(_)
            | MavMessage::COMMAND_INT(_)
    )
}

/// The logs that a ground station would have heard, and whose they are: those of the autopilots' links, or all where no name
/// says which.
fn logs_of(path: &Path) -> Result<Vec<(PathBuf, Option<Role>)>, RecordingError> {
    let failed = |source| RecordingError::Unreadable { path: path.to_owned(), source };
    if !std::fs::metadata(path).map_err(failed)?.is_dir() {
        return Ok(vec![(path.to_owned(), role_of(path))]);
    }
    let mut all = Vec::new();
    for found in std::fs::read_dir(path).map_err(failed)? {
        let file = found.map_err(failed)?.path();
        if file.extension().is_some_and(|extension| extension == "tlog") {
            all.push(file);
        }
    }
    all.sort();
    let named: Vec<_> = all.iter().filter(|log| role_of(log).is_some()).cloned().collect();
    let logs = if named.is_empty() { all } else { named };
    if logs.is_empty() {
        return Err(RecordingError::Nothing { path: path.to_owned() });
    }
    Ok(logs.into_iter().map(|log| (role_of(&log), log)).map(|(role, log)| (log, role)).collect())
}

/// Whose log of its autopilot's link this is, by its name.
fn role_of(log: &Path) -> Option<Role> {
    let name = log.file_name()?.to_str()?;
    Role::BOTH.into_iter().find(|role| name == format!("{}-autopilot.tlog", role.key()))
}
