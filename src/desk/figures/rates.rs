//! Figures 4a to 4c: mean secrecy rate over maximum transmit power; and the same over how deep the antennas' nulls are and over
//! how little is scattered.

use nalgebra::Vector3;

use super::scenario::{self, Conditions, Summary, per_hz};
use super::{Failure, Progress, Settings, Work};
use crate::desk::csv_text::CsvText;
use crate::planner::expectation::samples::Sequence;
use crate::planner::expectation::sobol::mix;
use crate::planner::problem::{Fading, Method, Objective, Pattern, Problem, Rician};
use crate::planner::{EvaluateOptions, Options, PlanError, cap, evaluate, parallel, plan_slot};
use crate::role::PerVehicle;

/// The maximum transmit powers in W, both vehicles'.
pub const MAX_POWERS_W: [f64; 6] = [0.1, 0.3, 0.5, 0.7, 0.9, 1.1];
/// The null depths in dB, both vehicles'.
pub const NULL_DEPTHS_DB: [f64; 6] = [15.0, 20.0, 25.0, 30.0, 35.0, 40.0];
/// The Rician factors in dB, of all receivers.
pub const RICIAN_KS_DB: [f64; 6] = [5.0, 10.0, 15.0, 20.0, 25.0, 30.0];
/// Maximum transmit power where something else is varied, W.
const MAX_POWER_W: f64 = 0.5;
/// Starts of every method in figures 3 and 4a to 4c: as many as Veilwing takes by itself where nothing is random.
pub const STARTS: usize = 24;
/// What is added to a curve's name that has one start.
const ONE_START: &str = "-one-start";
/// Samples by which every plan is scored.
const SCORE_SAMPLES: usize = 8192;

/// One of the figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Study {
    /// 4a: desired attitudes are held exactly, eavesdroppers are where they are thought to be.
    Plain,
    /// 4b: roll and pitch of both vehicles jitter by [`JITTER_DEG`].
    Jitter,
    /// 4c: jitter, and eavesdroppers anywhere within [`UNCERTAINTY_M`] of their estimates.
    Uncertain,
    /// Jitter, headings that are wrong by [`HEADING_DEG`], and antennas whose nulls have a floor.
    NullDepth,
    /// Jitter, the same headings, and scattering about all receivers.
    Scattering,
}

/// Standard deviation of roll and pitch in all figures but 4a, in degrees.
pub const JITTER_DEG: f64 = 2.0;
/// Radius of the discs of figure 4c in metres.
pub const UNCERTAINTY_M: f64 = 50.0;
/// Standard deviation of the headings over null depth and Rician factor, in degrees.
pub const HEADING_DEG: f64 = 2.0;

/// What a figure varies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Abscissa {
    /// Its name in the CSV file.
    pub name: &'static str,
    /// For a reader, with its unit.
    pub title: &'static str,
    /// The values, rising.
    pub values: [f64; 6],
}

