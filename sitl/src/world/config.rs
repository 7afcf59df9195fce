//! What the world is made of, checked once.

use nalgebra::{UnitQuaternion, Vector3};
use thiserror::Error;

use super::roaming::Roams;
use super::scattering::Fading;
use super::turning::{PlannedKnot, PlannedTurns};
use crate::frames::Euler;
use crate::geodesy::Origin;
use crate::vehicle::antenna::Antenna;
use crate::vehicle::config::VehicleConfig;
use crate::vehicle::jitter::JitterConfig;

/// How well a receiver's position is known. The truth is drawn once a flight, horizontally.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Uncertainty {
    /// Exactly where the mission says.
    #[default]
    Exact,
    /// Uniform on a disc of this radius, metres.
    Disc {
        /// Metres.
        radius_m: f64,
    },
    /// Gaussian on each horizontal axis.
    Gaussian {
        /// Metres.
        std_m: f64,
    },
}

/// Somebody who listens, and shall or shall not.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// As in the mission.
    pub name: String,
    /// Where the mission says, ENU, metres.
    pub position_enu_m: [f64; 3],
    /// How far the truth may be from it.
    pub uncertainty: Uncertainty,
    /// It moves, from there on.
    pub roams: Option<Roams>,
}

/// The radio channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadioConfig {
    /// Hertz.
    pub bandwidth_hz: f64,
    /// The noise variance, watts.
    pub noise_power_w: f64,
    /// Channel gain at one metre along the pattern's maximum.
    pub reference_gain: f64,
    /// The mission's cap for I and J, watts.
    pub max_power_w: [f64; 2],
}

/// Where vehicles may be.
#[derive(Debug, Clone, PartialEq)]
pub struct AirspaceConfig {
    /// Lowest and highest height above the mission's origin.
    pub altitude_m: [f64; 2],
    /// Corners of the geofence.
    pub area_enu_m: Vec<[f64; 2]>,
    /// Parts of it where no vehicle may be.
    pub no_fly: Vec<NoFlyConfig>,
    /// Metres.
    pub min_separation_m: f64,
}

/// A prism of the airspace where no vehicle may be.
#[derive(Debug, Clone, PartialEq)]
pub struct NoFlyConfig {
    /// As people call it.
    pub name: String,
    /// Corners, in either orientation.
    pub area_enu_m: Vec<[f64; 2]>,
    /// From this height above the mission's origin; `None`: from the ground.
    pub floor_m: Option<f64>,
    /// Up to this one; `None`: to the sky.
    pub ceiling_m: Option<f64>,
}

/// One vehicle's pose in a slot. Angles in the paper's convention.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedPose {
    /// Mission ENU, metres.
    pub position_enu_m: [f64; 3],
    /// Radians.
    pub roll_rad: f64,
    /// Radians.
    pub pitch_rad: f64,
    /// Radians, from east towards north.
    pub yaw_rad: f64,
    /// Watts; 0 for a vehicle that the plan keeps silent.
    pub tx_power_w: f64,
    /// How far the plan bears it to lean from this attitude, degrees; 0 of a vehicle that has no reason to.
    pub lean_deg: f64,
}

impl PlannedPose {
    pub(crate) fn euler(&self) -> Euler {
        Euler { roll_rad: self.roll_rad, pitch_rad: self.pitch_rad, yaw_rad: self.yaw_rad }
    }

    pub(crate) fn attitude(&self) -> UnitQuaternion<f64> {
        self.euler().rotation()
    }

    pub(crate) fn position(&self) -> Vector3<f64> {
        Vector3::from(self.position_enu_m)
    }
}

/// What the plan says of one slot. Power commands name a slot by its index in [`WorldConfig::slots`].
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedSlot {
    /// The user served.
    pub user: String,
    /// The plan's expectation.
    pub secrecy_rate_bps: f64,
    /// I and J; of a slot that is served through its turns as they are between two turns.
    pub poses: [PlannedPose; 2],
    /// How they turn while they radiate, if they do.
    pub turns: Option<PlannedTurns>,
}

/// How far a vehicle may be from its planned pose, judged without the injected jitter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Metres.
    pub position_m: f64,
    /// Angle of the rotation between the two attitudes, degrees.
    pub attitude_deg: f64,
    /// The same, but that nobody can overlook it within S4's 100 ms, degrees.
    pub conspicuous_deg: f64,
    /// Standard deviation of the jitter that is injected, degrees.
    pub jitter_deg: f64,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self::under_jitter(0.0)
    }
}

/// In pose, off by little, or off by what must be seen at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Off {
    Nothing,
    Little,
    Much,
}

