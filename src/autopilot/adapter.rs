//! The adapter itself: what comes in is given to the parts, what they have to say is queued.

mod known;

use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavMessage, MavModeFlag, MavSeverity, MavState};
use mavlink::{MavHeader, MessageData};

use super::command::{CommandQueue, Outcome, Purpose};
use super::context::Context;
use super::control::Control;
use super::discovery::Discovery;
use super::event::Event;
use super::fence::{self, Keeper};
use super::firmware::choice::Choice;
use super::firmware::specifics::Specifics;
use super::firmware::{Firmware, Mode, airframe};
use super::link::LinkWatch;
use super::outbox::{Address, Outbox};
use super::parameter::Parameters;
use super::position_control::Measured;
use super::pursuit::Aim;
use super::setpoint::{Setpoint, Stream, Surroundings};
use super::settings::{Actuation, Settings};
use super::stall::Stall;
use super::state::Timed;
use super::statustext::Texts;
use super::streams::{self, Streams};
use super::telemetry::Telemetry;
use crate::time::Instant;

/// The companion's side of the connection to one autopilot.
///
/// A state machine without I/O, clock or thread: it acts in its methods alone, each of which is handed the instant at
/// which it is called. These never go back. To drive it:
///
/// - Give every message of the link to [`handle_message`](Self::handle_message), from whomever it is.
/// - Call [`handle_timeout`](Self::handle_timeout) once the instant of [`poll_timeout`](Self::poll_timeout) has come, and
///   until that lies ahead. Too early does nothing; what was due is done late.
/// - Make requests ([`take_control`](Self::take_control), [`arm`](Self::arm), [`take_off`](Self::take_off),
///   [`land`](Self::land), [`return_to_launch`](Self::return_to_launch), [`hold`](Self::hold),
///   [`disarm`](Self::disarm)) when it suits. Each ends in one of the events that its documentation names, unless another
///   takes its place: of control, and of arming, one thing at a time is asked for. None is made again by itself.
/// - Call [`set_setpoint`](Self::set_setpoint) at [`Settings::rate_hz`], the only clock of the stream, from before
///   `take_control` until the vehicle is to be another's. Of what falls due at one instant, `handle_timeout` comes first.
/// - After any of these, drain [`poll_transmit`](Self::poll_transmit) and [`poll_event`](Self::poll_event) until both give
///   `None`, and only then ask [`poll_timeout`](Self::poll_timeout): each call may have changed all three.
///
/// Events are answered by requests, never by setpoints that go on: after [`Event::ControlLost`], [`Event::LinkLost`] and
/// [`Event::Restarted`] setpoints go nowhere until control has been taken again (F2). It has no end of its own; after
/// [`release`](Self::release), or at any time, it may be dropped, and the autopilot's own failsafe is left (F3).
#[derive(Debug, Clone)]
pub struct Autopilot {
    settings: Settings,
    out: Outbox,
    discovery: Discovery,
    peer: Option<Peer>,
    link: LinkWatch,
    telemetry: Telemetry,
    streams: Streams,
    commands: CommandQueue,
    parameters: Parameters,
    texts: Texts,
    fence: Keeper,
    control: Control,
    stream: Stream,
    stall: Stall,
}

/// The autopilot in use.
#[derive(Debug, Clone)]
struct Peer {
    firmware: Firmware,
    address: Address,
    specifics: Specifics,
    /// What [`Actuation::Auto`] has come to.
    chosen: Option<Choice>,
}

impl Autopilot {
    /// An adapter that listens for its autopilot.
    #[must_use]
    pub fn new(settings: Settings, _now: Instant) -> Self {
        Self {
            out: Outbox::default(),
            discovery: Discovery::new(settings.autopilot_system, settings.firmware),
            peer: None,
            link: LinkWatch::new(settings.link_timeout),
            telemetry: Telemetry::new(settings.mission_origin, settings.position_jump_m),
            streams: Streams::default(),
            commands: CommandQueue::default(),
            parameters: Parameters::default(),
            texts: Texts::default(),
            fence: Keeper::new(settings.fence.clone(), settings.mission_origin),
            control: Control::new(),
            stream: Stream::new(&settings),
            stall: Stall::default(),
            settings,
        }
    }

