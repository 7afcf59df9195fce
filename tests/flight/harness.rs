//! Two companions and the simulated world in one process and in virtual time: no socket, no sleep, no clock. Every
//! message crosses as bytes, through paths that can lose, delay and repeat it.

use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::companion::settings::{settings, transmitter_settings};
use veilwing::config::{Mission, Vehicle};
use veilwing::link::codec::{Decoder, Encoder};
use veilwing::link::counters::Counters;
use veilwing::mission::{Executive, Outcome, Outgoing};
use veilwing::pair::wire;
use veilwing::planner::slots::{Plan, PlannedSlot};
use veilwing::planner::{Options, plan_slot};
use veilwing::role::{PerVehicle, Role};
use veilwing::simulation::world_config;
use veilwing::time::Instant;
use veilwing::transmitter::Transmitter;
use veilwing_sitl::{Fault, FlightReport, World};

/// The harness's step: finer than the 2.5 ms of the world and the 20 ms of the companions.
pub const STEP: Duration = Duration::from_millis(1);
/// No flight of the small mission takes longer, faults included.
pub const LONGEST: Duration = Duration::from_secs(300);
/// Everything is silent so long after a companion's death or a link's: the lease of 500 ms, and 50 ms for one tick of
/// the survivor (20 ms), the way of its command (20 ms) and the wire.
pub const LEASE_AND_MARGIN: Duration = Duration::from_millis(550);
/// S4's reaction to what is seen on the wire.
pub const REACTION: Duration = Duration::from_millis(100);

/// Low, near and short.
pub const MISSION: &str = include_str!("yard.toml");

/// A mission and its plan.
#[derive(Debug, Clone)]
pub struct Planned {
    pub mission: Mission,
    pub plan: Plan,
}

pub fn planned(text: &str) -> Planned {
    let mission = Mission::parse("test.toml", text).unwrap();
    let options = Options { method: mission.planner.method, seed: mission.seed, ..Options::default() };
    let slots = mission.users.iter().enumerate().map(|(k, user)| PlannedSlot {
        user: user.name.clone(),
        plan: plan_slot(&mission.problem(k).unwrap(), &options).unwrap(),
    });
    let plan = Plan::new(slots.collect());
    Planned { mission, plan }
}

/// The small mission, planned once.
pub fn yard() -> &'static Planned {
    static YARD: OnceLock<Planned> = OnceLock::new();
    YARD.get_or_init(|| planned(MISSION))
}

pub fn vehicle_file(role: Role, simulated: bool) -> Vehicle {
    let name = role.to_string().to_lowercase();
    let system = 1 + index(role);
    let text = format!(
        "[vehicle]\nrole = \"{name}\"\n[autopilot]\nlink = \"udpout:127.0.0.1:1\"\nactuation = \"pose\"\n\
         system_id = {system}\n[transmitter]\nkind = \"leased\"\nsimulated = {simulated}\n\
         [pair]\nlink = \"udpout:127.0.0.1:2\"\n"
    );
    Vehicle::parse("vehicle.toml", &text).unwrap()
}

pub const fn index(role: Role) -> usize {
    match role {
        Role::I => 0,
        Role::J => 1,
    }
}

/// How a path treats its datagrams.
#[derive(Debug, Clone, Copy)]
pub struct Path {
    /// Probability that one is lost.
    pub loss: f64,
    /// Probability that one arrives twice.
    pub duplication: f64,
    pub delay: Duration,
    /// Uniform addition to the delay of each: they may overtake one another.
    pub spread: Duration,
}

impl Path {
    pub const GOOD: Self = Self { loss: 0.0, duplication: 0.0, delay: STEP, spread: Duration::ZERO };
    pub const CUT: Self = Self { loss: 1.0, ..Self::GOOD };
}

struct Pipe {
    path: Path,
    rng: ChaCha8Rng,
    /// By arrival and, for those of one instant, by departure.
    under_way: BTreeMap<(Duration, u64), Vec<u8>>,
    sent: u64,
}

impl Pipe {
    fn new(path: Path, seed: u64) -> Self {
        Self { path, rng: ChaCha8Rng::seed_from_u64(seed), under_way: BTreeMap::new(), sent: 0 }
    }

    fn send(&mut self, bytes: &[u8], now: Duration) {
        let copies = 1 + u8::from(self.rng.random::<f64>() < self.path.duplication);
        for _ in 0..copies {
            let extra = self.path.spread.mul_f64(self.rng.random::<f64>());
            if self.rng.random::<f64>() >= self.path.loss {
                self.sent += 1;
                self.under_way.insert((now + self.path.delay + extra, self.sent), bytes.to_vec());
            }
        }
    }

