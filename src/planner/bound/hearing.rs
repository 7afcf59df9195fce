//! What an eavesdropper hears of I in the mean, bounded from below for all axes at once, as a curve over the angle between axis
//! and line.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, LN_2};

use super::harm::least_off;
use super::law::{Law, Least, Range};
use super::link::Gain;
use super::prepared::POINTS;
use super::view::QUADRATURE;

/// An eavesdropper counts up to so many times its mean SINR.
pub(super) const LOUDEST: f64 = 12.0;
/// The first angle off the null, over the noise, and how angles grow.
const OFF_FIRST: f64 = 0.25;
const OFF_GROWTH: f64 = 1.3;
/// Beyond so many standard deviations the mean is smooth: a rule of few points does, and angles grow faster.
const AWAY: f64 = 5.0;
const OFF_GROWTH_AWAY: f64 = 1.5;
pub(super) const ROUGH_POINTS: usize = 128;
pub(super) const ROUGH_QUADRATURE: f64 = 0.045;
/// Range of the logarithm of the SINR across the axis.
const LEAST_SCALE: f64 = -8.0;
const MOST_SCALE: f64 = 40.0;
/// The least of 1 / (1 + z), z the floor.
const LEAST_FLOOR: f64 = 1e-6;
/// Angles at most, and pieces of a curve.
const ANGLES: usize = 32;

/// Lower bounds on `2^(E log2(1 + c G))`, tabulated when they are asked for.
#[derive(Debug)]
pub(super) struct Hearing {
    rough: Table,
    fine: Table,
}

/// Of each part of the rolls of the line, the floors and the scales: of each angle off the null.
#[derive(Debug)]
struct Table {
    /// Near the null, and away from it.
    laws: [Law; 2],
    /// Off each mean, bit/s/Hz.
    margin: f64,
    /// Angles off the null and their sines, squared.
    offs: Vec<(f64, f64)>,
    /// Rolls of lines, from the pole on.
    rolls: Vec<f64>,
    floors: usize,
    scale_step: f64,
    scales: usize,
    rows: HashMap<[usize; 3], Vec<Least>>,
}

/// How finely something is tabulated.
struct Grid {
    /// Of the rules near the null and away from it, and the margin off each mean, bit/s/Hz.
    points: [usize; 2],
    margin: f64,
    /// Rolls of the line by their cosine, values of `1 / (1 + z)`, steps of the logarithm of the scale.
    rolls: usize,
    floors: usize,
    scale_step: f64,
}

const ROUGH: Grid = Grid {
    points: [ROUGH_POINTS, 64],
    margin: ROUGH_QUADRATURE - QUADRATURE,
    rolls: 16,
    floors: 21,
    scale_step: 0.5,
};
const FINE: Grid = Grid { points: [POINTS, 128], margin: 0.0, rolls: 48, floors: 41, scale_step: 0.25 };

/// A convex function of the squared sine of the angle between axis and line, in pieces `a + b q`.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    /// From which q on, a and b.
    pieces: [[f64; 3]; 2 * ANGLES],
    count: usize,
    /// How fast its logarithm rises with that of the scale, at least.
    pub rise: f64,
    /// What draws count up to is at most this over the mean, bit/s/Hz.
    pub above: f64,
}

impl Curve {
    /// The value at q, and the piece there.
    pub fn at(&self, q: f64) -> (f64, [f64; 2]) {
        let k = self.pieces[..self.count].partition_point(|piece| piece[0] <= q).max(1) - 1;
        let [_, a, b] = self.pieces[k];
        (a + b * q, [a, b])
    }

    fn straight(a: f64, b: f64) -> Self {
        let mut pieces = [[0.0; 3]; 2 * ANGLES];
        pieces[0] = [0.0, a, b];
        Self { pieces, count: 1, rise: 0.0, above: 0.0 }
    }

    /// The greatest convex function below points of growing q.
    fn below(points: &[[f64; 2]]) -> Self {
        let mut hull = [[0.0; 2]; 2 * ANGLES];
        let mut count = 0;
        for &[q, value] in points {
            if count > 0 && q <= hull[count - 1][0] {
                // The lower of two at one place.
                hull[count - 1][1] = value.min(hull[count - 1][1]);
                continue;
            }
            while count >= 2 {
                let ([p, u], [r, v]) = (hull[count - 2], hull[count - 1]);
                if (v - u) * (q - p) < (value - u) * (r - p) {
                    break;
                }
                count -= 1;
            }
            hull[count] = [q, value];
            count += 1;
        }
        let mut curve = Self::straight(hull[0][1], 0.0);
        for k in 1..count {
            let ([p, u], [q, v]) = (hull[k - 1], hull[k]);
            let slope = (v - u) / (q - p);
            curve.pieces[k - 1] = [p, u - slope * p, slope];
            curve.count = k;
        }
        curve
    }
}

