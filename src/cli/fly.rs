//! `veilwing fly`: the companion of one vehicle, what runs onboard.

use std::path::PathBuf;
use std::time::Duration;

use crate::companion::Companion;
use crate::config::{self, Mission, TransmitterKind, Vehicle};
use crate::link::clock::Clock;
use crate::link::{Key, LinkConfig, SigningConfig, TlogWriter};
use crate::mission::interlock::Ceilings;
use crate::mission::{Outcome, Settings};
use crate::role::Role;
use crate::transmitter::{Kind, PowerParameter, Transmitter, Unit};
use crate::{autopilot, pair, transmitter};

use super::planning::{mission_options, plan_mission, timing, transit_limits};
use super::{Exit, load_mission};

/// The longest jam lease and transmitter lease: the time in which everything falls silent by itself.
const LEASE: Duration = Duration::from_millis(500);
/// Without a word for this long the other vehicle is lost and the mission is given up.
const PEER_TIMEOUT: Duration = Duration::from_secs(3);

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
    let outcome = runtime.block_on(companion.run(clock, stop_signal()));
    match outcome.map_err(|error| error.to_string())? {
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
    use tokio::signal::unix::{SignalKind, signal};
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
    let own = (vehicle.autopilot.system_id.unwrap_or(default_system(role)), vehicle.autopilot.component_id);
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
    Ok(Companion {
        autopilot: (vehicle.autopilot.link.clone(), link(AUTOPILOT, vehicle.autopilot.system_id, None)?),
        pair: (vehicle.pair_link.clone(), link(PAIR, None, pair_signing)?),
        transmitter: Transmitter::new(transmitter_settings(vehicle, own), clock.now()),
        settings: settings(args, &mission, vehicle, own, clock),
        planner: Box::new(move || {
            plan_mission(&mission, &options).map(|timed| timed.plan).map_err(|error| error.to_string())
        }),
    })
}

/// MAVLink systems where the vehicle file names none.
fn default_system(role: Role) -> u8 {
    match role {
        Role::I => 1,
        Role::J => 2,
    }
}

fn settings(args: &Args, mission: &Mission, vehicle: &Vehicle, own: (u8, u8), clock: &Clock) -> Settings {
    let role = vehicle.role;
    let limits = transit_limits(mission);
    let mut autopilot = autopilot::Settings::new(own, mission.origin);
    autopilot.autopilot_system = vehicle.autopilot.system_id;
    autopilot.rate_hz = vehicle.autopilot.rate_hz;
    autopilot.planned_tilt_rad = mission.vehicles[role].max_tilt_rad.min(mission.airspace_max_tilt_rad);
    autopilot.tilt_rate_rad_s = limits[role].tilt_rate_rad_s;
    autopilot.takeoff_speed_m_s = limits[role].climb_m_s;
    autopilot.firmware = vehicle.autopilot.firmware;
    autopilot.actuation = vehicle.autopilot.actuation;
    Settings {
        role,
        own,
        autopilot,
        pair: pair::Settings {
            role,
            boot_id: boot_id(clock),
            mission_digest: mission.digest(),
            lease: LEASE,
            peer_timeout: PEER_TIMEOUT,
            clock_tolerance: Duration::from_secs_f64(mission.tdma.guard_s / 4.0),
        },
        airspace: mission.airspace.clone(),
        limits,
        timing: timing(mission),
        order: mission.tdma.order,
        jitter_rad: mission.jitter.std_rad,
        ceilings: Ceilings {
            mission_w: mission.power_ceiling(role).0,
            vehicle_w: vehicle.limits.max_power_w.unwrap_or(f64::INFINITY),
        },
        emission_authorised: vehicle.transmitter.simulated || mission.emission.is_some(),
        start_unasked: args.start,
    }
}

/// Different at each start: the clock's microseconds, which no restart can repeat within 70 minutes.
fn boot_id(clock: &Clock) -> u32 {
    (clock.utc().unix_us & u64::from(u32::MAX)) as u32
}

fn transmitter_settings(vehicle: &Vehicle, own: (u8, u8)) -> transmitter::Settings {
    let t = &vehicle.transmitter;
    let kind = match (t.kind, &t.parameter) {
        (TransmitterKind::Leased, _) => Kind::Leased { command: t.command },
        (TransmitterKind::Parameter, Some(parameter)) => Kind::Parameter(power_parameter(parameter)),
        (TransmitterKind::Parameter, None) | (TransmitterKind::None, _) => Kind::None,
    };
    transmitter::Settings { own, target: (own.0, t.component_id), kind }
}

fn power_parameter(parameter: &config::PowerParameter) -> PowerParameter {
    let unit = match parameter.unit {
        config::PowerUnit::Watt => Unit::Watt,
        config::PowerUnit::Milliwatt => Unit::Milliwatt,
        config::PowerUnit::Dbm => Unit::Dbm,
        config::PowerUnit::Levels => Unit::Levels(parameter.levels.clone()),
    };
    PowerParameter {
        name: parameter.name.clone(),
        protocol: parameter.protocol,
        unit,
        off_value: parameter.off_value,
    }
}
