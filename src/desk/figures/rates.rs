//! Figures 4a to 4c: mean secrecy rate over maximum transmit power.

use super::scenario::{self, Conditions, Summary, per_hz};
use super::{Failure, Progress, Settings, Work};
use crate::desk::csv_text::CsvText;
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

    /// Against what the curves that lie close together are compared in a panel of their own, by name.
    pub fn gap_to(self) -> &'static str {
        match self {
            Self::Plain => "cap",
            Self::Jitter | Self::Uncertain => "veilwing",
        }
    }

    /// Whether a curve is in that panel.
    fn has_gap(self, curve: &Curve) -> bool {
        match self {
            Self::Plain => matches!(curve.name, "veilwing" | "paper"),
            Self::Jitter | Self::Uncertain => !matches!(curve.name, "cap" | "veilwing" | "conventional"),
        }
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
    /// In the order of [`Study::curves`].
    pub curves: Vec<CurveRates>,
}

/// One curve's numbers by power, in bit/s/Hz.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveRates {
    /// Which curve.
    pub curve: Curve,
    /// The rates.
    pub rates: Vec<Summary>,
    /// By how much it is below [`Study::gap_to`], scenario by scenario; empty for a curve not compared.
    pub gaps: Vec<Summary>,
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
    let summaries = |value: &dyn Fn(&[f64]) -> f64| {
        let at = |power: usize| {
            let values: Vec<f64> =
                cells.iter().skip(power).step_by(powers).map(|rates| value(rates)).collect();
            Summary::new(&values).ok_or(Failure::NoScenarios)
        };
        (0..powers).map(at).collect::<Result<Vec<_>, _>>()
    };
    let reference = curves.iter().position(|curve| curve.name == study.gap_to());
    let curves = curves.iter().enumerate().map(|(k, curve)| {
        let gaps = match reference {
            Some(r) if study.has_gap(curve) => summaries(&|rates| rates[r] - rates[k])?,
            _ => Vec::new(),
        };
        Ok(CurveRates { curve: *curve, rates: summaries(&|rates| rates[k])?, gaps })
    });
    let curves = curves.collect::<Result<_, Failure>>()?;
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
    /// Every number of the figure. Rates in bit/s/Hz, powers in W; the gap is that to [`Study::gap_to`].
    pub fn csv(&self) -> String {
        let below = |what: &str| format!("below_{}_{what}", self.study.gap_to());
        let names = [
            "method",
            "max_power_w",
            "scenarios",
            "mean_bit_s_hz",
            "standard_error_bit_s_hz",
            "lower_quartile_bit_s_hz",
            "median_bit_s_hz",
            "upper_quartile_bit_s_hz",
        ];
        let gap = [below("mean_bit_s_hz"), below("standard_error_bit_s_hz")];
        let mut text = CsvText::new(names.map(str::to_owned).into_iter().chain(gap));
        for CurveRates { curve, rates, gaps } in &self.curves {
            for (k, (power, s)) in MAX_POWERS_W.iter().zip(rates).enumerate() {
                let [lower, median, upper] = s.quartiles;
                let mut cells = vec![curve.name.to_owned(), power.to_string(), self.scenarios.to_string()];
                let all = [s.mean, s.standard_error, lower, median, upper];
                cells.extend(all.map(|rate| format!("{rate:.6}")));
                cells.extend(match gaps.get(k) {
                    Some(gap) => [gap.mean, gap.standard_error].map(|rate| format!("{rate:.6}")),
                    None => [const { String::new() }; 2],
                });
                text.row(cells);
            }
        }
        text.finish()
    }
}
