//! A flight as data.

use mavlink::dialects::ardupilotmega::MavSeverity;
use serde::{Deserialize, Serialize};

use crate::config::{Emission, Mission};
use crate::desk::simulation::FaultKind;
use crate::geo::{Attitude, Geodetic};
use crate::planner::document::VehicleDocument;
use crate::planning::maps::NoFlyArea;
use crate::role::{PerVehicle, Role};

/// The `format` of `scene.json`.
pub const SCENE_FORMAT: &str = "veilwing-scene/1";

/// A whole flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Timeline {
    /// What does not change.
    pub scene: Scene,
    /// In the order of time.
    pub samples: Vec<Sample>,
    /// In the order of time.
    pub events: Vec<Event>,
    /// The flight document, if there is one.
    pub summary: Option<Summary>,
}

/// Who saw the flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// The simulated world: true states, true powers, true eavesdroppers.
    Simulation,
    /// The vehicles' own telemetry: estimated states, acknowledged powers; rates follow from them by the mission's
    /// model.
    Telemetry,
}

/// What does not change in a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// [`SCENE_FORMAT`].
    pub format: String,
    /// Who saw it.
    pub source: Source,
    /// The mission's name.
    pub mission: String,
    /// SHA-256 of the mission's meaning, hexadecimal.
    pub mission_digest: Option<String>,
    /// Of the simulated world.
    pub seed: Option<u64>,
    /// UTC at flight second zero, microseconds since 1970.
    pub started_utc_us: Option<u64>,
    /// Where on earth, if the mission says so.
    #[serde(default)]
    pub origin: Option<OriginScene>,
    /// Standard deviation of the attitude jitter that the plan reckons with, degrees.
    pub jitter_std_deg: Option<f64>,
    /// The mission's permission to radiate, if it has one.
    #[serde(default)]
    pub emission: Option<EmissionScene>,
    /// The channel; `None` if no mission file was found.
    pub radio: Option<RadioScene>,
    /// Where vehicles may be.
    pub airspace: Option<AirspaceScene>,
    /// Whom the flight serves.
    pub users: Vec<Place>,
    /// From whom it hides.
    pub eavesdroppers: Vec<Listener>,
    /// The plan by slot number, over all superframes.
    pub slots: Vec<PlannedSlot>,
}

/// The mission frame's origin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OriginScene {
    /// Latitude in degrees, north positive.
    pub lat_deg: f64,
    /// Longitude in degrees, east positive.
    pub lon_deg: f64,
    /// Altitude above mean sea level, metres.
    pub alt_amsl_m: f64,
}

impl OriginScene {
    /// A mission's, if it has one.
    #[must_use]
    pub fn of(mission: &Mission) -> Option<Self> {
        let Geodetic { lat_deg, lon_deg, alt_m } = mission.origin;
        mission.has_origin().then_some(Self { lat_deg, lon_deg, alt_amsl_m: alt_m })
    }
}

/// The permission to radiate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EmissionScene {
    /// Who permitted it.
    pub authorised_by: String,
    /// Lowest and highest frequency, hertz.
    pub band_hz: [f64; 2],
    /// Ceiling over every other power, watts.
    pub max_power_w: f64,
    /// To whom it was given.
    pub licensee: Option<String>,
    /// Its number or name.
    pub licence: Option<String>,
    /// From when and until when it holds, RFC 3339.
    pub valid: Option<[String; 2]>,
    /// Where.
    pub site: Option<String>,
}

impl From<&Emission> for EmissionScene {
    fn from(emission: &Emission) -> Self {
        let Emission { authorised_by, band_hz, max_power_w, licensee, licence, valid, site } =
            emission.clone();
        let valid = valid.map(|period| period.map(|moment| moment.to_string()));
        Self { authorised_by, band_hz, max_power_w, licensee, licence, valid, site }
    }
}

/// The channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RadioScene {
    /// Hertz.
    pub bandwidth_hz: f64,
    /// The noise variance, watts.
    pub noise_power_w: f64,
    /// Path gain at one metre along the pattern's maximum.
    pub reference_gain: f64,
}

/// Where vehicles may be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AirspaceScene {
    /// Lowest and highest, above the mission origin.
    pub altitude_m: [f64; 2],
    /// Corners [east, north].
    pub area_enu_m: Vec<[f64; 2]>,
    /// Where in it no vehicle may be.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub no_fly: Vec<NoFlyArea>,
    /// Between the vehicles.
    pub min_separation_m: f64,
}

/// A named place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// As in the mission.
    pub name: String,
    /// Mission ENU, metres.
    pub position_enu_m: [f64; 3],
}

/// An eavesdropper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Listener {
    /// As in the mission.
    pub name: String,
    /// The mission's estimate, ENU, metres.
    pub position_enu_m: [f64; 3],
    /// It may be anywhere in a horizontal disc of this radius, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_m: Option<f64>,
    /// Standard deviation of its position in east and in north, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub std_m: Option<f64>,
    /// Where it really was; only a simulated world knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub true_position_enu_m: Option<[f64; 3]>,
}

/// What the plan says of one slot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedSlot {
    /// The user served; empty if no plan document names it.
    pub user: String,
    /// The plan's expectation, bit/s.
    pub secrecy_rate_bps: Option<f64>,
    /// Poses and powers.
    pub vehicles: PerVehicle<VehicleDocument>,
}

