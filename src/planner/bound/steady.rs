//! Branch and bound over the two positions, without jitter (the module's section 2).

use nalgebra::Vector3;

use super::budget::Budget;
use super::cell::{Cell, Region};
use super::form::{Axis, Form, exclude};
use super::link::{Gain, Links};
use crate::radio::link::NEAREST_M;

/// Taken off every comparison that excludes: the rounding of some fifty operations, doubled, and then a thousand.
pub(super) const MARGIN: f64 = 1e-11;

/// Line searches for a combination of forms.
const STEPS: usize = 8;

/// How a search over boxes ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Outcome {
    /// Every box was excluded: no configuration reaches the threshold.
    Excluded,
    /// A configuration was found whose rate, bit/s/Hz, exceeds the threshold.
    Refuted(f64),
    /// A box of the smallest size could not be excluded.
    Stuck,
    /// The budget ended first.
    Exhausted,
}

/// Interferences whose ratio, with the noise, is no larger are not told apart.
const LEAST_RATIO: f64 = 1e-6;

/// A pair of boxes, what interference over the noise the user bears there, and a guess at the axis that resists exclusion.
#[derive(Debug, Clone, Copy)]
struct Node {
    i: Cell,
    j: Cell,
    /// Least and largest `b_0`. Without a floor it costs nothing to have none, and it is never split.
    interference: [f64; 2],
    axis: Vector3<f64>,
}

/// The search and its storage, reused from one threshold to the next.
#[derive(Debug)]
pub(crate) struct Search<'a> {
    links: &'a Links,
    region: &'a Region,
    stack: Vec<Node>,
    relaxed: Relaxed,
    /// Boxes examined so far, over all thresholds.
    pub boxes: usize,
    budget: Budget,
}

impl<'a> Search<'a> {
    /// A search over the pairs of positions in `region`.
    pub fn new(links: &'a Links, region: &'a Region, budget: &Budget) -> Self {
        let relaxed = Relaxed::new(links.eavesdroppers.len());
        Self { links, region, stack: Vec::with_capacity(1024), relaxed, boxes: 0, budget: *budget }
    }

    /// Whether some configuration's rate exceeds `threshold`, bit/s/Hz, positive; the budget holds over all calls.
    pub fn run(&mut self, threshold: f64) -> Outcome {
        let smallest = self.budget.resolution_m;
        self.stack.clear();
        let relaxed_threshold = Threshold::new(threshold - self.links.shortfall(f64::INFINITY));
        if relaxed_threshold.sinr <= 0.0 {
            return Outcome::Stuck;
        }
        // Beyond this distance from the user not even a silent jammer and deaf eavesdroppers give the threshold.
        let reach = (self.links.rho.i / relaxed_threshold.sinr).sqrt() * (1.0 + MARGIN);
        let Some(i) = self.region.bounds.cut_to(reach) else { return Outcome::Excluded };
        let whole = [0.0, f64::INFINITY];
        self.stack.push(Node { i, j: self.region.bounds, interference: whole, axis: Vector3::x() });
        let mut outcome = Outcome::Excluded;
        while let Some(node) = self.stack.pop() {
            if self.boxes >= self.budget.boxes {
                return Outcome::Exhausted;
            }
            self.boxes += 1;
            if self.region.too_close(&node.i, &node.j) {
                continue;
            }
            let Some(open) = self.relaxed.examine(self.links, &node, threshold) else { continue };
            let Open { axis, loss_i, loss_j, interference, loss_between } = open;
            let (p_i, p_j) = (node.i.centre(), node.j.centre());
            if outcome == Outcome::Excluded
                && !self.region.excludes_point(&p_i)
                && !self.region.excludes_point(&p_j)
            {
                let rate = self.links.rate_nulled(&p_i, &p_j, &axis, between(interference));
                if rate > threshold && !self.region.too_close(&Cell::at(&p_i), &Cell::at(&p_j)) {
                    outcome = Outcome::Refuted(rate);
                    if !self.budget.exhaustive {
                        return outcome;
                    }
                }
            }
            let node = Node { axis, interference, ..node };
            if loss_between > loss_i.max(loss_j) {
                let [low, high] = interference;
                let middle = between(interference);
                for half in [[low, middle], [middle, high]] {
                    self.stack.push(Node { interference: half, ..node });
                }
                continue;
            }
            let ((edge_i, length_i), (edge_j, length_j)) = (node.i.longest_edge(), node.j.longest_edge());
            if length_i.max(length_j) < smallest {
                if !self.budget.exhaustive {
                    return Outcome::Stuck;
                }
                if outcome == Outcome::Excluded {
                    outcome = Outcome::Stuck;
                }
                continue;
            }
            if (loss_i >= loss_j && length_i >= smallest) || length_j < smallest {
                for half in node.i.split(edge_i) {
                    if !self.region.excludes(&half) {
                        self.stack.push(Node { i: half, ..node });
                    }
                }
            } else {
                for half in node.j.split(edge_j) {
                    if !self.region.excludes(&half) {
                        self.stack.push(Node { j: half, ..node });
                    }
                }
            }
        }
        outcome
    }
}

