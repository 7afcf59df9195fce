//! What the world measured of a flight: its part of the flight document, and violations in words.

use std::fmt;
use std::time::Duration;

use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};

use super::excuse::Excused;
use super::violation::{Breach, Violation};

/// A value of each vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct PerVehicle<T> {
    /// Of the aerial base station.
    pub i: T,
    /// Of the jammer.
    pub j: T,
}

impl<T> From<[T; 2]> for PerVehicle<T> {
    fn from([i, j]: [T; 2]) -> Self {
        Self { i, j }
    }
}

/// One slot as it was flown.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SlotReport {
    /// The user served.
    pub user: String,
    /// The plan's expectation.
    pub planned_secrecy_rate_bps: f64,
    /// Mean over the time in which I radiated; 0 if it never did.
    pub achieved_secrecy_rate_bps: f64,
    /// Of that mean, from the means of half-second batches, so that slow errors count.
    pub standard_error_bps: f64,
    /// Seconds on the air.
    pub radiated_s: PerVehicle<f64>,
    /// I radiated without J on at its planned power and in its pose; to the microsecond of a power's change.
    pub unprotected_s: f64,
    /// J radiated out of its pose.
    pub jam_out_of_tolerance_s: f64,
    /// True position against the plan while radiating; `null` if it never did.
    pub position_rms_m: PerVehicle<Option<f64>>,
    /// True attitude, jitter included, against the plan while radiating.
    pub attitude_rms_deg: PerVehicle<Option<f64>>,
    /// The same without the injected jitter: what control and wind leave.
    pub attitude_control_rms_deg: PerVehicle<Option<f64>>,
}

/// The world's account of a flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightReport {
    /// Simulation time.
    pub flight_s: f64,
    /// In the plan's order.
    pub slots: Vec<SlotReport>,
    /// Secret bits delivered: over all slots, the rate achieved times the time in which I radiated.
    pub secrecy_volume_bits: f64,
    /// Seconds in which I radiated in its slots.
    pub on_air_s: f64,
    /// Seconds on the air in no slot of the plan.
    pub outside_slots_s: PerVehicle<f64>,
    /// I radiated without J on at its planned power and in its pose, or in no slot: in all, whatever the cause.
    pub unprotected_s: f64,
    /// Seconds on the air out of the pose of the slot, or in no slot, whatever the cause.
    pub emitted_out_of_pose_s: PerVehicle<f64>,
    /// In the order of their times.
    pub violations: Vec<Violation>,
    /// What no companion could have kept, likewise. Documents tell it with what their host knows beside it.
    #[serde(skip)]
    pub excused: Vec<Excused>,
    /// Least distance while both were in the air; `null` if they never were.
    pub min_separation_m: Option<f64>,
    /// What is truly left in the batteries at the end, of 1, whatever is said of it.
    pub battery_left: PerVehicle<f64>,
}

impl Serialize for Violation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut object = serializer.serialize_struct("Violation", 4)?;
        object.serialize_field("invariant", self.invariant().name())?;
        object.serialize_field("at_s", &self.at.as_secs_f64())?;
        object.serialize_field("detail", &self.to_string())?;
        object.serialize_field("duration_s", &self.lasted.as_secs_f64())?;
        object.end()
    }
}

/// What happened, with the number that matters.
impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.vehicle {
            Some(0) => "I",
            Some(_) => "J",
            None => "the vehicles",
        };
        let radiates = |f: &mut fmt::Formatter<'_>, after: Duration, what: &str| {
            write!(f, "{name} radiates {} ms after {what}", after.as_millis())
        };
        match self.breach {
            Breach::NoSlot => write!(f, "{name} radiates in no slot of the plan"),
            Breach::OutOfPose { off_m, off_deg } => {
                write!(f, "{name} radiates out of its pose: {off_m:.2} m and {off_deg:.2} deg off")
            }
            Breach::Unprotected => write!(f, "I radiates while J does not jam its slot as planned"),
            Breach::InfoFirst => write!(f, "I is on before J is"),
            Breach::JamLeft => write!(f, "J went off while I was on"),
            Breach::Power { power_w, allowed_w } => {
                write!(f, "{name} radiates {power_w:.6} W; at most {allowed_w:.6} W is allowed")
            }
            Breach::Near { distance_m, least_m } => {
                write!(f, "{name} are {distance_m:.2} m apart; {least_m:.2} m is the least")
            }
            Breach::Fence { beyond_m, position_m: [x, y] } => {
                write!(f, "{name} is {beyond_m:.1} m outside the geofence, at ({x:.1}, {y:.1})")
            }
            Breach::NoFly { area, inside_m, position_m: [x, y, z] } => {
                let number = area + 1;
                write!(
                    f,
                    "{name} is {inside_m:.1} m inside no-fly area {number}, at ({x:.1}, {y:.1}, {z:.1})"
                )
            }
            Breach::Band { height_m, band_m: [low, high] } => {
                write!(f, "{name} is at {height_m:.1} m, outside the band from {low:.1} to {high:.1} m")
            }
            Breach::OutOfControl { after } => {
                radiates(f, after, "HEARTBEAT showed that its companion flies no more")
            }
            Breach::BadEstimate { after } => {
                radiates(f, after, "its autopilot reported that the estimate failed")
            }
            Breach::StateLate { after } => radiates(f, after, "its position or attitude was due on the wire"),
            Breach::LinkCut { after } => radiates(f, after, "its autopilot's link was cut"),
            Breach::Unheard { after } => radiates(f, after, "its companion last heard its peer"),
            Breach::Bare { after } => {
                radiates(f, after, "J fell silent out of turn, on links that lose nothing")
            }
            Breach::Outlives { after } => radiates(f, after, "its companion was gone"),
            Breach::Endless { lasts } => write!(
                f,
                "{name} radiates by a command that lasts for {} ms more, whatever becomes of its companion",
                lasts.as_millis()
            ),
            Breach::Setpoints { after } => write!(
                f,
                "{name}'s companion still sends setpoints {} ms after HEARTBEAT showed that another hand has the vehicle",
                after.as_millis()
            ),
            Breach::TakesBack => write!(
                f,
                "{name}'s companion took the vehicle back from another hand, and no operator had asked it to"
            ),
            Breach::Ghost { after } => write!(
                f,
                "setpoints or HEARTBEAT of {name}'s companion come {} ms after it was gone",
                after.as_millis()
            ),
        }
    }
}
