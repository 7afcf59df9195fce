//! The decoupled bound under jitter (the module's section 3).

use std::f64::consts::LN_2;

use nalgebra::Vector3;

use super::cell::{Cell, Region};
use super::jammer::Jammer;
use super::law::{ALL_ANGLES, Law, Least, Offset, Range, line_angles};
use super::link::{Gain, Links};
use super::negative::{Asked, Negative};
use super::steady::{Outcome, chord};
use crate::radio::pattern::antenna_axis;

/// E b_0 over 2^l: at most 2 e^gamma = 3.56 for a null under noise of one angle; with a quarter to spare.
const SPREAD: f64 = 4.5;
/// So many times more with scattered waves: e^gamma.
const SCATTERED_SPREAD: f64 = 1.7811;
/// An eavesdropper counts up to so many times its mean SINR.
const LOUDEST: f64 = 12.0;
/// Steps of the interface, a power of two.
const STEPS: u16 = 1024;
/// Parts of each side of an interface box, in which tangents and L are compared.
const PARTS: u16 = 8;
/// Curvature of the means in s that decides between splits, per bit/s/Hz.
const BEND: f64 = 0.03;
/// Points of the rough rule, and its margin: most boxes need no better one.
pub(super) const ROUGH_POINTS: usize = 128;
pub(super) const ROUGH_QUADRATURE: f64 = 0.045;
/// Where nothing loses more than this, bit/s/Hz, the fine rule has the last word.
const FINE_BELOW: f64 = 0.1;
/// A corner of the interface that falls by this, bit/s/Hz, has the rate below it bounded anew.
const AGAIN: f64 = 0.2;
/// Cosine of a roll by which a box's pitch counts at least where the wider of both is halved.
const LEAST_COSINE: f64 = 0.1;
/// Boxes of J that take the time of one of I.
const JAMMER_BOXES: usize = 16;
/// Margin of each mean for its quadrature, bit/s/Hz: twice what was measured (the tests of `law`).
pub(super) const QUADRATURE: f64 = 0.008;

/// By which rule means are taken.
#[derive(Debug, Clone, Copy)]
enum Rule {
    Rough,
    Fine,
}

/// A box of poses of I times a box of the interface.
#[derive(Debug, Clone, Copy)]
struct Node {
    position: Cell,
    roll: Range,
    pitch: Range,
    /// Bounds of s_1 and s_2 in steps.
    s: [[u16; 2]; 2],
}

/// An interface box and the rate of its upper corner, bit/s/Hz.
struct Corner {
    s: [[u16; 2]; 2],
    rate: f64,
}

/// The search over I and the interface.
#[derive(Debug)]
pub(super) struct Search<'a> {
    links: &'a Links,
    region: &'a Region,
    law: &'a Law,
    /// A rule of few points.
    rough: Law,
    jammer: Jammer<'a>,
    pair: [Vector3<f64>; 2],
    /// s of one step, bit/s/Hz.
    step: f64,
    /// ln(2^s - 1) of each step.
    wanted: Vec<f64>,
    stack: Vec<Node>,
    resolution_m: f64,
    boxes: usize,
    /// What the rate asked for says of negative draws, where they are bounded.
    asked: Option<Asked>,
    /// `E b_0` over `2^l` is at most this.
    spread: f64,
    /// Of each mean for its quadrature, roughly and finely.
    margins: [f64; 2],
    /// Whether negative draws are bounded: there are some, and nothing is scattered.
    clips: bool,
}

