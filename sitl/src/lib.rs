//! The simulated world: software vehicles behind a MAVLink autopilot face, leased transmitters, and the radio
//! truth that scores a flight and watches its invariants from outside.
//!
//! The physics, the frames and the formulas are stated here again, from the paper and from the MAVLink
//! documents, and never shared with the companion: a sign that is wrong on one side cannot cancel on the other.
//! The library does no I/O and reads no clock: bytes and simulation time go in, MAVLink frames come out.
//!
//! Inside, the frame is the mission's: ENU about the mission origin, bodies FLU (x forward, y left, z up).
//! NED and FRD exist only behind the autopilot face ([`vehicle::autopilot`]), about each vehicle's own origin.

pub mod calibration;
mod frames;
mod geodesy;
mod random;
pub mod vehicle;
mod wire;
pub mod world;

pub use calibration::{CalibrationConfig, CalibrationError, Reading};
pub use frames::{Euler, antenna_axis};
pub use geodesy::Origin;
pub use vehicle::airframe::{Airframe, AirframeModel, Body};
pub use vehicle::airframe_file::AirframeError;
pub use vehicle::antenna::Antenna;
pub use vehicle::autopilot::SetpointCounters;
pub use vehicle::bias::{Bias, PointingErrors};
pub use vehicle::config::{
    BatteryConfig, Firmware, PowerForm, RadioDevice, RadioPlace, Role, SensorConfig, Slip, Traps,
    VehicleConfig, WindConfig,
};
pub use vehicle::geometry::{Geometry, MAX_ROTORS, Rotor};
pub use vehicle::jitter::{JitterAxes, JitterConfig, JitterModel};
pub use vehicle::radio_hop::{Manners, Toward};
pub use vehicle::transmitter::DevicePower;
pub use vehicle::{Vehicle, VehicleCounters, VehicleSnapshot};
pub use wire::WireCounters;
pub use world::circumstances::{Circumstances, Passage};
pub use world::config::{
    AirspaceConfig, Error, NoFlyConfig, Node, PlannedPose, PlannedSlot, RadioConfig, Tolerance, Uncertainty,
    WorldConfig,
};
pub use world::excuse::{Cause, Excused};
pub use world::fault::Fault;
pub use world::followed::Flown;
pub use world::record::{Heard, Record, Recorder};
pub use world::report::{FlightReport, PerVehicle, SlotReport};
pub use world::roaming::{Fix, Reporter, Roams};
pub use world::scattering::{Fading, Rician};
pub use world::turning::{PLACES_S, PlannedKnot, PlannedTurns};
pub use world::violation::{Breach, Invariant, Violation};
pub use world::{Snapshot, World};
