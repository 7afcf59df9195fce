//! Every setting of the radio file, declared once: key, kind, range, unit, default, sentence.

use super::kind::{Choice, Flag, ID, Integer, List, Number, Numbers, Parsed, Text, byte};
use super::radio_draft::{
    AtDraft, AttenuatorDraft, CommandDraft, DeviceDraft, DeviceKind, JsonRpcDraft, KillLineDraft,
    ParameterDraft, RadioHostDraft, SoapyDraft,
};
use super::reader::Section;
use super::vehicle_file::{PROTOCOL, PROTOCOLS, log_limits};
use crate::link::LinkAddress;
use crate::radio_device::gpio::Electrical;
use crate::radio_device::parameter::Unit;

const PATH: Text = Text { max_chars: 4096 };
const LINE: Text = Text { max_chars: 2000 };
const LINK: Parsed<LinkAddress> = Parsed::new(
    "a link: udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT or serial:PATH:BAUD",
);
const PORT: Parsed<LinkAddress> = Parsed::new("the device's port: tcpout:HOST:PORT or serial:PATH:BAUD");
const SETTING: Number = Number::within("", -1000.0, 100_000.0);
const MS: Number = Number::positive("ms", 60_000.0);
const KHZ: Number = Number::within("kHz", 1.0, 300e6);

fn words() -> List<Text> {
    List { each: LINE, at_least: 1, at_most: 64 }
}

/// Reads, or checks, or describes, a whole radio file.
pub(super) fn describe(s: &mut Section<'_, '_>, draft: &mut RadioHostDraft) {
    s.required_table("radio", "Which radio this is.", |s| radio(s, draft));
    s.required_table("link", "The link to the companion.", |s| link(s, draft));
    s.table("operators", "Who else may kill the radio.", |s| {
        let each = "MAVLink systems whose radio kill is obeyed though it is not signed, beside the radio's own; where the \
                    link has a key, every kill on it is signed, and obeyed.";
        bytes(s, "system_ids", each, &mut draft.operators);
    });
    s.required_table("device", "What is driven, its settings, and its times.", |s| {
        device(s, &mut draft.device)
    });
    s.table("calibration", "What the settings give, measured. Unset: what the device says of itself.", |s| {
        let mut path = draft.calibration_file.as_ref().map(|path| path.display().to_string());
        let sentence = "CSV file with the columns frequency_hz,setting,dbm, relative to this file; `veilwing radio \
                        calibrate` writes one.";
        s.set_optional("file", sentence, PATH, &mut path);
        draft.calibration_file = path.map(Into::into);
    });
    s.set_optional_table("command", "Programs, for kind \"command\".", &mut draft.by_command, command);
    s.set_optional_table("attenuator", "For kind \"attenuator\".", &mut draft.attenuator, attenuator);
    s.set_optional_table("json_rpc", "For kind \"json_rpc\".", &mut draft.json_rpc, json_rpc);
    s.set_optional_table("at", "For kind \"at\".", &mut draft.at, at);
    s.set_optional_table("parameter", "For kind \"parameter\".", &mut draft.parameter, parameter);
    let sentence =
        "For kind \"soapy\": a SoapySDR device that radiates noise; the setting is its gain in dB.";
    s.set_optional_table("soapy", sentence, &mut draft.soapy, soapy);
    let sentence = "A line to the transmitter's enable, beside a device of any kind: it goes off with every off, and needs no \
                    answer of the device's. Linux alone.";
    s.set_optional_table("kill_line", sentence, &mut draft.kill_line, kill_line);
    s.table("log", "What is kept from one run to the next.", |s| {
        let mut dir = draft.log_dir.display().to_string();
        let sentence =
            "Directory for logs, the radio kill and the link's timestamps; relative to the working directory.";
        s.set("dir", sentence, PATH, &mut dir);
        draft.log_dir = dir.into();
        log_limits(s, &mut draft.log_limits);
    });
}

