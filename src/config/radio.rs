//! The radio file: what the radio host must know of its link and its device.

mod checks;

use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value as Json;

use super::diagnostic::{Diagnostics, Severity};
use super::document::Document;
use super::file::{MAX_BYTES, read_text};
use super::radio_draft::{CommandDraft, DeviceKind, JsonRpcDraft, RadioHostDraft};
use super::radio_file;
use super::reader::Section;
use super::reading;
use super::vehicle_links::key_file_fault;
use crate::link::{Clock, HostPort, LinkAddress};
#[cfg(feature = "soapy")]
use crate::radio_device::soapy;
use crate::radio_device::{AnyDevice, Reading, at, attenuator, command, gpio, json_rpc, parameter};
use crate::radio_host::{Facts, LineTimes, MOST_SETTINGS, Point, Scale, ScaleError, Silence, points_of_csv};

/// A validated radio file: its settings, which are read as its own fields ([`RadioHostDraft`]), and the scale of its device.
#[derive(Debug, Clone)]
pub struct RadioFile {
    draft: RadioHostDraft,
    /// Its settings and their powers; by the calibration, where there is one.
    pub scale: Scale,
    /// What the operator should know although the file can be used. No errors.
    pub warnings: Diagnostics,
}

impl Deref for RadioFile {
    type Target = RadioHostDraft;

    fn deref(&self) -> &RadioHostDraft {
        &self.draft
    }
}

impl RadioFile {
    /// Reads and validates a radio file, its calibration, and the mode of its key file.
    ///
    /// # Errors
    /// Everything that is wrong with them, each with its place and remedy.
    pub fn load(path: &Path) -> Result<Self, Diagnostics> {
        let (mut draft, document, findings) =
            Self::read(&path.display().to_string(), &read_text(path, MAX_BYTES)?)?;
        let beside = |file: &mut Option<PathBuf>| {
            *file = file.take().map(|file| path.parent().unwrap_or(Path::new("")).join(file));
        };
        beside(&mut draft.key_file);
        beside(&mut draft.calibration_file);
        if let Some((message, help)) = draft.key_file.as_deref().and_then(key_file_fault) {
            return Err(fault(&document, "link.key_file", message, help));
        }
        let scale = match &draft.calibration_file {
            None => linear(&draft).map_err(|error| at_device(&document, &error))?,
            Some(file) if !file.exists() => {
                let message = format!("`file` is {}: there is no such file", file.display());
                let help = "`veilwing radio calibrate` writes it".to_owned();
                return Err(fault(&document, "calibration.file", message, help));
            }
            Some(file) => measured(&draft, file, &read_text(file, MAX_BYTES)?)?,
        };
        Ok(Self { draft, scale, warnings: findings })
    }

