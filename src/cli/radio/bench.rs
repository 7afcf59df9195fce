//! A device on the bench: told by hand, and off whatever happens.

use std::time::Duration;

use tokio::runtime::Runtime;

use crate::cli::interrupt;
use crate::config::RadioFile;
use crate::link::Clock;
use crate::radio_device::{AnyDevice, Device, DeviceError};

/// A device that has not answered by then will not.
const PATIENCE: Duration = Duration::from_secs(30);

/// Why a bench cannot go on.
#[derive(Debug, thiserror::Error)]
pub(super) enum BenchError {
    /// The device did not do it.
    #[error("{doing}: {source}")]
    Device {
        /// What was wanted.
        doing: &'static str,
        /// Why not.
        source: DeviceError,
    },
    /// It did not answer.
    #[error("{doing}: no answer in {} s", PATIENCE.as_secs())]
    Late {
        /// What was wanted.
        doing: &'static str,
    },
    /// Somebody wants it to end.
    #[error("interrupted")]
    Interrupted,
}

/// One thread is enough.
pub(super) fn runtime() -> Result<Runtime, String> {
    let mut builder = tokio::runtime::Builder::new_current_thread();
    builder.enable_all().build().map_err(|error| format!("the event loop cannot start: {error}"))
}

/// The device of a file, and a clock.
pub(super) struct Bench {
    device: AnyDevice,
    clock: Clock,
}

impl Bench {
    pub fn new(radio: &RadioFile) -> Option<Self> {
        Some(Self { device: radio.device()?, clock: Clock::real() })
    }

    /// Off, and how long that took.
    pub async fn off(&mut self) -> Result<Duration, BenchError> {
        let begun = self.clock.now();
        within(&self.clock, "off", self.device.off()).await?;
        Ok(self.clock.now().saturating_since(begun))
    }

    /// At a setting: what was read back, and how long that took.
    pub async fn set(&mut self, setting: f64) -> Result<(Option<f64>, Duration), BenchError> {
        let begun = self.clock.now();
        let read_back = within(&self.clock, "set", self.device.set(setting)).await?;
        Ok((read_back, self.clock.now().saturating_since(begun)))
    }

    /// Off after all, also after an interruption, which does not interrupt this.
    pub async fn leave(&mut self) -> Result<(), BenchError> {
        let deadline = self.clock.now() + PATIENCE;
        tokio::select! {
            done = self.device.off() => done.map_err(|source| BenchError::Device { doing: "off", source }),
            () = self.clock.sleep_until(deadline) => Err(BenchError::Late { doing: "off" }),
        }
    }
}

/// A step of the device's, unless it takes too long, or somebody wants it to end.
async fn within<T>(
    clock: &Clock,
    doing: &'static str,
    step: impl Future<Output = Result<T, DeviceError>>,
) -> Result<T, BenchError> {
    tokio::select! {
        done = step => done.map_err(|source| BenchError::Device { doing, source }),
        () = clock.sleep_until(clock.now() + PATIENCE) => Err(BenchError::Late { doing }),
        () = interrupt::requested() => Err(BenchError::Interrupted),
    }
}

/// How a bench ended: off it is in any case, or that is said.
pub(super) fn end(left: Result<(), BenchError>, done: Result<(), BenchError>) -> crate::cli::Exit {
    if let Err(error) = &left {
        eprintln!("error: {error}: the device may radiate; cut its supply");
    }
    match (done, left) {
        (Err(BenchError::Interrupted), Ok(())) => crate::cli::Exit::Interrupted,
        (Err(error), _) => {
            eprintln!("error: {error}");
            crate::cli::Exit::Bad
        }
        (Ok(()), Err(_)) => crate::cli::Exit::Bad,
        (Ok(()), Ok(())) => crate::cli::Exit::Done,
    }
}
