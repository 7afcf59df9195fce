//! What a target is, and the list of them.

use crate::reached::Reached;
use crate::targets::{autopilot, executive, files, frames, report, signing, slot, tlog, transmitter};

/// Something that takes whatever bytes there are. It fails by a panic: an assertion of its own, or one that the code
/// under it should not have.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// As the command line and the corpus name it.
    pub name: &'static str,
    /// What it feeds to what.
    pub what: &'static str,
    /// Words that the inputs' language is made of, for the mutator.
    pub words: &'static [&'static str],
    /// Inputs to begin with, made afresh: what belongs to the repository anyway is not stored twice.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Takes one input, and notes what it reached.
    pub run: fn(&[u8], &mut Reached),
    /// How many generated inputs the test suite runs: fewer where one is slow.
    pub generated: u32,
}

/// All targets.
pub const TARGETS: &[Target] = &[
    frames::TARGET,
    signing::TARGET,
    tlog::TARGET,
    autopilot::TARGET,
    transmitter::NUMBERED,
    transmitter::LEASED,
    transmitter::PARAMETER,
    slot::HELD,
    slot::CARRIED_ON,
    slot::FOLLOWED,
    executive::TARGET,
    files::MISSION,
    files::VEHICLE,
    files::FAULTS,
    files::AIRFRAME,
    files::PLAN,
    report::RECORD,
    report::LOGS,
];

impl Target {
    /// The target of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        TARGETS.iter().find(|target| target.name == name)
    }

    /// Runs one input.
    #[must_use]
    pub fn reach(&self, input: &[u8]) -> Reached {
        let mut reached = Reached::default();
        (self.run)(input, &mut reached);
        reached
    }
}
