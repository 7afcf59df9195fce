//! I's boxes as the decoupled bound sees them (the module's section 3, step 7): what user and eavesdroppers make of an axis there.

use std::f64::consts::LN_2;

use nalgebra::Vector3;

use super::cell::Cell;
use super::form::{Form, Mixture};
use super::frame::Sight;
use super::hearing::{Curve, Hearing, LOUDEST};
use super::law::{ALL_ANGLES, Law, line_angles};
use super::link::Links;
use super::negative::Asked;
use super::steady::{MARGIN, chord, excess, split_share};

/// E b_0 over 2^l: at most 2 e^gamma = 3.56 for a null under noise of one angle; with a quarter to spare.
const SPREAD: f64 = 4.5;
/// So many times more with scattered waves: e^gamma.
const SCATTERED_SPREAD: f64 = 1.7811;
/// Eavesdroppers heeded at most: more of them take longer to show the same.
pub(super) const MOST: usize = 3;
/// Angles between I's axis and the line to the user, degrees, between which what negative draws add is bounded at once.
const BANDS_DEG: [f64; 9] = [90.0, 80.0, 70.0, 58.0, 45.0, 32.0, 20.0, 10.0, 0.0];
/// So many of these lie away from the null: what is nearer is excluded by itself.
const BANDS_AWAY: usize = 3;
/// Labels of inequalities: eavesdroppers and the floor.
pub(super) const LABELS: usize = MOST + 1;
/// Margin of each mean for its quadrature, bit/s/Hz: twice what was measured (the tests of `law`).
pub(super) const QUADRATURE: f64 = 0.008;

/// The user and the eavesdroppers seen from I's box.
pub(super) struct View {
    /// SINR at a gain of one, from the nearest point; gain across the axis, its swing.
    gain: f64,
    across: f64,
    depth: f64,
    /// Direction to the user, and by how much the box and the noise may lessen its cosine.
    towards: Vector3<f64>,
    chord: f64,
    /// `1 + E a_0`, and what negative draws add to its logarithm, are below this.
    pub away: Majorant,
    /// The same of axes nearer to the user's null, where that exceeds it: by the lesser of two.
    pub near: Option<[Majorant; 2]>,
    lines: Vec<Line>,
    /// Below this no axis lets eavesdroppers hear.
    floor: f64,
    /// How fast what each hears rises with what it hears at all, and the floor, at least.
    pub rises: [f64; LABELS],
}

/// `base + slope E a_0`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Majorant {
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
    pub fn sinr(&self, cosine: f64) -> f64 {
        let away = (cosine - self.chord).max(0.0);
        self.gain * (self.across - self.depth * away * away)
    }

    /// An upper bound on the rate at an axis, bit/s/Hz.
    pub fn rate(&self, axis: &Vector3<f64>) -> f64 {
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
    pub fn tightest(&self, user: &[Majorant], &(axes, first): &Mixture, power: f64) -> (f64, Form, usize) {
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

/// What all boxes have in common, and what a threshold says of it.
#[derive(Debug)]
pub(super) struct Views<'a> {
    pub links: &'a Links,
    pub law: &'a Law,
    hearing: Hearing,
    /// The eavesdroppers heeded, relative to the user, metres.
    pub heeded: Vec<Vector3<f64>>,
    /// What the rate asked for says of negative draws, where they are bounded.
    asked: Option<Asked>,
    /// 2^ of the rate asked for, less all margins.
    least: f64,
    /// `E b_0` over `2^l` is at most this.
    pub spread: f64,
    /// Of each mean for its quadrature.
    margin: f64,
    /// Whether negative draws are bounded: there are some, and nothing is scattered.
    clips: bool,
}

impl<'a> Views<'a> {
    pub fn new(links: &'a Links, law: &'a Law, heeded: Vec<Vector3<f64>>) -> Self {
        let jitters = law.variance() > 0.0;
        Self {
            links,
            law,
            hearing: Hearing::new(law.variance().sqrt()),
            heeded,
            asked: None,
            least: 1.0,
            spread: if jitters { SPREAD } else { 1.0 } * if links.scatters { SCATTERED_SPREAD } else { 1.0 },
            margin: if jitters { QUADRATURE } else { 0.0 },
            clips: jitters && !links.scatters,
        }
    }

    /// What step 1 adds at a threshold, `log2(1 + S / (2^T - S))`.
    fn correction(&self, threshold: f64) -> f64 {
        (self.spread / ((threshold * LN_2).exp() - self.spread)).ln_1p() / LN_2
    }

    /// Takes up a threshold; what the rate less L has to exceed.
    pub fn ask(&mut self, threshold: f64) -> f64 {
        let correction = self.correction(threshold);
        let wanted = threshold - correction - 2.0 * self.margin;
        self.least = wanted.exp2();
        self.asked = self.clips.then(|| Asked::new(threshold, self.spread, correction));
        wanted
    }

    /// What bounds the rate over a box of positions, for an interface in bit/s/Hz and for one that is lower by `range` at most; axes are
    /// told in the frame that turns with the line to `leader`, or in one that stands still.
    pub fn at(
        &mut self,
        position: &Cell,
        s: [f64; MOST],
        range: f64,
        fine: bool,
        leader: Option<usize>,
    ) -> View {
        let mean = self.links.user.i.mean;
        let leader = leader.map(|k| (k, Sight::new(position, &self.heeded[k])));
        let user = Vector3::zeros();
        let sight = Sight::new(position, &user);
        let towards = sight.direction;
        let seen = match &leader {
            Some((_, leader)) => sight.drift(position, leader),
            None => chord(position.spread(&user, &towards), 1.0),
        };
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
            let sight = Sight::new(position, e);
            let spread = match &leader {
                Some((leader, _)) if *leader == k => MARGIN,
                Some((_, leader)) => sight.drift(position, leader),
                None => position.spread(e, &sight.direction),
            };
            seen_at[k] = (scale, sight.direction, spread);
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
            let all = view.lines.iter().map(|line| line.curve.at(1.0).0).fold(view.floor, f64::max).log2();
            // No more is added than is heard.
            let added = |off: f64, rate: f64| {
                let std = self.law.variance().sqrt();
                asked.added(std, off, rate, [most, above], sinr).min(all + range) + slack
            };
            self.raise(&mut view, added);
        }
        view
    }

    /// Raises the user's majorants above `(1 + E a_0) 2^y` in each band, `y` what is `added` at the least angle of a band to the line to the
    /// user and the largest rate in it.
    fn raise(&self, view: &mut View, added: impl Fn(f64, f64) -> f64) {
        let mut near = [Majorant { base: 0.0, slope: 0.0 }; 2];
        for (k, band) in BANDS_DEG.windows(2).enumerate() {
            let [off_hi, off_lo] = [band[0], band[1]].map(f64::to_radians);
            // Angles are those from where I is, which the box does not blur.
            let cosine = (off_hi.cos() - self.law.variance()).max(0.0);
            let user = view.gain * (view.across - view.depth * cosine * cosine);
            let added = added(off_lo, user.ln_1p() / LN_2);
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
