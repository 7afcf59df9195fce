//! Any program: one that sets, one that turns off, one that reads back.
//!
//! Every argument may hold placeholders (`{dbm}`, `{mbm}`, `{mw}`, `{level}`); no shell is between. A program succeeds with exit
//! code 0. Each runs in a process group of its own, which is killed as a whole when its order is pre-empted.
//!
//! Facts of the preset for Wi-Fi cards ([`Settings::iw`]), from iw's help, the man pages of iw and ip, and nl80211.h:
//! - `iw dev X set txpower fixed N` takes N in mBm, hundredths of a dBm; `auto` and `limit` are other things. The driver may
//!   round, clip to what the regulatory domain allows, or keep another value, and says so only in `iw dev X info`
//!   (`txpower 20.00 dBm`). Some drivers show what was asked for, whatever the hardware does: measure one.
//! - There is no power that is off. `ip link set X down` ends transmission; `ip -brief link show X` then says `DOWN`. `rfkill
//!   block` does too, for every interface of the card, and may be given instead.
//! - The power is set before the link goes up, so that it does not come up at the last one. It takes tens of milliseconds; a
//!   link that goes up must find its peers again, which takes longer than that in all modes but monitor and IBSS.
//! - Nothing turns it off if this program dies.

use std::process::Stdio;

use rustix::process::{Pid, Signal, kill_process_group};
use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::process::Command;

use super::template::fill;
use super::{Device, DeviceError, MOST_BYTES, Reading};

/// The most that is kept of what a program says on stderr.
const MOST_COMPLAINT: u64 = 4096;

/// The programs, each with its arguments.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Settings {
    /// Sets the power; while it is off, before [`Self::on`].
    pub set: Vec<String>,
    /// Ends the off, if setting a power does not; may be empty.
    pub on: Vec<String>,
    /// Turns off.
    pub off: Vec<String>,
    /// Says the setting in force; empty: it cannot be read back.
    pub read: Vec<String>,
    /// Where it says it.
    pub reading: Reading,
    /// Says whether it is off; empty: it cannot be read back.
    pub read_off: Vec<String>,
    /// What that says, among other things, when it is off.
    pub off_reads: String,
}

impl Settings {
    /// For a Wi-Fi card's interface: see the module.
    #[must_use]
    pub fn iw(interface: &str) -> Self {
        let words = |text: &str| text.split(' ').map(|word| word.replace("IFACE", interface)).collect();
        Self {
            set: words("iw dev IFACE set txpower fixed {mbm}"),
            on: words("ip link set IFACE up"),
            off: words("ip link set IFACE down"),
            read: words("iw dev IFACE info"),
            reading: Reading { after: "txpower".to_owned(), before: "dBm".to_owned() },
            read_off: words("ip -brief link show IFACE"),
            off_reads: "DOWN".to_owned(),
        }
    }
}

/// See the module.
#[derive(Debug)]
pub struct Program {
    settings: Settings,
}

impl Program {
    /// A device that these programs drive.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { settings }
    }
}

impl Device for Program {
    async fn off(&mut self) -> Result<(), DeviceError> {
        let Settings { off, read_off, off_reads, .. } = &self.settings;
        run(off, 0.0).await?;
        if read_off.is_empty() {
            return Ok(());
        }
        let said = run(read_off, 0.0).await?;
        // As a word: an address may hold it.
        let is_off = said.split_whitespace().any(|word| word == off_reads) || said.trim() == off_reads.trim();
        if is_off { Ok(()) } else { Err(DeviceError::StillOn(super::excerpt(&said))) }
    }

    async fn set(&mut self, setting: f64) -> Result<Option<f64>, DeviceError> {
        let Settings { set, on, read, reading, .. } = &self.settings;
        run(set, setting).await?;
        if !on.is_empty() {
            run(on, setting).await?;
        }
        if read.is_empty() {
            return Ok(None);
        }
        let said = run(read, setting).await?;
        reading.of(&said).map(Some).ok_or_else(|| DeviceError::garbled(&said))
    }
}

/// Kills a program and all that it started, unless it has ended.
struct Group(Option<Pid>);

impl Drop for Group {
    fn drop(&mut self) {
        if let Some(group) = self.0 {
            // Gone already, or nothing that can be done about it.
            let _ = kill_process_group(group, Signal::KILL);
        }
    }
}

/// What the program says on stdout, if it succeeds.
async fn run(program: &[String], setting: f64) -> Result<String, DeviceError> {
    let mut words = program.iter().map(|word| fill(word, setting));
    let name = words.next().unwrap_or_default();
    let mut child = Command::new(&name)
        .args(words)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .kill_on_drop(true)
        .spawn()?;
    let mut group = Group(child.id().and_then(|id| Pid::from_raw(id.cast_signed())));
    let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
    let (said, complaint) = tokio::join!(read(stdout, MOST_BYTES as u64 + 1), read(stderr, MOST_COMPLAINT));
    let said = said?;
    if said.len() > MOST_BYTES {
        return Err(DeviceError::TooMuch);
    }
    let status = child.wait().await?;
    group.0 = None;
    let said = String::from_utf8_lossy(&said).into_owned();
    if status.success() {
        return Ok(said);
    }
    let complaint = String::from_utf8_lossy(&complaint?).into_owned();
    Err(DeviceError::refused(&format!("{name} ended with {status}: {complaint}")))
}

/// So much of a pipe.
async fn read(pipe: Option<impl AsyncRead + Unpin>, most: u64) -> Result<Vec<u8>, DeviceError> {
    let mut bytes = Vec::new();
    if let Some(pipe) = pipe {
        pipe.take(most).read_to_end(&mut bytes).await?;
    }
    Ok(bytes)
}
