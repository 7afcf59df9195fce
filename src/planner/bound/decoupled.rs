//! The decoupled bound under jitter (the module's section 3).

use std::f64::consts::LN_2;

use nalgebra::Vector3;

use super::cell::{Cell, Region};
use super::form::{Form, Mixture, exclude_mixtures};
use super::frame::Sight;
use super::hearing::{Curve, Hearing, LOUDEST};
use super::jammer::Jammer;
use super::law::{ALL_ANGLES, Law, line_angles};
use super::link::Links;
use super::negative::Asked;
use super::steady::{MARGIN, Outcome, chord, excess, split_share};

/// E b_0 over 2^l: at most 2 e^gamma = 3.56 for a null under noise of one angle; with a quarter to spare.
const SPREAD: f64 = 4.5;
/// So many times more with scattered waves: e^gamma.
const SCATTERED_SPREAD: f64 = 1.7811;
/// Eavesdroppers heeded at most: more of them take longer to show the same.
pub(super) const MOST: usize = 3;
/// Steps of the interface, a power of two.
const STEPS: u16 = 1024;
/// Line searches for a combination of forms.
const SEARCHES: usize = 12;
/// Times that the least harm to the user is asked for at one box.
const ROUNDS: usize = 4;
/// Beyond what a box's rate asks for, bit/s/Hz.
const BEYOND: f64 = 0.01;
/// Angles between I's axis and the line to the user, degrees, between which what negative draws add is bounded at once.
const BANDS_DEG: [f64; 9] = [90.0, 80.0, 70.0, 58.0, 45.0, 32.0, 20.0, 10.0, 0.0];
/// So many of these lie away from the null: what is nearer is excluded by itself.
const BANDS_AWAY: usize = 3;
/// Parts of each side of an interface box in which the rate and L are compared, by the eavesdroppers heeded.
const PARTS: [u16; MOST] = [8, 8, 4];
/// Edges of these parts, which need not begin at one, at most.
const EDGES: usize = 10;
/// An interface box that falls by this, bit/s/Hz, has the rate bounded anew.
const AGAIN: f64 = 0.2;
/// Labels of inequalities: eavesdroppers and the floor.
const LABELS: usize = MOST + 1;
/// Where nothing loses more than this, bit/s/Hz, the fine table is used.
const FINE_BELOW: f64 = 0.2;
/// Edges of a box that are no longer than this share of its longest are not split.
const SHORT: f64 = 0.2;
/// Boxes of J that take the time of one of I.
const JAMMER_BOXES: usize = 40;
/// Margin of each mean for its quadrature, bit/s/Hz: twice what was measured (the tests of `law`).
pub(super) const QUADRATURE: f64 = 0.008;

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

/// The user and the eavesdroppers seen from I's box.
struct View {
    /// SINR at a gain of one, from the nearest point; gain across the axis, its swing.
    gain: f64,
    across: f64,
    depth: f64,
    /// Direction to the user, and by how much the box and the noise may lessen its cosine.
    towards: Vector3<f64>,
    chord: f64,
    /// `1 + E a_0`, and what negative draws add to its logarithm, are below this.
    away: Majorant,
    /// The same of axes nearer to the user's null, where that exceeds it: by the lesser of two.
    near: Option<[Majorant; 2]>,
    lines: Vec<Line>,
    /// Below this no axis lets eavesdroppers hear.
    floor: f64,
    /// How fast what each hears rises with what it hears at all, and the floor, at least.
    rises: [f64; LABELS],
}

/// `base + slope E a_0`.
#[derive(Debug, Clone, Copy)]
struct Majorant {
    base: f64,
    slope: f64,
}

impl Majorant {
    fn at(&self, sinr: f64) -> f64 {
        self.base + self.slope * sinr
    }

    /// The lesser there.
    fn least(majorants: &[Self], sinr: f64) -> Self {
        majorants
            .iter()
            .fold(majorants[0], |least, &other| if other.at(sinr) < least.at(sinr) { other } else { least })
    }
}

/// An eavesdropper seen from I's box.
struct Line {
    eavesdropper: usize,
    direction: Vector3<f64>,
    /// How far the direction is off over the box.
    spread: f64,
    curve: Curve,
}

impl Line {
    /// `2^` of what is heard at an axis.
    fn heard(&self, axis: &Vector3<f64>) -> f64 {
        let kept = (axis.cross(&self.direction).norm() - self.spread).max(0.0);
        self.curve.at(kept * kept).0
    }
}

impl View {
    /// An upper bound on the user's mean SINR.
    fn sinr(&self, cosine: f64) -> f64 {
        let away = (cosine - self.chord).max(0.0);
        self.gain * (self.across - self.depth * away * away)
    }

