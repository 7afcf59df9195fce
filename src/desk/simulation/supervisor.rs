//! What befalls the companions of a simulated flight, and when they are given up: one policy for companions that are
//! processes in real time and for those that live in virtual time.

use std::time::Duration;

use veilwing_sitl::World;

use crate::role::{PerVehicle, Role};

use super::fault::{Change, Fault, FaultKind, RadioFault, Schedule};
use super::index;
use super::path::Path;
use super::station::{STATION_LINK, Station};

/// A companion whose peer has ended may take this much longer (flight time) before it is asked to stop ...
const LAST_ONE: Duration = Duration::from_secs(300);
/// ... and this much if its vehicle neither obeys it nor comes down: it has nothing left to do.
const LAST_ONE_IDLE: Duration = Duration::from_secs(15);
/// The kinds of fault of the pair link.
const PAIR: [FaultKind; 3] = [FaultKind::PairLoss, FaultKind::PairDegraded, FaultKind::PairFrozen];

/// Runs the companions and carries their datagrams.
pub trait Host {
    /// The faults of the link between vehicle and companion that befall the host's own part of it; the world's part has
    /// its own.
    const LINK: &'static [FaultKind];

    /// The world that the companions fly in.
    fn world(&mut self) -> &mut World;
    /// Whether a companion exists, frozen or not, as far as the host has seen.
    fn lives(&self, role: Role) -> bool;
    /// SIGKILL; the death may be seen later.
    fn kill(&mut self, role: Role);
    /// Starts a companion that is dead once more. Whether it could.
    fn start(&mut self, role: Role) -> bool;
    /// SIGSTOP, SIGCONT.
    fn freeze(&mut self, role: Role, frozen: bool);
    /// SIGTERM.
    fn stop(&mut self, role: Role);
    /// After being asked to stop, a companion has this long (flight time) before it is killed.
    fn stop_within(&self) -> Duration;
    /// The disk under a companion's logs is full, or takes records again.
    fn fill_disk(&mut self, role: Role, full: bool);
    /// That disk keeps what it is given waiting, or goes on.
    fn stall_disk(&mut self, role: Role, stalled: bool);
    /// The pair link in the direction from `from`; `None`: as good as ever.
    fn set_pair_path(&mut self, from: Role, path: Option<Path>);
    /// Both directions of a companion's autopilot link; `None`: as good as ever.
    fn set_autopilot_path(&mut self, role: Role, path: Option<Path>);
    /// What befalls a radio host or its device begins (`on`), or is over. A flight without one comes to none.
    fn befall_radio(&mut self, fault: RadioFault, role: Role, on: bool);
}

/// A companion that was killed to be started again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Restart {
    /// Not yet.
    Later,
    /// As soon as its death is seen.
    Due,
}

/// Lets faults begin and end, starts again what they killed for a while, and ends what would not end by itself.
#[derive(Debug)]
pub struct Supervisor {
    schedule: Schedule,
    happened: Vec<(Duration, Fault)>,
    restarts: PerVehicle<Option<Restart>>,
    first_end: Option<Duration>,
    asked_to_stop: PerVehicle<Option<Duration>>,
    longest: Duration,
    station: Station,
}

impl Supervisor {
    /// For a flight with these faults, which takes no longer than `longest`.
    #[must_use]
    pub fn new(faults: Vec<Fault>, longest: Duration) -> Self {
        Self {
            schedule: Schedule::new(faults),
            happened: Vec::new(),
            restarts: PerVehicle::default(),
            first_end: None,
            asked_to_stop: PerVehicle::default(),
            longest,
            station: Station::default(),
        }
    }

    /// The next fault that begins or ends now: to be told, and then applied.
    pub fn due(&mut self, world: &World) -> Option<Change> {
        let now = world.now();
        if !self.schedule.waits_for_no_slot() {
            self.schedule.watch(now, &world.snapshot());
        }
        self.schedule.poll(now)
    }

    /// When the next change is due, as far as it is known.
    #[must_use]
    pub fn next(&self) -> Option<Duration> {
        self.schedule.next()
    }

    /// Lets a fault begin or end.
    pub fn apply(&mut self, change: Change, host: &mut impl Host) {
        match change {
            Change::Begins(fault) => {
                fault.roles.iter().for_each(|role| self.befall(&fault, *role, true, host));
                self.happened.push((host.world().now(), fault));
            }
            Change::Ends(fault) => {
                fault.roles.iter().for_each(|role| self.befall(&fault, *role, false, host));
            }
        }
    }

