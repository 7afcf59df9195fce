//! What one unit of thrust along a body axis is worth, from PX4's description of the rotors (CA_ROTOR*).
//!
//! PX4 allocates by the pseudo-inverse of the rotors' effectiveness (rows: torque x, y, z, force x, y, z) and scales
//! each force axis by the mean magnitude of that axis's entries: one unit along an axis is the inverse of that mean.

use nalgebra::{DMatrix, Vector3};

use crate::autopilot::parameter::{Knowledge, Parameters};

const COUNT: &str = "CA_ROTOR_COUNT";
const MOST: usize = 12;
/// A force along an axis is had alone if what comes with it is less than this part of it (a torque: per metre).
const ALONE: f64 = 1e-3;
const FIELDS: [&str; 8] = ["PX", "PY", "PZ", "AX", "AY", "AZ", "CT", "KM"];

/// One rotor in body FRD axes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Rotor {
    position_m: Vector3<f64>,
    /// Direction of its thrust.
    axis: Vector3<f64>,
    thrust_n: f64,
    /// Torque about the axis per thrust, in metres.
    moment_ratio_m: f64,
}

/// The scales of the thrust axes, as far as the parameters have told the rotors.
#[derive(Debug, Clone, Default)]
pub(in crate::autopilot) struct RotorScales {
    thrust_n: Option<[f64; 3]>,
}

impl RotorScales {
    /// Newtons per unit along body x, y, z; `None` until every rotor is known.
    pub(in crate::autopilot::firmware) fn thrust_n(&self) -> Option<[f64; 3]> {
        self.thrust_n
    }

    /// Reads on where a rotor is not known, and gives the scales once they all are.
    pub(in crate::autopilot::firmware) fn learn(&mut self, parameters: &mut Parameters) -> Option<[f64; 3]> {
        if self.thrust_n.is_some() {
            return None;
        }
        parameters.read_also(names(parameters));
        self.thrust_n = thrust_scales(parameters);
        self.thrust_n
    }
}

/// The parameters to be read: the number of rotors first, then each rotor.
fn names(parameters: &Parameters) -> Vec<String> {
    let each =
        (0..count(parameters).unwrap_or(0)).flat_map(|i| FIELDS.map(|field| format!("CA_ROTOR{i}_{field}")));
    std::iter::once(COUNT.to_owned()).chain(each).collect()
}

fn thrust_scales(parameters: &Parameters) -> Option<[f64; 3]> {
    scales(&described(parameters)?)
}

/// The least thrust sideways that the rotors make by itself, without turning the body or lifting it, as a part of what they
/// make upwards. `None` until every rotor is known.
pub(in crate::autopilot::firmware) fn sideways(parameters: &Parameters) -> Option<f64> {
    described(parameters).map(|rotors| sideways_of(&rotors))
}

fn described(parameters: &Parameters) -> Option<Vec<Rotor>> {
    (0..count(parameters)?).map(|i| rotor(parameters, i)).collect()
}

fn sideways_of(rotors: &[Rotor]) -> f64 {
    let effectiveness = effectiveness(rotors);
    let Ok(mix) = effectiveness.clone().pseudo_inverse(1e-6) else { return 0.0 };
    // Along each body axis: what a unit of it asks of the rotor that does most, if it can be had alone.
    let reach = [3, 4, 5].map(|row| {
        let column = mix.column(row).into_owned();
        let mut made = &effectiveness * &column;
        made[row] -= 1.0;
        let most = column.amax();
        if made.amax() < ALONE && most > 0.0 { 1.0 / most } else { 0.0 }
    });
    if reach[2] > 0.0 { reach[0].min(reach[1]) / reach[2] } else { 0.0 }
}

fn count(parameters: &Parameters) -> Option<usize> {
    let count = number(parameters, COUNT)?;
    (1.0..=MOST as f64).contains(&count).then_some(count as usize)
}

fn number(parameters: &Parameters, name: &str) -> Option<f64> {
    match parameters.get(name) {
        Knowledge::Known(value) => Some(value.as_f64()),
        Knowledge::Pending | Knowledge::Unknown => None,
    }
}

fn rotor(parameters: &Parameters, index: usize) -> Option<Rotor> {
    let field = |name: &str| number(parameters, &format!("CA_ROTOR{index}_{name}"));
    let vector = |names: [&str; 3]| Some(Vector3::new(field(names[0])?, field(names[1])?, field(names[2])?));
    Some(Rotor {
        position_m: vector(["PX", "PY", "PZ"])?,
        axis: vector(["AX", "AY", "AZ"])?.try_normalize(1e-6)?,
        thrust_n: field("CT")?,
        moment_ratio_m: field("KM")?,
    })
}

/// Torques about and forces along the body's axes, of each rotor at full thrust.
fn effectiveness(rotors: &[Rotor]) -> DMatrix<f64> {
    DMatrix::from_fn(6, rotors.len(), |row, column| {
        let rotor = &rotors[column];
        let force = rotor.axis * rotor.thrust_n;
        let torque = rotor.position_m.cross(&force) - force * rotor.moment_ratio_m;
        if row < 3 { torque[row] } else { force[row - 3] }
    })
}