impl Table {
    fn new(std_rad: f64, grid: &Grid) -> Self {
        let Grid { points: [near, away], margin, rolls, floors, scale_step } = *grid;
        let mut offs = vec![0.0];
        if std_rad > 0.0 {
            let mut off = OFF_FIRST * std_rad;
            while off < FRAC_PI_2 / OFF_GROWTH.sqrt() {
                offs.push(off);
                off *= if off < AWAY * std_rad { OFF_GROWTH } else { OFF_GROWTH_AWAY };
            }
            offs.push(FRAC_PI_2);
        }
        debug_assert!(offs.len() <= ANGLES);
        let cosine = |k: usize| (k as f64 / rolls as f64).acos();
        Self {
            laws: [Law::new(std_rad, near), Law::new(std_rad, away)],
            margin,
            offs: offs.iter().map(|off: &f64| (*off, off.sin().powi(2))).collect(),
            rolls: (0..rolls).map(cosine).collect(),
            floors,
            scale_step,
            scales: ((MOST_SCALE - LEAST_SCALE) / scale_step) as usize,
            rows: HashMap::new(),
        }
    }

    /// The row for a scale and a floor, both rounded down, and a line as steep as this roll or steeper; and by how much the logarithm of
    /// the scale is larger than the row's. None where the scale is too small to be heard.
    ///
    /// `E log2 max(1 + c G, 1 + z) = log2(1 + z) + E log2 max(1, w + c w G)`, `w = 1 / (1 + z)`: of `c w` and `w` is the row, and its means
    /// are the second part.
    fn row(&mut self, scale: f64, floor: f64, roll: f64, clips: bool) -> Option<(f64, &[Least])> {
        let w = 1.0 / (1.0 + floor);
        let parts = (self.floors - 1) as f64;
        let part = (w * parts + 1e-9) as usize;
        let log = (scale * w).ln();
        let at = ((log - LEAST_SCALE) / self.scale_step).floor();
        if !(at >= 0.0) {
            return None;
        }
        let at = (at as usize).min(self.scales);
        let from = LEAST_SCALE + at as f64 * self.scale_step;
        let steeper = ((roll.cos() * self.rolls.len() as f64 + 1e-9) as usize).min(self.rolls.len() - 1);
        let Self { laws, margin, offs, rolls, rows, .. } = self;
        let row = rows.entry([steeper, part, at]).or_insert_with(|| {
            let w = (part as f64 / parts).max(LEAST_FLOOR);
            let share = if clips { LOUDEST } else { f64::INFINITY };
            let std_rad = laws[0].variance().sqrt();
            let least = |(off, _): &(f64, f64)| {
                let law = &laws[usize::from(*off > AWAY * std_rad)];
                let least = least_off(law, from.exp() / w, 1.0 / w - 1.0, share, [rolls[steeper]; 2], *off);
                let above = least.most.ln_1p() / LN_2 - least.mean + *margin;
                Least { mean: least.mean + w.log2() - *margin, most: above, ..least }
            };
            offs.iter().map(least).collect()
        });
        Some((log - from, row))
    }
}

impl Hearing {
    pub fn new(std_rad: f64) -> Self {
        Self { rough: Table::new(std_rad, &ROUGH), fine: Table::new(std_rad, &FINE) }
    }

