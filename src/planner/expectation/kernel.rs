//! The sampled objective and its gradient: the inner loop of every search under jitter.
//!
//! For samples s of both attitudes, with unit vectors `u` from node to vehicle, `k = b0 P / (s^2 d^2)` and
//! `t = <u, Y(s)>`, the received power over the noise is `a = k (1 - t^2)` from I and `b - 1 = k (1 - t^2)` from J, and
//! the value is the mean of
//!
//! ```text
//! f = ln((a_0 + b_0) b_m / (b_0 (a_m + b_m))),   m the eavesdropper with the largest a_m / b_m,
//! ```
//!
//! which is (3b), or (2.2b) with f replaced by max(f, 0). Derivatives follow from
//! `df/da_0 = 1/(a_0 + b_0)`, `df/db_0 = -a_0 / (b_0 (a_0 + b_0))`, their negatives with m for 0, and
//!
//! ```text
//! da/dp = (w Y - (w t + 2 a) u) / d,  w = -2 k t;   da/dY = w u;   dY/d(angle) = axis of that angle x Y;
//! da/d(ln P) = a.
//! ```
//!
//! Samples are handled in blocks of [`LANES`], arrays of which the compiler turns into vectors. Sums are kept per lane
//! and added in order of index, so that the result is the same bit for bit on any vector width.

use nalgebra::Vector3;

use super::attitude::{Axes, Desired};
use super::logarithm::LogSum;
use super::noise::Noise;
use super::samples::{LANES, Lane, Samples};
use crate::radio::link::NEAREST_M;

/// A configuration of the pair, flat: position (3), roll, pitch, yaw, power in W of I, then of J.
pub type Raw = [f64; 14];

/// Offset of vehicle J in [`Raw`].
pub const VEHICLE: usize = 7;
/// Offset of the angles within a vehicle's part of [`Raw`].
pub const ANGLES: usize = 3;
/// Offset of the power within a vehicle's part of [`Raw`].
pub const POWER: usize = 6;

/// The geometry and link of one node to both vehicles.
#[derive(Debug, Clone, Copy, Default)]
pub struct Node {
    /// To I and to J.
    pub link: [Link; 2],
}

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
}

/// Reusable memory of an evaluation.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    nodes: Vec<Node>,
}

/// A node's link to one vehicle for each sample of a block.
#[derive(Clone, Copy)]
struct LinkLanes {
    u: [Lane; 3],
    k: Lane,
    inverse_m: Lane,
}

impl LinkLanes {
    #[inline(always)]
    fn splat(link: &Link) -> Self {
        Self { u: link.u.map(|c| [c; LANES]), k: [link.k; LANES], inverse_m: [link.inverse_m; LANES] }
    }
}

/// Sums of one vehicle's gradient, per lane: position (3), angles (3), ln power.
type Sums = [Lane; 7];

/// Adds one node's part of the gradient, `c = df/da` (or `df/db`) per lane, and its force `df/dY` to `force`.
#[inline(always)]
fn accumulate(sums: &mut Sums, force: &mut [Lane; 3], y: &[Lane; 3], link: &LinkLanes, c: &Lane) {
    for l in 0..LANES {
        let u = [link.u[0][l], link.u[1][l], link.u[2][l]];
        let t = u[0] * y[0][l] + u[1] * y[1][l] + u[2] * y[2][l];
        let a = c[l] * link.k[l] * (1.0 - t * t);
        let w = -2.0 * c[l] * link.k[l] * t;
        let along = w * t + 2.0 * a;
        for axis in 0..3 {
            force[axis][l] += w * u[axis];
            sums[axis][l] += link.inverse_m[l] * (w * y[axis][l] - along * u[axis]);
        }
        sums[6][l] += a;
    }
}

