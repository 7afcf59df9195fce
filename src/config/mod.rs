//! Mission, vehicle and radio files: TOML to validated settings, or every error with line, column and remedy.
//!
//! Each setting is declared once (`mission_file`, `vehicle_file`, `radio_file`): key, kind, range, unit, default, sentence. Reading, range
//! checks, defaults, the JSON Schema and the digest all follow from the declaration. `reading`, `reader` and `kind` serve
//! other files of this form too.

mod area_file;
mod diagnostic;
pub(crate) mod document;
mod draft;
pub(crate) mod file;
pub(crate) mod kind;
mod link_checks;
mod link_file;
mod mission;
mod mission_checks;
mod mission_file;
mod mission_warnings;
mod moved;
mod permission;
mod plan_file;
mod radio;
mod radio_draft;
mod radio_file;
pub(crate) mod reader;
pub(crate) mod reading;
pub mod schema;
mod vehicle;
mod vehicle_draft;
mod vehicle_file;
mod vehicle_links;

pub use diagnostic::{Diagnostic, Diagnostics, Severity};
pub use draft::{
    AntennaDraft, AntennasDraft, Emission, FadingDraft, JitterDraft, MissionDraft, Mode, MovesDraft,
    NoFlyDraft, NodeDraft, Optimise, PerReceiver, PlannedVehicleDraft, PlannerSettings, PointingDraft,
    PowerLimit, RadioDraft, Tdma,
};
pub use mission::{Difference, Mission, NamedEavesdropper, Settled, User, VehicleSettings};
pub use mission_file::METHODS;
pub use moved::Node;
pub use plan_file::plan_of_text;
pub use radio::RadioFile;
pub use radio_draft::{
    AtDraft, AttenuatorDraft, CommandDraft, DeviceDraft, DeviceKind, JsonRpcDraft, RadioHostDraft,
};
pub use vehicle::Vehicle;
pub(crate) use vehicle::{FenceShape, fence_corners};
pub use vehicle_draft::{Autopilot, BatteryDraft, Limits, LogLimits, Transmitter, VehicleDraft};
pub use vehicle_links::ExposedLink;

#[cfg(test)]
mod tests;
