//! One software vehicle: body, autopilot face, transmitter and router.

pub mod autopilot;
pub mod config;
pub(crate) mod control;
pub(crate) mod dynamics;
pub mod geometry;
pub mod jitter;
mod parameters;
mod rotors;
mod router;
pub mod transmitter;
pub mod traps;
mod wind;

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

use crate::frames::Euler;
use crate::geodesy::Origin;
use crate::wire::WireCounters;
use autopilot::{Autopilot, Guidance, Mode, Sensed, SetpointCounters};
use config::{Firmware, VehicleConfig};
use control::{Controller, Estimate};
use dynamics::Dynamics;
use geometry::{Geometry, MAX_ROTORS};
use jitter::{Jitter, JitterConfig};
use parameters::SetOutcome;
use rotors::{Allocator, Throttles, through_curves};
use router::{Router, Sender, To};
use transmitter::{Transmitter, TransmitterCounters};
use wind::Wind;

/// The step of dynamics and autopilot: 400 Hz.
pub const TICK: Duration = Duration::from_micros(2500);
/// Every second tick is a radio sample: 200 Hz.
pub const TICKS_PER_SAMPLE: u64 = 2;
/// The time between two radio samples.
pub const SAMPLE: Duration = Duration::from_millis(5);
/// The companion's link; all others are ground stations'.
pub const COMPANION_LINK: usize = 0;

/// What can be seen of a vehicle from outside.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VehicleSnapshot {
    /// Mission ENU, metres.
    pub position_enu_m: [f64; 3],
    /// Mission ENU, m/s.
    pub velocity_enu_m_s: [f64; 3],
    /// Where the controller has brought the body: w, x, y, z of body FLU to mission ENU.
    pub nominal_attitude_wxyz: [f64; 4],
    /// The same with the injected jitter: the antenna's true attitude.
    pub attitude_wxyz: [f64; 4],
    /// The mode, as the firmware's ground stations call it.
    pub mode: &'static str,
    /// The mode is the companion's (OFFBOARD, GUIDED).
    pub companion_controlled: bool,
    /// Motors may turn.
    pub armed: bool,
    /// Standing on the ground.
    pub landed: bool,
    /// Battery, 0 to 1.
    pub battery: f64,
    /// Radiated power, watts; `None` when silent.
    pub tx_power_w: Option<f64>,
    /// The slot number of the power command in force.
    pub slot: Option<i32>,
}

/// Everything that a vehicle has counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct VehicleCounters {
    /// Bytes and frames.
    pub wire: WireCounters,
    /// Setpoints.
    pub setpoints: SetpointCounters,
    /// Power commands carried out, refused, expired.
    pub power_commands: [u64; 3],
}

/// One vehicle. Bytes and time go in, MAVLink frames come out.
#[derive(Debug, Clone)]
pub struct Vehicle {
    config: VehicleConfig,
    dynamics: Dynamics,
    controller: Controller,
    motor_curve: f64,
    /// Of the whole charge, with all rotors at full throttle.
    drain_per_s: f64,
    wind: Wind,
    jitter: Jitter,
    autopilot: Autopilot,
    transmitter: Transmitter,
    router: Router,
    battery: f64,
    attitude: UnitQuaternion<f64>,
    /// Both directions of the companion's link are cut.
    companion_link_down: bool,
    next_radio_heartbeat: Duration,
    ticks: u64,
}

impl Vehicle {
    /// A vehicle at rest at its home. `mission` is the origin of the mission's frame.
    #[must_use]
    pub fn new(
        config: VehicleConfig,
        jitter: JitterConfig,
        mission: Origin,
        utc_start_us: u64,
        seed: u64,
    ) -> Self {
        let index = config.role.index();
        let geometry = config.rotors();
        let dynamics = Dynamics::new(config.body, &geometry, config.home(), config.heading_rad);
        Self {
            controller: Controller::new(config.body, config.airframe, &geometry),
            motor_curve: geometry.curve,
            drain_per_s: drain_per_s(&config, &geometry),
            wind: Wind::new(config.wind, seed, index),
            jitter: Jitter::new(jitter, seed, index),
            autopilot: Autopilot::new(&config, mission, utc_start_us),
            transmitter: Transmitter::new(config.transmitter_max_dbm),
            router: Router::new(config.system_id, &[autopilot::COMPONENT, transmitter::COMPONENT]),
            battery: config.battery.initial.clamp(0.0, 1.0),
            attitude: dynamics.attitude,
            dynamics,
            companion_link_down: false,
            next_radio_heartbeat: Duration::ZERO,
            ticks: 0,
            config,
        }
    }

    /// Telemetry on a link from now on, for a ground station that waits to hear something.
    pub fn open_link(&mut self, link: usize) {
        self.router.open(link);
    }

    /// Bytes from a client on a link (0 is the companion's).
    pub fn handle(&mut self, link: usize, bytes: &[u8], now: Duration) {
        if self.companion_link_down && link == COMPANION_LINK {
            return;
        }
        for (from, component, message) in self.router.receive(link, bytes) {
            if component == autopilot::COMPONENT {
                self.autopilot.handle(from, message, now, &mut self.router);
            } else {
                self.radio(from, message, now);
            }
        }
    }

