//! Taking, keeping and giving up control. Success is what a heartbeat shows, never what an acknowledgement says.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavModeFlag, MavResult};

use super::adapter::Autopilot;
use super::command::{Outcome, Purpose};
use super::firmware::{Firmware, Mode};
use super::settings::{Event, Setpoint};
use super::state::Landed;
use super::streams::long;
use crate::geo::{Attitude, Enu};
use crate::time::Instant;

/// How long setpoints stream before a firmware that wants to see them is asked for its mode.
const STREAM_FIRST: Duration = Duration::from_millis(1100);
/// Heartbeats come once a second: how long an acknowledged change may take to show.
const SHOWS_WITHIN: Duration = Duration::from_millis(2500);
const ASK_AGAIN: Duration = Duration::from_secs(2);
/// An autopilot's reason follows its refusal by a moment.
const REASON_WITHIN: Duration = Duration::from_millis(150);
/// In flight, a mode is taken soon or not at all.
const IN_FLIGHT_TIMEOUT: Duration = Duration::from_secs(6);
const TAKEOFF_GRACE: Duration = Duration::from_secs(20);
/// Slowest climb that a take-off is given time for, m/s.
const SLOWEST_CLIMB_M_S: f64 = 0.5;
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

/// Something to be reached, by asking until it shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Aim {
    Mode(Mode),
    Arm,
    Disarm,
    TakeOff,
}

#[derive(Debug)]
pub(super) struct Goal {
    aim: Aim,
    since: Instant,
    deadline: Instant,
    /// When to ask (again).
    ask_at: Option<Instant>,
    asked_at: Option<Instant>,
    /// The last answer.
    answer: Outcome,
    /// When to report a refusal.
    report_at: Option<Instant>,
}

/// A take-off under way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Climb {
    from: Enu,
    yaw_rad: f64,
    altitude_m: f64,
    /// Altitude above the mission origin to be reached.
    top_m: f64,
    since: Instant,
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
        self.goals.iter().flat_map(|goal| [Some(goal.deadline), goal.ask_at, goal.report_at]).flatten().min()
    }
}

impl Aim {
    fn purpose(self) -> Purpose {
        match self {
            Self::Mode(_) => Purpose::Mode,
            Self::Arm | Self::Disarm => Purpose::Arming,
            Self::TakeOff => Purpose::TakeOff,
        }
    }

    fn name(self, firmware: Firmware) -> &'static str {
        match self {
            Self::Mode(mode) => firmware.mode_name(mode),
            Self::Arm => "arming",
            Self::Disarm => "disarming",
            Self::TakeOff => "take-off",
        }
    }
}

impl Autopilot {
    /// Starts to pursue an aim; an earlier one of its kind is given up.
    pub(super) fn pursue(&mut self, aim: Aim, patience: Duration, now: Instant) {
        let Some((firmware, _)) = self.peer else {
            self.out.tell(refused(aim, Firmware::Px4, None, Some("no autopilot on the link".into())));
            return;
        };
        if self.link.is_lost() {
            self.out.tell(refused(aim, firmware, None, Some("the autopilot's link is lost".into())));
            return;
        }
        self.give_up(aim.purpose());
        self.control.goals.push(Goal {
            aim,
            since: now,
            deadline: now + patience,
            ask_at: Some(now),
            asked_at: None,
            answer: None,
            report_at: None,
        });
        self.advance_goals(now);
    }

    /// Stops to pursue aims of this kind and forgets the command that may still be unanswered.
    fn give_up(&mut self, purpose: Purpose) {
        self.control.goals.retain(|goal| goal.aim.purpose() != purpose);
        self.commands.cancel(purpose);
    }

    /// Control is gone: nothing streams, nothing is asked for any more.
    pub(super) fn drop_control(&mut self) {
        self.control = Control::new();
        self.stream.stop();
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
        let (Some(position), Some(attitude), None) = (state.position_enu_m, state.attitude, why) else {
            let why = why.unwrap_or("position and attitude are not known");
            self.out.tell(refused(Aim::TakeOff, firmware, None, Some(why.into())));
            return;
        };
        let home_m = state.home_enu_m.map_or(position.value.z, |home| home.value.z);
        self.control.climb = Some(Climb {
            from: position.value,
            yaw_rad: attitude.value.euler().2,
            altitude_m,
            top_m: home_m + altitude_m,
            since: now,
        });
        let patience = TAKEOFF_GRACE + Duration::from_secs_f64((altitude_m / SLOWEST_CLIMB_M_S).min(1e6));
        self.pursue(Aim::TakeOff, patience, now);
    }

