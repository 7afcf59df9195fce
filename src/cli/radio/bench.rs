//! A device on the bench: told by hand, and off whatever happens.

use std::path::Path;
use std::time::Duration;

use tokio::runtime::Runtime;

use super::MAY_RADIATE;
use crate::cli::interrupt;
use crate::config::RadioFile;
use crate::link::Clock;
use crate::radio_device::gpio::LineError;
use crate::radio_device::{AnyDevice, Device, DeviceError, Line};
use crate::radio_host::{Feed, Level, LineTimes};

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
    /// The kill line was not driven.
    #[error("the kill line: {0}")]
    Line(#[from] LineError),
    /// Somebody wants it to end.
    #[error("interrupted")]
    Interrupted,
}

/// One thread is enough.
pub(super) fn runtime() -> Result<Runtime, String> {
    let mut builder = tokio::runtime::Builder::new_current_thread();
    builder.enable_all().build().map_err(|error| format!("the event loop cannot start: {error}"))
}

/// The device of a file with its kill line, and a clock.
pub(super) struct Bench {
    device: AnyDevice,
    line: Option<KillLine>,
    clock: Clock,
}

/// A line by hand: what its hardware does, and its edges, while a one-shot needs them.
struct KillLine {
    line: Box<dyn Line>,
    times: LineTimes,
    feed: Option<Feed>,
}

impl KillLine {
    fn drive(&mut self, level: Level, clock: &Clock) -> Result<(), LineError> {
        self.feed = None;
        self.line.drive(level)?;
        if level == Level::On {
            self.feed = Feed::begun(self.times.silence, clock.now());
        }
        Ok(())
    }

    /// Waits until an edge is due, and makes it. For ever, where none is.
    async fn edge(&mut self, clock: &Clock) -> Result<(), LineError> {
        let Some(due) = self.feed.as_ref().map(Feed::due) else { return std::future::pending().await };
        clock.sleep_until(due).await;
        let Some(feed) = &mut self.feed else { return Ok(()) };
        if let Some(level) = feed.edge(clock.now()) {
            self.line.drive(level)?;
            feed.made(level, clock.now());
        }
        Ok(())
    }
}

impl Bench {
    /// The file's device and line, the line driven off.
    pub fn new(file: &Path, radio: &RadioFile) -> Result<Self, String> {
        let clock = Clock::real();
        let line = super::kill_line(file, radio)?.zip(radio.kill_line());
        let line = line.map(|(line, (_, times))| KillLine { line, times, feed: None });
        let device = radio.device(&clock).ok_or("the file names no device")?;
        Ok(Self { device, line, clock })
    }

    /// Off, and how long that took.
    pub async fn off(&mut self) -> Result<Duration, BenchError> {
        let begun = self.clock.now();
        self.drive(Level::Off)?;
        within(&self.clock, &mut self.line, "off", self.device.off()).await?;
        let alone = self.line.as_ref().filter(|line| line.times.alone);
        if let Some(silent) = alone.and_then(|line| line.times.silence.after()) {
            self.clock.sleep_until(begun + silent).await;
        }
        Ok(self.clock.now().saturating_since(begun))
    }

    /// At a setting: what was read back, and how long that took.
    pub async fn set(&mut self, setting: f64) -> Result<(Option<f64>, Duration), BenchError> {
        let begun = self.clock.now();
        let read_back = within(&self.clock, &mut self.line, "set", self.device.set(setting)).await?;
        self.drive(Level::On)?;
        Ok((read_back, self.clock.now().saturating_since(begun)))
    }

    /// Waits for something else, and holds the device where it is.
    pub async fn hold<T>(&mut self, wait: impl Future<Output = T>) -> Result<T, BenchError> {
        fed(&self.clock, &mut self.line, async { Ok(wait.await) }).await
    }

    /// Off after all, also after an interruption, which does not interrupt this.
    pub async fn leave(&mut self) -> Result<(), BenchError> {
        let line = self.drive(Level::Off);
        off(&mut self.device, &self.clock).await?;
        line
    }

    fn drive(&mut self, level: Level) -> Result<(), BenchError> {
        match &mut self.line {
            Some(line) => Ok(line.drive(level, &self.clock)?),
            None => Ok(()),
        }
    }
}

/// Off, whoever wants it to end.
pub(super) async fn off(device: &mut AnyDevice, clock: &Clock) -> Result<(), BenchError> {
    let deadline = clock.now() + PATIENCE;
    tokio::select! {
        done = device.off() => done.map_err(|source| BenchError::Device { doing: "off", source }),
        () = clock.sleep_until(deadline) => Err(BenchError::Late { doing: "off" }),
    }
}

/// A step of the device's, unless it takes too long, or somebody wants it to end.
async fn within<T>(
    clock: &Clock,
    line: &mut Option<KillLine>,
    doing: &'static str,
    step: impl Future<Output = Result<T, DeviceError>>,
) -> Result<T, BenchError> {
    let deadline = clock.now() + PATIENCE;
    fed(clock, line, async {
        tokio::select! {
            done = step => done.map_err(|source| BenchError::Device { doing, source }),
            () = clock.sleep_until(deadline) => Err(BenchError::Late { doing }),
            () = interrupt::requested() => Err(BenchError::Interrupted),
        }
    })
    .await
}

/// The step, and meanwhile the line's edges.
async fn fed<T>(
    clock: &Clock,
    line: &mut Option<KillLine>,
    step: impl Future<Output = Result<T, BenchError>>,
) -> Result<T, BenchError> {
    let Some(line) = line else { return step.await };
    let mut step = std::pin::pin!(step);
    loop {
        tokio::select! {
            biased;
            done = &mut step => return done,
            edge = line.edge(clock) => edge?,
        }
    }
}

/// How a bench ended: off it is in any case, or that is said.
pub(super) fn end(left: Result<(), BenchError>, done: Result<(), BenchError>) -> crate::cli::Exit {
    if let Err(error) = &left {
        eprintln!("error: {error}: {MAY_RADIATE}");
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
