//! What ArduCopter's parameters say of the airframe: FRAME_CLASS.

use crate::autopilot::firmware::choice::Choice;
use crate::autopilot::parameter::{Knowledge, Parameters};
use crate::autopilot::settings::Actuation;

const NAME: &str = "FRAME_CLASS";

/// See [`airframe::choose`](super::super::airframe::choose).
pub(in crate::autopilot::firmware) fn choose(parameters: &Parameters) -> Option<Result<Choice, String>> {
    let class = match parameters.get(NAME) {
        Knowledge::Pending => return None,
        Knowledge::Unknown => return Some(Err(format!("{NAME} is not known to the autopilot"))),
        Knowledge::Known(value) => value.as_f64() as i64,
    };
    let (actuation, kind) = match class {
        16 => (Actuation::Pose, "6DoF, by the bridge script"),
        1..=5 | 7 | 12 | 14 | 15 | 17 => (Actuation::Position, "a multirotor that leans to move"),
        _ => return Some(Err(format!("{NAME} is {class}, which is no multirotor's"))),
    };
    Some(Ok(Choice { actuation, why: format!("{NAME} {class} ({kind})") }))
}
