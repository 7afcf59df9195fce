//! The pair's motion over a horizon: ways, attitudes at knots, J's null on where the user is foreseen.

use nalgebra::Vector3;
use sha2::{Digest, Sha256};

use super::super::moving::null;
use super::super::plan::VehiclePlan;
use super::super::turning::{Held, Tolerance};
use super::{HORIZON_S, Path, Scene};
use crate::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity, Pose};
use crate::role::{PerVehicle, Role};

/// Time between the places at which the user is foreseen, in seconds.
const STEP_S: f64 = 0.25;
/// How many there are.
const PLACES: usize = (HORIZON_S / STEP_S) as usize + 1;

/// Where the user is foreseen while a motion lasts: evenly from place to place.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Foreseen {
    begins_s: f64,
    places_enu_m: Vec<Enu>,
}

impl Foreseen {
    pub fn new(scene: &Scene<'_>, begins_s: f64) -> Self {
        let place = |k: usize| scene.user_at(begins_s + STEP_S * k as f64);
        Self { begins_s, places_enu_m: (0..PLACES).map(place).collect() }
    }

    pub fn at(&self, t_s: f64) -> Enu {
        let steps = ((t_s - self.begins_s) / STEP_S).max(0.0);
        let before = (steps as usize).min(PLACES - 2);
        let share = (steps - before as f64).min(1.0);
        let [from, to] = [before, before + 1].map(|k| self.places_enu_m[k]);
        from + (to - from) * share
    }
}

/// Angles and power at a knot of a motion; between knots they change evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::planner) struct Knot {
    pub at_s: f64,
    /// I's roll and pitch.
    pub i: [f64; 2],
    /// J's roll and pitch beside those of its null on the user.
    pub j: [f64; 2],
    /// J's power in W.
    pub j_power_w: f64,
}

/// What J's angles are off at a motion's beginning, since the user is foreseen elsewhere than in the last one, and how fast that
/// is made good: evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Slip {
    pub angles: [f64; 2],
    pub lasts_s: f64,
}

/// The pair's motion from an instant on.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Each vehicle's way.
    pub ways: PerVehicle<Path>,
    /// Yaws in radians, the same all through.
    pub(super) yaws: PerVehicle<f64>,
    /// Largest tilts in radians; 0 of a level vehicle.
    pub(super) tilts_rad: PerVehicle<f64>,
    pub(super) i_power_w: f64,
    pub(in crate::planner) knots: Vec<Knot>,
    pub(super) user: Foreseen,
    pub(super) slip: Slip,
    /// From I to J, across the planes that both keep to the sides of.
    pub(super) apart: Vector3<f64>,
    /// How wrong poses may be at some instants, where that was looked at.
    pub(super) tolerances: Vec<(f64, Option<Tolerance>)>,
    /// The mean rate that is expected over the horizon, by its weights, bit/s/Hz.
    pub expected_bps_hz: f64,
}

/// The pair at an instant of its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Poses and powers.
    pub vehicles: PerVehicle<VehiclePlan>,
    /// Velocities in m/s, ENU.
    pub velocities_enu_m_s: PerVehicle<EnuVelocity>,
    /// Accelerations in m/s^2, ENU.
    pub accelerations_enu_m_s2: PerVehicle<EnuAcceleration>,
}

impl State {
    /// The attitudes.
    #[must_use]
    pub fn attitudes(&self) -> PerVehicle<Attitude> {
        PerVehicle::from_fn(|role| self.vehicles[role].pose.attitude())
    }
}

/// Roll and pitch as they can be held: within the tilt, and none of a level vehicle.
pub(super) fn held(given: [f64; 2], tilt_rad: f64) -> Held {
    if tilt_rad > 0.0 { Held::new(given, tilt_rad) } else { Held::new([0.0; 2], 0.0) }
}

impl Motion {
    /// When it begins, in seconds.
    #[must_use]
    pub fn begins_s(&self) -> f64 {
        self.ways.i.begins_s
    }

