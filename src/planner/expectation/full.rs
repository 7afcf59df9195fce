//! The sampled objective and its gradient with everything that the link may hold: measured patterns, scattered waves, and
//! what stays wrong during a slot in each sample.
//!
//! As in [`super::kernel`], with `a = k h`: of a pattern's gain `g(t)`, a Rician share `q = K / (K + 1)` and a scattered wave
//! of parts (x, y), each of variance `s^2 = (1 - q) m / 2`,
//!
//! ```text
//! h = (sqrt(q g) + x)^2 + y^2,   dh/dt = g' (q + x sqrt(q / g)),   w = k dh/dt.
//! ```
//!
//! True positions of vehicles and nodes differ from sample to sample, and with them u, d and k; axes are those of true
//! headings and mountings.

use super::antenna::Antenna;
use super::attitude::{Axes, Desired};
use super::errors::Errors;
use super::logarithm::LogSum;
use super::parts::{
    LinkLanes, POWER, Raw, Scene, Strongest, Sums, VEHICLE, add, ratio, ratio_and_slopes, turn,
};
use super::samples::{Blocks, LANES, Lane};
use crate::radio::fading::Rician;
use crate::radio::link::NEAREST_M;

/// A null's gain in the derivative of its root: far below any floor, and far above rounding's square.
const LEAST_GAIN: f64 = 1e-24;

/// Links of the user (first) and of every eavesdropper to both vehicles in a block; reusable memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Links(Vec<[LinkLanes; 2]>);

/// A wave's parts and what share of the received power is direct.
#[derive(Debug, Clone, Copy)]
pub(super) struct Waves {
    direct: f64,
    /// s.
    size: f64,
}

impl Waves {
    fn new(rician: Rician, antenna: &Antenna) -> Self {
        Self { direct: rician.direct(), size: (0.5 * rician.scattered() * antenna.mean).sqrt() }
    }
}

/// h and dh/dt per lane.
#[inline(always)]
fn response(antenna: &Antenna, waves: Waves, t: &Lane, wave: Option<&[Lane; 2]>) -> [Lane; 2] {
    let mut out = antenna.gain(t);
    if let Some([x, y]) = wave {
        let [gain, slope] = &mut out;
        for l in 0..LANES {
            let (x, y) = (waves.size * x[l], waves.size * y[l]);
            let root = (waves.direct * gain[l]).sqrt();
            let share = waves.direct + x * (waves.direct / gain[l].max(LEAST_GAIN)).sqrt();
            gain[l] = (root + x) * (root + x) + y * y;
            slope[l] *= share;
        }
    }
    out
}

/// One block's view: links, axes and waves.
struct Block<'a> {
    scene: &'a Scene,
    links: &'a [[LinkLanes; 2]],
    axes: [Axes; 2],
    waves: &'a [[Lane; 2]],
    /// Of the user and of an eavesdropper, by vehicle.
    sizes: [[Waves; 2]; 2],
}

