//! How fast the world runs and how well it holds: a pair in a tilted slot in 4 m/s of wind with gusts, telemetry and
//! setpoints at 50 Hz, 2 degrees of jitter, an estimator that errs, both on the air.
//!
//! `cargo run --release -p veilwing-sitl --example speed`

// It uses its own part; helpers of tests may panic as tests may.
#[allow(dead_code, clippy::expect_used)]
#[path = "../tests/world/common/mod.rs"]
mod common;

use common::{Flight, config};
use veilwing_sitl::{SensorConfig, WindConfig};

#[allow(clippy::disallowed_methods)] // A stopwatch: the figure is wall time.
fn main() {
    let mut config = config();
    config.jitter.std_deg = 2.0;
    let wind = WindConfig { mean_enu_m_s: [4.0, 0.0, 0.0], turbulence_m_s: 8.0 };
    for vehicle in &mut config.vehicles {
        vehicle.wind = wind;
        vehicle.sensors = SensorConfig::typical();
    }
    let mut flight = Flight::at_slot(config);
    for client in &mut flight.clients {
        for id in [31.0, 32.0] {
            client.command(
                &mut flight.world,
                mavlink::dialects::ardupilotmega::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                &[id, 20_000.0],
            );
        }
    }
    flight.hold(0, 500, [false, true]);
    let simulated_s = 600.0;
    let start = std::time::Instant::now();
    flight.hold(0, 600_000, [true, true]);
    let wall_s = start.elapsed().as_secs_f64();
    println!("{simulated_s} s simulated in {wall_s:.3} s: {:.0} times real time", simulated_s / wall_s);
    let report = flight.world.report();
    println!("{:#?}\nviolations: {:?}", report.slots[0], report.violations);
}
