//! A flight for those who were not there: the truth at a steady rate, and at once whenever something changes that one
//! would ask about.

use std::time::Duration;

use serde::Serialize;

use super::radio::sinr;
use super::receiver::Receiver;
use super::{Snapshot, World, WorldConfig};

/// The world at one instant, with what its receivers hear.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Record {
    /// Vehicles, separation, secrecy rate.
    pub snapshot: Snapshot,
    /// What is heard of I; `None` while it does not radiate for a user of the plan.
    pub heard: Option<Heard>,
}

/// SINRs at one instant, linear: I's signal over J's jamming and the noise (1.5).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Heard {
    /// At the user whom I's power command names by its slot.
    pub user_sinr: f64,
    /// At each eavesdropper, where it truly is.
    pub eavesdropper_sinr: Vec<f64>,
}

/// What makes a record due at once.
type Discrete = [(&'static str, bool, bool, Option<f64>, Option<i32>); 2];

/// Collects [`Record`]s of a world: show it the world after each step.
#[derive(Debug, Clone)]
pub struct Recorder {
    every: Duration,
    next: Duration,
    last: Option<Discrete>,
    records: Vec<Record>,
}

impl Recorder {
    /// A recorder with this period, and a record beside it at each change of a mode, a power, a slot, of arming and of
    /// standing on the ground.
    #[must_use]
    pub fn new(every: Duration) -> Self {
        Self { every, next: Duration::ZERO, last: None, records: Vec::new() }
    }

    /// Keeps the world as it is if a record is due.
    pub fn observe(&mut self, world: &World) {
        let now = world.now();
        let discrete = world.discrete();
        if now < self.next && self.last == Some(discrete) {
            return;
        }
        self.last = Some(discrete);
        while self.next <= now {
            self.next += self.every.max(Duration::from_millis(1));
        }
        self.records.push(world.record());
    }

    /// What has been kept, in the order of time.
    #[must_use]
    pub fn finish(self) -> Vec<Record> {
        self.records
    }
}

impl World {
    /// The world at this instant, with what its receivers hear.
    #[must_use]
    pub fn record(&self) -> Record {
        Record { snapshot: self.snapshot(), heard: self.heard() }
    }

    /// What the world was made of.
    #[must_use]
    pub fn config(&self) -> &WorldConfig {
        &self.config
    }

    /// Where the eavesdroppers truly are, mission ENU, metres, in the configuration's order.
    #[must_use]
    pub fn eavesdroppers_enu_m(&self) -> Vec<[f64; 3]> {
        self.eavesdroppers.iter().map(|receiver| receiver.position_enu_m.into()).collect()
    }

    /// Where the users truly are, likewise.
    #[must_use]
    pub fn users_enu_m(&self) -> Vec<[f64; 3]> {
        self.users.iter().map(|receiver| receiver.position_enu_m.into()).collect()
    }

    fn heard(&self) -> Option<Heard> {
        let slot = self.slot_of(0)?;
        let power_w = |k: usize| self.vehicles[k].transmitter().power_w().unwrap_or(0.0);
        let (i, j) = (self.emitter(0, power_w(0)), self.emitter(1, power_w(1)));
        let at = |receiver: &Receiver| sinr(&self.config.radio, &i, &j, receiver);
        Some(Heard {
            user_sinr: at(&self.users[self.plans[slot].1]),
            eavesdropper_sinr: self.eavesdroppers.iter().map(at).collect(),
        })
    }

    fn discrete(&self) -> Discrete {
        let of = |k: usize| {
            let v = self.vehicles[k].snapshot();
            (v.mode, v.armed, v.landed, v.tx_power_w, v.slot)
        };
        [of(0), of(1)]
    }
}
