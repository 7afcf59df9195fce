//! Figures 4a to 4c: mean secrecy rate over maximum transmit power.

use std::fmt::Write as _;

use super::scenario::{self, Conditions, Summary, per_hz};
use super::{Failure, Progress, Settings, Work};
use crate::planner::expectation::samples::Sequence;
use crate::planner::expectation::sobol::mix;
use crate::planner::problem::{Method, Problem};
use crate::planner::{EvaluateOptions, Options, PlanError, cap, evaluate, parallel, plan_slot};

/// The maximum transmit powers in W, both vehicles'.
pub const MAX_POWERS_W: [f64; 6] = [0.1, 0.3, 0.5, 0.7, 0.9, 1.1];
/// Samples by which every plan is scored.
const SCORE_SAMPLES: usize = 8192;

/// One of the three figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Study {
    /// 4a: desired attitudes are held exactly, eavesdroppers are where they are thought to be.
    Plain,
    /// 4b: roll and pitch of both vehicles jitter by [`JITTER_DEG`].
    Jitter,
    /// 4c: jitter, and eavesdroppers anywhere within [`UNCERTAINTY_M`] of their estimates.
    Uncertain,
}

/// Standard deviation of roll and pitch in figures 4b and 4c, in degrees.
pub const JITTER_DEG: f64 = 2.0;
/// Radius of the discs of figure 4c in metres.
pub const UNCERTAINTY_M: f64 = 50.0;

impl Study {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Plain, Self::Jitter, Self::Uncertain];

    /// File name without extension.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "figure-4a",
            Self::Jitter => "figure-4b",
            Self::Uncertain => "figure-4c",
        }
    }

    /// What holds at a maximum power.
    pub fn conditions(self, max_power_w: f64) -> Conditions {
        let (jitter_deg, uncertainty_m) = match self {
            Self::Plain => (0.0, 0.0),
            Self::Jitter => (JITTER_DEG, 0.0),
            Self::Uncertain => (JITTER_DEG, UNCERTAINTY_M),
        };
        Conditions { max_power_w, jitter_std_rad: f64::to_radians(jitter_deg), uncertainty_m }
    }

    /// Its curves, best first.
    pub fn curves(self) -> Vec<Curve> {
        let mut curves = vec![
            Curve { name: "cap", source: Source::Cap },
            Curve { name: "veilwing", source: Source::Planned(Method::Veilwing) },
            Curve { name: "paper", source: Source::OnEstimates(Method::Paper) },
            Curve { name: "interior-point", source: Source::OnEstimates(Method::InteriorPoint) },
            Curve { name: "conventional", source: Source::OnEstimates(Method::Conventional) },
        ];
        if self == Self::Uncertain {
            let on_estimates = Source::OnEstimates(Method::Veilwing);
            curves.insert(2, Curve { name: "veilwing-on-estimates", source: on_estimates });
        }
        curves
    }
}

/// A curve of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Curve {
    /// Its name in the CSV file.
    pub name: &'static str,
    /// Where its rates come from.
    pub source: Source,
}

/// Where rates come from. Every plan is scored under the figure's jitter and position uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// What no configuration exceeds.
    Cap,
    /// A plan that knows how uncertain the positions are, and maximises the mean.
    Planned(Method),
    /// A plan that takes the estimated positions for true.
    OnEstimates(Method),
}

/// A figure's numbers: one row a curve and power, in the order of [`Study::curves`], then [`MAX_POWERS_W`].
#[derive(Debug, Clone, PartialEq)]
pub struct Rates {
    /// Which figure.
    pub study: Study,
    /// Scenarios behind each mean.
    pub scenarios: usize,
    /// Mean rate in bit/s/Hz and its spread by curve, then power.
    pub curves: Vec<(Curve, Vec<Summary>)>,
}

/// Plans and scores every scenario, power and method of a figure.
///
/// # Errors
/// [`Failure`] if the planner refuses a problem.
pub fn measure(study: Study, settings: &Settings, progress: &Progress) -> Result<Rates, Failure> {
    let curves = study.curves();
    let powers = MAX_POWERS_W.len();
    let count = settings.scenarios * powers;
    let work = Work::new(study.name(), count, progress);
    let cells = parallel::map(settings.threads, count, |_: &mut (), cell| {
        let (index, power) = (cell / powers, cell % powers);
        let eavesdroppers = scenario::eavesdroppers(settings.seed, index);
        let problem = scenario::problem(&eavesdroppers, &study.conditions(MAX_POWERS_W[power]));
        let seed = mix(settings.seed, index as u64);
        let rates: Result<Vec<f64>, PlanError> =
            curves.iter().map(|curve| rate(curve.source, &problem, seed)).collect();
        work.one_done();
        rates.map_err(|error| Failure::Plan { figure: study.name(), scenario: index, error })
    });
    let cells: Vec<Vec<f64>> = cells.into_iter().collect::<Result<_, _>>()?;
    let summaries = |k: usize| {
        let at = |power: usize| {
            let values: Vec<f64> = cells.iter().skip(power).step_by(powers).map(|rates| rates[k]).collect();
            Summary::new(&values).ok_or(Failure::NoScenarios)
        };
        (0..powers).map(at).collect::<Result<Vec<_>, _>>()
    };
    let curves = curves
        .iter()
        .enumerate()
        .map(|(k, curve)| Ok((*curve, summaries(k)?)))
        .collect::<Result<_, Failure>>()?;
    Ok(Rates { study, scenarios: settings.scenarios, curves })
}

/// The rate of one source in bit/s/Hz.
///
/// # Errors
/// [`PlanError`] of the planner.
pub fn rate(source: Source, problem: &Problem, seed: u64) -> Result<f64, PlanError> {
    let options = |method| Options { method, seed, ..Options::default() };
    let plan = match source {
        Source::Cap => return cap(problem).map(per_hz),
        Source::Planned(method) => plan_slot(problem, &options(method))?,
        Source::OnEstimates(method) => plan_slot(&scenario::on_estimates(problem), &options(method))?,
    };
    let scoring =
        EvaluateOptions { samples: SCORE_SAMPLES, seed: mix(seed, 0x0f19), sequence: Sequence::Sobol };
    Ok(per_hz(evaluate(problem, &plan.vehicles, &scoring)?.secrecy_rate_bps))
}

impl Rates {
    /// Every number of the figure. Rates in bit/s/Hz, powers in W.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "method,max_power_w,scenarios,mean_bit_s_hz,standard_error_bit_s_hz,lower_quartile_bit_s_hz,median_bit_s_hz,upper_quartile_bit_s_hz\n",
        );
        for (curve, summaries) in &self.curves {
            for (power, s) in MAX_POWERS_W.iter().zip(summaries) {
                let [lower, median, upper] = s.quartiles;
                // Writing to a String cannot fail.
                let _ = writeln!(
                    text,
                    "{},{power},{},{:.6},{:.6},{lower:.6},{median:.6},{upper:.6}",
                    curve.name, self.scenarios, s.mean, s.standard_error
                );
            }
        }
        text
    }
}
