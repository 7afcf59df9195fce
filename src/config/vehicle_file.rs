//! Every setting of the vehicle file, declared once: key, kind, range, unit, default, sentence.

use std::path::PathBuf;

use super::kind::{Choice, Flag, ID, Integer, List, Number, Numbers, Parsed, Text, byte};
use super::mission_file::{climb, power, speed, tilt, tilt_rate};
use super::reader::Section;
use super::vehicle_draft::{Autopilot, BatteryDraft, Limits, LogLimits, Transmitter, VehicleDraft};
use crate::autopilot::{Actuation, FenceDuty, FirmwareChoice};
use crate::link::LinkAddress;
use crate::role::Role;
use crate::transmitter::{Kind, Level, PowerParameter, Protocol, Unit};

const PATH: Text = Text { max_chars: 4096 };
const LINK: Parsed<LinkAddress> = Parsed::new(
    "a link: udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT or serial:PATH:BAUD",
);
const NEWTONS: Number = Number::within("N", 0.01, 1e5);
/// Up to a petabyte.
const MEGABYTES: Integer = Integer { min: 0, max: 1_000_000_000 };

/// Reads, or checks, or describes, a whole vehicle file.
pub(super) fn describe(s: &mut Section<'_, '_>, draft: &mut VehicleDraft) {
    s.required_table("vehicle", "Which vehicle of the pair this is.", |s| {
        let roles = Choice(&[("i", Role::I), ("j", Role::J)]);
        s.set_required(
            "role",
            "\"i\": the information transmitter, which leads; \"j\": the friendly jammer.",
            roles,
            &mut draft.role,
        );
    });
    s.table("autopilot", "The flight controller and how it is commanded.", |s| {
        autopilot(s, &mut draft.autopilot);
    });
    s.table("transmitter", "The payload radio.", |s| transmitter(s, &mut draft.transmitter));
    s.table("operators", "Who may command this companion.", |s| operators(s, &mut draft.operators));
    s.required_table("pair", "The link between the two companions.", |s| pair(s, draft));
    s.table("limits", "What this vehicle may be asked for. Unset: what the mission says of it.", |s| {
        limits(s, &mut draft.limits);
    });
    s.table("battery", "What is known of the battery.", |s| battery(s, &mut draft.battery));
    s.table("log", "Logs of flights.", |s| {
        let mut dir = draft.log_dir.display().to_string();
        s.set("dir", "Directory for logs; relative to the working directory.", PATH, &mut dir);
        draft.log_dir = dir.into();
        log_limits(s, &mut draft.log_limits);
    });
}

/// What recorded flights may take, here and in the radio file.
pub(super) fn log_limits(s: &mut Section<'_, '_>, limits: &mut LogLimits) {
    s.set(
        "max_mb",
        "What recorded flights may take together, in MB: beyond it the oldest go, never the one under way nor the last before it.",
        MEGABYTES,
        &mut limits.max_mb,
    );
    s.set(
        "min_free_mb",
        "What they leave free on their disk, in MB: below it the oldest go likewise.",
        MEGABYTES,
        &mut limits.min_free_mb,
    );
}

fn pair(s: &mut Section<'_, '_>, draft: &mut VehicleDraft) {
    s.set_required("link", "Where the other companion is.", LINK, &mut draft.pair_link);
    key_file(
        s,
        "File with the signing key, readable by its owner alone; relative to this file.",
        &mut draft.key_file,
    );
    system(
        s,
        "peer_system_id",
        "MAVLink system of the other companion; frames of others are turned away. Unset: any system's from a known \
         address; where the address is learnt, those of the only system heard in three seconds.",
        &mut draft.pair_peer_system,
    );
    s.set(
        "tunnel",
        "Pair messages ride in TUNNEL, for a path across an autopilot, which drops messages it does not know; alike on \
         both vehicles, and with peer_system_id.",
        Flag,
        &mut draft.pair_tunnel,
    );
}