    fn receive(&mut self, now: Duration) -> Option<Vec<u8>> {
        let first = self.under_way.first_entry()?;
        (first.key().0 <= now).then(|| first.remove())
    }
}

struct Companion {
    executive: Executive,
    encoder: Encoder,
    from_vehicle: Decoder<MavMessage>,
    from_peer: Decoder<wire::MavMessage>,
    counters: Counters,
    /// Simulation time at which its own time began: the two processes do not start together.
    began: Duration,
}

impl Companion {
    fn instant(&self, now: Duration) -> Instant {
        instant(self.began, now)
    }
}

/// The instant of `now` on the clock of a process that began at `began`. A process's time does not begin at zero either.
fn instant(began: Duration, now: Duration) -> Instant {
    Instant::from_start(now.saturating_sub(began) + Duration::from_secs(1))
}

/// What a flight left behind, all in simulation time.
#[derive(Debug, Default)]
pub struct Log {
    /// What the companions said.
    pub notices: Vec<(Duration, Role, String)>,
    /// Setpoints that left a companion.
    pub setpoints: PerVehicle<Vec<Duration>>,
    /// Off commands that left a companion.
    pub offs: PerVehicle<Vec<Duration>>,
    /// Position and attitude as they reached a companion: the latest of the two.
    pub last_state: PerVehicle<Duration>,
    /// Health and mode as they reached a companion.
    pub health: Vec<(Duration, Role, MavMessage)>,
    /// Acknowledgements of commands to a companion.
    pub acks: Vec<(Duration, Role, MavMessage)>,
    /// Changes of what is on the air.
    pub on_air: Vec<(Duration, [bool; 2])>,
}

/// Deviations from the plain flight.
#[derive(Debug, Clone)]
pub struct Setup {
    /// What each companion was given.
    pub given: PerVehicle<Planned>,
    pub simulated: bool,
    pub start_unasked: bool,
    pub pair: Path,
    pub seed: u64,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            given: PerVehicle { i: yard().clone(), j: yard().clone() },
            simulated: true,
            start_unasked: true,
            pair: Path::GOOD,
            seed: 1,
        }
    }
}

pub struct Flight {
    setup: Setup,
    pub world: World,
    companions: PerVehicle<Option<Companion>>,
    pub outcomes: PerVehicle<Option<Outcome>>,
    to_vehicle: PerVehicle<Pipe>,
    to_companion: PerVehicle<Pipe>,
    /// By sender.
    pair: PerVehicle<Pipe>,
    station: Encoder,
    pub log: Log,
    pub now: Duration,
}

impl Flight {
    pub fn new(setup: Setup) -> Self {
        let leader = &setup.given.i;
        let mut config = world_config(&leader.mission, &leader.plan).unwrap();
        config.seed = setup.seed;
        let pipe = |path, stream: u64| move |role| Pipe::new(path, 1000 * stream + index(role) as u64);
        let mut flight = Self {
            world: World::new(config).unwrap(),
            companions: PerVehicle { i: None, j: None },
            outcomes: PerVehicle { i: None, j: None },
            to_vehicle: PerVehicle::from_fn(pipe(Path::GOOD, 1)),
            to_companion: PerVehicle::from_fn(pipe(Path::GOOD, 2)),
            pair: PerVehicle::from_fn(pipe(setup.pair, 3 + setup.seed)),
            station: Encoder::default(),
            log: Log::default(),
            now: Duration::ZERO,
            setup,
        };
        for role in Role::BOTH {
            flight.start(role, 100 + index(role) as u32);
        }
        flight
    }

    /// Starts a companion process, with its plan made.
    pub fn start(&mut self, role: Role, boot_id: u32) {
        let given = &self.setup.given[role];
        let vehicle = vehicle_file(role, self.setup.simulated);
        let settings = settings(&given.mission, &vehicle, boot_id, self.setup.start_unasked);
        // J's clock reads 7 s when I's reads 1 s.
        let began = self.now.saturating_sub(Duration::from_secs(6 * index(role) as u64));
        let started = instant(began, self.now);
        let mut companion = Companion {
            executive: Executive::new(
                settings,
                Transmitter::new(transmitter_settings(&vehicle), started),
                started,
            ),
            encoder: Encoder::default(),
            from_vehicle: Decoder::default(),
            from_peer: Decoder::default(),
            counters: Counters::default(),
            began,
        };
        companion.executive.handle_plan(given.plan.clone());
        self.companions[role] = Some(companion);
        self.outcomes[role] = None;
    }

