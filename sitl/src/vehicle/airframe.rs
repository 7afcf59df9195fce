//! Airframes: what a vehicle weighs, what the air does to it, where its rotors are, and whether that can fly.

use super::geometry::Geometry;
use super::rotors;

/// What the rotors can do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Airframe {
    /// Force and torque in every direction: attitude and position are independent.
    #[default]
    Omnidirectional,
    /// A multirotor with parallel rotors: thrust along the body's z alone, so it tilts to move and its attitude
    /// targets are ignored.
    Conventional,
}

impl Airframe {
    /// The rotors that it has unless it is given others.
    #[must_use]
    pub fn rotors(self) -> Geometry {
        match self {
            Self::Omnidirectional => Geometry::tilted_eight(),
            Self::Conventional => Geometry::level_four(),
        }
    }

    /// How many directions of force and torque it must control, and what they are called in an error.
    const fn needs(self) -> (usize, &'static str) {
        match self {
            Self::Omnidirectional => (6, "geometry: directions of force and torque, of the 6 needed"),
            Self::Conventional => (4, "geometry: directions of force and torque, of the 4 needed"),
        }
    }
}

/// Mass and drag of the rigid body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Kilograms.
    pub mass_kg: f64,
    /// Principal moments about the body's axes.
    pub inertia_kg_m2: [f64; 3],
    /// Drag: force = this times the square of the air speed.
    pub drag_n_s2_per_m2: f64,
    /// Where drag acts, from the centre of mass, body axes: wind turns the vehicle as well as pushing it.
    pub pressure_offset_m: [f64; 3],
}

impl Default for Body {
    fn default() -> Self {
        Self {
            mass_kg: 2.0,
            inertia_kg_m2: [0.045, 0.045, 0.06],
            drag_n_s2_per_m2: 0.04,
            pressure_offset_m: [0.0, 0.0, 0.02],
        }
    }
}

impl Body {
    /// The first value that no body can have.
    fn fault(&self) -> Option<(&'static str, f64)> {
        let [x, y, z] = self.inertia_kg_m2;
        let positive = [
            ("body.mass_kg", self.mass_kg),
            ("body.inertia_kg_m2[0]", x),
            ("body.inertia_kg_m2[1]", y),
            ("body.inertia_kg_m2[2]", z),
        ];
        let drag = [("body.drag_n_s2_per_m2", self.drag_n_s2_per_m2)];
        let mut finite =
            drag.into_iter().chain(self.pressure_offset_m.map(|v| ("body.pressure_offset_m", v)));
        positive
            .into_iter()
            .find(|(_, v)| !(v.is_finite() && *v > 0.0))
            .or_else(|| finite.find(|(_, v)| !v.is_finite()))
    }
}

/// An airframe with all that makes it fly.
#[derive(Debug, Clone, PartialEq)]
pub struct AirframeModel {
    /// What the rotors can do.
    pub airframe: Airframe,
    /// Mass, inertia, drag.
    pub body: Body,
    /// The rotors.
    pub geometry: Geometry,
}

impl AirframeModel {
    /// The one that an airframe has unless a file says otherwise.
    #[must_use]
    pub fn of(airframe: Airframe) -> Self {
        Self { airframe, body: Body::default(), geometry: airframe.rotors() }
    }

    /// The first value that cannot fly: of the body, of the rotors, or too few directions that they control for this
    /// kind of airframe.
    pub(crate) fn fault(&self) -> Option<(&'static str, f64)> {
        self.body.fault().or_else(|| self.geometry.fault()).or_else(|| {
            let (needed, name) = self.airframe.needs();
            let rank = rotors::rank(&self.geometry);
            (rank < needed).then_some((name, rank as f64))
        })
    }
}
