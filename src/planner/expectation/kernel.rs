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

use super::samples::{LANES, Lane, Noise, Samples};
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

/// Axes of one vehicle in a block: Y, and the axes about which roll and pitch turn it.
struct Axes {
    y: [Lane; 3],
    roll: [Lane; 3],
    pitch: [Lane; 3],
}

/// Sine and cosine of one vehicle's desired angles, and its rotation.
struct Desired {
    trig: [[f64; 2]; 3],
    rotation: [[f64; 3]; 3],
}

impl Desired {
    fn new(angles: &[f64]) -> Self {
        let trig = [0, 1, 2].map(|i: usize| [angles[i].cos(), angles[i].sin()]);
        let [[cr, sr], [cp, sp], [cy, sy]] = trig;
        let rotation = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ];
        Self { trig, rotation }
    }

    #[inline(always)]
    fn axes(&self, noise: &Noise) -> Axes {
        let mut out = Axes { y: [[0.0; LANES]; 3], roll: [[0.0; LANES]; 3], pitch: [[0.0; LANES]; 3] };
        match noise {
            Noise::Euler(w) => {
                let [[cr, sr], [cp, sp], [cy, sy]] = self.trig;
                for l in 0..LANES {
                    let (c, s) = (cr * w[0][0][l] - sr * w[0][1][l], sr * w[0][0][l] + cr * w[0][1][l]);
                    let (cp, sp) = (cp * w[1][0][l] - sp * w[1][1][l], sp * w[1][0][l] + cp * w[1][1][l]);
                    let (cy, sy) = (cy * w[2][0][l] - sy * w[2][1][l], sy * w[2][0][l] + cy * w[2][1][l]);
                    out.y[0][l] = cy * c * sp + sy * s;
                    out.y[1][l] = sy * c * sp - cy * s;
                    out.y[2][l] = c * cp;
                    out.roll[0][l] = cy * cp;
                    out.roll[1][l] = sy * cp;
                    out.roll[2][l] = -sp;
                    out.pitch[0][l] = -sy;
                    out.pitch[1][l] = cy;
                }
            }
            Noise::Body(n) => {
                let r = &self.rotation;
                let [_, _, [cy, sy]] = self.trig;
                for l in 0..LANES {
                    for axis in 0..3 {
                        out.y[axis][l] = r[axis][0] * n[0][l] + r[axis][1] * n[1][l] + r[axis][2] * n[2][l];
                        out.roll[axis][l] = r[axis][0];
                    }
                    out.pitch[0][l] = -sy;
                    out.pitch[1][l] = cy;
                }
            }
        }
        out
    }
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
#[inline(always)]
fn power(link: &Link, y: &[Lane; 3]) -> Lane {
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
        let mut total = 0.0;
        for noise in blocks {
            let axes = [desired[0].axes(&noise[0]), desired[1].axes(&noise[1])];
            let ratio = match sums.as_deref_mut() {
                Some(sums) => self.block_gradient(&axes, clip, sums),
                None => self.block(&axes, clip),
            };
            // One logarithm for the block: a ratio is below 2^120, eight of them far below the largest number.
            total += ratio.iter().product::<f64>().ln();
        }
        total
    }

    /// f of every sample in nats per hertz, draw by draw, through `visit(draw, f)`.
    pub fn each(&mut self, scene: &Scene, samples: &Samples, raw: &Raw, mut visit: impl FnMut(usize, f64)) {
        let desired = desired(raw);
        for (index, (draw, blocks)) in samples.draws().enumerate() {
            self.place(scene, draw, raw);
            for noise in blocks {
                let axes = [desired[0].axes(&noise[0]), desired[1].axes(&noise[1])];
                for ratio in self.block(&axes, false) {
                    visit(index, ratio.ln());
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

/// Both antennas of a configuration at every sample of a shared set: what a search over a node's position needs.
#[derive(Debug, Clone)]
pub struct Beams {
    axes: Vec<[[Lane; 3]; 2]>,
    raw: Raw,
    scene: Scene,
}

impl Beams {
    /// The antennas of `raw`.
    #[must_use]
    pub fn new(scene: &Scene, samples: &Samples, raw: &Raw) -> Self {
        let desired = desired(raw);
        let blocks = samples.draws().next().map(|(_, blocks)| blocks).unwrap_or_default();
        let axes = blocks.iter().map(|noise| [0, 1].map(|v: usize| desired[v].axes(&noise[v]).y)).collect();
        Self { axes, raw: *raw, scene: scene.clone() }
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.axes.len() * LANES
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.axes.is_empty()
    }

    /// Appends the SINR at `node` for every sample.
    pub fn sinr(&self, node: &Vector3<f64>, out: &mut Vec<f64>) {
        let node = [node.x, node.y, node.z];
        let link = [POWER, VEHICLE + POWER].map(|at| {
            let vehicle = &self.raw[at - POWER..];
            Link::new(vehicle, &node, self.scene.budget_m2_w * self.raw[at].max(0.0))
        });
        for y in &self.axes {
            let (a, b) = (power(&link[0], &y[0]), power(&link[1], &y[1]));
            let mut sinr = [0.0; LANES];
            for l in 0..LANES {
                sinr[l] = a[l] / (1.0 + b[l]);
            }
            out.extend_from_slice(&sinr);
        }
    }

    /// E ln(1 + Gamma_0) in nats per hertz.
    #[must_use]
    pub fn user_mean(&self) -> f64 {
        let [x, y, z] = self.scene.user;
        let mut sinr = Vec::with_capacity(self.len());
        self.sinr(&Vector3::new(x, y, z), &mut sinr);
        sinr.iter().map(|s| s.ln_1p()).sum::<f64>() / self.len().max(1) as f64
    }
}
