//! One software vehicle: body, autopilot face, transmitter and router.

pub mod airframe;
pub mod airframe_file;
pub mod antenna;
pub mod autopilot;
pub mod bias;
mod companion_link;
pub mod config;
pub(crate) mod control;
pub(crate) mod dynamics;
pub(crate) mod estimator;
mod faults;
pub mod geometry;
pub mod jitter;
mod parameters;
mod radio;
pub mod radio_hop;
mod rotors;
mod router;
mod signing;
pub mod transmitter;
pub mod traps;
pub(crate) mod wind;

use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

use crate::frames::Euler;
use crate::geodesy::Origin;
use crate::random::{Noise, Purpose};
use crate::wire::WireCounters;
use antenna::Pattern;
use autopilot::{Autopilot, Guidance, Mode, Sensed, SetpointCounters, Traces};
use bias::{Bias, OwnFrame};
use companion_link::CompanionLink;
use config::{Firmware, RadioPlace, VehicleConfig};
use control::{Controller, Estimate};
use dynamics::Dynamics;
use estimator::Estimator;
use geometry::{Geometry, MAX_ROTORS};
use jitter::{Jitter, JitterConfig};
use radio::RadioHop;
use rotors::{Allocator, Throttles, through_curves};
use router::Router;
use transmitter::{Transmitter, TransmitterCounters};
use wind::Wind;

/// The step of dynamics and autopilot: 400 Hz.
pub const TICK: Duration = Duration::from_micros(2500);
/// Every second tick is a radio sample: 200 Hz.
pub const TICKS_PER_SAMPLE: u64 = 2;
/// The time between two radio samples.
pub const SAMPLE: Duration = Duration::from_millis(5);
/// The companion's link; all others are ground stations', but for ...
pub const COMPANION_LINK: usize = 0;
/// ... the radio's, if it has one of its own ([`RadioPlace::OnItsOwn`]).
pub const RADIO_LINK: usize = 15;

