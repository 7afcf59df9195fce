//! The firmware's version (AUTOPILOT_VERSION), and whether it is one that this companion knows.

use super::signing::Signing;
use super::{Firmware, px4};
use crate::autopilot::state::Version;
use crate::preflight::{Check, Verdict, check};

/// ArduCopter's releases whose parameters and manners are known.
const ARDUCOPTER: [(u8, u8); 2] = [(4, 5), (4, 7)];

/// Whether the version is known.
pub(in crate::autopilot) fn check_version(firmware: Firmware, version: Option<Version>) -> Check {
    let name = "firmware version";
    let Some((major, minor, patch)) = version else {
        return check(name, Verdict::Warn, "the autopilot does not say: AUTOPILOT_VERSION is not answered");
    };
    let [(first_major, first), (last_major, last)] = match firmware {
        Firmware::Px4 => px4::release::known(),
        Firmware::ArduPilot => ARDUCOPTER,
    };
    let told = format!("{firmware} {major}.{minor}.{patch}");
    if !((first_major, first)..=(last_major, last)).contains(&(major, minor)) {
        let detail = format!(
            "{told} is not known, {first_major}.{first} to {last_major}.{last} are: parameters may have other names and meanings"
        );
        return check(name, Verdict::Warn, detail);
    }
    let signing = match firmware {
        Firmware::Px4 => px4::release::signing((major, minor, patch)),
        Firmware::ArduPilot => Some(Signing::WhileDisarmed),
    };
    check(name, Verdict::Pass, signing.map_or(told.clone(), |signing| format!("{told}: {signing}")))
}
