//! Body offsets of ArduPilot's 6DoF frame.
//!
//! Such a vehicle tracks a roll and pitch of its own apart from its position, but takes them from a script on board
//! alone (the repository's `ardupilot/`): COMMAND_LONG 31013 carries the angles, 31014 switches them on and off, and
//! each is acknowledged. An attitude target is never sent to it: a quaternion panics that frame. Offsets are setpoints,
//! so one is never repeated for want of an answer; the next one is on its way.
//!
//! The answers are the script's heartbeat: ArduPilot removes a script that fails or takes too many instructions, for
//! good, without a word to us, and answers nothing in its place. In flight each offset is answered, twenty times a
//! second; on the ground an offset of zero asks every second. What the vehicle then does is the second script's affair.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};

use crate::autopilot::command::{CommandQueue, LONGEST_WAIT, Outcome, Purpose, is_meant_for, long};
use crate::autopilot::context::Context;
use crate::autopilot::event::Event;
use crate::geo::Attitude;
use crate::time::Instant;

/// The script answers each offset, so they are sent no faster than this.
const OFFSET_INTERVAL: Duration = Duration::from_millis(50);
/// After offsets without an answer for so long the script is dead: ten of them, or an answer late by as much.
const UNANSWERED: Duration = Duration::from_millis(500);
/// While the autopilot itself has not been heard for so long, or offsets have not gone out, the script's silence says nothing.
const GAP: Duration = Duration::from_millis(150);
/// On the ground the script is asked this long after its last answer,
const PROBE_INTERVAL: Duration = Duration::from_secs(1);
/// and after a question that nobody saw the end of: longer than a command is repeated.
const PROBE_LOST: Duration = Duration::from_secs(3);
/// A refused switch is asked for again after this.
const ASK_AGAIN: Duration = Duration::from_secs(1);

/// Whether the script follows the offsets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Switch {
    #[default]
    Off,
    Asked,
    On {
        /// When the last offset went out.
        sent_at: Option<Instant>,
        unanswered_since: Option<Instant>,
    },
    Refused {
        ask_at: Instant,
    },
}

/// What the script was asked and what it answered.
#[derive(Debug, Clone, Default)]
pub(in crate::autopilot) struct Bridge {
    probed: Outcome,
    /// When the script is asked again whether it is there.
    probe_at: Option<Instant>,
    switch: Switch,
    /// It has fallen silent, and has not answered since.
    dead: bool,
    /// The trouble at hand has been told.
    told: bool,
}

impl Bridge {
    /// Asks now and then whether the script is there, by an offset of zero, while it has no offsets to answer.
    pub(in crate::autopilot::firmware) fn probe(
        &mut self,
        armed: bool,
        commands: &mut CommandQueue,
        now: Instant,
    ) {
        if !armed && self.switch == Switch::Off && self.probe_at.is_none_or(|at| now >= at) {
            commands.push(long(MavCmd::MAV_CMD_USER_4, [0.0, 0.0]), Purpose::Bridge);
            self.probe_at = Some(now + PROBE_LOST);
        }
    }

    /// Whether the script follows no more.
    pub(in crate::autopilot::firmware) fn is_dead(&self) -> bool {
        self.dead
    }

    /// The last answer to an offset of zero; `None` if there was none.
    pub(super) fn probed(&self) -> Outcome {
        self.probed
    }

    /// Switches the offsets off: the autopilot is to land, hold or return by itself.
    pub(in crate::autopilot::firmware) fn level(&mut self, commands: &mut CommandQueue) {
        self.is_off();
        commands.push(long(MavCmd::MAV_CMD_USER_5, [0.0, 0.0]), Purpose::Offsets);
    }

    /// Control is gone: nothing is asked of the script any more, which goes level by itself.
    pub(in crate::autopilot::firmware) fn forget(&mut self, commands: &mut CommandQueue) {
        if self.switch == Switch::Asked {
            commands.cancel(Purpose::Offsets);
        }
        self.is_off();
    }

    fn is_off(&mut self) {
        (self.switch, self.told, self.dead) = (Switch::Off, false, false);
    }

    /// Has the script follow this attitude, once it has agreed to; it is asked to only `in_control`.
    pub(in crate::autopilot::firmware) fn drive(
        &mut self,
        attitude: Attitude,
        in_control: bool,
        context: &mut Context,
    ) {
        let now = context.now;
        match self.switch {
            Switch::Refused { ask_at } if now < ask_at => {}
            Switch::Off | Switch::Refused { .. } if in_control => {
                self.switch = Switch::Asked;
                // From here on the offsets are the question.
                context.commands.cancel(Purpose::Bridge);
                context.commands.push(long(MavCmd::MAV_CMD_USER_5, [1.0, 0.0]), Purpose::Offsets);
            }
            Switch::Off | Switch::Refused { .. } | Switch::Asked => {}
            Switch::On { sent_at: Some(at), .. } if now < at + OFFSET_INTERVAL => {}
            Switch::On { sent_at, unanswered_since } => {
                let gap = GAP.max(context.settings.period() * 3);
                let lately = |at: Instant| now.saturating_since(at) <= gap;
                let talking =
                    context.state.pose_received_at().is_none_or(lately) && sent_at.is_none_or(lately);
                let unanswered_since = unanswered_since.filter(|_| talking);
                if let Some(since) = unanswered_since.filter(|since| now >= *since + UNANSWERED) {
                    self.tell_dead(now.saturating_since(since), context);
                }
                let unanswered_since = Some(unanswered_since.unwrap_or(now));
                self.switch = Switch::On { sent_at: Some(now), unanswered_since };
                let (roll_rad, pitch_rad, _) = attitude.to_mavlink_euler();
                let angles = [roll_rad.to_degrees() as f32, pitch_rad.to_degrees() as f32];
                let mut command = long(MavCmd::MAV_CMD_USER_4, angles);
                (command.target_system, command.target_component) = context.target;
                context.out.send(MavMessage::COMMAND_LONG(command));
            }
        }
    }

