//! The vehicle file: one per vehicle, what its companion must know of its own hardware.

use std::ops::Deref;
use std::path::Path;

use nalgebra::Vector2;
use serde_json::Value as Json;

use super::diagnostic::{Diagnostics, Severity};
use super::document::Document;
use super::file::{MAX_BYTES, read_text};
use super::mission::Mission;
use super::mission_checks::ORIGIN_HELP;
use super::reader::Section;
use super::vehicle_draft::{Transmitter, VehicleDraft};
use super::vehicle_links::{self, KEY_FILES, key_file_fault};
use super::{permission, reading, vehicle_file};
use crate::autopilot::{Actuation, FENCE_MARGIN_M, FenceDuty, FirmwareChoice, MOST_FENCE_CORNERS};
use crate::planner::problem::{Airspace, NoFly};
use crate::role::Role;
use crate::schedule::outset::{Outset, inset, outset};
use crate::time::Utc;
use crate::transmitter::Kind;

/// A validated vehicle file: its settings, which are read as its own fields ([`VehicleDraft`]), and what is to be said of
/// them. SI units, angles in radians.
#[derive(Debug, Clone)]
pub struct Vehicle {
    draft: VehicleDraft,
    /// What the operator should know although the file can be used. No errors.
    pub warnings: Diagnostics,
    document: Document,
}

impl Deref for Vehicle {
    type Target = VehicleDraft;

    fn deref(&self) -> &VehicleDraft {
        &self.draft
    }
}

impl Vehicle {
    /// Reads and validates a vehicle file, and the modes of the key files it names.
    ///
    /// # Errors
    /// Everything that is wrong with the file, each with its place and remedy.
    pub fn load(path: &Path) -> Result<Self, Diagnostics> {
        let mut vehicle = Self::parse(&path.display().to_string(), &read_text(path, MAX_BYTES)?)?;
        let mut faults = Diagnostics::new(&vehicle.document.file, vehicle.document.text.clone());
        for setting in KEY_FILES {
            let Some(key_file) = vehicle.draft.key_file_mut(setting) else { continue };
            *key_file = path.parent().unwrap_or(Path::new("")).join(&*key_file);
            if let Some((message, help)) = key_file_fault(key_file) {
                faults.push(Severity::Error, vehicle.document.at(setting), message, help);
            }
        }
        if faults.has_errors() { Err(faults) } else { Ok(vehicle) }
    }

    /// Validates the text of a vehicle file; `file_name` is used in messages only, and no other file is looked at.
    ///
    /// # Errors
    /// Everything that is wrong with the text, each with its place and remedy.
    pub fn parse(file_name: &str, text: &str) -> Result<Self, Diagnostics> {
        let describe = |s: &mut Section<'_, '_>| {
            let mut draft = VehicleDraft::blank();
            vehicle_file::describe(s, &mut draft);
            draft
        };
        Self::settle(reading::text(file_name, text, describe, check))
    }

    /// Validates a vehicle that was filled in instead of read: every range and every check is the file's.
    ///
    /// # Errors
    /// Everything that is wrong with it, by the settings' paths.
    pub fn new(draft: VehicleDraft) -> Result<Self, Diagnostics> {
        Self::settle(reading::values("vehicle", draft, vehicle_file::describe, check))
    }

    fn settle(
        (draft, document, findings): (VehicleDraft, Document, Diagnostics),
    ) -> Result<Self, Diagnostics> {
        Ok(Self { draft, warnings: findings.into_result()?, document })
    }

    /// The text of a vehicle file that says the same, defaults spelt out.
    #[must_use]
    pub fn to_toml(&self) -> String {
        self.document.to_toml()
    }

    /// The text of the file as it was read; of a vehicle that was filled in, of one that says the same.
    #[must_use]
    pub fn to_file(&self) -> String {
        if self.document.text.is_empty() { self.to_toml() } else { self.document.text.to_string() }
    }

    /// An error at a setting, found by whoever uses it.
    pub(crate) fn error_at(&self, setting: &str, message: String, help: String) -> Diagnostics {
        let mut all = Diagnostics::new(&self.document.file, self.document.text.clone());
        all.push(Severity::Error, self.document.at(setting), message, help);
        all
    }

    /// The JSON Schema of the vehicle file.
    #[must_use]
    pub fn schema() -> Json {
        reading::schema(|s| vehicle_file::describe(s, &mut VehicleDraft::blank()))
    }

