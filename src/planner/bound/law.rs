//! The mean of `log2(1 + scale G)` over one vehicle's attitude noise, bounded from below for a whole box of poses at once:
//! step 5 of the parent module's section 3.
//!
//! *What is asked.* The antenna's axis has a roll and a pitch, and Gaussian noise on both. A receiver lies along a *line*,
//! which has a roll and a pitch too: those of the axis that points straight at it, and so sends it nothing. The gain
//! towards the receiver is `G = sin^2(psi)`, psi the angle between axis and line. Branch and bound asks for the mean not
//! at one pose but over a *box*: intervals of the axis's angles, of the line's, and of their difference, the *offset*. The
//! answer may be too low, never too high.
//!
//! *How it is answered.* The mean grows with the size of the offset, so that the least offset of the box stands for all
//! of it ([`Nearest`]); there the mean is taken by a fixed rule of points. What makes this more than a line of code is that
//! roll and pitch are latitude and longitude on the sphere of directions: on another meridian than the line's own, the
//! nearest point to the line has another latitude than the line ([`Aside`]), and every line has images half a turn away.

#[cfg(test)]
use nalgebra::Matrix3;
use nalgebra::Vector3;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, LN_2, PI};

use crate::planner::expectation::logarithm::LogSum;
use crate::planner::expectation::normal;

/// The generator of the rules, Kronecker lattices carried to the plane by the normal quantile: the golden ratio less one.
const GENERATOR: f64 = 0.618_033_988_749_894_9;
/// Points taken at once.
const GROUP: usize = 8;

/// A closed interval.
pub(super) type Range = [f64; 2];

/// The lower and the upper sum of two intervals, the second negated.
pub(super) fn minus(a: Range, b: Range) -> Range {
    [a[0] - b[1], a[1] - b[0]]
}

/// The lower and the upper sum of two intervals.
pub(super) fn plus(a: Range, b: Range) -> Range {
    [a[0] + b[0], a[1] + b[1]]
}

/// The point of an interval nearest to zero.
fn nearest_zero(a: Range) -> f64 {
    if a[0] > 0.0 { a[0] } else { a[1].min(0.0) }
}

/// The roll offset of a box, and how it changes as pitch leads away from the line.
///
/// Take roll for latitude and the line for a town. On the town's own meridian the nearest point to it is the town. On a
/// meridian `v` away the nearest point lies farther from the equator, by an angle of tangent
/// `s c (1 - cos v) / (1 - c^2 (1 - cos v))`, with s and c sine and cosine of the town's latitude. So whoever stands
/// poleward of the town is nearer to it, in latitude, on that meridian than on the town's; whoever stands on the side
/// of the equator is farther from it.
struct Aside {
    /// The least size of the roll offset on the line's own meridian, modulo half a turn.
    x: f64,
    /// `s c` of the formula: positive where the offset shrinks, negative where it grows.
    bend: f64,
    /// `c^2` of the formula.
    flat: f64,
}

impl Aside {
    /// Of the whole box: where an offset may shrink, the largest `s c` in it counts. That all of them grow, by the least
    /// `s c`, counts only where no angle passes a right one, for which pitches must be `small`; else no change is assumed.
    fn new(roll_off: Range, line: Range, small: bool) -> Self {
        let sides = |from: f64, to: f64| {
            let ends = [0.5 * (2.0 * from).sin(), 0.5 * (2.0 * to).sin()];
            let peak = if from <= FRAC_PI_4 && to >= FRAC_PI_4 { 0.5 } else { 0.0 };
            if from > to { [0.0; 2] } else { [ends[0].min(ends[1]).max(0.0), ends[0].max(ends[1]).max(peak)] }
        };
        // Lines of positive and of negative roll.
        let mut up = sides(line[0].max(0.0), line[1]);
        let mut down = sides((-line[1]).max(0.0), -line[0]);
        if line[0] < 0.0 {
            up[0] = 0.0;
        }
        if line[1] > 0.0 {
            down[0] = 0.0;
        }
        let flat = nearest_zero(line).cos().powi(2);
        let steep = line[0].cos().min(line[1].cos()).max(0.0).powi(2);
        let size = nearest_zero(roll_off).abs();
        let farthest = roll_off[0].abs().max(roll_off[1].abs());
        if farthest > FRAC_PI_2 {
            return Self { x: size.min((PI - farthest).max(0.0)), bend: up[1].max(down[1]), flat };
        }
        let (towards, away) = if roll_off[0] > 0.0 { (up[1], down[0]) } else { (down[1], up[0]) };
        if towards == 0.0 && small && farthest + size < 0.8 {
            return Self { x: size, bend: -away, flat: steep };
        }
        Self { x: size, bend: towards, flat }
    }
}

