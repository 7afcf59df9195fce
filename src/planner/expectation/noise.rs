//! From uniform points to attitude noise and positions.

use nalgebra::Vector3;

use super::lanes::{LANES, Lane};
use super::{normal, sobol, trigonometry};
use crate::planner::problem::{Eavesdropper, Jitter, JitterModel, Uncertainty};
use crate::radio::jitter;

/// First dimension of the sequence that moves positions; attitude noise comes before.
const POSITION_DIMENSION: usize = 8;

/// One vehicle's noise in a block, in the form in which the kernel uses it.
#[derive(Debug, Clone, Copy)]
pub enum Noise {
    /// Cosine and sine of the noise of roll, pitch and yaw: (c, s) each.
    Euler([[Lane; 2]; 3]),
    /// The antenna axis in the desired body frame.
    Body([Lane; 3]),
}

/// Where the random numbers come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sequence {
    /// Scrambled Sobol points.
    Sobol,
    /// Independent pseudo-random points, for comparison.
    MonteCarlo,
}

/// Where uniform numbers come from.
#[derive(Debug, Clone, Copy)]
pub struct Uniform {
    sequence: Sequence,
    seed: u64,
    set: sobol::Scrambled,
}

impl Uniform {
    /// The numbers of a seed.
    #[must_use]
    pub fn new(sequence: Sequence, seed: u64) -> Self {
        Self { sequence, seed, set: sobol::Scrambled::new(seed) }
    }

    /// A coordinate of a point.
    fn at(&self, index: usize, dimension: usize) -> f64 {
        match self.sequence {
            Sequence::Sobol => self.set.coordinate(index as u32, dimension),
            Sequence::MonteCarlo => {
                let word = sobol::mix(sobol::mix(self.seed, dimension as u64), index as u64);
                ((word >> 11) as f64 + 0.5) / (1u64 << 53) as f64
            }
        }
    }

    /// A coordinate of every point of a block.
    #[inline(always)]
    fn lane(&self, block: usize, dimension: usize) -> Lane {
        if self.sequence == Sequence::Sobol && dimension < sobol::NET_DIMENSIONS {
            return self.set.aligned((block * LANES) as u32, dimension);
        }
        let mut out = [0.0; LANES];
        for (l, value) in out.iter_mut().enumerate() {
            *value = self.at(block * LANES + l, dimension);
        }
        out
    }
}

/// Blocks of attitude noise in the vectors of the caller.
struct Blocks<'a> {
    jitter: &'a Jitter,
    count: usize,
    uniform: Uniform,
}

impl pulp::NullaryFnOnce for Blocks<'_> {
    type Output = Vec<[Noise; 2]>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        (0..self.count).map(|block| block_noise(self.jitter, block, &self.uniform)).collect()
    }
}

/// The first `count` blocks of both vehicles' noise.
#[must_use]
pub fn blocks(jitter: &Jitter, count: usize, uniform: Uniform) -> Vec<[Noise; 2]> {
    // The same operations in the same order on any machine's vectors.
    pulp::Arch::new().dispatch(Blocks { jitter, count, uniform })
}

#[inline(always)]
fn block_noise(jitter: &Jitter, block: usize, uniform: &Uniform) -> [Noise; 2] {
    let components = jitter::components(jitter.axes);
    let mut w = [[[0.0; LANES]; 3]; 2];
    if jitter::is_present(jitter) {
        for (vehicle, axes) in w.iter_mut().enumerate() {
            for (component, lane) in axes.iter_mut().take(components).enumerate() {
                *lane = normal::quantiles(&uniform.lane(block, vehicle * components + component));
                lane.iter_mut().for_each(|value| *value *= jitter.std_rad);
            }
        }
    }
    match jitter.model {
        JitterModel::Euler => [0, 1]
            .map(|v: usize| Noise::Euler([0, 1, 2].map(|axis: usize| trigonometry::cos_sin(&w[v][axis])))),
        JitterModel::Body => [0, 1].map(|v: usize| {
            let mut axis = [[0.0; LANES]; 3];
            for l in 0..LANES {
                let y = jitter::body_axis([w[v][0][l], w[v][1][l], w[v][2][l]]);
                for (lane, component) in axis.iter_mut().zip(y.iter()) {
                    lane[l] = *component;
                }
            }
            Noise::Body(axis)
        }),
    }
}

/// All eavesdroppers' positions in one draw.
#[must_use]
pub fn positions(nodes: &[Eavesdropper], draw: usize, uniform: &Uniform) -> Vec<Vector3<f64>> {
    nodes
        .iter()
        .enumerate()
        .map(|(node, eavesdropper)| {
            let u = uniform.at(draw, POSITION_DIMENSION + 2 * node);
            let angle = std::f64::consts::TAU * uniform.at(draw, POSITION_DIMENSION + 2 * node + 1);
            let radius = match eavesdropper.uncertainty {
                Uncertainty::None => 0.0,
                Uncertainty::Disc { radius_m } => radius_m * u.sqrt(),
                // The radius of a two-dimensional Gaussian follows Rayleigh's law.
                Uncertainty::Gaussian { std_m } => std_m * (-2.0 * libm::log(u)).sqrt(),
            };
            let (sin, cos) = libm::sincos(angle);
            eavesdropper.position_enu_m + radius * Vector3::new(cos, sin, 0.0)
        })
        .collect()
}
