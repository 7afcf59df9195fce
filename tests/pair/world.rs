//! Two companions, two radios, a network and faults, in virtual time from one seed; and an observer of the truth.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, MavMessage as RadioMessage};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::pair::wire::MavMessage;
use veilwing::role::{PerVehicle, Role};
use veilwing::service::Outgoing;

use super::clocks::Clocks;
use super::companion::Companion;
use super::observer::{Observer, RADIO_WAY_MS};
use super::radio::{Radio, Said};
use super::setup::{Flown, GUARD, LEASE, NUMBERED, SLOT, service};

/// A radio says by itself what it does, five times a second.
const REPORT_EVERY: Duration = Duration::from_millis(200);

/// What goes wrong beside the network's usual ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    None,
    /// The pair link is cut, one way or both, for 0.2 to 6 s.
    Partition,
    /// A companion dies and is back 0.05 to 5 s later.
    Restart,
    /// A vehicle is out of its pose for 0.1 to 2 s.
    Pose,
    /// A vehicle's UTC jumps by up to 5 s, and back 10 s later.
    Clock,
    /// A vehicle's state does not come for 0.02 to 0.3 s.
    Stale,
    /// The operator pauses the pair at either vehicle, for 0.2 to 6 s.
    Pause,
    /// A vehicle gives its mission up, as at an operator's return.
    GiveUp,
    /// All the time: each way to a radio and back takes up to 60 ms, in any order, and one message in ten is lost.
    RadioHop,
    /// All the time: J's radio is a tenth as strong as it is told to be, and says so.
    WeakJammer,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    pub loss: f64,
    /// Longest way of a datagram; the shortest is half of it.
    pub delay: Duration,
    pub duplication: f64,
    pub fault: FaultKind,
    pub slots: usize,
    pub seed: u64,
    /// Slots carry each other on.
    pub turning: bool,
}

impl Case {
    fn flown(&self) -> Flown {
        Flown { turning: self.turning, ..Flown::default() }
    }
}

/// What the observer saw.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    pub slots: usize,
    pub served: usize,
    pub airtime: Duration,
    pub violations: Vec<String>,
    /// Why missions were given up.
    pub aborts: Vec<String>,
    /// Longest time that I radiated without J, after a fault of J's.
    pub exposed: Duration,
    /// Longest time that a radio stayed on after its companion's death.
    pub dead: Duration,
    /// Longest time that a radio stayed on out of pose.
    pub out_of_pose: Duration,
}

enum Event {
    Pair(Role, Box<MavMessage>),
    Command(Role, Box<COMMAND_INT_DATA>),
    Answer(Role, Box<Said>),
    /// A radio says by itself what it does.
    Report(Role),
    Expiry,
    Fault,
    Heal(Role, Heal),
    Revive,
}

enum Heal {
    Pose,
    Clock(i64),
    State,
    Pause,
}

struct Queued {
    at: Duration,
    number: u64,
    event: Event,
}

impl PartialEq for Queued {
    fn eq(&self, other: &Self) -> bool {
        self.number == other.number
    }
}
impl Eq for Queued {}
impl PartialOrd for Queued {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Queued {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.at, self.number).cmp(&(other.at, other.number))
    }
}

struct World {
    case: Case,
    rng: ChaCha8Rng,
    t: Duration,
    numbers: u64,
    queue: BinaryHeap<Reverse<Queued>>,
    companions: PerVehicle<Option<Companion>>,
    clocks: PerVehicle<Clocks>,
    radios: PerVehicle<Radio>,
    boots: u32,
    /// Until when datagrams of this sender are lost.
    cut_until: PerVehicle<Duration>,
    revive_at: Option<Duration>,
    observer: Observer,
}

/// Runs a case.
pub fn run(case: Case) -> Seen {
    run_with(case, |_, _| {})
}

/// Runs a case with a hand on every datagram at its delivery: receiver's local clock in microseconds, message.
pub fn run_with(case: Case, mut meddle: impl FnMut(u64, &mut MavMessage)) -> Seen {
    run_with_lease(case, LEASE, &mut meddle)
}

