//! The three drivers of transmitters, commanded and answered at will: an honest radio's answers, late and repeated ones,
//! and lies.

use std::collections::VecDeque;
use std::time::Duration;

use arbitrary::Unstructured;
use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, MavMessage, MavParamExtType, MavParamType, MavResult,
    PARAM_EXT_ACK_DATA, PARAM_EXT_VALUE_DATA, PARAM_VALUE_DATA, ParamAck,
};
use mavlink::{MavHeader, Message};
use veilwing::time::Instant;
use veilwing::transmitter::wire::{
    MavMessage as RadioMessage, VEILWING_RADIO_DATA, VeilwingRadioResult as Is,
};
use veilwing::transmitter::{Kind, Level, PowerParameter, Protocol, Settings, Transmitter, Unit};

use crate::reached::Reached;
use crate::target::Target;
use crate::wire;

/// Numbered commands, which expire on the radio's clock.
pub const NUMBERED: Target = Target {
    name: "transmitter-numbered",
    what: "commands, answers and time to the driver of numbered commands",
    words: &[],
    seeds,
    run: numbered,
    generated: 3000,
};
/// Commands that expire after their receipt: the radio's first form.
pub const LEASED: Target = Target {
    name: "transmitter-leased",
    what: "commands, acknowledgements and time to the driver of commands that count from receipt",
    words: &[],
    seeds,
    run: leased,
    generated: 3000,
};
/// Power by parameter, classic and extended.
pub const PARAMETER: Target = Target {
    name: "transmitter-parameter",
    what: "commands, values and time to the driver of a power parameter",
    words: &[],
    seeds,
    run: parameter,
    generated: 3000,
};

const OWN: (u8, u8) = (1, 191);
const RADIO: (u8, u8) = (1, 68);
const BOOT: u32 = 5;
/// What a report states as power when there is none.
const OFF: i32 = i32::MIN;
/// What it may say at one time: a request for each of the eight facts that a radio declares, a power, and an off.
const MOST_MESSAGES: usize = 10;
const PARAMETER_NAME: &str = "TX_POWER";

fn seeds() -> Vec<Vec<u8>> {
    // Heard, off, time; then on, answered, renewed, silent.
    let settle = [4, 0, 2, 0, 0, 0, 3, 20].repeat(6);
    let serve = [0, 50, 100, 2, 0, 0, 0, 3, 20, 0, 50, 100, 2, 0, 0, 0, 3, 100, 1, 2, 0, 0, 0, 3, 60];
    vec![
        [&settle[..], &serve].concat(),
        vec![0, 6, 0, 0, 3, 50, 0, 50, 100, 6, 0, 0, 3, 50, 1, 3, 200, 6, 0, 0],
    ]
}

fn numbered(input: &[u8], reached: &mut Reached) {
    run(Kind::Numbered { command: 31_010 }, input, reached);
}

fn leased(input: &[u8], reached: &mut Reached) {
    run(Kind::Leased { command: 31_010 }, input, reached);
}

fn parameter(input: &[u8], reached: &mut Reached) {
    let Some((head, rest)) = input.split_first() else { return };
    let unit = match head % 4 {
        0 => Unit::Watt,
        1 => Unit::Milliwatt,
        2 => Unit::Dbm,
        _ => Unit::Levels(vec![Level { value: 1.0, power_w: 0.01 }, Level { value: 2.0, power_w: 0.2 }]),
    };
    let protocol = if head & 4 == 0 { Protocol::Classic } else { Protocol::Extended };
    let off_value = if head & 8 == 0 { 0.0 } else { -60.0 };
    let name = PARAMETER_NAME.to_owned();
    run(Kind::Parameter(PowerParameter { name, protocol, unit, off_value }), rest, reached);
}

struct Bench {
    transmitter: Transmitter,
    now: Instant,
    radio: (u8, u8),
    /// Commands that have left, the newest last.
    commands: VecDeque<COMMAND_INT_DATA>,
    /// Of the honest radio: who commands it, its newest number, its series, what is in force.
    boot: u32,
    newest: u32,
    series: u32,
    power_mdbm: i32,
    expires_ms: u32,
    /// What the parameter was set to last, classic and extended.
    set: (f32, [u8; 128]),
    /// The greatest power and the latest end asked for since it was last told to be silent.
    asked_w: f64,
    off_by: Instant,
}

