//! Both ends' gates with a wire between them, in virtual time, the listening end's path as UDP has it.

use std::net::SocketAddr;
use std::time::Duration;

use veilwing::link::gate::{Arrival, Gate, GateConfig};
use veilwing::link::signing::{Keeper, Signing, timestamp};
use veilwing::link::{Envelope, Form, Key, LearntPath, Origin, RawFrame, Rejection, SigningConfig};
use veilwing::pair::wire::{MavMessage, VEILWING_COMMIT_DATA};
use veilwing::time::{Instant, Utc};

use crate::common::*;

const DELAY: Duration = Duration::from_millis(40);
pub const TICK: Duration = Duration::from_millis(10);

/// A record that is always in time.
#[derive(Debug)]
struct Prompt(u64);

impl Keeper for Prompt {
    fn keep(&mut self, ceiling: u64) -> bool {
        self.0 = ceiling;
        true
    }

    fn kept(&self) -> u64 {
        self.0
    }

    fn close(&mut self, _: u64) {}
}

pub fn address(port: u16) -> SocketAddr {
    SocketAddr::from(([10, 0, 0, 1], port))
}

pub fn signing(link_id: u8, recorded: u64) -> Signing {
    let config = SigningConfig {
        key: Key::new(KEY),
        link_id,
        state_file: "none".into(),
        unsigned_allowed: Vec::new(),
    };
    Signing::with_keeper(config, Box::new(Prompt(recorded)), recorded)
}

/// One companion: its gate, its clock's error, and where it sends.
pub struct End {
    pub gate: Gate<Envelope>,
    pub system: u8,
    pub off_us: i64,
    /// The end that listens learns where the other is; the other one knows.
    pub path: Option<LearntPath>,
    pub said: Vec<String>,
    pub delivered: Vec<(Duration, u32)>,
    pub rejected: Vec<Rejection>,
}

pub fn utc_at(now: Duration, off_us: i64) -> Utc {
    let us = SIGNED_UNIX_US as i64 + now.as_micros() as i64 + off_us;
    Utc { unix_us: us as u64 }
}

impl End {
    pub fn new(system: u8, off_us: i64, listens: bool, recorded: Option<u64>, now: Duration) -> Self {
        let utc = utc_at(now, off_us);
        let recorded = recorded.unwrap_or(0).max(timestamp(utc));
        let signing = Some(signing(0, recorded));
        let config = GateConfig {
            peer_system: Some(3 - system),
            open_to_anyone: listens,
            accept_foreign: false,
            signing,
        };
        let mut gate = Gate::new(config, utc);
        gate.speak_as((system, 191));
        let path = listens.then(LearntPath::default);
        Self { gate, system, off_us, path, said: Vec::new(), delivered: Vec::new(), rejected: Vec::new() }
    }

    pub fn origin(&self, from: SocketAddr, now: Instant) -> Option<Origin> {
        self.path.as_ref().map_or(Some(Origin::Peer), |path| path.origin(from, now))
    }

    /// Takes a datagram, and gives back what goes out for it, and where to: `None` to the peer.
    pub fn take(
        &mut self,
        from: SocketAddr,
        raw: &RawFrame,
        now: Duration,
    ) -> Vec<(Option<SocketAddr>, RawFrame)> {
        let at = Instant::from_start(now);
        let Some(origin) = self.origin(from, at) else {
            self.rejected.push(Rejection::Stranger);
            return Vec::new();
        };
        match self.gate.admit(raw, Arrival { origin, now: at, utc: utc_at(now, self.off_us) }) {
            Ok(frame) => {
                if let Some(path) = &mut self.path {
                    path.heard(origin, at);
                }
                if let Some(frame) = frame {
                    let MavMessage::VEILWING_COMMIT(commit) = frame.message.message() else { panic!() };
                    self.delivered.push((now, commit.proposal));
                }
            }
            Err(reason) => self.rejected.push(reason),
        }
        self.said.extend(std::iter::from_fn(|| self.gate.poll_notice()).map(|notice| notice.to_string()));
        let replies = std::iter::from_fn(|| self.gate.poll_reply());
        let to = |origin| match origin {
            Origin::Address(to) => Some(to),
            _ => None,
        };
        replies.map(|(origin, raw)| (to(origin), raw)).collect()
    }

    pub fn speak(&mut self, number: u32, now: Duration) -> RawFrame {
        let message =
            MavMessage::VEILWING_COMMIT(VEILWING_COMMIT_DATA { boot_id: 1, proposal: number, slot: 0 });
        let from = (self.system, 191);
        self.gate.seal(from, &Envelope::new(Form::Plain, from, 0, message), utc_at(now, self.off_us)).unwrap()
    }
}

/// A datagram under way.
pub struct Flying {
    pub at: Duration,
    pub from: SocketAddr,
    pub to: SocketAddr,
    pub raw: RawFrame,
}

pub const LISTENER: u16 = 1;
pub const CALLER: u16 = 2;

/// The listening end at port 1, the other at `caller_port`, and what is under way.
pub struct Wire {
    pub listener: End,
    pub caller: End,
    pub caller_port: u16,
    pub flying: Vec<Flying>,
    /// All that was ever sent, for whoever listens in.
    pub recorded: Vec<Flying>,
    pub now: Duration,
    pub number: u32,
}

impl Wire {
    pub fn new(listener: End, caller: End) -> Self {
        Self {
            listener,
            caller,
            caller_port: CALLER,
            flying: Vec::new(),
            recorded: Vec::new(),
            now: Duration::ZERO,
            number: 0,
        }
    }

    pub fn send(&mut self, from: SocketAddr, to: SocketAddr, raw: RawFrame) {
        self.recorded.push(Flying { at: self.now, from, to, raw });
        self.flying.push(Flying { at: self.now + DELAY, from, to, raw });
    }

    /// Both speak ten times a second, as long as this lasts.
    pub fn pass(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.now += TICK;
            if self.now.as_millis().is_multiple_of(100) {
                self.number += 1;
                let raw = self.caller.speak(self.number, self.now);
                self.send(address(self.caller_port), address(LISTENER), raw);
                if let Some(to) = self.listener.path.as_ref().and_then(LearntPath::peer) {
                    let raw = self.listener.speak(self.number, self.now);
                    self.send(address(LISTENER), to, raw);
                }
            }
            self.deliver();
        }
    }

    pub fn deliver(&mut self) {
        let now = self.now;
        let (due, rest) = std::mem::take(&mut self.flying).into_iter().partition(|f| f.at <= now);
        self.flying = rest;
        let due: Vec<Flying> = due;
        for Flying { from, to, raw, .. } in due {
            let replies = match to.port() {
                LISTENER => self.listener.take(from, &raw, now),
                port if port == self.caller_port => self.caller.take(from, &raw, now),
                _ => continue,
            };
            for (reply_to, raw) in replies {
                let back = reply_to.unwrap_or(from);
                self.send(to, back, raw);
            }
        }
    }

    /// Somebody sends what is not the ends' own.
    pub fn inject(&mut self, from: u16, raw: RawFrame) {
        let (now, to) = (self.now, address(LISTENER));
        self.flying.push(Flying { at: now, from: address(from), to, raw });
        self.deliver();
    }

    /// Lets what is under way arrive, and its answers.
    pub fn settle(&mut self) {
        for _ in 0..3 {
            self.now += DELAY;
            self.deliver();
        }
    }

    pub fn path(&self) -> Option<u16> {
        self.listener.path.as_ref().and_then(LearntPath::peer).map(|at| at.port())
    }
}
