//! `veilwing bench`: the first hardware day, on the ground and silent.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use serde::Serialize;

use crate::autopilot::FenceDuty;
use crate::bench::figures::Samples;
use crate::bench::line::{self, Line};
use crate::bench::{Bench, SETTLE, Settings};
use crate::companion::settings::{settings, transmitter_settings};
use crate::computer::Reading;
use crate::config::{Mission, Vehicle};
use crate::link::{Aboard, Clock, Link, PairLink};
use crate::mission::Outgoing;
use crate::preflight::Verdict;
use crate::schedule::trajectory::Limits;
use crate::time::Instant;

use super::fly::{Links, boot_id, links, runtime};
use super::recording::Recording;
use super::{Exit, interrupt, load_mission, load_vehicle, print_json, print_text};

/// What is appended and synced at a time, as a busy link's log is.
const DISK_BYTES: usize = 16 * 1024;
/// How often, at most.
const DISK_TIMES: usize = 200;
/// Where no mission is given: one that asks nothing of the autopilot.
const NO_MISSION: &str =
    "[mission]\nname = \"bench\"\n[[user]]\nenu_m = [0, 0, 0]\n[[eavesdropper]]\nenu_m = [120, -40, 0]\n";
/// Words are folded to so many columns.
const COLUMNS: usize = 80;

const EXAMPLES: &str = "Example: veilwing bench --vehicle config/vehicle-i.toml
Propellers off. Nothing is armed, no setpoint and no parameter is sent, the radio is told nothing but off.
On both vehicles at once it measures the link between them too.";

/// Measure a vehicle on the ground, silent: links, messages, parameters, clocks, cadence, radio, computer.
///
/// Each line has a verdict (pass, warn, fail) and what to do; the same as JSON is kept with the flight logs.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Args {
    /// Vehicle file of this vehicle.
    #[arg(long, value_name = "FILE")]
    vehicle: PathBuf,
    /// Mission file: its altitudes, speeds, tilt and area are held against the autopilot's parameters.
    #[arg(long, value_name = "FILE")]
    mission: Option<PathBuf>,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// How long to measure; the last third under load.
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u64).range(9..=3600))]
    seconds: u64,
}

/// What is kept and printed.
#[derive(Debug, Serialize)]
struct Document {
    format: &'static str,
    vehicle: &'static str,
    started_utc: String,
    verdict: String,
    lines: Vec<Line>,
    /// Messages that would have changed something and were not sent, by name.
    held_back: std::collections::BTreeMap<&'static str, u64>,
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match args.mission.as_deref().map(load_mission).transpose() {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    let vehicle = match load_vehicle(&args.vehicle) {
        Ok(vehicle) => vehicle,
        Err(exit) => return exit,
    };
    measure(args, mission.as_ref(), &vehicle).unwrap_or_else(|message| {
        eprintln!("error: {message}");
        Exit::Unusable
    })
}

fn measure(args: &Args, mission: Option<&Mission>, vehicle: &Vehicle) -> Result<Exit, String> {
    let clock = Clock::real();
    let (runtime, _handled) = runtime()?;
    let recording = Recording::begin_bench(vehicle, &clock).map_err(|error| format!("[log] dir: {error}"))?;
    let started_utc = clock.utc().to_string();
    eprintln!("measuring for {} s; nothing is armed, set or radiated", args.seconds);
    let stand = Stand { vehicle, mission, clock: &clock, recording: &recording, seconds: args.seconds };
    let measured = match runtime.block_on(stand.measure()) {
        Ok(Measured::Lines { lines, held_back }) => (lines, held_back),
        Ok(Measured::Interrupted) => {
            recording.interrupted(&clock);
            return Ok(Exit::Interrupted);
        }
        Ok(Measured::Armed) => {
            let error =
                "the vehicle is armed: the bench is for the ground, disarmed, propellers off".to_owned();
            return Err(recording.failed(error, &clock));
        }
        Err(error) => return Err(recording.failed(error, &clock)),
    };
    let (lines, held_back) = measured;
    let worst = lines.iter().map(|line| line.verdict).max().unwrap_or(Verdict::Fail);
    let failed = lines.iter().filter(|line| line.verdict == Verdict::Fail).count();
    let name = vehicle.role.key();
    let document = Document {
        format: "veilwing-bench/1",
        vehicle: name,
        started_utc,
        verdict: worst.to_string(),
        lines,
        held_back,
    };
    let text = serde_json::to_string_pretty(&document).map_err(|error| error.to_string())?;
    let file = format!("bench-{name}.json");
    // The result first: a disk that takes nothing must not cost it.
    let shown = if args.json { print_json(&document) } else { print_text(&table(&document)) };
    match recording.end_bench(&clock, &file, &format!("{text}\n"), failed) {
        Ok(()) => eprintln!("kept in {}", recording.directory().join(file).display()),
        Err(error) => eprintln!("error: {error}"),
    }
    Ok(match (shown, worst) {
        (Exit::Done, Verdict::Fail) => Exit::Bad,
        (shown, _) => shown,
    })
}

/// How the measuring ended.
enum Measured {
    Lines { lines: Vec<Line>, held_back: std::collections::BTreeMap<&'static str, u64> },
    Interrupted,
    Armed,
}

struct Stand<'a> {
    vehicle: &'a Vehicle,
    mission: Option<&'a Mission>,
    clock: &'a Clock,
    recording: &'a Recording,
    seconds: u64,
}

impl Stand<'_> {
    fn settings(&self) -> Result<Settings, String> {
        let Self { vehicle, clock, .. } = *self;
        let boot = boot_id(clock);
        // Without a mission, the one that asks for least.
        let none = match self.mission {
            Some(_) => None,
            None => Some(Mission::parse("bench", NO_MISSION).map_err(|findings| findings.to_string())?),
        };
        let mission = self.mission.or(none.as_ref()).ok_or("there is no mission")?;
        let of_flight = settings(mission, vehicle, boot, false);
        let mut autopilot = of_flight.autopilot;
        if self.mission.is_none() {
            (autopilot.planned_tilt_rad, autopilot.return_altitude_m, autopilot.fence) = (0.0, None, None);
            autopilot.transit = Limits::new(0.1, 0.1, 0.1);
        }
        if let Some(fence) = autopilot.fence.as_mut().filter(|fence| fence.duty == FenceDuty::Upload) {
            fence.duty = FenceDuty::Foresee;
        }
        Ok(Settings {
            role: vehicle.role,
            own: of_flight.own,
            autopilot,
            transmitter: transmitter_settings(vehicle, boot),
            radio_apart: of_flight.radio_apart,
        })
    }

