//! How a firmware comes to sign its links.

use std::fmt;

/// How a firmware comes to sign its links.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::autopilot::firmware) enum Signing {
    None,
    /// SETUP_SIGNING over USB alone, and a parameter.
    OverUsb(&'static str),
    /// SETUP_SIGNING on any link while disarmed.
    WhileDisarmed,
}

impl fmt::Display for Signing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => write!(f, "it does not sign its links"),
            Self::OverUsb(name) => write!(f, "it signs by {name}, with a key set over USB"),
            Self::WhileDisarmed => write!(f, "it signs once SETUP_SIGNING has set a key, while disarmed"),
        }
    }
}
