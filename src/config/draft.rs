//! What a mission file says, by value: every setting in the file's own unit, with its default. Reading a file fills a draft in;
//! so may anybody else. `Mission::new` checks it, by the same rules.

use std::fmt;

use nalgebra::Vector2;

use super::mission_file::NOWHERE;
use crate::geo::{Enu, Geodetic};
use crate::planner::following::Gait;
use crate::planner::problem::{
    Airframe, Airspace, JitterAxes, JitterModel, Method, NoFly, Objective, Uncertainty,
};
use crate::planner::volume::Fairness;
use crate::role::{PerVehicle, Role};
use crate::schedule::order::Order;
use crate::time::Utc;
use crate::units::Watts;

/// The mission file. The default has neither users nor eavesdroppers: at least one of each must be added.
#[derive(Debug, Clone, PartialEq)]
pub struct MissionDraft {
    /// Name of the mission.
    pub name: String,
    /// Seed of everything random in planning.
    pub seed: u64,
    /// Origin of the mission frame; altitude above mean sea level. `None`: a default where nobody is.
    pub origin: Option<Geodetic>,
    /// Who allows what to be radiated.
    pub emission: Option<Emission>,
    /// Link budget.
    pub radio: RadioDraft,
    /// Where vehicles may be. Its area counts where there is none by latitude and longitude; its no-fly areas are made of
    /// [`no_fly`](Self::no_fly), and are left empty here.
    pub airspace: Airspace,
    /// Corners of the area by latitude and longitude, in degrees.
    pub area_lat_lon: Option<Vec<[f64; 2]>>,
    /// Parts of the area in which no vehicle may be.
    pub no_fly: Vec<NoFlyDraft>,
    /// Largest tilt the airspace's rules allow, in degrees.
    pub airspace_max_tilt_deg: f64,
    /// What must be known of each vehicle.
    pub vehicles: PerVehicle<PlannedVehicleDraft>,
    /// Attitude jitter of both vehicles.
    pub jitter: JitterDraft,
    /// The vehicles' antennas.
    pub antenna: AntennasDraft,
    /// Scattering about the nodes.
    pub fading: FadingDraft,
    /// What stays wrong with a vehicle's pose during a slot.
    pub pointing: PointingDraft,
    /// Slots.
    pub tdma: Tdma,
    /// At least one.
    pub users: Vec<NodeDraft>,
    /// At least one.
    pub eavesdroppers: Vec<NodeDraft>,
    /// How slots are planned.
    pub planner: PlannerSettings,
}

impl Default for MissionDraft {
    fn default() -> Self {
        let square = [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]];
        Self {
            name: "mission".to_owned(),
            seed: 7,
            origin: None,
            emission: None,
            radio: RadioDraft::default(),
            airspace: Airspace {
                altitude_m: [80.0, 300.0],
                area_enu_m: square.map(Vector2::from).to_vec(),
                no_fly: Vec::new(),
                min_separation_m: 5.0,
            },
            area_lat_lon: None,
            no_fly: Vec::new(),
            airspace_max_tilt_deg: 90.0,
            vehicles: PerVehicle::default(),
            jitter: JitterDraft { std_deg: 2.0, model: JitterModel::Euler, axes: JitterAxes::RollPitch },
            antenna: AntennasDraft::default(),
            fading: FadingDraft::default(),
            pointing: PointingDraft::default(),
            tdma: Tdma::default(),
            users: Vec::new(),
            eavesdroppers: Vec::new(),
            planner: PlannerSettings {
                method: Method::Veilwing,
                objective: Objective::Mean,
                optimise: Optimise::Rate,
                mode: Mode::Static,
                fairness: Fairness::Slots,
                replan: false,
                free_yaw: false,
                target_rate_bps: None,
            },
        }
    }
}

/// A no-fly area. Its corners are given in the mission frame or by latitude and longitude.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NoFlyDraft {
    /// Unique among them.
    pub name: String,
    /// Corners in the mission frame, east and north, in metres.
    pub area_enu_m: Option<Vec<[f64; 2]>>,
    /// Corners by latitude and longitude, in degrees.
    pub area_lat_lon: Option<Vec<[f64; 2]>>,
    /// From this altitude above the mission origin; `None`: from the ground.
    pub floor_m: Option<f64>,
    /// Up to this one; `None`: to the sky.
    pub ceiling_m: Option<f64>,
}

