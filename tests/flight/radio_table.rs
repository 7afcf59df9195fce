//! Radio hosts and their devices under faults, as a table: for every kind of device, whatever befalls companion, host or device, of
//! either vehicle, at instants of its time on the air, how long the device radiated on, and what the world's judge and the
//! preflight say. In virtual time.

use std::fmt::{self, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use veilwing::config::{Emission, MissionDraft, Vehicle};
use veilwing::desk::simulation::{
    DeviceModel, Flight, Given, Observer, OneShot, Path, RadioFault, Setup, index, judge, on_this_machine,
    vehicle_draft, world_config,
};
use veilwing::mission::Notice;
use veilwing::role::{PerVehicle, Role};
use veilwing::time::Utc;
use veilwing_sitl::{RadioPlace, World};

/// The longest way to a slot.
const LONGEST: Duration = Duration::from_secs(300);
/// A fault that can end does so after this.
const LASTS: Duration = Duration::from_secs(3);
/// Longer than what is left of a slot, and what any of these devices may declare.
const WATCHED: Duration = Duration::from_secs(10);
/// The preflight has asked a radio for all that it declares by then.
const ASKED: Duration = Duration::from_secs(20);

/// A kind of device, with its times in ms.
#[derive(Debug, Clone, Copy)]
pub struct Backend {
    pub name: &'static str,
    off: u64,
    change: u64,
    /// Its supply is cut so long after its host's death.
    dead: Option<u64>,
    /// An edge of its kill line holds so long; the device has no off of its own.
    line: Option<(u64, bool)>,
}

const fn backend(name: &'static str, [off, change]: [u64; 2]) -> Backend {
    Backend { name, off, change, dead: None, line: None }
}

/// As `veilwing sitl --radio-hosts` has them, and what makes the difference when a host dies.
pub const BACKENDS: &[Backend] = &[
    backend("attenuator, by any way", [1, 1]),
    backend("command, interface", [10, 30]),
    backend("at, by any way", [20, 50]),
    backend("json_rpc, ubus", [20, 60]),
    Backend { dead: Some(400), ..backend("json_rpc, dead-man 400 ms", [20, 60]) },
    Backend { line: Some((90, true)), ..backend("parameter, one-shot 90 ms", [20, 50]) },
    Backend { line: Some((90, false)), ..backend("at, one-shot 90 ms", [20, 50]) },
];

impl Backend {
    fn model(&self) -> DeviceModel {
        let ms = Duration::from_millis;
        DeviceModel {
            off: ms(self.off),
            change: ms(self.change),
            dead: self.dead.map(ms),
            outlives_control: true,
            line: self.line.map(|(holds, alone)| OneShot { holds: ms(holds), alone }),
        }
    }
}

/// What befalls what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    CompanionKill,
    CompanionStop,
    Radio(RadioFault),
}

impl What {
    /// Killed, stopped, cut off: companion, host and device in turn.
    pub const ALL: [Self; 9] = [
        Self::CompanionKill,
        Self::CompanionStop,
        Self::Radio(RadioFault::HostLoss),
        Self::Radio(RadioFault::HostKill),
        Self::Radio(RadioFault::HostStop),
        Self::Radio(RadioFault::DeviceLoss),
        Self::Radio(RadioFault::DeviceKill),
        Self::Radio(RadioFault::DeviceStop),
        Self::Radio(RadioFault::DeviceMute),
    ];

    fn name(self) -> &'static str {
        match self {
            Self::CompanionKill => "companion killed",
            Self::CompanionStop => "companion stopped 3 s",
            Self::Radio(RadioFault::HostLoss) => "companion cut off 3 s",
            Self::Radio(RadioFault::HostKill) => "host killed",
            Self::Radio(RadioFault::HostStop) => "host stopped 3 s",
            Self::Radio(RadioFault::DeviceLoss) => "host cut off 3 s",
            Self::Radio(RadioFault::DeviceKill) => "device killed",
            Self::Radio(RadioFault::DeviceStop) => "device stopped 3 s",
            Self::Radio(RadioFault::DeviceMute) => "device cut off 3 s",
            Self::Radio(_) => "device misbehaves",
        }
    }

    fn befall(self, flight: &mut Flight, role: Role, on: bool) {
        match self {
            Self::CompanionKill if on => flight.kill(role),
            Self::CompanionKill => {}
            Self::CompanionStop => flight.freeze(role, on),
            Self::Radio(fault) if on || fault.can_end() => flight.befall_radio(fault, role, on),
            Self::Radio(_) => {}
        }
    }
}

/// What came of one fault.
#[derive(Debug, Clone)]
pub struct Came {
    /// From the fault to the antenna's silence; `None`: not while it was watched.
    pub off_after: Option<Duration>,
    pub unprotected: Duration,
    /// Broken, and nobody's excuse: as the judge words it.
    pub violations: Vec<String>,
    /// Broken by what has failed, as the judge says.
    pub excused: usize,
}

