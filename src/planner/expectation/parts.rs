//! What the kernels share: configurations, links, sums of gradients, and the objective of a block once it is known what each
//! node receives.

use super::antenna::Antenna;
use super::attitude::Axes;
use super::lanes::{LANES, Lane};
use crate::planner::problem::{Fading, Problem};
use crate::radio::link::NEAREST_M;

/// A configuration of the pair, flat: position (3), roll, pitch, yaw, power in W of I, then of J.
pub type Raw = [f64; 14];

/// Offset of vehicle J in [`Raw`].
pub const VEHICLE: usize = 7;
/// Offset of the angles within a vehicle's part of [`Raw`].
pub const ANGLES: usize = 3;
/// Offset of the power within a vehicle's part of [`Raw`].
pub const POWER: usize = 6;

/// One vehicle as a node sees it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Link {
    /// Unit vector from node to vehicle.
    pub u: [f64; 3],
    /// `b0 P / (s^2 d^2)`.
    pub k: f64,
    /// 1 / d in 1/m.
    pub inverse_m: f64,
}

impl Link {
    /// The link between a vehicle and a node; `budget` is `b0 P / s^2` in m^2.
    #[must_use]
    #[inline(always)]
    pub fn new(vehicle: &[f64], node: &[f64; 3], budget_m2: f64) -> Self {
        let d = [vehicle[0] - node[0], vehicle[1] - node[1], vehicle[2] - node[2]];
        let inverse_m = 1.0 / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt().max(NEAREST_M);
        Self { u: d.map(|c| c * inverse_m), k: budget_m2 * inverse_m * inverse_m, inverse_m }
    }
}

/// What the kernel needs of a problem besides the samples.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The user's position in metres.
    pub user: [f64; 3],
    /// `b0 / s^2` in m^2/W.
    pub budget_m2_w: f64,
    /// Of I and of J.
    pub antennas: [Antenna; 2],
    /// About the nodes.
    pub fading: Fading,
}

impl Scene {
    /// A problem's.
    #[must_use]
    pub fn of(problem: &Problem) -> Self {
        let user = problem.user_enu_m;
        Self {
            user: [user.x, user.y, user.z],
            budget_m2_w: problem.radio.reference_gain / problem.radio.noise_power_w,
            antennas: [Antenna::new(&problem.antennas.i), Antenna::new(&problem.antennas.j)],
            fading: problem.fading,
        }
    }

    /// The depths of both dipoles, if they are dipoles in an empty sky.
    #[inline(always)]
    pub(super) fn depths(&self) -> Option<[f64; 2]> {
        let [i, j] = [self.antennas[0].depth()?, self.antennas[1].depth()?];
        (!self.fading.is_present()).then_some([i, j])
    }
}

/// A node's link to one vehicle for each sample of a block.
#[derive(Debug, Clone, Copy)]
pub(super) struct LinkLanes {
    pub(super) u: [Lane; 3],
    pub(super) k: Lane,
    pub(super) inverse_m: Lane,
}

impl LinkLanes {
    pub(super) const ZERO: Self = Self { u: [[0.0; LANES]; 3], k: [0.0; LANES], inverse_m: [0.0; LANES] };

    #[inline(always)]
    pub(super) fn splat(link: &Link) -> Self {
        Self { u: link.u.map(|c| [c; LANES]), k: [link.k; LANES], inverse_m: [link.inverse_m; LANES] }
    }

    /// One sample's `<u, Y>`.
    #[inline(always)]
    pub(super) fn cosine(&self, y: &[Lane; 3], l: usize) -> f64 {
        self.u[0][l] * y[0][l] + self.u[1][l] * y[1][l] + self.u[2][l] * y[2][l]
    }
}

/// Sums of one vehicle's gradient, per lane: position (3), angles (3), ln power.
pub(super) type Sums = [Lane; 7];

