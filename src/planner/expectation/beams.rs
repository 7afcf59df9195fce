//! Both antennas of a configuration under every sample: what a search over a node's position needs.

use nalgebra::Vector3;

use super::attitude::Desired;
use super::errors::Errors;
use super::full::{link, received, sizes};
use super::kernel::{ANGLES, Link, POWER, Raw, Scene, VEHICLE, power};
use super::logarithm::LogSum;
use super::samples::{LANES, Lane, Samples};

/// Both antennas of a configuration at every sample of a shared set: what a search over a node's position needs.
#[derive(Debug, Clone)]
pub struct Beams {
    /// By block and vehicle.
    axes: Vec<[[Lane; 3]; 2]>,
    /// What is wrong and scattered in each block.
    blocks: Vec<Block>,
    raw: Raw,
    scene: Scene,
    /// The depths of both dipoles, where nothing but these and attitude noise is in the samples.
    depths: Option<[f64; 2]>,
}

/// What is wrong and scattered in one block.
#[derive(Debug, Clone)]
struct Block {
    errors: Option<Errors>,
    waves: Vec<[Lane; 2]>,
}

impl Beams {
    /// The antennas of `raw`.
    #[must_use]
    pub fn new(scene: &Scene, samples: &Samples, raw: &Raw) -> Self {
        let desired = [Desired::new(&raw[ANGLES..]), Desired::new(&raw[VEHICLE + ANGLES..])];
        let (mut axes, mut blocks) = (Vec::new(), Vec::new());
        if let Some(first) = samples.draws().next() {
            for (index, [i, j]) in first.noise.iter().enumerate() {
                let errors = first.errors(index);
                axes.push(match errors {
                    Some(errors) => [
                        desired[0].axes_with(i, &errors.vehicles[0]).y,
                        desired[1].axes_with(j, &errors.vehicles[1]).y,
                    ],
                    None => [desired[0].axes(i).y, desired[1].axes(j).y],
                });
                blocks.push(Block { errors: errors.cloned(), waves: first.waves(index).to_vec() });
            }
        }
        let depths = scene.depths().filter(|_| samples.is_plain());
        Self { axes, blocks, raw: *raw, scene: scene.clone(), depths }
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

    /// Appends the SINR of eavesdropper `index`, were it at `position`, for every sample.
    pub fn sinr(&self, index: usize, position: &Vector3<f64>, out: &mut Vec<f64>) {
        self.sinr_at(index + 1, [position.x, position.y, position.z], out);
    }

    /// Appends the SINR of a node (0 the user) for every sample.
    fn sinr_at(&self, node: usize, position: [f64; 3], out: &mut Vec<f64>) {
        let parts = [&self.raw[..VEHICLE], &self.raw[VEHICLE..]];
        let budgets_m2 = parts.map(|part| self.scene.budget_m2_w * part[POWER].max(0.0));
        if let Some(depths) = self.depths {
            let links = [0, 1].map(|v: usize| Link::new(parts[v], &position, budgets_m2[v]));
            pulp::Arch::new().dispatch(Heard { axes: &self.axes, links, depths, out });
            return;
        }
        let sizes = sizes(&self.scene)[node.min(1)];
        for (block, axes) in self.blocks.iter().zip(&self.axes) {
            let errors = block.errors.as_ref();
            let shift = errors.and_then(|errors| errors.nodes_m.get(node));
            let powers = [0, 1].map(|v: usize| {
                let offset = errors.map(|errors| &errors.vehicles[v].offset_m);
                let link = link(parts[v], budgets_m2[v], offset, &position, shift);
                received(&self.scene.antennas[v], sizes[v], &link, &axes[v], block.waves.get(2 * node + v))
            });
            push_sinr(powers, out);
        }
    }

    /// Appends the user's SINR for every sample.
    pub fn user_sinr(&self, out: &mut Vec<f64>) {
        self.sinr_at(0, self.scene.user, out);
    }
}

/// What a node hears of plain dipoles, in the vectors of the caller.
struct Heard<'a> {
    axes: &'a [[[Lane; 3]; 2]],
    links: [Link; 2],
    depths: [f64; 2],
    out: &'a mut Vec<f64>,
}

impl pulp::NullaryFnOnce for Heard<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for axes in self.axes {
            let a = power(&self.links[0], self.depths[0], &axes[0]);
            push_sinr([a, power(&self.links[1], self.depths[1], &axes[1])], self.out);
        }
    }
}

/// The mean of `ln((1 + user) / (1 + s))` over samples, s the larger SINR of two nodes; with `clip`, of its positive part.
#[must_use]
pub fn mean_rate(user: &[f64], nodes: [&[f64]; 2], clip: bool) -> f64 {
    pulp::Arch::new().dispatch(MeanRate { user, nodes, least: if clip { 1.0 } else { 0.0 } })
}

/// [`mean_rate`] in the vectors of the caller.
struct MeanRate<'a> {
    user: &'a [f64],
    nodes: [&'a [f64]; 2],
    least: f64,
}

impl pulp::NullaryFnOnce for MeanRate<'_> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let (users, _) = self.user.as_chunks::<LANES>();
        let [(firsts, _), (seconds, _)] = self.nodes.map(|sinr| sinr.as_chunks::<LANES>());
        let mut total = LogSum::default();
        for ((user, first), second) in users.iter().zip(firsts).zip(seconds) {
            let mut ratio = [0.0; LANES];
            for l in 0..LANES {
                let strongest = first[l].max(second[l]);
                ratio[l] = ((1.0 + user[l]) / (1.0 + strongest)).max(self.least);
            }
            // As in the kernel, eight ratios are far below the largest number.
            total.push(ratio.iter().product());
        }
        total.value() / self.user.len() as f64
    }
}

#[inline(always)]
fn push_sinr([a, b]: [Lane; 2], out: &mut Vec<f64>) {
    let mut sinr = [0.0; LANES];
    for l in 0..LANES {
        sinr[l] = a[l] / (1.0 + b[l]);
    }
    out.extend_from_slice(&sinr);
}
