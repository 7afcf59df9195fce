//! What is flown: attitudes and powers by knots, over a superframe that comes round again.

use super::tolerance::Tolerance;
use super::turn::{Course, between};
use super::ways::angles;
use crate::geo::{Attitude, Enu, Pose};
use crate::planner::plan::VehiclePlan;
use crate::role::PerVehicle;

/// In a silence both vehicles are turned so long before the next user is served, in seconds: they come to rest, the jammer comes on
/// with its null where it belongs, and I asks for its lease.
pub const READY_S: f64 = 0.2;

/// An instant at which something changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Knot {
    /// Seconds from the superframe's beginning.
    pub at_s: f64,
    /// Poses at this instant; powers from it to the next knot. Roll and pitch run evenly to the next knot's while a user is
    /// served; positions and yaw stay.
    pub vehicles: PerVehicle<VehiclePlan>,
    /// Who is served from here to the next knot; nobody: both are silent.
    pub served: Option<usize>,
    /// The rate from here to the next knot, bit/s.
    pub rate_bps: f64,
    /// How wrong poses may be here; of knots at which somebody is served at a positive rate, and where it was asked for.
    pub tolerance: Option<Tolerance>,
}

/// How the vehicles come from one slot to the next, in silence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Between {
    /// They turn where they are, each at one rate until they are to be ready ([`READY_S`]).
    Turn(PerVehicle<Course>),
    /// They fly to other positions, as the schedule has them fly.
    Transit,
}

/// One user's turn of service, and the silence after it.
#[derive(Debug, Clone, PartialEq)]
pub struct Slot {
    /// Whose.
    pub user: usize,
    /// How long it is served, in seconds.
    pub on_air_s: f64,
    /// How long both are silent afterwards, in seconds.
    pub silence_s: f64,
    /// What happens in that.
    pub between: Between,
    /// What the user gets, bit.
    pub volume_bits: f64,
    /// In order of time, the last one where the silence begins.
    pub knots: Vec<Knot>,
}

/// A superframe with its turns: a cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct Protected {
    /// In the order of service.
    pub slots: Vec<Slot>,
    /// From the beginning of the first slot's service to the same in the next superframe, in seconds.
    pub superframe_s: f64,
}

/// The pair at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Positions.
    pub positions_enu_m: PerVehicle<Enu>,
    /// Attitudes.
    pub attitudes: PerVehicle<Attitude>,
    /// Powers in W.
    pub tx_powers_w: PerVehicle<f64>,
    /// Who is served.
    pub served: Option<usize>,
}

impl Protected {
    /// What all users get in a superframe, bit.
    #[must_use]
    pub fn volume_bits(&self) -> f64 {
        self.slots.iter().map(|slot| slot.volume_bits).sum()
    }

    /// What the user gets that gets least, bit.
    #[must_use]
    pub fn least_user_volume_bits(&self) -> f64 {
        self.slots.iter().map(|slot| slot.volume_bits).reduce(f64::min).unwrap_or(0.0)
    }

    /// The share of the time in which somebody is served.
    #[must_use]
    pub fn share_on_air(&self) -> f64 {
        let served = |slot: &&Slot| slot.knots.iter().any(|knot| knot.served.is_some());
        let on_air_s: f64 = self.slots.iter().filter(served).map(|slot| slot.on_air_s).sum();
        if self.superframe_s > 0.0 { on_air_s / self.superframe_s } else { 0.0 }
    }

    /// All knots in order of time.
    pub fn knots(&self) -> impl Iterator<Item = &Knot> {
        self.slots.iter().flat_map(|slot| &slot.knots)
    }

    /// The pair at an instant of any superframe; `None` on the way to other positions, and of a plan without slots.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Option<State> {
        if !(self.superframe_s > 0.0) {
            return None;
        }
        let t_s = t_s - self.superframe_s * (t_s / self.superframe_s).floor();
        let later = |slot: &Slot| slot.knots.first().is_some_and(|knot| knot.at_s <= t_s);
        let index = self.slots.partition_point(later).checked_sub(1)?;
        let slot = &self.slots[index];
        let number = slot.knots.partition_point(|knot| knot.at_s <= t_s).checked_sub(1)?;
        let knot = &slot.knots[number];
        let poses = |knot: &Knot| knot.vehicles.map(|vehicle| vehicle.pose);
        let from = poses(knot);
        let attitudes = match (slot.knots.get(number + 1), slot.between) {
            (Some(next), _) => {
                let share = share(t_s - knot.at_s, next.at_s - knot.at_s);
                let to = poses(next);
                PerVehicle::from_fn(|role| {
                    let [roll, pitch, yaw] = between(&angles(&from[role]), &angles(&to[role]), share);
                    Attitude::from_euler(roll, pitch, yaw)
                })
            }
            (None, Between::Turn(courses)) => {
                let next = self.slots[(index + 1) % self.slots.len()].knots.first()?;
                let share = share(t_s - knot.at_s, slot.silence_s - READY_S);
                let to = poses(next);
                PerVehicle::from_fn(|role| courses[role].at(&angles(&from[role]), &angles(&to[role]), share))
            }
            (None, Between::Transit) => return None,
        };
        Some(State {
            positions_enu_m: from.map(|pose: Pose| pose.position_enu_m),
            attitudes,
            tx_powers_w: knot.vehicles.map(|vehicle| vehicle.tx_power_w),
            served: knot.served,
        })
    }
}

fn share(part_s: f64, whole_s: f64) -> f64 {
    if whole_s > 0.0 { (part_s / whole_s).clamp(0.0, 1.0) } else { 0.0 }
}
