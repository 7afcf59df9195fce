//! A vehicle's links: who is at their other end, with which key, and whether that is proof enough to radiate.

use std::path::{Path, PathBuf};

use super::document::Document;
use super::vehicle_draft::VehicleDraft;
use crate::link::LinkAddress;
use crate::transmitter::Kind;

/// The settings that name key files.
pub(super) const KEY_FILES: [&str; 3] = ["pair.key_file", "autopilot.key_file", "transmitter.key_file"];

/// A link over which a real transmitter could be commanded, or a pose be told, by whoever reaches it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ExposedLink {
    /// The setting that says where it goes.
    pub setting: &'static str,
    /// Whose it is.
    pub name: &'static str,
    /// The setting of the key that it lacks.
    pub key_setting: &'static str,
}

impl VehicleDraft {
    /// The key file of one of [`KEY_FILES`].
    pub(super) fn key_file_mut(&mut self, setting: &str) -> &mut Option<PathBuf> {
        match setting {
            "autopilot.key_file" => &mut self.autopilot.key_file,
            "transmitter.key_file" => &mut self.transmitter.key_file,
            _ => &mut self.key_file,
        }
    }

    /// The key files that the vehicle has, each with its setting.
    pub fn key_files(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let files = [&self.key_file, &self.autopilot.key_file, &self.transmitter.key_file];
        KEY_FILES.into_iter().zip(files).filter_map(|(setting, file)| Some((setting, file.as_deref()?)))
    }

    /// Whether something real may be radiated.
    #[must_use]
    pub fn is_real(&self) -> bool {
        self.transmitter.kind != Kind::None && !self.transmitter.simulated
    }

    /// The links that keep a real transmitter from radiating: neither signed nor a serial line. None where nothing real
    /// is radiated.
    #[must_use]
    pub fn exposed_links(&self) -> Vec<ExposedLink> {
        let (autopilot, radio) = (&self.autopilot, &self.transmitter);
        if !self.is_real() {
            return Vec::new();
        }
        let exposed = |link: &LinkAddress, key: &Option<PathBuf>| key.is_none() && !link.is_point_to_point();
        let autopilot_link = exposed(&autopilot.link, &autopilot.key_file).then_some(ExposedLink {
            setting: "autopilot.link",
            name: "the autopilot's link",
            key_setting: "[autopilot] key_file",
        });
        let radio_link = radio.link.as_ref().filter(|link| exposed(link, &radio.key_file));
        let radio_link = radio_link.map(|_| ExposedLink {
            setting: "transmitter.link",
            name: "the transmitter's link",
            key_setting: "[transmitter] key_file",
        });
        [autopilot_link, radio_link].into_iter().flatten().collect()
    }
}

/// Adds what is wrong with the links.
pub(super) fn check(draft: &VehicleDraft, file: &mut Document) {
    check_autopilot(draft, file);
    check_radio(draft, file);
    check_pair(draft, file);
}

/// Whoever speaks first is nobody in particular.
fn check_autopilot(draft: &VehicleDraft, file: &mut Document) {
    let autopilot = &draft.autopilot;
    if matches!(autopilot.link, LinkAddress::UdpIn(_))
        && autopilot.system_id.is_none()
        && file.sound(&["autopilot.link", "autopilot.system_id"])
    {
        file.missing(
            file.at("autopilot.link"),
            format!(
                "`link` is {}, which learns where the autopilot is from its frames, and `system_id` does not say which autopilot that is",
                autopilot.link
            ),
            "give [autopilot] system_id, its MAVLink system (PX4: MAV_SYS_ID, ArduPilot: SYSID_THISMAV)".to_owned(),
        );
    }
}

fn check_radio(draft: &VehicleDraft, file: &mut Document) {
    let radio = &draft.transmitter;
    if !file.sound(&["transmitter"]) {
        return;
    }
    let Some(link) = &radio.link else {
        if radio.key_file.is_some() {
            file.error(
                file.at("transmitter.key_file"),
                "`key_file` is of the radio's own link, and it has none".to_owned(),
                "give [transmitter] link, or the key in [autopilot]: the radio is behind the autopilot"
                    .to_owned(),
            );
        }
        return;
    };
    if *link == draft.autopilot.link {
        file.error(
            file.at("transmitter.link"),
            format!("`link` is {link}, which is the autopilot's too"),
            "leave it out: the radio is behind the autopilot; or give the radio's own".to_owned(),
        );
    }
    if matches!(link, LinkAddress::UdpIn(_))
        && radio.system_id.or(draft.autopilot.system_id).is_none()
        && file.sound(&["autopilot"])
    {
        file.missing(
            file.at("transmitter.link"),
            format!("`link` is {link}, which learns where the radio is from its frames, and no `system_id` says which radio that is"),
            "give [transmitter] system_id, its MAVLink system, or [autopilot] system_id if it has the autopilot's".to_owned(),
        );
    }
}

fn check_pair(draft: &VehicleDraft, file: &mut Document) {
    if draft.pair_tunnel && draft.pair_peer_system.is_none() && file.sound(&["pair.peer_system_id"]) {
        file.missing(
            file.at("pair.tunnel"),
            "`tunnel` is set, but not whom TUNNEL is addressed to".to_owned(),
            "give peer_system_id, the MAVLink system of the other vehicle".to_owned(),
        );
    }
    if let Some(system) = draft.pair_peer_system.filter(|peer| Some(*peer) == draft.autopilot.system_id) {
        file.error(
            file.at("pair.peer_system_id"),
            format!("`peer_system_id` is {system}, which is this vehicle's own system_id"),
            "give the other vehicle's; the two must differ".to_owned(),
        );
    }
}

/// What is said of an exposed link, and what to do about it.
pub(super) fn exposure(link: &ExposedLink) -> (String, String) {
    let ExposedLink { name, key_setting, .. } = link;
    let message = format!(
        "the transmitter is real (`simulated` is false), and {name} is neither signed nor a serial line: whoever reaches it could vouch for the radio"
    );
    (message, format!("give {key_setting}, or connect it by serial:"))
}

/// What keeps a key file from being used. Its content is read by the link that signs with it.
pub(super) fn key_file_fault(path: &Path) -> Option<(String, String)> {
    let name = path.display();
    let metadata = match std::fs::metadata(path) {
        Ok(metadata) if metadata.is_file() => metadata,
        Ok(_) => {
            return Some((
                format!("the key file {name} is not a file"),
                "give the path of the key itself".to_owned(),
            ));
        }
        Err(error) => {
            let help = "give the path of the key, relative to this vehicle file".to_owned();
            return Some((format!("the key file {name} cannot be read: {error}"), help));
        }
    };
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = metadata.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            let message =
                format!("the key file {name} is open to others than its owner: its mode is {mode:03o}");
            return Some((message, format!("chmod 600 {name}")));
        }
    }
    #[cfg(not(unix))]
    drop(metadata);
    None
}