    /// The same for a calibration that is yet to be made: its file is not looked at, and powers are the device's word.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn load_uncalibrated(path: &Path) -> Result<Self, Diagnostics> {
        let (mut draft, _, warnings) = Self::read(&path.display().to_string(), &read_text(path, MAX_BYTES)?)?;
        draft.calibration_file =
            draft.calibration_file.map(|file| path.parent().unwrap_or(Path::new("")).join(file));
        // Any slope does: what each setting gives is what is asked for.
        let scale = Scale::linear(&settings_of(&draft), 0.0, 1.0).map_err(|error| {
            Diagnostics::of_file(&path.display().to_string(), error.to_string(), error.remedy())
        })?;
        Ok(Self { draft, scale, warnings })
    }

    /// Validates the text of a radio file without a calibration; `file_name` is used in messages only, and no other file is
    /// looked at.
    ///
    /// # Errors
    /// Everything that is wrong with the text, each with its place and remedy.
    pub fn parse(file_name: &str, text: &str) -> Result<Self, Diagnostics> {
        let (draft, document, warnings) = Self::read(file_name, text)?;
        let scale = linear(&draft).map_err(|error| at_device(&document, &error))?;
        Ok(Self { draft, scale, warnings })
    }

    fn read(file_name: &str, text: &str) -> Result<(RadioHostDraft, Document, Diagnostics), Diagnostics> {
        let describe = |s: &mut Section<'_, '_>| {
            let mut draft = RadioHostDraft::blank();
            radio_file::describe(s, &mut draft);
            draft
        };
        let (draft, document, findings) = reading::text(file_name, text, describe, checks::check);
        Ok((draft, document, findings.into_result()?))
    }

    /// The JSON Schema of the radio file.
    #[must_use]
    pub fn schema() -> Json {
        reading::schema(|s| radio_file::describe(s, &mut RadioHostDraft::blank()))
    }

    /// What the radio declares of itself.
    #[must_use]
    pub fn facts(&self) -> Facts {
        let device = &self.draft.device;
        let oneshot_ms = self.draft.kill_line.as_ref().and_then(|line| line.oneshot_ms);
        Facts {
            least_dbm: self.scale.least_dbm(),
            most_dbm: self.scale.most_dbm(),
            off: time(device.off_ms),
            change: time(device.change_ms),
            reads_back: self.reads_back(),
            dead: device.dead_ms.or(oneshot_ms).map(time),
            band_khz: device.band_khz,
        }
    }

    /// The kill line, if there is one: which it is, and what its hardware does.
    #[must_use]
    pub fn kill_line(&self) -> Option<(gpio::Settings, LineTimes)> {
        let line = self.draft.kill_line.as_ref()?;
        let which = match (line.line, &line.name) {
            (Some(offset), _) => gpio::Which::Offset(u32::try_from(offset).unwrap_or(u32::MAX)),
            (None, name) => gpio::Which::Name(name.clone()?),
        };
        let silence = match (line.silent_ms, line.oneshot_ms) {
            (Some(ms), _) => Silence::AtLevel(time(ms)),
            (None, Some(ms)) => Silence::WithoutEdges(time(ms)),
            (None, None) => Silence::Unknown,
        };
        let settings = gpio::Settings { chip: line.chip.clone(), line: which, off_level: line.off_level };
        Some((settings, LineTimes { silence, alone: has_no_off(&self.draft) }))
    }

    /// The device, not spoken to yet. `None` never comes of a file that was validated.
    #[must_use]
    pub fn device(&self, clock: &Clock) -> Option<AnyDevice> {
        let draft = &self.draft;
        Some(match draft.device.kind {
            DeviceKind::Command => {
                AnyDevice::Command(command::Program::new(programs(draft.by_command.as_ref()?)))
            }
            DeviceKind::Attenuator => {
                let attenuator = draft.attenuator.as_ref()?;
                let access = match (attenuator.http, &attenuator.address) {
                    (true, LinkAddress::TcpOut(to)) => {
                        attenuator::Access::Http { to: to.clone(), password: attenuator.password.clone() }
                    }
                    (_, address) => attenuator::Access::Lines(address.clone()),
                };
                let settings = attenuator::Settings { access, off_db: attenuator.off_db };
                AnyDevice::Attenuator(attenuator::Attenuator::new(settings))
            }
            DeviceKind::JsonRpc => {
                AnyDevice::JsonRpc(json_rpc::JsonRpc::new(calls(draft.json_rpc.as_ref()?)?))
            }
            DeviceKind::At => {
                let at = draft.at.as_ref()?;
                let read = |text: &String| if at.reads_back { text.clone() } else { String::new() };
                let after = |text: &String| Reading { after: text.clone(), before: String::new() };
                AnyDevice::At(at::Modem::new(at::Settings {
                    link: at.address.clone(),
                    login: at.user.clone().zip(at.password.clone()),
                    set: at.set.clone(),
                    read: read(&at.read),
                    reading: after(&at.read_after),
                    on: at.on.clone(),
                    off: at.off.clone(),
                    read_off: read(&at.read_off),
                    off_reading: after(&at.read_off_after),
                    off_reads: at.off_reads,
                }))
            }
            DeviceKind::Parameter => {
                let radio = draft.parameter.as_ref()?;
                let weakest = self.scale.settings().iter().min_by(|a, b| a.dbm.total_cmp(&b.dbm))?;
                let settings = parameter::Settings {
                    link: radio.address.clone(),
                    own: (draft.system_id, draft.component_id),
                    target: (radio.system_id, radio.component_id),
                    name: radio.name.clone(),
                    protocol: radio.protocol,
                    unit: radio.unit,
                    off: radio.off_value.map_or(parameter::Off::Least(weakest.value), parameter::Off::Value),
                };
                AnyDevice::Parameter(Box::new(parameter::ByParameter::new(settings, clock.clone())))
            }
            #[cfg(feature = "soapy")]
            DeviceKind::Soapy => {
                let radio = draft.soapy.as_ref()?;
                let settings = soapy::Settings {
                    args: radio.args.clone(),
                    channel: usize::try_from(radio.channel).ok()?,
                    antenna: radio.antenna.clone(),
                    frequency_hz: draft.device.frequency_hz?,
                    sample_rate_hz: radio.sample_rate_hz,
                    least_gain_db: self
                        .scale
                        .settings()
                        .iter()
                        .map(|setting| setting.value)
                        .reduce(f64::min)?,
                };
                AnyDevice::Soapy(soapy::Soapy::new(settings))
            }
            #[cfg(not(feature = "soapy"))]
            DeviceKind::Soapy => return None,
        })
    }

    fn reads_back(&self) -> bool {
        let draft = &self.draft;
        match draft.device.kind {
            DeviceKind::Command => {
                draft.by_command.as_ref().is_some_and(|command| !programs(command).read.is_empty())
            }
            DeviceKind::Attenuator => true,
            DeviceKind::JsonRpc => {
                draft.json_rpc.as_ref().is_some_and(|radio| radio.read.is_some() || radio.set.is_none())
            }
            DeviceKind::At => draft.at.as_ref().is_some_and(|at| at.reads_back),
            DeviceKind::Parameter | DeviceKind::Soapy => true,
        }
    }
}

