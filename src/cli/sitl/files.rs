//! The directory of a simulated flight: vehicle files for the companions, logs, plan, summary.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::autopilot::Actuation;
use crate::companion::orders_file;
use crate::config::file::{unwritable, usable_directory, write_whole};
use crate::config::{Mission, Vehicle};
use crate::desk::report::{self, Timeline, directory};
use crate::role::Role;

use crate::cli::report::{REPORT, write};
use crate::desk::simulation::{on_this_machine, vehicle_draft};

/// Kept where the operator said, or temporary and removed at the end.
pub(in crate::cli) struct Directory {
    path: PathBuf,
    temporary: bool,
}

impl Directory {
    pub fn new(out: Option<&Path>) -> Result<Self, String> {
        let path = out.map_or_else(
            || std::env::temp_dir().join(format!("veilwing-sitl-{}", std::process::id())),
            Path::to_path_buf,
        );
        usable_directory(&path)?;
        Ok(Self { path, temporary: out.is_none() })
    }

    /// One for a flight that begins. A directory with a flight in it is refused, unless that is to go: then its files do.
    pub fn of_flight(out: Option<&Path>, overwrite: bool) -> Result<Self, String> {
        let directory = Self::new(out)?;
        let earlier = flight_in(&directory.path);
        if let Some(file) = earlier.first().filter(|_| !overwrite) {
            return Err(format!(
                "there is a flight in {} already ({}): give --out another directory, or --overwrite to lose that flight",
                directory.path.display(),
                file.display()
            ));
        }
        for file in earlier {
            let file = directory.path.join(file);
            std::fs::remove_file(&file).map_err(|error| unwritable(&file, &error))?;
        }
        Ok(directory)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn write_summary(&self, document: &impl Serialize) -> Result<(), String> {
        let path = self.path.join("summary.json");
        let text = serde_json::to_string_pretty(document).map_err(|error| error.to_string())?;
        write_whole(&path, &text)
    }
}

impl Directory {
    /// Keeps the flight itself, and the mission beside it: what `veilwing report` reads.
    pub fn write_flight(&self, mission: &Path, timeline: &Timeline) -> Result<(), String> {
        let kept = self.path.join("mission.toml");
        let same = |a: &Path, b: &Path| match (a.canonicalize(), b.canonicalize()) {
            (Ok(a), Ok(b)) => a == b,
            _ => false,
        };
        if !same(mission, &kept) {
            // A pattern's file stays behind: its rows go along.
            match Mission::load(mission).ok().and_then(|mission| mission.with_rows()) {
                Some(text) => write_whole(&kept, &text)?,
                None => {
                    std::fs::copy(mission, &kept).map_err(|error| unwritable(&kept, &error))?;
                }
            }
        }
        report::store(&self.path, timeline).map_err(|error| error.to_string())?;
        // From what has just been written, so that `veilwing report` gives the same.
        let recorded = report::load(&self.path).map_err(|error| error.to_string())?;
        write(&self.path.join(REPORT), &recorded)
    }
}

impl Drop for Directory {
    fn drop(&mut self) {
        if self.temporary {
            // Nothing depends on it any more; what cannot be removed, the system's own cleaning takes.
            let _ = std::fs::remove_dir_all(&self.path);
        }
    }
}

/// The files of a simulated flight that are in a directory, without its plan: that may be a mission's alone.
fn flight_in(directory: &Path) -> Vec<PathBuf> {
    let Ok(found) = std::fs::read_dir(directory) else { return Vec::new() };
    let is_flight_s = |name: &str| {
        let log = name.starts_with("companion-") && name.ends_with(".log");
        let named = ["summary.json", REPORT, directory::SCENE, directory::TIMELINE, directory::EVENTS];
        log || name.ends_with(".tlog") || named.contains(&name)
    };
    let names = found.flatten().map(|file| file.file_name());
    let mut names: Vec<PathBuf> =
        names.filter(|name| name.to_str().is_some_and(is_flight_s)).map(PathBuf::from).collect();
    names.sort();
    names
}

/// Writes the vehicle file of one companion: loopback links, a simulated transmitter, with a link of its own if it has a
/// port for that.
pub(super) fn write_vehicle(
    directory: &Path,
    mission: &Mission,
    role: Role,
    ports: [u16; 2],
    radio_port: Option<u16>,
) -> Result<PathBuf, String> {
    let name = role.key();
    let path = directory.join(format!("vehicle-{name}.toml"));
    let mut draft = vehicle_draft(mission, role, ports);
    if draft.autopilot.actuation == Actuation::Pose {
        // What a stock PX4 obeys, in place of what only the simulated one does.
        draft.autopilot.actuation = Actuation::ThrustVector;
    }
    draft.transmitter.link = radio_port.map(on_this_machine);
    // The companion may run in another directory.
    draft.log_dir = std::path::absolute(directory).unwrap_or_else(|_| directory.to_path_buf());
    let vehicle = Vehicle::new(draft).map_err(|findings| findings.to_string())?;
    // The vehicle is a new one: nothing was ever ordered of it.
    let orders = orders_file::path(directory, role);
    if orders.exists() {
        std::fs::remove_file(&orders).map_err(|error| unwritable(&orders, &error))?;
    }
    let text = format!("# The simulated vehicle {role}.\n{}", vehicle.to_toml());
    std::fs::write(&path, text).map_err(|error| unwritable(&path, &error))?;
    Ok(path)
}
