//! `veilwing fly`: the companion of one vehicle, what runs onboard.

#[cfg(feature = "desk")]
mod in_step;

use std::path::{Path, PathBuf};

use rustix::process::Signal;
use tokio::runtime::Runtime;
use tokio::signal::unix::{self, SignalKind};

use crate::companion::Companion;
use crate::companion::orders_file::{self, OrdersFile};
use crate::companion::settings::{allow_for_clock_rate, pair_form, settings, transmitter_settings};
use crate::config::file::usable_directory;
use crate::config::{Mission, Vehicle};
use crate::link::clock::Clock;
use crate::link::signing::RADIO_STATUS_ID;
use crate::link::{Key, LinkConfig, SigningConfig, TlogWriter};
use crate::mission::Outcome;
use crate::planning;
use crate::transmitter::Transmitter;

use super::{Exit, interrupt, load_mission};

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
    /// Take the time from stdin instead of this machine's clock: `veilwing sitl --in-step` gives it.
    #[cfg(feature = "desk")]
    #[arg(long, hide = true, conflicts_with_all = ["clock_rate", "until_stdin_ends"])]
    clock_from_stdin: bool,
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match load_mission(&args.mission) {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    let vehicle = match Vehicle::load(&args.vehicle) {
        Ok(vehicle) => vehicle,
        Err(errors) => {
            eprint!("{errors}");
            return Exit::Unusable;
        }
    };
    let findings = vehicle.check_against(&mission);
    eprint!("{}{findings}", vehicle.warnings);
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
    let companion = companion(args, mission, vehicle, &clock)?;
    if args.until_stdin_ends {
        interrupt::when_stdin_ends();
    }
    let outcome = runtime.block_on(companion.run(clock, interrupt::requested()));
    Ok(end(outcome.map_err(|error| error.to_string())?))
}

/// The event loop's runtime, and a handler that it keeps.
fn runtime() -> Result<(Runtime, unix::Signal), String> {
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

fn companion(args: &Args, mission: Mission, vehicle: &Vehicle, clock: &Clock) -> Result<Companion, String> {
    usable_directory(&vehicle.log_dir).map_err(|error| format!("[log] dir: {error}"))?;
    let role = vehicle.role;
    let name = role.key();
    let link = |to: &str, peer_system, key_file: Option<&Path>| -> Result<LinkConfig, String> {
        let signing = key_file.map(|path| signing(path, to, vehicle)).transpose()?;
        let path = vehicle.log_dir.join(format!("{name}-{to}.tlog"));
        let tlog = TlogWriter::create(&path).map_err(|error| error.to_string())?;
        // Ground stations speak through the autopilot; nobody speaks through the peer.
        let accept_foreign = to == AUTOPILOT;
        Ok(LinkConfig { name: to.into(), peer_system, accept_foreign, signing, tlog: Some(tlog) })
    };
    let boot_id = boot_id(clock);
    let mut settings = settings(&mission, vehicle, boot_id, args.start);
    let (orders, kept) =
        OrdersFile::open(orders_file::path(&vehicle.log_dir, role)).map_err(|error| error.to_string())?;
    settings.pair.orders = kept;
    allow_for_clock_rate(&mut settings, args.clock_rate);
    let (autopilot, radio) = (&vehicle.autopilot, &vehicle.transmitter);
    let radio_system = radio.system_id.or(autopilot.system_id);
    let radio_link = match &radio.link {
        Some(address) => Some((address.clone(), link(RADIO, radio_system, radio.key_file.as_deref())?)),
        None => None,
    };
    Ok(Companion {
        autopilot: (
            autopilot.link.clone(),
            link(AUTOPILOT, autopilot.system_id, autopilot.key_file.as_deref())?,
        ),
        radio: radio_link,
        pair: (
            vehicle.pair_link.clone(),
            link(PAIR, vehicle.pair_peer_system, vehicle.key_file.as_deref())?,
            pair_form(vehicle),
        ),
        transmitter: Transmitter::new(transmitter_settings(vehicle, boot_id), clock.now()),
        orders: Some(orders),
        settings,
        planner: Box::new(move || planning::plan(&mission).map_err(|error| error.to_string())),
    })
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
fn boot_id(clock: &Clock) -> u32 {
    (clock.utc().unix_us & u64::from(u32::MAX)) as u32
}
