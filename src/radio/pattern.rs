//! The dipole's axis and pattern.

use nalgebra::Vector3;

/// The antenna axis (paper 1.1): the third column of `Rz(yaw) Ry(pitch) Rx(roll)`, a unit vector in ENU.
#[must_use]
pub fn antenna_axis(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Vector3<f64> {
    let (sr, cr) = libm::sincos(roll_rad);
    let (sp, cp) = libm::sincos(pitch_rad);
    let (sy, cy) = libm::sincos(yaw_rad);
    // Rz(yaw) applied to the yaw-free axis (cos roll sin pitch, -sin roll, cos roll cos pitch).
    Vector3::new(cy * cr * sp + sy * sr, sy * cr * sp - cy * sr, cr * cp)
}

/// Gain of the dipole relative to its maximum, in [0, 1] (paper 1.4): `1 - <u, Y>^2`, u the unit vector along
/// `direction` (any length, either sense) and Y the unit `axis`. 0 for a zero direction: nothing can be said there.
#[must_use]
pub fn gain(direction: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
    let square = direction.norm_squared();
    if square > 0.0 {
        // The cross product keeps its relative accuracy near the null, where 1 - <u, Y>^2 cancels.
        (direction.cross(axis).norm_squared() / square).min(1.0)
    } else {
        0.0
    }
}

/// The canonical roll and pitch of an antenna line, at yaw 0 and in radians: |roll|, |pitch| <= pi/2.
///
/// Paper 4.7 with its holes closed: Y and -Y are the same antenna, so the upper of the two is taken; `axis` need not
/// be normalised; where pitch is undetermined (Y along east-west's normal, +-e_y) it is 0, and the zero vector is level.
#[must_use]
pub fn canonical_angles(axis: &Vector3<f64>) -> (f64, f64) {
    let up = if axis.z < 0.0 { -axis } else { *axis };
    let in_plane = libm::hypot(up.x, up.z);
    let roll = if up.y == 0.0 { 0.0 } else { libm::atan2(-up.y, in_plane) };
    let pitch = if in_plane == 0.0 { 0.0 } else { libm::atan2(up.x, up.z) };
    (roll, pitch)
}

/// The canonical roll and pitch for given ones, and the same antenna line: |roll|, |pitch| <= pi/2 at an unchanged yaw.
#[must_use]
pub fn canonical_attitude(roll_rad: f64, pitch_rad: f64) -> (f64, f64) {
    canonical_angles(&antenna_axis(roll_rad, pitch_rad, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn val_axis_of_simple_attitudes() {
        assert_eq!(antenna_axis(0.0, 0.0, 0.0), Vector3::z());
        assert!((antenna_axis(FRAC_PI_2, 0.0, 0.0) + Vector3::y()).norm() < 1e-15);
        assert!((antenna_axis(0.0, FRAC_PI_2, 0.0) - Vector3::x()).norm() < 1e-15);
        assert!((antenna_axis(0.0, FRAC_PI_2, FRAC_PI_2) - Vector3::y()).norm() < 1e-15);
        assert!(
            (antenna_axis(0.3, 0.0, FRAC_PI_2) - Vector3::new(0.3f64.sin(), 0.0, 0.3f64.cos())).norm()
                < 1e-15
        );
    }

    #[test]
    fn val_gain_is_one_across_and_zero_along() {
        let axis = antenna_axis(0.4, -0.9, 0.0);
        assert!(gain(&(axis * 37.0), &axis) < 1e-30);
        assert!((gain(&axis.cross(&Vector3::x()), &axis) - 1.0).abs() < 1e-15);
        assert!((gain(&Vector3::new(1.0, 0.0, 1.0), &Vector3::z()) - 0.5).abs() < 1e-15);
        assert_eq!(gain(&Vector3::zeros(), &axis), 0.0);
    }

    #[test]
    fn val_degenerate_axes_have_angles() {
        assert_eq!(canonical_angles(&Vector3::y()), (-FRAC_PI_2, 0.0));
        assert_eq!(canonical_angles(&-Vector3::y()), (FRAC_PI_2, 0.0));
        assert_eq!(canonical_angles(&Vector3::zeros()), (0.0, 0.0));
        assert_eq!(canonical_angles(&-Vector3::z()), (0.0, 0.0));
        // Rounding may make |Y_y| exceed 1: the printed asin is NaN there.
        let (roll, pitch) = canonical_angles(&Vector3::new(0.0, 1.0 + 1e-12, 0.0));
        assert_eq!((roll, pitch), (-FRAC_PI_2, 0.0));
    }

    proptest! {
        #[test]
        fn prop_canonical_angles_give_the_same_line(r in -PI..PI, p in -PI..PI) {
            let axis = antenna_axis(r, p, 0.0);
            let (roll, pitch) = canonical_angles(&axis);
            prop_assert!(roll.abs() <= FRAC_PI_2 && pitch.abs() <= FRAC_PI_2);
            let again = antenna_axis(roll, pitch, 0.0);
            prop_assert!(again.cross(&axis).norm() < 1e-12);
            prop_assert_eq!(canonical_attitude(r, p), (roll, pitch));
        }

        #[test]
        fn prop_gain_of_opposite_axes_is_equal(r in -PI..PI, p in -PI..PI, x in -9.0..9.0, y in -9.0..9.0, z in -9.0..9.0) {
            let (axis, u) = (antenna_axis(r, p, 0.0), Vector3::new(x, y, z));
            prop_assert_eq!(gain(&u, &axis), gain(&u, &-axis));
            let plain = 1.0 - (u.dot(&axis) / u.norm()).powi(2);
            prop_assert!((gain(&u, &axis) - plain).abs() < 1e-12);
        }

        /// Yaw turns the axis about the vertical.
        #[test]
        fn prop_yaw_turns_the_axis(r in -PI..PI, p in -PI..PI, y in -PI..PI) {
            let turned = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), y) * antenna_axis(r, p, 0.0);
            prop_assert!((turned - antenna_axis(r, p, y)).norm() < 1e-12);
        }
    }
}
