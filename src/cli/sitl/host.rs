//! Runs a simulated flight: the world, two companion processes, and the datagrams between them. Each companion reaches its
//! vehicle and its peer through a socket of this process, so that faults can cut either. Time is the machine's, by which the
//! world and the companions live each for itself, or the world gives it out (`lockstep`).

use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;
use veilwing_sitl::{self as sim, DevicePower, World};

use crate::config::Mission;
use crate::desk::report::Event;
use crate::desk::simulation::{self, Excused, Fault, FaultKind, Late, RadioFault, Supervisor, index, judge};
use crate::link::HostPort;
use crate::link::clock::Clock;
use crate::role::{PerVehicle, Role};
use crate::time::{Instant, Utc};

use super::files::write_vehicle;
use super::journal::Journal;
use super::links::{Links, RadioEnd, Traffic};
use super::lockstep::{Round, STEP, Step};
use super::process::{Companion, End, Said, Spawning, spawn_companion};
use super::radios::{Options, Radios, RadiosDocument};

/// By the wall's clock, the world advances in steps of this much wall time.
const WALL_STEP: Duration = Duration::from_millis(2);
/// A step that is later than this, in flight time, makes vehicles late to each other: less than what silences I.
const LATE: Duration = Duration::from_millis(20);
/// What this machine takes to carry a datagram, in flight time.
const WIRE: Duration = Duration::from_millis(20);
/// The timeline has a record this often, and at each change.
const RECORD_EVERY: Duration = Duration::from_millis(50);
/// After being asked to stop, a companion has this much wall time, or of the time that it is given out.
const STOP_WITHIN: Duration = Duration::from_secs(5);

/// Whose time it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pace {
    /// Everybody's own, by the machine's clock.
    Wall,
    /// The world's, which the companions are given.
    InStep {
        /// When the flight begins.
        utc_start: Utc,
    },
}

/// What a flight needs.
pub(super) struct Setup<'a> {
    pub mission: &'a Path,
    pub world: World,
    pub faults: Vec<Fault>,
    /// A flight takes no longer than this (flight time); for faults that leave a vehicle hanging.
    pub longest: Duration,
    /// What degraded links draw from.
    pub seed: u64,
    /// Simulated seconds per second of wall time; in step, at most.
    pub speed: f64,
    pub pace: Pace,
    pub directory: &'a Path,
    /// What the mission file says.
    pub settings: &'a Mission,
    /// Each radio has a link of its own.
    pub own_radio_links: bool,
    /// Radio hosts with such devices, and the powers in watts that they must give.
    pub radio_hosts: Option<(Options, PerVehicle<Vec<f64>>)>,
    pub ground_stations: &'a [&'a HostPort],
    /// Begin without waiting for MISSION_START.
    pub start: bool,
}

impl Setup<'_> {
    fn spawning(&self) -> Spawning<'_> {
        let Self { mission, directory, start, .. } = *self;
        Spawning { mission, directory, rate: (self.pace == Pace::Wall).then_some(self.speed), start }
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
    pub radios: Option<RadiosDocument>,
}

/// A flight under way.
struct Host<'a> {
    setup: Setup<'a>,
    clock: Clock,
    links: Links,
    companions: PerVehicle<Companion>,
    radios: Option<Radios>,
    /// What each radio host's device radiates, as the world was told.
    on_air: PerVehicle<Option<f64>>,
    /// As they were when the companions had ended.
    radios_document: Option<RadiosDocument>,
    vehicle_files: PerVehicle<PathBuf>,
    said: mpsc::UnboundedSender<(Role, Said)>,
    /// What the world was last told of the companions.
    told: PerVehicle<sim::Circumstances>,
    /// How often each companion has been started again.
    lives: PerVehicle<u32>,
    late: Vec<Late>,
    interrupted: bool,
    recorder: sim::Recorder,
    journal: Journal,
}

