//! The least harm to the user for given harm to the eavesdroppers (the module's L).

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector3;

use super::cell::{Cell, Region};
use super::law::{Law, Offset, Range, line_angles};

/// A box of poses of J: positions, and the angle between the axis and the exact null on the user.
#[derive(Debug, Clone, Copy)]
struct Node {
    position: Cell,
    off: Range,
    /// Lower bound on l over the box.
    harm: f64,
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
    /// Least harm first out of a max-heap.
    fn cmp(&self, other: &Self) -> Ordering {
        other.harm.total_cmp(&self.harm)
    }
}

/// The jammer's side of the decoupled bound, with its storage.
#[derive(Debug)]
pub(super) struct Jammer<'a> {
    law: &'a Law,
    region: &'a Region,
    /// rho_J in m^2.
    rho: f64,
    /// The eavesdroppers that count.
    eavesdroppers: [Vector3<f64>; 2],
    heap: BinaryHeap<Node>,
    /// Boxes examined, over all calls.
    pub boxes: usize,
}

/// L is found to this, bit/s/Hz, from below.
const TOLERANCE: f64 = 0.15;
/// Boxes for one value of L.
const LIMIT: usize = 6_000;

impl<'a> Jammer<'a> {
    pub fn new(law: &'a Law, region: &'a Region, rho: f64, eavesdroppers: [Vector3<f64>; 2]) -> Self {
        Self { law, region, rho, eavesdroppers, heap: BinaryHeap::with_capacity(4096), boxes: 0 }
    }

    /// A lower bound on `l = E log2(1 + b_0)` over all J with `E b_j >= wanted_j`, infinite if there is none; and
    /// whether that is all that can be shown: the search ends early once the bound reaches `enough`.
    pub fn least_harm(&mut self, wanted: [f64; 2], enough: f64) -> (f64, bool) {
        self.heap.clear();
        self.heap.push(Node { position: self.region.bounds, off: [0.0, FRAC_PI_2], harm: 0.0 });
        let mut used = 0;
        while let Some(node) = self.heap.pop() {
            used += 1;
            self.boxes += 1;
            if used > LIMIT {
                return (node.harm, true);
            }
            if node.harm >= enough {
                return (node.harm, false);
            }
            let point = Cell::at(&node.position.centre());
            let least_off = [node.off[0]; 2];
            let exact = self.harm(&Node { position: point, off: least_off, harm: 0.0 }, wanted);
            if exact - node.harm <= TOLERANCE {
                return (node.harm, true);
            }
            let placed = self.harm(&Node { position: point, ..node }, wanted);
            let turned = self.harm(&Node { off: least_off, ..node }, wanted);
            let halves = if placed > turned {
                let (axis, _) = node.position.longest_edge();
                node.position.split(axis).map(|position| Node { position, ..node })
            } else {
                let cut = 0.5 * (node.off[0] + node.off[1]);
                [[node.off[0], cut], [cut, node.off[1]]].map(|off| Node { off, ..node })
            };
            for half in halves {
                if self.region.excludes(&half.position) {
                    continue;
                }
                let harm = self.harm(&half, wanted);
                if harm.is_finite() {
                    self.heap.push(Node { harm: harm.max(node.harm), ..half });
                }
            }
        }
        (f64::INFINITY, true)
    }

    /// A lower bound on l over a box; infinite if no pose in it gives what is wanted.
    fn harm(&self, node: &Node, wanted: [f64; 2]) -> f64 {
        let cell = &node.position;
        let power = self.least_power(cell, node.off[1], wanted);
        if power * cell.least_distance_squared(&Vector3::zeros()) > self.rho * (1.0 + 1e-9) {
            return f64::INFINITY;
        }
        // The line from the user: the exact null.
        let [line, _] = line_angles(&cell.lo, &cell.hi).unwrap_or([[-FRAC_PI_2, FRAC_PI_2]; 2]);
        let at = |roll_off: f64, pitch_off: f64| {
            let roll = [line[0] + roll_off, line[1] + roll_off];
            let offset = Offset { roll, line_roll: line, roll_off: [roll_off; 2], pitch_off: [pitch_off; 2] };
            self.law.least_mean(power, 0.0, &offset).0
        };
        let off = node.off[0];
        if off == 0.0 {
            return at(0.0, 0.0);
        }
        let flattest = if line[0] <= 0.0 && line[1] >= 0.0 { 1.0 } else { line[0].cos().max(line[1].cos()) };
        let across = 2.0 * ((0.5 * off).sin() / flattest).min(1.0).asin();
        at(off, 0.0).min(at(-off, 0.0)).min(at(0.0, across))
    }

    /// A lower bound on `beta = rho_J u / d_J0^2` over a box whose axes are at most `off` from the null.
    fn least_power(&self, cell: &Cell, off: f64, wanted: [f64; 2]) -> f64 {
        let (centre, radius) = (cell.centre(), cell.radius());
        let extents = (cell.hi - cell.lo) * 0.5;
        let farthest = cell.greatest_distance_squared(&Vector3::zeros());
        let noise = NOISE * self.law.variance();
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
            power = power.max(wanted / (root * root));
            let line = centre - e;
            let apart = line.norm_squared();
            if height > 1.5 * radius && nearest > 0.5 * radius {
                let low = height - radius;
                let sine = (low * length / (apart.sqrt() + radius).powi(2) / ratio).min(1.0);
                let rise = ((1.0 + noise / (sine * sine)).sqrt() + off / sine).ln() * 2.0;
                let curvature = 0.5 * radius * radius * (2.0 / (low * low) + 4.0 / nearest_squared);
                let here = 2.0 * (height * length / apart).ln();
                let slope = aside * (2.0 / (height * height)) - line * (4.0 / apart);
                tangents[count] = (wanted.ln() - here - rise - curvature, -slope);
                count += 1;
            }
        }
        let ceiling = |value: f64, slope: &Vector3<f64>| value - slope.abs().dot(&extents);
        let mut best = f64::NEG_INFINITY;
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
        power.max(best.exp())
    }
}

#[cfg(test)]
impl Jammer<'_> {
    /// The bound on l at one pose.
    pub fn harm_at(&self, position: &Vector3<f64>, roll: f64, pitch: f64, wanted: [f64; 2]) -> f64 {
        let axis = crate::radio::pattern::antenna_axis(roll, pitch, 0.0);
        let off = position.normalize().cross(&axis).norm().min(1.0).asin();
        self.harm(&Node { position: Cell::at(position), off: [off; 2], harm: 0.0 }, wanted)
    }
}

/// `E G - sin^2` of the desired angle, over the variance of the noise: at most 2 for the spread and half for the
/// mean's shift.
const NOISE: f64 = 2.5;