    /// Takes a message from the link, from whomever it is; what is not our autopilot's is ignored.
    pub fn handle_message(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        let Ok(system) = u8::try_from(header.system_id) else { return };
        let sender = (system, header.component_id);
        if let MavMessage::HEARTBEAT(heartbeat) = message
            && let Some(found) = self.discovery.handle_heartbeat(sender, heartbeat, now, &mut self.out)
        {
            self.adopt(found, now);
        }
        let peer = self.peer.as_ref().filter(|peer| peer.address == sender);
        let Some(firmware) = peer.map(|peer| peer.firmware) else { return };
        if self.telemetry.shows_restart(message, now) {
            self.handle_restart(firmware, now);
        }
        let is_stream =
            matches!(message, MavMessage::LOCAL_POSITION_NED(_) | MavMessage::ATTITUDE_QUATERNION(_));
        let is_heartbeat = matches!(message, MavMessage::HEARTBEAT(_));
        if self.link.heard(is_heartbeat, is_stream, now, &mut self.out) {
            self.streams.start(firmware, self.settings.rate_hz, &mut self.commands, now);
        }
        self.streams.heard(message);
        match message {
            MavMessage::HEARTBEAT(m) => self.handle_heartbeat(firmware, m, now),
            MavMessage::COMMAND_ACK(m) => match self.commands.handle_ack(m, self.settings.own, now) {
                Some((purpose, outcome)) => self.command_ended(purpose, outcome, now),
                None => self.hand(now, |_, specifics, context| specifics.acknowledged(m, context)),
            },
            MavMessage::PARAM_VALUE(m) => {
                self.parameters.handle_value(m, firmware.integer_form());
                self.learn_scales();
                self.choose_actuation(now);
            }
            MavMessage::STATUSTEXT(m) => self.texts.handle(m, now, &mut self.out),
            _ if fence::is_of_a_list(message) => {
                self.fence.handle(message, &self.telemetry.state, now, &mut self.out);
                self.advance_fence(now);
            }
            _ => {
                self.telemetry.handle(message, now, &mut self.out);
                self.hand(now, |control, _, context| control.handle_telemetry(context));
            }
        }
        self.pump(now);
    }

    /// Does what is due at `now`.
    pub fn handle_timeout(&mut self, now: Instant) {
        if let Some(found) = self.discovery.advance(now) {
            self.adopt(found, now);
        }
        if self.link.advance(now, &mut self.out) {
            self.control.drop(&mut self.commands);
            self.commands.clear();
        }
        if self.peer.is_some() && !self.link.is_lost() {
            self.streams.advance(now, &mut self.commands);
            self.telemetry.advance(now, &mut self.out);
            self.ask_time(now);
            let streamed_for = self.stream.streamed_for(now);
            self.hand(now, |control, _, context| control.advance(streamed_for, context));
            self.advance_specifics(now);
            self.parameters.refresh(!self.telemetry.state.is_armed(), now);
            self.advance_fence(now);
        }
        self.pump(now);
    }

