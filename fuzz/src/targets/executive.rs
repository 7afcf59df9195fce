//! The executive of one vehicle: somewhere in a recorded flight, from where on messages are lost, altered, repeated and
//! made up, the operator gives orders, stations ask for files, and the companion is told to end.

use std::sync::OnceLock;
use std::time::Duration;

use arbitrary::Unstructured;
use mavlink::dialects::ardupilotmega::{
    COMMAND_LONG_DATA, FILE_TRANSFER_PROTOCOL_DATA, MavCmd, MavMessage, MavResult,
};
use mavlink::{MavHeader, MavlinkVersion, Message};
use veilwing::companion::settings::{settings, transmitter_settings};
use veilwing::desk::simulation::{Wire, index, reads_at_start};
use veilwing::link::{Aboard, Envelope, RawFrame};
use veilwing::mission::{Executive, Notice, Outgoing};
use veilwing::pair;
use veilwing::role::{PerVehicle, Role};
use veilwing::time::Instant;
use veilwing::transmitter::Transmitter;

use super::recording::{Heard, Recording, recording};
use crate::reached::Reached;
use crate::target::Target;
use crate::wire;

/// The executive.
pub const TARGET: Target = Target {
    name: "executive",
    what: "a recorded flight, edited, with orders, file requests and made-up messages to the executive",
    words: &[],
    seeds,
    run,
    generated: 150,
};

/// So many messages of the recording are taken by one input at most.
const HORIZON: u32 = 3000;
/// A companion that says more than this at one input floods its links.
const MOST_MESSAGES: usize = 64;
/// One that asks more often than this to be called at one instant would do so for ever.
const MOST_CALLS: u32 = 100;
/// Messages of the recording between two states that an input may begin in.
const BETWEEN_STATES: usize = 500;
/// The operator's commands, in any order.
const ORDERS: [MavCmd; 8] = [
    MavCmd::MAV_CMD_MISSION_START,
    MavCmd::MAV_CMD_USER_2,
    MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH,
    MavCmd::MAV_CMD_DO_PAUSE_CONTINUE,
    MavCmd::MAV_CMD_REQUEST_MESSAGE,
    MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
    MavCmd::MAV_CMD_DO_SET_MODE,
    MavCmd::MAV_CMD_NAV_LAND,
];

fn seeds() -> Vec<Vec<u8>> {
    // At every tenth of the flight of either: a while as it was, then an order.
    let states = (0..12_u8).flat_map(|tenth| [0, 1].map(|role| (role, tenth * 20)));
    states.map(|(role, state)| vec![role, state, 0, 200, 4, state / 20, 0, 0, 200, 0, 200]).collect()
}

/// A companion in the flight.
#[derive(Clone)]
struct Run {
    role: Role,
    executive: Executive,
    /// The next message of the recording.
    next: usize,
    /// Simulation time.
    at: Duration,
    /// A radio kill was accepted, and nobody wanted it lifted since: nothing is on.
    killed: bool,
    reached: Reached,
}

/// States of the recorded flight to begin in.
fn states() -> &'static PerVehicle<Vec<Run>> {
    static STATES: OnceLock<PerVehicle<Vec<Run>>> = OnceLock::new();
    STATES.get_or_init(|| {
        let recording = recording();
        PerVehicle::from_fn(|role| {
            let mut run = Run::new(recording, role);
            let mut states = vec![run.clone()];
            while run.play(&recording.heard[role]) {
                if run.next.is_multiple_of(BETWEEN_STATES) {
                    states.push(run.clone());
                }
            }
            states
        })
    })
}

fn run(input: &[u8], reached: &mut Reached) {
    let [role, state, rest @ ..] = input else { return };
    let role = if role & 1 == 0 { Role::I } else { Role::J };
    let states = &states()[role];
    let mut run = states[usize::from(*state) * states.len() / 256].clone();
    run.reached = Reached::default();
    let heard = &recording().heard[role];
    let mut u = Unstructured::new(rest);
    let begun = run.next as u32;
    while !u.is_empty() && run.next as u32 - begun < HORIZON {
        if run.step(&mut u, heard).is_err() {
            break;
        }
    }
    run.note_outcome();
    reached.join(&run.reached);
}