impl Study {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Plain, Self::Jitter, Self::Uncertain, Self::NullDepth, Self::Scattering];

    /// File name without extension.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "figure-4a",
            Self::Jitter => "figure-4b",
            Self::Uncertain => "figure-4c",
            Self::NullDepth => "figure-null-depth",
            Self::Scattering => "figure-rician-k",
        }
    }

    /// Whether it varies the link instead of the power.
    fn varies_link(self) -> bool {
        matches!(self, Self::NullDepth | Self::Scattering)
    }

    /// What it varies.
    pub fn abscissa(self) -> Abscissa {
        let (name, title, values) = match self {
            Self::Plain | Self::Jitter | Self::Uncertain => {
                ("max_power_w", "maximum transmit power (W)", MAX_POWERS_W)
            }
            Self::NullDepth => ("null_depth_db", "depth of the antennas' nulls (dB)", NULL_DEPTHS_DB),
            Self::Scattering => ("rician_k_db", "Rician factor K (dB)", RICIAN_KS_DB),
        };
        Abscissa { name, title, values }
    }

    /// What holds between these eavesdroppers at a value of [`Study::abscissa`].
    pub fn problem(self, eavesdroppers: &[Vector3<f64>], value: f64) -> Problem {
        let mut problem = scenario::problem(
            eavesdroppers,
            &Conditions {
                max_power_w: if self.varies_link() { MAX_POWER_W } else { value },
                jitter_std_rad: if self == Self::Plain { 0.0 } else { f64::to_radians(JITTER_DEG) },
                uncertainty_m: if self == Self::Uncertain { UNCERTAINTY_M } else { 0.0 },
            },
        );
        if self.varies_link() {
            problem.pointing.heading_std_rad = f64::to_radians(HEADING_DEG);
        }
        match self {
            Self::Plain | Self::Jitter | Self::Uncertain => {}
            Self::NullDepth => {
                let floored = Pattern::with_null_depth(value);
                problem.antennas = PerVehicle { i: floored.clone(), j: floored };
            }
            Self::Scattering => {
                problem.fading =
                    Fading { user: Rician::from_db(value), eavesdropper: Rician::from_db(value) };
            }
        }
        problem
    }

    /// Against what the curves that lie close together are compared in a panel of their own, by name.
    pub fn gap_to(self) -> &'static str {
        match self {
            Self::Plain => "cap",
            Self::Jitter | Self::Uncertain => "veilwing",
            Self::NullDepth | Self::Scattering => "knowing",
        }
    }

    /// Whether a curve is in that panel.
    fn has_gap(self, curve: &Curve) -> bool {
        match self {
            Self::Plain => matches!(curve.name, "veilwing" | "paper" | "interior-point"),
            Self::Jitter | Self::Uncertain => {
                !matches!(curve.name, "cap" | "veilwing") && !curve.name.starts_with("conventional")
            }
            Self::NullDepth | Self::Scattering => curve.name == "unknowing",
        }
    }

    /// Its curves: first what all else is compared with, then method by method, then those from one start.
    pub fn curves(self) -> Vec<Curve> {
        let mean = |name, source| Curve { name, source, statistic: Statistic::Mean };
        if self.varies_link() {
            let quantile = |name, source| Curve { name, source, statistic: Statistic::Quantile };
            let [knowing, unknowing] = [Source::Planned(None), Source::OnIdeal];
            return vec![
                mean("knowing", knowing),
                quantile("knowing-5pct", knowing),
                mean("unknowing", unknowing),
                quantile("unknowing-5pct", unknowing),
            ];
        }
        let on_estimates = |method, starts| Source::OnEstimates(method, starts);
        let mut curves = vec![mean("cap", Source::Cap), mean("veilwing", Source::Planned(Some(STARTS)))];
        if self == Self::Uncertain {
            curves.push(mean("veilwing-on-estimates", on_estimates(Method::Veilwing, STARTS)));
        }
        for (name, method) in [
            ("paper", Method::Paper),
            ("interior-point", Method::InteriorPoint),
            ("conventional", Method::Conventional),
        ] {
            curves.push(mean(name, on_estimates(method, STARTS)));
        }
        for (name, method) in [
            ("paper-one-start", Method::Paper),
            ("interior-point-one-start", Method::InteriorPoint),
            ("conventional-one-start", Method::Conventional),
        ] {
            curves.push(mean(name, on_estimates(method, 1)));
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
    /// Which of them.
    pub statistic: Statistic,
}

impl Curve {
    /// Of a curve from one start, the name of the same method's from [`STARTS`].
    pub fn from_more_starts(&self) -> Option<&'static str> {
        self.name.strip_suffix(ONE_START)
    }
}

/// Which rate of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Statistic {
    /// Over everything that is random.
    Mean,
    /// What nineteen slots in twenty exceed.
    Quantile,
}

/// Where rates come from. Every plan is scored under all that holds in the figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// What no configuration exceeds.
    Cap,
    /// Veilwing's plan that knows all that holds, and maximises the mean; from so many starts, or its own number.
    Planned(Option<usize>),
    /// A method's plan that takes the estimated positions for true, from so many starts.
    OnEstimates(Method, usize),
    /// Veilwing's plan that knows of the jitter and takes all else for ideal.
    OnIdeal,
}

/// A figure's numbers: one row a curve and value, in the order of [`Study::curves`], then [`Study::abscissa`].
#[derive(Debug, Clone, PartialEq)]
pub struct Rates {
    /// Which figure.
    pub study: Study,
    /// Scenarios behind each mean.
    pub scenarios: usize,
    /// In the order of [`Study::curves`].
    pub curves: Vec<CurveRates>,
}

/// One curve's numbers by the value of the abscissa, in bit/s/Hz.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveRates {
    /// Which curve.
    pub curve: Curve,
    /// The rates.
    pub rates: Vec<Summary>,
    /// By how much it is below [`Study::gap_to`], scenario by scenario; empty for a curve not compared.
    pub gaps: Vec<Summary>,
}

