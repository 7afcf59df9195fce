//! What no companion can keep: the only three causes for which an emission that breaks an invariant is nobody's doing.

use std::time::Duration;

use super::violation::Violation;

/// Why no companion could have kept an invariant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cause {
    /// J's vehicle or its radio failed while a lease of I's ran: at most the lease's remainder.
    JammerFailed,
    /// A radio breaks its own declared behaviour: it radiates otherwise than it was told, or for longer.
    RadioOutOfOrder,
    /// A radio knows no expiry, as it says itself and the preflight names.
    RadioWithoutExpiry,
}

impl Cause {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::JammerFailed, Self::RadioOutOfOrder, Self::RadioWithoutExpiry];

    /// As documents spell it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::JammerFailed => "jammer-failed",
            Self::RadioOutOfOrder => "radio-out-of-order",
            Self::RadioWithoutExpiry => "radio-without-expiry",
        }
    }

    /// Why it does not count, as a clause.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::JammerFailed => "J's vehicle or radio failed while a lease of I's ran",
            Self::RadioOutOfOrder => "the radio did otherwise than it was told",
            Self::RadioWithoutExpiry => "the radio knows no expiry",
        }
    }
}

/// A break of an invariant that no companion could have kept; of an emission that lasts, the part of it that the cause
/// explains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Excused {
    /// What was seen, from when on, for how long.
    pub violation: Violation,
    /// Why it does not count.
    pub cause: Cause,
}

impl Excused {
    /// How long it lasted.
    #[must_use]
    pub const fn duration(&self) -> Duration {
        self.violation.lasted
    }
}