    fn befall<H: Host>(&mut self, fault: &Fault, role: Role, on: bool, host: &mut H) {
        // Another fault of the kind may be under way when this one ends.
        let still = self.schedule.runs(fault.kind, role);
        match fault.kind {
            FaultKind::CompanionKill if on => {
                self.restarts[role] = None;
                host.kill(role);
            }
            FaultKind::CompanionRestart if on => {
                if host.lives(role) || self.restarts[role].is_some() {
                    self.restarts[role] = Some(Restart::Later);
                }
                host.kill(role);
            }
            FaultKind::CompanionRestart => {
                self.restarts[role] = self.restarts[role].map(|_| Restart::Due);
                if !host.lives(role) {
                    self.start_if_due(role, host);
                }
            }
            FaultKind::CompanionStop => host.freeze(role, still),
            FaultKind::DiskFull => host.fill_disk(role, still),
            FaultKind::DiskStall => host.stall_disk(role, still),
            FaultKind::PairLoss | FaultKind::PairDegraded | FaultKind::PairFrozen => {
                host.set_pair_path(role, self.schedule.path(&PAIR, role));
            }
            FaultKind::Radio(fault) => host.befall_radio(fault, role, still),
            FaultKind::Operator(order) if on => {
                let frame = self.station.order(order, role, fault.is_to_all());
                host.world().handle(index(role), STATION_LINK, &frame);
            }
            kind => {
                if H::LINK.contains(&kind) {
                    host.set_autopilot_path(role, self.schedule.path(H::LINK, role));
                }
                if let Some(fault) = fault.in_the_world(role, on).filter(|_| on || !still) {
                    host.world().inject(fault);
                }
            }
        }
    }

    /// Whether a companion that is dead will be started again.
    #[must_use]
    pub fn comes_back(&self, role: Role) -> bool {
        self.restarts[role].is_some()
    }

    /// Starts a dead companion again if its time has come. Not so if it cannot be started.
    pub fn start_if_due(&mut self, role: Role, host: &mut impl Host) -> bool {
        if self.restarts[role] != Some(Restart::Due) {
            return true;
        }
        self.restarts[role] = None;
        host.start(role)
    }

    /// Whether a companion is dead for good.
    pub fn has_ended(&self, role: Role, host: &impl Host) -> bool {
        !host.lives(role) && !self.comes_back(role)
    }

    /// Whether a companion was asked to stop.
    #[must_use]
    pub fn asked_to_stop(&self, role: Role) -> bool {
        self.asked_to_stop[role].is_some()
    }

    /// Asks a companion to stop, frozen or not; later it is killed.
    pub fn ask_to_stop(&mut self, role: Role, host: &mut impl Host) {
        if !self.asked_to_stop(role) {
            self.asked_to_stop[role] = Some(host.world().now());
            self.restarts[role] = None;
            host.freeze(role, false);
            host.stall_disk(role, false);
            host.stop(role);
        }
    }

    /// Ends what would not end by itself.
    pub fn watch(&mut self, host: &mut impl Host) {
        let now = host.world().now();
        if self.first_end.is_none() && Role::BOTH.into_iter().any(|role| self.has_ended(role, host)) {
            self.first_end = Some(now);
        }
        for role in Role::BOTH {
            match self.asked_to_stop[role] {
                Some(at) if now > at + host.stop_within() => host.kill(role),
                None if self.is_too_late(role, now, host) => self.ask_to_stop(role, host),
                _ => {}
            }
        }
    }

    fn is_too_late(&self, role: Role, now: Duration, host: &mut impl Host) -> bool {
        let alone = |at| {
            let vehicle = &host.world().snapshot().vehicles[index(role)];
            let coming_down = ["LAND", "RTL"].iter().any(|mode| vehicle.mode.contains(mode));
            let patience = if vehicle.companion_controlled || coming_down { LAST_ONE } else { LAST_ONE_IDLE };
            now > at + patience
        };
        now > self.longest || self.first_end.is_some_and(alone)
    }

    /// Faults that came about, with their times.
    #[must_use]
    pub fn happened(&self) -> &[(Duration, Fault)] {
        &self.happened
    }
}
