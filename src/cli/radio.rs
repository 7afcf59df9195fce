//! `veilwing radio`: the radio host beside a transmitter, its calibration, and its times.

mod bench;
mod calibrate;
mod measure;
#[cfg(feature = "desk")]
mod simulated_line;

use std::path::{Path, PathBuf};

use super::recording::Recording;
use super::{Exit, interrupt};
use crate::config::RadioFile;
use crate::link::{Clock, Form, Key, LinkConfig, SigningConfig};
use crate::radio_device::{AnyDevice, Line, gpio};
use crate::radio_host::Settings;
use crate::radio_loop::{RadioProcess, Stopped, kept_kill};
use crate::systemd::Manager;
use crate::transmitter::wire::WHOLE;

/// Set a transmitter's power by lease: the radio's side, as a small process beside it.
///
/// Silent at the start, at the end, and whenever the companion's lease runs out.
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "Example: veilwing radio config/radio.toml\nA radio file to start from: config/radio.toml"
)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Option<Command>,
    /// The radio file.
    #[arg(required = true, value_name = "RADIO.toml")]
    file: Option<PathBuf>,
    /// Stop, in order, when stdin ends: with the program that started this one, however that ended.
    #[arg(long, hide = true)]
    until_stdin_ends: bool,
    /// What the kill line is driven to goes there, a word a datagram, and the file's own line is not touched: for simulation.
    #[cfg(feature = "desk")]
    #[arg(long, hide = true)]
    simulated_line: Option<std::net::SocketAddr>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Measure(measure::Args),
    Calibrate(calibrate::Args),
}

/// Runs it.
pub(super) fn run(args: &Args) -> Exit {
    match (&args.command, &args.file) {
        (Some(Command::Measure(args)), _) => measure::run(args),
        (Some(Command::Calibrate(args)), _) => calibrate::run(args),
        (None, Some(file)) => {
            if args.until_stdin_ends {
                interrupt::when_stdin_ends();
            }
            host(args, file)
        }
        (None, None) => Exit::Unusable,
    }
}

fn host(args: &Args, file: &Path) -> Exit {
    let Ok(radio) = load(RadioFile::load(file)) else { return Exit::Unusable };
    let (runtime, clock) = match bench::runtime() {
        Ok(runtime) => (runtime, Clock::real()),
        Err(error) => return unusable(&error),
    };
    // The host before this one may have died on the air: one that cannot start has said off all the same.
    let refuse = |error: &str| {
        let exit = unusable(error);
        let Some(mut device) = radio.device(&clock) else { return exit };
        match runtime.block_on(bench::off(&mut device, &clock)) {
            Ok(()) => eprintln!("the device was turned off"),
            Err(error) => eprintln!("error: {error}: {MAY_RADIATE}"),
        }
        exit
    };
    // Off before anything else can fail.
    let line = match line(args, file, &radio) {
        Ok(line) => line,
        Err(error) => return refuse(&error),
    };
    let recording = match Recording::begin_radio(&radio, &clock) {
        Ok(recording) => recording,
        Err(error) => return refuse(&format!("[log] dir: {error}")),
    };
    let process = match process(&radio, line, &clock, &recording) {
        Ok(process) => process,
        Err(error) => return refuse(&recording.failed(error, &clock)),
    };
    let stopped = runtime.block_on(process.run(clock.clone(), interrupt::requested()));
    recording.end_radio(&clock, &stopped);
    match stopped {
        Ok(Stopped::Off) => Exit::Interrupted,
        Ok(Stopped::ByLine) => {
            eprintln!(
                "error: the device was not read back off: the kill line keeps it silent, as far as its pull resistor does \
                 without this program; cut its supply"
            );
            Exit::Bad
        }
        Ok(Stopped::MayRadiate) => {
            eprintln!("error: the device was not read back off: {MAY_RADIATE}");
            Exit::Bad
        }
        Err(error) => refuse(&error.to_string()),
    }
}

/// What is said where somebody may be about to radiate unawares.
const RADIATES: &str = "this radiates: with a dummy load or a power meter on, say --radiate";

const MAY_RADIATE: &str = "the device may radiate; cut its supply";

fn unusable(error: &str) -> Exit {
    eprintln!("error: {error}");
    Exit::Unusable
}

/// Says what is to be said of a file.
fn load(loaded: Result<RadioFile, crate::config::Diagnostics>) -> Result<RadioFile, Exit> {
    match loaded {
        Ok(radio) => {
            eprint!("{}", radio.warnings);
            Ok(radio)
        }
        Err(errors) => {
            eprint!("{errors}");
            Err(Exit::Unusable)
        }
    }
}

/// The file's kill line, driven off.
fn kill_line(file: &Path, radio: &RadioFile) -> Result<Option<Box<dyn Line>>, String> {
    let Some((settings, _)) = radio.kill_line() else { return Ok(None) };
    gpio::open(&settings).map(Some).map_err(|error| format!("{}: [kill_line]: {error}", file.display()))
}

/// The line that is driven: the file's, or what stands for it.
fn line(args: &Args, file: &Path, radio: &RadioFile) -> Result<Option<Box<dyn Line>>, String> {
    #[cfg(feature = "desk")]
    if let (Some(to), true) = (args.simulated_line, radio.kill_line().is_some()) {
        return Ok(Some(simulated_line::open(to)?));
    }
    let _ = args;
    kill_line(file, radio)
}

fn process(
    radio: &RadioFile,
    line: Option<Box<dyn Line>>,
    clock: &Clock,
    recording: &Recording,
) -> Result<RadioProcess<AnyDevice>, String> {
    let kill_file = radio.log_dir.join("radio.kill");
    let killed = kept_kill(&kill_file).map_err(|error| error.to_string())?;
    if killed {
        eprintln!("a radio kill holds: lift it by 31011 with param1 = 1 to this component");
    }
    let signing = match &radio.key_file {
        None => None,
        Some(path) => Some(SigningConfig {
            key: Key::load(path).map_err(|error| error.to_string())?,
            // The companion's end of this link has 2 (one key, another stream).
            link_id: 3,
            state_file: radio.log_dir.join("radio.signing"),
            unsigned_allowed: Vec::new(),
        }),
    };
    let tlog = recording.tlog("radio.tlog")?;
    let signed = signing.is_some();
    let link = LinkConfig {
        name: "radio".to_owned(),
        peer_system: Some(radio.system_id),
        // An operator's kill comes the same way.
        accept_foreign: true,
        signing,
        tlog: Some(tlog),
    };
    // Microseconds since 1970: no two starts have the same.
    let seed = clock.utc().unix_us;
    let settings = Settings {
        own: (radio.system_id, radio.component_id),
        commanders: radio.commanders.clone(),
        operators: radio.operators.clone(),
        signed,
        command: radio.command,
        facts: radio.facts(),
        scale: radio.scale.clone(),
        below_db: radio.device.tolerance_db,
        line: radio.kill_line().map(|(_, times)| times),
        killed,
        seed,
        clock_began_ms: u32::try_from(seed / 1000 % u64::from(WHOLE)).unwrap_or_default(),
    };
    let device = radio.device(clock).ok_or("the file names no device")?;
    let form = if radio.tunnel { Form::Tunnel { to_system: 0 } } else { Form::Plain };
    let manager = Manager::from_environment().map_err(|error| format!("NOTIFY_SOCKET: {error}"))?;
    Ok(RadioProcess { link: (radio.address.clone(), link), form, settings, device, line, kill_file, manager })
}
