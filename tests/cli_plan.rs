//! `veilwing plan --bound`: what the plan document says of its upper bound.

#![cfg(feature = "companion")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::path::Path;
use std::process::Output;

use serde_json::Value;

use command::veilwing;

fn plan(arguments: &[&str]) -> Output {
    veilwing(&[&["plan"], arguments].concat()).output().unwrap()
}

fn document(arguments: &[&str]) -> Value {
    let output = plan(&[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Rate, bound and kind of a document's first slot.
fn bound(document: &Value) -> (f64, f64, &str) {
    let slot = &document["slots"][0];
    let number = |key: &str| slot[key].as_f64().unwrap();
    (number("secrecy_rate_bps"), number("upper_bound_bps"), slot["upper_bound_kind"].as_str().unwrap())
}

#[test]
fn spec_certify_tightens_the_bound_and_leaves_the_plan() {
    let capped = document(&["config/paper.toml"]);
    let (rate, cap, kind) = bound(&capped);
    assert_eq!(kind, "cap");
    assert_eq!(capped["slots"][0]["bound_time_s"], 0.0);
    let certified = document(&["config/paper.toml", "--bound", "certify"]);
    let (same_rate, upper, kind) = bound(&certified);
    assert_eq!(kind, "branch-and-bound");
    assert_eq!((rate, &capped["plan_digest"]), (same_rate, &certified["plan_digest"]));
    assert!(rate <= upper && upper < cap && upper < rate * 1.0011, "{rate} {upper} {cap}");
    assert!(certified["slots"][0]["bound_time_s"].as_f64().unwrap() > 0.0);
    // Boxes are budgeted, not seconds: the same bound again.
    assert_eq!(upper, bound(&document(&["config/paper.toml", "--bound", "certify"])).1);
}

#[test]
fn spec_text_says_the_gap_and_help_says_what_each_kind_means() {
    let text = String::from_utf8(plan(&["config/paper.toml", "--bound", "certify"]).stdout).unwrap();
    let line = text.lines().find(|line| line.contains("upper bound")).unwrap();
    assert!(line.contains("(branch-and-bound), gap 0.1") && line.contains("found in"), "{line}");
    let help = String::from_utf8(plan(&["--help"]).stdout).unwrap();
    for kind in ["cap", "branch-and-bound", "without-jitter", "decoupled", "decoupled-signed"] {
        assert!(help.lines().any(|line| line.trim_start().starts_with(kind)), "{kind} is not in {help}");
    }
    assert_eq!(plan(&["config/paper.toml", "--bound", "guess"]).status.code(), Some(2));
}

#[test]
fn spec_every_kind_of_mission_has_a_sound_bound() {
    let paper =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("config/paper.toml")).unwrap();
    let scratch = Path::new(env!("CARGO_TARGET_TMPDIR")).join("cli_plan");
    std::fs::create_dir_all(&scratch).unwrap();
    let variants = [
        ("body", "std_deg = 0.0", "std_deg = 2.0\nmodel = \"body\"", "without-jitter"),
        ("yaw", "std_deg = 0.0", "std_deg = 2.0\naxes = \"roll-pitch-yaw\"", "without-jitter"),
        ("tilted", "max_tilt_deg = 90.0", "max_tilt_deg = 30.0", "cap"),
        ("uncertain", "name = \"S1\"", "name = \"S1\"\nradius_m = 50.0", "cap"),
        ("silent", "max_power_w = 0.5", "max_power_w = { i = 0.0, j = 0.5 }", "cap"),
    ];
    for (name, from, to, expected) in variants {
        assert!(paper.contains(from), "{from}");
        let path = scratch.join(format!("{name}.toml"));
        std::fs::write(&path, paper.replacen(from, to, 1)).unwrap();
        let path = path.to_str().unwrap();
        let (capped, certified) = (document(&[path]), document(&[path, "--bound", "certify"]));
        let ((rate, cap, _), (_, upper, kind)) = (bound(&capped), bound(&certified));
        assert!(rate <= upper && upper <= cap, "{name}: {rate} {upper} {cap}");
        assert_eq!(kind, expected, "{name}");
        let text = String::from_utf8(plan(&[path]).stdout).unwrap();
        // Nobody's distance to the cap is a gap.
        assert!(text.contains("(cap)") && !text.contains("gap") && !text.contains("NaN"), "{name}: {text}");
    }
}
