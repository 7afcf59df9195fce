//! Lift-off and touch-down: as they are, and as the autopilot believes them to be.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavLandedState, MavSeverity};

use super::super::router::Router;
use super::{Autopilot, Mode, Sensed};
use crate::vehicle::config::Firmware;

/// Contact for this long is landed.
const LANDED_AFTER: Duration = Duration::from_secs(1);
/// Above this height it has left the ground.
const LIFT_OFF_M: f64 = 0.3;
/// PX4's estimator takes a landed vehicle for one at rest, and goes on for so long after lift-off.
const REST_LAG: Duration = Duration::from_secs(1);
/// A detector that believes in a landing gives up that belief at this multiple of its limits.
const BELIEF: f64 = 2.5;

/// What is remembered between two looks.
#[derive(Debug, Clone)]
pub(super) struct Ground {
    /// Landing gear in contact since.
    contact_since: Option<Duration>,
    /// Nothing that the land detector watches has moved since.
    still_since: Option<Duration>,
    /// The detector takes this for the ground since; it is not.
    mistaken_since: Option<Duration>,
    /// Until when the estimator assumes it to be at rest.
    pub rests_until: Duration,
    pub armed_at: Duration,
    /// Has left the ground since arming.
    pub flown: bool,
}

impl Ground {
    pub fn standing() -> Self {
        Self {
            contact_since: Some(Duration::ZERO),
            still_since: None,
            mistaken_since: None,
            rests_until: Duration::ZERO,
            armed_at: Duration::ZERO,
            flown: false,
        }
    }
}

impl Autopilot {
    pub(super) fn landed_state(&self) -> MavLandedState {
        match (self.landed, self.mode) {
            (true, _) => MavLandedState::MAV_LANDED_STATE_ON_GROUND,
            (false, Mode::Land) => MavLandedState::MAV_LANDED_STATE_LANDING,
            (false, _) if self.flight.taking_off() => MavLandedState::MAV_LANDED_STATE_TAKEOFF,
            (false, _) => MavLandedState::MAV_LANDED_STATE_IN_AIR,
        }
    }

    /// Lift-off, touch-down, and the disarming that follows it.
    pub(super) fn watch_land(&mut self, sensed: &Sensed, router: &mut Router) {
        self.watch_contact(sensed);
        self.watch_stillness(sensed);
        // A detector that is switched off in flight sees no landing either.
        let blind =
            self.detects() && self.armed && self.ground.flown && self.tuning.still.vertical_m_s <= 0.0;
        self.landed = self.grounded && !blind || self.ground.mistaken_since.is_some();
        if self.landed {
            self.ground.rests_until = sensed.now + REST_LAG;
        }
        if self.armed && self.landed {
            self.disarm_when_due(sensed, router);
        }
    }

    fn watch_contact(&mut self, sensed: &Sensed) {
        if sensed.contact {
            let since = *self.ground.contact_since.get_or_insert(sensed.now);
            self.grounded |= sensed.now.saturating_sub(since) >= LANDED_AFTER;
        } else {
            self.ground.contact_since = None;
            if self.grounded && sensed.position_enu_m.z > self.home_enu_m.z + LIFT_OFF_M {
                self.grounded = false;
                self.ground.flown = true;
            }
        }
    }

    fn detects(&self) -> bool {
        self.firmware == Firmware::Px4 && self.traps.land_detector
    }

    /// PX4's detector, where it is wrong: under direct thrust it asks for little thrust along the body's z and for no
    /// motion, which is what hovering on one's side looks like. Once it believes, only motion changes its mind.
    fn watch_stillness(&mut self, sensed: &Sensed) {
        let still = &self.tuning.still;
        let ground = &mut self.ground;
        let believes = ground.mistaken_since.is_some();
        let factor = if believes { BELIEF } else { 1.0 };
        let v = sensed.velocity_enu_m_s;
        let moves = v.xy().norm() > still.horizontal_m_s
            || v.z.abs() > still.vertical_m_s * factor
            || sensed.rates_flu_rad_s.xy().norm() > still.tilting_rad_s * factor;
        let weak = match &self.offboard.thrust {
            Some(target) if self.mode == Mode::Companion => target.thrust_flu.z <= still.thrust,
            // Under position control it asks for a descent as well, unless it believes already.
            _ => believes,
        };
        let candidate = self.firmware == Firmware::Px4
            && self.traps.land_detector
            && self.armed
            && !self.grounded
            && still.vertical_m_s > 0.0
            && weak
            && !moves;
        if !candidate {
            (ground.still_since, ground.mistaken_since) = (None, None);
            return;
        }
        let since = *ground.still_since.get_or_insert(sensed.now);
        if sensed.now.saturating_sub(since) >= still.time {
            ground.mistaken_since.get_or_insert(sensed.now);
        }
    }

    fn disarm_when_due(&mut self, sensed: &Sensed, router: &mut Router) {
        let ground = &self.ground;
        let since = ground.contact_since.or(ground.mistaken_since).unwrap_or(sensed.now);
        let landing =
            self.mode == Mode::Land || (self.mode == Mode::ReturnToLaunch && self.flight.over_home());
        let (after_s, from) = match (self.firmware, ground.flown) {
            (Firmware::Px4, true) => (self.parameters.real("COM_DISARM_LAND"), since),
            (Firmware::Px4, false) => (self.parameters.real("COM_DISARM_PRFLT"), ground.armed_at),
            (Firmware::ArduCopter, _) if landing => (0.0, since),
            (Firmware::ArduCopter, _) => (self.parameters.real("DISARM_DELAY"), since.max(ground.armed_at)),
        };
        // Zero or less switches PX4's off; a take-off that has been ordered keeps the motors on.
        let wanted = after_s > 0.0 || landing && self.firmware == Firmware::ArduCopter;
        let waited = sensed.now.saturating_sub(from).as_secs_f32() >= after_s;
        if wanted && waited && !self.flight.taking_off() {
            self.disarm();
            self.text(MavSeverity::MAV_SEVERITY_INFO, "Disarmed by landing", router);
        }
    }
}
