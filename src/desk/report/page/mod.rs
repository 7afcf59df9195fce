//! The page: one HTML file with everything in it, which is also well-formed XML.

mod drawings;
mod replay;
mod tables;

use std::fmt::Write as _;

use super::charts::ground::Square;
use super::facts::Facts;
use super::story::{Beat, Story, tell};
use super::timeline::{Source, Timeline};
use super::verdict::Tone;
use super::words::{instant, span};
use crate::desk::drawing::svg::escape;

const STYLE: &str = include_str!("style.css");

/// The report of a flight.
#[must_use]
pub fn html(timeline: &Timeline) -> String {
    let facts = Facts::new(timeline);
    let story = tell(&facts);
    let mission = escape(&timeline.scene.mission);
    let mut page = String::from("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n");
    // Nothing is fetched, whatever somebody has written into a file of the flight.
    page += "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'\"/>\n";
    page += "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n";
    page += &format!("<title>Flight report: {mission}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n");
    head(&mut page, &facts, &story);
    page += "<main>\n";
    section(&mut page, "story", "What happened", &happened(&story));
    section(&mut page, "slots", "The slots", &tables::slots(&facts));
    let square = Square::of(&facts);
    section(&mut page, "map", "From above", &drawings::overview(&facts));
    section(&mut page, "replay", "The flight again", &replay::section(&facts));
    section(&mut page, "secrecy", "Secrecy on the ground", &drawings::secrecy(&facts, &square));
    section(&mut page, "time", "Over time", &drawings::over_time(&facts));
    section(&mut page, "preflight", "Before the flight", &tables::preflight(&facts));
    section(&mut page, "rules", "What must never happen", &tables::invariants(&facts));
    section(&mut page, "plan", "The plan", &tables::plan(&facts));
    section(&mut page, "record", "About this record", &tables::record(&facts));
    page += "</main>\n<footer class=\"muted\"><p>Written by veilwing ";
    page += env!("CARGO_PKG_VERSION");
    page += "; this file needs nothing but itself.</p></footer>\n</body>\n</html>\n";
    page
}

/// A section, unless there is nothing to say in it.
fn section(page: &mut String, id: &str, title: &str, inner: &str) {
    if !inner.is_empty() {
        // Writing to a String cannot fail.
        let _ = write!(
            page,
            "<section aria-labelledby=\"{id}\">\n<h2 id=\"{id}\">{title}</h2>\n{inner}</section>\n"
        );
    }
}

fn class(tone: Tone) -> &'static str {
    match tone {
        Tone::Good => "good",
        Tone::Plain => "plain",
        Tone::Fault => "fault",
        Tone::Bad => "bad",
    }
}

fn head(page: &mut String, facts: &Facts, story: &Story) {
    let scene = &facts.timeline.scene;
    let who = match scene.source {
        Source::Simulation => {
            "Simulated flight, measured by the simulated world from true states and true powers"
        }
        Source::Telemetry => {
            "From the telemetry logs of both vehicles alone: what they estimated and acknowledged"
        }
    };
    let _ = write!(
        page,
        "<header>\n<h1>Flight report: {}</h1>\n<p class=\"muted\">{who}.</p>\n<p class=\"verdict {}\" role=\"status\">{}.</p>\n<p class=\"lead\">{}</p>\n<dl class=\"figures\">\n",
        escape(&scene.mission),
        class(story.tone),
        escape(&story.headline),
        escape(&story.lead)
    );
    for (name, value) in key_figures(facts) {
        let _ = writeln!(page, "<div><dt>{}</dt><dd>{}</dd></div>", escape(&name), escape(&value));
    }
    page.push_str("</dl>\n</header>\n");
}

fn key_figures(facts: &Facts) -> Vec<(String, String)> {
    let timeline = facts.timeline;
    let estimated = timeline.scene.source == Source::Telemetry;
    let named = |name: &str, value: String| (name.to_owned(), value);
    let on_s: f64 = facts.slots.iter().map(|slot| slot.radiated_s.i).sum();
    let mut figures = vec![
        named("slots served in full", format!("{} of {}", facts.served().0, facts.slots.len())),
        named("user data on the air", span(on_s)),
        named(
            if estimated { "unprotected, as acknowledged" } else { "of it unprotected" },
            span(facts.unprotected_s()),
        ),
    ];
    if let Some(ratio) = ratio(facts) {
        figures.push(named(
            if estimated { "estimated of planned secrecy" } else { "achieved of planned secrecy" },
            format!("{:.1}%", 100.0 * ratio),
        ));
    }
    if let Some(metres) = least_separation_m(facts) {
        figures.push(named("least separation", format!("{metres:.1} m")));
    }
    if let Some(summary) = &timeline.summary {
        figures.push(named("invariants broken", summary.violations.len().to_string()));
    }
    figures.push(named("length of the record", instant(facts.end_s)));
    figures
}

/// Achieved over planned, over all slots served, by the time on the air.
fn ratio(facts: &Facts) -> Option<f64> {
    let rated = facts.slots.iter().filter_map(|s| Some((s.achieved_bps?, s.planned_bps?, s.radiated_s.i)));
    let (achieved, planned) =
        rated.fold((0.0, 0.0), |sum, (a, p, on_s)| (sum.0 + a * on_s, sum.1 + p * on_s));
    (planned > 0.0).then(|| achieved / planned)
}

/// Measured by the world, or else the least of the samples in which both are off the ground.
fn least_separation_m(facts: &Facts) -> Option<f64> {
    if let Some(summary) = &facts.timeline.summary {
        return summary.min_separation_m;
    }
    let apart = facts.timeline.samples.iter().filter_map(|sample| {
        let (i, j) = (sample.vehicles.i.as_ref()?, sample.vehicles.j.as_ref()?);
        let squares = (0..3).map(|k| (i.position_enu_m[k] - j.position_enu_m[k]).powi(2));
        (!i.landed && !j.landed).then(|| squares.sum::<f64>().sqrt())
    });
    apart.reduce(f64::min)
}

fn happened(story: &Story) -> String {
    let mut inner = String::new();
    let marks = story.beats.iter().filter(|beat| beat.mark.is_some()).count();
    if marks > 0 {
        inner += &format!(
            "<p class=\"muted\">{} in the charts below: <span class=\"disc\">1</span>. Times in grey count from the last one.</p>\n",
            if marks == 1 { "The mark" } else { "The marks" }
        );
    }
    inner += "<ol class=\"story\">\n";
    for beat in &story.beats {
        inner += &told(beat);
    }
    inner + "</ol>\n"
}

fn told(beat: &Beat) -> String {
    let mark = beat.mark.map_or(String::new(), |number| format!("<span class=\"disc\">{number}</span> "));
    let since = beat
        .since
        .filter(|(_, seconds)| *seconds > 0.0)
        .map_or(String::new(), |(_, seconds)| format!(" <span class=\"since\">(+{})</span>", span(seconds)));
    let class = format!("{}{}", class(beat.tone), if beat.mark.is_some() { " mark" } else { "" });
    format!(
        "<li class=\"{class}\"><time>{}</time><span>{mark}{}{since}</span></li>\n",
        instant(beat.at_s),
        escape(&beat.text)
    )
}