impl<'a> Search<'a> {
    pub fn new(
        links: &'a Links,
        region: &'a Region,
        law: &'a Law,
        pair: [Vector3<f64>; 2],
        resolution_m: f64,
    ) -> Self {
        // No jammer does more than full power from the nearest position.
        let most =
            pair.iter().map(|e| links.rho.j / region.bounds.least_distance_squared(e)).fold(0.0, f64::max);
        let jitters = law.variance() > 0.0;
        let step = (most.ln_1p() / LN_2 * (1.0 + 1e-12) / f64::from(STEPS)).max(1e-6);
        Self {
            links,
            region,
            law,
            rough: Law::new(law.variance().sqrt(), ROUGH_POINTS),
            jammer: Jammer::new(law, region, links, pair),
            pair,
            step,
            wanted: (0..=STEPS).map(|s| (f64::from(s) * step * LN_2).exp_m1().ln()).collect(),
            stack: Vec::with_capacity(4096),
            resolution_m,
            boxes: 0,
            asked: None,
            spread: if jitters { SPREAD } else { 1.0 } * if links.scatters { SCATTERED_SPREAD } else { 1.0 },
            margins: if jitters { [ROUGH_QUADRATURE, QUADRATURE] } else { [0.0; 2] },
            clips: jitters && !links.scatters,
        }
    }

    /// Boxes of both sides, in boxes of I.
    pub fn used(&self) -> usize {
        self.boxes + self.jammer.boxes / JAMMER_BOXES
    }

    /// Whether some configuration's rate exceeds `threshold`.
    pub fn run(&mut self, threshold: f64, limit: usize) -> Outcome {
        self.ask(threshold);
        let power = (threshold * LN_2).exp();
        if power <= 2.0 * self.spread {
            return Outcome::Stuck;
        }
        let [rough, fine] = self.margins;
        let wanted = threshold - self.correction(threshold) - 2.0 * fine;
        let roughly = wanted - (rough - fine);
        let reach = (self.links.rho.i / (power - 1.0)).sqrt() * (1.0 + 1e-9);
        self.stack.clear();
        let Some(position) = self.region.bounds.cut_to(reach) else { return Outcome::Excluded };
        let whole = [[0, STEPS]; 2];
        self.stack.push(Node { position, roll: ALL_ANGLES, pitch: ALL_ANGLES, s: whole });
        while let Some(mut node) = self.stack.pop() {
            if self.used() >= limit {
                return Outcome::Exhausted;
            }
            self.boxes += 1;
            if self.region.excludes(&node.position) {
                continue;
            }
            if let Some(whole) = self.tighten(&mut node, Rule::Rough, roughly)
                && !self.branch(&mut node, &whole, wanted)
            {
                return Outcome::Stuck;
            }
        }
        Outcome::Excluded
    }

    /// Whether L at a corner of the interface's grid is shown to be at least `least`.
    fn harms(&mut self, s: [u16; 2], least: f64) -> bool {
        self.jammer.harms(s.map(|s| self.wanted[usize::from(s)]), least)
    }

    /// Shrinks the node's interface box, again while a lower corner makes a lower rate; `None` if nothing is left.
    fn tighten(&mut self, node: &mut Node, rule: Rule, wanted: f64) -> Option<Corner> {
        loop {
            let before = node.s;
            let rate = match rule {
                Rule::Rough => self.rate(node, &self.rough),
                Rule::Fine => self.rate(node, self.law),
            };
            let corner = Corner { s: before, rate: rate.at([0.0; 2]) };
            if corner.rate <= wanted || !self.shrink(node, &rate, wanted) {
                return None;
            }
            let fell = |k: usize| f64::from(before[k][1] - node.s[k][1]) * self.step;
            if fell(0) + fell(1) < AGAIN {
                return Some(corner);
            }
        }
    }

