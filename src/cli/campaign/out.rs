//! The directory of a campaign: plan, flight documents, and of one flight alone its full logs.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::Serialize;
use veilwing_sitl::{Recorder, World};

use crate::cli::plan::write_plan;
use crate::cli::sitl::document::{FlightDocument, FlightResult, Messages};
use crate::cli::sitl::files::Directory;
use crate::config::Mission;
use crate::config::file::{usable_directory, write_whole};
use crate::desk::campaign::coverage::Tally;
use crate::desk::campaign::{CampaignDocument, FaultLine, FlightLine};
use crate::desk::report::{self, Event, EventKind, Severity, Timeline};
use crate::desk::simulation::{Change, Fault, Flown, Observer, Scenario, ScenarioError, Wire, Witness};
use crate::link::Rejection;
use crate::link::tlog::append_record;
use crate::mission::Notice;
use crate::planner::document::PlanDocument;
use crate::role::{PerVehicle, Role};
use crate::time::Utc;

use super::shard::Shard;

/// The timeline of a flight has a record this often, and at each change.
const RECORD_EVERY: Duration = Duration::from_millis(50);

/// Where a campaign is kept.
pub(super) struct Out {
    path: PathBuf,
    /// A flight document could not be written; said once.
    failing: AtomicBool,
}

/// A flight document with what a campaign knows beside it.
#[derive(Serialize)]
struct Kept {
    #[serde(flatten)]
    flight: FlightDocument,
    seed: u64,
    faults: Vec<FaultLine>,
    /// Records of the telemetry logs that full disks did not take, by vehicle.
    unlogged: PerVehicle<u64>,
}

impl Out {
    /// Makes the directory and writes the plan.
    pub fn new(path: &Path, plan: &PlanDocument) -> Result<Self, String> {
        let runs = path.join("runs");
        usable_directory(&runs)?;
        write_plan(path, plan).map_err(|_| "the plan cannot be kept".to_owned())?;
        Ok(Self { path: path.to_owned(), failing: AtomicBool::new(false) })
    }

    /// Keeps the document of a flight as `runs/SEED.json`; of one flight alone, whose record is given with the mission's
    /// file, as `summary.json` too, and then what `veilwing report` makes of all that.
    pub fn keep(
        &self,
        line: &FlightLine,
        plan_digest: &str,
        flown: Flown,
        wall_s: f64,
        alone: Option<(&Path, &Timeline)>,
    ) {
        let kept = Kept {
            unlogged: flown.unlogged,
            flight: flight_document(flown, plan_digest, wall_s),
            seed: line.seed,
            faults: line.faults.clone(),
        };
        let mut written = write_json(&self.path.join(format!("runs/{}.json", line.seed)), &kept);
        if let Some((mission, timeline)) = alone {
            // The page tells of the verdict that is in the summary.
            let directory = Directory::new(Some(&self.path));
            written = written.and(directory.and_then(|directory| {
                directory.write_summary(&kept)?;
                directory.write_flight(mission, timeline)
            }));
        }
        self.report(written);
    }

    /// Keeps the campaign's document, or the part's.
    pub fn keep_campaign(&self, document: &CampaignDocument, shard: Option<Shard>) -> Result<(), String> {
        let name = shard.map_or_else(|| "campaign.json".to_owned(), Shard::file_name);
        write_json(&self.path.join(name), document)
    }

    /// Flies once and keeps all that was said and sent: `flight.log` and a `.tlog` of every link. Returns the record of
    /// the flight too.
    pub fn fly_with_logs(
        &self,
        mission: &Mission,
        scenario: &Scenario,
        seed: u64,
        faults: Vec<Fault>,
        tally: &mut Tally,
    ) -> Result<(Flown, Timeline), ScenarioError> {
        let mut logs = Logs::new(scenario.utc_start_us());
        let flown = scenario.fly(seed, faults, &mut (&mut logs, tally))?;
        self.report(logs.write(&self.path));
        let records = logs.recorder.finish();
        let judged = (flown.report.violations.as_slice(), flown.excused.as_slice());
        let timeline = report::simulated::timeline(mission, &flown.world, &records, logs.events, judged);
        Ok((flown, timeline))
    }

