//! What PX4's parameters say of the airframe: CA_AIRFRAME, and how much thrust sideways the rotors make.

use super::rotors;
use crate::autopilot::firmware::choice::Choice;
use crate::autopilot::parameter::{Knowledge, Parameters};
use crate::autopilot::settings::Actuation;

pub(in crate::autopilot::firmware) const NAME: &str = "CA_AIRFRAME";

/// From this part of the thrust upwards on, what the rotors make sideways carries a vehicle that tilts.
const FULLY_ACTUATED: f64 = 0.1;
/// Up to this part it is what rotors are off the vertical by mistake.
const FLAT: f64 = 0.02;

/// See [`airframe::choose`](super::super::airframe::choose).
pub(in crate::autopilot::firmware) fn choose(parameters: &Parameters) -> Option<Result<Choice, String>> {
    let airframe = match parameters.get(NAME) {
        Knowledge::Pending => return None,
        Knowledge::Unknown => return Some(Err(format!("{NAME} is not known to the autopilot"))),
        Knowledge::Known(value) => value.as_f64(),
    };
    // Multirotor, motors of six degrees of freedom, custom: rotors that stay where they are on the body.
    if ![0.0, 7.0, 9.0].contains(&airframe) {
        return Some(Err(format!(
            "{NAME} is {airframe}, whose rotors turn on the body, or which is no multirotor"
        )));
    }
    let sideways = match rotors::sideways(parameters) {
        Some(sideways) => sideways,
        None if parameters.is_reading("CA_ROTOR") => return None,
        None => return Some(Err("CA_ROTOR* is not known to the autopilot".to_owned())),
    };
    let actuation = match sideways {
        s if s >= FULLY_ACTUATED => Actuation::ThrustVector,
        s if s <= FLAT => Actuation::Position,
        s => {
            return Some(Err(format!(
                "its rotors make {s:.2} of their thrust sideways, neither much nor nothing"
            )));
        }
    };
    let why =
        format!("{NAME} {airframe} and CA_ROTOR*: {sideways:.2} of the thrust upwards can be had sideways");
    Some(Ok(Choice { actuation, why }))
}
