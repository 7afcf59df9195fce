//! One list's way from the autopilot or to it, by MAVLink's mission protocol, as a state machine without I/O.
//! <https://mavlink.io/en/services/mission.html>
//!
//! Whoever gives a list is asked for its items one by one: what is lost is asked for again, by us where we read, by the autopilot
//! where it reads (PX4 after 0.25 s, ArduPilot after a second).

// ArduPilot asks by the superseded MISSION_REQUEST.
#![allow(deprecated)]

use std::fmt;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_REQUEST_INT_DATA, MISSION_REQUEST_LIST_DATA, MavMessage,
    MavMissionResult, MavMissionType,
};

use super::super::outbox::{Address, Outbox};
use super::item::Item;
use crate::time::Instant;

const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);
const ATTEMPTS: u8 = 4;
/// For so long the autopilot may ask for nothing while it reads a list: more than two of ArduPilot's attempts.
const READS_WITHIN: Duration = Duration::from_millis(2500);

/// Why a transfer failed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Failure {
    /// No answer.
    Silent,
    /// A MISSION_ACK that is none.
    Refused(MavMissionResult),
    /// It asked for an item that the list does not have, or for the same ones without end.
    Confused,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => f.write_str("the autopilot does not answer"),
            // Both firmwares say this, too, while they serve another station.
            Self::Refused(
                result @ (MavMissionResult::MAV_MISSION_ERROR
                | MavMissionResult::MAV_MISSION_DENIED
                | MavMissionResult::MAV_MISSION_OPERATION_CANCELLED),
            ) => {
                write!(
                    f,
                    "the autopilot answers {result:?}: it is busy with another station, or does not take it now"
                )
            }
            Self::Refused(result @ MavMissionResult::MAV_MISSION_NO_SPACE) => {
                write!(
                    f,
                    "the autopilot answers {result:?}: too many corners for it, simplify airspace.area_enu_m"
                )
            }
            Self::Refused(result @ MavMissionResult::MAV_MISSION_UNSUPPORTED) => {
                write!(f, "the autopilot answers {result:?}: its build has none")
            }
            Self::Refused(result) => write!(f, "the autopilot answers {result:?}"),
            Self::Confused => f.write_str("the autopilot asks for items that there are not"),
        }
    }
}

/// How a transfer ended.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Ended {
    /// The autopilot has these.
    Read(Vec<Item>),
    /// The autopilot has so many, which is not what was expected.
    Counted(u16),
    /// The autopilot has asked for everything; whether it keeps it, reading tells.
    Written,
    Failed(Failure),
}

#[derive(Debug, Clone)]
enum Stage {
    /// Asked how many there are.
    Counting,
    /// Reading one after the other.
    Reading(Vec<Item>),
    /// Said how many are to come.
    Offering,
    /// The autopilot reads; so many items have been asked for at least once, so many questions answered.
    Serving { asked: usize, answered: usize },
}

