//! MAVLink to and from the vehicle's autopilot, as a state machine without I/O.
//!
//! [`Autopilot`] finds the autopilot on the link, asks for the telemetry it needs and checks that it comes, takes
//! the autopilot's companion mode (PX4 OFFBOARD, ArduCopter GUIDED) on the executive's request, sends the
//! executive's setpoints on, and hands the vehicle back. How it is to be called stands there. Whatever PX4 and ArduCopter
//! do differently is in [`firmware`].
//!
//! Two rules shape it. *The pilot wins* (F2): a heartbeat that shows another mode than the companion's ends the
//! stream at once, cancels what is still unanswered, and nothing is taken up again unasked. *Setpoints never outlive
//! the mind behind them* (F3): each goes out once, when it is set.

mod adapter;
mod alias;
mod batteries;
mod boot_clock;
mod clock;
mod command;
mod context;
mod control;
mod discovery;
mod event;
mod fence;
pub mod firmware;
mod heartbeat;
mod link;
mod outbox;
mod param_value;
mod parameter;
pub mod position_control;
mod preflight;
mod pursuit;
mod setpoint;
mod settings;
mod stall;
pub mod state;
pub(crate) mod statustext;
mod streams;
mod telemetry;

#[cfg(test)]
mod tests;

pub use crate::preflight::{Check, Verdict};
pub use adapter::Autopilot;
pub use boot_clock::BootTime;
pub use event::{EstimatorFault, Event};
pub use fence::{Fence, FenceDuty, MARGIN_M as FENCE_MARGIN_M, MOST_CORNERS as MOST_FENCE_CORNERS};
pub use firmware::{Firmware, Mode};
pub use heartbeat::heartbeat;
pub use param_value::ParamValue;
pub use setpoint::Setpoint;
pub use settings::{Actuation, FirmwareChoice, Settings};
pub use state::{Battery, Landed, Sampled, Timed, VehicleState};
pub use streams::Wanted;
