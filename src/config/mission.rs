//! The mission file: the same on both vehicles.

use std::path::Path;
use std::time::Duration;

use serde_json::Value as Json;
use sha2::{Digest, Sha256};

use super::diagnostic::{Diagnostics, Severity};
use super::document::Document;
use super::file::{MAX_BYTES, read_text};
use super::{mission_checks, mission_file};
use crate::geo::{Enu, Geodetic};
use crate::planner::problem::{
    Airframe, Airspace, Eavesdropper, Jitter, Method, Objective, Problem, Radio, Uncertainty, VehicleModel,
};
use crate::planner::{PlanError, cap};
use crate::role::{PerVehicle, Role};
use crate::schedule::order::Order;
use crate::schedule::table::Timing;
use crate::schedule::trajectory::Limits;
use crate::time::Utc;

/// A validated mission. SI units, angles in radians, positions ENU about [`Mission::origin`].
#[derive(Debug, Clone)]
pub struct Mission {
    /// Name of the mission.
    pub name: String,
    /// Seed of everything random in planning.
    pub seed: u64,
    /// Origin of the mission frame; altitude above mean sea level.
    pub origin: Geodetic,
    /// Who allows what to be radiated. Without it nothing but simulated transmitters may radiate.
    pub emission: Option<Emission>,
    /// Link budget. Its powers are what the mission asks for: see [`Mission::power_ceiling`] for what may be used.
    pub radio: Radio,
    /// The carrier, where the reference gain was given by it, in Hz.
    pub carrier_hz: Option<f64>,
    /// Where vehicles may be.
    pub airspace: Airspace,
    /// Largest tilt the airspace's rules allow, in radians.
    pub airspace_max_tilt_rad: f64,
    /// What must be known of each vehicle.
    pub vehicles: PerVehicle<VehicleSettings>,
    /// Attitude jitter of both vehicles.
    pub jitter: Jitter,
    /// Slots.
    pub tdma: Tdma,
    /// At least one.
    pub users: Vec<User>,
    /// At least one.
    pub eavesdroppers: Vec<NamedEavesdropper>,
    /// How slots are planned.
    pub planner: PlannerSettings,
    /// What the operator should know although the mission can be flown. No errors.
    pub warnings: Diagnostics,
    pub(super) document: Document,
}

/// The permission to radiate.
#[derive(Debug, Clone, PartialEq)]
pub struct Emission {
    /// Who permitted it.
    pub authorised_by: String,
    /// Lowest and highest frequency in Hz.
    pub band_hz: [f64; 2],
    /// Ceiling over every other power, in W.
    pub max_power_w: f64,
}

/// What must be known of a vehicle to plan for it and to time its transits; both companions use the same values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleSettings {
    /// Omnidirectional or level.
    pub airframe: Airframe,
    /// Largest tilt of this vehicle, in radians.
    pub max_tilt_rad: f64,
    /// Horizontal speed in transit, in m/s.
    pub speed_m_s: f64,
    /// Vertical speed in transit, in m/s.
    pub climb_m_s: f64,
    /// Acceleration in transit in any direction, in m/s^2.
    pub acceleration_m_s2: f64,
    /// How fast it turns its antenna, in rad/s.
    pub tilt_rate_rad_s: f64,
    /// Where the simulated vehicle starts. A real one starts where it stands.
    pub home_enu_m: Option<Enu>,
}

/// The slot table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tdma {
    /// Length of a slot in seconds, without the transit before it.
    pub slot_s: f64,
    /// The part of a slot in which nobody radiates, in seconds, half of it at each end; shorter than a slot.
    pub guard_s: f64,
    /// Time to come to rest and catch up after each transit, in seconds.
    pub settle_s: f64,
    /// In which order users are served.
    pub order: Order,
    /// How often the whole list of users is served.
    pub superframes: u16,
    /// When the transit to the first slot begins; `None`: when the operator says so.
    pub start_utc: Option<Utc>,
}

/// A ground user.
#[derive(Debug, Clone, PartialEq)]
pub struct User {
    /// Unique among users.
    pub name: String,
    /// Position in metres.
    pub position_enu_m: Enu,
}

