//! What is told of a flight under way: to the operator at once, and for its record as events.

use std::time::Duration;

use veilwing_sitl::World;

use crate::cli::{progress, watch};
use crate::desk::report::{Event, EventKind, Severity};
use crate::desk::simulation::{Change, index};
use crate::role::Role;

use super::process::{End, Line, describe_end};

/// Progress lines without news come this often, in flight time.
const PROGRESS_EVERY: Duration = Duration::from_secs(10);

/// The events so far.
#[derive(Debug)]
pub(super) struct Journal {
    events: Vec<Event>,
    next_progress: Duration,
}

impl Journal {
    pub fn new() -> Self {
        Self { events: Vec::new(), next_progress: PROGRESS_EVERY }
    }

    /// A line for the operator alone, `at` this flight time.
    pub fn say(at: Duration, text: &str) {
        progress(&format!("[{:7.1} s] {text}", at.as_secs_f64()));
    }

    /// A line of a companion's log.
    pub fn line(&mut self, at: Duration, role: Role, line: Line) {
        // A view hears it from the companion itself.
        if !watch::is_shown() {
            Self::say(at, &format!("{role}  {line}"));
        }
        self.note(at, EventKind::Notice, Some(role), line.severity, line.text);
        if let Some(event) = self.events.last_mut().filter(|_| !line.phase.is_empty()) {
            event.phase = Some(line.phase);
        }
    }

    /// A fault that begins or ends.
    pub fn change(&mut self, at: Duration, change: &Change) {
        let (fault, kind, over) = match change {
            Change::Begins(fault) => (fault, EventKind::Fault, ""),
            Change::Ends(fault) => (fault, EventKind::FaultOver, " is over"),
        };
        Self::say(at, &format!("{}{over}", fault.describe()));
        self.note(at, kind, fault.vehicle(), Severity::Warning, fault.what());
        if let Some(event) = self.events.last_mut() {
            event.code = Some(fault.kind.name().to_owned());
        }
    }

    /// A companion's end.
    pub fn end(&mut self, at: Duration, role: Role, end: End) {
        let severity = if end == End::Code(0) { Severity::Info } else { Severity::Warning };
        let text = format!("companion {}", describe_end(end));
        Self::say(at, &format!("{role}  {text}"));
        self.note(at, EventKind::Process, Some(role), severity, text);
    }

    /// A radio host's end, which nobody asked for.
    pub fn radio_end(&mut self, at: Duration, role: Role, end: End) {
        let text = match end {
            End::Code(code) => format!("radio host has ended with exit code {code}"),
            End::Signal(_) | End::Stopped => format!("radio host {}", describe_end(end)),
        };
        Self::say(at, &format!("{role}  {text}"));
        self.note(at, EventKind::Process, Some(role), Severity::Warning, text);
    }

    /// Where the vehicles are, if it is time to say so.
    pub fn progress(&mut self, world: &World) {
        let now = world.now();
        if now < self.next_progress {
            return;
        }
        self.next_progress = now + PROGRESS_EVERY;
        if watch::is_shown() {
            return;
        }
        let snapshot = world.snapshot();
        let vehicles: Vec<String> = Role::BOTH
            .into_iter()
            .map(|role| {
                let v = &snapshot.vehicles[index(role)];
                let [e, n, u] = v.position_enu_m;
                let power = crate::units::Watts(v.tx_power_w.unwrap_or(0.0));
                format!("{role} {} ({e:.0}, {n:.0}, {u:.0}) m, {power}", v.mode)
            })
            .collect();
        Self::say(now, &vehicles.join("; "));
    }

    fn note(
        &mut self,
        at: Duration,
        kind: EventKind,
        vehicle: Option<Role>,
        severity: Severity,
        text: String,
    ) {
        let at_s = at.as_secs_f64();
        self.events.push(Event { at_s, kind, vehicle, severity, phase: None, code: None, text });
    }

    pub fn finish(self) -> Vec<Event> {
        self.events
    }
}
