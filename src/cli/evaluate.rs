//! `veilwing evaluate`: scores given poses and powers under the mission's model.

mod limits;

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::config::file::{read_text, text_of};
use crate::config::{Diagnostics, Mission, Mode, plan_of_text};
use crate::planner::assessment::assess;
use crate::planner::document::{EditedPlan, EditedSlot, PlanDocument};
use crate::planner::explanation::explain;
use crate::planner::plan::{BoundKind, SlotPlan, Status, VehiclePlan};
use crate::planner::slots::{Plan, PlannedSlot};
use crate::planner::volume::Fairness;
use crate::planner::{EvaluateOptions, cap, evaluate};
use crate::planning::lean;

use super::planning::{plan_document, slot_document};
use super::{Exit, load_mission, print_json, print_text};

/// Largest plan that is read: some hundred thousand slots.
const MAX_BYTES: u64 = 1 << 28;

/// Score the poses and powers of a plan (perhaps edited) under the mission's model.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example: veilwing plan m.toml --json > p.json; veilwing evaluate m.toml p.json --samples 65536"
)]
pub(super) struct Args {
    /// Mission file.
    mission: PathBuf,
    /// Plan, as `plan --json` writes it; `-` reads stdin.
    plan: PathBuf,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
    /// Quasi-random samples of jitter and positions per slot.
    #[arg(long, value_name = "N", default_value_t = 16384, value_parser = clap::value_parser!(u32).range(16..=65536))]
    samples: u32,
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match load_mission(&args.mission) {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    let name = if args.plan == Path::new("-") { "stdin".into() } else { args.plan.display().to_string() };
    let edited = match read(&args.plan, &name) {
        Ok(edited) => edited,
        Err(errors) => {
            eprint!("{errors}");
            return Exit::Unusable;
        }
    };
    match mission.planner.mode {
        Mode::Static => {}
        Mode::Turning => eprintln!("{name}: warning: scored as poses that are held: turns are not scored"),
        Mode::Moving => eprintln!("{name}: warning: scored as poses that are held: motion is not scored"),
    }
    let scored = limits::possible(&edited).and_then(|()| {
        for warning in limits::exceeded(&mission, &edited) {
            eprintln!("{name}: warning: {warning}");
        }
        score(&mission, &edited, args.samples as usize)
    });
    match scored {
        Ok(document) if args.json => print_json(&document),
        Ok(document) => print_text(&table(&mission, &document)),
        Err(message) => {
            eprintln!("{name}: {message}");
            Exit::Unusable
        }
    }
}

fn read(path: &Path, name: &str) -> Result<EditedPlan, Diagnostics> {
    let text = if path == Path::new("-") {
        text_of(name, Ok(std::io::stdin().lock()), MAX_BYTES)
    } else {
        read_text(path, MAX_BYTES)
    }?;
    plan_of_text(name, &text)
}

fn score(mission: &Mission, edited: &EditedPlan, samples: usize) -> Result<PlanDocument, String> {
    let options = EvaluateOptions { samples, seed: mission.seed, ..EvaluateOptions::default() };
    let mut planned = Vec::new();
    let mut reasons = Vec::new();
    for (index, slot) in edited.slots.iter().enumerate() {
        let user = mission.users.iter().position(|user| user.name == slot.user).ok_or_else(|| {
            let names: Vec<_> = mission.users.iter().map(|user| user.name.as_str()).collect();
            format!(
                "slots[{index}]: user {:?} is not in the mission; give one of its users, {}",
                slot.user,
                names.join(", ")
            )
        })?;
        let Some(problem) = mission.problem(user) else { continue };
        let vehicles = slot.vehicles.clone().map(VehiclePlan::from);
        let score = evaluate(&problem, &vehicles, &options)
            .map_err(|error| format!("user {:?}: {error}", slot.user))?;
        let assessment = assess(&problem, &vehicles, mission.planner.target_rate_bps, &options)
            .map_err(|error| format!("user {:?}: {error}", slot.user))?;
        let explanation = explain(&problem, &vehicles, &options)
            .map_err(|error| format!("user {:?}: {error}", slot.user))?;
        reasons.push((assessment, explanation));
        let plan = SlotPlan {
            status: Status::Evaluated,
            vehicles,
            secrecy_rate_bps: score.secrecy_rate_bps,
            standard_error_bps: score.standard_error_bps,
            objective_bps: score.objective_rate_bps,
            upper_bound_bps: cap(&problem).map_err(|error| format!("user {:?}: {error}", slot.user))?,
            upper_bound_kind: BoundKind::Cap,
            user_sinr: score.user_sinr,
            eavesdropper_sinr: score.eavesdropper_sinr,
        };
        let lean_rad = lean::borne(&problem, &vehicles, mission.planner.target_rate_bps)
            .map_err(|error| format!("user {:?}: {error}", slot.user))?;
        let length = length_of(mission, slot).map_err(|error| format!("slots[{index}]: {error}"))?;
        planned.push(PlannedSlot { user: slot.user.clone(), plan, lean_rad, length });
    }
    let plan = Plan::new(planned);
    let slots = plan.slots.iter().zip(&reasons);
    let slots = slots
        .map(|(slot, (assessment, explanation))| {
            slot_document(mission, slot, (assessment, explanation), [0.0; 2])
        })
        .collect();
    Ok(plan_document(mission, mission.seed, "evaluate", &plan, slots))
}

/// How long a slot is, where the mission leaves that to the plan.
fn length_of(mission: &Mission, slot: &EditedSlot) -> Result<Option<Duration>, String> {
    if mission.planner.fairness != Fairness::MaxMin {
        return Ok(None);
    }
    let Some(slot_s) = slot.slot_s else { return Ok(None) };
    let [shortest_s, longest_s] = mission.tdma.slot_limits_s();
    if !(shortest_s..=longest_s).contains(&slot_s) {
        return Err(format!(
            "slot_s is {slot_s}, outside {shortest_s} to {longest_s} s: keep within the mission's tdma.slot_min_s and \
             slot_max_s"
        ));
    }
    Duration::try_from_secs_f64(slot_s).map(Some).map_err(|error| format!("slot_s is {slot_s}: {error}"))
}

fn table(mission: &Mission, document: &PlanDocument) -> String {
    let per_hz = |bps: f64| bps / mission.radio.bandwidth_hz;
    let line = |slot: &crate::planner::document::SlotDocument| {
        format!(
            "user {}: secrecy rate {:.4} +- {:.4} bit/s/Hz ({:.4} Mbit/s)\n  upper bound {:.4} bit/s/Hz ({})\n",
            slot.user,
            per_hz(slot.secrecy_rate_bps),
            per_hz(slot.standard_error_bps),
            slot.secrecy_rate_bps / 1e6,
            per_hz(slot.upper_bound_bps),
            slot.upper_bound_kind
        )
    };
    document.slots.iter().map(line).collect()
}
