//! `veilwing evaluate`: scores given poses and powers under the mission's model.

use std::path::{Path, PathBuf};

use crate::config::Mission;
use crate::planner::plan::{BoundKind, SlotPlan, Status, VehiclePlan};
use crate::planner::slots::{Plan, PlannedSlot, hex};
use crate::planner::{EvaluateOptions, cap, evaluate};
use crate::report::plan_document::{EditedPlan, FORMAT, PlanDocument};

use super::planning::slot_document;
use super::{Exit, load_mission, print_json, print_text};

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
    #[arg(long, default_value_t = 16384, value_parser = clap::value_parser!(u32).range(16..=65536))]
    samples: u32,
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match load_mission(&args.mission) {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    let scored = read(&args.plan).and_then(|edited| score(&mission, &edited, args.samples as usize));
    match scored {
        Ok(document) if args.json => print_json(&document),
        Ok(document) => print_text(&table(&mission, &document)),
        Err(message) => {
            eprintln!("{}: {message}", args.plan.display());
            Exit::Unusable
        }
    }
}

fn read(path: &Path) -> Result<EditedPlan, String> {
    let text = if path == Path::new("-") {
        std::io::read_to_string(std::io::stdin())
    } else {
        std::fs::read_to_string(path)
    };
    let text = text.map_err(|error| format!("cannot be read: {error}"))?;
    let plan: EditedPlan = serde_json::from_str(&text)
        .map_err(|error| format!("{}:{}: not a plan document: {error}", error.line(), error.column()))?;
    if plan.format == FORMAT {
        Ok(plan)
    } else {
        Err(format!("format {:?} is not {FORMAT:?}: give a document that `plan --json` wrote", plan.format))
    }
}

fn score(mission: &Mission, edited: &EditedPlan, samples: usize) -> Result<PlanDocument, String> {
    let options = EvaluateOptions { samples, seed: mission.seed, ..EvaluateOptions::default() };
    let mut planned = Vec::new();
    for slot in &edited.slots {
        let user = mission.users.iter().position(|user| user.name == slot.user).ok_or_else(|| {
            let names: Vec<_> = mission.users.iter().map(|user| user.name.as_str()).collect();
            format!("user {:?} is not in the mission, whose users are {}", slot.user, names.join(", "))
        })?;
        let Some(problem) = mission.problem(user) else { continue };
        let vehicles = slot.vehicles.clone().map(VehiclePlan::from);
        let score = evaluate(&problem, &vehicles, &options)
            .map_err(|error| format!("user {:?}: {error}", slot.user))?;
        let plan = SlotPlan {
            status: Status::Evaluated,
            vehicles,
            secrecy_rate_bps: score.secrecy_rate_bps,
            standard_error_bps: score.standard_error_bps,
            upper_bound_bps: cap(&problem).map_err(|error| format!("user {:?}: {error}", slot.user))?,
            upper_bound_kind: BoundKind::Cap,
            user_sinr: score.user_sinr,
            eavesdropper_sinr: score.eavesdropper_sinr,
        };
        planned.push(PlannedSlot { user: slot.user.clone(), plan });
    }
    let plan = Plan::new(planned);
    Ok(PlanDocument {
        format: FORMAT,
        mission_digest: mission.digest_hex(),
        plan_digest: hex(&plan.digest),
        seed: mission.seed,
        method: "evaluate".into(),
        slots: plan
            .slots
            .iter()
            .map(|slot| slot_document(mission, &slot.user, &slot.plan, [0.0; 2]))
            .collect(),
    })
}

fn table(mission: &Mission, document: &PlanDocument) -> String {
    let per_hz = |bps: f64| bps / mission.radio.bandwidth_hz;
    let line = |slot: &crate::report::plan_document::SlotDocument| {
        format!(
            "user {}: secrecy rate {:.4} +- {:.4} bit/s/Hz ({:.4} Mbit/s), bound {:.4} ({})\n",
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
