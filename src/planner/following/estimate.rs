//! Where something that moves is believed to be: a Kalman filter of constant velocity, whose variance grows while nothing is
//! heard.
//!
//! ```text
//! x = (p, v),   p' = v,   v' = white noise of density q,     (MODEL 9.5)
//! P(t + dt) = F P F^T + q [dt^3/3, dt^2/2; dt^2/2, dt],      F = [1, dt; 0, 1]
//! ```
//!
//! Axes are independent of each other: east and north alike, up by itself.

use crate::geo::{Enu, EnuVelocity};

/// What somebody says of a place, of himself or of another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// When it was so, in seconds of the clock that both vehicles share.
    pub at_s: f64,
    /// Where, in metres, ENU.
    pub position_enu_m: Enu,
    /// Standard deviations in metres: of east and of north, and of up; positive.
    pub std_m: [f64; 2],
}

/// How something moves, as far as that is known beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unrest {
    /// Standard deviations of its velocity in m/s before anything was heard of it twice: of east and of north, and of up.
    pub speed_std_m_s: [f64; 2],
    /// Densities of its acceleration's noise in m^2/s^3, likewise.
    pub density_m2_s3: [f64; 2],
}

impl Unrest {
    /// Who walks: 1.5 m/s, and round a corner in some seconds.
    pub const WALKS: Self = Self { speed_std_m_s: [1.5, 0.1], density_m2_s3: [0.1, 0.001] };
    /// Who drives.
    pub const DRIVES: Self = Self { speed_std_m_s: [8.0, 0.3], density_m2_s3: [1.0, 0.01] };
}

/// One axis: mean and covariance of position and velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Axis {
    mean: [f64; 2],
    /// Of position, of both, of velocity.
    covariance: [f64; 3],
}

impl Axis {
    fn after(&self, dt_s: f64, density: f64) -> Self {
        let [p, v] = self.mean;
        let [pp, pv, vv] = self.covariance;
        Self {
            mean: [p + dt_s * v, v],
            covariance: [
                pp + 2.0 * dt_s * pv + dt_s * dt_s * vv + density * dt_s * dt_s * dt_s / 3.0,
                pv + dt_s * vv + density * dt_s * dt_s / 2.0,
                vv + density * dt_s,
            ],
        }
    }

    fn take(&mut self, measured: f64, std: f64) {
        let [pp, pv, vv] = self.covariance;
        let gains = [pp, pv].map(|c| c / (pp + std * std));
        let off = measured - self.mean[0];
        for k in 0..2 {
            self.mean[k] += gains[k] * off;
        }
        self.covariance = [pp - gains[0] * pp, pv - gains[0] * pv, vv - gains[1] * pv];
    }
}

/// What is believed of one thing that moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    unrest: Unrest,
    at_s: f64,
    axes: [Axis; 3],
}

/// Where it is believed to be at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belief {
    /// In metres, ENU.
    pub position_enu_m: Enu,
    /// In m/s, ENU.
    pub velocity_enu_m_s: EnuVelocity,
    /// Standard deviations of the position in metres: of east and of north, and of up.
    pub std_m: [f64; 2],
}

/// What is believed from an instant on, in as few numbers as can be told another: evenly onwards, and known as well as then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// The instant, in seconds.
    pub at_s: f64,
    /// What is believed then.
    pub belief: Belief,
}

impl Drift {
    /// Where it is believed to be at an instant, before that one too.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Belief {
        let way_m = self.belief.velocity_enu_m_s.vector() * (t_s - self.at_s);
        Belief { position_enu_m: self.belief.position_enu_m + way_m, ..self.belief }
    }
}

/// East and north are alike.
fn kind(axis: usize) -> usize {
    usize::from(axis == 2)
}

impl Estimate {
    /// What one report says.
    #[must_use]
    pub fn new(report: &Report, unrest: Unrest) -> Self {
        let axes = std::array::from_fn(|k| {
            let (std_m, speed) = (report.std_m[kind(k)], unrest.speed_std_m_s[kind(k)]);
            Axis { mean: [report.position_enu_m[k], 0.0], covariance: [std_m * std_m, 0.0, speed * speed] }
        });
        Self { unrest, at_s: report.at_s, axes }
    }

    /// Takes another report; one that is older than the last is of no use, and one that is no number neither. Whether it was
    /// taken.
    pub fn take(&mut self, report: &Report) -> bool {
        let numbers = report.position_enu_m.iter().chain(&report.std_m).all(|x| x.is_finite());
        let usable = numbers && report.std_m.iter().all(|std_m| *std_m > 0.0);
        if !(usable && report.at_s >= self.at_s) {
            return false;
        }
        let dt_s = report.at_s - self.at_s;
        for k in 0..3 {
            let mut axis = self.axes[k].after(dt_s, self.unrest.density_m2_s3[kind(k)]);
            axis.take(report.position_enu_m[k], report.std_m[kind(k)]);
            self.axes[k] = axis;
        }
        self.at_s = report.at_s;
        true
    }

    /// When what it rests on was so, in seconds.
    #[must_use]
    pub fn at_s(&self) -> f64 {
        self.at_s
    }

