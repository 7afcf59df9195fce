//! Charts: which of a pair's fourteen numbers a search varies, and in which coordinates.
//!
//! Positions are in units of the chart's length, so that all variables are of order one. An axis is held fixed, given by
//! roll and pitch (and yaw), by tilt and azimuth where tilt is limited (the limit is then a bound on one variable), or
//! follows the position by a linear map (phases 1 and 2). A power is fixed, or varies linearly or logarithmically.

use nalgebra::{Matrix3, Vector3};

use super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::region::Region;
use super::solver::{Constraints, MAX, Row, Separation, Vars};
use crate::radio::pattern;

/// Tilt limits from here on exclude no antenna line.
const ANY_TILT_RAD: f64 = std::f64::consts::FRAC_PI_2 - 1e-12;

/// How an antenna axis is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AxisChart {
    /// Held at these angles.
    Fixed([f64; 3]),
    /// Roll and pitch are variables; yaw too, if so said.
    Angles {
        /// Whether yaw is a variable.
        yaw: bool,
    },
    /// Tilt and azimuth are variables, tilt limited; yaw too, if so said.
    Tilt {
        /// Whether yaw is a variable.
        yaw: bool,
        /// Largest tilt in radians, below pi/2.
        limit_rad: f64,
    },
    /// The axis is `map (p - about)`, turned into the tilt limit along its azimuth where it exceeds it.
    Follows {
        /// The linear map.
        map: Matrix3<f64>,
        /// The user's position in metres.
        about: Vector3<f64>,
        /// Largest tilt in radians.
        limit_rad: f64,
    },
}

impl AxisChart {
    /// A free axis under a tilt limit.
    #[must_use]
    pub fn free(limit_rad: f64, yaw: bool) -> Self {
        if limit_rad >= ANY_TILT_RAD {
            Self::Angles { yaw }
        } else if limit_rad <= 0.0 {
            Self::Fixed([0.0; 3])
        } else {
            Self::Tilt { yaw, limit_rad }
        }
    }

    /// Number of variables.
    #[must_use]
    pub fn variables(&self) -> usize {
        match self {
            Self::Fixed(_) | Self::Follows { .. } => 0,
            Self::Angles { yaw } | Self::Tilt { yaw, .. } => 2 + usize::from(*yaw),
        }
    }
}

/// How a power is chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PowerChart {
    /// Held at this many watts.
    Fixed(f64),
    /// `P / max` is the variable.
    Linear {
        /// The cap in watts, positive.
        max_w: f64,
    },
    /// `ln(P / max)` is the variable, between `floor` and 0.
    Log {
        /// The cap in watts, positive.
        max_w: f64,
        /// Least logarithm.
        floor: f64,
    },
}

impl PowerChart {
    fn variables(&self) -> usize {
        usize::from(!matches!(self, Self::Fixed(_)))
    }
}

/// Coordinates of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chart {
    /// Unit of positions in metres.
    pub length_m: f64,
    /// Axes of I and J.
    pub axes: [AxisChart; 2],
    /// Powers of I and J.
    pub powers: [PowerChart; 2],
}

impl Chart {
    /// Number of variables.
    #[must_use]
    pub fn dimension(&self) -> usize {
        (0..2).map(|v| self.vehicle_dimension(v)).sum()
    }

    /// Number of a vehicle's variables: its position, its axis, its power.
    #[must_use]
    pub fn vehicle_dimension(&self, v: usize) -> usize {
        3 + self.axes[v].variables() + self.powers[v].variables()
    }

    /// The first of a vehicle's variables.
    #[must_use]
    pub fn offset(&self, v: usize) -> usize {
        v * self.vehicle_dimension(0)
    }

    /// The configuration at `x`.
    #[must_use]
    pub fn raw(&self, x: &Vars) -> Raw {
        let mut raw = [0.0; 14];
        for v in 0..2 {
            let x = &x[self.offset(v)..];
            let out = &mut raw[v * VEHICLE..(v + 1) * VEHICLE];
            for k in 0..3 {
                out[k] = x[k] * self.length_m;
            }
            let angles = self.angles(v, &x[3..], out);
            out[ANGLES..POWER].copy_from_slice(&angles);
            let power = x.get(3 + self.axes[v].variables()).copied().unwrap_or(0.0);
            out[POWER] = match self.powers[v] {
                PowerChart::Fixed(w) => w,
                PowerChart::Linear { max_w } => max_w * power.clamp(0.0, 1.0),
                PowerChart::Log { max_w, .. } => max_w * libm::exp(power.min(0.0)),
            };
        }
        raw
    }

