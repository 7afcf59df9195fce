//! The MAVLink router aboard: several links, several components, one system id.
//!
//! Rules of <https://mavlink.io/en/guide/routing.html>: a broadcast is taken and passed on to every other link; a
//! message for somebody is passed to the link where that component was heard; what is not known is not passed on.

use std::collections::{BTreeMap, VecDeque};

use mavlink::Message;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, STATUSTEXT_DATA};

use super::COMPANION_LINK;
use super::signing::Signing;
use crate::wire::{self, Decoder, Frame, WireCounters};

/// More links than any vehicle has; a higher number is a caller's mistake and is ignored.
const MAX_LINKS: usize = 16;

/// Who sent something, and over which link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sender {
    pub link: usize,
    pub system_id: u8,
    pub component_id: u8,
}

/// Where a message goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum To {
    /// Every link that has been heard from, and link 0.
    All,
    /// One link.
    Link(usize),
}

#[derive(Debug, Clone, Default)]
struct Link {
    decoder: Decoder,
    active: bool,
    /// Next sequence number of each component on this link.
    sequence: BTreeMap<u8, u8>,
}

/// Messages of the vehicle's components, and frames between its links.
#[derive(Debug, Clone)]
pub(crate) struct Router {
    system_id: u8,
    components: &'static [u8],
    links: Vec<Link>,
    heard: BTreeMap<(u8, u8), usize>,
    out: VecDeque<(usize, Vec<u8>)>,
    signing: Signing,
    text_id: u16,
    /// An order to begin, or to go on, for a component that is not aboard has come by, from others than the companion.
    order_to_fly: bool,
}

/// The command that a message carries to somebody who is not aboard.
fn command_of(message: &MavMessage) -> Option<MavCmd> {
    match message {
        MavMessage::COMMAND_LONG(c) => Some(c.command),
        MavMessage::COMMAND_INT(c) => Some(c.command),
        _ => None,
    }
}

impl Router {
    pub fn new(system_id: u8, components: &'static [u8]) -> Self {
        let links = vec![Link { active: true, ..Link::default() }];
        Self {
            system_id,
            components,
            links,
            heard: BTreeMap::new(),
            out: VecDeque::new(),
            signing: Signing::default(),
            text_id: 0,
            order_to_fly: false,
        }
    }

