//! `veilwing sitl`: the main job on one machine. The simulated world in this process, the two companions in
//! processes of their own, MAVLink over loopback UDP between them.

pub(super) mod document;
pub(super) mod files;
mod ground;
mod host;
mod journal;
mod links;
mod lockstep;
mod port;
mod process;
pub(super) mod radios;
mod view;

use std::path::PathBuf;

use veilwing_sitl::RadioPlace;

use crate::companion::settings::scheduling_allowance;
use crate::config::Mission;
use crate::desk::report;
use crate::desk::simulation::{self, Faults, LONGEST, Scenario, Tracks, draw};
use crate::link::HostPort;
use crate::link::clock::Clock;
use crate::role::{PerVehicle, Role};
use crate::time::Utc;

use super::plan::write_plan;
use super::planning::{document as plan_document, plan_mission};
use super::{Exit, load_mission, print_json, print_text, progress};
use document::{FlightDocument, FlightResult};
use host::Pace;

const EXAMPLES: &str = "Examples:
  veilwing sitl config/mission.toml --out flight-1
  veilwing sitl config/mission.toml --ground-station udpout:127.0.0.1:14550
      the same, watched by a ground station on this machine that listens where they all do";

/// Fly a mission in simulation: two software vehicles, two companion processes, every slot flown and scored.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Args {
    /// Mission file.
    mission: PathBuf,
    /// Print the flight as one JSON document.
    #[arg(long)]
    json: bool,
    /// Simulated seconds per second of wall time, from 0.1 to 50.
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = parse_speed)]
    speed: f64,
    /// Let the world and the companions live by this machine's clock, as onboard, instead of waiting for each other: on a busy
    /// machine they are late, and a flight may fail by that.
    #[arg(long)]
    wall_clock: bool,
    /// Keep plan, summary, logs and a .tlog of every link in this directory.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Fly into a directory that has a flight already: its files go.
    #[arg(long, requires = "out")]
    overwrite: bool,
    /// What goes wrong, a TOML file (config/faults.toml); what it leaves open is drawn by the mission's seed.
    #[arg(long, value_name = "FILE")]
    faults: Option<PathBuf>,
    /// Where those go that move, a CSV file: name,t_s,east_m,north_m and, where wanted, up_m. Without it they wander.
    #[arg(long, value_name = "FILE")]
    tracks: Option<PathBuf>,
    /// Give each radio a link of its own, as a radio host beside the companion has, instead of the way through the autopilot.
    #[arg(long)]
    own_radio_links: bool,
    /// A radio host (`veilwing radio`) for each vehicle, with a fake device of this kind: what the device does is what the
    /// vehicle radiates. They live by this machine's clock (--wall-clock).
    #[arg(long, value_name = "KIND", conflicts_with = "own_radio_links")]
    radio_hosts: Option<radios::Kind>,
    /// How long the fake devices take: from an off to silence, and from an order to the power.
    #[arg(long, value_names = ["OFF", "CHANGE"], num_args = 2, requires = "radio_hosts", value_parser = parse_ms)]
    device_ms: Option<Vec<f64>>,
    /// The fake devices are silent by themselves so long after their host has died or stopped; without it never.
    #[arg(long, value_name = "MS", requires = "radio_hosts", value_parser = parse_ms)]
    device_dead_ms: Option<f64>,
    /// The fake devices go dark when their own control dies; without it they radiate on.
    #[arg(long, requires = "radio_hosts")]
    device_goes_dark: bool,
    /// A ground station (QGroundControl, MAVProxy) that listens there; both vehicles and both companions are on it.
    #[arg(long, value_name = "udpout:HOST:PORT", value_parser = ground::parse_ground_station, group = "stations")]
    ground_station: Option<HostPort>,
    /// Take off only when the ground station, or the key S of --watch, sends MISSION_START (command 300) to either companion
    /// (component 191).
    #[arg(long, requires = "stations")]
    wait_for_start: bool,
    /// Show the flight on this terminal as `veilwing watch` does, with its keys, in place of the log. q leaves the view alone,
    /// Ctrl-C ends the flight.
    #[arg(long, group = "stations")]
    watch: bool,
}

/// Of a fake device.
fn parse_ms(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(ms) if (0.0..=60_000.0).contains(&ms) => Ok(ms),
        _ => Err("give milliseconds from 0 to 60000".into()),
    }
}

impl Args {
    /// The radio hosts' devices, if there are any.
    fn devices(&self) -> Option<radios::Options> {
        let times_ms = match self.device_ms.as_deref() {
            Some([off, change]) => Some([*off, *change]),
            _ => None,
        };
        let (dead_ms, goes_dark) = (self.device_dead_ms, self.device_goes_dark);
        self.radio_hosts.map(|kind| radios::Options { kind, times_ms, dead_ms, goes_dark })
    }
}

