//! `veilwing plan`: plans every slot of a mission.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::config::file::{unwritable, usable_directory, write_whole};
use crate::config::{METHODS, Mission, Optimise};
use crate::planner::document::{PlanDocument, SlotDocument};
use crate::planner::problem::Method;
use crate::planning;
use crate::role::Role;
use crate::units::Watts;

use super::planning::{certify_plan, document, plan_mission};
use super::{Exit, load_mission, print_json, print_text};

const AFTER_HELP: &str = "\
Example: veilwing plan config/paper.toml --bound certify --json

What upper_bound_kind says of upper_bound_bps:
  cap               user at the least distance in the plane of maximum gain, eavesdroppers deaf: proven, for every mission
  branch-and-bound  no jitter: no poses and powers do better; proven, rounding included
  without-jitter    the same with the mission's jitter left out, which no jitter can exceed: proven, and loose
  decoupled-signed  under roll-pitch Euler jitter: bounds the mean of the rate with its sign kept (the clipped mean is
                    larger by about 0.003 bit/s/Hz at good plans), as firm as the margins of its quadrature";

/// Plan every slot of a mission: poses, powers, expected secrecy rate.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub(super) struct Args {
    /// Mission file.
    mission: PathBuf,
    /// Print the plan as one JSON document.
    #[arg(long)]
    json: bool,
    /// Planner to use instead of the mission file's.
    #[arg(long, value_name = "M", value_parser = method_parser())]
    method: Option<Method>,
    /// Seed instead of the mission file's.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<u64>,
    /// Threads to plan with; the plan does not depend on it.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// Upper bound on the rate beside the plan's own.
    #[arg(long, value_enum, default_value_t = BoundSearch::Cap)]
    bound: BoundSearch,
    /// Write plan.json into this directory as well; made if it is not there.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// How hard to look for an upper bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum BoundSearch {
    /// The cap alone, at once
    Cap,
    /// Branch and bound as well, a fixed budget of boxes: about a second a slot without jitter, ten with
    Certify,
}

fn method_parser() -> impl TypedValueParser<Value = Method> {
    PossibleValuesParser::new(METHODS.iter().map(|(name, _)| *name)).try_map(|text| {
        let found = METHODS.iter().find(|(name, _)| *name == text);
        found.map(|(_, method)| *method).ok_or("no such method")
    })
}

pub(super) fn run(args: &Args) -> Exit {
    let mission = match load_mission(&args.mission) {
        Ok(mission) => mission,
        Err(exit) => return exit,
    };
    // Before the work, not after it, is the time to learn that the directory cannot be written.
    if let Some(Err(error)) = args.out.as_deref().map(usable_directory) {
        eprintln!("error: {error}");
        return Exit::Unusable;
    }
    let mut options = planning::options(&mission);
    options.method = args.method.unwrap_or(options.method);
    options.seed = args.seed.unwrap_or(options.seed);
    options.threads = args.threads.into();
    let planned = plan_mission(&mission, &options).and_then(|mut timed| {
        if args.bound == BoundSearch::Certify {
            certify_plan(&mission, &mut timed)?;
        }
        Ok(timed)
    });
    let timed = match planned {
        Ok(timed) => timed,
        Err(error) => {
            eprintln!("{}: {error}", args.mission.display());
            return Exit::Unusable;
        }
    };
    let document = document(&mission, &options, &timed);
    let kept = args.out.as_deref().map_or(Ok(()), |out| write_plan(out, &document));
    let shown = if args.json { print_json(&document) } else { print_text(&table(&mission, &document)) };
    kept.err().unwrap_or(shown)
}

/// Writes `plan.json` into a directory, which is made if it is not there.
pub(super) fn write_plan(out: &Path, document: &PlanDocument) -> Result<(), Exit> {
    let path = out.join("plan.json");
    let text = serde_json::to_string_pretty(document).map_err(|error| error.to_string());
    let written = text.and_then(|text| {
        std::fs::create_dir_all(out).map_err(|error| unwritable(out, &error))?;
        write_whole(&path, &text)
    });
    written.map_err(|error| {
        eprintln!("error: {error}");
        Exit::Unusable
    })
}

/// The plan for a reader.
fn table(mission: &Mission, document: &PlanDocument) -> String {
    let mut text = format!(
        "mission {} ({}), plan {}, method {}, seed {}\n",
        mission.name,
        &document.mission_digest[..12],
        &document.plan_digest[..12],
        document.method,
        document.seed
    );
    // Writing to a String cannot fail.
    let _ = write_superframe(&mut text, mission, document);
    for slot in &document.slots {
        let _ = write_slot(&mut text, mission, slot);
    }
    text
}

