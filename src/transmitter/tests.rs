//! The transmitter's driver against radios and wires of every manner.

mod bounds;
mod declared;
mod leased;
mod parameter;

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::preflight::Verdict;

const OWN: (u8, u8) = (1, 191);
const RADIO: (u8, u8) = (1, 68);
const STEP: Duration = Duration::from_millis(1);

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// A radio as the documents have it: leased power, an acknowledgement with the achieved thousandths of a dBm.
#[derive(Default)]
struct Radio {
    on: Option<(f64, i32, Instant)>,
    refuses: Option<MavResult>,
    received: Vec<COMMAND_INT_DATA>,
}

impl Radio {
    fn advance(&mut self, now: Instant) {
        self.on = self.on.filter(|(_, _, until)| now < *until);
    }

    fn handle(&mut self, c: &COMMAND_INT_DATA, now: Instant) -> MavMessage {
        self.received.push(c.clone());
        assert_eq!((c.target_system, c.target_component), RADIO);
        if self.refuses.is_none() {
            let off = c.y <= 0 || c.param1 == f32::NEG_INFINITY;
            self.on = (!off).then(|| (f64::from(c.param1), c.x, now + ms(c.y.unsigned_abs().into())));
        }
        MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command: c.command,
            result: self.refuses.unwrap_or(MavResult::MAV_RESULT_ACCEPTED),
            progress: 0,
            result_param2: self.on.map_or(i32::MIN, |(dbm, ..)| (dbm * 1e3).round() as i32),
            target_system: OWN.0,
            target_component: OWN.1,
        })
    }
}

/// What a wire does to a message: when it arrives, once for each copy.
type Wire = Box<dyn FnMut() -> Vec<Duration>>;

struct World {
    now: Instant,
    radio: Radio,
    transmitter: Transmitter,
    wire: Wire,
    there: Vec<(Instant, COMMAND_INT_DATA)>,
    back: Vec<(Instant, MavMessage)>,
    asked: VecDeque<PARAM_REQUEST_READ_DATA>,
}

impl World {
    fn new(wire: impl FnMut() -> Vec<Duration> + 'static) -> Self {
        let now = Instant::from_start(Duration::from_secs(5));
        let transmitter = Transmitter::new(
            Settings {
                own: OWN,
                target: (OWN.0, 68),
                kind: Kind::Leased { command: 31010 },
                boot: 1,
                longest_round_trip: Duration::from_millis(150),
                apart: false,
                system_is_given: false,
                first_off_after: Duration::ZERO,
            },
            now,
        );
        Self {
            now,
            radio: Radio::default(),
            transmitter,
            wire: Box::new(wire),
            there: Vec::new(),
            back: Vec::new(),
            asked: VecDeque::new(),
        }
    }

    fn give(&mut self, message: &MavMessage) {
        let header = MavHeader { system_id: RADIO.0.into(), component_id: RADIO.1, sequence: 0 };
        self.transmitter.handle_message(header, message, self.now);
    }

    fn step(&mut self) {
        self.now = self.now + STEP;
        let now = self.now;
        while self.transmitter.poll_timeout().is_some_and(|(at, _)| at <= now) {
            self.transmitter.handle_timeout(now);
        }
        while let Some(message) = self.transmitter.poll_transmit() {
            match message {
                MavMessage::COMMAND_INT(c) => {
                    self.there.extend((self.wire)().into_iter().map(|delay| (now + delay, c.clone())));
                }
                MavMessage::PARAM_REQUEST_READ(p) => self.asked.push_back(p),
                other => panic!("{other:?}"),
            }
        }
        self.radio.advance(now);
        let (due, later): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.there).into_iter().partition(|(at, _)| *at <= now);
        self.there = later;
        for (_, command) in due {
            let answer = self.radio.handle(&command, now);
            self.back.extend((self.wire)().into_iter().map(|delay| (now + delay, answer.clone())));
        }
        let (due, later): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.back).into_iter().partition(|(at, _)| *at <= now);
        self.back = later;
        due.iter().for_each(|(_, message)| self.give(message));
    }

    fn run(&mut self, span: Duration) {
        let end = self.now + span;
        while self.now < end {
            self.step();
        }
    }
}

fn steady(delay_ms: u64) -> impl FnMut() -> Vec<Duration> {
    move || vec![ms(delay_ms)]
}

/// Settings of a radio that is driven by a parameter, and what it last was set to.
fn by_parameter(unit: Unit, protocol: Protocol) -> Transmitter {
    let kind = Kind::Parameter(PowerParameter { name: "TX_POWER".into(), protocol, unit, off_value: 0.0 });
    Transmitter::new(
        Settings {
            own: OWN,
            target: RADIO,
            kind,
            boot: 1,
            longest_round_trip: Duration::from_millis(150),
            apart: false,
            system_is_given: false,
            first_off_after: Duration::ZERO,
        },
        Instant::ZERO,
    )
}

fn give(transmitter: &mut Transmitter, message: &MavMessage, now: Instant) {
    let header = MavHeader { system_id: RADIO.0.into(), component_id: RADIO.1, sequence: 0 };
    transmitter.handle_message(header, message, now);
}

fn classic(value: f32) -> MavMessage {
    MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_value: value,
        param_count: 1,
        param_index: 0,
        param_id: "TX_POWER".into(),
        param_type: MavParamType::MAV_PARAM_TYPE_UINT8,
    })
}

fn extended(value: u8) -> MavMessage {
    let mut wire = [0u8; 128];
    wire[0] = value;
    MavMessage::PARAM_EXT_VALUE(PARAM_EXT_VALUE_DATA {
        param_count: 1,
        param_index: 0,
        param_id: "TX_POWER".into(),
        param_value: wire.into(),
        param_type: MavParamExtType::MAV_PARAM_EXT_TYPE_UINT8,
    })
}

fn drain(transmitter: &mut Transmitter) -> Vec<MavMessage> {
    std::iter::from_fn(|| transmitter.poll_transmit()).collect()
}
