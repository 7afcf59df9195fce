//! North, east and down: the axes of an autopilot's local frame. None of the types shares arithmetic with the mission frame's.

use nalgebra::Vector3;

use super::{EnuAcceleration, EnuVelocity, swap_enu_ned};

/// A position in an autopilot's local frame in metres. [`LocalFrame`](super::LocalFrame) is the way between it and the
/// mission frame: swapped axes are not enough, the origins differ and so do the projections.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ned(Vector3<f64>);

impl Ned {
    /// From its components to the north, east and down in metres.
    #[must_use]
    pub const fn new(north: f64, east: f64, down: f64) -> Self {
        Self(Vector3::new(north, east, down))
    }

    /// From a vector with these components.
    #[must_use]
    pub const fn from_vector(vector: Vector3<f64>) -> Self {
        Self(vector)
    }

    /// As a vector, to reckon with.
    #[must_use]
    pub const fn vector(self) -> Vector3<f64> {
        self.0
    }
}

/// A velocity to the north, east and down in m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NedVelocity(Vector3<f64>);

impl NedVelocity {
    /// From its components to the north, east and down in m/s.
    #[must_use]
    pub const fn new(north: f64, east: f64, down: f64) -> Self {
        Self(Vector3::new(north, east, down))
    }

    /// As a vector, to reckon with.
    #[must_use]
    pub const fn vector(self) -> Vector3<f64> {
        self.0
    }
}

impl From<EnuVelocity> for NedVelocity {
    /// The same velocity by the other axes; an autopilot's are taken for parallel to the mission's.
    fn from(velocity: EnuVelocity) -> Self {
        Self(swap_enu_ned(velocity.vector()))
    }
}

impl From<NedVelocity> for EnuVelocity {
    fn from(velocity: NedVelocity) -> Self {
        Self::from_vector(swap_enu_ned(velocity.0))
    }
}

/// An acceleration to the north, east and down in m/s^2, gravity left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NedAcceleration(Vector3<f64>);

impl NedAcceleration {
    /// As a vector, to reckon with.
    #[must_use]
    pub const fn vector(self) -> Vector3<f64> {
        self.0
    }
}

impl From<EnuAcceleration> for NedAcceleration {
    /// The same acceleration by the other axes, as for a velocity.
    fn from(acceleration: EnuAcceleration) -> Self {
        Self(swap_enu_ned(acceleration.vector()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_velocity_by_either_axes() {
        let (enu, ned) = (EnuVelocity::new(1.0, 2.0, 3.0), NedVelocity::new(2.0, 1.0, -3.0));
        assert_eq!((NedVelocity::from(enu), EnuVelocity::from(ned)), (ned, enu));
    }
}