fn run(kind: Kind, input: &[u8], reached: &mut Reached) {
    let now = Instant::from_start(Duration::from_secs(5));
    let settings = Settings {
        apart: false,
        system_is_given: false,
        own: OWN,
        target: RADIO,
        kind,
        boot: BOOT,
        longest_round_trip: Duration::from_millis(250),
        first_off_after: Duration::ZERO,
    };
    let mut bench = Bench {
        transmitter: Transmitter::new(settings, now),
        now,
        radio: RADIO,
        commands: VecDeque::new(),
        boot: 0,
        newest: 0,
        series: 77,
        power_mdbm: OFF,
        expires_ms: 0,
        set: (0.0, [0; 128]),
        asked_w: 0.0,
        off_by: now,
    };
    bench.drain(reached);
    let mut u = Unstructured::new(input);
    while !u.is_empty() {
        if bench.step(&mut u, reached).is_err() {
            break;
        }
        bench.look(reached);
    }
}

impl Bench {
    fn step(&mut self, u: &mut Unstructured<'_>, reached: &mut Reached) -> arbitrary::Result<()> {
        match u.arbitrary::<u8>()? % 8 {
            0 => {
                let (power, ahead) = (u.arbitrary::<u8>()?, u.arbitrary::<u8>()?);
                self.command(power, Duration::from_millis(5 * u64::from(ahead)), reached);
            }
            1 => {
                self.transmitter.silence(self.now);
                assert_eq!(self.transmitter.on_until_at_least(self.now), None, "told to be silent");
            }
            2 => {
                let (back, change, by) = (u.arbitrary::<u8>()?, u.arbitrary::<u8>()?, u.arbitrary::<u8>()?);
                self.answer(back, change, by);
            }
            3 => {
                let span = Duration::from_millis(u64::from(u.arbitrary::<u8>()?));
                self.pass(span, reached);
            }
            4 => {
                let change = u.arbitrary::<u8>()?;
                let mut report = self.report();
                lie(&mut report, change, 1);
                self.hear(&report);
            }
            5 => {
                // Whatever anybody may say on the common link.
                let from = if u.arbitrary()? { self.radio } else { (2, 1) };
                if let Some(message) = wire::message(u)? {
                    self.transmitter.handle_message(header(from), &message, self.now);
                }
            }
            6 => self.state_parameter(u.arbitrary()?, u.arbitrary()?),
            _ => {
                let system = u.arbitrary::<u8>()?;
                if system < 8 {
                    self.radio.0 = 1 + system;
                    self.transmitter.adopt_system(self.radio.0, self.now);
                    (self.boot, self.newest, self.power_mdbm) = (0, 0, OFF);
                }
            }
        }
        self.drain(reached);
        Ok(())
    }

    fn command(&mut self, power: u8, ahead: Duration, reached: &mut Reached) {
        let power_w = match power {
            255 => f64::NAN,
            254 => f64::INFINITY,
            253 => -1.0,
            252 => 1e-300,
            whole => f64::from(whole) * 1e-2,
        };
        let off_by = self.now + ahead;
        let given = self.transmitter.command(power_w, u16::from(power), off_by, self.now);
        if let Err(why) = &given {
            reached.sentence("not ready", &why.to_string());
        }
        if power_w.is_finite() && power_w > 0.0 {
            (self.asked_w, self.off_by) = (self.asked_w.max(power_w), self.off_by.max(off_by));
        }
    }

    /// What the radio's clock shows: behind ours, and about to wrap.
    fn clock_ms(&self) -> u32 {
        (self.now.since_start().as_millis() as u32).wrapping_add(u32::MAX - 20_000)
    }

