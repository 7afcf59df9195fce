//! Devices that set a radio's power, each by its own protocol, and the task that drives one.
//!
//! A device is told off and a setting, and is read back each time where it can be. It may be slow, wrong, gone, or never
//! answer: nothing here decides how long that may take. Whoever gives the orders does, by giving the next one
//! ([`worker::drive`]): what is under way is dropped, connection and all, so that whatever a device still has to say to the
//! old order is not taken for an answer to the new one.
//!
//! A kill line ([`Line`]) is none of them, and goes with any: it is driven by whoever gives the orders, at once.
//!
//! What is read from a device is bounded ([`MOST_BYTES`]). Each backend's module says what its makers' documents say, and what
//! the device cannot do.

pub mod at;
pub mod attenuator;
pub mod command;
pub mod gpio;
mod http;
pub mod json_rpc;
mod lines;
pub mod parameter;
mod reading;
pub mod soapy;
mod template;
mod worker;

use std::future::Future;
use std::io;

pub use reading::Reading;
pub use worker::drive;

use crate::radio_host::{Fault, Level};

/// The most that is read of one answer of a device's.
pub const MOST_BYTES: usize = 64 * 1024;

/// Something that radiates by settings.
pub trait Device: Send {
    /// Silent, read back where that can be.
    ///
    /// # Errors
    /// It is not certainly silent.
    fn off(&mut self) -> impl Future<Output = Result<(), DeviceError>> + Send;

    /// At `setting`; what was read back, where it can be.
    ///
    /// # Errors
    /// It is not certainly there.
    fn set(&mut self, setting: f64) -> impl Future<Output = Result<Option<f64>, DeviceError>> + Send;
}

/// A wire to the transmitter's enable, which needs no answer of anybody's.
pub trait Line: std::fmt::Debug + Send {
    /// At `level`, read back where that can be. Takes no longer than a register does to be written.
    ///
    /// # Errors
    /// It is not certainly there.
    fn drive(&mut self, level: Level) -> Result<(), gpio::LineError>;
}

/// What went wrong, for the log.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// It cannot be reached, or broke off.
    #[error("it cannot be reached: {0}")]
    Unreachable(#[from] io::Error),
    /// It says no.
    #[error("it refuses: {0:?}")]
    Refused(String),
    /// What it says is not what its documents have it say.
    #[error("it answers {0:?}, which cannot be understood")]
    Garbled(String),
    /// It says more than [`MOST_BYTES`].
    #[error("it answers more than {MOST_BYTES} bytes")]
    TooMuch,
    /// It was told off, and was read back on.
    #[error("told off, it says {0:?}")]
    StillOn(String),
}

impl DeviceError {
    /// The kind of it.
    #[must_use]
    pub fn fault(&self) -> Fault {
        match self {
            Self::Unreachable(_) => Fault::Unreachable,
            Self::Refused(_) => Fault::Refused,
            Self::Garbled(_) | Self::TooMuch => Fault::Garbled,
            Self::StillOn(_) => Fault::StillOn,
        }
    }

    fn garbled(text: &str) -> Self {
        Self::Garbled(excerpt(text))
    }

    fn refused(text: &str) -> Self {
        Self::Refused(excerpt(text))
    }
}

/// As much of a text as a line of a log takes.
fn excerpt(text: &str) -> String {
    text.trim().chars().take(120).collect()
}

/// Whatever a file names.
#[derive(Debug)]
pub enum AnyDevice {
    /// A program.
    Command(command::Program),
    /// A programmable attenuator.
    Attenuator(attenuator::Attenuator),
    /// A radio with an HTTP interface.
    JsonRpc(json_rpc::JsonRpc),
    /// A modem.
    At(at::Modem),
    /// A radio with a power parameter.
    Parameter(Box<parameter::ByParameter>),
    /// A SoapySDR device.
    #[cfg(feature = "soapy")]
    Soapy(soapy::Soapy),
}

impl Device for AnyDevice {
    async fn off(&mut self) -> Result<(), DeviceError> {
        match self {
            Self::Command(device) => device.off().await,
            Self::Attenuator(device) => device.off().await,
            Self::JsonRpc(device) => device.off().await,
            Self::At(device) => device.off().await,
            Self::Parameter(device) => device.off().await,
            #[cfg(feature = "soapy")]
            Self::Soapy(device) => device.off().await,
        }
    }

    async fn set(&mut self, setting: f64) -> Result<Option<f64>, DeviceError> {
        match self {
            Self::Command(device) => device.set(setting).await,
            Self::Attenuator(device) => device.set(setting).await,
            Self::JsonRpc(device) => device.set(setting).await,
            Self::At(device) => device.set(setting).await,
            Self::Parameter(device) => device.set(setting).await,
            #[cfg(feature = "soapy")]
            Self::Soapy(device) => device.set(setting).await,
        }
    }
}
