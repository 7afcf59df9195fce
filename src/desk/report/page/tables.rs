//! The page's tables.

use crate::desk::drawing::svg::escape;
use crate::desk::report::facts::Facts;
use crate::desk::report::said::Said;
use crate::desk::report::timeline::{EventKind, Source};
use crate::desk::report::words::{instant, power, utc};
use crate::role::Role;

/// The invariants in words, as the world watches them from outside.
const INVARIANTS: [(&str, &str); 9] = [
    ("S1", "I radiates only in its slot, in its pose, and while J jams the same slot"),
    ("S2", "J radiates only in its slot and in its pose, so that it never jams the user"),
    ("S3", "J is on before I, and goes off after I unless a fault forces it"),
    (
        "S4",
        "whatever fails, the transmitters fall silent: 100 ms after the first sign on the wire, by the lease where the link or the peer is gone; I follows a jammer that goes off out of turn",
    ),
    (
        "S5",
        "a transmitter whose companion is gone falls silent by itself, and no command lasts longer than a lease",
    ),
    ("S6", "no power above the plan's, the mission's or the permission's"),
    ("F1", "separation, geofence and heights are kept"),
    (
        "F2",
        "once another hand has taken a vehicle, its companion sends no setpoint and does not take it back unasked",
    ),
    ("F3", "no setpoint and no HEARTBEAT comes from a companion that is gone"),
];

/// A cell of a table.
enum Cell {
    Text(String),
    Wrapped(String),
    Figure(String),
    Bad(String),
}

fn figure(value: Option<f64>, decimals: usize) -> Cell {
    Cell::Figure(value.map_or("\u{2013}".into(), |value| format!("{value:.decimals$}")))
}

fn table(caption: &str, head: &[&str], texts: usize, rows: &[Vec<Cell>]) -> String {
    let mut text = format!(
        "<p class=\"muted\">{0}</p>\n<div class=\"scroll\" role=\"region\" tabindex=\"0\" aria-label=\"{0}\">\n<table>\n<thead><tr>",
        escape(caption)
    );
    for (k, name) in head.iter().enumerate() {
        let class = if k < texts { " class=\"text\"" } else { "" };
        text += &format!("<th scope=\"col\"{class}>{}</th>", escape(name));
    }
    text += "</tr></thead>\n<tbody>\n";
    for row in rows {
        text += "<tr>";
        for cell in row {
            text += &match cell {
                Cell::Text(value) => format!("<td class=\"text\">{}</td>", escape(value)),
                Cell::Wrapped(value) => format!("<td class=\"text wrap\">{}</td>", escape(value)),
                Cell::Figure(value) => format!("<td>{}</td>", escape(value)),
                Cell::Bad(value) => format!("<td class=\"bad\">{}</td>", escape(value)),
            };
        }
        text += "</tr>\n";
    }
    text + "</tbody>\n</table>\n</div>\n"
}

/// Planned and flown, slot by slot.
pub fn slots(facts: &Facts) -> String {
    if facts.slots.is_empty() {
        return "<p>No slot was flown.</p>\n".into();
    }
    let per_hz = |bps: Option<f64>| Some(bps? / facts.timeline.scene.radio?.bandwidth_hz);
    let rows: Vec<Vec<Cell>> = facts
        .slots
        .iter()
        .map(|run| {
            let (planned, achieved) = (per_hz(run.planned_bps), per_hz(run.achieved_bps));
            let ratio = planned.zip(achieved).map(|(planned, achieved)| achieved / planned);
            let unprotected = format!("{:.3}", run.unprotected_s);
            vec![
                Cell::Text(run.number.to_string()),
                Cell::Text(run.user.clone()),
                figure(planned, 3),
                figure(achieved, 3),
                figure(per_hz(run.standard_error_bps), 3),
                figure(ratio, 3),
                figure(Some(run.radiated_s.i), 2),
                figure(Some(run.radiated_s.j), 2),
                if run.unprotected_s > 0.0 { Cell::Bad(unprotected) } else { Cell::Figure(unprotected) },
                figure(run.position_rms_m.i, 3),
                figure(run.position_rms_m.j, 3),
                figure(run.attitude_rms_deg.i, 2),
                figure(run.attitude_rms_deg.j, 2),
            ]
        })
        .collect();
    let (caption, achieved) = match facts.timeline.scene.source {
        Source::Simulation => (
            "Measured by the simulated world. Rates in bit/s/Hz; errors are rms, jitter included.",
            "achieved",
        ),
        Source::Telemetry => (
            "Estimated from telemetry. Rates in bit/s/Hz, by the mission's model at its eavesdropper positions; errors are rms.",
            "estimated",
        ),
    };
    let head = [
        "slot",
        "user",
        "planned",
        achieved,
        "\u{b1}",
        "ratio",
        "I on (s)",
        "J on (s)",
        "unprotected (s)",
        "I off by (m)",
        "J off by (m)",
        "I off by (deg)",
        "J off by (deg)",
    ];
    table(caption, &head, 2, &rows)
}

