//! Two companions and the simulated world, moved from event to event.

use std::sync::Arc;
use std::time::Duration;

use veilwing_sitl::vehicle::{COMPANION_LINK, RADIO_LINK, TICK};
use veilwing_sitl::{Circumstances, DevicePower, Fault, Toward, World};

use crate::companion::{MOST_WAITING, WOKEN_LATE};
use crate::link::counters::Counters;
use crate::link::{Aboard, Envelope};
use crate::mission::{Outcome, Outgoing};
use crate::planner::following::Moved;
use crate::role::{PerVehicle, Role};

use super::disk::Disk;
use super::fault::RadioFault;
use super::hosted::{DeviceModel, Hosted};
use super::index;
use super::observer::{Observer, Wire};
use super::path::{Path, Pipe};
use super::process::{Given, Process};
use super::turning::tell_proposal;
use super::world;

/// How many datagrams wait in a socket while its process does not read; further ones are lost. Linux's default receive buffer
/// of 208 KiB, divided by what it accounts for a small datagram.
const SOCKET_HOLDS: usize = 256;
/// A companion that asks to be called again at the same instant more often than this would do so for ever.
const MOST_CALLS: u32 = 100;
/// What planning a motion takes a companion.
const PLANNING: Duration = Duration::from_millis(60);

/// Why a flight cannot go on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FlightError {
    /// A companion asks to be called again and again without time going on: on a vehicle it would take all of a processor.
    #[error("the companion of vehicle {role} asks to be called at once for ever ({why}) at {at:?}")]
    Spinning {
        /// Which one.
        role: Role,
        /// What it says it has to do.
        why: &'static str,
        /// Simulation time.
        at: Duration,
    },
}

/// What a flight starts from, beside the world.
#[derive(Debug, Clone)]
pub struct Setup {
    /// What each companion is given.
    pub given: PerVehicle<Arc<Given>>,
    /// The mission begins as soon as both vehicles are ready, without MISSION_START.
    pub start_unasked: bool,
    /// Both directions of the autopilot links, and of radios' own.
    pub autopilot: Path,
    /// Both directions of the pair link.
    pub pair: Path,
    /// What the paths draw from.
    pub seed: u64,
}

/// A flight in virtual time.
#[derive(Debug)]
pub struct Flight {
    setup: Setup,
    /// The world: to inject faults, and to look at.
    pub world: World,
    /// How each companion ended; `None` while it runs, and after a kill.
    pub outcomes: PerVehicle<Option<Outcome>>,
    processes: PerVehicle<Option<Process>>,
    /// What each companion's decoders turned away, over restarts.
    counters: PerVehicle<Counters>,
    to_vehicle: PerVehicle<Pipe>,
    to_companion: PerVehicle<Pipe>,
    /// Of radios that have links of their own, and from them.
    to_radio: PerVehicle<Pipe>,
    from_radio: PerVehicle<Pipe>,
    /// Radios whose device a host drives, in place of the simulated vehicle's own.
    hosted: PerVehicle<Option<Hosted>>,
    /// By sender.
    pair: PerVehicle<Pipe>,
    disks: PerVehicle<Disk>,
    on_air: [bool; 2],
    lives: PerVehicle<u32>,
    starts: u32,
    sent: u64,
    received: u64,
    lost: u64,
    now: Duration,
}