    pub fn active_links(&self) -> impl Iterator<Item = usize> + '_ {
        self.links.iter().enumerate().filter(|(_, l)| l.active).map(|(k, _)| k)
    }

    pub fn counters(&self) -> WireCounters {
        self.links.iter().fold(WireCounters::default(), |mut sum, link| {
            let c = link.decoder.counters;
            sum.frames += c.frames;
            sum.stray_bytes += c.stray_bytes;
            sum.bad_checksums += c.bad_checksums;
            sum.undecodable += c.undecodable;
            sum.unproven += c.unproven;
            sum
        })
    }

    /// Speaks on a link before anybody is heard there.
    pub fn open(&mut self, link: usize) {
        if link < MAX_LINKS {
            if self.links.len() <= link {
                self.links.resize_with(link + 1, Link::default);
            }
            self.links[link].active = true;
        }
    }

    /// Takes bytes from a link; returns what is for each component aboard.
    pub fn receive(&mut self, link: usize, bytes: &[u8]) -> Vec<(Sender, u8, MavMessage)> {
        if link >= MAX_LINKS {
            return Vec::new();
        }
        if self.links.len() <= link {
            self.links.resize_with(link + 1, Link::default);
        }
        self.links[link].decoder.push(bytes);
        let mut local = Vec::new();
        while let Some(frame) = self.links[link].decoder.next() {
            if !self.signing.admits(link, &frame) {
                self.links[link].decoder.counters.unproven += 1;
                continue;
            }
            self.links[link].active = true;
            self.dispatch(link, frame, &mut local);
        }
        local
    }

    fn dispatch(&mut self, link: usize, frame: Frame, local: &mut Vec<(Sender, u8, MavMessage)>) {
        let sender = Sender { link, system_id: frame.system_id, component_id: frame.component_id };
        if frame.system_id == self.system_id && self.components.contains(&frame.component_id) {
            return; // Our own words, come back over a loop between two links.
        }
        self.heard.insert((frame.system_id, frame.component_id), link);
        let Some(message) = frame.message() else {
            self.links[link].decoder.counters.undecodable += 1;
            if let Some((command, system, component)) = frame.unknown_command() {
                self.forward(link, (system, component), frame.bytes);
                self.refuse(sender, command, (system, component));
            }
            return;
        };
        let target = (message.target_system_id().unwrap_or(0), message.target_component_id().unwrap_or(0));
        let passing_by = command_of(&message).filter(|_| !self.components.contains(&target.1));
        self.order_to_fly |= link != COMPANION_LINK
            && matches!(passing_by, Some(MavCmd::MAV_CMD_MISSION_START | MavCmd::MAV_CMD_DO_PAUSE_CONTINUE));
        // A key goes to nobody for whom it is not meant.
        if !matches!(message, MavMessage::SETUP_SIGNING(_)) {
            self.forward(link, target, frame.bytes);
        }
        if target.0 != 0 && target.0 != self.system_id {
            return;
        }
        for &component in self.components {
            if target.1 == 0 || target.1 == component {
                local.push((sender, component, message.clone()));
            }
        }
    }

    /// Answers a command that has no name, if it is for us; for all components, the first speaks.
    fn refuse(&mut self, to: Sender, command: u16, target: (u8, u8)) {
        let component = self.components.iter().copied().find(|c| target.1 == 0 || target.1 == *c);
        let Some(component) = component.filter(|_| target.0 == 0 || target.0 == self.system_id) else {
            return;
        };
        let sequence = self.next_sequence(to.link, component);
        let from = [self.system_id, component];
        let frame = wire::encode_unsupported(sequence, from, command, [to.system_id, to.component_id]);
        self.out.push_back((to.link, self.signing.seal(to.link, frame)));
    }

    fn forward(&mut self, from: usize, target: (u8, u8), bytes: Vec<u8>) {
        if target.0 == self.system_id && self.components.contains(&target.1) {
            return;
        }
        let mut to = vec![false; self.links.len()];
        for (&(system, component), &link) in &self.heard {
            let meant = target.0 == 0 || (target.0 == system && (target.1 == 0 || target.1 == component));
            to[link] |= meant;
        }
        if target.0 == 0 {
            for link in self.active_links() {
                to[link] = true;
            }
        }
        for (link, _) in to.iter().enumerate().filter(|(link, meant)| **meant && *link != from) {
            self.out.push_back((link, bytes.clone()));
        }
    }

    /// The signing of every link.
    pub fn signing(&mut self) -> &mut Signing {
        &mut self.signing
    }

    /// Whether an operator's order to begin or to go on has passed on its way to a companion since this was last asked.
    pub fn take_order_to_fly(&mut self) -> bool {
        std::mem::take(&mut self.order_to_fly)
    }

    fn next_sequence(&mut self, link: usize, component: u8) -> u8 {
        let counter = self.links[link].sequence.entry(component).or_insert(0);
        let sequence = *counter;
        *counter = counter.wrapping_add(1);
        sequence
    }

    pub fn send(&mut self, to: To, component: u8, message: &MavMessage) {
        self.send_encoded(to, component, |sequence, [system, component]| {
            wire::encode(sequence, system, component, message)
        });
    }

    /// A message that the message crate does not know, by its payload.
    pub fn send_payload(&mut self, to: To, component: u8, id: u32, crc_extra: u8, payload: &[u8]) {
        self.send_encoded(to, component, |sequence, from| {
            wire::encode_payload(sequence, from, id, payload, crc_extra)
        });
    }

    /// Sends what `encode` makes of each link's sequence number and the sender.
    fn send_encoded(&mut self, to: To, component: u8, encode: impl Fn(u8, [u8; 2]) -> Vec<u8>) {
        let links: Vec<usize> = match to {
            To::All => self.active_links().collect(),
            To::Link(link) => vec![link],
        };
        for link in links.into_iter().filter(|&l| l < self.links.len()).collect::<Vec<_>>() {
            let sequence = self.next_sequence(link, component);
            let frame = encode(sequence, [self.system_id, component]);
            self.out.push_back((link, self.signing.seal(link, frame)));
        }
    }

    /// A STATUSTEXT to every link, in as many chunks as it takes.
    pub fn text(
        &mut self,
        component: u8,
        severity: mavlink::dialects::ardupilotmega::MavSeverity,
        text: &str,
    ) {
        let bytes = text.as_bytes();
        let chunked = bytes.len() > 50;
        if chunked {
            self.text_id = self.text_id.wrapping_add(1).max(1);
        }
        for (number, chunk) in bytes.chunks(50).enumerate() {
            let mut field = [0u8; 50];
            field[..chunk.len()].copy_from_slice(chunk);
            let message = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                severity,
                text: field.into(),
                id: if chunked { self.text_id } else { 0 },
                chunk_seq: number as u8,
            });
            self.send(To::All, component, &message);
        }
    }

    /// Passes on a frame of somebody else's.
    pub fn relay(&mut self, link: usize, frame: Vec<u8>) {
        self.out.push_back((link, self.signing.seal(link, frame)));
    }

    pub fn poll_transmit(&mut self) -> Option<(usize, Vec<u8>)> {
        self.out.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::{
        COMMAND_LONG_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavSeverity, MavType,
    };

    fn heartbeat() -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_GCS,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            ..HEARTBEAT_DATA::DEFAULT
        })
    }

    fn command(system: u8, component: u8) -> MavMessage {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
            target_system: system,
            target_component: component,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    }

    fn drain(router: &mut Router) -> Vec<usize> {
        std::iter::from_fn(|| router.poll_transmit()).map(|(link, _)| link).collect()
    }

    #[test]
    fn spec_broadcasts_spread_and_addressed_frames_are_routed() {
        let mut router = Router::new(1, &[1, 68]);
        let taken = router.receive(0, &wire::encode(0, 1, 191, &heartbeat()));
        assert_eq!(taken.iter().map(|(_, c, _)| *c).collect::<Vec<_>>(), [1, 68]);
        assert!(drain(&mut router).is_empty(), "nobody else is there yet");
        router.receive(2, &wire::encode(0, 255, 190, &heartbeat()));
        assert_eq!(drain(&mut router), [0]);
        // From the ground station to the companion: passed on, not ours.
        assert!(router.receive(2, &wire::encode(1, 255, 190, &command(1, 191))).is_empty());
        assert_eq!(drain(&mut router), [0]);
        // To the radio: ours alone.
        assert_eq!(router.receive(2, &wire::encode(2, 255, 190, &command(1, 68))).len(), 1);
        assert!(drain(&mut router).is_empty());
        // To somebody never heard of: dropped.
        assert!(router.receive(2, &wire::encode(3, 255, 190, &command(9, 1))).is_empty());
        assert!(drain(&mut router).is_empty());
        router.send(To::All, 1, &heartbeat());
        assert_eq!(drain(&mut router), [0, 2]);
    }

    #[test]
    fn spec_each_component_counts_its_own_frames_on_each_link() {
        let mut router = Router::new(1, &[1, 68]);
        for component in [1, 68, 1, 1] {
            router.send(To::All, component, &heartbeat());
        }
        let sequences: Vec<(u8, u8)> =
            std::iter::from_fn(|| router.poll_transmit()).map(|(_, f)| (f[6], f[4])).collect();
        assert_eq!(sequences, [(1, 0), (68, 0), (1, 1), (1, 2)]);
    }

    #[test]
    fn spec_an_unnamed_command_is_answered_and_long_texts_are_chunked() {
        let mut router = Router::new(1, &[1, 68]);
        let mut frame = wire::encode(0, 255, 190, &command(1, 1));
        frame[10 + 28..10 + 30].copy_from_slice(&60_001u16.to_le_bytes());
        let body = frame.len() - 2;
        let crc = mavlink::calculate_crc(&frame[1..body], MavMessage::extra_crc(76));
        frame[body..].copy_from_slice(&crc.to_le_bytes());
        assert!(router.receive(0, &frame).is_empty());
        let (_, ack) = router.poll_transmit().unwrap();
        assert_eq!(&ack[10..13], &[0x61, 0xEA, 3]);
        assert_eq!(ack[18..20], [255, 190]);
        router.text(1, MavSeverity::MAV_SEVERITY_INFO, &"x".repeat(120));
        assert_eq!(drain(&mut router).len(), 3);
    }
}
