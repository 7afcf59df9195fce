//! Faults for a simulated flight, from a TOML file.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::role::Role;

/// A fault file.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Faults {
    /// In any order.
    #[serde(default, rename = "fault")]
    pub faults: Vec<Fault>,
}

/// One fault.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Fault {
    /// What happens.
    pub kind: Kind,
    /// To which vehicle; `pair-loss` needs none.
    pub vehicle: Option<Role>,
    /// With `slot`: seconds after vehicle I first radiates in that slot. Without: flight seconds.
    pub after_s: f64,
    /// Slot number, from 0, over superframes.
    pub slot: Option<u16>,
    /// How long it lasts; for ever if absent. Only for the kinds that can end.
    pub duration_s: Option<f64>,
}

/// Kinds of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Kind {
    /// SIGKILL of the companion.
    CompanionKill,
    /// SIGSTOP of the companion, SIGCONT after `duration_s`.
    CompanionStop,
    /// No frame passes between the vehicle and its companion.
    LinkLoss,
    /// No datagram passes between the companions.
    PairLoss,
    /// The pilot takes over.
    PilotMode,
    /// The vehicle's position estimate fails.
    EstimatorFailure,
}

impl Kind {
    /// As a fault file names it.
    pub fn name(self) -> String {
        // A unit variant is written as its name.
        serde_json::to_value(self).ok().and_then(|name| name.as_str().map(str::to_owned)).unwrap_or_default()
    }
}

impl Faults {
    /// Reads a fault file.
    ///
    /// # Errors
    /// A message with file, line, column and what to change.
    pub fn load(path: &Path) -> Result<Self, String> {
        let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let faults: Self = toml::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
        for fault in &faults.faults {
            fault.check().map_err(|message| format!("{}: {message}", path.display()))?;
        }
        Ok(faults)
    }
}

impl Fault {
    fn check(&self) -> Result<(), String> {
        if !(self.after_s.is_finite() && self.after_s >= 0.0) {
            return Err(format!("after_s = {}: give seconds, 0 or more", self.after_s));
        }
        if let Some(duration_s) = self.duration_s.filter(|d| !(d.is_finite() && *d > 0.0)) {
            return Err(format!("duration_s = {duration_s}: give seconds above 0, or leave it out"));
        }
        match (self.kind, self.vehicle) {
            (Kind::PairLoss, _) | (_, Some(_)) => Ok(()),
            (kind, None) => Err(format!("{kind:?} needs vehicle = \"i\" or \"j\"")),
        }
    }

    /// For the progress lines.
    pub fn describe(&self) -> String {
        let whom = self.vehicle.map_or("both companions".to_owned(), |role| format!("vehicle {role}"));
        format!("fault: {whom}: {}", self.what())
    }

    /// What happens, without to whom.
    pub fn what(&self) -> String {
        let what = match self.kind {
            Kind::CompanionKill => "companion killed (SIGKILL)",
            Kind::CompanionStop => "companion stopped (SIGSTOP)",
            Kind::LinkLoss => "link between autopilot and companion cut",
            Kind::PairLoss => "pair link cut",
            Kind::PilotMode => "pilot takes over",
            Kind::EstimatorFailure => "position estimate fails",
        };
        let lasting = self.duration_s.map_or(String::new(), |d| format!(" for {d} s"));
        format!("{what}{lasting}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_fault_file_reads() {
        let text = "[[fault]]\nkind = \"companion-kill\"\nvehicle = \"j\"\nslot = 1\nafter_s = 4.0\n";
        let faults: Faults = toml::from_str(text).unwrap();
        let expected = Fault {
            kind: Kind::CompanionKill,
            vehicle: Some(Role::J),
            after_s: 4.0,
            slot: Some(1),
            duration_s: None,
        };
        assert_eq!(faults.faults, vec![expected]);
        assert!(faults.faults[0].check().is_ok());
    }

    #[test]
    fn val_bad_faults_are_refused() {
        for text in ["kind = \"link-loss\"\nafter_s = 1.0", "kind = \"pair-loss\"\nafter_s = nan"] {
            let fault: Fault = toml::from_str(text).unwrap();
            assert!(fault.check().is_err(), "{text}");
        }
        assert!(toml::from_str::<Fault>("kind = \"meteor\"\nafter_s = 1.0").is_err());
        assert!(toml::from_str::<Fault>("kind = \"pair-loss\"\nafter_s = 1.0\nvehicel = \"i\"").is_err());
    }
}
