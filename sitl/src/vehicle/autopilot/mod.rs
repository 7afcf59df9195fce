//! The MAVLink face of an autopilot, with the manners of PX4 or ArduCopter.
//!
//! Frames end here: setpoints are turned into the mission's ENU as they come in, telemetry into the vehicle's own
//! NED as it goes out.
//!
//! Traps of the real firmwares that it has, each shown by a test: OFFBOARD is acknowledged while disarmed, arming in it
//! needs a proven stream; a lost stream falls back by COM_OBL_RC_ACT, and resuming it takes the vehicle back unasked;
//! FD_FAIL_R/P end a tilted flight; integers ride bytewise (PX4). Setpoints before GUIDED and before the take-off are
//! ignored; one ignored axis drops its group; targets are shaped by acceleration and jerk, go on with their velocity until
//! GUID_TIMEOUT, and the position is then kept for ever in silence, while the attitude levels (ArduCopter). Unknown
//! parameters get silence from both.
//!
//! Its SET_ATTITUDE_TARGET turns the body apart from its position, and its thrust fields are ignored: the `pose` kind
//! of actuation.

// Ground stations still speak the superseded SET_MODE, PING and frame names, so an autopilot must understand them.
#![allow(deprecated)]

mod answers;
mod arducopter;
mod commands;
mod enclosure;
mod failsafe;
mod files;
mod flight;
mod land;
mod modes;
mod offboard;
mod parameter_protocol;
mod plans;
mod reposition;
mod script;
mod shaper;
pub mod slip;
mod streams;
mod telemetry;
mod traces;
mod tuning;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use nalgebra::{UnitQuaternion, Vector3};

use super::COMPANION_LINK;
use super::airframe::Airframe;
use super::config::{Firmware, Role, Traps, VehicleConfig};
use super::dynamics::GRAVITY_M_S2;
use super::parameters::Parameters;
use super::rotors::Allocator;
use super::router::{Router, Sender, To};
use crate::frames::heading_rad;
use crate::geodesy::{LocalFrame, Origin, Projection};

pub(crate) use flight::Guidance;
pub(crate) use modes::Mode;
pub use offboard::SetpointCounters;
pub(crate) use traces::{Shown, Taken, Traces};

/// The autopilot's component id (MAV_COMP_ID_AUTOPILOT1).
pub const COMPONENT: u8 = 1;
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(1);
/// From a restart to the first word.
const BOOT_TIME: Duration = Duration::from_secs(3);
/// From disarming to the mode that PX4 goes back to, as seen on the real program.
const MODE_RETURNS_AFTER: Duration = Duration::from_secs(1);

/// What the autopilot's estimator says at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sensed {
    pub now: Duration,
    pub position_enu_m: Vector3<f64>,
    pub velocity_enu_m_s: Vector3<f64>,
    /// Body FLU to ENU, jitter included: what is reported.
    pub attitude: UnitQuaternion<f64>,
    /// Without the jitter: what is controlled.
    pub nominal: UnitQuaternion<f64>,
    pub rates_flu_rad_s: Vector3<f64>,
    /// The landing gear carries weight.
    pub contact: bool,
    /// 0 to 1.
    pub battery: f64,
}

/// One autopilot.
#[derive(Debug, Clone)]
pub(crate) struct Autopilot {
    system_id: u8,
    firmware: Firmware,
    traps: Traps,
    slip: Option<slip::Slip>,
    airframe: Airframe,
    frame: LocalFrame,
    utc_start_us: u64,
    /// By how much the clock runs too fast, of 1, and since when.
    drifts: Option<(f64, Duration)>,
    booted_at: Duration,
    /// Still booting: neither hears nor speaks.
    silent_until: Duration,
    ready_after: Duration,
    pub parameters: Parameters,
    tuning: tuning::Tuning,
    plans: plans::Plans,
    enclosure: enclosure::Enclosure,
    offboard: offboard::Offboard,
    script: script::Script,
    /// ArduCopter: the target of its own that follows the companion's.
    shaper: Option<shaper::Shaper>,

