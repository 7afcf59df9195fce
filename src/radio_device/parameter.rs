//! Radios whose power is a MAVLink parameter: OpenHD, mLRS, and whatever else speaks a parameter protocol.
//!
//! A value is set, the radio's answer to that is awaited, and then it is asked for what it has: what counts as read back is the
//! answer to such a question. What is not answered is said again 20 times a second. Only the component that the file names is believed.
//! The link is kept from one order to the next, by a task of its own that hears the radio also when nobody asks; what had come
//! before an order is thrown away, as it answers another.
//!
//! What is read back is the parameter, and not what is radiated. How long a radio takes to follow its parameter, only a
//! spectrum analyser says.
//!
//! Facts of OpenHD, from its sources and QOpenHD's (2021 to 2025):
//! - The air unit is system 101, the ground unit 100; the parameters of the link are of component 191 (100 in old releases).
//!   QOpenHD sets them by PARAM_EXT_SET, INT32.
//! - `TX_POWER_MW` is in milliwatts, 10 to 30,000 (2,000 in old releases): anything else is refused, so that there is no off.
//!   It is handed to the driver as `iw` does it. `TX_POWER_I` is the power index of RTL8812AU cards, 0 to 63: 0 is the
//!   driver's own choice and not off. `TX_POWER_MW_ARM` and `TX_POWER_I_ARMED` are used in their place while the autopilot is
//!   armed, 0 meaning that they are not: leave them at 0. The newest sources have `TX_PWR_LVL`, 20 to 100 per cent in steps of
//!   20, and call that the only control there is for users.
//! - Each value is written to its settings file before it is applied: a memory card's worth of wear for each slot.
//!
//! Facts of mLRS, from its documents and sources (to 1.3):
//! - The transmitter module is system 51, component 68, if `Tx Mav Component` is enabled and a receiver in MAVLink mode is or was
//!   connected. It says in AUTOPILOT_VERSION that its parameters are encoded bytewise.
//! - `TX_POWER` is a UINT8: an index into the module's own list of powers, the least first, which only the module shows
//!   (`levels`, and a calibration). None of them is off. It is not kept over a restart but by `PSTORE`, which is not used here.
//! - Not verified: that the module radiates by a new index at once. `veilwing radio measure` cannot tell; a power meter can.
//!
//! ExpressLRS: not verified. Its sources forward MAVLink and have no component with parameters; its power is set by CRSF.
//!
//! None of them turns itself off if this program dies.

use std::io;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, ParamAck};
use tokio::sync::mpsc::{Receiver, Sender, UnboundedReceiver, UnboundedSender, channel, unbounded_channel};
use tokio::task::JoinHandle;

use super::{Device, DeviceError};
use crate::link::{Aboard, Clock, Link, LinkAddress, LinkConfig};
use crate::transmitter::Protocol;
use crate::transmitter::parameter_protocol::{self as wire, Said, Type, same};

/// What was not answered is said again after this: PARAM_EXT_SET takes 28 ms at 57,600 baud.
const AGAIN: Duration = Duration::from_millis(50);
/// More than a radio says between two looks, unless it is flooded with questions.
const MOST_UNHEARD: usize = 64;
/// So often is a radio asked that says another value than was set: the first answers may be to what was said again, or to an
/// order that was pre-empted.
const QUESTIONS: u8 = 3;

/// What the parameter's value is, for a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// The setting itself: dBm, or a level.
    Setting,
    /// The setting is in dBm, the value in milliwatts.
    Milliwatt,
    /// The setting is in dBm, the value in watts.
    Watt,
}

/// The radio's settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Where it is.
    pub link: LinkAddress,
    /// Who we are there.
    pub own: (u8, u8),
    /// Its (system, component).
    pub target: (u8, u8),
    /// The parameter.
    pub name: String,
    /// How it is set.
    pub protocol: Protocol,
    /// What its value is.
    pub unit: Unit,
    /// The value that is off.
    pub off: Off,
}

/// What the radio is told for an off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Off {
    /// A value at which nothing is radiated, as the operator says.
    Value(f64),
    /// None there is: the weakest setting, and the kill line is off.
    Least(f64),
}

/// See the module.
#[derive(Debug)]
pub struct ByParameter {
    settings: Settings,
    clock: Clock,
    port: Option<Port>,
    /// Learnt by reading it.
    kind: Option<Type>,
}

impl ByParameter {
    /// A radio that was not spoken to yet.
    #[must_use]
    pub fn new(settings: Settings, clock: Clock) -> Self {
        Self { settings, clock, port: None, kind: None }
    }

