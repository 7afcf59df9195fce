//! The companion processes of a simulated flight.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::process::{ExitStatus, Stdio};

use rustix::process::{Pid, Resource, Rlimit, Signal, kill_process, prlimit};
use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::process::{Child, ChildStderr, Command};
use tokio::sync::mpsc;

use crate::cli::progress;
use crate::cli::step::{Done, Flies};
use crate::desk::report::Severity;
use crate::role::Role;

use super::lockstep::Lead;

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
    pub role: Role,
    pub child: Child,
    /// What leads it through time, if it has none of its own.
    pub lead: Option<Lead>,
    /// How it ended, if it was not to be started again.
    pub end: Option<End>,
    /// Dead, to be started again.
    pub gone: bool,
    /// Stopped by a signal.
    frozen: bool,
    /// Waits for a disk that stalls.
    stalled: bool,
    /// Sent the signal that nothing survives.
    pub killed: bool,
}

impl Companion {
    /// It exists, as far as its end has been seen.
    pub fn lives(&self) -> bool {
        self.end.is_none() && !self.gone
    }

    pub fn kill(&mut self) {
        self.killed = true;
        self.signal(Signal::KILL);
    }

    /// Stops it by a signal, or lets it go on.
    pub fn freeze(&mut self, frozen: bool) {
        self.frozen = frozen;
        self.hold();
    }

    /// Lets it wait for its disk, or go on. A process cannot be given a slow disk: it does nothing meanwhile, which is the worst that
    /// one could do to it.
    pub fn stall(&mut self, stalled: bool) {
        self.stalled = stalled;
        self.hold();
    }

    /// It does nothing.
    pub fn is_held(&self) -> bool {
        self.frozen || self.stalled
    }

    fn hold(&self) {
        self.signal(if self.is_held() { Signal::STOP } else { Signal::CONT });
    }

    /// Asks it to stop in order.
    pub fn stop(&mut self) {
        match &mut self.lead {
            Some(lead) => lead.stop(),
            None => self.signal(Signal::TERM),
        }
    }

    fn signal(&self, signal: Signal) {
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
    /// Simulated seconds per second of the companion's own clock; `None`: its time is given out.
    pub rate: Option<f64>,
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
/// should see of it to `said`.
pub(super) fn spawn_companion(
    &Spawning { mission, directory, rate, start }: &Spawning<'_>,
    role: Role,
    vehicle: &Path,
    said: &mpsc::UnboundedSender<(Role, Said)>,
) -> Result<Companion, String> {
    let program =
        std::env::current_exe().map_err(|error| format!("this program cannot find itself: {error}"))?;
    // Either way it ends with this process, even if that is killed.
    let clock = match rate {
        Some(rate) => vec!["--until-stdin-ends".to_owned(), "--clock-rate".to_owned(), rate.to_string()],
        None => vec!["--clock-from-stdin".to_owned()],
    };
    let mut command = Command::new(program);
    command
        .args(["--log-format", "json", "fly", "--log-dir-is-the-flight-s"])
        .arg(mission)
        .arg("--vehicle")
        .arg(vehicle)
        .args(start.then_some("--start"))
        .args(clock);
    let log = directory.join(format!("companion-{}.log", role.key()));
    let mut child = spawn(&mut command, "companion", role, &log, said)?;
    let stdin = rate.is_none().then(|| child.stdin.take()).flatten();
    let lead = stdin.map(|stdin| Lead::new(role, stdin));
    Ok(Companion { role, child, lead, end: None, gone: false, frozen: false, stalled: false, killed: false })
}

/// Starts a process of a vehicle's, which ends no later than this one; what it logs goes to the end of a file, and what the
/// operator should see of it to `said`.
pub(super) fn spawn(
    command: &mut Command,
    what: &str,
    role: Role,
    log: &Path,
    said: &mpsc::UnboundedSender<(Role, Said)>,
) -> Result<Child, String> {
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        // Ctrl-C reaches this process alone, which then stops them in order.
        .process_group(0)
        .kill_on_drop(true)
        .spawn()
        .map_err(|error| format!("{what} {role} cannot start: {error}"))?;
    let pid = child.id().unwrap_or_default();
    progress(&format!("[    0.0 s] {role}  {what} started, process {pid}"));
    let file = std::fs::OpenOptions::new()
        .append(true)
        .create(true)
        .open(log)
        .map_err(|error| format!("{}: {error}", log.display()))?;
    if let Some(stderr) = child.stderr.take() {
        tokio::spawn(listen(role, stderr, file, said.clone()));
    }
    Ok(child)
}

/// What has been read of a companion.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Said {
    /// A line of its log.
    Line(Line),
    /// It has gone on as far as it was told.
    Done(Option<Flies>),
    /// Nothing more will come: it has ended.
    Gone,
}

/// Takes what a companion says, to its end: its log into the file, and what concerns this process or the operator to `said`.
pub(super) async fn listen(
    role: Role,
    stderr: ChildStderr,
    mut file: File,
    said: mpsc::UnboundedSender<(Role, Said)>,
) {
    let mut stderr = BufReader::new(stderr).lines();
    while let Ok(Some(line)) = stderr.next_line().await {
        let heard = if let Some(done) = Done::read(&line) {
            Some(Said::Done(done.flown))
        } else {
            // A full disk costs the log, not the flight.
            let _ = file.write_all(format!("{line}\n").as_bytes());
            readable(&line).map(Said::Line)
        };
        if heard.is_some_and(|heard| said.send((role, heard)).is_err()) {
            return;
        }
    }
    // Nobody may wait for it.
    let _ = said.send((role, Said::Gone));
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
