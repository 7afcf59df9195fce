//! What a pair delivers over a superframe by what it may do while it radiates: over the length of a slot, and over the size of the arena
//! in which users and eavesdroppers are.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::chart::{self, Chart, Line, Panel, Style};
use super::rates::JITTER_DEG;
use super::scenario::{self, EAVESDROPPERS, REACH_M, Summary};
use super::{Failure, Figure, Progress, Settings, Work};
use crate::config::{MissionDraft, Mode, NodeDraft, Optimise};
use crate::desk::csv_text::CsvText;
use crate::desk::drawing::svg::Marker;
use crate::geo::Enu;
use crate::planner::expectation::sobol::mix;
use crate::planner::parallel;
use crate::planning;

/// Users of a scenario.
pub const USERS: usize = 3;
/// Length of a slot over arenas, in seconds.
const SLOT_S: f64 = 20.0;
/// Side of the arena over lengths of slots, in metres: the paper's.
const SIDE_M: f64 = 2.0 * REACH_M;
/// One in so many of the scenarios of the other figures: four plans of three users each are some twenty of theirs.
const SHARE: usize = 5;

/// One of the figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Study {
    /// Over the length of a slot.
    SlotLength,
    /// Over the side of the arena.
    Arena,
}

impl Study {
    /// Both.
    pub const ALL: [Self; 2] = [Self::SlotLength, Self::Arena];

    /// File name without extension.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SlotLength => "figure-volume-slot",
            Self::Arena => "figure-volume-arena",
        }
    }

    /// What is varied: its name in the CSV file, for a reader, and its values.
    #[must_use]
    pub fn abscissa(self) -> (&'static str, &'static str, [f64; 5]) {
        match self {
            Self::SlotLength => ("slot_s", "length of a slot (s)", [5.0, 10.0, 20.0, 40.0, 60.0]),
            Self::Arena => ("side_m", "side of the arena (m)", [200.0, 400.0, 600.0, 800.0, 1000.0]),
        }
    }

    /// Scenario `index` of a seed at a value of [`Study::abscissa`]: the same places, as shares of the arena's side, whatever it is.
    #[must_use]
    pub fn mission(self, seed: u64, index: usize, value: f64) -> MissionDraft {
        let (slot_s, side_m) = match self {
            Self::SlotLength => (value, SIDE_M),
            Self::Arena => (SLOT_S, value),
        };
        let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, index as u64));
        let mut coordinate = || side_m * rng.random_range(-0.5..=0.5);
        let mut node = |name: &str| NodeDraft::new(name, Enu::new(coordinate(), coordinate(), 0.0));
        let mut draft = scenario::mission(seed, index, slot_s);
        draft.users = (1..=USERS).map(|k| node(&format!("user-{k}"))).collect();
        draft.eavesdroppers = (1..=EAVESDROPPERS).map(|k| node(&format!("eavesdropper-{k}"))).collect();
        draft.airspace.area_enu_m.iter_mut().for_each(|corner| *corner *= side_m / SIDE_M);
        draft
    }
}

/// What a pair may do, from the least to the most.
pub const WAYS: [(&str, Optimise, Mode); 4] = [
    ("by-rate", Optimise::Rate, Mode::Static),
    ("static", Optimise::Volume, Mode::Static),
    ("turning", Optimise::Volume, Mode::Turning),
    ("moving", Optimise::Volume, Mode::Moving),
];

/// What a plan delivers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delivered {
    /// Secret bits a hertz and second of the superframe, its silences included.
    pub volume_bit_s_hz: f64,
    /// The part of the superframe in which I radiates.
    pub on_air: f64,
}

/// The numbers of a figure, by way and value.
#[derive(Debug, Clone, PartialEq)]
pub struct Volumes {
    /// Which figure.
    pub study: Study,
    /// Scenarios behind each mean.
    pub scenarios: usize,
    /// In the order of [`WAYS`]: volumes, and parts of the time on the air.
    pub ways: Vec<[Vec<Summary>; 2]>,
}

/// Plans a mission that way, and says what it delivers.
///
/// # Errors
/// In words, where the mission has no plan, or none that can be flown slot after slot.
pub fn deliver(mut draft: MissionDraft, optimise: Optimise, mode: Mode) -> Result<Delivered, String> {
    (draft.planner.optimise, draft.planner.mode) = (optimise, mode);
    let (mission, plan) = scenario::planned(draft)?;
    let delivered = planning::delivered(&mission, &plan);
    let superframe_s = delivered.superframe_s.ok_or("slots that cannot be flown one after the other")?;
    Ok(Delivered {
        volume_bit_s_hz: delivered.volume_bits / mission.radio.bandwidth_hz / superframe_s,
        on_air: delivered.on_air_s / superframe_s,
    })
}

