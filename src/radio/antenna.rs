//! A vehicle's antenna: the ideal dipole, a dipole whose null has a floor, or a pattern that was measured.

use std::sync::Arc;

use nalgebra::Vector3;

use super::measured::Measured;

/// An axisymmetric antenna's gain over the angle from its axis, relative to its largest, linear.
///
/// The dipoles look the same along both ends of their axis. A measured pattern need not: its angle is counted from the
/// axis itself, body z.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// `G = 1 - (1 - f) c^2`, c the cosine between axis and direction: the paper's dipole (1.4) where the floor is 0. What
    /// is left in the null leaks incoherently, by cross-polarisation, the frame and the feed.
    Dipole {
        /// f, from 0 to 1: the gain along the axis.
        floor: f64,
    },
    /// As measured.
    Measured(Arc<Measured>),
}

impl Default for Pattern {
    /// The paper's dipole.
    fn default() -> Self {
        Self::IDEAL
    }
}

impl Pattern {
    /// The paper's dipole.
    pub const IDEAL: Self = Self::Dipole { floor: 0.0 };

    /// A dipole whose null is this deep, in dB below its largest gain.
    #[must_use]
    pub fn with_null_depth(depth_db: f64) -> Self {
        Self::Dipole { floor: libm::pow(10.0, -depth_db / 10.0) }
    }

    /// Whether it is the paper's.
    #[must_use]
    pub fn is_ideal(&self) -> bool {
        *self == Self::IDEAL
    }

    /// Whether both ends of the axis are alike, so that Y and -Y are the same antenna.
    #[must_use]
    pub fn is_symmetric(&self) -> bool {
        match self {
            Self::Dipole { .. } => true,
            Self::Measured(measured) => measured.is_symmetric(),
        }
    }

    /// The gain along `direction`, from the vehicle and of any length, by a unit `axis`. Of no direction, that across
    /// an ideal dipole's null: 0.
    #[must_use]
    pub fn gain(&self, direction: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
        let square = direction.norm_squared();
        if square == 0.0 {
            return 0.0;
        }
        // The cross product keeps its relative accuracy near the null, where 1 - <u, Y>^2 cancels.
        let sine_squared = (direction.cross(axis).norm_squared() / square).min(1.0);
        self.gain_and_slope(direction.dot(axis) / square.sqrt(), sine_squared).0
    }

    /// The gain at an angle from the axis, given by its cosine and the square of its sine, and the gain's derivative
    /// by the cosine.
    #[must_use]
    #[inline]
    pub fn gain_and_slope(&self, cosine: f64, sine_squared: f64) -> (f64, f64) {
        match self {
            Self::Dipole { floor } => {
                let depth = 1.0 - floor;
                (floor + depth * sine_squared, -2.0 * depth * cosine)
            }
            Self::Measured(measured) => {
                let sine = sine_squared.sqrt();
                let (gain, by_angle) = measured.gain_and_slope(libm::atan2(sine, cosine));
                // On the axis the derivative by the cosine may be infinite: large enough to turn away from it.
                (gain, -by_angle / sine.max(1e-9))
            }
        }
    }

    /// Mean of the gain over the sphere: what a field scattered from everywhere finds.
    #[must_use]
    pub fn mean(&self) -> f64 {
        match self {
            Self::Dipole { floor } => 1.0 - (1.0 - floor) / 3.0,
            Self::Measured(measured) => measured.mean(),
        }
    }

    /// The least gain in any direction.
    #[must_use]
    pub fn least(&self) -> f64 {
        match self {
            Self::Dipole { floor } => *floor,
            Self::Measured(measured) => measured.least(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::pattern;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// The mean over the sphere by the midpoint rule in the cosine.
    fn mean_by_sum(pattern: &Pattern) -> f64 {
        let n = 200_000;
        let cosine = |k: i32| -1.0 + 2.0 * (f64::from(k) + 0.5) / f64::from(n);
        (0..n).map(|k| pattern.gain_and_slope(cosine(k), 1.0 - cosine(k).powi(2)).0).sum::<f64>()
            / f64::from(n)
    }

    /// A dipole of this floor as somebody would have measured it.
    fn as_measured(depth_db: f64, step_deg: usize) -> Pattern {
        let floor = 10f64.powf(-depth_db / 10.0);
        let points = (0..=180 / step_deg).map(|k| {
            let deg = (k * step_deg) as f64;
            [deg, 10.0 * (1.0 - (1.0 - floor) * deg.to_radians().cos().powi(2)).log10()]
        });
        Pattern::Measured(Arc::new(Measured::new(&points.collect::<Vec<_>>()).unwrap()))
    }

    #[test]
    fn val_null_depth_is_the_gain_along_the_axis() {
        let pattern = Pattern::with_null_depth(25.0);
        let along = 10.0 * pattern.gain(&Vector3::new(0.0, 0.0, -40.0), &Vector3::z()).log10();
        assert!((along + 25.0).abs() < 1e-12, "{along}");
        assert_eq!(pattern.gain(&Vector3::x(), &Vector3::z()), 1.0);
        assert!(Pattern::with_null_depth(300.0).least() < 1e-29);
    }

    #[test]
    fn val_mean_over_the_sphere() {
        assert!((Pattern::IDEAL.mean() - 2.0 / 3.0).abs() < 1e-15);
        for pattern in
            [Pattern::IDEAL, Pattern::with_null_depth(20.0), as_measured(20.0, 5), as_measured(30.0, 1)]
        {
            assert!((pattern.mean() - mean_by_sum(&pattern)).abs() < 1e-7, "{pattern:?}");
        }
    }

    #[test]
    fn val_a_dipole_that_was_measured_is_that_dipole() {
        let (dipole, measured) = (Pattern::with_null_depth(20.0), as_measured(20.0, 1));
        for k in 0..=1800 {
            let angle = PI * f64::from(k) / 1800.0;
            let at = |p: &Pattern| p.gain_and_slope(angle.cos(), angle.sin().powi(2)).0;
            assert!((at(&dipole) - at(&measured)).abs() < 2e-4, "{angle}");
        }
        assert!((dipole.mean() - measured.mean()).abs() < 2e-5);
        assert!(measured.is_symmetric());
    }

    proptest! {
        /// Without a floor it is the paper's dipole, to the bit.
        #[test]
        fn prop_the_ideal_is_the_papers_dipole(r in -PI..PI, p in -PI..PI, x in -9.0..9.0, y in -9.0..9.0, z in -9.0..9.0) {
            let (axis, u) = (pattern::antenna_axis(r, p, 0.0), Vector3::new(x, y, z));
            prop_assert_eq!(Pattern::IDEAL.gain(&u, &axis), pattern::gain(&u, &axis));
        }

        #[test]
        fn prop_the_slope_is_the_gains_derivative(angle in 0.05..3.09f64, depth_db in 3.0..40.0f64) {
            for pattern in [Pattern::with_null_depth(depth_db), as_measured(depth_db, 5)] {
                let at = |c: f64| pattern.gain_and_slope(c, 1.0 - c * c);
                let (c, h) = (angle.cos(), 1e-7);
                let numeric = (at(c + h).0 - at(c - h).0) / (2.0 * h);
                prop_assert!((at(c).1 - numeric).abs() < 1e-4 * (1.0 + numeric.abs()), "{} {}", at(c).1, numeric);
            }
        }
    }
}