/// The noise of roll and pitch, as sines and cosines at the points of the rule.
#[derive(Debug)]
pub(super) struct Law {
    std_rad: f64,
    /// sin and cos of the roll noise and of the pitch noise.
    roll: [Vec<f64>; 2],
    pitch: [Vec<f64>; 2],
    /// The same of the angle by which both together turn an axis at most.
    turned: [Vec<f64>; 2],
}

/// A line seen from a vehicle and the vehicle's axis, as intervals of the angles of the paper.
#[derive(Debug, Clone, Copy)]
pub(super) struct Offset {
    /// Roll of the axis.
    pub roll: Range,
    /// Roll of the line.
    pub line_roll: Range,
    /// Roll of the axis less that of the line.
    pub roll_off: Range,
    /// Pitch of the axis less that of the line.
    pub pitch_off: Range,
}

impl Offset {
    /// Of boxes of an axis and of a line, each by roll and pitch.
    #[cfg(test)]
    pub fn new([roll, pitch]: [Range; 2], [line_roll, line_pitch]: [Range; 2]) -> Self {
        Self { roll, line_roll, roll_off: minus(roll, line_roll), pitch_off: minus(pitch, line_pitch) }
    }
}

/// Of a box of offsets: a lower bound on a mean, on how fast it rises with log2 of the scale, and the SINR up to which draws count.
#[derive(Debug, Clone, Copy)]
pub(super) struct Least {
    pub mean: f64,
    pub rise: f64,
    pub most: f64,
}

/// What a box of offsets is reduced to.
struct Nearest {
    /// The least size of the roll offset from the line, and the least pitch offset, signed.
    x: f64,
    y: f64,
    /// Of [`Aside`].
    bend: f64,
    flat: f64,
    /// The least cosine of the line's roll, squared.
    line: f64,
}

/// A mean to take, as vector code of the machine's own.
struct Mean<'a> {
    law: &'a Law,
    scale: f64,
    within: Range,
    at: &'a Nearest,
}

impl pulp::NullaryFnOnce for Mean<'_> {
    type Output = (f64, f64);

    #[inline(always)]
    fn call(self) -> Self::Output {
        // On the line's own roll pitch brings nothing nearer.
        if self.at.x > 0.0 {
            self.law.mean_inline::<true>(self.scale, self.within, self.at)
        } else {
            self.law.mean_inline::<false>(self.scale, self.within, self.at)
        }
    }
}

impl Law {
    /// Noise of this standard deviation, by a rule of so many points, rounded up to a multiple of eight.
    pub fn new(std_rad: f64, points: usize) -> Self {
        let points = points.next_multiple_of(GROUP);
        let mut law =
            Self { std_rad, roll: Default::default(), pitch: Default::default(), turned: Default::default() };
        for m in 0..points {
            let u = (m as f64 + 0.5) / points as f64;
            let v = (m as f64 * GENERATOR + 0.5 / points as f64).fract();
            let (roll, pitch) = (std_rad * normal::quantile(u), std_rad * normal::quantile(v));
            let push = |pair: &mut [Vec<f64>; 2], angle: f64| {
                pair[0].push(angle.sin());
                pair[1].push(angle.cos());
            };
            push(&mut law.roll, roll);
            push(&mut law.pitch, pitch);
            let haversine = (0.5 * roll).sin().powi(2) + (0.5 * pitch).sin().powi(2);
            push(&mut law.turned, 2.0 * haversine.min(0.5).sqrt().asin());
        }
        law
    }