/// The permission to radiate.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Emission {
    /// Who permitted it.
    pub authorised_by: String,
    /// Lowest and highest frequency in Hz.
    pub band_hz: [f64; 2],
    /// Ceiling over every other power, in W.
    pub max_power_w: f64,
    /// Whom it was given to.
    pub licensee: Option<String>,
    /// Its number, or what else it is called by.
    pub licence: Option<String>,
    /// From when, and until when, it holds.
    pub valid: Option<[Utc; 2]>,
    /// Where.
    pub site: Option<String>,
}

impl fmt::Display for Emission {
    /// All of it in one line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low_mhz, high_mhz] = self.band_hz.map(|hz| hz / 1e6);
        let most = Watts(self.max_power_w);
        write!(f, "{low_mhz} to {high_mhz} MHz, at most {most}, authorised by {}", self.authorised_by)?;
        for (name, text) in [("licensee", &self.licensee), ("licence", &self.licence), ("site", &self.site)] {
            if let Some(text) = text {
                write!(f, ", {name} {text}")?;
            }
        }
        match self.valid {
            Some([from, until]) => write!(f, ", valid from {from} to {until}"),
            None => write!(f, ", no validity stated"),
        }
    }
}

/// The link budget.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadioDraft {
    /// Bandwidth of the user's channel, in Hz.
    pub bandwidth_hz: f64,
    /// Noise power in that bandwidth, in W.
    pub noise_power_w: f64,
    /// Largest transmit power of each vehicle, in W.
    pub max_power_w: PerVehicle<f64>,
    /// Path gain at one metre, linear; the carrier's, if that is given.
    pub reference_gain: f64,
    /// Carrier frequency in Hz: makes the reference gain.
    pub carrier_hz: Option<f64>,
    /// Largest gain of the vehicles' antennas, in dBi; used with the carrier.
    pub tx_gain_dbi: f64,
    /// Gain of the nodes' antennas, in dBi; used with the carrier.
    pub rx_gain_dbi: f64,
}

impl Default for RadioDraft {
    fn default() -> Self {
        Self {
            bandwidth_hz: 1e6,
            noise_power_w: 1e-12,
            max_power_w: PerVehicle { i: 0.5, j: 0.5 },
            reference_gain: 1.0,
            carrier_hz: None,
            tx_gain_dbi: 0.0,
            rx_gain_dbi: 0.0,
        }
    }
}

/// What must be known of a vehicle to plan for it and to time its transits.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedVehicleDraft {
    /// Omnidirectional or level.
    pub airframe: Airframe,
    /// Largest tilt of this vehicle, in degrees.
    pub max_tilt_deg: f64,
    /// Horizontal speed in transit, in m/s.
    pub speed_m_s: f64,
    /// Vertical speed in transit, in m/s.
    pub climb_m_s: f64,
    /// Acceleration in transit in any direction, in m/s^2.
    pub acceleration_m_s2: f64,
    /// Change of that acceleration, in m/s^3.
    pub jerk_m_s3: f64,
    /// How fast it turns its antenna, in deg/s.
    pub tilt_rate_deg_s: f64,
    /// Where the simulated vehicle starts.
    pub home_enu_m: Option<Enu>,
    /// The same by latitude and longitude, in degrees. Not with a position in the mission frame.
    pub home_lat_lon: Option<[f64; 2]>,
    /// With latitude and longitude: altitude above the origin in metres; `None`: 0.
    pub home_alt_m: Option<f64>,
    /// The least power above off that its transmitter can give, in W.
    pub min_power_w: Option<f64>,
    /// The only powers above off that its transmitter can give, in W, rising. Not with a least power.
    pub power_levels_w: Option<Vec<f64>>,
}

impl Default for PlannedVehicleDraft {
    fn default() -> Self {
        Self {
            airframe: Airframe::Omnidirectional,
            max_tilt_deg: 90.0,
            speed_m_s: 8.0,
            climb_m_s: 3.0,
            acceleration_m_s2: 2.5,
            // Below ArduCopter's default of 5, so that what it corrects has something left.
            jerk_m_s3: 4.0,
            tilt_rate_deg_s: 45.0,
            home_enu_m: None,
            home_lat_lon: None,
            home_alt_m: None,
            min_power_w: None,
            power_levels_w: None,
        }
    }
}

impl MissionDraft {
    /// Corners of the area in the mission frame, east and north.
    #[must_use]
    pub fn area_m(&self) -> Vec<Vector2<f64>> {
        self.area_lat_lon
            .as_ref()
            .map_or_else(|| self.airspace.area_enu_m.clone(), |corners| self.in_frame(corners))
    }

