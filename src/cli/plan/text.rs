//! A plan for a reader.

use std::fmt::Write as _;
use std::time::Duration;

use crate::cli::folded;
use crate::config::{Mission, Optimise};
use crate::planner::document::{PlanDocument, SlotDocument};
use crate::planner::moving::Demand;
use crate::planner::plan::BoundKind;
use crate::planner::problem::{Airframe, PowerSteps};
use crate::planner::slots::Plan;
use crate::planner::turning::{Between, Protected};
use crate::planning::timetable::timetable;
use crate::role::Role;
use crate::units::Watts;

/// Columns of a narrow window.
const COLUMNS: usize = 80;

/// The plan for a reader.
pub(super) fn table(mission: &Mission, plan: &Plan, document: &PlanDocument) -> String {
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
    let _ = write_times(&mut text, mission, plan);
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
    slot.turning.as_ref().map_or_else(
        || (slot.slot_s - mission.tdma.guard_s) * slot.secrecy_rate_bps,
        |turning| turning.secrecy_volume_bits,
    )
}

fn write_slot(text: &mut String, mission: &Mission, slot: &SlotDocument) -> std::fmt::Result {
    let per_hz = |bps: f64| bps / mission.radio.bandwidth_hz;
    writeln!(
        text,
        "\nuser {}: secrecy rate {:.3} +- {:.3} bit/s/Hz ({:.4} Mbit/s)\n  {:.2} bit/Hz in a slot of {} s",
        slot.user,
        per_hz(slot.secrecy_rate_bps),
        per_hz(slot.standard_error_bps),
        slot.secrecy_rate_bps / 1e6,
        per_hz(slot_volume(mission, slot)),
        slot.slot_s,
    )?;
    if slot.objective_bps != slot.secrecy_rate_bps {
        writeln!(
            text,
            "  objective {:.3} bit/s/Hz: what was asked for; the rate above is the mean",
            per_hz(slot.objective_bps)
        )?;
    }
    write_reasons(text, mission, slot, per_hz)?;
    write_assessment(text, slot, per_hz)?;
    write_bound(text, slot, per_hz)?;
    write_folded(text, &format!("{}; planned in {:.1} ms", ended(slot.status), slot.planning_time_s * 1e3))?;
    write_folded(text, &heard(slot))?;
    writeln!(text, "     east_m  north_m   up_m  roll_deg  pitch_deg  yaw_deg  off_deg  power")?;
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

/// What is received of I, over J and the noise, at the desired attitudes.
fn heard(slot: &SlotDocument) -> String {
    if slot.vehicles.i.tx_power_w <= 0.0 {
        return "SINR: none, nothing is radiated".to_owned();
    }
    let db = |sinr: f64| 10.0 * sinr.log10();
    let mut text = format!("SINR: user {:.1} dB", db(slot.sinr.user));
    for eavesdropper in &slot.sinr.eavesdroppers {
        // Writing to a String cannot fail.
        let _ = write!(text, ", {} {:.1} dB", eavesdropper.name, db(eavesdropper.sinr));
    }
    text
}

/// A line, indented, broken where it would be longer than a narrow window.
fn write_folded(text: &mut String, line: &str) -> std::fmt::Result {
    for (number, line) in folded(line, COLUMNS - 4).into_iter().enumerate() {
        writeln!(text, "{}{line}", if number == 0 { "  " } else { "    " })?;
    }
    Ok(())
}

/// What jamming is worth, who sets the rate, and what holds it down.
fn write_reasons(
    text: &mut String,
    mission: &Mission,
    slot: &SlotDocument,
    per_hz: impl Fn(f64) -> f64,
) -> std::fmt::Result {
    let best = slot
        .best_unprotected_rate_bps
        .map_or(String::new(), |best_bps| format!("; {:.3} at the best poses for I alone", per_hz(best_bps)));
    write_folded(text, &format!("with J off {:.3} at these poses{best}", per_hz(slot.unprotected_rate_bps)))?;
    if let Some(name) = &slot.decisive_eavesdropper {
        let without = slot
            .without_decisive_bps
            .map_or(String::new(), |bps| format!(": without it {:.3} at these poses", per_hz(bps)));
        write_folded(text, &format!("set by eavesdropper {name}{without}"))?;
    }
    writeln!(text, "  limits that bind:{}", if slot.limits.is_empty() { " none" } else { "" })?;
    slot.limits.iter().try_for_each(|name| writeln!(text, "    {}", limit_in_words(mission, name)))
}

/// A limit of the document, with its value and the setting that it comes from.
fn limit_in_words(mission: &Mission, name: &str) -> String {
    let Some((role, what)) = Role::BOTH.into_iter().find_map(|role| {
        let rest = name.strip_prefix(role.key())?.strip_prefix('.')?;
        Some((role, rest))
    }) else {
        let least_m = mission.airspace.min_separation_m;
        return format!("the vehicles {least_m} m apart (airspace.min_separation_m)");
    };
    let [low_m, high_m] = mission.airspace.altitude_m;
    let (power_w, ceiling) = mission.power_ceiling(role);
    let steps = format!("vehicles.{}", role.key());
    match what {
        "fence" => format!("{role} at the area's edge (airspace.area_enu_m)"),
        "no-fly" => format!("{role} at a no-fly area's face (airspace.no_fly)"),
        "floor" => format!("{role} at its lowest, {low_m} m (airspace.altitude_m)"),
        "ceiling" => format!("{role} at its highest, {high_m} m (airspace.altitude_m)"),
        "tilt" => match mission.vehicles[role].airframe {
            Airframe::Conventional => format!("{role} level ({steps}.airframe)"),
            Airframe::Omnidirectional => {
                let own_rad = mission.vehicles[role].max_tilt_rad;
                let air_rad = mission.airspace_max_tilt_rad;
                let key = if own_rad <= air_rad { steps } else { "airspace".to_owned() };
                let most_deg = own_rad.min(air_rad).to_degrees();
                format!("{role} tilted by {most_deg:.1} deg ({key}.max_tilt_deg)")
            }
        },
        "least-power" => match &mission.power_steps[role] {
            PowerSteps::Levels(_) => format!("{role} at its least power ({steps}.power_levels_w)"),
            PowerSteps::Any | PowerSteps::AtLeast(_) => {
                format!("{role} at its least power ({steps}.min_power_w)")
            }
        },
        _ => match &mission.power_steps[role] {
            PowerSteps::Levels(_) => format!("{role} at its largest power ({steps}.power_levels_w)"),
            PowerSteps::Any | PowerSteps::AtLeast(_) => {
                format!("{role} at its largest power, {} ({})", Watts(power_w), ceiling.key())
            }
        },
    }
}

/// How the search ended, in words.
fn ended(status: &str) -> &'static str {
    match status {
        "converged" => "the search has converged",
        "iteration-limit" => {
            "the search ran out of iterations: the best it met, and perhaps not the best there is nearby"
        }
        "no-positive-rate" => "no poses and powers have a positive rate: both transmitters stay off",
        _ => "not searched: given poses and powers",
    }
}

