//! Temporary leased transmitter.
use crate::time::Instant;
use crate::units::{Dbm, Watts};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, MavCmd, MavFrame, MavMessage, MavResult};
use std::collections::VecDeque;
use std::time::Duration;

#[derive(Debug, Clone)]
pub struct Settings {
    pub own: (u8, u8),
    pub component: u8,
}
impl Settings {
    pub fn from_parts(own: (u8, u8), component: u8, _c: u16) -> Self {
        Self { own, component }
    }
}
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lease {
    pub power_w: f64,
    pub slot: u16,
    pub expires_at: Instant,
}
#[derive(Debug, Clone, Copy)]
struct Flight {
    lease: Option<Lease>,
    sent_at: Instant,
}
#[derive(Debug)]
pub struct Transmitter {
    s: Settings,
    out: VecDeque<MavMessage>,
    inflight: VecDeque<Flight>,
    acked: Option<Lease>,
    on_until: Option<Instant>,
    off_acked: bool,
    next_off: Option<Instant>,
    rtt: Option<Duration>,
}
#[derive(Debug, Clone)]
pub struct Check {
    pub name: &'static str,
    pub result: Verdict,
    pub detail: String,
}
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    Pass,
    Warn,
    Fail,
}
impl Transmitter {
    pub fn new(s: Settings, now: Instant) -> Self {
        Self {
            s,
            out: VecDeque::new(),
            inflight: VecDeque::new(),
            acked: None,
            on_until: None,
            off_acked: false,
            next_off: Some(now),
            rtt: None,
        }
    }
    fn command(&mut self, dbm: f32, slot: u16, ms: i32) {
        self.out.push_back(MavMessage::COMMAND_INT(COMMAND_INT_DATA {
            param1: dbm,
            param2: 0.0,
            param3: 0.0,
            param4: 0.0,
            x: slot.into(),
            y: ms,
            z: 0.0,
            command: MavCmd::MAV_CMD_USER_1,
            target_system: self.s.own.0,
            target_component: self.s.component,
            frame: MavFrame::MAV_FRAME_GLOBAL,
            current: 0,
            autocontinue: 0,
        }));
    }
    pub fn radiate(&mut self, power_w: f64, slot: u16, expires_at: Instant, now: Instant) {
        let ms = expires_at.saturating_since(now).as_millis() as i32;
        if ms <= 0 {
            return self.silence(now);
        }
        self.next_off = None;
        self.off_acked = false;
        self.on_until = self.on_until.max(Some(expires_at + Duration::from_millis(100)));
        self.inflight.push_back(Flight { lease: Some(Lease { power_w, slot, expires_at }), sent_at: now });
        let mut dbm = Dbm::from(Watts(power_w)).0 as f32;
        if f64::from(dbm) > Dbm::from(Watts(power_w)).0 {
            dbm = dbm.next_down();
        }
        self.command(dbm, slot, ms);
    }
    pub fn silence(&mut self, now: Instant) {
        self.acked = None;
        self.inflight.clear();
        self.next_off = Some(now + Duration::from_millis(50));
        self.off_acked = false;
        self.inflight.push_back(Flight { lease: None, sent_at: now });
        self.command(f32::NEG_INFINITY, 0, 0);
    }
    pub fn handle_timeout(&mut self, now: Instant) {
        if self.next_off.is_some_and(|t| t <= now) && !self.off_acked {
            self.silence(now);
        }
    }
    pub fn poll_timeout(&self) -> Option<(Instant, &'static str)> {
        self.next_off.filter(|_| !self.off_acked).map(|t| (t, "off"))
    }
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop_front()
    }
    pub fn handle_message(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        let MavMessage::COMMAND_ACK(ack) = message else { return };
        if ack.command != MavCmd::MAV_CMD_USER_1 || header.component_id != self.s.component {
            return;
        }
        let Some(flight) = self.inflight.pop_front() else { return };
        self.rtt = Some(now.saturating_since(flight.sent_at));
        if ack.result != MavResult::MAV_RESULT_ACCEPTED {
            return;
        }
        match flight.lease {
            Some(l) if ack.result_param2 != i32::MIN => self.acked = Some(l),
            Some(_) => {}
            None => {
                self.acked = None;
                self.off_acked = self.inflight.is_empty() && ack.result_param2 == i32::MIN;
                if self.off_acked {
                    self.on_until = None;
                }
            }
        }
    }
    pub fn acknowledged(&self) -> Option<Lease> {
        self.acked
    }
    pub fn round_trip(&self) -> Option<Duration> {
        self.rtt
    }
    pub fn limit_w(&self) -> Option<f64> {
        None
    }
    pub fn preflight(&self) -> Vec<Check> {
        vec![]
    }
    pub fn is_off(&self, now: Instant) -> bool {
        self.off_acked || self.on_until.is_none_or(|t| t <= now)
    }
}
