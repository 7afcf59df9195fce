//! Every setting of the vehicle file, declared once: key, kind, range, unit, default, sentence.

use super::kind::{Choice, Flag, Integer, Number, Numbers, Parsed, Text};
use super::mission_file::{climb, power, speed, tilt, tilt_rate};
use super::reader::Section;
use super::vehicle::{
    Autopilot, CommandForm, Draft, Limits, PairLink, PowerParameter, PowerUnit, Transmitter, TransmitterKind,
};
use crate::autopilot::{Actuation, FirmwareChoice};
use crate::link::LinkAddress;
use crate::role::Role;
use crate::transmitter::{Level, Protocol};

const PATH: Text = Text { max_chars: 4096 };
const LINK: Parsed<LinkAddress> = Parsed::new(
    "a link: udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT or serial:PATH:BAUD",
);

/// Reads, or describes, a whole vehicle file.
pub(super) fn describe(s: &mut Section<'_, '_>) -> Draft {
    let role = s.required_table("vehicle", "Which vehicle of the pair this is.", |s| {
        let roles = Choice(&[("i", Role::I), ("j", Role::J)]);
        s.required(
            "role",
            "\"i\": the information transmitter, which leads; \"j\": the friendly jammer.",
            roles,
        )
    });
    let autopilot = s.table("autopilot", "The flight controller and how it is commanded.", autopilot);
    let transmitter = s.table("transmitter", "The payload radio.", transmitter);
    let pair = s.required_table("pair", "The link between the two companions.", |s| PairLink {
        link: s.required("link", "Where the other companion is.", LINK),
        key_file: s
            .optional(
                "key_file",
                "File with the signing key, readable by its owner alone; relative to this file.",
                PATH,
            )
            .map(Into::into),
        peer_system_id: s
            .optional(
                "peer_system_id",
                "MAVLink system of the other companion; frames of others are turned away. Unset: any system's are taken.",
                ID,
            )
            .map(byte),
        tunnel: s.read(
            "tunnel",
            "Pair messages ride in TUNNEL, for a path across an autopilot, which drops messages it does not know; alike on \
             both vehicles, and with peer_system_id.",
            Flag,
            false,
        ),
    });
    let limits =
        s.table("limits", "What this vehicle may be asked for. Unset: what the mission says of it.", limits);
    let log_dir = s.table("log", "Logs of flights.", |s| {
        s.read(
            "dir",
            "Directory for logs; relative to the working directory.",
            PATH,
            "flight-logs".to_owned(),
        )
        .into()
    });
    Draft { role, autopilot, transmitter, pair, limits, log_dir }
}

fn byte(value: u64) -> u8 {
    u8::try_from(value).unwrap_or(u8::MAX)
}

const NEWTONS: Number = Number::within("N", 0.01, 1e5);
const ID: Integer = Integer { min: 1, max: 255 };

fn autopilot(s: &mut Section<'_, '_>) -> Autopilot {
    let default_link = LinkAddress::UdpIn(crate::link::HostPort { host: "0.0.0.0".to_owned(), port: 14540 });
    let firmware = Choice(&[
        ("auto", FirmwareChoice::Auto),
        ("px4", FirmwareChoice::Px4),
        ("ardupilot", FirmwareChoice::ArduPilot),
    ]);
    let actuation = Choice(&[
        ("thrust_vector", Actuation::ThrustVector),
        ("pose", Actuation::Pose),
        ("position", Actuation::Position),
    ]);
    Autopilot {
        link: s.read("link", "Where the autopilot is.", LINK, default_link),
        firmware: s.read("firmware", "\"auto\" takes it from HEARTBEAT.", firmware, FirmwareChoice::Auto),
        actuation: s.read(
            "actuation",
            "\"thrust_vector\": attitude and 3-D thrust (PX4, fully actuated); \"pose\": position and attitude targets; \
             \"position\": position targets alone, the vehicle stays level.",
            actuation,
            Actuation::Pose,
        ),
        system_id: s.optional("system_id", "MAVLink system of the autopilot. Unset: the first that is heard.", ID).map(byte),
        component_id: byte(s.read("component_id", "MAVLink component of this companion.", ID, 191)),
        rate_hz: s.read("rate_hz", "Setpoints and state per second.", Number::within("Hz", 5.0, 400.0), 50.0),
        thrust_n: s.optional(
            "thrust_n",
            "What one unit of thrust is worth along body x, y and z, for \"thrust_vector\"; ratios matter. Unset: from the \
             autopilot's CA_ROTOR* parameters.",
            Numbers([("x", NEWTONS), ("y", NEWTONS), ("z", NEWTONS)]),
        ),
    }
}

