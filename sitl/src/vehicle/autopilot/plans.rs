//! The lists that a station gives an autopilot by the mission protocol: its fence and its rally points. What it flies by itself
//! (missions) it has none of.
//! <https://mavlink.io/en/services/mission.html>
//!
//! The firmwares' ways: PX4 asks for items by MISSION_REQUEST_INT, again after 0.25 s, for 5 s; ArduCopter by MISSION_REQUEST, again
//! after a second, for 8 s. Who comes while another one writes is answered MAV_MISSION_ERROR by PX4, MAV_MISSION_DENIED by ArduCopter;
//! PX4 leaves a question for the list unanswered then. An item out of turn PX4 ignores, ArduCopter answers
//! MAV_MISSION_INVALID_SEQUENCE and goes on. PX4 gives items out in their order alone.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;

use super::super::router::{Router, Sender, To};
use super::{Autopilot, COMPONENT};
use crate::vehicle::config::Firmware;

/// PX4's storage, and what ArduPilot counts in one byte.
const MOST: [usize; 2] = [64, 255];
const RALLY_MOST: usize = 32;

/// The lists that are kept.
const KINDS: [MavMissionType; 2] =
    [MavMissionType::MAV_MISSION_TYPE_FENCE, MavMissionType::MAV_MISSION_TYPE_RALLY];

/// A list on its way in.
#[derive(Debug, Clone)]
struct Incoming {
    kind: usize,
    from: Sender,
    count: usize,
    items: Vec<MISSION_ITEM_INT_DATA>,
    asked_at: Duration,
    heard_at: Duration,
}

/// A list on its way out: to whom, which, and the next item's number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Outgoing {
    kind: usize,
    to: (u8, u8),
    next: u16,
}

/// What is kept, and what is on its way.
#[derive(Debug, Clone, Default)]
pub(super) struct Plans {
    kept: [Vec<MISSION_ITEM_INT_DATA>; 2],
    incoming: Option<Incoming>,
    outgoing: Option<Outgoing>,
    /// PX4 answers its last item again if that comes again: from whom, its list and number.
    last: Option<((u8, u8), usize, u16)>,
    /// Counts the fences that were written.
    pub revision: u32,
}

impl Plans {
    /// What outlives a restart.
    pub fn kept(&self) -> Self {
        Self { kept: self.kept.clone(), revision: self.revision + 1, ..Self::default() }
    }

    /// The items of the fence.
    pub fn fence(&self) -> &[MISSION_ITEM_INT_DATA] {
        &self.kept[0]
    }

    /// The rally points.
    pub fn rally(&self) -> &[MISSION_ITEM_INT_DATA] {
        &self.kept[1]
    }
}

/// Whether a message is of the mission protocol.
pub(super) fn is_one(message: &MavMessage) -> bool {
    matches!(
        message,
        MavMessage::MISSION_REQUEST_LIST(_)
            | MavMessage::MISSION_REQUEST_INT(_)
            | MavMessage::MISSION_REQUEST(_)
            | MavMessage::MISSION_COUNT(_)
            | MavMessage::MISSION_ITEM_INT(_)
            | MavMessage::MISSION_CLEAR_ALL(_)
            | MavMessage::MISSION_ACK(_)
    )
}

fn number(kind: MavMissionType) -> Option<usize> {
    KINDS.iter().position(|known| *known == kind)
}

impl Autopilot {
    pub(super) fn handle_plan(
        &mut self,
        from: Sender,
        message: &MavMessage,
        now: Duration,
        router: &mut Router,
    ) {
        match message {
            MavMessage::MISSION_REQUEST_LIST(m) => self.list_asked(from, m.mission_type, router),
            MavMessage::MISSION_REQUEST_INT(m) => {
                self.item_asked(from, m.mission_type, m.seq, true, router);
            }
            MavMessage::MISSION_REQUEST(m) => self.item_asked(from, m.mission_type, m.seq, false, router),
            MavMessage::MISSION_COUNT(m) => self.list_offered(from, m.mission_type, m.count, now, router),
            MavMessage::MISSION_ITEM_INT(m) => self.item_given(from, m, now, router),
            MavMessage::MISSION_CLEAR_ALL(m) => self.clear(from, m.mission_type, router),
            MavMessage::MISSION_ACK(_) => {
                let to = (from.system_id, from.component_id);
                self.plans.outgoing = self.plans.outgoing.filter(|outgoing| outgoing.to != to);
            }
            _ => {}
        }
    }