impl Run {
    fn new(recording: &Recording, role: Role) -> Self {
        // As the simulated flight starts them: I is its first process.
        let boot = 1 + index(role) as u32;
        let vehicle = &recording.vehicles[role];
        let now = Instant::from_start(reads_at_start(role));
        let transmitter = Transmitter::new(transmitter_settings(vehicle, boot), now);
        let settings = settings(&recording.mission, vehicle, boot, true);
        let mut executive = Executive::new(settings, transmitter, now);
        executive.handle_plan(recording.plan.clone());
        let reached = Reached::default();
        let mut run = Self { role, executive, next: 0, at: Duration::ZERO, killed: false, reached };
        run.drain();
        run
    }

    fn now(&self) -> Instant {
        Instant::from_start(reads_at_start(self.role) + self.at)
    }

    /// Lets time go on to `at`, deadline by deadline.
    fn pass(&mut self, at: Duration) {
        let end = Instant::from_start(reads_at_start(self.role) + at);
        let mut calls = 0;
        loop {
            let (due, why) = self.executive.poll_timeout();
            if due > end {
                break;
            }
            if due > self.now() {
                self.at = due.since_start().saturating_sub(reads_at_start(self.role));
                calls = 0;
            }
            calls += 1;
            assert!(calls < MOST_CALLS, "{} asks for ever to be called: {why}", self.role);
            self.executive.handle_timeout(self.now());
            self.drain();
        }
        self.at = self.at.max(at);
    }

    /// The next message of the recording, as it was and when it was; whether there was one.
    fn play(&mut self, heard: &[Heard]) -> bool {
        let Some(message) = heard.get(self.next) else { return false };
        self.next += 1;
        self.pass(message.at.max(self.at));
        self.hear(message.wire, &message.bytes);
        true
    }

    fn hear(&mut self, wire: Wire, bytes: &[u8]) {
        let Some(raw) = RawFrame::from_bytes(bytes) else { return };
        match wire {
            Wire::Autopilot => {
                if let Ok(frame) = raw.parse::<Aboard>() {
                    self.hear_aboard(frame.header, &frame.message);
                }
            }
            // The recorded radio is behind its autopilot.
            Wire::Radio => {}
            Wire::Pair => {
                if let Ok(frame) = raw.parse::<Envelope>() {
                    self.executive.handle_pair(frame.message.message(), self.now());
                    self.drain();
                }
            }
        }
    }

    fn hear_aboard(&mut self, header: MavHeader, message: &Aboard) {
        let (now, lifts) = (self.now(), lifts_the_kill(message));
        match message {
            Aboard::Common(message) => self.executive.handle_autopilot(header, message, now),
            Aboard::Radio(message) => self.executive.handle_radio(header, message.message(), now),
        }
        self.drain();
        self.killed &= !lifts;
    }

