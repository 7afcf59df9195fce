//! What a superframe's poses are worth: the volume that counts over the superframe's length, and its gradient.

use super::super::expectation::kernel::Raw;
use super::super::expectation::samples::Samples;
use super::super::model::{Memory, Target};
use super::super::setup::Setup;
use super::Service;
use super::layout::{Axes, Layout, Pattern};
use super::shares::{Shares, shares};
use super::ways::{Ways, largest_s, smoothed};
use crate::planner::solver::limited::{self, Settings};

/// A superframe to be planned: its users, and what is known of them.
pub struct Case<'a, W> {
    /// Each user's problem.
    pub setups: &'a [Setup<'a>],
    /// Each user's samples, the coarsest first; none of a resolution where nothing is random.
    pub samples: Vec<[Samples; 4]>,
    /// Lengths and limits of slots.
    pub service: &'a Service,
    /// How long transits take.
    pub ways: &'a W,
    /// Who can be served at all.
    pub counts: Vec<bool>,
}

/// How finely a superframe is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Which samples.
    pub resolution: usize,
    /// Sharpness of the maximum over eavesdroppers, where nothing is random.
    pub sharpness: f64,
    /// Power of the norm that stands for a maximum of times.
    pub power: f64,
}

/// To tell hopeless places from others.
pub const ROUGH: View = View { resolution: 0, sharpness: 200.0, power: 12.0 };
/// Coarse enough to find one's way.
pub const COARSE: View = View { resolution: 1, sharpness: 200.0, power: 12.0 };
/// For the search.
pub const MEDIUM: View = View { resolution: 2, sharpness: 2e3, power: 12.0 };
/// For the last steps.
pub const FINE: View = View { resolution: 3, sharpness: 2e5, power: 48.0 };

/// A superframe's configurations and what they are worth.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// By user.
    pub raws: Vec<Raw>,
    /// In which order they are served.
    pub order: Vec<usize>,
    /// The volume that counts over the superframe's length, nats per hertz and second.
    pub value: f64,
    /// Whether the solver's tolerance was met.
    pub converged: bool,
}

