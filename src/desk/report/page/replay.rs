//! The replay: the flight's states as compact JSON, and the script that draws them. The page does without either.
//!
//! The script reckons SINR and secrecy from poses and powers by the formulas of [`crate::radio::link`], anywhere and at any
//! instant, so that no map is stored. A page holds [`INSTANTS`] instants and every change of a power, a slot or a mode; between
//! two of them poses are interpolated.

use serde::Serialize;

use crate::desk::drawing::svg::escape;
use crate::desk::report::charts::ground::circles;
use crate::desk::report::facts::{AFTERWARDS_S, Emission, Facts};
use crate::desk::report::said::Said;
use crate::desk::report::story::slot_name;
use crate::desk::report::timeline::{EventKind, Sample, Scene, VehicleState};
use crate::desk::report::words::{gloss, instant};
use crate::desk::simulation::FaultKind;
use crate::role::Role;

const SCRIPT: &str = include_str!("replay.js");
/// So many instants are in a page, besides changes: 10 minutes at 5 Hz.
const INSTANTS: f64 = 3000.0;

/// Values that seldom change: each with the index from which it holds.
type Steps<T> = Vec<(usize, T)>;

#[derive(Debug, Serialize)]
struct Flight<'a> {
    origin: Option<[f64; 3]>,
    radio: Option<Radio>,
    area: Option<&'a [[f64; 2]]>,
    alt: Option<[f64; 2]>,
    nofly: Vec<NoFly<'a>>,
    users: Vec<Node<'a>>,
    eves: Vec<Node<'a>>,
    slots: Vec<Slot<'a>>,
    /// Instants, in steps of 0.1 ms, each as the difference from the one before.
    t: Vec<i64>,
    v: [Vehicle<'a>; 2],
    h: Recorded,
    /// When a vehicle went off the air, which one, and why.
    off: Vec<(f64, u8, String)>,
    /// When a companion came into a phase, which one's, and the phase.
    phases: Vec<(f64, u8, &'a str)>,
    end: f64,
}

#[derive(Debug, Serialize)]
struct Radio {
    bandwidth: f64,
    noise: f64,
    gain: f64,
}

#[derive(Debug, Serialize)]
struct NoFly<'a> {
    n: &'a str,
    c: &'a [[f64; 2]],
    f: Option<f64>,
    t: Option<f64>,
}

#[derive(Debug, Serialize)]
struct Node<'a> {
    n: &'a str,
    p: [f64; 3],
    /// Radii of the circles that show how well it is known.
    r: Vec<f64>,
    /// Where it truly was.
    t: Option<[f64; 3]>,
}

#[derive(Debug, Serialize)]
struct Slot<'a> {
    u: &'a str,
}

#[derive(Debug, Default, Serialize)]
struct Vehicle<'a> {
    /// East, north, up in centimetres, as differences.
    p: [Vec<i64>; 3],
    /// The antenna's axis in steps of 0.0001, as differences.
    a: [Vec<i64>; 3],
    k: Steps<bool>,
    s: Steps<i32>,
    w: Steps<f64>,
    m: Steps<&'a str>,
}

/// What the record says is heard of I. The script's own figures are those of ideal antennas, as the map's are.
#[derive(Debug, Serialize)]
struct Recorded {
    /// SINR at the user, in hundredths of a decibel, as differences.
    u: Vec<i64>,
    /// At the eavesdropper that hears best.
    e: Vec<i64>,
    /// Its index; -1 where there is none.
    k: Steps<i32>,
    /// Whether anything is heard.
    on: Steps<bool>,
}

fn recorded(samples: &[&Sample]) -> Recorded {
    // Louder than this something is always.
    const LEAST_DB: f64 = -200.0;
    let strongest = |sample: &Sample| {
        let heard = sample.heard.as_ref()?;
        let each = heard.eavesdropper_sinr.iter().copied().enumerate();
        each.max_by(|(_, a), (_, b)| a.total_cmp(b))
    };
    let decibels = |sinr: Option<f64>| sinr.map_or(0.0, |sinr| (10.0 * sinr.log10()).max(LEAST_DB));
    let user = |sample: &&Sample| decibels(sample.heard.as_ref().map(|heard| heard.user_sinr));
    let loudest = |sample: &&Sample| decibels(strongest(sample).map(|(_, sinr)| sinr));
    let which = |sample: &&Sample| strongest(sample).and_then(|(k, _)| i32::try_from(k).ok()).unwrap_or(-1);
    Recorded {
        u: differences(samples.iter().map(user), 1e-2),
        e: differences(samples.iter().map(loudest), 1e-2),
        k: steps(samples.iter().map(which)),
        on: steps(samples.iter().map(|sample| sample.heard.is_some())),
    }
}