/// Runs a case in which I believes in leases as long as this, whatever J's may be.
pub fn run_with_lease(case: Case, i_lease: Duration, meddle: &mut impl FnMut(u64, &mut MavMessage)) -> Seen {
    let mut rng = ChaCha8Rng::seed_from_u64(case.seed);
    let clocks = PerVehicle::from_fn(|_| Clocks {
        started: Duration::ZERO,
        rate: 1.0 + rng.random_range(-50e-6..50e-6),
        utc_error_us: rng.random_range(-100_000..100_000),
    });
    let companions = PerVehicle::from_fn(|role| {
        let boot = if role == Role::I { 1 } else { 2 };
        let lease = if role == Role::I { i_lease } else { LEASE };
        let (flown, clocks) = (case.flown(), clocks[role]);
        Some(Companion::new(role, clocks, service(role, boot, NUMBERED, lease, &flown), &flown))
    });
    let mut world = World {
        case,
        rng,
        t: Duration::ZERO,
        numbers: 0,
        queue: BinaryHeap::new(),
        companions,
        clocks,
        radios: PerVehicle::default(),
        boots: 2,
        cut_until: PerVehicle::default(),
        revive_at: None,
        observer: Observer::new(case.flown()),
    };
    // The worst that crystals do: I's radio is on for longer than it is told, J's for less.
    (world.radios.i.fast_ppm, world.radios.j.fast_ppm) = (-45.0, 45.0);
    world.radios.j.weak_mdb = if case.fault == FaultKind::WeakJammer { 10_000 } else { 0 };
    Role::BOTH.into_iter().for_each(|role| world.push(Duration::ZERO, Event::Report(role)));
    if case.fault != FaultKind::None {
        world.push(Duration::from_secs(8), Event::Fault);
    }
    // A slot takes about six seconds; whoever has agreed on nothing for this long never will.
    let longest = Duration::from_secs(60) * (case.slots as u32 + 5);
    while world.observer.seen.slots < case.slots && world.t < longest {
        world.step(meddle);
    }
    if world.observer.seen.slots < case.slots {
        world.observer.violate(world.t, "the simulation stood still".into());
    }
    world.observer.seen
}

impl World {
    fn push(&mut self, at: Duration, event: Event) {
        self.numbers += 1;
        self.queue.push(Reverse(Queued { at, number: self.numbers, event }));
    }

    fn step(&mut self, meddle: &mut impl FnMut(u64, &mut MavMessage)) {
        let wakes = PerVehicle::from_fn(|role| self.companions[role].as_ref().map(Companion::wake_at));
        let wake = Role::BOTH.into_iter().filter_map(|role| wakes[role].map(|at| (at, role))).min();
        let queued = self.queue.peek().map(|q| q.0.at);
        match (wake, queued) {
            (Some((at, role)), queued) if queued.is_none_or(|q| at < q) => {
                self.t = self.t.max(at);
                if let Some(companion) = self.companions[role].as_mut() {
                    companion.handle_timeout(self.t);
                }
                self.flush(role);
            }
            _ => {
                let Some(Reverse(next)) = self.queue.pop() else { return };
                self.t = self.t.max(next.at);
                self.handle(next.event, meddle);
            }
        }
        self.observer.look(self.t, &self.companions, &self.radios);
        self.account();
    }

    fn handle(&mut self, event: Event, meddle: &mut impl FnMut(u64, &mut MavMessage)) {
        match event {
            Event::Pair(to, mut message) => {
                if let Some(companion) = self.companions[to].as_mut() {
                    let local = companion.clocks.local(self.t).since_start().as_micros() as u64;
                    meddle(local, &mut message);
                    companion.handle_pair(&message, self.t);
                }
                self.flush(to);
            }
            Event::Command(role, command) => {
                let answer = self.radios[role].command(&command, self.t);
                if let Some(until) = self.radios[role].expires_at() {
                    self.push(until, Event::Expiry);
                }
                if let Some(way) = self.radio_way() {
                    self.push(self.t + way, Event::Answer(role, Box::new(answer)));
                }
            }
            Event::Report(role) => {
                self.push(self.t + REPORT_EVERY, Event::Report(role));
                let report = self.radios[role].report(self.t);
                if let Some(way) = self.radio_way() {
                    self.push(self.t + way, Event::Answer(role, Box::new(report)));
                }
            }
            Event::Answer(role, answer) => {
                if let Some(companion) = self.companions[role].as_mut() {
                    companion.handle_radio(&answer, self.t);
                }
                self.flush(role);
            }
            Event::Expiry => {}
            Event::Fault => self.fault(),
            Event::Heal(role, heal) => {
                match heal {
                    Heal::Pose => self.observer.pose_lost_at[role] = None,
                    Heal::Clock(back_us) => self.clocks[role].utc_error_us += back_us,
                    Heal::State => self.observer.stale_since[role] = None,
                    Heal::Pause => self.order(role, false),
                }
                let utc_error_us = self.clocks[role].utc_error_us;
                if let Some(companion) = self.companions[role].as_mut() {
                    companion.pose_lost &= !matches!(heal, Heal::Pose);
                    companion.stale_since = companion.stale_since.filter(|_| !matches!(heal, Heal::State));
                    companion.clocks.utc_error_us = utc_error_us;
                }
            }
            Event::Revive => self.revive(),
        }
    }

