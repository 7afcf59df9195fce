//! The pattern itself, angle by angle: the mean of what was heard at each, whatever an antenna should be.

use std::f64::consts::PI;

use serde::Serialize;

use super::model::{Parameters, View};

/// From one angle to the next, degrees.
const STEP_DEG: f64 = 5.0;
/// A reading counts for an angle within this: further off, the pattern may be another, most of all next to a null.
const NEAR_DEG: f64 = STEP_DEG / 4.0;
/// Fewer readings are no mean.
const FEWEST: usize = 5;

/// The gain at one angle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PatternPoint {
    /// From the antenna's axis, body z.
    pub angle_deg: f64,
    /// Over the largest.
    pub gain_db: f64,
    /// Of the mean; `null` where there are too few readings, and the gain is that of the dipole with the floor found.
    pub standard_error_db: Option<f64>,
    /// By how much it is above the dipole with the floor found, dB.
    pub above_dipole_db: f64,
    /// Readings within a quarter of a step.
    pub readings: usize,
}

/// The gain at every fifth degree. `offs`: expected less received of each reading, dB, with parameters fitted as a dipole;
/// `blocks`: into as many parts of the log for the standard errors.
///
/// A mount or a compass that is off shows on opposite sides of the antenna with opposite signs, a pattern that is no dipole
/// all round it: so the first can be found with a dipole, and the second from what is left.
pub(super) fn pattern(
    parameters: &Parameters,
    views: &[View],
    offs: &[f64],
    blocks: usize,
) -> Vec<PatternPoint> {
    let steps = (180.0 / STEP_DEG) as usize;
    let mut sums = vec![(0usize, 0.0); steps + 1];
    let bin = |view: &View| {
        let bin = ((view.angle / PI * steps as f64).round() as usize).min(steps);
        ((view.angle.to_degrees() - bin as f64 * STEP_DEG).abs() <= NEAR_DEG).then_some(bin)
    };
    for (view, off) in views.iter().zip(offs) {
        if let Some(bin) = bin(view) {
            let (count, sum) = &mut sums[bin];
            *count += 1;
            *sum -= off;
        }
    }
    let means: Vec<f64> =
        sums.iter().map(|&(count, sum)| if count < FEWEST { 0.0 } else { sum / count as f64 }).collect();
    // What the readings of one block have in common counts once.
    let length = views.len().div_ceil(blocks.max(1)).max(1);
    let mut squares = vec![0.0; steps + 1];
    for (views, offs) in views.chunks(length).zip(offs.chunks(length)) {
        let mut block = vec![0.0; steps + 1];
        for (view, off) in views.iter().zip(offs) {
            if let Some(bin) = bin(view) {
                block[bin] -= off + means[bin];
            }
        }
        squares.iter_mut().zip(block).for_each(|(square, sum)| *square += sum * sum);
    }
    let mut points: Vec<PatternPoint> = (0..=steps)
        .map(|k| {
            let angle_deg = k as f64 * STEP_DEG;
            let dipole_db = 10.0 * parameters.gain(angle_deg.to_radians().sin().powi(2)).log10();
            let count = sums[k].0;
            PatternPoint {
                angle_deg,
                gain_db: dipole_db + means[k],
                standard_error_db: (count >= FEWEST).then(|| squares[k].sqrt() / count as f64),
                above_dipole_db: means[k],
                readings: count,
            }
        })
        .collect();
    let largest_db = points.iter().map(|point| point.gain_db).fold(f64::NEG_INFINITY, f64::max);
    points.iter_mut().for_each(|point| point.gain_db -= largest_db);
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn val_a_pattern_is_the_dipole_and_what_is_left_of_the_readings() {
        let parameters = Parameters {
            level_dbm: 0.0,
            leak: 0.1,
            heading_deg: 0.0,
            mounting_deg: [0.0; 2],
            position_enu_m: Vector3::zeros(),
        };
        // Twelve readings at 90 deg that are 1 dB stronger than expected or as expected, block by block; twelve at 0 deg
        // that are 2 dB weaker.
        let view = |angle: f64| View { distance_m: 1.0, angle, sine_squared: angle.sin().powi(2) };
        let mut views = Vec::new();
        let mut offs = Vec::new();
        for block in 0..4 {
            for _ in 0..3 {
                views.extend([view(PI / 2.0), view(0.01)]);
                offs.extend([if block % 2 == 0 { -1.0 } else { 0.0 }, 2.0]);
            }
        }
        let points = pattern(&parameters, &views, &offs, 4);
        let at = |deg: f64| points.iter().find(|p| p.angle_deg == deg).unwrap();
        // Blocks of three are off their mean by 1.5: 4 * 1.5^2 under the root, over 12.
        assert!((at(90.0).standard_error_db.unwrap() - 0.25).abs() < 1e-12);
        assert_eq!((at(90.0).gain_db, at(90.0).above_dipole_db, at(90.0).readings), (0.0, 0.5, 12));
        assert!((at(0.0).gain_db + 22.5).abs() < 1e-12 && at(0.0).standard_error_db == Some(0.0));
        assert_eq!((at(45.0).standard_error_db, at(45.0).readings), (None, 0));
    }
}
