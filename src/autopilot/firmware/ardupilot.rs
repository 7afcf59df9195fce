//! ArduPilot's copter: `custom_mode` is the mode's number.

pub(super) mod airframe;
pub(super) mod bridge;
pub(super) mod preflight;
pub(super) mod shaping;

use super::mode::{Mode, ModeNumber};

const GUIDED: u8 = 4;
const RTL: u8 = 6;
const LAND: u8 = 9;
/// Holds without a pilot's throttle; LOITER without one descends.
const BRAKE: u8 = 17;
/// Holds with a pilot's throttle at the middle.
pub(super) const LOITER: Mode = Mode::Other { name: "LOITER", custom_mode: 5 };

pub(super) const PARAMETERS: &[&str] =
    &["FRAME_CLASS", "GUID_TIMEOUT", "GUID_OPTIONS", "FS_GCS_ENABLE", "SCR_ENABLE", "SCR_VM_I_COUNT"];

pub(super) fn mode(custom_mode: u32) -> Mode {
    let name = match custom_mode {
        4 => return Mode::Companion,
        6 => return Mode::Return,
        9 => return Mode::Land,
        17 => return Mode::Hold,
        0 => "STABILIZE",
        1 => "ACRO",
        2 => "ALT_HOLD",
        3 => "AUTO",
        5 => return LOITER,
        7 => "CIRCLE",
        11 => "DRIFT",
        13 => "SPORT",
        14 => "FLIP",
        15 => "AUTOTUNE",
        16 => "POSHOLD",
        18 => "THROW",
        19 => "AVOID_ADSB",
        20 => "GUIDED_NOGPS",
        21 => "SMART_RTL",
        22 => "FLOWHOLD",
        23 => "FOLLOW",
        24 => "ZIGZAG",
        27 => "AUTO_RTL",
        _ => "an unknown mode",
    };
    Mode::Other { name, custom_mode }
}

pub(super) fn mode_number(mode: Mode) -> Option<ModeNumber> {
    let main = match mode {
        Mode::Companion => GUIDED,
        Mode::Land => LAND,
        Mode::Return => RTL,
        Mode::Hold => BRAKE,
        Mode::Other { custom_mode, .. } => u8::try_from(custom_mode).ok()?,
    };
    Some(ModeNumber { main, sub: 0 })
}
