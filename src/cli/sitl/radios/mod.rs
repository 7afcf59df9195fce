//! Radio hosts of a simulated flight: for each vehicle a fake device that this process serves over loopback, a radio file for
//! it, and the process `veilwing radio`. What the device does is what the vehicle radiates.

mod bench;
pub(in crate::cli) mod client;
mod file;
mod kind;
mod parameter;
mod protocol;
mod server;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use serde::Serialize;
use tokio::net::UdpSocket;
use tokio::process::{Child, Command};
use tokio::sync::mpsc;

use crate::cli::progress;
use crate::desk::simulation::{RadioFault, SimulatedDevice};
use crate::link::Clock;
use crate::radio_loop::STOP_WITHIN;
use crate::role::{PerVehicle, Role};

use super::process::{self, End, Said};
use bench::Bench;
use kind::Table;
pub(in crate::cli) use kind::{Kind, Options};
use server::Socket;

/// After being asked to stop, a host has this much more than it takes to give a device up.
const STOPS_LATE: Duration = Duration::from_secs(2);

/// One vehicle's.
struct Aboard {
    file: PathBuf,
    /// Until it is served.
    sockets: Option<(Socket, Option<UdpSocket>, Table)>,
    bench: Option<Arc<Bench>>,
    child: Child,
    /// As it was seen to end, unasked.
    end: Option<End>,
    stopped: bool,
    /// Changes of its device's that the world was told of.
    told: usize,
}

/// See the module.
pub(super) struct Radios {
    options: Options,
    aboard: PerVehicle<Aboard>,
}

/// What became of them, for the flight's document.
#[derive(Debug, Clone, Serialize)]
pub(in crate::cli) struct RadiosDocument {
    kind: String,
    /// As the device does, and not as its host declares.
    off_ms: f64,
    change_ms: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    dead_ms: Option<f64>,
    /// What the devices radiated.
    devices: Devices,
}

/// Each device's changes.
#[derive(Debug, Clone, Serialize)]
struct Devices {
    i: Vec<Change>,
    j: Vec<Change>,
}

/// From then on it radiates so much; nothing: off.
#[derive(Debug, Clone, Copy, Serialize)]
struct Change {
    at_s: f64,
    dbm: Option<f64>,
}

impl Radios {
    /// Opens the devices' servers, writes the radio files and starts the hosts. `powers_w`: the plan's, for each vehicle;
    /// `companions`: where each host finds its companion.
    ///
    /// # Errors
    /// A device that cannot give the plan's powers, sockets, files or processes that cannot be had; in words.
    pub async fn start(
        options: Options,
        powers_w: &PerVehicle<Vec<f64>>,
        companions: PerVehicle<u16>,
        directory: &Path,
        said: &mpsc::UnboundedSender<(Role, Said)>,
    ) -> Result<Self, String> {
        let one = async |role: Role| -> Result<Aboard, String> {
            let table = Table::covering(options.kind, &powers_w[role])?;
            let (socket, device) = Socket::open(options.kind.speech()).await?;
            let mut beside = Beside::default();
            if options.kind == Kind::Interface {
                beside.programs = Some(file::write_programs(directory, role, &device)?);
            }
            let mut line = None;
            if options.model().line.is_some() {
                let failed = |error: std::io::Error| format!("loopback: {error}");
                let socket = UdpSocket::bind(("127.0.0.1", 0)).await.map_err(failed)?;
                beside.line = Some(socket.local_addr().map_err(failed)?);
                line = Some(socket);
            }
            let places = file::Places { companion: companions[role], device };
            let file = file::write(directory, role, &options, &table, &places)?;
            let child = spawn(role, &file, &beside, directory, said)?;
            let sockets = Some((socket, line, table));
            Ok(Aboard { file, sockets, bench: None, child, end: None, stopped: false, told: 0 })
        };
        Ok(Self { options, aboard: PerVehicle { i: one(Role::I).await?, j: one(Role::J).await? } })
    }

    /// Begins to serve, by the flight's clock: hosts that have called already wait.
    pub fn serve(&mut self, clock: &Clock) {
        for role in Role::BOTH {
            let aboard = &mut self.aboard[role];
            let Some((socket, line, table)) = aboard.sockets.take() else { continue };
            let device = SimulatedDevice::new(self.options.model());
            let bench = Bench::new(self.options.kind, table, device, clock.clone());
            tokio::spawn(server::serve(socket, Arc::clone(&bench)));
            if let Some(line) = line {
                tokio::spawn(server::serve_line(line, Arc::clone(&bench)));
            }
            aboard.bench = Some(bench);
        }
    }

    /// What befalls a host or its device begins (`on`), or is over.
    pub fn befall(&mut self, fault: RadioFault, role: Role, on: bool) {
        let aboard = &mut self.aboard[role];
        let Some(bench) = &aboard.bench else { return };
        match fault {
            RadioFault::HostKill if on => {
                aboard.signal(Signal::KILL);
                bench.lose_host(true);
            }
            RadioFault::HostStop => {
                aboard.stopped = on;
                aboard.signal(if on { Signal::STOP } else { Signal::CONT });
                if aboard.end.is_none() {
                    bench.lose_host(on);
                }
            }
            other => bench.befall(other, on),
        }
    }

