//! What anybody who reaches an autopilot's link can do with frames that claim to be the autopilot's, the radio's or the
//! operator's: everything where the link is not signed, nothing where it is.
//!
//! `cargo test --test flight forged -- --nocapture` prints the table.

use std::time::Duration;

use mavlink::MAVLinkV2MessageRaw;
use mavlink::dialects::ardupilotmega::*;
use veilwing::link::codec::Encoder;
use veilwing::link::gate::{Arrival, Gate, GateConfig};
use veilwing::link::signing::{Keeper, Signing, timestamp};
use veilwing::link::{Aboard, Form, Key, Origin, RawFrame, Rejection, SigningConfig, envelope::Enclosed};
use veilwing::role::Role;
use veilwing::time::{Instant, Utc};
use veilwing::transmitter::wire;

use crate::harness::*;

const KEY: [u8; 32] = [0x5A; 32];
const UTC: Utc = Utc { unix_us: 1_800_000_000_000_000 };
const HOUR: Duration = Duration::from_secs(3600);

/// A frame, and whose it claims to be.
struct Forgery {
    what: &'static str,
    from: (u8, u8),
    message: Aboard,
    /// On the ground, or in a slot.
    in_slot: bool,
}

fn forgeries() -> Vec<Forgery> {
    let common = Aboard::Common;
    let mode = |custom_mode, base_mode| {
        common(MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode,
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode,
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        }))
    };
    let command = |command, component| {
        common(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command,
            target_system: 1,
            target_component: component,
            ..COMMAND_LONG_DATA::DEFAULT
        }))
    };
    let report = |power_mdbm| {
        let report = wire::VEILWING_RADIO_DATA {
            newest: 16_000_000,
            power_mdbm,
            ..wire::VEILWING_RADIO_DATA::default()
        };
        Aboard::Radio(Enclosed::new(Form::Plain, (1, 68), 0, wire::MavMessage::VEILWING_RADIO(report)))
    };
    let written = |name: &str, value, from: bool| {
        common(if from {
            MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
                param_value: value,
                param_count: 1,
                param_index: 0,
                param_id: name.into(),
                param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
            })
        } else {
            MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_value: value,
                target_system: 1,
                target_component: 191,
                param_id: name.into(),
                param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
            })
        })
    };
    let armed = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED | MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    let row = |what, from, message, in_slot| Forgery { what, from, message, in_slot };
    vec![
        row("the operator's start", (255, 190), command(MavCmd::MAV_CMD_MISSION_START, 191), false),
        row("the operator's kill", (255, 190), command(MavCmd::MAV_CMD_USER_2, 191), true),
        row("the operator's return", (255, 190), command(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, 191), true),
        row("a stranger's kill", (254, 190), command(MavCmd::MAV_CMD_USER_2, 191), true),
        row("the operator's tolerance", (255, 190), written("VW_POS_TOL_M", 0.1, false), true),
        row("autopilot: the pilot's mode", (1, 1), mode(3 << 16, armed), true),
        row("autopilot: disarmed", (1, 1), mode(6 << 16, MavModeFlag::empty()), true),
        row(
            "autopilot: elsewhere",
            (1, 1),
            common(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                x: 500.0,
                ..LOCAL_POSITION_NED_DATA::DEFAULT
            })),
            true,
        ),
        row(
            "autopilot: on its back",
            (1, 1),
            common(MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                q2: 1.0,
                ..ATTITUDE_QUATERNION_DATA::DEFAULT
            })),
            true,
        ),
        row("radio: off, by a number to come", (1, 68), report(i32::MIN), true),
        row("radio: at most -40 dBm", (1, 68), written("TX_MAX_DBM", -40.0, true), true),
    ]
}

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

fn signing(key: [u8; 32], at: Utc) -> Signing {
    let config = SigningConfig {
        key: Key::new(key),
        link_id: 0,
        state_file: "none".into(),
        unsigned_allowed: Vec::new(),
    };
    let from = timestamp(at);
    Signing::with_keeper(config, Box::new(Prompt(from)), from)
}

fn before(utc: Utc, time: Duration) -> Utc {
    Utc { unix_us: utc.unix_us - time.as_micros() as u64 }
}

/// The frame signed with this key at this time.
fn signed(forgery: &Forgery, key: [u8; 32], at: Utc) -> RawFrame {
    let mut raw: MAVLinkV2MessageRaw = Encoder::default().encode_for_signing(forgery.from, &forgery.message);
    signing(key, before(at, Duration::from_millis(1))).sign(&mut raw, at).unwrap();
    RawFrame::V2(raw)
}