    /// When it rests, in seconds.
    #[must_use]
    pub fn ends_s(&self) -> f64 {
        self.ways.i.ends_s()
    }

    /// The first bytes of SHA-256 over every number that it is made of: what two companions compare.
    #[must_use]
    pub fn digest(&self) -> u64 {
        let mut hash = Sha256::new();
        let mut take = |number: f64| hash.update(number.to_bits().to_le_bytes());
        for role in Role::BOTH {
            self.ways[role].numbers().for_each(&mut take);
            take(self.yaws[role]);
            take(self.tilts_rad[role]);
        }
        take(self.i_power_w);
        for Knot { at_s, i, j, j_power_w } in &self.knots {
            [*at_s, i[0], i[1], j[0], j[1], *j_power_w].into_iter().for_each(&mut take);
        }
        self.user.places_enu_m.iter().flatten().copied().for_each(&mut take);
        [self.user.begins_s, self.slip.angles[0], self.slip.angles[1], self.slip.lasts_s]
            .into_iter()
            .for_each(&mut take);
        let digest: [u8; 32] = hash.finalize().into();
        digest[..8].iter().fold(0, |sum, byte| sum << 8 | u64::from(*byte))
    }

    /// Angles and power at an instant, as they are at knots.
    pub(in crate::planner) fn knot_at(&self, t_s: f64) -> Knot {
        let after = self.knots.partition_point(|knot| knot.at_s <= t_s).clamp(1, self.knots.len() - 1);
        let [from, to] = [self.knots[after - 1], self.knots[after]];
        let share = ((t_s - from.at_s) / (to.at_s - from.at_s)).clamp(0.0, 1.0);
        let mixed = |a: f64, b: f64| a + share * (b - a);
        let both = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|k: usize| mixed(a[k], b[k]));
        Knot {
            at_s: t_s,
            i: both(from.i, to.i),
            j: both(from.j, to.j),
            j_power_w: mixed(from.j_power_w, to.j_power_w),
        }
    }

    /// How wrong poses may be at an instant, by the stricter of those before and after at which it was looked at; `None` where it was
    /// not, or where nothing is carried.
    #[must_use]
    pub fn tolerance(&self, t_s: f64) -> Option<Tolerance> {
        let after = self.tolerances.partition_point(|(at_s, _)| *at_s <= t_s);
        let about = [after.checked_sub(1), Some(after)].into_iter().flatten();
        about.filter_map(|k| self.tolerances.get(k)?.1).reduce(|a, b| a.and(&b))
    }

    /// The pair at an instant. Before the motion begins and after it ends, where it begins and ends: it rests then, and J's null
    /// follows the user no further.
    #[must_use]
    pub fn at(&self, t_s: f64) -> State {
        let t_s = t_s.max(self.begins_s()).min(self.ends_s());
        let knot = self.knot_at(t_s);
        let now = PerVehicle::from_fn(|role: Role| self.ways[role].at(t_s));
        let (null, _) = null(&(now.j.position_enu_m - self.user.at(t_s)), self.yaws.j);
        let slips = (1.0 - (t_s - self.begins_s()) / self.slip.lasts_s).max(0.0);
        let j = [0, 1].map(|k: usize| null[k] + knot.j[k] + slips * self.slip.angles[k]);
        let vehicle = |role: Role, given, tx_power_w| {
            let [roll_rad, pitch_rad] = held(given, self.tilts_rad[role]).at;
            let position_enu_m = now[role].position_enu_m;
            let pose = Pose { position_enu_m, roll_rad, pitch_rad, yaw_rad: self.yaws[role] };
            VehiclePlan { pose, tx_power_w }
        };
        State {
            vehicles: PerVehicle {
                i: vehicle(Role::I, knot.i, self.i_power_w),
                j: vehicle(Role::J, j, knot.j_power_w),
            },
            velocities_enu_m_s: PerVehicle::from_fn(|role: Role| now[role].velocity_enu_m_s),
            accelerations_enu_m_s2: PerVehicle::from_fn(|role: Role| now[role].acceleration_enu_m_s2),
        }
    }
}
