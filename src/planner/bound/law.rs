//! Means over the Euler jitter of one vehicle, bounded over boxes of angles.

use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{FRAC_PI_2, LN_2, PI};

use crate::planner::expectation::normal;

/// Points of the rule: a Kronecker lattice carried to the plane by the normal quantile.
const POINTS: usize = 96;
/// Its generator: the golden ratio less one.
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

/// The noise of roll and pitch, as sines and cosines at the points of the rule.
#[derive(Debug)]
pub(super) struct Law {
    std_rad: f64,
    /// sin and cos of half the roll noise, of the roll noise, of half the pitch noise.
    half_roll: [Vec<f64>; 2],
    roll: [Vec<f64>; 2],
    half_pitch: [Vec<f64>; 2],
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

/// What a box of offsets is reduced to.
struct Nearest {
    /// The least differences of roll and pitch, signed.
    x: f64,
    y: f64,
    /// All differences of pitch.
    pitch_off: Range,
    /// Rolls of the axis.
    roll: Range,
    /// The least and the largest cosine of the line's roll.
    line_cos: f64,
    flat_cos: f64,
}

/// A mean to take, as vector code of the machine's own.
struct Mean<'a> {
    law: &'a Law,
    scale: f64,
    floor: f64,
    at: &'a Nearest,
}

impl pulp::NullaryFnOnce for Mean<'_> {
    type Output = (f64, f64);

    #[inline(always)]
    fn call(self) -> Self::Output {
        self.law.mean_inline(self.scale, self.floor, self.at)
    }
}

impl Law {
    pub fn new(std_rad: f64) -> Self {
        let mut law = Self {
            std_rad,
            half_roll: Default::default(),
            roll: Default::default(),
            half_pitch: Default::default(),
        };
        for m in 0..POINTS {
            let u = (m as f64 + 0.5) / POINTS as f64;
            let v = (m as f64 * GENERATOR + 0.5 / POINTS as f64).fract();
            let (roll, pitch) = (std_rad * normal::quantile(u), std_rad * normal::quantile(v));
            let push = |pair: &mut [Vec<f64>; 2], angle: f64| {
                pair[0].push(angle.sin());
                pair[1].push(angle.cos());
            };
            push(&mut law.half_roll, 0.5 * roll);
            push(&mut law.roll, roll);
            push(&mut law.half_pitch, 0.5 * pitch);
        }
        law
    }

    /// The variance of one angle.
    pub fn variance(&self) -> f64 {
        self.std_rad * self.std_rad
    }

    /// A lower bound on `E log2 max(1 + scale G, 1 + floor)` over a box of offsets.
    pub fn least_mean(&self, scale: f64, floor: f64, offset: &Offset) -> (f64, f64) {
        let mut least = (f64::INFINITY, f64::INFINITY);
        let turned = plus(offset.roll, offset.line_roll);
        let images = [
            (offset.roll_off, offset.pitch_off),
            (turned, plus(offset.pitch_off, [PI; 2])),
            (turned, minus(offset.pitch_off, [PI; 2])),
        ];
        let line_cos = offset.line_roll[0].cos().min(offset.line_roll[1].cos()).max(0.0);
        let axis_cos = offset.roll[0].cos().min(offset.roll[1].cos());
        let steepest = offset.line_roll[0].abs().min(offset.line_roll[1].abs());
        let crosses = offset.line_roll[0] <= 0.0 && offset.line_roll[1] >= 0.0;
        let flat_cos = if crosses { 1.0 } else { steepest.cos() };
        for (roll_off, pitch_off) in images {
            let (x, y) = (nearest_zero(roll_off), nearest_zero(pitch_off));
            let near = (0.5 * x).sin().powi(2) + line_cos * axis_cos * (0.5 * y).sin().powi(2);
            // Beyond a right angle another image of the line is nearer; the nearest of all is at most half way.
            if near <= 0.5 {
                let (value, slope) = self.mean(
                    scale,
                    floor,
                    &Nearest { x, y, pitch_off, roll: offset.roll, line_cos, flat_cos },
                );
                least = (least.0.min(value), least.1.min(slope));
            }
        }
        if least.0.is_finite() { least } else { (scale.max(floor).ln_1p() / LN_2, 0.0) }
    }

    /// In the widest vectors that this machine has; the result is the same in all.
    fn mean(&self, scale: f64, floor: f64, at: &Nearest) -> (f64, f64) {
        pulp::Arch::new().dispatch(Mean { law: self, scale, floor, at })
    }

