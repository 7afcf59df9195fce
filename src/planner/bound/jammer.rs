//! The least harm to the user for given harm to the eavesdroppers (the module's L), as a table shared by all who ask.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, LN_2};

use nalgebra::Vector3;

use super::cell::{Cell, Region};
use super::harm::least_harm;
use super::law::{Law, Range, line_angles};
use super::link::Links;

/// `E G - sin^2` of the desired angle, over the variance of the noise, is at most this: 2 for the spread and half for
/// the mean's shift (a test of this module takes the maximum).
const NOISE: f64 = 2.5;
/// The least power is found to this, nats, from below.
const TOLERANCE: f64 = 0.02;
/// Boxes for one least power over all rolls, and over those of one class: near the edge of what positions allow, where few
/// boxes hold any, the latter takes long to settle and decides little.
const LIMIT: usize = 30_000;
const ROLL_LIMIT: usize = 100;
/// Cells of the logarithm of the ratio of what is wanted of both, nats.
const RATIO_STEP: f64 = 0.02;
/// Ratios beyond e^this count as one eavesdropper alone.
const RATIO_REACH: f64 = 12.0;
/// Parts of the cosine of the line's roll.
const ROLLS: usize = 48;
/// The first step off the exact null, in what blurs it, and how steps grow.
const OFF_FIRST: f64 = 0.06;
const OFF_GROWTH: f64 = 1.25;
/// Beyond so many of it steps grow faster: the best axes are nearer.
const OFF_FINE: f64 = 0.8;
const OFF_GROWTH_BEYOND: f64 = 1.6;
/// Grid of log2 of the power per area.
const POWER_STEP: f64 = 0.5;
const LEAST_POWER: f64 = -10.0;
/// l is looked for to this much above what is asked for, bit/s/Hz, which spares asking again.
const AHEAD: f64 = 0.1;
/// Grid of log2 of what is wanted of one eavesdropper.
const BASE_STEP: f64 = 1.0 / 128.0;
const LEAST_BASE: f64 = -4.0;

/// Poses of J alike in how the noise acts: rolls of the line to the user, angles of the axis off the exact null.
#[derive(Debug)]
struct Class {
    roll: usize,
    off: usize,
    /// A lower bound on l over log2 of the power per area: the value at each point of the grid, and the slope there;
    /// NaN until it is asked for. The first classes are the exact null's, by roll.
    harm: Vec<(f64, f64)>,
}

/// The jammer's side of the decoupled bound, with its storage.
#[derive(Debug)]
pub(super) struct Jammer<'a> {
    law: &'a Law,
    /// A rule of few points, for axes far off the null.
    away: Law,
    region: &'a Region,
    links: &'a Links,
    /// The eavesdroppers that count.
    eavesdroppers: [Vector3<f64>; 2],
    /// log2 of the largest power per area.
    most_power: f64,
    rolls: Vec<Range>,
    offs: Vec<Range>,
    classes: Vec<Class>,
    /// By ratio, then by class: log2 of the least power for what is wanted of the first, and whether it is the class's own.
    least: Vec<Vec<(f64, bool)>>,
    /// By ratio, then by angle off the null: whether the least over all rolls is known.
    coarse: Vec<Vec<bool>>,
    /// By ratio: lower bounds on l over the grid of what is wanted of the leading one, and whether more cannot be shown.
    harms: Vec<Vec<(f64, bool)>>,
    /// Points of a table.
    points: usize,
    /// By angle off the null, over all rolls and then by roll: where the least power was last found.
    found: Vec<Vector3<f64>>,
    heap: BinaryHeap<Node>,
    /// Boxes examined, over all calls.
    pub boxes: usize,
}

impl<'a> Jammer<'a> {
    pub fn new(law: &'a Law, region: &'a Region, links: &'a Links, eavesdroppers: [Vector3<f64>; 2]) -> Self {
        let most_power =
            (links.rho.j / region.bounds.least_distance_squared(&Vector3::zeros())).log2() + 1e-9;
        let cosine = |k: usize| (k as f64 / ROLLS as f64).acos();
        let rolls: Vec<Range> = (0..ROLLS).map(|k| [cosine(k + 1), cosine(k)]).collect();
        // What blurs a null: the noise, and what comes by it.
        let null = &links.user.j.mean;
        let blur = (law.variance() + null.flat / null.swing).sqrt();
        let mut offs = vec![[0.0, (OFF_FIRST * blur).min(FRAC_PI_2)]];
        while let Some(&[_, from]) = offs.last().filter(|off| off[1] < FRAC_PI_2) {
            let growth = if from < OFF_FINE * blur { OFF_GROWTH } else { OFF_GROWTH_BEYOND };
            offs.push([from, (from * growth).min(FRAC_PI_2)]);
        }
        let points = ((most_power - LEAST_POWER) / POWER_STEP).ceil().max(1.0) as usize + 1;
        let mut classes = Vec::with_capacity(rolls.len() * offs.len());
        for off in 0..offs.len() {
            for roll in 0..rolls.len() {
                classes.push(Class { roll, off, harm: vec![(f64::NAN, f64::NAN); points] });
            }
        }
        let ratios = 2 * (RATIO_REACH / RATIO_STEP) as usize + 2;
        let found = vec![region.bounds.centre(); offs.len() * (ROLLS + 1)];
        Self {
            points,
            found,
            law,
            away: Law::new(law.variance().sqrt(), 128),
            region,
            links,
            eavesdroppers,
            most_power,
            rolls,
            offs,
            classes,
            least: vec![Vec::new(); ratios],
            coarse: vec![Vec::new(); ratios],
            harms: vec![Vec::new(); ratios],
            heap: BinaryHeap::with_capacity(4096),
            boxes: 0,
        }
    }

