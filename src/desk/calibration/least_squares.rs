//! Nonlinear least squares by Levenberg and Marquardt's method, for a handful of parameters and many residuals.
//!
//! Minimises `sum_i r_i(p)^2 + sum_k (p_k / s_k)^2`: the second sum is what is known of a parameter beforehand, a mean of 0
//! and a deviation s_k in units of a residual of 1 (infinite: nothing). Each step solves
//! `(J'J + S^-2 + lambda diag) dp = -(J'r + S^-2 p)`; lambda falls by 10 after a step that helps and grows by 10 after one
//! that does not (Marquardt 1963). The Jacobian is taken by central differences with steps of 1e-4, so that a parameter's
//! unit must be chosen such that 1 is a fair change of it.
//!
//! The covariance is `H^-1 (sum_b g_b g_b' + S^-2) H^-1`, H = J'J + S^-2, over blocks b of successive residuals with
//! `g_b = H (H - H_b)^-1 J_b' r_b`, H_b = J_b'J_b: it holds whatever the residuals' deviations, and whatever their correlation
//! within a block (the cluster-robust or sandwich form; Liang and Zeger 1986). The inverse makes up for what a block's own
//! residuals were fitted away by, and rather by more, so that few blocks are enough (Bell and McCaffrey 2002, the jackknife).

use nalgebra::{SMatrix, SVector};

const DIFFERENCE: f64 = 1e-4;
const MOST_STEPS: usize = 100;
/// A step this small in every parameter is none.
const SMALLEST_STEP: f64 = 1e-7;
const MOST_DAMPING: f64 = 1e12;

/// A minimum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Minimum<const N: usize> {
    pub parameters: SVector<f64, N>,
    pub covariance: SMatrix<f64, N, N>,
    pub converged: bool,
}

/// Residual and gradient of one reading.
struct Line<const N: usize> {
    residual: f64,
    gradient: SVector<f64, N>,
}

/// The problem: `count` residuals, what is known beforehand, and the number of blocks for the covariance.
pub(super) struct Problem<const N: usize, R: Fn(usize, &SVector<f64, N>) -> f64> {
    pub residual: R,
    pub count: usize,
    pub deviations: [f64; N],
    pub blocks: usize,
}

impl<const N: usize, R: Fn(usize, &SVector<f64, N>) -> f64> Problem<N, R> {
    /// From `start` downhill. `None` where a residual is no number.
    pub fn minimise(&self, start: [f64; N]) -> Option<Minimum<N>> {
        let mut parameters = SVector::from(start);
        let mut cost = self.cost(&parameters);
        let mut damping = 1e-3;
        let mut converged = false;
        let mut lines = self.lines(&parameters);
        for _ in 0..MOST_STEPS {
            let (curvature, slope) = self.normal(&lines, &parameters);
            let step = self.step(&curvature, &slope, damping)?;
            let next = parameters + step;
            let next_cost = self.cost(&next);
            if next_cost <= cost {
                (parameters, cost) = (next, next_cost);
                lines = self.lines(&parameters);
                damping = (damping / 10.0).max(1e-12);
                converged = step.amax() < SMALLEST_STEP;
            } else {
                damping *= 10.0;
                converged = step.amax() < SMALLEST_STEP || damping > MOST_DAMPING;
            }
            if converged {
                break;
            }
        }
        let covariance = self.covariance(&lines, &parameters)?;
        let finite = cost.is_finite() && covariance.iter().all(|v| v.is_finite());
        finite.then_some(Minimum { parameters, covariance, converged })
    }

    /// What is known beforehand, as a curvature.
    fn known(&self) -> SVector<f64, N> {
        SVector::from(self.deviations.map(|s| (s * s).recip()))
    }

    fn cost(&self, parameters: &SVector<f64, N>) -> f64 {
        let data: f64 = (0..self.count).map(|i| (self.residual)(i, parameters).powi(2)).sum();
        data + self.known().component_mul(parameters).dot(parameters)
    }

    fn lines(&self, parameters: &SVector<f64, N>) -> Vec<Line<N>> {
        let line = |i| Line {
            residual: (self.residual)(i, parameters),
            gradient: SVector::from_fn(|k, _| {
                let at = |by: f64| {
                    let mut moved = *parameters;
                    moved[k] += by;
                    (self.residual)(i, &moved)
                };
                (at(DIFFERENCE) - at(-DIFFERENCE)) / (2.0 * DIFFERENCE)
            }),
        };
        (0..self.count).map(line).collect()
    }

