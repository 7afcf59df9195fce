//! All slots of a mission: the plan that both companions must agree on.

use std::time::Duration;

use sha2::{Digest, Sha256};

use super::moving::{Limits, Moving, Spline};
use super::plan::{SlotPlan, VehiclePlan};
use super::track::{self, Track};
use super::turning::Protected;
use crate::role::{PerVehicle, Role};

/// One user's slot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedSlot {
    /// The user's name in the mission file.
    pub user: String,
    /// Poses, powers and what they are worth.
    pub plan: SlotPlan,
    /// The largest tilt from its pose that the slot bears of each vehicle, radians; `None` of one that has no reason to lean.
    pub lean_rad: PerVehicle<Option<f64>>,
    /// How long its slot is, where the plan gives each user a length of its own; `None`: as long as the mission says.
    pub length: Option<Duration>,
}

/// The plan of a mission: a slot for each user, in the mission file's order, each with the poses that were chosen for it.
/// In which order they are flown the slot table settles, which knows where the vehicles start (`schedule::table`).
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// SHA-256 over users, poses, powers, lengths that the plan has chosen, knots and ways, bit for bit: what the two companions compare.
    pub digest: [u8; 32],
    /// By user, in the mission file's order.
    pub slots: Vec<PlannedSlot>,
    /// The superframe as it is served where the vehicles turn on the air: each user's pose above is the one it is served in between
    /// two turns. `None`: they hold their poses.
    pub turns: Option<Protected>,
    /// Each vehicle's way round the superframe, where they move on the air: then knots lie on it, and each user's pose above is the
    /// one in the middle of its slot. `None`: they stay where their slots' poses are.
    pub ways: Option<PerVehicle<Spline>>,
}

impl Plan {
    /// The length of each user's slot, where the mission's is `usual`.
    #[must_use]
    pub fn lengths(&self, usual: Duration) -> Vec<Duration> {
        self.slots.iter().map(|slot| slot.length.unwrap_or(usual)).collect()
    }

    /// All powers in watts that a vehicle is to radiate, each with the user that it is for: of a user who is served through turns, one
    /// a knot.
    pub fn powers_w(&self, role: Role) -> impl Iterator<Item = (&str, f64)> {
        let name = move |user: usize| self.slots.get(user).map_or("", |slot| slot.user.as_str());
        let turned = self.turns.iter().flat_map(Protected::knots);
        let turned =
            turned.filter_map(move |knot| Some((name(knot.served?), knot.vehicles[role].tx_power_w)));
        let standing = self.slots.iter().filter(|_| self.turns.is_none());
        standing.map(move |slot| (slot.user.as_str(), slot.plan.vehicles[role].tx_power_w)).chain(turned)
    }

    /// How the vehicles turn, and move, in each slot of a superframe, in the order of service; none of a plan whose poses are held.
    /// As [`track::tracks`].
    #[must_use]
    pub fn tracks(&self, guard_s: f64, limits: &PerVehicle<Limits>) -> Vec<PerVehicle<Track>> {
        let turns = self.turns.as_ref();
        turns.map(|turns| track::tracks(turns, self.ways.as_ref(), guard_s, limits)).unwrap_or_default()
    }

    /// Seals the slots with their digest.
    #[must_use]
    pub fn new(slots: Vec<PlannedSlot>) -> Self {
        Self::sealed(slots, None, None)
    }

    /// Seals the slots and the turns between them with their digest.
    #[must_use]
    pub fn turning(slots: Vec<PlannedSlot>, turns: Protected) -> Self {
        Self::sealed(slots, Some(turns), None)
    }

    /// Seals the slots and the motion in which they are served with their digest.
    #[must_use]
    pub fn moving(slots: Vec<PlannedSlot>, moving: Moving) -> Self {
        Self::sealed(slots, Some(moving.protected), Some(moving.ways))
    }

    /// The motion in which the slots are served, to be sampled by whoever flies it.
    #[must_use]
    pub fn motion(&self) -> Option<Moving> {
        Some(Moving { protected: self.turns.clone()?, ways: self.ways.clone()? })
    }

    /// The plan by the users of a mission, made for one that lists them in this order instead: a permutation. One that is none gives
    /// `None`.
    #[must_use]
    pub fn relisted(self, order: &[usize]) -> Option<Self> {
        let listed = |user: usize| order.iter().position(|listed| *listed == user);
        let slots = (0..self.slots.len()).map(|user| self.slots.get(listed(user)?).cloned());
        let slots = slots.collect::<Option<Vec<_>>>().filter(|_| order.len() == self.slots.len())?;
        let mut turns = self.turns;
        for slot in turns.iter_mut().flat_map(|turns| &mut turns.slots) {
            slot.user = *order.get(slot.user)?;
            for served in slot.knots.iter_mut().filter_map(|knot| knot.served.as_mut()) {
                *served = *order.get(*served)?;
            }
        }
        Some(Self::sealed(slots, turns, self.ways))
    }

