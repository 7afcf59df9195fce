//! Slips planted on purpose in what the autopilot hears: what the second opinion exists to find. A flight test that
//! passes with one of them would pass with the same slip in a companion.

use mavlink::dialects::ardupilotmega::{MavMessage, SET_ATTITUDE_TARGET_DATA};
use nalgebra::{Quaternion, UnitQuaternion};

/// One slip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slip {
    /// A wrong sign: the roll of attitude targets.
    RollSign,
    /// A swapped frame: north and east of position targets.
    SwappedAxes,
    /// Radians for degrees: roll and pitch of attitude targets.
    RadiansForDegrees,
}

impl Slip {
    /// The message as somebody who slips would have sent it.
    pub(super) fn plant(self, mut message: MavMessage) -> MavMessage {
        match (&mut message, self) {
            (MavMessage::SET_ATTITUDE_TARGET(m), Self::RollSign) => turn(m, |roll, pitch| (-roll, pitch)),
            (MavMessage::SET_ATTITUDE_TARGET(m), Self::RadiansForDegrees) => {
                turn(m, |roll, pitch| (roll.to_radians(), pitch.to_radians()));
            }
            (MavMessage::SET_POSITION_TARGET_LOCAL_NED(m), Self::SwappedAxes) => {
                std::mem::swap(&mut m.x, &mut m.y);
                std::mem::swap(&mut m.vx, &mut m.vy);
            }
            _ => {}
        }
        message
    }
}

fn turn(m: &mut SET_ATTITUDE_TARGET_DATA, angles: impl Fn(f64, f64) -> (f64, f64)) {
    let [w, x, y, z] = m.q.map(f64::from);
    let (roll, pitch, yaw) = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)).euler_angles();
    let (roll, pitch) = angles(roll, pitch);
    let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    m.q = [q.w, q.i, q.j, q.k].map(|c| c as f32);
}