    fn report(&self) -> VEILWING_RADIO_DATA {
        VEILWING_RADIO_DATA {
            time_ms: self.clock_ms(),
            boot: self.boot,
            newest: self.newest,
            answers_boot: 0,
            answers: 0,
            series: self.series,
            expires_ms: self.expires_ms,
            power_mdbm: self.power_mdbm,
            result: Is::VEILWING_RADIO_RESULT_ACCEPTED,
        }
    }

    /// Obeys a command of late, and answers it; honestly, if `change` says so.
    fn answer(&mut self, back: u8, change: u8, by: u8) {
        let count = self.commands.len();
        let Some(command) =
            count.checked_sub(1 + usize::from(back)).and_then(|at| self.commands.get(at)).cloned()
        else {
            return;
        };
        let (number, boot) = (command.param2 as u32, command.param3 as u32);
        let result = if boot != self.boot && command.param4 as u32 != self.series {
            Is::VEILWING_RADIO_RESULT_OTHER_SERIES
        } else if boot == self.boot && number <= self.newest {
            Is::VEILWING_RADIO_RESULT_NOT_NEWER
        } else {
            if boot != self.boot {
                self.series += 1;
            }
            (self.boot, self.newest) = (boot, number);
            self.power_mdbm =
                if command.param1.is_finite() { (command.param1 * 1e3).round() as i32 } else { OFF };
            self.expires_ms = command.y.cast_unsigned();
            Is::VEILWING_RADIO_RESULT_ACCEPTED
        };
        let mut report = VEILWING_RADIO_DATA { answers_boot: boot, answers: number, result, ..self.report() };
        lie(&mut report, change, by);
        let acknowledgement = COMMAND_ACK_DATA {
            command: command.command,
            result: if change == 1 { MavResult::MAV_RESULT_DENIED } else { MavResult::MAV_RESULT_ACCEPTED },
            result_param2: report.power_mdbm,
            target_system: OWN.0,
            target_component: OWN.1,
            ..COMMAND_ACK_DATA::DEFAULT
        };
        self.transmitter.handle_message(
            header(self.radio),
            &MavMessage::COMMAND_ACK(acknowledgement),
            self.now,
        );
        self.hear(&report);
    }

    fn hear(&mut self, report: &VEILWING_RADIO_DATA) {
        let message = RadioMessage::VEILWING_RADIO(report.clone());
        self.transmitter.handle_radio(header(self.radio), &message, self.now);
    }

    /// Says the value that the power parameter was set to last, or another, in one of its types.
    fn state_parameter(&mut self, kind: u8, other: u8) {
        let classic = [
            MavParamType::MAV_PARAM_TYPE_REAL32,
            MavParamType::MAV_PARAM_TYPE_INT8,
            MavParamType::MAV_PARAM_TYPE_UINT64,
        ];
        let value = PARAM_VALUE_DATA {
            param_value: if other == 0 { self.set.0 } else { f32::from(other) },
            param_count: 1,
            param_index: 0,
            param_id: PARAMETER_NAME.into(),
            param_type: classic[usize::from(kind) % classic.len()],
        };
        self.transmitter.handle_message(header(self.radio), &MavMessage::PARAM_VALUE(value), self.now);
        let extended = [
            MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32,
            MavParamExtType::MAV_PARAM_EXT_TYPE_UINT8,
            MavParamExtType::MAV_PARAM_EXT_TYPE_INT16,
            MavParamExtType::MAV_PARAM_EXT_TYPE_REAL64,
            MavParamExtType::MAV_PARAM_EXT_TYPE_CUSTOM,
        ];
        let param_type = extended[usize::from(kind) % extended.len()];
        let param_value = if other == 0 { self.set.1 } else { [other; 128] };
        let message = if kind & 0x80 == 0 {
            MavMessage::PARAM_EXT_VALUE(PARAM_EXT_VALUE_DATA {
                param_count: 1,
                param_index: 0,
                param_id: PARAMETER_NAME.into(),
                param_value: param_value.into(),
                param_type,
            })
        } else {
            MavMessage::PARAM_EXT_ACK(PARAM_EXT_ACK_DATA {
                param_id: PARAMETER_NAME.into(),
                param_value: param_value.into(),
                param_type,
                param_result: ParamAck::PARAM_ACK_ACCEPTED,
            })
        };
        self.transmitter.handle_message(header(self.radio), &message, self.now);
    }