    /// A lower bound on `l = E log2(1 + b_0)` for all J with `E b_j >= exp(wanted_j)`, looked for until it is `enough`.
    pub fn harms(&mut self, wanted: [f64; 2], enough: f64) -> f64 {
        if enough <= 0.0 {
            return 0.0;
        }
        let last = self.least.len() - 1;
        let ratio = wanted[1] - wanted[0];
        let (slot, base) = if ratio >= RATIO_REACH {
            (last, wanted[1])
        } else if ratio > -RATIO_REACH {
            (1 + (((ratio + RATIO_REACH) / RATIO_STEP) as usize).min(last - 2), wanted[0])
        } else {
            (0, wanted[0])
        };
        // Below the least power no harm is counted; where none is wanted of either, the base is minus infinity.
        let at = (base / LN_2 - LEAST_BASE) / BASE_STEP;
        if !(at >= 0.0) {
            return 0.0;
        }
        let at = at as usize;
        let (shown, all) = self.harms[slot].get(at).copied().unwrap_or((0.0, false));
        if shown >= enough || all {
            return shown;
        }
        let found = self.search(slot, LEAST_BASE + at as f64 * BASE_STEP, enough + AHEAD);
        if self.harms[slot].len() <= at {
            self.harms[slot].resize(at + 1, (0.0, false));
        }
        self.harms[slot][at] = found;
        found.0
    }

    /// A lower bound on the least l over all classes, at log2 of what is wanted of the slot's leading eavesdropper, and
    /// whether that is all that can be shown: the search ends once `enough` is.
    fn search(&mut self, slot: usize, base: f64, enough: f64) -> (f64, bool) {
        if self.least[slot].is_empty() {
            self.open(slot);
        }
        loop {
            let mut best = (f64::INFINITY, None, 0);
            for (k, &(power, _)) in self.least[slot].iter().enumerate() {
                let (harm, point) = self.read(k, base + power);
                if harm < best.0 {
                    best = (harm, point, k);
                }
            }
            let (harm, point, class) = best;
            let all = harm.is_infinite() || (self.least[slot][class].1 && point.is_none());
            if all || harm >= enough {
                return (harm, all);
            }
            if let Some(point) = point {
                self.tabulate(class, point);
            } else {
                self.refine(slot, class);
            }
        }
    }

    /// Computes a point of a class's table, and of the exact null's.
    fn tabulate(&mut self, class: usize, point: usize) {
        let roll = self.classes[class].roll;
        let gains = &self.links.user.j.least;
        let power = (LEAST_POWER + point as f64 * POWER_STEP).exp2();
        for class in [roll, class] {
            let Class { roll, off, ref mut harm } = self.classes[class];
            if harm[point].0.is_nan() {
                let law =
                    if self.offs[off][0] > 5.0 * self.law.variance().sqrt() { &self.away } else { self.law };
                harm[point] = least_harm(law, gains, power, self.rolls[roll], self.offs[off][0]);
                if class == roll {
                    return;
                }
            }
        }
    }

    /// First bounds on the powers of a slot: from the nearest slots that have some. The least power for what is wanted of
    /// the first rises with the ratio, and by no more than it.
    fn open(&mut self, slot: usize) {
        let last = self.least.len() - 1;
        self.coarse[slot] = vec![false; self.offs.len()];
        let mut powers = vec![(f64::NEG_INFINITY, false); self.classes.len()];
        let known = |k: &usize| !self.least[*k].is_empty();
        if slot != 0 && slot != last {
            if let Some(below) = (1..slot).rev().find(known) {
                for (power, (from, _)) in powers.iter_mut().zip(&self.least[below]) {
                    power.0 = power.0.max(*from);
                }
            }
            if let Some(above) = (slot + 1..last).find(known) {
                let fall = (above - slot) as f64 * RATIO_STEP / LN_2;
                for (power, (from, _)) in powers.iter_mut().zip(&self.least[above]) {
                    power.0 = power.0.max(from - fall);
                }
            }
        }
        self.least[slot] = powers;
    }

