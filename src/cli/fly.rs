//! `veilwing fly`: the companion of one vehicle, what runs onboard.

#[cfg(feature = "desk")]
mod in_step;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::process::Signal;
use tokio::runtime::Runtime;
use tokio::signal::unix::{self, SignalKind};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};

use crate::companion::Companion;
use crate::companion::orders_file::{self, OrdersFile};
use crate::companion::settings::{allow_for_clock_rate, pair_form, settings, transmitter_settings};
#[cfg(feature = "desk")]
use crate::config::file::usable_directory;
use crate::config::{Mission, Vehicle};
use crate::link::clock::Clock;
use crate::link::signing::RADIO_STATUS_ID;
use crate::link::{Form, Key, LinkAddress, LinkConfig, SigningConfig};
use crate::mission::Outcome;
use crate::planner::following::Moved;
use crate::planner::slots::Plan;
use crate::planning;
use crate::systemd::Manager;
use crate::transmitter::Transmitter;

use super::recording::Recording;
use super::{Exit, interrupt, load_mission, load_vehicle};

/// Names of the links, in logs and file names.
const AUTOPILOT: &str = "autopilot";
const RADIO: &str = "transmitter";
const PAIR: &str = "pair";

/// Run the companion of one vehicle, beside its autopilot.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing fly config/mission.toml --vehicle config/vehicle-i.toml")]
pub(super) struct Args {
    /// Mission file, the same on both vehicles.
    mission: PathBuf,
    /// Vehicle file of this vehicle.
    #[arg(long, value_name = "FILE")]
    vehicle: PathBuf,
    /// Begin as soon as both vehicles are ready, without waiting for MISSION_START from a ground station.
    #[arg(long)]
    start: bool,
    /// Seconds of the simulated world for each second of this machine's clock; for simulation alone.
    #[arg(long, hide = true, default_value_t = 1.0)]
    clock_rate: f64,
    /// Stop, in order, when stdin ends: with the program that started this one, however that ended.
    #[arg(long, hide = true)]
    until_stdin_ends: bool,
    /// The log directory is this one flight's: the logs themselves go there. `veilwing sitl` gives each flight one.
    #[cfg(feature = "desk")]
    #[arg(long, hide = true)]
    log_dir_is_the_flight_s: bool,
    /// Take the time from stdin instead of this machine's clock: `veilwing sitl` gives it.
    #[cfg(feature = "desk")]
    #[arg(long, hide = true, conflicts_with_all = ["clock_rate", "until_stdin_ends"])]
    clock_from_stdin: bool,
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match load_mission(&args.mission) {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    let vehicle = match load_vehicle(&args.vehicle) {
        Ok(vehicle) => vehicle,
        Err(exit) => return exit,
    };
    let findings = vehicle.check_against(&mission);
    eprint!("{findings}");
    if findings.has_errors() {
        return Exit::Unusable;
    }
    fly(args, mission, &vehicle).unwrap_or_else(|message| {
        eprintln!("error: {message}");
        Exit::Unusable
    })
}

fn fly(args: &Args, mission: Mission, vehicle: &Vehicle) -> Result<Exit, String> {
    #[cfg(feature = "desk")]
    if args.clock_from_stdin {
        return in_step::fly(args, mission, vehicle);
    }
    let clock = Clock::start(args.clock_rate).map_err(|error| error.to_string())?;
    let (runtime, _handled) = runtime()?;
    let recording = recording(args, &mission, vehicle, &clock)?;
    let _inside = runtime.enter();
    let companion = match companion(args, mission, vehicle, &clock, &recording) {
        Ok(companion) => companion,
        Err(error) => return Err(recording.failed(error, &clock)),
    };
    if args.until_stdin_ends {
        interrupt::when_stdin_ends();
    }
    let outcome = runtime.block_on(companion.run(clock.clone(), interrupt::requested()));
    recording.end(&clock, outcome.map_err(|error| error.to_string())).map(end)
}

/// Where this flight is recorded.
fn recording(args: &Args, mission: &Mission, vehicle: &Vehicle, clock: &Clock) -> Result<Recording, String> {
    #[cfg(feature = "desk")]
    if args.log_dir_is_the_flight_s {
        usable_directory(&vehicle.log_dir).map_err(|error| format!("[log] dir: {error}"))?;
        return Ok(Recording::into(&vehicle.log_dir));
    }
    let _ = args;
    Recording::begin(mission, vehicle, clock).map_err(|error| format!("[log] dir: {error}"))
}

/// The event loop's runtime, and a handler that it keeps.
pub(super) fn runtime() -> Result<(Runtime, unix::Signal), String> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| format!("the event loop cannot start: {error}"))?;
    // A limit on the size of files costs the logs that grow beyond it. Without a handler it would cost the flight, from
    // the first file on.
    let inside = runtime.enter();
    let file_size = SignalKind::from_raw(Signal::XFSZ.as_raw());
    let handled = unix::signal(file_size).map_err(|error| format!("a signal cannot be handled: {error}"))?;
    drop(inside);
    Ok((runtime, handled))
}

/// How the command ends.
fn end(outcome: Outcome) -> Exit {
    match outcome {
        Outcome::Completed => Exit::Done,
        Outcome::Aborted(cause) => {
            eprintln!("mission not completed: {cause}");
            Exit::Bad
        }
        Outcome::Interrupted => Exit::Interrupted,
    }
}

