//! The fault file: what goes wrong in simulated flights, each kind with how often, when, to whom and how much.
//!
//! A number may be given as a range from which it is drawn, so that the same format says what happens in one flight
//! and what may happen in a thousand.

use std::path::Path;

use serde_json::Value as Json;

use super::diagnostic::Diagnostics;
use super::fault_file;
use super::file::{MAX_BYTES, read_text};
use super::reading;

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
    /// GPS is lost: the position drifts, and jumps back with it.
    GpsLoss,
    /// The position estimate jumps, for good.
    EstimatorReset,
    /// The autopilot's UTC jumps.
    ClockJump,
    /// The autopilot restarts, in the air with its motors stopped.
    AutopilotRestart,
    /// The battery's charge falls at once.
    BatteryLow,
    /// A rotor stops.
    RotorLoss,
    /// The mean wind changes.
    WindStep,
    /// The transmitter obeys, but what it radiates never ends by itself.
    TransmitterIgnoresExpiry,
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
        Self::GpsLoss,
        Self::EstimatorReset,
        Self::ClockJump,
        Self::AutopilotRestart,
        Self::BatteryLow,
        Self::RotorLoss,
        Self::WindStep,
        Self::TransmitterIgnoresExpiry,
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
            Self::GpsLoss => "GPS lost",
            Self::EstimatorReset => "position estimate jumps",
            Self::ClockJump => "autopilot's clock jumps",
            Self::AutopilotRestart => "autopilot restarts",
            Self::BatteryLow => "battery low",
            Self::RotorLoss => "a rotor stops",
            Self::WindStep => "wind changes",
            Self::TransmitterIgnoresExpiry => "transmitter ignores expiry",
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
            Self::EstimatorReset => &[Magnitude::Jump],
            Self::ClockJump => &[Magnitude::ClockStep],
            Self::BatteryLow => &[Magnitude::Charge],
            Self::RotorLoss => &[Magnitude::Rotor],
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
                | Self::GpsLoss
                | Self::DiskFull
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
        matches!(self, Self::TransmitterStuck | Self::TransmitterIgnoresExpiry)
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
    /// Of the position, horizontally, metres.
    Jump,
    /// Of the clock, forward if positive, seconds.
    ClockStep,
    /// Left in the battery, 0 to 1.
    Charge,
    /// Number of a rotor, from 0.
    Rotor,
}

impl Magnitude {
    /// Whether it is a whole number.
    #[must_use]
    pub const fn is_whole(self) -> bool {
        matches!(self, Self::Rotor)
    }
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
        Self::parse(&path.display().to_string(), &read_text(path, MAX_BYTES)?)
    }

    /// Validates the text of a fault file; `file_name` is used in messages only.
    ///
    /// # Errors
    /// Everything that is wrong with the text, each with its place and remedy.
    pub fn parse(file_name: &str, text: &str) -> Result<Self, Diagnostics> {
        let (drafts, document, findings) =
            reading::text(file_name, text, fault_file::describe, |drafts, file| {
                fault_file::check(drafts, file)
            });
        findings.into_result()?;
        let laws = drafts.into_iter().filter_map(fault_file::Draft::law).collect();
        let canonical: Vec<String> =
            document.settings.iter().map(|(path, value)| format!("{path} = {value}")).collect();
        Ok(Self { laws, canonical: canonical.join("\n") })
    }

    /// The JSON Schema of the fault file.
    #[must_use]
    pub fn schema() -> Json {
        reading::schema(fault_file::describe)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn laws(text: &str) -> Vec<FaultLaw> {
        Faults::parse("f.toml", text).unwrap().laws
    }

    #[test]
    fn val_every_kind_has_a_name_of_its_own_and_is_in_the_example() {
        let example = include_str!("../../config/faults.toml");
        let laws = laws(example);
        let names: std::collections::BTreeSet<_> = FaultKind::ALL.iter().map(|kind| kind.name()).collect();
        assert_eq!(names.len(), FaultKind::ALL.len());
        assert_eq!(fault_file::KINDS.len(), FaultKind::ALL.len());
        for kind in FaultKind::ALL {
            assert!(laws.iter().any(|law| law.kind == *kind), "{} is not in config/faults.toml", kind.name());
            assert!(!kind.name().is_empty());
        }
    }

    #[test]
    fn val_a_fixed_fault_and_a_law_read() {
        let laws = laws(
            "[[fault]]\nkind = \"companion-kill\"\nvehicle = \"j\"\nslot = 1\nafter_s = 4.0\n\
             [[fault]]\nkind = \"pair-degraded\"\nrate_per_hour = 30\nduration_s = [1, 2.5]\nloss = [0.1, 0.4]\n",
        );
        let fixed = FaultLaw {
            kind: FaultKind::CompanionKill,
            whom: Whom::J,
            frequency: Frequency::Once(1.0),
            slot: Some(1),
            after_s: Some([4.0, 4.0]),
            duration_s: None,
            sizes: Vec::new(),
        };
        let law = FaultLaw {
            kind: FaultKind::PairDegraded,
            whom: Whom::Both,
            frequency: Frequency::PerHour(30.0),
            slot: None,
            after_s: None,
            duration_s: Some([1.0, 2.5]),
            sizes: vec![
                (Magnitude::Loss, [0.1, 0.4]),
                (Magnitude::Duplication, [0.0; 2]),
                (Magnitude::Delay, [0.001; 2]),
                (Magnitude::Spread, [0.0; 2]),
            ],
        };
        assert_eq!(laws, vec![fixed, law]);
    }

    #[test]
    fn val_what_is_wrong_with_a_fault_is_said_with_its_place() {
        let fault = |more: &str| format!("[[fault]]\n{more}\n");
        let cases = [
            (fault("kind = \"meteor\""), "f.toml:2:8: `kind` is \"meteor\""),
            (fault("after_s = 1.0"), "has no `kind`"),
            (fault("kind = \"pair-loss\"\nafter_s = nan"), "f.toml:3:11: `after_s` is NaN"),
            (fault("kind = \"pair-loss\"\nduration_s = [3, 1]"), "f.toml:3:14: `duration_s` is inverted"),
            (fault("kind = \"link-loss\"\nvehicel = \"i\""), "did you mean `vehicle`?"),
            (fault("kind = \"link-loss\"\nvehicle = \"k\""), "f.toml:3:11: `vehicle` is \"k\""),
            (fault("kind = \"pilot-mode\"\nduration_s = 3"), "which does not end"),
            (fault("kind = \"companion-restart\""), "companion-restart has no `duration_s`"),
            (fault("kind = \"pair-loss\"\nloss = 0.5"), "f.toml:3:8: `loss` means nothing for pair-loss"),
            (
                fault("kind = \"link-loss\"\nprobability = 0.5\nrate_per_hour = 2"),
                "`rate_per_hour` is given together with `probability`",
            ),
            (fault("kind = \"link-loss\"\nprobability = 1.5"), "above the maximum of 1"),
        ];
        for (text, complaint) in cases {
            let said = Faults::parse("f.toml", &text).unwrap_err().to_string();
            assert!(said.contains(complaint), "{text}{said}");
        }
    }
}
