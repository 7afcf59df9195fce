//! The law of attitude noise.
//!
//! - *Euler* (the paper's): the noise is added to the desired angles, `eta = eta_d + w`. Not isotropic: at a roll of
//!   +-90 deg, pitch noise does nothing.
//! - *Body*: a small random rotation about the body axes, `R = R_d exp([w])`, what a vehicle does. The component
//!   about body z turns the antenna about itself; it matters to second order only.
//!
//! In both, w has independent Gaussian components of equal standard deviation: roll and pitch (paper 2.2b), or all
//! three.

use nalgebra::{Rotation3, Vector3};

use super::pattern;

/// Attitude jitter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jitter {
    /// Standard deviation per axis in radians; 0 is none.
    pub std_rad: f64,
    /// What the noise is added to.
    pub model: JitterModel,
    /// Which axes jitter.
    pub axes: JitterAxes,
}

/// What the attitude noise is added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JitterModel {
    /// To the Euler angles, as the paper does.
    Euler,
    /// A small random rotation about the body axes, as a vehicle does.
    Body,
}

/// The axes that jitter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JitterAxes {
    /// Roll and pitch (paper 2.2b).
    RollPitch,
    /// Roll, pitch and yaw.
    RollPitchYaw,
}

impl Jitter {
    /// How much of it turns an antenna: the mean square of the small turn about body x and y, over the two, at desired angles, for a
    /// deviation of 1 per axis. About those it turns by `(roll' - sin(pitch) yaw', cos(roll) pitch' + sin(roll) cos(pitch) yaw')`.
    #[must_use]
    pub fn share_across(&self, roll_rad: f64, pitch_rad: f64) -> f64 {
        let [roll, pitch] = [roll_rad, pitch_rad].map(|angle_rad| {
            let cosine = libm::cos(angle_rad);
            cosine * cosine
        });
        match (self.model, self.axes) {
            (JitterModel::Body, _) => 1.0,
            (JitterModel::Euler, JitterAxes::RollPitch) => (1.0 + roll) / 2.0,
            (JitterModel::Euler, JitterAxes::RollPitchYaw) => {
                (1.0 + roll + (1.0 - pitch) + (1.0 - roll) * pitch) / 2.0
            }
        }
    }
}

/// The antenna axis at desired angles (roll, pitch, yaw) under the noise `w_rad` (same order).
#[must_use]
pub fn axis(model: JitterModel, desired_rad: [f64; 3], w_rad: [f64; 3]) -> Vector3<f64> {
    let [roll, pitch, yaw] = desired_rad;
    match model {
        JitterModel::Euler => pattern::antenna_axis(roll + w_rad[0], pitch + w_rad[1], yaw + w_rad[2]),
        JitterModel::Body => Rotation3::from_euler_angles(roll, pitch, yaw) * body_axis(w_rad),
    }
}

/// The antenna axis in the desired body frame after the small rotation `exp([w])`.
#[must_use]
pub fn body_axis(w_rad: [f64; 3]) -> Vector3<f64> {
    let angle = Vector3::from(w_rad).norm();
    if angle == 0.0 {
        return Vector3::z();
    }
    let [x, y, z] = w_rad.map(|c| c / angle);
    let (sin, cos) = libm::sincos(angle);
    let turn = z * (1.0 - cos);
    Vector3::new(y * sin + x * turn, -x * sin + y * turn, cos + z * turn)
}

/// The small rotation `exp([w])` as a unit quaternion, scalar first.
#[must_use]
pub fn body_rotation(w_rad: [f64; 3]) -> [f64; 4] {
    let angle = Vector3::from(w_rad).norm();
    if angle == 0.0 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    let (sin, cos) = libm::sincos(0.5 * angle);
    let [x, y, z] = w_rad.map(|c| c / angle * sin);
    [cos, x, y, z]
}

/// Number of noise components per vehicle: 2, or 3 with yaw.
#[must_use]
pub fn components(axes: JitterAxes) -> usize {
    match axes {
        JitterAxes::RollPitch => 2,
        JitterAxes::RollPitchYaw => 3,
    }
}

/// Whether attitudes jitter at all.
#[must_use]
pub fn is_present(jitter: &Jitter) -> bool {
    jitter.std_rad > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn val_pitch_noise_does_nothing_at_a_roll_of_90_deg() {
        let still = axis(JitterModel::Euler, [FRAC_PI_2, 0.2, 0.0], [0.0; 3]);
        let noisy = axis(JitterModel::Euler, [FRAC_PI_2, 0.2, 0.0], [0.0, 0.3, 0.0]);
        assert!((still - noisy).norm() < 1e-15);
        let noisy = axis(JitterModel::Body, [FRAC_PI_2, 0.2, 0.0], [0.0, 0.3, 0.0]);
        assert!((still.dot(&noisy) - 0.3f64.cos()).abs() < 1e-14);
    }

    #[test]
    fn val_rotation_about_the_antenna_is_no_noise() {
        assert!((body_axis([0.0, 0.0, 0.7]) - Vector3::z()).norm() < 1e-15);
        assert!((body_axis([0.1, 0.0, 0.0]) - Vector3::new(0.0, -0.1f64.sin(), 0.1f64.cos())).norm() < 1e-15);
    }

    #[test]
    fn val_the_rotation_carries_z_to_the_axis() {
        for w in [[0.0; 3], [0.1, -0.2, 0.3], [0.0, 1e-9, 0.0], [2.0, 1.0, -0.5]] {
            let [scalar, x, y, z] = body_rotation(w);
            let rotation =
                nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(scalar, x, y, z));
            assert!((rotation * Vector3::z() - body_axis(w)).norm() < 1e-15, "{w:?}");
            let outside = Rotation3::new(Vector3::from(w));
            assert!((rotation.to_rotation_matrix().matrix() - outside.matrix()).norm() < 1e-14, "{w:?}");
        }
    }

    proptest! {
        /// Body-axis noise of a length turns the axis by that angle whatever the attitude.
        #[test]
        fn prop_body_noise_is_isotropic(r in -PI..PI, p in -PI..PI, y in -PI..PI, a in -PI..PI, w in 0.0..0.5f64) {
            let still = axis(JitterModel::Body, [r, p, y], [0.0; 3]);
            let noisy = axis(JitterModel::Body, [r, p, y], [w * a.cos(), w * a.sin(), 0.0]);
            prop_assert!((still.dot(&noisy) - w.cos()).abs() < 1e-12);
        }

        /// Identity: canonical angles have the same law under Euler noise (pointwise, up to signs of w and Y).
        #[test]
        fn prop_canonical_angles_have_the_same_law(r in -PI..PI, p in -PI..PI, w1 in -0.3..0.3, w2 in -0.3..0.3) {
            let (roll, pitch) = pattern::canonical_attitude(r, p);
            let given = axis(JitterModel::Euler, [r, p, 0.0], [w1, w2, 0.0]);
            let best = [(w1, w2), (-w1, w2), (w1, -w2), (-w1, -w2)].into_iter().map(|(a, b)| {
                axis(JitterModel::Euler, [roll, pitch, 0.0], [a, b, 0.0]).cross(&given).norm()
            }).fold(f64::INFINITY, f64::min);
            prop_assert!(best < 1e-9, "{best}");
        }
    }
}