    /// An upper bound on the rate at an axis, bit/s/Hz.
    fn rate(&self, axis: &Vector3<f64>) -> f64 {
        let loudest = self.lines.iter().map(|line| line.heard(axis)).fold(self.floor, f64::max);
        let cosine = axis.dot(&self.towards).abs();
        let edge = BANDS_DEG[BANDS_AWAY].to_radians().cos();
        let sinr = self.sinr(cosine);
        let away = self.away.at(sinr);
        // From some of the box's positions one and the same axis may lie on either side of the edge.
        let user = match &self.near {
            Some(near) if cosine > edge - self.chord => {
                let near = Majorant::least(near, sinr).at(sinr);
                if cosine > edge + self.chord { near } else { near.max(away) }
            }
            _ => away,
        };
        (user / loudest).min(1.0 + sinr).log2()
    }

    /// The largest in the mean of the inequalities `2^t` times what is heard less the user's at a mixture of axes, and its form.
    fn tightest(&self, user: &[Majorant], &(axes, first): &Mixture, power: f64) -> (f64, Form, usize) {
        let mean =
            |value: &dyn Fn(&Vector3<f64>) -> f64| first * value(&axes[0]) + (1.0 - first) * value(&axes[1]);
        let cosine = mean(&|y| y.dot(&self.towards).powi(2)).sqrt();
        let share = split_share(self.chord, cosine);
        let sinr = self.sinr(cosine);
        let user = Majorant::least(user, sinr);
        let gain = user.slope * self.gain;
        let wanted = Form::new(
            user.base + gain * (self.across + self.depth * excess(share, self.chord)),
            gain * self.depth * (1.0 - share),
            &self.towards,
        );
        let (mut value, mut form, mut label) =
            (self.floor, Form::new(power * self.floor, 0.0, &self.towards), MOST);
        for line in &self.lines {
            let sine = mean(&|y| y.cross(&line.direction).norm_squared()).sqrt();
            let (here, [a, b]) = line.curve.at((sine - line.spread).max(0.0).powi(2));
            if here > value {
                let share = split_share(line.spread, sine);
                (value, label) = (here, line.eavesdropper);
                let kept = b * (1.0 - share);
                form = Form::new(
                    power * (a - b * excess(share, line.spread) + kept),
                    power * kept,
                    &line.direction,
                );
            }
        }
        (power * value - user.at(sinr), form.plus(-1.0, &wanted), label)
    }
}

