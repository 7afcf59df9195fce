//! Something that the autopilot is asked for, again and again, until a heartbeat shows it.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavModeFlag, MavResult};

use super::command::{Outcome, Purpose, long};
use super::context::Context;
use super::event::Event;
use super::firmware::{Firmware, Mode};
use crate::time::Instant;

/// Heartbeats come once a second: how long an acknowledged change may take to show.
const SHOWS_WITHIN: Duration = Duration::from_millis(2500);
const ASK_AGAIN: Duration = Duration::from_secs(2);
/// An autopilot's reason follows its refusal by a moment.
const REASON_WITHIN: Duration = Duration::from_millis(150);
/// How often it is looked whether setpoints have streamed for long enough.
const LOOK_AGAIN: Duration = Duration::from_millis(100);

/// What is to be reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Aim {
    Mode(Mode),
    Arm,
    Disarm,
    TakeOff {
        /// Above home.
        altitude_m: f64,
    },
}

impl Aim {
    pub(super) fn purpose(self) -> Purpose {
        match self {
            Self::Mode(_) => Purpose::Mode,
            Self::Arm | Self::Disarm => Purpose::Arming,
            Self::TakeOff { .. } => Purpose::TakeOff,
        }
    }

    fn name(self, firmware: Option<Firmware>) -> &'static str {
        match self {
            Self::Mode(mode) => firmware.map_or("the mode", |firmware| firmware.mode_name(mode)),
            Self::Arm => "arming",
            Self::Disarm => "disarming",
            Self::TakeOff { .. } => "take-off",
        }
    }

    /// The event for what was not even asked for, with the reason.
    pub(super) fn refused(self, firmware: Option<Firmware>, why: &str) -> Event {
        Event::Refused { what: self.name(firmware), result: None, statustext: Some(why.to_owned()) }
    }

    /// The command that asks for it; `None` where setpoints do it.
    fn command(self, firmware: Firmware) -> Option<COMMAND_LONG_DATA> {
        Some(match self {
            Self::Mode(mode) => {
                let number = firmware.mode_number(mode)?;
                let custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.bits();
                COMMAND_LONG_DATA {
                    param3: f32::from(number.sub),
                    ..long(MavCmd::MAV_CMD_DO_SET_MODE, [f32::from(custom), f32::from(number.main)])
                }
            }
            Self::Arm => long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0]),
            Self::Disarm => long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, 0.0]),
            Self::TakeOff { .. } if firmware.takes_off_by_setpoints() => return None,
            Self::TakeOff { altitude_m } => COMMAND_LONG_DATA {
                param7: altitude_m as f32,
                ..long(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0, 0.0])
            },
        })
    }
}

/// One aim, pursued.
#[derive(Debug, Clone)]
pub(super) struct Pursuit {
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

/// Whether a pursuit goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Progress {
    Going,
    /// The time is up, or the autopilot cannot do it: to be given up.
    Over,
}

impl Pursuit {
    /// To be reached within `patience`. Nothing is asked before [`Self::advance`].
    pub(super) fn new(aim: Aim, patience: Duration, now: Instant) -> Self {
        let deadline = now + patience;
        Self { aim, since: now, deadline, ask_at: Some(now), asked_at: None, answer: None, report_at: None }
    }

    pub(super) fn aim(&self) -> Aim {
        self.aim
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        [Some(self.deadline), self.ask_at, self.report_at].into_iter().flatten().min()
    }

    /// Whether it had been asked for before `now`: what shows without that was not our doing.
    pub(super) fn was_asked(&self, now: Instant) -> bool {
        self.asked_at.is_some_and(|at| at < now)
    }

    /// Takes the end of a command that was sent for it.
    pub(super) fn answered(&mut self, outcome: Outcome, now: Instant) {
        self.answer = outcome;
        match outcome {
            Some(MavResult::MAV_RESULT_ACCEPTED) => {
                // A take-off that is accepted is under way: asking again would start it anew.
                let once = matches!(self.aim, Aim::TakeOff { .. });
                self.ask_at = (!once).then_some(now + SHOWS_WITHIN);
            }
            Some(_) => {
                self.ask_at = Some(now + ASK_AGAIN);
                self.report_at = Some(now + REASON_WITHIN);
            }
            None => self.ask_at = Some(now),
        }
    }

    /// Asks and reports what is due. Without `may_ask` it looks again a moment later.
    pub(super) fn advance(&mut self, may_ask: bool, context: &mut Context) -> Progress {
        let now = context.now;
        let report = self.report_at.is_some_and(|at| at <= now);
        let hopeless = report && self.answer == Some(MavResult::MAV_RESULT_UNSUPPORTED);
        if hopeless || self.deadline <= now {
            return Progress::Over;
        }
        if let (true, Some(result)) = (report, self.answer) {
            self.report_at = None;
            context.out.tell(self.not_ready(result, context));
        }
        if self.ask_at.is_some_and(|at| at <= now) {
            if may_ask {
                self.ask(context);
            } else {
                self.ask_at = Some(now + LOOK_AGAIN);
            }
        }
        Progress::Going
    }

    fn ask(&mut self, context: &mut Context) {
        self.ask_at = None;
        self.asked_at.get_or_insert(context.now);
        if let Some(command) = self.aim.command(context.firmware) {
            context.commands.push(command, self.aim.purpose());
        }
    }