/// What can be seen of a vehicle from outside.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VehicleSnapshot {
    /// Mission ENU, metres.
    pub position_enu_m: [f64; 3],
    /// Mission ENU, m/s.
    pub velocity_enu_m_s: [f64; 3],
    /// Where the controller has brought the body: w, x, y, z of body FLU to mission ENU.
    pub nominal_attitude_wxyz: [f64; 4],
    /// The same with the injected jitter.
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
    /// The radio's own, on a link of its own.
    radio_router: Option<Router>,
    battery: f64,
    /// What is said of it, by a gauge that stands still.
    battery_said: Option<f64>,
    attitude: UnitQuaternion<f64>,
    estimator: Estimator,
    bias: Bias,
    frame: OwnFrame,
    pattern: Pattern,
    /// What it says, as of the last step.
    estimate: Estimate,
    estimator_failed: bool,
    /// A rotor is lost and the autopilot does not know.
    crippled: bool,
    link: CompanionLink,
    mission: Origin,
    utc_start_us: u64,
    /// Bytes and frames are of this time.
    now: Duration,
    hop: RadioHop,
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
        let bias = config.errors.draw(seed, index);
        let frame = OwnFrame::from(bias);
        let apart = config.radio_place == RadioPlace::OnItsOwn;
        let aboard: &'static [u8] =
            if apart { &[autopilot::COMPONENT] } else { &[autopilot::COMPONENT, transmitter::COMPONENT] };
        let dynamics = Dynamics::new(config.body, &geometry, config.home(), config.heading_rad);
        Self {
            controller: Controller::new(config.body, config.airframe, &geometry),
            motor_curve: geometry.curve,
            drain_per_s: drain_per_s(&config, &geometry),
            wind: Wind::new(config.wind, seed, index),
            jitter: Jitter::new(jitter, seed, index),
            autopilot: Autopilot::new(&config, mission, utc_start_us),
            transmitter: Transmitter::new(
                config.transmitter_max_dbm,
                config.radio_expires,
                config.radio_device,
                Noise::new(seed, Purpose::Radio, index),
            ),
            router: Router::new(config.system_id, aboard),
            radio_router: apart.then(|| Router::new(config.system_id, &[transmitter::COMPONENT])),
            battery: config.battery.initial.clamp(0.0, 1.0),
            battery_said: None,
            attitude: dynamics.attitude,
            estimator: Estimator::new(config.sensors, frame, seed, index, TICK.as_secs_f64()),
            bias,
            frame,
            pattern: Pattern::new(&config.antenna),
            estimate: truth(&dynamics),
            estimator_failed: false,
            crippled: false,
            link: CompanionLink::new(seed, index),
            mission,
            utc_start_us,
            now: Duration::ZERO,
            dynamics,
            hop: RadioHop::new(seed, index),
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
        self.now = self.now.max(now);
        if link == RADIO_LINK
            && let Some(router) = &mut self.radio_router
        {
            for (from, _, message) in router.receive(0, bytes) {
                self.hand_to_radio(from, message, now);
            }
            return;
        }
        let here = if link == COMPANION_LINK { self.link.receive(bytes, now) } else { Some(bytes) };
        if let Some(bytes) = here {
            self.take(link, bytes, now);
        }
    }

    /// Whether an operator's order to fly has passed since this was last asked.
    pub(crate) fn take_order_to_fly(&mut self) -> bool {
        self.router.take_order_to_fly()
    }

    /// An operator has ordered its companion to fly, or the other one, which tells it.
    pub(crate) fn operator_ordered(&mut self) {
        self.autopilot.operator_ordered();
    }

    fn take(&mut self, link: usize, bytes: &[u8], now: Duration) {
        let messages = self.router.receive(link, bytes);
        for (from, component, message) in messages {
            if component == autopilot::COMPONENT {
                self.autopilot.handle(from, message, now, &mut self.router);
            } else {
                self.hand_to_radio(from, message, now);
            }
        }
    }

    /// Passes a frame on to the companion that a radio aboard has received.
    pub fn relay(&mut self, frame: Vec<u8>) {
        self.router.relay(COMPANION_LINK, frame);
    }

    /// The next MAVLink frame to send, and the link it goes to.
    pub fn poll_transmit(&mut self) -> Option<(usize, Vec<u8>)> {
        loop {
            if let Some(frame) = self.link.delivered(self.now) {
                return Some((COMPANION_LINK, frame));
            }
            if let Some((_, frame)) = self.radio_router.as_mut().and_then(Router::poll_transmit) {
                return Some((RADIO_LINK, frame));
            }
            let (link, frame) = self.router.poll_transmit()?;
            if link != COMPANION_LINK {
                return Some((link, frame));
            }
            if let Some(frame) = self.link.transmit(frame, self.now) {
                return Some((link, frame));
            }
        }
    }

    fn sensed(&self, now: Duration) -> Sensed {
        Sensed {
            now,
            position_enu_m: self.estimate.position_enu_m,
            velocity_enu_m_s: self.estimate.velocity_enu_m_s,
            attitude: self.estimator.reported(&self.attitude),
            nominal: self.estimate.attitude,
            rates_flu_rad_s: self.estimate.rates_flu_rad_s,
            contact: self.dynamics.on_ground,
            battery: self.battery_said.unwrap_or(self.battery),
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
        self.now = self.now.max(now);
        while let Some(bytes) = self.link.arrived(now) {
            self.take(COMPANION_LINK, &bytes, now);
        }
        self.run_radio(now);
        let dt = TICK.as_secs_f64();
        self.estimate = self.estimator.step(truth(&self.dynamics), now, dt);
        self.autopilot.gps_ok = self.estimator.has_gps();
        self.autopilot.estimator_ok = !self.estimator_failed && self.estimator.trusted(now);
        let sensed = self.sensed(now);
        let guidance = self.autopilot.tick(&sensed, &mut self.router);
        let throttles = self.throttles(&guidance, dt);
        let height_m = self.dynamics.position_enu_m.z - self.config.home_enu_m[2];
        let wind = self.wind.step(dt, height_m, &self.dynamics.velocity_enu_m_s);
        self.dynamics.step(&throttles, wind, dt);
        self.battery = (self.battery - self.dynamics.rotors.load() * self.drain_per_s * dt).max(0.0);
        self.ticks += 1;
    }

    /// What the motors are told, and through a curve that is not theirs if the autopilot believes in one.
    fn throttles(&mut self, guidance: &Guidance, dt: f64) -> Throttles {
        let state = self.estimate;
        let throttles = match guidance {
            // An empty battery turns nothing.
            _ if self.battery <= 0.0 => [0.0; MAX_ROTORS],
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

    /// What has passed between autopilot and companion.
    pub(crate) fn traces(&self) -> &Traces {
        self.autopilot.traces()
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

    /// Where it is in the frame that it takes for the mission's.
    pub(crate) fn own_position_enu_m(&self) -> Vector3<f64> {
        self.frame.position(&self.dynamics.position_enu_m)
    }

    /// Its attitude in the frame that it takes for the mission's, without the jitter.
    pub(crate) fn own_attitude(&self) -> UnitQuaternion<f64> {
        self.frame.attitude(&self.dynamics.attitude)
    }

    /// Where the best-informed mind aboard takes it to be: the truth, and what its biases and its estimator make up.
    pub(crate) fn supposed_position_enu_m(&self) -> Vector3<f64> {
        self.own_position_enu_m() + self.estimator.lie_m()
    }

    /// The body's true attitude without the injected jitter.
    pub(crate) fn nominal_attitude(&self) -> &UnitQuaternion<f64> {
        &self.dynamics.attitude
    }

    /// The body's true attitude, jitter included.
    pub(crate) fn attitude(&self) -> &UnitQuaternion<f64> {
        &self.attitude
    }

    /// The antenna's true axis, ENU, jitter and mounting included.
    pub(crate) fn antenna_axis(&self) -> Vector3<f64> {
        self.frame.antenna_axis(&self.attitude)
    }

    pub(crate) fn pattern(&self) -> &Pattern {
        &self.pattern
    }

    /// By how much the truth is off what it believes, in this flight.
    #[must_use]
    pub fn bias(&self) -> Bias {
        self.bias
    }

    /// When its autopilot's clock shows this.
    pub(crate) fn time_of(&self, utc_us: u64, now: Duration) -> Duration {
        self.autopilot.time_of(utc_us, now)
    }

    pub(crate) fn airborne(&self) -> bool {
        !self.autopilot.grounded
    }

    /// The motors turn, all of those that the autopilot counts on.
    pub(crate) fn powered(&self) -> bool {
        self.autopilot.armed && self.battery > 0.0 && !self.crippled
    }

    /// The autopilot knows where it is.
    pub(crate) fn estimate_ok(&self) -> bool {
        self.autopilot.estimator_ok
    }

    /// The radio knows expiry, as it says.
    pub(crate) fn radio_expires(&self) -> bool {
        self.config.radio_expires
    }

    pub(crate) fn mode(&self) -> Mode {
        self.autopilot.mode
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

/// The body's motion as it is.
pub(crate) fn truth(body: &Dynamics) -> Estimate {
    Estimate {
        position_enu_m: body.position_enu_m,
        velocity_enu_m_s: body.velocity_enu_m_s,
        attitude: body.attitude,
        rates_flu_rad_s: body.rates_rad_s(),
        contact: body.on_ground,
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
