//! Flights of the tests: the pair in the simulated world, in virtual time (`veilwing::desk::simulation`), with a log of
//! everything that the tests look at.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage, MavParamType, PARAM_SET_DATA};
use veilwing::autopilot::{Actuation, FenceDuty};
use veilwing::config::{BatteryDraft, Mission, MissionDraft, Vehicle};
use veilwing::desk::simulation::{self, Given, Observer, on_this_machine, vehicle_draft, world_config};
pub use veilwing::desk::simulation::{Path, index};
use veilwing::geo::Enu;
use veilwing::link::codec::Encoder;
use veilwing::mission::{Notice, Outgoing};
use veilwing::planner::slots::Plan;
use veilwing::planning;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::{
    Firmware, FlightReport, RadioDevice, RadioPlace, Reporter, Slip, Tolerance, Traps, World,
};

/// No flight takes longer, faults and gales included.
pub const LONGEST: Duration = Duration::from_secs(600);
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

impl Planned {
    pub fn new(mission: Mission) -> Self {
        let plan = planning::plan(&mission).unwrap();
        Self { mission, plan }
    }

    /// The same plan under a mission of which something else was changed.
    pub fn under(&self, change: impl FnOnce(&mut MissionDraft)) -> Self {
        Self { mission: self.mission.changed(change).unwrap(), plan: self.plan.clone() }
    }
}

/// The small mission, planned once.
pub fn yard() -> &'static Planned {
    static YARD: OnceLock<Planned> = OnceLock::new();
    YARD.get_or_init(|| Planned::new(Mission::parse("yard.toml", MISSION).unwrap()))
}

fn vehicle(mission: &Mission, role: Role, setup: &Setup) -> Vehicle {
    let mut draft = vehicle_draft(mission, role, [1, 2]);
    if setup.bridged == Some(role) {
        draft.autopilot.actuation = Actuation::Pose;
    }
    let (simulated, tunnel) = (setup.simulated, setup.tunnel[role]);
    draft.transmitter.simulated = simulated;
    draft.transmitter.link = setup.radio_apart.then(|| on_this_machine(3));
    draft.transmitter.accept_orphaned_radio = setup.accept_orphaned_radio;
    draft.pair_tunnel = tunnel;
    draft.autopilot.fence = setup.fence[role];
    draft.battery = setup.battery.unwrap_or(draft.battery);
    // Nothing is signed in virtual time; what is at stake here is the mission's leave, not the links'.
    draft.autopilot.key_file = (!simulated).then(|| "autopilot.key".into());
    draft.transmitter.key_file = (!simulated && setup.radio_apart).then(|| "radio.key".into());
    draft.pair_peer_system = tunnel.then(|| 1 + index(role.peer()) as u8);
    Vehicle::new(draft).unwrap()
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
    /// What the companions said of fences and rally points.
    pub plans: Vec<(Duration, Role, MavMessage)>,
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
    /// Each radio has a link of its own.
    pub radio_apart: bool,
    /// Both accept a radio that goes on when its host dies.
    pub accept_orphaned_radio: bool,
    /// What the radios' devices are.
    pub devices: PerVehicle<RadioDevice>,
    /// Whose pair messages ride in TUNNEL.
    pub tunnel: PerVehicle<bool>,
    /// What becomes of the fence in each autopilot.
    pub fence: PerVehicle<FenceDuty>,
    /// What both companions are told of their batteries; `None`: what is true.
    pub battery: Option<BatteryDraft>,
    pub pair: Path,
    /// An ArduCopter of the 6DoF frame, whose bridge script dies of a burst of commands.
    pub bridged: Option<Role>,
    /// The manners of both autopilots.
    pub traps: Traps,
    /// A slip planted in what a vehicle's autopilot hears.
    pub slip: Option<(Role, Slip)>,
    /// By how much both vehicles jitter, in degrees, where that is not what the mission says.
    pub jitter_deg: Option<f64>,
    /// Nobody says where those are that move.
    pub unheard: bool,
    /// How high above the mission's origin both stand before the flight, in metres.
    pub roof_m: f64,
    pub seed: u64,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            given: PerVehicle { i: yard().clone(), j: yard().clone() },
            simulated: true,
            start_unasked: true,
            radio_apart: false,
            accept_orphaned_radio: false,
            devices: PerVehicle::default(),
            tunnel: PerVehicle::default(),
            fence: PerVehicle::default(),
            battery: None,
            pair: Path::GOOD,
            bridged: None,
            traps: Traps::default(),
            slip: None,
            jitter_deg: None,
            unheard: false,
            roof_m: 0.0,
            seed: 1,
        }
    }
}

