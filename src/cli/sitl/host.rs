//! Runs a simulated flight: the world in step with the clock, two companion processes, and the datagrams between
//! them. Each companion reaches its vehicle and its peer through a socket of this process, so that faults can cut
//! either.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::process::Signal;
use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;
use veilwing_sitl::{self as sim, World};

use crate::cli::progress;
use crate::config::Mission;
use crate::desk::report::{Event, EventKind, Severity};
use crate::desk::simulation::{self, Change, Excused, Fault, FaultKind, Late, Supervisor, index, judge};
use crate::link::HostPort;
use crate::link::clock::Clock;
use crate::role::{PerVehicle, Role};

use super::files::write_vehicle;
use super::links::{Links, Traffic};
use super::process::{Companion, End, Line, Spawning, describe_end, spawn_companion};

/// The world advances in steps of this much wall time.
const STEP: Duration = Duration::from_millis(2);
/// A step that is later than this, in flight time, makes vehicles late to each other: less than what silences I.
const LATE: Duration = Duration::from_millis(20);
/// What this machine takes to carry a datagram, in flight time.
const WIRE: Duration = Duration::from_millis(20);
/// Somebody else's relay is taken to hold a datagram up for no longer.
const RELAY: Duration = Duration::from_millis(400);
/// Progress lines without news come this often, in flight time.
const PROGRESS_EVERY: Duration = Duration::from_secs(10);
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
    pub traffic: Traffic,
}

/// A flight under way.
struct Host<'a> {
    setup: Setup<'a>,
    clock: Clock,
    links: Links,
    companions: PerVehicle<Companion>,
    vehicle_files: PerVehicle<PathBuf>,
    lines: mpsc::UnboundedSender<(Role, Line)>,
    /// What the world was last told of the companions.
    told: PerVehicle<sim::Circumstances>,
    /// How often each companion has been started again.
    lives: PerVehicle<u32>,
    late: Vec<Late>,
    interrupted: bool,
    next_progress: Duration,
    recorder: sim::Recorder,
    events: Vec<Event>,
}

