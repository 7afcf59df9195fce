//! Which vehicle of the pair, and a value for each of the two.

use std::fmt;
use std::ops::{Index, IndexMut};

/// A vehicle's part in the pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Vehicle I, the information transmitter: an aerial base station. It leads the pair.
    I,
    /// Vehicle J, the friendly jammer.
    J,
}

impl Role {
    /// Both roles, in the order in which documents list them.
    pub const BOTH: [Self; 2] = [Self::I, Self::J];

    /// As documents and file names write it: `"i"` or `"j"`.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::I => "i",
            Self::J => "j",
        }
    }

    /// The other vehicle of the pair.
    #[must_use]
    pub fn peer(self) -> Self {
        match self {
            Self::I => Self::J,
            Self::J => Self::I,
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::I => "I",
            Self::J => "J",
        })
    }
}

/// One value for each vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct PerVehicle<T> {
    /// Vehicle I's.
    pub i: T,
    /// Vehicle J's.
    pub j: T,
}

impl<T> PerVehicle<T> {
    /// Builds each vehicle's value from its role.
    pub fn from_fn(mut f: impl FnMut(Role) -> T) -> Self {
        Self { i: f(Role::I), j: f(Role::J) }
    }

    /// Both values, borrowed.
    pub fn as_ref(&self) -> PerVehicle<&T> {
        PerVehicle { i: &self.i, j: &self.j }
    }

    /// Applies `f` to both values.
    pub fn map<U>(self, mut f: impl FnMut(T) -> U) -> PerVehicle<U> {
        PerVehicle { i: f(self.i), j: f(self.j) }
    }
}

impl<T> Index<Role> for PerVehicle<T> {
    type Output = T;

    fn index(&self, role: Role) -> &T {
        match role {
            Role::I => &self.i,
            Role::J => &self.j,
        }
    }
}

impl<T> IndexMut<Role> for PerVehicle<T> {
    fn index_mut(&mut self, role: Role) -> &mut T {
        match role {
            Role::I => &mut self.i,
            Role::J => &mut self.j,
        }
    }
}
