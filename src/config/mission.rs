//! The mission file: the same on both vehicles.

use std::f64::consts::PI;
use std::ops::Deref;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use serde_json::Value as Json;
use sha2::{Digest, Sha256};

use super::diagnostic::{Diagnostics, Severity};
use super::document::Document;
use super::draft::{
    AntennaDraft, AntennasDraft, Emission, MissionDraft, MovesDraft, NodeDraft, PlannedVehicleDraft,
    PlannerSettings, PointingDraft, PowerLimit, RadioDraft, Tdma,
};
use super::file::{MAX_BYTES, read_text};
use super::mission_file::NOWHERE;
use super::reader::Section;
use super::{mission_checks, mission_file, mission_warnings, reading};
use crate::geo::{Enu, Geodetic};
use crate::planner::following::{Mover, Who};
use crate::planner::problem::{
    Airframe, Airspace, Eavesdropper, Fading, Jitter, Pattern, Pointing, PowerSteps, Problem, Radio, Rician,
    Uncertainty, VehicleModel,
};
use crate::planner::volume::Service;
use crate::planner::{PlanError, cap};
use crate::radio::measured::Measured;
use crate::role::{PerVehicle, Role};
use crate::schedule::order::Order;
use crate::schedule::table::Timing;
use crate::schedule::trajectory::Limits;
use crate::time::Utc;

/// Speed of light in m/s.
const C_M_S: f64 = 299_792_458.0;

/// A validated mission. It cannot be changed, so that its digest is always that of its settings, which are read as its own
/// fields ([`Settled`]). [`Mission::changed`] makes another mission.
#[derive(Debug, Clone)]
pub struct Mission {
    settled: Settled,
    draft: MissionDraft,
    /// What the operator should know although the mission can be flown. No errors.
    pub warnings: Diagnostics,
    document: Document,
}

impl Deref for Mission {
    type Target = Settled;

    fn deref(&self) -> &Settled {
        &self.settled
    }
}

/// The settings of a validated mission. SI units, angles in radians, positions ENU about [`Settled::origin`].
#[derive(Debug, Clone)]
pub struct Settled {
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
    /// The antennas' patterns.
    pub antennas: PerVehicle<Pattern>,
    /// Scattering about the nodes.
    pub fading: Fading,
    /// What stays wrong with a vehicle's pose during a slot.
    pub pointing: Pointing,
    /// Which powers the transmitters can give.
    pub power_steps: PerVehicle<PowerSteps>,
    /// Slots.
    pub tdma: Tdma,
    /// At least one.
    pub users: Vec<User>,
    /// At least one.
    pub eavesdroppers: Vec<NamedEavesdropper>,
    /// Those of both that move, and are reported of.
    pub movers: Vec<Mover>,
    /// How slots are planned.
    pub planner: PlannerSettings,
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
    /// Change of that acceleration, in m/s^3.
    pub jerk_m_s3: f64,
    /// How fast it turns its antenna, in rad/s.
    pub tilt_rate_rad_s: f64,
    /// Where the simulated vehicle starts. A real one starts where it stands.
    pub home_enu_m: Option<Enu>,
}

/// A ground user.
#[derive(Debug, Clone, PartialEq)]
pub struct User {
    /// Unique among users.
    pub name: String,
    /// Estimated position in metres.
    pub position_enu_m: Enu,
    /// How well it is known.
    pub uncertainty: Uncertainty,
}