/// The bound, and what of it the plan leaves. The cap bounds any plan of any mission alike: no distance to it says anything
/// about this one.
fn write_bound(text: &mut String, slot: &SlotDocument, per_hz: impl Fn(f64) -> f64) -> std::fmt::Result {
    let bound = per_hz(slot.upper_bound_bps);
    if slot.upper_bound_kind == BoundKind::Cap.name() {
        let words = "no plan can exceed";
        return write_folded(
            text,
            &format!(
                "{words} {bound:.3} bit/s/Hz, were the eavesdroppers deaf (cap); --bound certify looks closer"
            ),
        );
    }
    // A bound of zero (no power) leaves nothing.
    let gap = if bound > 0.0 { 1.0 - slot.secrecy_rate_bps / slot.upper_bound_bps } else { 0.0 };
    write_folded(
        text,
        &format!(
            "upper bound {bound:.3} bit/s/Hz ({}), gap {:.2}%, found in {:.2} s",
            slot.upper_bound_kind,
            gap * 100.0,
            slot.bound_time_s
        ),
    )
}

/// Slots that are listed; a mission may have tens of thousands.
const LISTED: usize = 20;

/// Who is served when in a superframe in which the vehicles turn on the air.
fn write_turns(text: &mut String, plan: &Plan, turns: &Protected) -> std::fmt::Result {
    writeln!(text, "\nuser                 begins_s  on_air_s  silent_s  between")?;
    for slot in &turns.slots {
        let user = plan.slots.get(slot.user).map_or("", |slot| slot.user.as_str());
        let user: String = user.chars().take(20).collect();
        let begins_s = slot.knots.first().map_or(0.0, |knot| knot.at_s);
        let between = match slot.between {
            Between::Turn(_) => "turn",
            Between::Transit => "transit",
        };
        writeln!(
            text,
            "{user:<20} {begins_s:>8.1} {:>9.1} {:>9.2}  {between}",
            slot.on_air_s, slot.silence_s
        )?;
    }
    if let Some(ways) = &plan.ways {
        let most = |of: fn(&Demand) -> f64| of(&ways.i.demand()).max(of(&ways.j.demand()));
        writeln!(
            text,
            "both move all the while: at most {:.1} m/s, climbing {:.1} m/s, {:.1} m/s^2",
            most(|demand| demand.speed_m_s),
            most(|demand| demand.climb_m_s),
            most(|demand| demand.acceleration_m_s2),
        )?;
    }
    writeln!(text, "and again after {:.1} s", turns.superframe_s)
}

