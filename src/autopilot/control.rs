//! Taking, keeping and giving up control. Success is what a heartbeat shows, never what an acknowledgement says.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavResult;

use super::command::{CommandQueue, Outcome, Purpose};
use super::context::Context;
use super::event::Event;
use super::firmware::{Firmware, Mode};
use super::pursuit::{Aim, Progress, Pursuit};
use super::setpoint::Footing;
use super::settings::Actuation;
use super::state::{Landed, VehicleState};
use crate::geo::{Enu, EnuVelocity};
use crate::time::Instant;

/// How long setpoints stream before a firmware that wants to see them is asked for its mode.
const STREAM_FIRST: Duration = Duration::from_millis(1100);
/// In flight, a mode is taken soon or not at all.
const IN_FLIGHT_TIMEOUT: Duration = Duration::from_secs(6);
/// How long an autopilot is asked to disarm.
const DISARM_TIMEOUT: Duration = Duration::from_secs(10);
const TAKEOFF_GRACE: Duration = Duration::from_secs(20);
/// Slowest climb that a take-off is given time for, m/s.
const SLOWEST_CLIMB_M_S: f64 = 0.5;
/// A vehicle this much higher than it stood, or rising this fast, has left the ground.
const LEFT_GROUND_M: f64 = 0.1;
const LEFT_GROUND_M_S: f64 = 0.2;
const ALTITUDE_TOLERANCE_M: f64 = 0.5;

/// Who flies.
#[derive(Debug, Clone)]
enum Phase {
    /// Not the companion.
    Released,
    /// The companion has asked for its mode, from this one.
    Taking { from: Option<Mode>, pursuit: Pursuit },
    /// The companion; on a take-off perhaps.
    Held { climb: Option<Climb> },
    /// The companion has asked for one of the autopilot's own modes; `held`: its own mode was shown until then.
    HandingOver { to: Mode, held: bool, acknowledged: bool, pursuit: Pursuit },
    /// The autopilot, in the mode that the companion asked for.
    HandedOver { mode: Mode },
}

/// A take-off under way.
#[derive(Debug, Clone)]
struct Climb {
    from: Enu,
    /// Altitude above the mission origin to be reached.
    top_m: f64,
    /// Still on the ground, where it is ours to find the thrust that lifts.
    lifting: bool,
    pursuit: Pursuit,
}

/// Who flies, and what the autopilot is asked for. Requests and evidence come in; commands, and events once a heartbeat
/// shows the outcome, go to the [`Context`].
#[derive(Debug, Clone)]
pub(super) struct Control {
    phase: Phase,
    /// To arm or to disarm.
    arming: Option<Pursuit>,
    /// Whether this flight has left the ground. It ends by disarming alone: a land detector may be mistaken.
    flown: bool,
    previous_mode: Option<Mode>,
    /// The mode that the autopilot's failsafe took from the companion's, while it is in it.
    fell_back_to: Option<Mode>,
}

impl Control {
    pub(super) fn new() -> Self {
        Self { phase: Phase::Released, arming: None, flown: false, previous_mode: None, fell_back_to: None }
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        let own = match &self.phase {
            Phase::Taking { pursuit, .. } | Phase::HandingOver { pursuit, .. } => Some(pursuit),
            Phase::Held { climb } => climb.as_ref().map(|climb| &climb.pursuit),
            Phase::Released | Phase::HandedOver { .. } => None,
        };
        own.into_iter().chain(&self.arming).filter_map(Pursuit::timeout).min()
    }

    /// Whether a heartbeat has shown the companion's mode after it was asked for, and none another since.
    pub(super) fn is_held(&self) -> bool {
        matches!(self.phase, Phase::Held { .. })
    }

    pub(super) fn is_climbing(&self) -> bool {
        matches!(self.phase, Phase::Held { climb: Some(_) })
    }

    /// Whether setpoints belong to this phase at all; between two such phases the stream ends.
    pub(super) fn wants_setpoints(&self) -> bool {
        !matches!(self.phase, Phase::Released | Phase::HandedOver { .. })
    }

