//! `veilwing campaign` from outside: the same totals whatever the threads and parts, replays, interruption, bad input.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

const MISSION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/flight/yard.toml");
const FAULTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/faults.toml");

fn veilwing() -> Command {
    command::veilwing(&["campaign"])
}

fn directory(name: &str) -> PathBuf {
    command::directory(&format!("campaign-{name}"))
}

fn output(arguments: &[&str]) -> Output {
    veilwing().args(arguments).output().unwrap()
}

fn document(arguments: &[&str]) -> Value {
    let output = output(arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{said}");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {said}"))
}

/// The document without what depends on the machine and on who flew what.
fn totals(mut document: Value) -> Value {
    let object = document.as_object_mut().unwrap();
    for key in ["wall_s", "cpu_s", "shard"] {
        assert!(object.remove(key).is_some(), "{key}");
    }
    document
}

#[test]
fn spec_totals_depend_neither_on_threads_nor_on_parts() {
    let run = |more: &[&str]| {
        let common = [MISSION, "--runs", "7", "--seed", "40", "--faults", FAULTS, "--json"];
        document(&[&common, more].concat())
    };
    let one = run(&["--threads", "1"]);
    assert_eq!(one["format"], "veilwing-campaign/1");
    assert_eq!((one["runs"].as_u64(), one["flights"].as_array().unwrap().len()), (Some(7), 7));
    assert!(one["faults"].as_object().unwrap().len() > 3, "{}", one["faults"]);
    let one = totals(one);
    assert_eq!(totals(run(&["--threads", "2"])), one);

    let parts = directory("parts");
    let out = parts.to_str().unwrap();
    for shard in ["1/3", "2/3", "3/3"] {
        run(&["--shard", shard, "--out", out]);
    }
    assert_eq!(totals(document(&["--merge", out, "--json"])), one);
    let files = ["2", "3", "1"].map(|k| parts.join(format!("shard-{k}-of-3.json")).display().to_string());
    assert_eq!(totals(document(&["--json", "--merge", &files[0], &files[1], &files[2]])), one);
    // A part that is missing shows, a part that is there twice is refused.
    let partial = document(&["--json", "--merge", &files[0], &files[1]]);
    assert_eq!((partial["runs"].as_u64(), partial["complete"].as_bool()), (Some(4), Some(false)));
    let twice = output(&["--merge", &files[0], &files[0]]);
    assert_eq!(twice.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&twice.stderr).contains("is in another part too"));
}

/// A flight document without the wall time that it took.
fn flight(path: &Path) -> Value {
    let mut document: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert!(document.as_object_mut().unwrap().remove("wall_s").is_some());
    document
}

#[test]
fn spec_a_flight_of_a_campaign_is_replayed_by_its_seed_with_full_logs() {
    let fly = |name: &str, runs: &str, seed: &str| {
        let out = directory(name);
        let arguments = ["--runs", runs, "--seed", seed, "--faults", FAULTS, "--json", "--out"];
        document(&[&[MISSION], &arguments[..], &[out.to_str().unwrap()]].concat());
        out
    };
    let campaign = fly("many", "3", "70");
    let (alone, again) = (fly("alone", "1", "72"), fly("again", "1", "72"));
    let of_campaign = flight(&campaign.join("runs/72.json"));
    assert_eq!(of_campaign["format"], "veilwing-flight/1");
    assert_eq!(flight(&alone.join("runs/72.json")), of_campaign);
    assert_eq!(flight(&alone.join("summary.json")), of_campaign);
    assert_ne!(flight(&campaign.join("runs/71.json"))["slots"], of_campaign["slots"]);
    for name in ["flight.log", "i-autopilot.tlog", "i-pair.tlog", "j-autopilot.tlog", "j-pair.tlog"] {
        let bytes = std::fs::read(alone.join(name)).unwrap();
        assert!(bytes.len() > 1000, "{name}: {} bytes", bytes.len());
        assert!(bytes == std::fs::read(again.join(name)).unwrap(), "{name} differs between two replays");
        assert!(!campaign.join(name).exists());
    }
    let tlog = log_times_s(&alone.join("i-pair.tlog")).len();
    assert!(tlog > 100, "{tlog} records");
    assert!(alone.join("plan.json").exists());
    // The page knows how the flight ended, and is what `veilwing report` makes of the directory.
    let page = std::fs::read_to_string(alone.join("report.html")).unwrap();
    let ended = if of_campaign["result"] == "completed" { "<h1>Completed:" } else { "<h1>Not completed:" };
    assert!(page.contains(ended.trim_start_matches("<h1>")), "no {ended}");
    assert!(!page.contains("without a flight document"));
    let made = alone.join("again.html");
    let directory = alone.to_str().unwrap();
    let report = Command::new(env!("CARGO_BIN_EXE_veilwing"))
        .args(["report", directory, "--out", made.to_str().unwrap()])
        .status();
    assert!(report.unwrap().success());
    assert!(
        std::fs::read_to_string(made).unwrap() == page,
        "the page differs from the report of its directory"
    );
}

