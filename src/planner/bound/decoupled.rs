//! The decoupled bound under jitter (the module's section 3).

use std::f64::consts::LN_2;

use nalgebra::Vector3;

use super::cell::{Cell, Region};
use super::form::exclude_mixtures;
use super::jammer::Jammer;
use super::law::Law;
use super::link::Links;
use super::steady::{MARGIN, Outcome};
use super::view::{LABELS, MOST, Majorant, View, Views};

/// Steps of the interface, a power of two.
const STEPS: u16 = 1024;
/// Line searches for a combination of forms.
const SEARCHES: usize = 12;
/// Times that the least harm to the user is asked for at one box.
const ROUNDS: usize = 4;
/// Beyond what a box's rate asks for, bit/s/Hz.
const BEYOND: f64 = 0.01;
/// Parts of each side of an interface box in which the rate and L are compared, by the eavesdroppers heeded.
const PARTS: [u16; MOST] = [8, 8, 4];
/// Edges of these parts, which need not begin at one, at most.
const EDGES: usize = 10;
/// An interface box that falls by this, bit/s/Hz, has the rate bounded anew.
const AGAIN: f64 = 0.2;
/// Where nothing loses more than this, bit/s/Hz, the fine table is used.
const FINE_BELOW: f64 = 0.2;
/// Edges of a box that are no longer than this share of its longest are not split.
const SHORT: f64 = 0.2;
/// Boxes of J that take the time of one of I.
const JAMMER_BOXES: usize = 40;

/// A box of positions of I times a box of the interface.
#[derive(Debug, Clone, Copy)]
struct Node {
    position: Cell,
    /// Bounds of each eavesdropper's s in steps.
    s: [[u16; 2]; MOST],
    /// An axis that was not excluded before, and what L is at least, bit/s/Hz.
    axis: Vector3<f64>,
    harm: f64,
    /// Whether the fine table is used.
    fine: bool,
    /// The eavesdropper with whose line the frame turns that axes are told in.
    leader: Option<usize>,
}

/// What is shown of a node.
enum Shown {
    /// No axis has a rate that exceeds L by what is wanted.
    Excluded,
    /// No axis has a larger rate, bit/s/Hz: by combinations of inequalities with these weights, away from the null and near it.
    Rate(f64, [[f64; LABELS]; 2]),
    /// Nothing.
    Open,
}

/// The search over I and the interface.
#[derive(Debug)]
pub(super) struct Search<'a> {
    region: &'a Region,
    views: Views<'a>,
    /// Of each pair of the eavesdroppers heeded.
    jammers: Vec<([usize; 2], Jammer<'a>)>,
    /// s of one step, bit/s/Hz.
    step: f64,
    /// ln(2^s - 1) of each step.
    wanted: Vec<f64>,
    stack: Vec<Node>,
    resolution_m: f64,
    boxes: usize,
}