    /// SIGKILL.
    pub fn kill(&mut self, role: Role) {
        self.companions[role] = None;
        self.world.inject(Fault::CompanionLost { vehicle: index(role) });
    }

    /// SIGTERM.
    pub fn stop(&mut self, role: Role) {
        let now = self.now;
        if let Some(companion) = &mut self.companions[role] {
            let at = companion.instant(now);
            companion.executive.shutdown(at);
        }
    }

    /// A ground station's command to the companion, through the vehicle's link.
    pub fn command(&mut self, role: Role, command: MavCmd) {
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command,
            target_system: 1 + index(role) as u8,
            target_component: 191,
            ..COMMAND_LONG_DATA::DEFAULT
        });
        let frame = self.station.encode((255, 190), &message);
        self.to_companion[role].send(frame.raw_bytes(), self.now);
    }

    pub fn pair_path(&mut self, from: Role, path: Path) {
        self.pair[from].path = path;
    }

    pub fn radiating(&self) -> [bool; 2] {
        self.log.on_air.last().map_or([false; 2], |(_, on)| *on)
    }

    /// Flies until `done`, or to `LONGEST`. Whether it was done.
    pub fn until(&mut self, mut done: impl FnMut(&Self) -> bool) -> bool {
        while self.now < LONGEST {
            if done(self) {
                return true;
            }
            self.step();
        }
        false
    }

    pub fn pass(&mut self, time: Duration) {
        let end = self.now + time;
        self.until(|flight| flight.now >= end);
    }

    /// Flies until every companion that lives has ended, and a second more for what is still on the air.
    pub fn fly_out(&mut self) {
        assert!(
            self.until(|f| Role::BOTH.into_iter().all(|r| f.companions[r].is_none())),
            "{}",
            self.story()
        );
        let end = self.now + Duration::from_secs(1);
        while self.now < end {
            self.step();
        }
    }

    fn step(&mut self) {
        self.now += STEP;
        for role in Role::BOTH {
            self.step_companion(role);
        }
        for role in Role::BOTH {
            while let Some(bytes) = self.to_vehicle[role].receive(self.now) {
                self.world.handle(index(role), 0, &bytes);
            }
        }
        self.world.advance(self.now);
        while let Some((vehicle, _, frame)) = self.world.poll_transmit() {
            self.to_companion[Role::BOTH[vehicle]].send(&frame, self.now);
        }
        let on = self.world.snapshot().vehicles.map(|vehicle| vehicle.tx_power_w.is_some());
        if on != self.radiating() {
            self.log.on_air.push((self.now, on));
        }
    }

    fn step_companion(&mut self, role: Role) {
        let now = self.now;
        let Some(mut companion) = self.companions[role].take() else {
            // Nobody listens.
            while self.to_companion[role].receive(now).is_some() {}
            while self.pair[role.peer()].receive(now).is_some() {}
            return;
        };
        let at = companion.instant(now);
        while let Some(bytes) = self.to_companion[role].receive(now) {
            companion.from_vehicle.feed(&bytes);
            companion.from_vehicle.end();
            while let Some(raw) = companion.from_vehicle.next_frame(&mut companion.counters) {
                let frame = raw.parse::<MavMessage>().unwrap();
                self.log.note_received(role, frame.header, &frame.message, now);
                companion.executive.handle_autopilot(frame.header, &frame.message, at);
                self.send(role, &mut companion);
            }
        }
        while let Some(bytes) = self.pair[role.peer()].receive(now) {
            companion.from_peer.feed(&bytes);
            companion.from_peer.end();
            while let Some(raw) = companion.from_peer.next_frame(&mut companion.counters) {
                let frame = raw.parse::<wire::MavMessage>().unwrap();
                companion.executive.handle_pair(&frame.message, at);
                self.send(role, &mut companion);
            }
        }
        let mut rounds = 0;
        while companion.executive.poll_timeout().0 <= at {
            companion.executive.handle_timeout(at);
            self.send(role, &mut companion);
            rounds += 1;
            assert!(
                rounds < 100,
                "{role} has something to do for ever: {:?}",
                companion.executive.poll_timeout()
            );
        }
        self.outcomes[role] = companion.executive.outcome(at);
        if self.outcomes[role].is_none() {
            self.companions[role] = Some(companion);
        } else {
            assert_eq!(companion.counters.rejected.total(), 0, "{role}: {}", companion.counters);
        }
    }

    fn send(&mut self, role: Role, companion: &mut Companion) {
        let now = self.now;
        let own = (1 + index(role) as u8, 191);
        while let Some(outgoing) = companion.executive.poll_transmit() {
            match outgoing {
                Outgoing::Autopilot(message) => {
                    self.log.note_sent(role, &message, now);
                    let frame = companion.encoder.encode(own, &*message);
                    self.to_vehicle[role].send(frame.raw_bytes(), now);
                }
                Outgoing::Pair(message) => {
                    let frame = companion.encoder.encode(own, &*message);
                    self.pair[role].send(frame.raw_bytes(), now);
                }
            }
        }
        while let Some(notice) = companion.executive.poll_notice() {
            self.log.notices.push((now, role, notice.text));
        }
    }

    pub fn report(&self) -> FlightReport {
        self.world.report()
    }

    /// When `role` first said something with `text` in it.
    pub fn said(&self, role: Role, text: &str) -> Option<Duration> {
        self.log.notices.iter().find(|(_, who, what)| *who == role && what.contains(text)).map(|(at, ..)| *at)
    }

    pub fn landed(&self, role: Role) -> bool {
        let vehicle = &self.world.snapshot().vehicles[index(role)];
        vehicle.landed && !vehicle.armed
    }

    /// Time from `since` until the transmitter of `role` is off and stays off; zero if it was off.
    pub fn silent_after(&self, role: Role, since: Duration) -> Duration {
        let k = index(role);
        let before = self.log.on_air.iter().rev().find(|(at, _)| *at <= since).is_some_and(|(_, on)| on[k]);
        let later = self.log.on_air.iter().filter(|(at, _)| *at > since);
        let mut on = before;
        let mut off_at = since;
        for (at, now_on) in later {
            if on && !now_on[k] {
                off_at = *at;
            }
            on = now_on[k];
        }
        assert!(!on, "{role} still radiates\n{}", self.story());
        off_at - since
    }

    /// Everything said, for failures.
    pub fn story(&self) -> String {
        use std::fmt::Write as _;
        let mut text = String::new();
        for (at, role, what) in &self.log.notices {
            writeln!(text, "[{:8.3}] {role}  {what}", at.as_secs_f64()).unwrap();
        }
        for (at, on) in &self.log.on_air {
            writeln!(text, "[{:8.3}] on the air: {on:?}", at.as_secs_f64()).unwrap();
        }
        for (k, vehicle) in self.world.snapshot().vehicles.iter().enumerate() {
            writeln!(
                text,
                "{} {:?} {} landed {} armed {}",
                Role::BOTH[k],
                vehicle.position_enu_m,
                vehicle.mode,
                vehicle.landed,
                vehicle.armed
            )
            .unwrap();
        }
        writeln!(text, "outcomes {:?}\n{:#?}", self.outcomes, self.report()).unwrap();
        text
    }

    /// No invariant was broken, and I never radiated without J.
    pub fn assert_safe(&self) {
        self.assert_safe_but(Duration::ZERO);
    }

    /// The same, but for `unprotected` in a slot: a jammer torn out of its pose needs S4's reaction to fall silent.
    pub fn assert_safe_but(&self, unprotected: Duration) {
        let report = self.report();
        assert_eq!(report.violations, vec![], "{}", self.story());
        assert_eq!(report.outside_slots_s.i + report.outside_slots_s.j, 0.0, "{}", self.story());
        for slot in &report.slots {
            assert!(slot.unprotected_s <= unprotected.as_secs_f64(), "{}", self.story());
        }
    }
}

impl Log {
    fn note_received(&mut self, role: Role, header: MavHeader, message: &MavMessage, now: Duration) {
        match message {
            MavMessage::LOCAL_POSITION_NED(_) | MavMessage::ATTITUDE_QUATERNION(_) => {
                self.last_state[role] = now
            }
            MavMessage::HEARTBEAT(_) if header.component_id != 1 => {}
            MavMessage::HEARTBEAT(_) | MavMessage::ESTIMATOR_STATUS(_) | MavMessage::SYS_STATUS(_) => {
                self.health.push((now, role, message.clone()));
            }
            _ => {}
        }
    }

    fn note_sent(&mut self, role: Role, message: &MavMessage, now: Duration) {
        match message {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)
            | MavMessage::SET_POSITION_TARGET_GLOBAL_INT(_)
            | MavMessage::SET_ATTITUDE_TARGET(_) => self.setpoints[role].push(now),
            MavMessage::COMMAND_INT(c) if c.command == MavCmd::MAV_CMD_USER_1 && c.y <= 0 => {
                self.offs[role].push(now);
            }
            MavMessage::COMMAND_ACK(_) => self.acks.push((now, role, message.clone())),
            _ => {}
        }
    }
}
