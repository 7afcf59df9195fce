//! The least that can fly a software vehicle: an in-test companion, in virtual time.

mod client;
mod flight;

use veilwing_sitl::*;

pub use self::client::*;
pub use self::flight::*;

/// Two users, two eavesdroppers, one tilted slot; vehicles with homes and local origins of their own.
pub fn config() -> WorldConfig {
    let pose = |position_enu_m, roll_deg: f64, pitch_deg: f64, tx_power_w| PlannedPose {
        position_enu_m,
        roll_rad: roll_deg.to_radians(),
        pitch_rad: pitch_deg.to_radians(),
        yaw_rad: 0.0,
        tx_power_w,
        lean_deg: 0.0,
    };
    let mut i = VehicleConfig::new(Role::I);
    i.home_enu_m = [-30.0, 10.0, 0.0];
    i.local_origin_offset_enu_m = [3.0, -2.0, 0.5];
    let mut j = VehicleConfig::new(Role::J);
    j.home_enu_m = [40.0, -20.0, 1.0];
    j.local_origin_offset_enu_m = [-1.0, 4.0, 0.0];
    WorldConfig {
        seed: 7,
        origin: Origin { lat_deg: 50.0755, lon_deg: 14.4378, alt_amsl_m: 200.0 },
        utc_start_us: 1_790_000_000_000_000,
        vehicles: [i, j],
        users: vec![exactly("alpha", [0.0; 3])],
        eavesdroppers: vec![exactly("hill", [120.0, -40.0, 0.0]), exactly("roof", [-60.0, 100.0, 0.0])],
        radio: RadioConfig {
            bandwidth_hz: 1e6,
            noise_power_w: 1e-12,
            reference_gain: 1.0,
            max_power_w: [0.5, 0.5],
        },
        fading: Fading::default(),
        airspace: AirspaceConfig {
            altitude_m: [20.0, 300.0],
            area_enu_m: vec![[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]],
            no_fly: Vec::new(),
            min_separation_m: 5.0,
        },
        jitter: JitterConfig::default(),
        slots: vec![PlannedSlot {
            turns: None,
            user: "alpha".into(),
            secrecy_rate_bps: 20e6,
            poses: [pose([-20.0, 15.0, 30.0], 60.0, -20.0, 0.4), pose([25.0, -30.0, 40.0], 0.0, 0.0, 0.01)],
        }],
        tolerance: Tolerance::default(),
    }
}

/// A receiver where it is said to be.
pub fn exactly(name: &str, position_enu_m: [f64; 3]) -> Node {
    Node { name: name.into(), position_enu_m, uncertainty: Uncertainty::Exact, roams: None }
}
