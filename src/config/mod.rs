//! Mission, vehicle and fault files: TOML to validated settings, or every error with line, column and remedy.
//!
//! Each setting is declared once (`mission_file`, `vehicle_file`, `fault_file`): key, kind, range, unit, default, sentence. Reading,
//! range checks, defaults, the JSON Schema and the digest all follow from the declaration.

mod address;
mod diagnostic;
mod document;
mod draft;
mod fault_file;
mod faults;
pub(crate) mod file;
mod kind;
mod mission;
mod mission_checks;
mod mission_file;
mod reader;
mod reading;
mod schema;
mod vehicle;
mod vehicle_file;

pub use address::{AddressError, HostPort, LinkAddress};
pub use diagnostic::{Diagnostic, Diagnostics, Severity};
pub use draft::{
    Autopilot, EavesdropperDraft, Emission, JitterDraft, Limits, MissionDraft, NodeDraft,
    PlannedVehicleDraft, PlannerSettings, RadioDraft, Tdma, Transmitter, VehicleDraft,
};
pub use faults::{FaultKind, FaultLaw, Faults, Frequency, Magnitude, Whom};
pub use mission::{Difference, Mission, NamedEavesdropper, PowerLimit, Settled, User, VehicleSettings};
pub use mission_file::METHODS;
pub use schema::schema;
pub use vehicle::Vehicle;

#[cfg(test)]
mod tests;
