//! A flight in a line and in a paragraph.

use super::facts::{Emission, Facts, SlotRun, ending};
use super::timeline::{EventKind, Severity, Source};
use super::words::{clause, count, instant, sentence, span, speaker};
use crate::desk::simulation::FaultKind;
use crate::role::Role;

/// A vehicle that falls silent this soon after a mark does so because of it.
const REACTION_S: f64 = 2.0;

/// How something is to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tone {
    /// As it should be.
    Good,
    /// Neither.
    Plain,
    /// A fault, a warning.
    Fault,
    /// The mission or its safety suffers.
    Bad,
}

/// How it ended, in a line.
pub fn headline(facts: &Facts) -> (Tone, String) {
    let timeline = facts.timeline;
    let seen = |kind| timeline.events.iter().filter(|event| event.kind == kind).count();
    let violations = seen(EventKind::Violation);
    let kept = match seen(EventKind::Excused) {
        0 => "no invariant broken".to_owned(),
        excused => {
            let excused = count(excused, "time");
            format!("no invariant broken by a companion; {excused} one could not be kept")
        }
    };
    let (whole, part) = facts.served();
    let planned = facts.slots.len();
    let mut slots = format!("{whole} of {} served in full", count(planned, "slot"));
    if part > 0 {
        slots += &format!(", {part} in part");
    }
    if violations > 0 {
        return (Tone::Bad, format!("Not safe: {} broken; {slots}", count(violations, "invariant")));
    }
    match timeline.summary.as_ref().map(|summary| summary.result.as_str()) {
        Some("completed") => (Tone::Good, format!("Completed: {slots}; {kept}")),
        Some("interrupted") => (Tone::Plain, format!("Interrupted by the operator: {slots}; {kept}")),
        Some(_) => (Tone::Fault, format!("Not completed: {slots}; {kept}")),
        None => {
            let trouble = timeline.events.iter().any(|event| event.severity == Severity::Error);
            let tone = if trouble || whole < planned { Tone::Fault } else { Tone::Plain };
            let how = if trouble { "Aborted" } else { "Flown" };
            let who = match timeline.scene.source {
                Source::Telemetry => "as the vehicles' own telemetry tells it",
                Source::Simulation => "without a flight document",
            };
            (tone, format!("{how}, {who}: {slots}"))
        }
    }
}

/// What went wrong, what came of it, and how the vehicles came home.
pub fn lead(facts: &Facts) -> String {
    let mut sentences = Vec::new();
    for (k, mark) in facts.marks.iter().enumerate() {
        // What follows another mark belongs to that one.
        let next_s = facts.marks.get(k + 1).map_or(f64::INFINITY, |next| next.at_s);
        let what = clause(facts.event(mark));
        let while_serving = facts.on_air(Role::I, mark.at_s).and_then(|emission| {
            let run = facts.slots.get(usize::from(emission.slot?))?;
            Some(format!(
                ", {} after vehicle I went on the air for {}",
                span(mark.at_s - emission.from_s),
                name(run)
            ))
        });
        sentences.push(format!("At {}{}, {what}", instant(mark.at_s), while_serving.unwrap_or_default()));
        let silent = Role::BOTH.into_iter().filter_map(|role| {
            let ended = |e: &&Emission| e.ended && e.until_s - mark.at_s <= REACTION_S && e.until_s < next_s;
            let emission = facts.on_air(role, mark.at_s).filter(ended)?;
            Some(format!("vehicle {role} was silent {} later", span(emission.until_s - mark.at_s)))
        });
        let silent: Vec<String> = silent.collect();
        if !silent.is_empty() {
            sentences.push(sentence(&silent.join(" and ")));
        }
    }
    let events = &facts.timeline.events;
    let mut notices = events.iter().enumerate().filter(|(_, event)| event.kind == EventKind::Notice);
    let first_error = || notices.find(|(_, event)| event.severity == Severity::Error).map(|(index, _)| index);
    let abort = ending(events).or_else(first_error);
    // What is marked has been said.
    let told = |index: &usize| facts.marks.iter().any(|mark| mark.event == *index);
    if let Some(event) = abort.filter(|index| !told(index)).map(|index| &events[index]) {
        let who = sentence(&speaker(event.vehicle));
        sentences.push(format!("{who} concluded: \u{201c}{}\u{201d}", event.text));
    }
    sentences.push(protection(facts));
    for role in Role::BOTH {
        sentences.extend(homecoming(facts, role));
    }
    sentences.join(". ") + "."
}

fn name(run: &SlotRun) -> String {
    if run.user.is_empty() { format!("slot {}", run.number) } else { run.user.clone() }
}

fn protection(facts: &Facts) -> String {
    let bare_s = facts.unprotected_s();
    let on_s: f64 = facts.slots.iter().map(|slot| slot.radiated_s.i).sum();
    match facts.timeline.scene.source {
        _ if on_s == 0.0 => "Vehicle I was never on the air".into(),
        Source::Simulation if bare_s == 0.0 => {
            format!("In {} on the air vehicle I was never without vehicle J's jamming", span(on_s))
        }
        Source::Simulation => {
            format!("Vehicle I was on the air for {}, of them {} unprotected", span(on_s), span(bare_s))
        }
        Source::Telemetry if bare_s == 0.0 => format!(
            "By the power commands that the transmitters acknowledged, vehicle I was on the air for {} and never without vehicle J's jamming",
            span(on_s)
        ),
        Source::Telemetry => format!(
            "By the power commands that the transmitters acknowledged, vehicle I was on the air for {}, of them {} without vehicle J",
            span(on_s),
            span(bare_s)
        ),
    }
}

fn homecoming(facts: &Facts, role: Role) -> Option<String> {
    let samples = &facts.timeline.samples;
    let known = || samples.iter().filter_map(move |s| s.vehicles[role].as_ref().map(|v| (s.at_s, v)));
    let (_, start) = known().next()?;
    let flew = known().any(|(_, v)| !v.landed);
    let (last_s, last) = facts.last_state(role)?;
    if !flew {
        return Some(format!("Vehicle {role} never left the ground"));
    }
    if facts.is_lost(role) && !last.landed {
        let (at, mode) = (instant(last_s), &last.mode);
        return Some(format!("Vehicle {role} was last known at {at}, in the air, in {mode}"));
    }
    if !last.landed {
        let marks = || facts.marks.iter().map(|mark| facts.event(mark));
        let befell = |kind| marks().any(|e| e.vehicle == Some(role) && e.fault() == Some(kind));
        let why = match (befell(FaultKind::CompanionKill), befell(FaultKind::PilotMode)) {
            (true, _) => ": it had no companion left to bring it down",
            (false, true) => ": the pilot had it",
            (false, false) => "",
        };
        return Some(format!("Vehicle {role} was still in the air at the end, in {}{why}", last.mode));
    }
    let down_s = known().rfind(|(_, v)| !v.landed).map_or(0.0, |(at_s, _)| at_s);
    let [dx, dy] = [0, 1].map(|k| last.position_enu_m[k] - start.position_enu_m[k]);
    Some(format!(
        "Vehicle {role} landed at {}, {:.1} m from where it had taken off",
        instant(down_s),
        dx.hypot(dy)
    ))
}