/// A link's signing key.
fn key_file(s: &mut Section<'_, '_>, sentence: &str, file: &mut Option<PathBuf>) {
    let mut path = file.as_ref().map(|path| path.display().to_string());
    s.set_optional("key_file", sentence, PATH, &mut path);
    *file = path.map(Into::into);
}

fn operators(s: &mut Section<'_, '_>, systems: &mut Vec<u8>) {
    let mut ids: Vec<u64> = systems.iter().map(|id| u64::from(*id)).collect();
    s.set(
        "system_ids",
        "MAVLink systems whose commands are obeyed though they are not signed; where the autopilot's link has a key, \
         every command is signed, and all are obeyed.",
        List { each: ID, at_least: 0, at_most: 255 },
        &mut ids,
    );
    *systems = ids.into_iter().map(byte).collect();
}

/// A MAVLink system, which may be left unset.
fn system(s: &mut Section<'_, '_>, key: &'static str, sentence: &str, id: &mut Option<u8>) {
    let mut number = id.map(u64::from);
    s.set_optional(key, sentence, ID, &mut number);
    *id = number.map(byte);
}

/// A MAVLink component.
fn component(s: &mut Section<'_, '_>, sentence: &str, id: &mut u8) {
    let mut number = u64::from(*id);
    s.set("component_id", sentence, ID, &mut number);
    *id = byte(number);
}

fn autopilot(s: &mut Section<'_, '_>, autopilot: &mut Autopilot) {
    let firmware = Choice(&[
        ("auto", FirmwareChoice::Auto),
        ("px4", FirmwareChoice::Px4),
        ("ardupilot", FirmwareChoice::ArduPilot),
    ]);
    let actuation = Choice(&[
        ("thrust_vector", Actuation::ThrustVector),
        ("pose", Actuation::Pose),
        ("position", Actuation::Position),
        ("auto", Actuation::Auto),
    ]);
    s.set("link", "Where the autopilot is.", LINK, &mut autopilot.link);
    s.set("firmware", "\"auto\" takes it from HEARTBEAT.", firmware, &mut autopilot.firmware);
    s.set(
        "actuation",
        "\"thrust_vector\": attitude and 3-D thrust (PX4, fully actuated); \"pose\": position and attitude targets; \
         \"position\": position targets alone, the vehicle stays level; \"auto\": what the autopilot's parameters say of the airframe.",
        actuation,
        &mut autopilot.actuation,
    );
    s.set(
        "tracks_pose",
        "The autopilot's firmware tracks position and attitude targets together, as \"pose\" needs and no stock PX4 does.",
        Flag,
        &mut autopilot.tracks_pose,
    );
    system(
        s,
        "system_id",
        "MAVLink system of the autopilot. Unset: the only one that is heard; with udpin it must be given.",
        &mut autopilot.system_id,
    );
    key_file(
        s,
        "File with the signing key of this link, readable by its owner alone; relative to this file. With it, nothing \
         unsigned is taken.",
        &mut autopilot.key_file,
    );
    component(s, "MAVLink component of this companion.", &mut autopilot.component_id);
    s.set(
        "rate_hz",
        "Setpoints and state per second.",
        Number::within("Hz", 5.0, 400.0),
        &mut autopilot.rate_hz,
    );
    s.set_optional(
        "thrust_n",
        "What one unit of thrust is worth along body x, y and z, for \"thrust_vector\"; ratios matter. Unset: from the \
         autopilot's CA_ROTOR* parameters.",
        Numbers([("x", NEWTONS), ("y", NEWTONS), ("z", NEWTONS)]),
        &mut autopilot.thrust_n,
    );
    let duties =
        Choice(&[("upload", FenceDuty::Upload), ("check", FenceDuty::Check), ("none", FenceDuty::None)]);
    s.set(
        "fence",
        "The mission's area in the autopilot itself, with a rally point at home. \"upload\": written unless it is there, and read \
         back; \"check\": read and compared alone; \"none\": not asked for.",
        duties,
        &mut autopilot.fence,
    );
}