/// Plans every scenario at every value and in every way.
///
/// # Errors
/// [`Failure`] for no scenarios, or if one has no plan.
pub fn measure(study: Study, settings: &Settings, progress: &Progress) -> Result<Volumes, Failure> {
    let scenarios = settings.scenarios.div_ceil(SHARE);
    let (_, _, values) = study.abscissa();
    let work = Work::new(study.name(), scenarios * values.len(), progress);
    let cells = parallel::map(settings.threads, scenarios * values.len(), |_: &mut (), cell| {
        let (scenario, value) = (cell / values.len(), cell % values.len());
        let draft = study.mission(settings.seed, scenario, values[value]);
        let ways = WAYS.map(|(_, optimise, mode)| deliver(draft.clone(), optimise, mode));
        work.one_done();
        let ways: Result<Vec<_>, _> = ways.into_iter().collect();
        ways.map_err(|why| Failure::Service { figure: study.name(), scenario, why })
    });
    let cells: Vec<Vec<Delivered>> = cells.into_iter().collect::<Result<_, _>>()?;
    let summaries = |way: usize, of: fn(&Delivered) -> f64| {
        Summary::by_value(&cells, values.len(), |ways| Some(of(&ways[way])))
    };
    let ways = (0..WAYS.len()).map(|way| {
        Ok([summaries(way, |plan| plan.volume_bit_s_hz)?, summaries(way, |plan| 100.0 * plan.on_air)?])
    });
    Ok(Volumes { study, scenarios, ways: ways.collect::<Result<_, Failure>>()? })
}

impl Volumes {
    /// The figure.
    #[must_use]
    pub fn figure(&self) -> Figure {
        Figure { name: self.study.name(), svg: self.svg(), csv: self.csv() }
    }

    fn csv(&self) -> String {
        let (name, _, values) = self.study.abscissa();
        let mut text = CsvText::new([
            "way",
            name,
            "scenarios",
            "volume_bit_s_hz",
            "volume_standard_error_bit_s_hz",
            "on_air_percent",
            "on_air_standard_error_percent",
        ]);
        for ((way, ..), [volumes, on_air]) in WAYS.iter().zip(&self.ways) {
            for (value, (volume, on_air)) in values.iter().zip(volumes.iter().zip(on_air)) {
                let numbers = [volume.mean, volume.standard_error, on_air.mean, on_air.standard_error];
                let cells = [(*way).to_owned(), value.to_string(), self.scenarios.to_string()];
                text.row(cells.into_iter().chain(numbers.map(|number| format!("{number:.6}"))));
            }
        }
        text.finish()
    }

    fn svg(&self) -> String {
        let (_, abscissa, values) = self.study.abscissa();
        let panel = |label: &str, most_ticks: f64, which: usize| {
            let mut lines: Vec<_> =
                STYLES.iter().zip(&self.ways).map(|(style, way)| Line::new(*style, &way[which])).collect();
            lines.reverse();
            Panel { label: label.to_owned(), lines, most_ticks }
        };
        let what = match self.study {
            Study::SlotLength => format!("in an arena of {SIDE_M} m"),
            Study::Arena => format!("slots of {SLOT_S} s"),
        };
        chart::draw(&Chart {
            title: format!("Secrecy volume over {abscissa} ({})", self.study.name()),
            caption: vec![
                format!("{USERS} users, {EAVESDROPPERS} eavesdroppers, {what}, jitter {JITTER_DEG}\u{b0}"),
                format!(
                    "Mean of {} scenarios, over whole superframes; band: \u{b1} standard error",
                    self.scenarios
                ),
            ],
            legend: STYLES.chunks(2).map(<[Style]>::to_vec).collect(),
            abscissa,
            values: &values,
            panels: vec![panel("volume (bit/s/Hz)", 6.0, 0), panel("on the air (%)", 5.0, 1)],
        })
    }
}

/// By way, in the order of [`WAYS`].
const STYLES: [Style; 4] = [
    Style::new("best rates, static", "#7d7d7d", 1.2, "1.2 1.6", Some(Marker::Diamond)),
    Style::new("volume, static", "#2f8f5b", 1.2, "6 2 1.2 2", Some(Marker::Triangle)),
    Style::new("volume, turning", "#c8500a", 1.2, "5 2", Some(Marker::OpenSquare)),
    Style::new("volume, moving", "#0b5394", 1.5, "", Some(Marker::Disc)),
];
