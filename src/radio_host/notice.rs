//! What the operator should know: in kinds, with their words beside them.

use mavlink::dialects::ardupilotmega::MavSeverity;

use super::rig::Fault;

/// Something that has happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notice {
    /// A component commands from now on, and nobody else.
    Commander {
        /// Its system.
        system: u8,
        /// Its component.
        component: u8,
    },
    /// The device was told to be off for the first time, and off was read back.
    Silent,
    /// The device did not do what it was told, and is told off.
    Fault(Fault),
    /// Off was not confirmed: the device may radiate. It is told again until it is.
    MayRadiate(Fault),
    /// The device did not confirm off; the kill line keeps the radio silent.
    ByLine(Fault),
    /// A lease ended while the radio was on.
    RanOut,
    /// The radio kill.
    Killed,
    /// The radio kill was lifted.
    Lifted,
    /// Somebody who may not gave a power command or a kill.
    Stranger {
        /// The system.
        system: u8,
        /// The component.
        component: u8,
    },
}

impl Notice {
    /// How much it matters.
    #[must_use]
    pub fn severity(self) -> MavSeverity {
        match self {
            Self::MayRadiate(_) | Self::Killed => MavSeverity::MAV_SEVERITY_CRITICAL,
            Self::Fault(_) | Self::ByLine(_) => MavSeverity::MAV_SEVERITY_ERROR,
            Self::RanOut | Self::Stranger { .. } | Self::Lifted => MavSeverity::MAV_SEVERITY_WARNING,
            Self::Commander { .. } | Self::Silent => MavSeverity::MAV_SEVERITY_INFO,
        }
    }
}

impl std::fmt::Display for Notice {
    /// At most 50 characters, as STATUSTEXT takes.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Commander { system, component } => {
                write!(f, "radio: commanded by {system}/{component} alone")
            }
            Self::Silent => write!(f, "radio: off"),
            Self::Fault(fault) => write!(f, "radio: {fault}; off"),
            Self::MayRadiate(fault) => write!(f, "radio NOT off: {fault}"),
            Self::ByLine(fault) => write!(f, "radio off by line: {fault}"),
            Self::RanOut => write!(f, "radio: the lease ran out; off"),
            Self::Killed => write!(f, "radio: killed until it is lifted here"),
            Self::Lifted => write!(f, "radio: the kill is lifted"),
            Self::Stranger { system, component } => write!(f, "radio: {system}/{component} may not command"),
        }
    }
}