/// The samples that a page holds.
fn chosen(facts: &Facts) -> Vec<usize> {
    let samples = &facts.timeline.samples;
    let every_s = facts.end_s / INSTANTS;
    let seldom = |sample: &Sample| {
        Role::BOTH.map(|role| {
            let state = sample.vehicles[role].as_ref();
            state.map(|state| (state.tx_power_w.map(f64::to_bits), state.slot, state.mode.clone()))
        })
    };
    let mut chosen: Vec<usize> = Vec::new();
    for (index, sample) in samples.iter().enumerate() {
        let due = chosen.last().is_none_or(|last| sample.at_s - samples[*last].at_s >= every_s);
        let changed = index.checked_sub(1).is_some_and(|before| seldom(&samples[before]) != seldom(sample));
        if due || changed || index + 1 == samples.len() {
            chosen.push(index);
        }
    }
    chosen
}

/// Whole steps of a unit, each as the difference from the one before.
fn differences(values: impl Iterator<Item = f64>, unit: f64) -> Vec<i64> {
    let mut before = 0;
    values
        .map(|value| {
            let now = (value / unit).round() as i64;
            now - std::mem::replace(&mut before, now)
        })
        .collect()
}

fn steps<T: PartialEq>(values: impl Iterator<Item = T>) -> Steps<T> {
    let mut steps: Steps<T> = Vec::new();
    for (index, value) in values.enumerate() {
        if steps.last().is_none_or(|(_, last)| *last != value) {
            steps.push((index, value));
        }
    }
    steps
}

fn vehicle<'a>(samples: &[&'a Sample], role: Role) -> Vehicle<'a> {
    let states = || samples.iter().map(|sample| sample.vehicles[role].as_ref());
    // What is not known stays where it was: the page does not show it.
    let column = |of: &dyn Fn(&VehicleState) -> f64, unit| {
        let mut last = 0.0;
        differences(
            states().map(|state| {
                last = state.map_or(last, of);
                last
            }),
            unit,
        )
    };
    Vehicle {
        p: [0, 1, 2].map(|k| column(&|state| state.position_enu_m[k], 1e-2)),
        a: [0, 1, 2].map(|k| column(&|state| state.attitude.antenna_axis()[k], 1e-4)),
        k: steps(states().map(|state| state.is_some())),
        s: steps(states().map(|state| state.and_then(|state| state.slot).map_or(-1, i32::from))),
        w: steps(states().map(|state| state.and_then(|state| state.tx_power_w).unwrap_or(0.0))),
        m: steps(states().map(|state| state.map_or("", |state| state.mode.as_str()))),
    }
}

/// Why an emission ended; `None` if it went on otherwise.
fn off(facts: &Facts, emission: &Emission) -> Option<String> {
    let Emission { role, until_s, .. } = *emission;
    let events = &facts.timeline.events;
    if !emission.ended || facts.on_air(role, until_s).is_some() {
        return None;
    }
    let said = events.iter().find_map(|event| match Said::of(&event.text) {
        Said::Silent(why)
            if event.kind == EventKind::Notice
                && event.vehicle == Some(role)
                && (event.at_s - until_s).abs() <= AFTERWARDS_S =>
        {
            Some(gloss(why))
        }
        _ => None,
    });
    let gone = || {
        let lost = events.iter().any(|event| {
            event.fault().is_some_and(FaultKind::is_of_the_companion)
                && event.vehicle == Some(role)
                && (emission.from_s..=until_s).contains(&event.at_s)
        });
        lost.then(|| "its companion was gone, and its last command expired".to_owned())
    };
    Some(said.or_else(gone).unwrap_or_else(|| "its slot is over".to_owned()))
}

fn number(role: Role) -> u8 {
    role as u8
}

fn data(facts: &Facts) -> Option<String> {
    let timeline = facts.timeline;
    let scene: &Scene = &timeline.scene;
    let samples: Vec<&Sample> = chosen(facts).into_iter().map(|index| &timeline.samples[index]).collect();
    let known = |sample: &&Sample| sample.vehicles.i.is_some() || sample.vehicles.j.is_some();
    if !samples.iter().any(known) {
        return None;
    }
    let mut phases: Vec<(f64, u8, &str)> = Vec::new();
    for event in &timeline.events {
        if let (Some(role), Some(phase)) = (event.vehicle, event.phase.as_deref()) {
            let last = phases.iter().rev().find(|(_, which, _)| *which == number(role));
            if last.is_none_or(|(_, _, last)| *last != phase) {
                phases.push((event.at_s, number(role), phase));
            }
        }
    }
    let air = scene.airspace.as_ref();
    let flight = Flight {
        origin: scene.origin.map(|origin| [origin.lat_deg, origin.lon_deg, origin.alt_amsl_m]),
        radio: scene.radio.map(|radio| Radio {
            bandwidth: radio.bandwidth_hz,
            noise: radio.noise_power_w,
            gain: radio.reference_gain,
        }),
        area: air.map(|air| air.area_enu_m.as_slice()),
        alt: air.map(|air| air.altitude_m),
        nofly: air
            .iter()
            .flat_map(|air| &air.no_fly)
            .map(|area| NoFly { n: &area.name, c: &area.corners_m, f: area.floor_m, t: area.ceiling_m })
            .collect(),
        users: scene
            .users
            .iter()
            .map(|user| Node { n: &user.name, p: user.position_enu_m, r: Vec::new(), t: None })
            .collect(),
        eves: scene
            .eavesdroppers
            .iter()
            .map(|e| Node {
                n: &e.name,
                p: e.position_enu_m,
                r: circles(e),
                t: e.true_position_enu_m.filter(|truth| *truth != e.position_enu_m),
            })
            .collect(),
        slots: scene.slots.iter().map(|slot| Slot { u: &slot.user }).collect(),
        t: differences(samples.iter().map(|sample| sample.at_s), 1e-4),
        v: Role::BOTH.map(|role| vehicle(&samples, role)),
        h: recorded(&samples),
        off: facts
            .emissions
            .iter()
            .filter_map(|emission| Some((emission.until_s, number(emission.role), off(facts, emission)?)))
            .collect(),
        phases,
        end: samples.last().map_or(0.0, |sample| sample.at_s),
    };
    serde_json::to_string(&flight).ok()
}

