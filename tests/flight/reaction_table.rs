//! S4 as a table: faults injected at every phase of a vehicle's time on the air, and how long each took from the event
//! on the wire to the power-off command on the wire. In virtual time: a message takes as long as its path, the
//! companion's own computing takes nothing.

use std::fmt::{self, Write as _};
use std::sync::Arc;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{EstimatorStatusFlags, MavCmd, MavMessage, MavSysStatusSensor};
use veilwing::desk::simulation::{Flight, Given, Observer, Path, Setup, index, vehicle, world_config};
use veilwing::mission::Outgoing;
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::{Fault, World};

/// S4.
pub const BOUND: Duration = Duration::from_millis(100);
/// The longest flight that is waited for.
const LONGEST: Duration = Duration::from_secs(300);
/// After a fault, longer than the slowest heartbeat and any reaction.
const WATCHED: Duration = Duration::from_millis(2500);

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    ModeChange,
    EstimatorFailure,
    LinkLoss,
}

impl Kind {
    pub const ALL: [Self; 3] = [Self::ModeChange, Self::EstimatorFailure, Self::LinkLoss];

    fn name(self) -> &'static str {
        match self {
            Self::ModeChange => "mode change by the pilot",
            Self::EstimatorFailure => "estimator failure",
            Self::LinkLoss => "autopilot link lost",
        }
    }

    fn fault(self, role: Role) -> Fault {
        let vehicle = index(role);
        match self {
            Self::ModeChange => Fault::PilotMode { vehicle },
            Self::EstimatorFailure => Fault::EstimatorFailure { vehicle },
            Self::LinkLoss => Fault::LinkLoss { vehicle, on: true },
        }
    }
}

/// One injected fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reaction {
    pub kind: Kind,
    pub role: Role,
    /// Tenth of the vehicle's time on the air in its slot, 0 to 9.
    pub phase: usize,
    /// From the fault itself to the first sign of it on the wire.
    pub shown_after: Duration,
    /// From that sign to the off command; `None` if none came.
    pub off_after: Option<Duration>,
    /// The vehicle went on the air again after its off.
    pub on_again: bool,
}

/// Notes when a fault shows and when off is commanded.
#[derive(Default)]
struct Watch {
    on_air: Vec<(Duration, [bool; 2])>,
    /// Faults are looked for from here on.
    since: Option<(Duration, Role, Kind)>,
    mode: PerVehicle<Option<u32>>,
    last_state: PerVehicle<Option<Duration>>,
    shown: Option<Duration>,
    off: Option<Duration>,
    on_again: bool,
}

impl Watch {
    fn shows(&self, role: Role, kind: Kind, message: &MavMessage) -> bool {
        match (kind, message) {
            (Kind::ModeChange, MavMessage::HEARTBEAT(m)) => Some(m.custom_mode) != self.mode[role],
            (Kind::EstimatorFailure, MavMessage::ESTIMATOR_STATUS(m)) => {
                !m.flags.contains(EstimatorStatusFlags::ESTIMATOR_POS_HORIZ_ABS)
            }
            (Kind::EstimatorFailure, MavMessage::SYS_STATUS(m)) => {
                !m.onboard_control_sensors_health.contains(MavSysStatusSensor::MAV_SYS_STATUS_AHRS)
            }
            _ => false,
        }
    }
}

impl Observer for Watch {
    fn received(&mut self, at: Duration, role: Role, header: MavHeader, message: &MavMessage) {
        let from_autopilot = header.component_id == 1;
        match self.since {
            Some((_, who, kind)) if who == role && from_autopilot => {
                if self.shown.is_none() && self.shows(role, kind, message) {
                    self.shown = Some(at);
                }
            }
            Some(_) => {}
            None => {
                if let (MavMessage::HEARTBEAT(m), true) = (message, from_autopilot) {
                    self.mode[role] = Some(m.custom_mode);
                }
            }
        }
        if matches!(message, MavMessage::LOCAL_POSITION_NED(_) | MavMessage::ATTITUDE_QUATERNION(_)) {
            self.last_state[role] = Some(at);
        }
    }

    fn sent(&mut self, at: Duration, role: Role, message: &Outgoing) {
        let Some((since, who, _)) = self.since else { return };
        let Outgoing::Autopilot(message) = message else { return };
        if let MavMessage::COMMAND_INT(c) = &**message
            && c.command == MavCmd::MAV_CMD_USER_1
            && who == role
            && at >= since
        {
            if c.y <= 0 {
                self.off.get_or_insert(at);
            } else {
                self.on_again |= self.off.is_some();
            }
        }
    }

    fn on_air(&mut self, at: Duration, on: [bool; 2]) {
        self.on_air.push((at, on));
    }
}

/// What every flight starts from.
#[derive(Clone)]
pub struct Base {
    given: PerVehicle<Arc<Given>>,
    /// Of each vehicle, in a flight without faults: every time on the air.
    on_air: PerVehicle<Vec<[Duration; 2]>>,
}

