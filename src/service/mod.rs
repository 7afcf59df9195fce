//! What the pair does together, on one vehicle: agreeing on slots, serving them, and ending them so that nothing is
//! transmitted unprotected and nothing jams the user (S1 to S6). No I/O, no autopilot: [`SlotService`] is told the
//! vehicle's state and the time, and gives permits to its transmitter and messages to its peer.
//!
//! The executive flies by it, and the model check, the sweep and the fuzz target drive this very type.

mod agreement_time;
mod evidence;
pub mod interlock;
mod pose_monitor;
mod protection;
mod refusals;
mod slot;
mod slot_service;
mod staleness;
mod terms;

pub use evidence::Vehicle;
pub use interlock::{Ceilings, Permit, Silence};
pub use pose_monitor::{Off, PoseMonitor, Reference, Tolerance};
pub use protection::Jamming;
pub use slot::{Served, Slot};
pub use slot_service::SlotService;
pub use staleness::{Freshness, silences_after};
pub use terms::{Event, GiveUp, Outgoing, Settings, Standing};