    /// A serial line: quick and in order, and one message in a hundred lost; or much worse.
    fn radio_way(&mut self) -> Option<Duration> {
        let poor = self.case.fault == FaultKind::RadioHop;
        let lost = self.rng.random_bool(if poor { 0.1 } else { 0.01 });
        let share = if poor { self.rng.random_range(0.1..=4.0) } else { 0.5 };
        (!lost).then(|| Duration::from_secs_f64(RADIO_WAY_MS * 1e-3 * share))
    }

    fn flush(&mut self, role: Role) {
        while let Some(message) = self.companions[role].as_mut().and_then(|c| c.service.poll_transmit()) {
            match message {
                Outgoing::Radio(message) => {
                    // The limit's request is not answered: the caps alone hold.
                    if let RadioMessage::COMMAND_INT(command) = *message
                        && let Some(way) = self.radio_way()
                    {
                        self.push(self.t + way, Event::Command(role, Box::new(command)));
                    }
                }
                Outgoing::Pair(message) => {
                    self.watch_grants(role, &message);
                    self.send(role, *message);
                }
            }
        }
    }

    fn watch_grants(&mut self, role: Role, message: &MavMessage) {
        if let (MavMessage::VEILWING_LEASE_GRANT(grant), Some(companion)) = (message, &self.companions[role])
        {
            let local = companion.clocks.local(self.t) + Duration::from_millis(grant.duration_ms.into());
            let until = companion.clocks.true_time(local);
            let before = self.observer.granted.filter(|(slot, _)| *slot == grant.slot);
            let until = before.map_or(until, |(_, earlier)| earlier.max(until));
            self.observer.granted = Some((grant.slot, until));
        }
    }

    /// The operator's pause, or the end of it, at one companion; the other one hears of it from its peer.
    fn order(&mut self, role: Role, pause: bool) {
        let Some(companion) = self.companions[role].as_mut() else { return };
        companion.order(pause, self.t);
        self.observer.paused_at = pause.then_some((role, self.t));
        self.flush(role);
    }

    fn send(&mut self, from: Role, message: MavMessage) {
        let copies = if self.rng.random_bool(self.case.duplication) { 2 } else { 1 };
        for copy in 0..copies {
            if self.rng.random_bool(self.case.loss) || self.t < self.cut_until[from] {
                continue;
            }
            let mut way = self.case.delay.mul_f64(self.rng.random_range(0.5..=1.0));
            if copy > 0 {
                // A copy may be seconds late: from before a restart, or from another slot.
                way += Duration::from_secs_f64(self.rng.random_range(0.0..4.0));
            }
            let way = way.max(Duration::from_micros(200));
            self.push(self.t + way, Event::Pair(from.peer(), Box::new(message.clone())));
        }
    }

