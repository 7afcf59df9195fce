//! Both antennas of a configuration under every sample: what a search over a node's position needs.

use nalgebra::Vector3;

use super::attitude::Desired;
use super::errors::Errors;
use super::full::{link, received, sizes};
use super::kernel::{ANGLES, Link, POWER, Raw, Scene, VEHICLE, power};
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
            for axes in &self.axes {
                let a = power(&links[0], depths[0], &axes[0]);
                push_sinr([a, power(&links[1], depths[1], &axes[1])], out);
            }
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

fn push_sinr([a, b]: [Lane; 2], out: &mut Vec<f64>) {
    let mut sinr = [0.0; LANES];
    for l in 0..LANES {
        sinr[l] = a[l] / (1.0 + b[l]);
    }
    out.extend_from_slice(&sinr);
}
