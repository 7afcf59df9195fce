//! Operator's orders as state, not as messages (PROTOCOL section 5): numbered facts that each companion keeps over a
//! restart, carries in every STATUS, and merges with the other's by rule. Pure.
//!
//! Numbers are Lamport's: an order's number is above every number its giver has heard of, so that "later" means "given in
//! knowledge of". Merging takes the greater of each number, whatever is lost, repeated, late or reordered on the way.
//!
//! - A *kill* holds while its number is above the *lift* of either vehicle: a person at each vehicle lifts it, or a restart
//!   of its companion on the ground does. It beats all (S7).
//! - A *recall* sends both home, or takes back a START on the ground. It beats a START that was given without knowing of it.
//! - Of *pause* and *continue* the later holds; of two with one number, the pause. A START ends both.
//! - A *START* is pending for [`START_EXPIRES`]. A companion stands by it while it is pending and nothing speaks against it;
//!   both take off once each knows that the other stands by the same one (F4). What is done with, by take-off or
//!   because the vehicle was armed by another hand, never counts again.

use std::collections::VecDeque;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::wire::{VEILWING_STATUS_DATA, VeilwingFlags};
use crate::time::Instant;

/// A START that is not confirmed by both companions after this long is none.
pub const START_EXPIRES: Duration = Duration::from_secs(30);

/// What is kept over a restart. The numbers are 0 where there was no such order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// The greatest number known.
    pub newest: u32,
    /// Of the last radio kill.
    pub kill: u32,
    /// The kills up to this one are lifted at this vehicle.
    pub lifted: u32,
    /// Of the last recall.
    pub recall: u32,
    /// Of the last pause or continue ...
    pub hold: u32,
    /// ... which was a pause.
    pub holding: bool,
    /// STARTs up to this one are done with.
    pub begun: u32,
    /// `--start` and `start_utc` count no more: there has been a flight since, or they were taken back.
    pub spent: bool,
}

/// What an operator can order of the pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Begin the mission.
    Start,
    /// Hold position, silent.
    Pause,
    /// Go on after a pause.
    Continue,
    /// Silent, home and down; on the ground, a START is taken back.
    Recall,
    /// Silent, latched.
    Kill,
}

/// What has come about, by an order given here or at the peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// The radio kill is latched.
    Killed,
    /// The last kill is lifted at both vehicles.
    KillLifted,
    /// Home, or not off.
    Recalled,
    /// Paused (`true`), or not any more.
    Held(bool),
    /// A START is pending.
    StartPending,
    /// The pending START was not confirmed by both in time.
    StartExpired,
    /// The other does not stand any more by the START that we have begun.
    StartWithdrawn,
}

/// What the peer said last.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Peer {
    kill: u32,
    lifted: u32,
    recall: u32,
    hold: u32,
    start: u32,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Orders {
    record: Record,
    /// The kill that this process found on record.
    inherited_kill: u32,
    peer: Peer,
    pending: Option<(u32, Instant)>,
    /// Nothing speaks against a take-off here.
    ready: bool,
    /// The START that we fly by, and whether the other was seen to stand by it.
    flying: Option<(u32, bool)>,
    unsaved: bool,
    /// The peer has not been told of what has changed.
    untold: bool,
    changes: VecDeque<Change>,
}

impl Orders {
    /// Goes on from what was kept.
    #[must_use]
    pub fn new(record: Record) -> Self {
        Self {
            record,
            inherited_kill: record.kill,
            peer: Peer::default(),
            pending: None,
            ready: false,
            flying: None,
            unsaved: false,
            untold: false,
            changes: VecDeque::new(),
        }
    }

    /// What is to be kept, if that has changed since it was asked for last.
    pub fn poll_record(&mut self) -> Option<Record> {
        std::mem::take(&mut self.unsaved).then_some(self.record)
    }

    /// What has come about.
    pub fn poll_change(&mut self) -> Option<Change> {
        self.changes.pop_front()
    }

    /// Whether the peer is to be told at once.
    pub(super) fn poll_untold(&mut self) -> bool {
        std::mem::take(&mut self.untold)
    }

    fn tell(&mut self, change: Change) {
        self.changes.push_back(change);
        self.untold = true;
    }

    /// What is to be kept.
    #[must_use]
    pub fn record(&self) -> &Record {
        &self.record
    }

