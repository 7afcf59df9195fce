//! Modems that take AT commands over telnet or a serial line: Microhard pMDDL and its like.
//!
//! Facts, as ground stations and drivers that others have published use them. The maker's manual of the pMDDL was not to be had, so
//! every command, and where its answer stands, can be given, and `veilwing radio measure` says whether they fit:
//! - Telnet port 23 asks for `login:` and `Password:`, and says `Entering` when it takes commands; the serial console takes
//!   them at once. A command ends with a line feed, is echoed, and is answered with its lines, then `OK` or `ERROR`.
//! - `AT+MWTXPOWER=20` sets the power in whole dBm (7 to 30 by model), `AT+MWTXPOWER?` says it. `AT+MWRADIO=0` turns the radio off
//!   and `=1` on, `AT+MWRADIO?` says which. They hold until the next start; only `AT&W` writes them down, and is not used here.
//! - Some firmware restarts the wireless interface for a change of power, which takes a second or more: measure it (`veilwing
//!   radio measure`), and declare it. Firmware with `AT+MWTXPOWERQ` changes it without: give that in `set`.
//! - It goes on as it is if this program dies.
//!
//! Found in such programs, several of them: `AT+MWTXPOWER=`, `AT+MWTXPOWER?`, `AT+MWTXPOWERQ=` (with a flag whether it is kept),
//! `AT+MWRADIO=0` and `=1`, answers that end with `OK`, the login. Not found in any: `AT+MWRADIO?`, how the answers to the
//! two questions are worded, and any time. Where `read_off` is not known by your firmware, it answers `ERROR`, and the file
//! is of no use before another one is given.

use super::lines::Lines;
use super::template::fill;
use super::{Device, DeviceError, Reading};
use crate::link::LinkAddress;

/// The device's settings; commands with placeholders.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// `tcpout:` (telnet) or `serial:`.
    pub link: LinkAddress,
    /// User and password, where it asks for them.
    pub login: Option<(String, String)>,
    /// Sets the power.
    pub set: String,
    /// Says it; empty: it cannot be read back.
    pub read: String,
    /// Where.
    pub reading: Reading,
    /// Ends the off; may be empty.
    pub on: String,
    /// Turns off.
    pub off: String,
    /// Says whether it is off; empty: it cannot be read back.
    pub read_off: String,
    /// The number that it says then, and where.
    pub off_reading: Reading,
    /// The number that means off.
    pub off_reads: f64,
}

/// See the module.
#[derive(Debug)]
pub struct Modem {
    settings: Settings,
    lines: Option<Lines>,
}

impl Modem {
    /// A modem that is not connected yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { settings, lines: None }
    }

    async fn open(&self) -> Result<Lines, DeviceError> {
        let Settings { link, login, .. } = &self.settings;
        let mut lines = Lines::open(link).await?;
        if let Some((user, password)) = login {
            lines.until(&["ogin:"]).await?;
            lines.ask(user, "\n").await?;
            lines.until(&["assword:"]).await?;
            lines.ask(password, "\n").await?;
            if lines.until(&["Entering", "ncorrect"]).await? != 0 {
                return Err(DeviceError::refused("the login"));
            }
        }
        Ok(lines)
    }

    /// What is said to a command before `OK`, its echo aside.
    async fn ask(&mut self, command: &str) -> Result<String, DeviceError> {
        let mut lines = match self.lines.take() {
            Some(lines) => lines,
            None => self.open().await?,
        };
        lines.ask(command, "\n").await?;
        let mut said = String::new();
        loop {
            let line = lines.line().await?;
            // A prompt may stand before the echo.
            match line.as_str() {
                "OK" => break,
                _ if line.starts_with("ERROR") => {
                    return Err(DeviceError::refused(&format!("{command}: {line}")));
                }
                _ if line.ends_with(command) => {}
                _ => said = said + &line + "\n",
            }
        }
        self.lines = Some(lines);
        Ok(said)
    }
}

impl Device for Modem {
    async fn off(&mut self) -> Result<(), DeviceError> {
        let Settings { off, read_off, off_reading, off_reads, .. } = self.settings.clone();
        self.ask(&off).await?;
        if read_off.is_empty() {
            return Ok(());
        }
        let said = self.ask(&read_off).await?;
        match off_reading.of(&said) {
            None => Err(DeviceError::garbled(&said)),
            Some(value) if value == off_reads => Ok(()),
            Some(_) => Err(DeviceError::StillOn(super::excerpt(&said))),
        }
    }

    async fn set(&mut self, setting: f64) -> Result<Option<f64>, DeviceError> {
        let Settings { set, on, read, reading, .. } = self.settings.clone();
        self.ask(&fill(&set, setting)).await?;
        if !on.is_empty() {
            self.ask(&on).await?;
        }
        if read.is_empty() {
            return Ok(None);
        }
        let said = self.ask(&read).await?;
        reading.of(&said).map(Some).ok_or_else(|| DeviceError::garbled(&said))
    }
}