    /// Shrinks the node's interface box to where the rate less L is not shown to stay below `wanted`; false if that is
    /// nowhere.
    fn shrink(&mut self, node: &mut Node, rate: &Rate, wanted: f64) -> bool {
        if self.harms(node.s.map(|s| s[0]), rate.at([0.0; 2]) - wanted) {
            return false;
        }
        let [[lo_a, hi_a], [lo_b, hi_b]] = node.s;
        // Corners at multiples of powers of two: boxes share what L is asked for.
        let part = node.s.map(|[lo, hi]| (hi - lo).div_ceil(PARTS).next_power_of_two());
        let mut left = [[u16::MAX, 0]; 2];
        let mut a = lo_a - lo_a % part[0];
        while a < hi_a {
            let a_hi = (a + part[0]).min(hi_a);
            let mut b = lo_b - lo_b % part[1];
            while b < hi_b {
                let b_hi = (b + part[1]).min(hi_b);
                let below = [hi_a - a_hi, hi_b - b_hi].map(|s| f64::from(s) * self.step);
                if !self.harms([a, b], rate.at(below) - wanted) {
                    left = [
                        [left[0][0].min(a.max(lo_a)), left[0][1].max(a_hi)],
                        [left[1][0].min(b.max(lo_b)), left[1][1].max(b_hi)],
                    ];
                }
                b = b_hi;
            }
            a = a_hi;
        }
        node.s = left;
        left[0][0] < left[0][1]
    }

    /// The split that promises most: of the pose as given, or 2 and 3 for the interface's sides.
    fn widest(&self, node: &Node, pose: (f64, usize)) -> (f64, usize) {
        let mut choice = pose;
        for (k, [lo, hi]) in node.s.into_iter().enumerate() {
            let range = f64::from(hi - lo) * self.step;
            let loss = range / f64::from(PARTS) + BEND * range * range;
            if hi - lo > 1 && loss > choice.0 {
                choice = (loss, 2 + k);
            }
        }
        choice
    }

    /// Halves a box where its bound, as taken for `whole`, loses most; false if it is too small for that.
    fn branch(&mut self, node: &mut Node, whole: &Corner, wanted: f64) -> bool {
        let middle = |r: Range| [0.5 * (r[0] + r[1]); 2];
        let corner = Node { s: whole.s, ..*node };
        let placed = Node { position: Cell::at(&node.position.centre()), ..corner };
        let turned = Node { roll: middle(node.roll), pitch: middle(node.pitch), ..corner };
        let loss_place = whole.rate - self.rate(&placed, &self.rough).at([0.0; 2]);
        let loss_turn = whole.rate - self.rate(&turned, &self.rough).at([0.0; 2]);
        let pose = if loss_place > loss_turn { (loss_place, 0) } else { (loss_turn, 1) };
        let mut choice = self.widest(node, pose);
        if choice.0 < FINE_BELOW {
            if self.tighten(node, Rule::Fine, wanted).is_none() {
                return true;
            }
            choice = self.widest(node, pose);
        }
        match choice.1 {
            0 => {
                let (axis, length) = node.position.longest_edge();
                if length < self.resolution_m {
                    return false;
                }
                self.stack.extend(node.position.split(axis).map(|position| Node { position, ..*node }));
            }
            1 => {
                let (across_roll, across_pitch) =
                    (node.roll[1] - node.roll[0], node.pitch[1] - node.pitch[0]);
                // At the pole pitch turns nothing, and yet the bound loses by it.
                let cos = node.roll[0].cos().max(node.roll[1].cos()).max(LEAST_COSINE);
                if across_roll.max(across_pitch) < 1e-6 {
                    return false;
                }
                if across_roll > across_pitch * cos {
                    self.stack.extend(halves(node.roll).map(|roll| Node { roll, ..*node }));
                } else {
                    self.stack.extend(halves(node.pitch).map(|pitch| Node { pitch, ..*node }));
                }
            }
            k => {
                let k = k - 2;
                let [lo, hi] = node.s[k];
                let middle = u16::midpoint(lo, hi);
                for part in [[lo, middle], [middle, hi]] {
                    let mut half = *node;
                    half.s[k] = part;
                    self.stack.push(half);
                }
            }
        }
        true
    }

    /// An upper bound on `log2(1 + E a_0) - E max_j log2(1 + a_j 2^-s_j)` over a box of poses, and on what negative rates add.
    fn rate(&self, node: &Node, law: &Law) -> Rate {
        self.rate_at(node, law, node.s.map(|s| f64::from(s[1]) * self.step))
    }

