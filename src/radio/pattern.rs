//! The dipole's axis and pattern.

use nalgebra::Vector3;

/// The antenna axis (paper 1.1): the third column of `Rz(yaw) Ry(pitch) Rx(roll)`, a unit vector in ENU.
#[must_use]
pub fn antenna_axis(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Vector3<f64> {
    let (sr, cr) = roll_rad.sin_cos();
    let (sp, cp) = pitch_rad.sin_cos();
    let (sy, cy) = yaw_rad.sin_cos();
    // Rz(yaw) applied to the yaw-free axis (cos roll sin pitch, -sin roll, cos roll cos pitch).
    Vector3::new(cy * cr * sp + sy * sr, sy * cr * sp - cy * sr, cr * cp)
}
