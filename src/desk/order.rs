//! What an operator asks of a companion by MAVLink: of a simulated ground station, and of the view in a terminal.

use mavlink::dialects::ardupilotmega::MavCmd;

/// An operator's order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Order {
    /// The mission begins: MISSION_START.
    Start,
    /// Silent, and holding: DO_PAUSE_CONTINUE, pause.
    Pause,
    /// On with it: DO_PAUSE_CONTINUE, continue.
    Continue,
    /// Silent, and home: NAV_RETURN_TO_LAUNCH.
    Return,
    /// Both radios off, until it is lifted: MAV_CMD_USER_2.
    Kill,
    /// The same with param1 = 1: the kill is lifted at this vehicle.
    Lift,
}

impl Order {
    /// Its command and param1.
    #[must_use]
    pub fn command(self) -> (MavCmd, f32) {
        match self {
            Self::Start => (MavCmd::MAV_CMD_MISSION_START, 0.0),
            Self::Pause => (MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 0.0),
            Self::Continue => (MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0),
            Self::Return => (MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, 0.0),
            Self::Kill => (MavCmd::MAV_CMD_USER_2, 0.0),
            Self::Lift => (MavCmd::MAV_CMD_USER_2, 1.0),
        }
    }
}
