//! Mission and vehicle files: TOML to validated settings, or every error with line, column and remedy.
//!
//! Each setting is declared once (`mission_file`, `vehicle_file`): key, kind, range, unit, default, sentence. Reading, range
//! checks, defaults, the JSON Schema and the digest all follow from the declaration. `document`, `reader` and `kind` serve
//! other files of this form too.

mod diagnostic;
pub(crate) mod document;
pub(crate) mod file;
pub(crate) mod kind;
mod mission;
mod mission_checks;
mod mission_file;
mod polygon;
pub(crate) mod reader;
mod schema;
mod vehicle;
mod vehicle_file;

pub use diagnostic::{Diagnostic, Diagnostics, Severity};
pub use mission::{
    Difference, Emission, Mission, NamedEavesdropper, PlannerSettings, PowerLimit, Tdma, User,
    VehicleSettings,
};
pub use mission_file::METHODS;
pub use schema::schema;
pub use vehicle::{
    Autopilot, CommandForm, Limits, PowerParameter, PowerUnit, Transmitter, TransmitterKind, Vehicle,
};

#[cfg(test)]
mod tests;