/// What a signed link says to a frame: as it is, signed with another key, and recorded on the link an hour ago.
fn through_the_gate(forgery: &Forgery) -> [Result<bool, Rejection>; 3] {
    let config = GateConfig {
        peer_system: Some(1),
        accept_foreign: true,
        signing: Some(signing(KEY, before(UTC, 2 * HOUR))),
        ..GateConfig::default()
    };
    let mut gate = Gate::<Aboard>::new(config, UTC);
    gate.speak_as((1, 191));
    let plain = RawFrame::V2(Encoder::default().encode(forgery.from, &forgery.message));
    let at = Arrival { origin: Origin::Peer, now: Instant::ZERO, utc: UTC };
    [plain, signed(forgery, [7; 32], UTC), signed(forgery, KEY, before(UTC, HOUR))]
        .map(|raw| gate.admit(&raw, at).map(|frame| frame.is_some()))
}

/// What a flight comes to, in a line.
#[derive(Debug, Clone, PartialEq)]
struct Course {
    took_off: bool,
    radiated_s: f64,
    /// What the companions said, and when.
    notices: Vec<(Duration, Role, String)>,
}

/// Flies on the ground or into a slot, then with these frames fifty times in a second, then on.
fn course(in_slot: bool, frames: &[Vec<u8>]) -> Course {
    let mut flight = Flight::new(Setup { start_unasked: in_slot, ..Setup::default() });
    if in_slot {
        assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
        flight.pass(Duration::from_millis(500));
    } else {
        flight.pass(Duration::from_secs(20));
    }
    for _ in 0..50 {
        frames.iter().for_each(|frame| flight.send_to_companion(Role::I, frame));
        flight.pass(Duration::from_millis(20));
    }
    flight.pass(Duration::from_secs(60));
    let report = flight.report();
    let radiated_s = report.slots.iter().map(|slot| slot.radiated_s.i + slot.radiated_s.j).sum();
    Course {
        took_off: flight.said(Role::I, "taking off").is_some(),
        radiated_s,
        notices: flight.log.notices.clone(),
    }
}

fn changed(course: &Course, undisturbed: &Course) -> String {
    if course == undisturbed {
        return "nothing".to_owned();
    }
    let (on, of) = (course.radiated_s, undisturbed.radiated_s);
    let took_off = if course.took_off && !undisturbed.took_off { "takes off; " } else { "" };
    let mut new = course.notices.iter().filter(|notice| !undisturbed.notices.contains(notice));
    let said: String = new.next().map_or("nothing is said", |(_, _, text)| text).chars().take(70).collect();
    format!("{took_off}on the air {on:.1} s of {of:.1} s; {said}")
}

#[test]
fn spec_forged_frames_change_nothing_where_the_link_is_signed() {
    let undisturbed = [false, true].map(|in_slot| course(in_slot, &[]));
    assert!(undisturbed[1].radiated_s > 10.0 && undisturbed[0].radiated_s == 0.0);
    println!("forged frame                     signed link: nothing, since          unsigned link");
    let mut got_in = Vec::new();
    for forgery in forgeries() {
        let [plain, other_key, recorded] = through_the_gate(&forgery);
        let reasons = [plain, other_key, recorded].map(|verdict| match verdict {
            Ok(_) => {
                got_in.push(forgery.what);
                "TAKEN"
            }
            Err(reason) => reason.as_str(),
        });
        let frame = Encoder::default().encode(forgery.from, &forgery.message).raw_bytes().to_vec();
        let unsigned = course(forgery.in_slot, &[frame]);
        let what = changed(&unsigned, &undisturbed[usize::from(forgery.in_slot)]);
        println!("{:32} {:36} {what}", forgery.what, reasons.join(", "));
        assert_eq!(
            [plain, other_key, recorded],
            [Err(Rejection::Unsigned), Err(Rejection::WrongSignature), Err(Rejection::TooOld)],
            "{}",
            forgery.what
        );
        // The table shows what signing is for. A radio's report must name the companion's boot: this forger has not listened.
        assert_eq!(what == "nothing", forgery.what.starts_with("radio: off"), "{}", forgery.what);
        // What the list of operators keeps out is told, and changes nothing else.
        if forgery.from.0 == 254 {
            assert!((unsigned.radiated_s - undisturbed[1].radiated_s).abs() < 0.01, "{what}");
        }
    }
    assert!(got_in.is_empty(), "{got_in:?}");
}
