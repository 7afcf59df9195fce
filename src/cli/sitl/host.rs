//! Runs a simulated flight: the world in step with the clock, two companion processes, and the datagrams between
//! them. Each companion reaches its vehicle and its peer through a socket of this process, so that faults can cut
//! either.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;
use veilwing_sitl::{self as sim, World};

use crate::config::HostPort;
use crate::link::clock::Clock;
use crate::report::flight::{Event, EventKind, Severity};
use crate::role::{PerVehicle, Role};
use crate::simulation::index;

use super::faults::{Fault, Faults, Kind};
use super::files::write_vehicle;
use super::ground::{GROUND_LINK, GroundStation};
use super::process::{Companion, End, Line, describe_end, spawn_companion};

/// The world advances in steps of this much wall time.
const STEP: Duration = Duration::from_millis(2);
/// Progress lines without news come this often, in flight time.
const PROGRESS_EVERY: Duration = Duration::from_secs(10);
/// A companion whose peer has ended may take this much longer (flight time) before it is asked to stop ...
const LAST_ONE: Duration = Duration::from_secs(300);
/// ... and this much if its vehicle neither obeys it nor lands: it has nothing left to do.
const LAST_ONE_IDLE: Duration = Duration::from_secs(15);
/// The timeline has a record this often, and at each change.
const RECORD_EVERY: Duration = Duration::from_millis(50);
/// A flight takes no longer than this (flight time); for faults that leave a vehicle hanging.
const LONGEST: Duration = Duration::from_secs(4 * 3600);
/// After being asked to stop, a companion has this much wall time.
const STOP_WITHIN: Duration = Duration::from_secs(5);

/// What a flight needs.
pub(super) struct Setup<'a> {
    pub mission: &'a Path,
    pub world: World,
    pub faults: Faults,
    pub speed: f64,
    pub directory: &'a Path,
    /// Ports at which the companions find each other, instead of this process's own.
    pub pair_relay: Option<PerVehicle<u16>>,
    pub actuation: PerVehicle<&'static str>,
    pub ground_station: Option<&'a HostPort>,
    /// Begin without waiting for MISSION_START.
    pub start: bool,
}

/// A flight that is over.
pub(super) struct Flight {
    pub report: sim::FlightReport,
    /// As it was left.
    pub world: World,
    pub records: Vec<sim::Record>,
    pub events: Vec<Event>,
    pub ends: PerVehicle<Option<End>>,
    pub interrupted: bool,
    /// Datagrams that companions sent to their vehicle or to each other.
    pub sent: u64,
    /// Frames that companions were sent by their vehicles.
    pub received: u64,
    /// Datagrams that a fault swallowed.
    pub swallowed: u64,
}

/// One socket of ours and the companion that was heard on it.
struct Port {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    open: bool,
}

impl Port {
    async fn bind() -> Result<Self, String> {
        let socket =
            UdpSocket::bind(("127.0.0.1", 0)).await.map_err(|error| format!("loopback UDP: {error}"))?;
        Ok(Self { socket, peer: None, open: true })
    }

    fn number(&self) -> Result<u16, String> {
        self.socket
            .local_addr()
            .map(|address| address.port())
            .map_err(|error| format!("loopback UDP: {error}"))
    }

    /// The next datagram of the companion, if one is there.
    fn receive<'b>(&mut self, buffer: &'b mut [u8]) -> Option<&'b [u8]> {
        let (length, from) = self.socket.try_recv_from(buffer).ok()?;
        self.peer = Some(from);
        Some(&buffer[..length])
    }

    fn send(&self, bytes: &[u8]) {
        if let Some(peer) = self.peer {
            // A full buffer or a companion that is gone: lost, as on any radio link.
            let _ = self.socket.try_send_to(bytes, peer);
        }
    }
}

