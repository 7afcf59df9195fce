//! `veilwing watch`: the state and the view of [`crate::desk::watch`] in this terminal, round a loop that has the sockets, the
//! keys and the clock.

mod screen;
mod station;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use mavlink::dialects::ardupilotmega::{MavAutopilot, MavMessage, MavModeFlag, MavState, MavType};

use crate::desk::watch::{After, Recording, Source, State};
use crate::link::signing::Key;
use crate::link::{Clock, LinkAddress};

use super::Exit;
pub(super) use screen::{Screen, aside, is_possible, is_shown, takes_over};
pub(super) use station::{Port, Station};

const EXAMPLES: &str = "Examples:
  veilwing watch udpin:0.0.0.0:14550
      both companions, where ground stations listen: whoever sends there
  veilwing watch udpin:0.0.0.0:14551 serial:/dev/ttyUSB0:57600
      each on a link of its own
  veilwing watch flight-1
      a recorded flight: of `sitl --out`, of a companion's [log] dir, or a ground station's .tlog";

/// What an operator speaks as.
const STATION: u8 = 255;
const STATION_COMPONENT: u8 = 190;
/// A companion's component, where nothing else is given.
const COMPANION: u8 = 191;

/// Watch both companions in this terminal, and order them; or a recorded flight.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Args {
    /// MAVLink addresses (udpin:, udpout:, tcpin:, tcpout:, serial:), or one recorded flight: a directory, or a .tlog.
    #[arg(required = true, value_name = "ADDRESS|DIR")]
    what: Vec<String>,
    /// The key of signed links to the companions' autopilots: what is unsigned is not taken, orders are signed.
    #[arg(long, value_name = "FILE")]
    key_file: Option<PathBuf>,
    /// The MAVLink system that this station speaks as: one of the vehicle files' [operators] system_ids.
    #[arg(long, value_name = "ID", default_value_t = STATION, value_parser = clap::value_parser!(u8).range(1..))]
    system_id: u8,
    /// The companions' MAVLink component.
    #[arg(long, value_name = "ID", default_value_t = COMPANION, value_parser = clap::value_parser!(u8).range(1..))]
    component_id: u8,
    /// Send no HEARTBEAT: to an autopilot that counts ground stations this one is not there, and it may pass nothing on.
    #[arg(long)]
    no_heartbeat: bool,
}

pub(super) fn run(args: &Args) -> Exit {
    match watch(args) {
        Ok(exit) => exit,
        Err(message) => {
            eprintln!("error: {message}");
            Exit::Unusable
        }
    }
}

fn watch(args: &Args) -> Result<Exit, String> {
    screen::is_possible()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| format!("the event loop cannot start: {error}"))?;
    let clock = Clock::real();
    if let Some(path) = recorded(&args.what)? {
        let recording = Recording::load(&path).map_err(|error| error.to_string())?;
        let state = State::recorded(path.display().to_string(), args.component_id, recording, clock.now());
        return runtime.block_on(look(state, Vec::new(), &clock, None));
    }
    let addresses: Vec<LinkAddress> = args
        .what
        .iter()
        .map(|text| text.parse().map_err(|error| told(text, error)))
        .collect::<Result<_, _>>()?;
    let key = args.key_file.as_deref().map(Key::load).transpose().map_err(|error| error.to_string())?;
    let own = (args.system_id, STATION_COMPONENT);
    let heartbeat = (!args.no_heartbeat).then(heartbeat);
    runtime.block_on(async {
        let mut ports = Vec::new();
        for (place, address) in addresses.iter().enumerate() {
            ports.push(Port::open(address, place, key.as_ref(), &clock).await?);
        }
        let state = State::new(Source::Live(args.what.clone()), args.component_id, utc_of_zero(&clock));
        look(state, ports, &clock, Some(Station { own, heartbeat })).await
    })
}

fn told(text: &str, error: impl std::fmt::Display) -> String {
    format!("{text}: {error}; and there is no such directory or file")
}

/// What is no address is a recorded flight, alone.
fn recorded(what: &[String]) -> Result<Option<PathBuf>, String> {
    let Some(path) = what.iter().find(|what| Path::new(what).exists()) else { return Ok(None) };
    match what {
        [_] => Ok(Some(PathBuf::from(path))),
        _ => Err(format!("{path} is a recorded flight: give it alone")),
    }
}

/// UTC at the clock's instant 0.
pub(super) fn utc_of_zero(clock: &Clock) -> crate::time::Utc {
    let passed_us = u64::try_from(clock.now().since_start().as_micros()).unwrap_or_default();
    crate::time::Utc { unix_us: clock.utc().unix_us.saturating_sub(passed_us) }
}

/// That of a ground station.
fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(mavlink::dialects::ardupilotmega::HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// Shows the state until the operator leaves, or a signal ends it.
async fn look(
    state: State,
    ports: Vec<Port>,
    clock: &Clock,
    station: Option<Station>,
) -> Result<Exit, String> {
    let mut screen = Screen::open()?;
    let ended = screen.run(state, ports, clock, station, true, &AtomicBool::new(false)).await;
    drop(screen);
    match ended.map_err(|error| format!("the terminal takes nothing any more: {error}"))? {
        Some(After::Leave | After::Stay) => Ok(Exit::Done),
        Some(After::Interrupt) | None => Ok(Exit::Interrupted),
    }
}
