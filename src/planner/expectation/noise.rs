//! From uniform points to attitude noise and scattered waves.

use super::lanes::{LANES, Lane};
use super::{normal, sobol, trigonometry};
use crate::planner::problem::{Jitter, JitterModel, Problem};
use crate::radio::jitter;

/// First dimension of the sequence that scatters: two for each pair of node and vehicle. Attitude noise has the first
/// dimensions, and what stays wrong those between.
const SCATTER_DIMENSION: usize = 1 << 14;

/// One vehicle's noise in a block, in the form in which the kernel uses it.
#[derive(Debug, Clone, Copy)]
pub enum Noise {
    /// Cosine and sine of the noise of roll, pitch and yaw: (c, s) each.
    Euler([[Lane; 2]; 3]),
    /// The antenna axis in the desired body frame.
    Body([Lane; 3]),
    /// The rotation of the body from the desired one, a unit quaternion, scalar first: for an antenna that is not mounted along
    /// body z.
    Turn([Lane; 4]),
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
    pub fn at(&self, index: usize, dimension: usize) -> f64 {
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
        if self.sequence == Sequence::Sobol {
            return self.set.coordinates((block * LANES) as u32, dimension);
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
    is_mounted_askew: bool,
    count: usize,
    uniform: Uniform,
}

impl pulp::NullaryFnOnce for Blocks<'_> {
    type Output = Vec<[Noise; 2]>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        // No closures here nor below: they would leave the caller's vectors.
        let mut out = Vec::with_capacity(self.count);
        for block in 0..self.count {
            out.push(block_noise(self.jitter, self.is_mounted_askew, block, &self.uniform));
        }
        out
    }
}

/// The first `count` blocks of both vehicles' noise.
#[must_use]
pub fn blocks(problem: &Problem, count: usize, uniform: Uniform) -> Vec<[Noise; 2]> {
    let is_mounted_askew = problem.pointing.mounting_std_rad > 0.0;
    // The same operations in the same order on any machine's vectors.
    pulp::Arch::new().dispatch(Blocks { jitter: &problem.jitter, is_mounted_askew, count, uniform })
}

/// Scattered waves, complex normal with a mean square of two: of each block, for the user and every eavesdropper, from I
/// and from J.
struct Waves {
    links: usize,
    count: usize,
    uniform: Uniform,
}

impl pulp::NullaryFnOnce for Waves {
    type Output = Vec<[Lane; 2]>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        let mut out = Vec::with_capacity(self.count * self.links);
        for block in 0..self.count {
            for link in 0..self.links {
                let dimension = SCATTER_DIMENSION + 2 * link;
                let (real, imaginary) =
                    (self.uniform.lane(block, dimension), self.uniform.lane(block, dimension + 1));
                out.push([normal::quantiles(&real), normal::quantiles(&imaginary)]);
            }
        }
        out
    }
}

/// The scattered waves of the first `count` blocks, over `links` pairs of node and vehicle each.
#[must_use]
pub fn waves(links: usize, count: usize, uniform: Uniform) -> Vec<[Lane; 2]> {
    pulp::Arch::new().dispatch(Waves { links, count, uniform })
}

#[inline(always)]
fn block_noise(jitter: &Jitter, is_mounted_askew: bool, block: usize, uniform: &Uniform) -> [Noise; 2] {
    let components = jitter::components(jitter.axes);
    let mut w = [[[0.0; LANES]; 3]; 2];
    if jitter::is_present(jitter) {
        for (vehicle, axes) in w.iter_mut().enumerate() {
            for (component, lane) in axes.iter_mut().take(components).enumerate() {
                *lane = normal::quantiles(&uniform.lane(block, vehicle * components + component));
                for value in lane.iter_mut() {
                    *value *= jitter.std_rad;
                }
            }
        }
    }
    match jitter.model {
        JitterModel::Euler => {
            let mut out = [Noise::Euler([[[0.0; LANES]; 2]; 3]); 2];
            for (noise, axes) in out.iter_mut().zip(&w) {
                let mut turns = [[[0.0; LANES]; 2]; 3];
                for (turn, axis) in turns.iter_mut().zip(axes) {
                    *turn = trigonometry::cos_sin(axis);
                }
                *noise = Noise::Euler(turns);
            }
            out
        }
        JitterModel::Body if is_mounted_askew => [0, 1].map(|v: usize| Noise::Turn(turns(&w[v]))),
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

/// `exp([w])` per sample.
fn turns(w: &[Lane; 3]) -> [Lane; 4] {
    let mut parts = [[0.0; LANES]; 4];
    for l in 0..LANES {
        let rotation = jitter::body_rotation([w[0][l], w[1][l], w[2][l]]);
        for (lane, part) in parts.iter_mut().zip(rotation) {
            lane[l] = part;
        }
    }
    parts
}