/// What a superframe delivers, and in what time.
fn write_superframe(text: &mut String, mission: &Mission, document: &PlanDocument) -> std::fmt::Result {
    let per_hz = |bits: f64| bits / mission.radio.bandwidth_hz;
    let PlanDocument { secrecy_volume_bits, superframe_s, on_air_s, least_user_volume_bits, .. } = document;
    let aims = match mission.planner.optimise {
        Optimise::Rate => "each slot by its rate",
        Optimise::Volume => "all slots by volume",
    };
    write!(text, "\nsuperframe ({aims}): {:.2} bit/Hz", per_hz(*secrecy_volume_bits))?;
    match superframe_s {
        Some(length_s) => write!(
            text,
            " in {length_s:.1} s, {:.3} bit/s/Hz\n  on the air {on_air_s:.1} s, {:.1}% of the time",
            per_hz(secrecy_volume_bits / length_s),
            100.0 * on_air_s / length_s,
        )?,
        None => write!(text, ", but no way from slot to slot\n  on the air {on_air_s:.1} s")?,
    }
    let least =
        |a: &&SlotDocument, b: &&SlotDocument| slot_volume(mission, a).total_cmp(&slot_volume(mission, b));
    let user = document.slots.iter().min_by(least).map_or("", |slot| slot.user.as_str());
    writeln!(text, "; least served {user}: {:.2} bit/Hz", per_hz(*least_user_volume_bits))
}

/// What a slot delivers, bits.
fn slot_volume(mission: &Mission, slot: &SlotDocument) -> f64 {
    (slot.slot_s - mission.tdma.guard_s) * slot.secrecy_rate_bps
}

/// What of the bound the plan leaves, at most, as a share of the bound.
fn gap(slot: &SlotDocument) -> f64 {
    // A bound of zero (no power) leaves nothing.
    if slot.upper_bound_bps > 0.0 { 1.0 - slot.secrecy_rate_bps / slot.upper_bound_bps } else { 0.0 }
}

fn write_slot(text: &mut String, mission: &Mission, slot: &SlotDocument) -> std::fmt::Result {
    let per_hz = |bps: f64| bps / mission.radio.bandwidth_hz;
    writeln!(
        text,
        "\nuser {}: secrecy rate {:.3} +- {:.3} bit/s/Hz ({:.4} Mbit/s)\n  {:.2} bit/Hz in a slot of {} s; {}, planned in {:.1} ms",
        slot.user,
        per_hz(slot.secrecy_rate_bps),
        per_hz(slot.standard_error_bps),
        slot.secrecy_rate_bps / 1e6,
        per_hz(slot_volume(mission, slot)),
        slot.slot_s,
        slot.status,
        slot.planning_time_s * 1e3,
    )?;
    if slot.objective_bps != slot.secrecy_rate_bps {
        writeln!(
            text,
            "  objective {:.3} bit/s/Hz: what was asked for; the rate above is the mean",
            per_hz(slot.objective_bps)
        )?;
    }
    write!(
        text,
        "  upper bound {:.3} bit/s/Hz ({}), gap {:.2}%",
        per_hz(slot.upper_bound_bps),
        slot.upper_bound_kind,
        gap(slot) * 100.0,
    )?;
    if slot.bound_time_s > 0.0 {
        write!(text, ", found in {:.2} s", slot.bound_time_s)?;
    }
    writeln!(text)?;
    write_assessment(text, slot, per_hz)?;
    let db = |sinr: f64| 10.0 * sinr.log10();
    write!(text, "  SINR: user {:.1} dB", db(slot.sinr.user))?;
    for eavesdropper in &slot.sinr.eavesdroppers {
        write!(text, ", {} {:.1} dB", eavesdropper.name, db(eavesdropper.sinr))?;
    }
    writeln!(text, "\n     east_m  north_m   up_m  roll_deg  pitch_deg  yaw_deg  off_deg  power")?;
    for role in Role::BOTH {
        let v = &slot.vehicles[role];
        let [e, n, u] = v.position_enu_m;
        writeln!(
            text,
            "  {role} {e:>7.1} {n:>8.1} {u:>6.1} {:>9.2} {:>10.2} {:>8.2} {:>8.1}  {}",
            v.roll_rad.to_degrees(),
            v.pitch_rad.to_degrees(),
            v.yaw_rad.to_degrees(),
            slot.attitude_tolerance_deg[role],
            Watts(v.tx_power_w)
        )?;
    }
    Ok(())
}

/// What most slots exceed, how likely one misses the target, and what each imperfection costs: where the mission states more
/// than jitter.
fn write_assessment(text: &mut String, slot: &SlotDocument, per_hz: impl Fn(f64) -> f64) -> std::fmt::Result {
    let is_cause = |cause: &str| cause != "all";
    let stated = slot.loss_bps.keys().any(|cause| is_cause(cause) && *cause != "jitter");
    if !stated && slot.miss_probability.is_none() {
        return Ok(());
    }
    write!(text, "  19 slots in 20 exceed {:.3} bit/s/Hz", per_hz(slot.quantile_5pct_bps))?;
    if let Some(probability) = slot.miss_probability {
        write!(text, "; {:.1}% miss the target", probability * 100.0)?;
    }
    writeln!(text)?;
    let Some(all) = slot.loss_bps.get("all") else { return Ok(()) };
    writeln!(text, "  lost to imperfections, bit/s/Hz: {:.3} together; alone", per_hz(*all))?;
    for (cause, loss) in slot.loss_bps.iter().filter(|(cause, _)| is_cause(cause)) {
        writeln!(text, "    {cause:<13} {:>7.3}", per_hz(*loss))?;
    }
    Ok(())
}
