//! PX4's simulated battery: half of its charge goes within half a minute of arming, and then nothing more.

use crate::autopilot::parameter::{Knowledge, Parameters};
use crate::preflight::Verdict::Pass;
use crate::preflight::{Check, check};

/// Where the simulated battery stops, percent. No board has it: there the battery is a real one.
pub(in crate::autopilot::firmware) const FLOOR: &str = "SIM_BAT_MIN_PCT";

/// The charge down to which it falls, of 1; `None` where the battery is a real one, as far as is known.
pub(in crate::autopilot::firmware) fn floor(parameters: &Parameters) -> Option<f64> {
    match parameters.get(FLOOR) {
        Knowledge::Known(percent) => Some(percent.as_f64() / 100.0),
        Knowledge::Pending | Knowledge::Unknown => None,
    }
}

/// What a simulated battery means for the flight; nothing is said of a real one.
pub(in crate::autopilot::firmware) fn checked(parameters: &Parameters) -> Option<Check> {
    let percent = floor(parameters)? * 100.0;
    let detail = format!(
        "{percent}: a simulated battery; how fast its charge falls down to there is taken for no forecast"
    );
    Some(check(FLOOR, Pass, detail))
}