    fn step(&mut self, u: &mut Unstructured<'_>, heard: &[Heard]) -> arbitrary::Result<()> {
        match u.arbitrary::<u8>()? % 9 {
            0 => {
                let count: u8 = u.arbitrary()?;
                let _ = (0..count).all(|_| self.play(heard));
            }
            1 => self.next = (self.next + usize::from(u.arbitrary::<u8>()?)).min(heard.len()),
            2 => {
                let (at, to): (u8, u8) = u.arbitrary()?;
                self.play_altered(heard, usize::from(at), to);
            }
            // Again what came a little ago.
            3 => {
                let back = usize::from(u.arbitrary::<u8>()?);
                if let Some(message) = self.next.checked_sub(1 + back).and_then(|at| heard.get(at)) {
                    self.hear(message.wire, &message.bytes);
                }
            }
            4 => {
                let (which, param1): (u8, u8) = u.arbitrary()?;
                self.order(ORDERS[usize::from(which) % ORDERS.len()], f32::from(param1));
            }
            5 => {
                let span = Duration::from_millis(10 * u64::from(u.arbitrary::<u8>()?));
                self.pass(self.at + span);
            }
            6 => {
                let system = 1 + index(self.role) as u32;
                let who: u8 = u.arbitrary()?;
                let (system_id, component_id) =
                    [(system, 1), (system, 68), (255, 190), (system, 1)][usize::from(who) % 4];
                if let Some(message) = wire::message(u)? {
                    let header = MavHeader { system_id, component_id, sequence: 0 };
                    self.hear_aboard(header, &Aboard::Common(message));
                }
            }
            7 => {
                let id = 42_100 + u32::from(u.arbitrary::<u8>()? % 12);
                let mut payload = [0; 255];
                let given = wire::bytes(u)?;
                payload[..given.len()].copy_from_slice(given);
                if let Ok(message) = pair::wire::MavMessage::parse(MavlinkVersion::V2, id, &payload) {
                    self.executive.handle_pair(&message, self.now());
                    self.drain();
                }
            }
            _ => match u.arbitrary::<u8>()? {
                0 => {
                    self.executive.shutdown(self.now());
                    self.drain();
                }
                opcode => self.ask_for_a_file(opcode % 20, u)?,
            },
        }
        self.reached.note(format_args!("{} {}", self.role, self.executive.phase_name()));
        Ok(())
    }

    /// The next message, a byte of its payload other than it was.
    fn play_altered(&mut self, heard: &[Heard], at: usize, to: u8) {
        let Some(message) = heard.get(self.next) else { return };
        self.next += 1;
        let frame = &message.bytes;
        if frame.first() == Some(&0xFD) && frame.len() > 12 {
            let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
            let mut payload = frame[10..frame.len() - 2].to_vec();
            let length = payload.len();
            if let Some(byte) = payload.get_mut(at % length) {
                *byte = to;
            }
            let from = (frame[5], frame[6]);
            self.pass(message.at.max(self.at));
            let altered = match message.wire {
                Wire::Autopilot | Wire::Radio => wire::frame_v2::<Aboard>(from, frame[4], id, &payload),
                Wire::Pair => wire::frame_v2::<Envelope>(from, frame[4], id, &payload),
            };
            self.hear(message.wire, &altered);
        }
    }