    /// A class's lower bound on l at log2 of a power per area, and the point of its table that would raise it. Until it
    /// is known the exact null's stands in, and for that 0.
    fn read(&self, class: usize, power: f64) -> (f64, Option<usize>) {
        if power > self.most_power {
            return (f64::INFINITY, None);
        }
        let at = (power - LEAST_POWER) / POWER_STEP;
        if !(at >= 0.0) {
            return (0.0, None);
        }
        let k = (at as usize).min(self.points - 1);
        // The tangent at the point below: l is convex in the logarithm of the power.
        let tangent = |(value, slope): (f64, f64)| value + slope * (at - k as f64) * POWER_STEP;
        let own = tangent(self.classes[class].harm[k]);
        if own.is_nan() {
            (tangent(self.classes[class % self.rolls.len()].harm[k]).max(0.0), Some(k))
        } else {
            (own, None)
        }
    }

    /// A better least power for a class: over all rolls first, then its own.
    fn refine(&mut self, slot: usize, class: usize) {
        let Class { roll, off, .. } = self.classes[class];
        if !self.coarse[slot][off] {
            // What every roll is known to need.
            let known = (self.classes.iter().zip(&self.least[slot]))
                .filter(|(c, _)| c.off == off)
                .fold(f64::INFINITY, |known, (_, least)| known.min(least.0));
            let power = self.least_power(slot, off, None, known);
            self.coarse[slot][off] = true;
            // Nearer to the null takes no less.
            for (c, least) in self.classes.iter().zip(&mut self.least[slot]) {
                if c.off <= off && !least.1 {
                    least.0 = least.0.max(power);
                }
            }
        } else {
            let power = self.least_power(slot, off, Some(roll), self.least[slot][class].0);
            let least = &mut self.least[slot][class];
            *least = (least.0.max(power), true);
        }
    }

    /// log2 of a lower bound on the power per area over all positions (with this roll of the line), by best-first
    /// branch and bound.
    fn least_power(&mut self, slot: usize, off: usize, roll: Option<usize>, known: f64) -> f64 {
        let place = off * (ROLLS + 1) + roll.map_or(0, |roll| roll + 1);
        let off = self.offs[off][1];
        let wanted = if slot == 0 {
            [1.0, 0.0]
        } else if slot == self.least.len() - 1 {
            [0.0, 1.0]
        } else {
            [1.0, ((slot - 1) as f64 * RATIO_STEP - RATIO_REACH).exp()]
        };
        // Where the last ratio's least was found nothing less than this is needed.
        let before = self.power(&Cell::at(&self.found[place]), off, wanted);
        if before - known * LN_2 <= TOLERANCE {
            return known;
        }
        let roll = roll.map(|roll| self.rolls[roll]);
        let limit = if roll.is_some() { ROLL_LIMIT } else { LIMIT };
        self.heap.clear();
        self.heap.push(Node { position: self.region.bounds, power: f64::NEG_INFINITY });
        let (mut used, mut reached) = (0, f64::INFINITY);
        while let Some(node) = self.heap.pop() {
            used += 1;
            self.boxes += 1;
            if used > limit {
                return node.power / LN_2;
            }
            let centre = Cell::at(&node.position.centre());
            let here = self.power(&centre, off, wanted);
            if here < reached && roll.is_none_or(|roll| has_roll(&centre, roll)) {
                reached = here;
                self.found[place] = centre.lo;
            }
            if used > 1 && reached - node.power.max(known * LN_2) <= TOLERANCE {
                return (node.power / LN_2).max(known);
            }
            let (axis, _) = node.position.longest_edge();
            for half in node.position.split(axis) {
                if self.region.excludes(&half) || roll.is_some_and(|roll| !has_roll(&half, roll)) {
                    continue;
                }
                let power = self.power(&half, off, wanted).max(node.power);
                self.heap.push(Node { position: half, power });
            }
        }
        f64::INFINITY
    }

