//! One fixed set of samples: attitude noise of both vehicles, scattered waves and, where anything stays wrong during a
//! slot, draws of it.

use std::ops::Range;

pub use super::errors::Draw;
use super::errors::{Errors, draw_errors, positions};
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
    /// Scattered waves per block, node (the user first) and vehicle; none where nothing is scattered.
    waves: Vec<[Lane; 2]>,
    /// Waves of a block.
    waves_per_block: usize,
    /// Draws of what stays wrong; a single one (the estimates) when nothing does.
    draws: Vec<Draw>,
    /// What else is wrong.
    errors: Wrong,
    /// Blocks of noise per draw.
    per_draw: usize,
    /// Whether every draw meets the same blocks, rather than blocks of its own.
    shared: bool,
}

/// What is wrong beside the eavesdroppers' positions.
#[derive(Debug, Clone)]
enum Wrong {
    Nothing,
    /// Something else in each sample.
    InEachBlock(Vec<Errors>),
    /// Something else in each draw.
    InEachDraw(Vec<Errors>),
}

/// A draw with its blocks.
#[derive(Debug, Clone, Copy)]
pub struct Blocks<'a> {
    /// What stays wrong.
    pub draw: &'a Draw,
    /// Noise of both vehicles.
    pub noise: &'a [[Noise; 2]],
    waves: &'a [[Lane; 2]],
    waves_per_block: usize,
    errors: &'a [Errors],
}

impl<'a> Blocks<'a> {
    /// What is wrong in a block beside the eavesdroppers' positions.
    #[must_use]
    #[inline(always)]
    pub fn errors(&self, block: usize) -> Option<&'a Errors> {
        self.errors.get(block.min(self.errors.len().saturating_sub(1)))
    }

    /// Whether all blocks have the same errors.
    #[must_use]
    pub fn errs_alike(&self) -> bool {
        self.errors.len() < 2
    }

    /// The scattered waves of a block, by node (the user first) and vehicle; none where nothing is scattered.
    #[must_use]
    #[inline(always)]
    pub fn waves(&self, block: usize) -> &'a [[Lane; 2]] {
        let from = block * self.waves_per_block;
        &self.waves[from..from + self.waves_per_block]
    }
}

impl Samples {
    /// `count` samples (rounded up to whole blocks) over `draws` draws of what stays wrong during a slot, each with noise of
    /// its own: for a mean over both. One draw is the estimates, with nothing wrong. Where more than the eavesdroppers'
    /// positions stays wrong, each sample is a draw of its own, however many are asked for.
    #[must_use]
    pub fn new(problem: &Problem, count: usize, draws: usize, seed: u64, sequence: Sequence) -> Self {
        let uniform = Uniform::new(sequence, seed);
        let apart = draws > 1 && problem.errs();
        let draws = if apart { 1 } else { draws.max(1) };
        let per_draw = count.div_ceil(LANES * draws).max(1);
        let noise = noise::blocks(problem, draws * per_draw, uniform);
        let errors =
            if apart { Wrong::in_each_block(problem, noise.len(), true, &uniform) } else { Wrong::Nothing };
        let draws = if draws == 1 {
            vec![estimates(problem)]
        } else {
            (0..draws).map(|draw| positions(problem, draw, &uniform).into()).collect()
        };
        Self { per_draw, draws, errors, shared: false, ..Self::of_noise(problem, noise, uniform) }
    }

    /// `count` samples (rounded up to whole blocks; one block if nothing else is random) that each of `draws` meets: for
    /// comparing the rates of draws. Where a draw says nothing of the user's and the vehicles' errors, each sample has its
    /// own.
    #[must_use]
    pub fn shared(
        problem: &Problem,
        count: usize,
        draws: impl IntoIterator<Item = impl Into<Draw>>,
        seed: u64,
    ) -> Self {
        let draws: Vec<Draw> = draws.into_iter().map(Into::into).collect();
        let drawn: Option<Vec<Errors>> =
            draws.iter().map(|draw| draw.errors.as_ref().map(Errors::of_draw)).collect();
        let apart = drawn.is_none() && problem.errs();
        let varies = jitter::is_present(&problem.jitter) || problem.fading.is_present();
        let count = if varies || apart { count } else { 1 };
        let uniform = Uniform::new(Sequence::Sobol, seed);
        let noise = noise::blocks(problem, count.div_ceil(LANES).max(1), uniform);
        let errors = match drawn {
            Some(errors) => Wrong::InEachDraw(errors),
            None if apart => Wrong::in_each_block(problem, noise.len(), false, &uniform),
            None => Wrong::Nothing,
        };
        Self { per_draw: noise.len(), draws, errors, shared: true, ..Self::of_noise(problem, noise, uniform) }
    }

