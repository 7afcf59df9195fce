//! Runs a simulated flight: the world in step with the clock, two companion processes, and the datagrams between
//! them. Each companion reaches its vehicle and its peer through a socket of this process, so that faults can cut
//! either.

use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;
use veilwing_sitl::{self as sim, World};

use crate::cli::progress;
use crate::config::{HostPort, Mission};
use crate::link::clock::Clock;
use crate::report::flight::{Event, EventKind, Severity};
use crate::role::{PerVehicle, Role};
use crate::simulation::{Excused, Fault, Late, Schedule, index, judge};

use super::faults::Restart;
use super::files::write_vehicle;
use super::ground::{GROUND_LINK, GroundStation};
use super::port::Port;
use super::process::{Companion, End, Line, Spawning, describe_end, spawn_companion};

/// The world advances in steps of this much wall time.
const STEP: Duration = Duration::from_millis(2);
/// A step that is later than this, in flight time, makes vehicles late to each other: less than what silences I.
const LATE: Duration = Duration::from_millis(20);
/// Progress lines without news come this often, in flight time.
const PROGRESS_EVERY: Duration = Duration::from_secs(10);
/// A companion whose peer has ended may take this much longer (flight time) before it is asked to stop ...
const LAST_ONE: Duration = Duration::from_secs(300);
/// ... and this much if its vehicle neither obeys it nor lands: it has nothing left to do.
const LAST_ONE_IDLE: Duration = Duration::from_secs(15);
/// The timeline has a record this often, and at each change.
const RECORD_EVERY: Duration = Duration::from_millis(50);
/// After being asked to stop, a companion has this much wall time.
const STOP_WITHIN: Duration = Duration::from_secs(5);

/// What a flight needs.
pub(super) struct Setup<'a> {
    pub mission: &'a Path,
    pub world: World,
    pub faults: Vec<Fault>,
    /// A flight takes no longer than this (flight time); for faults that leave a vehicle hanging.
    pub longest: Duration,
    /// What degraded links draw from.
    pub seed: u64,
    pub speed: f64,
    pub directory: &'a Path,
    /// Ports at which the companions find each other, instead of this process's own.
    pub pair_relay: Option<PerVehicle<u16>>,
    /// What the mission file says.
    pub settings: &'a Mission,
    pub ground_station: Option<&'a HostPort>,
    /// Begin without waiting for MISSION_START.
    pub start: bool,
}

impl Setup<'_> {
    fn spawning(&self) -> Spawning<'_> {
        let Self { mission, directory, speed, start, .. } = *self;
        Spawning { mission, directory, speed, start }
    }
}

/// A flight that is over.
pub(super) struct Flight {
    /// Its violations are those that count.
    pub report: sim::FlightReport,
    /// Violations that are nobody's aboard.
    pub excused: Vec<Excused>,
    /// Steps in which the world fell behind its clock.
    pub late: Vec<Late>,
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

/// A flight under way.
pub(super) struct Host<'a> {
    pub setup: Setup<'a>,
    clock: Clock,
    wall: Clock,
    pub autopilot: PerVehicle<Port>,
    pub pair: PerVehicle<Port>,
    ground: Option<GroundStation>,
    pub companions: PerVehicle<Companion>,
    vehicle_files: PerVehicle<PathBuf>,
    lines: mpsc::UnboundedSender<(Role, Line)>,
    pub schedule: Schedule,
    /// Faults that have begun.
    pub happened: Vec<(Duration, Fault)>,
    /// What the world was last told of the companions.
    pub told: PerVehicle<sim::Circumstances>,
    /// How often each companion has been started again.
    pub lives: PerVehicle<u32>,
    late: Vec<Late>,
    pub restarts: PerVehicle<Option<Restart>>,
    first_end: Option<Duration>,
    interrupted: bool,
    next_progress: Duration,
    recorder: sim::Recorder,
    pub events: Vec<Event>,
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
    let seed = setup.seed;
    let autopilot = PerVehicle { i: Port::bind(seed, 0).await?, j: Port::bind(seed, 1).await? };
    let pair = PerVehicle { i: Port::bind(seed, 2).await?, j: Port::bind(seed, 3).await? };
    let (lines, mut log) = mpsc::unbounded_channel();
    let write = |role: Role| {
        let pair_port = match &setup.pair_relay {
            Some(ports) => ports[role],
            None => pair[role].number()?,
        };
        let ports = [autopilot[role].number()?, pair_port];
        write_vehicle(setup.directory, setup.settings, role, ports)
    };
    let vehicle_files = PerVehicle { i: write(Role::I)?, j: write(Role::J)? };
    let spawn = |role: Role| spawn_companion(&setup.spawning(), role, &vehicle_files[role], &lines);
    let companions = PerVehicle { i: spawn(Role::I)?, j: spawn(Role::J)? };
    let clock = Clock::start(setup.speed).map_err(|error| error.to_string())?;
    let schedule = Schedule::new(setup.faults.clone());
    let mut host = Host {
        setup,
        clock,
        wall: Clock::real(),
        autopilot,
        pair,
        ground,
        companions,
        vehicle_files,
        lines,
        schedule,
        happened: Vec::new(),
        told: PerVehicle::default(),
        lives: PerVehicle::default(),
        late: Vec::new(),
        restarts: PerVehicle::default(),
        first_end: None,
        interrupted: false,
        next_progress: PROGRESS_EVERY,
        recorder: sim::Recorder::new(RECORD_EVERY),
        events: Vec::new(),
    };
    let mut step = tokio::time::interval(STEP);
    step.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut interrupt = std::pin::pin!(crate::cli::interrupt::requested());
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
    // The companions' last words: to the end of what they said, now that no other will be started.
    host.lines = mpsc::unbounded_channel().0;
    while let Some((role, line)) = log.recv().await {
        host.hear(role, line);
    }
    host.settle();
    Ok(host.finish())
}