    /// Hosts that have ended since, unasked.
    pub fn ended(&mut self) -> Vec<(Role, End)> {
        let mut ended = Vec::new();
        for role in Role::BOTH {
            let aboard = &mut self.aboard[role];
            if aboard.end.is_some() {
                continue;
            }
            if let Ok(Some(status)) = aboard.child.try_wait() {
                let end = End::new(status, false);
                aboard.end = Some(end);
                if let Some(bench) = &aboard.bench {
                    bench.lose_host(true);
                }
                ended.push((role, end));
            }
        }
        ended
    }

    /// What the devices have done since this was last asked, in the order of their times.
    pub fn changes(&mut self) -> Vec<(Duration, Role, Option<f64>)> {
        let mut changes = Vec::new();
        for role in Role::BOTH {
            let aboard = &mut self.aboard[role];
            let Some(bench) = &aboard.bench else { continue };
            let new = bench.look(|device| device.radiated()[aboard.told..].to_vec());
            aboard.told += new.len();
            changes.extend(new.into_iter().map(|(at, dbm)| (at, role, dbm)));
        }
        changes.sort_by_key(|(at, ..)| *at);
        changes
    }

    /// Whether a device has done nothing since [`Self::changes`] was last asked.
    pub fn is_told(&self, role: Role) -> bool {
        let aboard = &self.aboard[role];
        aboard.bench.as_ref().is_none_or(|bench| bench.look(|device| device.radiated().len() == aboard.told))
    }

    /// Whether what a device does is nobody's order.
    pub fn is_astray(&self, role: Role, now: Duration) -> bool {
        self.aboard[role].bench.as_ref().is_some_and(|bench| bench.look(|device| device.is_astray(now)))
    }

    /// For the flight's document.
    pub fn document(&self) -> RadiosDocument {
        let of = |role: Role| {
            let radiated = |device: &SimulatedDevice| device.radiated().to_vec();
            let radiated = self.aboard[role].bench.as_ref().map(|bench| bench.look(radiated));
            let change = |(at, dbm): (Duration, _)| Change { at_s: at.as_secs_f64(), dbm };
            radiated.unwrap_or_default().into_iter().map(change).collect()
        };
        let model = self.options.model();
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        RadiosDocument {
            kind: self.options.kind.name(),
            off_ms: ms(model.line.filter(|line| line.alone).map_or(model.off, |line| line.holds)),
            change_ms: ms(model.change),
            dead_ms: model.declared_dead().map(ms),
            devices: Devices { i: of(Role::I), j: of(Role::J) },
        }
    }

    /// Asks the hosts to end, in order, and sees that they do.
    pub async fn stop(&mut self, clock: &Clock) {
        for role in Role::BOTH {
            let aboard = &mut self.aboard[role];
            if aboard.end.is_some() {
                continue;
            }
            let dead = aboard.bench.as_ref().is_none_or(|bench| {
                bench.mend();
                bench.look(SimulatedDevice::is_dead)
            });
            aboard.signal(Signal::CONT);
            // One whose device is dead would try for seconds to turn it off.
            aboard.signal(if dead { Signal::KILL } else { Signal::TERM });
        }
        let give_up_at = clock.now() + STOP_WITHIN + STOPS_LATE;
        for role in Role::BOTH {
            let aboard = &mut self.aboard[role];
            let ended = tokio::select! {
                _ = aboard.child.wait() => true,
                () = clock.sleep_until(give_up_at) => false,
            };
            if !ended {
                progress(&format!("{role}  {}: the radio host does not end: killed", aboard.file.display()));
                // What is killed ends.
                let _ = aboard.child.kill().await;
            }
        }
    }
}

impl Aboard {
    fn signal(&self, signal: Signal) {
        let pid = self.child.id().and_then(|id| Pid::from_raw(i32::try_from(id).ok()?));
        if let Some(pid) = pid {
            // It may have ended in the meantime.
            let _ = kill_process(pid, signal);
        }
    }
}

/// What a host needs beside its file.
#[derive(Debug, Default)]
struct Beside {
    /// Programs that are found before the machine's own.
    programs: Option<PathBuf>,
    /// What stands for its kill line.
    line: Option<SocketAddr>,
}

/// Starts a radio host; its log goes to a file in the directory, and what the operator should see of it to `said`.
fn spawn(
    role: Role,
    file: &Path,
    beside: &Beside,
    directory: &Path,
    said: &mpsc::UnboundedSender<(Role, Said)>,
) -> Result<Child, String> {
    let program =
        std::env::current_exe().map_err(|error| format!("this program cannot find itself: {error}"))?;
    let mut command = Command::new(program);
    if let Some(place) = &beside.programs {
        let found = std::env::var_os("PATH").unwrap_or_default();
        let places = [place.clone()].into_iter().chain(std::env::split_paths(&found));
        let path = std::env::join_paths(places).map_err(|error| format!("{}: {error}", place.display()))?;
        command.env("PATH", path);
    }
    // It ends with this process, even if that is killed.
    command.args(["--log-format", "json", "radio", "--until-stdin-ends"]);
    if let Some(line) = beside.line {
        command.arg("--simulated-line").arg(line.to_string());
    }
    let log = directory.join(format!("radio-{}.log", role.key()));
    process::spawn(command.arg(file), "radio host", role, &log, said)
}
