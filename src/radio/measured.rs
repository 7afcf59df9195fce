//! A measured antenna pattern: gain over the angle from the axis, between the points by PCHIP in linear units.
//!
//! PCHIP (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 1984) is a cubic Hermite interpolant that is monotone
//! wherever the points are: at an inner point the slope is the weighted harmonic mean of those of the two intervals, or
//! 0 at a turning point; at an end, the three-point formula, limited so as to keep the shape. No interpolated gain lies
//! outside those of the neighbouring points.

use std::f64::consts::PI;

/// The heading of a pattern's file.
pub const COLUMNS: [&str; 2] = ["angle_deg", "gain_db"];
/// Points that a pattern may have.
pub const POINTS: std::ops::RangeInclusive<usize> = 3..=2000;
/// The least gain that is told from none, in dB.
pub const LEAST_DB: f64 = -200.0;
/// How far the largest gain may lie below 0 dB.
const LARGEST_SLACK_DB: f64 = 0.05;
/// Angles between the points of the rule that integrates a pattern are at most this, in radians.
const RULE_STEP: f64 = PI / 180.0;

/// Why points make no pattern.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeasuredError {
    /// Too few to interpolate between, or too many.
    #[error("holds {points} points; give {} to {}", POINTS.start(), POINTS.end())]
    Count {
        /// Points given.
        points: usize,
    },
    /// The first or the last angle is missing, or one does not rise.
    #[error(
        "has the angle {angle_deg} deg as point {number}; angles rise from 0 deg, along the axis, to 180 deg"
    )]
    Angle {
        /// Which point, from 1.
        number: usize,
        /// Its angle.
        angle_deg: f64,
    },
    /// A gain that is none, or below what is told from none.
    #[error("has the gain {gain_db} dB as point {number}; give dB below the largest gain, {LEAST_DB} to 0")]
    Gain {
        /// Which point, from 1.
        number: usize,
        /// Its gain.
        gain_db: f64,
    },
    /// The gains are not relative to the largest.
    #[error(
        "has a largest gain of {largest_db} dB; subtract it from every gain, so that the largest is 0 dB"
    )]
    Largest {
        /// The largest gain.
        largest_db: f64,
    },
    /// A line of the file is no point.
    #[error("says {text:?} in line {line}, which is not two numbers, `angle_deg,gain_db`")]
    Line {
        /// Which line, from 1.
        line: usize,
        /// What it says.
        text: String,
    },
    /// The file does not begin with its columns' names.
    #[error("begins with {text:?} and not with the line `angle_deg,gain_db`")]
    Heading {
        /// What it begins with.
        text: String,
    },
}

/// A pattern between measured points.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Angle in radians, gain (linear) and slope per radian, by rising angle.
    knots: Vec<[f64; 3]>,
    mean: f64,
    is_symmetric: bool,
}

/// The points of a pattern's file: CSV with the heading `angle_deg,gain_db`; empty lines and lines from `#` on are passed
/// over.
///
/// # Errors
/// [`MeasuredError`] names the line that is none.
pub fn points_of_csv(text: &str) -> Result<Vec<[f64; 2]>, MeasuredError> {
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let heading = lines.next().map_or("", |(_, line)| line);
    if !heading.split(',').map(str::trim).eq(COLUMNS) {
        return Err(MeasuredError::Heading { text: heading.chars().take(60).collect() });
    }
    lines
        .map(|(line, text)| {
            let mut numbers = text.split(',').map(|number| number.trim().parse::<f64>().ok());
            match (numbers.next().flatten(), numbers.next().flatten(), numbers.next()) {
                (Some(angle_deg), Some(gain_db), None) => Ok([angle_deg, gain_db]),
                _ => Err(MeasuredError::Line { line, text: text.chars().take(60).collect() }),
            }
        })
        .collect()
}

