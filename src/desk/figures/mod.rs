//! The paper's figures, and six of what it leaves out, from the running program: what [`planner::plan_slot`](crate::planner::plan_slot),
//! [`planner::evaluate`](crate::planner::evaluate) and [`planning::plan`](crate::planning::plan) answer, and what became of simulated
//! flights, as SVG and CSV.
//!
//! | figure | shows | method |
//! |---|---|---|
//! | 3 | positions and antenna axes of both vehicles, one scenario | [`poses`] |
//! | 4a | mean rate over maximum power, no jitter | [`rates`] |
//! | 4b | the same with attitude jitter | [`rates`] |
//! | 4c | the same with jitter and uncertain eavesdropper positions | [`rates`] |
//! | null depth | plans that know of the antennas' floors against plans that do not: mean and 5% quantile | [`rates`] |
//! | Rician K | the same of scattering | [`rates`] |
//! | volume over slots | what a superframe delivers by what the pair may do while it radiates | [`service`] |
//! | volume over arenas | the same over how far users and eavesdroppers are apart | [`service`] |
//! | regret | what flights lose by not knowing where a user will go, over how fast it goes | [`regret`] |
//! | breakdown | what each imperfection that a mission states costs its plan | [`breakdown`] |
//!
//! Scenarios are drawn as in the paper: two eavesdroppers uniform in a square of a kilometre about the user. A figure
//! depends on the seed and the number of scenarios, never on the number of threads.

pub mod breakdown;
mod chart;
mod pose_chart;
pub mod poses;
mod rate_chart;
pub mod rates;
pub mod regret;
pub mod scenario;
pub mod service;

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::planner::PlanError;

/// How the figures are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// Random scenarios behind each mean of rates, at least 1; a fifth and a twenty-fifth as many, rounded up, behind those of
    /// [`service`] and [`regret`].
    pub scenarios: usize,
    /// Threads; the figures do not depend on them.
    pub threads: usize,
    /// Seed of the scenarios and of the planner.
    pub seed: u64,
}

/// Why a figure cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Failure {
    /// A mean of nothing.
    #[error("no scenarios to average over; ask for at least 1")]
    NoScenarios,
    /// The planner refused.
    #[error("{figure}, scenario {scenario}: {error}")]
    Plan {
        /// The figure's name.
        figure: &'static str,
        /// Index of the scenario.
        scenario: usize,
        /// What the planner said.
        error: PlanError,
    },
    /// A mission could not be planned, or not be flown.
    #[error("{figure}, scenario {scenario}: {why}")]
    Service {
        /// The figure's name.
        figure: &'static str,
        /// Index of the scenario.
        scenario: usize,
        /// In words.
        why: String,
    },
}

/// A figure ready to be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// File name without extension.
    pub name: &'static str,
    /// The drawing.
    pub svg: String,
    /// Every number in it.
    pub csv: String,
}

/// Hears, from any thread, of parts done: figure, parts done, parts in all.
pub type Progress<'a> = dyn Fn(&str, usize, usize) + Sync + 'a;

/// The names of all figures of random scenarios, in the order in which they are made.
#[must_use]
pub fn names() -> Vec<&'static str> {
    let rates = rates::Study::ALL.map(rates::Study::name);
    let services = service::Study::ALL.map(service::Study::name);
    [&[poses::NAME][..], &rates, &services, &[regret::NAME]].concat()
}

/// Makes the figures of random scenarios whose names are `wanted`; [`breakdown`] is of a mission.
///
/// # Errors
/// [`Failure`] for no scenarios, or if one cannot be planned or flown.
pub fn make(
    settings: &Settings,
    wanted: impl Fn(&str) -> bool,
    progress: &Progress,
) -> Result<Vec<Figure>, Failure> {
    let mut figures = Vec::new();
    if wanted(poses::NAME) {
        let poses = poses::plan(settings, progress)?;
        figures.push(Figure { name: poses::NAME, svg: pose_chart::draw(&poses), csv: poses.csv() });
    }
    for study in rates::Study::ALL.into_iter().filter(|study| wanted(study.name())) {
        let rates = rates::measure(study, settings, progress)?;
        figures.push(Figure { name: study.name(), svg: rate_chart::draw(&rates), csv: rates.csv() });
    }
    for study in service::Study::ALL.into_iter().filter(|study| wanted(study.name())) {
        figures.push(service::measure(study, settings, progress)?.figure());
    }
    if wanted(regret::NAME) {
        figures.push(regret::measure(settings, progress)?.figure());
    }
    Ok(figures)
}

/// Counts the parts of a figure done by all threads.
struct Work<'a> {
    figure: &'static str,
    count: usize,
    done: AtomicUsize,
    progress: &'a Progress<'a>,
}

impl<'a> Work<'a> {
    fn new(figure: &'static str, count: usize, progress: &'a Progress<'a>) -> Self {
        Self { figure, count, done: AtomicUsize::new(0), progress }
    }

    fn one_done(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        (self.progress)(self.figure, done, self.count);
    }
}

#[cfg(test)]
mod tests;