/// Both vehicles and the radio at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Flight seconds.
    pub at_s: f64,
    /// `None` while nothing is known of a vehicle.
    pub vehicles: PerVehicle<Option<VehicleState>>,
    /// What is heard of I while it serves a user.
    pub heard: Option<Heard>,
}

/// One vehicle at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleState {
    /// Mission ENU, metres.
    pub position_enu_m: [f64; 3],
    /// The antenna's attitude, jitter included.
    pub attitude: Attitude,
    /// Where control has brought the body, without the jitter; `None` if not told apart.
    pub held: Option<Attitude>,
    /// The autopilot's mode, as its ground stations call it.
    pub mode: String,
    /// Motors may turn.
    pub armed: bool,
    /// On the ground.
    pub landed: bool,
    /// Battery, 0 to 1.
    pub battery: Option<f64>,
    /// Radiated power in W; `None` when silent.
    pub tx_power_w: Option<f64>,
    /// The slot number of the power command in force.
    pub slot: Option<u16>,
}

/// What is heard of I, linear.
#[derive(Debug, Clone, PartialEq)]
pub struct Heard {
    /// At the slot's user.
    pub user_sinr: f64,
    /// At each eavesdropper of the scene.
    pub eavesdropper_sinr: Vec<f64>,
    /// Bit/s.
    pub secrecy_rate_bps: f64,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// Flight seconds.
    pub at_s: f64,
    /// What sort of thing.
    pub kind: EventKind,
    /// To which vehicle, or by whose companion; `None` for both.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<Role>,
    /// How bad.
    #[serde(default)]
    pub severity: Severity,
    /// The companion's phase when it said so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<String>,
    /// A fault's kind, as in a fault file; a violation's invariant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
    /// In words.
    pub text: String,
}

impl Event {
    /// The fault that begins, if that is what happens, and if its kind is known.
    #[must_use]
    pub fn fault(&self) -> Option<FaultKind> {
        let code = self.code.as_deref().filter(|_| self.kind == EventKind::Fault)?;
        FaultKind::named(code)
    }
}

/// Sorts of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EventKind {
    /// A fault was injected.
    Fault,
    /// An injected fault ended.
    FaultOver,
    /// A companion said so.
    Notice,
    /// A companion's process began or ended.
    Process,
    /// The monitor saw an invariant broken.
    Violation,
    /// It saw one broken by nobody aboard: by a transmitter out of order, or by a simulation that ran late.
    Excused,
}

/// How bad an event is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// As it should be.
    #[default]
    Info,
    /// Out of the ordinary, and dealt with.
    Warning,
    /// The mission suffers.
    Error,
}

impl From<MavSeverity> for Severity {
    fn from(severity: MavSeverity) -> Self {
        match severity {
            MavSeverity::MAV_SEVERITY_EMERGENCY
            | MavSeverity::MAV_SEVERITY_ALERT
            | MavSeverity::MAV_SEVERITY_CRITICAL
            | MavSeverity::MAV_SEVERITY_ERROR => Self::Error,
            MavSeverity::MAV_SEVERITY_WARNING => Self::Warning,
            MavSeverity::MAV_SEVERITY_NOTICE
            | MavSeverity::MAV_SEVERITY_INFO
            | MavSeverity::MAV_SEVERITY_DEBUG => Self::Info,
        }
    }
}

/// The flight document as far as a report needs it (`veilwing-flight/1`); more keys are welcome.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Summary {
    /// `completed`, `aborted` or `interrupted`.
    pub result: String,
    /// SHA-256 of poses and powers, hexadecimal.
    #[serde(default)]
    pub plan_digest: Option<String>,
    /// Flight seconds.
    pub flight_s: f64,
    /// By slot number.
    pub slots: Vec<SlotSummary>,
    /// Broken invariants.
    pub violations: Vec<ViolationSummary>,
    /// Least distance while both were in the air.
    #[serde(default)]
    pub min_separation_m: Option<f64>,
}

/// One slot of the flight document.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct SlotSummary {
    /// The user served.
    pub user: String,
    /// The plan's expectation.
    pub planned_secrecy_rate_bps: Option<f64>,
    /// Mean over the time in which I radiated.
    pub achieved_secrecy_rate_bps: Option<f64>,
    /// Of that mean.
    pub standard_error_bps: Option<f64>,
    /// Seconds on the air.
    pub radiated_s: PerVehicle<f64>,
    /// I radiated without J on at its planned power and pose.
    pub unprotected_s: f64,
    /// True position against the plan while radiating.
    pub position_rms_m: PerVehicle<Option<f64>>,
    /// True attitude, jitter included, against the plan while radiating.
    pub attitude_rms_deg: PerVehicle<Option<f64>>,
}

/// One violation of the flight document.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct ViolationSummary {
    /// S1 to S6, F1 to F3.
    pub invariant: String,
    /// Flight seconds.
    pub at_s: f64,
    /// With the number that matters.
    pub detail: String,
}

impl Timeline {
    /// The end of the record, flight seconds.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        let last_event = self.events.last().map_or(0.0, |event| event.at_s);
        self.samples.last().map_or(0.0, |sample| sample.at_s).max(last_event)
    }
}