fn radio(s: &mut Section<'_, '_>, draft: &mut RadioHostDraft) {
    let (mut system, mut component) = (u64::from(draft.system_id), u64::from(draft.component_id));
    let mut command = u64::from(draft.command);
    s.set_required("system_id", "MAVLink system of the radio: the vehicle's autopilot's.", ID, &mut system);
    s.set("component_id", "MAVLink component of the radio.", ID, &mut component);
    s.set(
        "command",
        "MAV_CMD that sets its power, as in the vehicle file.",
        Integer { min: 1, max: u64::from(u16::MAX) },
        &mut command,
    );
    (draft.system_id, draft.component_id) = (byte(system), byte(component));
    draft.command = u16::try_from(command).unwrap_or(u16::MAX);
}

fn link(s: &mut Section<'_, '_>, draft: &mut RadioHostDraft) {
    s.set_required("address", "Where the companion is, or comes from.", LINK, &mut draft.address);
    let mut key_file = draft.key_file.as_ref().map(|path| path.display().to_string());
    s.set_optional(
        "key_file",
        "File with the signing key of this link, readable by its owner alone; relative to this file. With it, nothing \
         unsigned is taken.",
        PATH,
        &mut key_file,
    );
    draft.key_file = key_file.map(Into::into);
    let each = "Components of the radio's system that may command power: the companion's. Empty: any. The first that \
                does is the only one until the next start.";
    bytes(s, "commanders", each, &mut draft.commanders);
    s.set("tunnel", "Its reports ride in TUNNEL, for a path across an autopilot.", Flag, &mut draft.tunnel);
}

fn bytes(s: &mut Section<'_, '_>, key: &'static str, sentence: &str, values: &mut Vec<u8>) {
    let mut ids: Vec<u64> = values.iter().map(|id| u64::from(*id)).collect();
    s.set(key, sentence, List { each: ID, at_least: 0, at_most: 255 }, &mut ids);
    *values = ids.into_iter().map(byte).collect();
}

fn device(s: &mut Section<'_, '_>, device: &mut DeviceDraft) {
    let kinds = Choice(&[
        ("command", DeviceKind::Command),
        ("attenuator", DeviceKind::Attenuator),
        ("json_rpc", DeviceKind::JsonRpc),
        ("at", DeviceKind::At),
        ("parameter", DeviceKind::Parameter),
        ("soapy", DeviceKind::Soapy),
    ]);
    let sentence = "How it is driven: by programs, as an attenuator, by JSON over HTTP, by AT commands, by a MAVLink \
                    parameter; with a table of that name.";
    s.set_required("kind", sentence, kinds, &mut device.kind);
    s.set_optional(
        "least",
        "The least setting: dBm, decibels of attenuation, a level.",
        SETTING,
        &mut device.least,
    );
    s.set_optional("most", "The largest setting.", SETTING, &mut device.most);
    s.set("step", "From one setting to the next.", Number::within("", 0.01, 1000.0), &mut device.step);
    let levels = List { each: SETTING, at_least: 1, at_most: 1000 };
    s.set_optional(
        "levels",
        "All its settings, where they are not evenly spaced.",
        levels,
        &mut device.levels,
    );
    s.alternatives(&[&["least", "most"], &["levels"]], true);
    let dbm = Number::within("dBm", -100.0, 80.0);
    s.set_optional(
        "source_dbm",
        "The power that enters an attenuator, where there is no calibration.",
        dbm,
        &mut device.source_dbm,
    );
    s.set_optional(
        "frequency_hz",
        "What is radiated at, for the calibration.",
        Number::within("Hz", 1e3, 3e11),
        &mut device.frequency_hz,
    );
    s.set_required(
        "off_ms",
        "The longest from an off to silence that was read back; `veilwing radio measure` measures it.",
        MS,
        &mut device.off_ms,
    );
    s.set_required(
        "change_ms",
        "The longest from a command to the new power, read back.",
        MS,
        &mut device.change_ms,
    );
    s.set_optional(
        "dead_ms",
        "The longest until the device is silent by itself when this program dies. Unset: what the kill line's one-shot \
         holds; without one, never.",
        MS,
        &mut device.dead_ms,
    );
    s.set_optional(
        "band_khz",
        "The band in which it radiates, from and to.",
        Numbers([("from", KHZ), ("to", KHZ)]),
        &mut device.band_khz,
    );
    s.set(
        "tolerance_db",
        "How far below the power that was set it may be read back; above it, never.",
        Number::within("dB", 0.0, 10.0),
        &mut device.tolerance_db,
    );
}