impl Flight {
    /// A flight at the beginning of `world`'s time, both companions just started.
    #[must_use]
    pub fn new(world: World, setup: Setup) -> Self {
        let pipe = |path, direction: u64| {
            move |role| Pipe::new(path, setup.seed, 2 * direction + index(role) as u64)
        };
        let mut flight = Self {
            now: world.now(),
            world,
            outcomes: PerVehicle::default(),
            processes: PerVehicle::default(),
            counters: PerVehicle::default(),
            to_vehicle: PerVehicle::from_fn(pipe(setup.autopilot, 0)),
            to_companion: PerVehicle::from_fn(pipe(setup.autopilot, 1)),
            pair: PerVehicle::from_fn(pipe(setup.pair, 2)),
            to_radio: PerVehicle::from_fn(pipe(setup.autopilot, 3)),
            from_radio: PerVehicle::from_fn(pipe(setup.autopilot, 4)),
            hosted: PerVehicle::default(),
            disks: PerVehicle::default(),
            on_air: [false; 2],
            lives: PerVehicle::default(),
            starts: 0,
            sent: 0,
            received: 0,
            lost: 0,
            setup,
        };
        Role::BOTH.into_iter().for_each(|role| flight.start(role));
        Role::BOTH.into_iter().for_each(|role| flight.tell(role));
        flight
    }

    /// Puts a radio host and such a device aboard, in place of the vehicle's own radio, which is to have a link of its own
    /// ([`RadioPlace::OnItsOwn`](veilwing_sitl::RadioPlace::OnItsOwn)).
    pub fn host_radio(&mut self, role: Role, model: DeviceModel) {
        self.hosted[role] = Hosted::start(role, model, self.setup.seed, self.now);
        self.world.set_device_power(index(role), DevicePower::default());
    }

    /// The radio host aboard, if there is one.
    #[must_use]
    pub fn hosted(&self, role: Role) -> Option<&Hosted> {
        self.hosted[role].as_ref()
    }

    /// What befalls a radio host or its device begins, or is over; nothing where there is none.
    pub fn befall_radio(&mut self, fault: RadioFault, role: Role, on: bool) {
        let now = self.now;
        let Some(hosted) = &mut self.hosted[role] else { return };
        if fault == RadioFault::HostLoss {
            let path = if on { Path::CUT } else { Path::GOOD };
            self.to_radio[role].path = path;
            self.from_radio[role].path = path;
            let vehicle = index(role);
            return self.world.inject(Fault::RadioHopFrozen { vehicle, toward: Toward::Radio, on });
        }
        hosted.befall(fault, on, now);
        if on {
            self.world.inject(Fault::RadioFails { vehicle: index(role) });
        }
        self.radiate(role);
    }

    /// Lets the radio hosts do what is due.
    fn run_hosts(&mut self) {
        for role in Role::BOTH {
            let Some(hosted) = &mut self.hosted[role] else { continue };
            while let Some(bytes) = hosted.listens().then(|| self.to_radio[role].receive(self.now)).flatten()
            {
                hosted.hear(&bytes, self.now);
            }
            for bytes in hosted.run(self.now) {
                self.received += 1;
                self.lost += self.from_radio[role].send(&bytes, self.now);
            }
            self.radiate(role);
        }
    }

    /// The vehicle radiates what its device does.
    fn radiate(&mut self, role: Role) {
        let Some(hosted) = &self.hosted[role] else { return };
        let astray = hosted.device().is_astray(self.now);
        let power = DevicePower { dbm: hosted.device().antenna_dbm(), slot: hosted.slot(), astray };
        self.world.set_device_power(index(role), power);
    }

    /// Starts a companion process, in place of the one that runs if one does.
    pub fn start(&mut self, role: Role) {
        self.starts += 1;
        self.lives[role] += 1;
        self.disks[role].forget();
        let given = &self.setup.given[role];
        let start = (self.setup.start_unasked, self.disks[role].orders);
        let process = Process::start(given, role, self.starts, start, self.now);
        self.processes[role] = Some(process);
        self.outcomes[role] = None;
        self.tell(role);
    }

    /// SIGKILL.
    pub fn kill(&mut self, role: Role) {
        if self.processes[role].take().is_some() {
            self.world.inject(Fault::CompanionLost { vehicle: index(role) });
            self.tell(role);
        }
    }

