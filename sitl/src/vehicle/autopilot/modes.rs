//! Flight modes and how each firmware says them.

use crate::vehicle::config::Firmware;

/// What the autopilot is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// The pilot's attitude mode; without sticks it stays where it is.
    Stabilize,
    /// The pilot's position mode.
    Position,
    Hold,
    /// ArduCopter's stop, which ground stations send for "pause"; PX4 has Hold for it.
    Brake,
    /// PX4's AUTO_TAKEOFF. ArduCopter takes off inside GUIDED.
    Takeoff,
    Land,
    ReturnToLaunch,
    /// OFFBOARD or GUIDED: the companion's.
    Companion,
}

/// PX4's main modes (`custom_mode` bits 16 to 23) and AUTO's sub-modes (bits 24 to 31).
const PX4_MODES: &[(Mode, u8, u8)] = &[
    (Mode::Position, 3, 0),
    (Mode::Takeoff, 4, 2),
    (Mode::Hold, 4, 3),
    (Mode::ReturnToLaunch, 4, 5),
    (Mode::Land, 4, 6),
    (Mode::Companion, 6, 0),
    (Mode::Stabilize, 7, 0),
];

/// ArduCopter's mode numbers; POSHOLD stands for the pilot's position mode.
const ARDUCOPTER_MODES: &[(Mode, u32)] = &[
    (Mode::Stabilize, 0),
    (Mode::Companion, 4),
    (Mode::Hold, 5),
    (Mode::ReturnToLaunch, 6),
    (Mode::Land, 9),
    (Mode::Position, 16),
    (Mode::Brake, 17),
];

impl Mode {
    /// HEARTBEAT's custom_mode.
    pub fn custom(self, firmware: Firmware) -> u32 {
        match firmware {
            Firmware::Px4 => PX4_MODES
                .iter()
                .find(|(mode, ..)| *mode == self)
                .map_or(0, |(_, main, sub)| u32::from(*main) << 16 | u32::from(*sub) << 24),
            Firmware::ArduCopter => {
                ARDUCOPTER_MODES.iter().find(|(mode, _)| *mode == self).map_or(4, |(_, number)| *number)
            }
        }
    }

    /// The mode of DO_SET_MODE's second and third parameter.
    pub fn from_command(firmware: Firmware, main: f64, sub: f64) -> Option<Self> {
        match firmware {
            Firmware::Px4 => PX4_MODES
                .iter()
                .find(|(_, m, s)| f64::from(*m) == main && (*m != 4 || f64::from(*s) == sub))
                .map(|(mode, ..)| *mode),
            Firmware::ArduCopter => {
                ARDUCOPTER_MODES.iter().find(|(_, number)| f64::from(*number) == main).map(|(mode, _)| *mode)
            }
        }
    }

    /// The mode of SET_MODE's custom_mode.
    pub fn from_custom(firmware: Firmware, custom: u32) -> Option<Self> {
        match firmware {
            Firmware::Px4 => {
                Self::from_command(firmware, f64::from(custom >> 16 & 0xFF), f64::from(custom >> 24))
            }
            Firmware::ArduCopter => Self::from_command(firmware, f64::from(custom), 0.0),
        }
    }

    /// As the firmware's ground stations call it.
    pub fn name(self, firmware: Firmware) -> &'static str {
        match (self, firmware) {
            (Self::Stabilize, _) => "STABILIZE",
            (Self::Position, Firmware::Px4) => "POSCTL",
            (Self::Position, Firmware::ArduCopter) => "POSHOLD",
            (Self::Hold, Firmware::Px4) => "HOLD",
            (Self::Hold, Firmware::ArduCopter) => "LOITER",
            (Self::Brake, _) => "BRAKE",
            (Self::Takeoff, _) => "TAKEOFF",
            (Self::Land, _) => "LAND",
            (Self::ReturnToLaunch, _) => "RTL",
            (Self::Companion, Firmware::Px4) => "OFFBOARD",
            (Self::Companion, Firmware::ArduCopter) => "GUIDED",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_codes_of_the_documents() {
        assert_eq!(Mode::Companion.custom(Firmware::Px4), 0x0006_0000);
        assert_eq!(Mode::Hold.custom(Firmware::Px4), 0x0304_0000);
        assert_eq!(Mode::ReturnToLaunch.custom(Firmware::Px4), 0x0504_0000);
        assert_eq!(Mode::Companion.custom(Firmware::ArduCopter), 4);
        assert_eq!(Mode::Land.custom(Firmware::ArduCopter), 9);
        assert_eq!(Mode::from_custom(Firmware::ArduCopter, 17), Some(Mode::Brake));
    }

    #[test]
    fn prop_every_mode_reads_back() {
        for firmware in [Firmware::Px4, Firmware::ArduCopter] {
            for mode in [
                Mode::Stabilize,
                Mode::Position,
                Mode::Hold,
                Mode::Land,
                Mode::ReturnToLaunch,
                Mode::Companion,
            ] {
                assert_eq!(Mode::from_custom(firmware, mode.custom(firmware)), Some(mode));
            }
        }
        assert_eq!(Mode::from_command(Firmware::Px4, 4.0, 99.0), None);
        assert_eq!(Mode::from_command(Firmware::ArduCopter, f64::NAN, 0.0), None);
    }
}
