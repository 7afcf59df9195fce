//! `veilwing fly`: the companion of one vehicle, what runs onboard.

use std::path::PathBuf;

use rustix::process::{Signal, getpid, kill_process};
use tokio::signal::unix::{SignalKind, signal};

use crate::companion::Companion;
use crate::companion::orders_file::{self, OrdersFile};
use crate::companion::settings::{allow_for_clock_rate, pair_form, settings, transmitter_settings};
use crate::config::file::usable_directory;
use crate::config::{Mission, Vehicle};
use crate::link::clock::Clock;
use crate::link::{Key, LinkConfig, SigningConfig, TlogWriter};
use crate::mission::Outcome;
use crate::planning;
use crate::transmitter::Transmitter;

use super::{Exit, interrupt, load_mission};

/// Names of the two links, in logs and file names.
const AUTOPILOT: &str = "autopilot";
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
    let clock = Clock::start(args.clock_rate).map_err(|error| error.to_string())?;
    let companion = companion(args, mission, vehicle, &clock)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| format!("the event loop cannot start: {error}"))?;
    if args.until_stdin_ends {
        std::thread::spawn(|| {
            // However the reading ends, nobody is at the other end.
            let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
            let _ = kill_process(getpid(), Signal::TERM);
        });
    }
    let outcome = runtime.block_on(async {
        // A limit on the size of files costs the logs that grow beyond it. Without a handler it would cost the flight.
        let file_size = SignalKind::from_raw(Signal::XFSZ.as_raw());
        let _handled = signal(file_size).map_err(|error| format!("a signal cannot be handled: {error}"))?;
        companion.run(clock, interrupt::requested()).await.map_err(|error| error.to_string())
    });
    match outcome? {
        Outcome::Completed => Ok(Exit::Done),
        Outcome::Aborted(cause) => {
            eprintln!("mission not completed: {cause}");
            Ok(Exit::Bad)
        }
        Outcome::Interrupted => Ok(Exit::Interrupted),
    }
}

fn companion(args: &Args, mission: Mission, vehicle: &Vehicle, clock: &Clock) -> Result<Companion, String> {
    usable_directory(&vehicle.log_dir).map_err(|error| format!("[log] dir: {error}"))?;
    let role = vehicle.role;
    let name = role.to_string().to_lowercase();
    let link = |to: &str, peer_system, signing| -> Result<LinkConfig, String> {
        let path = vehicle.log_dir.join(format!("{name}-{to}.tlog"));
        let tlog = TlogWriter::create(&path).map_err(|error| error.to_string())?;
        // Ground stations speak through the autopilot; nobody speaks through the peer.
        let accept_foreign = to == AUTOPILOT;
        Ok(LinkConfig { name: to.into(), peer_system, accept_foreign, signing, tlog: Some(tlog) })
    };
    let pair_signing = match &vehicle.key_file {
        Some(path) => Some(SigningConfig {
            key: Key::load(path).map_err(|error| error.to_string())?,
            link_id: 0,
            state_file: vehicle.log_dir.join(format!("{name}-{PAIR}.signing")),
            unsigned_allowed: Vec::new(),
        }),
        None => None,
    };
    let boot_id = boot_id(clock);
    let mut settings = settings(&mission, vehicle, boot_id, args.start);
    let (orders, kept) =
        OrdersFile::open(orders_file::path(&vehicle.log_dir, role)).map_err(|error| error.to_string())?;
    settings.pair.orders = kept;
    allow_for_clock_rate(&mut settings, args.clock_rate);
    Ok(Companion {
        autopilot: (vehicle.autopilot.link.clone(), link(AUTOPILOT, vehicle.autopilot.system_id, None)?),
        pair: (
            vehicle.pair_link.clone(),
            link(PAIR, vehicle.pair_peer_system, pair_signing)?,
            pair_form(vehicle),
        ),
        transmitter: Transmitter::new(transmitter_settings(vehicle, boot_id), clock.now()),
        orders: Some(orders),
        settings,
        planner: Box::new(move || planning::plan(&mission).map_err(|error| error.to_string())),
    })
}

/// Different at each start: the clock's microseconds, which no restart can repeat within 70 minutes.
fn boot_id(clock: &Clock) -> u32 {
    (clock.utc().unix_us & u64::from(u32::MAX)) as u32
}