    /// The end of the command that probed for the script.
    pub(in crate::autopilot::firmware) fn probe_answered(&mut self, outcome: Outcome, now: Instant) {
        self.probed = outcome;
        self.probe_at = Some(now + PROBE_INTERVAL);
    }

    /// The answer to 31014.
    pub(in crate::autopilot::firmware) fn switch_answered(
        &mut self,
        outcome: Outcome,
        context: &mut Context,
    ) {
        if self.switch != Switch::Asked {
            return; // to the order to go level
        }
        if outcome == Some(MavResult::MAV_RESULT_ACCEPTED) {
            self.switch = Switch::On { sent_at: None, unanswered_since: None };
            (self.told, self.dead) = (false, false);
        } else {
            self.switch = Switch::Refused { ask_at: context.now + ASK_AGAIN };
            match outcome {
                Some(_) => self.tell_refused(outcome, context),
                None => self.tell_dead(LONGEST_WAIT, context),
            }
        }
    }

    /// An acknowledgement that ended no command of the queue: the answer to an offset perhaps.
    pub(in crate::autopilot::firmware) fn offset_answered(
        &mut self,
        ack: &COMMAND_ACK_DATA,
        context: &mut Context,
    ) {
        let is_ours = ack.command == MavCmd::MAV_CMD_USER_4 && is_meant_for(ack, context.settings.own);
        let Switch::On { unanswered_since, .. } = &mut self.switch else { return };
        if !is_ours {
            return;
        }
        *unanswered_since = None;
        if ack.result == MavResult::MAV_RESULT_UNSUPPORTED {
            // The autopilot's own answer: scripting has been stopped.
            return self.tell_dead(Duration::ZERO, context);
        }
        self.dead = false;
        match ack.result {
            MavResult::MAV_RESULT_ACCEPTED => self.told = false,
            // The script has gone level by itself and wants to be switched on again.
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED => {
                self.switch = Switch::Refused { ask_at: context.now + ASK_AGAIN };
                self.tell_refused(Some(ack.result), context);
            }
            other => self.tell_refused(Some(other), context),
        }
    }

    fn tell_dead(&mut self, silent_for: Duration, context: &mut Context) {
        if !std::mem::replace(&mut self.dead, true) {
            context.out.tell(Event::BridgeDead { silent_for });
        }
    }

