//! What the planner is asked: one slot's user, the eavesdroppers, the radio, the airspace and the vehicles.
//! Built by `config` from a mission file, or by hand by users of the library. Frame: ENU about the mission origin.

use nalgebra::{Vector2, Vector3};

use crate::geo::polygon::Polygon;
use crate::role::PerVehicle;

pub use crate::radio::antenna::Pattern;
pub use crate::radio::fading::{Fading, Rician};
pub use crate::radio::jitter::{Jitter, JitterAxes, JitterModel};

/// The problem of one TDMA slot (paper 2.2a, 2.2b with the field's constraints).
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    /// The served user's position in metres, as it is estimated.
    pub user_enu_m: Vector3<f64>,
    /// How well it is known.
    pub user_uncertainty: Uncertainty,
    /// At least one.
    pub eavesdroppers: Vec<Eavesdropper>,
    /// Link budget and power limits.
    pub radio: Radio,
    /// Where vehicles may be.
    pub airspace: Airspace,
    /// What each vehicle can do.
    pub vehicles: PerVehicle<VehicleModel>,
    /// Which powers up to its ceiling each transmitter can give.
    pub power_steps: PerVehicle<PowerSteps>,
    /// Attitude jitter of both vehicles.
    pub jitter: Jitter,
    /// The antennas' patterns.
    pub antennas: PerVehicle<Pattern>,
    /// Scattering about the nodes.
    pub fading: Fading,
    /// What stays wrong with each vehicle's pose during a slot.
    pub pointing: Pointing,
    /// Over what stays wrong during a slot: what is maximised.
    pub objective: Objective,
    /// The desired yaw is a variable instead of 0.
    pub free_yaw: bool,
}

impl Problem {
    /// Whether anything but the eavesdroppers' positions stays wrong during a slot.
    #[must_use]
    pub fn errs(&self) -> bool {
        self.pointing.is_present() || self.user_uncertainty.is_present()
    }

    /// Whether the link is the paper's but for jitter and uncertain eavesdroppers: dipoles without a floor, nothing
    /// scattered, poses and user as they are said to be.
    #[must_use]
    pub fn has_ideal_link(&self) -> bool {
        self.antennas.i.is_ideal() && self.antennas.j.is_ideal() && !self.fading.is_present() && !self.errs()
    }

    /// The paper's set-up (its section V): a user at the origin, these eavesdroppers on the ground, given as east and
    /// north; 1 MHz, a noise variance of 1e-12 W, reference gain 1, the same power ceiling for both vehicles; an
    /// altitude of 80 to 300 m over a square of a kilometre about the user, no separation; omnidirectional vehicles that
    /// tilt at will; Euler jitter of roll and pitch, all positions known. What figures, examples, benches and tests
    /// start from.
    #[must_use]
    pub fn paper(
        eavesdroppers_m: impl IntoIterator<Item = [f64; 2]>,
        max_power_w: f64,
        jitter_std_rad: f64,
    ) -> Self {
        let vehicle =
            VehicleModel { airframe: Airframe::Omnidirectional, max_tilt_rad: std::f64::consts::FRAC_PI_2 };
        let corners = [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]];
        let on_the_ground = |[east, north]: [f64; 2]| Eavesdropper {
            position_enu_m: Vector3::new(east, north, 0.0),
            uncertainty: Uncertainty::None,
        };
        Self {
            user_enu_m: Vector3::zeros(),
            user_uncertainty: Uncertainty::None,
            eavesdroppers: eavesdroppers_m.into_iter().map(on_the_ground).collect(),
            radio: Radio {
                bandwidth_hz: 1e6,
                noise_power_w: 1e-12,
                max_power_w: PerVehicle { i: max_power_w, j: max_power_w },
                reference_gain: 1.0,
            },
            airspace: Airspace {
                altitude_m: [80.0, 300.0],
                area_enu_m: corners.map(Vector2::from).to_vec(),
                no_fly: Vec::new(),
                min_separation_m: 0.0,
            },
            vehicles: PerVehicle { i: vehicle, j: vehicle },
            power_steps: PerVehicle::default(),
            jitter: Jitter {
                std_rad: jitter_std_rad,
                model: JitterModel::Euler,
                axes: JitterAxes::RollPitch,
            },
            antennas: PerVehicle::default(),
            fading: Fading::default(),
            pointing: Pointing::default(),
            objective: Objective::Mean,
            free_yaw: false,
        }
    }

    /// The same with the nearest dipole in place of each measured pattern: quick to take the gain of. `None` where nothing is measured.
    #[must_use]
    pub(super) fn with_dipoles(&self) -> Option<Self> {
        let of = |pattern: &Pattern| match pattern {
            Pattern::Dipole { .. } => pattern.clone(),
            Pattern::Measured(measured) => {
                let end = |angle: f64| measured.gain_and_slope(angle).0;
                Pattern::Dipole { floor: (end(0.0) * end(std::f64::consts::PI)).sqrt().min(1.0) }
            }
        };
        let antennas = PerVehicle { i: of(&self.antennas.i), j: of(&self.antennas.j) };
        (antennas != self.antennas).then(|| Self { antennas, ..self.clone() })
    }
}

/// A node that must not decode the user's traffic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eavesdropper {
    /// Estimated position in metres.
    pub position_enu_m: Vector3<f64>,
    /// How well it is known.
    pub uncertainty: Uncertainty,
}