    async fn measure(&self) -> Result<Measured, String> {
        let Self { vehicle, clock, recording, .. } = *self;
        let words = |error: crate::link::LinkError| error.to_string();
        let Links { autopilot, radio, pair } = links(recording, vehicle)?;
        let mut autopilot_link: Link<Aboard> =
            Link::open(autopilot.0, autopilot.1, clock.clone()).await.map_err(words)?;
        let mut radio_link: Option<Link<Aboard>> = match radio {
            Some((address, config)) => Some(Link::open(address, config, clock.clone()).await.map_err(words)?),
            None => None,
        };
        let mut pair_link = PairLink::open(pair.0, pair.1, pair.2, clock.clone()).await.map_err(words)?;
        let mut bench = Bench::new(self.settings()?, clock.now());
        let begun = clock.now();
        let end = begun + SETTLE + Duration::from_secs(self.seconds);
        let load_from = begun + SETTLE + Duration::from_secs(self.seconds * 2 / 3);
        let look = || Reading::take(recording.directory());
        let before = look();
        let mut load: Option<(Load, Reading)> = None;
        let mut stop = std::pin::pin!(interrupt::requested());
        loop {
            while let Some(outgoing) = bench.poll_transmit() {
                match outgoing {
                    Outgoing::Autopilot(message) => {
                        autopilot_link.send(bench.own(), &Aboard::Common(*message))
                    }
                    Outgoing::Radio(message) => {
                        if let Some(radio) = &mut radio_link {
                            radio.send(bench.own(), &Aboard::Common(*message));
                        }
                    }
                    Outgoing::Pair(message) => pair_link.send(bench.own(), &message),
                }
            }
            let now = clock.now();
            if bench.is_armed() {
                return Ok(Measured::Armed);
            }
            if now >= end {
                break;
            }
            if load.is_none() && now >= load_from {
                load = Some((Load::begin(recording.directory(), clock)?, look()));
                bench.set_under_load();
            }
            let until = if load.is_none() { load_from } else { end };
            let deadline = Instant::min(bench.poll_timeout(), until);
            tokio::select! {
                biased;
                () = &mut stop => return Ok(Measured::Interrupted),
                () = clock.sleep_until(deadline) => bench.handle_timeout(clock.now(), clock.utc()),
                frame = autopilot_link.recv() => match &frame.message {
                    Aboard::Common(message) => {
                        bench.handle_autopilot(frame.header, message, clock.now(), clock.utc());
                    }
                    Aboard::Radio(message) if radio_link.is_none() => {
                        bench.handle_report(frame.header, message.message(), clock.now());
                    }
                    Aboard::Radio(_) => {}
                },
                frame = Link::recv_of(&mut radio_link) => match &frame.message {
                    Aboard::Common(message) => bench.handle_radio_link(frame.header, message, clock.now()),
                    Aboard::Radio(message) => bench.handle_report(frame.header, message.message(), clock.now()),
                },
                frame = pair_link.recv() => bench.handle_pair(&frame.message, clock.now(), clock.utc()),
            }
        }
        let after_load = look();
        let mut lines = bench.lines(clock.now());
        if let Some((load, after_rest)) = load {
            let times = load.end();
            let limits = vehicle.log_limits.in_bytes();
            lines.extend(line::disk(&times, DISK_BYTES, after_load.disk, limits.min_free_bytes));
            lines.extend(line::computer(&before, &after_rest, &after_load));
        }
        Ok(Measured::Lines { lines, held_back: bench.held_back().clone() })
    }
}

