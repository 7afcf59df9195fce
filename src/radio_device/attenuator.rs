//! A programmable attenuator behind a transmitter of constant power: Mini-Circuits RUDAT and RCDAT.
//!
//! Facts, as drivers and emulators that others have published have them, after the maker's Prog_Manual-6 (Programmable Attenuator),
//! which was not to be had itself. So measure yours first (`veilwing radio measure`):
//! - The same commands over TCP port 23, over HTTP port 80 as `GET /:COMMAND`, and by serial line where the model has one.
//!   `:MN?` answers the model name (`MN=RUDAT-6000-30`, or `RUDAT-6000-30`), `:ATT?` the attenuation in dB (`12.25`),
//!   `:SETATT=12.25` answers `1` when done, `0` when refused, and `2` when the value was beyond the range and the largest was set
//!   instead. A password, where one is set, precedes an HTTP command as `PWD=...;`.
//! - 0 to 30, 60, 90 or 110 dB by model, in steps of 0.25 dB (some 0.5). A change settles in less than a millisecond; the command
//!   takes one to a few milliseconds over Ethernet.
//! - `:STARTUPATT:INDICATOR?` says what it comes up with after a power cut: `L` the last attenuation, `F` a given one
//!   (`:STARTUPATT:VALUE:`), `N` the factory's, which is the largest. Anything but `L` is what is wanted here, and is only told of.
//! - It has no off: off is the largest attenuation, and what leaks through it goes on. Only the transmitter behind it, or a
//!   line that cuts its supply, is silence. Nothing attenuates by itself if this program dies.
//! - One TCP connection at a time on some models: it is kept while all goes well.
//!
//! Found in such drivers, several of them: `SETATT=`, `ATT?`, `MN?`, `STARTUPATT:INDICATOR?` with its three letters, by HTTP and by
//! telnet, the colon before a command being optional; 1 for done and 0 for refused; an answer that begins with `-99` to what is not
//! known. Not found: the framing on a serial line, that 2 stands for a value out of range, and any time but the maker's own claims.
//!
//! Models with several channels (RC4DAT) take the channel first (`:CHAN:1:SETATT:`), and are not driven.

use super::lines::Lines;
use super::{Device, DeviceError, Reading, http};
use crate::link::{HostPort, LinkAddress};

/// Two readings in dB that are one, as it prints two decimals.
const SAME_DB: f64 = 0.01;

/// How it is reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Access {
    /// By lines of text: `tcpout:` or `serial:`.
    Lines(LinkAddress),
    /// By HTTP.
    Http {
        /// Host and port.
        to: HostPort,
        /// Its password, if it has one.
        password: Option<String>,
    },
}

/// The device's settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// How it is reached.
    pub access: Access,
    /// The attenuation that is off, in dB: the model's largest.
    pub off_db: f64,
}

/// See the module.
#[derive(Debug)]
pub struct Attenuator {
    settings: Settings,
    lines: Option<Lines>,
    known: bool,
}

impl Attenuator {
    /// An attenuator that is not connected yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { settings, lines: None, known: false }
    }

    async fn ask(&mut self, command: &str) -> Result<String, DeviceError> {
        match &self.settings.access {
            Access::Http { to, password } => {
                let password =
                    password.as_ref().map(|password| format!("PWD={password};")).unwrap_or_default();
                let body = http::request(to, &format!("/{password}{command}"), None).await?;
                Ok(body.trim().to_owned())
            }
            Access::Lines(address) => {
                let mut lines = match self.lines.take() {
                    Some(lines) => lines,
                    None => Lines::open(address).await?,
                };
                lines.ask(command, "\r\n").await?;
                let mut answer = lines.line().await?;
                if answer == command {
                    // It echoes.
                    answer = lines.line().await?;
                }
                self.lines = Some(lines);
                Ok(answer)
            }
        }
    }

    /// Sees once that it is what it should be.
    async fn meet(&mut self) -> Result<(), DeviceError> {
        if self.known {
            return Ok(());
        }
        let model = self.ask(":MN?").await?;
        if !model.contains("DAT") {
            return Err(DeviceError::garbled(&model));
        }
        let comes_up = self.ask(":STARTUPATT:INDICATOR?").await?;
        tracing::info!(model, comes_up, "the attenuator");
        if comes_up.trim_start_matches("STARTUPATT:INDICATOR=").starts_with('L') {
            tracing::warn!(
                "after a power cut the attenuator comes up as it was last, and may let power through: give it :STARTUPATT:INDICATOR:N"
            );
        }
        self.known = true;
        Ok(())
    }

    /// Sets and reads back.
    async fn attenuate(&mut self, db: f64) -> Result<f64, DeviceError> {
        self.meet().await?;
        let answer = self.ask(&format!(":SETATT={db:.2}")).await?;
        match answer.as_str() {
            "1" | "2" => {}
            "0" => return Err(DeviceError::refused(&format!(":SETATT={db:.2}"))),
            other => return Err(DeviceError::garbled(other)),
        }
        let read = self.ask(":ATT?").await?;
        Reading::default().of(&read).ok_or_else(|| DeviceError::garbled(&read))
    }
}

impl Device for Attenuator {
    async fn off(&mut self) -> Result<(), DeviceError> {
        let off_db = self.settings.off_db;
        let read_db = self.attenuate(off_db).await?;
        if read_db >= off_db - SAME_DB { Ok(()) } else { Err(DeviceError::StillOn(format!("{read_db} dB"))) }
    }

    async fn set(&mut self, setting: f64) -> Result<Option<f64>, DeviceError> {
        self.attenuate(setting).await.map(Some)
    }
}
