//! Taking, keeping and giving up control. Success is what a heartbeat shows, never what an acknowledgement says.

use std::time::Duration;

use super::adapter::Autopilot;
use super::command::Purpose;
use super::firmware::{Firmware, Mode};
use super::goal::{Aim, Goal, refused};
use super::settings::{Actuation, Event};
use super::state::Landed;
use crate::geo::Enu;
use crate::time::Instant;

/// In flight, a mode is taken soon or not at all.
const IN_FLIGHT_TIMEOUT: Duration = Duration::from_secs(6);
const TAKEOFF_GRACE: Duration = Duration::from_secs(20);
/// Slowest climb that a take-off is given time for, m/s.
const SLOWEST_CLIMB_M_S: f64 = 0.5;
/// A vehicle this much higher than it stood, or rising this fast, has left the ground.
const LEFT_GROUND_M: f64 = 0.1;
const LEFT_GROUND_M_S: f64 = 0.2;
const ALTITUDE_TOLERANCE_M: f64 = 0.5;

/// Who flies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// Not the companion.
    Released,
    /// The companion has asked for its mode, from this one.
    Taking { from: Option<Mode> },
    /// The companion.
    Held,
    /// The companion has asked for one of the autopilot's own modes.
    HandingOver { to: Mode, acknowledged: bool },
    /// The autopilot, in the mode that the companion asked for.
    HandedOver { mode: Mode },
}

/// A take-off under way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Climb {
    from: Enu,
    pub(super) altitude_m: f64,
    /// Altitude above the mission origin to be reached.
    top_m: f64,
    /// Still on the ground, where it is ours to find the thrust that lifts.
    pub(super) lifting: bool,
}

impl Climb {
    /// Whether this position and vertical speed show that the vehicle has left the ground.
    pub(super) fn has_left(&self, position_enu_m: Enu, up_m_s: f64) -> bool {
        position_enu_m.z > self.from.z + LEFT_GROUND_M || up_m_s > LEFT_GROUND_M_S
    }
}

/// What control remembers.
#[derive(Debug)]
pub(super) struct Control {
    pub(super) phase: Phase,
    pub(super) goals: Vec<Goal>,
    pub(super) climb: Option<Climb>,
}

impl Control {
    pub(super) fn new() -> Self {
        Self { phase: Phase::Released, goals: Vec::new(), climb: None }
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        self.goals.iter().filter_map(Goal::timeout).min()
    }
}

impl Autopilot {
    /// Control is gone: nothing streams, nothing is asked for any more.
    pub(super) fn drop_control(&mut self) {
        self.control = Control::new();
        self.stream.stop();
        self.forget_offsets();
        for purpose in [Purpose::Mode, Purpose::Arming, Purpose::TakeOff] {
            self.commands.cancel(purpose);
        }
    }

    /// Takes the companion's mode.
    pub(super) fn start_taking(&mut self, now: Instant) {
        if let Some((firmware, _)) = self.peer
            && let Some(why) = firmware.cannot(self.settings.actuation)
        {
            self.out.tell(refused(Aim::Mode(Mode::Companion), firmware, None, Some(why.into())));
            return;
        }
        let patience =
            if self.telemetry.state.is_armed() { IN_FLIGHT_TIMEOUT } else { self.settings.readiness_timeout };
        self.control.phase = Phase::Taking { from: self.telemetry.state.mode() };
        self.pursue(Aim::Mode(Mode::Companion), patience, now);
        if self.control.goals.is_empty() {
            self.control.phase = Phase::Released;
        }
    }

    /// Asks for one of the autopilot's own modes.
    pub(super) fn start_handing_over(&mut self, to: Mode, now: Instant) {
        self.control.climb = None;
        self.give_up(Purpose::TakeOff);
        self.give_up(Purpose::Arming);
        self.level_offsets();
        self.control.phase = Phase::HandingOver { to, acknowledged: false };
        self.pursue(Aim::Mode(to), IN_FLIGHT_TIMEOUT, now);
        if self.control.goals.is_empty() {
            self.control.phase = Phase::Released;
        }
    }