    /// Where it is believed to be at an instant after the last report (or at that report, if asked for before).
    #[must_use]
    pub fn at(&self, t_s: f64) -> Belief {
        let dt_s = (t_s - self.at_s).max(0.0);
        let axes: [Axis; 3] =
            std::array::from_fn(|k| self.axes[k].after(dt_s, self.unrest.density_m2_s3[kind(k)]));
        Belief {
            position_enu_m: Enu::from_fn(|k, _| axes[k].mean[0]),
            velocity_enu_m_s: EnuVelocity::from_vector(Enu::from_fn(|k, _| axes[k].mean[1])),
            std_m: [axes[0], axes[2]].map(|axis| axis.covariance[0].sqrt()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn report(at_s: f64, east_m: f64) -> Report {
        Report { at_s, position_enu_m: Enu::new(east_m, -2.0 * east_m, 0.0), std_m: [3.0, 1.0] }
    }

    #[test]
    fn val_one_axis_is_the_filter_of_the_textbook_in_matrices() {
        let unrest = Unrest::WALKS;
        let mut estimate = Estimate::new(&report(0.0, 4.0), unrest);
        let (mut x, mut p) = (Vector2::new(4.0, 0.0), Matrix2::new(9.0, 0.0, 0.0, 2.25));
        for (at_s, dt, z) in [(1.0, 1.0, 5.0), (3.5, 2.5, 9.0), (3.5, 0.0, 8.0), (4.0, 0.5, 11.0)] {
            assert!(estimate.take(&report(at_s, z)));
            let f = Matrix2::new(1.0, dt, 0.0, 1.0);
            let q = Matrix2::new(dt * dt * dt / 3.0, dt * dt / 2.0, dt * dt / 2.0, dt) * 0.1;
            (x, p) = (f * x, f * p * f.transpose() + q);
            let h = nalgebra::RowVector2::new(1.0, 0.0);
            let k = p * h.transpose() / ((h * p * h.transpose())[0] + 9.0);
            (x, p) = (x + k * (z - x[0]), (Matrix2::identity() - k * h) * p);
            let now = estimate.at(at_s);
            assert!((now.position_enu_m.x - x[0]).abs() < 1e-12);
            assert!((now.velocity_enu_m_s.vector().x - x[1]).abs() < 1e-12);
            assert!((now.position_enu_m.y + 2.0 * x[0]).abs() < 1e-9);
            assert!((now.std_m[0] - p[(0, 0)].sqrt()).abs() < 1e-12);
        }
    }

    #[test]
    fn spec_what_is_older_or_no_number_changes_nothing_and_silence_makes_it_less_certain() {
        let mut estimate = Estimate::new(&report(10.0, 4.0), Unrest::WALKS);
        let before = estimate;
        let mut useless =
            [report(9.9, 1.0), report(11.0, f64::NAN), report(11.0, 1.0), report(f64::NAN, 1.0)];
        useless[2].std_m = [0.0, 1.0];
        for report in &useless {
            assert!(!estimate.take(report), "{report:?}");
        }
        assert_eq!(estimate, before);
        let stds = [10.0, 11.0, 15.0, 30.0].map(|t_s| estimate.at(t_s).std_m[0]);
        assert!(stds.windows(2).all(|pair| pair[0] < pair[1]), "{stds:?}");
        // Asked for a time before, it says what it last heard.
        assert_eq!(estimate.at(3.0), estimate.at(10.0));
    }

    #[test]
    fn val_errors_are_as_large_as_it_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut normal = || crate::planner::expectation::normal::quantile(rng.random());
        let (mut squares, runs) = (0.0, 400);
        for _ in 0..runs {
            // It moves as the filter thinks that it does.
            let (unrest, dt) = (Unrest::WALKS, 0.1);
            let (mut p, mut v) = (0.0, 1.5 * normal());
            let mut estimate = Estimate::new(&report(0.0, p + 3.0 * normal()), unrest);
            for step in 1..=200 {
                v += (0.1f64 * dt).sqrt() * normal();
                p += v * dt;
                if step % 10 == 0 && step % 50 != 0 {
                    estimate.take(&report(f64::from(step) * dt, p + 3.0 * normal()));
                }
            }
            let now = estimate.at(20.0);
            squares += ((now.position_enu_m.x - p) / now.std_m[0]).powi(2);
        }
        let ratio = squares / f64::from(runs);
        assert!((ratio - 1.0).abs() < 0.25, "{ratio}");
    }

    /// Straight on for 8 to 25 s, then round a corner of up to a right angle, at 0.4 rad/s; a report a second, a fifth of them lost.
    #[test]
    fn val_errors_of_one_that_goes_round_corners_are_as_large_as_it_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        for unrest in [Unrest::WALKS, Unrest::DRIVES] {
            let step_m = 0.1 * unrest.speed_std_m_s[0];
            let (mut heading, mut off, mut corner) = (0.0, 0.0, 0);
            let mut at = Enu::zeros();
            let mut estimate =
                Estimate::new(&Report { at_s: 0.0, position_enu_m: at, std_m: [3.0, 1.0] }, unrest);
            let (mut errors, mut said) = (0.0, 0.0);
            for step in 1..=40_000_u32 {
                if step >= corner {
                    off = std::f64::consts::PI * (rng.random::<f64>() - 0.5);
                    corner = step + rng.random_range(80..250);
                }
                let turn = f64::clamp(off, -0.04, 0.04);
                (heading, off) = (heading + turn, off - turn);
                at += Enu::new(step_m * libm::cos(heading), step_m * libm::sin(heading), 0.0);
                let at_s = 0.1 * f64::from(step);
                if step % 10 == 5 {
                    let now = estimate.at(at_s);
                    errors += (now.position_enu_m - at).xy().norm_squared() / 2.0;
                    said += now.std_m[0] * now.std_m[0];
                }
                if step % 10 == 0 && rng.random::<f64>() > 0.2 {
                    let noise = Enu::from_fn(|_, _| {
                        3.0 * crate::planner::expectation::normal::quantile(rng.random())
                    });
                    estimate.take(&Report { at_s, position_enu_m: at + noise, std_m: [3.0, 1.0] });
                }
            }
            let ratio = (errors / said).sqrt();
            assert!((0.9..1.1).contains(&ratio), "{unrest:?}: {ratio}");
        }
    }
}
