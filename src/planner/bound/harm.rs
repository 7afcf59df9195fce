//! The least harm to the user of J's axes at one angle off the exact null.

use std::f64::consts::FRAC_PI_2;

use super::law::{Law, Offset, Range};

/// Parts of the circle of axes at one angle to the null.
const ARCS: usize = 8;

/// A lower bound on l, and on its slope over log2 of the power, over rolls of the line and axes `off` from the null.
///
/// `sin^2(off/2) = sin^2(x/2) + cos(roll) cos(line roll) sin^2(y/2)`: the circle is cut into arcs of x, of which each has
/// a least y.
pub(super) fn least_harm(law: &Law, power: f64, line: Range, off: f64) -> (f64, f64) {
    let at = |x: Range, y: f64| {
        let roll = [line[0] + x[0], (line[1] + x[1]).min(FRAC_PI_2)];
        let offset = Offset { roll, line_roll: line, roll_off: x, pitch_off: [y; 2] };
        law.least_mean(power, 0.0, &offset)
    };
    if off == 0.0 {
        return at([0.0; 2], 0.0);
    }
    let mut least = (f64::INFINITY, f64::INFINITY);
    for k in 0..ARCS {
        let [from, to] = [k, k + 1].map(|k| off * k as f64 / ARCS as f64);
        for x in [[from, to], [-to, -from]] {
            // Rolls are latitudes.
            let x = [x[0].max(-FRAC_PI_2 - line[1]), x[1].min(FRAC_PI_2 - line[0])];
            if x[0] > x[1] {
                continue;
            }
            // The axis is no steeper than its nearest roll to the horizon's.
            let flattest = (line[0] + x[0].min(0.0)).max(0.0).cos();
            let height = (0.5 * off).sin().powi(2) - (0.5 * to).sin().powi(2);
            let square = height.max(0.0) / (flattest * line[0].cos()).max(1e-300);
            // No pitch makes up for it: no axis of the circle is here.
            if square > 1.0 + 1e-9 {
                continue;
            }
            let sine = square.min(1.0).sqrt();
            let (value, slope) = at(x, 2.0 * sine.asin());
            least = (least.0.min(value), least.1.min(slope));
        }
    }
    // Far off, where arcs pass the pole, they say little.
    let straight = law.straight_mean(power, off);
    if straight.0 > least.0 { straight } else { least }
}