    /// The variance of one angle.
    pub fn variance(&self) -> f64 {
        self.std_rad * self.std_rad
    }

    /// A lower bound on `E log2(1 + scale G)` over a box of offsets.
    #[cfg(test)]
    pub fn least_mean(&self, scale: f64, offset: &Offset) -> (f64, f64) {
        let Least { mean, rise, .. } = self.least_within(scale, 0.0, f64::INFINITY, offset);
        (mean, rise)
    }

    /// A lower bound on `E log2(1 + scale G)` over a box of offsets, of `scale G` no less than `floor`, and no more than so many
    /// times its `share` of the box's nearest pose in the mean.
    pub fn least_within(&self, scale: f64, floor: f64, share: f64, offset: &Offset) -> Least {
        let mut least = Least { mean: f64::INFINITY, rise: f64::INFINITY, most: 0.0 };
        let turned = plus(offset.roll, offset.line_roll);
        let opposite = [-offset.line_roll[1], -offset.line_roll[0]];
        let images = [
            (offset.roll_off, offset.pitch_off, offset.line_roll),
            (turned, plus(offset.pitch_off, [PI; 2]), opposite),
            (turned, minus(offset.pitch_off, [PI; 2]), opposite),
        ];
        let line_cos = offset.line_roll[0].cos().min(offset.line_roll[1].cos()).max(0.0);
        let axis_cos = offset.roll[0].cos().min(offset.roll[1].cos());
        for (roll_off, pitch_off, line_roll) in images {
            let (x, y) = (nearest_zero(roll_off), nearest_zero(pitch_off));
            let near = (0.5 * x).sin().powi(2) + line_cos * axis_cos * (0.5 * y).sin().powi(2);
            // Beyond a right angle another image of the line is nearer; the nearest of all is at most half way.
            if near <= 0.5 {
                let small = y.abs() + 3.5 * self.std_rad < FRAC_PI_2;
                let Aside { x, bend, flat } = Aside::new(roll_off, line_roll, small);
                let at = Nearest { x, y, bend, line: line_cos * line_cos, flat };
                let gain = 4.0 * near + 2.0 * self.variance();
                let most = if share.is_finite() { (share * scale * gain).max(2.0 * floor) } else { share };
                let (mut mean, mut rise) = self.mean(scale, [floor, most], &at);
                // Across the pole the nearest roll says little, and the angle itself says more.
                let off = 2.0 * near.sqrt().asin();
                let usual = (off - 2.0 * self.std_rad).max(0.0).sin().powi(2);
                if (scale * usual).max(floor).min(most).ln_1p() > mean * LN_2 {
                    let straight = self.straight_mean(scale, [floor, most], off);
                    if straight.0 > mean {
                        (mean, rise) = straight;
                    }
                }
                least = Least {
                    mean: least.mean.min(mean),
                    rise: least.rise.min(rise),
                    most: least.most.max(most),
                };
            }
        }
        let all = scale.max(floor);
        if least.mean.is_finite() { least } else { Least { mean: all.ln_1p() / LN_2, rise: 0.0, most: all } }
    }