    fn rate_at(&self, node: &Node, law: &Law, s: [f64; 2]) -> Rate {
        let (centre, radius) = (node.position.centre(), node.position.radius());
        let distance = centre.norm();
        let (roll_mid, pitch_mid) =
            (0.5 * (node.roll[0] + node.roll[1]), 0.5 * (node.pitch[0] + node.pitch[1]));
        let turn = (node.roll[1] - roll_mid).hypot(node.pitch[1] - pitch_mid);
        let moment = law.second_moment(roll_mid, pitch_mid);
        let sine_squared = |u: &Vector3<f64>| (1.0 - u.dot(&(moment * u))).clamp(0.0, 1.0);
        let (along, off) = if distance > 0.0 {
            let (u, seen) = (centre / distance, chord(radius, distance));
            let axis = antenna_axis(roll_mid, pitch_mid, 0.0);
            // The angle between axis and line over the box: no less than this.
            let off = u.dot(&axis).abs().min(1.0).acos() - turn - 2.0 * (0.5 * seen).min(1.0).asin();
            ((u.dot(&(moment * u)).max(0.0).sqrt() - seen - turn).max(0.0), off.max(0.0))
        } else {
            (0.0, 0.0)
        };
        let mean = self.links.user.i.mean;
        let nearest = node.position.least_distance_squared(&Vector3::zeros());
        let user = (self.links.rho.i / nearest * (mean.most() - mean.swing * along * along)).ln_1p() / LN_2;
        let mut scale = [0.0; 2];
        let mut directions = [Vector3::z(); 2];
        let mut blur = 0.0;
        // Of each eavesdropper's least gains the one that counts for most about the centre.
        let mut gains = [self.links.eavesdropper.i.least[0]; 2];
        for k in 0..2 {
            let e = &self.pair[k];
            let farthest = node.position.greatest_distance_squared(e);
            scale[k] = self.links.rho.i / farthest * (-s[k] * LN_2).exp();
            let line = e - centre;
            let length = line.norm();
            blur += (radius / length.max(radius)).asin();
            if length > 0.0 {
                directions[k] = line / length;
            }
            let sine_squared = sine_squared(&directions[k]);
            for gain in &self.links.eavesdropper.i.least {
                if gain.at(sine_squared) > gains[k].at(sine_squared) {
                    gains[k] = *gain;
                }
            }
        }
        let floor = both_floor([0, 1].map(|k| scale[k] * gains[k].swing), &directions, blur);
        let share = if self.clips { LOUDEST } else { f64::INFINITY };
        let least = floor.ln_1p() / LN_2;
        let mut heard = [(least, 0.0); 2];
        let mut most = least;
        for k in 0..2 {
            if scale[k] * gains[k].most() <= floor {
                continue;
            }
            let e = &self.pair[k];
            let line = line_angles(&(node.position.lo - e), &(node.position.hi - e))
                .unwrap_or([ALL_ANGLES, [-std::f64::consts::PI, std::f64::consts::PI]]);
            let offset = Offset::new([node.roll, node.pitch], line);
            let Least { mean, rise, most: up_to } = gained(law, gains[k], scale[k], floor, share, &offset);
            heard[k] = (mean, rise);
            most = most.max(up_to);
        }
        let negative = self.asked.map_or(Negative::NONE, |asked| {
            let farthest = node.position.greatest_distance_squared(&Vector3::zeros());
            let sinr = |sine_squared: f64| self.links.rho.i / farthest * mean.at(sine_squared);
            Negative::new(&asked, law.variance().sqrt(), off, user, most, sinr)
        });
        Rate { user, heard, negative }
    }

    /// What step 1 adds at a threshold, `log2(1 + S / (2^T - S))`.
    fn correction(&self, threshold: f64) -> f64 {
        (self.spread / ((threshold * LN_2).exp() - self.spread)).ln_1p() / LN_2
    }