/// An eavesdropper with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedEavesdropper {
    /// Unique among eavesdroppers.
    pub name: String,
    /// What the planner knows of it.
    pub node: Eavesdropper,
}

/// How slots are planned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlannerSettings {
    /// The planning method.
    pub method: Method,
    /// What is maximised over uncertain positions.
    pub objective: Objective,
    /// The desired yaw is a variable instead of 0.
    pub free_yaw: bool,
}

/// Which limit holds a transmitter's power down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PowerLimit {
    /// `radio.max_power_w`.
    Radio,
    /// `emission.max_power_w`.
    Emission,
}

impl PowerLimit {
    /// The setting's name in the mission file.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Radio => "radio.max_power_w",
            Self::Emission => "emission.max_power_w",
        }
    }
}

/// A setting that differs between two missions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Its path, such as `tdma.slot_s` or `user[0].enu_m`.
    pub key: String,
    /// Its value here, `None` if unset.
    pub ours: Option<String>,
    /// Its value there, `None` if unset.
    pub theirs: Option<String>,
}

impl Mission {
    /// Reads and validates a mission file.
    ///
    /// # Errors
    /// Everything that is wrong with the file, each with its place and remedy.
    pub fn load(path: &Path) -> Result<Self, Diagnostics> {
        Self::parse(&path.display().to_string(), &read_text(path, MAX_BYTES)?)
    }

    /// Validates the text of a mission file; `file_name` is used in messages only.
    ///
    /// # Errors
    /// Everything that is wrong with the text, each with its place and remedy.
    pub fn parse(file_name: &str, text: &str) -> Result<Self, Diagnostics> {
        let (draft, document, findings) =
            Document::read(file_name, text, mission_file::describe, mission_checks::check);
        let mission = draft.into_mission(findings.into_result()?, document);
        mission.check_with_the_planner()?;
        Ok(mission)
    }

    /// A file that passes can be planned: what only several numbers together make impossible, the planner knows.
    fn check_with_the_planner(&self) -> Result<(), Diagnostics> {
        let Some(Err(error)) = self.problem(0).map(|problem| cap(&problem)) else { return Ok(()) };
        let message = match error {
            PlanError::OutOfRange { what, value, least, most } => {
                format!("the {what} comes to {value:e}, outside {least:e} to {most:e}")
            }
            error => error.to_string(),
        };
        let mut all = Diagnostics::new(&self.document.file, self.document.text.clone());
        let help =
            "check the magnitudes: powers are in W, reference_gain is linear, antenna gains are in dBi";
        all.push(Severity::Error, self.document.at("radio"), message, help.to_owned());
        Err(all)
    }

    /// The JSON Schema of the mission file.
    #[must_use]
    pub fn schema() -> Json {
        Document::schema(mission_file::describe)
    }

    /// What the planner is asked for one user. `None` if there is no such user.
    #[must_use]
    pub fn problem(&self, user: usize) -> Option<Problem> {
        let user = self.users.get(user)?;
        Some(Problem {
            user_enu_m: user.position_enu_m,
            eavesdroppers: self.eavesdroppers.iter().map(|eavesdropper| eavesdropper.node).collect(),
            radio: Radio {
                max_power_w: PerVehicle::from_fn(|role| self.power_ceiling(role).0),
                ..self.radio
            },
            airspace: self.airspace.clone(),
            vehicles: self.vehicles.map(|vehicle| VehicleModel {
                airframe: vehicle.airframe,
                max_tilt_rad: vehicle.max_tilt_rad.min(self.airspace_max_tilt_rad),
            }),
            jitter: self.jitter,
            objective: self.planner.objective,
            free_yaw: self.planner.free_yaw,
        })
    }

    /// The largest power in W a vehicle may be planned with, and the limit that binds.
    #[must_use]
    pub fn power_ceiling(&self, role: Role) -> (f64, PowerLimit) {
        let radio_w = self.radio.max_power_w[role];
        match &self.emission {
            Some(emission) if emission.max_power_w < radio_w => (emission.max_power_w, PowerLimit::Emission),
            _ => (radio_w, PowerLimit::Radio),
        }
    }

