//! PX4: `custom_mode` carries the main mode in bits 16-23 and, for AUTO, the sub-mode in bits 24-31.

pub(super) mod airframe;
pub(super) mod battery;
pub(super) mod land_detector;
pub(super) mod preflight;
pub(super) mod release;
pub(super) mod rotors;

use super::mode::{Mode, ModeNumber};

const MAIN_AUTO: u8 = 4;
const MAIN_OFFBOARD: u8 = 6;
const AUTO_LOITER: u8 = 3;
const AUTO_RTL: u8 = 5;
const AUTO_LAND: u8 = 6;

/// The land detector's largest vertical speed on the ground, in m/s; 0 keeps it from ever seeing a landing.
const LAND_DETECTOR_SPEED: &str = "LNDMC_Z_VEL_MAX";

pub(super) const PARAMETERS: &[&str] = &[
    "COM_OF_LOSS_T",
    "COM_OBL_RC_ACT",
    "FD_FAIL_R",
    "FD_FAIL_P",
    "NAV_DLL_ACT",
    "MAV_TYPE",
    "THR_MDL_FAC",
    airframe::NAME,
    "MPC_XY_VEL_MAX",
    "MPC_Z_VEL_MAX_UP",
    "MPC_Z_VEL_MAX_DN",
    LAND_DETECTOR_SPEED,
    battery::FLOOR,
];

pub(super) fn mode(custom_mode: u32) -> Mode {
    let [_, _, main, sub] = custom_mode.to_le_bytes();
    let name = match (main, sub) {
        (MAIN_OFFBOARD, _) => return Mode::Companion,
        (MAIN_AUTO, AUTO_LAND) => return Mode::Land,
        (MAIN_AUTO, AUTO_RTL) => return Mode::Return,
        (MAIN_AUTO, AUTO_LOITER) => return Mode::Hold,
        (1, _) => "MANUAL",
        (2, _) => "ALTCTL",
        (3, _) => "POSCTL",
        (MAIN_AUTO, 1) => "AUTO.READY",
        (MAIN_AUTO, 2) => "AUTO.TAKEOFF",
        (MAIN_AUTO, 4) => "AUTO.MISSION",
        (MAIN_AUTO, 8) => "AUTO.FOLLOW",
        (MAIN_AUTO, 9) => "AUTO.PRECLAND",
        (MAIN_AUTO, _) => "AUTO",
        (5, _) => "ACRO",
        (7, _) => "STABILIZED",
        (10, _) => "TERMINATION",
        _ => "an unknown mode",
    };
    Mode::Other { name, custom_mode }
}

pub(super) fn mode_number(mode: Mode) -> Option<ModeNumber> {
    let (main, sub) = match mode {
        Mode::Companion => (MAIN_OFFBOARD, 0),
        Mode::Land => (MAIN_AUTO, AUTO_LAND),
        Mode::Return => (MAIN_AUTO, AUTO_RTL),
        Mode::Hold => (MAIN_AUTO, AUTO_LOITER),
        Mode::Other { .. } => return None,
    };
    Some(ModeNumber { main, sub })
}
