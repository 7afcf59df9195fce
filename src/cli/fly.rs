//! `veilwing fly`: the companion of one vehicle, what runs onboard.

use std::path::PathBuf;

use tokio::signal::unix::{SignalKind, signal};

use crate::companion::Companion;
use crate::companion::settings::{allow_for_clock_rate, pair_form, settings, transmitter_settings};
use crate::config::{Mission, Vehicle};
use crate::link::clock::Clock;
use crate::link::{Key, LinkConfig, SigningConfig, TlogWriter};
use crate::mission::Outcome;
use crate::transmitter::Transmitter;

use super::planning::{mission_options, plan_mission};
use super::{Exit, load_mission};

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
    #[arg(long)]
    vehicle: PathBuf,
    /// Begin as soon as both vehicles are ready, without waiting for MISSION_START from a ground station.
    #[arg(long)]
    start: bool,
    /// Seconds of the simulated world for each second of this machine's clock; for simulation alone.
    #[arg(long, hide = true, default_value_t = 1.0)]
    clock_rate: f64,
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match load_mission(&args.mission) {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    let vehicle = match Vehicle::load(&args.vehicle) {
        Ok(vehicle) => vehicle,
        Err(errors) => {
            eprintln!("{errors}");
            return Exit::Unusable;
        }
    };
    let findings = vehicle.check_against(&mission);
    if !findings.is_empty() {
        eprintln!("{findings}");
    }
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
    let outcome = runtime.block_on(async {
        // A limit on the size of files costs the logs that grow beyond it. Without a handler it would cost the flight.
        let file_size = SignalKind::from_raw(rustix::process::Signal::XFSZ.as_raw());
        let _handled = signal(file_size).map_err(|error| format!("a signal cannot be handled: {error}"))?;
        companion.run(clock, stop_signal()).await.map_err(|error| error.to_string())
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

/// Completes on Ctrl-C or SIGTERM.
pub(super) async fn stop_signal() {
    let wait = |kind| async move {
        match signal(kind) {
            Ok(mut stream) => {
                stream.recv().await;
            }
            // Without a handler the signal's default ends the process; the radio's expiry makes it silent.
            Err(_) => std::future::pending().await,
        }
    };
    tokio::select! {
        () = wait(SignalKind::interrupt()) => {}
        () = wait(SignalKind::terminate()) => {}
    }
}

fn companion(args: &Args, mission: Mission, vehicle: &Vehicle, clock: &Clock) -> Result<Companion, String> {
    std::fs::create_dir_all(&vehicle.log_dir)
        .map_err(|error| format!("log directory {}: {error}", vehicle.log_dir.display()))?;
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
    let options = mission_options(&mission);
    let mut settings = settings(&mission, vehicle, boot_id(clock), args.start);
    allow_for_clock_rate(&mut settings, args.clock_rate);
    Ok(Companion {
        autopilot: (vehicle.autopilot.link.clone(), link(AUTOPILOT, vehicle.autopilot.system_id, None)?),
        pair: (
            vehicle.pair_link.clone(),
            link(PAIR, vehicle.pair_peer_system, pair_signing)?,
            pair_form(vehicle),
        ),
        transmitter: Transmitter::new(transmitter_settings(vehicle), clock.now()),
        settings,
        planner: Box::new(move || {
            plan_mission(&mission, &options).map(|timed| timed.plan).map_err(|error| error.to_string())
        }),
    })
}

/// Different at each start: the clock's microseconds, which no restart can repeat within 70 minutes.
fn boot_id(clock: &Clock) -> u32 {
    (clock.utc().unix_us & u64::from(u32::MAX)) as u32
}