/// JSON inside an element: no markup, and no character that XML forbids.
fn inside(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for c in json.chars() {
        match c {
            '<' | '>' | '&' | '\u{fffe}' | '\u{ffff}' => text += &format!("\\u{:04x}", u32::from(c)),
            _ => text.push(c),
        }
    }
    text
}

/// The section; empty where nothing is known of either vehicle.
pub fn section(facts: &Facts) -> String {
    let Some(json) = data(facts) else { return String::new() };
    let mut leaps = String::new();
    for mark in &facts.marks {
        leaps += &format!(
            "<button type=\"button\" data-at=\"{:.3}\">{}: {}</button>",
            mark.at_s,
            mark.number,
            instant(mark.at_s)
        );
    }
    for run in &facts.slots {
        if let Some([from_s, until_s]) = run.window_s {
            let middle_s = f64::midpoint(from_s, until_s);
            leaps += &format!(
                "<button type=\"button\" data-at=\"{middle_s:.3}\">{}</button>",
                escape(&slot_name(run))
            );
        }
    }
    let speeds = [("0.25", "1/4"), ("1", "1"), ("4", "4"), ("16", "16")];
    let speeds: String = speeds
        .iter()
        .map(|(value, name)| {
            let chosen = if *value == "4" { " selected=\"selected\"" } else { "" };
            format!("<option value=\"{value}\"{chosen}>{name} times</option>")
        })
        .collect();
    format!(
        "<noscript><p>The replay needs a script; everything else on this page does without.</p></noscript>
<div id=\"replay-view\" class=\"replay\" hidden=\"hidden\">
<p class=\"muted\">Drag moves the map; the wheel zooms it once it has been clicked, or with Ctrl; two fingers, +, \u{2212} and 0 do too. The ground is coloured by the secrecy rate of this instant if the only eavesdropper were there and the antennas were ideal; the figures beside are the record's. Dotted: the antennas' nulls, where almost nothing is heard, and the edge where a hundredth of the gain is.</p>
<div class=\"bar\"><button type=\"button\" id=\"replay-play\">Play</button><label>at <select id=\"replay-speed\">{speeds}</select></label><output id=\"replay-now\"></output></div>
<input type=\"range\" id=\"replay-time\" step=\"0.05\" min=\"0\" max=\"1\" value=\"0\" aria-label=\"flight time in seconds\"/>
<div class=\"bar\" id=\"replay-marks\">{leaps}</div>
<div class=\"views\">
<div><canvas id=\"replay-plan\" class=\"plan\" tabindex=\"0\" role=\"img\" aria-label=\"The flight from above at this instant; arrow keys point at a place\"></canvas>
<div class=\"bar\"><button type=\"button\" id=\"replay-closer\" aria-label=\"closer\">+</button><button type=\"button\" id=\"replay-farther\" aria-label=\"farther\">\u{2212}</button><button type=\"button\" id=\"replay-whole\">whole</button><label><input type=\"checkbox\" id=\"replay-rates\" checked=\"checked\"/>secrecy</label><label><input type=\"checkbox\" id=\"replay-nulls\" checked=\"checked\"/>nulls</label></div>
<div class=\"shades\" aria-hidden=\"true\"></div><div class=\"ends\"><span>0</span><span id=\"replay-top\"></span></div></div>
<div><canvas id=\"replay-side\" class=\"side\" role=\"img\" aria-label=\"The flight from the side at this instant\"></canvas>
<div class=\"bar\"><label>seen from <select id=\"replay-facing\"><option value=\"south\">the south</option><option value=\"east\">the east</option></select></label></div>
<dl id=\"replay-told\"></dl></div>
</div>
<p id=\"replay-pointed\" class=\"muted\"></p>
</div>
<script type=\"application/json\" id=\"replay-data\">{}</script>
<script>//<![CDATA[
{SCRIPT}//]]></script>
",
        inside(&json)
    )
}