fn parse_speed(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(speed) if (0.1..=50.0).contains(&speed) => Ok(speed),
        _ => Err("give a number from 0.1 to 50".into()),
    }
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match load_mission(&args.mission) {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    let faults = match args.faults.as_deref().map(Faults::load).transpose() {
        Ok(faults) => faults.unwrap_or_default(),
        Err(errors) => {
            eprint!("{errors}");
            return Exit::Unusable;
        }
    };
    if args.radio_hosts.is_some() && args.speed != 1.0 {
        eprintln!(
            "error: --radio-hosts with --speed {}: a radio host lives by this machine's clock; leave --speed out",
            args.speed
        );
        return Exit::Unusable;
    }
    if let Some(kind) = faults.of_radio_hosts().filter(|_| args.radio_hosts.is_none()) {
        eprintln!("error: {kind} befalls radio hosts, and there are none: give --radio-hosts KIND");
        return Exit::Unusable;
    }
    if !mission.movers.is_empty() && (args.wall_clock || args.radio_hosts.is_some()) {
        eprintln!(
            "error: somebody `moves` in this mission, and what both vehicles fly then is known to the simulated world in step alone; leave \
             --wall-clock and --radio-hosts out"
        );
        return Exit::Unusable;
    }
    if args.watch
        && let Err(message) = view::is_possible()
    {
        eprintln!("error: --watch: {message}");
        return Exit::Unusable;
    }
    fly(args, &mission, &faults).unwrap_or_else(|message| {
        eprintln!("error: {message}");
        Exit::Unusable
    })
}

fn fly(args: &Args, mission: &Mission, faults: &Faults) -> Result<Exit, String> {
    let wall = Clock::real();
    let directory = files::Directory::of_flight(args.out.as_deref(), args.overwrite)?;
    let options = crate::planning::options(mission);
    let timed = plan_mission(mission, &options).map_err(|error| error.to_string())?;
    let plan = plan_document(mission, &options, &timed);
    if write_plan(directory.path(), &plan).is_err() {
        return Ok(Exit::Unusable);
    }
    let mut config = simulation::world_config(mission, &timed.plan)?;
    if let Some(path) = &args.tracks {
        Tracks::load(path, mission)?.lay(&mut config);
    }
    if args.own_radio_links || args.radio_hosts.is_some() {
        config.vehicles.iter_mut().for_each(|vehicle| vehicle.radio_place = RadioPlace::OnItsOwn);
    }
    // Switched on a while before their companions.
    config.vehicles.iter_mut().for_each(|vehicle| vehicle.ready_after_s = 0.5);
    let utc_start = Utc { unix_us: config.utc_start_us };
    let mut world = veilwing_sitl::World::new(config).map_err(|error| error.to_string())?;
    // A radio host takes its time from nobody.
    let by_the_wall = args.wall_clock || args.radio_hosts.is_some();
    let pace = if by_the_wall { Pace::Wall } else { Pace::InStep { utc_start } };
    if pace == Pace::Wall {
        world.allow_for_scheduling(scheduling_allowance(args.speed));
    }
    let (faults, longest) = match faults.laws.as_slice() {
        [] => (Vec::new(), LONGEST),
        // Times of faults may depend on the length of the flight, which one in virtual time tells.
        _ => {
            let scenario = Scenario::new(mission, &timed.plan, None).map_err(|error| error.to_string())?;
            let longest = if args.wait_for_start { LONGEST } else { scenario.longest() };
            (draw(faults, mission.seed, scenario.lengths()), longest)
        }
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| format!("the event loop cannot start: {error}"))?;
    let view = if args.watch { Some(view::View::open(&mission.name, args.speed)?) } else { None };
    let stations: Vec<&HostPort> =
        args.ground_station.iter().chain(view.as_ref().map(view::View::address)).collect();
    let flown = runtime.block_on(host::fly(host::Setup {
        mission: &args.mission,
        world,
        faults,
        longest,
        seed: mission.seed,
        speed: args.speed,
        pace,
        directory: directory.path(),
        settings: mission,
        own_radio_links: args.own_radio_links,
        radio_hosts: args.devices().map(|options| {
            let powers_w = |role: Role| {
                timed.plan.slots.iter().map(|slot| slot.plan.vehicles[role].tx_power_w).collect()
            };
            (options, PerVehicle::from_fn(powers_w))
        }),
        ground_stations: &stations,
        start: !args.wait_for_start,
    }));
    // The terminal first, whatever came of the flight.
    drop(view);
    let flown = flown?;
    let wall_s = wall.now().since_start().as_secs_f64();
    let document = FlightDocument::of_processes(&flown, plan.plan_digest.clone(), wall_s);
    // The result first: a disk that has filled up meanwhile must not cost it.
    let shown =
        if args.json { print_json(&document) } else { print_text(&document.table(mission, &flown.ends)) };
    directory.write_summary(&document)?;
    if let Some(out) = &args.out {
        let judged = (flown.report.violations.as_slice(), flown.excused.as_slice());
        let timeline =
            report::simulated::timeline(mission, &flown.world, &flown.records, flown.events.clone(), judged);
        directory.write_flight(&args.mission, &timeline)?;
        progress(&format!("kept in {}", out.display()));
    }
    Ok(match document.result {
        _ if shown != Exit::Done => shown,
        _ if document.is_good() => Exit::Done,
        FlightResult::Interrupted => Exit::Interrupted,
        FlightResult::Completed | FlightResult::Aborted => Exit::Bad,
    })
}
