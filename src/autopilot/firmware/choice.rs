//! An actuation that was chosen.

use crate::autopilot::settings::Actuation;

/// What the airframe asks for, with what shows it.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::autopilot) struct Choice {
    pub actuation: Actuation,
    pub why: String,
}