    /// Corners by latitude and longitude, in the mission frame.
    fn in_frame(&self, corners: &[[f64; 2]]) -> Vec<Vector2<f64>> {
        let origin = self.origin.unwrap_or(NOWHERE);
        let in_frame = |[lat_deg, lon_deg]: &[f64; 2]| {
            let corner = Geodetic { lat_deg: *lat_deg, lon_deg: *lon_deg, alt_m: origin.alt_m };
            corner.to_enu(origin).xy()
        };
        corners.iter().map(in_frame).collect()
    }

    /// The no-fly areas in the mission frame.
    #[must_use]
    pub fn no_fly_m(&self) -> Vec<NoFly> {
        let settled = |area: &NoFlyDraft| NoFly {
            name: area.name.clone(),
            area_enu_m: match (&area.area_lat_lon, &area.area_enu_m) {
                (Some(corners), _) => self.in_frame(corners),
                (None, Some(corners)) => corners.iter().copied().map(Vector2::from).collect(),
                (None, None) => Vec::new(),
            },
            floor_m: area.floor_m,
            ceiling_m: area.ceiling_m,
        };
        self.no_fly.iter().map(settled).collect()
    }

    /// Where a simulated vehicle starts, in the mission frame.
    #[must_use]
    pub fn home_m(&self, role: Role) -> Option<Enu> {
        let origin = self.origin.unwrap_or(NOWHERE);
        let vehicle = &self.vehicles[role];
        vehicle.home_enu_m.or_else(|| {
            let [lat_deg, lon_deg] = vehicle.home_lat_lon?;
            let alt_m = origin.alt_m + vehicle.home_alt_m.unwrap_or(0.0);
            Some(Geodetic { lat_deg, lon_deg, alt_m }.to_enu(origin))
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

/// How steadily the vehicles hold their attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JitterDraft {
    /// Standard deviation of each axis, in degrees.
    pub std_deg: f64,
    /// How it adds to the attitude.
    pub model: JitterModel,
    /// The axes that jitter.
    pub axes: JitterAxes,
}

/// What is known of the vehicles' antennas.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AntennasDraft {
    /// Of both, where a vehicle has none of its own.
    pub both: AntennaDraft,
    /// Of I.
    pub i: Option<AntennaDraft>,
    /// Of J.
    pub j: Option<AntennaDraft>,
}

impl AntennasDraft {
    /// Each vehicle's.
    #[must_use]
    pub fn each(&self) -> PerVehicle<&AntennaDraft> {
        PerVehicle { i: self.i.as_ref().unwrap_or(&self.both), j: self.j.as_ref().unwrap_or(&self.both) }
    }
}

/// What is known of an antenna; nothing: an ideal dipole.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AntennaDraft {
    /// How far the null lies below the largest gain, in dB.
    pub null_depth_db: Option<f64>,
    /// The pattern's points: degrees from the axis, and dB below the largest gain. Not with a null depth.
    pub pattern: Option<Vec<[f64; 2]>>,
}

/// What is known of scattering about the nodes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FadingDraft {
    /// Rician factor about each kind of receiver, in dB; `None`: nothing is scattered.
    pub rician_k_db: Option<PerReceiver>,
}

/// One number for each kind of receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PerReceiver {
    /// The user's.
    pub user: f64,
    /// Every eavesdropper's.
    pub eavesdropper: f64,
}

/// What stays wrong with a vehicle's pose during a slot: standard deviations, the same for both vehicles; `None`: 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PointingDraft {
    /// Of the heading, in degrees.
    pub heading_std_deg: Option<f64>,
    /// Of the antenna's mounting, in degrees about each of body x and y.
    pub mounting_std_deg: Option<f64>,
    /// Of the position in metres: per horizontal axis, and vertically.
    pub position_std_m: Option<[f64; 2]>,
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
    /// The shortest and the longest slot in seconds, where slots are as long as fairness asks for; `None`: half of `slot_s` and
    /// twice that.
    pub slot_min_s: Option<f64>,
    /// See `slot_min_s`.
    pub slot_max_s: Option<f64>,
    /// In which order users are served.
    pub order: Order,
    /// How often the whole list of users is served.
    pub superframes: u16,
    /// How long a vehicle in the air that does not hear the other waits for it, silent, before it goes home, in seconds; `None`: 3.
    pub wait_for_peer_s: Option<f64>,
    /// When the transit to the first slot begins; `None`: when the operator says so.
    pub start_utc: Option<Utc>,
}

impl Default for Tdma {
    fn default() -> Self {
        Self {
            slot_s: 20.0,
            guard_s: 1.0,
            settle_s: 3.0,
            slot_min_s: None,
            slot_max_s: None,
            order: Order::Listed,
            superframes: 1,
            wait_for_peer_s: None,
            start_utc: None,
        }
    }
}