/// Adds one sample's part of the gradient: of `t = <u, Y>`, the part a of the value's change by ln P, and the part w by t.
#[inline(always)]
pub(super) fn add(
    sums: &mut Sums,
    force: &mut [Lane; 3],
    y: &[Lane; 3],
    link: &LinkLanes,
    l: usize,
    [t, a, w]: [f64; 3],
) {
    let along = w * t + 2.0 * a;
    for axis in 0..3 {
        let u = link.u[axis][l];
        force[axis][l] += w * u;
        sums[axis][l] += link.inverse_m[l] * (w * y[axis][l] - along * u);
    }
    sums[6][l] += a;
}

/// Turns forces on the axis into derivatives by angles.
#[inline(always)]
pub(super) fn turn(sums: &mut Sums, axes: &Axes, force: &[Lane; 3]) {
    let y = &axes.y;
    for l in 0..LANES {
        let torque = [
            y[1][l] * force[2][l] - y[2][l] * force[1][l],
            y[2][l] * force[0][l] - y[0][l] * force[2][l],
            y[0][l] * force[1][l] - y[1][l] * force[0][l],
        ];
        sums[3][l] += axes.roll[0][l] * torque[0] + axes.roll[1][l] * torque[1] + axes.roll[2][l] * torque[2];
        sums[4][l] += axes.pitch[0][l] * torque[0] + axes.pitch[1][l] * torque[1];
        sums[5][l] += torque[2];
    }
}

/// One block's strongest eavesdropper per lane.
pub(super) struct Strongest {
    a: Lane,
    b: Lane,
    /// Its index; a float, so that choosing it is the same vector operation as choosing a and b.
    pub(super) node: Lane,
}

impl Strongest {
    /// Of none.
    pub(super) const NONE: Self = Self { a: [-1.0; LANES], b: [1.0; LANES], node: [0.0; LANES] };

    /// Of these and one more, by what it receives from I and from J. No closure asks for that: one that is not inlined
    /// would leave the caller's vectors.
    #[inline(always)]
    pub(super) fn heed(&mut self, index: usize, a: &Lane, mut b: Lane) {
        let mut stronger = [false; LANES];
        for l in 0..LANES {
            b[l] += 1.0;
            stronger[l] = a[l] * self.b[l] > self.a[l] * b[l];
        }
        for l in 0..LANES {
            self.a[l] = if stronger[l] { a[l] } else { self.a[l] };
        }
        for l in 0..LANES {
            self.b[l] = if stronger[l] { b[l] } else { self.b[l] };
        }
        for l in 0..LANES {
            self.node[l] = if stronger[l] { index as f64 } else { self.node[l] };
        }
    }
}

/// exp f per sample, from what the user receives from I and from J; with `clip`, of max(f, 0).
#[inline(always)]
pub(super) fn ratio([a0, b0]: &[Lane; 2], best: &Strongest, clip: bool) -> Lane {
    let mut ratio = [0.0; LANES];
    for l in 0..LANES {
        let (a, b) = (a0[l], 1.0 + b0[l]);
        let value = (a + b) * best.b[l] / (b * (best.a[l] + best.b[l]));
        ratio[l] = if clip { value.max(1.0) } else { value };
    }
    ratio
}

/// [`ratio`], and df/da_0, df/db_0, df/da_m, df/db_m.
#[inline(always)]
pub(super) fn ratio_and_slopes([a0, b0]: &[Lane; 2], best: &Strongest, clip: bool) -> (Lane, [Lane; 4]) {
    let mut ratio = [0.0; LANES];
    let mut c = [[0.0; LANES]; 4];
    for l in 0..LANES {
        let (a, b) = (a0[l], 1.0 + b0[l]);
        let (am, bm) = (best.a[l], best.b[l]);
        let (user, eavesdropper) = (1.0 / (b * (a + b)), 1.0 / (bm * (am + bm)));
        let value = (a + b) * (a + b) * user * bm * bm * eavesdropper;
        let on = if clip && value < 1.0 { 0.0 } else { 1.0 };
        ratio[l] = if clip { value.max(1.0) } else { value };
        c[0][l] = on * b * user;
        c[1][l] = -on * a * user;
        c[2][l] = -on * bm * eavesdropper;
        c[3][l] = on * am * eavesdropper;
    }
    (ratio, c)
}
