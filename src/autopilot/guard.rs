//! PX4's land detector disarms a tilted vehicle in mid-air: low body-z thrust without motion looks like the ground.
//! With its speed limit at zero it never sees a landing; so that is what it is while the vehicle flies tilted, and
//! the limit is put back before a landing and after every abort, once the vehicle is level again.

use super::firmware::px4::{LAND_DETECTOR_SPEED, LAND_DETECTOR_SPEED_DEFAULT};
use super::parameter::{Knowledge, Parameters};

/// Plans that tilt less than this keep enough body-z thrust, in radians.
pub(super) const NEEDED_ABOVE_RAD: f64 = 0.35;
/// At this tilt or less the detector is right again, in radians.
pub(super) const LEVEL_BELOW_RAD: f64 = 0.26;

/// The guard of the land detector.
#[derive(Debug)]
pub(super) struct LandDetectorGuard {
    /// What the parameter is put back to.
    restore: f64,
}

impl Default for LandDetectorGuard {
    fn default() -> Self {
        Self { restore: LAND_DETECTOR_SPEED_DEFAULT }
    }
}

impl LandDetectorGuard {
    /// Brings the parameter to where it should be: zero in tilted flight, its old value once `safe_to_restore`.
    pub(super) fn advance(&mut self, in_flight: bool, safe_to_restore: bool, parameters: &mut Parameters) {
        let Knowledge::Known(value) = parameters.get(LAND_DETECTOR_SPEED) else { return };
        let value = value.as_f64();
        if in_flight {
            if value > 0.0 {
                self.restore = value;
                parameters.write(LAND_DETECTOR_SPEED, 0.0);
            }
        } else if safe_to_restore && (value == 0.0 || parameters.is_writing(LAND_DETECTOR_SPEED)) {
            parameters.write(LAND_DETECTOR_SPEED, self.restore);
        }
    }

    /// Whether tilting is safe: the detector is off, or the autopilot has no such parameter.
    pub(super) fn allows_tilt(parameters: &Parameters) -> bool {
        match parameters.get(LAND_DETECTOR_SPEED) {
            Knowledge::Pending => false,
            Knowledge::Unknown => true,
            Knowledge::Known(value) => value.as_f64() == 0.0 && !parameters.is_writing(LAND_DETECTOR_SPEED),
        }
    }
}