    fn sealed(slots: Vec<PlannedSlot>, turns: Option<Protected>, ways: Option<PerVehicle<Spline>>) -> Self {
        let mut hash = Sha256::new();
        for slot in &slots {
            // The length keeps one name's end apart from the next number's start.
            hash.update((slot.user.len() as u64).to_le_bytes());
            hash.update(slot.user.as_bytes());
            flown(&mut hash, &slot.plan.vehicles.i);
            flown(&mut hash, &slot.plan.vehicles.j);
            if let Some(length) = slot.length {
                hash.update(length.as_nanos().to_le_bytes());
            }
        }
        for knot in turns.iter().flat_map(Protected::knots) {
            hash.update(knot.at_s.to_le_bytes());
            hash.update(knot.served.map_or(u64::MAX, |user| user as u64).to_le_bytes());
            flown(&mut hash, &knot.vehicles.i);
            flown(&mut hash, &knot.vehicles.j);
        }
        for way in ways.iter().flat_map(|ways| [&ways.i, &ways.j]) {
            hash.update(way.period_s.to_le_bytes());
            for value in way.control_enu_m.iter().flatten() {
                hash.update(value.to_le_bytes());
            }
        }
        Self { digest: hash.finalize().into(), slots, turns, ways }
    }
}

/// Takes in a vehicle's pose and power.
fn flown(hash: &mut Sha256, vehicle: &VehiclePlan) {
    let pose = &vehicle.pose;
    let angles = [pose.roll_rad, pose.pitch_rad, pose.yaw_rad, vehicle.tx_power_w];
    for value in pose.position_enu_m.iter().chain(&angles) {
        hash.update(value.to_le_bytes());
    }
}

/// A digest as lowercase hexadecimal.
#[must_use]
pub fn hex(digest: &[u8]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
pub(crate) mod testing {
    use super::*;
    use crate::geo::Pose;
    use crate::planner::plan::{BoundKind, Status};

    /// With these poses, half a watt each.
    pub fn slot(user: &str, poses: &PerVehicle<Pose>) -> PlannedSlot {
        let plan = SlotPlan {
            status: Status::Converged,
            vehicles: poses.map(|pose| VehiclePlan { pose, tx_power_w: 0.5 }),
            secrecy_rate_bps: 1.0,
            standard_error_bps: 0.0,
            objective_bps: 1.0,
            upper_bound_bps: 2.0,
            upper_bound_kind: BoundKind::Cap,
            user_sinr: 1.0,
            eavesdropper_sinr: vec![],
        };
        PlannedSlot { user: user.into(), plan, lean_rad: PerVehicle { i: None, j: None }, length: None }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::geo::Pose;

    fn slot(user: &str, x: f64) -> PlannedSlot {
        let pose =
            Pose { position_enu_m: Vector3::new(x, 0.0, 80.0), roll_rad: 0.1, pitch_rad: 0.2, yaw_rad: 0.0 };
        testing::slot(user, &PerVehicle { i: pose, j: pose })
    }

    #[test]
    fn spec_a_plan_by_another_list_is_the_plan_by_the_mission_s() {
        let listed = Plan::new(["a", "b", "c"].map(|user| slot(user, 1.0)).into());
        let order = [2, 0, 1];
        let other = Plan::new(order.map(|user| listed.slots[user].clone()).into());
        assert_ne!(other.digest, listed.digest);
        assert_eq!(other.clone().relisted(&order), Some(listed));
        for none in [&[2, 0][..], &[0, 0, 1], &[0, 1, 3], &[0, 1, 2, 3]] {
            assert_eq!(other.clone().relisted(none), None, "{none:?}");
        }
    }

    #[test]
    fn spec_digest_tells_every_bit_of_what_is_flown_and_nothing_else() {
        let base = Plan::new(vec![slot("a", 1.0), slot("b", 2.0)]);
        let same = Plan::new(vec![slot("a", 1.0), slot("b", 2.0)]);
        assert_eq!(base.digest, same.digest);
        let mut dearer = vec![slot("a", 1.0), slot("b", 2.0)];
        dearer[0].plan.secrecy_rate_bps = 9.0;
        assert_eq!(base.digest, Plan::new(dearer).digest);
        let longer = PlannedSlot { length: Some(Duration::from_secs(9)), ..slot("a", 1.0) };
        for other in [
            vec![longer, slot("b", 2.0)],
            vec![slot("a", 1.0_f64.next_up()), slot("b", 2.0)],
            vec![slot("b", 2.0), slot("a", 1.0)],
            vec![slot("a", 1.0)],
            vec![slot("c", 1.0), slot("b", 2.0)],
        ] {
            assert_ne!(base.digest, Plan::new(other).digest);
        }
    }

    #[test]
    fn val_hex() {
        assert_eq!(hex(&[0x00, 0xab, 0x10]), "00ab10");
    }
}
