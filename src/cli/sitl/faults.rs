//! Faults of a simulated flight: in the world, on the links, and of the companion processes.

use rustix::process::{Pid, Resource, Rlimit, Signal};
use veilwing_sitl as sim;

use crate::desk::report::{EventKind, Severity};
use crate::desk::simulation::{Change, Fault, FaultKind, index};
use crate::role::Role;

use super::host::Host;
use super::port::DIRECT;

const LINK: [FaultKind; 2] = [FaultKind::LinkLoss, FaultKind::LinkDegraded];
const PAIR: [FaultKind; 2] = [FaultKind::PairLoss, FaultKind::PairDegraded];

/// A companion that was killed to be started again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Restart {
    /// Not yet.
    Later,
    /// As soon as its death is seen.
    Due,
}

impl Host<'_> {
    /// Lets faults begin and end.
    pub(super) fn change_faults(&mut self) {
        let now = self.setup.world.now();
        self.schedule.watch(now, &self.setup.world.snapshot());
        while let Some(change) = self.schedule.poll(now) {
            match change {
                Change::Begins(fault) => {
                    self.say(&fault.describe());
                    self.note_fault(EventKind::Fault, &fault);
                    self.apply(&fault, true);
                    self.happened.push((now, fault));
                }
                Change::Ends(fault) => {
                    self.say(&format!("{} is over", fault.describe()));
                    self.note_fault(EventKind::FaultOver, &fault);
                    self.apply(&fault, false);
                }
            }
        }
    }

    /// Tells the world's monitor how the companions fare, as far as this process knows.
    pub(super) fn tell_world(&mut self) {
        for role in Role::BOTH {
            let companion = &self.companions[role];
            let stopped = self.schedule.runs(FaultKind::CompanionStop, role);
            let passage =
                |kinds: &[FaultKind], from| self.schedule.path(kinds, from).unwrap_or(DIRECT).passage();
            let told = sim::Circumstances {
                runs: companion.end.is_none() && !companion.gone && !stopped,
                life: self.lives[role],
                vehicle_link: passage(&LINK, role),
                from_peer: match self.setup.pair_relay {
                    // What somebody else's relay does to it is not known here.
                    Some(_) => sim::Passage::Impaired,
                    None => passage(&PAIR, role.peer()),
                },
            };
            if std::mem::replace(&mut self.told[role], told) != told {
                self.setup.world.set_circumstances(index(role), told);
            }
        }
    }

    fn note_fault(&mut self, kind: EventKind, fault: &Fault) {
        self.note(kind, fault.vehicle(), Severity::Warning, fault.what());
        if let Some(event) = self.events.last_mut() {
            event.code = Some(fault.kind.name().to_owned());
        }
    }

    fn apply(&mut self, fault: &Fault, on: bool) {
        for &role in &fault.roles {
            let still = self.schedule.runs(fault.kind, role);
            match fault.kind {
                FaultKind::CompanionKill if on => {
                    self.restarts[role] = None;
                    self.signal(role, Signal::KILL);
                }
                FaultKind::CompanionRestart if on => {
                    if self.companions[role].end.is_none() {
                        self.restarts[role] = Some(Restart::Later);
                    }
                    self.signal(role, Signal::KILL);
                }
                FaultKind::CompanionRestart => {
                    self.restarts[role] = self.restarts[role].map(|_| Restart::Due);
                }
                FaultKind::CompanionStop => {
                    self.signal(role, if still { Signal::STOP } else { Signal::CONT });
                }
                FaultKind::DiskFull => self.fill_disk(role, still),
                FaultKind::PairLoss | FaultKind::PairDegraded => {
                    let path = self.schedule.path(&PAIR, role).unwrap_or(DIRECT);
                    self.pair[role].set_path_from(path);
                }
                _ => {
                    let path = self.schedule.path(&LINK, role).unwrap_or(DIRECT);
                    self.autopilot[role].set_path_from(path);
                    self.autopilot[role].set_path_to(path);
                    if let Some(fault) = fault.in_the_world(role, on).filter(|_| on || !still) {
                        self.setup.world.inject(fault);
                    }
                }
            }
        }
    }

    /// A companion process that has ended is started again, if that is what its fault asks for.
    /// Whether its end is not the end.
    pub(super) fn restart(&mut self, role: Role) -> bool {
        let Some(restart) = self.restarts[role] else { return false };
        if !self.companions[role].gone {
            self.companions[role].gone = true;
            self.setup.world.inject(sim::Fault::CompanionLost { vehicle: index(role) });
        }
        if restart == Restart::Due {
            self.restarts[role] = None;
            match self.spawn_again(role) {
                Ok(companion) => {
                    self.companions[role] = companion;
                    self.lives[role] += 1;
                }
                Err(error) => {
                    self.say(&format!("{role}  {error}"));
                    return false;
                }
            }
        }
        true
    }

    /// No file of the companion grows any more, or may again: what a full disk does to it. Its log on stderr is a pipe.
    fn fill_disk(&self, role: Role, full: bool) {
        let Some(pid) = self.pid(role) else { return };
        let limit = Rlimit { current: full.then_some(0), maximum: None };
        if let Err(error) = rustix::process::prlimit(Some(pid), Resource::Fsize, limit) {
            self.say(&format!("{role}  the disk cannot be made to look full: {error}"));
        }
    }

    pub(super) fn signal(&self, role: Role, signal: Signal) {
        if let Some(pid) = self.pid(role) {
            // It may have ended in the meantime.
            let _ = rustix::process::kill_process(pid, signal);
        }
    }

    fn pid(&self, role: Role) -> Option<Pid> {
        let id = self.companions[role].child.id()?;
        i32::try_from(id).ok().and_then(Pid::from_raw)
    }
}