    /// SIGTERM; a frozen process hears it when it runs again.
    pub fn stop(&mut self, role: Role) {
        let now = self.now;
        if let Some(process) = &mut self.processes[role] {
            let at = process.instant(now);
            process.executive.shutdown(at);
            process.wakes_at = now;
        }
    }

    /// The mission file of a companion was edited: those that move in it, or what is wrong with it.
    pub fn edit_mission(&mut self, role: Role, edited: Result<Vec<Moved>, String>) {
        let now = self.now;
        if let Some(process) = &mut self.processes[role] {
            let at = process.instant(now);
            process.executive.handle_file(edited, at);
            process.wakes_at = now;
        }
    }

    /// SIGSTOP, SIGCONT.
    pub fn freeze(&mut self, role: Role, frozen: bool) {
        let now = self.now;
        if let Some(process) = &mut self.processes[role] {
            if process.frozen && !frozen {
                self.lost += self.to_companion[role].overflow(SOCKET_HOLDS, now);
                self.lost += self.from_radio[role].overflow(SOCKET_HOLDS, now);
                self.lost += self.pair[role.peer()].overflow(SOCKET_HOLDS, now);
            }
            process.frozen = frozen;
        }
        self.tell(role);
    }

    /// The disk under a companion's logs is full, or takes records again.
    pub fn fill_disk(&mut self, role: Role, full: bool) {
        self.disks[role].full = full;
    }

    /// The disk under a companion's logs takes nothing for a while, or goes on.
    pub fn stall_disk(&mut self, role: Role, stalled: bool) {
        self.disks[role].stalled = stalled;
    }

    /// Records that the disk under a companion's logs did not take.
    #[must_use]
    pub fn unlogged(&self, role: Role) -> u64 {
        self.disks[role].lost
    }

    /// Tells the world's monitor how a companion fares.
    fn tell(&mut self, role: Role) {
        let process = self.processes[role].as_ref();
        let circumstances = Circumstances {
            runs: process.is_some_and(|process| !process.frozen),
            life: self.lives[role],
            vehicle_link: self.to_vehicle[role].path.passage().max(self.to_companion[role].path.passage()),
            from_peer: self.pair[role.peer()].path.passage(),
            vehicle_way: self.to_vehicle[role]
                .path
                .longest_way()
                .max(self.to_companion[role].path.longest_way()),
            peer_way: self.pair[role.peer()].path.longest_way(),
        };
        self.world.set_circumstances(index(role), circumstances);
    }

    /// Changes the pair link in the direction from `from`, for what is sent from now on.
    pub fn set_pair_path(&mut self, from: Role, path: Path) {
        let thaws = std::mem::replace(&mut self.pair[from].path, path).frozen && !path.frozen;
        if thaws {
            // What was held up is heard, though nothing is from now on.
            self.pair[from].path = Path::GOOD;
            self.tell(from.peer());
            self.pair[from].path = path;
        }
        self.tell(from.peer());
    }

    /// Changes both directions of a companion's autopilot link, likewise.
    pub fn set_autopilot_path(&mut self, role: Role, path: Path) {
        self.to_vehicle[role].path = path;
        self.to_companion[role].path = path;
        self.tell(role);
    }

    /// Changes what a companion hears of its autopilot and radio alone, likewise.
    pub fn set_telemetry_path(&mut self, role: Role, path: Path) {
        self.to_companion[role].path = path;
        self.tell(role);
    }

    /// Changes both directions of the link that a companion's radio has of its own, likewise.
    pub fn set_radio_path(&mut self, role: Role, path: Path) {
        self.to_radio[role].path = path;
        self.from_radio[role].path = path;
    }

    /// A frame of another station, which the vehicle's router passes on to the companion.
    pub fn send_to_companion(&mut self, role: Role, frame: &[u8]) {
        self.lost += self.to_companion[role].send(frame, self.now);
    }

    /// The simulation time.
    #[must_use]
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Whether a companion process exists, frozen or not.
    #[must_use]
    pub fn lives(&self, role: Role) -> bool {
        self.processes[role].is_some()
    }

