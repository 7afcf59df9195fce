//! What one software vehicle is.

use nalgebra::Vector3;

use super::airframe::{Airframe, AirframeModel, Body};
use super::antenna::Antenna;
pub use super::autopilot::slip::Slip;
use super::bias::PointingErrors;
use super::geometry::Geometry;
pub use super::transmitter::RadioDevice;
pub use super::traps::Traps;

/// Which vehicle of the pair this is; a vehicle alone is `I`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The aerial base station.
    I,
    /// The friendly jammer.
    J,
}

impl Role {
    /// 0 for I, 1 for J.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::I => 0,
            Self::J => 1,
        }
    }
}

/// The firmware whose manners the autopilot has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Firmware {
    /// OFFBOARD from a live stream, parameters encoded bytewise.
    #[default]
    Px4,
    /// GUIDED, take-off by command, parameters cast to float.
    ArduCopter,
}

/// Mean wind and Dryden turbulence (MIL-F-8785C, low altitude).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WindConfig {
    /// Where the air moves to, east, north, up.
    pub mean_enu_m_s: [f64; 3],
    /// The wind at 20 feet (6 m) that the turbulence belongs to, m/s: 7.7 is light, 15.4 moderate, 23 severe
    /// turbulence; 0 is none.
    pub turbulence_m_s: f64,
}

/// What the autopilot's estimator gets wrong. The default is perfect.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SensorConfig {
    /// Standard deviation of the position error on each axis, metres; correlated over 20 s.
    pub position_std_m: f64,
    /// Standard deviation of the velocity error on each axis, m/s; correlated over 1 s.
    pub velocity_std_m_s: f64,
    /// Standard deviation of the attitude error about each body axis, degrees; correlated over 5 s.
    pub attitude_std_deg: f64,
    /// How old the estimate is, seconds; at most 1.
    pub lag_s: f64,
}

impl SensorConfig {
    /// A vehicle with centimetre positioning and a well-kept attitude.
    #[must_use]
    pub const fn typical() -> Self {
        Self { position_std_m: 0.03, velocity_std_m_s: 0.02, attitude_std_deg: 0.1, lag_s: 0.01 }
    }
}

/// A battery that drains with the rotors' power.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatteryConfig {
    /// Charge at the start, 0 to 1.
    pub initial: f64,
    /// Time in a level hover from full to empty.
    pub endurance_s: f64,
}

impl Default for BatteryConfig {
    fn default() -> Self {
        Self { initial: 1.0, endurance_s: 1800.0 }
    }
}

/// The form of the power command that a transmitter knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PowerForm {
    /// Its expiry counts from its receipt, COMMAND_ACK answers it.
    First,
    /// Numbered, its expiry on the radio's clock, an answer of the radio's own; the first as well, until it is given.
    #[default]
    Second,
}

/// How the companion reaches the radio.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RadioPlace {
    /// Through the autopilot, which drops what it does not know: the radio's own message rides in TUNNEL.
    #[default]
    BehindAutopilot,
    /// On the companion's wire itself, beside the autopilot.
    OnTheWire,
    /// On a link of its own, [`RADIO_LINK`](super::RADIO_LINK); the autopilot knows nothing of it.
    OnItsOwn,
}