fn command(s: &mut Section<'_, '_>, command: &mut CommandDraft) {
    s.set_optional(
        "interface",
        "A Wi-Fi interface, driven by iw and ip; in place of all else.",
        Text { max_chars: 15 },
        &mut command.interface,
    );
    let sentence =
        "Sets the power: a program and its arguments, with {dbm}, {mbm}, {mw} or {level} for the setting.";
    s.set_optional("set", sentence, words(), &mut command.set);
    s.set_optional("off", "Turns off.", words(), &mut command.off);
    s.alternatives(&[&["interface"], &["set", "off"]], true);
    s.set_optional(
        "on",
        "Ends the off, after the power was set, where that alone does not.",
        words(),
        &mut command.on,
    );
    s.set_optional(
        "read",
        "Says the setting in force. Unset: it cannot be read back.",
        words(),
        &mut command.read,
    );
    s.set_optional(
        "read_after",
        "What stands before it. Unset: it comes first.",
        LINE,
        &mut command.read_after,
    );
    s.set_optional("read_before", "What stands behind it. Unset: anything.", LINE, &mut command.read_before);
    s.set_optional(
        "read_off",
        "Says whether it is off. Unset: it cannot be read back.",
        words(),
        &mut command.read_off,
    );
    s.set_optional("off_reads", "The word that is in it then.", LINE, &mut command.off_reads);
}

fn attenuator(s: &mut Section<'_, '_>, attenuator: &mut AttenuatorDraft) {
    s.set_required("address", "Where it is.", PORT, &mut attenuator.address);
    s.set(
        "http",
        "It is spoken to by HTTP, and not by lines of text (telnet, serial).",
        Flag,
        &mut attenuator.http,
    );
    s.set_optional("password", "Its password, by HTTP.", Text { max_chars: 100 }, &mut attenuator.password);
    let sentence =
        "Its largest attenuation, which is off: it lets through so much less, and is never silent.";
    s.set_required("off_db", sentence, Number::positive("dB", 200.0), &mut attenuator.off_db);
}

fn soapy(s: &mut Section<'_, '_>, radio: &mut SoapyDraft) {
    let sentence =
        "Which device: key=value pairs with commas between them, as SoapySDRUtil --find prints them.";
    s.set_required("args", sentence, LINE, &mut radio.args);
    s.set("channel", "Which of its transmit channels.", Integer { min: 0, max: 63 }, &mut radio.channel);
    s.set_optional(
        "antenna",
        "Its connector, as SoapySDRUtil --probe has it.",
        Text { max_chars: 100 },
        &mut radio.antenna,
    );
    let sentence = "Samples a second, which is how wide the noise is.";
    s.set_required("sample_rate_hz", sentence, Number::positive("Hz", 1e9), &mut radio.sample_rate_hz);
}

fn json_rpc(s: &mut Section<'_, '_>, radio: &mut JsonRpcDraft) {
    s.set_required("address", "Where it is: tcpout:HOST:PORT.", PORT, &mut radio.address);
    s.set("path", "What is posted to.", LINE, &mut radio.path);
    s.set_optional("login", "Gives a session, for {session} in the others: JSON.", LINE, &mut radio.login);
    s.set("login_at", "Where in the answer it stands, a JSON pointer.", LINE, &mut radio.login_at);
    let sentence = "Sets the power: JSON, with {dbm}, {mbm}, {mw} or {level} for the setting. Unset: StreamCaster's power_dBm, \
                    read back by read_power_dBm.";
    s.set_optional("set", sentence, LINE, &mut radio.set);
    s.set_optional(
        "on",
        "Ends the off, after the power was set, where that alone does not.",
        LINE,
        &mut radio.on,
    );
    s.set_required("off", "Turns off.", LINE, &mut radio.off);
    s.set_optional(
        "read",
        "Says the setting in force. Unset, with `set`: it cannot be read back.",
        LINE,
        &mut radio.read,
    );
    s.set("read_at", "Where in the answer it stands.", LINE, &mut radio.read_at);
    s.set_optional(
        "read_off",
        "Says whether it is off. Unset: it cannot be read back.",
        LINE,
        &mut radio.read_off,
    );
    s.set("read_off_at", "Where in the answer that stands.", LINE, &mut radio.read_off_at);
    s.set("off_reads", "What stands there then.", LINE, &mut radio.off_reads);
}

