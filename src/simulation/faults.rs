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
    let mut size = |magnitude: Magnitude, [low, high]: [f64; 2]| {
        // Each whole number of the range is as likely as any other.
        if magnitude.is_whole() { between([low, high + 1.0]).floor().min(high) } else { between([low, high]) }
    };
    let sizes = law.sizes.iter().map(|(magnitude, range)| (*magnitude, size(*magnitude, *range))).collect();
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

    /// A vector of this size in the direction that was drawn: east, north, up.
    fn horizontal(&self, magnitude: Magnitude) -> [f64; 3] {
        let (sin, cos) = self.direction_rad.sin_cos();
        let size = self.size(magnitude);
        [size * cos, size * sin, 0.0]
    }

    /// The vehicle that it befalls; `None` if both.
    #[must_use]
    pub fn vehicle(&self) -> Option<Role> {
        match self.roles.as_slice() {
            [role] => Some(*role),
            _ => None,
        }
    }

    /// For the log, with whom it befalls.
    #[must_use]
    pub fn describe(&self) -> String {
        let whom = match self.vehicle() {
            Some(role) if self.kind.is_of_the_pair() => format!("from vehicle {role}"),
            Some(role) => format!("vehicle {role}"),
            None => "both vehicles".to_owned(),
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
            FaultKind::GpsLoss => Some(sim::Fault::GpsLoss { vehicle, on }),
            _ if !on => None,
            FaultKind::EstimatorReset => {
                let jump_enu_m = self.horizontal(Magnitude::Jump);
                Some(sim::Fault::EstimatorReset { vehicle, jump_enu_m })
            }
            FaultKind::ClockJump => {
                Some(sim::Fault::ClockJump { vehicle, by_s: self.size(Magnitude::ClockStep) })
            }
            FaultKind::AutopilotRestart => Some(sim::Fault::AutopilotRestart { vehicle }),
            FaultKind::BatteryLow => {
                Some(sim::Fault::BatteryLow { vehicle, charge: self.size(Magnitude::Charge) })
            }
            FaultKind::RotorLoss => {
                Some(sim::Fault::RotorLoss { vehicle, rotor: self.size(Magnitude::Rotor) as usize })
            }
            FaultKind::TransmitterIgnoresExpiry => Some(sim::Fault::TransmitterIgnoresExpiry { vehicle }),
            FaultKind::PilotMode => Some(sim::Fault::PilotMode { vehicle }),
            FaultKind::EstimatorFailure => Some(sim::Fault::EstimatorFailure { vehicle }),
            FaultKind::TransmitterStuck => Some(sim::Fault::TransmitterStuck { vehicle }),
            FaultKind::WindStep => {
                let mean_enu_m_s = self.horizontal(Magnitude::WindSpeed);
                Some(sim::Fault::WindStep { vehicle, mean_enu_m_s })
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

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTHS: Lengths = Lengths { flight_s: 80.0, slot_s: 9.0 };

    fn laws(text: &str) -> Faults {
        Faults::parse("f.toml", text).unwrap()
    }

    fn all(faults: &Faults, seeds: u64) -> Vec<Fault> {
        (0..seeds).flat_map(|seed| draw(faults, seed, LENGTHS)).collect()
    }

    #[test]
    fn val_faults_are_as_frequent_as_their_law_says_and_anywhere_in_the_flight() {
        let n = 4000;
        let once = all(&laws("[[fault]]\nkind = \"link-loss\"\nprobability = 0.2\n"), n);
        let share = once.len() as f64 / n as f64;
        assert!((share - 0.2).abs() < 4.0 * (0.2 * 0.8 / n as f64).sqrt(), "{share}");
        let times: Vec<f64> = once.iter().map(|fault| fault.after.as_secs_f64()).collect();
        assert!(times.iter().all(|at| (0.0..80.0).contains(at)));
        // Uniform: mean 40, variance 80^2/12.
        let mean = times.iter().sum::<f64>() / times.len() as f64;
        assert!((mean - 40.0).abs() < 4.0 * 80.0 / (12.0 * times.len() as f64).sqrt(), "{mean}");
        let of_i = once.iter().filter(|fault| fault.roles == [Role::I]).count() as f64 / times.len() as f64;
        assert!((of_i - 0.5).abs() < 4.0 * 0.5 / (times.len() as f64).sqrt(), "{of_i}");
        // 90 an hour are 2 in 80 s, with the variance of a Poisson law.
        let poisson = all(&laws("[[fault]]\nkind = \"pilot-mode\"\nrate_per_hour = 90\n"), n);
        let mean = poisson.len() as f64 / n as f64;
        assert!((mean - 2.0).abs() < 4.0 * (2.0 / n as f64).sqrt(), "{mean}");
    }

    #[test]
    fn val_what_is_fixed_is_not_drawn() {
        let text =
            "[[fault]]\nkind = \"wind-step\"\nvehicle = \"j\"\nslot = 2\nafter_s = 1.5\nspeed_m_s = 7\n";
        for seed in 0..20 {
            let [fault] = &draw(&laws(text), seed, LENGTHS)[..] else { panic!("one fault") };
            assert_eq!(
                (fault.after, fault.slot, &fault.roles[..]),
                (Duration::from_millis(1500), Some(2), &[Role::J][..])
            );
            let Some(sim::Fault::WindStep { vehicle: 1, mean_enu_m_s: [e, n, 0.0] }) =
                fault.in_the_world(Role::J, true)
            else {
                panic!("{fault:?}")
            };
            assert!((e.hypot(n) - 7.0).abs() < 1e-12);
        }
    }

    #[test]
    fn prop_a_law_added_at_the_end_changes_nothing_in_the_others() {
        let one = "[[fault]]\nkind = \"link-loss\"\nprobability = 0.5\nduration_s = [1, 9]\n";
        let two = format!("{one}[[fault]]\nkind = \"pilot-mode\"\n");
        for seed in 0..100 {
            let (alone, both) = (draw(&laws(one), seed, LENGTHS), draw(&laws(&two), seed, LENGTHS));
            assert_eq!(both[..alone.len()], alone[..]);
            assert_eq!(both.len(), alone.len() + 1);
        }
    }

    fn fault(kind: FaultKind, after_s: u64, lasts_s: Option<u64>) -> Fault {
        Fault {
            kind,
            roles: vec![Role::I],
            slot: None,
            after: Duration::from_secs(after_s),
            duration: lasts_s.map(Duration::from_secs),
            sizes: vec![(Magnitude::Loss, 0.2)],
            direction_rad: 0.0,
        }
    }

    #[test]
    fn val_faults_begin_and_end_in_time_and_a_cut_outdoes_a_bad_link() {
        let cut = fault(FaultKind::PairLoss, 2, Some(3));
        let bad = fault(FaultKind::PairDegraded, 3, None);
        let mut schedule = Schedule::new(vec![bad.clone(), cut.clone()]);
        let kinds = [FaultKind::PairLoss, FaultKind::PairDegraded];
        let seconds = Duration::from_secs;
        assert_eq!((schedule.next(), schedule.poll(seconds(1))), (Some(seconds(2)), None));
        assert_eq!(schedule.path(&kinds, Role::I), None);
        assert_eq!(schedule.poll(seconds(2)), Some(Change::Begins(cut.clone())));
        assert_eq!(schedule.next(), Some(seconds(3)));
        assert_eq!(schedule.poll(seconds(3)), Some(Change::Begins(bad.clone())));
        assert_eq!(schedule.path(&kinds, Role::I), Some(Path::CUT));
        assert_eq!(schedule.path(&kinds, Role::J), None);
        assert_eq!(schedule.poll(seconds(5)), Some(Change::Ends(cut)));
        assert_eq!(schedule.path(&kinds, Role::I).map(|path| path.loss), Some(0.2));
        assert_eq!((schedule.poll(seconds(99)), schedule.next()), (None, None));
        assert!(schedule.runs(FaultKind::PairDegraded, Role::I));
    }
}
