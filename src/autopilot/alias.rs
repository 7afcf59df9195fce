//! Quantities that versions of a firmware have under different names, and in different units.

use super::parameter::{Knowledge, Parameters};

/// The names of one quantity, oldest first, each with what one of its units is worth in SI.
#[derive(Debug, Clone, Copy)]
pub(super) struct Alias(pub(super) &'static [(&'static str, f64)]);

/// What is known of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Told {
    /// Still being asked for.
    Pending,
    /// The autopilot has it under none of the names, or does not say.
    Unknown,
    /// In SI units.
    Known(f64),
}

impl Alias {
    /// Asks by the next name where the one before is not known to the autopilot.
    pub(super) fn ask(self, parameters: &mut Parameters) {
        for (name, _) in self.0 {
            parameters.read_also([(*name).to_owned()]);
            if parameters.get(name) != Knowledge::Unknown {
                break;
            }
        }
    }

    /// The name by which the autopilot has it, or the oldest, and what is known.
    pub(super) fn told(self, parameters: &Parameters) -> (&'static str, Told) {
        for &(name, worth) in self.0 {
            match parameters.get(name) {
                Knowledge::Known(value) => return (name, Told::Known(value.as_f64() * worth)),
                Knowledge::Pending => return (name, Told::Pending),
                Knowledge::Unknown => {}
            }
        }
        (self.0.first().map_or("", |(name, _)| *name), Told::Unknown)
    }
}
