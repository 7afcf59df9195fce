//! The faults of one flight in time: told when they begin and when they end.

use std::time::Duration;

use veilwing_sitl::Snapshot;

use crate::desk::simulation::path::Path;
use crate::role::Role;

use super::drawn::Fault;
use super::kind::FaultKind;

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

    /// What a link suffers from the faults of these kinds that are under way: a cut, or else a freeze, or else the newest.
    #[must_use]
    pub fn path(&self, kinds: &[FaultKind], role: Role) -> Option<Path> {
        let newest_first = self.running.iter().rev().map(|(fault, _)| fault);
        let paths = newest_first
            .filter(|fault| kinds.contains(&fault.kind) && fault.roles.contains(&role))
            .filter_map(Fault::path);
        let rank = |path: &Path| [*path == Path::CUT, path.frozen];
        paths.reduce(|worst, path| if rank(&path) > rank(&worst) { path } else { worst })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::desk::simulation::fault::Magnitude;

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
    fn spec_faults_begin_and_end_in_time_and_a_cut_outdoes_a_bad_link() {
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