/// When the records of a `.tlog`, all of which can be read, were written: seconds after the first.
fn log_times_s(path: &Path) -> Vec<f64> {
    let records: Result<Vec<_>, _> = veilwing::link::TlogReader::open(path).unwrap().collect();
    let times: Vec<u64> = records.unwrap().iter().map(|(utc, _)| utc.unix_us).collect();
    times.iter().map(|at| (at - times[0]) as f64 * 1e-6).collect()
}

#[test]
fn spec_a_full_disk_costs_records_and_a_warning_and_nothing_else() {
    let out = directory("full");
    let write = |name: &str, text: &str| {
        let path = out.join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let law = "[[fault]]\nkind = \"disk-full\"\nvehicle = \"i\"\nafter_s = 10\nduration_s = 8\n";
    let faults = write("full.toml", law);
    let fly = |name: &str, more: &[&str]| {
        let out = directory(name);
        document(&[&[MISSION, "--runs", "1", "--json", "--out", out.to_str().unwrap()], more].concat());
        (flight(&out.join("summary.json")), out)
    };
    let ((plain, _), (full, kept)) = (fly("full-not", &[]), fly("full-yes", &["--faults", &faults]));
    for key in ["result", "slots", "violations", "flight_s"] {
        assert_eq!(full[key], plain[key], "{key}");
    }
    assert_eq!((plain["unlogged"]["i"].as_u64(), full["unlogged"]["j"].as_u64()), (Some(0), Some(0)));
    assert!(full["unlogged"]["i"].as_u64().unwrap() > 1000, "{}", full["unlogged"]);
    let longest_gap = |name: &str| {
        let times = log_times_s(&kept.join(name));
        times.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
    };
    assert!((longest_gap("i-autopilot.tlog") - 8.0).abs() < 0.1, "{}", longest_gap("i-autopilot.tlog"));
    assert!(longest_gap("j-autopilot.tlog") < 1.0);
    let said = std::fs::read_to_string(kept.join("flight.log")).unwrap();
    assert!(said.contains("records are being lost") && said.contains("takes records again"), "{said}");
}

#[test]
fn spec_an_interrupted_campaign_keeps_what_is_done() {
    let mut child = veilwing()
        .args([MISSION, "--runs", "1000000", "--threads", "1", "--json"])
        .env("RUST_LOG", "debug")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
    let flown = said.by_ref().find(|line| line.as_ref().unwrap().contains("flown"));
    assert!(flown.is_some(), "it ended before a flight was flown");
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let drain = std::thread::spawn(move || said.count());
    let mut text = String::new();
    child.stdout.take().unwrap().read_to_string(&mut text).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    drain.join().unwrap();
    let document: Value = serde_json::from_str(&text).unwrap();
    let runs = document["runs"].as_u64().unwrap();
    assert!(runs >= 1 && document["flights"].as_array().unwrap().len() as u64 == runs, "{runs}");
    assert_eq!(document["complete"], false);
}

#[test]
fn spec_bad_input_is_refused() {
    let out = directory("bad");
    let write = |name: &str, text: &str| {
        let path = out.join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let no_campaign = write("plan.json", "{\"format\": \"veilwing-plan/1\"}");
    let unknown = write("unknown.toml", "[[fault]]\nkind = \"link-loss\"\nprobabilty = 0.5\n");
    let meteor = write("meteor.toml", "[[fault]]\nkind = \"meteor\"\n");
    let cases: [(&[&str], &str); 9] = [
        (&[MISSION, "--shard", "4/3"], "parts are counted from 1"),
        (&[MISSION, "--shard", "half"], "I/K"),
        (&[MISSION, "--runs", "0"], "0 is not in"),
        (&[MISSION, "--faults", "no-such-faults.toml"], "no-such-faults.toml"),
        (&[MISSION, "--faults", &unknown], "unknown.toml:3:1: unknown key `probabilty`"),
        (&[MISSION, "--faults", &meteor], "meteor.toml:2:8: `kind` is \"meteor\""),
        (&["--merge", "no-such-part.json"], "no-such-part.json"),
        (&["--merge", &no_campaign], "plan.json"),
        (&[], "<MISSION>"),
    ];
    for (arguments, complaint) in cases {
        let output = output(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(complaint), "{arguments:?}: {said}");
        assert!(output.stdout.is_empty());
    }
}
