//! `veilwing-sitl`: one software vehicle alone on a UDP address, for any MAVLink client; or a calibration flight's log.

mod calibrate;
mod udp;

use std::io::IsTerminal;
use std::process::ExitCode;
use std::time::Duration;

use clap::{Parser, Subcommand, ValueEnum};
use tokio::signal::unix::{Signal, SignalKind, signal};
use veilwing_sitl::{
    Airframe, AirframeModel, Firmware, JitterConfig, Origin, Role, Vehicle, VehicleConfig, WindConfig,
};

const EXAMPLES: &str = "Examples:
  veilwing-sitl vehicle --link udpout:127.0.0.1:14550
      a PX4-like vehicle that a ground station on this machine finds by itself
  veilwing-sitl vehicle --link udpin:0.0.0.0:14540 --firmware ardupilot --speed 5 --home 47.397,8.545,488
      an ArduCopter-like one that waits for its client, five times as fast as real time
  veilwing-sitl vehicle --link udpin:127.0.0.1:14540 --ground-station udpout:127.0.0.1:14550
      a companion on one link, and a ground station on the other that sees both";

#[derive(Parser)]
#[command(version, about = "Software vehicle behind a MAVLink autopilot face", after_help = EXAMPLES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// One software vehicle alone on a UDP address
    #[command(after_help = EXAMPLES)]
    Vehicle(VehicleArguments),
    /// A flight round a receiver that calibrates an antenna, with a given truth: its log as CSV
    #[command(after_help = calibrate::EXAMPLES)]
    Calibrate(calibrate::CalibrateArguments),
}

#[derive(Clone, Copy, ValueEnum)]
enum FirmwareArgument {
    Px4,
    Ardupilot,
}

#[derive(Clone, Copy, ValueEnum)]
enum AirframeArgument {
    Omnidirectional,
    Conventional,
}

#[derive(clap::Args)]
struct VehicleArguments {
    /// Where the client is: udpout:HOST:PORT sends there, udpin:HOST:PORT waits for it
    #[arg(long)]
    link: udp::Link,
    /// A ground station beside the client, written as --link; it hears and reaches whatever is on that one. May be
    /// repeated
    #[arg(long, value_name = "LINK")]
    ground_station: Vec<udp::Link>,
    /// Whose manners the autopilot has
    #[arg(long, value_enum, default_value = "px4")]
    firmware: FirmwareArgument,
    /// What the rotors can do
    #[arg(long, value_enum, default_value = "omnidirectional")]
    airframe: AirframeArgument,
    /// An airframe of its own: mass, drag and rotors from a TOML file, as in sitl/airframes
    #[arg(long, value_name = "FILE", conflicts_with = "airframe")]
    airframe_file: Option<std::path::PathBuf>,
    /// Mean wind in m/s, where the air moves to: EAST,NORTH,UP
    #[arg(long, default_value = "0,0,0", value_parser = parse_wind, allow_hyphen_values = true)]
    wind: [f64; 3],
    /// Wind at 6 m that the turbulence belongs to, m/s: 7.7 is light, 15.4 moderate, 23 severe; 0 is none
    #[arg(long, default_value_t = 0.0, value_parser = parse_turbulence)]
    turbulence: f64,
    /// MAVLink system id, 1 to 254; the payload radio shares it
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=254))]
    system_id: u8,
    /// Where it stands: latitude and longitude in degrees, height above the sea in metres
    #[arg(long, default_value = "50.0755,14.4378,200", value_parser = parse_home)]
    home: Origin,
    /// Random seed of gusts and jitter
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Simulated seconds per second, 0.01 to 100
    #[arg(long, default_value_t = 1.0, value_parser = parse_speed)]
    speed: f64,
    /// Stop after this many simulated seconds
    #[arg(long, value_parser = parse_duration)]
    duration: Option<Duration>,
    /// Standard deviation of an injected attitude jitter, degrees
    #[arg(long, default_value_t = 0.0, value_parser = parse_jitter)]
    jitter: f64,
}

fn parse_home(text: &str) -> Result<Origin, String> {
    let values: Vec<f64> = text.split(',').filter_map(|v| v.trim().parse().ok()).collect();
    match values[..] {
        [lat_deg, lon_deg, alt_amsl_m]
            if lat_deg.abs() <= 90.0
                && lon_deg.abs() <= 180.0
                && (-1000.0..=10_000.0).contains(&alt_amsl_m) =>
        {
            Ok(Origin { lat_deg, lon_deg, alt_amsl_m })
        }
        _ => Err("write LATITUDE,LONGITUDE,HEIGHT, for example 50.0755,14.4378,200".to_owned()),
    }
}

fn number(text: &str, range: std::ops::RangeInclusive<f64>) -> Result<f64, String> {
    let value = text.parse().map_err(|_| format!("\"{text}\" is no number"))?;
    if range.contains(&value) {
        Ok(value)
    } else {
        Err(format!("{value} is outside {} to {}", range.start(), range.end()))
    }
}

fn parse_speed(text: &str) -> Result<f64, String> {
    number(text, 0.01..=100.0)
}

fn parse_jitter(text: &str) -> Result<f64, String> {
    number(text, 0.0..=45.0)
}

fn parse_duration(text: &str) -> Result<Duration, String> {
    number(text, 0.0..=1e7).map(Duration::from_secs_f64)
}