impl Measured {
    /// The pattern through points of angle in degrees and gain in dB below the largest.
    ///
    /// # Errors
    /// [`MeasuredError`] names the first point that is wrong.
    pub fn new(points: &[[f64; 2]]) -> Result<Self, MeasuredError> {
        check(points)?;
        let angles: Vec<f64> = points.iter().map(|[deg, _]| deg * (PI / 180.0)).collect();
        let gains: Vec<f64> = points.iter().map(|[_, db]| libm::pow(10.0, db / 10.0)).collect();
        let slopes = slopes(&angles, &gains);
        let knots: Vec<[f64; 3]> = (0..points.len()).map(|k| [angles[k], gains[k], slopes[k]]).collect();
        let mirrored = |k: usize| (points[k], points[points.len() - 1 - k]);
        // Of points that were computed the last digits differ.
        let alike = |a: f64, b: f64| (a - b).abs() < 1e-9;
        let is_symmetric = (0..points.len()).all(|k| {
            let ([deg, db], [other_deg, other_db]) = mirrored(k);
            alike(deg, 180.0 - other_deg) && alike(db, other_db)
        });
        let mut pattern = Self { knots, mean: 0.0, is_symmetric };
        pattern.mean = pattern.integrate();
        Ok(pattern)
    }

    /// Whether the gain is the same at an angle and at 180 deg less that angle.
    #[must_use]
    pub fn is_symmetric(&self) -> bool {
        self.is_symmetric
    }

    /// Mean over the sphere.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// The least gain.
    #[must_use]
    pub fn least(&self) -> f64 {
        // The interpolant is monotone between points.
        self.knots.iter().map(|knot| knot[1]).fold(f64::INFINITY, f64::min)
    }

    /// Gain and its derivative per radian at an angle from the axis, in radians.
    #[must_use]
    pub fn gain_and_slope(&self, angle: f64) -> (f64, f64) {
        let last = self.knots.len() - 1;
        let after = self.knots.partition_point(|knot| knot[0] <= angle).clamp(1, last);
        let ([from, g0, d0], [to, g1, d1]) = (self.knots[after - 1], self.knots[after]);
        let h = to - from;
        let s = ((angle - from) / h).clamp(0.0, 1.0);
        let (rise, lean) = (g1 - g0, [d0 * h, d1 * h]);
        // Hermite's cubic: g0 + s (lean0 + s (q + s r)).
        let (q, r) = (3.0 * rise - 2.0 * lean[0] - lean[1], lean[0] + lean[1] - 2.0 * rise);
        let gain = g0 + s * (lean[0] + s * (q + s * r));
        (gain, (lean[0] + s * (2.0 * q + s * 3.0 * r)) / h)
    }

    /// `1/2 int G sin` over the angle, by Gauss's rule of three points on parts of at most a degree.
    fn integrate(&self) -> f64 {
        let node = (3.0f64 / 5.0).sqrt();
        let mut sum = 0.0;
        for pair in self.knots.windows(2) {
            let ([from, ..], [to, ..]) = (pair[0], pair[1]);
            let parts = ((to - from) / RULE_STEP).ceil().max(1.0);
            let half = (to - from) / (2.0 * parts);
            for part in 0..parts as usize {
                let middle = from + half * (2.0 * part as f64 + 1.0);
                for (at, weight) in [(-node, 5.0), (0.0, 8.0), (node, 5.0)] {
                    let angle = middle + half * at;
                    sum += half * weight / 9.0 * self.gain_and_slope(angle).0 * libm::sin(angle);
                }
            }
        }
        sum / 2.0
    }
}