    /// What is on the air: I and J.
    #[must_use]
    pub fn radiating(&self) -> [bool; 2] {
        self.on_air
    }

    /// What a companion's decoders have turned away.
    #[must_use]
    pub fn counters(&self, role: Role) -> &Counters {
        &self.counters[role]
    }

    /// Datagrams that companions have sent, that vehicles have sent to companions, and those of either that were lost.
    #[must_use]
    pub fn datagrams(&self) -> (u64, u64, u64) {
        (self.sent, self.received, self.lost)
    }

    /// Moves to the next event, but not beyond `limit`.
    ///
    /// # Errors
    /// A companion that cannot be run.
    pub fn step(&mut self, limit: Duration, observer: &mut impl Observer) -> Result<(), FlightError> {
        self.now = self.next_event().min(limit).max(self.now);
        self.world.advance(self.now);
        self.collect_frames();
        self.run_hosts();
        for role in Role::BOTH {
            self.run_companion(role, observer)?;
        }
        self.tell_followed();
        for role in Role::BOTH {
            while let Some(bytes) = self.to_vehicle[role].receive(self.now) {
                self.world.handle(index(role), 0, &bytes);
            }
            while let Some(bytes) = self.next_for_own_radio(role) {
                self.world.handle(index(role), RADIO_LINK, &bytes);
            }
        }
        self.collect_frames();
        self.run_hosts();
        let on = self.world.snapshot().vehicles.map(|vehicle| vehicle.tx_power_w.is_some());
        if on != self.on_air {
            self.on_air = on;
            observer.on_air(self.now, on);
        }
        observer.saw(&self.world);
        Ok(())
    }

    /// Tells the world what both are to do in a slot whose motion is made anew, as I has it; as J has it where I has none, or knows
    /// that J flies another.
    fn tell_followed(&mut self) {
        let told = Role::BOTH.into_iter().find_map(|role| {
            let process = self.processes[role].as_ref()?;
            let at = process.instant(self.now);
            let flown = process.executive.flown().filter(|_| process.executive.flies_alike(at))?;
            Some((flown.slot, flown.at(at)))
        });
        if let Some((slot, flown)) = told {
            self.world.follow(usize::from(slot), world::flown(&flown));
        }
    }

    /// The next datagram for the vehicle's own radio, where no host takes it.
    fn next_for_own_radio(&mut self, role: Role) -> Option<Vec<u8>> {
        self.hosted[role].is_none().then(|| self.to_radio[role].receive(self.now)).flatten()
    }

    /// The world's next tick, the next arrival, or the next deadline of a companion.
    fn next_event(&self) -> Duration {
        let tick_us = TICK.as_micros() as u64;
        let mut next = Duration::from_micros((self.now.as_micros() as u64 / tick_us + 1) * tick_us);
        for role in Role::BOTH {
            // What a stopped host lets wait is no event.
            let listens = self.hosted[role].as_ref().is_none_or(Hosted::listens);
            let to_radio = Some(&self.to_radio[role]).filter(|_| listens).and_then(Pipe::next_arrival);
            let arrivals = [self.to_vehicle[role].next_arrival(), to_radio];
            let hosted = self.hosted[role].as_ref().and_then(Hosted::next).filter(|at| *at > self.now);
            let events = [self.next_of_companion(role), hosted].into_iter().chain(arrivals);
            next = events.flatten().fold(next, Duration::min);
        }
        next
    }

    /// When a companion has something to do; `None` while it runs not.
    fn next_of_companion(&self, role: Role) -> Option<Duration> {
        let process = self.processes[role].as_ref().filter(|process| !process.frozen)?;
        let pipes = [&self.to_companion[role], &self.from_radio[role], &self.pair[role.peer()]];
        let arrivals = pipes.map(Pipe::next_arrival);
        Some(arrivals.into_iter().flatten().fold(process.wakes_at, Duration::min))
    }

