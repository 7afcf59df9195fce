//! The radio host's event loop: its link, its device and its clock around [`Host`].
//!
//! Outputs first, then inputs. The device is driven by a task of its own, so that nothing it does or does not do delays an
//! expiry, an answer or an off. The kill line is driven from this loop itself, before the device is told anything: a loop that
//! hangs does not feed a one-shot. When it is told to stop, it is off, and was read back so, or has tried for [`STOP_WITHIN`],
//! before it ends.

use std::future::Future;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::sync::mpsc::unbounded_channel;
use tracing::{info, warn};

use crate::durable::{Keeper, replace};
use crate::link::envelope::Enclosed;
use crate::link::{Aboard, Clock, Form, Link, LinkAddress, LinkConfig, LinkError};
use crate::radio_device::{Device, Line, drive};
use crate::radio_host::{Host, Notice, Said, Settings};
use crate::systemd::Manager;
use crate::time::Instant;
use crate::transmitter::wire;

/// A device that is not read back off by then is left, and the end says so.
pub const STOP_WITHIN: Duration = Duration::from_secs(5);

/// What stands in the file of the kill.
const KILLED: &str = "killed = true\n";
const NOT_KILLED: &str = "killed = false\n";

/// Why the radio host cannot run.
#[derive(Debug, thiserror::Error)]
pub enum RadioLoopError {
    /// Its link cannot be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Whether a kill holds cannot be read, or not be kept.
    #[error("{}: {source}: a radio kill must be kept over a restart; give [log] dir a directory that can be written", path.display())]
    Kill {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file of the kill is not what was written.
    #[error("{} says {found:?}: a radio kill may be recorded in it; on the ground, remove it", path.display())]
    KillContent {
        /// The file.
        path: PathBuf,
        /// What it says.
        found: String,
    },
}

/// Whether a kill of an earlier process holds; the file is written again, so that what cannot be is known beforehand.
///
/// # Errors
/// [`RadioLoopError::Kill`], [`RadioLoopError::KillContent`].
pub fn kept_kill(path: &Path) -> Result<bool, RadioLoopError> {
    let fault = |source| RadioLoopError::Kill { path: path.to_owned(), source };
    let killed = match std::fs::read_to_string(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => false,
        Err(error) => return Err(fault(error)),
        Ok(text) if text == NOT_KILLED => false,
        Ok(text) if text == KILLED => true,
        Ok(text) => {
            let found = text.chars().take(40).collect();
            return Err(RadioLoopError::KillContent { path: path.to_owned(), found });
        }
    };
    replace(path, kill_text(killed)).map_err(fault)?;
    Ok(killed)
}

/// What stands in the file.
fn kill_text(killed: bool) -> &'static str {
    if killed { KILLED } else { NOT_KILLED }
}

/// How it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// The device was read back off.
    Off,
    /// It was not; the kill line keeps it silent, as far as the line stays where it is without this program.
    ByLine,
    /// It was not, and may radiate.
    MayRadiate,
}

/// Everything that a radio host is made of.
pub struct RadioProcess<D> {
    /// Where the companion is.
    pub link: (LinkAddress, LinkConfig),
    /// How its reports are sent.
    pub form: Form,
    /// The state machine's settings.
    pub settings: Settings,
    /// What is driven.
    pub device: D,
    /// Its kill line, driven off when it was opened; with [`Settings::line`], or neither.
    pub line: Option<Box<dyn Line>>,
    /// Where a kill is kept.
    pub kill_file: PathBuf,
    /// Who started this process, and its watchdog.
    pub manager: Manager,
}

impl<D: Device + 'static> RadioProcess<D> {
    /// Runs until `stop`, and then until the device is off.
    ///
    /// # Errors
    /// The link cannot be opened, or a kill not be kept. The device was told nothing then: say off to it.
    pub async fn run(self, clock: Clock, stop: impl Future<Output = ()>) -> Result<Stopped, RadioLoopError> {
        let own = self.settings.own;
        let lost = "the radio kill cannot be recorded: after a restart it holds no more";
        let kept = Keeper::spawn(self.kill_file.clone(), lost, |_| ())
            .map_err(|source| RadioLoopError::Kill { path: self.kill_file, source })?;
        let (address, config) = self.link;
        let mut link = Link::<Aboard>::open(address, config, clock.clone()).await?;
        let (orders, orders_for_device) = unbounded_channel();
        let (outcomes_of_device, mut outcomes) = unbounded_channel();
        let device = tokio::spawn(drive(self.device, orders_for_device, outcomes_of_device));
        let mut host = Host::new(self.settings, clock.now());
        let mut stop = std::pin::pin!(stop);
        let mut line = self.line;
        let mut line_obeys = true;
        let mut give_up_at: Option<Instant> = None;
        let mut manager = self.manager;
        // The device is told off at the first turn.
        manager.ready();
        let stopped = loop {
            while let Some(level) = host.poll_line() {
                let driven = line.as_mut().map(|line| line.drive(level));
                if let (Some(Err(error)), true) = (&driven, line_obeys) {
                    warn!(%error, "the kill line does not obey");
                }
                line_obeys = matches!(driven, Some(Ok(())));
                host.handle_line(level, line_obeys, clock.now());
            }
            while let Some(order) = host.poll_order() {
                // The task ends after this loop does.
                let _ = orders.send(order);
            }
            while let Some(said) = host.poll_transmit() {
                link.send(own, &aboard(said, self.form, own));
            }
            while let Some(notice) = host.poll_notice() {
                manager.status(&notice.to_string());
                log(notice);
            }
            if let Some(killed) = host.poll_kill_record() {
                kept.keep(kill_text(killed).to_owned());
            }
            manager.turn(clock.now(), host.poll_timeout().0);
            match give_up_at {
                Some(_) if host.is_off() => break Stopped::Off,
                Some(at) if at <= clock.now() && host.is_silent() => break Stopped::ByLine,
                Some(at) if at <= clock.now() => break Stopped::MayRadiate,
                _ => {}
            }
            let (due, now) = (host.poll_timeout().0, clock.now());
            if due <= now {
                host.handle_timeout(now);
                continue;
            }
            let deadline = give_up_at.map_or(due, |at| at.min(due));
            tokio::select! {
                biased;
                () = &mut stop, if give_up_at.is_none() => {
                    info!("stopping: off");
                    manager.stopping();
                    host.stop(clock.now());
                    give_up_at = Some(clock.now() + STOP_WITHIN);
                }
                Some((id, outcome)) = outcomes.recv() => host.handle_outcome(id, outcome, clock.now()),
                frame = link.recv() => {
                    if let Aboard::Common(message) = &frame.message {
                        host.handle_message(frame.header, message, clock.now());
                    }
                }
                () = clock.sleep_until(deadline) => {}
            }
        };
        device.abort();
        info!("commands: {}", host.counters());
        info!("link: {}", link.counters());
        Ok(stopped)
    }
}

fn aboard(said: Said, form: Form, own: (u8, u8)) -> Aboard {
    match said {
        Said::Common(message) => Aboard::Common(*message),
        Said::Report(report) => {
            Aboard::Radio(Enclosed::new(form, own, 0, wire::MavMessage::VEILWING_RADIO(report)))
        }
    }
}

fn log(notice: Notice) {
    match notice {
        Notice::Commander { .. } | Notice::Silent => info!("{notice}"),
        _ => warn!("{notice}"),
    }
}
