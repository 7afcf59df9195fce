//! The adapter itself: what comes in is given to the parts, what they have to say is queued.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavSeverity, MavState, MavType,
};

use super::bridge::Bridge;
use super::command::{CommandQueue, Purpose};
use super::control::{Control, Phase};
use super::discovery::Discovery;
use super::firmware::{Firmware, Mode};
use super::goal::Aim;
use super::guard::LandDetectorGuard;
use super::link::LinkWatch;
use super::parameter::Parameters;
use super::preflight;
use super::setpoint::Stream;
use super::settings::{Event, Setpoint, Settings};
use super::state::{Timed, VehicleState};
use super::statustext::{self, Assembly};
use super::streams::Streams;
use super::telemetry::Telemetry;
use super::{Address, Outbox};
use crate::preflight::Check;
use crate::time::{Instant, Utc};

/// How long an autopilot is asked to disarm.
const DISARM_TIMEOUT: Duration = Duration::from_secs(10);

/// The companion's side of the connection to one autopilot. See the module's documentation.
#[derive(Debug)]
pub struct Autopilot {
    pub(super) settings: Settings,
    pub(super) out: Outbox,
    /// The autopilot in use.
    pub(super) peer: Option<(Firmware, Address)>,
    discovery: Discovery,
    pub(super) link: LinkWatch,
    pub(super) telemetry: Telemetry,
    pub(super) commands: CommandQueue,
    pub(super) parameters: Parameters,
    pub(super) streams: Streams,
    pub(super) stream: Stream,
    pub(super) control: Control,
    pub(super) guard: LandDetectorGuard,
    /// Whether this flight has left the ground. It ends by disarming alone: a land detector may be mistaken.
    pub(super) flown: bool,
    pub(super) previous_mode: Option<Mode>,
    pub(super) bridge: Bridge,
    /// Thrust per unit along each body axis, from the autopilot's rotors.
    pub(super) rotor_scales: Option<[f64; 3]>,
    pub(super) last_text: Option<Timed<String>>,
    assembly: Assembly,
    text_id: u16,
}

impl Autopilot {
    /// An adapter that listens for its autopilot.
    #[must_use]
    pub fn new(settings: Settings, _now: Instant) -> Self {
        Self {
            out: Outbox::default(),
            peer: None,
            discovery: Discovery::new(settings.autopilot_system, settings.firmware),
            link: LinkWatch::new(settings.link_timeout),
            telemetry: Telemetry::new(settings.mission_origin, settings.position_jump_m),
            commands: CommandQueue::default(),
            parameters: Parameters::default(),
            streams: Streams::default(),
            stream: Stream::new(&settings),
            control: Control::new(),
            guard: LandDetectorGuard::default(),
            flown: false,
            previous_mode: None,
            bridge: Bridge::default(),
            rotor_scales: None,
            last_text: None,
            assembly: Assembly::default(),
            text_id: 0,
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
        let Some((firmware, address)) = self.peer.filter(|(_, address)| *address == sender) else { return };
        if self.telemetry.shows_restart(message) {
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
            MavMessage::COMMAND_ACK(m) => {
                if let Some((purpose, outcome)) = self.commands.handle_ack(m, self.settings.own, now) {
                    self.command_ended(purpose, outcome, now);
                } else {
                    self.offset_answered(m, now);
                }
            }
            MavMessage::PARAM_VALUE(m) => {
                self.parameters.handle_value(m, firmware);
                self.learn_rotors();
            }
            MavMessage::STATUSTEXT(m) => {
                if let Some(text) = self.assembly.handle(m) {
                    self.last_text = Some(Timed::new(text.clone(), now));
                    self.out.tell(Event::StatusText { severity: m.severity, text });
                }
            }
            _ => {
                self.telemetry.handle(message, now, &mut self.out);
                let state = &self.telemetry.state;
                self.flown |= state.is_armed() && state.is_airborne() == Some(true);
                self.check_climb();
            }
        }
        self.pump(firmware, address, now);
    }

    /// Does what is due at `now`.
    pub fn handle_timeout(&mut self, now: Instant) {
        if let Some(found) = self.discovery.advance(now) {
            self.adopt(found, now);
        }
        let Some((firmware, address)) = self.peer else { return };
        if self.link.advance(now, &mut self.out) {
            self.drop_control();
            self.commands.clear();
        }
        if !self.link.is_lost() {
            self.streams.advance(now, &mut self.commands);
            self.advance_goals(now);
            self.guard_land_detector(now);
            self.parameters.refresh(!self.telemetry.state.is_armed(), now);
        }
        self.pump(firmware, address, now);
    }

    /// The next message to send, addressed; the caller stamps our own (system, component).
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.messages.pop_front()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.out.events.pop_front()
    }