/// When each slot is flown, and how long all of them take.
fn write_times(text: &mut String, mission: &Mission, plan: &Plan) -> std::fmt::Result {
    if let Some(turns) = &plan.turns {
        return write_turns(text, plan, turns);
    }
    let table = match timetable(mission, plan) {
        Ok(Some(table)) => table,
        Ok(None) => {
            let slots = plan.slots.len() * usize::from(mission.tdma.superframes);
            writeln!(text)?;
            let said = format!(
                "slots: {slots} of {} s, each after a transit; [vehicles.i] and [vehicles.j] home_enu_m would tell when",
                mission.tdma.slot_s
            );
            return folded(&said, COLUMNS).iter().try_for_each(|line| writeln!(text, "{line}"));
        }
        Err(error) => {
            writeln!(text)?;
            let said = format!("slots: they cannot be flown one after the other: {error}");
            return folded(&said, COLUMNS).iter().try_for_each(|line| writeln!(text, "{line}"));
        }
    };
    writeln!(text, "\nslot  user                 transit_s  opens_s  on_air_s  closes_s")?;
    let seconds = |from: Duration, until: Duration| until.saturating_sub(from).as_secs_f64();
    for entry in table.entries.iter().take(LISTED) {
        let user = plan.slots.get(entry.user_index).map_or("", |slot| slot.user.as_str());
        let user: String = user.chars().take(20).collect();
        writeln!(
            text,
            "{:>4}  {user:<20} {:>9.1} {:>8.1} {:>9.1} {:>9.1}",
            entry.slot,
            seconds(entry.transit_starts, entry.opens),
            entry.opens.as_secs_f64(),
            seconds(entry.radiate_from, entry.radiate_until),
            entry.closes.as_secs_f64(),
        )?;
    }
    if table.entries.len() > LISTED {
        writeln!(text, "      and {} more", table.entries.len() - LISTED)?;
    }
    let whole_s = table.ends.as_secs_f64();
    let length = if whole_s < 120.0 {
        format!("{whole_s:.1} s")
    } else {
        format!("{:.0} min {:.0} s", (whole_s / 60.0).floor(), (whole_s % 60.0).floor())
    };
    writeln!(text, "from above the homes to the end of the last slot {length}; then the way home")
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