/// A flight and its log.
pub struct Flight {
    flight: simulation::Flight,
    station: Encoder,
    pub log: Log,
    pub now: Duration,
}

impl Deref for Flight {
    type Target = simulation::Flight;

    fn deref(&self) -> &simulation::Flight {
        &self.flight
    }
}

impl DerefMut for Flight {
    fn deref_mut(&mut self) -> &mut simulation::Flight {
        &mut self.flight
    }
}

impl Flight {
    pub fn new(setup: Setup) -> Self {
        let leader = &setup.given.i;
        let mut config = world_config(&leader.mission, &leader.plan).unwrap();
        config.seed = setup.seed;
        config.vehicles.iter_mut().for_each(|vehicle| vehicle.traps = setup.traps);
        if let Some((role, slip)) = setup.slip {
            config.vehicles[index(role)].slip = Some(slip);
        }
        if let Some(deg) = setup.jitter_deg {
            config.jitter.std_deg = deg;
            config.tolerance = Tolerance::under_jitter(deg);
        }
        if setup.unheard {
            let all = config.users.iter_mut().chain(&mut config.eavesdroppers);
            all.filter_map(|node| node.roams.as_mut())
                .for_each(|roams| roams.reporter = Reporter::Handset(99));
        }
        if let Some(role) = setup.bridged {
            let vehicle = &mut config.vehicles[index(role)];
            vehicle.firmware = Firmware::ArduCopter;
            vehicle.traps.script_dies_of_bursts = true;
        }
        for role in Role::BOTH {
            let vehicle = &mut config.vehicles[index(role)];
            vehicle.radio_device = setup.devices[role];
            vehicle.home_enu_m[2] = setup.roof_m;
            if setup.radio_apart {
                vehicle.radio_place = RadioPlace::OnItsOwn;
            }
        }
        let bridged = setup.bridged;
        let given = PerVehicle::from_fn(|role| {
            let Planned { mission, plan } = setup.given[role].clone();
            let vehicle = vehicle(&mission, role, &setup);
            Arc::new(Given { mission, plan, vehicle })
        });
        let setup = simulation::Setup {
            given,
            start_unasked: setup.start_unasked,
            autopilot: Path::GOOD,
            pair: setup.pair,
            seed: setup.seed,
        };
        let mut flight = Self {
            flight: simulation::Flight::new(World::new(config).unwrap(), setup),
            station: Encoder::default(),
            log: Log::default(),
            now: Duration::ZERO,
        };
        if let Some(role) = bridged {
            flight.set_autopilot(role, "FRAME_CLASS", 16.0);
        }
        flight
    }

