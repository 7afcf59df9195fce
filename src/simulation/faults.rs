//! Faults of one flight: drawn from the laws of a fault file, and told when their time has come.

use std::f64::consts::TAU;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing_sitl::{self as sim, Snapshot};

use crate::config::{FaultKind, FaultLaw, Faults, Frequency, Magnitude, Whom};
use crate::role::Role;

use super::index;
use super::path::Path;

/// Laws draw from streams of their own, beyond those of the paths.
const FIRST_STREAM: u64 = 1000;
/// More faults of one law than this in one flight are no flight.
const MOST: usize = 1000;

/// A fault of one flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// What happens.
    pub kind: FaultKind,
    /// To whom: one vehicle or both. For the pair link: the directions from them.
    pub roles: Vec<Role>,
    /// With it `after` counts from vehicle I's first emission in that slot, else from the start.
    pub slot: Option<u16>,
    /// When.
    pub after: Duration,
    /// For how long; for ever without it.
    pub duration: Option<Duration>,
    /// The sizes that belong to the kind.
    pub sizes: Vec<(Magnitude, f64)>,
    /// A horizontal direction from east towards north, for the kinds that have one.
    pub direction_rad: f64,
}

/// The lengths that times are drawn from where a law gives none, in seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lengths {
    /// Of a flight as planned, from power-up to both landed.
    pub flight_s: f64,
    /// Of a slot.
    pub slot_s: f64,
}

/// The faults of the flight with this seed. Each law draws from a stream of its own, so that a law added at the end of
/// the file changes nothing in the faults of the others.
#[must_use]
pub fn draw(faults: &Faults, seed: u64, lengths: Lengths) -> Vec<Fault> {
    let each = faults.laws.iter().zip(FIRST_STREAM..);
    each.flat_map(|(law, stream)| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        let count = count(law, &mut rng, lengths.flight_s);
        (0..count).map(|_| draw_one(law, &mut rng, lengths)).collect::<Vec<_>>()
    })
    .collect()
}

fn count(law: &FaultLaw, rng: &mut ChaCha8Rng, flight_s: f64) -> usize {
    match law.frequency {
        Frequency::Once(probability) => usize::from(rng.random::<f64>() < probability),
        // A Poisson process, by its exponential gaps.
        Frequency::PerHour(rate) => {
            let mean_gap_s = 3600.0 / rate;
            let mut at_s = 0.0;
            let gaps = std::iter::repeat_with(|| {
                at_s -= mean_gap_s * (1.0 - rng.random::<f64>()).ln();
                at_s
            });
            gaps.take_while(|at_s| *at_s < flight_s).take(MOST).count()
        }
    }
}

fn draw_one(law: &FaultLaw, rng: &mut ChaCha8Rng, lengths: Lengths) -> Fault {
    // Every draw is made, wanted or not, so that fixing one value leaves the others as they were.
    let mut between = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
    let first = between([0.0, 1.0]) < 0.5;
    let whole = if law.slot.is_some() { lengths.slot_s } else { lengths.flight_s };
    let after_s = between(law.after_s.unwrap_or([0.0, whole]));
    let duration_s = between(law.duration_s.unwrap_or_default());
    let direction_rad = between([0.0, TAU]);
    let sizes = law.sizes.iter().map(|(magnitude, range)| (*magnitude, between(*range))).collect();
    let drawn = if first { Role::I } else { Role::J };
    Fault {
        kind: law.kind,
        roles: match law.whom {
            Whom::I => vec![Role::I],
            Whom::J => vec![Role::J],
            Whom::Either => vec![drawn],
            Whom::Both => Role::BOTH.to_vec(),
        },
        slot: law.slot,
        after: Duration::from_secs_f64(after_s),
        duration: law.duration_s.map(|_| Duration::from_secs_f64(duration_s)),
        sizes,
        direction_rad,
    }
}

impl Fault {
    fn size(&self, magnitude: Magnitude) -> f64 {
        self.sizes.iter().find(|(of, _)| *of == magnitude).map_or(0.0, |(_, size)| *size)
    }

    /// For the log, with whom it befalls.
    #[must_use]
    pub fn describe(&self) -> String {
        let whom = match self.roles.as_slice() {
            [role] if self.kind.is_of_the_pair() => format!("from vehicle {role}"),
            [role] => format!("vehicle {role}"),
            _ => "both vehicles".to_owned(),
        };
        format!("fault: {whom}: {}", self.what())
    }

    /// What happens, without to whom.
    #[must_use]
    pub fn what(&self) -> String {
        let lasting = self.duration.map_or(String::new(), |d| format!(" for {:.3} s", d.as_secs_f64()));
        let sizes: Vec<String> = self.sizes.iter().map(|(of, size)| format!("{of:?} {size:.3}")).collect();
        let sizes = if sizes.is_empty() { String::new() } else { format!(" ({})", sizes.join(", ")) };
        format!("{}{sizes}{lasting}", self.kind.describe())
    }

