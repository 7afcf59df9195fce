//! What is lost in flight by not knowing where a user will go, over how fast it goes: to the pair that knows its track beforehand, and by
//! the pair that stays where the plan has it. Whole flights of the simulated world, its reports once a second with 3 m of noise, a fifth
//! of them lost.

use super::chart::{self, Chart, Line, Panel, Style};
use super::rates::JITTER_DEG;
use super::scenario::{self, Summary};
use super::{Failure, Figure, Progress, Settings, Work};
use crate::config::{MissionDraft, MovesDraft, NodeDraft};
use crate::desk::campaign::FollowingLine;
use crate::desk::csv_text::CsvText;
use crate::desk::drawing::svg::Marker;
use crate::desk::simulation::Scenario;
use crate::geo::Enu;
use crate::planner::following::Gait;
use crate::planner::parallel;

/// File name without extension.
pub const NAME: &str = "figure-regret-speed";
/// How fast the user goes, m/s.
pub const SPEEDS_M_S: [f64; 5] = [1.5, 3.0, 6.0, 9.0, 12.0];
/// From which speed on the mission says that it drives: as far, as a ratio, from a walk as from a drive.
const DRIVES_FROM_M_S: f64 = 3.5;
/// Length of the slot in seconds.
const SLOT_S: f64 = 20.0;
/// One in so many of the scenarios of the figures of rates: a flight takes seconds.
const SHARE: usize = 25;

/// The curves: what the pair that follows loses to the one that begins as it does and knows the track, and what is lost by the one that
/// stays where the plan has it to the one that begins where it is best, and knows.
pub const CURVES: [&str; 2] = ["following", "staying"];

/// What a flight lost, of 100, in the order of [`CURVES`].
pub type Lost = [f64; 2];

/// The figure's numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Regret {
    /// Flights behind each mean.
    pub flights: usize,
    /// In the order of [`CURVES`], by speed; of 100.
    pub lost: [Vec<Summary>; 2],
}

/// The mission of scenario `index`: the paper's arena, the user in its middle as it opens.
#[must_use]
pub fn mission(seed: u64, index: usize, speed_m_s: f64) -> MissionDraft {
    let mut draft = scenario::mission(seed, index, SLOT_S);
    let gait = if speed_m_s < DRIVES_FROM_M_S { Gait::Walks } else { Gait::Drives };
    let mut user = NodeDraft::new("user", Enu::zeros());
    user.moves = Some(MovesDraft { system_id: Some(51), gait, ..MovesDraft::default() });
    draft.users = vec![user];
    let nodes = scenario::eavesdroppers(seed, index).into_iter().zip(1..);
    draft.eavesdroppers = nodes.map(|(at, k)| NodeDraft::new(&format!("eavesdropper-{k}"), at)).collect();
    draft
}

/// Flies a mission once; `None` where nothing could have been carried.
///
/// # Errors
/// In words, where it cannot be planned or flown.
pub fn fly(draft: MissionDraft, speed_m_s: f64) -> Result<Option<Lost>, String> {
    let (mission, plan) = scenario::planned(draft)?;
    let scenario = Scenario::new(&mission, &plan, None).map_err(|error| error.to_string())?;
    let flown = scenario.at_speed(speed_m_s).fly(mission.seed, Vec::new(), &mut ());
    let line = FollowingLine::of(&flown.map_err(|error| error.to_string())?);
    Ok(line.and_then(|line| {
        let lost = |had: f64, of: f64| (of > 0.0).then(|| 100.0 * (1.0 - had / of));
        Some([
            lost(line.achieved_secrecy_rate_bps, line.knowing_secrecy_rate_bps)?,
            lost(line.staying_secrecy_rate_bps, line.best_secrecy_rate_bps)?,
        ])
    }))
}

/// Flies every scenario at every speed.
///
/// # Errors
/// [`Failure`] for no scenarios, or if one cannot be flown.
pub fn measure(settings: &Settings, progress: &Progress) -> Result<Regret, Failure> {
    let flights = settings.scenarios.div_ceil(SHARE);
    let work = Work::new(NAME, flights * SPEEDS_M_S.len(), progress);
    let cells = parallel::map(settings.threads, flights * SPEEDS_M_S.len(), |_: &mut (), cell| {
        let (scenario, speed_m_s) = (cell / SPEEDS_M_S.len(), SPEEDS_M_S[cell % SPEEDS_M_S.len()]);
        let lost = fly(mission(settings.seed, scenario, speed_m_s), speed_m_s);
        work.one_done();
        lost.map_err(|why| Failure::Service { figure: NAME, scenario, why })
    });
    let cells: Vec<Option<Lost>> = cells.into_iter().collect::<Result<_, _>>()?;
    let summaries =
        |curve: usize| Summary::by_value(&cells, SPEEDS_M_S.len(), |lost| lost.map(|lost| lost[curve]));
    Ok(Regret { flights, lost: [summaries(0)?, summaries(1)?] })
}

impl Regret {
    /// The figure.
    #[must_use]
    pub fn figure(&self) -> Figure {
        Figure { name: NAME, svg: self.svg(), csv: self.csv() }
    }

    fn csv(&self) -> String {
        let mut text =
            CsvText::new(["curve", "speed_m_s", "flights", "lost_percent", "standard_error_percent"]);
        for (curve, lost) in CURVES.iter().zip(&self.lost) {
            for (speed_m_s, lost) in SPEEDS_M_S.iter().zip(lost) {
                let numbers = [lost.mean, lost.standard_error].map(|number| format!("{number:.6}"));
                let cells = [(*curve).to_owned(), speed_m_s.to_string(), self.flights.to_string()];
                text.row(cells.into_iter().chain(numbers));
            }
        }
        text.finish()
    }

    fn svg(&self) -> String {
        let panel = |label: &str, most_ticks: f64, curves: usize| {
            let lines = STYLES.into_iter().zip(&self.lost).take(curves);
            let lines = lines.map(|(style, lost)| Line::new(style, lost)).collect();
            Panel { label: label.to_owned(), lines, most_ticks }
        };
        chart::draw(&Chart {
            title: format!("Rate lost over a user's speed ({NAME})"),
            caption: vec![
                format!(
                    "A user that roams in the paper's arena and is told of once a second within 3 m, slots of {SLOT_S} s, jitter {JITTER_DEG}\u{b0}"
                ),
                format!(
                    "Against a pair that knows its track; mean over {} flights at each speed; band: \u{b1} standard error",
                    self.flights
                ),
            ],
            legend: vec![STYLES.to_vec()],
            abscissa: "speed of the user (m/s)",
            values: &SPEEDS_M_S,
            panels: vec![panel("rate lost (%)", 6.0, 2), panel("who follows", 3.0, 1)],
        })
    }
}

/// In the order of [`CURVES`].
const STYLES: [Style; 2] = [
    Style::new("by who follows", "#0b5394", 1.5, "", Some(Marker::Disc)),
    Style::new("by who stays", "#7d7d7d", 1.2, "1.2 1.6", Some(Marker::Diamond)),
];
