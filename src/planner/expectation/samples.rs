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
    pub noise: Vec<[Noise; 2]>,
    /// Draws of all eavesdroppers' positions; a single one (the estimates) when nothing is uncertain. Consecutive
    /// runs of `noise.len() / draws.len()` blocks share a draw.
    pub draws: Vec<Vec<Vector3<f64>>>,
}

/// First dimension of the sequence that moves positions; attitude noise comes before.
const POSITION_DIMENSION: usize = 8;

impl Samples {
    /// `count` samples (rounded up to whole blocks) with `draws` draws of the positions (1: the estimates).
    ///
    /// Without jitter a draw needs one block, all of whose lanes are equal.
    #[must_use]
    pub fn new(problem: &Problem, count: usize, draws: usize, seed: u64, sequence: Sequence) -> Self {
        let draws = draws.max(1);
        let runs = count.div_ceil(LANES * draws).max(1);
        let set = sobol::Scrambled::new(seed);
        let uniform = |index: usize, dimension: usize| match sequence {
            Sequence::Sobol => set.coordinate(index as u32, dimension),
            Sequence::MonteCarlo => {
                let word = sobol::mix(sobol::mix(seed, dimension as u64), index as u64);
                ((word >> 11) as f64 + 0.5) / 53f64.exp2()
            }
        };
        let noise = (0..draws * runs).map(|block| block_noise(&problem.jitter, block, &uniform)).collect();
        let draws = if draws == 1 {
            vec![problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect()]
        } else {
            (0..draws).map(|draw| positions(&problem.eavesdroppers, draw, &uniform)).collect()
        };
        Self { noise, draws }
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.noise.len() * LANES
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.noise.is_empty()
    }

    /// Blocks that share a draw of the positions.
    #[must_use]
    pub fn blocks_per_draw(&self) -> usize {
        self.noise.len() / self.draws.len().max(1)
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