    /// Whether a setpoint may go out now.
    pub(super) fn lets_out_setpoints(&self, firmware: Firmware, state: &VehicleState) -> bool {
        match &self.phase {
            Phase::Taking { .. } => firmware.wants_stream_first(),
            Phase::Held { climb } => {
                firmware.takes_off_by_setpoints() || (climb.is_none() && self.is_flying(state))
            }
            Phase::HandingOver { held, acknowledged, .. } => *held && !acknowledged && self.is_flying(state),
            Phase::Released | Phase::HandedOver { .. } => false,
        }
    }

    /// A vehicle that has flown is taken to fly until it disarms: idle thrust in mid-air, because a land detector took
    /// a tilted hover for the ground, would make it fall.
    pub(super) fn is_flying(&self, state: &VehicleState) -> bool {
        self.flown || state.is_airborne() == Some(true)
    }

    /// How the vehicle stands to the ground, for the thrust that a setpoint asks for.
    pub(super) fn footing(&self, state: &VehicleState) -> Footing {
        match &self.phase {
            Phase::Held { climb: Some(climb) } if climb.lifting => Footing::Lifting,
            Phase::Held { climb: Some(_) } => Footing::Airborne,
            _ if self.is_flying(state) => Footing::Airborne,
            _ => Footing::Standing,
        }
    }

    /// Ends the search for the thrust that lifts once the vehicle has left the ground.
    pub(super) fn note_lift_off(&mut self, position_enu_m: Enu, velocity_enu_m_s: EnuVelocity) {
        if let Phase::Held { climb: Some(climb) } = &mut self.phase {
            let left = position_enu_m.z > climb.from.z + LEFT_GROUND_M
                || velocity_enu_m_s.vector().z > LEFT_GROUND_M_S;
            climb.lifting &= !left;
        }
    }

    /// Control is gone: nothing is asked for any more.
    pub(super) fn drop(&mut self, commands: &mut CommandQueue) {
        self.phase = Phase::Released;
        self.arming = None;
        for purpose in [Purpose::Mode, Purpose::Arming, Purpose::TakeOff] {
            commands.cancel(purpose);
        }
    }

    /// The autopilot has restarted: nothing is known of its flight either.
    pub(super) fn forget(&mut self, commands: &mut CommandQueue) {
        self.drop(commands);
        self.flown = false;
        self.previous_mode = None;
        self.fell_back_to = None;
    }

    /// Asks for the companion's mode.
    pub(super) fn take(&mut self, streamed_for: Duration, context: &mut Context) {
        let aim = Aim::Mode(Mode::Companion);
        if let Some(why) = context.firmware.cannot(context.settings) {
            context.out.tell(aim.refused(Some(context.firmware), why));
            return;
        }
        let in_flight = context.state.is_armed();
        let patience = if in_flight { IN_FLIGHT_TIMEOUT } else { context.settings.readiness_timeout };
        self.leave(context.commands);
        let pursuit = Pursuit::new(aim, patience, context.now);
        self.phase = Phase::Taking { from: context.state.mode(), pursuit };
        self.advance(streamed_for, context);
    }

    /// Asks the autopilot to arm, for as long as it may need to become ready.
    pub(super) fn arm(&mut self, context: &mut Context) {
        self.pursue_arming(Aim::Arm, context.settings.readiness_timeout, context);
    }

    /// Asks the autopilot to disarm, without force.
    pub(super) fn disarm(&mut self, context: &mut Context) {
        self.pursue_arming(Aim::Disarm, DISARM_TIMEOUT, context);
    }

    fn pursue_arming(&mut self, aim: Aim, patience: Duration, context: &mut Context) {
        context.commands.cancel(Purpose::Arming);
        self.arming = Some(Pursuit::new(aim, patience, context.now));
        self.advance_arming(context);
    }

    /// Asks for one of the autopilot's own modes.
    pub(super) fn hand_over(&mut self, to: Mode, context: &mut Context) {
        let held = matches!(self.phase, Phase::Held { .. } | Phase::HandingOver { held: true, .. });
        self.begin_hand_over(to, held, context);
    }

    fn begin_hand_over(&mut self, to: Mode, held: bool, context: &mut Context) {
        self.leave(context.commands);
        self.arming = None;
        context.commands.cancel(Purpose::Arming);
        let pursuit = Pursuit::new(Aim::Mode(to), IN_FLIGHT_TIMEOUT, context.now);
        self.phase = Phase::HandingOver { to, held, acknowledged: false, pursuit };
        self.advance_phase(true, context);
    }

