//! PX4's land detector disarms a tilted vehicle in mid-air: low body-z thrust without motion looks like the ground.
//! With its speed limit at zero it never sees a landing; so that is what it is while the vehicle flies tilted, and
//! the limit is put back before a landing and after every abort, once the vehicle is level again.

use super::LAND_DETECTOR_SPEED;
use crate::autopilot::event::Event;
use crate::autopilot::parameter::{Knowledge, Parameters};
use crate::autopilot::settings::{Actuation, Settings};

/// The firmware's default of [`LAND_DETECTOR_SPEED`], in m/s.
const DEFAULT_SPEED_M_S: f64 = 0.25;
/// Plans that tilt less than this keep enough body-z thrust, in radians.
const NEEDED_ABOVE_RAD: f64 = 0.35;
/// At this tilt or less the detector is right again, in radians.
pub(in crate::autopilot::firmware) const LEVEL_BELOW_RAD: f64 = 0.26;

/// The guard of the land detector. The autopilot keeps the parameter on its disk, so a companion that dies in the air leaves
/// it at zero: every companion puts that right, also of a vehicle that it does not tilt itself.
#[derive(Debug, Clone)]
pub(in crate::autopilot) struct LandDetectorGuard {
    /// Whether this flight needs it.
    tilts: bool,
    /// What the parameter is put back to.
    restore: f64,
    /// Whether the zero is ours.
    ours: bool,
    /// Whether a zero that was not ours is being put right.
    repairing: bool,
}

impl LandDetectorGuard {
    pub(in crate::autopilot::firmware) fn new(settings: &Settings) -> Self {
        let tilts = settings.actuation != Actuation::Position && settings.planned_tilt_rad > NEEDED_ABOVE_RAD;
        Self { tilts, restore: DEFAULT_SPEED_M_S, ours: false, repairing: false }
    }

    /// The actuation is known: whether this flight needs the guard.
    pub(in crate::autopilot::firmware) fn choose(&mut self, settings: &Settings) {
        self.tilts = Self::new(settings).tilts;
    }

    /// Brings the parameter to where it should be: zero in tilted flight, its old value once `safe_to_restore`. Says that a
    /// zero which another had left is put right, once it is.
    pub(in crate::autopilot::firmware) fn advance(
        &mut self,
        in_flight: bool,
        safe_to_restore: bool,
        parameters: &mut Parameters,
    ) -> Option<Event> {
        let Knowledge::Known(value) = parameters.get(LAND_DETECTOR_SPEED) else { return None };
        let value = value.as_f64();
        if in_flight && self.tilts {
            if value > 0.0 {
                self.restore = value;
                parameters.write(LAND_DETECTOR_SPEED, 0.0);
            }
            (self.ours, self.repairing) = (true, false);
        } else if safe_to_restore && Self::is_off(parameters) {
            self.repairing |= !self.ours;
            parameters.write(LAND_DETECTOR_SPEED, self.restore);
        } else if !Self::is_off(parameters) {
            self.ours = false;
            if std::mem::take(&mut self.repairing) {
                return Some(Event::PutRight { parameter: LAND_DETECTOR_SPEED, was: 0.0, is: value });
            }
        }
        None
    }

    /// Whether tilting is safe: the detector is off, or the autopilot has no such parameter.
    pub(in crate::autopilot::firmware) fn allows_tilt(&self, parameters: &Parameters) -> bool {
        match parameters.get(LAND_DETECTOR_SPEED) {
            _ if !self.tilts => true,
            Knowledge::Pending => false,
            Knowledge::Unknown => true,
            Knowledge::Known(value) => value.as_f64() == 0.0 && !parameters.is_writing(LAND_DETECTOR_SPEED),
        }
    }

    /// Whether it is this companion's flight that keeps the detector off.
    pub(in crate::autopilot::firmware) fn is_ours(&self) -> bool {
        self.ours
    }