    fn collect_frames(&mut self) {
        while let Some((vehicle, link, frame)) = self.world.poll_transmit() {
            let role = Role::BOTH[vehicle];
            let pipe = match link {
                // Its own radio is not aboard.
                RADIO_LINK if self.hosted[role].is_some() => continue,
                COMPANION_LINK => &mut self.to_companion[role],
                RADIO_LINK => &mut self.from_radio[role],
                _ => continue,
            };
            self.received += 1;
            self.lost += pipe.send(&frame, self.now);
        }
    }

    fn run_companion(&mut self, role: Role, observer: &mut impl Observer) -> Result<(), FlightError> {
        if self.processes[role].is_none() {
            // Nobody listens.
            self.lost += self.to_companion[role].overflow(0, self.now);
            self.lost += self.from_radio[role].overflow(0, self.now);
            self.lost += self.pair[role.peer()].overflow(0, self.now);
        }
        if self.next_of_companion(role).is_none_or(|at| at > self.now) {
            return Ok(());
        }
        let Some(mut process) = self.processes[role].take() else { return Ok(()) };
        self.run(role, &mut process, observer)?;
        self.outcomes[role] = process.executive.outcome();
        match self.outcomes[role] {
            None => self.processes[role] = Some(process),
            Some(_) => self.tell(role),
        }
        Ok(())
    }

    /// One instant of a companion, in the order of its event loop: deadlines before messages (but for a process that
    /// was not run, which first takes what waits), the autopilot's before the radio's and the peer's, and everything it says before it
    /// hears more.
    fn run(
        &mut self,
        role: Role,
        process: &mut Process,
        observer: &mut impl Observer,
    ) -> Result<(), FlightError> {
        let at = process.instant(self.now);
        let (mut calls, mut waiting) = (0, 0);
        loop {
            if let Some(orders) = process.executive.poll_record() {
                self.disks[role].keep(orders);
            }
            if let Some(orders) = self.disks[role].kept() {
                process.executive.handle_recorded(orders, at);
            }
            self.send(role, process, observer);
            while let Some((ticket, question)) = process.executive.poll_question() {
                process.planning.push_back((at + PLANNING, ticket, question.answer()));
            }
            if process.planning.front().is_some_and(|(made, ..)| *made <= at)
                && let Some((_, ticket, answer)) = process.planning.pop_front()
            {
                process.executive.handle_answer(ticket, answer, at);
                continue;
            }
            let (deadline, why) = process.executive.poll_timeout();
            let woken_late = deadline + WOKEN_LATE < at && waiting < MOST_WAITING;
            if (deadline > at || woken_late) && self.hear(role, process, observer) {
                waiting += 1;
            } else if deadline <= at {
                calls += 1;
                if calls > MOST_CALLS {
                    return Err(FlightError::Spinning { role, why, at: self.now });
                }
                process.executive.handle_timeout(at);
            } else {
                let made = process.planning.front().map_or(deadline, |(made, ..)| *made);
                process.wakes_at = process.simulation_time(deadline.min(made));
                return Ok(());
            }
        }
    }

    /// Lets a companion hear the next datagram that has arrived, if there is one.
    fn hear(&mut self, role: Role, process: &mut Process, observer: &mut impl Observer) -> bool {
        if let Some(bytes) = self.to_companion[role].receive(self.now) {
            self.hear_own(role, process, (Wire::Autopilot, &bytes), observer);
        } else if let Some(bytes) = self.from_radio[role].receive(self.now) {
            self.hear_own(role, process, (Wire::Radio, &bytes), observer);
        } else if let Some(bytes) = self.pair[role.peer()].receive(self.now) {
            self.hear_peer(role, process, &bytes, observer);
        } else {
            return false;
        }
        true
    }