    #[inline(always)]
    fn mean_inline(&self, scale: f64, floor: f64, at: &Nearest) -> (f64, f64) {
        let &Nearest { x, y, pitch_off, roll, line_cos, flat_cos } = at;
        // Half the sine of the farthest pitch, unless opposite ones are near: then all of it.
        let [far_a, far_b] = pitch_off.map(|y| (0.5 * y).sin_cos());
        let beyond = if pitch_off[0] < -2.0 || pitch_off[1] > 2.0 { 1.0 } else { 0.0 };
        let (sx, cx) = (0.5 * x).sin_cos();
        let (sy, cy) = (0.5 * y).sin_cos();
        let [(s_lo, c_lo), (s_hi, c_hi)] = roll.map(f64::sin_cos);
        let floor = 1.0 + floor;
        // All factors of a lane together stay below 1e300, or the logarithm is taken at once.
        let often = scale.max(floor) > 1e24;
        let mut sum = 0.0;
        let mut products = [1.0; GROUP];
        let mut shares = [0.0; GROUP];
        let [half_roll_s, half_roll_c] = self.half_roll.each_ref().map(|v| v.as_chunks::<GROUP>().0);
        let [roll_s, roll_c] = self.roll.each_ref().map(|v| v.as_chunks::<GROUP>().0);
        let [half_pitch_s, half_pitch_c] = self.half_pitch.each_ref().map(|v| v.as_chunks::<GROUP>().0);
        for g in 0..POINTS / GROUP {
            for m in 0..GROUP {
                let a = sx * half_roll_c[g][m] + cx * half_roll_s[g][m];
                let b = sy * half_pitch_c[g][m] + cy * half_pitch_s[g][m];
                let (p, q) =
                    (c_lo * roll_c[g][m] - s_lo * roll_s[g][m], c_hi * roll_c[g][m] - s_hi * roll_s[g][m]);
                let least = if p < q { p } else { q };
                // Past a right angle of roll the product is negative: the farthest pitch counts, and the flattest line.
                let far_a = far_a.0 * half_pitch_c[g][m] + far_a.1 * half_pitch_s[g][m];
                let far_b = far_b.0 * half_pitch_c[g][m] + far_b.1 * half_pitch_s[g][m];
                let (far_a, far_b) = (far_a * far_a, far_b * far_b);
                let far = if far_a > far_b { far_a } else { far_b };
                let far = if far > beyond { far } else { beyond };
                let part = if least > 0.0 { line_cos * b * b } else { flat_cos * far };
                let h = a * a + least * part;
                let h = if h > 0.0 { h } else { 0.0 };
                let x = 1.0 + scale * 4.0 * h * (1.0 - h);
                products[m] *= if x > floor { x } else { floor };
                shares[m] += if x > floor { (x - 1.0) / x } else { 0.0 };
            }
            if often {
                for p in &mut products {
                    sum += p.ln();
                    *p = 1.0;
                }
            }
        }
        sum += products.iter().map(|p| p.ln()).sum::<f64>();
        (sum / (POINTS as f64 * LN_2), shares.iter().sum::<f64>() / POINTS as f64)
    }

    /// `E[Y Y']` at desired roll and pitch: exact.
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
mod tests {
    use super::*;
    use crate::radio::pattern::antenna_axis;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// The mean by a fine midpoint rule in the plane of the two quantiles.
    fn fine(std: f64, scale: f64, axis: [f64; 2], line: &Vector3<f64>) -> f64 {
        let n = 200;
        let at = |k: usize| std * normal::quantile((k as f64 + 0.5) / n as f64);
        let mut sum = 0.0;
        for a in 0..n {
            for b in 0..n {
                let y = antenna_axis(axis[0] + at(a), axis[1] + at(b), 0.0);
                sum += (scale * y.cross(line).norm_squared()).ln_1p();
            }
        }
        sum / (n * n) as f64 / LN_2
    }

    #[test]
    fn val_least_mean_is_the_mean_at_a_point_and_below_it_over_a_box() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut under, mut over): (f64, f64) = (0.0, 0.0);
        for round in 0..150 {
            let std = [1.0_f64, 2.0, 5.0, 10.0][round % 4].to_radians();
            let law = Law::new(std);
            let line = [rng.random_range(-1.3..1.3), rng.random_range(-1.4..1.4)];
            let near = 6.0 * std;
            let axis: [f64; 2] = std::array::from_fn(|k| {
                if round % 3 == 0 {
                    line[k]
                } else {
                    (line[k] + rng.random_range(-near..near)).clamp(-1.57, 1.57)
                }
            });
            let scale = 10.0_f64.powf(rng.random_range(-0.5..2.5)) / (std * std);
            let u = antenna_axis(line[0], line[1], 0.0);
            let truth = fine(std, scale, axis, &u);
            let mut offset = Offset {
                roll: [axis[0]; 2],
                line_roll: [line[0]; 2],
                roll_off: [axis[0] - line[0]; 2],
                pitch_off: [axis[1] - line[1]; 2],
            };
            let point = law.least_mean(scale, 0.0, &offset).0;
            under = under.max(point - truth);
            over = over.max(truth - point);
            let half = rng.random_range(0.0..2.0) * std;
            offset.roll = [axis[0] - half, axis[0] + half];
            offset.roll_off = offset.roll_off.map(|x| x - half);
            offset.roll_off[1] += 2.0 * half;
            offset.pitch_off[0] -= half;
            offset.pitch_off[1] += half;
            let bound = law.least_mean(scale, 0.0, &offset).0;
            assert!(
                bound <= truth + 0.03,
                "std {std} scale {scale} {axis:?} {line:?}: {bound} above {truth}"
            );
        }
        assert!(over < 0.06, "the rule understates by {over}");
        assert!(under < 0.03, "the rule overstates by {under}");
    }

    #[test]
    fn val_second_moment_is_the_mean_of_samples() {
        let law = Law::new(0.1);
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
        // Step 1's S: E G over exp(E ln G), over offsets and rolls; the limit is 2 e^gamma = 3.56.
        let mut worst: f64 = 0.0;
        for degrees in [1.0_f64, 5.0, 10.0] {
            let std = degrees.to_radians();
            let law = Law::new(std);
            for roll in [0.0, 0.8, 1.3, 1.5, FRAC_PI_2] {
                for off in [0.0, 0.5 * std, 2.0 * std, 0.5] {
                    let u = antenna_axis(roll - off, 0.0, 0.0);
                    let mean = 1.0 - u.dot(&(law.second_moment(roll, 0.0) * u));
                    let scale = 1e12;
                    let log = fine(std, scale, [roll, 0.0], &u) - scale.log2();
                    worst = worst.max(mean / log.exp2());
                }
            }
        }
        assert!(worst > 1.7 && worst < 4.5, "{worst}");
    }
}