/// Turns forces on the axis into derivatives by angles.
#[inline(always)]
fn turn(sums: &mut Sums, axes: &Axes, force: &[Lane; 3]) {
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
struct Strongest {
    a: Lane,
    b: Lane,
    /// Its index; a float, so that choosing it is the same vector operation as choosing a and b.
    node: Lane,
}

/// `k (1 - t^2)` per lane.
#[must_use]
#[inline(always)]
pub fn power(link: &Link, y: &[Lane; 3]) -> Lane {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let t = link.u[0] * y[0][l] + link.u[1] * y[1][l] + link.u[2] * y[2][l];
        out[l] = link.k - link.k * (t * t);
    }
    out
}

#[inline(always)]
fn strongest(nodes: &[Node], y: [&[Lane; 3]; 2]) -> Strongest {
    let mut best = Strongest { a: [-1.0; LANES], b: [1.0; LANES], node: [0.0; LANES] };
    for (index, node) in nodes.iter().enumerate() {
        let a = power(&node.link[0], y[0]);
        let mut b = power(&node.link[1], y[1]);
        let mut stronger = [false; LANES];
        for l in 0..LANES {
            b[l] += 1.0;
            stronger[l] = a[l] * best.b[l] > best.a[l] * b[l];
        }
        for l in 0..LANES {
            best.a[l] = if stronger[l] { a[l] } else { best.a[l] };
        }
        for l in 0..LANES {
            best.b[l] = if stronger[l] { b[l] } else { best.b[l] };
        }
        for l in 0..LANES {
            best.node[l] = if stronger[l] { index as f64 } else { best.node[l] };
        }
    }
    best
}

fn desired(raw: &Raw) -> [Desired; 2] {
    [Desired::new(&raw[ANGLES..]), Desired::new(&raw[VEHICLE + ANGLES..])]
}

/// Adds up the lanes.
#[inline(always)]
fn reduce(sums: &[Sums; 2], scale: f64, out: &mut Raw) {
    for (vehicle, sums) in sums.iter().enumerate() {
        for (slot, lane) in out[vehicle * VEHICLE..].iter_mut().zip(sums) {
            *slot = lane.iter().sum::<f64>() * scale;
        }
    }
}

/// [`Workspace::mean`] in the vectors of the caller.
struct Mean<'a> {
    workspace: &'a mut Workspace,
    scene: &'a Scene,
    samples: &'a Samples,
    raw: &'a Raw,
    clip: bool,
    gradient: Option<&'a mut Raw>,
}

impl pulp::NullaryFnOnce for Mean<'_> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let desired = desired(self.raw);
        let scale = 1.0 / self.samples.len() as f64;
        let mut total = 0.0;
        if let Some(gradient) = self.gradient {
            let mut sums = [[[0.0; LANES]; 7]; 2];
            for (draw, blocks) in self.samples.draws() {
                self.workspace.place(self.scene, draw, self.raw);
                total += self.workspace.draw(&desired, blocks, self.clip, Some(&mut sums));
            }
            reduce(&sums, scale, gradient);
        } else {
            for (draw, blocks) in self.samples.draws() {
                self.workspace.place(self.scene, draw, self.raw);
                total += self.workspace.draw(&desired, blocks, self.clip, None);
            }
        }
        total * scale
    }
}

/// [`Workspace::mean_of_draws`] in the vectors of the caller.
struct MeanOfDraws<'a, F> {
    workspace: &'a mut Workspace,
    scene: &'a Scene,
    samples: &'a Samples,
    raw: &'a Raw,
    clip: bool,
    visit: F,
}

impl<F: FnMut(f64, &Raw)> pulp::NullaryFnOnce for MeanOfDraws<'_, F> {
    type Output = ();

    #[inline(always)]
    fn call(mut self) {
        let desired = desired(self.raw);
        for (draw, blocks) in self.samples.draws() {
            let mut sums = [[[0.0; LANES]; 7]; 2];
            let mut gradient = [0.0; 14];
            let scale = 1.0 / (blocks.len() * LANES) as f64;
            self.workspace.place(self.scene, draw, self.raw);
            let total = self.workspace.draw(&desired, blocks, self.clip, Some(&mut sums));
            reduce(&sums, scale, &mut gradient);
            (self.visit)(total * scale, &gradient);
        }
    }
}