    /// What the vehicle passes on, or a radio says on a link of its own.
    fn hear_own(
        &mut self,
        role: Role,
        process: &mut Process,
        (wire, bytes): (Wire, &[u8]),
        observer: &mut impl Observer,
    ) {
        let at = process.instant(self.now);
        let radio = wire == Wire::Radio;
        process.aboard(radio).feed(bytes);
        process.aboard(radio).end();
        while let Some(raw) = process.aboard(radio).next_frame(&mut self.counters[role]) {
            match raw.parse::<Aboard>() {
                Ok(frame) => {
                    self.log(role, wire, raw.bytes(), observer);
                    let (header, executive) = (frame.header, &mut process.executive);
                    match &frame.message {
                        Aboard::Common(message) if radio => executive.handle_radio_link(header, message, at),
                        Aboard::Common(message) => {
                            observer.received(self.now, role, header, message);
                            executive.handle_autopilot(header, message, at);
                        }
                        Aboard::Radio(message) if radio => {
                            executive.handle_report(header, message.message(), at);
                        }
                        Aboard::Radio(message) => executive.handle_radio(header, message.message(), at),
                    }
                    self.send(role, process, observer);
                }
                Err(reason) => {
                    self.counters[role].rejected.count(reason);
                }
            }
        }
    }

    fn hear_peer(&mut self, role: Role, process: &mut Process, bytes: &[u8], observer: &mut impl Observer) {
        let at = process.instant(self.now);
        process.from_peer.feed(bytes);
        process.from_peer.end();
        while let Some(raw) = process.from_peer.next_frame(&mut self.counters[role]) {
            match raw.parse().and_then(|frame| process.form.open(frame.message)) {
                Ok(message) => {
                    self.log(role, Wire::Pair, raw.bytes(), observer);
                    process.executive.handle_pair(&message, at);
                    self.send(role, process, observer);
                }
                Err(reason) => {
                    self.counters[role].rejected.count(reason);
                }
            }
        }
    }

    /// Sends and tells all that a companion has to say.
    fn send(&mut self, role: Role, process: &mut Process, observer: &mut impl Observer) {
        let stands = (process.executive.phase_name(), process.executive.standing());
        if process.stands.replace(stands) != Some(stands) {
            observer.stands(self.now, role, stands.0, stands.1);
        }
        let own = process.executive.own();
        while let Some(outgoing) = process.executive.poll_transmit() {
            observer.sent(self.now, role, &outgoing);
            if let (Role::I, Outgoing::Pair(message)) = (role, &outgoing) {
                tell_proposal(message, &mut self.world);
            }
            let (wire, frame) = match &outgoing {
                Outgoing::Autopilot(message) => (Wire::Autopilot, process.encoder.encode(own, &**message)),
                Outgoing::Radio(message) => (Wire::Radio, process.to_radio.encode(own, &**message)),
                Outgoing::Pair(message) => {
                    let envelope = Envelope::new(process.form, own, 0, (**message).clone());
                    (Wire::Pair, process.encoder.encode(own, &envelope))
                }
            };
            self.log(role, wire, frame.raw_bytes(), observer);
            self.sent += 1;
            let pipe = match wire {
                Wire::Autopilot => &mut self.to_vehicle[role],
                Wire::Radio => &mut self.to_radio[role],
                Wire::Pair => &mut self.pair[role],
            };
            self.lost += pipe.send(frame.raw_bytes(), self.now);
        }
        while let Some(notice) = process.executive.poll_notice() {
            observer.said(self.now, role, Some(process.executive.phase_name()), &notice);
        }
    }

    /// A frame for a companion's log.
    fn log(&mut self, role: Role, wire: Wire, bytes: &[u8], observer: &mut impl Observer) {
        let (written, notice) = self.disks[role].write();
        if let Some(notice) = notice {
            observer.said(self.now, role, None, &notice);
        }
        if written {
            observer.frame(self.now, role, wire, bytes);
        }
    }
}
