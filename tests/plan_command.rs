//! `veilwing plan` on missions at the edge of sense: a plan without NaN, or a clear refusal, and never a panic; and what
//! `order = "shortest"` chooses.

#![cfg(feature = "companion")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::PathBuf;
use std::process::{Command, Output};

use serde_json::Value;

/// A mission file from its tables; each table may be replaced.
struct Mission {
    radio: &'static str,
    airspace: &'static str,
    jitter: &'static str,
    rest: String,
    nodes: String,
}

impl Mission {
    fn new(jitter: &'static str, eavesdroppers: &[[f64; 2]]) -> Self {
        let node = |(k, p): (usize, &[f64; 2])| {
            format!("[[eavesdropper]]\nname = \"e{k}\"\nenu_m = [{:?}, {:?}, 0.0]\n", p[0], p[1])
        };
        let nodes: String = eavesdroppers.iter().enumerate().map(node).collect();
        Self {
            radio: "",
            airspace: "",
            jitter,
            rest: String::new(),
            nodes: format!("[[user]]\nname = \"u\"\nenu_m = [0.0, 0.0, 0.0]\n{nodes}"),
        }
    }

    fn text(&self) -> String {
        let Self { radio, airspace, jitter, rest, nodes } = self;
        format!(
            "[mission]\nname = \"edge\"\nseed = 1\n[radio]\n{radio}\n[airspace]\n{airspace}\n[jitter]\n{jitter}\n{rest}\n{nodes}"
        )
    }
}

fn plan(name: &str, text: &str) -> Output {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("plan-command-{name}.toml"));
    std::fs::write(&path, text).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_veilwing"))
        .args(["plan", path.to_str().unwrap(), "--json"])
        .output()
        .unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(!log.contains("panicked"), "{name}: {log}");
    output
}

fn no_null(name: &str, value: &Value) {
    match value {
        Value::Null => panic!("{name}: null in the plan"),
        Value::Array(items) => items.iter().for_each(|v| no_null(name, v)),
        Value::Object(fields) => fields.values().for_each(|v| no_null(name, v)),
        _ => {}
    }
}

/// The document of a mission that has a plan: every number in it is finite (JSON has no NaN: it would be null).
fn planned(name: &str, text: &str) -> Value {
    let output = plan(name, text);
    assert_eq!(output.status.code(), Some(0), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    no_null(name, &document);
    for slot in document["slots"].as_array().unwrap() {
        let (rate, bound) = (number(&slot["secrecy_rate_bps"]), number(&slot["upper_bound_bps"]));
        assert!(rate >= 0.0 && rate <= bound, "{name}: {rate} of {bound}");
    }
    document
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

/// A refusal: exit code 2, nothing on stdout, and the words.
fn refused(name: &str, text: &str, words: &str) {
    let output = plan(name, text);
    let log = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{name}: {log}");
    assert!(output.stdout.is_empty(), "{name}");
    assert!(log.contains(words), "{name}: {words:?} is not in {log}");
}

const JITTER: [&str; 2] = ["std_deg = 0.0", "std_deg = 2.0"];

#[test]
fn spec_missions_at_the_edge_have_a_plan() {
    for (k, jitter) in JITTER.into_iter().enumerate() {
        let name = |what: &str| format!("{what}-{k}");
        let usual = [[120.0, -40.0], [-300.0, 210.0]];
        let at_user = planned(&name("at-user"), &Mission::new(jitter, &[[0.0, 0.0]]).text());
        assert_eq!(at_user["slots"][0]["status"], "no-positive-rate");
        assert_eq!(number(&at_user["slots"][0]["secrecy_rate_bps"]), 0.0);
        planned(&name("two-at-once"), &Mission::new(jitter, &[[120.0, -40.0], [120.0, -40.0]]).text());
        let ring: Vec<[f64; 2]> = (0..100)
            .map(|a| f64::from(a) * std::f64::consts::TAU / 100.0)
            .map(|a| [150.0 * a.cos(), 150.0 * a.sin()])
            .collect();
        planned(&name("ring"), &Mission::new(jitter, &ring).text());
        let silent = Mission { radio: "max_power_w = 0.0", ..Mission::new(jitter, &usual) };
        let silent = planned(&name("silent"), &silent.text());
        assert_eq!(silent["slots"][0]["status"], "no-positive-rate");
        let flat = Mission { airspace: "altitude_m = [80.0, 80.0]", ..Mission::new(jitter, &usual) };
        // The library plans in a band of one altitude; a mission file that asks for it is taken for a slip.
        refused(&name("flat"), &flat.text(), "`altitude_m` is inverted or empty");
        // A level vehicle is best right above an eavesdropper or the user.
        for vehicle in ["i", "j"] {
            let rest = format!("[vehicles.{vehicle}]\nairframe = \"conventional\"");
            let under = Mission { rest, ..Mission::new(jitter, &usual) };
            planned(&name(&format!("under-{vehicle}")), &under.text());
        }
        planned(&name("far"), &Mission::new(jitter, &[[49e3, -49e3], [120.0, 0.0]]).text());
    }
}

#[test]
fn spec_missions_beyond_the_edge_are_refused() {
    let usual = Mission::new(JITTER[1], &[[120.0, -40.0]]);
    refused(
        "no-noise",
        &Mission { radio: "noise_power_w = 0.0", ..Mission::new(JITTER[1], &[[1.0, 2.0]]) }.text(),
        "noise_power_w",
    );
    let small = "area_enu_m = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]\naltitude_m = [80.0, 81.0]\nmin_separation_m = 5.0";
    refused(
        "small",
        &Mission { airspace: small, ..Mission::new(JITTER[0], &[[1.0, 2.0]]) }.text(),
        "min_separation_m",
    );
    refused("farther", &usual.text().replace("120.0", "9e5"), "above the maximum");
    refused("huge", &usual.text().replace("120.0", "1e300"), "enu_m");
    refused("nan", &usual.text().replace("120.0", "nan"), "enu_m");
}

/// Three users in two superframes; both orders give plans of nearly the same worth.
#[test]
fn spec_the_shortest_order_keeps_the_rates() {
    let users = "[[user]]\nname = \"v\"\nenu_m = [150.0, 60.0, 0.0]\n[[user]]\nname = \"w\"\nenu_m = [-120.0, 90.0, 0.0]\n";
    let mission = |order: &str| {
        let mut mission = Mission::new(JITTER[0], &[[120.0, -140.0], [-300.0, 210.0], [60.0, 300.0]]);
        mission.rest = format!("[tdma]\norder = \"{order}\"\nsuperframes = 2");
        mission.nodes.push_str(users);
        mission.text()
    };
    let listed = planned("listed", &mission("listed"));
    let shortest = planned("shortest", &mission("shortest"));
    // The companion of the other vehicle chooses the same.
    assert_eq!(shortest["plan_digest"], planned("shortest-again", &mission("shortest"))["plan_digest"]);
    for k in 0..3 {
        let rate = |document: &Value| number(&document["slots"][k]["secrecy_rate_bps"]);
        assert_eq!(listed["slots"][k]["user"], shortest["slots"][k]["user"]);
        assert!(rate(&shortest) >= rate(&listed) * (1.0 - 1.5e-3), "{k}");
    }
}