/// To whom, and of which list, a message is that a transfer takes.
pub(super) fn addressed(message: &MavMessage) -> Option<(Address, MavMissionType)> {
    Some(match message {
        MavMessage::MISSION_COUNT(m) => ((m.target_system, m.target_component), m.mission_type),
        MavMessage::MISSION_ITEM_INT(m) => ((m.target_system, m.target_component), m.mission_type),
        MavMessage::MISSION_REQUEST_INT(m) => ((m.target_system, m.target_component), m.mission_type),
        MavMessage::MISSION_REQUEST(m) => ((m.target_system, m.target_component), m.mission_type),
        MavMessage::MISSION_ACK(m) => ((m.target_system, m.target_component), m.mission_type),
        _ => return None,
    })
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Transfer {
    kind: MavMissionType,
    own: Address,
    target: Address,
    /// What is written, or what is expected to be read.
    items: Vec<Item>,
    stage: Stage,
    sent: u8,
    waits_until: Instant,
}

impl Transfer {
    /// Asks for the list `kind`. Where it has another length than `items`, it is not read any further.
    pub fn read(kind: MavMissionType, items: Vec<Item>, between: (Address, Address), now: Instant) -> Self {
        Self::begin(Stage::Counting, kind, items, between, now)
    }

    /// Gives `items` as the list `kind`, in place of what there is.
    pub fn write(kind: MavMissionType, items: Vec<Item>, between: (Address, Address), now: Instant) -> Self {
        Self::begin(Stage::Offering, kind, items, between, now)
    }

    fn begin(
        stage: Stage,
        kind: MavMissionType,
        items: Vec<Item>,
        (own, target): (Address, Address),
        now: Instant,
    ) -> Self {
        Self { kind, own, target, items, stage, sent: 0, waits_until: now }
    }

    pub fn timeout(&self) -> Instant {
        self.waits_until
    }

    /// Sends what is due; says how it ended if nothing answers.
    pub fn advance(&mut self, now: Instant, out: &mut Outbox) -> Option<Ended> {
        if now < self.waits_until {
            return None;
        }
        match &self.stage {
            // The last word may have been lost: reading tells.
            Stage::Serving { asked, .. } if *asked == self.items.len() => return Some(Ended::Written),
            Stage::Serving { .. } => return Some(Ended::Failed(Failure::Silent)),
            _ if self.sent == ATTEMPTS => return Some(Ended::Failed(Failure::Silent)),
            _ => {}
        }
        self.sent += 1;
        self.ask(now, out);
        None
    }

    /// Takes a message of the autopilot's. Those to others, or of other lists, are none of ours.
    pub fn handle(&mut self, message: &MavMessage, now: Instant, out: &mut Outbox) -> Option<Ended> {
        if addressed(message)? != (self.own, self.kind) {
            return None;
        }
        match message {
            MavMessage::MISSION_COUNT(m) => self.counted(m.count, now, out),
            MavMessage::MISSION_ITEM_INT(m) => self.item(m.seq, Item::heard(m), now, out),
            MavMessage::MISSION_REQUEST_INT(m) => self.asked(m.seq, now, out),
            MavMessage::MISSION_REQUEST(m) => self.asked(m.seq, now, out),
            MavMessage::MISSION_ACK(m) => self.acknowledged(m.mavtype),
            _ => None,
        }
    }

    fn counted(&mut self, count: u16, now: Instant, out: &mut Outbox) -> Option<Ended> {
        // A second answer to a question that was asked twice.
        let Stage::Counting = self.stage else { return None };
        let expected = usize::from(count) == self.items.len();
        if count == 0 || !expected {
            let result = if expected || count == 0 {
                MavMissionResult::MAV_MISSION_ACCEPTED
            } else {
                MavMissionResult::MAV_MISSION_OPERATION_CANCELLED
            };
            self.acknowledge(result, out);
            return Some(if expected { Ended::Read(Vec::new()) } else { Ended::Counted(count) });
        }
        self.stage = Stage::Reading(Vec::with_capacity(self.items.len()));
        self.sent = 1;
        self.ask(now, out);
        None
    }

    fn item(&mut self, seq: u16, item: Item, now: Instant, out: &mut Outbox) -> Option<Ended> {
        let Stage::Reading(read) = &mut self.stage else { return None };
        if usize::from(seq) != read.len() {
            return None;
        }
        read.push(item);
        if read.len() == self.items.len() {
            let read = std::mem::take(read);
            self.acknowledge(MavMissionResult::MAV_MISSION_ACCEPTED, out);
            return Some(Ended::Read(read));
        }
        self.sent = 1;
        self.ask(now, out);
        None
    }

    fn asked(&mut self, seq: u16, now: Instant, out: &mut Outbox) -> Option<Ended> {
        let (asked, answered) = match self.stage {
            Stage::Offering => (0, 0),
            Stage::Serving { asked, answered } => (asked, answered),
            Stage::Counting | Stage::Reading(_) => return None,
        };
        // Each item as often as there are attempts, and no more: nobody makes us talk for ever.
        let most = self.items.len() * usize::from(ATTEMPTS) + usize::from(ATTEMPTS);
        let Some(item) = self.items.get(usize::from(seq)).filter(|_| answered < most) else {
            return Some(Ended::Failed(Failure::Confused));
        };
        out.send(MavMessage::MISSION_ITEM_INT(item.message(self.kind, seq, self.target)));
        self.stage = Stage::Serving { asked: asked.max(usize::from(seq) + 1), answered: answered + 1 };
        self.waits_until = now + READS_WITHIN;
        None
    }

    fn acknowledged(&self, result: MavMissionResult) -> Option<Ended> {
        match (&self.stage, result) {
            (Stage::Serving { asked, .. }, MavMissionResult::MAV_MISSION_ACCEPTED)
                if *asked == self.items.len() =>
            {
                Some(Ended::Written)
            }
            // Of a list without items.
            (Stage::Offering, MavMissionResult::MAV_MISSION_ACCEPTED) if self.items.is_empty() => {
                Some(Ended::Written)
            }
            // Late, of a transfer before this one.
            (_, MavMissionResult::MAV_MISSION_ACCEPTED) => None,
            // ArduPilot's answer to an item that came twice; it goes on.
            (Stage::Serving { .. }, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE) => None,
            (_, result) => Some(Ended::Failed(Failure::Refused(result))),
        }
    }

    fn ask(&mut self, now: Instant, out: &mut Outbox) {
        let (target_system, target_component) = self.target;
        let mission_type = self.kind;
        self.waits_until = now + ANSWER_TIMEOUT;
        out.send(match &self.stage {
            Stage::Counting => MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
                target_system,
                target_component,
                mission_type,
            }),
            Stage::Reading(read) => MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                seq: read.len() as u16,
                target_system,
                target_component,
                mission_type,
            }),
            Stage::Offering | Stage::Serving { .. } => MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                count: self.items.len() as u16,
                target_system,
                target_component,
                mission_type,
                ..MISSION_COUNT_DATA::DEFAULT
            }),
        });
    }

    fn acknowledge(&self, result: MavMissionResult, out: &mut Outbox) {
        out.send(MavMessage::MISSION_ACK(MISSION_ACK_DATA {
            target_system: self.target.0,
            target_component: self.target.1,
            mavtype: result,
            mission_type: self.kind,
            ..MISSION_ACK_DATA::DEFAULT
        }));
    }
}