impl Block<'_> {
    /// What a node (0 the user) receives from a vehicle.
    #[inline(always)]
    fn received(&self, node: usize, vehicle: usize) -> Lane {
        let (antenna, sizes) = (&self.scene.antennas[vehicle], self.sizes[node.min(1)][vehicle]);
        let wave = self.waves.get(2 * node + vehicle);
        received(antenna, sizes, &self.links[node][vehicle], &self.axes[vehicle].y, wave)
    }

    /// What the user receives, and the strongest eavesdropper.
    #[inline(always)]
    fn user_and_strongest(&self) -> ([Lane; 2], Strongest) {
        let mut best = Strongest::NONE;
        for node in 1..self.links.len() {
            best.heed(node - 1, &self.received(node, 0), self.received(node, 1));
        }
        ([self.received(0, 0), self.received(0, 1)], best)
    }

    #[inline(always)]
    fn ratio(&self, clip: bool) -> Lane {
        let (user, best) = self.user_and_strongest();
        ratio(&user, &best, clip)
    }

    /// exp f per sample, adding its logarithm's gradient to `sums`.
    #[inline(always)]
    fn gradient(&self, clip: bool, sums: &mut [Sums; 2]) -> Lane {
        let (user, best) = self.user_and_strongest();
        let (ratio, c) = ratio_and_slopes(&user, &best, clip);
        for vehicle in 0..2 {
            let mut force = [[0.0; LANES]; 3];
            let mut m = LinkLanes::ZERO;
            let mut wave = [[0.0; LANES]; 2];
            for l in 0..LANES {
                let node = 1 + best.node[l] as usize;
                let link = &self.links[node][vehicle];
                for axis in 0..3 {
                    m.u[axis][l] = link.u[axis][l];
                }
                m.k[l] = link.k[l];
                m.inverse_m[l] = link.inverse_m[l];
                if let Some(of) = self.waves.get(2 * node + vehicle) {
                    for (wave, of) in wave.iter_mut().zip(of) {
                        wave[l] = of[l];
                    }
                }
            }
            let of_user = self.waves.get(vehicle);
            let (of_strongest, sums) = (of_user.map(|_| &wave), &mut sums[vehicle]);
            self.add(sums, &mut force, vehicle, &self.links[0][vehicle], 0, of_user, &c[vehicle]);
            self.add(sums, &mut force, vehicle, &m, 1, of_strongest, &c[2 + vehicle]);
            turn(sums, &self.axes[vehicle], &force);
        }
        ratio
    }

    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    fn add(
        &self,
        sums: &mut Sums,
        force: &mut [Lane; 3],
        vehicle: usize,
        link: &LinkLanes,
        kind: usize,
        wave: Option<&[Lane; 2]>,
        c: &Lane,
    ) {
        let t = cosines(link, &self.axes[vehicle].y);
        let [h, slope] = response(&self.scene.antennas[vehicle], self.sizes[kind][vehicle], &t, wave);
        for l in 0..LANES {
            let scale = c[l] * link.k[l];
            add(sums, force, &self.axes[vehicle].y, link, l, [t[l], scale * h[l], scale * slope[l]]);
        }
    }
}

impl Links {
    /// Adds a draw's blocks to `sums` (if the gradient is wanted) and returns its total in nats per hertz.
    #[inline(always)]
    pub(super) fn draw(
        &mut self,
        scene: &Scene,
        raw: &Raw,
        desired: &[Desired; 2],
        blocks: &Blocks<'_>,
        clip: bool,
        mut sums: Option<&mut [Sums; 2]>,
    ) -> f64 {
        let mut total = LogSum::default();
        let sizes = sizes(scene);
        for index in 0..blocks.noise.len() {
            let block = self.block(scene, raw, desired, blocks, index, sizes);
            let ratio = match sums.as_deref_mut() {
                Some(sums) => block.gradient(clip, sums),
                None => block.ratio(clip),
            };
            total.push(ratio.iter().product::<f64>());
        }
        total.value()
    }

    /// exp f of every block's samples through `visit`.
    pub(super) fn each(
        &mut self,
        scene: &Scene,
        raw: &Raw,
        desired: &[Desired; 2],
        blocks: &Blocks<'_>,
        mut visit: impl FnMut(Lane),
    ) {
        let sizes = sizes(scene);
        for index in 0..blocks.noise.len() {
            visit(self.block(scene, raw, desired, blocks, index, sizes).ratio(false));
        }
    }

