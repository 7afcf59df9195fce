//! `veilwing evaluate` on plans as people edit them: scored, warned of, or refused with place, key, value and remedy.

#![cfg(feature = "companion")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use serde_json::{Value, json};

use command::veilwing;

const MISSION: &str = "config/paper.toml";

fn run(arguments: &[&str]) -> Output {
    veilwing(arguments).output().unwrap()
}

fn plan() -> Value {
    let output = run(&["plan", MISSION, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Scores `text`, and what was said of it apart from the warning that the mission itself earns.
fn evaluate(name: &str, text: &[u8]) -> (Output, String) {
    let path: PathBuf = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("evaluate-{name}.json"));
    std::fs::write(&path, text).unwrap();
    let output = run(&["evaluate", MISSION, path.to_str().unwrap(), "--json", "--samples", "16"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!said.contains("panicked"), "{name}: {said}");
    let of_the_plan = said.split_inclusive('\n').skip_while(|line| !line.contains("evaluate-")).collect();
    (output, of_the_plan)
}

fn edited(change: impl FnOnce(&mut Value)) -> String {
    let mut plan = plan();
    change(&mut plan);
    plan.to_string()
}

#[test]
fn spec_a_plan_is_scored_as_it_was_planned_whatever_wrote_the_file() {
    let plan = plan();
    let pretty = serde_json::to_string_pretty(&plan).unwrap();
    let least = json!({ "format": plan["format"], "slots": [
        { "user": plan["slots"][0]["user"], "vehicles": plan["slots"][0]["vehicles"] }
    ] });
    for (name, text) in [
        ("same", pretty.clone()),
        ("windows", format!("\u{feff}{}", pretty.replace('\n', "\r\n"))),
        ("least", least.to_string()),
    ] {
        let (output, said) = evaluate(name, text.as_bytes());
        assert_eq!((output.status.code(), said.as_str()), (Some(0), ""), "{name}");
        let scored: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(scored["plan_digest"], plan["plan_digest"], "{name}");
        assert_eq!(scored["slots"][0]["status"], "evaluated");
        let rate = |document: &Value| document["slots"][0]["secrecy_rate_bps"].as_f64().unwrap();
        // Without jitter there is nothing to sample.
        assert!((rate(&scored) / rate(&plan) - 1.0).abs() < 1e-12, "{name}");
    }
}

#[test]
fn spec_what_is_no_plan_is_refused_with_place_and_remedy() {
    let whole = serde_json::to_string_pretty(&plan()).unwrap();
    let remedy = "help: give a document that `veilwing plan MISSION --json` wrote";
    let cases: [(&str, String, &str); 9] = [
        ("empty", String::new(), ":1:1: this is no plan document: EOF"),
        (
            "list",
            "[]".into(),
            ":1:2: this is no plan document: invalid length 0, expected an object with `format`",
        ),
        ("cut", whole[..300].into(), "this is no plan document: EOF"),
        ("nan", whole.replacen("0.5,", "NaN,", 1), "this is no plan document: expected value"),
        (
            "other",
            whole.replace("plan/1", "plan/9"),
            ":1:1: `format` is \"veilwing-plan/9\", not \"veilwing-plan/1\"",
        ),
        ("no-slots", edited(|plan| plan["slots"] = json!([])), ":1:1: `slots` is empty"),
        (
            "no-j",
            edited(|plan| drop(plan["slots"][0]["vehicles"].as_object_mut().unwrap().remove("j"))),
            "missing field `j`",
        ),
        (
            "place",
            edited(|plan| plan["slots"][0]["vehicles"]["i"]["position_enu_m"] = json!([1, 2])),
            "invalid length 2, expected an array of length 3",
        ),
        (
            "huge",
            edited(|plan| plan["slots"][0]["vehicles"]["i"]["tx_power_w"] = json!("1")),
            "invalid type: string",
        ),
    ];
    for (name, text, says) in cases {
        let (output, said) = evaluate(name, text.as_bytes());
        assert_eq!((output.status.code(), output.stdout.is_empty()), (Some(2), true), "{name}: {said}");
        assert!(said.contains(says) && said.contains(remedy), "{name}: {says:?} is not in {said}");
        assert!(
            said.contains(&format!("evaluate-{name}.json:1:")) || name == "cut" || name == "nan",
            "{said}"
        );
    }
    let (output, said) = evaluate("bytes", b"\xff{}");
    assert_eq!(output.status.code(), Some(2));
    assert!(said.contains("not UTF-8") && said.contains("help: "), "{said}");
    for (path, says) in [("no-such.json", "there is no such file"), ("tests", "this is a directory")] {
        let output = run(&["evaluate", MISSION, path]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2));
        assert!(
            said.contains(&format!("{path}:1:1: cannot be read: {says}")) && said.contains("help: "),
            "{said}"
        );
    }
}

#[test]
fn spec_impossible_figures_are_refused_and_forbidden_ones_scored_with_a_warning() {
    let vehicle =
        |role: &str, key: &str, value: Value| edited(|plan| plan["slots"][0]["vehicles"][role][key] = value);
    for (name, text, says) in [
        (
            "negative",
            vehicle("j", "tx_power_w", json!(-1.0)),
            "slots[0].vehicles.j.tx_power_w is -1e0 W; give a power",
        ),
        (
            "endless",
            vehicle("i", "tx_power_w", json!(1e300)),
            "slots[0].vehicles.i.tx_power_w is 1e300 W; give a power",
        ),
        (
            "far",
            vehicle("i", "position_enu_m", json!([0.0, -1e9, 100.0])),
            "position_enu_m holds -1e9 m; give metres",
        ),
        (
            "stranger",
            edited(|plan| plan["slots"][0]["user"] = json!("zulu")),
            "user \"zulu\" is not in the mission; give one of its users, S0",
        ),
    ] {
        let (output, said) = evaluate(name, text.as_bytes());
        assert_eq!((output.status.code(), output.stdout.is_empty()), (Some(2), true), "{name}: {said}");
        assert!(said.contains(says), "{name}: {says:?} is not in {said}");
    }
    let j = plan()["slots"][0]["vehicles"]["j"]["position_enu_m"].clone();
    for (name, text, says) in [
        (
            "strong",
            vehicle("i", "tx_power_w", json!(2.0)),
            "I radiates 2.000 W, more than the 500.000 mW of radio.max_power_w",
        ),
        (
            "low",
            vehicle("i", "position_enu_m", json!([0.0, 0.0, 10.0])),
            "I is at 10 m, outside altitude_m of 80 to 300 m",
        ),
        (
            "outside",
            vehicle("i", "position_enu_m", json!([600.0, 0.0, 90.0])),
            "I is at [600, 0] m, outside area_enu_m",
        ),
        ("close", vehicle("i", "position_enu_m", j), "0.000 m apart, closer than min_separation_m of 5 m"),
        ("over", vehicle("i", "roll_rad", json!(3.0)), "I is tilted by"),
        ("edited", edited(|plan| plan["mission_digest"] = json!("00")), "made for another mission"),
    ] {
        let (output, said) = evaluate(name, text.as_bytes());
        assert_eq!(output.status.code(), Some(0), "{name}: {said}");
        assert!(said.contains("warning: ") && said.contains(says), "{name}: {says:?} is not in {said}");
    }
}

#[test]
fn spec_stdin_is_named_so_and_read_to_its_end() {
    let score = |text: &str| {
        let mut child = veilwing(&["evaluate", MISSION, "-", "--samples", "16"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        child.wait_with_output().unwrap()
    };
    assert_eq!(score(&plan().to_string()).status.code(), Some(0));
    let output = score("{");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2));
    assert!(said.contains("stdin:1:1: this is no plan document"), "{said}");
}