    /// When [`Self::handle_timeout`] is next to be called, and for what.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<(Instant, &'static str)> {
        let alive = |at: Option<Instant>| at.filter(|_| !self.link.is_lost());
        [
            (self.discovery.timeout(), "discovery"),
            (self.link.timeout(), "autopilot link"),
            (alive(self.commands.timeout()), "command"),
            (alive(self.parameters.timeout()), "parameter"),
            (alive(self.streams.timeout()), "telemetry"),
            (alive(self.control.timeout()), "control"),
        ]
        .into_iter()
        .filter_map(|(at, reason)| at.map(|at| (at, reason)))
        .min_by_key(|(at, _)| *at)
    }

    /// Takes the companion's mode: for PX4 once setpoints have streamed for a second, so keep setting them. Ends in
    /// [`Event::ControlTaken`] or [`Event::Refused`].
    pub fn take_control(&mut self, now: Instant) {
        self.start_taking(now);
        self.flush(now);
    }

    /// Arms, asking again while the autopilot is not ready. Ends in [`Event::Armed`] or [`Event::Refused`].
    pub fn arm(&mut self, now: Instant) {
        self.pursue(Aim::Arm, self.settings.readiness_timeout, now);
        self.flush(now);
    }

    /// Climbs to this altitude above home in metres; ends in [`Event::Airborne`] or [`Event::Refused`]. ArduCopter does
    /// it by itself, and setpoints are kept from it meanwhile. PX4 is flown up by the executive's setpoints; with
    /// [`Actuation::ThrustVector`](super::Actuation::ThrustVector) thrust rises first until the vehicle leaves the ground.
    pub fn take_off(&mut self, altitude_above_home_m: f64, now: Instant) {
        self.start_climb(altitude_above_home_m, now);
        self.flush(now);
    }

    /// Sets where the vehicle should be at `now`. It goes out at once, stamped with that instant, and once: what is not
    /// set again is not sent again (F3), so the caller's pace is the stream's.
    pub fn set_setpoint(&mut self, setpoint: Setpoint, now: Instant) {
        let Some((firmware, address)) = self.peer.filter(|_| !self.link.is_lost()) else { return };
        self.guard_land_detector(now);
        self.stream(&setpoint, firmware, address, now);
        self.pump(firmware, address, now);
    }

    /// Stops the setpoints and whatever else is pursued; the autopilot stays in its mode.
    pub fn release(&mut self, _now: Instant) {
        self.drop_control();
    }

    /// Lets the autopilot land. Ends in [`Event::HandedOver`] or [`Event::Refused`], as do the next two.
    pub fn land(&mut self, now: Instant) {
        self.start_handing_over(Mode::Land, now);
        self.flush(now);
    }

    /// Lets the autopilot return to its home and land.
    pub fn return_to_launch(&mut self, now: Instant) {
        self.start_handing_over(Mode::Return, now);
        self.flush(now);
    }

    /// Lets the autopilot hold its place.
    pub fn hold(&mut self, now: Instant) {
        self.start_handing_over(Mode::Hold, now);
        self.flush(now);
    }

    /// Disarms, never by force: an autopilot in the air refuses. Ends in [`Event::Disarmed`] or [`Event::Refused`].
    pub fn disarm(&mut self, now: Instant) {
        self.pursue(Aim::Disarm, DISARM_TIMEOUT, now);
        self.flush(now);
    }

    /// Says something to whoever listens, in chunks if it is long.
    pub fn statustext(&mut self, severity: MavSeverity, text: &str) {
        self.text_id = self.text_id.checked_add(1).unwrap_or(1);
        statustext::chunks(severity, text, self.text_id)
            .into_iter()
            .for_each(|message| self.out.send(message));
    }

    /// We speak as a component of this MAVLink system from now on.
    pub fn adopt_system(&mut self, system: u8) {
        self.settings.own.0 = system;
    }

    /// What is known of the vehicle.
    #[must_use]
    pub fn state(&self) -> &VehicleState {
        &self.telemetry.state
    }

    /// The settings in use.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// When the older of position and attitude was received; `None` while one is unknown or the link is lost.
    #[must_use]
    pub fn state_since(&self) -> Option<Instant> {
        let state = &self.telemetry.state;
        let (position, attitude) = (state.position_enu_m?, state.attitude?);
        (!self.link.is_lost()).then(|| position.received_at.min(attitude.received_at))
    }

    /// Time between two messages of position or attitude, whichever is longer, as granted and as they come.
    #[must_use]
    pub fn state_period(&self) -> Duration {
        self.streams.state_period().unwrap_or_else(|| self.settings.period())
    }

    /// Age of the older of position and attitude; `None` as above.
    #[must_use]
    pub fn state_age(&self, now: Instant) -> Option<Duration> {
        self.state_since().map(|since| now.saturating_since(since))
    }

    /// Whether position and attitude were received a moment ago and the link stands.
    #[must_use]
    pub fn fresh(&self, now: Instant) -> bool {
        self.state_age(now).is_some_and(|age| age <= self.settings.freshness)
    }

    /// Whether we took control and the last heartbeat shows the companion's mode, armed.
    #[must_use]
    pub fn in_control(&self) -> bool {
        let state = &self.telemetry.state;
        self.control.phase == Phase::Held && state.mode() == Some(Mode::Companion) && state.is_armed()
    }

    /// UTC by the autopilot's clock.
    #[must_use]
    pub fn utc(&self, now: Instant) -> Option<Utc> {
        self.telemetry.utc.utc(now)
    }

    /// How far [`Self::utc`] may be off, transport to the autopilot alone considered.
    #[must_use]
    pub fn utc_uncertainty(&self) -> Option<Duration> {
        self.telemetry.utc.uncertainty()
    }

    /// The thrust command that hovers, as learned so far (`thrust_vector`).
    #[must_use]
    pub fn hover_thrust(&self) -> f64 {
        self.stream.hover_thrust()
    }

    /// Everything that speaks for or against a flight, as far as the autopilot is concerned.
    #[must_use]
    pub fn preflight(&self, now: Instant) -> Vec<Check> {
        preflight::checks(self, self.discovery.candidates(), now)
    }

    fn adopt(&mut self, (address, firmware): (Address, Firmware), now: Instant) {
        self.peer = Some((firmware, address));
        self.telemetry.state.system = Some(address.0);
        self.telemetry.state.firmware = Some(firmware);
        self.out.tell(Event::Discovered { system: address.0, firmware });
        self.read_parameters(firmware);
        self.streams.start(firmware, self.settings.rate_hz, &mut self.commands, now);
        self.pump(firmware, address, now);
    }

    fn handle_restart(&mut self, firmware: Firmware, now: Instant) {
        self.drop_control();
        self.commands.clear();
        self.telemetry.forget();
        self.flown = false;
        self.previous_mode = None;
        self.out.tell(Event::Restarted);
        self.read_parameters(firmware);
        self.streams.start(firmware, self.settings.rate_hz, &mut self.commands, now);
    }

    fn read_parameters(&mut self, firmware: Firmware) {
        self.parameters.read(firmware.parameters());
        self.rotor_scales = None;
        self.learn_rotors();
        self.probe_bridge();
    }

    fn handle_heartbeat(&mut self, firmware: Firmware, heartbeat: &HEARTBEAT_DATA, now: Instant) {
        let armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        let mode = firmware.mode(heartbeat.custom_mode);
        let state = &mut self.telemetry.state;
        state.vehicle_type = Some(heartbeat.mavtype);
        state.mode = Some(Timed::new(mode, now));
        let was_armed = state.armed.replace(Timed::new(armed, now)).is_some_and(|armed| armed.value);
        self.handle_mode(mode, armed, was_armed, now);
    }

    fn command_ended(&mut self, purpose: Purpose, outcome: super::command::Outcome, now: Instant) {
        match purpose {
            Purpose::Interval(id) => self.streams.answered(id, outcome),
            Purpose::Bridge => self.bridge_probed(outcome),
            Purpose::Offsets => self.switch_answered(outcome, now),
            Purpose::Request(_) => {}
            Purpose::Mode | Purpose::Arming | Purpose::TakeOff => self.answered(purpose, outcome, now),
        }
    }

    /// Sends commands and parameters that are due.
    fn pump(&mut self, firmware: Firmware, address: Address, now: Instant) {
        if self.link.is_lost() {
            return;
        }
        for (purpose, outcome) in self.commands.advance(now, address, &mut self.out) {
            self.command_ended(purpose, outcome, now);
        }
        self.parameters.advance(now, firmware, address, &mut self.out);
    }

    fn flush(&mut self, now: Instant) {
        if let Some((firmware, address)) = self.peer {
            self.pump(firmware, address, now);
        }
    }
}

/// Our own HEARTBEAT: an onboard controller without an autopilot of its own. The executive sends it once a second,
/// with its true status (F3).
#[must_use]
pub fn heartbeat(status: MavState) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: status,
        mavlink_version: 3,
    })
}