    /// What the slot table demands of each vehicle.
    #[must_use]
    pub fn transit_limits(&self) -> PerVehicle<Limits> {
        self.vehicles.map(|vehicle| Limits {
            acceleration_m_s2: vehicle.acceleration_m_s2,
            ..Limits::new(vehicle.speed_m_s, vehicle.climb_m_s, vehicle.tilt_rate_rad_s)
        })
    }

    /// Lengths of slots and number of superframes.
    #[must_use]
    pub fn timing(&self) -> Timing {
        let seconds = Duration::from_secs_f64;
        let Tdma { slot_s, guard_s, settle_s, superframes, .. } = self.tdma;
        Timing { settle: seconds(settle_s), ..Timing::new(seconds(slot_s), seconds(guard_s), superframes) }
    }

    /// SHA-256 over what the file means: every setting in its canonical form, defaults filled in. Comments,
    /// formatting and the order of tables and keys do not matter; the order of users and eavesdroppers does.
    /// It is the file's: fields changed afterwards do not change it.
    #[must_use]
    pub fn digest(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(b"veilwing-mission/1\n");
        for (key, value) in &self.document.settings {
            hash.update(format!("{key}={value}\n").as_bytes());
        }
        hash.finalize().into()
    }

    /// [`Mission::digest`] in hexadecimal.
    #[must_use]
    pub fn digest_hex(&self) -> String {
        self.digest().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// The settings that differ between two missions: what a digest mismatch is about.
    #[must_use]
    pub fn differences(&self, other: &Self) -> Vec<Difference> {
        let find = |mission: &Self, key: &str| {
            mission.document.settings.iter().find(|(name, _)| name == key).map(|(_, value)| value.to_string())
        };
        let theirs_only = other.document.settings.iter().filter(|(key, _)| find(self, key).is_none());
        self.document
            .settings
            .iter()
            .chain(theirs_only)
            .map(|(key, _)| Difference { key: key.clone(), ours: find(self, key), theirs: find(other, key) })
            .filter(|difference| difference.ours != difference.theirs)
            .collect()
    }
}

/// A mission as read, before anything is known to be right.
pub(super) struct Draft {
    pub(super) name: String,
    pub(super) seed: u64,
    pub(super) origin: Geodetic,
    pub(super) emission: Option<Emission>,
    pub(super) radio: Radio,
    pub(super) carrier_hz: Option<f64>,
    pub(super) airspace: Airspace,
    pub(super) airspace_max_tilt_rad: f64,
    pub(super) vehicles: PerVehicle<VehicleSettings>,
    pub(super) jitter: Jitter,
    pub(super) tdma: Tdma,
    pub(super) users: Vec<(String, Position)>,
    pub(super) eavesdroppers: Vec<(String, Position, Uncertainty)>,
    pub(super) planner: PlannerSettings,
}

/// A node's position as the file gives it.
#[derive(Debug, Clone, Copy)]
pub(super) enum Position {
    /// In the mission frame.
    Enu(Enu),
    /// Latitude and longitude in degrees, altitude in metres above the origin.
    Geodetic(Geodetic),
}

impl Position {
    /// The position in the frame about `origin`.
    pub(super) fn enu(self, origin: Geodetic) -> Enu {
        match self {
            Self::Enu(position) => position,
            Self::Geodetic(point) => Geodetic { alt_m: point.alt_m + origin.alt_m, ..point }.to_enu(origin),
        }
    }
}

impl Draft {
    fn into_mission(self, warnings: Diagnostics, document: Document) -> Mission {
        let origin = self.origin;
        Mission {
            name: self.name,
            seed: self.seed,
            origin,
            emission: self.emission,
            radio: self.radio,
            carrier_hz: self.carrier_hz,
            airspace: self.airspace,
            airspace_max_tilt_rad: self.airspace_max_tilt_rad,
            vehicles: self.vehicles,
            jitter: self.jitter,
            tdma: self.tdma,
            users: self
                .users
                .into_iter()
                .map(|(name, at)| User { name, position_enu_m: at.enu(origin) })
                .collect(),
            eavesdroppers: self
                .eavesdroppers
                .into_iter()
                .map(|(name, at, uncertainty)| NamedEavesdropper {
                    name,
                    node: Eavesdropper { position_enu_m: at.enu(origin), uncertainty },
                })
                .collect(),
            planner: self.planner,
            warnings,
            document,
        }
    }
}