    /// A lower bound on `E log2(1 + scale G)`, of `scale G` within these, of an axis `off` the line, a right angle at most: noise
    /// takes it straight there.
    pub fn straight_mean(&self, scale: f64, within: Range, off: f64) -> (f64, f64) {
        let (sin, cos) = off.sin_cos();
        let [floor, most] = within.map(|x| 1.0 + x);
        let (mut sum, mut share) = (LogSum::default(), 0.0);
        for (s, c) in self.turned[0].iter().zip(&self.turned[1]) {
            let sine = (sin * c - cos * s).max(0.0);
            let x = 1.0 + scale * sine * sine;
            sum.push(x.clamp(floor, most));
            share += if x > floor && x < most { (x - 1.0) / x } else { 0.0 };
        }
        let points = self.turned[0].len() as f64;
        (sum.value() / (points * LN_2), share / points)
    }

    /// In the widest vectors that this machine has; the result is the same in all.
    fn mean(&self, scale: f64, within: Range, at: &Nearest) -> (f64, f64) {
        pulp::Arch::new().dispatch(Mean { law: self, scale, within, at })
    }

    #[inline(always)]
    fn mean_inline<const APART: bool>(&self, scale: f64, within: Range, at: &Nearest) -> (f64, f64) {
        let &Nearest { x, y, bend, line, flat } = at;
        let (sx, cx) = x.sin_cos();
        let away = bend < 0.0;
        let (sy, cy) = y.sin_cos();
        let [floor, most] = within.map(|x| 1.0 + x);
        // So many factors of a lane stay below 1e300, or the logarithm is taken at once.
        let together = if scale.max(floor) > 1e24 { 1 } else { 12 };
        let mut sum = LogSum::default();
        let mut products = [1.0; GROUP];
        let mut shares = [0.0; GROUP];
        let [roll_s, roll_c] = self.roll.each_ref().map(|v| v.as_chunks::<GROUP>().0);
        let [pitch_s, pitch_c] = self.pitch.each_ref().map(|v| v.as_chunks::<GROUP>().0);
        for g in 0..roll_s.len() {
            for m in 0..GROUP {
                // The pitch, and by how much it moves the nearest roll away from the line's.
                let sin_pitch = sy * pitch_c[g][m] + cy * pitch_s[g][m];
                let fall = 1.0 - (cy * pitch_c[g][m] - sy * pitch_s[g][m]);
                let fall = if away && fall > 0.7 { 0.7 } else { fall };
                let a = if APART {
                    let rest = 1.0 - flat * fall;
                    let tangent = bend * fall / if rest > 1e-9 { rest } else { 1e-9 };
                    let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
                    // The least roll offset, moved by it.
                    let moved_s = cosine * (sx - cx * tangent);
                    let moved_c = cosine * (cx + sx * tangent);
                    let (s, c) = if moved_s > 0.0 { (moved_s, moved_c) } else { (0.0, 1.0) };
                    s * roll_c[g][m] + c * roll_s[g][m]
                } else {
                    roll_s[g][m]
                };
                let across = line * sin_pitch * sin_pitch;
                let gain = across + a * a * (1.0 - across);
                let x = 1.0 + scale * gain;
                let raised = if x > floor { x } else { floor };
                products[m] *= if raised < most { raised } else { most };
                shares[m] += if x > floor && x < most { (x - 1.0) / x } else { 0.0 };
            }
            if (g + 1) % together == 0 {
                for p in &mut products {
                    sum.push(*p);
                    *p = 1.0;
                }
            }
        }
        products.iter().for_each(|p| sum.push(*p));
        let points = self.roll[0].len() as f64;
        (sum.value() / (points * LN_2), shares.iter().sum::<f64>() / points)
    }