    /// Takes an order given at this vehicle: its number. One that already holds keeps its own.
    pub fn give(&mut self, order: Order, now: Instant) -> u32 {
        let number = match order {
            Order::Kill if self.is_killed() => return self.record.kill,
            Order::Pause | Order::Continue if self.is_paused() == (order == Order::Pause) => {
                return self.record.hold;
            }
            Order::Start => match self.pending {
                Some((number, _)) => return number,
                None => self.next(),
            },
            Order::Kill | Order::Pause | Order::Continue | Order::Recall => self.next(),
        };
        let change = match order {
            Order::Kill => {
                self.record.kill = number;
                // Where numbers have come to their end, a kill still holds.
                self.record.lifted = self.record.lifted.min(number.saturating_sub(1));
                self.drop_start();
                Change::Killed
            }
            Order::Recall => {
                self.record.recall = number;
                self.drop_start();
                Change::Recalled
            }
            Order::Pause | Order::Continue => {
                (self.record.hold, self.record.holding) = (number, order == Order::Pause);
                Change::Held(self.record.holding)
            }
            Order::Start => {
                self.pending = Some((number, now + START_EXPIRES));
                Change::StartPending
            }
        };
        self.tell(change);
        number
    }

    fn next(&mut self) -> u32 {
        self.record.newest = self.record.newest.saturating_add(1);
        self.unsaved = true;
        self.record.newest
    }

    fn drop_start(&mut self) {
        if let Some((number, _)) = self.pending.take() {
            self.record.begun = self.record.begun.max(number);
        }
        self.spend();
    }

    /// `--start` and `start_utc` count no more.
    fn spend(&mut self) {
        self.unsaved |= !std::mem::replace(&mut self.record.spent, true);
    }

    /// A person at this vehicle lifts the kill, here.
    pub fn lift(&mut self) {
        self.lift_up_to(self.record.kill);
    }

    /// This process began on the ground: a kill that it found on record is lifted here.
    pub fn began_on_the_ground(&mut self) {
        self.lift_up_to(self.inherited_kill);
    }

    fn lift_up_to(&mut self, kill: u32) {
        if kill <= self.record.lifted {
            return;
        }
        let was_killed = self.is_killed();
        self.record.lifted = kill;
        (self.unsaved, self.untold) = (true, true);
        if was_killed && !self.is_killed() {
            self.tell(Change::KillLifted);
        }
    }

    /// The vehicle was armed, and not by this mission: what was asked for before counts no more (F4).
    pub fn forget_start(&mut self) {
        self.pending = None;
        if self.record.begun < self.record.newest {
            self.record.begun = self.record.newest;
            self.unsaved = true;
        }
        self.spend();
    }

    /// Takes in the peer's state of orders.
    pub fn hear(&mut self, said: &VEILWING_STATUS_DATA, now: Instant) {
        let (before, was_killed, was_paused) = (self.record, self.is_killed(), self.is_paused());
        self.peer = Peer {
            kill: said.kill,
            lifted: said.kill_lifted,
            recall: said.recall,
            hold: said.hold,
            start: said.start,
        };
        let holding = said.flags.contains(VeilwingFlags::VEILWING_FLAGS_PAUSED);
        let record = &mut self.record;
        let told = [said.newest_order, said.kill, said.kill_lifted, said.recall, said.hold, said.start];
        record.newest = told.into_iter().fold(record.newest, u32::max);
        record.kill = record.kill.max(said.kill);
        record.recall = record.recall.max(said.recall);
        (record.hold, record.holding) = (record.hold, record.holding).max((said.hold, holding));
        if record.kill > before.kill || record.recall > before.recall {
            self.drop_start();
        }
        match (was_killed, self.is_killed()) {
            (false, true) => self.tell(Change::Killed),
            (true, false) => self.tell(Change::KillLifted),
            _ => {}
        }
        if self.record.recall > before.recall {
            self.tell(Change::Recalled);
        }
        if self.is_paused() != was_paused {
            self.tell(Change::Held(self.is_paused()));
        }
        self.hear_start(said.start, now);
        self.unsaved |= self.record != before;
    }

    fn hear_start(&mut self, start: u32, now: Instant) {
        if let Some((number, stood_by)) = &mut self.flying {
            let withdrawn = *stood_by && start != *number;
            *stood_by = start == *number;
            if withdrawn {
                self.tell(Change::StartWithdrawn);
            }
            return;
        }
        let known = self.pending.map_or(self.record.begun, |(number, _)| number);
        // One given in knowledge of an order against it has the higher number. A process that has restarted has no other mark
        // of a START that was pending before.
        let against = self.record.kill.max(self.record.recall);
        let new = start > known.max(self.record.begun).max(against) && self.sees_alike() && !self.is_killed();
        if new {
            self.pending = Some((start, now + START_EXPIRES));
            self.tell(Change::StartPending);
        }
    }