/// Flies until both companions have ended.
///
/// # Errors
/// Sockets, files or processes that cannot be had, or a companion in step that hangs; in words.
pub(super) async fn fly(mut setup: Setup<'_>) -> Result<Flight, String> {
    let radio_end = match (&setup.radio_hosts, setup.own_radio_links) {
        (Some(_), _) => RadioEnd::Hosted,
        (None, true) => RadioEnd::OnItsOwn,
        (None, false) => RadioEnd::BehindAutopilot,
    };
    let links = Links::open(setup.seed, radio_end, setup.ground_stations, &mut setup.world).await?;
    let (said, mut log) = mpsc::unbounded_channel();
    let write = |role: Role| {
        write_vehicle(setup.directory, setup.settings, role, links.numbers(role)?, links.radio_number(role)?)
    };
    let vehicle_files = PerVehicle { i: write(Role::I)?, j: write(Role::J)? };
    let spawn = |role: Role| spawn_companion(&setup.spawning(), role, &vehicle_files[role], &said);
    let mut radios = match &setup.radio_hosts {
        None => None,
        Some((options, powers_w)) => {
            let number = |role| Ok::<u16, String>(links.host_number(role)?.unwrap_or_default());
            let companions = PerVehicle { i: number(Role::I)?, j: number(Role::J)? };
            Some(Radios::start(*options, powers_w, companions, setup.directory, &said).await?)
        }
    };
    let companions = PerVehicle { i: spawn(Role::I)?, j: spawn(Role::J)? };
    let clock = Clock::start(setup.speed).map_err(|error| error.to_string())?;
    if let Some(radios) = &mut radios {
        radios.serve(&clock);
        Role::BOTH
            .into_iter()
            .for_each(|role| setup.world.set_device_power(index(role), DevicePower::default()));
    }
    let mut supervisor = Supervisor::new(setup.faults.clone(), setup.longest);
    let mut host = Host {
        setup,
        clock,
        links,
        companions,
        radios,
        on_air: PerVehicle::default(),
        radios_document: None,
        vehicle_files,
        said,
        told: PerVehicle::default(),
        lives: PerVehicle::default(),
        late: Vec::new(),
        interrupted: false,
        recorder: sim::Recorder::new(RECORD_EVERY),
        journal: Journal::new(),
    };
    match host.setup.pace {
        Pace::Wall => host.live_by_the_wall(&mut supervisor, &mut log).await,
        Pace::InStep { utc_start } => host.live_in_step(utc_start, &mut supervisor, &mut log).await?,
    }
    if let Some(radios) = &mut host.radios {
        host.radios_document = Some(radios.document());
        radios.stop(&host.clock).await;
    }
    // The companions' last words: to the end of what they said, now that no other will be started.
    host.said = mpsc::unbounded_channel().0;
    while let Some((role, said)) = log.recv().await {
        host.hear(role, said);
    }
    host.settle();
    Ok(host.finish())
}