    fn angles(&self, v: usize, x: &[f64], position: &[f64]) -> [f64; 3] {
        let yaw = |on: bool| if on { x[2] } else { 0.0 };
        match self.axes[v] {
            AxisChart::Fixed(angles) => angles,
            AxisChart::Angles { yaw: on } => [x[0], x[1], yaw(on)],
            AxisChart::Tilt { yaw: on, .. } => {
                let ((st, ct), (sa, ca)) = (libm::sincos(x[0]), libm::sincos(x[1]));
                let (roll, pitch) = pattern::canonical_angles(&Vector3::new(st * ca, st * sa, ct));
                [roll, pitch, yaw(on)]
            }
            AxisChart::Follows { map, about, limit_rad } => {
                let y =
                    limited(map * (Vector3::new(position[0], position[1], position[2]) - about), limit_rad).0;
                let (roll, pitch) = pattern::canonical_angles(&y);
                [roll, pitch, 0.0]
            }
        }
    }

    /// The variables nearest to a configuration: coordinates this chart does not vary are dropped.
    #[must_use]
    pub fn encode(&self, raw: &Raw) -> Vars {
        let mut x = [0.0; MAX];
        for v in 0..2 {
            let from = &raw[v * VEHICLE..(v + 1) * VEHICLE];
            let to = &mut x[self.offset(v)..];
            for k in 0..3 {
                to[k] = from[k] / self.length_m;
            }
            match self.axes[v] {
                AxisChart::Fixed(_) | AxisChart::Follows { .. } => {}
                AxisChart::Angles { yaw } => {
                    to[3..5].copy_from_slice(&from[ANGLES..ANGLES + 2]);
                    if yaw {
                        to[5] = from[ANGLES + 2];
                    }
                }
                AxisChart::Tilt { yaw, limit_rad } => {
                    let y = pattern::antenna_axis(from[ANGLES], from[ANGLES + 1], 0.0);
                    let y = if y.z < 0.0 { -y } else { y };
                    to[3] = libm::atan2(libm::hypot(y.x, y.y), y.z).min(limit_rad);
                    to[4] = if y.x == 0.0 && y.y == 0.0 { 0.0 } else { libm::atan2(y.y, y.x) };
                    if yaw {
                        to[5] = from[ANGLES + 2];
                    }
                }
            }
            let at = 3 + self.axes[v].variables();
            match self.powers[v] {
                PowerChart::Fixed(_) => {}
                PowerChart::Linear { max_w } => to[at] = from[POWER] / max_w,
                PowerChart::Log { max_w, floor } => to[at] = libm::log(from[POWER] / max_w).clamp(floor, 0.0),
            }
        }
        x
    }

    /// Carries a gradient (power entries by ln P) from the configuration `raw` at `x` to the variables.
    pub fn pull(&self, x: &Vars, raw: &Raw, by_raw: &Raw, out: &mut Vars) {
        *out = [0.0; MAX];
        for v in 0..2 {
            let (raw, from) = (&raw[v * VEHICLE..(v + 1) * VEHICLE], &by_raw[v * VEHICLE..(v + 1) * VEHICLE]);
            let x = &x[self.offset(v)..];
            let to = &mut out[self.offset(v)..];
            for k in 0..3 {
                to[k] = from[k] * self.length_m;
            }
            let (droll, dpitch) = (from[ANGLES], from[ANGLES + 1]);
            match self.axes[v] {
                AxisChart::Fixed(_) => {}
                AxisChart::Angles { .. } => to[3..5].copy_from_slice(&from[ANGLES..ANGLES + 2]),
                AxisChart::Tilt { .. } => {
                    let ((st, ct), (sa, ca)) = (libm::sincos(x[3]), libm::sincos(x[4]));
                    let by_axis = angles_transposed(&Vector3::new(st * ca, st * sa, ct), droll, dpitch);
                    to[3] = by_axis.dot(&Vector3::new(ct * ca, ct * sa, -st));
                    to[4] = by_axis.dot(&Vector3::new(-st * sa, st * ca, 0.0));
                }
                AxisChart::Follows { map, about, limit_rad } => {
                    let (y, jacobian) =
                        limited(map * (Vector3::new(raw[0], raw[1], raw[2]) - about), limit_rad);
                    let by_axis = angles_transposed(&y, droll, dpitch);
                    let by_position = map.transpose() * jacobian.transpose() * by_axis;
                    for k in 0..3 {
                        to[k] += by_position[k] * self.length_m;
                    }
                }
            }
            if let AxisChart::Angles { yaw: true } | AxisChart::Tilt { yaw: true, .. } = self.axes[v] {
                to[5] = from[ANGLES + 2];
            }
            let at = 3 + self.axes[v].variables();
            match self.powers[v] {
                PowerChart::Fixed(_) => {}
                PowerChart::Linear { .. } => to[at] = from[POWER] / x[at].max(1e-12),
                PowerChart::Log { .. } => to[at] = from[POWER],
            }
        }
    }

