//! The flight document (`veilwing-flight/1`) and its table for a reader. Every figure in it is the simulated
//! world's.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;
use veilwing_sitl::{FlightReport, Violation};

use crate::config::Mission;
use crate::desk::simulation::Excused;
use crate::planner::problem::Uncertainty;
use crate::role::{PerVehicle, Role};

use super::host::Flight;
use super::process::{End, describe_end};
use super::radios::RadiosDocument;

/// How a flight ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(in crate::cli) enum FlightResult {
    /// Both companions flew every slot and landed.
    Completed,
    /// At least one did not.
    Aborted,
    /// Stopped by the operator.
    Interrupted,
}

/// The document.
#[derive(Debug, Serialize)]
pub(in crate::cli) struct FlightDocument {
    format: &'static str,
    pub result: FlightResult,
    plan_digest: String,
    wall_s: f64,
    #[serde(flatten)]
    report: FlightReport,
    /// Violations that do not count, each with the reason.
    excused: Vec<Excused>,
    /// Steps in which the simulated world fell behind its own clock; absent in virtual time, where it cannot.
    #[serde(skip_serializing_if = "Option::is_none")]
    world_late: Option<WorldLate>,
    messages: Messages,
    /// Radio hosts, and what their devices did.
    #[serde(skip_serializing_if = "Option::is_none")]
    radio_hosts: Option<RadiosDocument>,
}

/// How far the simulated world fell behind its own clock.
#[derive(Debug, Serialize)]
struct WorldLate {
    /// Steps that were late.
    steps: usize,
    /// The latest of them, flight milliseconds.
    worst_ms: u128,
}

/// What was sent, and what was lost of it.
#[derive(Debug, Serialize)]
pub(in crate::cli) struct Messages {
    /// Datagrams that companions sent.
    pub sent: u64,
    /// Frames that vehicles sent to companions.
    pub received: u64,
    /// By reason.
    pub rejected: BTreeMap<&'static str, u64>,
}

impl FlightDocument {
    /// The document of a flight whose result is known.
    pub fn new(
        result: FlightResult,
        report: FlightReport,
        excused: Vec<Excused>,
        plan_digest: String,
        wall_s: f64,
        messages: Messages,
    ) -> Self {
        let format = "veilwing-flight/1";
        Self {
            format,
            result,
            plan_digest,
            wall_s,
            report,
            excused,
            world_late: None,
            messages,
            radio_hosts: None,
        }
    }

    /// The document of a flight of companion processes.
    pub(in crate::cli::sitl) fn of_processes(flight: &Flight, plan_digest: String, wall_s: f64) -> Self {
        let done = |role| flight.ends[role] == Some(End::Code(0));
        let result = match flight.interrupted {
            true => FlightResult::Interrupted,
            false if Role::BOTH.into_iter().all(done) => FlightResult::Completed,
            false => FlightResult::Aborted,
        };
        let messages = Messages {
            sent: flight.traffic.sent,
            received: flight.traffic.received,
            rejected: BTreeMap::from([("swallowed-by-fault", flight.traffic.swallowed)]),
        };
        let excused = flight.excused.clone();
        let document = Self::new(result, flight.report.clone(), excused, plan_digest, wall_s, messages);
        let worst = flight.late.iter().map(|late| late.by).max().unwrap_or_default();
        let world_late = Some(WorldLate { steps: flight.late.len(), worst_ms: worst.as_millis() });
        Self { world_late, radio_hosts: flight.radios.clone(), ..document }
    }

    /// Completed without a violated invariant.
    pub fn is_good(&self) -> bool {
        self.result == FlightResult::Completed && self.report.violations.is_empty()
    }

    /// The flight for a reader.
    pub(in crate::cli::sitl) fn table(&self, mission: &Mission, ends: &PerVehicle<Option<End>>) -> String {
        let mut text = String::new();
        // Writing to a String cannot fail.
        let _ = self.write_table(&mut text, mission, ends);
        text
    }