    /// Starts a climb to this altitude above home.
    pub(super) fn start_climb(&mut self, altitude_m: f64, now: Instant) {
        let state = &self.telemetry.state;
        let firmware = self.peer.map_or(Firmware::Px4, |(firmware, _)| firmware);
        let why = if !(altitude_m.is_finite() && altitude_m > 0.0) {
            Some("the altitude must be above zero")
        } else if !self.in_control() {
            Some("not in control of an armed vehicle")
        } else {
            None
        };
        let (Some(position), None) = (state.position_enu_m, why) else {
            let why = why.unwrap_or("the position is not known");
            self.out.tell(refused(Aim::TakeOff, firmware, None, Some(why.into())));
            return;
        };
        let home_m = state.home_enu_m.map_or(position.value.z, |home| home.value.z);
        self.control.climb = Some(Climb {
            from: position.value,
            altitude_m,
            top_m: home_m + altitude_m,
            lifting: self.settings.actuation == Actuation::ThrustVector,
        });
        let patience = TAKEOFF_GRACE + Duration::from_secs_f64((altitude_m / SLOWEST_CLIMB_M_S).min(1e6));
        self.pursue(Aim::TakeOff, patience, now);
    }

    /// Whether a climb has reached its top.
    pub(super) fn check_climb(&mut self) {
        let (Some(climb), Some(position)) = (self.control.climb, self.telemetry.state.position_enu_m) else {
            return;
        };
        let on_ground = self.telemetry.state.landed.is_some_and(|landed| landed.value == Landed::OnGround);
        if position.value.z >= climb.top_m - ALTITUDE_TOLERANCE_M && !on_ground {
            self.control.climb = None;
            self.give_up(Purpose::TakeOff);
            self.flown = true;
            self.out.tell(Event::Airborne);
        }
    }

    /// What a heartbeat shows, at once and without debouncing (F2).
    pub(super) fn handle_mode(&mut self, mode: Mode, armed: bool, was_armed: bool, now: Instant) {
        let changed = self.previous_mode.replace(mode).is_some_and(|before| before != mode);
        if was_armed && !armed {
            self.flown = false;
            self.drop_control();
            self.out.tell(Event::Disarmed);
            return;
        }
        if armed && self.reached(Aim::Arm) {
            self.out.tell(Event::Armed);
        }
        match self.control.phase {
            Phase::Released => {}
            Phase::Taking { .. } if mode == Mode::Companion => {
                if self.asked(Aim::Mode(mode), now) && self.reached(Aim::Mode(mode)) {
                    self.control.phase = Phase::Held;
                    self.out.tell(Event::ControlTaken);
                }
            }
            // On the ground, modes come and go while an autopilot starts; in flight another mode is another hand.
            Phase::Taking { from } => {
                if armed && from.is_some_and(|from| from != mode) {
                    self.lose_control(mode);
                }
            }
            Phase::Held => {
                if mode != Mode::Companion {
                    self.lose_control(mode);
                }
            }
            Phase::HandingOver { to, .. } => {
                if mode == to {
                    self.reached(Aim::Mode(to));
                    self.stream.stop();
                    self.control.phase = Phase::HandedOver { mode };
                    self.out.tell(Event::HandedOver { mode: self.mode_name(mode) });
                } else if mode != Mode::Companion && changed {
                    self.lose_control(mode);
                }
            }
            Phase::HandedOver { mode: before } => {
                // Returning ends in landing or holding by the autopilot's own doing.
                let goes_on = before == Mode::Return && matches!(mode, Mode::Land | Mode::Hold);
                if mode != before && goes_on {
                    self.control.phase = Phase::HandedOver { mode };
                } else if mode != before && armed {
                    self.lose_control(mode);
                }
            }
        }
    }

    fn lose_control(&mut self, mode: Mode) {
        self.drop_control();
        self.out.tell(Event::ControlLost { mode: self.mode_name(mode).to_owned() });
    }

    fn mode_name(&self, mode: Mode) -> &'static str {
        self.peer.map_or("an unknown mode", |(firmware, _)| firmware.mode_name(mode))
    }

    /// An aim that was not reached.
    pub(super) fn abandon(&mut self, aim: Aim) {
        self.give_up(aim.purpose());
        match (aim, self.control.phase) {
            (Aim::Mode(Mode::Companion), _) => self.drop_control(),
            (Aim::Mode(_), Phase::HandingOver { .. }) => {
                let still_ours = self.telemetry.state.mode() == Some(Mode::Companion);
                self.control.phase = if still_ours { Phase::Held } else { Phase::Released };
            }
            (Aim::TakeOff, _) => self.control.climb = None,
            _ => {}
        }
    }
}