impl Tdma {
    /// The shortest and the longest slot in seconds, where slots are as long as fairness asks for.
    #[must_use]
    pub fn slot_limits_s(&self) -> [f64; 2] {
        [self.slot_min_s.unwrap_or(0.5 * self.slot_s), self.slot_max_s.unwrap_or(2.0 * self.slot_s)]
    }
}

/// What a plan is to make large.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Optimise {
    /// The rate of each slot, by itself.
    #[default]
    Rate,
    /// What is delivered over a superframe, its transits included.
    Volume,
}

/// What a vehicle may do while it radiates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// It holds one pose from a slot's beginning to its end.
    #[default]
    Static,
    /// It turns where it is: users served from the same positions follow each other with no more silence than the change asks for.
    Turning,
    /// It moves: the superframe is one periodic motion of both vehicles, where that gains anything.
    Moving,
}

/// How slots are planned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannerSettings {
    /// The planning method.
    pub method: Method,
    /// What is maximised over what stays wrong during a slot.
    pub objective: Objective,
    /// The rate of each slot, or what is delivered over a superframe.
    pub optimise: Optimise,
    /// What a vehicle may do while it radiates.
    pub mode: Mode,
    /// Who comes first in a superframe.
    pub fairness: Fairness,
    /// The plan is made anew in flight, between two slots, for the jitter and the speeds that are measured. Where somebody moves, poses
    /// and motions are made anew in any case.
    pub replan: bool,
    /// The desired yaw is a variable instead of 0.
    pub free_yaw: bool,
    /// A secrecy rate in bit/s that is counted on: plans say how likely a slot misses it.
    pub target_rate_bps: Option<f64>,
}

/// A user or an eavesdropper: its name, its position, in the mission frame or by latitude and longitude, not both, and how
/// well that is known.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeDraft {
    /// Unique among its kind.
    pub name: String,
    /// Position from the mission origin, in metres.
    pub enu_m: Option<Enu>,
    /// Latitude in degrees, north positive.
    pub lat_deg: Option<f64>,
    /// Longitude in degrees, east positive.
    pub lon_deg: Option<f64>,
    /// With latitude and longitude: altitude above the mission origin in metres; `None`: 0.
    pub alt_m: Option<f64>,
    /// It is anywhere in a horizontal disc of this radius in metres; 0 is exact.
    pub radius_m: Option<f64>,
    /// It is Gaussian with this deviation in east and in north in metres; 0 is exact. Not with a radius.
    pub std_m: Option<f64>,
    /// It moves, and somebody says where it is.
    pub moves: Option<MovesDraft>,
}

/// How a user or an eavesdropper moves, and who says where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovesDraft {
    /// MAVLink system whose GLOBAL_POSITION_INT or FOLLOW_TARGET says where it is; `None`: operators alone do.
    pub system_id: Option<u8>,
    /// How it moves.
    pub gait: Gait,
    /// Standard deviation of a reported position in metres, where the report does not say.
    pub std_m: f64,
}

impl Default for MovesDraft {
    fn default() -> Self {
        Self { system_id: None, gait: Gait::Walks, std_m: 3.0 }
    }
}

impl NodeDraft {
    /// A node by its position in the mission frame, exactly known.
    #[must_use]
    pub fn new(name: &str, enu_m: Enu) -> Self {
        Self { enu_m: Some(enu_m), ..Self::unplaced(name.to_owned()) }
    }

    pub(super) fn unplaced(name: String) -> Self {
        Self {
            name,
            enu_m: None,
            lat_deg: None,
            lon_deg: None,
            alt_m: None,
            radius_m: None,
            std_m: None,
            moves: None,
        }
    }

    pub(super) fn uncertainty(&self) -> Uncertainty {
        let positive = |value: Option<f64>| value.filter(|value| *value > 0.0);
        match (positive(self.radius_m), positive(self.std_m)) {
            (Some(radius_m), _) => Uncertainty::Disc { radius_m },
            (None, Some(std_m)) => Uncertainty::Gaussian { std_m },
            (None, None) => Uncertainty::None,
        }
    }

    /// Where it is, as far as it is told.
    pub(super) fn position(&self) -> Position {
        match (self.enu_m, self.lat_deg, self.lon_deg) {
            (None, Some(lat_deg), Some(lon_deg)) => {
                Position::Geodetic(Geodetic { lat_deg, lon_deg, alt_m: self.alt_m.unwrap_or(0.0) })
            }
            (enu_m, _, _) => Position::Enu(enu_m.unwrap_or_else(Enu::zeros)),
        }
    }
}

/// A node's position as it is given.
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
