//! Every setting of the fault file, declared once: key, kind, range, unit, sentence.

use super::document::Document;
use super::faults::{FaultKind, FaultLaw, Frequency, Magnitude, Whom};
use super::kind::{Choice, Extent, Integer, Number};
use super::reader::Section;

/// No flight is longer, in seconds.
const LONGEST_S: f64 = 86_400.0;

/// The words for the kinds.
pub(super) const KINDS: &[(&str, FaultKind)] = &[
    ("companion-kill", FaultKind::CompanionKill),
    ("companion-restart", FaultKind::CompanionRestart),
    ("companion-stop", FaultKind::CompanionStop),
    ("disk-full", FaultKind::DiskFull),
    ("link-loss", FaultKind::LinkLoss),
    ("link-degraded", FaultKind::LinkDegraded),
    ("pair-loss", FaultKind::PairLoss),
    ("pair-degraded", FaultKind::PairDegraded),
    ("pilot-mode", FaultKind::PilotMode),
    ("estimator-failure", FaultKind::EstimatorFailure),
    ("gps-loss", FaultKind::GpsLoss),
    ("estimator-reset", FaultKind::EstimatorReset),
    ("clock-jump", FaultKind::ClockJump),
    ("autopilot-restart", FaultKind::AutopilotRestart),
    ("battery-low", FaultKind::BatteryLow),
    ("rotor-loss", FaultKind::RotorLoss),
    ("wind-step", FaultKind::WindStep),
    ("transmitter-ignores-expiry", FaultKind::TransmitterIgnoresExpiry),
    ("transmitter-stuck", FaultKind::TransmitterStuck),
];

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
        range: Number::within("s", -LONGEST_S, LONGEST_S),
        default: [1.0; 2],
    },
    Size {
        magnitude: Magnitude::Charge,
        key: "charge",
        sentence: "What is left in the battery, of 1; 0.1 if not given.",
        range: Number::within("", 0.0, 1.0),
        default: [0.1; 2],
    },
    Size {
        magnitude: Magnitude::Rotor,
        key: "rotor",
        sentence: "Number of the rotor, from 0; 0 if not given. One that the airframe has not changes nothing.",
        range: Number::within("", 0.0, 31.0),
        default: [0.0; 2],
    },
];

/// One `[[fault]]` as it was read.
pub(super) struct Draft {
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
pub(super) fn describe(s: &mut Section<'_, '_>) -> Vec<Draft> {
    s.tables("fault", "One kind of fault.", 0, |s, _| fault(s))
}

fn fault(s: &mut Section<'_, '_>) -> Draft {
    let seconds = Number::within("s", 0.0, LONGEST_S);
    let whom = Choice(&[("i", Whom::I), ("j", Whom::J), ("either", Whom::Either), ("both", Whom::Both)]);
    let kind = s.required("kind", "What happens.", Choice(KINDS));
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
pub(super) fn check(drafts: &[Draft], file: &mut Document) {
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
            refuse("kind", message, "give the time until the companion is started again, in seconds");
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
    pub fn law(self) -> Option<FaultLaw> {
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