/// The search over I and the interface.
#[derive(Debug)]
pub(super) struct Search<'a> {
    links: &'a Links,
    region: &'a Region,
    law: &'a Law,
    hearing: Hearing,
    /// Of each pair of the eavesdroppers heeded.
    jammers: Vec<([usize; 2], Jammer<'a>)>,
    heeded: Vec<Vector3<f64>>,
    /// s of one step, bit/s/Hz.
    step: f64,
    /// ln(2^s - 1) of each step.
    wanted: Vec<f64>,
    stack: Vec<Node>,
    resolution_m: f64,
    boxes: usize,
    /// What the rate asked for says of negative draws, where they are bounded.
    asked: Option<Asked>,
    /// 2^ of the rate asked for, less all margins.
    least: f64,
    /// `E b_0` over `2^l` is at most this.
    spread: f64,
    /// Of each mean for its quadrature.
    margin: f64,
    /// Whether negative draws are bounded: there are some, and nothing is scattered.
    clips: bool,
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
        let jitters = law.variance() > 0.0;
        let step = (most.ln_1p() / LN_2 * (1.0 + 1e-12) / f64::from(STEPS)).max(1e-6);
        let count = heeded.len();
        let mut pairs: Vec<[usize; 2]> =
            (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b])).collect();
        if pairs.is_empty() {
            pairs.push([0, 0]);
        }
        let jammer = |pair: [usize; 2]| (pair, Jammer::new(law, region, links, pair.map(|k| heeded[k])));
        Self {
            links,
            region,
            law,
            hearing: Hearing::new(law.variance().sqrt()),
            jammers: pairs.into_iter().map(jammer).collect(),
            heeded,
            step,
            wanted: (0..=STEPS).map(|s| (f64::from(s) * step * LN_2).exp_m1().ln()).collect(),
            stack: Vec::with_capacity(4096),
            resolution_m,
            boxes: 0,
            asked: None,
            least: 1.0,
            spread: if jitters { SPREAD } else { 1.0 } * if links.scatters { SCATTERED_SPREAD } else { 1.0 },
            margin: if jitters { QUADRATURE } else { 0.0 },
            clips: jitters && !links.scatters,
        }
    }

    /// Boxes of both sides, in boxes of I.
    pub fn used(&self) -> usize {
        self.boxes + self.jammers.iter().map(|(_, jammer)| jammer.boxes).sum::<usize>() / JAMMER_BOXES
    }

    /// Whether some configuration's rate exceeds `threshold`.
    pub fn run(&mut self, threshold: f64, limit: usize) -> Outcome {
        let power = (threshold * LN_2).exp();
        if power <= 2.0 * self.spread {
            return Outcome::Stuck;
        }
        let wanted = self.ask(threshold);
        let reach = (self.links.rho.i / (power - 1.0)).sqrt() * (1.0 + 1e-9);
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
        let count = self.heeded.len();
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
        for leader in std::iter::once(None).chain((0..self.heeded.len()).map(Some)) {
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
        for k in 0..self.heeded.len() {
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
        let heeded = &node.s[..self.heeded.len()];
        let range = heeded.iter().map(|[lo, hi]| f64::from(hi - lo) * self.step).fold(0.0, f64::max);
        self.view_at(position, at, range, node.fine, node.leader)
    }

    /// The same of an interface in bit/s/Hz, and of one that is lower by `range` at most.
    fn view_at(
        &mut self,
        position: &Cell,
        s: [f64; MOST],
        range: f64,
        fine: bool,
        leader: Option<usize>,
    ) -> View {
        let centre = position.centre();
        let distance = centre.norm();
        let towards = if distance > 0.0 { centre / distance } else { Vector3::z() };
        let mean = self.links.user.i.mean;
        let leader = leader.map(|k| (k, Sight::new(position, &self.heeded[k])));
        let drift = |node: &Vector3<f64>| {
            leader.as_ref().map(|(_, leader)| Sight::new(position, node).drift(position, leader))
        };
        let user = Vector3::zeros();
        let seen = drift(&user).unwrap_or_else(|| chord(position.spread(&user, &-towards), 1.0));
        let farthest = position.greatest_distance_squared(&user);
        let nearest = position.least_distance_squared(&user);
        let gain = self.links.rho.i / nearest;
        // Where the user is farther than that it hears less, and eavesdroppers by no smaller a factor; its rate falls nearly as much.
        let slack = (farthest / nearest).log2() / self.least;
        let count = self.heeded.len();
        let mut lines = Vec::with_capacity(count);
        let (mut most, mut above) = (0.0_f64, 0.0_f64);
        let mut rises = [1.0_f64; LABELS];
        let mut seen_at = [(0.0, Vector3::z(), 2.0); MOST];
        for (k, e) in self.heeded.iter().enumerate() {
            let faintest = (self.links.rho.i / position.greatest_distance_squared(e))
                .max(gain * position.least_ratio(e) * (1.0 - MARGIN));
            let scale = faintest * (-s[k] * LN_2).exp();
            let line = e - centre;
            let length = line.norm();
            let direction = if length > 0.0 { line / length } else { Vector3::z() };
            let spread = match &leader {
                Some((leader, _)) if *leader == k => MARGIN,
                _ => drift(e).unwrap_or_else(|| position.spread(e, &direction)),
            };
            seen_at[k] = (scale, direction, spread);
        }
        let swing = self.links.eavesdropper.i.least.iter().map(|gain| gain.swing).fold(0.0, f64::max);
        let mut floor = 0.0_f64;
        for (k, (scale, direction, spread)) in seen_at[..count].iter().enumerate() {
            for (other, towards, blur) in &seen_at[..k] {
                let blur = spread.min(1.0).asin() + blur.min(1.0).asin();
                floor = floor.max(both_floor([scale * swing, other * swing], [direction, towards], blur));
            }
        }
        for (k, e) in self.heeded.iter().enumerate() {
            let (scale, direction, spread) = seen_at[k];
            let roll =
                line_angles(&(position.lo - e), &(position.hi - e)).map_or(ALL_ANGLES, |[roll, _]| roll);
            for gain in &self.links.eavesdropper.i.least {
                let curve = self.hearing.curve(gain, scale, floor, roll, self.clips, fine);
                above = above.max(curve.above + (1.0 - curve.rise) * range);
                rises[k] = rises[k].min(curve.rise);
                most = most.max((LOUDEST * scale).ln_1p() / LN_2 + range);
                lines.push(Line { eavesdropper: k, direction, spread, curve });
            }
        }
        let mut view = View {
            gain,
            across: mean.most(),
            depth: mean.swing,
            towards,
            // The mean of a noisy axis is shorter than it by the noise's variance at most.
            chord: seen + self.law.variance(),
            away: Majorant { base: slack.exp2(), slope: slack.exp2() },
            near: None,
            lines,
            floor: 1.0 + floor,
            rises: {
                rises[MOST] = floor / (1.0 + floor);
                rises
            },
        };
        if let Some(asked) = &self.asked {
            let sinr = |sine_squared: f64| self.links.rho.i / farthest * mean.at(sine_squared);
            let std = self.law.variance().sqrt();
            // No more is added than is heard.
            let loudest = view.lines.iter().map(|line| line.curve.at(1.0).0).fold(view.floor, f64::max);
            let all = loudest.log2() + range;
            let mut near = [Majorant { base: 0.0, slope: 0.0 }; 2];
            for (k, band) in BANDS_DEG.windows(2).enumerate() {
                let [off_hi, off_lo] = [band[0], band[1]].map(f64::to_radians);
                // Angles are those from where I is, which the box does not blur.
                let cosine = (off_hi.cos() - self.law.variance()).max(0.0);
                let user = view.gain * (view.across - view.depth * cosine * cosine);
                let rate = user.ln_1p() / LN_2;
                let added = asked.added(std, off_lo, rate, [most, above], sinr).min(all) + slack;
                let whole = (1.0 + user) * added.exp2();
                let away = &mut view.away;
                if k == 0 {
                    *away = Majorant { base: added.exp2(), slope: added.exp2() };
                    near[0].slope = away.slope;
                } else if whole > self.least && k < BANDS_AWAY {
                    away.base = away.base.max(whole - away.slope * user);
                } else if whole > self.least {
                    for near in &mut near {
                        near.base = near.base.max(whole - near.slope * user);
                    }
                }
            }
            view.near = Some(near).filter(|near| near[0].base > view.away.base);
        }
        view
    }

    /// What step 1 adds at a threshold, `log2(1 + S / (2^T - S))`.
    fn correction(&self, threshold: f64) -> f64 {
        (self.spread / ((threshold * LN_2).exp() - self.spread)).ln_1p() / LN_2
    }

    /// Takes up a threshold; what the rate less L has to exceed.
    fn ask(&mut self, threshold: f64) -> f64 {
        let correction = self.correction(threshold);
        let wanted = threshold - correction - 2.0 * self.margin;
        self.least = wanted.exp2();
        self.asked = self.clips.then(|| Asked::new(threshold, self.spread, correction));
        wanted
    }
}

/// The least of the larger of two SINRs `scale_k sin^2 psi_k` over all axes: the angles to two lines add up to at
/// least the angle between them, less what the box blurs.
fn both_floor(scale: [f64; 2], directions: [&Vector3<f64>; 2], blur: f64) -> f64 {
    let cosine = directions[0].dot(directions[1]).abs().min(1.0);
    let angle = cosine.acos() - blur;
    if angle <= 0.0 {
        return 0.0;
    }
    let root = scale.map(f64::sqrt);
    let (sin, cos) = angle.sin_cos();
    let first = (root[1] * sin).atan2(root[0] + root[1] * cos);
    (root[0] * first.sin()).powi(2)
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
        self.ask(threshold);
        let cell = Cell { lo, hi };
        let told = leader.map_or(*axis, |k| {
            let [from, to] = [p, cell.centre()].map(|at| self.heeded[k] - at);
            nalgebra::Rotation3::rotation_between(&from, &to).unwrap_or_default() * axis
        });
        let boxed = self.view_at(&cell, s, 0.0, true, leader).rate(&told);
        [boxed, self.view_at(&Cell::at(&p), s, 0.0, true, None).rate(axis)]
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
        let wanted = self.ask(threshold);
        let mean = self.links.eavesdropper.j.mean;
        let moment = self.law.second_moment(roll_j, pitch_j);
        let jamming = [0, 1].map(|k| {
            let line = self.heeded[k] - p_j;
            let u = line.normalize();
            self.links.rho.j * power_share * mean.at(1.0 - u.dot(&(moment * u))) / line.norm_squared()
        });
        let axis = crate::radio::pattern::antenna_axis(roll_i, pitch_i, 0.0);
        let mut s = [0.0; MOST];
        s[..2].copy_from_slice(&jamming.map(|b| b.ln_1p() / LN_2));
        let view = self.view_at(&Cell::at(&p_i), s, 0.0, true, None);
        let rate = view.rate(&axis);
        let jammer = &mut self.jammers[0].1;
        let harm = jammer.harm_at(&p_j, roll_j, pitch_j, jamming);
        // The law at a point and over a class differ by rounding alone where the class is tight.
        let below = jammer.harms(jamming.map(f64::ln), harm + 1e-6) < harm + 1e-6;
        (rate - harm + threshold - wanted, below)
    }
}