    /// What a degraded or cut link does to its datagrams; `None` for faults of anything else.
    #[must_use]
    pub fn path(&self) -> Option<Path> {
        match self.kind {
            FaultKind::PairLoss | FaultKind::LinkLoss => Some(Path::CUT),
            FaultKind::PairDegraded | FaultKind::LinkDegraded => Some(Path {
                loss: self.size(Magnitude::Loss),
                duplication: self.size(Magnitude::Duplication),
                delay: Duration::from_secs_f64(self.size(Magnitude::Delay)),
                spread: Duration::from_secs_f64(self.size(Magnitude::Spread)),
            }),
            _ => None,
        }
    }

    /// What the world is told when the fault begins (`on`) or ends; `None` for the faults of hosts and of pair links.
    #[must_use]
    pub fn in_the_world(&self, role: Role, on: bool) -> Option<sim::Fault> {
        let vehicle = index(role);
        match self.kind {
            FaultKind::LinkLoss => Some(sim::Fault::LinkLoss { vehicle, on }),
            _ if !on => None,
            FaultKind::PilotMode => Some(sim::Fault::PilotMode { vehicle }),
            FaultKind::EstimatorFailure => Some(sim::Fault::EstimatorFailure { vehicle }),
            FaultKind::TransmitterStuck => Some(sim::Fault::TransmitterStuck { vehicle }),
            FaultKind::WindStep => {
                let speed = self.size(Magnitude::WindSpeed);
                let (sin, cos) = self.direction_rad.sin_cos();
                Some(sim::Fault::WindStep { vehicle, mean_enu_m_s: [speed * cos, speed * sin, 0.0] })
            }
            FaultKind::CompanionKill
            | FaultKind::CompanionRestart
            | FaultKind::CompanionStop
            | FaultKind::DiskFull
            | FaultKind::LinkDegraded
            | FaultKind::PairLoss
            | FaultKind::PairDegraded => None,
        }
    }
}

/// A fault begins or ends.
#[derive(Debug, Clone, PartialEq)]
pub enum Change {
    /// Now.
    Begins(Fault),
    /// Now.
    Ends(Fault),
}

/// The faults of a flight that are to come, and those that are under way.
#[derive(Debug, Clone, Default)]
pub struct Schedule {
    pending: Vec<Fault>,
    /// With their ends.
    running: Vec<(Fault, Option<Duration>)>,
    first_radiated: Vec<(i32, Duration)>,
}

impl Schedule {
    /// A schedule of these faults.
    #[must_use]
    pub fn new(faults: Vec<Fault>) -> Self {
        Self { pending: faults, ..Self::default() }
    }

    /// Takes note of the slot in which vehicle I radiates, if it does.
    pub fn watch(&mut self, now: Duration, snapshot: &Snapshot) {
        let vehicle_i = &snapshot.vehicles[0];
        if let Some(slot) = vehicle_i.slot.filter(|_| vehicle_i.tx_power_w.is_some())
            && !self.first_radiated.iter().any(|(known, _)| *known == slot)
        {
            self.first_radiated.push((slot, now));
        }
    }

    /// Whether there is nothing to come in a slot that has not been reached.
    #[must_use]
    pub fn waits_for_no_slot(&self) -> bool {
        self.pending.iter().all(|fault| fault.slot.is_none())
    }

    fn due(&self, fault: &Fault) -> Option<Duration> {
        let zero = match fault.slot {
            None => Duration::ZERO,
            Some(slot) => self.first_radiated.iter().find(|(known, _)| *known == i32::from(slot))?.1,
        };
        Some(zero + fault.after)
    }

    /// When the next change is due, as far as it is known.
    #[must_use]
    pub fn next(&self) -> Option<Duration> {
        let begins = self.pending.iter().filter_map(|fault| self.due(fault));
        begins.chain(self.running.iter().filter_map(|(_, ends)| *ends)).min()
    }

    /// The next change that is due: ends first.
    pub fn poll(&mut self, now: Duration) -> Option<Change> {
        if let Some(k) = self.running.iter().position(|(_, ends)| ends.is_some_and(|at| at <= now)) {
            return Some(Change::Ends(self.running.remove(k).0));
        }
        let k = self.pending.iter().position(|fault| self.due(fault).is_some_and(|at| at <= now))?;
        let fault = self.pending.remove(k);
        self.running.push((fault.clone(), fault.duration.map(|lasts| now + lasts)));
        Some(Change::Begins(fault))
    }

    /// Whether a fault of this kind is under way.
    #[must_use]
    pub fn runs(&self, kind: FaultKind, role: Role) -> bool {
        self.running.iter().any(|(fault, _)| fault.kind == kind && fault.roles.contains(&role))
    }

    /// What a link suffers from the faults of these kinds that are under way: a cut, or else the newest.
    #[must_use]
    pub fn path(&self, kinds: &[FaultKind], role: Role) -> Option<Path> {
        let newest_first = self.running.iter().rev().map(|(fault, _)| fault);
        let paths = newest_first
            .filter(|fault| kinds.contains(&fault.kind) && fault.roles.contains(&role))
            .filter_map(Fault::path);
        paths.reduce(|worst, path| if path == Path::CUT { path } else { worst })
    }
}