    /// Of a gain, where the SINR at a gain of one is `scale`, and the line's roll lies within this; all draws count as `floor` at least.
    pub fn curve(
        &mut self,
        gain: &Gain,
        scale: f64,
        floor: f64,
        roll: Range,
        clips: bool,
        fine: bool,
    ) -> Curve {
        let (flat, scale) = gain.apart(scale);
        let least = ((1.0 + floor) / flat).max(1.0);
        if self.fine.laws[0].variance() == 0.0 {
            let mut curve = Curve::straight(flat * least, 0.0);
            curve.pieces[1] = [((least - 1.0) / scale).min(2.0), flat, flat * scale];
            curve.count = 2;
            return curve;
        }
        let table = if fine { &mut self.fine } else { &mut self.rough };
        let count = table.offs.len();
        let mut points = [[0.0; 2]; ANGLES];
        for (point, (_, sine_squared)) in points.iter_mut().zip(&table.offs) {
            point[0] = *sine_squared;
        }
        let steepest = roll[0].abs().max(roll[1].abs());
        let Some((more, row)) = table.row(scale, least - 1.0, steepest, clips) else {
            return Curve::straight(flat * least, 0.0);
        };
        let (mut above, mut rise) = (0.0_f64, 1.0_f64);
        for (point, least) in points.iter_mut().zip(row) {
            point[1] = least.mean + least.rise * more / LN_2;
            rise = rise.min(least.rise);
            above = above.max(least.most + (1.0 - least.rise) * more / LN_2);
        }
        for point in &mut points[..count] {
            point[1] = flat * least * point[1].max(0.0).exp2();
        }
        let (vertices, count) = vertices(&points[..count]);
        Curve { above, rise, ..Curve::below(&vertices[..count]) }
    }
}

/// Points below a function that is known at some: where it is convex about an interval, the chords of the two next to it, drawn on, lie
/// below it there, and meet in one; where it is not, its own chord does. Before the first it is no less, for it rises.
fn vertices(points: &[[f64; 2]]) -> ([[f64; 2]; 2 * ANGLES], usize) {
    let slope = |k: usize| {
        let ([p, u], [q, v]) = (points[k], points[k + 1]);
        (v - u) / (q - p)
    };
    let mut all = [[0.0; 2]; 2 * ANGLES];
    all[0] = points[0];
    let mut count = 1;
    for k in 0..points.len() - 1 {
        let ([p, u], [q, v]) = (points[k], points[k + 1]);
        let before = if k > 0 { slope(k - 1) } else { 0.0 };
        let after = if k + 2 < points.len() { slope(k + 1) } else { f64::INFINITY };
        if before > slope(k) || slope(k) > after {
            all[count] = [p, u];
            all[count + 1] = [q, v];
            count += 2;
        } else {
            let meet = if after.is_finite() && after > before {
                ((v - u + before * p - after * q) / (before - after)).clamp(p, q)
            } else {
                q
            };
            all[count] = [meet, u + before * (meet - p)];
            count += 1;
        }
    }
    (all, count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::bound::law::{axis_off, floored_mean};
    use crate::radio::pattern::antenna_axis;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::f64::consts::TAU;

    #[test]
    fn val_curves_are_below_the_mean_of_every_axis() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let degrees = [1.0_f64, 2.0, 5.0, 10.0];
        let mut hearings = degrees.map(|d| Hearing::new(d.to_radians()));
        let gain = Gain { flat: 0.0, swing: 1.0 };
        let (mut over, mut under) = ([f64::NEG_INFINITY; 2], [[0.0_f64; 2]; 2]);
        for round in 0..2000 {
            let std = degrees[round % 4].to_radians();
            let scale =
                10.0_f64.powf(rng.random_range(-0.5..6.5)) / if round % 3 == 0 { std * std } else { 100.0 };
            let line_roll: f64 =
                if round % 5 == 0 { rng.random_range(1.2..1.57) } else { rng.random_range(0.0..1.3) };
            let line = antenna_axis(line_roll, 0.0, 0.0);
            let off = (std * 10.0_f64.powf(rng.random_range(-1.5..1.7))).min(FRAC_PI_2);
            // About what is heard, where the curve bends most, or none.
            let heard = scale * (off.sin().powi(2) + std * std);
            let floor = if round % 4 == 0 { 0.0 } else { heard * 10.0_f64.powf(rng.random_range(-1.0..1.0)) };
            let axis = axis_off(&line, off, rng.random_range(0.0..TAU));
            let truth = floored_mean(std, scale, floor, axis, &line);
            for (k, fine) in [false, true].into_iter().enumerate() {
                let curve = hearings[round % 4].curve(&gain, scale, floor, [line_roll; 2], false, fine);
                let bound = curve.at(off.sin().powi(2)).0.log2();
                over[k] = over[k].max(bound - truth);
                under[k][0] = under[k][0].max(truth - bound);
                under[k][1] += (truth - bound) / 2000.0;
            }
        }
        // Roughly and finely; the rough one has the fine one's margin on top of its own.
        println!("over {over:?}, under at most and in the mean {under:?}");
        for (over, [_, mean]) in over.into_iter().zip(under) {
            assert!(over < 0.25 * QUADRATURE && mean < 0.2, "{over} {mean}");
        }
    }
}
