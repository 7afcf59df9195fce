//! Flight modes.

/// A flight mode, as far as the companion has business with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// The mode in which the companion flies: PX4 OFFBOARD, ArduCopter GUIDED.
    Companion,
    /// The autopilot lands by itself.
    Land,
    /// The autopilot returns to launch by itself.
    Return,
    /// The autopilot holds its place by itself: PX4 AUTO.LOITER, ArduCopter BRAKE.
    Hold,
    /// Any other mode.
    Other {
        /// Its name.
        name: &'static str,
        /// Its number on the wire.
        custom_mode: u32,
    },
}

/// What DO_SET_MODE takes in its parameters 2 and 3, with base mode "custom" in parameter 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::autopilot) struct ModeNumber {
    pub(in crate::autopilot) main: u8,
    pub(in crate::autopilot) sub: u8,
}