    /// A full disk costs the files, not the campaign.
    fn report(&self, written: Result<(), String>) {
        if let Err(message) = written
            && !self.failing.swap(true, Ordering::Relaxed)
        {
            eprintln!("warning: flights are not kept: {message}");
        }
    }
}

fn write_json(path: &Path, document: &impl Serialize) -> Result<(), String> {
    let text = serde_json::to_string_pretty(document).map_err(|error| error.to_string())?;
    write_whole(path, &(text + "\n"))
}

fn flight_document(flown: Flown, plan_digest: &str, wall_s: f64) -> FlightDocument {
    let result = if flown.completed() { FlightResult::Completed } else { FlightResult::Aborted };
    let mut rejected = BTreeMap::from([("swallowed-by-fault", flown.lost)]);
    for reason in Rejection::ALL {
        let turned_away: u64 = Role::BOTH.map(|role| flown.counters[role].rejected.get(*reason)).iter().sum();
        if turned_away > 0 {
            rejected.insert(reason.as_str(), turned_away);
        }
    }
    let messages = Messages { sent: flown.sent, received: flown.received, rejected };
    FlightDocument::new(result, flown.report, flown.excused, plan_digest.to_owned(), wall_s, messages)
}

/// Everything said and sent in a flight.
struct Logs {
    utc_start_us: u64,
    text: String,
    autopilot: PerVehicle<Vec<u8>>,
    pair: PerVehicle<Vec<u8>>,
    recorder: Recorder,
    events: Vec<Event>,
}

impl Logs {
    fn new(utc_start_us: u64) -> Self {
        let (autopilot, pair) = (PerVehicle::default(), PerVehicle::default());
        let recorder = Recorder::new(RECORD_EVERY);
        Self { utc_start_us, text: String::new(), autopilot, pair, recorder, events: Vec::new() }
    }

    fn line(&mut self, at: Duration, text: &str) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.text, "[{:9.3} s] {text}", at.as_secs_f64());
    }

    fn write(&self, directory: &Path) -> Result<(), String> {
        let write = |name: String, bytes: &[u8]| {
            let path = directory.join(name);
            std::fs::write(&path, bytes).map_err(|error| format!("{}: {error}", path.display()))
        };
        write("flight.log".to_owned(), self.text.as_bytes())?;
        for role in Role::BOTH {
            let name = role.key();
            write(format!("{name}-autopilot.tlog"), &self.autopilot[role])?;
            write(format!("{name}-pair.tlog"), &self.pair[role])?;
        }
        Ok(())
    }
}

impl Observer for Logs {
    fn said(&mut self, at: Duration, role: Role, phase: Option<&'static str>, notice: &Notice) {
        self.line(at, &format!("{role}  {}", notice));
        let text = notice.to_string();
        self.events.push(Event {
            at_s: at.as_secs_f64(),
            kind: EventKind::Notice,
            vehicle: Some(role),
            severity: notice.severity().into(),
            phase: phase.map(str::to_owned),
            code: None,
            text,
        });
    }

    fn saw(&mut self, world: &World) {
        self.recorder.observe(world);
    }

    fn frame(&mut self, at: Duration, role: Role, wire: Wire, bytes: &[u8]) {
        let utc = Utc { unix_us: self.utc_start_us } + at;
        let log = match wire {
            // The radios of campaigns are behind their autopilots.
            Wire::Autopilot | Wire::Radio => &mut self.autopilot[role],
            Wire::Pair => &mut self.pair[role],
        };
        append_record(log, utc, bytes);
    }

    fn on_air(&mut self, at: Duration, [i, j]: [bool; 2]) {
        let word = |on| if on { "on" } else { "off" };
        self.line(at, &format!("on the air: I {}, J {}", word(i), word(j)));
    }
}

impl Witness for Logs {
    fn fault(&mut self, at: Duration, change: &Change) {
        let (fault, kind, over) = match change {
            Change::Begins(fault) => (fault, EventKind::Fault, ""),
            Change::Ends(fault) => (fault, EventKind::FaultOver, " is over"),
        };
        self.line(at, &format!("{}{over}", fault.describe()));
        self.events.push(Event {
            at_s: at.as_secs_f64(),
            kind,
            vehicle: fault.vehicle(),
            severity: Severity::Warning,
            phase: None,
            code: Some(fault.kind.name().to_owned()),
            text: fault.what(),
        });
    }
}