    /// What is wrong between this vehicle and a mission: limits below what the mission plans with, a real transmitter
    /// without the mission's leave, or with a link that anyone may speak on. May hold warnings alone: see [`Diagnostics::into_result`].
    #[must_use]
    pub fn check_against(&self, mission: &Mission) -> Diagnostics {
        let file = &self.document;
        let mut all = Diagnostics::new(&file.file, file.text.clone());
        for Comparison { key, unit, limit, planned, planned_by, severity } in self.comparisons(mission) {
            // Radians and back lose a last digit, which is neither a difference nor worth showing.
            let shown = |value: f64| (value * 1e9).round() / 1e9;
            let planned = shown(planned);
            let Some(limit) = limit.map(shown).filter(|limit| *limit < planned) else { continue };
            let consequence = match severity {
                Severity::Error => "transits would be late",
                Severity::Warning => "the limit holds, and the flight falls short of its plan",
            };
            let message = format!(
                "`{key}` is {limit} {unit}, but the mission plans this vehicle with {planned} {unit}"
            );
            let help = format!(
                "{consequence}: lower {planned_by} in the mission, on both vehicles, or raise the limit"
            );
            all.push(severity, file.at(&format!("limits.{key}")), message, help);
        }
        if self.is_real() {
            let mut refuse = |message: &str, help: &str| {
                let at = file.at("transmitter.simulated");
                all.push(Severity::Error, at, message.to_owned(), help.to_owned());
            };
            match &mission.emission {
                None => refuse(
                    "the transmitter is real, but the mission has no [emission] table",
                    "add [emission] with who authorised it, the band, the largest power and when it is valid, or set simulated = true",
                ),
                Some(_) if !mission.has_origin() => {
                    refuse("the transmitter is real, but the mission has no `origin`", ORIGIN_HELP);
                }
                Some(emission) => {
                    if let Some((message, help)) = permission::fault(emission.valid, mission.tdma.start_utc) {
                        refuse(&message, &help);
                    }
                }
            }
        }
        if self.autopilot.fence != FenceDuty::None
            && let Err(Corners(count)) = fence_corners(mission)
        {
            let message = format!(
                "the mission's area and no-fly areas make a fence of {count} corners, and no autopilot keeps more than {MOST_FENCE_CORNERS}"
            );
            let help = "give airspace.area_enu_m, or [[airspace.no_fly]], fewer corners, on both vehicles, or say fence = \"none\""
                .to_owned();
            all.push(Severity::Error, file.at("autopilot.fence"), message, help);
        }
        for link in self.exposed_links() {
            let (message, help) = vehicle_links::exposure(&link);
            all.push(Severity::Error, file.at(link.setting), message, help);
        }
        all
    }

    /// What is wrong with radiating by the mission's permission at `now`, as this machine's clock has it, or at the mission's
    /// start where that is given. Nothing where nothing real is radiated.
    #[must_use]
    pub fn check_permission_at(&self, mission: &Mission, now: Utc) -> Diagnostics {
        let file = &self.document;
        let mut all = Diagnostics::new(&file.file, file.text.clone());
        let valid = mission.emission.as_ref().and_then(|emission| emission.valid);
        if let Some(valid) = valid.filter(|_| self.is_real())
            && let Some((message, help)) = permission::fault_at(valid, mission.tdma.start_utc, now)
        {
            all.push(Severity::Error, file.at("transmitter.simulated"), message, help);
        }
        all
    }

    /// Each limit against what the mission plans with. Power and tilt may stay below their ceilings, so that a
    /// stricter limit is no error; speeds are what the slot table is computed from.
    fn comparisons(&self, mission: &Mission) -> [Comparison; 5] {
        use Severity::{Error, Warning};
        let limits = self.limits;
        let planned = mission.vehicles[self.role];
        let table = if self.role == Role::I { "vehicles.i" } else { "vehicles.j" };
        let compare = |key, unit, limit, planned, severity| {
            let planned_by = format!("{table}.{key}");
            Comparison { key, unit, limit, planned, planned_by, severity }
        };
        let tilt_deg = planned.max_tilt_rad.min(mission.airspace_max_tilt_rad).to_degrees();
        let tilt_rate_deg_s = planned.tilt_rate_rad_s.to_degrees();
        let (power_w, power_limit) = mission.power_ceiling(self.role);
        [
            compare("speed_m_s", "m/s", limits.speed_m_s, planned.speed_m_s, Error),
            compare("climb_m_s", "m/s", limits.climb_m_s, planned.climb_m_s, Error),
            compare(
                "tilt_rate_deg_s",
                "deg/s",
                limits.tilt_rate_rad_s.map(f64::to_degrees),
                tilt_rate_deg_s,
                Error,
            ),
            compare("max_tilt_deg", "deg", limits.max_tilt_rad.map(f64::to_degrees), tilt_deg, Warning),
            Comparison {
                planned_by: power_limit.key().to_owned(),
                ..compare("max_power_w", "W", limits.max_power_w, power_w, Warning)
            },
        ]
    }
}

