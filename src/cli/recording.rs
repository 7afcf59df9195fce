//! The directory in which this process's flight is recorded, and what goes into it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::config::file::usable_directory;
use crate::config::{Mission, RadioFile, Vehicle};
use crate::durable::append::Keeping;
use crate::link::{Clock, TlogWriter};
use crate::logbook::{Ended, Limits, Running, Start, Writer};
use crate::mission::Outcome;
use crate::planner::Options;
use crate::planning::Timed;
use crate::radio_loop::{RadioLoopError, Stopped};

use super::flight_log;
use super::planning::{assessed, document};

/// A directory of this start's own; or one that somebody else keeps.
#[derive(Debug, Clone)]
pub(super) struct Recording {
    directory: PathBuf,
    running: Option<Arc<Running>>,
}

impl Recording {
    /// Logs go into this directory, emptied if they are there: a simulated flight's, which its host keeps.
    #[cfg(feature = "desk")]
    pub fn into(directory: &Path) -> Self {
        Self { directory: directory.to_owned(), running: None }
    }

    /// A companion's, with copies of its two files.
    pub fn begin(mission: &Mission, vehicle: &Vehicle, clock: &Clock) -> Result<Self, String> {
        let name = vehicle.role.key();
        let start = Start {
            writer: Writer::Companion(vehicle.role),
            mission: &mission.name,
            mission_digest: Some(mission.digest_hex()),
            utc: clock.utc(),
        };
        let log = format!("companion-{name}.log");
        let recording = Self::start(&vehicle.log_dir, vehicle.log_limits.in_bytes(), &start, &log)?;
        recording.keep("mission.toml", &mission.to_file())?;
        recording.keep(&format!("vehicle-{name}.toml"), &vehicle.to_file())?;
        Ok(recording)
    }

    /// A radio host's. Its file stays where it is: there may be a password in it.
    pub fn begin_radio(radio: &RadioFile, clock: &Clock) -> Result<Self, String> {
        let number = format!("{}-{}", radio.system_id, radio.component_id);
        let start = Start { writer: Writer::Radio, mission: &number, mission_digest: None, utc: clock.utc() };
        Self::start(&radio.log_dir, radio.log_limits.in_bytes(), &start, "radio.log")
    }

    /// A bench's, with a copy of the vehicle file.
    pub fn begin_bench(vehicle: &Vehicle, clock: &Clock) -> Result<Self, String> {
        let name = vehicle.role.key();
        let writer = Writer::Companion(vehicle.role);
        let start = Start { writer, mission: "bench", mission_digest: None, utc: clock.utc() };
        let log = format!("bench-{name}.log");
        let recording = Self::start(&vehicle.log_dir, vehicle.log_limits.in_bytes(), &start, &log)?;
        recording.keep(&format!("vehicle-{name}.toml"), &vehicle.to_file())?;
        Ok(recording)
    }

    /// A bench's end, and what it says.
    pub fn end_bench(&self, clock: &Clock, name: &str, document: &str, failed: usize) -> Result<(), String> {
        let kept = self.keep(name, document);
        match failed {
            0 => self.write_end(clock, Ended::Completed, None),
            failed => self.write_end(clock, Ended::Aborted, Some(format!("{failed} lines fail"))),
        }
        kept
    }

    /// It was asked to stop.
    pub fn interrupted(&self, clock: &Clock) {
        self.write_end(clock, Ended::Interrupted, None);
    }

    /// Where it is.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    fn start(root: &Path, limits: Limits, start: &Start<'_>, log: &str) -> Result<Self, String> {
        // Where files cannot be made at all, that is what there is to say.
        let running = Running::begin(root, limits, start)
            .map_err(|error| usable_directory(root).err().unwrap_or_else(|| error.to_string()))?;
        usable_directory(root)?;
        flight_log::begin(&running.path().join(log), running.keeping())?;
        tracing::info!(flight = %running.path().display(), "recorded");
        Ok(Self { directory: running.path().to_owned(), running: Some(Arc::new(running)) })
    }

    /// A telemetry log of the flight.
    pub fn tlog(&self, name: &str) -> Result<TlogWriter, String> {
        let keeping = self.running.as_ref().map_or_else(Keeping::default, |running| running.keeping());
        let tlog =
            TlogWriter::keep(&self.directory.join(name), keeping).map_err(|error| error.to_string())?;
        if let Some(Err(error)) = self.running.as_ref().map(|running| running.show(name)) {
            tracing::debug!(%error, name, "no link to the newest log");
        }
        Ok(tlog)
    }

    fn keep(&self, name: &str, content: &str) -> Result<(), String> {
        self.running
            .as_ref()
            .map_or(Ok(()), |running| running.keep(name, content).map_err(|error| error.to_string()))
    }

    /// Has the plan written beside the flight, which does not wait for it.
    pub fn keep_plan(&self, mission: Mission, options: Options, timed: Timed) {
        let Some(running) = self.running.clone() else { return };
        let keep = {
            let running = Arc::clone(&running);
            move || {
                let plan = assessed(&mission, &options, timed).map_err(|error| error.to_string());
                let text = plan.and_then(|plan| {
                    serde_json::to_string_pretty(&document(&mission, &options, &plan))
                        .map_err(|error| error.to_string())
                });
                let kept =
                    text.and_then(|text| running.keep("plan.json", &text).map_err(|error| error.to_string()));
                if let Err(error) = kept {
                    tracing::warn!(error, "the plan is not kept with the logs");
                }
            }
        };
        match std::thread::Builder::new().name("plan".to_owned()).spawn(keep) {
            Ok(work) => running.add_work(work),
            Err(error) => tracing::warn!(%error, "the plan is not kept with the logs"),
        }
    }

    /// The flight is over, as the outcome says.
    pub fn end(&self, clock: &Clock, outcome: Result<Outcome, String>) -> Result<Outcome, String> {
        let (ended, cause) = match &outcome {
            Ok(Outcome::Completed) => (Ended::Completed, None),
            Ok(Outcome::Aborted(cause)) => (Ended::Aborted, Some(cause.to_string())),
            Ok(Outcome::Interrupted) => (Ended::Interrupted, None),
            Err(error) => (Ended::Failed, Some(error.clone())),
        };
        self.write_end(clock, ended, cause);
        outcome
    }

    /// It did not begin. Returns why.
    pub fn failed(&self, error: String, clock: &Clock) -> String {
        self.write_end(clock, Ended::Failed, Some(error.clone()));
        error
    }

    /// A radio host's end.
    pub fn end_radio(&self, clock: &Clock, stopped: &Result<Stopped, RadioLoopError>) {
        let (ended, cause) = match stopped {
            Ok(Stopped::Off) => (Ended::Interrupted, None),
            Ok(Stopped::ByLine) => (Ended::Failed, Some("silent by its kill line alone".to_owned())),
            Ok(Stopped::MayRadiate) => (Ended::Failed, Some("not read back off: it may radiate".to_owned())),
            Err(error) => (Ended::Failed, Some(error.to_string())),
        };
        self.write_end(clock, ended, cause);
    }

    fn write_end(&self, clock: &Clock, ended: Ended, cause: Option<String>) {
        let Some(running) = &self.running else { return };
        let ended = running.end(ended, cause, clock.now().since_start());
        flight_log::end();
        if let Err(error) = ended {
            tracing::warn!("{error}");
        }
    }
}