    /// `E[Y Y']` at desired roll and pitch: exact.
    #[cfg(test)]
    pub fn second_moment(&self, roll_rad: f64, pitch_rad: f64) -> Matrix3<f64> {
        let variance = self.std_rad * self.std_rad;
        let (damp, damp_pitch) = ((-2.0 * variance).exp(), (-0.5 * variance).exp());
        let squares = |angle: f64| {
            let c = damp * (2.0 * angle).cos();
            (0.5 * (1.0 - c), 0.5 * (1.0 + c), 0.5 * damp * (2.0 * angle).sin())
        };
        let (sin_roll, cos_roll, mixed_roll) = squares(roll_rad);
        let (sin_pitch, cos_pitch, mixed_pitch) = squares(pitch_rad);
        let (s, c) = pitch_rad.sin_cos();
        let (xy, xz, yz) =
            (-mixed_roll * damp_pitch * s, cos_roll * mixed_pitch, -mixed_roll * damp_pitch * c);
        Matrix3::new(cos_roll * sin_pitch, xy, xz, xy, sin_roll, yz, xz, yz, cos_roll * cos_pitch)
    }
}

/// Roll and pitch of the axis along `v`, as intervals over a box of `v` with positive last coordinate.
pub(super) fn line_angles(lo: &Vector3<f64>, hi: &Vector3<f64>) -> Option<[Range; 2]> {
    if lo.z <= 0.0 {
        return None;
    }
    let low = |a: f64, near: f64, far: f64| a.atan2(if a < 0.0 { near } else { far });
    let high = |a: f64, near: f64, far: f64| a.atan2(if a > 0.0 { near } else { far });
    let pitch = [low(lo.x, lo.z, hi.z), high(hi.x, lo.z, hi.z)];
    let side = if lo.x > 0.0 { lo.x } else { hi.x.min(0.0) };
    let (near, far) = (side.hypot(lo.z), lo.x.abs().max(hi.x.abs()).hypot(hi.z));
    let roll = [low(-hi.y, near, far), high(-lo.y, near, far)];
    Some([roll, pitch])
}

/// All rolls and all pitches of the canonical axes.
pub(super) const ALL_ANGLES: Range = [-FRAC_PI_2, FRAC_PI_2];

#[cfg(test)]
/// Roll and pitch of the canonical axis at this angle to a line, `around` it from where x lies.
pub(super) fn axis_off(line: &Vector3<f64>, off: f64, around: f64) -> [f64; 2] {
    let across = line.cross(&Vector3::x()).normalize();
    let aside = across * around.cos() + line.cross(&across) * around.sin();
    let axis = line * off.cos() + aside * off.sin();
    let axis = if axis.z < 0.0 { -axis } else { axis };
    [(-axis.y).clamp(-1.0, 1.0).asin(), axis.x.atan2(axis.z)]
}

#[cfg(test)]
/// [`floored_mean`] without a floor.
pub(super) fn fine_mean(std: f64, scale: f64, axis: [f64; 2], line: &Vector3<f64>) -> f64 {
    floored_mean(std, scale, 0.0, axis, line)
}

#[cfg(test)]
/// The mean of log2 max(1 + scale G, 1 + floor) over an axis' angles by the trapezoidal rule on the Gaussian density, which converges
/// faster than any power where it is smooth.
pub(super) fn floored_mean(std: f64, scale: f64, floor: f64, axis: [f64; 2], line: &Vector3<f64>) -> f64 {
    let step = 0.05;
    let gain = |at: [f64; 2]| {
        let y = crate::radio::pattern::antenna_axis(axis[0] + std * at[0], axis[1] + std * at[1], 0.0);
        y.cross(line).norm_squared()
    };
    let (mut sum, mut total) = (0.0, 0.0);
    for a in -130..130 {
        for b in -130..130 {
            let at = [a, b].map(|k| (f64::from(k) + 0.5) * step);
            // About a null, where the logarithm is nearly singular, sixteen steps to one.
            let parts = if gain(at) < (4.0 * step * std).powi(2) { 16 } else { 1 };
            for k in 0..parts * parts {
                let part = |k: i32| ((f64::from(k) + 0.5) / f64::from(parts) - 0.5) * step;
                let at = [at[0] + part(k / parts), at[1] + part(k % parts)];
                let weight = (-0.5 * (at[0] * at[0] + at[1] * at[1])).exp() / f64::from(parts * parts);
                sum += weight * (scale * gain(at)).max(floor).ln_1p();
                total += weight;
            }
        }
    }
    sum / total / LN_2
}