impl Tolerance {
    /// 1 m; and 5 deg, or 3 deg and one standard deviation of the jitter if that is more. Aboard, an error of the attitude
    /// shows only in what a mean over several samples leaves of the jitter. S4's 100 ms hold five samples at 50 Hz, whose
    /// mean has a deviation of 0.45 of one sample's, and a fault is claimed at some 4.7 of those, 2.1 in all: an error
    /// below that cannot be told from the jitter at once.
    #[must_use]
    pub fn under_jitter(std_deg: f64) -> Self {
        let attitude_deg = f64::max(5.0, 3.0 + std_deg);
        Self {
            position_m: 1.0,
            attitude_deg,
            conspicuous_deg: attitude_deg.max(2.1 * std_deg),
            jitter_deg: std_deg,
        }
    }

    /// From where an attitude is off by little, and by much. A vehicle that leans comes to the limit slowly, and its companion
    /// finds that out by a mean of the jittering attitude: of the last 0.4 s that leaves a sixth of the jitter's deviation,
    /// of the last 0.1 s a third, about each axis. Three of the one, and four and a half of the other, are granted.
    fn limits_deg(&self, lean_deg: f64) -> [f64; 2] {
        if lean_deg <= self.attitude_deg {
            return [self.attitude_deg, self.conspicuous_deg];
        }
        [lean_deg + 0.5 * self.jitter_deg, lean_deg + 1.5 * self.jitter_deg]
    }

    /// How this position and (jitter-free) attitude compare with the plan's.
    pub(crate) fn judge(
        &self,
        plan: &Reference,
        position: &Vector3<f64>,
        attitude: &UnitQuaternion<f64>,
    ) -> Off {
        let off_deg = attitude.angle_to(&plan.attitude).to_degrees();
        let [little_deg, much_deg] = self.limits_deg(plan.lean_deg);
        // What is no number is off.
        let placed = (position - plan.position).norm() <= self.position_m;
        if !placed || off_deg.is_nan() || off_deg > much_deg {
            Off::Much
        } else if off_deg > little_deg {
            Off::Little
        } else {
            Off::Nothing
        }
    }
}

/// A planned pose, ready for comparison.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reference {
    pub position: Vector3<f64>,
    pub attitude: UnitQuaternion<f64>,
    pub euler: Euler,
    pub power_w: f64,
    /// The most that it may radiate: more, while another power is on its way to the radio.
    pub most_w: f64,
    pub lean_deg: f64,
}

impl From<&PlannedPose> for Reference {
    fn from(pose: &PlannedPose) -> Self {
        Self {
            position: pose.position(),
            attitude: pose.attitude(),
            euler: pose.euler(),
            power_w: pose.tx_power_w,
            most_w: pose.tx_power_w,
            lean_deg: pose.lean_deg,
        }
    }
}

/// Everything that a flight starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldConfig {
    /// The same seed gives the same world, bit for bit.
    pub seed: u64,
    /// Where the mission's frame lies.
    pub origin: Origin,
    /// UTC at simulation time zero, microseconds since 1970.
    pub utc_start_us: u64,
    /// I and J.
    pub vehicles: [VehicleConfig; 2],
    /// Users.
    pub users: Vec<Node>,
    /// Eavesdroppers.
    pub eavesdroppers: Vec<Node>,
    /// The channel.
    pub radio: RadioConfig,
    /// What the site scatters.
    pub fading: Fading,
    /// Geofence, altitudes, separation.
    pub airspace: AirspaceConfig,
    /// The injected attitude jitter.
    pub jitter: JitterConfig,
    /// The plan that is flown, slot by slot in the order of their numbers.
    pub slots: Vec<PlannedSlot>,
    /// What counts as in pose.
    pub tolerance: Tolerance,
}

/// Why a world cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    /// A number that is not finite, or not positive where it must be.
    #[error("{what} is {value}: it must be finite, and positive where it is a size")]
    Value {
        /// Which one.
        what: String,
        /// Its value.
        value: f64,
    },
    /// A slot for a user that is not there.
    #[error("slot {slot} serves user \"{user}\", who is not among the users")]
    UnknownUser {
        /// Index of the slot.
        slot: usize,
        /// The name.
        user: String,
    },
    /// Two vehicles with one system id.
    #[error("both vehicles have system id {0}: give each its own, from 1 to 254")]
    SystemIds(u8),
    /// Vehicles are not I and J, in this order.
    #[error("vehicles must be I and J, in this order")]
    Roles,
}