struct Host<'a> {
    setup: Setup<'a>,
    clock: Clock,
    wall: Clock,
    autopilot: PerVehicle<Port>,
    pair: PerVehicle<Port>,
    ground: Option<GroundStation>,
    companions: PerVehicle<Companion>,
    pending: Vec<Fault>,
    running: Vec<(Fault, Duration)>,
    first_radiated: Vec<(i32, Duration)>,
    first_end: Option<Duration>,
    interrupted: bool,
    sent: u64,
    received: u64,
    swallowed: u64,
    next_progress: Duration,
    recorder: sim::Recorder,
    events: Vec<Event>,
}

/// Flies until both companions have ended.
pub(super) async fn fly(mut setup: Setup<'_>) -> Result<Flight, String> {
    let ground = match setup.ground_station {
        Some(address) => Some(GroundStation::connect(address).await?),
        None => None,
    };
    if ground.is_some() {
        Role::BOTH.into_iter().for_each(|role| setup.world.open_link(index(role), GROUND_LINK));
    }
    let autopilot = PerVehicle { i: Port::bind().await?, j: Port::bind().await? };
    let pair = PerVehicle { i: Port::bind().await?, j: Port::bind().await? };
    let (lines, mut log) = mpsc::unbounded_channel();
    let spawn = |role: Role| {
        let pair_port = match &setup.pair_relay {
            Some(ports) => ports[role],
            None => pair[role].number()?,
        };
        let vehicle = write_vehicle(
            setup.directory,
            role,
            autopilot[role].number()?,
            pair_port,
            setup.actuation[role],
        )?;
        let start = setup.start.then_some("--start");
        spawn_companion(setup.mission, setup.directory, setup.speed, start, role, &vehicle, &lines)
    };
    let companions = PerVehicle { i: spawn(Role::I)?, j: spawn(Role::J)? };
    let clock = Clock::start(setup.speed).map_err(|error| error.to_string())?;
    let pending = setup.faults.faults.clone();
    let mut host = Host {
        setup,
        clock,
        wall: Clock::real(),
        autopilot,
        pair,
        ground,
        companions,
        pending,
        running: Vec::new(),
        first_radiated: Vec::new(),
        first_end: None,
        interrupted: false,
        sent: 0,
        received: 0,
        swallowed: 0,
        next_progress: PROGRESS_EVERY,
        recorder: sim::Recorder::new(RECORD_EVERY),
        events: Vec::new(),
    };
    let mut step = tokio::time::interval(STEP);
    step.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut interrupt = std::pin::pin!(crate::cli::fly::stop_signal());
    while !host.is_over() {
        tokio::select! {
            _ = step.tick() => host.advance(),
            Some((role, line)) = log.recv() => host.hear(role, line),
            () = &mut interrupt, if !host.interrupted => {
                host.say("interrupted: both companions are asked to stop");
                host.interrupted = true;
                Role::BOTH.into_iter().for_each(|role| host.ask_to_stop(role));
            }
        }
    }
    while let Ok((role, line)) = log.try_recv() {
        host.hear(role, line);
    }
    host.settle();
    Ok(host.finish())
}

