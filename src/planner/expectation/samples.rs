//! One fixed set of samples: attitude noise of both vehicles and, if positions are uncertain, draws of them.

use nalgebra::Vector3;

use super::{normal, sobol};
use crate::planner::problem::{Eavesdropper, Jitter, JitterModel, Problem, Uncertainty};
use crate::radio::jitter;

/// Samples handled together: one arithmetic instruction a lane, whatever the machine's vector width.
pub const LANES: usize = 8;

/// One value per sample of a block.
pub type Lane = [f64; LANES];

/// Where the random numbers come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sequence {
    /// Scrambled Sobol points.
    Sobol,
    /// Independent pseudo-random points, for comparison.
    MonteCarlo,
}

/// One vehicle's noise in a block, in the form in which the kernel uses it.
#[derive(Debug, Clone, Copy)]
pub enum Noise {
    /// Cosine and sine of the noise of roll, pitch and yaw: (c, s) each.
    Euler([[Lane; 2]; 3]),
    /// The antenna axis in the desired body frame.
    Body([Lane; 3]),
}

/// A sample set, common to every evaluation of a plan (common random numbers).
#[derive(Debug, Clone)]
pub struct Samples {
    /// Noise per block and vehicle (I, J).
    noise: Vec<[Noise; 2]>,
    /// Draws of all eavesdroppers' positions; a single one (the estimates) when nothing is uncertain.
    draws: Vec<Vec<Vector3<f64>>>,
    /// Blocks of noise per draw.
    per_draw: usize,
    /// Whether every draw meets the same blocks, rather than blocks of its own.
    shared: bool,
}

/// First dimension of the sequence that moves positions; attitude noise comes before.
const POSITION_DIMENSION: usize = 8;

/// A coordinate of a point, by index and dimension.
fn uniform(sequence: Sequence, seed: u64) -> impl Fn(usize, usize) -> f64 {
    let set = sobol::Scrambled::new(seed);
    move |index, dimension| match sequence {
        Sequence::Sobol => set.coordinate(index as u32, dimension),
        Sequence::MonteCarlo => {
            let word = sobol::mix(sobol::mix(seed, dimension as u64), index as u64);
            ((word >> 11) as f64 + 0.5) / 53f64.exp2()
        }
    }
}

impl Samples {
    /// `count` samples (rounded up to whole blocks) over `draws` draws of the positions, each with noise of its own: for
    /// a mean over both. One draw is the estimates.
    #[must_use]
    pub fn new(problem: &Problem, count: usize, draws: usize, seed: u64, sequence: Sequence) -> Self {
        let draws = draws.max(1);
        let per_draw = count.div_ceil(LANES * draws).max(1);
        let uniform = uniform(sequence, seed);
        let noise =
            (0..draws * per_draw).map(|block| block_noise(&problem.jitter, block, &uniform)).collect();
        let draws = if draws == 1 {
            vec![problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect()]
        } else {
            (0..draws).map(|draw| positions(&problem.eavesdroppers, draw, &uniform)).collect()
        };
        Self { noise, draws, per_draw, shared: false }
    }

    /// `count` noise samples (rounded up to whole blocks; one block without jitter) that each of `draws` meets: for
    /// comparing the rates of draws.
    #[must_use]
    pub fn shared(problem: &Problem, count: usize, draws: Vec<Vec<Vector3<f64>>>, seed: u64) -> Self {
        let count = if jitter::is_present(&problem.jitter) { count } else { 1 };
        let uniform = uniform(Sequence::Sobol, seed);
        let noise: Vec<_> = (0..count.div_ceil(LANES).max(1))
            .map(|block| block_noise(&problem.jitter, block, &uniform))
            .collect();
        Self { per_draw: noise.len(), noise, draws, shared: true }
    }

    /// `count` draws of the positions.
    #[must_use]
    pub fn positions(problem: &Problem, count: usize, seed: u64) -> Vec<Vec<Vector3<f64>>> {
        let uniform = uniform(Sequence::Sobol, seed);
        (0..count).map(|draw| positions(&problem.eavesdroppers, draw, &uniform)).collect()
    }

    /// The first `count` samples (rounded up to whole draws): of a Sobol set, itself one.
    #[must_use]
    pub fn first(&self, count: usize) -> Self {
        let blocks = count.div_ceil(LANES).clamp(1, self.noise.len());
        if self.draws.len() == 1 {
            return Self {
                noise: self.noise[..blocks].to_vec(),
                draws: self.draws.clone(),
                per_draw: blocks,
                ..*self
            };
        }
        let draws = blocks.div_ceil(self.per_draw);
        Self {
            noise: self.noise[..draws * self.per_draw].to_vec(),
            draws: self.draws[..draws].to_vec(),
            ..*self
        }
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.draws.len() * self.per_draw * LANES
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.draws.is_empty()
    }

    /// Each draw with its blocks of noise.
    pub fn draws(&self) -> impl Iterator<Item = (&[Vector3<f64>], &[[Noise; 2]])> {
        self.draws.iter().enumerate().map(|(draw, positions)| {
            let from = if self.shared { 0 } else { draw * self.per_draw };
            (positions.as_slice(), &self.noise[from..from + self.per_draw])
        })
    }

    /// Adds a draw to a shared set.
    pub fn push_draw(&mut self, positions: Vec<Vector3<f64>>) {
        if self.shared {
            self.draws.push(positions);
        }
    }
}

fn block_noise(jitter: &Jitter, block: usize, uniform: &impl Fn(usize, usize) -> f64) -> [Noise; 2] {
    let components = jitter::components(jitter.axes);
    let mut w = [[[0.0; LANES]; 3]; 2];
    if jitter::is_present(jitter) {
        for (vehicle, axes) in w.iter_mut().enumerate() {
            for (component, lane) in axes.iter_mut().take(components).enumerate() {
                for (l, value) in lane.iter_mut().enumerate() {
                    let u = uniform(block * LANES + l, vehicle * components + component);
                    *value = jitter.std_rad * normal::quantile(u);
                }
            }
        }
    }
    w.map(|axes| match jitter.model {
        JitterModel::Euler => Noise::Euler(axes.map(|lane| [lane.map(f64::cos), lane.map(f64::sin)])),
        JitterModel::Body => {
            let mut axis = [[0.0; LANES]; 3];
            for l in 0..LANES {
                let y = jitter::body_axis([axes[0][l], axes[1][l], axes[2][l]]);
                for (lane, component) in axis.iter_mut().zip(y.iter()) {
                    lane[l] = *component;
                }
            }
            Noise::Body(axis)
        }
    })
}

/// All eavesdroppers' positions in one draw.
fn positions(
    nodes: &[Eavesdropper],
    draw: usize,
    uniform: &impl Fn(usize, usize) -> f64,
) -> Vec<Vector3<f64>> {
    nodes
        .iter()
        .enumerate()
        .map(|(node, eavesdropper)| {
            let u = uniform(draw, POSITION_DIMENSION + 2 * node);
            let angle = std::f64::consts::TAU * uniform(draw, POSITION_DIMENSION + 2 * node + 1);
            let radius = match eavesdropper.uncertainty {
                Uncertainty::None => 0.0,
                Uncertainty::Disc { radius_m } => radius_m * u.sqrt(),
                // The radius of a two-dimensional Gaussian follows Rayleigh's law.
                Uncertainty::Gaussian { std_m } => std_m * (-2.0 * u.ln()).sqrt(),
            };
            eavesdropper.position_enu_m + radius * Vector3::new(angle.cos(), angle.sin(), 0.0)
        })
        .collect()
}