/// What the companions waited for, what they warned of, and when they were content.
pub fn preflight(facts: &Facts) -> String {
    let mut rows = Vec::new();
    for role in Role::BOTH {
        let own = || {
            let events = facts.timeline.events.iter();
            let notices = events.filter(move |e| e.vehicle == Some(role) && e.kind == EventKind::Notice);
            notices.map(|event| (event, Said::of(&event.text)))
        };
        let passed = own().find_map(|(event, said)| (said == Said::Passed).then_some(event));
        let before = |at_s: f64| passed.is_none_or(|passed| at_s <= passed.at_s);
        // Each reason for waiting, with the first and the last time at which it was named.
        let mut reasons: Vec<(String, f64, f64)> = Vec::new();
        let waits = own().filter_map(|(event, said)| match said {
            Said::Waiting(why) if before(event.at_s) => Some((event.at_s, why)),
            _ => None,
        });
        let waits: Vec<(f64, &str)> = waits.collect();
        for (k, (at_s, why)) in waits.iter().enumerate() {
            let until_s = waits.get(k + 1).map(|(next_s, _)| *next_s).or(passed.map(|event| event.at_s));
            let until_s = until_s.unwrap_or(facts.end_s);
            for reason in why.split("; ") {
                match reasons.iter_mut().find(|(known, ..)| known == reason) {
                    Some(known) => known.2 = until_s,
                    None => reasons.push((reason.to_owned(), *at_s, until_s)),
                }
            }
        }
        rows.extend(reasons.into_iter().map(|(reason, from_s, until_s)| {
            vec![
                Cell::Text(role.to_string()),
                Cell::Wrapped(reason),
                Cell::Figure(instant(from_s)),
                Cell::Figure(instant(until_s)),
            ]
        }));
        for (event, said) in own() {
            let Said::Warned(warning) = said else { continue };
            rows.push(vec![
                Cell::Text(role.to_string()),
                Cell::Wrapped(format!("flown all the same: {warning}")),
                Cell::Figure(instant(event.at_s)),
                Cell::Figure("\u{2013}".into()),
            ]);
        }
        if let Some(passed) = passed {
            let (what, at) = ("nothing failed any more".to_owned(), instant(passed.at_s));
            rows.push(vec![
                Cell::Text(role.to_string()),
                Cell::Wrapped(what),
                Cell::Figure(at),
                Cell::Figure("\u{2013}".into()),
            ]);
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let caption =
        "What each companion waited for before it would arm, and what it warned of, by its own notices.";
    table(caption, &["vehicle", "check", "from", "until"], 2, &rows)
}

/// The invariants and how they fared; only a world that sees the truth can judge them.
pub fn invariants(facts: &Facts) -> String {
    if facts.timeline.scene.source == Source::Telemetry {
        return "<p>Nobody watched this flight from outside: whether an invariant was broken cannot be known from the vehicles' own telemetry. What they acknowledged is above.</p>\n".into();
    }
    let seen = |kind: EventKind, code: &str| -> Vec<String> {
        let events = facts.timeline.events.iter();
        events
            .filter(|event| event.kind == kind && event.code.as_deref() == Some(code))
            .map(|event| format!("at {:.3} s: {}", event.at_s, event.text))
            .collect()
    };
    let rows: Vec<Vec<Cell>> = INVARIANTS
        .iter()
        .map(|(code, what)| {
            let mut how = seen(EventKind::Violation, code);
            let count = how.len().to_string();
            let broken = !how.is_empty();
            how.extend(seen(EventKind::Excused, code).iter().map(|text| format!("not counted, {text}")));
            vec![
                Cell::Text((*code).to_owned()),
                Cell::Wrapped((*what).to_owned()),
                if broken { Cell::Bad(count) } else { Cell::Figure(count) },
                Cell::Wrapped(how.join("; ")),
            ]
        })
        .collect();
    let caption = "Watched from outside in every radio sample and at every change of a power.";
    table(caption, &["invariant", "says", "broken", "how"], 2, &rows)
}

/// Poses and powers.
pub fn plan(facts: &Facts) -> String {
    let mut rows = Vec::new();
    for (number, slot) in facts.timeline.scene.slots.iter().enumerate() {
        for role in Role::BOTH {
            let v = &slot.vehicles[role];
            let [east, north, up] = v.position_enu_m.map(Some);
            let degrees = |rad: f64| figure(Some(rad.to_degrees()), 2);
            rows.push(vec![
                Cell::Text(number.to_string()),
                Cell::Text(slot.user.clone()),
                Cell::Text(role.to_string()),
                figure(east, 1),
                figure(north, 1),
                figure(up, 1),
                degrees(v.roll_rad),
                degrees(v.pitch_rad),
                degrees(v.yaw_rad),
                Cell::Figure(power(v.tx_power_w)),
            ]);
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    let head = [
        "slot",
        "user",
        "vehicle",
        "east (m)",
        "north (m)",
        "up (m)",
        "roll (deg)",
        "pitch (deg)",
        "yaw (deg)",
        "power",
    ];
    table("What both companions had agreed to fly.", &head, 3, &rows)
}

/// Where the report's figures come from.
pub fn record(facts: &Facts) -> String {
    let scene = &facts.timeline.scene;
    let mut rows: Vec<Vec<Cell>> = Vec::new();
    let mut add = |name: &str, value: String| rows.push(vec![Cell::Text(name.into()), Cell::Wrapped(value)]);
    scene.started_utc_us.into_iter().for_each(|us| add("flight second zero", utc(us)));
    scene.mission_digest.iter().for_each(|digest| add("mission digest", digest.clone()));
    let plan_digest = facts.timeline.summary.as_ref().and_then(|summary| summary.plan_digest.clone());
    plan_digest.into_iter().for_each(|digest| add("plan digest", digest));
    scene.seed.into_iter().for_each(|seed| add("seed of the simulated world", seed.to_string()));
    scene.jitter_std_deg.into_iter().for_each(|deg| add("attitude jitter planned for", format!("{deg} deg")));
    if let Some(emission) = &scene.emission {
        let [low_mhz, high_mhz] = emission.band_hz.map(|hz| hz / 1e6);
        add("emission authorised by", emission.authorised_by.clone());
        let stated =
            [("licensee", &emission.licensee), ("licence", &emission.licence), ("site", &emission.site)];
        for (name, text) in stated {
            text.iter().for_each(|text| add(name, text.clone()));
        }
        let period = |[from, until]: &[String; 2]| format!("{from} to {until}");
        add("emission valid", emission.valid.as_ref().map_or("not stated".to_owned(), period));
        add("permitted", format!("{low_mhz} to {high_mhz} MHz, at most {}", power(emission.max_power_w)));
    }
    if let Some(radio) = &scene.radio {
        add("bandwidth", format!("{} MHz", radio.bandwidth_hz / 1e6));
        add("noise power", format!("{:e} W", radio.noise_power_w));
        add("path gain at one metre", format!("{:e}", radio.reference_gain));
    }
    add(
        "samples and events",
        format!("{} and {}", facts.timeline.samples.len(), facts.timeline.events.len()),
    );
    let about = match scene.source {
        Source::Simulation => {
            "Positions, attitudes, powers, SINRs and violations are the simulated world's truth. Notices and phases are the companions' own words, at the times at which they were heard."
        }
        Source::Telemetry => {
            "Positions, attitudes and modes are the autopilots' estimates; powers are what transmitters acknowledged; SINRs and secrecy rates follow from them by the mission's radio model and its estimates of the eavesdroppers. Where the eavesdroppers truly were and what they truly heard is not known. Each vehicle's times are its own companion's UTC."
        }
    };
    format!("<p>{about}</p>\n{}", table("Particulars", &["what", "value"], 2, &rows))
}