    /// Whether the detector is off, or not known to be on again.
    pub(in crate::autopilot::firmware) fn is_off(parameters: &Parameters) -> bool {
        match parameters.get(LAND_DETECTOR_SPEED) {
            Knowledge::Known(value) => value.as_f64() == 0.0 || parameters.is_writing(LAND_DETECTOR_SPEED),
            Knowledge::Pending | Knowledge::Unknown => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::outbox::Outbox;
    use crate::autopilot::param_value::IntegerForm;
    use crate::time::Instant;
    use mavlink::dialects::ardupilotmega::{MavMessage, MavParamType, PARAM_VALUE_DATA};

    /// A guard and the parameters as an autopilot has told them.
    struct Bench {
        guard: LandDetectorGuard,
        parameters: Parameters,
    }

    impl Bench {
        fn new(limit_m_s: f32) -> Self {
            let mut settings = crate::autopilot::context::tests::settings();
            settings.planned_tilt_rad = 1.0;
            let guard = LandDetectorGuard::new(&settings);
            let mut bench = Self { guard, parameters: Parameters::default() };
            bench.parameters.read(&[LAND_DETECTOR_SPEED]);
            assert!(!bench.guard.allows_tilt(&bench.parameters), "not read yet");
            bench.hear(limit_m_s);
            bench
        }

        fn hear(&mut self, limit_m_s: f32) {
            let value = PARAM_VALUE_DATA {
                param_value: limit_m_s,
                param_count: 1,
                param_index: 0,
                param_id: LAND_DETECTOR_SPEED.into(),
                param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
            };
            self.parameters.handle_value(&value, IntegerForm::Bytes);
        }

        /// What is written to the autopilot.
        fn written(&mut self) -> Option<f32> {
            let mut out = Outbox::default();
            self.parameters.advance(Instant::ZERO, IntegerForm::Bytes, (1, 1), &mut out);
            std::iter::from_fn(|| out.next_message()).find_map(|message| match message {
                MavMessage::PARAM_SET(set) => Some(set.param_value),
                _ => None,
            })
        }
    }

    #[test]
    fn spec_the_detector_is_off_before_a_tilt_and_put_back_once_it_is_safe() {
        let mut bench = Bench::new(0.4);
        assert!(!bench.guard.allows_tilt(&bench.parameters));
        bench.guard.advance(true, false, &mut bench.parameters);
        assert_eq!(bench.written(), Some(0.0));
        assert!(!bench.guard.allows_tilt(&bench.parameters), "not confirmed");
        bench.hear(0.0);
        assert!(bench.guard.allows_tilt(&bench.parameters));
        // Control is gone, and the vehicle lies on its side.
        bench.guard.advance(false, false, &mut bench.parameters);
        assert_eq!(bench.written(), None);
        bench.guard.advance(false, true, &mut bench.parameters);
        assert_eq!(bench.written(), Some(0.4));
    }

    #[test]
    fn spec_a_detector_found_off_is_put_right_and_that_is_told_once() {
        for actuation in [Actuation::Pose, Actuation::Position] {
            let mut bench = Bench::new(0.0);
            let settings = Settings { actuation, ..crate::autopilot::context::tests::settings() };
            bench.guard = LandDetectorGuard::new(&settings);
            assert!(LandDetectorGuard::is_off(&bench.parameters));
            assert_eq!(bench.guard.advance(false, false, &mut bench.parameters), None, "not safe yet");
            assert_eq!(bench.written(), None);
            assert_eq!(bench.guard.advance(false, true, &mut bench.parameters), None, "not yet confirmed");
            assert_eq!(bench.written(), Some(0.25));
            bench.hear(0.25);
            let told = Event::PutRight { parameter: LAND_DETECTOR_SPEED, was: 0.0, is: 0.25 };
            assert_eq!(bench.guard.advance(false, true, &mut bench.parameters), Some(told));
            assert_eq!(bench.guard.advance(false, true, &mut bench.parameters), None);
        }
    }

    #[test]
    fn spec_what_was_switched_off_here_comes_back_without_a_word() {
        let mut bench = Bench::new(0.4);
        bench.guard.advance(true, false, &mut bench.parameters);
        bench.hear(0.0);
        bench.guard.advance(false, true, &mut bench.parameters);
        assert!(LandDetectorGuard::is_off(&bench.parameters), "not confirmed");
        bench.hear(0.4);
        assert!(!LandDetectorGuard::is_off(&bench.parameters));
        assert_eq!(bench.guard.advance(false, true, &mut bench.parameters), None);
    }

    #[test]
    fn spec_level_plans_need_no_guard() {
        let mut settings = crate::autopilot::context::tests::settings();
        for (actuation, tilt_rad, needed) in [
            (Actuation::Pose, 0.3, false),
            (Actuation::Pose, 0.4, true),
            (Actuation::ThrustVector, 0.4, true),
            (Actuation::Position, 1.5, false),
        ] {
            (settings.actuation, settings.planned_tilt_rad) = (actuation, tilt_rad);
            let mut bench = Bench::new(0.25);
            bench.guard = LandDetectorGuard::new(&settings);
            bench.guard.advance(true, false, &mut bench.parameters);
            assert_eq!(bench.written().is_some(), needed, "{actuation} {tilt_rad}");
        }
    }
}