impl Host<'_> {
    /// Everybody lives by the machine's clock, and nobody waits for anybody.
    async fn live_by_the_wall(
        &mut self,
        supervisor: &mut Supervisor,
        log: &mut mpsc::UnboundedReceiver<(Role, Said)>,
    ) {
        let mut step = tokio::time::interval(WALL_STEP);
        step.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut interrupt = std::pin::pin!(crate::cli::interrupt::requested());
        while !self.is_over() {
            tokio::select! {
                _ = step.tick() => {
                    self.befall(supervisor);
                    // What has come in was sent before now.
                    self.links.listen(&mut self.setup.world);
                    let to = self.clock.now().since_start();
                    self.note_lateness(self.setup.world.now(), to);
                    self.advance(to);
                    self.end_step(supervisor);
                }
                Some((role, said)) = log.recv() => self.hear(role, said),
                () = &mut interrupt, if !self.interrupted => self.interrupt(supervisor),
            }
        }
    }

    /// The companions go first, by what they have heard so far; then the world, which hears at the end of a step what they
    /// have said in it. So nobody hears what is yet to be said.
    async fn live_in_step(
        &mut self,
        utc_start: Utc,
        supervisor: &mut Supervisor,
        log: &mut mpsc::UnboundedReceiver<(Role, Said)>,
    ) -> Result<(), String> {
        let mut interrupt = std::pin::pin!(crate::cli::interrupt::requested());
        while !self.is_over() {
            let from = self.setup.world.now();
            let to = from + STEP;
            tokio::select! {
                biased;
                () = &mut interrupt, if !self.interrupted => self.interrupt(supervisor),
                () = self.clock.sleep_until(Instant::from_start(to)) => {}
            }
            self.befall(supervisor);
            let PerVehicle { i, j } = &mut self.companions;
            let round = Round::begin(Step { from, to, utc: utc_start + from }, [i, j]).await;
            let mut lines = Vec::new();
            let flown = round.end(log, |role, line| lines.push((role, line))).await?;
            if let Some(flies) = flown {
                self.setup.world.follow(usize::from(flies.slot), flies.both);
            }
            self.advance(to);
            // By vehicle, and not by who was quicker.
            lines.sort_by_key(|(role, _)| index(*role));
            lines.into_iter().for_each(|(role, line)| self.journal.line(to, role, line));
            self.links.listen(&mut self.setup.world);
            self.recorder.observe(&self.setup.world);
            self.end_step(supervisor);
        }
        Ok(())
    }

    /// Faults that are due.
    fn befall(&mut self, supervisor: &mut Supervisor) {
        while let Some(change) = supervisor.due(&self.setup.world) {
            self.journal.change(self.setup.world.now(), &change);
            supervisor.apply(change, self);
        }
        for (role, end) in self.radios.as_mut().map(Radios::ended).unwrap_or_default() {
            self.journal.radio_end(self.setup.world.now(), role, end);
            self.setup.world.inject(sim::Fault::RadioFails { vehicle: index(role) });
            let grounded = self.setup.world.snapshot().vehicles.iter().all(|vehicle| !vehicle.armed);
            if grounded && matches!(end, End::Code(_)) {
                // The companions would wait for it for as long as anybody likes.
                self.say(&format!("no flight without {role}'s radio host: see radio-{}.log", role.key()));
                Role::BOTH.into_iter().for_each(|role| supervisor.ask_to_stop(role, self));
            }
        }
        // The slot, and whose doing it is, may have changed; of what a device has done since, its change tells.
        for role in Role::BOTH {
            if self.radios.as_ref().is_some_and(|radios| radios.is_told(role)) {
                self.radiate(role, self.on_air[role]);
            }
        }
        self.tell_world();
    }

    /// The world forward.
    fn advance(&mut self, to: Duration) {
        // What a fault or a command has just changed keeps its own instant.
        self.recorder.observe(&self.setup.world);
        let changes = self.radios.as_mut().map(Radios::changes).unwrap_or_default();
        for (at, role, dbm) in changes {
            self.setup.world.advance(at.min(to));
            self.radiate(role, dbm);
            self.recorder.observe(&self.setup.world);
        }
        self.setup.world.advance(to);
        self.recorder.observe(&self.setup.world);
    }

    /// A vehicle radiates what its device does.
    fn radiate(&mut self, role: Role, dbm: Option<f64>) {
        let now = self.setup.world.now();
        let Some(radios) = &self.radios else { return };
        let (slot, astray) = (self.links.asked_slot(role), radios.is_astray(role, now));
        let power = DevicePower { dbm, slot, astray };
        self.on_air[role] = dbm;
        self.setup.world.set_device_power(index(role), power);
    }

    /// Datagrams out, and whoever has ended.
    fn end_step(&mut self, supervisor: &mut Supervisor) {
        self.links.deliver(&mut self.setup.world);
        Role::BOTH.into_iter().for_each(|role| self.see_end(role, supervisor));
        supervisor.watch(self);
        self.journal.progress(&self.setup.world);
    }

    fn interrupt(&mut self, supervisor: &mut Supervisor) {
        self.say("interrupted: both companions are asked to stop");
        self.interrupted = true;
        Role::BOTH.into_iter().for_each(|role| supervisor.ask_to_stop(role, self));
    }

    /// A step that makes up for more than its own length was late: nobody was told anything meanwhile.
    fn note_lateness(&mut self, from: Duration, to: Duration) {
        let by = to.saturating_sub(from).saturating_sub(WALL_STEP.mul_f64(self.setup.speed));
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
            events: self.journal.finish(),
            ends: self.companions.map(|companion| companion.end),
            interrupted: self.interrupted,
            traffic: self.links.traffic(),
            radios: self.radios_document,
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
        self.journal.end(self.setup.world.now(), role, end);
    }

    /// Tells the world's monitor how the companions fare, as far as this process knows.
    fn tell_world(&mut self) {
        for role in Role::BOTH {
            let companion = &self.companions[role];
            let [vehicle_way, peer_way] = self.links.longest_ways(role);
            let told = sim::Circumstances {
                runs: companion.lives() && !companion.is_held(),
                life: self.lives[role],
                vehicle_link: self.links.vehicle_passage(role),
                from_peer: self.links.pair_passage(role.peer()),
                vehicle_way: WIRE + vehicle_way,
                peer_way: WIRE + peer_way,
            };
            if std::mem::replace(&mut self.told[role], told) != told {
                self.setup.world.set_circumstances(index(role), told);
            }
        }
    }

    /// Starts a companion once more; the telemetry logs of its earlier life are kept beside the new ones.
    fn spawn_again(&self, role: Role) -> Result<Companion, String> {
        let name = role.key();
        for link in ["autopilot", "transmitter", "pair"] {
            let log = |suffix: &str| self.setup.directory.join(format!("{name}-{link}{suffix}.tlog"));
            let earlier = (1..).map(|life| log(&format!(".{life}"))).find(|path| !path.exists());
            if let Some(earlier) = earlier {
                // Without it the new log takes the old one's place: that costs the log, not the flight.
                let _ = std::fs::rename(log(""), earlier);
            }
        }
        spawn_companion(&self.setup.spawning(), role, &self.vehicle_files[role], &self.said)
    }

    /// What a companion has said, if it is for the operator.
    fn hear(&mut self, role: Role, said: Said) {
        if let Said::Line(line) = said {
            self.journal.line(self.setup.world.now(), role, line);
        }
    }

    fn say(&self, text: &str) {
        Journal::say(self.setup.world.now(), text);
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
        self.companions[role].kill();
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
        self.companions[role].freeze(frozen);
    }

    fn stop(&mut self, role: Role) {
        self.companions[role].stop();
    }

    fn stop_within(&self) -> Duration {
        match self.setup.pace {
            Pace::Wall => STOP_WITHIN.mul_f64(self.setup.speed),
            Pace::InStep { .. } => STOP_WITHIN,
        }
    }

    fn fill_disk(&mut self, role: Role, full: bool) {
        if let Err(error) = self.companions[role].fill_disk(full) {
            self.say(&format!("{role}  the disk cannot be made to look full: {error}"));
        }
    }

    fn stall_disk(&mut self, role: Role, stalled: bool) {
        self.companions[role].stall(stalled);
    }

    fn set_pair_path(&mut self, from: Role, path: Option<simulation::Path>) {
        self.links.set_pair_path(from, path);
    }

    fn set_autopilot_path(&mut self, role: Role, path: Option<simulation::Path>) {
        self.links.set_autopilot_path(role, path);
    }

    fn befall_radio(&mut self, fault: RadioFault, role: Role, on: bool) {
        let Some(radios) = &mut self.radios else { return };
        let vehicle = index(role);
        if fault == RadioFault::HostLoss {
            self.links.cut_host(role, on);
            return self.setup.world.inject(sim::Fault::RadioHopFrozen {
                vehicle,
                toward: sim::Toward::Radio,
                on,
            });
        }
        radios.befall(fault, role, on);
        if on {
            self.setup.world.inject(sim::Fault::RadioFails { vehicle });
        }
    }
}