impl Host<'_> {
    /// One step: faults that are due, datagrams in, the world forward, datagrams out.
    fn advance(&mut self) {
        self.change_faults();
        self.tell_world();
        let now = self.setup.world.now();
        for role in Role::BOTH {
            self.autopilot[role].listen(now);
            while let Some(bytes) = self.autopilot[role].receive(now) {
                self.setup.world.handle(index(role), 0, &bytes);
            }
            self.pair[role].listen(now);
            while let Some(bytes) = self.pair[role].receive(now) {
                self.pair[role.peer()].send(&bytes, now);
            }
        }
        let mut buffer = [0; 2048];
        while let Some(bytes) = self.ground.as_ref().and_then(|ground| ground.receive(&mut buffer)) {
            Role::BOTH.into_iter().for_each(|role| self.setup.world.handle(index(role), GROUND_LINK, bytes));
        }
        // What a fault or a command has just changed keeps its own instant.
        self.recorder.observe(&self.setup.world);
        let to = self.clock.now().since_start();
        self.note_lateness(now, to);
        self.setup.world.advance(to);
        self.recorder.observe(&self.setup.world);
        while let Some((vehicle, link, frame)) = self.setup.world.poll_transmit() {
            if let (GROUND_LINK, Some(ground)) = (link, &self.ground) {
                ground.send(&frame);
                continue;
            }
            self.autopilot[Role::BOTH[vehicle]].send(&frame, self.setup.world.now());
        }
        let now = self.setup.world.now();
        for role in Role::BOTH {
            self.autopilot[role].deliver(now);
            self.pair[role].deliver(now);
        }
        self.watch_companions();
        self.note_progress();
    }

    /// A step that makes up for more than its own length was late: nobody was told anything meanwhile.
    fn note_lateness(&mut self, from: Duration, to: Duration) {
        let by = to.saturating_sub(from).saturating_sub(STEP.mul_f64(self.setup.speed));
        if by > LATE {
            self.late.push(Late { from, by });
        }
    }

    /// Lets leases run out and the last measurements come in after both companions have ended.
    fn settle(&mut self) {
        let end = self.setup.world.now() + Duration::from_secs(1);
        self.setup.world.advance(end);
        self.recorder.observe(&self.setup.world);
        while self.setup.world.poll_transmit().is_some() {}
    }

    fn finish(self) -> Flight {
        let ports = || Role::BOTH.into_iter().flat_map(|role| [&self.autopilot[role], &self.pair[role]]);
        let (sent, swallowed) =
            (ports().map(|port| port.sent).sum(), ports().map(|port| port.swallowed).sum());
        let received = Role::BOTH.map(|role| self.autopilot[role].received).iter().sum();
        let mut report = self.setup.world.report();
        let (violations, excused) = judge(std::mem::take(&mut report.violations), &self.happened, &self.late);
        report.violations = violations;
        Flight {
            report,
            excused,
            late: self.late,
            records: self.recorder.finish(),
            events: self.events,
            ends: self.companions.map(|companion| companion.end),
            interrupted: self.interrupted,
            sent,
            received,
            swallowed,
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
                if self.restart(role) {
                    continue;
                }
                let companion = &mut self.companions[role];
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
            if self.first_end.is_some_and(|at| now > at + patience) || now > self.setup.longest {
                self.ask_to_stop(role);
            }
        }
    }

    /// Starts a companion once more; the telemetry logs of its earlier life are kept beside the new ones.
    pub(super) fn spawn_again(&self, role: Role) -> Result<Companion, String> {
        let name = role.to_string().to_lowercase();
        for link in ["autopilot", "pair"] {
            let log = |suffix: &str| self.setup.directory.join(format!("{name}-{link}{suffix}.tlog"));
            let earlier = (1..).map(|life| log(&format!(".{life}"))).find(|path| !path.exists());
            if let Some(earlier) = earlier {
                // Without it the new log takes the old one's place: that costs the log, not the flight.
                let _ = std::fs::rename(log(""), earlier);
            }
        }
        spawn_companion(&self.setup.spawning(), role, &self.vehicle_files[role], &self.lines)
    }

    fn ask_to_stop(&mut self, role: Role) {
        let now = self.wall.now();
        let companion = &mut self.companions[role];
        if companion.end.is_none() && companion.asked_to_stop.is_none() {
            companion.asked_to_stop = Some(now);
            self.restarts[role] = None;
            self.signal(role, rustix::process::Signal::TERM);
            self.signal(role, rustix::process::Signal::CONT);
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

    pub(super) fn note(&mut self, kind: EventKind, vehicle: Option<Role>, severity: Severity, text: String) {
        let at_s = self.setup.world.now().as_secs_f64();
        self.events.push(Event { at_s, kind, vehicle, severity, phase: None, code: None, text });
    }

    pub(super) fn say(&self, text: &str) {
        progress(&format!("[{:7.1} s] {text}", self.setup.world.now().as_secs_f64()));
    }
}
