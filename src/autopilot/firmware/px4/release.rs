//! What differs between the releases of PX4, as far as a flight depends on it; read in their release notes and sources.
//! Main releases alone: a patch changes no parameter.

use crate::autopilot::firmware::signing::Signing;
use crate::autopilot::parameter::{Knowledge, Parameters};
use crate::autopilot::settings::{Actuation, Settings};
use crate::autopilot::state::Version;
use crate::preflight::Verdict::{Fail, Pass, Warn};
use crate::preflight::{Check, check};

const RADIO_LOSS: &str = "NAV_RCL_ACT";
const ALTITUDE_LOSS: &str = "FD_ALT_LOSS";
/// NAV_RCL_ACT that holds and lets the companion go on.
const HOLD_WITHOUT_FAILSAFE: f64 = 7.0;

/// How the pilot's sticks take a vehicle out of OFFBOARD.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Override {
    /// COM_RC_OVERRIDE, by bit 1.
    Bits(&'static str),
    /// MAN_OVERRIDE_SPD, in stick travel per second, unless it is negative.
    Speed(&'static str),
}

/// One main release.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Release {
    version: (u8, u8),
    sticks: Override,
    /// It has FD_ALT_LOSS, and 7 in NAV_RCL_ACT.
    altitude_loss: bool,
    signing: Signing,
}

static RELEASES: [Release; 4] = {
    const OLD: Release = Release {
        version: (1, 15),
        sticks: Override::Bits("COM_RC_OVERRIDE"),
        altitude_loss: false,
        signing: Signing::None,
    };
    [
        OLD,
        Release { version: (1, 16), ..OLD },
        Release { version: (1, 17), signing: Signing::OverUsb("MAV_SIGN_CFG"), ..OLD },
        Release {
            version: (1, 18),
            sticks: Override::Speed("MAN_OVERRIDE_SPD"),
            altitude_loss: true,
            signing: Signing::WhileDisarmed,
        },
    ]
};

/// How a release signs, if it is one of those that are known.
pub(in crate::autopilot::firmware) fn signing((major, minor, _): Version) -> Option<Signing> {
    RELEASES.iter().find(|release| release.version == (major, minor)).map(|release| release.signing)
}

/// The first and the last release that is known.
pub(in crate::autopilot::firmware) fn known() -> [(u8, u8); 2] {
    [RELEASES[0].version, RELEASES[RELEASES.len() - 1].version]
}

/// The release of a version; of one that is not known, the nearest.
fn release((major, minor, _): Version) -> &'static Release {
    let after = RELEASES.partition_point(|release| release.version <= (major, minor));
    &RELEASES[after.saturating_sub(1)]
}

/// Asks for what this version has.
pub(in crate::autopilot::firmware) fn read(parameters: &mut Parameters, version: Version) {
    let release = release(version);
    let sticks = match release.sticks {
        Override::Bits(name) | Override::Speed(name) => name,
    };
    parameters.read_also([sticks, RADIO_LOSS].map(str::to_owned));
    if release.altitude_loss {
        parameters.read_also([ALTITUDE_LOSS.to_owned()]);
    }
}

/// What this version has, before a flight.
pub(in crate::autopilot::firmware) fn checks(
    parameters: &Parameters,
    settings: &Settings,
    version: Version,
) -> Vec<Check> {
    let release = release(version);
    let mut all = vec![sticks(parameters, release.sticks)];
    all.push(parameters.check(RADIO_LOSS, |value| match value {
        5.0 | 6.0 => (
            Fail,
            "1 (hold), 2 (return) or 3 (land): this one stops the motors when the pilot's radio is lost",
        ),
        HOLD_WITHOUT_FAILSAFE if !release.altitude_loss => (Warn, "1, 2 or 3: 7 is known from 1.18 on"),
        _ => (Pass, ""),
    }));
    if release.altitude_loss {
        all.push(parameters.check(ALTITUDE_LOSS, |value| match value {
            0.0 => (Pass, ""),
            _ if settings.actuation != Actuation::ThrustVector => (Pass, ""),
            _ => (Fail, "0: PX4 knows no altitude that thrust is to hold, and takes a descent for a fall that ends the flight"),
        }));
    }
    all
}

/// Says what moving the sticks does: either way the mode switch takes the vehicle.
fn sticks(parameters: &Parameters, sticks: Override) -> Check {
    let (Override::Bits(name) | Override::Speed(name)) = sticks;
    let value = match parameters.get(name) {
        Knowledge::Pending => return check(name, Fail, "not read yet"),
        Knowledge::Unknown => return check(name, Warn, "the autopilot does not answer: not known"),
        Knowledge::Known(value) => value.as_f64(),
    };
    let take = match sticks {
        Override::Bits(_) => value as i64 & 2 != 0,
        Override::Speed(_) => value >= 0.0,
    };
    let what = if take { "moved sticks take" } else { "only the mode switch takes" };
    check(name, Pass, format!("{value}: {what} the vehicle from the companion"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_a_version_is_taken_for_its_release_and_an_unknown_one_for_the_nearest() {
        for (version, expected) in [
            ((1, 15, 4), (1, 15)),
            ((1, 16, 0), (1, 16)),
            ((1, 18, 9), (1, 18)),
            ((1, 14, 0), (1, 15)),
            ((1, 19, 0), (1, 18)),
            ((2, 0, 0), (1, 18)),
        ] {
            assert_eq!(release(version).version, expected, "{version:?}");
        }
        assert_eq!(signing((1, 17, 1)), Some(Signing::OverUsb("MAV_SIGN_CFG")));
        assert_eq!(signing((1, 19, 0)), None);
    }
}