    /// Asks for an item again, or gives up.
    pub(super) fn watch_plans(&mut self, now: Duration, router: &mut Router) {
        let Some(incoming) = &mut self.plans.incoming else { return };
        let (again, patience) = match self.firmware {
            Firmware::Px4 => (Duration::from_millis(250), Duration::from_secs(5)),
            Firmware::ArduCopter => (Duration::from_secs(1), Duration::from_secs(8)),
        };
        if now.saturating_sub(incoming.heard_at) > patience {
            let (from, kind) = (incoming.from, KINDS[incoming.kind]);
            self.plans.incoming = None;
            self.text(MavSeverity::MAV_SEVERITY_WARNING, "Plan upload timeout", router);
            if self.firmware == Firmware::ArduCopter {
                self.conclude(from, kind, MavMissionResult::MAV_MISSION_OPERATION_CANCELLED, router);
            }
        } else if now.saturating_sub(incoming.asked_at) > again {
            incoming.asked_at = now;
            self.ask_for_item(router);
        }
    }

    fn list_asked(&mut self, from: Sender, kind: MavMissionType, router: &mut Router) {
        if self.plans.incoming.is_some() {
            match self.firmware {
                Firmware::Px4 => {
                    self.text(MavSeverity::MAV_SEVERITY_INFO, "Mission download request ignored", router);
                }
                Firmware::ArduCopter => {
                    self.conclude(from, kind, MavMissionResult::MAV_MISSION_DENIED, router);
                }
            }
            return;
        }
        let count = match (kind, number(kind)) {
            (_, Some(kind)) => self.plans.kept[kind].len(),
            (MavMissionType::MAV_MISSION_TYPE_MISSION, _) => 0,
            _ => return self.conclude(from, kind, MavMissionResult::MAV_MISSION_UNSUPPORTED, router),
        };
        let to = (from.system_id, from.component_id);
        self.plans.outgoing = number(kind).map(|kind| Outgoing { kind, to, next: 0 });
        let reply = MISSION_COUNT_DATA {
            count: count as u16,
            target_system: from.system_id,
            target_component: from.component_id,
            mission_type: kind,
            ..MISSION_COUNT_DATA::DEFAULT
        };
        router.send(To::Link(from.link), COMPONENT, &MavMessage::MISSION_COUNT(reply));
    }

    fn item_asked(&mut self, from: Sender, kind: MavMissionType, seq: u16, int: bool, router: &mut Router) {
        let Some(list) = number(kind) else {
            return self.conclude(from, kind, MavMissionResult::MAV_MISSION_ERROR, router);
        };
        if self.firmware == Firmware::ArduCopter && self.plans.incoming.is_some() {
            return self.conclude(from, kind, MavMissionResult::MAV_MISSION_DENIED, router);
        }
        if self.firmware == Firmware::Px4 {
            let to = (from.system_id, from.component_id);
            let Some(outgoing) = self.plans.outgoing.as_mut().filter(|o| o.to == to && o.kind == list) else {
                return;
            };
            if seq != outgoing.next && seq + 1 != outgoing.next {
                self.plans.outgoing = None;
                return self.conclude(from, kind, MavMissionResult::MAV_MISSION_ERROR, router);
            }
            outgoing.next = seq + 1;
        }
        let Some(item) = self.plans.kept[list].get(usize::from(seq)) else {
            return self.conclude(from, kind, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE, router);
        };
        let item = MISSION_ITEM_INT_DATA {
            seq,
            target_system: from.system_id,
            target_component: from.component_id,
            ..item.clone()
        };
        let message = if int {
            MavMessage::MISSION_ITEM_INT(item)
        } else {
            let degrees = |e7: i32| (f64::from(e7) * 1e-7) as f32;
            MavMessage::MISSION_ITEM(MISSION_ITEM_DATA {
                param1: item.param1,
                x: degrees(item.x),
                y: degrees(item.y),
                z: item.z,
                seq,
                command: item.command,
                target_system: item.target_system,
                target_component: item.target_component,
                frame: item.frame,
                mission_type: kind,
                ..MISSION_ITEM_DATA::DEFAULT
            })
        };
        router.send(To::Link(from.link), COMPONENT, &message);
    }