    /// Not done, and not asked for again.
    pub(super) fn refused(&self, context: &Context) -> Event {
        let waits_for_setpoints = self.asked_at.is_none() && self.aim == Aim::Mode(Mode::Companion);
        let why =
            waits_for_setpoints.then(|| "no setpoints could be streamed: is the position known?".to_owned());
        Event::Refused {
            what: self.aim.name(Some(context.firmware)),
            result: self.answer,
            statustext: self.reason(context).or(why),
        }
    }

    /// Not done, and something else is asked for in its place.
    pub(super) fn replaced(&self, context: &Context) -> Event {
        self.not_ready(self.answer.unwrap_or(MavResult::MAV_RESULT_FAILED), context)
    }

    fn not_ready(&self, result: MavResult, context: &Context) -> Event {
        Event::NotReady {
            what: self.aim.name(Some(context.firmware)),
            result,
            statustext: self.reason(context),
            waited: context.now.saturating_since(self.since),
        }
    }

    /// What the autopilot has said since it was asked.
    fn reason(&self, context: &Context) -> Option<String> {
        let asked_at = self.asked_at?;
        context.last_text.filter(|text| text.received_at >= asked_at).map(|text| text.value.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::context::tests::Bench;

    fn pursuing(aim: Aim) -> (Bench, Pursuit) {
        let mut bench = Bench::new(Firmware::ArduPilot);
        let mut pursuit = Pursuit::new(aim, Duration::from_secs(10), bench.now);
        assert_eq!(pursuit.advance(true, &mut bench.context()), Progress::Going);
        (bench, pursuit)
    }

    #[test]
    fn spec_a_refusal_is_told_with_the_moment_of_its_reason_and_asked_again() {
        let (mut bench, mut pursuit) = pursuing(Aim::Arm);
        assert_eq!(bench.sent().len(), 1);
        pursuit.answered(Some(MavResult::MAV_RESULT_DENIED), bench.now);
        assert_eq!(pursuit.timeout(), Some(bench.now + REASON_WITHIN));
        bench.pass(REASON_WITHIN);
        assert_eq!(pursuit.advance(true, &mut bench.context()), Progress::Going);
        let told = bench.events();
        assert!(
            matches!(
                told[..],
                [Event::NotReady { what: "arming", result: MavResult::MAV_RESULT_DENIED, .. }]
            ),
            "{told:?}"
        );
        bench.pass(ASK_AGAIN - REASON_WITHIN);
        assert_eq!(pursuit.advance(true, &mut bench.context()), Progress::Going);
        assert_eq!(bench.sent().len(), 1);
        assert_eq!(bench.events(), [], "told once an answer");
    }

    #[test]
    fn spec_what_is_unsupported_is_given_up_and_so_is_what_takes_too_long() {
        let (mut bench, mut pursuit) = pursuing(Aim::Mode(Mode::Hold));
        pursuit.answered(Some(MavResult::MAV_RESULT_UNSUPPORTED), bench.now);
        bench.pass(REASON_WITHIN);
        assert_eq!(pursuit.advance(true, &mut bench.context()), Progress::Over);
        let (mut bench, mut pursuit) = pursuing(Aim::Mode(Mode::Hold));
        pursuit.answered(Some(MavResult::MAV_RESULT_ACCEPTED), bench.now);
        bench.pass(Duration::from_secs(10));
        assert_eq!(pursuit.advance(true, &mut bench.context()), Progress::Over);
        let refused = pursuit.refused(&bench.context());
        let result = Some(MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(refused, Event::Refused { what: "BRAKE", result, statustext: None });
    }

    #[test]
    fn spec_an_accepted_take_off_is_not_asked_for_again_and_an_accepted_mode_is() {
        for (aim, again) in [(Aim::TakeOff { altitude_m: 12.0 }, 0), (Aim::Mode(Mode::Companion), 1)] {
            let (mut bench, mut pursuit) = pursuing(aim);
            let asked = bench.sent();
            assert_eq!(asked.len(), 1);
            bench.commands.clear();
            pursuit.answered(Some(MavResult::MAV_RESULT_ACCEPTED), bench.now);
            bench.pass(SHOWS_WITHIN);
            assert_eq!(pursuit.advance(true, &mut bench.context()), Progress::Going);
            assert_eq!(bench.sent().len(), again, "{aim:?}");
        }
    }

    #[test]
    fn spec_what_may_not_be_asked_yet_is_looked_at_again_and_says_why_it_failed() {
        let mut bench = Bench::new(Firmware::Px4);
        let mut pursuit = Pursuit::new(Aim::Mode(Mode::Companion), Duration::from_secs(1), bench.now);
        for _ in 0..5 {
            assert_eq!(pursuit.advance(false, &mut bench.context()), Progress::Going);
            assert_eq!(pursuit.timeout(), Some(bench.now + LOOK_AGAIN));
            bench.pass(LOOK_AGAIN);
        }
        assert!(bench.sent().is_empty() && !pursuit.was_asked(bench.now));
        let Event::Refused { statustext: Some(why), .. } = pursuit.refused(&bench.context()) else {
            panic!("no reason")
        };
        assert!(why.contains("no setpoints"), "{why}");
    }

    #[test]
    fn spec_a_take_off_by_setpoints_is_not_commanded() {
        let mut bench = Bench::new(Firmware::Px4);
        let aim = Aim::TakeOff { altitude_m: 12.0 };
        let mut pursuit = Pursuit::new(aim, Duration::from_secs(10), bench.now);
        assert_eq!(pursuit.advance(true, &mut bench.context()), Progress::Going);
        assert!(bench.sent().is_empty());
    }
}
