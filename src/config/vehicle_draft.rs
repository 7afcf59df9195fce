//! What a vehicle file says, by value: every setting with its default. Reading a file fills a draft in; so may anybody else.
//! `Vehicle::new` checks it, by the same rules.

use std::path::PathBuf;

use crate::autopilot::{Actuation, FenceDuty, FirmwareChoice};
use crate::link::{HostPort, LinkAddress};
use crate::logbook::Limits as LogbookLimits;
use crate::role::Role;
use crate::transmitter::Kind;

/// The vehicle file. SI units, angles in radians.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleDraft {
    /// Which vehicle of the pair this is.
    pub role: Role,
    /// The flight controller.
    pub autopilot: Autopilot,
    /// The payload radio.
    pub transmitter: Transmitter,
    /// MAVLink systems whose commands are obeyed without a signature.
    pub operators: Vec<u8>,
    /// Link to the other companion.
    pub pair_link: LinkAddress,
    /// The signing key of the pair link, if it is signed.
    pub key_file: Option<PathBuf>,
    /// MAVLink system of the other companion; `None`: on a link to a known address any, else the only one heard.
    pub pair_peer_system: Option<u8>,
    /// Pair messages ride in TUNNEL. Then the peer's system must be given.
    pub pair_tunnel: bool,
    /// What the vehicle may be asked for.
    pub limits: Limits,
    /// What is known of its battery.
    pub battery: BatteryDraft,
    /// Directory for logs.
    pub log_dir: PathBuf,
    /// What recorded flights may take there.
    pub log_limits: LogLimits,
}

impl VehicleDraft {
    /// A vehicle with the defaults of everything that has one.
    #[must_use]
    pub fn new(role: Role, pair_link: LinkAddress) -> Self {
        Self {
            role,
            autopilot: Autopilot::default(),
            transmitter: Transmitter::default(),
            operators: vec![255],
            pair_link,
            key_file: None,
            pair_peer_system: None,
            pair_tunnel: false,
            limits: Limits::default(),
            battery: BatteryDraft::default(),
            log_dir: PathBuf::from("flight-logs"),
            log_limits: LogLimits::default(),
        }
    }

    /// Before a file is read: what must be given is anything.
    pub(super) fn blank() -> Self {
        Self::new(Role::I, listening_on(14_600))
    }
}

/// The battery.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatteryDraft {
    /// Time in the air from full to empty, in s.
    pub endurance_s: Option<f64>,
    /// The charge to land with, of 1.
    pub reserve: f64,
}

impl Default for BatteryDraft {
    fn default() -> Self {
        Self { endurance_s: None, reserve: 0.2 }
    }
}

/// What recorded flights may take, in units of 10^6 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogLimits {
    /// All together.
    pub max_mb: u64,
    /// What they leave free on their disk.
    pub min_free_mb: u64,
}

impl Default for LogLimits {
    fn default() -> Self {
        Self { max_mb: 8_000, min_free_mb: 500 }
    }
}

impl LogLimits {
    /// The same in bytes.
    #[must_use]
    pub fn in_bytes(self) -> LogbookLimits {
        let [max_bytes, min_free_bytes] =
            [self.max_mb, self.min_free_mb].map(|megabytes| megabytes.saturating_mul(1_000_000));
        LogbookLimits { max_bytes, min_free_bytes }
    }
}

fn listening_on(port: u16) -> LinkAddress {
    LinkAddress::UdpIn(HostPort { host: "0.0.0.0".to_owned(), port })
}

/// The flight controller and how it is commanded.
#[derive(Debug, Clone, PartialEq)]
pub struct Autopilot {
    /// Where it is.
    pub link: LinkAddress,
    /// What it runs.
    pub firmware: FirmwareChoice,
    /// Which targets it is given.
    pub actuation: Actuation,
    /// Its firmware tracks position and attitude targets together, as no stock PX4 does.
    pub tracks_pose: bool,
    /// Its MAVLink system; `None`: the only one that is heard. Must be given where the link learns its peer's address.
    pub system_id: Option<u8>,
    /// The signing key of its link, if that is signed.
    pub key_file: Option<PathBuf>,
    /// The companion's own MAVLink component.
    pub component_id: u8,
    /// Setpoints and state per second.
    pub rate_hz: f64,
    /// Newtons per unit of thrust along body x, y, z, for [`Actuation::ThrustVector`]; `None`: from the autopilot.
    pub thrust_n: Option<[f64; 3]>,
    /// What becomes of the mission's area in the autopilot.
    pub fence: FenceDuty,
}

impl Default for Autopilot {
    fn default() -> Self {
        Self {
            link: listening_on(14_540),
            firmware: FirmwareChoice::Auto,
            actuation: Actuation::Pose,
            tracks_pose: false,
            system_id: None,
            key_file: None,
            component_id: 191,
            rate_hz: 50.0,
            thrust_n: None,
            fence: FenceDuty::Upload,
        }
    }
}

/// The payload radio.
#[derive(Debug, Clone, PartialEq)]
pub struct Transmitter {
    /// How its power is set.
    pub kind: Kind,
    /// It radiates nothing real.
    pub simulated: bool,
    /// Where it is, if it has a link of its own; `None`: behind the autopilot.
    pub link: Option<LinkAddress>,
    /// The signing key of that link, if it is signed.
    pub key_file: Option<PathBuf>,
    /// Its MAVLink system; `None`: the autopilot's.
    pub system_id: Option<u8>,
    /// Its MAVLink component.
    pub component_id: u8,
    /// What a command of the first form ([`Kind::Leased`]) that comes late does is accepted, so that something real may be
    /// radiated by it.
    pub accept_late_commands: bool,
    /// A radio that goes on when its own host dies is accepted, so that something real may be radiated by it.
    pub accept_orphaned_radio: bool,
}

impl Transmitter {
    /// The MAV_CMD that sets power, slot and expiry where nobody says otherwise: MAV_CMD_USER_1.
    pub(super) const COMMAND: u16 = 31_010;
}

impl Default for Transmitter {
    fn default() -> Self {
        Self {
            kind: Kind::Numbered { command: Self::COMMAND },
            simulated: true,
            link: None,
            key_file: None,
            system_id: None,
            component_id: 68,
            accept_late_commands: false,
            accept_orphaned_radio: false,
        }
    }
}

/// What a vehicle may be asked for; `None` where the mission's word is enough.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limits {
    /// Horizontal speed in m/s.
    pub speed_m_s: Option<f64>,
    /// Vertical speed in m/s.
    pub climb_m_s: Option<f64>,
    /// Turning rate of the antenna in rad/s.
    pub tilt_rate_rad_s: Option<f64>,
    /// Tilt from level in radians.
    pub max_tilt_rad: Option<f64>,
    /// Transmit power in W.
    pub max_power_w: Option<f64>,
}
