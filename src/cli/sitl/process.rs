//! The companion processes of a simulated flight.

use std::io;
use std::path::Path;
use std::process::{ExitStatus, Stdio};

use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process, prlimit};
use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::process::{Child, Command};
use tokio::sync::mpsc;

use crate::cli::progress;
use crate::desk::report::Severity;
use crate::role::Role;

/// How a companion process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// With this exit code.
    Code(i32),
    /// By this signal.
    Signal(i32),
    /// This process asked it to stop.
    Stopped,
}

/// A companion process.
pub(super) struct Companion {
    pub child: Child,
    /// How it ended, if it was not to be started again.
    pub end: Option<End>,
    /// Dead, to be started again.
    pub gone: bool,
    /// Stopped by a signal.
    pub frozen: bool,
}

impl Companion {
    /// It exists, as far as its end has been seen.
    pub fn lives(&self) -> bool {
        self.end.is_none() && !self.gone
    }

    pub fn signal(&self, signal: Signal) {
        if let Some(pid) = self.pid() {
            // It may have ended in the meantime.
            let _ = kill_process(pid, signal);
        }
    }

    /// No file of it grows any more, or may again: what a full disk does to it. Its log on stderr is a pipe.
    pub fn fill_disk(&self, full: bool) -> io::Result<()> {
        let Some(pid) = self.pid() else { return Ok(()) };
        let limit = Rlimit { current: full.then_some(0), maximum: None };
        prlimit(Some(pid), Resource::Fsize, limit)?;
        Ok(())
    }

    fn pid(&self) -> Option<Pid> {
        let id = self.child.id()?;
        i32::try_from(id).ok().and_then(Pid::from_raw)
    }
}

/// How companions are started.
pub(super) struct Spawning<'a> {
    pub mission: &'a Path,
    pub directory: &'a Path,
    /// Simulated seconds per second.
    pub speed: f64,
    /// Begin without waiting for MISSION_START.
    pub start: bool,
}

impl End {
    /// Of a process that was asked to stop, or was not.
    pub fn new(status: ExitStatus, asked_to_stop: bool) -> Self {
        use std::os::unix::process::ExitStatusExt;
        match status.code() {
            _ if asked_to_stop => Self::Stopped,
            Some(code) => Self::Code(code),
            None => Self::Signal(status.signal().unwrap_or_default()),
        }
    }
}

/// How a companion ended, in words.
pub(super) fn describe_end(end: End) -> String {
    match end {
        End::Code(0) => "has ended: mission completed".into(),
        End::Code(code) => format!("has ended with exit code {code}: mission not completed"),
        End::Signal(signal) => format!("was killed by signal {signal}"),
        End::Stopped => "was asked to stop".into(),
    }
}

/// Starts a companion; its log goes to a file in the directory, after that of an earlier one, and what the operator
/// should see of it to `lines`.
pub(super) fn spawn_companion(
    &Spawning { mission, directory, speed, start }: &Spawning<'_>,
    role: Role,
    vehicle: &Path,
    lines: &mpsc::UnboundedSender<(Role, Line)>,
) -> Result<Companion, String> {
    let program =
        std::env::current_exe().map_err(|error| format!("this program cannot find itself: {error}"))?;
    let mut child = Command::new(program)
        .args(["--log-format", "json", "fly"])
        .arg(mission)
        .arg("--vehicle")
        .arg(vehicle)
        .args(start.then_some("--start"))
        .args(["--clock-rate", &speed.to_string()])
        // It ends with this process, even if that is killed.
        .arg("--until-stdin-ends")
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        // Ctrl-C reaches this process alone, which then stops the companions in order.
        .process_group(0)
        .kill_on_drop(true)
        .spawn()
        .map_err(|error| format!("companion {role} cannot start: {error}"))?;
    let pid = child.id().unwrap_or_default();
    progress(&format!("[    0.0 s] {role}  companion started, process {pid}"));
    let name = role.key();
    let path = directory.join(format!("companion-{name}.log"));
    let mut file = std::fs::OpenOptions::new()
        .append(true)
        .create(true)
        .open(&path)
        .map_err(|error| format!("{}: {error}", path.display()))?;
    if let Some(stderr) = child.stderr.take() {
        let lines = lines.clone();
        tokio::spawn(async move {
            let mut stderr = BufReader::new(stderr).lines();
            while let Ok(Some(line)) = stderr.next_line().await {
                // A full disk costs the log, not the flight.
                let _ = std::io::Write::write_all(&mut file, format!("{line}\n").as_bytes());
                if let Some(text) = readable(&line)
                    && lines.send((role, text)).is_err()
                {
                    break;
                }
            }
        });
    }
    Ok(Companion { child, end: None, gone: false, frozen: false })
}

/// A line of a companion's log, for the operator.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Line {
    /// How bad it is.
    pub severity: Severity,
    /// The companion's phase; empty if it has none to tell.
    pub phase: String,
    /// What it says.
    pub text: String,
}

impl std::fmt::Display for Line {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { severity, phase, text } = self;
        match severity {
            Severity::Info => write!(f, "{phase:<14} {text}"),
            Severity::Warning => write!(f, "{phase:<14} warn: {text}"),
            Severity::Error => write!(f, "{phase:<14} error: {text}"),
        }
    }
}

/// What the operator should see of a companion's log: its message if it is a log record of information or worse.
fn readable(line: &str) -> Option<Line> {
    let Ok(record) = serde_json::from_str::<serde_json::Value>(line) else {
        return Some(Line { severity: Severity::Info, phase: String::new(), text: line.to_owned() });
    };
    let severity = match record.get("level").and_then(serde_json::Value::as_str).unwrap_or_default() {
        "DEBUG" | "TRACE" => return None,
        "INFO" => Severity::Info,
        "WARN" => Severity::Warning,
        _ => Severity::Error,
    };
    let fields = record.get("fields");
    let field = |name: &str| {
        fields.and_then(|f| f.get(name)).and_then(serde_json::Value::as_str).unwrap_or_default().to_owned()
    };
    // A record of a link says which one, and what went wrong with it.
    let part = |name: &str, before: &str, after: &str| {
        let value = field(name);
        if value.is_empty() { value } else { format!("{before}{value}{after}") }
    };
    let text = format!("{}{}{}", part("link", "", ": "), field("message"), part("error", ": ", ""));
    Some(Line { severity, phase: field("phase"), text })
}
