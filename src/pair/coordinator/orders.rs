//! Operator's orders between the companions: each is repeated until the other side has acknowledged it.

use std::time::Duration;

use crate::time::Instant;

use super::super::wire::{self, MavMessage, VeilwingOrder};

const REPEAT_EVERY: Duration = Duration::from_millis(200);

/// Ours that is not acknowledged.
#[derive(Debug, Clone, Copy)]
struct Pending {
    number: u32,
    order: VeilwingOrder,
    next_send: Instant,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Orders {
    boot_id: u32,
    given: u32,
    pending: Option<Pending>,
    /// The newest of the peer's present boot.
    taken: Option<u32>,
}

impl Orders {
    pub fn new(boot_id: u32) -> Self {
        Self { boot_id, ..Self::default() }
    }

    /// An order for the peer as well.
    pub fn give(&mut self, order: VeilwingOrder, now: Instant) {
        self.given += 1;
        self.pending = Some(Pending { number: self.given, order, next_send: now });
    }

    pub fn due(&self) -> Option<Instant> {
        self.pending.map(|pending| pending.next_send)
    }

    /// The order to the peer, if it is due.
    pub fn say(&mut self, now: Instant) -> Option<MavMessage> {
        let pending = self.pending.as_mut().filter(|pending| pending.next_send <= now)?;
        pending.next_send = now + REPEAT_EVERY;
        Some(MavMessage::VEILWING_ORDER_RELAY(wire::VEILWING_ORDER_RELAY_DATA {
            boot_id: self.boot_id,
            number: pending.number,
            order: pending.order,
        }))
    }

    /// Takes an order of the peer's present boot: the order, if it is none that was taken already, and the
    /// acknowledgement.
    pub fn take(&mut self, order: &wire::VEILWING_ORDER_RELAY_DATA) -> (Option<VeilwingOrder>, MavMessage) {
        let ack = wire::VEILWING_ORDER_ACK_DATA { boot_id: order.boot_id, number: order.number };
        let new = self.taken.is_none_or(|taken| order.number > taken);
        if new {
            self.taken = Some(order.number);
        }
        (new.then_some(order.order), MavMessage::VEILWING_ORDER_ACK(ack))
    }

    pub fn acknowledged(&mut self, ack: &wire::VEILWING_ORDER_ACK_DATA) {
        let ours = ack.boot_id == self.boot_id;
        self.pending = self.pending.filter(|pending| !(ours && pending.number == ack.number));
    }

    /// The peer restarted: its numbers begin anew.
    pub fn new_boot(&mut self) {
        self.taken = None;
    }
}