fn companion(
    args: &Args,
    mission: Mission,
    vehicle: &Vehicle,
    clock: &Clock,
    recording: &Recording,
) -> Result<Companion, String> {
    let role = vehicle.role;
    let boot_id = boot_id(clock);
    let mut settings = settings(&mission, vehicle, boot_id, args.start);
    let (orders, kept) =
        OrdersFile::open(orders_file::path(&vehicle.log_dir, role)).map_err(|error| error.to_string())?;
    settings.pair.orders = kept;
    allow_for_clock_rate(&mut settings, args.clock_rate);
    let Links { autopilot, radio, pair } = links(recording, vehicle)?;
    Ok(Companion {
        autopilot,
        radio,
        pair,
        transmitter: Transmitter::new(transmitter_settings(vehicle, boot_id), clock.now()),
        orders: Some(orders),
        computer: has_own_time(args).then(|| vehicle.log_dir.clone()),
        manager: manager(args)?,
        settings,
        flown: None,
        edited: edited(args.mission.clone(), mission.clone())?,
        planner: planner(mission, clock.clone(), recording.clone()),
    })
}

/// Where those that move are in the mission file each time that SIGUSR1 asks for it.
fn edited(path: PathBuf, flown: Mission) -> Result<UnboundedReceiver<Result<Vec<Moved>, String>>, String> {
    let asked = unix::signal(SignalKind::user_defined1());
    let mut asked = asked.map_err(|error| format!("a signal cannot be handled: {error}"))?;
    let (sender, receiver) = unbounded_channel();
    let flown = Arc::new(flown);
    tokio::spawn(async move {
        while asked.recv().await.is_some() {
            let (path, flown) = (path.clone(), Arc::clone(&flown));
            let read = tokio::task::spawn_blocking(move || {
                let edited = Mission::load(&path).map_err(|errors| {
                    eprint!("{errors}");
                    format!("it has errors: veilwing check {}", path.display())
                });
                edited.and_then(|edited| flown.moved(&edited))
            });
            if read.await.is_ok_and(|read| sender.send(read).is_err()) {
                break;
            }
        }
    });
    Ok(receiver)
}

/// By this machine's clock, and not by one that a simulation gives out: there nothing may depend on how the machine fares.
fn has_own_time(args: &Args) -> bool {
    #[cfg(feature = "desk")]
    if args.clock_from_stdin {
        return false;
    }
    let _ = args;
    true
}

/// Makes the plan, and has it kept with the flight's logs.
fn planner(
    mission: Mission,
    clock: Clock,
    recording: Recording,
) -> Box<dyn FnOnce() -> Result<Plan, String> + Send> {
    Box::new(move || {
        let options = planning::options(&mission);
        let timed =
            planning::plan_with(&mission, &options, || clock.now()).map_err(|error| error.to_string())?;
        let plan = timed.plan.clone();
        recording.keep_plan(mission, options, timed);
        Ok(plan)
    })
}

/// A vehicle's links, to be opened.
pub(super) struct Links {
    pub autopilot: (LinkAddress, LinkConfig),
    /// To a radio that is not reached through the autopilot.
    pub radio: Option<(LinkAddress, LinkConfig)>,
    pub pair: (LinkAddress, LinkConfig, Form),
}

/// The links that the vehicle file names, with their keys and logs.
pub(super) fn links(recording: &Recording, vehicle: &Vehicle) -> Result<Links, String> {
    let link = |to: &str, peer_system, key_file: Option<&Path>| -> Result<LinkConfig, String> {
        let signing = key_file.map(|path| signing(path, to, vehicle)).transpose()?;
        let tlog = recording.tlog(&format!("{}-{to}.tlog", vehicle.role.key()))?;
        // Ground stations speak through the autopilot; nobody speaks through the peer.
        let accept_foreign = to == AUTOPILOT;
        Ok(LinkConfig { name: to.into(), peer_system, accept_foreign, signing, tlog: Some(tlog) })
    };
    let (autopilot, radio) = (&vehicle.autopilot, &vehicle.transmitter);
    let radio_system = radio.system_id.or(autopilot.system_id);
    let radio = match &radio.link {
        Some(address) => Some((address.clone(), link(RADIO, radio_system, radio.key_file.as_deref())?)),
        None => None,
    };
    let autopilot_config = link(AUTOPILOT, autopilot.system_id, autopilot.key_file.as_deref())?;
    let pair_config = link(PAIR, vehicle.pair_peer_system, vehicle.key_file.as_deref())?;
    Ok(Links {
        autopilot: (autopilot.link.clone(), autopilot_config),
        radio,
        pair: (vehicle.pair_link.clone(), pair_config, pair_form(vehicle)),
    })
}

/// The service manager, where time is its own: nobody else's seconds feed a watchdog.
fn manager(args: &Args) -> Result<Manager, String> {
    #[allow(clippy::float_cmp, reason = "exactly 1 is the default")]
    if !has_own_time(args) || args.clock_rate != 1.0 {
        return Ok(Manager::none());
    }
    Manager::from_environment().map_err(|error| format!("NOTIFY_SOCKET: {error}"))
}

/// How the link called `to` signs. Each has a record of timestamps of its own, and a link id: with one key on several
/// links, what is recorded on one is still of another stream on the others.
fn signing(key_file: &Path, to: &str, vehicle: &Vehicle) -> Result<SigningConfig, String> {
    let name = vehicle.role.key();
    Ok(SigningConfig {
        key: Key::load(key_file).map_err(|error| error.to_string())?,
        link_id: match to {
            AUTOPILOT => 1,
            RADIO => 2,
            _ => 0,
        },
        state_file: vehicle.log_dir.join(format!("{name}-{to}.signing")),
        // SiK radios put their own into the stream, and have no key.
        unsigned_allowed: if to == AUTOPILOT { vec![RADIO_STATUS_ID] } else { Vec::new() },
    })
}

/// Different at each start: the clock's microseconds, which no restart can repeat within 70 minutes.
pub(super) fn boot_id(clock: &Clock) -> u32 {
    (clock.utc().unix_us & u64::from(u32::MAX)) as u32
}