fn transmitter(s: &mut Section<'_, '_>) -> Transmitter {
    let kinds = Choice(&[
        ("leased", TransmitterKind::Leased),
        ("parameter", TransmitterKind::Parameter),
        ("none", TransmitterKind::None),
    ]);
    let kind = s.read(
        "kind",
        "\"leased\": power commands that expire; \"parameter\": power by a parameter, which does not expire; \"none\": no radio.",
        kinds,
        TransmitterKind::Leased,
    );
    let simulated = s.read(
        "simulated",
        "The transmitter radiates nothing real. Anything else needs the mission's [emission] table.",
        Flag,
        true,
    );
    let component_id = byte(s.read("component_id", "MAVLink component of the radio.", ID, 68));
    let commands = Integer { min: 1, max: u64::from(u16::MAX) };
    let command = s.read(
        "command",
        "MAV_CMD that sets power, slot and expiry of a leased transmitter.",
        commands,
        31_010,
    );
    let form = s.read(
        "form",
        "Of that command. 2: numbered, its expiry on the radio's clock (docs/radio.md); 1: its expiry counts from its \
         receipt, so that one that comes late lasts too long.",
        Integer { min: 1, max: 2 },
        2,
    );
    let accept_late_commands = s.read(
        "accept_late_commands",
        "With form = 1: what delay does is accepted. Without it nothing real is radiated by that form.",
        Flag,
        false,
    );
    let parameter = parameter(s);
    Transmitter {
        kind,
        simulated,
        component_id,
        command: u16::try_from(command).unwrap_or(u16::MAX),
        form: if form == 1 { CommandForm::FromReceipt } else { CommandForm::Numbered },
        accept_late_commands,
        parameter,
    }
}

/// The settings of a transmitter's power parameter.
fn parameter(s: &mut Section<'_, '_>) -> Option<PowerParameter> {
    let name = s.optional("name", "Name of the power parameter.", Text { max_chars: 16 });
    let protocols = Choice(&[("ext", Protocol::Extended), ("classic", Protocol::Classic)]);
    let protocol =
        s.read("protocol", "\"ext\": PARAM_EXT_SET; \"classic\": PARAM_SET.", protocols, Protocol::Extended);
    let units = Choice(&[
        ("W", PowerUnit::Watt),
        ("mW", PowerUnit::Milliwatt),
        ("dBm", PowerUnit::Dbm),
        ("levels", PowerUnit::Levels),
    ]);
    let unit = s.read("unit", "Unit of the power parameter.", units, PowerUnit::Dbm);
    let value = Number::within("", -1e6, 1e6);
    let off_value = s.optional(
        "off_value",
        "Value of the power parameter that silences the radio. 0 for \"W\" and \"mW\"; must be given for \"dBm\" and \"levels\".",
        value,
    );
    let levels = s.tables("level", "One power level, for unit = \"levels\".", 0, |s, _| Level {
        value: s.required("value", "Value of the parameter.", value).unwrap_or_default(),
        power_w: s.required("power_w", "The power it gives.", power()).unwrap_or_default(),
    });
    name.map(|name| PowerParameter { name, protocol, unit, off_value: off_value.unwrap_or(0.0), levels })
}

fn limits(s: &mut Section<'_, '_>) -> Limits {
    Limits {
        speed_m_s: s.optional("speed_m_s", "Largest horizontal speed.", speed()),
        climb_m_s: s.optional("climb_m_s", "Largest vertical speed.", climb()),
        tilt_rate_rad_s: s
            .optional("tilt_rate_deg_s", "Fastest turn of the antenna.", tilt_rate())
            .map(f64::to_radians),
        max_tilt_rad: s.optional("max_tilt_deg", "Largest tilt from level.", tilt()).map(f64::to_radians),
        max_power_w: s.optional("max_power_w", "Largest transmit power.", power()),
    }
}