/// More corners than any autopilot keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Corners(pub usize);

/// The fence that an autopilot is given for a mission.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct FenceShape {
    /// Its area and a margin.
    pub area: Outset,
    /// Polygons that nobody may enter: no-fly areas less the margin.
    pub zones: Vec<Vec<Vector2<f64>>>,
    /// No-fly areas that the autopilot cannot be told of, by name, each with the reason.
    pub untold: Vec<String>,
}

/// The fence that an autopilot is given for a mission: its area and a margin, and its no-fly areas less one. An autopilot's
/// zones have no heights: an area over or under which the mission may fly is none of them.
///
/// # Errors
/// [`Corners`], if they are too many.
pub(crate) fn fence_corners(mission: &Mission) -> Result<FenceShape, Corners> {
    let Airspace { area_enu_m: area, altitude_m: [low, high], no_fly, .. } = &mission.airspace;
    if area.len() > MOST_FENCE_CORNERS {
        return Err(Corners(area.len()));
    }
    // A mission's area has an interior: that was checked when it was read.
    let area = outset(area, FENCE_MARGIN_M).map_err(|_| Corners(area.len()))?;
    let mut shape = FenceShape { area, ..FenceShape::default() };
    for area in no_fly {
        let (NoFly { name, area_enu_m, .. }, [floor, ceiling]) = (area, area.heights_m());
        if floor > *low || ceiling < *high {
            shape.untold.push(format!("{name:?} (it has a height)"));
        } else if let Some(zone) = inset(area_enu_m, FENCE_MARGIN_M) {
            shape.zones.push(zone);
        } else {
            shape.untold.push(format!("{name:?} (too narrow for a margin)"));
        }
    }
    let count = shape.area.corners.len() + shape.zones.iter().map(Vec::len).sum::<usize>();
    if count > MOST_FENCE_CORNERS { Err(Corners(count)) } else { Ok(shape) }
}

/// A limit of the vehicle and what the mission plans with.
struct Comparison {
    key: &'static str,
    unit: &'static str,
    limit: Option<f64>,
    planned: f64,
    /// The mission's setting.
    planned_by: String,
    severity: Severity,
}

/// Settings against each other.
fn check(draft: &VehicleDraft, file: &mut Document) {
    let refuse = |file: &mut Document, path: &str, message: &str, help: &str| {
        file.error(file.at(path), message.to_owned(), help.to_owned());
    };
    let autopilot = &draft.autopilot;
    let may_be_thrust = matches!(autopilot.actuation, Actuation::ThrustVector | Actuation::Auto);
    if may_be_thrust && autopilot.rate_hz < 50.0 && file.sound(&["autopilot.rate_hz"]) {
        let message = format!("`rate_hz` is {} Hz, too slow to fly by thrust vector", autopilot.rate_hz);
        refuse(file, "autopilot.rate_hz", &message, "give at least 50");
    }
    if autopilot.actuation == Actuation::Pose
        && autopilot.firmware == FirmwareChoice::Px4
        && !autopilot.tracks_pose
        && file.sound(&["autopilot.actuation", "autopilot.firmware", "autopilot.tracks_pose"])
    {
        let message =
            "`actuation` is \"pose\", which no stock PX4 can do: it obeys the last of position and attitude";
        let help = "give \"thrust_vector\" (fully actuated) or \"position\"; or tracks_pose = true for firmware that tracks both";
        refuse(file, "autopilot.actuation", message, help);
    }
    if autopilot.thrust_n.is_some()
        && !may_be_thrust
        && file.sound(&["autopilot.thrust_n", "autopilot.actuation"])
    {
        let message = format!("`thrust_n` means nothing with actuation \"{}\"", autopilot.actuation);
        refuse(file, "autopilot.thrust_n", &message, "leave it out, or give actuation = \"thrust_vector\"");
    }
    vehicle_links::check(draft, file);
    check_form(&draft.transmitter, file);
}

/// A command that counts from its receipt prolongs what is real.
fn check_form(transmitter: &Transmitter, file: &mut Document) {
    let late = matches!(transmitter.kind, Kind::Leased { .. });
    if late && !transmitter.simulated && !transmitter.accept_late_commands && file.sound(&["transmitter"]) {
        file.error(
            file.at("transmitter.form"),
            "the transmitter is real, and its commands expire so long after their receipt (`form` 1): one that comes late lasts too long"
                .to_owned(),
            "use a radio of form 2, or say accept_late_commands = true if the way to the radio delays nothing".to_owned(),
        );
    }
}