/// One line of the table.
#[derive(Debug, Clone)]
pub struct Row {
    pub backend: Backend,
    pub what: What,
    pub role: Role,
    pub came: Vec<Came>,
}

impl Row {
    pub fn never(&self) -> usize {
        self.came.iter().filter(|came| came.off_after.is_none()).count()
    }

    pub fn worst_off(&self) -> Option<Duration> {
        self.came.iter().filter_map(|came| came.off_after).max()
    }

    pub fn violations(&self) -> Vec<&String> {
        self.came.iter().flat_map(|came| &came.violations).collect()
    }

    fn excused(&self) -> usize {
        self.came.iter().map(|came| came.excused).sum()
    }

    /// Nothing was broken, and the radio fell silent.
    pub fn holds(&self) -> bool {
        self.violations().is_empty() && self.excused() == 0 && self.never() == 0
    }
}

/// What was radiated, and what preflights said.
#[derive(Default)]
struct Watch {
    on_air: Vec<(Duration, [bool; 2])>,
    refused: PerVehicle<Option<String>>,
}

impl Observer for Watch {
    fn on_air(&mut self, at: Duration, on: [bool; 2]) {
        self.on_air.push((at, on));
    }

    fn said(&mut self, _at: Duration, role: Role, _phase: Option<&'static str>, notice: &Notice) {
        let said = notice.to_string();
        if let Some(refusal) =
            said.split_once("waiting: ").and_then(|(_, text)| text.find("TX_").map(|at| &text[at..]))
        {
            let short = refusal.splitn(3, ',').take(2).collect::<Vec<_>>().join(",");
            self.refused[role].get_or_insert(short);
        }
    }
}

/// Which slot table is flown.
#[derive(Clone)]
pub struct Base {
    given: Given,
}

impl Base {
    /// `planned`: a mission and its plan.
    pub fn new(planned: &Given) -> Self {
        Self { given: planned.clone() }
    }

    fn flight(&self, backend: &Backend, real: bool) -> Flight {
        let permitted = |draft: &mut MissionDraft| {
            draft.emission = real.then(|| Emission {
                authorised_by: "a table".to_owned(),
                band_hz: [1e6, 1e11],
                max_power_w: 1e3,
                valid: Some([0, 4_102_444_800_000_000].map(|unix_us| Utc { unix_us })),
                ..Default::default()
            });
        };
        let mission = self.given.mission.changed(permitted).expect("a mission with leave");
        let mut config = world_config(&mission, &self.given.plan).expect("a world of the mission");
        config.vehicles.iter_mut().for_each(|vehicle| vehicle.radio_place = RadioPlace::OnItsOwn);
        let given = PerVehicle::from_fn(|role| {
            let mut draft = vehicle_draft(&mission, role, [1, 2]);
            draft.transmitter.simulated = !real;
            draft.transmitter.link = Some(on_this_machine(3));
            // Nothing is signed in virtual time: what is asked is what the radio declares.
            draft.autopilot.key_file = real.then(|| "autopilot.key".into());
            draft.transmitter.key_file = real.then(|| "radio.key".into());
            let vehicle = Vehicle::new(draft).expect("a vehicle file");
            Arc::new(Given { mission: mission.clone(), plan: self.given.plan.clone(), vehicle })
        });
        let setup = Setup { given, start_unasked: true, autopilot: Path::GOOD, pair: Path::GOOD, seed: 1 };
        let mut flight = Flight::new(World::new(config).expect("a world"), setup);
        Role::BOTH.into_iter().for_each(|role| flight.host_radio(role, backend.model()));
        flight
    }

    /// Each vehicle's time on the air in the first slot.
    fn spans(&self, backend: &Backend) -> PerVehicle<[Duration; 2]> {
        let (mut flight, mut watch) = (self.flight(backend, false), Watch::default());
        let span = |watch: &Watch, role: Role| {
            let k = index(role);
            let from = watch.on_air.iter().position(|(_, on)| on[k])?;
            let to = watch.on_air[from..].iter().find(|(_, on)| !on[k])?;
            Some([watch.on_air[from].0, to.0])
        };
        loop {
            if let (Some(i), Some(j)) = (span(&watch, Role::I), span(&watch, Role::J)) {
                return PerVehicle { i, j };
            }
            assert!(flight.now() < LONGEST, "{}: no slot is served", backend.name);
            flight.step(LONGEST, &mut watch).expect("a companion that runs");
        }
    }

