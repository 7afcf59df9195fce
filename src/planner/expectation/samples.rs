//! One fixed set of samples: attitude noise of both vehicles and, if positions are uncertain, draws of them.

use nalgebra::Vector3;

pub use super::lanes::{LANES, Lane};
pub use super::noise::Sequence;
use super::noise::{self, Noise, Uniform};
use crate::planner::problem::Problem;
use crate::radio::jitter;

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

impl Samples {
    /// `count` samples (rounded up to whole blocks) over `draws` draws of the positions, each with noise of its own: for
    /// a mean over both. One draw is the estimates.
    #[must_use]
    pub fn new(problem: &Problem, count: usize, draws: usize, seed: u64, sequence: Sequence) -> Self {
        let draws = draws.max(1);
        let per_draw = count.div_ceil(LANES * draws).max(1);
        let uniform = Uniform::new(sequence, seed);
        let noise = noise::blocks(&problem.jitter, draws * per_draw, uniform);
        let draws = if draws == 1 {
            vec![problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect()]
        } else {
            (0..draws).map(|draw| noise::positions(&problem.eavesdroppers, draw, &uniform)).collect()
        };
        Self { noise, draws, per_draw, shared: false }
    }

    /// `count` noise samples (rounded up to whole blocks; one block without jitter) that each of `draws` meets: for
    /// comparing the rates of draws.
    #[must_use]
    pub fn shared(problem: &Problem, count: usize, draws: Vec<Vec<Vector3<f64>>>, seed: u64) -> Self {
        let count = if jitter::is_present(&problem.jitter) { count } else { 1 };
        let uniform = Uniform::new(Sequence::Sobol, seed);
        let noise = noise::blocks(&problem.jitter, count.div_ceil(LANES).max(1), uniform);
        Self { per_draw: noise.len(), noise, draws, shared: true }
    }

    /// `count` draws of the positions.
    #[must_use]
    pub fn positions(problem: &Problem, count: usize, seed: u64) -> Vec<Vec<Vector3<f64>>> {
        let uniform = Uniform::new(Sequence::Sobol, seed);
        (0..count).map(|draw| noise::positions(&problem.eavesdroppers, draw, &uniform)).collect()
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