/// A threshold and what follows from it alone.
struct Threshold {
    /// 2^T.
    power: f64,
    /// 2^T - 1: the SINR the user needs.
    sinr: f64,
}

impl Threshold {
    fn new(threshold: f64) -> Self {
        let sinr = (threshold * std::f64::consts::LN_2).exp_m1() * (1.0 - MARGIN);
        Self { power: 1.0 + sinr, sinr }
    }
}

/// A pair of boxes that was not excluded.
struct Open {
    /// The axis of I that resisted.
    axis: Vector3<f64>,
    /// What the size of I's box costs at that axis, in the units of the forms.
    loss_i: f64,
    /// What the size of J's box costs.
    loss_j: f64,
    /// What of the node's interference is possible.
    interference: [f64; 2],
    /// What its range costs; 0 where it is not to be split.
    loss_between: f64,
}

/// The relaxation of one pair of boxes, with its storage.
#[derive(Debug)]
struct Relaxed {
    /// rho_I / (1 + b_j) of each eavesdropper, b_j bounded above over J's box.
    strength: Vec<f64>,
    /// The same at the centre of J's box.
    strength_centre: Vec<f64>,
    /// Of each eavesdropper, by each of its least gains.
    lines: Vec<Line>,
}

/// One eavesdropper seen from I's box, by one of its least gains.
#[derive(Debug, Clone, Copy)]
struct Line {
    eavesdropper: usize,
    direction: Vector3<f64>,
    /// The gain's swing / distance^2 from the centre.
    inverse_square: f64,
    /// Largest change of the inverted position, relative to it.
    spread: f64,
    /// What is received whatever the axis: the gain's flat part / distance^2, from the farthest point of the box.
    leak: f64,
}

impl Relaxed {
    fn new(n: usize) -> Self {
        Self { strength: vec![0.0; n], strength_centre: vec![0.0; n], lines: Vec::with_capacity(n) }
    }

    /// `None` if no configuration with its positions in these boxes reaches the threshold.
    fn examine(&mut self, links: &Links, node: &Node, threshold: f64) -> Option<Open> {
        let Node { i, j, interference: [least, most], axis: hint } = node;
        let (centre, radius) = (i.centre(), i.radius() * (1.0 + MARGIN));
        let nearest_squared = i.least_distance_squared(&Vector3::zeros()) * (1.0 - MARGIN);
        let Gain { swing: depth, .. } = links.user.i.mean;
        let across = links.user.i.mean.most();
        let t = &Threshold::new(threshold - links.shortfall(*most));
        let interference = links.rho.i * across / (nearest_squared * t.sinr) * (1.0 + MARGIN) - 1.0;
        if interference < *least {
            return None;
        }
        let interference = interference.min(*most);
        let t = &Threshold::new(threshold - links.shortfall(interference));
        self.jam(links, j, interference);
        self.lines.clear();
        for (eavesdropper, e) in links.eavesdroppers.iter().enumerate() {
            let line = e - centre;
            let distance = line.norm();
            let nearest = i.least_distance_squared(e).sqrt();
            // Nearer than this the link is not that of the formulas, and weaker.
            let spread = if nearest > NEAREST_M { radius / nearest } else { f64::INFINITY };
            let direction = line.try_normalize(0.0).unwrap_or_else(Vector3::z);
            let farthest_squared = i.greatest_distance_squared(e);
            for gain in &links.eavesdropper.i.least {
                let leak = if gain.flat > 0.0 && nearest > NEAREST_M {
                    gain.flat / farthest_squared * (1.0 - MARGIN)
                } else {
                    0.0
                };
                let inverse_square = gain.swing / (distance * distance);
                self.lines.push(Line { eavesdropper, direction, inverse_square, spread, leak });
            }
        }
        let distance = centre.norm();
        let towards = if distance > 0.0 { centre / distance } else { Vector3::z() };
        let chord = chord(radius, distance);
        let gain = links.rho.i / (t.power * nearest_squared * (1.0 + least)) * (1.0 + MARGIN);
        let user = User { gain, across, depth, chord, towards };
        let Axis::Maybe(axis) = exclude(|y| self.tightest(y, &user, t), hint, MARGIN, STEPS) else {
            return None;
        };
        // The part of the excess at the resisting axis that would vanish with the box.
        let own = links.rho.i / (t.power * distance * distance * (1.0 + least));
        let away = axis.dot(&towards).abs();
        let loss_user =
            gain * (across - depth * (away - chord).max(0.0).powi(2)) - own * (across - depth * away * away);
        // One eavesdropper that hears well excludes, so the loudest counts: as bounded, with either box a point.
        let (mut bounded, mut point_i, mut point_j) = (0.0_f64, 0.0_f64, 0.0_f64);
        for line in &self.lines {
            let [strength, at_centre] = [&self.strength, &self.strength_centre].map(|s| s[line.eavesdropper]);
            let sine = axis.cross(&line.direction).norm();
            let kept = line.leak + line.inverse_square * (sine - line.spread).max(0.0).powi(2);
            bounded = bounded.max(strength * kept);
            point_i = point_i.max(strength * (line.leak + line.inverse_square * sine * sine));
            point_j = point_j.max(at_centre * kept);
        }
        let (loss_i, loss_j) = (loss_user + point_i - bounded, point_j - bounded);
        let ratio = (1.0 + interference) / (1.0 + least);
        let loss_between = if links.user.j.mean.flat > 0.0 && ratio.is_finite() && ratio > 1.0 + LEAST_RATIO {
            own * (across - depth * away * away) * (1.0 - 1.0 / ratio.sqrt())
        } else {
            0.0
        };
        Some(Open { axis, loss_i, loss_j, interference: [*least, interference], loss_between })
    }