    fn list_offered(
        &mut self,
        from: Sender,
        kind: MavMissionType,
        count: u16,
        now: Duration,
        router: &mut Router,
    ) {
        let same = |one: Sender| (one.system_id, one.component_id) == (from.system_id, from.component_id);
        let busy = match (&self.plans.incoming, self.firmware) {
            (None, _) => None,
            (Some(i), Firmware::Px4) if !same(i.from) || !i.items.is_empty() => {
                Some(MavMissionResult::MAV_MISSION_ERROR)
            }
            (Some(i), Firmware::ArduCopter) if !same(i.from) => Some(MavMissionResult::MAV_MISSION_DENIED),
            (Some(_), _) => None,
        };
        if let Some(busy) = busy {
            return self.conclude(from, kind, busy, router);
        }
        let Some(list) = number(kind) else {
            return self.conclude(from, kind, MavMissionResult::MAV_MISSION_UNSUPPORTED, router);
        };
        let most = match (list, self.firmware) {
            (0, Firmware::Px4) => MOST[0],
            (0, Firmware::ArduCopter) => MOST[1],
            _ => RALLY_MOST,
        };
        let count = usize::from(count);
        if count > most {
            return self.conclude(from, kind, MavMissionResult::MAV_MISSION_NO_SPACE, router);
        }
        self.plans.incoming = None;
        if count == 0 {
            self.keep(list, Vec::new());
            return self.conclude(from, kind, MavMissionResult::MAV_MISSION_ACCEPTED, router);
        }
        self.plans.outgoing = None;
        let items = Vec::with_capacity(count);
        self.plans.incoming = Some(Incoming { kind: list, from, count, items, asked_at: now, heard_at: now });
        self.ask_for_item(router);
    }

