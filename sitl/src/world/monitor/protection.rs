//! S1's jam and S3's order: every microsecond in which I radiates unprotected, and whose doing it is.

use std::time::Duration;

use super::{I, LEASE, Monitor, Seen};
use crate::vehicle::autopilot::Traces;
use crate::world::config::Off;
use crate::world::excuse::{Cause, Excused};
use crate::world::violation::{Breach, Violation};

/// What has held since the last look.
#[derive(Debug, Clone, Copy, Default)]
struct Held {
    since: Duration,
    /// I radiates without J on at its planned power and in its pose.
    unprotected: bool,
    /// What I's radio does by itself.
    radio: Option<Cause>,
    /// I's slot.
    slot: Option<usize>,
    /// Who radiates out of its pose, or in no slot.
    out: [bool; 2],
}

/// I unprotected without a break: which entries tell of it.
#[derive(Debug, Clone, Copy, Default)]
struct Exposure {
    violation: Option<usize>,
    excused: [Option<usize>; Cause::ALL.len()],
}

/// Exact times, whatever the cause.
#[derive(Debug, Clone, Default)]
pub(crate) struct Measured {
    /// I unprotected, by slot; the last is of no slot.
    unprotected: Vec<Duration>,
    outside: Duration,
    /// Radiated out of its pose, or in no slot.
    pub out_of_pose: [Duration; 2],
}

impl Measured {
    /// In a slot of the plan.
    pub fn unprotected_in(&self, slot: usize) -> Duration {
        self.unprotected.get(slot).copied().unwrap_or_default()
    }

    /// In all.
    pub fn unprotected(&self) -> Duration {
        self.outside + self.unprotected.iter().sum::<Duration>()
    }

    fn add(&mut self, held: &Held, time: Duration) {
        for (sum, _) in self.out_of_pose.iter_mut().zip(held.out).filter(|(_, out)| *out) {
            *sum += time;
        }
        if !held.unprotected {
            return;
        }
        match held.slot {
            None => self.outside += time,
            Some(slot) => {
                self.unprotected.resize(self.unprotected.len().max(slot + 1), Duration::ZERO);
                self.unprotected[slot] += time;
            }
        }
    }
}

/// What is remembered between two looks.
#[derive(Debug, Clone, Default)]
pub(super) struct Protection {
    held: Held,
    exposure: Exposure,
    /// When I was, or would have been, jammed for last.
    jammed_last: Option<Duration>,
    /// I was on for last.
    pub i_on_last: Option<Duration>,
    /// I on without a jammer on in its slot since, and whether there was one before.
    pub bare_since: Option<(Duration, bool)>,
}

impl Monitor {
    /// S1's jam and S3's order.
    pub(super) fn protection(
        &mut self,
        now: Duration,
        seen: &[Seen; 2],
        planned_silent: bool,
        jammer: &Traces,
    ) {
        self.settle(now);
        self.jammer.look(now, &seen[1], jammer);
        let [i, j] = seen;
        let i_on = i.power_w.is_some();
        let jams = j.power_w.is_some() && j.slot == i.slot && j.slot.is_some();
        let protects = j.full_power && (planned_silent || jams && j.off == Off::Nothing);
        let out = |seen: &Seen| seen.power_w.is_some() && (seen.slot.is_none() || seen.off != Off::Nothing);
        if i_on {
            self.protection.i_on_last = Some(now);
        }
        let unprotected = i_on && !protects;
        if !unprotected {
            self.protection.exposure = Exposure::default();
        }
        self.protection.held =
            Held { since: now, unprotected, radio: i.radio, slot: i.slot, out: [out(i), out(j)] };
        self.order(
            now,
            i_on && i.slot.is_some(),
            planned_silent || jams,
            planned_silent || j.power_w.is_some(),
        );
    }

    /// Books what has held since the last look: all of it as measured, and what was unprotected as excused, for its
    /// cause, or as a violation.
    pub(super) fn settle(&mut self, now: Duration) {
        let held = self.protection.held;
        self.protection.held.since = now;
        let time = now.saturating_sub(held.since);
        self.measured.add(&held, time);
        if !held.unprotected || time.is_zero() {
            return;
        }
        if let Some(cause) = held.radio {
            return self.excuse(held.since, time, cause);
        }
        let leased_until = self.jammer.leased_until().clamp(held.since, now);
        self.excuse(held.since, leased_until - held.since, Cause::JammerFailed);
        self.count(leased_until, now - leased_until);
    }

    fn excuse(&mut self, at: Duration, time: Duration, cause: Cause) {
        if time.is_zero() {
            return;
        }
        let entry = &mut self.protection.exposure.excused[cause as usize];
        let known = entry.and_then(|k| self.excused.get_mut(k));
        match known {
            Some(excused) => excused.violation.lasted += time,
            None => {
                *entry = Some(self.excused.len());
                let violation = Violation { at, vehicle: I, breach: Breach::Unprotected, lasted: time };
                self.excused.push(Excused { violation, cause });
            }
        }
    }

    fn count(&mut self, at: Duration, time: Duration) {
        if time.is_zero() {
            return;
        }
        let entry = &mut self.protection.exposure.violation;
        match entry.and_then(|k| self.violations.get_mut(k)) {
            Some(violation) => violation.lasted += time,
            None => {
                *entry = Some(self.violations.len());
                let violation = Violation { at, vehicle: I, breach: Breach::Unprotected, lasted: time };
                self.violations.push(violation);
            }
        }
    }

    /// S3: J on before I, off after I; except that J whose vehicle fails cannot wait (S4).
    fn order(&mut self, now: Duration, i_on: bool, jammed: bool, j_on: bool) {
        let bare = i_on && !jammed;
        let excepted = now < self.jammer.leased_until();
        let memory = &mut self.protection;
        if j_on {
            memory.jammed_last = Some(now);
        }
        if !bare {
            memory.bare_since = None;
        } else if memory.bare_since.is_none() {
            // What was granted before lasts, whether I is on already or not yet.
            let leased = memory.jammed_last.filter(|at| excepted && now.saturating_sub(*at) <= LEASE);
            memory.bare_since = Some(match leased {
                Some(at) if !self.radiating[0] => (at, true),
                _ => (now, self.radiating[0]),
            });
        }
        let begins = memory.bare_since.filter(|(since, _)| *since == now).is_some_and(|(_, had)| had);
        let first = memory.bare_since.is_some_and(|(_, had_jam)| !had_jam);
        let left = self.goes_on(I, Breach::JamLeft) || begins && !excepted;
        self.set(now, I, Breach::InfoFirst, bare && first);
        self.set(now, I, Breach::JamLeft, bare && left);
    }
}