    fn tell_refused(&mut self, result: Outcome, context: &mut Context) {
        if !std::mem::replace(&mut self.told, true) {
            let statustext = context.last_text.map(|text| text.value.clone());
            context.out.tell(Event::Refused { what: "body offsets", result, statustext });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::context::tests::Bench;
    use crate::autopilot::firmware::Firmware;

    const TICK: Duration = Duration::from_millis(20);

    fn tilted() -> Attitude {
        Attitude::from_euler(0.5, -0.2, 1.0)
    }

    fn ack(result: MavResult) -> COMMAND_ACK_DATA {
        let command = MavCmd::MAV_CMD_USER_4;
        COMMAND_ACK_DATA { command, result, target_system: 1, target_component: 191, ..Default::default() }
    }

    /// A script that has agreed to follow.
    fn agreed() -> (Bench, Bridge) {
        let mut bench = Bench::new(Firmware::ArduPilot);
        let mut bridge = Bridge::default();
        bridge.probe(false, &mut bench.commands, bench.now);
        bridge.probe_answered(Some(MavResult::MAV_RESULT_ACCEPTED), bench.now);
        bridge.drive(tilted(), true, &mut bench.context());
        bridge.switch_answered(Some(MavResult::MAV_RESULT_ACCEPTED), &mut bench.context());
        bench.commands.clear();
        _ = bench.sent();
        (bench, bridge)
    }

    #[test]
    fn val_an_offset_is_the_roll_and_pitch_of_the_quaternion_in_degrees() {
        let (mut bench, mut bridge) = agreed();
        bridge.drive(tilted(), true, &mut bench.context());
        let [offset] = &bench.sent()[..] else { panic!("not one offset") };
        // FRD: the paper's roll, and its pitch with the other sign.
        assert!((offset.param1 - 0.5_f32.to_degrees()).abs() < 1e-3, "{}", offset.param1);
        assert!((offset.param2 - 0.2_f32.to_degrees()).abs() < 1e-3, "{}", offset.param2);
        assert_eq!((offset.target_system, offset.target_component), (1, 1));
    }

    #[test]
    fn spec_without_control_the_script_is_not_asked() {
        let mut bench = Bench::new(Firmware::ArduPilot);
        let mut bridge = Bridge::default();
        bridge.drive(tilted(), false, &mut bench.context());
        assert!(bench.sent().is_empty());
        bridge.drive(tilted(), true, &mut bench.context());
        let [switch] = &bench.sent()[..] else { panic!("not one command") };
        assert_eq!((switch.command, switch.param1), (MavCmd::MAV_CMD_USER_5, 1.0));
    }

    #[test]
    fn spec_offsets_keep_their_interval_and_silence_is_told_once_within_a_second() {
        let (mut bench, mut bridge) = agreed();
        let mut sent = 0;
        for _ in 0..100 {
            bridge.drive(tilted(), true, &mut bench.context());
            sent += bench.sent().len();
            bench.pass(TICK);
        }
        assert_eq!(sent, 34, "every third tick of 20 ms, for 2 s");
        let told = bench.events();
        let [Event::BridgeDead { silent_for }] = told[..] else { panic!("{told:?}") };
        assert!(silent_for >= UNANSWERED && silent_for < Duration::from_millis(600), "{silent_for:?}");
        assert!(bridge.is_dead());
        bridge.offset_answered(&ack(MavResult::MAV_RESULT_ACCEPTED), &mut bench.context());
        assert!(!bridge.is_dead());
        bench.pass(UNANSWERED);
        bridge.drive(tilted(), true, &mut bench.context());
        assert_eq!(bench.events(), [], "answered meanwhile");
    }

    #[test]
    fn spec_a_switch_that_nobody_answers_is_a_dead_script() {
        let mut bench = Bench::new(Firmware::ArduPilot);
        let mut bridge = Bridge::default();
        bridge.drive(tilted(), true, &mut bench.context());
        bridge.switch_answered(None, &mut bench.context());
        assert!(matches!(bench.events()[..], [Event::BridgeDead { .. }]));
        assert!(bridge.is_dead());
    }

    #[test]
    fn spec_on_the_ground_the_script_is_asked_every_second_and_in_flight_by_its_offsets() {
        let mut bench = Bench::new(Firmware::ArduPilot);
        let mut bridge = Bridge::default();
        let mut asked = 0;
        for _ in 0..500 {
            bridge.probe(false, &mut bench.commands, bench.now);
            if !bench.sent().is_empty() {
                asked += 1;
                bench.commands.clear();
                bridge.probe_answered(Some(MavResult::MAV_RESULT_ACCEPTED), bench.now);
            }
            bench.pass(TICK);
        }
        assert_eq!(asked, 10, "in ten seconds");
        // Whoever sees no end of a question asks again.
        bridge.probe(false, &mut bench.commands, bench.now);
        bench.commands.clear();
        bench.pass(PROBE_LOST);
        bridge.probe(false, &mut bench.commands, bench.now);
        assert_eq!(bench.sent().len(), 1);
        bridge.drive(tilted(), true, &mut bench.context());
        let [switch] = &bench.sent()[..] else { panic!("not one command") };
        assert_eq!(switch.command, MavCmd::MAV_CMD_USER_5);
        bench.pass(PROBE_LOST);
        bridge.probe(true, &mut bench.commands, bench.now);
        assert!(bench.sent().iter().all(|command| command.command == MavCmd::MAV_CMD_USER_5));
    }

    #[test]
    fn spec_a_script_gone_level_is_switched_on_again_after_a_second() {
        let (mut bench, mut bridge) = agreed();
        bridge.drive(tilted(), true, &mut bench.context());
        bridge.offset_answered(&ack(MavResult::MAV_RESULT_TEMPORARILY_REJECTED), &mut bench.context());
        assert_eq!(bench.events().len(), 1);
        _ = bench.sent();
        bridge.drive(tilted(), true, &mut bench.context());
        assert!(bench.sent().is_empty());
        bench.pass(ASK_AGAIN);
        bridge.drive(tilted(), true, &mut bench.context());
        assert_eq!(bench.sent().len(), 1);
    }

    #[test]
    fn spec_levelled_or_forgotten_no_offset_goes_out_and_the_order_to_go_level_stands() {
        let (mut bench, mut bridge) = agreed();
        bridge.level(&mut bench.commands);
        // Its answer is none to a switching on.
        bridge.switch_answered(Some(MavResult::MAV_RESULT_ACCEPTED), &mut bench.context());
        bridge.forget(&mut bench.commands);
        bridge.drive(tilted(), false, &mut bench.context());
        let [switch] = &bench.sent()[..] else { panic!("not one command") };
        assert_eq!((switch.command, switch.param1), (MavCmd::MAV_CMD_USER_5, 0.0));
        assert_eq!(bridge.probed(), Some(MavResult::MAV_RESULT_ACCEPTED));
    }
}