    /// A draw's block by its index; asked for in order.
    #[inline(always)]
    fn block<'a>(
        &'a mut self,
        scene: &'a Scene,
        raw: &Raw,
        desired: &[Desired; 2],
        blocks: &Blocks<'a>,
        index: usize,
        sizes: [[Waves; 2]; 2],
    ) -> Block<'a> {
        let errors = blocks.errors(index);
        if index == 0 || !blocks.errs_alike() {
            self.place(scene, blocks, errors, raw);
        }
        let [i, j] = &blocks.noise[index];
        let axes = match errors {
            Some(errors) => {
                [desired[0].axes_with(i, &errors.vehicles[0]), desired[1].axes_with(j, &errors.vehicles[1])]
            }
            None => [desired[0].axes(i), desired[1].axes(j)],
        };
        Block { scene, links: &self.0, axes, waves: blocks.waves(index), sizes }
    }

    #[inline(always)]
    fn place(&mut self, scene: &Scene, blocks: &Blocks<'_>, errors: Option<&Errors>, raw: &Raw) {
        // No closures here nor below: they would leave the caller's vectors.
        let eavesdroppers = &blocks.draw.eavesdroppers;
        self.0.resize(1 + eavesdroppers.len(), [LinkLanes::ZERO; 2]);
        for (index, links) in self.0.iter_mut().enumerate() {
            let node = if index == 0 {
                scene.user
            } else {
                let p = &eavesdroppers[index - 1];
                [p.x, p.y, p.z]
            };
            for (v, link_of) in links.iter_mut().enumerate() {
                let (mut offset, mut shift) = (None, None);
                if let Some(errors) = errors {
                    (offset, shift) = (Some(&errors.vehicles[v].offset_m), errors.nodes_m.get(index));
                }
                let vehicle = &raw[v * VEHICLE..(v + 1) * VEHICLE];
                *link_of = link(vehicle, scene.budget_m2_w * vehicle[POWER].max(0.0), offset, &node, shift);
            }
        }
    }
}

/// By kind of node (the user, an eavesdropper) and vehicle.
pub(super) fn sizes(scene: &Scene) -> [[Waves; 2]; 2] {
    let [i, j] = &scene.antennas;
    [scene.fading.user, scene.fading.eavesdropper].map(|law| [Waves::new(law, i), Waves::new(law, j)])
}

/// The link of a vehicle, held at `vehicle` and `offset` from there, to a node, held to be at `node` and `shift` from there.
#[inline(always)]
pub(super) fn link(
    vehicle: &[f64],
    budget_m2: f64,
    offset: Option<&[Lane; 3]>,
    node: &[f64; 3],
    shift: Option<&[Lane; 2]>,
) -> LinkLanes {
    let mut out = LinkLanes::ZERO;
    for axis in 0..3 {
        out.u[axis] = [vehicle[axis] - node[axis]; LANES];
    }
    if let Some(offset) = offset {
        for axis in 0..3 {
            for l in 0..LANES {
                out.u[axis][l] += offset[axis][l];
            }
        }
    }
    if let Some(shift) = shift {
        for axis in 0..2 {
            for l in 0..LANES {
                out.u[axis][l] -= shift[axis][l];
            }
        }
    }
    for l in 0..LANES {
        let d = [out.u[0][l], out.u[1][l], out.u[2][l]];
        let inverse_m = 1.0 / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt().max(NEAREST_M);
        out.inverse_m[l] = inverse_m;
        out.k[l] = budget_m2 * inverse_m * inverse_m;
        for axis in 0..3 {
            out.u[axis][l] *= inverse_m;
        }
    }
    out
}

/// `<u, Y>` per lane.
#[inline(always)]
fn cosines(link: &LinkLanes, y: &[Lane; 3]) -> Lane {
    let mut t = [0.0; LANES];
    for l in 0..LANES {
        t[l] = link.cosine(y, l);
    }
    t
}

/// What a node receives from a vehicle in a block.
#[inline(always)]
pub(super) fn received(
    antenna: &Antenna,
    waves: Waves,
    link: &LinkLanes,
    y: &[Lane; 3],
    wave: Option<&[Lane; 2]>,
) -> Lane {
    let [mut h, _] = response(antenna, waves, &cosines(link, y), wave);
    for l in 0..LANES {
        h[l] *= link.k[l];
    }
    h
}