impl Workspace {
    /// Mean over the samples in nats per hertz; with `clip`, of max(f, 0). Adds nothing to memory after its first call.
    ///
    /// `gradient`, if given, is overwritten; its power entries are derivatives by ln P.
    pub fn mean(
        &mut self,
        scene: &Scene,
        samples: &Samples,
        raw: &Raw,
        clip: bool,
        gradient: Option<&mut Raw>,
    ) -> f64 {
        // The widest vectors of this machine: the same operations in the same order on any.
        pulp::Arch::new().dispatch(Mean { workspace: self, scene, samples, raw, clip, gradient })
    }

    /// Mean of each draw in nats per hertz, and its gradient, through `visit`.
    pub fn mean_of_draws(
        &mut self,
        scene: &Scene,
        samples: &Samples,
        raw: &Raw,
        clip: bool,
        visit: impl FnMut(f64, &Raw),
    ) {
        pulp::Arch::new().dispatch(MeanOfDraws { workspace: self, scene, samples, raw, clip, visit });
    }

    /// Adds a draw's blocks to `sums` (if the gradient is wanted) and returns its total in nats per hertz.
    #[inline(always)]
    fn draw(
        &mut self,
        desired: &[Desired; 2],
        blocks: &[[Noise; 2]],
        clip: bool,
        mut sums: Option<&mut [Sums; 2]>,
    ) -> f64 {
        let mut total = LogSum::default();
        for noise in blocks {
            let axes = [desired[0].axes(&noise[0]), desired[1].axes(&noise[1])];
            let ratio = match sums.as_deref_mut() {
                Some(sums) => self.block_gradient(&axes, clip, sums),
                None => self.block(&axes, clip),
            };
            // A ratio is below 2^120: eight of them are far below the largest number.
            total.push(ratio.iter().product::<f64>());
        }
        total.value()
    }

    /// f of every sample in nats per hertz, draw by draw, through `visit(draw, f)`.
    pub fn each(&mut self, scene: &Scene, samples: &Samples, raw: &Raw, mut visit: impl FnMut(usize, f64)) {
        let desired = desired(raw);
        for (index, (draw, blocks)) in samples.draws().enumerate() {
            self.place(scene, draw, raw);
            for noise in blocks {
                let axes = [desired[0].axes(&noise[0]), desired[1].axes(&noise[1])];
                for ratio in self.block(&axes, false) {
                    visit(index, libm::log(ratio));
                }
            }
        }
    }

    /// Links of the user (first) and of every eavesdropper to both vehicles.
    #[inline(always)]
    fn place(&mut self, scene: &Scene, eavesdroppers: &[Vector3<f64>], raw: &Raw) {
        let budget =
            [scene.budget_m2_w * raw[POWER].max(0.0), scene.budget_m2_w * raw[VEHICLE + POWER].max(0.0)];
        self.nodes.clear();
        self.nodes.extend(
            std::iter::once(scene.user).chain(eavesdroppers.iter().map(|p| [p.x, p.y, p.z])).map(|node| {
                Node {
                    link: [Link::new(raw, &node, budget[0]), Link::new(&raw[VEHICLE..], &node, budget[1])],
                }
            }),
        );
    }

    /// exp f per sample.
    #[inline(always)]
    fn block(&self, axes: &[Axes; 2], clip: bool) -> Lane {
        let (user, eavesdroppers) = (&self.nodes[0], &self.nodes[1..]);
        let best = strongest(eavesdroppers, [&axes[0].y, &axes[1].y]);
        let mut ratio = [0.0; LANES];
        let (a0, b0) = (power(&user.link[0], &axes[0].y), power(&user.link[1], &axes[1].y));
        for l in 0..LANES {
            let (a, b) = (a0[l], 1.0 + b0[l]);
            let value = (a + b) * best.b[l] / (b * (best.a[l] + best.b[l]));
            ratio[l] = if clip { value.max(1.0) } else { value };
        }
        ratio
    }