    /// Starts a climb to this altitude above home.
    pub(super) fn take_off(&mut self, altitude_m: f64, context: &mut Context) {
        let aim = Aim::TakeOff { altitude_m };
        let refuse = |context: &mut Context, why| context.out.tell(aim.refused(Some(context.firmware), why));
        if !(altitude_m.is_finite() && altitude_m > 0.0) {
            return refuse(context, "the altitude must be above zero");
        }
        let Phase::Held { climb } = &mut self.phase else {
            return refuse(context, "not in control of an armed vehicle");
        };
        if !is_ours(context.state) {
            return refuse(context, "not in control of an armed vehicle");
        }
        let Some(from) = context.state.position_enu_m.map(|position| position.value) else {
            return refuse(context, "the position is not known");
        };
        let home_m = context.state.home_enu_m.map_or(from.z, |home| home.value.z);
        let patience = TAKEOFF_GRACE + Duration::from_secs_f64((altitude_m / SLOWEST_CLIMB_M_S).min(1e6));
        context.commands.cancel(Purpose::TakeOff);
        *climb = Some(Climb {
            from,
            top_m: home_m + altitude_m,
            lifting: context.settings.actuation == Actuation::ThrustVector,
            pursuit: Pursuit::new(aim, patience, context.now),
        });
        self.advance_phase(true, context);
    }

    /// Takes the end of a command that was sent for one of the aims.
    pub(super) fn answered(&mut self, purpose: Purpose, outcome: Outcome, now: Instant) {
        let pursuit = match (purpose, &mut self.phase) {
            (Purpose::Mode, Phase::Taking { pursuit, .. }) => Some(pursuit),
            (Purpose::Mode, Phase::HandingOver { pursuit, acknowledged, .. }) => {
                *acknowledged |= outcome == Some(MavResult::MAV_RESULT_ACCEPTED);
                Some(pursuit)
            }
            (Purpose::TakeOff, Phase::Held { climb: Some(climb) }) => Some(&mut climb.pursuit),
            (Purpose::Arming, _) => self.arming.as_mut(),
            _ => None,
        };
        if let Some(pursuit) = pursuit {
            pursuit.answered(outcome, now);
        }
    }

    /// Asks, reports refusals and gives up what is due, `streamed_for` being how long setpoints have gone out.
    pub(super) fn advance(&mut self, streamed_for: Duration, context: &mut Context) {
        let may_take = !context.firmware.wants_stream_first() || streamed_for >= STREAM_FIRST;
        self.advance_phase(may_take, context);
        self.advance_arming(context);
    }

    fn advance_phase(&mut self, may_take: bool, context: &mut Context) {
        let progress = match &mut self.phase {
            Phase::Taking { pursuit, .. } => pursuit.advance(may_take, context),
            Phase::HandingOver { pursuit, .. } => pursuit.advance(true, context),
            Phase::Held { climb: Some(climb) } => climb.pursuit.advance(true, context),
            Phase::Released | Phase::Held { climb: None } | Phase::HandedOver { .. } => Progress::Going,
        };
        if progress == Progress::Over {
            self.give_up(context);
        }
    }

    fn advance_arming(&mut self, context: &mut Context) {
        if let Some(pursuit) = &mut self.arming
            && pursuit.advance(true, context) == Progress::Over
        {
            context.out.tell(pursuit.refused(context));
            context.commands.cancel(Purpose::Arming);
            self.arming = None;
        }
    }

    /// Leaves a phase whose aim was not reached.
    fn give_up(&mut self, context: &mut Context) {
        match std::mem::replace(&mut self.phase, Phase::Released) {
            Phase::Taking { pursuit, .. } => {
                self.drop(context.commands);
                context.out.tell(pursuit.refused(context));
            }
            Phase::Held { climb: Some(Climb { pursuit, .. }) } => {
                context.commands.cancel(Purpose::TakeOff);
                self.phase = Phase::Held { climb: None };
                context.out.tell(pursuit.refused(context));
            }
            Phase::HandingOver { to, held, pursuit, .. } => {
                context.commands.cancel(Purpose::Mode);
                if let Some(instead) = context.firmware.next_best(to) {
                    context.out.tell(pursuit.replaced(context));
                    self.begin_hand_over(instead, held, context);
                    return;
                }
                if context.state.mode() == Some(Mode::Companion) {
                    self.phase = Phase::Held { climb: None };
                }
                context.out.tell(pursuit.refused(context));
            }
            unasked => self.phase = unasked,
        }
    }

