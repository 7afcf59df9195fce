//! The line search of both active-set methods.

/// Least part of the decrease that the slope promises.
const ARMIJO: f64 = 1e-4;
/// A step is too short while the slope at its end is steeper than this part of the first.
const CURVATURE: f64 = 0.9;
const EVALUATIONS: usize = 20;

/// Searches from `value`, where the function falls by `slope` per unit of length, up to `longest`. `at` gives the value and
/// whatever belongs to the point at a length, `slope_of` the slope there. The best acceptable point: its value, itself, its
/// length; `None` if there was none.
pub(super) fn search<P>(
    (value, slope): (f64, f64),
    longest: f64,
    mut at: impl FnMut(f64) -> (f64, P),
    slope_of: impl Fn(&P) -> f64,
) -> Option<(f64, P, f64)> {
    let mut length = longest.min(1.0);
    let (mut low, mut high) = (0.0, None::<f64>);
    let mut best: Option<(f64, P, f64)> = None;
    for _ in 0..EVALUATIONS {
        let (there, point) = at(length);
        // Not `there > ...`: NaN must fail too.
        if !(there <= value + ARMIJO * length * slope) {
            let curvature = (there - value - length * slope) / (length * length);
            let minimum = if curvature.is_finite() { -slope / (2.0 * curvature) } else { 0.0 };
            high = Some(length);
            length = minimum.clamp(low + 0.1 * (length - low), low + 0.5 * (length - low));
            continue;
        }
        let improves = best.as_ref().is_none_or(|b| there < b.0);
        let too_short = slope_of(&point) < CURVATURE * slope;
        if improves {
            best = Some((there, point, length));
        }
        if !too_short || length >= longest || !improves {
            break;
        }
        low = length;
        length = high.map_or((3.0 * length).min(longest), |h| 0.5 * (low + h));
    }
    best
}