    /// The peer knows of every order that speaks against a START, and we of all of its.
    fn sees_alike(&self) -> bool {
        self.peer.kill == self.record.kill && self.peer.recall == self.record.recall
    }

    /// The peer's companion restarted: what it stood by is void.
    pub fn new_boot(&mut self) {
        self.peer.start = 0;
        if let Some((_, stood_by)) = &mut self.flying {
            *stood_by = false;
        }
    }

    /// A START that was pending too long is none.
    pub fn handle_timeout(&mut self, now: Instant) {
        let Some((number, _)) = self.pending.filter(|(_, expires)| *expires <= now) else { return };
        self.pending = None;
        self.record.begun = self.record.begun.max(number);
        self.unsaved = true;
        self.tell(Change::StartExpired);
    }

    /// When [`Self::handle_timeout`] is due.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.pending.map(|(_, expires)| expires)
    }

    /// Whether nothing here speaks against a take-off.
    pub fn set_ready(&mut self, ready: bool) {
        let before = self.stands_by();
        self.ready = ready;
        self.untold |= before != self.stands_by();
    }

    /// The START that we stand by: we are ready for it, or fly by it. 0: none.
    fn stands_by(&self) -> u32 {
        match (self.flying, self.pending) {
            (Some((number, _)), _) => number,
            (None, Some((number, _))) if self.ready => number,
            (None, _) => 0,
        }
    }

    /// The START that is pending here.
    #[must_use]
    pub fn pending_start(&self) -> Option<u32> {
        self.pending.map(|(number, _)| number)
    }

    /// Whether we fly by this START.
    #[must_use]
    pub fn is_flying(&self, number: u32) -> bool {
        self.flying.is_some_and(|(flying, _)| flying == number)
    }

    /// Whether both stand by the pending START, each in knowledge of all the other's orders.
    #[must_use]
    pub fn is_start_confirmed(&self) -> bool {
        let stands_by = self.stands_by();
        self.flying.is_none()
            && stands_by != 0
            && self.peer.start == stands_by
            && self.sees_alike()
            && !self.is_killed()
    }

    /// Takes up the pending START: it counts never again.
    pub fn begin(&mut self) {
        let Some((number, _)) = self.pending.take() else { return };
        self.record.begun = self.record.begun.max(number);
        self.flying = Some((number, self.peer.start == number));
        (self.unsaved, self.untold) = (true, true);
        self.spend();
    }

    /// What was begun is taken back before the vehicle has left the ground.
    pub fn stand_down(&mut self) {
        self.flying = None;
        self.untold = true;
    }

    /// Whether a radio kill holds.
    #[must_use]
    pub fn is_killed(&self) -> bool {
        self.record.kill > self.record.lifted.min(self.peer.lifted)
    }

    /// Whether a kill is lifted here and still holds for the other vehicle's sake.
    #[must_use]
    pub fn is_lifted_here_alone(&self) -> bool {
        self.is_killed() && self.record.lifted >= self.record.kill
    }

    /// Whether the pair is to hold, silent.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        let start = self.pending.map_or(self.record.begun, |(number, _)| number);
        self.record.holding && self.record.hold > start
    }

    /// Whether `--start` and `start_utc` count no more.
    #[must_use]
    pub fn is_spent(&self) -> bool {
        self.record.spent
    }

    /// Whether the peer is known to have this order, or a later one of its kind.
    #[must_use]
    pub fn peer_has(&self, order: Order, number: u32) -> bool {
        let heard = match order {
            Order::Kill => self.peer.kill,
            Order::Recall => self.peer.recall,
            Order::Pause | Order::Continue => self.peer.hold,
            Order::Start => self.peer.start,
        };
        heard >= number
    }

    /// Writes what is said of orders into a status.
    pub(super) fn say(&self, status: &mut VEILWING_STATUS_DATA) {
        let Record { newest, kill, lifted, recall, hold, holding, .. } = self.record;
        status.newest_order = newest;
        (status.kill, status.kill_lifted, status.recall) = (kill, lifted, recall);
        (status.hold, status.start) = (hold, self.stands_by());
        status.flags.set(VeilwingFlags::VEILWING_FLAGS_PAUSED, holding);
    }
}

#[cfg(test)]
mod tests;
