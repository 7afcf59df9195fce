//! Phase 2 of the paper: J's null on the user.
//!
//! The dipole radiates nothing along its axis, so `Y_J = (p_J - p_0) / |p_J - p_0|` protects the user from any power of J
//! (4.9, with J's own position; printed with I's). Without jitter this is optimal to 2e-6.

use nalgebra::Matrix3;

/// J's axis follows its position: `Y_J = M (p_J - p_0)`, up to length.
#[must_use]
pub fn axis_map() -> Matrix3<f64> {
    Matrix3::identity()
}