fn time(ms: f64) -> Duration {
    Duration::from_secs_f64(ms * 1e-3)
}

/// Whether only a kill line can silence the device.
fn has_no_off(draft: &RadioHostDraft) -> bool {
    draft.device.kind == DeviceKind::Parameter
        && draft.parameter.as_ref().is_some_and(|parameter| parameter.off_value.is_none())
}

fn programs(draft: &CommandDraft) -> command::Settings {
    if let Some(interface) = &draft.interface {
        return command::Settings::iw(interface);
    }
    let given = |words: &Option<Vec<String>>| words.clone().unwrap_or_default();
    let text = |text: &Option<String>| text.clone().unwrap_or_default();
    command::Settings {
        set: given(&draft.set),
        on: given(&draft.on),
        off: given(&draft.off),
        read: given(&draft.read),
        reading: Reading { after: text(&draft.read_after), before: text(&draft.read_before) },
        read_off: given(&draft.read_off),
        off_reads: text(&draft.off_reads),
    }
}

fn calls(draft: &JsonRpcDraft) -> Option<json_rpc::Settings> {
    let to = host_port(&draft.address)?;
    let call =
        |json: &Option<String>, at: &String| json.clone().map(|json| json_rpc::Call { json, at: at.clone() });
    let (set, read) = match &draft.set {
        Some(set) => (set.clone(), call(&draft.read, &draft.read_at)),
        None => {
            let (set, read) = json_rpc::streamcaster();
            (set, call(&draft.read, &draft.read_at).or(Some(read)))
        }
    };
    Some(json_rpc::Settings {
        to,
        path: draft.path.clone(),
        login: call(&draft.login, &draft.login_at),
        set,
        read,
        on: draft.on.clone(),
        off: draft.off.clone(),
        read_off: call(&draft.read_off, &draft.read_off_at),
        off_reads: draft.off_reads.clone(),
    })
}

fn host_port(address: &LinkAddress) -> Option<HostPort> {
    if let LinkAddress::TcpOut(to) = address { Some(to.clone()) } else { None }
}

/// All settings that the device takes.
fn settings_of(draft: &RadioHostDraft) -> Vec<f64> {
    let device = &draft.device;
    if let Some(levels) = &device.levels {
        return levels.clone();
    }
    let (Some(least), Some(most)) = (device.least, device.most) else { return Vec::new() };
    let steps = ((most - least) / device.step + 1e-9).floor().clamp(0.0, MOST_SETTINGS as f64) as u32;
    // To the millionth: 0.1 three times is 0.3.
    (0..=steps).map(|k| ((least + f64::from(k) * device.step) * 1e6).round() * 1e-6).collect()
}

/// Powers by the device's own word.
fn linear(draft: &RadioHostDraft) -> Result<Scale, ScaleError> {
    let settings = settings_of(draft);
    match draft.device.kind {
        DeviceKind::Attenuator => Scale::linear(&settings, draft.device.source_dbm.unwrap_or_default(), -1.0),
        _ => Scale::linear(&settings, 0.0, 1.0),
    }
}

fn measured(draft: &RadioHostDraft, file: &Path, text: &str) -> Result<Scale, Diagnostics> {
    let scale = |points: Vec<Point>| Scale::measured(&settings_of(draft), &points, draft.device.frequency_hz);
    points_of_csv(text).and_then(scale).map_err(|error| {
        let at = (error.line().unwrap_or(1), 1);
        Diagnostics::of_text(&file.display().to_string(), text, at, error.to_string(), error.remedy())
    })
}

fn fault(document: &Document, setting: &str, message: String, help: String) -> Diagnostics {
    let mut all = Diagnostics::new(&document.file, document.text.clone());
    all.push(Severity::Error, document.at(setting), message, help);
    all
}

fn at_device(document: &Document, error: &ScaleError) -> Diagnostics {
    fault(document, "device", error.to_string(), error.remedy().to_owned())
}