/// Flies until both companions have ended.
pub(super) async fn fly(mut setup: Setup<'_>) -> Result<Flight, String> {
    let links = Links::open(setup.seed, setup.ground_station, &mut setup.world).await?;
    let (lines, mut log) = mpsc::unbounded_channel();
    let write = |role: Role| {
        let [autopilot, pair] = links.numbers(role)?;
        let pair = setup.pair_relay.as_ref().map_or(pair, |ports| ports[role]);
        write_vehicle(setup.directory, setup.settings, role, [autopilot, pair])
    };
    let vehicle_files = PerVehicle { i: write(Role::I)?, j: write(Role::J)? };
    let spawn = |role: Role| spawn_companion(&setup.spawning(), role, &vehicle_files[role], &lines);
    let companions = PerVehicle { i: spawn(Role::I)?, j: spawn(Role::J)? };
    let clock = Clock::start(setup.speed).map_err(|error| error.to_string())?;
    let mut supervisor = Supervisor::new(setup.faults.clone(), setup.longest);
    let mut host = Host {
        setup,
        clock,
        links,
        companions,
        vehicle_files,
        lines,
        told: PerVehicle::default(),
        lives: PerVehicle::default(),
        late: Vec::new(),
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
            _ = step.tick() => host.advance(&mut supervisor),
            Some((role, line)) = log.recv() => host.hear(role, line),
            () = &mut interrupt, if !host.interrupted => {
                host.say("interrupted: both companions are asked to stop");
                host.interrupted = true;
                Role::BOTH.into_iter().for_each(|role| supervisor.ask_to_stop(role, &mut host));
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
    fn advance(&mut self, supervisor: &mut Supervisor) {
        while let Some(change) = supervisor.due(&self.setup.world) {
            self.note_change(&change);
            supervisor.apply(change, self);
        }
        self.tell_world();
        self.links.listen(&mut self.setup.world);
        // What a fault or a command has just changed keeps its own instant.
        self.recorder.observe(&self.setup.world);
        let to = self.clock.now().since_start();
        self.note_lateness(self.setup.world.now(), to);
        self.setup.world.advance(to);
        self.recorder.observe(&self.setup.world);
        self.links.deliver(&mut self.setup.world);
        Role::BOTH.into_iter().for_each(|role| self.see_end(role, supervisor));
        supervisor.watch(self);
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
        let mut report = self.setup.world.report();
        let excused = judge(&mut report, &self.late);
        Flight {
            report,
            excused,
            late: self.late,
            records: self.recorder.finish(),
            events: self.events,
            ends: self.companions.map(|companion| companion.end),
            interrupted: self.interrupted,
            traffic: self.links.traffic(),
            world: self.setup.world,
        }
    }

    fn is_over(&self) -> bool {
        Role::BOTH.into_iter().all(|role| self.companions[role].end.is_some())
    }

    /// Takes note of the end of a companion process, or starts it again.
    fn see_end(&mut self, role: Role, supervisor: &mut Supervisor) {
        let companion = &mut self.companions[role];
        if companion.end.is_some() {
            return;
        }
        let Ok(Some(status)) = companion.child.try_wait() else { return };
        if supervisor.comes_back(role) {
            if !std::mem::replace(&mut companion.gone, true) {
                self.setup.world.inject(sim::Fault::CompanionLost { vehicle: index(role) });
            }
            if supervisor.start_if_due(role, self) {
                return;
            }
        }
        let end = End::new(status, supervisor.asked_to_stop(role));
        self.companions[role].end = Some(end);
        if end != End::Code(0) {
            self.setup.world.inject(sim::Fault::CompanionLost { vehicle: index(role) });
        }
        let severity = if end == End::Code(0) { Severity::Info } else { Severity::Warning };
        let text = format!("companion {}", describe_end(end));
        self.say(&format!("{role}  {text}"));
        self.note(EventKind::Process, Some(role), severity, text);
    }

    /// Tells the world's monitor how the companions fare, as far as this process knows.
    fn tell_world(&mut self) {
        for role in Role::BOTH {
            let companion = &self.companions[role];
            let [vehicle_way, peer_way] = self.links.longest_ways(role);
            let told = sim::Circumstances {
                runs: companion.lives() && !companion.frozen,
                life: self.lives[role],
                vehicle_link: self.links.vehicle_passage(role),
                from_peer: match self.setup.pair_relay {
                    // What somebody else's relay does to it is not known here.
                    Some(_) => sim::Passage::Impaired,
                    None => self.links.pair_passage(role.peer()),
                },
                vehicle_way: WIRE + vehicle_way,
                // As above.
                peer_way: WIRE + self.setup.pair_relay.map_or(peer_way, |_| RELAY),
            };
            if std::mem::replace(&mut self.told[role], told) != told {
                self.setup.world.set_circumstances(index(role), told);
            }
        }
    }

    /// Starts a companion once more; the telemetry logs of its earlier life are kept beside the new ones.
    fn spawn_again(&self, role: Role) -> Result<Companion, String> {
        let name = role.key();
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

    /// A fault that begins or ends.
    fn note_change(&mut self, change: &Change) {
        let (fault, kind, over) = match change {
            Change::Begins(fault) => (fault, EventKind::Fault, ""),
            Change::Ends(fault) => (fault, EventKind::FaultOver, " is over"),
        };
        self.say(&format!("{}{over}", fault.describe()));
        self.note(kind, fault.vehicle(), Severity::Warning, fault.what());
        if let Some(event) = self.events.last_mut() {
            event.code = Some(fault.kind.name().to_owned());
        }
    }

    fn note(&mut self, kind: EventKind, vehicle: Option<Role>, severity: Severity, text: String) {
        let at_s = self.setup.world.now().as_secs_f64();
        self.events.push(Event { at_s, kind, vehicle, severity, phase: None, code: None, text });
    }

    fn say(&self, text: &str) {
        progress(&format!("[{:7.1} s] {text}", self.setup.world.now().as_secs_f64()));
    }
}

impl simulation::Host for Host<'_> {
    const LINK: &'static [FaultKind] = &[FaultKind::LinkLoss, FaultKind::LinkDegraded, FaultKind::LinkFrozen];

    fn world(&mut self) -> &mut World {
        &mut self.setup.world
    }

    fn lives(&self, role: Role) -> bool {
        self.companions[role].lives()
    }

    fn kill(&mut self, role: Role) {
        self.companions[role].signal(Signal::KILL);
    }

    fn start(&mut self, role: Role) -> bool {
        match self.spawn_again(role) {
            Ok(companion) => {
                self.companions[role] = companion;
                self.lives[role] += 1;
                true
            }
            Err(error) => {
                self.say(&format!("{role}  {error}"));
                false
            }
        }
    }

    fn freeze(&mut self, role: Role, frozen: bool) {
        self.companions[role].frozen = frozen;
        self.companions[role].signal(if frozen { Signal::STOP } else { Signal::CONT });
    }

    fn stop(&mut self, role: Role) {
        self.companions[role].signal(Signal::TERM);
    }

    fn stop_within(&self) -> Duration {
        STOP_WITHIN.mul_f64(self.setup.speed)
    }

    fn fill_disk(&mut self, role: Role, full: bool) {
        if let Err(error) = self.companions[role].fill_disk(full) {
            self.say(&format!("{role}  the disk cannot be made to look full: {error}"));
        }
    }

    fn set_pair_path(&mut self, from: Role, path: Option<simulation::Path>) {
        self.links.set_pair_path(from, path);
    }

    fn set_autopilot_path(&mut self, role: Role, path: Option<simulation::Path>) {
        self.links.set_autopilot_path(role, path);
    }
}