impl<W: Ways> Case<'_, W> {
    /// A user's rate in nats per hertz, [.]^+ inside, and its gradient.
    pub fn rate(&self, user: usize, view: View, raw: &Raw, memory: &mut Memory, gradient: &mut Raw) -> f64 {
        memory.value(&self.setups[user], self.target(user, view, true), raw, gradient)
    }

    /// What is averaged for a user.
    pub fn target(&self, user: usize, view: View, clip: bool) -> Target<'_> {
        let setup = &self.setups[user];
        if setup.varies() || setup.heeds_uncertainty() {
            Target::Mean { samples: &self.samples[user][view.resolution], clip }
        } else {
            Target::Exact(view.sharpness)
        }
    }

    /// The superframe's length without transits, in seconds.
    fn slots_s(&self, shares: &Shares) -> f64 {
        shares.slots_s.iter().sum::<f64>() + self.setups.len() as f64 * self.service.settle_s
    }

    /// The volume that counts over the superframe's length, and its gradient by each user's configuration.
    pub fn value(
        &self,
        order: &[usize],
        view: View,
        raws: &[Raw],
        memory: &mut Memory,
        by_raws: &mut [Raw],
    ) -> f64 {
        let rates: Vec<f64> = raws
            .iter()
            .zip(by_raws.iter_mut())
            .enumerate()
            .map(|(user, (raw, by_raw))| self.rate(user, view, raw, memory, by_raw))
            .collect();
        let shares = shares(self.service, &rates, &self.counts);
        let legs: Vec<_> = legs(order)
            .map(|(from, to)| (from, to, smoothed(self.ways, &raws[from], &raws[to], view.power)))
            .collect();
        let length_s = self.slots_s(&shares) + legs.iter().map(|(_, _, leg)| leg.time_s).sum::<f64>();
        let value = shares.volume / length_s;
        for (user, by_raw) in by_raws.iter_mut().enumerate() {
            let by_rate = (shares.by_rate[user] - value * shares.length_by_rate[user]) / length_s;
            by_raw.iter_mut().for_each(|c| *c *= by_rate);
        }
        for (from, to, leg) in &legs {
            for (end, by) in [from, to].into_iter().zip(&leg.by) {
                by_raws[*end].iter_mut().zip(by).for_each(|(sum, c)| *sum -= value / length_s * c);
            }
        }
        value
    }

    /// The same with the largest of all times in place of their norm, and no gradient.
    pub fn worth(&self, order: &[usize], view: View, raws: &[Raw], memory: &mut Memory) -> f64 {
        let mut unused = [0.0; 14];
        let rates: Vec<f64> = raws
            .iter()
            .enumerate()
            .map(|(user, raw)| self.rate(user, view, raw, memory, &mut unused))
            .collect();
        let transits_s: f64 =
            legs(order).map(|(from, to)| largest_s(self.ways, &raws[from], &raws[to])).sum();
        self.worth_of(&rates, transits_s)
    }

    /// What rates and the sum of all transits are worth.
    pub fn worth_of(&self, rates: &[f64], transits_s: f64) -> f64 {
        let shares = shares(self.service, rates, &self.counts);
        shares.volume / (self.slots_s(&shares) + transits_s)
    }

    /// A local maximum near a candidate, sharing positions by `pattern`; `None` where no feasible one is found.
    pub fn climb(
        &self,
        from: &Candidate,
        pattern: &Pattern,
        (view, axes): (View, Axes),
        settings: &Settings,
        memory: &mut Memory,
    ) -> Option<Candidate> {
        let layout = Layout::new(self.setups, &from.raws, pattern, axes);
        let mut x = layout.encode(&from.raws);
        let mut best: Option<Candidate> = None;
        let mut other = false;
        for _ in 0..=MOST_CROSSINGS {
            let raws = layout.raws(&x);
            let cells: Vec<[usize; 2]> =
                self.setups.iter().zip(&raws).map(|(setup, raw)| cells(setup, raw, other)).collect();
            let mut rows = layout.rows(self.setups, &cells);
            if !rows.repair(&mut x) {
                break;
            }
            let mut by_raws = vec![[0.0; 14]; raws.len()];
            let mut objective = |x: &[f64], gradient: &mut [f64]| {
                let raws = layout.raws(x);
                let value = self.value(&from.order, view, &raws, memory, &mut by_raws);
                layout.pull(x, &raws, &by_raws, gradient);
                gradient.iter_mut().for_each(|c| *c = -*c);
                -value
            };
            let end = limited::minimise(&mut objective, &mut rows, &x, settings);
            let gained = best.as_ref().is_none_or(|known| -end.value > known.value + 1e-9);
            let raws = layout.raws(&end.x);
            other = self.setups.iter().zip(&raws).zip(&cells).any(|((s, raw), cells)| on_cut(s, raw, *cells));
            x = end.x;
            if gained {
                best = Some(Candidate {
                    raws,
                    order: from.order.clone(),
                    value: -end.value,
                    converged: end.converged,
                });
            }
            if !gained || !other {
                break;
            }
        }
        best.filter(|found| found.value.is_finite())
    }
}

/// Crossings of a cut between the area's convex parts that one search may make.
const MOST_CROSSINGS: usize = 3;
/// A position this deep in a cut, in metres, lies on it.
const ON_CUT_M: f64 = 1e-7;

/// From whom to whom the pair goes.
pub fn legs(order: &[usize]) -> impl Iterator<Item = (usize, usize)> + '_ {
    let n = order.len();
    (0..n).filter(move |_| n > 1).map(move |k| (order[k], order[(k + 1) % n]))
}

/// The cells of both positions; `other` asks for the neighbour across a cut, where one lies on it.
fn cells(setup: &Setup, raw: &Raw, other: bool) -> [usize; 2] {
    [0, 7].map(|at| {
        let p = nalgebra::Vector3::new(raw[at], raw[at + 1], raw[at + 2]);
        let home = setup.region.cell_of(&p);
        let mut all = 0..setup.region.cells().len();
        let across = all.find(|c| *c != home && setup.region.depth_m(*c, &p) >= -ON_CUT_M);
        across.filter(|_| other).unwrap_or(home)
    })
}

/// Whether a position is on a cut of its cell.
fn on_cut(setup: &Setup, raw: &Raw, cells: [usize; 2]) -> bool {
    [(0, cells[0]), (7, cells[1])].into_iter().any(|(at, cell)| {
        let p = nalgebra::Vector2::new(raw[at], raw[at + 1]);
        setup.region.cells()[cell]
            .sides
            .iter()
            .any(|half_plane| half_plane.cut && half_plane.offset_m - half_plane.normal.dot(&p) < ON_CUT_M)
    })
}