    /// Sets the parameter and reads it back: what it has.
    async fn give(&mut self, exact: f64) -> Result<f64, DeviceError> {
        let Self { settings, clock, port, kind } = self;
        let (settings, clock) = (&*settings, &*clock);
        // Kept also when this is dropped: a link that is opened anew has to find its radio again, and may reset it.
        let port = match port {
            Some(port) => port,
            None => port.insert(Port::open(settings.clone(), clock.clone()).await?),
        };
        while port.heard.try_recv().is_ok() {}
        let mut ask = async |message: &MavMessage| port.ask(message, clock).await;
        let Settings { name, protocol, target, .. } = settings;
        let question = wire::read(*protocol, name, *target);
        let known = match *kind {
            Some(kind) => kind,
            None => *kind.insert(ask(&question).await?.kind),
        };
        // Never more than was asked for; but the grid's rounding is no reason for the next integer below.
        let value = if known.is_whole() { (exact + 1e-6).floor() } else { exact };
        let mut found = ask(&wire::set(*protocol, name, *target, known, value)).await?;
        for _ in 0..QUESTIONS {
            let refused =
                ![ParamAck::PARAM_ACK_ACCEPTED, ParamAck::PARAM_ACK_IN_PROGRESS].contains(&found.result);
            if refused {
                return Err(DeviceError::refused(&format!("{name} = {value}: {:?}", found.result)));
            }
            found = ask(&question).await?;
            if found.value.is_some_and(|found| same(found, value)) {
                break;
            }
        }
        if found.kind != known {
            // Another radio, or another release of it.
            *kind = None;
            return Err(DeviceError::garbled(&format!("{name} is {:?}, and was {known:?}", found.kind)));
        }
        found.value.ok_or_else(|| DeviceError::garbled(&format!("{name} has no finite value")))
    }
}

/// The link to the radio, and what it says of the parameter.
#[derive(Debug)]
struct Port {
    say: UnboundedSender<MavMessage>,
    heard: Receiver<Said>,
    task: JoinHandle<()>,
}

impl Drop for Port {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Port {
    async fn open(settings: Settings, clock: Clock) -> Result<Self, DeviceError> {
        let config = LinkConfig {
            name: "power parameter".to_owned(),
            peer_system: Some(settings.target.0),
            ..LinkConfig::default()
        };
        let opened = Link::open(settings.link.clone(), config, clock).await;
        let link = opened.map_err(|error| io::Error::other(error.to_string()))?;
        let (say, to_say) = unbounded_channel();
        let (to_hear, heard) = channel(MOST_UNHEARD);
        Ok(Self { say, heard, task: tokio::spawn(serve(link, settings, to_say, to_hear)) })
    }

    /// Says it until the radio says something of the parameter.
    async fn ask(&mut self, message: &MavMessage, clock: &Clock) -> Result<Said, DeviceError> {
        let gone = || DeviceError::Unreachable(io::ErrorKind::BrokenPipe.into());
        loop {
            self.say.send(message.clone()).map_err(|_| gone())?;
            let again_at = clock.now() + AGAIN;
            tokio::select! {
                biased;
                said = self.heard.recv() => return said.ok_or_else(gone),
                () = clock.sleep_until(again_at) => {}
            }
        }
    }
}

/// Has the link say what is to be said, and hears the radio. What nobody hears is as much as fits.
async fn serve(
    mut link: Link<Aboard>,
    settings: Settings,
    mut to_say: UnboundedReceiver<MavMessage>,
    to_hear: Sender<Said>,
) {
    let Settings { own, target, name, protocol, .. } = settings;
    loop {
        tokio::select! {
            biased;
            message = to_say.recv() => match message {
                Some(message) => link.send(own, &Aboard::Common(message)),
                None => return,
            },
            frame = link.recv() => {
                let from = (u8::try_from(frame.header.system_id).unwrap_or(0), frame.header.component_id);
                if let Aboard::Common(message) = &frame.message
                    && from == target
                    && let Some(said) = wire::said(protocol, &name, message)
                {
                    let _ = to_hear.try_send(said);
                }
            }
        }
    }
}

impl Unit {
    fn value(self, setting: f64) -> f64 {
        match self {
            Self::Setting => setting,
            Self::Milliwatt => 10f64.powf(setting / 10.0),
            Self::Watt => 10f64.powf(setting / 10.0) * 1e-3,
        }
    }

    /// The setting of a value; minus infinity where nothing is radiated.
    fn setting(self, value: f64) -> f64 {
        match self {
            Self::Setting => value,
            Self::Milliwatt => 10.0 * value.log10(),
            Self::Watt => 10.0 * (value * 1e3).log10(),
        }
    }
}

impl Device for ByParameter {
    async fn off(&mut self) -> Result<(), DeviceError> {
        let value = match self.settings.off {
            Off::Value(value) => value,
            Off::Least(setting) => self.settings.unit.value(setting),
        };
        let found = self.give(value).await?;
        let is_off = match self.settings.off {
            Off::Value(value) => same(found, value),
            // Rounded down, where it is whole.
            Off::Least(_) => same(found, value) || found == (value + 1e-6).floor(),
        };
        if is_off { Ok(()) } else { Err(DeviceError::StillOn(format!("{} = {found}", self.settings.name))) }
    }

    async fn set(&mut self, setting: f64) -> Result<Option<f64>, DeviceError> {
        let unit = self.settings.unit;
        let found = self.give(unit.value(setting)).await?;
        Ok(Some(unit.setting(found)))
    }
}