/// Uncertainty of a position, horizontal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Uncertainty {
    /// Exactly known.
    None,
    /// Uniform in a horizontal disc of this radius in metres.
    Disc {
        /// Radius in metres, positive.
        radius_m: f64,
    },
    /// Gaussian with this standard deviation per horizontal axis in metres.
    Gaussian {
        /// Standard deviation in metres, positive.
        std_m: f64,
    },
}

impl Uncertainty {
    /// Whether anything is uncertain.
    #[must_use]
    pub fn is_present(&self) -> bool {
        *self != Self::None
    }
}

/// What stays wrong with a vehicle's pose during a slot, drawn anew for each vehicle and slot. All independent, normal and
/// without a mean; standard deviations, the same for both vehicles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pointing {
    /// Of the heading, in radians: it turns the antenna's axis about the world's vertical.
    pub heading_std_rad: f64,
    /// Of the antenna's mounting, in radians about each of body x and y: the axis is `R(eta) exp([delta]) e_z`.
    pub mounting_std_rad: f64,
    /// Of the position in metres: per horizontal axis, and vertically.
    pub position_std_m: [f64; 2],
}

impl Pointing {
    /// Whether anything stays wrong.
    #[must_use]
    pub fn is_present(&self) -> bool {
        *self != Self::default()
    }
}

/// Link budget.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radio {
    /// B of (1.6) in Hz.
    pub bandwidth_hz: f64,
    /// The noise variance in W (MODEL: the paper's sigma is the variance). May be 0 only where refused clearly.
    pub noise_power_w: f64,
    /// Power ceiling of each transmitter in W: the smallest of all that applies.
    pub max_power_w: PerVehicle<f64>,
    /// b0 of (1.5): gain at one metre in the plane of maximum gain, linear.
    pub reference_gain: f64,
}

/// Which powers a transmitter can give beside none, up to its ceiling.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum PowerSteps {
    /// Any.
    #[default]
    Any,
    /// Any from this one in W on, positive.
    AtLeast(f64),
    /// These alone, in W, positive and rising.
    Levels(Vec<f64>),
}

/// Where vehicles may be.
#[derive(Debug, Clone, PartialEq)]
pub struct Airspace {
    /// Lowest and highest altitude above the mission origin, in metres.
    pub altitude_m: [f64; 2],
    /// Geofence: a simple polygon (not closed: the last vertex joins the first), either orientation, maybe concave.
    pub area_enu_m: Vec<Vector2<f64>>,
    /// Parts of it in which no vehicle may be.
    pub no_fly: Vec<NoFly>,
    /// Least distance between the vehicles in metres.
    pub min_separation_m: f64,
}

/// A part of the airspace in which no vehicle may be: an upright prism. Its faces are allowed, its inside is not.
#[derive(Debug, Clone, PartialEq)]
pub struct NoFly {
    /// What people call it.
    pub name: String,
    /// Corners of a simple polygon (not closed), either orientation, maybe concave.
    pub area_enu_m: Vec<Vector2<f64>>,
    /// From this altitude above the mission origin in metres; `None`: from the ground.
    pub floor_m: Option<f64>,
    /// Up to this one; `None`: to the sky.
    pub ceiling_m: Option<f64>,
}

impl NoFly {
    /// From which altitude to which, in metres.
    #[must_use]
    pub fn heights_m(&self) -> [f64; 2] {
        [self.floor_m.unwrap_or(f64::NEG_INFINITY), self.ceiling_m.unwrap_or(f64::INFINITY)]
    }

    /// How far a place lies inside, from the nearest face, in metres; 0 outside.
    #[must_use]
    pub fn depth_m(&self, at: &Vector3<f64>) -> f64 {
        let [floor, ceiling] = self.heights_m();
        let across = Polygon::new(&self.area_enu_m).ok().filter(|area| area.encloses(at.xy()));
        let across = across.map_or(0.0, |area| (at.xy() - area.nearest_on_boundary(at.xy())).norm());
        across.min(at.z - floor).min(ceiling - at.z).max(0.0)
    }
}

/// What a vehicle can do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleModel {
    /// Omnidirectional or level.
    pub airframe: Airframe,
    /// Largest angle between antenna axis (as a line) and the vertical, radians; the stricter of airspace and vehicle.
    pub max_tilt_rad: f64,
}

/// How a vehicle can be turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Airframe {
    /// Tilts without moving.
    Omnidirectional,
    /// Under-actuated: stays level while it hovers.
    Conventional,
}

/// Over what stays wrong during a slot (positions of nodes, poses of vehicles): what is maximised of the mean over what does
/// not (attitude jitter, scattering).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// The rate where nothing stays wrong.
    Nominal,
    /// The mean over it.
    Mean,
    /// The 5% quantile over it.
    Quantile,
    /// The worst case over the eavesdroppers' discs, in the mean over the rest.
    WorstCase,
}

/// How a slot is planned (MODEL section 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Ours: global.
    Veilwing,
    /// The paper's four phases, one start.
    Paper,
    /// Benchmark 1: interior point over all twelve variables, one start.
    InteriorPoint,
    /// Benchmark 1 from many starts.
    InteriorPointMultiStart,
    /// Benchmark 2: level vehicles, interior point over positions and powers, one start.
    Conventional,
    /// Benchmark 2 from many starts.
    ConventionalMultiStart,
    /// J's axis by phase 2, interior point over the rest.
    JammerOrientation,
}