    fn write_table(
        &self,
        text: &mut String,
        mission: &Mission,
        ends: &PerVehicle<Option<End>>,
    ) -> std::fmt::Result {
        let per_hz = |bps: f64| bps / mission.radio.bandwidth_hz;
        writeln!(text, "\nslot  user            planned  achieved     +-   ratio  on_I_s  on_J_s  unprot_s")?;
        for (number, slot) in self.report.slots.iter().enumerate() {
            writeln!(
                text,
                "{number:>4}  {:<14} {:>8.3} {:>9.3} {:>6.3} {:>7.3} {:>7.2} {:>7.2} {:>9.3}",
                slot.user,
                per_hz(slot.planned_secrecy_rate_bps),
                per_hz(slot.achieved_secrecy_rate_bps),
                per_hz(slot.standard_error_bps),
                slot.achieved_secrecy_rate_bps / slot.planned_secrecy_rate_bps,
                slot.radiated_s.i,
                slot.radiated_s.j,
                slot.unprotected_s,
            )?;
        }
        writeln!(text, "(rates in bit/s/Hz; on: seconds radiated; unprot: I on without J)")?;
        writeln!(
            text,
            "delivered {:.2} bit/Hz in {:.1} s on the air",
            per_hz(self.report.secrecy_volume_bits),
            self.report.on_air_s
        )?;
        // Two tables: one would be wider than 80 columns.
        writeln!(text, "\nslot  pos_I_m  pos_J_m  att_I_deg  att_J_deg")?;
        for (number, slot) in self.report.slots.iter().enumerate() {
            writeln!(
                text,
                "{number:>4} {:>8} {:>8} {:>10} {:>10}",
                figure(slot.position_rms_m.i, 3),
                figure(slot.position_rms_m.j, 3),
                figure(slot.attitude_rms_deg.i, 2),
                figure(slot.attitude_rms_deg.j, 2),
            )?;
        }
        writeln!(text, "(errors of position and attitude in the slot, rms, jitter included)")?;
        if mission.eavesdroppers.iter().any(|e| e.node.uncertainty != Uncertainty::None) {
            let text_uncertain =
                "the plan is for uncertain eavesdropper positions; this flight drew them once";
            writeln!(text, "({text_uncertain}\nfrom the seed, so achieved may differ from planned)")?;
        }
        for role in Role::BOTH {
            if let Some(end) = ends[role].filter(|end| *end != End::Code(0)) {
                writeln!(text, "vehicle {role}: companion {}", describe_end(end))?;
            }
        }
        let told = |violation: &Violation| {
            format!("{} at {:.3} s: {violation}", violation.invariant().name(), violation.at.as_secs_f64())
        };
        for violation in &self.report.violations {
            writeln!(text, "VIOLATION {}", told(violation))?;
        }
        for Excused { violation, cause } in &self.excused {
            let lasted_ms = violation.lasted.as_millis();
            writeln!(text, "not counted: {}, for {lasted_ms} ms ({})", told(violation), cause.describe())?;
        }
        if let Some(WorldLate { steps, worst_ms }) = self.world_late.as_ref().filter(|late| late.steps > 0) {
            writeln!(
                text,
                "the world ran late in {steps} of its steps, by {worst_ms} ms of flight at worst:\nthis machine was busy; a lower --speed asks less of it"
            )?;
        }
        let verdict = match self.result {
            FlightResult::Completed => "completed",
            FlightResult::Aborted => "NOT COMPLETED",
            FlightResult::Interrupted => "interrupted",
        };
        let separation =
            self.report.min_separation_m.map_or("never both airborne".into(), |m| format!("{m:.1} m"));
        let out = self.report.emitted_out_of_pose_s;
        writeln!(
            text,
            "unprotected {:.3} s, on the air out of pose {:.3} s, whatever the cause",
            self.report.unprotected_s,
            out.i + out.j
        )?;
        writeln!(
            text,
            "{verdict}: {} violations, least separation {separation}\n{:.1} s of flight in {:.1} s of wall time",
            self.report.violations.len(),
            self.report.flight_s,
            self.wall_s
        )
    }
}

/// A figure, or a dash where nothing was measured.
fn figure(value: Option<f64>, decimals: usize) -> String {
    value.map_or("-".into(), |value| format!("{value:.decimals$}"))
}
