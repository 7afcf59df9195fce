//! What the settings of a radio file say of one another.

use super::super::document::Document;
use super::super::radio_draft::{DeviceKind, RadioHostDraft};
use super::has_no_off;
use crate::link::LinkAddress;
use crate::radio_host::MOST_SETTINGS;

/// Settings against each other.
pub(super) fn check(draft: &RadioHostDraft, file: &mut Document) {
    tables(draft, file);
    device(draft, file);
    addresses(draft, file);
    off(draft, file);
    if draft.key_file.is_none()
        && !draft.address.is_point_to_point()
        && file.sound(&["link.address", "link.key_file"])
    {
        file.warning(
            file.at("link.address"),
            "the link is neither signed nor a serial line: whoever reaches it first commands the radio"
                .to_owned(),
            "give [link] key_file, the same as the companion's [transmitter] key_file".to_owned(),
        );
    }
}

/// One table for the device's kind, and none of another's.
fn tables(draft: &RadioHostDraft, file: &mut Document) {
    if !file.sound(&["device.kind"]) || !file.given("device.kind") {
        return;
    }
    let wanted = draft.device.kind;
    for kind in DeviceKind::ALL {
        let key = kind.key();
        let given = file.given(key);
        if kind == wanted && !given {
            let message = format!("`kind` is {key:?}, and there is no [{key}] table");
            file.missing(file.at("device.kind"), message, format!("add [{key}]"));
        } else if kind != wanted && given {
            let message = format!("[{key}] has no effect: the device is of kind {:?}", wanted.key());
            file.error(file.at(key), message, "remove it, or give that kind".to_owned());
        }
    }
}

fn device(draft: &RadioHostDraft, file: &mut Document) {
    let device = &draft.device;
    if !file.sound(&["device"]) {
        return;
    }
    let error = |file: &mut Document, path: &str, message: String, help: &str| {
        file.error(file.at(path), message, help.to_owned());
    };
    if let (Some(least), Some(most)) = (device.least, device.most) {
        if least > most {
            error(file, "device.least", format!("`least` is {least}, above `most`, {most}"), "swap them");
        } else if (most - least) / device.step > MOST_SETTINGS as f64 {
            let message = format!(
                "from {least} to {most} by {} there are more than {MOST_SETTINGS} settings",
                device.step
            );
            error(file, "device.step", message, "give a larger step");
        }
    }
    if device.kind == DeviceKind::Soapy {
        if cfg!(not(feature = "soapy")) {
            let message = "`kind` is \"soapy\", and this build drives no SoapySDR devices".to_owned();
            error(
                file,
                "device.kind",
                message,
                "build it with --features soapy, where SoapySDR is installed",
            );
        }
        if device.frequency_hz.is_none() {
            file.missing(
                file.at("device.kind"),
                "nothing says what a SoapySDR device radiates at".to_owned(),
                "give frequency_hz".to_owned(),
            );
        }
        if draft.calibration_file.is_none() {
            file.missing(
                file.at("device.kind"),
                "nothing says what power a gain gives".to_owned(),
                "give [calibration] file; `veilwing radio calibrate` writes one".to_owned(),
            );
        }
    }
    let needs_source = device.kind == DeviceKind::Attenuator && draft.calibration_file.is_none();
    if needs_source && device.source_dbm.is_none() {
        file.missing(
            file.at("device.kind"),
            "nothing says what power an attenuation gives".to_owned(),
            "give source_dbm, or a calibration".to_owned(),
        );
    } else if !needs_source && device.source_dbm.is_some() {
        error(
            file,
            "device.source_dbm",
            "`source_dbm` has no effect: it is for an attenuator without a calibration".to_owned(),
            "remove it",
        );
    }
    if let Some([from, to]) = device.band_khz.filter(|[from, to]| from >= to) {
        error(
            file,
            "device.band_khz",
            format!("the band ends at {to} kHz, where it begins or before, {from} kHz"),
            "swap them",
        );
    }
}

/// There is an off, and it comes in the time that the file declares.
fn off(draft: &RadioHostDraft, file: &mut Document) {
    if !file.sound(&["device", "parameter", "kill_line"]) {
        return;
    }
    let Some(line) = &draft.kill_line else {
        if has_no_off(draft) {
            file.missing(
                file.at("parameter"),
                "nothing silences the radio: the parameter has no off value, and there is no kill line".to_owned(),
                "give [kill_line] with silent_ms or oneshot_ms, or off_value, if there is a value at which nothing is radiated"
                    .to_owned(),
            );
        }
        return;
    };
    let off_ms = draft.device.off_ms;
    match line.silent_ms.or(line.oneshot_ms) {
        None if has_no_off(draft) => file.missing(
            file.at("kill_line"),
            "off is the kill line's alone, and nothing says how long it takes".to_owned(),
            "give silent_ms, or oneshot_ms where a one-shot is behind it: measure it".to_owned(),
        ),
        None => file.warning(
            file.at("kill_line"),
            "nothing says how long the line takes: it is driven, but a device that does not answer is not known to be off"
                .to_owned(),
            "give silent_ms, or oneshot_ms where a one-shot is behind it: measure it".to_owned(),
        ),
        Some(ms) if has_no_off(draft) && ms > off_ms => file.error(
            file.at("device.off_ms"),
            format!("`off_ms` is {off_ms}, and off is the kill line's alone, which takes {ms} ms"),
            format!("give off_ms = {ms} or more, or hardware that is faster"),
        ),
        Some(ms) if ms > off_ms => file.warning(
            file.at("device.off_ms"),
            format!(
                "`off_ms` is {off_ms}, and off by the kill line alone takes {ms} ms: a device that fails is silent later than is \
                 declared"
            ),
            format!("give off_ms = {ms} for vehicle I's radio, whose silence vehicle J waits for"),
        ),
        Some(_) => {}
    }
    if let (Some(dead_ms), Some(oneshot_ms)) = (draft.device.dead_ms, line.oneshot_ms)
        && dead_ms < oneshot_ms
    {
        file.warning(
            file.at("device.dead_ms"),
            format!("`dead_ms` is {dead_ms}, and the kill line's one-shot holds for {oneshot_ms} ms"),
            "remove it, unless something else silences the radio sooner".to_owned(),
        );
    }
}

/// Devices are called, and not waited for.
fn addresses(draft: &RadioHostDraft, file: &mut Document) {
    let mut check = |path: &str, address: &LinkAddress, lines: bool| {
        let usable = match address {
            LinkAddress::TcpOut(_) => true,
            LinkAddress::Serial { .. } => lines,
            _ => false,
        };
        if !usable && file.sound(&[path]) {
            let help =
                if lines { "give tcpout:HOST:PORT or serial:PATH:BAUD" } else { "give tcpout:HOST:PORT" };
            file.error(
                file.at(path),
                format!("`address` is {address}, and the device is called"),
                help.to_owned(),
            );
        }
    };
    if let Some(attenuator) = &draft.attenuator {
        check("attenuator.address", &attenuator.address, !attenuator.http);
    }
    if let Some(radio) = &draft.json_rpc {
        check("json_rpc.address", &radio.address, false);
    }
    if let Some(at) = &draft.at {
        check("at.address", &at.address, true);
    }
}
