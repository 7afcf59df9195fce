//! The altitude at which the autopilot's own return crosses: nobody has planned that way, and the other vehicle may be on it.
//! It is apart from the other's, and above the column in which that one takes off and lands. A vehicle that is higher when it
//! turns home stays as high in any case: different altitudes make a meeting unlikely, and exclude none.

use super::Firmware;
use crate::autopilot::alias::{Alias, Told};
use crate::autopilot::parameter::Parameters;
use crate::preflight::Verdict::{Fail, Pass, Warn};
use crate::preflight::{Check, check};

const PX4: Alias = Alias(&[("RTL_RETURN_ALT", 1.0)]);
const ARDUCOPTER: Alias = Alias(&[("RTL_ALT", 0.01), ("RTL_ALT_M", 1.0)]);

fn altitude(firmware: Firmware) -> Alias {
    match firmware {
        Firmware::Px4 => PX4,
        Firmware::ArduPilot => ARDUCOPTER,
    }
}

/// Both climb less the nearer they are to home, unless this is 0.
fn cone(firmware: Firmware) -> &'static str {
    match firmware {
        Firmware::Px4 => "RTL_CONE_ANG",
        Firmware::ArduPilot => "RTL_CONE_SLOPE",
    }
}

/// Asks for what the checks look at.
pub(in crate::autopilot::firmware) fn read(firmware: Firmware, parameters: &mut Parameters) {
    altitude(firmware).ask(parameters);
    parameters.read_also([cone(firmware).to_owned()]);
}

/// The altitude against the lowest and the highest that it may be, in metres above the mission's origin; `home_m` is home's.
pub(in crate::autopilot) fn checks(
    firmware: Firmware,
    parameters: &Parameters,
    home_m: Option<f64>,
    [lowest_m, highest_m]: [f64; 2],
) -> Vec<Check> {
    let (name, told) = altitude(firmware).told(parameters);
    // Without a home there is no way to it: that is a check of its own.
    let home_m = home_m.unwrap_or(0.0);
    let [lowest_m, highest_m] = [lowest_m - home_m, highest_m - home_m];
    let altitude = match told {
        Told::Pending => check(name, Fail, "not read yet"),
        Told::Unknown => check(name, Warn, "the autopilot does not answer: not known"),
        Told::Known(m) if (lowest_m..=highest_m).contains(&m) => {
            check(name, Pass, format!("{m} m above home"))
        }
        Told::Known(m) => {
            let detail = format!(
                "{m} m above home, should be {lowest_m:.0} to {highest_m:.0} m: apart from the other vehicle's return, and above \
                 where that one takes off and lands"
            );
            check(name, Warn, detail)
        }
    };
    let cone = parameters.check(cone(firmware), |value| match value {
        0.0 => (Pass, ""),
        _ => (Warn, "0: near its home it would return below that altitude"),
    });
    vec![altitude, cone]
}
