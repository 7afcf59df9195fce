//! What the executive asked for, pursued by asking the autopilot until a heartbeat shows it.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavModeFlag, MavResult};

use super::adapter::Autopilot;
use super::command::{Outcome, Purpose};
use super::control::Phase;
use super::firmware::{Firmware, Mode};
use super::settings::Event;
use super::streams::long;
use crate::time::Instant;

/// How long setpoints stream before a firmware that wants to see them is asked for its mode.
const STREAM_FIRST: Duration = Duration::from_millis(1100);
/// Heartbeats come once a second: how long an acknowledged change may take to show.
const SHOWS_WITHIN: Duration = Duration::from_millis(2500);
const ASK_AGAIN: Duration = Duration::from_secs(2);
/// An autopilot's reason follows its refusal by a moment.
const REASON_WITHIN: Duration = Duration::from_millis(150);

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

impl Goal {
    pub(super) fn timeout(&self) -> Option<Instant> {
        [Some(self.deadline), self.ask_at, self.report_at].into_iter().flatten().min()
    }
}

impl Aim {
    pub(super) fn purpose(self) -> Purpose {
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
    pub(super) fn give_up(&mut self, purpose: Purpose) {
        self.control.goals.retain(|goal| goal.aim.purpose() != purpose);
        self.commands.cancel(purpose);
    }

    /// Whether this aim has been asked for yet: a mode seen before was not our doing.
    pub(super) fn asked(&self, aim: Aim, now: Instant) -> bool {
        self.control.goals.iter().any(|goal| goal.aim == aim && goal.asked_at.is_some_and(|at| at < now))
    }

    /// Ends an aim that shows; `false` if it was not pursued.
    pub(super) fn reached(&mut self, aim: Aim) -> bool {
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
                let (answer, waited) = (goal.answer, now.saturating_since(goal.since));
                let statustext = statustext.or_else(|| self.why_not(aim));
                self.abandon(aim);
                let next_best = if let Aim::Mode(mode) = aim { firmware.next_best(mode) } else { None };
                if let Some(instead) = next_best {
                    let result = answer.unwrap_or(MavResult::MAV_RESULT_FAILED);
                    self.out.tell(Event::NotReady { what: aim.name(firmware), result, statustext, waited });
                    self.start_handing_over(instead, now);
                } else {
                    self.out.tell(refused(aim, firmware, answer, statustext));
                }
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

    fn why_not(&self, aim: Aim) -> Option<String> {
        let never_asked = self.control.goals.iter().any(|goal| goal.aim == aim && goal.asked_at.is_none());
        (never_asked && aim == Aim::Mode(Mode::Companion))
            .then(|| "no setpoints could be streamed: is the position known?".to_owned())
    }
}

pub(super) fn refused(aim: Aim, firmware: Firmware, result: Outcome, statustext: Option<String>) -> Event {
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
