//! The fault file: what goes wrong in simulated flights, each kind with how often, when, to whom and how much.
//!
//! A number may be given as a range from which it is drawn, so that the same format says what happens in one flight
//! and what may happen in a thousand.

use std::path::Path;

use serde_json::Value as Json;

use super::diagnostic::Diagnostics;
use super::document::{Document, read_text};
use super::fault_file;

/// Kinds of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FaultKind {
    /// SIGKILL of the companion; it stays dead.
    CompanionKill,
    /// SIGKILL, and a new start after the duration.
    CompanionRestart,
    /// SIGSTOP of the companion, SIGCONT after the duration.
    CompanionStop,
    /// The disk under the companion's logs takes nothing.
    DiskFull,
    /// No frame passes between the vehicle and its companion.
    LinkLoss,
    /// That link loses, repeats, delays and reorders.
    LinkDegraded,
    /// No datagram passes between the companions.
    PairLoss,
    /// That link loses, repeats, delays and reorders.
    PairDegraded,
    /// The pilot takes over.
    PilotMode,
    /// The vehicle's position estimate fails.
    EstimatorFailure,
    /// The mean wind changes.
    WindStep,
    /// The transmitter keeps what it radiates, whatever it is told.
    TransmitterStuck,
}

impl FaultKind {
    /// Every kind, in the order in which reports list them.
    pub const ALL: &[Self] = &[
        Self::LinkLoss,
        Self::LinkDegraded,
        Self::PairLoss,
        Self::PairDegraded,
        Self::CompanionKill,
        Self::CompanionRestart,
        Self::CompanionStop,
        Self::DiskFull,
        Self::PilotMode,
        Self::EstimatorFailure,
        Self::WindStep,
        Self::TransmitterStuck,
    ];

    /// The kind as files and documents spell it.
    #[must_use]
    pub fn name(self) -> &'static str {
        fault_file::KINDS.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// What happens, in words.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::CompanionKill => "companion killed (SIGKILL)",
            Self::CompanionRestart => "companion killed (SIGKILL), to be started again",
            Self::CompanionStop => "companion stopped (SIGSTOP)",
            Self::DiskFull => "disk under the companion's logs full",
            Self::LinkLoss => "link between autopilot and companion cut",
            Self::LinkDegraded => "link between autopilot and companion degraded",
            Self::PairLoss => "pair link cut",
            Self::PairDegraded => "pair link degraded",
            Self::PilotMode => "pilot takes over",
            Self::EstimatorFailure => "position estimate fails",
            Self::WindStep => "wind changes",
            Self::TransmitterStuck => "transmitter sticks",
        }
    }

    /// The sizes that belong to the kind.
    #[must_use]
    pub const fn magnitudes(self) -> &'static [Magnitude] {
        match self {
            Self::LinkDegraded | Self::PairDegraded => {
                &[Magnitude::Loss, Magnitude::Duplication, Magnitude::Delay, Magnitude::Spread]
            }
            Self::WindStep => &[Magnitude::WindSpeed],
            _ => &[],
        }
    }

    /// Whether it can end.
    #[must_use]
    pub const fn can_end(self) -> bool {
        matches!(
            self,
            Self::CompanionRestart
                | Self::CompanionStop
                | Self::LinkLoss
                | Self::LinkDegraded
                | Self::PairLoss
                | Self::PairDegraded
        )
    }

    /// Whether it must.
    #[must_use]
    pub const fn must_end(self) -> bool {
        matches!(self, Self::CompanionRestart)
    }

    /// Whether it leaves the transmitter to itself: nobody can silence it any more.
    #[must_use]
    pub const fn is_of_the_transmitter(self) -> bool {
        matches!(self, Self::TransmitterStuck)
    }

    /// Whether it is between the vehicles, and so has no one vehicle of its own unless one direction is meant.
    #[must_use]
    pub const fn is_of_the_pair(self) -> bool {
        matches!(self, Self::PairLoss | Self::PairDegraded)
    }
}

/// The size of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Magnitude {
    /// Probability that a datagram is lost.
    Loss,
    /// Probability that a datagram arrives twice.
    Duplication,
    /// Time under way, seconds.
    Delay,
    /// Uniform addition to it, seconds.
    Spread,
    /// Mean wind, m/s.
    WindSpeed,
}

/// Whom a fault befalls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Whom {
    /// Vehicle I.
    I,
    /// Vehicle J.
    J,
    /// One of the two, drawn.
    Either,
    /// Both at once.
    Both,
}

/// How often a fault happens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frequency {
    /// Once in a flight with this probability.
    Once(f64),
    /// So many an hour of flight, on average, independently of one another.
    PerHour(f64),
}

/// One `[[fault]]`: the law from which each flight's faults of it are drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct FaultLaw {
    /// What happens.
    pub kind: FaultKind,
    /// To whom.
    pub whom: Whom,
    /// How often.
    pub frequency: Frequency,
    /// The slot, from 0 over superframes, from whose first emission `after_s` counts.
    pub slot: Option<u16>,
    /// Lowest and highest: seconds of flight, or after the slot's first emission. `None`: uniform over the planned
    /// flight, or over the slot.
    pub after_s: Option<[f64; 2]>,
    /// Lowest and highest. `None`: for ever.
    pub duration_s: Option<[f64; 2]>,
    /// Lowest and highest of each size that belongs to the kind.
    pub sizes: Vec<(Magnitude, [f64; 2])>,
}

/// A validated fault file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Faults {
    /// In the file's order.
    pub laws: Vec<FaultLaw>,
    /// The file in canonical form, to tell whether two campaigns drew from the same laws.
    pub canonical: String,
}

impl Faults {
    /// Reads and validates a fault file.
    ///
    /// # Errors
    /// Everything that is wrong with the file, each with its place and remedy.
    pub fn load(path: &Path) -> Result<Self, Diagnostics> {
        Self::parse(&path.display().to_string(), &read_text(path)?)
    }

    /// Validates the text of a fault file; `file_name` is used in messages only.
    ///
    /// # Errors
    /// Everything that is wrong with the text, each with its place and remedy.
    pub fn parse(file_name: &str, text: &str) -> Result<Self, Diagnostics> {
        let (drafts, document, findings) =
            Document::read(file_name, text, fault_file::describe, fault_file::check);
        findings.into_result()?;
        let laws = drafts.into_iter().filter_map(fault_file::Draft::law).collect();
        let canonical: Vec<String> =
            document.settings.iter().map(|(path, value)| format!("{path} = {value}")).collect();
        Ok(Self { laws, canonical: canonical.join("\n") })
    }

    /// The JSON Schema of the fault file.
    #[must_use]
    pub fn schema() -> Json {
        Document::schema(fault_file::describe)
    }
}