impl Base {
    pub fn new(planned: &Given) -> Self {
        let given = PerVehicle::from_fn(|role| {
            let vehicle = vehicle(&planned.mission, role).expect("the simulated vehicle's file");
            Arc::new(Given { vehicle, ..planned.clone() })
        });
        let mut base = Self { given, on_air: PerVehicle::default() };
        let (mut flight, mut watch) = (base.flight(), Watch::default());
        while Role::BOTH.iter().any(|role| flight.outcomes[*role].is_none()) {
            assert!(flight.now() < LONGEST, "the flight without faults does not end");
            flight.step(LONGEST, &mut watch).expect("a companion that runs");
        }
        base.on_air = PerVehicle::from_fn(|role| {
            let mut spans: Vec<[Duration; 2]> = Vec::new();
            let mut since = None;
            for (at, on) in &watch.on_air {
                match (since, on[index(role)]) {
                    (None, true) => since = Some(*at),
                    (Some(from), false) => {
                        spans.push([from, *at]);
                        since = None;
                    }
                    _ => {}
                }
            }
            spans
        });
        base
    }

    fn flight(&self) -> Flight {
        let leader = &self.given.i;
        let config = world_config(&leader.mission, &leader.plan).expect("a world of the mission");
        let setup = Setup {
            given: self.given.clone(),
            start_unasked: true,
            autopilot: Path::GOOD,
            pair: Path::GOOD,
            seed: 1,
        };
        Flight::new(World::new(config).expect("a world"), setup)
    }

    /// The `number`-th of `count` faults: kinds and vehicles in turn, times spread evenly over the time on the air.
    pub fn inject(&self, number: usize, count: usize) -> Reaction {
        let kind = Kind::ALL[number % 3];
        let role = Role::BOTH[number / 3 % 2];
        let spans = &self.on_air[role];
        let of_kind = count.div_ceil(6);
        let share = (number / 6) as f64 / of_kind as f64;
        let place = share * spans.len() as f64;
        let [from, to] = spans[place as usize];
        // The last two milliseconds of a slot are its own off.
        let in_span = place.fract();
        let at = from + (to - from - Duration::from_millis(2)).mul_f64(in_span);
        let (mut flight, mut watch) = (self.flight(), Watch::default());
        while flight.now() < at {
            flight.step(at, &mut watch).expect("a companion that runs");
        }
        let last_state = watch.last_state[role].unwrap_or(at);
        watch.since = Some((at, role, kind));
        flight.world.inject(kind.fault(role));
        let end = at + WATCHED;
        while flight.now() < end {
            flight.step(end, &mut watch).expect("a companion that runs");
        }
        // A link that is cut shows when the next state is due and does not come: 20 ms after the last.
        let due = watch.last_state[role].unwrap_or(last_state).max(last_state) + Duration::from_millis(20);
        let shown = if kind == Kind::LinkLoss { Some(due) } else { watch.shown };
        let shown = shown.unwrap_or(at);
        Reaction {
            kind,
            role,
            phase: ((in_span * 10.0) as usize).min(9),
            shown_after: shown.saturating_sub(at),
            // A slot that ends by itself meanwhile is off before the fault shows.
            off_after: watch.off.map(|off| off.saturating_sub(shown)),
            on_again: watch.on_again,
        }
    }
}

/// All reactions, in order of their number whatever the threads.
pub fn table(base: &Base, count: usize, threads: usize) -> Table {
    let mut reactions = vec![None; count];
    std::thread::scope(|scope| {
        for (k, part) in reactions.chunks_mut(count.div_ceil(threads)).enumerate() {
            let first = k * count.div_ceil(threads);
            scope.spawn(move || {
                for (offset, reaction) in part.iter_mut().enumerate() {
                    *reaction = Some(base.inject(first + offset, count));
                }
            });
        }
    });
    Table(reactions.into_iter().flatten().collect())
}

/// See [`table`].
#[derive(Debug, PartialEq, Eq)]
pub struct Table(pub Vec<Reaction>);

impl Table {
    /// Reactions that took too long, never came, or did not last.
    pub fn beyond(&self) -> Vec<&Reaction> {
        let bad = |r: &&Reaction| r.on_again || r.off_after.is_none_or(|off| off > BOUND);
        self.0.iter().filter(bad).collect()
    }
}

fn median_and_worst(mut all: Vec<Duration>) -> (f64, f64) {
    all.sort_unstable();
    let ms = |d: Option<&Duration>| d.map_or(f64::NAN, |d| d.as_secs_f64() * 1e3);
    (ms(all.get(all.len() / 2)), ms(all.last()))
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = String::new();
        writeln!(
            text,
            "| fault | vehicle | faults | shows after, ms: median, worst | off after it shows, ms: median, worst | worst by tenth of the time on the air, ms |"
        )?;
        writeln!(text, "|---|---|---|---|---|---|")?;
        for kind in Kind::ALL {
            for role in Role::BOTH {
                let of: Vec<_> = self.0.iter().filter(|r| r.kind == kind && r.role == role).collect();
                let (shown, shown_worst) = median_and_worst(of.iter().map(|r| r.shown_after).collect());
                let (off, worst) = median_and_worst(of.iter().filter_map(|r| r.off_after).collect());
                let tenths = (0..10).map(|phase| {
                    let here = of.iter().filter(|r| r.phase == phase).filter_map(|r| r.off_after);
                    here.max().map_or("-".into(), |d| format!("{:.0}", d.as_secs_f64() * 1e3))
                });
                let tenths = tenths.collect::<Vec<_>>().join(" ");
                writeln!(
                    text,
                    "| {} | {role} | {} | {shown:.1}, {shown_worst:.1} | {off:.1}, {worst:.1} | {tenths} |",
                    kind.name(),
                    of.len()
                )?;
            }
        }
        write!(text, "{} faults, {} beyond {} ms", self.0.len(), self.beyond().len(), BOUND.as_millis())?;
        f.write_str(&text)
    }
}