impl Host<'_> {
    /// One step: faults that are due, datagrams in, the world forward, datagrams out.
    fn advance(&mut self) {
        self.inject_faults();
        let mut buffer = [0; 2048];
        for role in Role::BOTH {
            while let Some(bytes) = self.autopilot[role].receive(&mut buffer) {
                if self.autopilot[role].open {
                    self.sent += 1;
                    self.setup.world.handle(index(role), 0, bytes);
                } else {
                    self.swallowed += 1;
                }
            }
            while let Some(bytes) = self.pair[role].receive(&mut buffer) {
                if self.pair[role].open {
                    self.sent += 1;
                    self.pair[role.peer()].send(bytes);
                } else {
                    self.swallowed += 1;
                }
            }
        }
        while let Some(bytes) = self.ground.as_ref().and_then(|ground| ground.receive(&mut buffer)) {
            Role::BOTH.into_iter().for_each(|role| self.setup.world.handle(index(role), GROUND_LINK, bytes));
        }
        // What a fault or a command has just changed keeps its own instant.
        self.recorder.observe(&self.setup.world);
        self.setup.world.advance(self.clock.now().since_start());
        self.recorder.observe(&self.setup.world);
        while let Some((vehicle, link, frame)) = self.setup.world.poll_transmit() {
            if let (GROUND_LINK, Some(ground)) = (link, &self.ground) {
                ground.send(&frame);
                continue;
            }
            let port = &self.autopilot[if vehicle == 0 { Role::I } else { Role::J }];
            if port.open {
                self.received += 1;
                port.send(&frame);
            } else {
                self.swallowed += 1;
            }
        }
        self.watch_companions();
        self.note_progress();
    }

    /// Lets leases run out and the last measurements come in after both companions have ended.
    fn settle(&mut self) {
        let end = self.setup.world.now() + Duration::from_secs(1);
        self.setup.world.advance(end);
        self.recorder.observe(&self.setup.world);
        while self.setup.world.poll_transmit().is_some() {}
    }

    fn finish(self) -> Flight {
        Flight {
            report: self.setup.world.report(),
            records: self.recorder.finish(),
            events: self.events,
            ends: self.companions.map(|companion| companion.end),
            interrupted: self.interrupted,
            sent: self.sent,
            received: self.received,
            swallowed: self.swallowed,
            world: self.setup.world,
        }
    }

    fn is_over(&self) -> bool {
        Role::BOTH.into_iter().all(|role| self.companions[role].end.is_some())
    }

    fn watch_companions(&mut self) {
        let now = self.setup.world.now();
        for role in Role::BOTH {
            let companion = &mut self.companions[role];
            if companion.end.is_some() {
                continue;
            }
            if let Ok(Some(status)) = companion.child.try_wait() {
                use std::os::unix::process::ExitStatusExt;
                let end = match (companion.asked_to_stop, status.code(), status.signal()) {
                    (Some(_), ..) => End::Stopped,
                    (None, Some(code), _) => End::Code(code),
                    (None, None, signal) => End::Signal(signal.unwrap_or_default()),
                };
                companion.end = Some(end);
                if end != End::Code(0) {
                    self.setup.world.inject(sim::Fault::CompanionLost { vehicle: index(role) });
                }
                self.first_end.get_or_insert(now);
                let severity = if end == End::Code(0) { Severity::Info } else { Severity::Warning };
                let text = format!("companion {}", describe_end(end));
                self.say(&format!("{role}  {text}"));
                self.note(EventKind::Process, Some(role), severity, text);
            } else if companion.asked_to_stop.is_some_and(|at| self.wall.now() > at + STOP_WITHIN) {
                // It does not listen: end it. Its transmitter falls silent by itself.
                let _ = companion.child.start_kill();
            }
        }
        let snapshot = self.setup.world.snapshot();
        for role in Role::BOTH {
            let vehicle = &snapshot.vehicles[index(role)];
            let coming_down = ["LAND", "RTL"].iter().any(|mode| vehicle.mode.contains(mode));
            let patience = if vehicle.companion_controlled || coming_down { LAST_ONE } else { LAST_ONE_IDLE };
            if self.first_end.is_some_and(|at| now > at + patience) || now > LONGEST {
                self.ask_to_stop(role);
            }
        }
    }

    fn ask_to_stop(&mut self, role: Role) {
        let now = self.wall.now();
        let companion = &mut self.companions[role];
        if companion.end.is_none() && companion.asked_to_stop.is_none() {
            companion.asked_to_stop = Some(now);
            self.signal(role, rustix::process::Signal::TERM);
            self.signal(role, rustix::process::Signal::CONT);
        }
    }

    fn signal(&self, role: Role, signal: rustix::process::Signal) {
        let pid = self.companions[role].child.id().and_then(|id| i32::try_from(id).ok());
        if let Some(pid) = pid.and_then(rustix::process::Pid::from_raw) {
            // It may have ended in the meantime.
            let _ = rustix::process::kill_process(pid, signal);
        }
    }

    fn inject_faults(&mut self) {
        let now = self.setup.world.now();
        let snapshot = self.setup.world.snapshot();
        let vehicle_i = &snapshot.vehicles[0];
        if let Some(slot) = vehicle_i.slot.filter(|_| vehicle_i.tx_power_w.is_some())
            && !self.first_radiated.iter().any(|(known, _)| *known == slot)
        {
            self.first_radiated.push((slot, now));
        }
        let radiated = &self.first_radiated;
        let is_due = |fault: &Fault| {
            let zero = match fault.slot {
                None => Some(Duration::ZERO),
                Some(slot) => radiated.iter().find(|(known, _)| *known == i32::from(slot)).map(|(_, at)| *at),
            };
            zero.is_some_and(|zero| now >= zero + Duration::from_secs_f64(fault.after_s))
        };
        let due: Vec<Fault> = self.pending.extract_if(.., |fault| is_due(fault)).collect();
        for fault in due {
            self.say(&fault.describe());
            self.note_fault(EventKind::Fault, &fault);
            self.apply(&fault, true);
            self.running.push((fault, now));
        }
        let ends = |(fault, since): &(Fault, Duration)| {
            fault.duration_s.is_some_and(|lasts| now >= *since + Duration::from_secs_f64(lasts))
        };
        let over: Vec<_> = self.running.extract_if(.., |running| ends(running)).collect();
        for (fault, _) in over {
            self.say(&format!("{} is over", fault.describe()));
            self.note_fault(EventKind::FaultOver, &fault);
            self.apply(&fault, false);
        }
    }

    fn apply(&mut self, fault: &Fault, on: bool) {
        use rustix::process::Signal;
        let roles = fault.vehicle.map_or(Role::BOTH.to_vec(), |role| vec![role]);
        for role in roles {
            let vehicle = index(role);
            match fault.kind {
                Kind::CompanionKill if on => self.signal(role, Signal::KILL),
                Kind::CompanionKill => {}
                Kind::CompanionStop => self.signal(role, if on { Signal::STOP } else { Signal::CONT }),
                Kind::LinkLoss => {
                    self.autopilot[role].open = !on;
                    self.setup.world.inject(sim::Fault::LinkLoss { vehicle, on });
                }
                Kind::PairLoss => self.pair[role].open = !on,
                Kind::PilotMode if on => self.setup.world.inject(sim::Fault::PilotMode { vehicle }),
                Kind::PilotMode => {}
                Kind::EstimatorFailure if on => {
                    self.setup.world.inject(sim::Fault::EstimatorFailure { vehicle })
                }
                Kind::EstimatorFailure => {}
            }
        }
    }

    fn note_progress(&mut self) {
        let now = self.setup.world.now();
        if now < self.next_progress {
            return;
        }
        self.next_progress = now + PROGRESS_EVERY;
        let snapshot = self.setup.world.snapshot();
        let vehicles: Vec<String> = Role::BOTH
            .into_iter()
            .map(|role| {
                let v = &snapshot.vehicles[index(role)];
                let [e, n, u] = v.position_enu_m;
                let power = crate::units::Watts(v.tx_power_w.unwrap_or(0.0));
                format!("{role} {} ({e:.0}, {n:.0}, {u:.0}) m, {power}", v.mode)
            })
            .collect();
        self.say(&vehicles.join("; "));
    }

    /// A line of a companion's log.
    fn hear(&mut self, role: Role, line: Line) {
        self.say(&format!("{role}  {line}"));
        self.note(EventKind::Notice, Some(role), line.severity, line.text);
        if let Some(event) = self.events.last_mut().filter(|_| !line.phase.is_empty()) {
            event.phase = Some(line.phase);
        }
    }

    fn note_fault(&mut self, kind: EventKind, fault: &Fault) {
        self.note(kind, fault.vehicle, Severity::Warning, fault.what());
        if let Some(event) = self.events.last_mut() {
            event.code = Some(fault.kind.name());
        }
    }

    fn note(&mut self, kind: EventKind, vehicle: Option<Role>, severity: Severity, text: String) {
        let at_s = self.setup.world.now().as_secs_f64();
        self.events.push(Event { at_s, kind, vehicle, severity, phase: None, code: None, text });
    }

    fn say(&self, text: &str) {
        eprintln!("[{:7.1} s] {text}", self.setup.world.now().as_secs_f64());
    }
}