impl WorldConfig {
    /// Checks what the world relies on.
    pub(crate) fn check(&self) -> Result<(), Error> {
        let [i, j] = &self.vehicles;
        if [i.role.index(), j.role.index()] != [0, 1] {
            return Err(Error::Roles);
        }
        if i.system_id == j.system_id {
            return Err(Error::SystemIds(i.system_id));
        }
        for vehicle in &self.vehicles {
            if let Some((what, value)) = vehicle.fault() {
                return Err(Error::Value { what: format!("vehicle {:?}: {what}", vehicle.role), value });
            }
        }
        if let Some((what, value)) = self.fading.fault() {
            return Err(Error::Value { what: what.to_owned(), value });
        }
        for (what, value, positive) in self.numbers() {
            if !value.is_finite() || positive && value <= 0.0 {
                return Err(Error::Value { what, value });
            }
        }
        for (slot, planned) in self.slots.iter().enumerate() {
            if !self.users.iter().any(|u| u.name == planned.user) {
                return Err(Error::UnknownUser { slot, user: planned.user.clone() });
            }
        }
        Ok(())
    }

    /// The link is the paper's: dipoles with perfect nulls that point where they are told, on vehicles that know where they
    /// are, no scattering, and users who are where they are said to be.
    #[must_use]
    pub fn has_ideal_link(&self) -> bool {
        let ideal = |vehicle: &VehicleConfig| vehicle.antenna == Antenna::Dipole && vehicle.errors.is_none();
        self.fading == Fading::default()
            && self.vehicles.iter().all(ideal)
            && self.users.iter().all(|user| user.uncertainty == Uncertainty::Exact)
    }

    fn numbers(&self) -> Vec<(String, f64, bool)> {
        let named = |what: &str, value, positive| (what.to_owned(), value, positive);
        let mut all = vec![
            named("origin.lat_deg", self.origin.lat_deg, false),
            named("origin.lon_deg", self.origin.lon_deg, false),
            named("origin.alt_amsl_m", self.origin.alt_amsl_m, false),
            named("radio.bandwidth_hz", self.radio.bandwidth_hz, true),
            named("radio.noise_power_w", self.radio.noise_power_w, true),
            named("radio.reference_gain", self.radio.reference_gain, true),
            named("radio.max_power_w[0]", self.radio.max_power_w[0], false),
            named("radio.max_power_w[1]", self.radio.max_power_w[1], false),
            named("jitter.std_deg", self.jitter.std_deg, false),
            named("jitter.correlation_s", self.jitter.correlation_s, false),
            named("tolerance.position_m", self.tolerance.position_m, true),
            named("tolerance.attitude_deg", self.tolerance.attitude_deg, true),
            named("tolerance.conspicuous_deg", self.tolerance.conspicuous_deg, true),
            named("airspace.min_separation_m", self.airspace.min_separation_m, false),
            named("airspace.altitude_m[0]", self.airspace.altitude_m[0], false),
            named("airspace.altitude_m[1]", self.airspace.altitude_m[1], false),
        ];
        let corners = self.airspace.area_enu_m.iter().flatten();
        all.extend(corners.map(|v| named("airspace.area_enu_m", *v, false)));
        for area in &self.airspace.no_fly {
            let heights = area.floor_m.iter().chain(&area.ceiling_m);
            let all_of_it = area.area_enu_m.iter().flatten().chain(heights);
            all.extend(all_of_it.map(|v| (format!("no-fly area \"{}\"", area.name), *v, false)));
        }
        for Node { name, position_enu_m, uncertainty, .. } in self.users.iter().chain(&self.eavesdroppers) {
            all.extend(position_enu_m.map(|v| (format!("position of \"{name}\""), v, false)));
            let spread = match *uncertainty {
                Uncertainty::Exact => 0.0,
                Uncertainty::Disc { radius_m: s } | Uncertainty::Gaussian { std_m: s } => s,
            };
            all.push((format!("uncertainty of \"{name}\""), spread, false));
        }
        for (k, slot) in self.slots.iter().enumerate() {
            for pose in &slot.poses {
                let angles = [pose.roll_rad, pose.pitch_rad, pose.yaw_rad, pose.tx_power_w];
                all.extend(
                    angles
                        .iter()
                        .chain(&pose.position_enu_m)
                        .map(|v| (format!("pose of slot {k}"), *v, false)),
                );
            }
            for PlannedKnot { at_s, angles_rad, tx_power_w } in
                slot.turns.iter().flat_map(|turns| turns.knots.iter().flatten())
            {
                let numbers = angles_rad.iter().chain([at_s, tx_power_w]);
                all.extend(numbers.map(|v| (format!("knot of slot {k}"), *v, false)));
            }
        }
        all
    }
}
