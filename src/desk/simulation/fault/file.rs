//! The fault file: what goes wrong in simulated flights, each kind with how often, when, to whom and how much. Every
//! setting of it is declared once: key, kind, range, unit, sentence.
//!
//! A number may be given as a range from which it is drawn, so that the same format says what happens in one flight
//! and what may happen in a thousand.

use std::path::Path;

use serde_json::Value as Json;

use crate::config::Diagnostics;
use crate::config::document::Document;
use crate::config::file::{MAX_BYTES, read_text};
use crate::config::kind::{Choice, Integer, Number};
use crate::config::reader::Section;
use crate::config::reading;

use super::extent::Extent;
use super::kind::{FaultKind, Magnitude, NAMES};
use super::law::{FaultLaw, Frequency, Whom};

/// No flight is longer, in seconds.
const LONGEST_S: f64 = 86_400.0;
/// No clock is further off: ten years, in seconds.
const FARTHEST_S: f64 = 315_360_000.0;

/// A size's key, sentence, range and default.
struct Size {
    magnitude: Magnitude,
    key: &'static str,
    sentence: &'static str,
    range: Number,
    default: [f64; 2],
}

const SIZES: &[Size] = &[
    Size {
        magnitude: Magnitude::Loss,
        key: "loss",
        sentence: "Probability that a datagram is lost; 0.3 if not given.",
        range: Number::within("", 0.0, 1.0),
        default: [0.3; 2],
    },
    Size {
        magnitude: Magnitude::Duplication,
        key: "duplication",
        sentence: "Probability that a datagram arrives twice; 0 if not given.",
        range: Number::within("", 0.0, 1.0),
        default: [0.0; 2],
    },
    Size {
        magnitude: Magnitude::Delay,
        key: "delay_s",
        sentence: "Time that each datagram is under way; 0.001 if not given.",
        range: Number::within("s", 0.0, 10.0),
        default: [0.001; 2],
    },
    Size {
        magnitude: Magnitude::Spread,
        key: "spread_s",
        sentence: "Uniform addition to the delay of each datagram, so that they overtake one another; 0 if not given.",
        range: Number::within("s", 0.0, 10.0),
        default: [0.0; 2],
    },
    Size {
        magnitude: Magnitude::WindSpeed,
        key: "speed_m_s",
        sentence: "Mean wind from then on, from a direction that is drawn; 6 if not given.",
        range: Number::within("m/s", 0.0, 60.0),
        default: [6.0; 2],
    },
    Size {
        magnitude: Magnitude::Jump,
        key: "jump_m",
        sentence: "How far the position estimate jumps, in a horizontal direction that is drawn; 5 if not given.",
        range: Number::within("m", 0.0, 1000.0),
        default: [5.0; 2],
    },
    Size {
        magnitude: Magnitude::ClockStep,
        key: "step_s",
        sentence: "How far the autopilot's clock jumps, forward if positive; 1 if not given.",
        range: Number::within("s", -FARTHEST_S, FARTHEST_S),
        default: [1.0; 2],
    },
    Size {
        magnitude: Magnitude::ClockDrift,
        key: "drift_ppm",
        sentence: "How much too fast the autopilot's clock runs from then on, in millionths; 100 if not given.",
        range: Number::within("ppm", -1.0e5, 1.0e5),
        default: [100.0; 2],
    },
    Size {
        magnitude: Magnitude::Charge,
        key: "charge",
        sentence: "What is left in the battery, of 1; 0.1 if not given.",
        range: Number::within("", 0.0, 1.0),
        default: [0.1; 2],
    },
    Size {
        magnitude: Magnitude::Drain,
        key: "times",
        sentence: "How many times faster than it should the battery's charge falls from then on; 3 if not given.",
        range: Number::within("", 1.0, 100.0),
        default: [3.0; 2],
    },
    Size {
        magnitude: Magnitude::Rotor,
        key: "rotor",
        sentence: "Number of the rotor, from 0; 0 if not given. One that the airframe has not changes nothing.",
        range: Number::within("", 0.0, 31.0),
        default: [0.0; 2],
    },
    Size {
        magnitude: Magnitude::ToAll,
        key: "to_all",
        sentence: "1: the order is addressed to all components, 0 (if not given): to the companion's own.",
        range: Number::within("", 0.0, 1.0),
        default: [0.0; 2],
    },
];

/// One `[[fault]]` as it was read.
struct Draft {
    kind: Option<FaultKind>,
    whom: Option<Whom>,
    probability: Option<f64>,
    per_hour: Option<f64>,
    slot: Option<u64>,
    after_s: Option<[f64; 2]>,
    duration_s: Option<[f64; 2]>,
    /// By the order of [`SIZES`].
    sizes: Vec<Option<[f64; 2]>>,
}

/// Reads, or describes, a whole fault file.
fn describe(s: &mut Section<'_, '_>) -> Vec<Draft> {
    s.tables("fault", "One kind of fault.", 0, |s, _| fault(s))
}

