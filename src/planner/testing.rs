//! A problem for the tests of this module: the paper's setup.

use nalgebra::{Vector2, Vector3};

use super::problem::{
    Airframe, Airspace, Eavesdropper, Jitter, JitterAxes, JitterModel, Objective, Problem, Radio,
    Uncertainty, VehicleModel,
};
use crate::role::PerVehicle;

/// The paper's setup at 0.5 W with these eavesdroppers and this Euler jitter.
pub fn problem(eavesdroppers: &[[f64; 2]], jitter_deg: f64) -> Problem {
    let vehicle =
        VehicleModel { airframe: Airframe::Omnidirectional, max_tilt_rad: std::f64::consts::FRAC_PI_2 };
    let corners = [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]];
    let node = |p: &[f64; 2]| Eavesdropper {
        position_enu_m: Vector3::new(p[0], p[1], 0.0),
        uncertainty: Uncertainty::None,
    };
    Problem {
        user_enu_m: Vector3::zeros(),
        eavesdroppers: eavesdroppers.iter().map(node).collect(),
        radio: Radio {
            bandwidth_hz: 1e6,
            noise_power_w: 1e-12,
            max_power_w: PerVehicle { i: 0.5, j: 0.5 },
            reference_gain: 1.0,
        },
        airspace: Airspace {
            altitude_m: [80.0, 300.0],
            area_enu_m: corners.iter().map(|c| Vector2::new(c[0], c[1])).collect(),
            min_separation_m: 5.0,
        },
        vehicles: PerVehicle { i: vehicle, j: vehicle },
        jitter: Jitter {
            std_rad: jitter_deg.to_radians(),
            model: JitterModel::Euler,
            axes: JitterAxes::RollPitch,
        },
        objective: Objective::Mean,
        free_yaw: false,
    }
}