    /// A ground station's command.
    fn order(&mut self, command: MavCmd, param1: f32) {
        let order = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command,
            param1,
            target_system: 1 + index(self.role) as u8,
            target_component: 191,
            ..COMMAND_LONG_DATA::DEFAULT
        });
        let station = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
        self.hear_aboard(station, &Aboard::Common(order));
    }

    /// A station's request by MAVLink FTP: of a file that is there, or of anything.
    fn ask_for_a_file(&mut self, opcode: u8, u: &mut Unstructured<'_>) -> arbitrary::Result<()> {
        let (who, session, offset, named): (u8, u8, u16, u8) = u.arbitrary()?;
        let mut payload = [0; 251];
        payload[2..4].copy_from_slice(&[session % 6, opcode]);
        payload[8..10].copy_from_slice(&offset.to_le_bytes());
        let given = match named % 4 {
            0 => b"general.json",
            1 => b"parameter.json".as_slice(),
            2 => b"/",
            _ => wire::bytes(u)?,
        };
        let given = &given[..given.len().min(239)];
        payload[4] = if named < 250 { given.len() as u8 } else { named };
        payload[12..12 + given.len()].copy_from_slice(given);
        let asked = MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: 1 + index(self.role) as u8,
            target_component: 191,
            payload,
        });
        let station = MavHeader { system_id: 250 + u32::from(who % 6), component_id: 190, sequence: 0 };
        self.hear_aboard(station, &Aboard::Common(asked));
        Ok(())
    }

    /// What is said: nothing above the plan's power, nothing on after a kill, no flood, no figure that is none.
    fn drain(&mut self) {
        let mut count = 0;
        while let Some(record) = self.executive.poll_record() {
            self.executive.handle_recorded(record, self.now());
        }
        while let Some(outgoing) = self.executive.poll_transmit() {
            count += 1;
            match outgoing {
                Outgoing::Pair(message) => {
                    self.reached.note(format_args!("{} {}", self.role, message.message_name()));
                }
                Outgoing::Autopilot(message) | Outgoing::Radio(message) => self.look_at(&message),
            }
        }
        assert!(count <= MOST_MESSAGES, "{}: {count} messages at once", self.role);
        while let Some(notice) = self.executive.poll_notice() {
            self.note(&notice);
        }
    }

    fn look_at(&mut self, message: &MavMessage) {
        self.reached.note(format_args!("{} {}", self.role, message.message_name()));
        match message {
            MavMessage::COMMAND_INT(c) if c.command == MavCmd::MAV_CMD_USER_1 && c.param1.is_finite() => {
                let power_w = 1e-3 * 10f64.powf(f64::from(c.param1) / 10.0);
                let slots = &recording().plan.slots;
                let most = slots.iter().map(|slot| slot.plan.vehicles[self.role].tx_power_w);
                let most = most.fold(0.0, f64::max);
                assert!(power_w <= most * (1.0 + 1e-9), "{}: {power_w} W of {most} W", self.role);
                assert!(!self.killed, "{}: on after a kill", self.role);
                self.reached.note(format_args!("{} on", self.role));
            }
            MavMessage::COMMAND_ACK(ack) => {
                self.killed |=
                    ack.command == MavCmd::MAV_CMD_USER_2 && ack.result == MavResult::MAV_RESULT_ACCEPTED;
                self.reached.note(format_args!("{:?} {:?}", ack.command, ack.result));
            }
            MavMessage::FILE_TRANSFER_PROTOCOL(m) => {
                assert!(m.payload[4] <= 239 && [128, 129].contains(&m.payload[3]), "{m:?}");
                self.reached.note(format_args!("file {} {}", m.payload[5], m.payload[3]));
            }
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => {
                assert!([m.x, m.y, m.z, m.vx, m.vy, m.vz, m.yaw].iter().all(|v| v.is_finite()), "{m:?}");
            }
            MavMessage::SET_ATTITUDE_TARGET(m) => {
                assert!(m.q.iter().chain(&m.thrust_body).all(|v| v.is_finite()), "{m:?}");
            }
            _ => {}
        }
    }

    fn note(&mut self, notice: &Notice) {
        self.reached.sentence("notice", &format!("{} {notice:?}", self.role));
    }

    fn note_outcome(&mut self) {
        if let Some(outcome) = self.executive.outcome() {
            self.reached.sentence("outcome", &format!("{} {outcome:?}", self.role));
        }
    }
}

/// Whether somebody wants the radio kill lifted, which is accepted at once or not at all.
fn lifts_the_kill(message: &Aboard) -> bool {
    let (command, param1) = match message {
        Aboard::Common(MavMessage::COMMAND_LONG(c)) => (c.command, c.param1),
        Aboard::Common(MavMessage::COMMAND_INT(c)) => (c.command, c.param1),
        _ => return false,
    };
    command == MavCmd::MAV_CMD_USER_2 && param1 == 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use veilwing::mission::Outcome;

    #[test]
    fn spec_the_recorded_flight_is_flown_again_to_its_end_by_its_messages_alone() {
        let recording = recording();
        for role in Role::BOTH {
            let mut run = Run::new(recording, role);
            while run.play(&recording.heard[role]) {}
            assert_eq!(run.executive.outcome(), Some(Outcome::Completed), "{role} at {:?}", run.at);
            assert!(states()[role].len() > 10, "{}", states()[role].len());
        }
    }
}