    /// Leaves a phase for another that is asked for: what it had asked for is forgotten.
    fn leave(&mut self, commands: &mut CommandQueue) {
        self.phase = Phase::Released;
        commands.cancel(Purpose::Mode);
        commands.cancel(Purpose::TakeOff);
    }

    /// Looks at what telemetry has shown: whether the vehicle has flown, and whether a climb has reached its top.
    pub(super) fn handle_telemetry(&mut self, context: &mut Context) {
        let state = context.state;
        self.flown |= state.is_armed() && state.is_airborne() == Some(true);
        let (Phase::Held { climb }, Some(position)) = (&mut self.phase, state.position_enu_m) else { return };
        let on_ground = state.landed.is_some_and(|landed| landed.value == Landed::OnGround);
        let at_the_top = |climb: &mut Climb| position.value.z >= climb.top_m - ALTITUDE_TOLERANCE_M;
        if !on_ground && climb.take_if(at_the_top).is_some() {
            context.commands.cancel(Purpose::TakeOff);
            self.flown = true;
            context.out.tell(Event::Airborne);
        }
    }

    /// What a heartbeat shows, at once and without debouncing (F2): the state is the one that it has just brought, but
    /// for whether the motors were armed before.
    pub(super) fn handle_heartbeat(&mut self, mode: Mode, was_armed: bool, context: &mut Context) {
        let armed = context.state.is_armed();
        let changed = self.previous_mode.replace(mode).is_some_and(|before| before != mode);
        if was_armed && !armed {
            self.flown = false;
            self.drop(context.commands);
            context.out.tell(Event::Disarmed);
            return;
        }
        if armed && self.arming.take_if(|pursuit| pursuit.aim() == Aim::Arm).is_some() {
            context.commands.cancel(Purpose::Arming);
            context.out.tell(Event::Armed);
        }
        let name = context.firmware.mode_name(mode);
        let fell_back_to = self.fell_back_to.take_if(|to| *to != mode);
        match &mut self.phase {
            Phase::Released => {
                if let Some(to) = fell_back_to
                    && mode == Mode::Companion
                    && armed
                {
                    self.send_back(to, context);
                }
            }
            Phase::Taking { pursuit, .. } if mode == Mode::Companion => {
                if pursuit.was_asked(context.now) {
                    context.commands.cancel(Purpose::Mode);
                    self.phase = Phase::Held { climb: None };
                    context.out.tell(Event::ControlTaken);
                }
            }
            // On the ground, modes come and go while an autopilot starts; in flight another mode is another hand.
            Phase::Taking { from, .. } => {
                if armed && from.is_some_and(|from| from != mode) {
                    self.lose(mode, context);
                }
            }
            Phase::Held { .. } => {
                if mode != Mode::Companion {
                    self.lose(mode, context);
                }
            }
            Phase::HandingOver { to, .. } => {
                if mode == *to {
                    context.commands.cancel(Purpose::Mode);
                    self.phase = Phase::HandedOver { mode };
                    context.out.tell(Event::HandedOver { mode: name });
                } else if mode != Mode::Companion && changed {
                    self.lose(mode, context);
                }
            }
            Phase::HandedOver { mode: before } => {
                // Returning ends in landing or holding by the autopilot's own doing.
                let goes_on = *before == Mode::Return && matches!(mode, Mode::Land | Mode::Hold);
                if mode != *before && goes_on {
                    *before = mode;
                } else if mode != *before && armed {
                    self.lose(mode, context);
                }
            }
        }
    }

    /// Control is another's, and nothing more is asked for; but where a failsafe took it that our setpoints undo, those that
    /// are under way still.
    fn lose(&mut self, mode: Mode, context: &mut Context) {
        self.drop(context.commands);
        if context.state.in_failsafe && context.firmware.resumes_by_setpoints() {
            self.fell_back_to = Some(mode);
        }
        let mode = context.firmware.mode_name(mode);
        context.out.tell(Event::ControlLost { mode: mode.to_owned() });
    }