    fn fault(&mut self) {
        let again = self.t + Duration::from_secs_f64(self.rng.random_range(4.0..20.0));
        self.push(again, Event::Fault);
        let role = if self.rng.random_bool(0.5) { Role::I } else { Role::J };
        match self.case.fault {
            FaultKind::None | FaultKind::RadioHop | FaultKind::WeakJammer => {}
            FaultKind::Partition => {
                let until = self.t + Duration::from_secs_f64(self.rng.random_range(0.2..6.0));
                let both = self.rng.random_bool(0.5);
                self.cut_until[role] = until;
                if both {
                    self.cut_until[role.peer()] = until;
                }
            }
            FaultKind::Restart => self.kill(role),
            FaultKind::Pause => {
                self.order(role, true);
                let back = self.t + Duration::from_secs_f64(self.rng.random_range(0.2..6.0));
                self.push(back, Event::Heal(role, Heal::Pause));
            }
            FaultKind::GiveUp => {
                let Some(companion) = self.companions[role].as_mut() else { return };
                companion.abort("given up".into(), companion.clocks.local(self.t));
                companion.handle_timeout(self.t);
                self.flush(role);
            }
            FaultKind::Stale => {
                let Some(companion) = self.companions[role].as_mut() else { return };
                companion.stale_since = Some(companion.clocks.local(self.t));
                self.observer.stale_since[role] = Some(self.t);
                let back = self.t + Duration::from_secs_f64(self.rng.random_range(0.02..0.3));
                self.push(back, Event::Heal(role, Heal::State));
            }
            FaultKind::Pose => {
                let Some(companion) = self.companions[role].as_mut() else { return };
                companion.pose_lost = true;
                self.observer.pose_lost_at[role] = Some(self.t);
                if role == Role::J {
                    self.observer.j_fault_at = Some(self.t);
                }
                let back = self.t + Duration::from_secs_f64(self.rng.random_range(0.1..2.0));
                self.push(back, Event::Heal(role, Heal::Pose));
            }
            FaultKind::Clock => {
                let jump_us = self.rng.random_range(-5_000_000..5_000_000);
                self.clocks[role].utc_error_us += jump_us;
                let utc_error_us = self.clocks[role].utc_error_us;
                if let Some(companion) = self.companions[role].as_mut() {
                    companion.clocks.utc_error_us = utc_error_us;
                }
                self.push(self.t + Duration::from_secs(10), Event::Heal(role, Heal::Clock(-jump_us)));
            }
        }
    }

    fn kill(&mut self, role: Role) {
        if let Some(companion) = self.companions[role].take() {
            self.observer.died_at[role] = Some(self.t);
            if role == Role::J {
                self.observer.j_fault_at = Some(self.t);
            }
            if role == Role::I && companion.service.slot().is_some() {
                self.count();
            }
            self.boots += 1;
            let back = self.t + Duration::from_secs_f64(self.rng.random_range(0.05..5.0));
            self.clocks[role].started = back;
            self.push(back, Event::Revive);
        }
    }

    fn revive(&mut self) {
        for role in Role::BOTH {
            if self.companions[role].is_none() && self.clocks[role].started <= self.t {
                if role == Role::J {
                    self.observer.j_fault_at = Some(self.t);
                }
                let flown = self.case.flown();
                let service = service(role, self.boots, NUMBERED, LEASE, &flown);
                let mut born = Companion::new(role, self.clocks[role], service, &flown);
                // In flight it takes nothing over.
                (born.aborted, born.joining) = (Some("back in the air".into()), false);
                self.companions[role] = Some(born);
            }
        }
    }

    fn count(&mut self) {
        let observer = &mut self.observer;
        observer.seen.slots += 1;
        observer.seen.served += usize::from(observer.served_now);
        observer.served_now = false;
    }

    /// Counts the slots that I has behind it; starts the mission again after an abort.
    fn account(&mut self) {
        let finished =
            self.companions.i.as_mut().map(|i| std::mem::take(&mut i.finished)).unwrap_or_default();
        for _ in finished {
            self.count();
        }
        let aborted = |c: &Option<Companion>| c.as_ref().is_none_or(|c| c.aborted.is_some());
        let any = Role::BOTH.into_iter().any(|role| aborted(&self.companions[role]));
        match self.revive_at {
            None if any => {
                let causes = Role::BOTH.map(|role| {
                    let cause = self.companions[role].as_ref().and_then(|c| c.aborted.clone());
                    cause.map_or(String::new(), |cause| format!("{role}: {cause}"))
                });
                self.observer.seen.aborts.push(format!("{:.3} s {}", self.t.as_secs_f64(), causes.concat()));
                self.revive_at = Some(self.t + Duration::from_secs(4));
            }
            Some(at) if self.t >= at && self.companions.i.is_some() && self.companions.j.is_some() => {
                self.revive_at = None;
                let t = self.t;
                for role in Role::BOTH {
                    if let Some(companion) = self.companions[role].as_mut() {
                        companion.begin(t);
                    }
                }
            }
            _ => {}
        }
    }
}

/// The airtime of one slot.
pub const AIRTIME: Duration = Duration::from_secs(SLOT.as_secs() - GUARD.as_secs());