    /// The next MAVLink frame to send, and the link it goes to.
    pub fn poll_transmit(&mut self) -> Option<(usize, Vec<u8>)> {
        loop {
            let (link, frame) = self.router.poll_transmit()?;
            if !(self.companion_link_down && link == COMPANION_LINK) {
                return Some((link, frame));
            }
        }
    }

    /// The radio component's side of a message.
    fn radio(&mut self, from: Sender, message: MavMessage, now: Duration) {
        let component = transmitter::COMPONENT;
        let link = To::Link(from.link);
        let ack = |command, result, result_param2| {
            MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command,
                result,
                progress: 0,
                result_param2,
                target_system: from.system_id,
                target_component: from.component_id,
            })
        };
        match message {
            MavMessage::COMMAND_INT(c) if c.target_component == component => {
                let reply = if c.command == transmitter::POWER_COMMAND {
                    let (result, achieved_mdbm) = self.transmitter.command(&c, now);
                    ack(c.command, result, achieved_mdbm)
                } else {
                    ack(c.command, MavResult::MAV_RESULT_UNSUPPORTED, 0)
                };
                self.router.send(link, component, &reply);
            }
            MavMessage::COMMAND_LONG(c) if c.target_component == component => {
                // The slot and the expiry are integers; a float cannot carry them safely.
                let result = if c.command == transmitter::POWER_COMMAND {
                    MavResult::MAV_RESULT_COMMAND_INT_ONLY
                } else {
                    MavResult::MAV_RESULT_UNSUPPORTED
                };
                self.router.send(link, component, &ack(c.command, result, 0));
            }
            MavMessage::PARAM_REQUEST_LIST(_) => {
                for index in 0..self.transmitter.parameters.len() {
                    self.radio_parameter(link, Some(index));
                }
            }
            MavMessage::PARAM_REQUEST_READ(m) if m.target_component == component => {
                let by_name = || self.transmitter.parameters.index_of(m.param_id.to_str().ok()?);
                self.radio_parameter(link, usize::try_from(m.param_index).ok().or_else(by_name));
            }
            MavMessage::PARAM_SET(m) if m.target_component == component => {
                match self.transmitter.parameters.handle_set(&m) {
                    SetOutcome::Stored(index) | SetOutcome::Refused(index) => {
                        self.radio_parameter(To::All, Some(index));
                    }
                    SetOutcome::Unknown => {}
                }
            }
            _ => {}
        }
    }

    fn radio_parameter(&mut self, to: To, index: Option<usize>) {
        if let Some(value) = index.and_then(|k| self.transmitter.parameters.message(k)) {
            self.router.send(to, transmitter::COMPONENT, &MavMessage::PARAM_VALUE(value));
        }
    }

    fn sensed(&self, now: Duration) -> Sensed {
        Sensed {
            now,
            position_enu_m: self.dynamics.position_enu_m,
            velocity_enu_m_s: self.dynamics.velocity_enu_m_s,
            attitude: self.attitude,
            nominal: self.dynamics.attitude,
            rates_flu_rad_s: self.dynamics.rates_rad_s(),
            contact: self.dynamics.on_ground,
            battery: self.battery,
        }
    }

    /// Draws the jitter of a radio sample. `meant` are the Euler angles that the body is meant to have, if known.
    pub(crate) fn sample(&mut self, meant: Option<Euler>) {
        self.jitter.draw(SAMPLE.as_secs_f64());
        self.attitude = if self.airborne() {
            self.jitter.apply(&self.dynamics.attitude, meant)
        } else {
            self.dynamics.attitude
        };
    }

    /// One step of autopilot, control and dynamics, from `now` to `now + TICK`.
    pub(crate) fn tick(&mut self, now: Duration) {
        if now >= self.next_radio_heartbeat {
            self.next_radio_heartbeat = now + Duration::from_secs(1);
            let heartbeat = HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_RADIO,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                system_status: MavState::MAV_STATE_ACTIVE,
                mavlink_version: 3,
                ..HEARTBEAT_DATA::DEFAULT
            };
            self.router.send(To::All, transmitter::COMPONENT, &MavMessage::HEARTBEAT(heartbeat));
        }
        let sensed = self.sensed(now);
        let guidance = self.autopilot.tick(&sensed, &mut self.router);
        let dt = TICK.as_secs_f64();
        let throttles = self.throttles(&guidance, &sensed, dt);
        let wind = self.wind.step(dt);
        self.dynamics.step(&throttles, wind, dt);
        self.battery = (self.battery - self.dynamics.rotors.load() * self.drain_per_s * dt).max(0.0);
        self.ticks += 1;
    }

    /// What the motors are told, and through a curve that is not theirs if the autopilot believes in one.
    fn throttles(&mut self, guidance: &Guidance, sensed: &Sensed, dt: f64) -> Throttles {
        let state = Estimate {
            position_enu_m: sensed.position_enu_m,
            velocity_enu_m_s: sensed.velocity_enu_m_s,
            attitude: sensed.nominal,
            rates_flu_rad_s: sensed.rates_flu_rad_s,
            contact: sensed.contact,
        };
        let throttles = match guidance {
            Guidance::Off => {
                self.controller.reset();
                [0.0; MAX_ROTORS]
            }
            Guidance::Fly(target, limits) => self.controller.step(&state, target, *limits, dt),
            Guidance::Thrust(target) => self.controller.step_thrust(&state, target, dt),
        };
        match self.autopilot.believed_curve() {
            Some(believed) if believed != self.motor_curve => {
                throttles.map(|u| through_curves(u, believed, self.motor_curve))
            }
            _ => throttles,
        }
    }

    /// A vehicle alone: everything due up to simulation time `to`, without a world around it.
    pub fn advance(&mut self, to: Duration) {
        loop {
            let now = tick_time(self.ticks);
            if now > to {
                break;
            }
            self.transmitter.expire(now);
            if self.ticks.is_multiple_of(TICKS_PER_SAMPLE) {
                self.sample(None);
            }
            self.tick(now);
        }
        self.transmitter.expire(to);
    }

    /// An operator's radio kill has passed on its way to the companion.
    pub(crate) fn radio_kill_seen(&self) -> bool {
        self.router.radio_kill_seen()
    }

    pub(crate) fn transmitter(&self) -> &Transmitter {
        &self.transmitter
    }

    pub(crate) fn transmitter_mut(&mut self) -> &mut Transmitter {
        &mut self.transmitter
    }

    pub(crate) fn home_enu_m(&self) -> Vector3<f64> {
        self.config.home()
    }

    pub(crate) fn position_enu_m(&self) -> Vector3<f64> {
        self.dynamics.position_enu_m
    }

    pub(crate) fn nominal_attitude(&self) -> &UnitQuaternion<f64> {
        &self.dynamics.attitude
    }

    /// The antenna's true attitude, jitter included.
    pub(crate) fn attitude(&self) -> &UnitQuaternion<f64> {
        &self.attitude
    }

    pub(crate) fn airborne(&self) -> bool {
        !self.autopilot.grounded
    }

    pub(crate) fn mode(&self) -> Mode {
        self.autopilot.mode
    }

    pub(crate) fn cut_companion_link(&mut self, down: bool) {
        self.companion_link_down = down;
    }

    pub(crate) fn pilot_takes_over(&mut self) {
        self.autopilot.pilot_takes_over(&mut self.router);
    }

    pub(crate) fn fail_estimator(&mut self) {
        self.autopilot.estimator_ok = false;
    }

    pub(crate) fn lose_rotor(&mut self, rotor: usize) {
        self.dynamics.rotors.lose(rotor);
        if self.autopilot.drops_lost_rotors() {
            self.controller.drop_rotor(rotor);
        }
    }

    pub(crate) fn set_battery(&mut self, charge: f64) {
        self.battery = charge.clamp(0.0, 1.0);
    }

    pub(crate) fn set_wind(&mut self, mean_enu_m_s: Vector3<f64>) {
        self.wind.mean_enu_m_s = mean_enu_m_s;
    }

    /// The firmware face.
    #[must_use]
    pub fn firmware(&self) -> Firmware {
        self.config.firmware
    }

    /// What can be seen from outside.
    #[must_use]
    pub fn snapshot(&self) -> VehicleSnapshot {
        let wxyz = |q: &UnitQuaternion<f64>| [q.w, q.i, q.j, q.k];
        VehicleSnapshot {
            position_enu_m: self.dynamics.position_enu_m.into(),
            velocity_enu_m_s: self.dynamics.velocity_enu_m_s.into(),
            nominal_attitude_wxyz: wxyz(&self.dynamics.attitude),
            attitude_wxyz: wxyz(&self.attitude),
            mode: self.autopilot.mode_name(),
            companion_controlled: self.autopilot.mode == Mode::Companion,
            armed: self.autopilot.armed,
            landed: self.autopilot.grounded,
            battery: self.battery,
            tx_power_w: self.transmitter.power_w(),
            slot: self.transmitter.emission().map(|e| e.slot),
        }
    }

    /// What has been counted.
    #[must_use]
    pub fn counters(&self) -> VehicleCounters {
        let TransmitterCounters { accepted, denied, expired } = self.transmitter.counters;
        VehicleCounters {
            wire: self.router.counters(),
            setpoints: self.autopilot.setpoint_counters(),
            power_commands: [accepted, denied, expired],
        }
    }
}

/// The charge that all rotors at full throttle take in a second: hovering takes the whole in the endurance.
fn drain_per_s(config: &VehicleConfig, geometry: &Geometry) -> f64 {
    let weight_n = config.body.mass_kg * dynamics::GRAVITY_M_S2;
    let hover = Allocator::new(geometry).hover_load(weight_n);
    if hover > 0.0 { 1.0 / (hover * config.battery.endurance_s) } else { 0.0 }
}

/// The simulation time of a tick.
pub(crate) fn tick_time(ticks: u64) -> Duration {
    Duration::from_micros(ticks * TICK.as_micros() as u64)
}
