//! The page's figures: drawings with caption and legend.

use crate::desk::drawing::svg::{Marker, Stroke, Svg, escape};
use crate::desk::report::charts::ground::{Square, overview as draw_overview};
use crate::desk::report::charts::secrecy::{SHADES, SecrecyMap};
use crate::desk::report::charts::series::charts;
use crate::desk::report::charts::time::Chart;
use crate::desk::report::charts::{Format, THEME, colour, strips};
use crate::desk::report::facts::Facts;
use crate::desk::report::timeline::Source;
use crate::role::Role;

/// Maps of more slots than this are left out.
const MOST_MAPS: usize = 12;

/// Both widths of a drawing.
fn both(draw: impl Fn(Format) -> String) -> String {
    let mut text = String::new();
    for format in Format::ALL {
        text += &format!("<div class=\"{}\">{}</div>\n", format.name(), draw(format));
    }
    text
}

fn figure(title: &str, about: &str, legend: &str, drawing: &str) -> String {
    format!(
        "<figure>\n<figcaption><strong>{}</strong><p>{}</p>{legend}</figcaption>\n{drawing}</figure>\n",
        escape(title),
        escape(about)
    )
}

/// A legend's entries: a small drawing and its name.
fn legend(entries: &[(String, String)]) -> String {
    let mut text = String::from("<ul class=\"legend\">");
    for (sign, name) in entries {
        text += &format!("<li>{sign}{}</li>", escape(name));
    }
    text + "</ul>"
}

/// A sign of a legend, which is described by the name beside it.
fn sign(draw: impl FnOnce(&mut Svg)) -> String {
    let mut svg = Svg::inline("sign", (26.0, 12.0), THEME, "", "");
    draw(&mut svg);
    let text = svg.finish();
    let body = text.split_once("</desc>").map_or(text.as_str(), |(_, body)| body);
    format!("<svg viewBox=\"0 0 26 12\" aria-hidden=\"true\">{}", body.trim_end())
}

fn line_sign(stroke: &Stroke) -> String {
    sign(|svg| svg.line(&[(1.0, 6.0), (25.0, 6.0)], stroke))
}

fn marker_sign(marker: Marker, colour: &'static str) -> String {
    sign(|svg| svg.marker((13.0, 6.0), marker, colour, 4.2))
}

/// The whole flight from above.
pub fn overview(facts: &Facts) -> String {
    let scene = &facts.timeline.scene;
    let mut entries = Vec::new();
    let mut add = |sign: String, name: &str| entries.push((sign, name.to_owned()));
    if !scene.users.is_empty() {
        add(marker_sign(Marker::OpenSquare, "var(--user)"), "user");
    }
    let listeners = &scene.eavesdroppers;
    if !listeners.is_empty() {
        add(marker_sign(Marker::Cross, "var(--eve)"), "eavesdropper, as the mission estimates it");
    }
    let ring = Stroke { colour: "var(--eve)", width: 1.1, dashes: "3 2.5" };
    if listeners.iter().any(|e| e.radius_m.is_some()) {
        add(line_sign(&ring), "where it may be");
    }
    if listeners.iter().any(|e| e.std_m.is_some()) {
        add(line_sign(&ring), "one and two standard deviations of where it may be");
    }
    if listeners.iter().any(|e| e.true_position_enu_m.is_some_and(|truth| truth != e.position_enu_m)) {
        add(marker_sign(Marker::Circle, "var(--eve)"), "where it truly was");
    }
    for (role, marker, name) in [(Role::I, Marker::Disc, "I"), (Role::J, Marker::Diamond, "J")] {
        if !scene.slots.is_empty() {
            let pose = sign(|svg| {
                svg.line(&[(4.0, 6.0), (22.0, 6.0)], &Stroke::solid(colour(role), 2.4));
                svg.marker((13.0, 6.0), marker, colour(role), 4.2);
            });
            add(pose, &format!("{name}'s pose in a slot with its antenna's axis"));
        }
        let dashes = if role == Role::I { "" } else { "7 3" };
        add(line_sign(&Stroke { colour: colour(role), width: 1.5, dashes }), &format!("{name}'s path"));
    }
    if scene.airspace.is_some() {
        add(line_sign(&Stroke { colour: "var(--muted)", width: 1.0, dashes: "8 4" }), "geofence");
    }
    let about = match scene.source {
        Source::Simulation => {
            "Where everything truly was. An axis is drawn as long as it looks from above: a point is an upright antenna."
        }
        Source::Telemetry => {
            "Paths as the vehicles estimated them; eavesdroppers where the mission takes them to be: where they truly were, nobody knows."
        }
    };
    let drawing = both(|format| draw_overview(facts, format));
    format!("<div class=\"map\">{}</div>\n", figure("Map", about, &legend(&entries), &drawing))
}