fn scales(rotors: &[Rotor]) -> Option<[f64; 3]> {
    let mix = effectiveness(rotors).pseudo_inverse(1e-6).ok()?;
    let mut scales = [0.0; 3];
    for (axis, scale) in scales.iter_mut().enumerate() {
        let entries = mix.column(3 + axis).map(f64::abs);
        let used = entries.iter().filter(|entry| **entry > 1e-7).count();
        // An axis without rotors has no thrust at all: the vehicle is not fully actuated.
        if used == 0 {
            return None;
        }
        *scale = used as f64 / entries.sum();
    }
    scales.iter().all(|scale| scale.is_finite()).then_some(scales)
}

#[cfg(test)]
pub(in crate::autopilot) mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// A cube of eight rotors: corner signs and axes of PX4's stock omnicopter.
    pub(in crate::autopilot) const OMNICOPTER: [([f64; 3], [f64; 3]); 8] = {
        const P: f64 = 0.14435;
        const L: f64 = 0.788_675;
        const S: f64 = 0.211_325;
        const Z: f64 = 0.577_35;
        [
            ([P, -P, -P], [-L, -S, -Z]),
            ([-P, -P, -P], [S, -L, Z]),
            ([P, P, -P], [-S, L, Z]),
            ([-P, P, -P], [L, S, -Z]),
            ([P, -P, P], [L, S, -Z]),
            ([-P, -P, P], [-S, L, Z]),
            ([P, P, P], [S, -L, Z]),
            ([-P, P, P], [-L, -S, -Z]),
        ]
    };

    fn rotors(thrust_n: f64) -> Vec<Rotor> {
        let rotor = |(position, axis): ([f64; 3], [f64; 3])| Rotor {
            position_m: position.into(),
            axis: Vector3::from(axis).normalize(),
            thrust_n,
            moment_ratio_m: 0.05,
        };
        OMNICOPTER.map(rotor).to_vec()
    }

    #[test]
    fn val_scales_of_the_stock_omnicopter() {
        // Seen on the real program: 133.9 N along x and y, 115.9 N along z.
        let [x, y, z] = scales(&rotors(6.5)).unwrap();
        assert!((x / z - 133.9 / 115.9).abs() < 2e-3 && (y / z - 133.9 / 115.9).abs() < 2e-3, "{x} {y} {z}");
        let twice = scales(&rotors(13.0)).unwrap();
        assert!((twice[0] / x - 2.0).abs() < 1e-9);
    }

    #[test]
    fn val_thrust_sideways_of_an_omnicopter_a_hexarotor_by_its_cant_and_a_quad() {
        // By NumPy's pinv: the busiest rotor limits the force to 20.860002 N along x and y, and to 25.018867 N along z.
        let omnicopter = sideways_of(&rotors(6.5));
        assert!((omnicopter - 20.860_002 / 25.018_867).abs() < 1e-6, "{omnicopter}");
        // A hexarotor whose rotors lean in turn to either side of their arms, by the tangent of the cant.
        let hexarotor = |cant_deg: f64| {
            let rotor = |k: i32| {
                let (sin, cos) = (f64::from(k) * PI / 3.0).sin_cos();
                let side = if k % 2 == 0 { 1.0 } else { -1.0 };
                let lean = cant_deg.to_radians().tan() * side;
                Rotor {
                    position_m: Vector3::new(cos, sin, 0.0) * 0.3,
                    axis: Vector3::new(-sin * lean, cos * lean, -1.0).normalize(),
                    thrust_n: 6.5,
                    moment_ratio_m: 0.05 * side,
                }
            };
            sideways_of(&(0..6).map(rotor).collect::<Vec<_>>())
        };
        assert!(hexarotor(30.0) > 0.1 && hexarotor(0.0) == 0.0, "{} {}", hexarotor(30.0), hexarotor(0.0));
        assert!(hexarotor(30.0) > hexarotor(10.0));
        // Four rotors make no force sideways without turning the body, however they lean.
        let quad = |lean: f64| {
            let rotor = |(x, y, spin): (f64, f64, f64)| Rotor {
                position_m: Vector3::new(x, y, 0.0),
                axis: Vector3::new(-y * lean, x * lean, -1.0).normalize(),
                thrust_n: 6.5,
                moment_ratio_m: 0.05 * spin,
            };
            sideways_of(
                &[(0.2, 0.2, 1.0), (-0.2, -0.2, 1.0), (0.2, -0.2, -1.0), (-0.2, 0.2, -1.0)].map(rotor),
            )
        };
        assert_eq!([quad(0.0), quad(1.0)], [0.0; 2]);
    }

    #[test]
    fn spec_a_flat_multirotor_has_no_thrust_sideways() {
        let mut flat = rotors(6.5);
        flat.iter_mut().for_each(|rotor| rotor.axis = -Vector3::z());
        assert_eq!(scales(&flat), None);
    }
}
