//! An adapter, a scripted autopilot and the wire between them, in virtual time.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use mavlink::{MavHeader, Message};
use nalgebra::Vector3;

use super::super::*;
use super::fake::*;
use crate::geo::{Attitude, EnuAcceleration, EnuVelocity};
use crate::time::Instant;

/// An adapter, a scripted autopilot and the wire between them.
pub struct World {
    pub now: Instant,
    pub fake: Fake,
    pub autopilot: Autopilot,
    pub events: Vec<(Instant, Event)>,
    /// What the executive keeps setting, at the rate; `None`: it stalls.
    pub setpoint: Option<Setpoint>,
    set_at: Instant,
    /// Cut the wire, both ways.
    pub cut: bool,
    /// What the autopilot says is so much later than it should be.
    pub late: Duration,
    to_fake: VecDeque<(Instant, MavMessage)>,
    to_us: VecDeque<(Instant, MavHeader, MavMessage)>,
}

impl World {
    pub fn new(fake: Fake, change: impl FnOnce(&mut Settings)) -> Self {
        let mut settings = Settings::new(OWN, MISSION);
        settings.autopilot_system = Some(1);
        settings.tracks_pose = true;
        change(&mut settings);
        let now = Instant::from_start(Duration::from_secs(1));
        Self {
            now,
            fake,
            autopilot: Autopilot::new(settings, now),
            events: Vec::new(),
            setpoint: None,
            set_at: now,
            cut: false,
            late: Duration::ZERO,
            to_fake: VecDeque::new(),
            to_us: VecDeque::new(),
        }
    }

    /// Lets someone else's message arrive.
    pub fn inject(&mut self, from: (u8, u8), message: &MavMessage) {
        let header = MavHeader { system_id: from.0.into(), component_id: from.1, sequence: 0 };
        self.autopilot.handle_message(header, message, self.now);
    }

    pub fn run(&mut self, seconds: f64) {
        let end = self.now + Duration::from_secs_f64(seconds);
        while self.now < end {
            self.step();
        }
    }

    /// Runs until there is such an event; panics after `seconds`.
    pub fn until(&mut self, seconds: f64, wanted: impl Fn(&Event) -> bool) -> Event {
        let end = self.now + Duration::from_secs_f64(seconds);
        let mut seen = self.events.len();
        while self.now < end {
            self.step();
            while seen < self.events.len() {
                if wanted(&self.events[seen].1) {
                    return self.events[seen].1.clone();
                }
                seen += 1;
            }
        }
        panic!("not within {seconds} s: {:#?}", self.events);
    }

    fn step(&mut self) {
        self.now = self.now + STEP;
        let now = self.now;
        while self.to_fake.front().is_some_and(|(at, _)| *at <= now) {
            if let Some((_, message)) = self.to_fake.pop_front().filter(|_| !self.cut) {
                self.fake.handle(message, now);
            }
        }
        self.fake.step(now);
        for message in std::mem::take(&mut self.fake.out) {
            let (system, component_id) = self.fake.address;
            let header = MavHeader { system_id: system.into(), component_id, sequence: 0 };
            if !self.fake.silent && !self.cut {
                self.to_us.push_back((now + LATENCY + self.late, header, message));
            }
        }
        while self.to_us.front().is_some_and(|(at, ..)| *at <= now) {
            if let Some((_, header, message)) = self.to_us.pop_front() {
                self.autopilot.handle_message(header, &message, now);
            }
        }
        let mut turns = 0;
        while let Some((at, reason)) = self.autopilot.poll_timeout().filter(|(at, _)| *at <= now) {
            turns += 1;
            assert!(turns < 20, "{reason}, due at {at:?}, is never done");
            self.autopilot.handle_timeout(now);
        }
        if let Some(setpoint) = self.setpoint.filter(|_| self.set_at <= now) {
            self.set_at = now + Duration::from_secs_f64(1.0 / self.autopilot.settings().rate_hz);
            self.autopilot.set_setpoint(setpoint, now);
        }
        while let Some(message) = self.autopilot.poll_transmit() {
            assert!(message.message_id() != 0, "heartbeats are the executive's");
            self.to_fake.push_back((now + LATENCY, message));
        }
        while let Some(event) = self.autopilot.poll_event() {
            self.events.push((now, event));
        }
    }

    pub fn count(&self, wanted: impl Fn(&Event) -> bool) -> usize {
        self.events.iter().filter(|(_, event)| wanted(event)).count()
    }

    /// Holds where the vehicle is.
    pub fn hold_here(&mut self) {
        let state = self.autopilot.state();
        self.setpoint = Some(Setpoint {
            position_enu_m: state.position_enu_m.unwrap().value,
            velocity_enu_m_s: EnuVelocity::ZERO,
            acceleration_enu_m_s2: EnuAcceleration::ZERO,
            attitude: Attitude::from_euler(0.0, 0.0, 0.0),
        });
    }

    /// Discovered, telemetry flowing, parameters read.
    pub fn connect(&mut self) {
        self.until(5.0, |event| matches!(event, Event::Discovered { .. }));
        self.run(6.0);
        self.hold_here();
    }

    /// Sets a place above the present one.
    pub fn climb_to(&mut self, height_m: f64) {
        self.setpoint = self.setpoint.map(|setpoint| Setpoint {
            position_enu_m: setpoint.position_enu_m + Vector3::z() * height_m,
            ..setpoint
        });
    }

    /// In control, armed and at 10 m.
    pub fn launch(&mut self) {
        self.connect();
        self.autopilot.take_control(self.now);
        self.until(10.0, |event| *event == Event::ControlTaken);
        self.autopilot.arm(self.now);
        self.until(10.0, |event| *event == Event::Armed);
        self.autopilot.take_off(10.0, self.now);
        self.climb_to(10.0);
        self.until(30.0, |event| *event == Event::Airborne);
        self.hold_here();
        self.run(2.0);
        assert!(self.autopilot.in_control(), "{:#?}", self.events);
    }
}
