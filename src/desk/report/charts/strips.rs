//! Phases, modes and emissions as strips over flight time.

use super::time::{draw_marks, fits, shade_slots, time_axes, time_ticks};
use super::{Format, THEME, faint};
use crate::desk::drawing::axes::Axes;
use crate::desk::drawing::svg::{Anchor, Svg};
use crate::desk::report::facts::Facts;
use crate::desk::report::timeline::EventKind;
use crate::desk::report::words::power;
use crate::role::Role;

const TOP: f64 = 38.0;
const ROW: f64 = 21.0;
const BOTTOM: f64 = 22.0;

/// A stretch of time with a name.
#[derive(Debug, Clone, PartialEq)]
struct Stretch {
    from_s: f64,
    until_s: f64,
    name: String,
    fill: &'static str,
}

/// The drawing.
#[must_use]
pub fn draw(facts: &Facts, format: Format) -> String {
    let rows: Vec<(String, Vec<Stretch>)> = Role::BOTH
        .into_iter()
        .flat_map(|role| {
            [
                (format!("{role} phase"), phases(facts, role)),
                (format!("{role} mode"), modes(facts, role)),
                (format!("{role} on air"), on_air(facts, role)),
            ]
        })
        .filter(|(_, stretches)| !stretches.is_empty())
        .collect();
    let inner = ROW * rows.len() as f64;
    let size = (format.width(), TOP + inner + BOTTOM);
    let mut svg = Svg::inline(
        &format!("chart-strips-{}", format.name()),
        size,
        THEME,
        "Phases, autopilot modes and emissions over flight time",
        "A row each for the phase that each companion reports, its autopilot's mode, and when it was on the air.",
    );
    let axes = time_axes(facts, format, TOP, inner);
    shade_slots(&mut svg, facts, &axes);
    let xs = time_ticks(&axes, format);
    axes.grid(&mut svg, &xs, &[]);
    for (k, (label, stretches)) in rows.iter().enumerate() {
        let top = TOP + ROW * k as f64 + 2.0;
        let short = label.replace(" on air", " air");
        svg.text((axes.corner.0 - 3.0, top + ROW / 2.0 - 2.0), Anchor::End, &short);
        for stretch in stretches {
            draw_stretch(&mut svg, &axes, top, stretch);
        }
    }
    axes.frame(&mut svg, &xs, &[], [true, false]);
    name_slots(&mut svg, facts, &axes);
    draw_marks(&mut svg, facts, &axes);
    svg.finish()
}

fn draw_stretch(svg: &mut Svg, axes: &Axes, top: f64, stretch: &Stretch) {
    let (x, _) = axes.at(stretch.from_s, 0.0);
    let (right, _) = axes.at(stretch.until_s, 0.0);
    let hint = format!("{}, {:.1} to {:.1} s", stretch.name, stretch.from_s, stretch.until_s);
    svg.titled(&hint, |svg| {
        svg.rectangle((x, top), ((right - x).max(0.6), ROW - 5.0), stretch.fill, None);
        if fits(&stretch.name, x, right) {
            svg.text((f64::midpoint(x, right), top + (ROW - 5.0) / 2.0), Anchor::Middle, &stretch.name);
        }
    });
}

/// The users' names above the shaded slots.
fn name_slots(svg: &mut Svg, facts: &Facts, axes: &Axes) {
    for slot in &facts.slots {
        let Some([from_s, until_s]) = slot.window_s else { continue };
        let (x, _) = axes.at(from_s, 0.0);
        let (right, _) = axes.at(until_s, 0.0);
        let names =
            [format!("slot {}: {}", slot.number, slot.user), slot.user.clone(), slot.number.to_string()];
        if let Some(name) = names.iter().find(|name| !name.is_empty() && fits(name, x - 12.0, right + 12.0)) {
            svg.text((f64::midpoint(x, right), 9.0), Anchor::Middle, name);
        }
    }
}

/// As the companions' notices tell them.
fn phases(facts: &Facts, role: Role) -> Vec<Stretch> {
    let events = facts.timeline.events.iter().filter(|event| event.vehicle == Some(role));
    let named = events.filter_map(|event| {
        let killed = event.kind == EventKind::Fault
            && matches!(event.code.as_deref(), Some("companion-kill" | "companion-restart"));
        let gone = killed || event.kind == EventKind::Process;
        Some((event.at_s, if gone { "gone".to_owned() } else { event.phase.clone()? }))
    });
    stretches(named, facts.end_s, |name| match name {
        "connecting" | "standby" | "ended" | "gone" => "var(--calm)",
        "slot" => "var(--serving)",
        "returning" | "landing" => "var(--homing)",
        "surrendered" | "holding" => "var(--alarm)",
        _ => "var(--flying)",
    })
}

fn modes(facts: &Facts, role: Role) -> Vec<Stretch> {
    let named = facts.timeline.samples.iter().map(|sample| {
        (sample.at_s, sample.vehicles[role].as_ref().map_or_else(String::new, |state| state.mode.clone()))
    });
    let mut all = stretches(named, facts.end_s, |name| match name {
        "OFFBOARD" | "GUIDED" => "var(--flying)",
        name if ["LAND", "RTL"].iter().any(|part| name.contains(part)) => "var(--homing)",
        name if ["POSCTL", "ALTCTL", "STAB", "MANUAL", "ACRO"].iter().any(|part| name.contains(part)) => {
            "var(--alarm)"
        }
        _ => "var(--calm)",
    });
    // Nothing is known of the vehicle where it has no mode.
    all.retain(|stretch| !stretch.name.is_empty());
    all
}

fn on_air(facts: &Facts, role: Role) -> Vec<Stretch> {
    let own = facts.emissions.iter().filter(|emission| emission.role == role);
    own.map(|emission| Stretch {
        from_s: emission.from_s,
        until_s: emission.until_s,
        name: power(emission.power_w),
        fill: faint(role),
    })
    .collect()
}

/// Runs of one name.
fn stretches(
    named: impl Iterator<Item = (f64, String)>,
    end_s: f64,
    fill: impl Fn(&str) -> &'static str,
) -> Vec<Stretch> {
    let mut all: Vec<Stretch> = Vec::new();
    for (at_s, name) in named {
        match all.last_mut() {
            Some(last) if last.name == name => {}
            last => {
                if let Some(last) = last {
                    last.until_s = at_s;
                }
                let fill = fill(&name);
                all.push(Stretch { from_s: at_s, until_s: end_s, name, fill });
            }
        }
    }
    all
}
