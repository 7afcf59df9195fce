//! An airframe from a TOML file: what it weighs, what the air does to it, where its rotors are.

use serde::Deserialize;
use thiserror::Error;

use super::airframe::{Airframe, AirframeModel, Body};
use super::geometry::{Geometry, Rotor};

/// Why a file describes no airframe.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AirframeError {
    /// It is no TOML, or has other keys than it should; with the line.
    #[error("{file}: {reason}")]
    Syntax {
        /// The file's name.
        file: String,
        /// Line, column, and what is wrong there.
        reason: String,
    },
    /// A value that cannot fly.
    #[error("{file}: {what} is {value}: {remedy}")]
    Value {
        /// The file's name.
        file: String,
        /// Which one.
        what: String,
        /// Its value.
        value: String,
        /// What it should be.
        remedy: &'static str,
    },
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Omnidirectional,
    Conventional,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    airframe: Kind,
    mass_kg: f64,
    inertia_kg_m2: [f64; 3],
    drag_n_s2_per_m2: f64,
    pressure_offset_flu_m: [f64; 3],
    reversible: bool,
    lag_s: f64,
    curve: f64,
    rotor: Vec<RotorTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RotorTable {
    position_flu_m: [f64; 3],
    axis_flu: [f64; 3],
    thrust_n: f64,
    moment_m: f64,
}

impl AirframeModel {
    /// Reads an airframe. `file` is its name, for errors.
    ///
    /// # Errors
    /// What is wrong with the text, with its line, or with a value, with what it should be.
    pub fn parse(file: &str, text: &str) -> Result<Self, AirframeError> {
        let read: File = toml::from_str(text).map_err(|error| AirframeError::Syntax {
            file: file.to_owned(),
            reason: error.to_string().trim_end().to_owned(),
        })?;
        let airframe = match read.airframe {
            Kind::Omnidirectional => Airframe::Omnidirectional,
            Kind::Conventional => Airframe::Conventional,
        };
        let rotor = |r: &RotorTable| Rotor {
            position_flu_m: r.position_flu_m,
            axis_flu: r.axis_flu,
            thrust_n: r.thrust_n,
            moment_m: r.moment_m,
        };
        let model = Self {
            airframe,
            body: Body {
                mass_kg: read.mass_kg,
                inertia_kg_m2: read.inertia_kg_m2,
                drag_n_s2_per_m2: read.drag_n_s2_per_m2,
                pressure_offset_m: read.pressure_offset_flu_m,
            },
            geometry: Geometry {
                rotors: read.rotor.iter().map(rotor).collect(),
                reversible: read.reversible,
                lag_s: read.lag_s,
                curve: read.curve,
            },
        };
        match model.fault() {
            None => Ok(model),
            Some((what, value)) => Err(AirframeError::Value {
                file: file.to_owned(),
                what: what.to_owned(),
                value: value.to_string(),
                remedy: "masses, inertias and thrusts must be positive, axes of length 1, curve from 0 to 1, rotors \
                         within 100 m and 1e6 N, and at most 12 of them must give force and torque in every direction \
                         of this kind of airframe",
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OMNI: &str = include_str!("../../airframes/tilted-eight.toml");
    const QUAD: &str = include_str!("../../airframes/level-four.toml");

    #[test]
    fn spec_the_files_are_the_built_in_airframes() {
        for (text, airframe) in [(OMNI, Airframe::Omnidirectional), (QUAD, Airframe::Conventional)] {
            let read = AirframeModel::parse("airframe.toml", text).unwrap();
            let built_in = AirframeModel::of(airframe);
            assert_eq!((read.airframe, read.body), (built_in.airframe, built_in.body));
            assert_eq!(read.geometry.rotors.len(), built_in.geometry.rotors.len());
            for (a, b) in read.geometry.rotors.iter().zip(&built_in.geometry.rotors) {
                let numbers =
                    |r: &Rotor| [r.position_flu_m, r.axis_flu, [r.thrust_n, r.moment_m, 0.0]].concat();
                assert!(numbers(a).iter().zip(numbers(b)).all(|(x, y)| (x - y).abs() < 1e-9), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn regress_figures_whose_products_overflow_are_refused_and_not_computed_with_for_ever() {
        let refused = |from: &str, to: &str| {
            let text = OMNI.replacen(from, to, 1);
            assert_ne!(text, OMNI);
            AirframeModel::parse("x.toml", &text).unwrap_err().to_string()
        };
        assert!(refused("[0.14435,", "[-1e308,").contains("position_flu_m is -1"));
        assert!(refused("thrust_n = 25.1", "thrust_n = 1e308").contains("thrust_n is 1"));
        assert!(refused("moment_m = 0.05", "moment_m = -1e300").contains("moment_m is -1"));
    }

    #[test]
    fn spec_bad_files_are_refused_with_place_and_remedy() {
        let refused = |text: &str| AirframeModel::parse("x.toml", text).unwrap_err().to_string();
        let error = refused(&OMNI.replace("mass_kg", "mass"));
        assert!(error.starts_with("x.toml") && error.contains("line") && error.contains("mass"), "{error}");
        let error = refused(&OMNI.replace("mass_kg = 2.0", "mass_kg = \"heavy\""));
        assert!(error.contains("line") && error.contains("heavy"), "{error}");
        let error = refused(&OMNI.replace("mass_kg = 2.0", "mass_kg = -2.0"));
        assert!(error.contains("body.mass_kg is -2") && error.contains("positive"), "{error}");
        // A quadrotor's rotors do not make an omnidirectional vehicle.
        let error = refused(&QUAD.replace("\"conventional\"", "\"omnidirectional\""));
        assert!(error.contains("of the 6 needed is 4"), "{error}");
        let error = refused(&OMNI.replace("rotor", "motor"));
        assert!(error.contains("line"), "{error}");
    }
}