fn transmitter(s: &mut Section<'_, '_>, transmitter: &mut Transmitter) {
    let unused = u64::from(Transmitter::COMMAND);
    let (mut kind, mut command, mut form, mut by_parameter) = match transmitter.kind.clone() {
        Kind::Numbered { command } => ("leased", command.into(), 2, None),
        Kind::Leased { command } => ("leased", command.into(), 1, None),
        Kind::Parameter(parameter) => ("parameter", unused, 2, Some(parameter)),
        Kind::None => ("none", unused, 2, None),
    };
    s.set(
        "kind",
        "\"leased\": power commands that expire; \"parameter\": power by a parameter, which does not expire; \"none\": no radio.",
        Choice(&[("leased", "leased"), ("parameter", "parameter"), ("none", "none")]),
        &mut kind,
    );
    s.set(
        "simulated",
        "The transmitter radiates nothing real. Anything else needs the mission's [emission] table.",
        Flag,
        &mut transmitter.simulated,
    );
    s.set_optional(
        "link",
        "A link of the radio's own. Unset: the radio is behind the autopilot.",
        LINK,
        &mut transmitter.link,
    );
    key_file(
        s,
        "File with the signing key of the radio's own link, as in [autopilot].",
        &mut transmitter.key_file,
    );
    system(
        s,
        "system_id",
        "MAVLink system of the radio. Unset: the autopilot's.",
        &mut transmitter.system_id,
    );
    component(s, "MAVLink component of the radio.", &mut transmitter.component_id);
    s.set(
        "command",
        "MAV_CMD that sets power, slot and expiry of a leased transmitter.",
        Integer { min: 1, max: u64::from(u16::MAX) },
        &mut command,
    );
    s.set(
        "form",
        "Of that command. 2: numbered, its expiry on the radio's clock (docs/radio.md); 1: its expiry counts from its \
         receipt, so that one that comes late lasts too long.",
        Integer { min: 1, max: 2 },
        &mut form,
    );
    s.set(
        "accept_late_commands",
        "With form = 1: what delay does is accepted. Without it nothing real is radiated by that form.",
        Flag,
        &mut transmitter.accept_late_commands,
    );
    s.set(
        "accept_orphaned_radio",
        "What a radio does that goes on by itself when its host dies (TX_DEAD_MS, docs/radio.md) is accepted. Without it \
         nothing real is radiated by such a radio.",
        Flag,
        &mut transmitter.accept_orphaned_radio,
    );
    parameter(s, &mut by_parameter, kind == "parameter");
    transmitter.kind = match (kind, by_parameter) {
        ("leased", _) => {
            let command = u16::try_from(command).unwrap_or(u16::MAX);
            if form == 1 { Kind::Leased { command } } else { Kind::Numbered { command } }
        }
        ("parameter", Some(parameter)) => Kind::Parameter(parameter),
        _ => Kind::None,
    };
}

/// How a power parameter is set, here and in the radio file.
pub(super) const PROTOCOLS: [(&str, Protocol); 3] =
    [("ext", Protocol::Extended), ("classic", Protocol::Classic), ("bytewise", Protocol::Bytewise)];
pub(super) const PROTOCOL: &str = "\"ext\": PARAM_EXT_SET; \"classic\": PARAM_SET, integers as floats (C cast); \"bytewise\": \
                                   PARAM_SET, integers byte by byte.";