    /// Bounds on b_j over J's box, given the largest interference that the user bears.
    fn jam(&mut self, links: &Links, cell: &Cell, interference: f64) {
        let (centre, radius) = (cell.centre(), cell.radius());
        let distance = centre.norm();
        // Half-angle of the box seen from the user.
        let (sin_half, cos_half) = if radius < distance {
            let s = radius / distance;
            (s, (1.0 - s * s).sqrt())
        } else {
            (1.0, 0.0)
        };
        // The user's own distance counts as NEAREST_M at least; that of an eavesdropper only ever weakens J.
        let farthest = cell.greatest_distance_squared(&Vector3::zeros()).sqrt().max(NEAREST_M);
        let most = Jamming::new(links, interference, farthest);
        let here = Jamming::new(links, interference, distance.max(NEAREST_M));
        for (j, e) in links.eavesdroppers.iter().enumerate() {
            let cross = centre.cross(e).norm();
            let length = e.norm();
            let nearest_squared = cell.least_distance_squared(e);
            let nearest = nearest_squared.sqrt();
            // L_j sin(angle at the user), over the box: the angle of the line grows by at most the half-angle.
            let sine = if distance * length > 0.0 { (cross / (distance * length)).min(1.0) } else { 1.0 };
            let cosine = (1.0 - sine * sine).sqrt();
            let wider = if sine >= cos_half { 1.0 } else { sine * cos_half + cosine * sin_half };
            let ratio = (farthest / nearest).min(1.0 + length.max(NEAREST_M) / nearest);
            // A box that holds the eavesdropper may silence it.
            let upper = if nearest > 0.0 {
                most.at(length * wider / nearest_squared, ratio, nearest_squared) * (1.0 + MARGIN)
            } else {
                f64::INFINITY
            };
            self.strength[j] = links.rho.i / (1.0 + upper) * (1.0 - MARGIN);
            let apart_squared = (e - centre).norm_squared();
            let apart = apart_squared.sqrt();
            let here = here.at(length * sine / apart_squared, distance / apart, apart_squared);
            self.strength_centre[j] = links.rho.i / (1.0 + here);
        }
    }

    /// The largest of the inflated inequalities at `axis`, and its form with the splitting of squares tight there.
    fn tightest(&self, axis: &Vector3<f64>, user: &User, t: &Threshold) -> (f64, Form) {
        let cosine = axis.dot(&user.towards).abs();
        let away = (cosine - user.chord).max(0.0);
        let one = 1.0 - 1.0 / t.power;
        let (mut loudest, mut at, mut heard) = (0, 0.0, -1.0);
        for (j, line) in self.lines.iter().enumerate() {
            let sine = axis.cross(&line.direction).norm();
            let kept = (sine - line.spread).max(0.0);
            let here = self.strength[line.eavesdropper] * (line.leak + line.inverse_square * kept * kept);
            if here > heard {
                (loudest, at, heard) = (j, sine, here);
            }
        }
        let value = one + heard - user.gain * (user.across - user.depth * away * away);
        let share = split_share(user.chord, cosine);
        let wanted = Form::new(
            user.gain * (user.across + user.depth * excess(share, user.chord)),
            user.gain * user.depth * (1.0 - share),
            &user.towards,
        );
        let Line { eavesdropper, direction, inverse_square, spread, leak } = self.lines[loudest];
        let strength = self.strength[eavesdropper];
        let share = split_share(spread, at);
        let weight = strength * inverse_square;
        let one = one + strength * leak;
        let form = if share < 1.0 && weight.is_finite() {
            let kept = weight * (1.0 - share);
            Form::new(one + kept - weight * excess(share, spread), kept, &direction)
        } else {
            Form::new(one, 0.0, &direction)
        };
        (value, form.plus(-1.0, &wanted))
    }
}