/// The secrecy map of each slot that was flown.
pub fn secrecy(facts: &Facts, square: &Square) -> String {
    let flown: Vec<_> =
        facts.slots.iter().filter_map(|run| Some((run, SecrecyMap::new(facts, run, square)?))).collect();
    let Some(top) = flown.iter().map(|(_, map)| map.highest()).reduce(f64::max).filter(|top| *top > 0.0)
    else {
        return String::new();
    };
    let top = top.ceil();
    let mut text = String::from(
        "<p>For every point of the ground: the secrecy rate of the slot as it was flown, if the only eavesdropper were there. Bright ground is safe; dark ground is where a listener would take the secret away.</p>\n",
    );
    if facts.timeline.scene.source == Source::Telemetry {
        text += "<p>Estimated from the vehicles' telemetry by the mission's radio model.</p>\n";
    }
    text += "<div class=\"scale\" aria-hidden=\"true\">";
    for shade in SHADES {
        text += &format!("<span style=\"background:{shade}\"></span>");
    }
    text += &format!("</div><div class=\"ends\"><span>0</span><span>{top:.0} bit/s/Hz</span></div>\n");
    let contour = |colour, dashes| line_sign(&Stroke { colour, width: 1.6, dashes });
    text += &legend(&[
        (contour("var(--i)", "6 3"), "I: half its gain".into()),
        (contour("var(--j)", "6 3"), "J: half its gain".into()),
        (contour("var(--j)", "1.5 2"), "J: a hundredth of its gain, the edge of its null".into()),
    ]);
    text += "<div class=\"maps\">\n";
    for (run, map) in flown.iter().take(MOST_MAPS) {
        let title = format!("Slot {}, user {}", run.number, run.user);
        text += &figure(&title, "", "", &map.draw(facts, run, square, top));
    }
    text += "</div>\n";
    if flown.len() > MOST_MAPS {
        text += &format!("<p class=\"muted\">Slots from {MOST_MAPS} on are not drawn.</p>\n");
    }
    let silent: Vec<String> = facts
        .slots
        .iter()
        .filter(|run| run.radiated_s.i <= 0.0)
        .map(|run| format!("{} ({})", run.number, run.user))
        .collect();
    if !silent.is_empty() {
        text += &format!("<p class=\"muted\">Not flown: slot {}.</p>\n", escape(&silent.join(", ")));
    }
    text
}

/// Strips and charts over flight time.
pub fn over_time(facts: &Facts) -> String {
    let about =
        "Flight time in seconds runs to the right in all charts. Shaded: somebody is on the air for a slot.";
    let mut text = figure("Phases, modes, emissions", about, "", &both(|format| strips::draw(facts, format)));
    for chart in charts(facts) {
        let drawing = both(|format| chart.draw(facts, format));
        text += &figure(&chart.title, &chart.about, &series_legend(&chart), &drawing);
    }
    text
}

fn series_legend(chart: &Chart) -> String {
    let shown = chart
        .series
        .iter()
        .filter(|series| !series.label.is_empty() && series.points.iter().any(|(_, value)| value.is_some()));
    let entries: Vec<_> = shown.map(|series| (line_sign(&series.stroke), series.label.clone())).collect();
    legend(&entries)
}