impl<'a> Search<'a> {
    pub fn new(
        links: &'a Links,
        region: &'a Region,
        law: &'a Law,
        heeded: Vec<Vector3<f64>>,
        resolution_m: f64,
    ) -> Self {
        // No jammer does more than full power from the nearest position.
        let most =
            heeded.iter().map(|e| links.rho.j / region.bounds.least_distance_squared(e)).fold(0.0, f64::max);
        let step = (most.ln_1p() / LN_2 * (1.0 + 1e-12) / f64::from(STEPS)).max(1e-6);
        let count = heeded.len();
        let mut pairs: Vec<[usize; 2]> =
            (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b])).collect();
        if pairs.is_empty() {
            pairs.push([0, 0]);
        }
        let jammer = |pair: [usize; 2]| (pair, Jammer::new(law, region, links, pair.map(|k| heeded[k])));
        Self {
            region,
            jammers: pairs.into_iter().map(jammer).collect(),
            step,
            wanted: (0..=STEPS).map(|s| (f64::from(s) * step * LN_2).exp_m1().ln()).collect(),
            stack: Vec::with_capacity(4096),
            resolution_m,
            boxes: 0,
            views: Views::new(links, law, heeded),
        }
    }

    /// Boxes of both sides, in boxes of I.
    pub fn used(&self) -> usize {
        self.boxes + self.jammers.iter().map(|(_, jammer)| jammer.boxes).sum::<usize>() / JAMMER_BOXES
    }

    /// Whether some configuration's rate exceeds `threshold`.
    pub fn run(&mut self, threshold: f64, limit: usize) -> Outcome {
        let power = (threshold * LN_2).exp();
        if power <= 2.0 * self.views.spread {
            return Outcome::Stuck;
        }
        let wanted = self.views.ask(threshold);
        let reach = (self.views.links.rho.i / (power - 1.0)).sqrt() * (1.0 + 1e-9);
        self.stack.clear();
        let Some(position) = self.region.bounds.cut_to(reach) else { return Outcome::Excluded };
        self.stack.push(Node {
            position,
            s: [[0, STEPS]; MOST],
            axis: Vector3::z(),
            harm: 0.0,
            fine: false,
            leader: None,
        });
        while let Some(mut node) = self.stack.pop() {
            if self.used() >= limit {
                return Outcome::Exhausted;
            }
            self.boxes += 1;
            if self.region.excludes(&node.position) {
                continue;
            }
            if !self.excludes(&mut node, wanted) && !self.branch(node, wanted) {
                return Outcome::Stuck;
            }
        }
        Outcome::Excluded
    }

    /// A lower bound on L at a corner of the interface's grid, looked for until it is `enough`.
    fn harm(&mut self, s: &[u16; MOST], enough: f64) -> f64 {
        let mut most = 0.0_f64;
        for (pair, jammer) in &mut self.jammers {
            let wanted = pair.map(|k| self.wanted[usize::from(s[k])]);
            most = most.max(jammer.harms(wanted, enough));
            if most >= enough {
                break;
            }
        }
        most
    }

    /// Whether no axis makes the rate less L exceed `wanted` over a node. Otherwise an axis that may is left in it, and of its interface
    /// box what may, looked at again while a lower corner makes a lower rate.
    fn excludes(&mut self, node: &mut Node, wanted: f64) -> bool {
        loop {
            let before = node.s;
            let view = self.view(node, &node.position, [1; MOST]);
            let excluded = match self.least_rate(node, &view, wanted) {
                Shown::Excluded => true,
                Shown::Open => false,
                Shown::Rate(rate, weights) => self.shrink(node, &view, &weights, rate, wanted),
            };
            let fell: u16 = before.iter().zip(&node.s).map(|(before, now)| before[1] - now[1]).sum();
            if excluded || f64::from(fell) * self.step < AGAIN {
                return excluded;
            }
        }
    }

    /// What can be shown of the largest rate over a node.
    fn least_rate(&mut self, node: &mut Node, view: &View, wanted: f64) -> Shown {
        let mut threshold = wanted + node.harm;
        // Whatever negative draws add, the rate is no larger than the user's.
        let most = view.sinr(0.0).ln_1p() / LN_2;
        for _ in 0..ROUNDS {
            if most <= threshold {
                return if threshold <= wanted + node.harm { Shown::Excluded } else { Shown::Open };
            }
            let power = threshold.exp2();
            let exclude = |user: &[Majorant]| {
                exclude_mixtures(|y| view.tightest(user, y, power), &node.axis, MARGIN, SEARCHES)
            };
            let away = exclude(&[view.away]);
            let near = view.near.as_ref().filter(|_| away.is_ok());
            let near = near.map_or(away, |near| exclude(near));
            let axes = match (away, near) {
                (Ok(_), Ok(_)) if threshold <= wanted + node.harm => return Shown::Excluded,
                (Ok(away), Ok(near)) => return Shown::Rate(threshold, [away, near]),
                (Err((axes, _)), _) | (_, Err((axes, _))) => axes,
            };
            let rates = axes.map(|y| view.rate(&y));
            node.axis = axes[usize::from(rates[1] > rates[0])];
            let rate = rates[0].max(rates[1]).max(threshold) + BEYOND;
            node.harm = self.harm(&node.s.map(|s| s[0]), rate - wanted).max(node.harm);
            threshold = rate.max(wanted + node.harm);
        }
        Shown::Open
    }

    /// Shrinks the node's interface box to where the rate less L is not shown to stay below `wanted`; true if that is nowhere.
    ///
    /// `rate` bounds the rate at the upper corner by a combination of these weights. Where s of an eavesdropper is lower by d, it hears
    /// `2^(rise d)` times as much: the weights over that, made to add up to one again, show a rate lower by the logarithm of their sum.
    fn shrink(
        &mut self,
        node: &mut Node,
        view: &View,
        weights: &[[f64; LABELS]; 2],
        rate: f64,
        wanted: f64,
    ) -> bool {
        let count = self.views.heeded.len();
        let parts = PARTS[count - 1];
        let mut edges = [[0_u16; EDGES]; MOST];
        let mut numbers = [0; MOST];
        for k in 0..count {
            let [lo, hi] = node.s[k];
            // Corners at multiples of powers of two: boxes share what L is asked for.
            let part = (hi - lo).div_ceil(parts).next_power_of_two();
            let mut at = lo;
            edges[k][0] = lo;
            while at < hi {
                at = (at - at % part + part).min(hi);
                numbers[k] += 1;
                edges[k][numbers[k]] = at;
            }
        }
        let mut left = [[u16::MAX, 0]; MOST];
        let mut index = [0; MOST];
        loop {
            let mut lower = [0; MOST];
            let mut sums = weights.map(|weights| weights[MOST]);
            let mut least = f64::INFINITY;
            for k in 0..count {
                lower[k] = edges[k][index[k]];
                let below = f64::from(node.s[k][1] - edges[k][index[k] + 1]) * self.step;
                let louder = (-view.rises[k] * below).exp2();
                (0..2).for_each(|case| sums[case] += weights[case][k] * louder);
                least = least.min(below);
            }
            let louder = (-view.rises[MOST] * least).exp2();
            (0..2).for_each(|case| sums[case] -= weights[case][MOST] * (1.0 - louder));
            let enough = rate + sums[0].max(sums[1]).log2() - wanted;
            if self.harm(&lower, enough) < enough {
                let mut all = true;
                for k in 0..count {
                    left[k] = [left[k][0].min(lower[k]), left[k][1].max(edges[k][index[k] + 1])];
                    all &= left[k] == node.s[k];
                }
                if all {
                    return false;
                }
            }
            let Some(next) = (0..count).find(|k| index[*k] + 1 < numbers[*k]) else { break };
            index[next] += 1;
            index[..next].fill(0);
        }
        if left[0][0] == u16::MAX {
            return true;
        }
        node.s[..count].copy_from_slice(&left[..count]);
        false
    }

    /// Lets the frame follow the line at which the rate is least at the axis that resists; whether that is another than before.
    fn follow(&mut self, node: &mut Node) -> bool {
        let before = node.leader;
        let mut least = f64::INFINITY;
        for leader in std::iter::once(None).chain((0..self.views.heeded.len()).map(Some)) {
            let rate = self.view(&Node { leader, ..*node }, &node.position, [1; MOST]).rate(&node.axis);
            if rate < least {
                (node.leader, least) = (leader, rate);
            }
        }
        node.leader != before
    }

    /// Halves a box where its bound loses most at the axis that resists; false if it is too small for that.
    fn branch(&mut self, mut node: Node, wanted: f64) -> bool {
        if self.follow(&mut node) && self.excludes(&mut node, wanted) {
            return true;
        }
        let rate = |search: &mut Self, position: &Cell, ends: [usize; MOST]| {
            search.view(&node, position, ends).rate(&node.axis)
        };
        let whole = rate(self, &node.position, [1; MOST]);
        let centre = Cell::at(&node.position.centre());
        let mut choice = (whole - rate(self, &centre, [1; MOST]), None);
        for k in 0..self.views.heeded.len() {
            let mut ends = [1; MOST];
            ends[k] = 0;
            let loss = whole - rate(self, &node.position, ends);
            if node.s[k][1] - node.s[k][0] > 1 && loss > choice.0 {
                choice = (loss, Some(k));
            }
        }
        if choice.0 < FINE_BELOW && !node.fine {
            node.fine = true;
            return self.excludes(&mut node, wanted) || self.branch(node, wanted);
        }
        match choice.1 {
            None => {
                let (_, length) = node.position.longest_edge();
                if length < self.resolution_m {
                    return false;
                }
                let (mut axis, mut least) = (0, f64::INFINITY);
                for edge in 0..3 {
                    if node.position.hi[edge] - node.position.lo[edge] > SHORT * length {
                        let halved = rate(self, &node.position.middle(edge), [1; MOST]);
                        if halved < least {
                            (axis, least) = (edge, halved);
                        }
                    }
                }
                for position in node.position.split(axis) {
                    let mut half = node;
                    half.position = position;
                    self.stack.push(half);
                }
            }
            Some(k) => {
                let [lo, hi] = node.s[k];
                let middle = u16::midpoint(lo, hi);
                for part in [[lo, middle], [middle, hi]] {
                    let mut half = node;
                    half.s[k] = part;
                    self.stack.push(half);
                }
            }
        }
        true
    }

    /// What bounds the rate over a box of positions within a node's, for these ends of its interface box.
    fn view(&mut self, node: &Node, position: &Cell, ends: [usize; MOST]) -> View {
        let at: [f64; MOST] = std::array::from_fn(|k| f64::from(node.s[k][ends[k]]) * self.step);
        let heeded = &node.s[..self.views.heeded.len()];
        let range = heeded.iter().map(|[lo, hi]| f64::from(hi - lo) * self.step).fold(0.0, f64::max);
        self.views.at(position, at, range, node.fine, node.leader)
    }
}