    /// Setpoints that were under way when the failsafe was seen have called the autopilot back to the companion's mode,
    /// where nobody flies it: to its failsafe's mode again, before it goes on blindly with the last of them.
    fn send_back(&mut self, to: Mode, context: &mut Context) {
        let to = if matches!(to, Mode::Land | Mode::Return) { to } else { Mode::Hold };
        self.begin_hand_over(to, false, context);
        context.out.tell(Event::CalledBack { to: context.firmware.mode_name(to) });
    }
}

/// Whether the last heartbeat shows the companion's mode, armed.
pub(super) fn is_ours(state: &VehicleState) -> bool {
    state.mode() == Some(Mode::Companion) && state.is_armed()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::BootTime;
    use crate::autopilot::context::tests::Bench;
    use crate::autopilot::state::{Sampled, Timed};
    use mavlink::dialects::ardupilotmega::MavCmd;

    const LONG_ENOUGH: Duration = Duration::from_secs(2);
    const POSCTL: Mode = Mode::Other { name: "POSCTL", custom_mode: 3 << 16 };
    const SECOND: Duration = Duration::from_secs(1);

    /// Control and all around it.
    struct Flight {
        bench: Bench,
        control: Control,
    }

    impl Flight {
        fn new(firmware: Firmware) -> Self {
            Self { bench: Bench::new(firmware), control: Control::new() }
        }

        /// A heartbeat, a second later.
        fn beat(&mut self, mode: Mode, armed: bool) {
            self.bench.pass(SECOND);
            let now = self.bench.now;
            let was_armed = self.bench.state.is_armed();
            self.bench.state.mode = Some(Timed::new(mode, now));
            self.bench.state.armed = Some(Timed::new(armed, now));
            self.control.handle_heartbeat(mode, was_armed, &mut self.bench.context());
        }

        fn see(&mut self, altitude_m: f64, landed: Landed) {
            let now = self.bench.now;
            let position = Enu::new(0.0, 0.0, altitude_m);
            self.bench.state.position_enu_m = Some(Sampled::new(position, BootTime::ZERO, now));
            self.bench.state.landed = Some(Timed::new(landed, now));
            self.control.handle_telemetry(&mut self.bench.context());
        }

        fn take(&mut self) {
            self.control.take(LONG_ENOUGH, &mut self.bench.context());
        }

        /// In control, armed, flying at 10 m.
        fn held(firmware: Firmware) -> Self {
            let mut flight = Self::new(firmware);
            flight.take();
            flight.beat(Mode::Companion, true);
            flight.see(10.0, Landed::InAir);
            assert!(flight.control.is_held());
            _ = (flight.bench.sent(), flight.bench.events());
            flight
        }

        fn lets_out(&self) -> bool {
            self.control.lets_out_setpoints(self.bench.firmware, &self.bench.state)
        }

        fn answer(&mut self, purpose: Purpose, result: MavResult) {
            self.control.answered(purpose, Some(result), self.bench.now);
        }

        fn advance(&mut self) {
            self.control.advance(LONG_ENOUGH, &mut self.bench.context());
        }
    }

    #[test]
    fn spec_a_mode_that_shows_before_it_was_asked_for_is_not_ours() {
        let mut flight = Flight::new(Firmware::Px4);
        // Setpoints do not stream yet, so nothing has been asked.
        flight.control.take(Duration::ZERO, &mut flight.bench.context());
        flight.beat(Mode::Companion, true);
        assert!(!flight.control.is_held() && flight.bench.sent().is_empty());
        flight.advance();
        assert_eq!(flight.bench.sent().len(), 1);
        flight.beat(Mode::Companion, true);
        assert!(flight.control.is_held());
        assert_eq!(flight.bench.events(), [Event::ControlTaken]);
    }

    #[test]
    fn spec_another_mode_ends_control_and_all_that_is_asked_for() {
        for firmware in [Firmware::Px4, Firmware::ArduPilot] {
            let mut flight = Flight::held(firmware);
            flight.control.disarm(&mut flight.bench.context());
            assert_eq!(flight.bench.sent().len(), 1);
            flight.beat(POSCTL, true);
            assert_eq!(flight.bench.events(), [Event::ControlLost { mode: "POSCTL".into() }]);
            assert!(!flight.control.wants_setpoints() && flight.control.timeout().is_none());
            flight.bench.pass(SECOND);
            assert!(flight.bench.sent().is_empty(), "the unanswered command is not repeated");
            // The mode's return is nobody's request.
            flight.beat(Mode::Companion, true);
            assert!(!flight.control.is_held() && flight.bench.events().is_empty());
        }
    }

    #[test]
    fn regress_an_autopilot_that_late_setpoints_call_back_from_its_failsafe_is_sent_back() {
        // The mode that is seen first, by whose doing, and what the autopilot is asked for as it shows the companion's.
        let cases = [
            (Firmware::Px4, Mode::Hold, true, Some("AUTO.LOITER")),
            (Firmware::Px4, Mode::Land, true, Some("AUTO.LAND")),
            (Firmware::Px4, POSCTL, true, Some("AUTO.LOITER")),
            (Firmware::Px4, Mode::Hold, false, None),
            // It knows no such return: another hand asked for GUIDED.
            (Firmware::ArduPilot, Mode::Land, true, None),
        ];
        for (firmware, fallback, by_failsafe, to) in cases {
            for pilot_between in [false, true] {
                let mut flight = Flight::held(firmware);
                flight.bench.state.in_failsafe = by_failsafe;
                flight.beat(fallback, true);
                flight.control.drop(&mut flight.bench.commands);
                _ = flight.bench.events();
                flight.bench.state.in_failsafe = false;
                if pilot_between {
                    flight.beat(Mode::Other { name: "ALTCTL", custom_mode: 2 << 16 }, true);
                }
                flight.beat(Mode::Companion, true);
                let to = to.filter(|_| !pilot_between);
                let expected: Vec<Event> = to.into_iter().map(|to| Event::CalledBack { to }).collect();
                assert_eq!(flight.bench.events(), expected);
                assert_eq!(flight.bench.sent().len(), expected.len());
                assert!(!flight.lets_out() && !flight.control.is_held());
            }
        }
    }

    #[test]
    fn spec_setpoints_go_out_until_the_hand_over_is_acknowledged() {
        let mut flight = Flight::held(Firmware::Px4);
        flight.control.hand_over(Mode::Land, &mut flight.bench.context());
        assert!(flight.lets_out());
        flight.answer(Purpose::Mode, MavResult::MAV_RESULT_ACCEPTED);
        assert!(!flight.lets_out() && flight.control.wants_setpoints());
        flight.beat(Mode::Land, true);
        assert!(!flight.control.wants_setpoints());
        assert_eq!(flight.bench.events(), [Event::HandedOver { mode: "AUTO.LAND" }]);
    }

    #[test]
    fn regress_no_setpoint_goes_out_while_another_is_asked_to_land_what_was_never_ours() {
        let mut flight = Flight::new(Firmware::ArduPilot);
        flight.beat(POSCTL, true);
        flight.see(10.0, Landed::InAir);
        flight.control.hand_over(Mode::Land, &mut flight.bench.context());
        assert!(!flight.lets_out());
        // Nor when it is asked for the next best mode.
        flight.control.hand_over(Mode::Hold, &mut flight.bench.context());
        flight.answer(Purpose::Mode, MavResult::MAV_RESULT_UNSUPPORTED);
        flight.bench.pass(SECOND);
        flight.advance();
        assert!(!flight.lets_out());
    }

    #[test]
    fn spec_a_refused_hand_over_falls_back_to_who_flies() {
        for (mode, held) in [(Mode::Companion, true), (POSCTL, false)] {
            let mut flight = Flight::held(Firmware::Px4);
            flight.control.hand_over(Mode::Land, &mut flight.bench.context());
            flight.answer(Purpose::Mode, MavResult::MAV_RESULT_UNSUPPORTED);
            flight.bench.state.mode = Some(Timed::new(mode, flight.bench.now));
            flight.bench.pass(SECOND);
            flight.advance();
            assert_eq!(flight.control.is_held(), held);
            assert!(matches!(flight.bench.events()[..], [Event::Refused { what: "AUTO.LAND", .. }]));
        }
    }

    #[test]
    fn spec_a_build_without_brake_is_asked_to_loiter_in_its_place() {
        let mut flight = Flight::held(Firmware::ArduPilot);
        flight.control.hand_over(Mode::Hold, &mut flight.bench.context());
        flight.answer(Purpose::Mode, MavResult::MAV_RESULT_UNSUPPORTED);
        _ = flight.bench.sent();
        flight.bench.pass(SECOND);
        flight.advance();
        assert!(matches!(flight.bench.events()[..], [Event::NotReady { what: "BRAKE", .. }]));
        let asked = flight.bench.sent();
        assert!(matches!(&asked[..], [mode] if mode.param2 == 5.0), "{asked:?}");
    }

    #[test]
    fn spec_a_climb_keeps_setpoints_from_arducopter_until_its_top() {
        for (firmware, meanwhile) in [(Firmware::Px4, true), (Firmware::ArduPilot, false)] {
            let mut flight = Flight::new(firmware);
            flight.take();
            flight.beat(Mode::Companion, true);
            flight.see(0.0, Landed::OnGround);
            assert_eq!(flight.control.footing(&flight.bench.state), Footing::Standing);
            flight.control.take_off(10.0, &mut flight.bench.context());
            let commanded = flight.bench.sent().iter().any(|c| c.command == MavCmd::MAV_CMD_NAV_TAKEOFF);
            assert_eq!(commanded, !meanwhile);
            _ = flight.bench.events();
            flight.see(5.0, Landed::InAir);
            assert_eq!(flight.lets_out(), meanwhile, "{firmware}");
            flight.see(9.6, Landed::InAir);
            assert!(flight.lets_out() && !flight.control.is_climbing());
            assert_eq!(flight.bench.events(), [Event::Airborne]);
        }
    }

    #[test]
    fn spec_thrust_is_sought_until_the_vehicle_leaves_the_ground() {
        let mut flight = Flight::new(Firmware::Px4);
        flight.bench.settings.actuation = Actuation::ThrustVector;
        flight.take();
        flight.beat(Mode::Companion, true);
        flight.see(0.0, Landed::OnGround);
        flight.control.take_off(10.0, &mut flight.bench.context());
        flight.control.note_lift_off(Enu::new(0.0, 0.0, 0.05), EnuVelocity::new(0.0, 0.0, 0.1));
        assert_eq!(flight.control.footing(&flight.bench.state), Footing::Lifting);
        flight.control.note_lift_off(Enu::new(0.0, 0.0, 0.05), EnuVelocity::new(0.0, 0.0, 0.3));
        assert_eq!(flight.control.footing(&flight.bench.state), Footing::Airborne);
    }

    #[test]
    fn spec_a_flight_ends_by_disarming_and_not_by_a_land_detector() {
        let mut flight = Flight::held(Firmware::Px4);
        flight.see(10.0, Landed::OnGround);
        assert_eq!(flight.control.footing(&flight.bench.state), Footing::Airborne);
        flight.beat(Mode::Companion, false);
        assert_eq!(flight.bench.events(), [Event::Disarmed]);
        assert!(!flight.control.is_flying(&flight.bench.state) && !flight.control.wants_setpoints());
    }

    #[test]
    fn spec_a_take_off_needs_control_a_place_and_a_height() {
        let mut flight = Flight::held(Firmware::Px4);
        let refused = |flight: &mut Flight, altitude_m: f64| {
            flight.control.take_off(altitude_m, &mut flight.bench.context());
            let Some(Event::Refused { statustext: Some(why), .. }) = flight.bench.events().pop() else {
                panic!("not refused")
            };
            assert!(!flight.control.is_climbing());
            why
        };
        assert!(refused(&mut flight, f64::NAN).contains("above zero"));
        assert!(refused(&mut flight, -1.0).contains("above zero"));
        flight.bench.state.position_enu_m = None;
        assert!(refused(&mut flight, 10.0).contains("position"));
        flight.beat(POSCTL, true);
        _ = flight.bench.events();
        assert!(refused(&mut flight, 10.0).contains("not in control"));
    }
}