/// An eavesdropper with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedEavesdropper {
    /// Unique among eavesdroppers.
    pub name: String,
    /// What the planner knows of it.
    pub node: Eavesdropper,
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
    /// What the mission states of each vehicle's antenna, in its own terms; [`Settled::antennas`] is what is made of it.
    #[must_use]
    pub fn antennas_as_stated(&self) -> PerVehicle<&AntennaDraft> {
        self.draft.antenna.each()
    }

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
        let describe = |s: &mut Section<'_, '_>| {
            let mut draft = MissionDraft::default();
            mission_file::describe(s, &mut draft);
            draft
        };
        Self::settle(reading::text(file_name, text, describe, mission_checks::check))
    }

    /// Validates a mission that was filled in instead of read: every range and every check is the file's.
    ///
    /// # Errors
    /// Everything that is wrong with it, by the settings' paths.
    pub fn new(draft: MissionDraft) -> Result<Self, Diagnostics> {
        Self::settle(reading::values("mission", draft, mission_file::describe, mission_checks::check))
    }

    /// Another mission, with some settings changed: checked anew, and with a digest of its own.
    ///
    /// # Errors
    /// Everything that is wrong with the changed one.
    pub fn changed(&self, change: impl FnOnce(&mut MissionDraft)) -> Result<Self, Diagnostics> {
        let mut draft = self.draft.clone();
        change(&mut draft);
        Self::new(draft)
    }

    fn settle(
        (draft, document, findings): (MissionDraft, Document, Diagnostics),
    ) -> Result<Self, Diagnostics> {
        let warnings = findings.into_result()?;
        let mission = Self { settled: in_si_units(&draft), draft, warnings, document };
        mission.check_with_the_planner()?;
        Ok(mission)
    }

    /// What the operator should know when the mission is to be flown from `now` on: that its start has passed, or its permission.
    #[must_use]
    pub fn warnings_at(&self, now: Utc) -> Diagnostics {
        let mut all = Diagnostics::new(&self.document.file, self.document.text.clone());
        let start = self.tdma.start_utc.and_then(|start| mission_warnings::of_start(start, now));
        if let Some((message, help)) = start {
            all.push(Severity::Warning, self.document.at("tdma.start_utc"), message, help);
        }
        let valid = self.emission.as_ref().and_then(|emission| emission.valid);
        if let Some((message, help)) = valid.and_then(|valid| mission_warnings::of_permission(valid, now)) {
            all.push(Severity::Warning, self.document.at("emission.valid"), message, help);
        }
        all
    }

    /// Whether the origin was given: where it was not, nothing real may rest on it.
    #[must_use]
    pub fn has_origin(&self) -> bool {
        self.draft.origin.is_some()
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

    /// The mission as a file that needs no other, where it has a measured pattern or an area from a file; `None` where its own
    /// file needs none.
    #[must_use]
    pub fn with_rows(&self) -> Option<String> {
        let AntennasDraft { both, i, j } = &self.draft.antenna;
        let measured =
            [Some(both), i.as_ref(), j.as_ref()].into_iter().flatten().any(|a| a.pattern.is_some());
        let needs_others = measured || self.document.given("airspace.area_file");
        needs_others.then(|| self.document.to_toml())
    }

    /// The mission as one file: as it was read, with the rows of measured patterns and what was drawn elsewhere in it.
    #[must_use]
    pub fn to_file(&self) -> String {
        self.with_rows().unwrap_or_else(|| self.document.text.to_string())
    }

    /// The JSON Schema of the mission file.
    #[must_use]
    pub fn schema() -> Json {
        reading::schema(|s| mission_file::describe(s, &mut MissionDraft::default()))
    }

    /// What the planner is asked for one user. `None` if there is no such user.
    #[must_use]
    pub fn problem(&self, user: usize) -> Option<Problem> {
        let user = self.users.get(user)?;
        Some(Problem {
            user_enu_m: user.position_enu_m,
            user_uncertainty: user.uncertainty,
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
            power_steps: self.power_steps.clone(),
            jitter: self.jitter,
            antennas: self.antennas.clone(),
            fading: self.fading,
            pointing: self.pointing,
            objective: self.planner.objective,
            free_yaw: self.planner.free_yaw,
        })
    }

    /// The largest power in W a vehicle may be planned with, and the limit that binds.
    #[must_use]
    pub fn power_ceiling(&self, role: Role) -> (f64, PowerLimit) {
        self.draft.power_ceiling(role)
    }

    /// What the slot table demands of each vehicle.
    #[must_use]
    pub fn transit_limits(&self) -> PerVehicle<Limits> {
        self.vehicles.map(|vehicle| Limits {
            acceleration_m_s2: vehicle.acceleration_m_s2,
            jerk_m_s3: Some(vehicle.jerk_m_s3),
            ..Limits::new(vehicle.speed_m_s, vehicle.climb_m_s, vehicle.tilt_rate_rad_s)
        })
    }

    /// What a plan for volume must know of slots.
    #[must_use]
    pub fn service(&self) -> Service {
        let Tdma { slot_s, guard_s, settle_s, order, .. } = self.tdma;
        let slot_limits_s = self.tdma.slot_limits_s();
        let fairness = self.planner.fairness;
        Service { slot_s, guard_s, settle_s, slot_limits_s, fairness, may_reorder: order == Order::Shortest }
    }

    /// Lengths of slots and number of superframes.
    #[must_use]
    pub fn timing(&self) -> Timing {
        let seconds = Duration::from_secs_f64;
        let Tdma { slot_s, guard_s, settle_s, superframes, .. } = self.tdma;
        Timing { settle: seconds(settle_s), ..Timing::new(seconds(slot_s), seconds(guard_s), superframes) }
    }

    /// SHA-256 over what the mission means: every setting in its canonical form, defaults filled in. Comments,
    /// formatting and the order of tables and keys do not matter; the order of users and eavesdroppers does.
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

/// A draft that passed, in SI units.
fn in_si_units(draft: &MissionDraft) -> Settled {
    let origin = draft.origin.unwrap_or(NOWHERE);
    let RadioDraft { bandwidth_hz, noise_power_w, max_power_w, carrier_hz, .. } = draft.radio;
    let reference_gain = carrier_hz.map_or(draft.radio.reference_gain, |carrier_hz| {
        let gains_dbi = draft.radio.tx_gain_dbi + draft.radio.rx_gain_dbi;
        (C_M_S / carrier_hz / (4.0 * PI)).powi(2) * 10f64.powf(gains_dbi / 10.0)
    });
    let user = |user: &NodeDraft| User {
        name: user.name.clone(),
        position_enu_m: user.position().enu(origin),
        uncertainty: user.uncertainty(),
    };
    let eavesdropper = |e: &NodeDraft| NamedEavesdropper {
        name: e.name.clone(),
        node: Eavesdropper { position_enu_m: e.position().enu(origin), uncertainty: e.uncertainty() },
    };
    let moves = |nodes: &[NodeDraft], who: fn(usize) -> Who| {
        let all = nodes.iter().enumerate().filter_map(move |(index, node)| {
            let MovesDraft { system_id, gait, std_m } = node.moves?;
            Some(Mover { who: who(index), system_id, gait, std_m })
        });
        all.collect::<Vec<_>>()
    };
    let movers = [moves(&draft.users, Who::User), moves(&draft.eavesdroppers, Who::Eavesdropper)].concat();
    Settled {
        movers,
        name: draft.name.clone(),
        seed: draft.seed,
        origin,
        emission: draft.emission.clone(),
        radio: Radio { bandwidth_hz, noise_power_w, max_power_w, reference_gain },
        carrier_hz,
        airspace: Airspace { area_enu_m: draft.area_m(), no_fly: draft.no_fly_m(), ..draft.airspace.clone() },
        airspace_max_tilt_rad: draft.airspace_max_tilt_deg.to_radians(),
        vehicles: PerVehicle::from_fn(|role| (role, &draft.vehicles[role])).map(|(role, vehicle)| {
            VehicleSettings {
                airframe: vehicle.airframe,
                max_tilt_rad: vehicle.max_tilt_deg.to_radians(),
                speed_m_s: vehicle.speed_m_s,
                climb_m_s: vehicle.climb_m_s,
                acceleration_m_s2: vehicle.acceleration_m_s2,
                jerk_m_s3: vehicle.jerk_m_s3,
                tilt_rate_rad_s: vehicle.tilt_rate_deg_s.to_radians(),
                home_enu_m: draft.home_m(role),
            }
        }),
        jitter: Jitter {
            std_rad: draft.jitter.std_deg.to_radians(),
            model: draft.jitter.model,
            axes: draft.jitter.axes,
        },
        antennas: patterns(&draft.antenna),
        fading: draft.fading.rician_k_db.map_or_else(Fading::default, |k_db| Fading {
            user: Rician::from_db(k_db.user),
            eavesdropper: Rician::from_db(k_db.eavesdropper),
        }),
        pointing: pointing(&draft.pointing),
        power_steps: draft.vehicles.as_ref().map(power_steps),
        tdma: draft.tdma,
        users: draft.users.iter().map(user).collect(),
        eavesdroppers: draft.eavesdroppers.iter().map(eavesdropper).collect(),
        planner: draft.planner,
    }
}

fn patterns(antennas: &AntennasDraft) -> PerVehicle<Pattern> {
    antennas.each().map(|AntennaDraft { null_depth_db, pattern }| {
        // Points that make no pattern were refused.
        let measured = pattern.as_ref().and_then(|points| Measured::new(points).ok());
        match (measured, null_depth_db) {
            (Some(measured), _) => Pattern::Measured(Arc::new(measured)),
            (None, Some(depth_db)) => Pattern::with_null_depth(*depth_db),
            (None, None) => Pattern::IDEAL,
        }
    })
}

fn pointing(draft: &PointingDraft) -> Pointing {
    Pointing {
        heading_std_rad: draft.heading_std_deg.unwrap_or(0.0).to_radians(),
        mounting_std_rad: draft.mounting_std_deg.unwrap_or(0.0).to_radians(),
        position_std_m: draft.position_std_m.unwrap_or_default(),
    }
}

fn power_steps(vehicle: &PlannedVehicleDraft) -> PowerSteps {
    match (&vehicle.power_levels_w, vehicle.min_power_w) {
        (Some(levels_w), _) => PowerSteps::Levels(levels_w.clone()),
        (None, Some(least_w)) if least_w > 0.0 => PowerSteps::AtLeast(least_w),
        (None, _) => PowerSteps::Any,
    }
}
