//! The least harm to the user of J's axes at one angle off the exact null.

use std::f64::consts::FRAC_PI_2;

use super::law::{Law, Least, Offset, Range};
use super::link::Gain;

/// Parts of the circle of axes at one angle to the null.
const ARCS: usize = 8;
/// Nearer to the pole than so many standard deviations the circle is cut into arcs.
const STEEP: f64 = 4.0;
/// Shares of an angle off a line that are roll: bearings at which the least is taken.
const BEARINGS: [f64; 5] = [1.0, -1.0, 0.7, -0.7, 0.0];

/// A lower bound on l, and on its slope over log2 of the power, over rolls of the line and axes `off` from the null.
///
/// `sin^2(off/2) = sin^2(x/2) + cos(roll) cos(line roll) sin^2(y/2)`: the circle is cut into arcs of x, of which each has
/// a least y.
pub(super) fn least_harm(law: &Law, gains: &[Gain], power: f64, line: Range, off: f64) -> (f64, f64) {
    let harm = |gain: &Gain| {
        let (flat, power) = gain.apart(power);
        let (value, slope) = ideal_harm(law, power, line, off);
        (flat.log2() + value, (flat - 1.0 + slope) / flat)
    };
    gains.iter().map(harm).fold((f64::NEG_INFINITY, 0.0), |best, at| if at.0 > best.0 { at } else { best })
}

/// The same of a gain of `sin^2`.
fn ideal_harm(law: &Law, power: f64, line: Range, off: f64) -> (f64, f64) {
    let Least { mean, rise, .. } = least_off(law, power, 0.0, f64::INFINITY, line, off);
    (mean, rise)
}

/// The least of [`Law::least_within`] over axes `off` from a line of such a roll, or farther.
///
/// `sin^2(off/2) = sin^2(x/2) + cos(roll) cos(line roll) sin^2(y/2)`. About the pole the circle is cut into arcs of x, of which each has a
/// least y; elsewhere a few bearings stand for it: the mean changes little and evenly from the one to the next.
pub(super) fn least_off(law: &Law, scale: f64, floor: f64, share: f64, line: Range, off: f64) -> Least {
    let mut least = Least { mean: f64::INFINITY, rise: f64::INFINITY, most: 0.0 };
    let mut take = |x: Range, height: f64| {
        // Rolls are latitudes.
        let x = [x[0].max(-FRAC_PI_2 - line[1]), x[1].min(FRAC_PI_2 - line[0])];
        if x[0] > x[1] {
            return;
        }
        // The axis is no steeper than its nearest roll to the horizon's.
        let flattest = (line[0] + x[0].min(0.0)).max(0.0).cos();
        let square = height.max(0.0) / (flattest * line[0].cos()).max(1e-300);
        // No pitch makes up for it: no axis of the circle is here.
        if square > 1.0 + 1e-9 {
            return;
        }
        let y = 2.0 * square.min(1.0).sqrt().asin();
        let roll = [line[0] + x[0], (line[1] + x[1]).min(FRAC_PI_2)];
        let offset = Offset { roll, line_roll: line, roll_off: x, pitch_off: [y; 2] };
        let here = law.least_within(scale, floor, share, &offset);
        least = Least {
            mean: least.mean.min(here.mean),
            rise: least.rise.min(here.rise),
            most: least.most.max(here.most),
        };
    };
    let height = |x: f64| (0.5 * off).sin().powi(2) - (0.5 * x).sin().powi(2);
    if off == 0.0 {
        take([0.0; 2], 0.0);
        return least;
    }
    let steep = line[1] + off + STEEP * law.variance().sqrt() > FRAC_PI_2;
    if steep {
        for k in 0..ARCS {
            let [from, to] = [k, k + 1].map(|k| off * k as f64 / ARCS as f64);
            take([from, to], height(to));
            take([-to, -from], height(to));
        }
    } else {
        for bearing in BEARINGS {
            take([off * bearing; 2], height(off * bearing));
        }
        return least;
    }
    // Far off, where arcs pass the pole, they say little.
    let most = if share.is_finite() { least.most } else { f64::INFINITY };
    let (mean, rise) = law.straight_mean(scale, [floor, most], off);
    if mean > least.mean { Least { mean, rise, ..least } } else { least }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::bound::law::{STATED, TAKEN, axis_off, fine_mean};
    use crate::planner::bound::prepared::POINTS;
    use crate::planner::bound::view::QUADRATURE;
    use crate::radio::pattern::antenna_axis;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn val_least_harm_is_below_that_of_every_axis_of_its_class() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let laws = [1.0_f64, 2.0, 5.0, 10.0].map(|degrees| Law::new(degrees.to_radians(), POINTS));
        let (mut over, mut far) = (f64::NEG_INFINITY, Vec::new());
        for round in 0..600 {
            let law = &laws[round % 4];
            let std = law.variance().sqrt();
            let from: f64 = rng.random_range(0.0..1.5);
            let class = [from, (from + rng.random_range(0.0..0.1)).min(FRAC_PI_2)];
            let line_roll: f64 = rng.random_range(class[0]..=class[1]);
            let off = (std * 10.0_f64.powf(rng.random_range(-1.5..1.7))).min(FRAC_PI_2);
            let angle = (off * rng.random_range(1.0..1.25)).min(FRAC_PI_2);
            let line = antenna_axis(line_roll, 0.0, 0.0);
            let axis = axis_off(&line, angle, rng.random_range(0.0..TAU));
            let power = 10.0_f64.powf(rng.random_range(STATED)) / (std * std);
            let truth = fine_mean(std, power, axis, &line);
            let ideal = [Gain { flat: 0.0, swing: 1.0 }];
            let (bound, _) = least_harm(law, &ideal, power, class, off);
            over = over.max(bound - truth);
            assert!(
                bound <= truth + TAKEN * QUADRATURE,
                "std {std} class {class:?} off {off} axis {axis:?}: {bound} above {truth}"
            );
            if off > PI / 6.0 {
                far.push(truth - bound);
            }
        }
        // Far off, where a null was once counted, little is lost.
        let most = far.iter().copied().fold(0.0, f64::max);
        println!("over by {over:.4}; beyond 30 deg under by {most:.2} at most, of {}", far.len());
        assert!(far.len() > 50 && most < 2.0, "{most}");
    }
}