    pub mode: Mode,
    pub armed: bool,
    /// The last mode asked for in which it can be armed.
    armable: Mode,
    /// PX4: the mode to go back to after disarming, and when.
    returns_to: Option<(Mode, Duration)>,
    /// As the autopilot believes.
    pub landed: bool,
    /// As it is.
    pub grounded: bool,
    /// OFFBOARD was lost to a silent stream and nobody has chosen another mode since: PX4 goes back by itself.
    resumes: bool,
    /// A failsafe chose the present mode.
    failsafe: bool,
    flight: flight::Flight,
    ground: land::Ground,
    home_enu_m: Vector3<f64>,
    /// Where the present return goes: home, or the rally point.
    return_enu_m: Vector3<f64>,
    pub estimator_ok: bool,
    pub gps_ok: bool,
    estimator_lost_at: Option<Duration>,
    /// The battery's state that has been acted on.
    charge: failsafe::Charge,
    /// The last heartbeat of a ground station.
    ground_station_at: Option<Duration>,
    /// Thrust, in the allocator's units, that carries the vehicle's weight.
    hover_thrust: f64,
    /// A mode was acknowledged and not taken.
    mode_forgotten: bool,
    traces: Traces,

    streams: BTreeMap<usize, streams::Streams>,
    parameter_queue: VecDeque<(usize, usize)>,
    next_heartbeat: Duration,
    sensed: Option<Sensed>,
}

impl Autopilot {
    pub fn new(config: &VehicleConfig, mission: Origin, utc_start_us: u64) -> Self {
        let mut parameters = Parameters::of_firmware(config.firmware);
        for name in ["MAV_SYS_ID", "SYSID_THISMAV"] {
            parameters.set(name, super::parameters::Value::Int(config.system_id.into()));
        }
        if config.firmware == Firmware::Px4 {
            parameters.describe_rotors(&config.rotors());
            if config.traps.simulated_battery {
                parameters.describe_simulated_battery();
            }
        }
        // The two of a pair return at altitudes of their own.
        if config.role == Role::J {
            parameters.set("RTL_RETURN_ALT", super::parameters::Value::Real(60.0));
            parameters.set("RTL_ALT", super::parameters::Value::Int(6000));
        }
        for name in ["GF_MAX_VER_DIST", "FENCE_ALT_MAX"] {
            parameters.set(name, super::parameters::Value::Real(config.flies_below_m as f32));
        }
        let origin = config.home() + Vector3::from(config.local_origin_offset_enu_m);
        Self {
            system_id: config.system_id,
            firmware: config.firmware,
            traps: config.traps,
            slip: config.slip,
            airframe: config.airframe,
            frame: local_frame(mission, origin, config.firmware),
            utc_start_us,
            drifts: None,
            booted_at: Duration::ZERO,
            silent_until: Duration::ZERO,
            ready_after: Duration::try_from_secs_f64(config.ready_after_s).unwrap_or_default(),
            tuning: tuning::Tuning::of(&parameters, config.firmware),
            parameters,
            plans: plans::Plans::default(),
            enclosure: enclosure::Enclosure::default(),
            offboard: offboard::Offboard::default(),
            script: script::Script::default(),
            shaper: None,
            mode: match config.firmware {
                Firmware::Px4 => Mode::Hold,
                Firmware::ArduCopter => Mode::Stabilize,
            },
            armed: false,
            armable: Mode::Hold,
            returns_to: None,
            landed: true,
            grounded: true,
            resumes: false,
            failsafe: false,
            flight: flight::Flight::at(config.home(), config.heading_rad),
            ground: land::Ground::standing(),
            home_enu_m: config.home(),
            return_enu_m: config.home(),
            estimator_ok: true,
            gps_ok: true,
            estimator_lost_at: None,
            charge: failsafe::Charge::default(),
            ground_station_at: None,
            hover_thrust: hover_thrust(config),
            mode_forgotten: false,
            traces: Traces::default(),
            streams: BTreeMap::new(),
            parameter_queue: VecDeque::new(),
            next_heartbeat: Duration::ZERO,
            sensed: None,
        }
    }

    pub fn setpoint_counters(&self) -> SetpointCounters {
        self.offboard.counters
    }

    /// Time since power-on, or since the last restart.
    pub(super) fn uptime(&self, now: Duration) -> Duration {
        now.saturating_sub(self.booted_at)
    }