    /// The next message to send, addressed; the caller stamps our own (system, component).
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.next_message()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.out.next_event()
    }

    /// When [`Self::handle_timeout`] is next to be called, and for what; `None` while nothing is waited for.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<(Instant, &'static str)> {
        let alive = |at: Option<Instant>| at.filter(|_| !self.link.is_lost());
        [
            (self.discovery.timeout(), "discovery"),
            (self.link.timeout(), "autopilot link"),
            (alive(self.commands.timeout()), "command"),
            (alive(self.parameters.timeout()), "parameter"),
            (alive(self.streams.timeout()), "telemetry"),
            (alive(self.peer.as_ref().map(|_| self.telemetry.clock.timeout())), "autopilot's clock"),
            (alive(self.telemetry.timeout()), "GPS receiver"),
            (alive(self.control.timeout()), "control"),
            (alive(self.peer.as_ref().and_then(|_| self.fence.timeout(self.state()))), "fence"),
        ]
        .into_iter()
        .filter_map(|(at, reason)| at.map(|at| (at, reason)))
        .min_by_key(|(at, _)| *at)
    }

    /// Takes the companion's mode: for PX4 once setpoints have streamed for a second, so keep setting them. Ends in
    /// [`Event::ControlTaken`] or [`Event::Refused`].
    pub fn take_control(&mut self, now: Instant) {
        let streamed_for = self.stream.streamed_for(now);
        self.request(Aim::Mode(Mode::Companion), now, |control, _, context| {
            control.take(streamed_for, context);
        });
    }

    /// Arms, asking again while the autopilot is not ready. Ends in [`Event::Armed`] or [`Event::Refused`].
    pub fn arm(&mut self, now: Instant) {
        self.request(Aim::Arm, now, |control, _, context| control.arm(context));
    }

    /// Climbs to this altitude above home in metres; ends in [`Event::Airborne`] or [`Event::Refused`]. ArduCopter does
    /// it by itself, and setpoints are kept from it meanwhile. PX4 is flown up by the executive's setpoints; with
    /// [`Actuation::ThrustVector`](super::Actuation::ThrustVector) thrust rises first until the vehicle leaves the ground.
    pub fn take_off(&mut self, altitude_above_home_m: f64, now: Instant) {
        self.request(Aim::TakeOff { altitude_m: altitude_above_home_m }, now, |control, _, context| {
            control.take_off(altitude_above_home_m, context);
        });
    }

    /// Sets where the vehicle should be at `now`. It goes out at once, stamped with that instant, and once: what is not
    /// set again is not sent again (F3), so the caller's pace is the stream's.
    pub fn set_setpoint(&mut self, setpoint: Setpoint, now: Instant) {
        if self.link.is_lost() {
            return;
        }
        if !self.stall.allows(self.control.is_held(), self.link.silent_for(now), now) {
            if self.stall.asks(now) {
                let id = HEARTBEAT_DATA::ID;
                self.commands.push_ahead(streams::request(id), Purpose::Request(id));
                self.pump(now);
            }
            return;
        }
        self.advance_specifics(now);
        if let Some((position_enu_m, velocity_enu_m_s)) = self.telemetry.motion() {
            self.control.note_lift_off(position_enu_m, velocity_enu_m_s);
        }
        let around = self.surroundings(now);
        let sent = self.stream.set(&setpoint, around.as_ref(), now, &mut self.out);
        if sent.is_some() || !self.lets_out_setpoints() {
            self.stall.sent(now);
        }
        if let Some(commanded) = sent {
            self.hand(now, |control, specifics, context| {
                specifics.drive(commanded, control.is_held(), context);
            });
        }
        self.pump(now);
    }

    /// Whether the vehicle is told to be turned as [`set_setpoint`](Self::set_setpoint) asked last: the tilt rate has caught up, and
    /// nothing keeps it level.
    #[must_use]
    pub fn commands_as_asked(&self) -> bool {
        self.stream.commands_as_asked()
    }

    /// Stops the setpoints and whatever else is pursued; the autopilot stays in its mode.
    pub fn release(&mut self, now: Instant) {
        self.control.drop(&mut self.commands);
        self.end_unwanted_stream(now);
    }

    /// Lets the autopilot land. Ends in [`Event::HandedOver`] or [`Event::Refused`], as do the next two.
    pub fn land(&mut self, now: Instant) {
        self.hand_over(Mode::Land, now);
    }

    /// Lets the autopilot return to its home and land.
    pub fn return_to_launch(&mut self, now: Instant) {
        self.hand_over(Mode::Return, now);
    }

    /// Lets the autopilot hold its place.
    pub fn hold(&mut self, now: Instant) {
        self.hand_over(Mode::Hold, now);
    }

    /// Disarms, never by force: an autopilot in the air refuses. Ends in [`Event::Disarmed`] or [`Event::Refused`].
    pub fn disarm(&mut self, now: Instant) {
        self.request(Aim::Disarm, now, |control, _, context| control.disarm(context));
    }

    /// Says something to whoever listens, in chunks if it is long.
    pub fn statustext(&mut self, severity: MavSeverity, text: &str) {
        self.texts.say(severity, text, &mut self.out);
    }

    /// We speak as a component of this MAVLink system from now on.
    pub fn adopt_system(&mut self, system: u8) {
        self.settings.own.0 = system;
    }

    fn adopt(&mut self, (address, firmware): (Address, Firmware), now: Instant) {
        let specifics = Specifics::new(firmware, &self.settings);
        self.peer = Some(Peer { firmware, address, specifics, chosen: None });
        self.telemetry.state.system = Some(address.0);
        self.telemetry.state.firmware = Some(firmware);
        self.out.tell(Event::Discovered { system: address.0, firmware });
        self.begin(firmware, now);
        self.pump(now);
    }

    fn handle_restart(&mut self, firmware: Firmware, now: Instant) {
        // It may have been restarted for another airframe.
        if let Some(peer) = &mut self.peer
            && peer.chosen.take().is_some()
        {
            self.settings.actuation = Actuation::Auto;
        }
        self.control.forget(&mut self.commands);
        self.commands.clear();
        self.telemetry.forget();
        self.out.tell(Event::Restarted);
        self.begin(firmware, now);
    }

    /// Asks an autopilot of which nothing is known for all that is needed.
    fn begin(&mut self, firmware: Firmware, now: Instant) {
        self.parameters.read(firmware.parameters());
        self.fence.forget();
        self.hand(now, |_, specifics, context| specifics.begin(context));
        self.streams.start(firmware, self.settings.rate_hz, &mut self.commands, now);
    }

    fn handle_heartbeat(&mut self, firmware: Firmware, heartbeat: &HEARTBEAT_DATA, now: Instant) {
        let armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        let mode = firmware.mode(heartbeat.custom_mode);
        let state = &mut self.telemetry.state;
        state.vehicle_type = Some(heartbeat.mavtype);
        state.mode = Some(Timed::new(mode, now));
        state.in_failsafe =
            matches!(heartbeat.system_status, MavState::MAV_STATE_CRITICAL | MavState::MAV_STATE_EMERGENCY);
        let was_armed = state.armed.replace(Timed::new(armed, now)).is_some_and(|armed| armed.value);
        if mode == Mode::Companion {
            self.stall.shown(now);
        }
        self.hand(now, |control, _, context| control.handle_heartbeat(mode, was_armed, context));
    }

    fn command_ended(&mut self, purpose: Purpose, outcome: Outcome, now: Instant) {
        match purpose {
            Purpose::Interval(id) => self.streams.answered(id, outcome),
            Purpose::Request(_) => {}
            Purpose::Bridge | Purpose::Offsets => {
                self.hand(now, |_, specifics, context| specifics.answered(purpose, outcome, context));
            }
            Purpose::Mode | Purpose::Arming | Purpose::TakeOff => {
                self.control.answered(purpose, outcome, now);
            }
        }
    }

    fn ask_time(&mut self, now: Instant) {
        if let Some(peer) = &self.peer
            && let Some(question) = self.telemetry.clock.ask(peer.address, now)
        {
            self.out.send(question);
        }
    }

    fn advance_fence(&mut self, now: Instant) {
        if let Some(peer) = &self.peer {
            let ends = (self.settings.own, peer.address);
            self.fence.advance(&self.telemetry.state, ends, now, &mut self.out);
        }
    }

    fn learn_scales(&mut self) {
        let specifics = self.peer.as_mut().map(|peer| &mut peer.specifics);
        if let Some(scales) = specifics.and_then(|s| s.parameter_heard(&mut self.parameters)) {
            self.stream.learn_scales(scales);
        }
    }

    /// Whether the actuation is the airframe's to say.
    fn chooses_actuation(&self) -> bool {
        self.settings.actuation == Actuation::Auto
            || self.peer.as_ref().is_some_and(|peer| peer.chosen.is_some())
    }

    /// [`Actuation::Auto`] gives way to what the airframe asks for, once its parameters say so.
    fn choose_actuation(&mut self, now: Instant) {
        if self.settings.actuation != Actuation::Auto {
            return;
        }
        let Some(peer) = &mut self.peer else { return };
        let Some(Ok(choice)) = airframe::choose(peer.firmware, &self.parameters) else { return };
        self.settings.actuation = choice.actuation;
        self.stream.choose(choice.actuation);
        peer.chosen = Some(choice);
        self.hand(now, |_, specifics, context| specifics.choose(context));
    }

    fn advance_specifics(&mut self, now: Instant) {
        let (fresh, in_control) = (self.fresh(now), self.in_control());
        self.hand(now, |control, specifics, context| {
            let in_flight = in_control && !control.is_climbing() && control.is_flying(context.state);
            specifics.advance(in_flight, fresh, context);
        });
    }

    /// Whether who flies lets setpoints out.
    fn lets_out_setpoints(&self) -> bool {
        let state = &self.telemetry.state;
        self.peer.as_ref().is_some_and(|peer| self.control.lets_out_setpoints(peer.firmware, state))
    }

    /// What a setpoint is built on; `None` while none may go out.
    fn surroundings(&self, now: Instant) -> Option<Surroundings> {
        let Peer { firmware, address, specifics, .. } = self.peer.as_ref()?;
        let state = &self.telemetry.state;
        let known = match self.settings.actuation {
            // The preflight refuses it for a firmware that takes no attitude targets; one ends a 6DoF ArduCopter.
            Actuation::ThrustVector => firmware.takes_attitude_targets(),
            Actuation::Auto => false,
            // The autopilot closes the loop, over what it knows itself.
            Actuation::Pose | Actuation::Position => self.hears_state(now),
        };
        if !known || !self.lets_out_setpoints() {
            return None;
        }
        let (position_enu_m, velocity_enu_m_s) = self.telemetry.motion()?;
        let measured = Measured {
            position_enu_m,
            velocity_enu_m_s,
            attitude: state.attitude?.value,
            age_s: self.state_age(now).unwrap_or_default().as_secs_f64(),
        };
        // We close the loop of a thrust vector: over what is too old, or does not come, it would be a guess.
        let closes_loop = self.settings.actuation == Actuation::ThrustVector;
        Some(Surroundings {
            target: *address,
            takes_attitude_targets: firmware.takes_attitude_targets(),
            frame: self.telemetry.frame()?,
            measured: (!closes_loop || self.fresh(now)).then_some(measured),
            footing: self.control.footing(state),
            may_tilt: specifics.allows_tilt(&self.parameters),
        })
    }

    fn hand_over(&mut self, to: Mode, now: Instant) {
        self.request(Aim::Mode(to), now, |control, specifics, context| {
            specifics.level(context.commands);
            control.hand_over(to, context);
        });
    }

    /// Makes a request of an autopilot that can hear it.
    fn request(
        &mut self,
        aim: Aim,
        now: Instant,
        make: impl FnOnce(&mut Control, &mut Specifics, &mut Context),
    ) {
        let firmware = self.peer.as_ref().map(|peer| peer.firmware);
        if firmware.is_none() {
            self.out.tell(aim.refused(firmware, "no autopilot on the link"));
        } else if self.link.is_lost() {
            self.out.tell(aim.refused(firmware, "the autopilot's link is lost"));
        } else {
            self.hand(now, make);
            self.pump(now);
        }
    }

    /// Hands something to control and to the firmware's own parts, if there is an autopilot.
    fn hand(&mut self, now: Instant, input: impl FnOnce(&mut Control, &mut Specifics, &mut Context)) {
        let Some(Peer { firmware, address, specifics, .. }) = &mut self.peer else { return };
        let mut context = Context {
            now,
            firmware: *firmware,
            target: *address,
            settings: &self.settings,
            state: &self.telemetry.state,
            last_text: self.texts.last(),
            commands: &mut self.commands,
            parameters: &mut self.parameters,
            out: &mut self.out,
        };
        input(&mut self.control, specifics, &mut context);
    }

    /// Nothing of a stream outlives the phase that it belongs to.
    fn end_unwanted_stream(&mut self, now: Instant) {
        if !self.control.wants_setpoints() {
            self.stream.stop();
            self.stall.ends();
            self.hand(now, |_, specifics, context| specifics.released(context.commands));
        }
    }

    /// Sends commands and parameters that are due.
    fn pump(&mut self, now: Instant) {
        self.end_unwanted_stream(now);
        if self.link.is_lost() {
            return;
        }
        let Some((firmware, address)) = self.peer.as_ref().map(|peer| (peer.firmware, peer.address)) else {
            return;
        };
        for (purpose, outcome) in self.commands.advance(now, address, &mut self.out) {
            self.command_ended(purpose, outcome, now);
        }
        self.parameters.advance(now, firmware.integer_form(), address, &mut self.out);
    }
}