    /// Half the Hessian (Gauss-Newton) and half the gradient of the cost.
    fn normal(
        &self,
        lines: &[Line<N>],
        parameters: &SVector<f64, N>,
    ) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
        let known = self.known();
        let mut curvature = SMatrix::from_diagonal(&known);
        let mut slope = known.component_mul(parameters);
        for Line { residual, gradient } in lines {
            curvature.ger(1.0, gradient, gradient, 1.0);
            slope.axpy(*residual, gradient, 1.0);
        }
        (curvature, slope)
    }

    fn step(
        &self,
        curvature: &SMatrix<f64, N, N>,
        slope: &SVector<f64, N>,
        damping: f64,
    ) -> Option<SVector<f64, N>> {
        let damped = curvature + SMatrix::from_diagonal(&(curvature.diagonal() * damping));
        damped.cholesky().map(|factor| -factor.solve(slope))
    }

    fn covariance(&self, lines: &[Line<N>], parameters: &SVector<f64, N>) -> Option<SMatrix<f64, N, N>> {
        let (curvature, _) = self.normal(lines, parameters);
        let inverse = curvature.cholesky()?.inverse();
        let blocks = self.blocks.clamp(1, lines.len().max(1));
        let mut scatter = SMatrix::<f64, N, N>::zeros();
        for block in lines.chunks(lines.len().div_ceil(blocks).max(1)) {
            let (mut sum, mut own) = (SVector::<f64, N>::zeros(), SMatrix::<f64, N, N>::zeros());
            for line in block {
                sum.axpy(line.residual, &line.gradient, 1.0);
                own.ger(1.0, &line.gradient, &line.gradient, 1.0);
            }
            // What one block alone decides is known by nothing else: no number follows.
            let sum = curvature * (curvature - own).cholesky()?.solve(&sum);
            scatter.ger(1.0, &sum, &sum, 1.0);
        }
        let spare = (blocks as f64 - 1.0) / blocks as f64;
        let middle = scatter * spare + SMatrix::from_diagonal(&self.known());
        Some(inverse * middle * inverse)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn normal(rng: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
    }

    #[test]
    fn val_a_straight_line_has_the_textbooks_solution() {
        // y = a + b x: b = Sxy/Sxx, a = mean y - b mean x.
        let data: [(f64, f64); 5] = [(0.0, 1.0), (1.0, 2.9), (2.0, 5.2), (3.0, 6.8), (5.0, 11.1)];
        let problem = Problem {
            residual: |i: usize, p: &SVector<f64, 2>| p[0] + p[1] * data[i].0 - data[i].1,
            count: data.len(),
            deviations: [f64::INFINITY; 2],
            blocks: 5,
        };
        let found = problem.minimise([0.0, 0.0]).unwrap();
        let (mx, my) = (11.0 / 5.0, 27.0 / 5.0);
        let sxy: f64 = data.iter().map(|(x, y)| (x - mx) * (y - my)).sum();
        let sxx: f64 = data.iter().map(|(x, _)| (x - mx).powi(2)).sum();
        assert!(found.converged);
        assert!((found.parameters[1] - sxy / sxx).abs() < 1e-8, "{}", found.parameters);
        assert!((found.parameters[0] - (my - sxy / sxx * mx)).abs() < 1e-8);
    }

    #[test]
    fn val_a_curved_fit_and_its_covariance_over_many_samples() {
        // y = a exp(-b x) with noise that is correlated over a few values: what is stated must be what scatters.
        let (a, b) = (2.0, 0.7);
        let x = |i: usize| 4.0 * i as f64 / 600.0;
        let (mut squares, mut stated) = ([0.0; 2], [0.0; 2]);
        let samples = 200;
        for seed in 0..samples {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut slow = 0.0;
            let y: Vec<f64> = (0..600)
                .map(|i| {
                    slow = 0.6 * slow + 0.8 * normal(&mut rng);
                    a * f64::exp(-b * x(i)) + 0.05 * slow
                })
                .collect();
            let problem = Problem {
                residual: |i: usize, p: &SVector<f64, 2>| p[0] * (-p[1] * x(i)).exp() - y[i],
                count: y.len(),
                deviations: [f64::INFINITY; 2],
                blocks: 30,
            };
            let found = problem.minimise([1.0, 0.1]).unwrap();
            assert!(found.converged);
            for (k, truth) in [a, b].into_iter().enumerate() {
                squares[k] += (found.parameters[k] - truth).powi(2);
                stated[k] += found.covariance[(k, k)];
            }
        }
        for k in 0..2 {
            // 200 samples know a deviation to 5%; what is stated is rather too much, most of all where few blocks decide.
            assert!((0.9..1.3).contains(&(stated[k] / squares[k]).sqrt()), "{k}: {stated:?} {squares:?}");
        }
    }

    #[test]
    fn spec_what_the_data_do_not_show_stays_as_uncertain_as_it_was() {
        let problem = Problem {
            residual: |i: usize, p: &SVector<f64, 2>| p[0] - i as f64,
            count: 9,
            deviations: [f64::INFINITY, 3.0],
            blocks: 9,
        };
        let found = problem.minimise([0.0, 1.0]).unwrap();
        assert!((found.parameters[0] - 4.0).abs() < 1e-8 && found.parameters[1].abs() < 1e-6);
        assert!((found.covariance[(1, 1)] - 9.0).abs() < 1e-6, "{}", found.covariance);
    }
}