    /// The setpoint of a climb that the companion itself flies, instead of the executive's.
    pub(super) fn climb_setpoint(&self, now: Instant) -> Option<Setpoint> {
        let climb = self.control.climb?;
        let speed_m_s = self.settings.takeoff_speed_m_s;
        let height_m = climb.from.z + speed_m_s * now.saturating_since(climb.since).as_secs_f64();
        let climbing = height_m < climb.top_m;
        let velocity_m_s = if climbing { speed_m_s } else { 0.0 };
        Some(Setpoint {
            position_enu_m: Enu::new(climb.from.x, climb.from.y, height_m.min(climb.top_m)),
            velocity_enu_m_s: Enu::new(0.0, 0.0, velocity_m_s),
            attitude: Attitude::from_euler(0.0, 0.0, climb.yaw_rad),
        })
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

    /// Whether this aim has been asked for yet: a mode seen before was not our doing.
    fn asked(&self, aim: Aim, now: Instant) -> bool {
        self.control.goals.iter().any(|goal| goal.aim == aim && goal.asked_at.is_some_and(|at| at < now))
    }

    /// Ends an aim that shows; `false` if it was not pursued.
    fn reached(&mut self, aim: Aim) -> bool {
        let pursued = self.control.goals.iter().any(|goal| goal.aim == aim);
        if pursued {
            self.give_up(aim.purpose());
        }
        pursued
    }

    /// Takes the end of a command that was sent for an aim.
    pub(super) fn answered(&mut self, purpose: Purpose, outcome: Outcome, now: Instant) {
        let Some(goal) = self.control.goals.iter_mut().find(|goal| goal.aim.purpose() == purpose) else {
            return;
        };
        goal.answer = outcome;
        match outcome {
            Some(MavResult::MAV_RESULT_ACCEPTED) => {
                // A take-off that is accepted is under way: asking again would start it anew.
                goal.ask_at = (goal.aim != Aim::TakeOff).then_some(now + SHOWS_WITHIN);
                if let Phase::HandingOver { acknowledged, .. } = &mut self.control.phase
                    && matches!(goal.aim, Aim::Mode(_))
                {
                    *acknowledged = true;
                }
            }
            Some(_) => {
                goal.ask_at = Some(now + ASK_AGAIN);
                goal.report_at = Some(now + REASON_WITHIN);
            }
            None => goal.ask_at = Some(now),
        }
    }

    /// Asks, reports refusals, gives up.
    pub(super) fn advance_goals(&mut self, now: Instant) {
        let Some((firmware, _)) = self.peer else { return };
        let mut index = 0;
        while let Some(goal) = self.control.goals.get_mut(index) {
            let aim = goal.aim;
            let text = goal
                .asked_at
                .and_then(|asked| self.last_text.as_ref().filter(|text| text.received_at >= asked));
            let statustext = text.map(|text| text.value.clone());
            let report = goal.report_at.is_some_and(|at| at <= now);
            let hopeless = report && goal.answer == Some(MavResult::MAV_RESULT_UNSUPPORTED);
            if hopeless || goal.deadline <= now {
                let event = refused(aim, firmware, goal.answer, statustext.or_else(|| self.why_not(aim)));
                self.abandon(aim);
                self.out.tell(event);
                continue;
            }
            if let (true, Some(result)) = (report, goal.answer) {
                goal.report_at = None;
                let waited = now.saturating_since(goal.since);
                self.out.tell(Event::NotReady { what: aim.name(firmware), result, statustext, waited });
            }
            if goal.ask_at.is_some_and(|at| at <= now) {
                self.ask(index, firmware, now);
            }
            index += 1;
        }
    }

    fn ask(&mut self, index: usize, firmware: Firmware, now: Instant) {
        let altitude_m = self.control.climb.map_or(0.0, |climb| climb.altitude_m);
        let streamed = self.stream.streamed_for(now) >= STREAM_FIRST;
        let Some(goal) = self.control.goals.get_mut(index) else { return };
        if goal.aim == Aim::Mode(Mode::Companion) && firmware.wants_stream_first() && !streamed {
            // Every tick of the stream comes back here.
            goal.ask_at = Some(now + Duration::from_millis(100));
            return;
        }
        goal.ask_at = None;
        goal.asked_at.get_or_insert(now);
        if let Some(command) = command(goal.aim, firmware, altitude_m) {
            self.commands.push(command, goal.aim.purpose());
        }
    }

    /// An aim that was not reached.
    fn abandon(&mut self, aim: Aim) {
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

    fn why_not(&self, aim: Aim) -> Option<String> {
        let never_asked = self.control.goals.iter().any(|goal| goal.aim == aim && goal.asked_at.is_none());
        (never_asked && aim == Aim::Mode(Mode::Companion))
            .then(|| "no setpoints could be streamed: is the position known?".to_owned())
    }
}

fn refused(aim: Aim, firmware: Firmware, result: Outcome, statustext: Option<String>) -> Event {
    Event::Refused { what: aim.name(firmware), result, statustext }
}

/// The command that asks for an aim; `None` where setpoints do it.
fn command(aim: Aim, firmware: Firmware, altitude_m: f64) -> Option<COMMAND_LONG_DATA> {
    Some(match aim {
        Aim::Mode(mode) => {
            let number = firmware.mode_number(mode)?;
            let custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
            COMMAND_LONG_DATA {
                param3: f32::from(number.sub),
                ..long(MavCmd::MAV_CMD_DO_SET_MODE, [f32::from(custom), f32::from(number.main)])
            }
        }
        Aim::Arm => long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0]),
        Aim::Disarm => long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, 0.0]),
        Aim::TakeOff if firmware == Firmware::Px4 => return None,
        Aim::TakeOff => {
            COMMAND_LONG_DATA { param7: altitude_m as f32, ..long(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0, 0.0]) }
        }
    })
}