    fn set_autopilot(&mut self, role: Role, name: &str, value: f32) {
        let set = PARAM_SET_DATA {
            param_value: value,
            target_system: 1 + index(role) as u8,
            target_component: 1,
            param_id: name.into(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        };
        self.tell_autopilot(role, &MavMessage::PARAM_SET(set));
    }

    /// A ground station's command to the companion, through the vehicle's link.
    pub fn command(&mut self, role: Role, command: MavCmd) {
        self.command_with(role, command, 0.0);
    }

    pub fn command_with(&mut self, role: Role, command: MavCmd, param1: f32) {
        self.command_to((255, 190), (1 + index(role) as u8, 191), role, (command, param1));
    }

    /// The same, addressed to all.
    pub fn command_all(&mut self, role: Role, command: MavCmd, param1: f32) {
        self.command_to((255, 190), (0, 0), role, (command, param1));
    }

    /// The same of anybody.
    pub fn command_from(&mut self, from: (u8, u8), role: Role, command: MavCmd) {
        self.command_to(from, (1 + index(role) as u8, 191), role, (command, 0.0));
    }

    fn command_to(&mut self, from: (u8, u8), to: (u8, u8), role: Role, (command, param1): (MavCmd, f32)) {
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command,
            param1,
            target_system: to.0,
            target_component: to.1,
            ..COMMAND_LONG_DATA::DEFAULT
        });
        let frame = self.station.encode(from, &message);
        self.send_to_companion(role, frame.raw_bytes());
    }

    /// Anybody writes a parameter of the companion's.
    pub fn write_from(&mut self, from: (u8, u8), role: Role, name: &str, value: f32) {
        let message = MavMessage::PARAM_SET(PARAM_SET_DATA {
            param_value: value,
            target_system: 1 + index(role) as u8,
            target_component: 191,
            param_id: name.into(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        });
        let frame = self.station.encode(from, &message);
        self.send_to_companion(role, frame.raw_bytes());
    }

    /// A ground station's message to the autopilot.
    pub fn tell_autopilot(&mut self, role: Role, message: &MavMessage) {
        let frame = self.station.encode((255, 190), message);
        self.world.handle(index(role), 0, frame.raw_bytes());
    }

    /// Ordinary commands of a ground station to the autopilot, all at once.
    pub fn burst(&mut self, role: Role, count: usize) {
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
            param1: 242.0,
            target_system: 1 + index(role) as u8,
            target_component: 1,
            ..COMMAND_LONG_DATA::DEFAULT
        });
        (0..count).for_each(|_| self.tell_autopilot(role, &message));
    }

    /// Flies until `done`, or to `LONGEST`. Whether it was done.
    pub fn until(&mut self, done: impl FnMut(&Self) -> bool) -> bool {
        self.until_or(LONGEST, done)
    }

    fn until_or(&mut self, limit: Duration, mut done: impl FnMut(&Self) -> bool) -> bool {
        while self.now < limit {
            if done(self) {
                return true;
            }
            self.flight.step(limit, &mut self.log).unwrap();
            self.now = self.flight.now();
        }
        done(self)
    }

    pub fn pass(&mut self, time: Duration) {
        self.until_or(self.now + time, |_| false);
    }

    /// Flies until every companion that lives has ended, and a second more for what is still on the air.
    pub fn fly_out(&mut self) {
        assert!(
            self.until(|flight| Role::BOTH.into_iter().all(|role| !flight.lives(role))),
            "{}",
            self.story()
        );
        self.pass(Duration::from_secs(1));
        for role in Role::BOTH {
            assert_eq!(self.counters(role).rejected.total(), 0, "{role}: {}", self.counters(role));
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

    /// Half a second after an order both are silent for good, and they land.
    pub fn assert_goes_home(&mut self) {
        self.pass(Duration::from_millis(500));
        let since = self.now;
        self.fly_out();
        self.assert_safe();
        assert!(self.log.on_air.iter().all(|(at, on)| *at < since || *on == [false, false]));
        assert!(Role::BOTH.iter().all(|role| self.landed(*role)), "{}", self.story());
    }

    /// Where a vehicle truly is.
    pub fn place(&self, role: Role) -> Enu {
        Enu::from(self.world.snapshot().vehicles[index(role)].position_enu_m)
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

/// Both have begun the slot of this number of the demonstration's two users, and radiate.
pub fn on_the_air(setup: Setup, slot: usize) -> Flight {
    let mut flight = Flight::new(setup);
    let text = format!("slot {slot} for {}: agreed", ["alpha", "bravo"][slot % 2]);
    assert!(flight.until(|flight| Role::BOTH.iter().all(|role| flight.said(*role, &text).is_some())));
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    flight
}

/// In mid-slot, both tilted: they have radiated for half a second.
pub fn in_mid_slot(setup: Setup) -> Flight {
    let mut flight = Flight::new(setup);
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
    flight.pass(Duration::from_millis(500));
    flight
}

impl Observer for Log {
    fn said(&mut self, at: Duration, role: Role, _phase: Option<&'static str>, notice: &Notice) {
        self.notices.push((at, role, notice.to_string()));
    }

    fn sent(&mut self, at: Duration, role: Role, message: &Outgoing) {
        let (Outgoing::Autopilot(message) | Outgoing::Radio(message)) = message else { return };
        match &**message {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)
            | MavMessage::SET_POSITION_TARGET_GLOBAL_INT(_)
            | MavMessage::SET_ATTITUDE_TARGET(_) => self.setpoints[role].push(at),
            MavMessage::COMMAND_INT(c) if c.command == MavCmd::MAV_CMD_USER_1 && c.y <= 0 => {
                self.offs[role].push(at);
            }
            message @ MavMessage::COMMAND_ACK(_) => self.acks.push((at, role, message.clone())),
            message @ (MavMessage::MISSION_COUNT(_)
            | MavMessage::MISSION_ITEM_INT(_)
            | MavMessage::MISSION_REQUEST_LIST(_)
            | MavMessage::MISSION_REQUEST_INT(_)) => self.plans.push((at, role, message.clone())),
            _ => {}
        }
    }

    fn received(&mut self, at: Duration, role: Role, header: MavHeader, message: &MavMessage) {
        match message {
            MavMessage::LOCAL_POSITION_NED(_) | MavMessage::ATTITUDE_QUATERNION(_) => {
                self.last_state[role] = at;
            }
            MavMessage::HEARTBEAT(_) if header.component_id != 1 => {}
            MavMessage::HEARTBEAT(_) | MavMessage::ESTIMATOR_STATUS(_) | MavMessage::SYS_STATUS(_) => {
                self.health.push((at, role, message.clone()));
            }
            _ => {}
        }
    }

    fn on_air(&mut self, at: Duration, on: [bool; 2]) {
        self.on_air.push((at, on));
    }
}