    /// The feasible set with I and J in the given cells of the region.
    #[must_use]
    pub fn constraints(&self, region: &Region, cells: [usize; 2], separation_m: f64) -> Constraints {
        let mut rows = Vec::new();
        let mut bound = |at: usize, sign: f64, b: f64| {
            let mut a = [0.0; MAX];
            a[at] = sign;
            rows.push(Row { a, b: sign * b });
        };
        for v in 0..2 {
            let at = self.offset(v);
            let altitude_m = region.cells()[cells[v]].altitude_m;
            bound(at + 2, -1.0, altitude_m[0] / self.length_m);
            bound(at + 2, 1.0, altitude_m[1] / self.length_m);
            if let AxisChart::Tilt { limit_rad, .. } = self.axes[v] {
                bound(at + 3, -1.0, -limit_rad);
                bound(at + 3, 1.0, limit_rad);
            }
            let power = at + 3 + self.axes[v].variables();
            match self.powers[v] {
                PowerChart::Fixed(_) => {}
                PowerChart::Linear { .. } => {
                    bound(power, -1.0, 0.0);
                    bound(power, 1.0, 1.0);
                }
                PowerChart::Log { floor, .. } => {
                    bound(power, -1.0, floor);
                    bound(power, 1.0, 0.0);
                }
            }
        }
        for (v, cell) in cells.iter().enumerate() {
            for half_plane in &region.cells()[*cell].sides {
                let mut a = [0.0; MAX];
                a[self.offset(v)] = half_plane.normal.x;
                a[self.offset(v) + 1] = half_plane.normal.y;
                rows.push(Row { a, b: half_plane.offset_m / self.length_m });
            }
        }
        let separation = (separation_m > 0.0).then(|| Separation {
            at: [self.offset(0), self.offset(1)],
            distance: separation_m / self.length_m,
        });
        Constraints::new(self.dimension(), rows, separation)
    }
}

/// `J' (droll, dpitch)`, J the Jacobian of the canonical angles of an axis of any length.
fn angles_transposed(y: &Vector3<f64>, droll: f64, dpitch: f64) -> Vector3<f64> {
    let up = if y.z < 0.0 { -1.0 } else { 1.0 };
    let y = y * up;
    let plane2 = (y.x * y.x + y.z * y.z).max(1e-24);
    let plane = plane2.sqrt();
    let all2 = plane2 + y.y * y.y;
    let roll = Vector3::new(y.x * y.y / plane, -plane, y.z * y.y / plane) / all2;
    let pitch = Vector3::new(y.z, 0.0, -y.x) / plane2;
    (roll * droll + pitch * dpitch) * up
}

