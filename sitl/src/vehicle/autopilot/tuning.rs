//! What the autopilot reads out of its parameters, kept until one of them is written.

use std::time::Duration;

use super::shaper::Shaping;
use crate::vehicle::config::Firmware;
use crate::vehicle::control::SpeedLimits;
use crate::vehicle::parameters::Parameters;

/// Values that are wanted at every step.
#[derive(Debug, Clone)]
pub(super) struct Tuning {
    /// Of the parameters that these were read from.
    pub revision: u32,
    pub limits: SpeedLimits,
    /// ArduCopter: of the target that it moves by itself.
    pub shaping: Shaping,
    /// Without a setpoint for this long the stream is lost (COM_OF_LOSS_T, GUID_TIMEOUT).
    pub stream_timeout: Duration,
    /// FD_FAIL_R and FD_FAIL_P, degrees; 0 is off.
    pub failure_deg: [f64; 2],
    pub still: Still,
    /// Charges, 0 to 1, that count as low, critical and an emergency.
    pub charge: [f64; 3],
    /// NAV_DLL_ACT or FS_GCS_ENABLE; 0 is off.
    pub ground_station_action: i32,
    pub ground_station_timeout: Duration,
    /// THR_MDL_FAC: the curve that the autopilot believes its motors to have.
    pub curve: Option<f64>,
}

/// What PX4's land detector takes for standing on the ground.
#[derive(Debug, Clone)]
pub(super) struct Still {
    /// Largest body-z thrust, in units.
    pub thrust: f64,
    pub horizontal_m_s: f64,
    /// 0 switches the detector off.
    pub vertical_m_s: f64,
    pub tilting_rad_s: f64,
    pub time: Duration,
}

impl Tuning {
    pub fn of(parameters: &Parameters, firmware: Firmware) -> Self {
        let real = |name: &str| f64::from(parameters.real(name));
        let speed = |name: &str, unit: f64| (real(name) * unit).max(0.1);
        let px4 = firmware == Firmware::Px4;
        let limits = if px4 {
            SpeedLimits {
                horizontal_m_s: speed("MPC_XY_VEL_MAX", 1.0),
                up_m_s: speed("MPC_Z_VEL_MAX_UP", 1.0),
                down_m_s: speed("MPC_Z_VEL_MAX_DN", 1.0),
            }
        } else {
            SpeedLimits {
                horizontal_m_s: speed("WPNAV_SPEED", 0.01),
                up_m_s: speed("WPNAV_SPEED_UP", 0.01),
                down_m_s: speed("WPNAV_SPEED_DN", 0.01),
            }
        };
        Self {
            revision: parameters.revision,
            limits,
            shaping: Shaping {
                acceleration_m_s2: ["WPNAV_ACCEL", "WPNAV_ACCEL_Z"].map(|name| speed(name, 0.01)),
                jerk_m_s3: ["PSC_JERK_XY", "PSC_JERK_Z"].map(|name| speed(name, 1.0)),
            },
            stream_timeout: parameters.seconds(if px4 { "COM_OF_LOSS_T" } else { "GUID_TIMEOUT" }),
            failure_deg: [real("FD_FAIL_R"), real("FD_FAIL_P")],
            still: Still {
                thrust: real("MPC_MANTHR_MIN") + 0.01,
                horizontal_m_s: real("LNDMC_XY_VEL_MAX"),
                vertical_m_s: real("LNDMC_Z_VEL_MAX"),
                tilting_rad_s: real("LNDMC_ROT_MAX").to_radians(),
                time: parameters.seconds("LNDMC_TRIG_TIME"),
            },
            charge: if px4 {
                ["BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR"].map(real)
            } else {
                // ArduPilot counts what is left in mAh.
                let capacity = real("BATT_CAPACITY").max(1.0);
                [real("BATT_LOW_MAH") / capacity, real("BATT_CRT_MAH") / capacity, 0.0]
            },
            ground_station_action: parameters.real(if px4 { "NAV_DLL_ACT" } else { "FS_GCS_ENABLE" }) as i32,
            ground_station_timeout: parameters.seconds(if px4 { "COM_DL_LOSS_T" } else { "FS_GCS_TIMEOUT" }),
            curve: px4.then(|| real("THR_MDL_FAC").clamp(0.0, 1.0)),
        }
    }
}