/// Plans and scores every scenario, value of the abscissa and method of a figure.
///
/// # Errors
/// [`Failure`] if the planner refuses a problem.
pub fn measure(study: Study, settings: &Settings, progress: &Progress) -> Result<Rates, Failure> {
    let curves = study.curves();
    let values = study.abscissa().values;
    let count = settings.scenarios * values.len();
    let work = Work::new(study.name(), count, progress);
    let cells = parallel::map(settings.threads, count, |_: &mut (), cell| {
        let (index, value) = (cell / values.len(), cell % values.len());
        let eavesdroppers = scenario::eavesdroppers(settings.seed, index);
        let problem = study.problem(&eavesdroppers, values[value]);
        let rates = rates(&curves, &problem, mix(settings.seed, index as u64));
        work.one_done();
        rates.map_err(|error| Failure::Plan { figure: study.name(), scenario: index, error })
    });
    let cells: Vec<Vec<f64>> = cells.into_iter().collect::<Result<_, _>>()?;
    let summaries =
        |of: &dyn Fn(&[f64]) -> f64| Summary::by_value(&cells, values.len(), |rates| Some(of(rates)));
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

/// The rates of all curves; one plan serves those that follow each other with the same source.
fn rates(curves: &[Curve], problem: &Problem, seed: u64) -> Result<Vec<f64>, PlanError> {
    let mut last = None;
    let rates = curves.iter().map(|curve| {
        let known = last.filter(|(source, _)| *source == curve.source);
        let score = known.map_or_else(|| score(curve.source, problem, seed), |(_, score)| Ok(score))?;
        last = Some((curve.source, score));
        Ok(score.of(curve.statistic))
    });
    rates.collect()
}

/// What a plan is worth, in bit/s/Hz.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// [`Statistic::Mean`].
    pub mean: f64,
    /// [`Statistic::Quantile`]; the mean where every heading is right.
    pub quantile: f64,
}

impl Score {
    /// One of them.
    pub fn of(self, statistic: Statistic) -> f64 {
        match statistic {
            Statistic::Mean => self.mean,
            Statistic::Quantile => self.quantile,
        }
    }
}

/// What one source's plan is worth.
///
/// # Errors
/// [`PlanError`] of the planner.
pub fn score(source: Source, problem: &Problem, seed: u64) -> Result<Score, PlanError> {
    let options = |method, starts| Options { method, starts, seed, ..Options::default() };
    let plan = match source {
        Source::Cap => return cap(problem).map(per_hz).map(|cap| Score { mean: cap, quantile: cap }),
        Source::Planned(starts) => plan_slot(problem, &options(Method::Veilwing, starts))?,
        Source::OnEstimates(method, starts) => {
            plan_slot(&scenario::on_estimates(problem), &options(method, Some(starts)))?
        }
        Source::OnIdeal => plan_slot(&scenario::on_ideal(problem), &options(Method::Veilwing, None))?,
    };
    let scoring =
        EvaluateOptions { samples: SCORE_SAMPLES, seed: mix(seed, 0x0f19), sequence: Sequence::Sobol };
    // Planned for the mean; scored by the quantile beside it, where a figure draws one.
    let objective = if problem.pointing.is_present() { Objective::Quantile } else { problem.objective };
    let scored = evaluate(&Problem { objective, ..problem.clone() }, &plan.vehicles, &scoring)?;
    Ok(Score { mean: per_hz(scored.secrecy_rate_bps), quantile: per_hz(scored.objective_rate_bps) })
}

impl Rates {
    /// How the paper's method stands to interior point, from as many starts and from one, over all powers; `None` where
    /// neither is drawn.
    pub fn paper_to_interior_point(&self) -> Option<String> {
        let means = |name: &str| {
            let curve = self.curves.iter().find(|curve| curve.curve.name == name)?;
            Some(curve.rates.iter().map(|summary| summary.mean).collect::<Vec<_>>())
        };
        let between = |paper: &str, other: &str| {
            let (paper, other) = (means(paper)?, means(other)?);
            let below = || other.iter().zip(&paper).map(|(other, paper)| other - paper);
            let (least, most) =
                (below().fold(f64::INFINITY, f64::min), below().fold(f64::NEG_INFINITY, f64::max));
            Some(if least > 0.0 {
                format!("below by {least:.2} to {most:.2}")
            } else if most < 0.0 {
                format!("above by {:.2} to {:.2}", -most, -least)
            } else {
                format!("from {:.2} above to {most:.2} below", -least)
            })
        };
        let many = between("paper", "interior-point")?;
        let one = between("paper-one-start", "interior-point-one-start")?;
        Some(format!("The paper's method against interior point: {many}; from one start {one}."))
    }

    /// Every number of the figure. Rates in bit/s/Hz; the gap is that to [`Study::gap_to`].
    pub fn csv(&self) -> String {
        let below = |what: &str| format!("below_{}_{what}", self.study.gap_to());
        let names = [
            "method",
            self.study.abscissa().name,
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
            for (k, (value, s)) in self.study.abscissa().values.iter().zip(rates).enumerate() {
                let [lower, median, upper] = s.quartiles;
                let mut cells = vec![curve.name.to_owned(), value.to_string(), self.scenarios.to_string()];
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
