//! Both antennas of a configuration under every sample: what a search over a node's position needs.

use nalgebra::Vector3;

use super::attitude::Desired;
use super::kernel::{ANGLES, Link, POWER, Raw, Scene, VEHICLE, power};
use super::logarithm::LogSum;
use super::samples::{LANES, Lane, Samples};

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
        let desired = [Desired::new(&raw[ANGLES..]), Desired::new(&raw[VEHICLE + ANGLES..])];
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
        let mut sum = LogSum::default();
        sinr.iter().for_each(|s| sum.push(1.0 + s));
        sum.value() / self.len().max(1) as f64
    }
}