#[cfg(test)]
impl Search<'_> {
    /// What bounds the rate of one axis from anywhere in a box, in the frame that turns with the line to `leader`, and from a point of it.
    pub fn boxed_rates(
        &mut self,
        [lo, hi, p]: [Vector3<f64>; 3],
        axis: &Vector3<f64>,
        s: [f64; MOST],
        leader: Option<usize>,
        threshold: f64,
    ) -> [f64; 2] {
        self.views.ask(threshold);
        let cell = Cell { lo, hi };
        let told = leader.map_or(*axis, |k| {
            let [from, to] = [p, cell.centre()].map(|at| self.views.heeded[k] - at);
            nalgebra::Rotation3::rotation_between(&from, &to).unwrap_or_default() * axis
        });
        let boxed = self.views.at(&cell, s, 0.0, true, leader).rate(&told);
        [boxed, self.views.at(&Cell::at(&p), s, 0.0, true, None).rate(axis)]
    }

    /// The whole chain at one configuration: the bound on its rate, the interface from its own `E b_j`; and whether the
    /// table of L stays below the bound on its own l there.
    pub fn relaxed_rate(
        &mut self,
        poses: [(Vector3<f64>, f64, f64); 2],
        power_share: f64,
        threshold: f64,
    ) -> (f64, bool) {
        let [(p_i, roll_i, pitch_i), (p_j, roll_j, pitch_j)] = poses;
        let wanted = self.views.ask(threshold);
        let mean = self.views.links.eavesdropper.j.mean;
        let moment = self.views.law.second_moment(roll_j, pitch_j);
        let jamming = [0, 1].map(|k| {
            let line = self.views.heeded[k] - p_j;
            let u = line.normalize();
            self.views.links.rho.j * power_share * mean.at(1.0 - u.dot(&(moment * u))) / line.norm_squared()
        });
        let axis = crate::radio::pattern::antenna_axis(roll_i, pitch_i, 0.0);
        let mut s = [0.0; MOST];
        s[..2].copy_from_slice(&jamming.map(|b| b.ln_1p() / LN_2));
        let view = self.views.at(&Cell::at(&p_i), s, 0.0, true, None);
        let rate = view.rate(&axis);
        let jammer = &mut self.jammers[0].1;
        let harm = jammer.harm_at(&p_j, roll_j, pitch_j, jamming);
        // The law at a point and over a class differ by rounding alone where the class is tight.
        let below = jammer.harms(jamming.map(f64::ln), harm + 1e-6) < harm + 1e-6;
        (rate - harm + threshold - wanted, below)
    }
}
