//! What a vehicle may do on its way.

use super::spline::Demand;
use crate::geo::Enu;

/// Limits of motion; how fast a vehicle turns its [`Ways`](super::super::volume::Ways) say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Horizontal speed in m/s.
    pub speed_m_s: f64,
    /// Vertical speed in m/s, up and down.
    pub climb_m_s: f64,
    /// Acceleration in any direction in m/s^2.
    pub acceleration_m_s2: f64,
    /// Change of acceleration in m/s^3; `None`: any.
    pub jerk_m_s3: Option<f64>,
}

impl Limits {
    /// The largest of what is demanded over what may be: 1 and less keeps every limit.
    #[must_use]
    pub fn strain(&self, demand: &Demand) -> f64 {
        let all = [
            demand.speed_m_s / self.speed_m_s,
            demand.climb_m_s / self.climb_m_s,
            demand.acceleration_m_s2 / self.acceleration_m_s2,
            self.jerk_m_s3.map_or(0.0, |jerk| demand.jerk_m_s3 / jerk),
        ];
        all.into_iter().fold(0.0, f64::max)
    }

    /// How long a straight way takes at full speed, in seconds; in metres, ENU.
    #[must_use]
    pub fn flies_s(&self, way: &Enu) -> f64 {
        (way.xy().norm() / self.speed_m_s).max(way.z.abs() / self.climb_m_s)
    }
}