    fn pass(&mut self, span: Duration, reached: &mut Reached) {
        let end = self.now + span;
        while let Some((at, _)) = self.transmitter.poll_timeout().filter(|(at, _)| *at <= end) {
            self.now = self.now.max(at);
            self.transmitter.handle_timeout(self.now);
            let next = self.transmitter.poll_timeout();
            assert!(next.is_none_or(|(next, _)| next > self.now), "never satisfied: {next:?}");
            self.drain(reached);
        }
        self.now = end;
    }

    /// What leaves: nothing above what was asked for, nothing that outlives it.
    fn drain(&mut self, reached: &mut Reached) {
        let mut count = 0;
        while let Some(message) = self.transmitter.poll_transmit() {
            count += 1;
            reached.note(format_args!("{}", message.message_name()));
            let command = match message {
                MavMessage::COMMAND_INT(command) => command,
                MavMessage::PARAM_SET(set) => {
                    self.set.0 = set.param_value;
                    continue;
                }
                MavMessage::PARAM_EXT_SET(set) => {
                    self.set.1 = *set.param_value;
                    continue;
                }
                _ => continue,
            };
            assert!(command.param1 == f32::NEG_INFINITY || command.param1.is_finite(), "{command:?}");
            if command.param1.is_finite() {
                let power_w = 1e-3 * 10f64.powf(f64::from(command.param1) / 10.0);
                assert!(power_w <= self.asked_w, "{power_w} W, asked for {} W", self.asked_w);
                reached.note(format_args!("on"));
            }
            self.commands.push_back(command);
            if self.commands.len() > 32 {
                self.commands.pop_front();
            }
        }
        assert!(count <= MOST_MESSAGES, "{count} messages at once");
    }

    fn look(&self, reached: &mut Reached) {
        let (t, now) = (&self.transmitter, self.now);
        if let Some(vouched) = t.on_until_at_least(now) {
            assert!(
                vouched.until > now && vouched.until <= self.off_by,
                "{vouched:?} at {now:?}, off by {:?}",
                self.off_by
            );
            assert!(!vouched.power_w.is_nan() && !t.is_off(now), "{vouched:?}");
            reached.note(format_args!("vouched"));
        }
        let ready = t.ready(now);
        reached.note(format_args!("{} {:?} {}", t.is_off(now), t.supports_expiry(), ready.is_ok()));
        if let Err(why) = ready {
            reached.sentence("not ready", &why.to_string());
        }
        for check in t.preflight(now) {
            reached.note(format_args!("{} {:?}", check.name, check.result));
        }
    }
}

fn header(from: (u8, u8)) -> MavHeader {
    MavHeader { system_id: from.0.into(), component_id: from.1, sequence: 0 }
}

/// Changes one thing of a report, or nothing.
fn lie(report: &mut VEILWING_RADIO_DATA, change: u8, by: u8) {
    let by = u32::from(by);
    match change {
        1 => report.result = Is::VEILWING_RADIO_RESULT_DENIED,
        2 => report.result = Is::VEILWING_RADIO_RESULT_EXPIRED,
        3 => report.result = Is::VEILWING_RADIO_RESULT_NOT_NEWER,
        4 => report.time_ms = report.time_ms.wrapping_add(by << 4),
        5 => report.time_ms = report.time_ms.wrapping_sub(by << 4),
        6 => report.newest = report.newest.wrapping_add(by),
        7 => report.newest = report.newest.wrapping_sub(by),
        8 => report.answers = report.answers.wrapping_sub(by),
        9 => report.boot = by,
        10 => report.answers_boot = by,
        11 => report.series = by,
        12 => report.expires_ms = report.expires_ms.wrapping_add(by << 6),
        13 => report.power_mdbm = OFF,
        14 => report.power_mdbm = i32::MAX,
        15 => report.power_mdbm = report.power_mdbm.saturating_sub(by as i32 * 100),
        16 => report.newest = u32::MAX,
        _ => {}
    }
}