fn parse_wind(text: &str) -> Result<[f64; 3], String> {
    let values: Vec<f64> = text.split(',').filter_map(|v| v.trim().parse().ok()).collect();
    match values[..] {
        [east, north, up] if values.iter().all(|v| v.abs() <= 100.0) => Ok([east, north, up]),
        _ => Err("write EAST,NORTH,UP in m/s, each at most 100, for example 3,-1,0".to_owned()),
    }
}

fn parse_turbulence(text: &str) -> Result<f64, String> {
    number(text, 0.0..=50.0)
}

/// The airframe of a file.
fn airframe(path: &std::path::Path) -> Result<AirframeModel, String> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|error| format!("{name}: {error}"))?;
    AirframeModel::parse(&name, &text).map_err(|error| error.to_string())
}

fn vehicle(arguments: &VehicleArguments) -> Result<Vehicle, String> {
    let mut config = VehicleConfig::new(Role::I);
    config.system_id = arguments.system_id;
    config.firmware = match arguments.firmware {
        FirmwareArgument::Px4 => Firmware::Px4,
        FirmwareArgument::Ardupilot => Firmware::ArduCopter,
    };
    config.airframe = match arguments.airframe {
        AirframeArgument::Omnidirectional => Airframe::Omnidirectional,
        AirframeArgument::Conventional => Airframe::Conventional,
    };
    if let Some(path) = &arguments.airframe_file {
        config.fly(airframe(path)?);
    }
    config.wind = WindConfig { mean_enu_m_s: arguments.wind, turbulence_m_s: arguments.turbulence };
    let jitter = JitterConfig { std_deg: arguments.jitter, ..JitterConfig::default() };
    let utc_us = utc_at_speed_us(utc_now_us(), arguments.speed);
    Ok(Vehicle::new(config, jitter, arguments.home, utc_us, arguments.seed))
}

/// UTC that has run at this speed since the machine's last midnight: two vehicles of one speed, started one after the
/// other, agree on the time. At speed 1 it is the machine's.
fn utc_at_speed_us(now_us: u64, speed: f64) -> u64 {
    const DAY_US: u64 = 86_400_000_000;
    let since_midnight = now_us % DAY_US;
    now_us - since_midnight + (since_midnight as f64 * speed) as u64
}

#[allow(clippy::disallowed_methods)]
fn utc_now_us() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_micros()).unwrap_or(u64::MAX)
}

/// Ctrl-C and SIGTERM.
struct Interrupts {
    interrupt: Signal,
    terminate: Signal,
}

impl Interrupts {
    fn listen() -> std::io::Result<Self> {
        Ok(Self { interrupt: signal(SignalKind::interrupt())?, terminate: signal(SignalKind::terminate())? })
    }

    async fn arrive(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}

/// As many as the vehicle's router has links for, beside the client's.
const MOST_GROUND_STATIONS: usize = 15;

/// The client's link first.
async fn bind_all(arguments: &VehicleArguments) -> Result<Vec<udp::Port>, String> {
    if arguments.ground_station.len() > MOST_GROUND_STATIONS {
        return Err(format!("at most {MOST_GROUND_STATIONS} ground stations"));
    }
    let mut ports = Vec::new();
    for link in std::iter::once(&arguments.link).chain(&arguments.ground_station) {
        ports.push(udp::Port::bind(*link).await.map_err(|error| format!("{link}: {error}"))?);
    }
    Ok(ports)
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    let arguments = match Arguments::parse().command {
        Command::Vehicle(arguments) => arguments,
        Command::Calibrate(arguments) => {
            return match calibrate::run(&arguments) {
                Ok(()) => ExitCode::SUCCESS,
                Err(message) => {
                    eprintln!("veilwing-sitl: {message}");
                    ExitCode::from(2)
                }
            };
        }
    };
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| "info".into()),
        )
        .init();
    let (mut interrupts, mut ports) = match (Interrupts::listen(), bind_all(&arguments).await) {
        (Ok(interrupts), Ok(ports)) => (interrupts, ports),
        (Err(error), _) => {
            eprintln!("veilwing-sitl: signals: {error}");
            return ExitCode::from(2);
        }
        (_, Err(message)) => {
            eprintln!("veilwing-sitl: {message}");
            return ExitCode::from(2);
        }
    };
    let mut vehicle = match vehicle(&arguments) {
        Ok(vehicle) => vehicle,
        Err(message) => {
            eprintln!("veilwing-sitl: {message}");
            return ExitCode::from(2);
        }
    };
    let pace = udp::Pace { speed: arguments.speed, duration: arguments.duration };
    tracing::info!("system {} on {} at {}x", arguments.system_id, arguments.link, arguments.speed);
    let code = tokio::select! {
        () = udp::run(&mut vehicle, &mut ports, pace) => ExitCode::SUCCESS,
        () = interrupts.arrive() => ExitCode::from(130),
    };
    let counters = vehicle.counters();
    tracing::info!(
        "{} frames received, {} bad checksums, {} setpoints taken",
        counters.wire.frames,
        counters.wire.bad_checksums,
        counters.setpoints.accepted
    );
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_vehicles_started_one_after_the_other_agree_on_the_time() {
        let (first, later) = (1_790_000_000_000_000, 1_790_000_003_000_000);
        assert_eq!(utc_at_speed_us(first, 1.0), first);
        // The first has flown for three seconds at five times the speed when the other starts.
        assert_eq!(utc_at_speed_us(later, 5.0), utc_at_speed_us(first, 5.0) + 15_000_000);
    }
}
