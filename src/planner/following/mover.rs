//! Who moves, and who says where it is.

use super::Unrest;
use crate::geo::Enu;

/// A user or an eavesdropper, by its number in the mission's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Who {
    /// A user.
    User(usize),
    /// An eavesdropper.
    Eavesdropper(usize),
}

/// How somebody moves, in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gait {
    /// On foot.
    Walks,
    /// In a vehicle.
    Drives,
}

impl Gait {
    /// What that means for the filter.
    #[must_use]
    pub fn unrest(self) -> Unrest {
        match self {
            Self::Walks => Unrest::WALKS,
            Self::Drives => Unrest::DRIVES,
        }
    }

    /// How fast it usually is, in m/s.
    #[must_use]
    pub fn speed_m_s(self) -> f64 {
        self.unrest().speed_std_m_s[0]
    }
}

/// Somebody that moves, and is reported of in flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mover {
    /// Who it is.
    pub who: Who,
    /// MAVLink system that says where it is; `None`: an operator does.
    pub system_id: Option<u8>,
    /// How it moves.
    pub gait: Gait,
    /// Standard deviation of a reported position in metres, where the report does not say.
    pub std_m: f64,
}

/// Somebody that moves, as an edited mission file has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// Who.
    pub who: Who,
    /// Where, ENU, metres.
    pub position_enu_m: Enu,
    /// How well that is known in east and in north, standard deviation in metres.
    pub std_m: f64,
}
