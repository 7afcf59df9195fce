//! The least harm to the user for given harm to the eavesdroppers (the module's L).

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector3;

use super::cell::{Cell, Region};
use super::law::{Law, Offset, Range, line_angles, minus, plus};
use super::steady::chord;

/// A box of poses of J: positions, and offsets of the axis from the exact null on the user.
#[derive(Debug, Clone, Copy)]
struct Node {
    position: Cell,
    roll_off: Range,
    pitch_off: Range,
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
    pub law: &'a Law,
    pub region: &'a Region,
    /// rho_J in m^2.
    pub rho: f64,
    /// The eavesdroppers that count.
    pub eavesdroppers: [Vector3<f64>; 2],
    pub tolerance: f64,
    heap: BinaryHeap<Node>,
    pub boxes: usize,
}

/// Boxes for one value of L.
const LIMIT: usize = 20_000;

impl<'a> Jammer<'a> {
    pub fn new(law: &'a Law, region: &'a Region, rho: f64, eavesdroppers: [Vector3<f64>; 2], tolerance: f64) -> Self {
        Self { law, region, rho, eavesdroppers, tolerance, heap: BinaryHeap::with_capacity(4096), boxes: 0 }
    }

    /// A lower bound on `l = E log2(1 + b_0)` over all J with `E b_j >= wanted_j`; infinite if there is none.
    pub fn least_harm(&mut self, wanted: [f64; 2]) -> f64 {
        self.heap.clear();
        let root =
            Node { position: self.region.bounds, roll_off: [-PI, PI], pitch_off: [-FRAC_PI_2, FRAC_PI_2], harm: 0.0 };
        self.heap.push(root);
        let mut used = 0;
        while let Some(node) = self.heap.pop() {
            used += 1;
            self.boxes += 1;
            if used > LIMIT {
                return node.harm;
            }
            let centre = Node {
                position: Cell::at(&node.position.centre()),
                roll_off: [0.5 * (node.roll_off[0] + node.roll_off[1]); 2],
                pitch_off: [0.5 * (node.pitch_off[0] + node.pitch_off[1]); 2],
                harm: 0.0,
            };
            let at_position = Node { position: centre.position, ..node };
            let at_axis = Node { position: node.position, ..centre };
            let exact = self.harm(&centre, wanted).unwrap_or(f64::INFINITY);
            if exact - node.harm <= self.tolerance {
                return node.harm;
            }
            let placed = self.harm(&at_position, wanted).unwrap_or(f64::INFINITY);
            let turned = self.harm(&at_axis, wanted).unwrap_or(f64::INFINITY);
            let halves = if placed >= turned {
                let (axis, _) = node.position.longest_edge();
                node.position.split(axis).map(|position| Node { position, ..node })
            } else if node.roll_off[1] - node.roll_off[0] > node.pitch_off[1] - node.pitch_off[0] {
                thirds(node.roll_off).map(|roll_off| Node { roll_off, ..node })
            } else {
                thirds(node.pitch_off).map(|pitch_off| Node { pitch_off, ..node })
            };
            for half in halves {
                if self.region.excludes(&half.position) {
                    continue;
                }
                if let Some(harm) = self.harm(&half, wanted) {
                    self.heap.push(Node { harm: harm.max(node.harm), ..half });
                }
            }
        }
        f64::INFINITY
    }

    /// A lower bound on l over a box; `None` if no pose in it gives what is wanted.
    fn harm(&self, node: &Node, wanted: [f64; 2]) -> Option<f64> {
        let cell = &node.position;
        // The line from the user: the exact null.
        let [line_roll, line_pitch] = line_angles(&cell.lo, &cell.hi).unwrap_or([[-FRAC_PI_2, FRAC_PI_2], [-PI, PI]]);
        let roll = plus(line_roll, node.roll_off);
        let pitch = plus(line_pitch, node.pitch_off);
        if roll[0] > FRAC_PI_2 || roll[1] < -FRAC_PI_2 {
            return None;
        }
        let roll = [roll[0].max(-FRAC_PI_2), roll[1].min(FRAC_PI_2)];
        let (roll_mid, pitch_mid) = (0.5 * (roll[0] + roll[1]), 0.5 * (pitch[0] + pitch[1]));
        let turn = (roll[1] - roll_mid).hypot(pitch[1] - pitch_mid);
        let moment = self.law.second_moment(roll_mid, pitch_mid);
        let (centre, radius) = (cell.centre(), cell.radius());
        let farthest = cell.greatest_distance_squared(&Vector3::zeros());
        let mut power = 0.0_f64;
        for (e, wanted) in self.eavesdroppers.iter().zip(wanted) {
            if wanted <= 0.0 {
                continue;
            }
            let line = e - centre;
            let distance = line.norm();
            let nearest = cell.least_distance_squared(e);
            let gain = if distance > 0.0 {
                let u = line / distance;
                let mean = (1.0 - u.dot(&(moment * u))).max(0.0);
                (mean.sqrt() + chord(radius, distance) + turn).min(1.0)
            } else {
                1.0
            };
            // k_j = (d_J0 / d_Jj)^2 E G_Jj, above.
            let ratio = (farthest / nearest).min((1.0 + e.norm() / nearest.sqrt()).powi(2));
            power = power.max(wanted / (ratio * gain * gain));
        }
        if power * cell.least_distance_squared(&Vector3::zeros()) > self.rho * (1.0 + 1e-9) {
            return None;
        }
        let offset = Offset { roll, line_roll, roll_off: node.roll_off, pitch_off: node.pitch_off };
        let _ = minus;
        Some(self.law.least_mean(power, 0.0, &offset))
    }
}

/// Two parts of an interval about its middle, but never cut at zero: the null is inside one of them.
fn thirds(range: Range) -> [Range; 2] {
    let [lo, hi] = range;
    let middle = 0.5 * (lo + hi);
    let cut = if middle.abs() < 1e-3 * (hi - lo) { lo + (hi - lo) / 3.0 } else { middle };
    [[lo, cut], [cut, hi]]
}
