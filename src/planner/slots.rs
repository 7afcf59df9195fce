//! All slots of a mission: the plan that both companions must agree on.

use std::time::Duration;

use sha2::{Digest, Sha256};

use super::plan::SlotPlan;
use crate::role::PerVehicle;

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
    /// SHA-256 over users, poses, powers and lengths that the plan has chosen, bit for bit: what the two companions compare.
    pub digest: [u8; 32],
    /// By user, in the mission file's order.
    pub slots: Vec<PlannedSlot>,
}

impl Plan {
    /// The length of each user's slot, where the mission's is `usual`.
    #[must_use]
    pub fn lengths(&self, usual: Duration) -> Vec<Duration> {
        self.slots.iter().map(|slot| slot.length.unwrap_or(usual)).collect()
    }

    /// Seals the slots with their digest.
    #[must_use]
    pub fn new(slots: Vec<PlannedSlot>) -> Self {
        let mut hash = Sha256::new();
        for slot in &slots {
            // The length keeps one name's end apart from the next number's start.
            hash.update((slot.user.len() as u64).to_le_bytes());
            hash.update(slot.user.as_bytes());
            for vehicle in [&slot.plan.vehicles.i, &slot.plan.vehicles.j] {
                let pose = &vehicle.pose;
                let angles = [pose.roll_rad, pose.pitch_rad, pose.yaw_rad, vehicle.tx_power_w];
                for value in pose.position_enu_m.iter().chain(&angles) {
                    hash.update(value.to_le_bytes());
                }
            }
            if let Some(length) = slot.length {
                hash.update(length.as_nanos().to_le_bytes());
            }
        }
        Self { digest: hash.finalize().into(), slots }
    }
}

/// A digest as lowercase hexadecimal.
#[must_use]
pub fn hex(digest: &[u8]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::geo::Pose;
    use crate::planner::plan::{BoundKind, Status, VehiclePlan};

    fn slot(user: &str, x: f64) -> PlannedSlot {
        let pose =
            Pose { position_enu_m: Vector3::new(x, 0.0, 80.0), roll_rad: 0.1, pitch_rad: 0.2, yaw_rad: 0.0 };
        let vehicle = VehiclePlan { pose, tx_power_w: 0.5 };
        let plan = SlotPlan {
            status: Status::Converged,
            vehicles: PerVehicle { i: vehicle, j: vehicle },
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