fn at(s: &mut Section<'_, '_>, modem: &mut AtDraft) {
    s.set_required("address", "Where it is: telnet or a serial line.", PORT, &mut modem.address);
    s.set_optional("user", "Who logs in. Unset: it does not ask.", LINE, &mut modem.user);
    s.set_optional("password", "With what.", LINE, &mut modem.password);
    s.alternatives(&[&["user", "password"]], false);
    s.set("set", "Sets the power, with {dbm}, {mbm}, {mw} or {level} for the setting.", LINE, &mut modem.set);
    s.set("on", "Ends the off.", LINE, &mut modem.on);
    s.set("off", "Turns off.", LINE, &mut modem.off);
    s.set("reads_back", "Whether it is read back by what follows.", Flag, &mut modem.reads_back);
    s.set("read", "Says the setting in force.", LINE, &mut modem.read);
    s.set("read_after", "What stands before it.", LINE, &mut modem.read_after);
    s.set("read_off", "Says whether it is off.", LINE, &mut modem.read_off);
    s.set("read_off_after", "What stands before that.", LINE, &mut modem.read_off_after);
    s.set("off_reads", "The number that means off.", SETTING, &mut modem.off_reads);
}

fn parameter(s: &mut Section<'_, '_>, parameter: &mut ParameterDraft) {
    let (mut system, mut component) = (u64::from(parameter.system_id), u64::from(parameter.component_id));
    s.set_required("address", "Where the radio is, or comes from.", LINK, &mut parameter.address);
    s.set_required("system_id", "MAVLink system of the radio on that link.", ID, &mut system);
    s.set("component_id", "Its MAVLink component.", ID, &mut component);
    (parameter.system_id, parameter.component_id) = (byte(system), byte(component));
    s.set_required("name", "Name of the power parameter.", Text { max_chars: 16 }, &mut parameter.name);
    s.set("protocol", PROTOCOL, Choice(&PROTOCOLS), &mut parameter.protocol);
    let units = Choice(&[("setting", Unit::Setting), ("mW", Unit::Milliwatt), ("W", Unit::Watt)]);
    let sentence =
        "What its value is: the setting itself (dBm, a level), or, of settings in dBm, \"mW\" or \"W\".";
    s.set("unit", sentence, units, &mut parameter.unit);
    let sentence = "The value at which nothing is radiated. Unset: there is none, off is the kill line's, and the device is told \
                    its weakest setting.";
    s.set_optional("off_value", sentence, Number::within("", -1e6, 1e6), &mut parameter.off_value);
}

fn kill_line(s: &mut Section<'_, '_>, line: &mut KillLineDraft) {
    let mut chip = line.chip.display().to_string();
    s.set_required(
        "chip",
        "The chip's device file, /dev/gpiochipN; `gpiodetect` lists them.",
        PATH,
        &mut chip,
    );
    line.chip = chip.into();
    let offsets = Integer { min: 0, max: 65_535 };
    s.set_optional("line", "The line's offset on the chip.", offsets, &mut line.line);
    let sentence = "The line's name, in place of its offset; `gpioinfo` shows it.";
    s.set_optional("name", sentence, Text { max_chars: 31 }, &mut line.name);
    s.alternatives(&[&["line"], &["name"]], true);
    let levels = Choice(&[("low", Electrical::Low), ("high", Electrical::High)]);
    let sentence =
        "The level at which the transmitter is silent, which must be that of the board's pull resistor.";
    s.set_required("off_level", sentence, levels, &mut line.off_level);
    let sentence = "The longest from that level to silence. Unset, without oneshot_ms: the line is driven, and its off proves \
                    nothing.";
    s.set_optional("silent_ms", sentence, MS, &mut line.silent_ms);
    let sentence = "Behind the line is a retriggered one-shot, which lets the transmitter radiate for at most so long after an \
                    edge away from off_level, whatever level the line stays at. While it radiates the line has six edges in \
                    that time.";
    s.set_optional("oneshot_ms", sentence, MS, &mut line.oneshot_ms);
    s.excludes("oneshot_ms", "silent_ms");
}
