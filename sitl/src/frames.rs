//! Attitudes and axes, from the paper's section II and the MAVLink frame definitions.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Roll, pitch and yaw in radians, the paper's convention: `R = Rz(yaw) Ry(pitch) Rx(roll)` turns body (FLU)
/// coordinates into world (ENU) coordinates; at zero the body's x points east.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Euler {
    /// About the body's x.
    pub roll_rad: f64,
    /// About the once-turned y; positive lowers the nose in FLU.
    pub pitch_rad: f64,
    /// About the world's z, from east towards north.
    pub yaw_rad: f64,
}

impl Euler {
    /// The rotation from body (FLU) to world (ENU).
    #[must_use]
    pub fn rotation(self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw_rad)
            * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), self.pitch_rad)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.roll_rad)
    }

    /// The angles of a rotation, with |pitch| <= pi/2. At pitch = +-pi/2 only roll -+ yaw is defined; yaw is then
    /// taken as zero.
    #[must_use]
    pub fn of(rotation: &UnitQuaternion<f64>) -> Self {
        let m = rotation.to_rotation_matrix();
        let sin_pitch = (-m[(2, 0)]).clamp(-1.0, 1.0);
        let cos_pitch = m[(0, 0)].hypot(m[(1, 0)]);
        let pitch_rad = sin_pitch.atan2(cos_pitch);
        if cos_pitch < 1e-9 {
            let roll_rad = (sin_pitch * m[(0, 1)]).atan2(m[(1, 1)]);
            return Self { roll_rad, pitch_rad, yaw_rad: 0.0 };
        }
        Self { roll_rad: m[(2, 1)].atan2(m[(2, 2)]), pitch_rad, yaw_rad: m[(1, 0)].atan2(m[(0, 0)]) }
    }
}

/// The dipole's axis in the world (paper 1.1): the body's z, carried by the attitude.
#[must_use]
pub fn antenna_axis(attitude: &UnitQuaternion<f64>) -> Vector3<f64> {
    attitude * Vector3::z()
}

/// East, north, up from north, east, down of one origin, and back: half a turn about the axis midway between x and y.
pub(crate) fn enu_to_ned() -> UnitQuaternion<f64> {
    let h = std::f64::consts::FRAC_1_SQRT_2;
    UnitQuaternion::new_unchecked(Quaternion::new(0.0, h, h, 0.0))
}

/// Forward-right-down from forward-left-up: half a turn about x, its own inverse.
pub(crate) fn frd_to_flu() -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0))
}

/// The turn about the vertical that a body makes, from east towards north: where its x points, or for a body that
/// stands on its nose, where its z does.
pub(crate) fn heading_rad(attitude: &UnitQuaternion<f64>) -> f64 {
    let x = attitude * Vector3::x();
    let d = if x.x.hypot(x.y) > 0.1 { x } else { (attitude * Vector3::z()) * -x.z.signum() };
    d.y.atan2(d.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_axis_is_the_papers_closed_form_at_zero_yaw() {
        for (roll, pitch) in [(0.3, -0.7), (-1.2, 0.4), (1.5, 1.5), (0.0, 0.0)] {
            let axis = antenna_axis(&Euler { roll_rad: roll, pitch_rad: pitch, yaw_rad: 0.0 }.rotation());
            let paper = Vector3::new(roll.cos() * pitch.sin(), -roll.sin(), roll.cos() * pitch.cos());
            assert!((axis - paper).norm() < 1e-15, "{axis} {paper}");
        }
    }

    #[test]
    fn prop_euler_angles_return_the_same_rotation() {
        for roll in [-3.0, -1.0, 0.0, 0.5, 1.57] {
            for pitch in [-std::f64::consts::FRAC_PI_2, -1.2, 0.0, 0.9, std::f64::consts::FRAC_PI_2] {
                for yaw in [-2.0, 0.0, 1.0] {
                    let r = Euler { roll_rad: roll, pitch_rad: pitch, yaw_rad: yaw }.rotation();
                    assert!(Euler::of(&r).rotation().angle_to(&r) < 1e-7);
                }
            }
        }
    }

    #[test]
    fn val_ned_and_frd_follow_the_mavlink_definitions() {
        // Facing east and level is a NED yaw of 90 degrees; the paper's pitch is the nose down, MAVLink's is up.
        let q =
            enu_to_ned() * Euler { roll_rad: 0.2, pitch_rad: 0.3, yaw_rad: 0.0 }.rotation() * frd_to_flu();
        let (roll, pitch, yaw) = q.euler_angles();
        assert!((roll - 0.2).abs() < 1e-12 && (pitch + 0.3).abs() < 1e-12);
        assert!((yaw - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        let up = q * Vector3::new(0.0, 0.0, -1.0);
        let axis = antenna_axis(&Euler { roll_rad: 0.2, pitch_rad: 0.3, yaw_rad: 0.0 }.rotation());
        // The same axis in NED: x and y change places, z its sign.
        assert!((up - Vector3::new(axis.y, axis.x, -axis.z)).norm() < 1e-12);
    }
}