    fn of_noise(problem: &Problem, noise: Vec<[Noise; 2]>, uniform: Uniform) -> Self {
        let links = if problem.fading.is_present() { 2 * (1 + problem.eavesdroppers.len()) } else { 0 };
        Self {
            waves: noise::waves(links, noise.len(), uniform),
            waves_per_block: links,
            noise,
            draws: Vec::new(),
            errors: Wrong::Nothing,
            per_draw: 1,
            shared: false,
        }
    }

    /// `count` draws of what stays wrong during a slot.
    #[must_use]
    pub fn draws_of(problem: &Problem, count: usize, seed: u64) -> Vec<Draw> {
        let uniform = Uniform::new(Sequence::Sobol, seed);
        let errs = problem.errs();
        let draw = |index: usize| Draw {
            eavesdroppers: positions(problem, index, &uniform),
            errors: errs.then(|| draw_errors(problem, index, &uniform)),
        };
        (0..count).map(draw).collect()
    }

    /// The first `count` samples (rounded up to whole draws): of a Sobol set, itself one.
    #[must_use]
    pub fn first(&self, count: usize) -> Self {
        self.blocks(0..count.div_ceil(LANES).clamp(1, self.noise.len()))
    }

    /// These samples cut into `count` sets of as many each (or the whole draws in which those lie): of a Sobol set, each is one where
    /// `count` is a power of two.
    #[must_use]
    pub fn parts(&self, count: usize) -> Vec<Self> {
        let blocks = (self.noise.len() / count).max(1);
        let part = |part: usize| (part * blocks).min(self.noise.len() - blocks);
        (0..count).map(part).map(|from| self.blocks(from..from + blocks)).collect()
    }

    /// Some of the blocks, and what else there is of the draws in which they lie.
    fn blocks(&self, blocks: Range<usize>) -> Self {
        let (per_draw, draws, blocks) = if self.draws.len() == 1 {
            (blocks.len(), 0..1, blocks)
        } else {
            let draws = blocks.start / self.per_draw..blocks.end.div_ceil(self.per_draw);
            (self.per_draw, draws.clone(), draws.start * self.per_draw..draws.end * self.per_draw)
        };
        let waves = blocks.start * self.waves_per_block..blocks.end * self.waves_per_block;
        Self {
            noise: self.noise[blocks.clone()].to_vec(),
            waves: self.waves[waves].to_vec(),
            waves_per_block: self.waves_per_block,
            draws: self.draws[draws.clone()].to_vec(),
            errors: match &self.errors {
                Wrong::Nothing => Wrong::Nothing,
                Wrong::InEachBlock(errors) => Wrong::InEachBlock(errors[blocks].to_vec()),
                Wrong::InEachDraw(errors) => Wrong::InEachDraw(errors[draws].to_vec()),
            },
            per_draw,
            shared: self.shared,
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

    /// Whether anything but the eavesdroppers' positions is wrong, or anything is scattered.
    #[must_use]
    pub fn is_plain(&self) -> bool {
        matches!(self.errors, Wrong::Nothing) && self.waves_per_block == 0
    }

    /// Each draw with its blocks.
    pub fn draws(&self) -> impl Iterator<Item = Blocks<'_>> {
        self.draws.iter().enumerate().map(|(index, draw)| {
            let from = if self.shared { 0 } else { index * self.per_draw };
            let blocks = from..from + self.per_draw;
            Blocks {
                draw,
                noise: &self.noise[blocks.clone()],
                waves: &self.waves[blocks.start * self.waves_per_block..blocks.end * self.waves_per_block],
                waves_per_block: self.waves_per_block,
                errors: match &self.errors {
                    Wrong::Nothing => &[],
                    Wrong::InEachBlock(errors) => &errors[blocks],
                    Wrong::InEachDraw(errors) => &errors[index..=index],
                },
            }
        })
    }

    /// Adds a draw to a shared set whose draws are positions of the eavesdroppers.
    pub fn push_draw(&mut self, draw: impl Into<Draw>) {
        if self.shared {
            self.draws.push(draw.into());
        }
    }
}

impl Wrong {
    fn in_each_block(problem: &Problem, blocks: usize, eavesdroppers: bool, uniform: &Uniform) -> Self {
        let each = (0..blocks).map(|block| Errors::of_block(problem, block, eavesdroppers, uniform));
        Self::InEachBlock(each.collect())
    }
}

fn estimates(problem: &Problem) -> Draw {
    problem.eavesdroppers.iter().map(|e| e.position_enu_m).collect::<Vec<_>>().into()
}