    /// Starts where another autopilot's program has ended, with its parameters: a restart in mid-flight or not.
    pub fn boot(&mut self, before: &Self, mission: Origin, sensed: &Sensed) {
        self.parameters = before.parameters.clone();
        self.plans = before.plans.kept();
        self.tuning = tuning::Tuning::of(&self.parameters, self.firmware);
        self.booted_at = sensed.now;
        self.silent_until = sensed.now + BOOT_TIME;
        self.next_heartbeat = self.silent_until;
        // A new estimator begins where it is.
        self.frame = local_frame(mission, sensed.position_enu_m, self.firmware);
        (self.home_enu_m, self.return_enu_m) = (before.home_enu_m, before.home_enu_m);
        self.traces = before.traces;
        self.traces.changes(before.mode, self.mode, sensed.now);
        (self.grounded, self.landed) = (sensed.contact, sensed.contact);
    }

    /// The clock is set: what it says jumps.
    pub fn jump_clock(&mut self, by_s: f64) {
        let by_us = (by_s * 1e6) as i64;
        self.utc_start_us = self.utc_start_us.saturating_add_signed(by_us);
    }

    /// The clock runs fast or slow from now on.
    pub fn let_clock_drift(&mut self, ppm: f64, now: Duration) {
        let shows_us = self.utc_us(now);
        self.drifts = Some((ppm * 1e-6, now));
        self.utc_start_us = shows_us.saturating_sub(now.as_micros() as u64);
    }

    /// What the clock shows.
    fn utc_us(&self, now: Duration) -> u64 {
        let gained_us =
            self.drifts.map_or(0.0, |(rate, since)| now.saturating_sub(since).as_secs_f64() * rate * 1e6);
        (self.utc_start_us + now.as_micros() as u64).saturating_add_signed(gained_us as i64)
    }

    /// When the clock shows this, if it goes on as it does; not before the simulation begins.
    pub fn time_of(&self, utc_us: u64, now: Duration) -> Duration {
        let shows_us = self.utc_us(now);
        let ahead = Duration::from_micros(utc_us.saturating_sub(shows_us));
        (now + ahead).saturating_sub(Duration::from_micros(shows_us.saturating_sub(utc_us)))
    }