    /// Takes up a threshold.
    fn ask(&mut self, threshold: f64) {
        self.asked = self.clips.then(|| Asked::new(threshold, self.spread, self.correction(threshold)));
    }
}

/// An upper bound on `log2(1 + E a_0) - E max_j log2(1 + a_j 2^-s_j)` below a corner of the interface.
struct Rate {
    user: f64,
    /// Of each eavesdropper: the mean at the corner, and how fast it rises as s falls. It is convex in s.
    heard: [(f64, f64); 2],
    negative: Negative,
}

impl Rate {
    /// The bound `below` the corner.
    fn at(&self, below: [f64; 2]) -> f64 {
        let [(a, rise_a), (b, rise_b)] = self.heard;
        let heard = (a + rise_a * below[0]).max(b + rise_b * below[1]);
        self.user - heard + self.negative.part(heard, below[0].max(below[1]))
    }
}

/// [`Law::least_within`] of a gain that is not all swing; `most` in bit/s/Hz.
fn gained(law: &Law, gain: Gain, scale: f64, floor: f64, share: f64, offset: &Offset) -> Least {
    let (flat, scale) = gain.apart(scale);
    let floor = ((1.0 + floor) / flat - 1.0).max(0.0);
    let least = law.least_within(scale, floor, share, offset);
    let more = flat.log2();
    // The whole rises no slower: by what the flat part adds where nothing ends the range.
    Least { mean: more + least.mean, most: more + least.most.ln_1p() / LN_2, ..least }
}

/// The least of the larger of two SINRs `scale_k sin^2 psi_k` over all axes: the angles to two lines add up to at
/// least the angle between them, less what the box blurs.
fn both_floor(scale: [f64; 2], directions: &[Vector3<f64>; 2], blur: f64) -> f64 {
    let cosine = directions[0].dot(&directions[1]).abs().min(1.0);
    let angle = cosine.acos() - blur;
    if angle <= 0.0 {
        return 0.0;
    }
    let root = scale.map(f64::sqrt);
    let (sin, cos) = angle.sin_cos();
    let first = (root[1] * sin).atan2(root[0] + root[1] * cos);
    (root[0] * first.sin()).powi(2)
}

fn halves(range: Range) -> [Range; 2] {
    let middle = 0.5 * (range[0] + range[1]);
    [[range[0], middle], [middle, range[1]]]
}

#[cfg(test)]
impl Search<'_> {
    /// The whole chain at one configuration: the bound on its rate, the interface from its own `E b_j`; and whether the
    /// table of L stays below the bound on its own l there.
    pub fn relaxed_rate(
        &mut self,
        poses: [(Vector3<f64>, f64, f64); 2],
        power_share: f64,
        threshold: f64,
    ) -> (f64, bool) {
        let [(p_i, roll_i, pitch_i), (p_j, roll_j, pitch_j)] = poses;
        self.ask(threshold);
        let mean = self.links.eavesdropper.j.mean;
        let moment = self.law.second_moment(roll_j, pitch_j);
        let jamming = self.pair.map(|e| {
            let line = e - p_j;
            let u = line.normalize();
            self.links.rho.j * power_share * mean.at(1.0 - u.dot(&(moment * u))) / line.norm_squared()
        });
        let node = Node { position: Cell::at(&p_i), roll: [roll_i; 2], pitch: [pitch_i; 2], s: [[0, 0]; 2] };
        let rate = self.rate_at(&node, self.law, jamming.map(|b| b.ln_1p() / LN_2)).at([0.0; 2]);
        let harm = self.jammer.harm_at(&p_j, roll_j, pitch_j, jamming);
        // The law at a point and over a class differ by rounding alone where the class is tight.
        let below = !self.jammer.harms(jamming.map(f64::ln), harm + 1e-6);
        (rate - harm + self.correction(threshold) + 2.0 * self.margins[1], below)
    }
}