/// log10 of the SINRs at one standard deviation for which margins are stated: weak ones, and up to the strongest that a
/// link budget of the field gives.
#[cfg(test)]
pub(super) const STATED: std::ops::Range<f64> = -0.5..6.5;
/// Of a margin, what the rule may take: it was measured to take half.
#[cfg(test)]
pub(super) const TAKEN: f64 = 0.6;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::bound::hearing::{ROUGH_POINTS, ROUGH_QUADRATURE};
    use crate::planner::bound::prepared::POINTS;
    use crate::planner::bound::view::QUADRATURE;
    use crate::radio::pattern::antenna_axis;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn val_least_mean_is_the_mean_at_a_point_and_below_it_over_a_box() {
        least_means(POINTS, QUADRATURE);
        least_means(ROUGH_POINTS, ROUGH_QUADRATURE);
    }

    /// Margins are about twice what a rule of so many points overstates, at any SINR up to 10^6.5.
    fn least_means(points: usize, margin: f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut under, mut over): (f64, f64) = (0.0, 0.0);
        let laws = [1.0_f64, 2.0, 5.0, 10.0].map(|degrees| Law::new(degrees.to_radians(), points));
        let mut most: f64 = 0.0;
        for round in 0..1200 {
            let law = &laws[round / 2 % 4];
            let std = law.std_rad;
            // Steep ones too, where the noise of roll counts for most in the pitch's share.
            let steep = round % 2 == 0;
            let roll: f64 = if steep { rng.random_range(0.8..1.55) } else { rng.random_range(0.0..1.5) };
            let line = [if rng.random_bool(0.5) { roll } else { -roll }, rng.random_range(-1.4..1.4)];
            let near = if steep { [2.0 * std, 1.3] } else { [6.0 * std; 2] };
            let axis: [f64; 2] = std::array::from_fn(|k| {
                if round % 3 == 0 {
                    line[k]
                } else {
                    (line[k] + rng.random_range(-near[k]..near[k])).clamp(-FRAC_PI_2, FRAC_PI_2)
                }
            });
            let scale = 10.0_f64.powf(rng.random_range(STATED)) / (std * std);
            let u = antenna_axis(line[0], line[1], 0.0);
            let truth = fine_mean(std, scale, axis, &u);
            let at = |axis: [Range; 2], line: [Range; 2]| law.least_mean(scale, &Offset::new(axis, line)).0;
            let point = at(axis.map(|x| [x; 2]), line.map(|x| [x; 2]));
            under = under.max(point - truth);
            if round % 3 == 0 {
                over = over.max(truth - point);
            }
            // Boxes that hold both, about them or to one side, of the axis and of the line.
            let mut around = |x: f64, reach: f64| {
                let below = if rng.random_bool(0.5) { 0.0 } else { rng.random_range(0.0..reach) };
                let above = if rng.random_bool(0.5) { 0.0 } else { rng.random_range(0.0..reach) };
                [(x - below).max(-FRAC_PI_2), (x + above).min(FRAC_PI_2)]
            };
            let boxes = [0.1, 0.5, 2.0].map(|share| {
                let axes = axis.map(|x| around(x, share * std));
                at(axes, line.map(|x| around(x, 0.5 * share * std)))
            });
            for bound in boxes {
                most = most.max(bound - truth);
                assert!(
                    bound <= truth + TAKEN * margin,
                    "std {std} scale {scale} {axis:?} {line:?}: {bound} above {truth}"
                );
            }
        }
        println!("{points} points: at a point {under:.4} over, {over:.4} under; over a box {most:.4} over");
        assert!(over < 2.0 * margin, "the rule understates by {over}");
        assert!(under < TAKEN * margin, "the rule overstates by {under}");
    }

    /// Steep axes and lines on either side of the pole: whichever way round they are taken, and in however small a box, nothing is
    /// near a null that is not.
    #[test]
    fn regress_an_axis_across_the_pole_is_as_far_off_as_it_is() {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let law = Law::new(2.0_f64.to_radians(), ROUGH_POINTS);
        let (mut across, mut least) = (0, 0.0_f64);
        for _ in 0..400 {
            let mut any = || [rng.random_range(-1.5..1.5), rng.random_range(-1.5..1.5)];
            let (axis, line): ([f64; 2], [f64; 2]) = (any(), any());
            let [y, u] = [axis, line].map(|[roll, pitch]| antenna_axis(roll, pitch, 0.0));
            let off = y.cross(&u).norm().min(1.0).asin();
            if off < 0.5 {
                continue;
            }
            across += usize::from(y.dot(&u) < 0.0);
            let truth = fine_mean(law.std_rad, 1e6, axis, &u);
            for half in [0.0, 1e-4, 1e-2] {
                let [axis, line] = [axis, line].map(|at| at.map(|x| [x - half, x + half]));
                let bound = law.least_mean(1e6, &Offset::new(axis, line)).0;
                assert!(
                    bound <= truth + TAKEN * ROUGH_QUADRATURE,
                    "{axis:?} {line:?}: {bound} above {truth}"
                );
                least = least.min(bound - truth + 12.0 * half);
            }
        }
        assert!(across > 100 && least > -0.4, "{across}: {least}");
    }

    #[test]
    fn val_second_moment_is_the_mean_of_samples() {
        let law = Law::new(0.1, 96);
        let (roll, pitch) = (0.7, -0.4);
        let n = 300;
        let at = |k: usize| 0.1 * normal::quantile((k as f64 + 0.5) / n as f64);
        let mut sum = Matrix3::zeros();
        for a in 0..n {
            for b in 0..n {
                let y = antenna_axis(roll + at(a), pitch + at(b), 0.0);
                sum += y * y.transpose();
            }
        }
        let difference = (sum / (n * n) as f64 - law.second_moment(roll, pitch)).amax();
        assert!(difference < 2e-4, "{difference}");
    }

    #[test]
    fn val_spread_of_a_mean_over_its_geometric_mean() {
        // Step 1's S: E G over exp(E ln G), over offsets and rolls; the limit is 2 e^gamma = 3.56. Step 8's t: the same of
        // (E G^3)^(1/3), whose limit is 15^(1/3) as much.
        let (mut worst, mut loudest): (f64, f64) = (0.0, 0.0);
        for degrees in [1.0_f64, 5.0, 10.0] {
            let std = degrees.to_radians();
            let law = Law::new(std, 96);
            for roll in [0.0, 0.8, 1.3, 1.5, FRAC_PI_2] {
                for off in [0.0, 0.5 * std, 2.0 * std, 0.5] {
                    let u = antenna_axis(roll - off, 0.0, 0.0);
                    let mean = 1.0 - u.dot(&(law.second_moment(roll, 0.0) * u));
                    let scale = 1e12;
                    let log = fine_mean(std, scale, [roll, 0.0], &u) - scale.log2();
                    worst = worst.max(mean / log.exp2());
                    let gain =
                        |roll: f64, pitch: f64| antenna_axis(roll, pitch, 0.0).cross(&u).norm_squared();
                    let at = |k: usize| std * normal::quantile((k as f64 + 0.5) / 200.0);
                    let cubes = (0..200).flat_map(|a| (0..200).map(move |b| (a, b)));
                    let cubes: f64 = cubes.map(|(a, b)| gain(roll + at(a), at(b)).powi(3)).sum();
                    loudest = loudest.max((cubes / 40_000.0).cbrt() / log.exp2());
                }
            }
        }
        assert!(worst > 1.7 && worst < 4.5, "{worst}");
        assert!(loudest > 3.0 && loudest < 11.0, "{loudest}");
    }
}
