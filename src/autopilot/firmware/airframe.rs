//! [`Actuation::Auto`]: which of the others the airframe asks for, by the autopilot's parameters alone. What they leave
//! open is refused, never guessed: the plan was made for one of two kinds of vehicle, by both companions.

use super::choice::Choice;
use super::{Firmware, ardupilot, px4};
use crate::autopilot::parameter::Parameters;
use crate::autopilot::settings::{Actuation, Settings};
use crate::preflight::{Check, Verdict, check};

/// Plans that tilt no more than this are flown level, in radians.
const LEVEL_RAD: f64 = 0.087;

/// The choice, or why there is none; `None` while the parameters are being read.
pub(in crate::autopilot) fn choose(
    firmware: Firmware,
    parameters: &Parameters,
) -> Option<Result<Choice, String>> {
    match firmware {
        Firmware::Px4 => px4::airframe::choose(parameters),
        Firmware::ArduPilot => ardupilot::airframe::choose(parameters),
    }
}

/// What a choice means before a flight.
pub(in crate::autopilot) fn check_choice(
    firmware: Firmware,
    chosen: Option<&Choice>,
    parameters: &Parameters,
    settings: &Settings,
) -> Check {
    let name = "actuation";
    let tilt_deg = settings.planned_tilt_rad.to_degrees();
    match chosen {
        Some(Choice { actuation: Actuation::Position, why }) if settings.planned_tilt_rad > LEVEL_RAD => {
            let detail = format!(
                "auto: {why}, so it flies level, but the mission plans it tilted by up to {tilt_deg:.0} deg: give it \
                 airframe = \"conventional\" there, on both vehicles"
            );
            check(name, Verdict::Fail, detail)
        }
        Some(Choice { actuation, why }) => {
            check(name, Verdict::Pass, format!("{actuation} on {firmware}, chosen by {why}"))
        }
        None => {
            let open = choose(firmware, parameters).and_then(Result::err);
            let detail = match open {
                Some(why) => format!("auto cannot tell: {why}; give actuation in the vehicle file"),
                None => "auto: the airframe's parameters are not read yet".to_owned(),
            };
            check(name, Verdict::Fail, detail)
        }
    }
}