    /// A lower bound on the logarithm of `beta = rho_J u / d_J0^2` over a box whose axes are at most `off` from the null.
    fn power(&self, cell: &Cell, off: f64, wanted: [f64; 2]) -> f64 {
        let (centre, radius) = (cell.centre(), cell.radius());
        let extents = (cell.hi - cell.lo) * 0.5;
        let farthest = cell.greatest_distance_squared(&Vector3::zeros());
        let noise = NOISE * self.law.variance();
        let gain = self.links.eavesdropper.j.mean;
        let mut power = 0.0_f64;
        // Of each eavesdropper: the logarithm of the power at the centre, its gradient, the curvature's share.
        let mut tangents = [(0.0, Vector3::zeros()); 2];
        let mut count = 0;
        for (e, wanted) in self.eavesdroppers.iter().zip(wanted) {
            if wanted <= 0.0 {
                continue;
            }
            let length = e.norm();
            let nearest_squared = cell.least_distance_squared(e);
            let nearest = nearest_squared.sqrt();
            let ratio = (farthest.sqrt() / nearest).min(1.0 + length / nearest);
            let along = e / length.max(1e-9);
            let aside = centre - along * centre.dot(&along);
            let height = aside.norm();
            // kappa = (d_J0 / d_Jj) sin(angle at J) = |p x e| / d_Jj^2.
            let kappa = (height + radius) * length / nearest_squared;
            let root = ((kappa * kappa + ratio * ratio * noise).sqrt() + ratio * off).min(ratio);
            power = power.max(wanted / (gain.swing * root * root + gain.flat * ratio * ratio));
            let line = centre - e;
            let apart = line.norm_squared();
            if height > 1.5 * radius && nearest > 0.5 * radius {
                let low = height - radius;
                let sine = (low * length / (apart.sqrt() + radius).powi(2) / ratio).min(1.0);
                let swung = gain.swing * ((1.0 + noise / (sine * sine)).sqrt() + off / sine).powi(2);
                let rise = swung + gain.flat / (sine * sine);
                let curvature = 0.5 * radius * radius * (2.0 / (low * low) + 4.0 / nearest_squared);
                let kappa_here = height * length / apart;
                let here = (wanted / (kappa_here * kappa_here * rise)).ln();
                let slope = aside * (2.0 / (height * height)) - line * (4.0 / apart);
                tangents[count] = (here - curvature, -slope);
                count += 1;
            }
        }
        let ceiling = |value: f64, slope: &Vector3<f64>| value - slope.abs().dot(&extents);
        let mut best = power.ln();
        for (value, slope) in &tangents[..count] {
            best = best.max(ceiling(*value, slope));
        }
        if count == 2 {
            // The larger of two is at least any mean of both: the one with the flattest slope, and two more.
            let [(v, g), (w, h)] = tangents;
            let step = h - g;
            let flattest = (-g.dot(&step) / step.norm_squared().max(1e-300)).clamp(0.0, 1.0);
            for share in [flattest, 0.5 * flattest, 0.5 + 0.5 * flattest] {
                best = best.max(ceiling(v + share * (w - v), &(g + step * share)));
            }
        }
        best
    }
}

/// A box of positions of J.
#[derive(Debug, Clone, Copy)]
struct Node {
    position: Cell,
    /// Lower bound on the logarithm of the power.
    power: f64,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Node {}
impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Node {
    /// Least power first out of a max-heap.
    fn cmp(&self, other: &Self) -> Ordering {
        other.power.total_cmp(&self.power)
    }
}

/// Whether some line from the user into `cell` has an absolute roll within `roll`.
fn has_roll(cell: &Cell, roll: Range) -> bool {
    let Some([[lo, hi], _]) = line_angles(&cell.lo, &cell.hi) else { return true };
    let least = if lo > 0.0 { lo } else { (-hi).max(0.0) };
    least <= roll[1] + 1e-12 && lo.abs().max(hi.abs()) >= roll[0] - 1e-12
}

#[cfg(test)]
impl Jammer<'_> {
    /// The bound on l at one pose.
    pub fn harm_at(&self, position: &Vector3<f64>, roll: f64, pitch: f64, wanted: [f64; 2]) -> f64 {
        let axis = crate::radio::pattern::antenna_axis(roll, pitch, 0.0);
        let off = position.normalize().cross(&axis).norm().min(1.0).asin();
        let power = self.power(&Cell::at(position), off, wanted).exp();
        let line = line_angles(position, position).map_or(0.0, |[roll, _]| roll[0].abs());
        least_harm(self.law, &self.links.user.j.least, power, [line; 2], off).0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::pattern::antenna_axis;

    #[test]
    fn val_noise_adds_no_more_than_its_share_to_the_gain() {
        // The most that E[sin^2] - sin^2 gains over all lines: the largest eigenvalue of M(0) - M(sigma). Pitch turns
        // both alike, so roll alone matters.
        let mut worst: f64 = 0.0;
        for degrees in [0.1_f64, 1.0, 2.0, 5.0, 10.0, 20.0] {
            let law = Law::new(degrees.to_radians(), 8);
            for k in 0..=900 {
                let roll = FRAC_PI_2 * f64::from(k) / 900.0;
                let axis = antenna_axis(roll, 0.0, 0.0);
                let gain = (axis * axis.transpose() - law.second_moment(roll, 0.0)).symmetric_eigenvalues();
                worst = worst.max(gain.max() / law.variance());
            }
        }
        assert!(worst > 1.9 && worst <= NOISE, "{worst}");
    }
}