fn fault(s: &mut Section<'_, '_>) -> Draft {
    let seconds = Number::within("s", 0.0, LONGEST_S);
    let whom = Choice(&[("i", Whom::I), ("j", Whom::J), ("either", Whom::Either), ("both", Whom::Both)]);
    let kind = s.required("kind", "What happens.", Choice(NAMES));
    let whom = s.optional(
        "vehicle",
        "Whom it befalls: \"i\", \"j\", \"both\", or \"either\", which draws one. Unset: either; both for the pair link, \
         of which one vehicle means the direction from it.",
        whom,
    );
    s.alternatives(&[&["probability"], &["rate_per_hour"]], false);
    Draft {
        kind,
        whom,
        probability: s.optional(
            "probability",
            "Of happening in a flight; 1 if not given.",
            Number::within("", 0.0, 1.0),
        ),
        per_hour: s.optional(
            "rate_per_hour",
            "Instead of a probability: how often an hour of flight, on average.",
            Number::within("1/h", 0.0, 3600.0),
        ),
        slot: s.optional(
            "slot",
            "Slot number, from 0 over superframes: `after_s` counts from vehicle I's first emission in it.",
            Integer { min: 0, max: u64::from(u16::MAX) },
        ),
        after_s: s.optional(
            "after_s",
            "When: seconds of flight, or of the slot. Unset: any time of the planned flight, or of the slot.",
            Extent(seconds),
        ),
        duration_s: s.optional(
            "duration_s",
            "How long it lasts. Unset: for ever.",
            Extent(Number::positive("s", LONGEST_S)),
        ),
        sizes: SIZES.iter().map(|size| s.optional(size.key, size.sentence, Extent(size.range))).collect(),
    }
}

/// Adds what is wrong with the settings of a fault together.
fn check(drafts: &[Draft], file: &mut Document) {
    for (index, draft) in drafts.iter().enumerate() {
        let Some(kind) = draft.kind else { continue };
        let path = format!("fault[{index}]");
        let mut refuse = |key: &str, message: String, help: &str| {
            let path = format!("{path}.{key}");
            file.fail(&path);
            file.error(file.at(&path), message, help.to_owned());
        };
        if draft.duration_s.is_some() && !kind.can_end() {
            let message = format!("`duration_s` is given for {}, which does not end", kind.name());
            refuse("duration_s", message, "remove it");
        }
        if draft.duration_s.is_none() && kind.must_end() {
            let message = format!("{} has no `duration_s`", kind.name());
            refuse("kind", message, "give the time until it is over, in seconds");
        }
        for (size, given) in SIZES.iter().zip(&draft.sizes) {
            if given.is_some() && !kind.magnitudes().contains(&size.magnitude) {
                let message = format!("`{}` means nothing for {}", size.key, kind.name());
                refuse(size.key, message, "remove it, or change `kind`");
            }
        }
    }
}

impl Draft {
    /// The law, if it has a kind.
    fn law(self) -> Option<FaultLaw> {
        let kind = self.kind?;
        let unsaid = if kind.is_of_the_pair() { Whom::Both } else { Whom::Either };
        let sizes =
            SIZES.iter().zip(self.sizes).filter(|(size, _)| kind.magnitudes().contains(&size.magnitude));
        Some(FaultLaw {
            kind,
            whom: self.whom.unwrap_or(unsaid),
            frequency: match self.per_hour {
                Some(rate) => Frequency::PerHour(rate),
                None => Frequency::Once(self.probability.unwrap_or(1.0)),
            },
            slot: self.slot.and_then(|slot| u16::try_from(slot).ok()),
            after_s: self.after_s,
            duration_s: self.duration_s,
            sizes: sizes.map(|(size, given)| (size.magnitude, given.unwrap_or(size.default))).collect(),
        })
    }
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
            reading::text(file_name, text, describe, |drafts, file| check(drafts, file));
        findings.into_result()?;
        let laws = drafts.into_iter().filter_map(Draft::law).collect();
        let canonical: Vec<String> =
            document.settings.iter().map(|(path, value)| format!("{path} = {value}")).collect();
        Ok(Self { laws, canonical: canonical.join("\n") })
    }

    /// The first of them that only a flight with radio hosts can come to.
    #[must_use]
    pub fn of_radio_hosts(&self) -> Option<&'static str> {
        let mut kinds = self.laws.iter().map(|law| law.kind);
        kinds.find(|kind| matches!(kind, FaultKind::Radio(_))).map(FaultKind::name)
    }

    /// The JSON Schema of the fault file.
    #[must_use]
    pub fn schema() -> Json {
        reading::schema(describe)
    }
}

#[cfg(test)]
mod tests {
    use super::super::kind::RadioFault;
    use super::*;

    fn laws(text: &str) -> Vec<FaultLaw> {
        Faults::parse("f.toml", text).unwrap().laws
    }

    #[test]
    fn spec_every_kind_has_a_name_of_its_own_and_is_in_the_example() {
        let laws = laws(include_str!("../../../../config/faults.toml"));
        let harsh = self::laws(include_str!("../../../../config/faults-harsh.toml"));
        let of_radios = RadioFault::ALL.map(FaultKind::Radio);
        let all = || FaultKind::ALL.iter().chain(&of_radios);
        let names: std::collections::BTreeSet<_> = all().map(|kind| kind.name()).collect();
        assert_eq!((names.len(), NAMES.len()), (all().count(), all().count()));
        let radios = Faults::parse("f.toml", include_str!("../../../../config/faults-radio.toml")).unwrap();
        assert!(radios.of_radio_hosts().is_some());
        for kind in of_radios {
            assert!(radios.laws.iter().any(|law| law.kind == kind), "{} is not in an example", kind.name());
        }
        for kind in FaultKind::ALL {
            for laws in [&laws, &harsh] {
                assert!(laws.iter().any(|law| law.kind == *kind), "{} is not in an example", kind.name());
            }
            assert!(!kind.name().is_empty());
        }
    }

    #[test]
    fn spec_a_fixed_fault_and_a_law_read() {
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
    fn spec_what_is_wrong_with_a_fault_is_said_with_its_place() {
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