/// The settings of a transmitter's power parameter, and whether they suffice if it is `used`.
fn parameter(s: &mut Section<'_, '_>, parameter: &mut Option<PowerParameter>, used: bool) {
    let mut name = parameter.as_ref().map(|parameter| parameter.name.clone());
    let mut protocol = parameter.as_ref().map_or(Protocol::Extended, |parameter| parameter.protocol);
    let mut off_value = parameter.as_ref().map(|parameter| parameter.off_value);
    let (mut unit, mut levels) = match parameter.take().map(|parameter| parameter.unit) {
        Some(Unit::Watt) => ("W", Vec::new()),
        Some(Unit::Milliwatt) => ("mW", Vec::new()),
        Some(Unit::Dbm) | None => ("dBm", Vec::new()),
        Some(Unit::Levels(levels)) => ("levels", levels),
    };
    s.set_optional("name", "Name of the power parameter.", Text { max_chars: 16 }, &mut name);
    s.set("protocol", PROTOCOL, Choice(&PROTOCOLS), &mut protocol);
    let units = Choice(&[("W", "W"), ("mW", "mW"), ("dBm", "dBm"), ("levels", "levels")]);
    s.set("unit", "Unit of the power parameter.", units, &mut unit);
    let value = Number::within("", -1e6, 1e6);
    s.set_optional(
        "off_value",
        "Value of the power parameter that silences the radio. 0 for \"W\" and \"mW\"; must be given for \"dBm\" and \"levels\".",
        value,
        &mut off_value,
    );
    let new = |_| Level { value: 0.0, power_w: 0.0 };
    s.set_tables("level", "One power level, for unit = \"levels\".", 0, &mut levels, new, |s, level| {
        s.set_required("value", "Value of the parameter.", value, &mut level.value);
        s.set_required("power_w", "The power it gives.", power(), &mut level.power_w);
    });
    levels.sort_by(|a, b| a.power_w.total_cmp(&b.power_w));
    if used {
        check_parameter(s, name.is_some(), unit, levels.is_empty());
    }
    let unit = match unit {
        "W" => Unit::Watt,
        "mW" => Unit::Milliwatt,
        "levels" => Unit::Levels(levels),
        _ => Unit::Dbm,
    };
    *parameter =
        name.map(|name| PowerParameter { name, protocol, unit, off_value: off_value.unwrap_or(0.0) });
}

/// What a parameter that is used must say beside its own settings.
fn check_parameter(s: &mut Section<'_, '_>, named: bool, unit: &str, no_levels: bool) {
    if !s.is_sound() {
        return;
    }
    if !named {
        s.lacks(
            "",
            "a transmitter of kind \"parameter\" has no `name`",
            "give the name of its power parameter",
        );
        return;
    }
    if !s.given("off_value") && !matches!(unit, "W" | "mW") {
        s.lacks(
            "unit",
            "nothing says how to silence the radio: `off_value` is not set",
            "give off_value, the parameter's value at which the radio is off",
        );
    }
    if unit == "levels" && no_levels {
        s.lacks(
            "unit",
            "`unit` is \"levels\", but there is no [[transmitter.level]]",
            "add [[transmitter.level]] with value = ... and power_w = ..., one for each level",
        );
    }
}

fn battery(s: &mut Section<'_, '_>, battery: &mut BatteryDraft) {
    s.set_optional(
        "endurance_s",
        "Time in the air from full to empty, as this vehicle was seen to fly with its payload and tilt. Unset: what fits is not \
         known before take-off, and a gauge that stands still is believed.",
        Number::within("s", 30.0, 1e5),
        &mut battery.endurance_s,
    );
    s.set(
        "reserve",
        "The charge to land with, of 1: the pair goes home in time for it.",
        Number::within("", 0.05, 0.9),
        &mut battery.reserve,
    );
}

fn limits(s: &mut Section<'_, '_>, limits: &mut Limits) {
    s.set_optional("speed_m_s", "Largest horizontal speed.", speed(), &mut limits.speed_m_s);
    s.set_optional("climb_m_s", "Largest vertical speed.", climb(), &mut limits.climb_m_s);
    let mut tilt_rate_deg_s = limits.tilt_rate_rad_s.map(f64::to_degrees);
    s.set_optional("tilt_rate_deg_s", "Fastest turn of the antenna.", tilt_rate(), &mut tilt_rate_deg_s);
    limits.tilt_rate_rad_s = tilt_rate_deg_s.map(f64::to_radians);
    let mut max_tilt_deg = limits.max_tilt_rad.map(f64::to_degrees);
    s.set_optional("max_tilt_deg", "Largest tilt from level.", tilt(), &mut max_tilt_deg);
    limits.max_tilt_rad = max_tilt_deg.map(f64::to_radians);
    s.set_optional("max_power_w", "Largest transmit power.", power(), &mut limits.max_power_w);
}