/// How loud J may be to an eavesdropper while the user bears so much (step 2).
struct Jamming {
    rho: f64,
    /// Of J's mean gains, with `G_0 = F_0 + W_0 g^2` towards the user and `F_1 + W_1 sin^2` towards an eavesdropper: `W_1`, `W_1 / W_0`,
    /// and `F_1 - F_0 W_1 / W_0` if that is positive.
    swing: f64,
    ratio: f64,
    rest: f64,
    /// What the user bears at most, and what J's null leaks to it at full power.
    interference: f64,
    leak: f64,
    /// The largest share of its power that J may have.
    share: f64,
}

impl Jamming {
    /// With J at most this far from the user.
    fn new(links: &Links, interference: f64, distance: f64) -> Self {
        let (rho, user, node) = (links.rho.j, links.user.j.mean, links.eavesdropper.j.mean);
        let leak = user.flat * rho / (distance * distance);
        let share = if leak > interference { interference / leak } else { 1.0 };
        let ratio = node.swing / user.swing;
        let rest = (node.flat - user.flat * ratio).max(0.0);
        Self { rho, swing: node.swing, ratio, rest, interference, leak, share }
    }

    /// The largest b_j where `sin(u_J0, u_Jj) / d_Jj` and `d_J0 / d_Jj` are at most so much, and `d_Jj^2` at least.
    fn at(&self, sine_per_m: f64, ratio: f64, nearest_squared: f64) -> f64 {
        let (k, leak) = (self.interference, self.leak);
        let straight = self.rho * (self.swing * sine_per_m * sine_per_m + self.rest / nearest_squared);
        let mixed = sine_per_m * ratio * (self.rho * self.swing * self.ratio).sqrt();
        // Of `a v + b sqrt(v (1 - v))`, v the leak's share of what the user bears.
        let share = if leak > 0.0 {
            let (a, b) = (straight * k / leak, 2.0 * mixed * k / leak.sqrt());
            let length = a.hypot(b);
            let best = if length > 0.0 { 0.5 + 0.5 * a / length } else { 1.0 };
            self.share.min(best * k / leak)
        } else {
            self.share
        };
        let both = (share * (k - share * leak).max(0.0)).sqrt();
        let all = straight * share + self.ratio * k * ratio * ratio + 2.0 * mixed * both;
        all.min(self.rho * self.share / nearest_squared)
    }
}

/// An interference between two, in the middle of the noise with it as a logarithm.
fn between([low, high]: [f64; 2]) -> f64 {
    ((1.0 + low) * (1.0 + high)).sqrt() - 1.0
}

/// The user seen from I's box.
struct User {
    /// SINR over 2^T at a gain of one, from the nearest point.
    gain: f64,
    /// The largest mean gain towards the user, and its swing.
    across: f64,
    depth: f64,
    /// Largest change of the direction.
    chord: f64,
    /// Direction between the user and the centre.
    towards: Vector3<f64>,
}

/// Largest distance between the unit vectors towards two points of a ball, one of them its centre.
pub(super) fn chord(radius: f64, distance: f64) -> f64 {
    if radius >= distance {
        return 2.0;
    }
    let s = radius / distance;
    // 2 sin(asin(s) / 2), outward.
    (2.0 * s * s / (1.0 + (1.0 - s * s).sqrt())).sqrt() * (1.0 + MARGIN)
}

/// The t in (0, 1] for which (1 - t) x^2 - (1/t - 1) e^2 <= max(x - e, 0)^2 is tight at `at`.
pub(super) fn split_share(e: f64, at: f64) -> f64 {
    if e < at { (e / at).max(1e-12) } else { 1.0 }
}

/// (1/t - 1) e^2.
pub(super) fn excess(share: f64, e: f64) -> f64 {
    if share < 1.0 { (1.0 / share - 1.0) * e * e } else { 0.0 }
}

/// The bound on b_j from points: distances of user and eavesdropper from J, and the sine of the angle between their lines.
#[cfg(test)]
pub(super) fn most_jamming(links: &Links, interference: f64, [user, node]: [f64; 2], sine: f64) -> f64 {
    Jamming::new(links, interference, user).at(sine / node, user / node, node * node)
}