    /// exp f per sample, adding its logarithm's gradient to `sums`.
    #[inline(always)]
    fn block_gradient(&self, axes: &[Axes; 2], clip: bool, sums: &mut [Sums; 2]) -> Lane {
        let (user, eavesdroppers) = (&self.nodes[0], &self.nodes[1..]);
        let best = strongest(eavesdroppers, [&axes[0].y, &axes[1].y]);
        let mut ratio = [0.0; LANES];
        // df/da_0, df/db_0, df/da_m, df/db_m.
        let mut c = [[0.0; LANES]; 4];
        let (a0, b0) = (power(&user.link[0], &axes[0].y), power(&user.link[1], &axes[1].y));
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
        for vehicle in 0..2 {
            let mut force = [[0.0; LANES]; 3];
            let mut m = LinkLanes::splat(&Link::default());
            for l in 0..LANES {
                let link = &eavesdroppers[best.node[l] as usize].link[vehicle];
                for axis in 0..3 {
                    m.u[axis][l] = link.u[axis];
                }
                m.k[l] = link.k;
                m.inverse_m[l] = link.inverse_m;
            }
            let y = &axes[vehicle].y;
            accumulate(
                &mut sums[vehicle],
                &mut force,
                y,
                &LinkLanes::splat(&user.link[vehicle]),
                &c[vehicle],
            );
            accumulate(&mut sums[vehicle], &mut force, y, &m, &c[2 + vehicle]);
            turn(&mut sums[vehicle], &axes[vehicle], &force);
        }
        ratio
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::expectation::samples::Sequence;
    use crate::planner::problem::Problem;
    use crate::planner::problem::{Jitter, JitterAxes, JitterModel};
    use crate::radio::link::{self, Transmitter};
    use crate::radio::{jitter, secrecy};

    const RAW: Raw = [5.0, 3.0, 80.0, 0.8, -0.3, 0.2, 0.5, 90.0, -210.0, 80.0, 1.1, 0.8, -0.1, 0.006];
    const SCENE: Scene = Scene { user: [0.0; 3], budget_m2_w: 1e12 };

    /// The kernel against the radio module, sample by sample: the same noise, another road.
    #[test]
    fn val_each_sample_is_the_radio_modules_rate() {
        let nodes = [[120.0, -40.0], [-300.0, 210.0], [10.0, 400.0]];
        for model in [JitterModel::Euler, JitterModel::Body] {
            let mut problem = Problem::paper(nodes, 0.5, 3f64.to_radians());
            problem.jitter = Jitter { model, axes: JitterAxes::RollPitchYaw, ..problem.jitter };
            let samples = Samples::new(&problem, 32, 1, 4, Sequence::Sobol);
            let set = super::super::sobol::Scrambled::new(4);
            let noise = |index: u32, dimension: usize| {
                problem.jitter.std_rad * super::super::normal::quantile(set.coordinate(index, dimension))
            };
            let mut index = 0;
            let mut sum = 0.0;
            Workspace::default().each(&SCENE, &samples, &RAW, |_, f| {
                let transmitter = |v: usize| {
                    let part = &RAW[v * VEHICLE..(v + 1) * VEHICLE];
                    let w = [0, 1, 2].map(|c: usize| noise(index, 3 * v + c));
                    Transmitter {
                        position_enu_m: Vector3::new(part[0], part[1], part[2]),
                        axis: jitter::axis(model, [part[3], part[4], part[5]], w),
                        tx_power_w: part[6],
                    }
                };
                let (i, j) = (transmitter(0), transmitter(1));
                let sinr = |node: &Vector3<f64>| link::sinr(&i, &j, node, 1.0, 1e-12);
                let rate = secrecy::signed_bit_s_hz(
                    sinr(&problem.user_enu_m),
                    problem.eavesdroppers.iter().map(|e| sinr(&e.position_enu_m)),
                );
                assert!((f / std::f64::consts::LN_2 - rate).abs() < 1e-9, "{index}: {f} {rate}");
                sum += f;
                index += 1;
            });
            let mean = Workspace::default().mean(&SCENE, &samples, &RAW, false, None);
            assert!((mean - sum / 32.0).abs() < 1e-12);
        }
    }

    /// Under Euler jitter E[YY'] is known: with c = exp(-2 s^2), E cos^2(x + w) = (1 + c cos 2x) / 2. At a signal so weak
    /// that ln(1 + a) = a, the user's mean is k E[G].
    #[test]
    fn val_mean_gain_in_closed_form() {
        let mut problem = Problem::paper([[4e5, 4e5]], 0.5, 10f64.to_radians());
        problem.jitter.std_rad = 0.3;
        let raw: Raw = [60.0, 0.0, 80.0, 0.5, 0.4, 0.0, 1.0, 0.0, 0.0, 100.0, 0.0, 0.0, 0.0, 0.0];
        let scene = Scene { budget_m2_w: 1e-4, ..SCENE };
        let samples = Samples::new(&problem, 1 << 14, 1, 3, Sequence::Sobol);
        let mean = Workspace::default().mean(&scene, &samples, &raw, false, None);
        let c = (-2.0 * 0.3f64 * 0.3).exp();
        let squares = |x: f64| ((1.0 + c * (2.0 * x).cos()) / 2.0, (1.0 - c * (2.0 * x).cos()) / 2.0);
        let ((cr, _), (cp, sp)) = (squares(0.5), squares(0.4));
        // u = (0.6, 0, 0.8): <u, Y>^2 = cos^2 roll (0.6 sin pitch + 0.8 cos pitch)^2.
        let cross = c * 0.8f64.sin() / 2.0;
        let gain = 1.0 - cr * (0.36 * sp + 0.64 * cp + 0.96 * cross);
        assert!((mean / (1e-4 / 1e4 * gain) - 1.0).abs() < 1e-4, "{mean}");
    }

    #[test]
    fn spec_clipping_lifts_negative_samples_to_zero() {
        let problem = Problem::paper([[5.0, 0.0], [-300.0, 210.0]], 0.5, 10f64.to_radians());
        let samples = Samples::new(&problem, 512, 1, 3, Sequence::Sobol);
        let (mut signed, mut clipped) = (0.0, 0.0);
        let mut workspace = Workspace::default();
        workspace.each(&SCENE, &samples, &RAW, |_, f| {
            signed += f / 512.0;
            clipped += f.max(0.0) / 512.0;
        });
        assert!(clipped > signed + 1e-3);
        assert!((workspace.mean(&SCENE, &samples, &RAW, true, None) - clipped).abs() < 1e-12);
        assert!((workspace.mean(&SCENE, &samples, &RAW, false, None) - signed).abs() < 1e-12);
    }

    #[test]
    fn spec_the_narrowest_vectors_give_the_same_bits() {
        let problem = Problem::paper([[120.0, -40.0], [-300.0, 210.0]], 0.5, 2f64.to_radians());
        let samples = Samples::new(&problem, 256, 1, 3, Sequence::Sobol);
        let (mut wide, mut narrow) = ([0.0; 14], [0.0; 14]);
        let mut workspace = Workspace::default();
        let value = workspace.mean(&SCENE, &samples, &RAW, false, Some(&mut wide));
        let scalar = Mean {
            workspace: &mut Workspace::default(),
            scene: &SCENE,
            samples: &samples,
            raw: &RAW,
            clip: false,
            gradient: Some(&mut narrow),
        };
        assert_eq!(pulp::NullaryFnOnce::call(scalar), value);
        assert_eq!(wide, narrow);
    }
}
