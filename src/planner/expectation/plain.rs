//! The kernel for dipoles in an empty sky, on vehicles that are where and how they believe to be.

use nalgebra::Vector3;

use super::attitude::{Axes, Desired};
use super::logarithm::LogSum;
use super::parts::{
    Link, LinkLanes, POWER, Raw, Scene, Strongest, Sums, VEHICLE, add, ratio, ratio_and_slopes, turn,
};
use super::samples::{Blocks, LANES, Lane};

/// The geometry and link of one node to both vehicles.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    /// To I and to J.
    link: [Link; 2],
}

/// How deep both dipoles are.
pub(super) trait Depths: Copy {
    /// `1 - f` of I (0) or J (1).
    fn of(self, vehicle: usize) -> f64;
}

/// Dipoles without a floor: a depth that the compiler knows costs nothing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ideal;

impl Depths for Ideal {
    #[inline(always)]
    fn of(self, _vehicle: usize) -> f64 {
        1.0
    }
}

impl Depths for [f64; 2] {
    #[inline(always)]
    fn of(self, vehicle: usize) -> f64 {
        self[vehicle]
    }
}

/// Links of the user (first) and of every eavesdropper; reusable memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Links {
    nodes: Vec<Node>,
}

/// Adds one node's part of the gradient, `c = df/da` (or `df/db`) per lane, and its force `df/dY` to `force`.
#[inline(always)]
fn accumulate(sums: &mut Sums, force: &mut [Lane; 3], y: &[Lane; 3], link: &LinkLanes, depth: f64, c: &Lane) {
    for l in 0..LANES {
        let t = link.cosine(y, l);
        let a = c[l] * link.k[l] * (1.0 - depth * (t * t));
        let w = -2.0 * c[l] * link.k[l] * (depth * t);
        add(sums, force, y, link, l, [t, a, w]);
    }
}

/// `k (1 - e t^2)` per lane, e the depth of the dipole.
#[must_use]
#[inline(always)]
pub fn power(link: &Link, depth: f64, y: &[Lane; 3]) -> Lane {
    let mut out = [0.0; LANES];
    let swing = link.k * depth;
    for l in 0..LANES {
        let t = link.u[0] * y[0][l] + link.u[1] * y[1][l] + link.u[2] * y[2][l];
        out[l] = link.k - swing * (t * t);
    }
    out
}

impl Links {
    /// Adds a draw's blocks to `sums` (if the gradient is wanted) and returns its total in nats per hertz.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    pub(super) fn draw(
        &mut self,
        scene: &Scene,
        depths: impl Depths,
        raw: &Raw,
        desired: &[Desired; 2],
        blocks: &Blocks<'_>,
        clip: bool,
        mut sums: Option<&mut [Sums; 2]>,
    ) -> f64 {
        self.place(scene, &blocks.draw.eavesdroppers, raw);
        let mut total = LogSum::default();
        for noise in blocks.noise {
            let axes = [desired[0].axes(&noise[0]), desired[1].axes(&noise[1])];
            let ratio = match sums.as_deref_mut() {
                Some(sums) => self.block_gradient(&axes, depths, clip, sums),
                None => self.block(&axes, depths, clip),
            };
            // A ratio is below 2^120: eight of them are far below the largest number.
            total.push(ratio.iter().product::<f64>());
        }
        total.value()
    }

    /// exp f of every sample of a draw's blocks through `visit`.
    pub(super) fn each(
        &mut self,
        scene: &Scene,
        depths: impl Depths,
        raw: &Raw,
        desired: &[Desired; 2],
        blocks: &Blocks<'_>,
        mut visit: impl FnMut(Lane),
    ) {
        self.place(scene, &blocks.draw.eavesdroppers, raw);
        for noise in blocks.noise {
            let axes = [desired[0].axes(&noise[0]), desired[1].axes(&noise[1])];
            visit(self.block(&axes, depths, false));
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

    /// What the user receives, and the strongest eavesdropper.
    #[inline(always)]
    fn received(&self, axes: &[Axes; 2], depths: impl Depths) -> ([Lane; 2], Strongest) {
        let mut best = Strongest::NONE;
        for (index, node) in self.nodes[1..].iter().enumerate() {
            let a = power(&node.link[0], depths.of(0), &axes[0].y);
            best.heed(index, &a, power(&node.link[1], depths.of(1), &axes[1].y));
        }
        let [i, j] = &self.nodes[0].link;
        ([power(i, depths.of(0), &axes[0].y), power(j, depths.of(1), &axes[1].y)], best)
    }

    /// exp f per sample.
    #[inline(always)]
    fn block(&self, axes: &[Axes; 2], depths: impl Depths, clip: bool) -> Lane {
        let (user, best) = self.received(axes, depths);
        ratio(&user, &best, clip)
    }

    /// exp f per sample, adding its logarithm's gradient to `sums`.
    #[inline(always)]
    fn block_gradient(
        &self,
        axes: &[Axes; 2],
        depths: impl Depths,
        clip: bool,
        sums: &mut [Sums; 2],
    ) -> Lane {
        let (user, best) = self.received(axes, depths);
        let (ratio, c) = ratio_and_slopes(&user, &best, clip);
        let (user, eavesdroppers) = (&self.nodes[0], &self.nodes[1..]);
        for vehicle in 0..2 {
            let mut force = [[0.0; LANES]; 3];
            let mut m = LinkLanes::ZERO;
            for l in 0..LANES {
                let link = &eavesdroppers[best.node[l] as usize].link[vehicle];
                for axis in 0..3 {
                    m.u[axis][l] = link.u[axis];
                }
                m.k[l] = link.k;
                m.inverse_m[l] = link.inverse_m;
            }
            let (y, depth) = (&axes[vehicle].y, depths.of(vehicle));
            let sums = &mut sums[vehicle];
            accumulate(sums, &mut force, y, &LinkLanes::splat(&user.link[vehicle]), depth, &c[vehicle]);
            accumulate(sums, &mut force, y, &m, depth, &c[2 + vehicle]);
            turn(sums, &axes[vehicle], &force);
        }
        ratio
    }
}