/// One software vehicle: body, autopilot face and transmitter.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleConfig {
    /// I or J.
    pub role: Role,
    /// MAVLink system id of the autopilot and of everything aboard.
    pub system_id: u8,
    /// Where it stands at the start, mission ENU; the ground under it is level at this height.
    pub home_enu_m: [f64; 3],
    /// Heading at the start, from east towards north (0 faces east).
    pub heading_rad: f64,
    /// Where the autopilot's local origin lies, from home: real ones are set where the estimator started.
    pub local_origin_offset_enu_m: [f64; 3],
    /// What the rotors can do.
    pub airframe: Airframe,
    /// Whose manners the autopilot has.
    pub firmware: Firmware,
    /// Mass and drag.
    pub body: Body,
    /// The rotors; `None` has those of the airframe's kind.
    pub geometry: Option<Geometry>,
    /// Wind where this vehicle flies.
    pub wind: WindConfig,
    /// What the estimator gets wrong.
    pub sensors: SensorConfig,
    /// What nobody aboard can know, drawn once a flight.
    pub errors: PointingErrors,
    /// What it radiates with.
    pub antenna: Antenna,
    /// Battery.
    pub battery: BatteryConfig,
    /// Which manners of the firmware it has.
    pub traps: Traps,
    /// A slip planted on purpose in what the autopilot hears, for tests of tests.
    pub slip: Option<Slip>,
    /// The ceiling that its owner has set in the autopilot, above home: GF_MAX_VER_DIST, FENCE_ALT_MAX.
    pub flies_below_m: f64,
    /// Time from power-on until the autopilot agrees to arm.
    pub ready_after_s: f64,
    /// The transmitter's own limit.
    pub transmitter_max_dbm: f64,
    /// The form of the power command that it knows.
    pub power_form: PowerForm,
    /// The radio falls silent by itself when its command expires; one that does not says so (TX_EXPIRY_OK 0).
    pub radio_expires: bool,
    /// What the radio's device is.
    pub radio_device: RadioDevice,
    /// Where the radio is.
    pub radio_place: RadioPlace,
}

impl VehicleConfig {
    /// A vehicle of this role at the mission's origin.
    #[must_use]
    pub fn new(role: Role) -> Self {
        Self {
            role,
            system_id: role.index() as u8 + 1,
            home_enu_m: [0.0; 3],
            heading_rad: 0.0,
            local_origin_offset_enu_m: [0.0; 3],
            airframe: Airframe::default(),
            firmware: Firmware::default(),
            body: Body::default(),
            geometry: None,
            wind: WindConfig::default(),
            sensors: SensorConfig::default(),
            errors: PointingErrors::default(),
            antenna: Antenna::default(),
            battery: BatteryConfig::default(),
            traps: Traps::default(),
            slip: None,
            flies_below_m: 500.0,
            ready_after_s: 2.0,
            transmitter_max_dbm: 30.0,
            power_form: PowerForm::default(),
            radio_expires: true,
            radio_device: RadioDevice::default(),
            radio_place: RadioPlace::default(),
        }
    }

    /// Takes its airframe, its mass and its rotors from a model.
    pub fn fly(&mut self, model: AirframeModel) {
        self.airframe = model.airframe;
        self.body = model.body;
        self.geometry = Some(model.geometry);
    }

    /// The rotors that it has.
    pub(crate) fn rotors(&self) -> Geometry {
        self.geometry.clone().unwrap_or_else(|| self.airframe.rotors())
    }

    pub(crate) fn home(&self) -> Vector3<f64> {
        Vector3::from(self.home_enu_m)
    }

    /// The first value that cannot be flown, if any.
    pub(crate) fn fault(&self) -> Option<(&'static str, f64)> {
        let mut finite = vec![
            ("heading_rad", self.heading_rad),
            ("ready_after_s", self.ready_after_s),
            ("flies_below_m", self.flies_below_m),
            ("transmitter_max_dbm", self.transmitter_max_dbm),
            ("wind.turbulence_m_s", self.wind.turbulence_m_s),
            ("sensors.position_std_m", self.sensors.position_std_m),
            ("sensors.velocity_std_m_s", self.sensors.velocity_std_m_s),
            ("sensors.attitude_std_deg", self.sensors.attitude_std_deg),
            ("sensors.lag_s", self.sensors.lag_s),
            ("battery.initial", self.battery.initial),
        ];
        finite.extend(self.errors.deviations());
        finite.extend(self.radio_device.values());
        finite.extend(self.home_enu_m.map(|v| ("home_enu_m", v)));
        finite.extend(self.local_origin_offset_enu_m.map(|v| ("local_origin_offset_enu_m", v)));
        finite.extend(self.wind.mean_enu_m_s.map(|v| ("wind.mean_enu_m_s", v)));
        let endurance_s = self.battery.endurance_s;
        let drained =
            (!(endurance_s.is_finite() && endurance_s > 0.0)).then_some(("battery.endurance_s", endurance_s));
        let model = AirframeModel { airframe: self.airframe, body: self.body, geometry: self.rotors() };
        drained
            .or_else(|| finite.into_iter().find(|(_, v)| !v.is_finite()))
            .or_else(|| self.antenna.fault())
            .or_else(|| model.fault())
    }
}