fn check(points: &[[f64; 2]]) -> Result<(), MeasuredError> {
    if !POINTS.contains(&points.len()) {
        return Err(MeasuredError::Count { points: points.len() });
    }
    let last = points.len() - 1;
    for (index, [angle_deg, gain_db]) in points.iter().copied().enumerate() {
        let number = index + 1;
        let placed = (index > 0 || angle_deg == 0.0) && (index < last || angle_deg == 180.0);
        if !placed || !(index == 0 || angle_deg > points[index - 1][0]) {
            return Err(MeasuredError::Angle { number, angle_deg });
        }
        if !(gain_db.is_finite() && gain_db >= LEAST_DB) {
            return Err(MeasuredError::Gain { number, gain_db });
        }
    }
    let largest_db = points.iter().map(|[_, db]| *db).fold(f64::NEG_INFINITY, f64::max);
    if !(-LARGEST_SLACK_DB..=0.0).contains(&largest_db) {
        return Err(MeasuredError::Largest { largest_db });
    }
    Ok(())
}

/// PCHIP's slopes at the points (x, y), x rising, at least three of them.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let delta: Vec<f64> = y.windows(2).zip(&h).map(|(w, h)| (w[1] - w[0]) / h).collect();
    let mut out = vec![0.0; n];
    for k in 1..n - 1 {
        let (before, after) = (delta[k - 1], delta[k]);
        if before * after > 0.0 {
            let (w1, w2) = (2.0 * h[k] + h[k - 1], h[k] + 2.0 * h[k - 1]);
            out[k] = (w1 + w2) / (w1 / before + w2 / after);
        }
    }
    out[0] = end_slope(h[0], h[1], delta[0], delta[1]);
    out[n - 1] = end_slope(h[n - 2], h[n - 3], delta[n - 2], delta[n - 3]);
    out
}