    /// Why the vehicle cannot arm, if it cannot.
    fn unready(&self, now: Duration) -> Option<&'static str> {
        if self.uptime(now) < self.ready_after {
            Some("Preflight Fail: estimator not ready")
        } else if !self.estimator_ok {
            Some("Preflight Fail: no valid position estimate")
        } else {
            None
        }
    }

    /// Takes what a client sent to this component.
    pub fn handle(&mut self, from: Sender, message: MavMessage, now: Duration, router: &mut Router) {
        if now < self.silent_until {
            return;
        }
        self.traces.listen_to(from.link == COMPANION_LINK);
        self.traces.heard(&message, now);
        self.take(from, message, now, router);
        self.traces.listen_to(false);
    }

    fn take(&mut self, from: Sender, message: MavMessage, now: Duration, router: &mut Router) {
        match message {
            MavMessage::COMMAND_LONG(_) | MavMessage::COMMAND_INT(_) | MavMessage::SET_MODE(_) => {
                self.handle_command(from, &message, now, router);
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)
            | MavMessage::SET_POSITION_TARGET_GLOBAL_INT(_)
            | MavMessage::SET_ATTITUDE_TARGET(_) => {
                let message = match self.slip {
                    Some(slip) => slip.plant(message),
                    None => message,
                };
                self.handle_setpoint(&message, now, router);
            }
            MavMessage::HEARTBEAT(h) if h.mavtype == MavType::MAV_TYPE_GCS => {
                self.ground_station_at = Some(now)
            }
            MavMessage::PARAM_REQUEST_LIST(_) => {
                self.parameter_queue.extend((0..self.parameters.len()).map(|k| (from.link, k)));
            }
            MavMessage::REQUEST_DATA_STREAM(m) => self.request_data_stream(from.link, &m, now),
            MavMessage::PARAM_REQUEST_READ(m) => self.read_parameter(from, &m, router),
            MavMessage::PARAM_SET(m) => self.set_parameter(&m, router),
            MavMessage::FILE_TRANSFER_PROTOCOL(m) => self.file_request(from, &m, router),
            MavMessage::SETUP_SIGNING(m) => self.set_up_signing(&m, router),
            plan if plans::is_one(&plan) => self.handle_plan(from, &plan, now, router),
            question => self.answer(from, question, now, router),
        }
    }

    fn handle_setpoint(&mut self, message: &MavMessage, now: Duration, router: &mut Router) {
        if !self.takes_setpoints() {
            return;
        }
        match message {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => {
                self.offboard.local(m, (self.firmware, &self.traps), &self.frame, now);
            }
            MavMessage::SET_POSITION_TARGET_GLOBAL_INT(m) => {
                let home_alt_m = self.frame.geodetic(self.home_enu_m).alt_amsl_m;
                self.offboard.global(m, (self.firmware, &self.traps), &self.frame, home_alt_m, now);
            }
            MavMessage::SET_ATTITUDE_TARGET(m) if !self.take_angle(m, now, router) => {
                self.offboard.attitude(m, (self.firmware, &self.traps), &self.frame, now);
            }
            _ => {}
        }
    }

    /// ArduCopter ignores setpoints outside GUIDED and before its take-off; PX4 lets any stream prove itself.
    fn takes_setpoints(&mut self) -> bool {
        let takes = match self.firmware {
            Firmware::Px4 => true,
            Firmware::ArduCopter if !self.traps.guided_first => true,
            Firmware::ArduCopter => {
                self.mode == Mode::Companion && self.armed && !self.landed && !self.flight.taking_off()
            }
        };
        self.offboard.counters.not_in_control += u64::from(!takes);
        takes
    }

    /// The old way to ask for telemetry. PX4 does not listen to it.
    fn request_data_stream(&mut self, link: usize, m: &REQUEST_DATA_STREAM_DATA, now: Duration) {
        if self.firmware == Firmware::ArduCopter {
            let streams = self.streams(link, now);
            streams.set_group(m.req_stream_id as u8, m.start_stop == 1, m.req_message_rate, now);
        }
    }

    /// A link's streams; a new link has the firmware's own.
    fn streams(&mut self, link: usize, now: Duration) -> &mut streams::Streams {
        let begun = || streams::Streams::new(self.firmware, &self.traps, now);
        self.streams.entry(link).or_insert_with(begun)
    }

    fn text(&self, severity: MavSeverity, text: &str, router: &mut Router) {
        router.text(COMPONENT, severity, text);
    }

    /// One step: telemetry, failsafes, and what the vehicle shall do.
    pub fn tick(&mut self, sensed: &Sensed, router: &mut Router) -> Guidance {
        let sensed = &Sensed { battery: self.reported_charge(sensed), ..*sensed };
        self.sensed = Some(*sensed);
        if sensed.now < self.silent_until {
            return Guidance::Off;
        }
        if self.tuning.revision != self.parameters.revision {
            self.tuning = tuning::Tuning::of(&self.parameters, self.firmware);
        }
        self.tell(sensed, router);
        self.watch_land(sensed, router);
        self.watch_disarmed(sensed);
        self.watch(sensed, router);
        self.watch_plans(sensed.now, router);
        let guidance = self.guide(sensed, router);
        self.tilted_by_the_dead(guidance, sensed)
    }

    /// The charge as it is told, of 1: the battery's, or that which PX4 makes up in simulation.
    fn reported_charge(&self, sensed: &Sensed) -> f64 {
        let made_up = self.firmware == Firmware::Px4 && self.traps.simulated_battery;
        match (made_up, self.armed) {
            (false, _) => sensed.battery,
            (true, false) => 1.0,
            (true, true) => {
                let armed_s = sensed.now.saturating_sub(self.ground.armed_at).as_secs_f64();
                let left = 1.0 - armed_s / f64::from(self.parameters.real("SIM_BAT_DRAIN"));
                left.max(f64::from(self.parameters.real("SIM_BAT_MIN_PCT")) / 100.0)
            }
        }
    }

    /// PX4, disarmed, goes back to a mode that it can be armed in.
    fn watch_disarmed(&mut self, sensed: &Sensed) {
        if let Some((mode, _)) = self.returns_to.take_if(|(_, at)| *at <= sensed.now) {
            self.mode = mode;
            self.flight.hold_here(sensed.position_enu_m, heading_rad(&sensed.nominal));
        }
    }

    /// ArduCopter takes no key while it is armed, and says so.
    fn set_up_signing(&self, m: &SETUP_SIGNING_DATA, router: &mut Router) {
        if self.firmware == Firmware::ArduCopter && self.traps.signing_refused_while_armed && self.armed {
            return self.text(
                MavSeverity::MAV_SEVERITY_CRITICAL,
                "ERROR: Won't setup signing when armed",
                router,
            );
        }
        router.signing().set_up(m);
    }

    fn tell(&mut self, sensed: &Sensed, router: &mut Router) {
        router.signing().set_utc(self.utc_us(sensed.now));
        if sensed.now >= self.next_heartbeat {
            self.next_heartbeat = sensed.now + HEARTBEAT_INTERVAL;
            router.send(To::All, COMPONENT, &self.heartbeat());
            self.traces.beats(self.mode, self.armed, sensed.now);
        }
        for link in router.active_links().collect::<Vec<_>>() {
            for (id, next) in self.streams(link, sensed.now).due(sensed.now) {
                if let Some(message) = self.message(id, sensed) {
                    router.send(To::Link(link), COMPONENT, &message);
                    if link == COMPANION_LINK {
                        let health = [self.estimator_ok, self.gps_ok];
                        self.traces.sends(id, next, health, sensed.now);
                    }
                }
            }
        }
        // One a step: 400 a second, as a fast link carries them.
        if let Some((link, index)) = self.parameter_queue.pop_front()
            && let Some(value) = self.parameters.message(index)
        {
            router.send(To::Link(link), COMPONENT, &MavMessage::PARAM_VALUE(value));
        }
    }

    fn disarm(&mut self) {
        if let (Firmware::Px4, true, Some(sensed)) =
            (self.firmware, self.traps.armable_mode_returns, &self.sensed)
        {
            self.returns_to = Some((self.armable, sensed.now + MODE_RETURNS_AFTER));
        }
        self.armed = false;
        self.traces.disarms();
        self.resumes = false;
        self.failsafe = false;
        self.flight.end();
    }

    /// Changes the mode, from where the vehicle is.
    fn enter(&mut self, mode: Mode, sensed: &Sensed) {
        if mode != Mode::Companion {
            self.script.guided_ends();
        }
        self.shaper = None;
        if mode == Mode::ReturnToLaunch {
            self.return_enu_m = self.return_point(sensed.position_enu_m);
        }
        self.traces.changes(self.mode, mode, sensed.now);
        self.mode = mode;
        self.returns_to = None;
        self.resumes = false;
        self.failsafe = false;
        self.flight.hold_here(sensed.position_enu_m, heading_rad(&sensed.nominal));
    }

    /// Somebody has chosen this mode; what a failsafe enters nobody has.
    fn asked_for(&mut self, mode: Mode) {
        if ![Mode::Land, Mode::ReturnToLaunch].contains(&mode) {
            self.armable = mode;
        }
    }

    /// The pilot takes the sticks.
    pub fn pilot_takes_over(&mut self, router: &mut Router) {
        if let Some(sensed) = self.sensed {
            self.enter(Mode::Position, &sensed);
            self.asked_for(Mode::Position);
            let text = format!("Pilot took over: {}", self.mode.name(self.firmware));
            self.text(MavSeverity::MAV_SEVERITY_INFO, &text, router);
        }
    }

    /// PX4 allocates without a rotor that has failed, if CA_FAILURE_MODE says so.
    pub fn drops_lost_rotors(&self) -> bool {
        self.firmware == Firmware::Px4 && self.parameters.real("CA_FAILURE_MODE") == 1.0
    }

    /// The motors' curve that the autopilot believes in; `None` where it always knows the right one.
    pub fn believed_curve(&self) -> Option<f64> {
        self.tuning.curve
    }

    /// As the firmware's ground stations call the mode.
    pub fn mode_name(&self) -> &'static str {
        self.mode.name(self.firmware)
    }
}

/// The thrust that carries a vehicle's weight, in the allocator's units.
fn hover_thrust(config: &VehicleConfig) -> f64 {
    config.body.mass_kg * GRAVITY_M_S2 / Allocator::new(&config.rotors()).unit_n().z
}

/// A firmware's local frame about a point of the mission's.
fn local_frame(mission: Origin, at_enu_m: Vector3<f64>, firmware: Firmware) -> LocalFrame {
    let projection = match firmware {
        Firmware::Px4 => Projection::GreatCircle,
        Firmware::ArduCopter => Projection::MetresPerDegree,
    };
    LocalFrame::at(mission, at_enu_m, projection)
}