/// An axis turned into the tilt limit along its azimuth, and the Jacobian of that.
fn limited(y: Vector3<f64>, limit_rad: f64) -> (Vector3<f64>, Matrix3<f64>) {
    let horizontal = libm::hypot(y.x, y.y);
    if limit_rad >= ANY_TILT_RAD || horizontal <= libm::tan(limit_rad) * y.z.abs() {
        return (y, Matrix3::identity());
    }
    // (x, y) scaled to the length tan(limit) |z|: with z = 0 straight up is as good as any.
    let up = if y.z < 0.0 { -1.0 } else { 1.0 };
    let (ux, uy) = (y.x / horizontal, y.y / horizontal);
    let reach = libm::tan(limit_rad);
    let z = y.z.abs().max(1e-9 * horizontal);
    let axis = Vector3::new(reach * z * ux, reach * z * uy, up * z);
    let spread = reach * z / horizontal;
    let jacobian = Matrix3::new(
        spread * uy * uy,
        -spread * ux * uy,
        reach * up * ux,
        -spread * ux * uy,
        spread * ux * ux,
        reach * up * uy,
        0.0,
        0.0,
        1.0,
    );
    (axis, jacobian)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::expectation::exact::Exact;
    use crate::planner::expectation::kernel::{Scene, Workspace};
    use crate::planner::expectation::samples::{Samples, Sequence};
    use crate::planner::phase1;
    use crate::planner::problem::Problem;
    use crate::planner::problem::{Eavesdropper, JitterAxes, JitterModel, Uncertainty};

    fn scene() -> Scene {
        Scene { user: [10.0, -5.0, 2.0], budget_m2_w: 1e9, ..Scene::of(&Problem::paper([], 0.5, 0.0)) }
    }

    fn configuration() -> Raw {
        [25.0, 30.0, 85.0, 0.7, -0.4, 0.3, 0.5, 150.0, -210.0, 120.0, 0.9, 0.5, -0.2, 0.02]
    }

    fn charts() -> Vec<Chart> {
        let about = Vector3::new(10.0, -5.0, 2.0);
        let axes = [
            AxisChart::Fixed([0.1, 0.2, 0.3]),
            AxisChart::Angles { yaw: false },
            AxisChart::Angles { yaw: true },
            AxisChart::Tilt { yaw: false, limit_rad: 0.9 },
            AxisChart::Tilt { yaw: true, limit_rad: 1.2 },
            AxisChart::Follows { map: Matrix3::identity(), about, limit_rad: 2.0 },
            AxisChart::Follows { map: Matrix3::identity(), about, limit_rad: 0.4 },
            AxisChart::Follows { map: phase1::axis_map(0.8), about, limit_rad: 2.0 },
            AxisChart::Follows { map: phase1::axis_map(0.8), about, limit_rad: 0.5 },
        ];
        let powers = [
            PowerChart::Fixed(0.3),
            PowerChart::Linear { max_w: 0.6 },
            PowerChart::Log { max_w: 0.6, floor: -20.0 },
        ];
        let pair = |k: usize| Chart {
            length_m: 80.0,
            axes: [axes[k % axes.len()], axes[(k / 3 + 4) % axes.len()]],
            powers: [powers[k % 3], powers[(k / 2) % 3]],
        };
        (0..27).map(pair).collect()
    }

    /// Central differences through chart and objective against the analytic gradient.
    fn check(name: &str, mut objective: impl FnMut(&Raw, &mut Raw) -> f64) {
        for (index, chart) in charts().iter().enumerate() {
            let x = chart.encode(&configuration());
            let mut by_raw = [0.0; 14];
            let raw = chart.raw(&x);
            objective(&raw, &mut by_raw);
            let mut gradient = [0.0; MAX];
            chart.pull(&x, &raw, &by_raw, &mut gradient);
            for k in 0..chart.dimension() {
                let mut at = |step: f64| {
                    let mut y = x;
                    y[k] += step;
                    objective(&chart.raw(&y), &mut [0.0; 14])
                };
                let numeric = (8.0 * (at(1e-5) - at(-1e-5)) - (at(2e-5) - at(-2e-5))) / 12e-5;
                let scale = 1.0 + gradient[k].abs();
                assert!(
                    (numeric - gradient[k]).abs() < 1e-5 * scale,
                    "{name}, chart {index}, variable {k}: {numeric} {}",
                    gradient[k]
                );
            }
        }
    }

    #[test]
    fn val_gradient_without_jitter() {
        let nodes = [[120.0, 80.0, 3.0], [-200.0, 90.0, 0.0], [40.0, -300.0, 10.0]];
        let mut exact = Exact::default();
        check("exact", |raw, gradient| exact.value(&scene(), nodes.into_iter(), raw, 7.0, Some(gradient)));
    }

    #[test]
    fn val_gradient_under_every_jitter_and_draws() {
        for model in [JitterModel::Euler, JitterModel::Body] {
            for axes in [JitterAxes::RollPitch, JitterAxes::RollPitchYaw] {
                for draws in [1, 4] {
                    let mut problem = Problem::paper(
                        [[120.0, 80.0], [-200.0, 90.0], [40.0, -300.0]],
                        0.5,
                        5f64.to_radians(),
                    );
                    (problem.jitter.model, problem.jitter.axes) = (model, axes);
                    for e in &mut problem.eavesdroppers {
                        *e = Eavesdropper { uncertainty: Uncertainty::Disc { radius_m: 30.0 }, ..*e };
                    }
                    // Few samples: none of them on the kink between two eavesdroppers.
                    let samples = Samples::new(&problem, 32, draws, 9, Sequence::Sobol);
                    let mut workspace = Workspace::default();
                    check("sampled", |raw, gradient| {
                        workspace.mean(&scene(), &samples, raw, false, Some(gradient))
                    });
                }
            }
        }
    }

    #[test]
    fn val_encode_and_raw_are_inverse() {
        for chart in charts() {
            let x = chart.encode(&configuration());
            let again = chart.encode(&chart.raw(&x));
            assert!(x.iter().zip(again).all(|(a, b)| (a - b).abs() < 1e-12), "{chart:?}");
        }
    }
}