/// What a computer has to do in flight and more: a thread that computes for each processor, and one that writes a log.
struct Load {
    over: Arc<AtomicBool>,
    computing: Vec<JoinHandle<()>>,
    writing: Option<JoinHandle<Result<Samples, String>>>,
}

impl Load {
    fn begin(directory: &Path, clock: &Clock) -> Result<Self, String> {
        let fault = |error: std::io::Error| format!("no thread can be started: {error}");
        let over = Arc::new(AtomicBool::new(false));
        let mut load = Self { over: Arc::clone(&over), computing: Vec::new(), writing: None };
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        for _ in 0..processors {
            let over = Arc::clone(&over);
            let compute = move || {
                let mut x = 0.5f64;
                while !over.load(Ordering::Relaxed) {
                    for _ in 0..10_000 {
                        x = black_box(x * 1.000_001 + 1e-9);
                    }
                    x = x.fract();
                }
            };
            load.computing
                .push(std::thread::Builder::new().name("load".to_owned()).spawn(compute).map_err(fault)?);
        }
        let (path, clock) = (directory.join("disk.test"), clock.clone());
        let write = move || {
            let times = write_and_sync(&path, &clock, &over);
            // What cannot be removed is small.
            std::fs::remove_file(&path).ok();
            times.map_err(|error| crate::config::file::unwritable(&path, &error))
        };
        load.writing = Some(std::thread::Builder::new().name("disk".to_owned()).spawn(write).map_err(fault)?);
        Ok(load)
    }

    fn end(mut self) -> Result<Samples, String> {
        self.over.store(true, Ordering::Relaxed);
        for thread in self.computing.drain(..) {
            drop(thread.join());
        }
        let written = self.writing.take().map(JoinHandle::join);
        written.and_then(Result::ok).unwrap_or_else(|| Err("the disk was not measured".to_owned()))
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
    }
}

fn write_and_sync(path: &Path, clock: &Clock, over: &AtomicBool) -> std::io::Result<Samples> {
    use std::io::Write;
    let mut file = std::fs::File::create_new(path)?;
    let block = vec![0xa5u8; DISK_BYTES];
    let mut times = Samples::default();
    while times.count() < DISK_TIMES && !over.load(Ordering::Relaxed) {
        let begun = clock.now();
        file.write_all(&block)?;
        file.sync_data()?;
        times.add_ms(clock.now().saturating_since(begun));
    }
    Ok(times)
}

/// The lines for a reader, each folded to the terminal.
fn table(document: &Document) -> String {
    let mut text = String::new();
    let width = document.lines.iter().map(|line| line.name.len()).max().unwrap_or_default().min(24);
    let indent = " ".repeat(6 + width + 2);
    for line in &document.lines {
        let Line { name, verdict, seen, remedy, .. } = line;
        let what = remedy.as_ref().map_or_else(|| seen.clone(), |remedy| format!("{seen}: {remedy}"));
        let folded = super::folded(&what, COLUMNS - indent.len());
        let head = format!("{verdict:<4}  {name:<width$}  ");
        // A longer name has a line of its own.
        if head.len() > indent.len() {
            text.push_str(&format!("{}\n{indent}", head.trim_end()));
        } else {
            text.push_str(&head);
        }
        text.push_str(&folded.join(&format!("\n{indent}")));
        text.push('\n');
    }
    let count = |verdict| document.lines.iter().filter(|line| line.verdict == verdict).count();
    let [pass, warn, fail] = [Verdict::Pass, Verdict::Warn, Verdict::Fail].map(count);
    text.push_str(&format!("vehicle {}: {pass} pass, {warn} warn, {fail} fail\n", document.vehicle));
    for (name, times) in &document.held_back {
        text.push_str(&format!(
            "{name} would have been sent {times} times, and was not: the bench changes nothing\n"
        ));
    }
    text
}