    fn ask_for_item(&self, router: &mut Router) {
        let Some(incoming) = &self.plans.incoming else { return };
        let seq = incoming.items.len() as u16;
        let (target_system, target_component) = (incoming.from.system_id, incoming.from.component_id);
        let mission_type = KINDS[incoming.kind];
        let message = match self.firmware {
            Firmware::Px4 => MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            }),
            Firmware::ArduCopter => MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            }),
        };
        router.send(To::Link(incoming.from.link), COMPONENT, &message);
    }

    fn item_given(&mut self, from: Sender, m: &MISSION_ITEM_INT_DATA, now: Duration, router: &mut Router) {
        let address = (from.system_id, from.component_id);
        let Some(incoming) = &mut self.plans.incoming else {
            let again =
                number(m.mission_type).is_some_and(|kind| self.plans.last == Some((address, kind, m.seq)));
            let result = if self.firmware == Firmware::Px4 && again {
                MavMissionResult::MAV_MISSION_ACCEPTED
            } else {
                MavMissionResult::MAV_MISSION_ERROR
            };
            return self.conclude(from, m.mission_type, result, router);
        };
        let whose = (incoming.from.system_id, incoming.from.component_id);
        if whose != address || m.mission_type != KINDS[incoming.kind] {
            let result = match self.firmware {
                Firmware::Px4 => MavMissionResult::MAV_MISSION_ERROR,
                Firmware::ArduCopter => MavMissionResult::MAV_MISSION_DENIED,
            };
            return self.conclude(from, m.mission_type, result, router);
        }
        if usize::from(m.seq) != incoming.items.len() {
            if self.firmware == Firmware::ArduCopter {
                let result = MavMissionResult::MAV_MISSION_INVALID_SEQUENCE;
                self.conclude(from, m.mission_type, result, router);
            }
            return;
        }
        let fault = fault(m, incoming.kind, self.firmware);
        if let Some(fault) = fault {
            self.plans.incoming = None;
            return self.conclude(from, m.mission_type, fault, router);
        }
        (incoming.heard_at, incoming.asked_at) = (now, now);
        incoming.items.push(m.clone());
        if incoming.items.len() < incoming.count {
            return self.ask_for_item(router);
        }
        let (kind, items) = (incoming.kind, std::mem::take(&mut incoming.items));
        self.plans.incoming = None;
        self.plans.last = Some((address, kind, m.seq));
        let whole = self.firmware == Firmware::Px4 || kind != 0 || counts_agree(&items);
        let result = if whole {
            self.keep(kind, items);
            MavMissionResult::MAV_MISSION_ACCEPTED
        } else {
            MavMissionResult::MAV_MISSION_ERROR
        };
        self.conclude(from, m.mission_type, result, router);
    }

    fn clear(&mut self, from: Sender, kind: MavMissionType, router: &mut Router) {
        if self.plans.incoming.is_some() {
            return self.conclude(from, kind, MavMissionResult::MAV_MISSION_ERROR, router);
        }
        for (list, known) in KINDS.into_iter().enumerate() {
            if kind == known || kind == MavMissionType::MAV_MISSION_TYPE_ALL {
                self.keep(list, Vec::new());
            }
        }
        self.conclude(from, kind, MavMissionResult::MAV_MISSION_ACCEPTED, router);
    }

    fn keep(&mut self, list: usize, items: Vec<MISSION_ITEM_INT_DATA>) {
        self.plans.kept[list] = items;
        self.plans.revision += 1;
    }

    fn conclude(&self, to: Sender, kind: MavMissionType, result: MavMissionResult, router: &mut Router) {
        let ack = MISSION_ACK_DATA {
            target_system: to.system_id,
            target_component: to.component_id,
            mavtype: result,
            mission_type: kind,
            ..MISSION_ACK_DATA::DEFAULT
        };
        router.send(To::Link(to.link), COMPONENT, &MavMessage::MISSION_ACK(ack));
    }
}

/// What is wrong with an item.
fn fault(item: &MISSION_ITEM_INT_DATA, kind: usize, firmware: Firmware) -> Option<MavMissionResult> {
    let relative = matches!(
        item.frame,
        MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    );
    let global =
        relative || matches!(item.frame, MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT);
    let polygon = matches!(
        item.command,
        MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
            | MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    );
    let known = match kind {
        0 => {
            polygon
                || matches!(
                    item.command,
                    MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT
                        | MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
                        | MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
                )
        }
        _ => item.command == MavCmd::MAV_CMD_NAV_RALLY_POINT,
    };
    if !global || (kind == 1 && firmware == Firmware::ArduCopter && !relative) {
        Some(MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME)
    } else if !known {
        Some(MavMissionResult::MAV_MISSION_UNSUPPORTED)
    } else if polygon && firmware == Firmware::Px4 && item.param1 < 3.0 {
        Some(MavMissionResult::MAV_MISSION_ERROR)
    } else {
        None
    }
}

/// Whether each polygon has as many corners as its corners say.
fn counts_agree(items: &[MISSION_ITEM_INT_DATA]) -> bool {
    let mut at = 0;
    while let Some(item) = items.get(at) {
        let polygon = matches!(
            item.command,
            MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
                | MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
        );
        let corners = if polygon { item.param1 as usize } else { 1 };
        let alike = items.get(at..at + corners).is_some_and(|all| {
            all.iter().all(|other| other.command == item.command && other.param1 == item.param1)
        });
        if !alike || polygon && corners < 3 {
            return false;
        }
        at += corners;
    }
    true
}