    fn befall(&self, backend: &Backend, what: What, role: Role, at: Duration) -> Came {
        let (mut flight, mut watch) = (self.flight(backend, false), Watch::default());
        let mut pass = |flight: &mut Flight, to: Duration| {
            while flight.now() < to {
                flight.step(to, &mut watch).expect("a companion that runs");
            }
        };
        pass(&mut flight, at);
        what.befall(&mut flight, role, true);
        pass(&mut flight, at + LASTS);
        what.befall(&mut flight, role, false);
        pass(&mut flight, at + WATCHED);
        let radiated =
            flight.hosted(role).map(|hosted| hosted.device().radiated().to_vec()).unwrap_or_default();
        let off = radiated.iter().find(|(then, dbm)| *then >= at && dbm.is_none());
        let mut report = flight.world.report();
        let excused = judge(&mut report, &[]).len();
        Came {
            off_after: off.map(|(then, _)| *then - at),
            unprotected: Duration::from_secs_f64(report.unprotected_s),
            violations: report
                .violations
                .iter()
                .map(|violation| format!("{} {violation}", violation.invariant().name()))
                .collect(),
            excused,
        }
    }

    /// What the preflight says of such a device that is real; `None`: nothing against it.
    pub fn refusal(&self, backend: &Backend) -> Option<String> {
        let (mut flight, mut watch) = (self.flight(backend, true), Watch::default());
        while flight.now() < ASKED {
            flight.step(ASKED, &mut watch).expect("a companion that runs");
        }
        watch.refused.i
    }
}

/// All rows, in the order of backends, faults and vehicles, whatever the threads: `instants` flights each.
pub fn table(base: &Base, backends: &[Backend], faults: &[What], instants: usize, threads: usize) -> Table {
    let spans: Vec<_> = backends.iter().map(|backend| base.spans(backend)).collect();
    let refusals = backends.iter().map(|backend| base.refusal(backend)).collect();
    let mut rows = Vec::new();
    for (k, backend) in backends.iter().enumerate() {
        for what in faults {
            for role in Role::BOTH {
                rows.push((k, Row { backend: *backend, what: *what, role, came: Vec::new() }));
            }
        }
    }
    let next = AtomicUsize::new(0);
    let done: Vec<_> = rows.iter().map(|_| std::sync::Mutex::new(Vec::new())).collect();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some((number, (k, row))) = {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    rows.get(number).map(|row| (number, row))
                } {
                    let [from, to] = spans[*k][row.role];
                    let at =
                        |instant: usize| from + (to - from).mul_f64((instant as f64 + 0.5) / instants as f64);
                    let came =
                        (0..instants).map(|n| base.befall(&row.backend, row.what, row.role, at(n))).collect();
                    *done[number].lock().expect("no thread has panicked") = came;
                }
            });
        }
    });
    let came = done.into_iter().map(|came| came.into_inner().expect("no thread has panicked"));
    let rows = rows.into_iter().zip(came).map(|((_, row), came)| Row { came, ..row }).collect();
    Table { rows, refusals, backends: backends.to_vec() }
}

/// See [`table`].
pub struct Table {
    pub rows: Vec<Row>,
    backends: Vec<Backend>,
    /// By backend.
    refusals: Vec<Option<String>>,
}

impl Table {
    /// Why the preflight refuses such a device that is real.
    pub fn refusal(&self, backend: &Backend) -> Option<&String> {
        let at = self.backends.iter().position(|other| other.name == backend.name)?;
        self.refusals[at].as_ref()
    }

    /// What is neither kept nor refused.
    pub fn open(&self) -> Vec<&Row> {
        self.rows.iter().filter(|row| !row.holds() && self.refusal(&row.backend).is_none()).collect()
    }
}

fn ms(time: Option<Duration>) -> String {
    time.map_or("-".to_owned(), |time| format!("{:.0}", time.as_secs_f64() * 1e3))
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for backend in &self.backends {
            let said = self.refusal(backend).map_or("nothing against it", String::as_str);
            writeln!(f, "{}: the preflight of a real one says: {said}", backend.name)?;
        }
        let mut text = String::new();
        writeln!(
            text,
            "\n{:<26} {:<22} {:<2} {:>7} {:>7} {:>6} {:>6} {:>9} {:>10} {:>7}  verdict",
            "device",
            "what",
            "of",
            "flights",
            "off ms",
            "worst",
            "never",
            "unprot.ms",
            "violations",
            "excused"
        )?;
        for row in &self.rows {
            let mut off: Vec<Duration> = row.came.iter().filter_map(|came| came.off_after).collect();
            off.sort_unstable();
            let verdict = match (row.holds(), self.refusal(&row.backend)) {
                (true, _) => "holds",
                (false, Some(_)) => "refused where it is real",
                (false, None) if row.violations().is_empty() => "excused: the radio's own failure",
                (false, None) => "BROKEN",
            };
            writeln!(
                text,
                "{:<26} {:<22} {:<2} {:>7} {:>7} {:>6} {:>6} {:>9} {:>10} {:>7}  {verdict}",
                row.backend.name,
                row.what.name(),
                row.role.to_string(),
                row.came.len(),
                ms(off.get(off.len() / 2).copied()),
                ms(row.worst_off()),
                row.never(),
                ms(row.came.iter().map(|came| came.unprotected).max()),
                row.violations().len(),
                row.excused(),
            )?;
            for violation in row.violations() {
                writeln!(text, "    {violation}")?;
            }
        }
        f.write_str(&text)
    }
}