/// The slope at an end, from the widths and slopes of its interval and the next one.
fn end_slope(h0: f64, h1: f64, delta0: f64, delta1: f64) -> f64 {
    let slope = ((2.0 * h0 + h1) * delta0 - h0 * delta1) / (h0 + h1);
    if slope * delta0 <= 0.0 {
        0.0
    } else if delta0 * delta1 <= 0.0 && slope.abs() > 3.0 * delta0.abs() {
        3.0 * delta0
    } else {
        slope
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn val_the_interpolant_is_pchip() {
        // Slopes by hand: gains 0.1, 1, 0.5, 0.25 at 0, 60, 90, 180 deg.
        let slopes = slopes(&[0.0, 60.0, 90.0, 180.0], &[0.1, 1.0, 0.5, 0.25]);
        let (d0, d1, d2) = (0.9 / 60.0, -0.5 / 30.0, -0.25 / 90.0);
        let inner = 360.0 / (210.0 / d1 + 150.0 / d2);
        let first = (150.0 * d0 - 60.0 * d1) / 90.0;
        // The last three-point slope would rise: it is 0.
        let last: f64 = (210.0 * d2 - 90.0 * d1) / 120.0;
        assert!(last > 0.0);
        for (got, expected) in slopes.iter().zip([first, 0.0, inner, 0.0]) {
            assert!((got - expected).abs() < 1e-15, "{slopes:?}");
        }
    }

    /// As SciPy 1.17's `PchipInterpolator` over radians and linear gain has it, and its `quad` the mean.
    #[test]
    fn val_an_outside_interpolant_is_the_same() {
        let points = [[0.0, -22.0], [20.0, -9.0], [90.0, 0.0], [150.0, -8.0], [180.0, -30.0]];
        let pattern = Measured::new(&points).unwrap();
        for (deg, expected) in [
            (3.0, 0.020_495_767_420_891_656),
            (10.0, 0.058_455_930_225_906_39),
            (45.0, 0.459_161_319_794_714),
            (100.0, 0.947_765_686_575_779_3),
            (149.0, 0.166_214_274_852_335_2),
            (151.0, 0.151_255_767_290_931_38),
            (170.0, 0.036_001_826_359_753_21),
            (179.0, 0.003_451_067_209_799_187),
        ] {
            let gain = pattern.gain_and_slope(f64::to_radians(deg)).0;
            assert!((gain - expected).abs() < 1e-14, "{deg}: {gain}");
        }
        assert!((pattern.mean() - 0.617_154_434_447_703).abs() < 1e-10, "{}", pattern.mean());
    }

    #[test]
    fn val_points_are_met_and_nothing_is_above_the_largest() {
        let points = [[0.0, -22.0], [20.0, -9.0], [90.0, 0.0], [150.0, -8.0], [180.0, -30.0]];
        let pattern = Measured::new(&points).unwrap();
        for [deg, db] in points {
            let gain = pattern.gain_and_slope(deg.to_radians()).0;
            assert!((10.0 * gain.log10() - db).abs() < 1e-9, "{deg}");
        }
        assert!((pattern.least() - 1e-3).abs() < 1e-12 && !pattern.is_symmetric());
        for k in 0..=3600 {
            let gain = pattern.gain_and_slope(PI * f64::from(k) / 3600.0).0;
            assert!((1e-3 - 1e-12..=1.0 + 1e-12).contains(&gain));
        }
    }

    #[test]
    fn spec_what_is_no_pattern_is_refused_with_its_place() {
        let say = |points: &[[f64; 2]]| Measured::new(points).unwrap_err().to_string();
        for (points, fragment) in [
            (vec![[0.0, 0.0], [180.0, 0.0]], "holds 2 points"),
            (vec![[5.0, -20.0], [90.0, 0.0], [180.0, -20.0]], "angle 5 deg as point 1"),
            (vec![[0.0, -20.0], [90.0, 0.0], [170.0, -20.0]], "angle 170 deg as point 3"),
            (vec![[0.0, -20.0], [90.0, 0.0], [90.0, 0.0], [180.0, -20.0]], "angle 90 deg as point 3"),
            (vec![[0.0, f64::NAN], [90.0, 0.0], [180.0, -20.0]], "gain NaN dB as point 1"),
            (vec![[0.0, -20.0], [90.0, 2.1], [180.0, -20.0]], "largest gain of 2.1 dB; subtract"),
            (vec![[0.0, -20.0], [90.0, -3.0], [180.0, -20.0]], "largest gain of -3 dB; subtract"),
        ] {
            assert!(say(&points).contains(fragment), "{}", say(&points));
        }
    }

    #[test]
    fn spec_a_file_is_read_by_its_columns() {
        let text = "# chamber 2\nangle_deg, gain_db\n0,-20\n\n90,0.0\n180, -2e1\n";
        assert_eq!(points_of_csv(text), Ok(vec![[0.0, -20.0], [90.0, 0.0], [180.0, -20.0]]));
        for (text, fragment) in [
            ("", "begins with \"\""),
            ("0,-20\n", "begins with \"0,-20\""),
            ("angle_deg,gain_db\n0\n", "says \"0\" in line 2"),
            ("angle_deg,gain_db\n0,1,2\n", "line 2"),
            ("angle_deg,gain_db\n\n0,x\n", "says \"0,x\" in line 3"),
        ] {
            let message = points_of_csv(text).unwrap_err().to_string();
            assert!(message.contains(fragment), "{message}");
        }
    }

    proptest! {
        /// Monotone between neighbouring points, whatever the points.
        #[test]
        fn prop_nothing_overshoots(db in prop::collection::vec(-40.0..0.0f64, 3..30)) {
            let last = db.len() - 1;
            let points: Vec<[f64; 2]> = db.iter().enumerate()
                .map(|(k, db)| [180.0 * k as f64 / last as f64, if k == 1 { 0.0 } else { *db }]).collect();
            let pattern = Measured::new(&points).unwrap();
            for pair in points.windows(2) {
                let ends = [pair[0][1], pair[1][1]].map(|db| 10f64.powf(db / 10.0));
                let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
                for k in 0..=20 {
                    let deg = pair[0][0] + (pair[1][0] - pair[0][0]) * f64::from(k) / 20.0;
                    let gain = pattern.gain_and_slope(deg.to_radians()).0;
                    prop_assert!((low - 1e-9..=high + 1e-9).contains(&gain), "{deg}: {gain}");
                }
            }
        }
    }
}
