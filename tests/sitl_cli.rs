//! The commands as processes, through the binary: flights with real companions over loopback UDP, documents, exit codes.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde_json::Value;

use command::{directory, veilwing};

const MISSION: &str = include_str!("flight/yard.toml");

/// Flights run one at a time: one of them lives by the wall's clock, and the others take what the machine has.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn write(directory: &Path, name: &str, text: &str) -> String {
    let path = directory.join(name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn run(arguments: &[&str]) -> Output {
    veilwing(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}\n{}\n{}", text(&output.stdout), text(&output.stderr)))
}

fn number(value: &Value, pointer: &str) -> f64 {
    value.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer} in {value:#}"))
}

/// Flies the small mission; the exit code, the document, and what was said.
fn fly(name: &str, faults: Option<&str>) -> (Option<i32>, Value, String, PathBuf) {
    let directory = directory(name);
    let mission = write(&directory, "mission.toml", MISSION);
    let out = directory.join("out");
    let mut arguments = vec!["sitl", &mission, "--json", "--speed", "50"];
    arguments.extend(["--out", out.to_str().unwrap()]);
    let faults = faults.map(|faults| write(&directory, "faults.toml", faults));
    if let Some(faults) = &faults {
        arguments.extend(["--faults", faults]);
    }
    let output = run(&arguments);
    (output.status.code(), json(&output), text(&output.stderr), out)
}

fn assert_protected(document: &Value) {
    for slot in document["slots"].as_array().unwrap() {
        assert_eq!(number(slot, "/unprotected_s"), 0.0, "{document:#}");
    }
    assert_eq!(document["violations"], Value::Array(Vec::new()), "{document:#}");
}

#[test]
fn spec_a_flight_completes_and_its_document_and_files_are_whole() {
    let _alone = alone();
    let (code, document, said, out) = fly("sitl-nominal", None);
    assert_eq!(code, Some(0), "{said}\n{document:#}");
    assert_eq!(document["format"], "veilwing-flight/1");
    assert_eq!(document["result"], "completed");
    assert_protected(&document);
    let (flight_s, wall_s) = (number(&document, "/flight_s"), number(&document, "/wall_s"));
    assert!(
        // No more than 50 simulated seconds a second.
        flight_s > 30.0 && flight_s < 300.0 && wall_s > flight_s / 50.0,
        "{flight_s} in {wall_s}"
    );
    let slots = document["slots"].as_array().unwrap();
    assert_eq!(
        slots.iter().map(|slot| slot["user"].as_str().unwrap()).collect::<Vec<_>>(),
        ["alpha", "bravo"]
    );
    for slot in slots {
        let (planned, achieved) =
            (number(slot, "/planned_secrecy_rate_bps"), number(slot, "/achieved_secrecy_rate_bps"));
        let standard_error = number(slot, "/standard_error_bps");
        assert!((achieved - planned).abs() <= (0.03 * planned).max(4.0 * standard_error), "{slot:#}");
        let on = ["i", "j"].map(|role| number(slot, &format!("/radiated_s/{role}")));
        assert!(on[0] > 2.5 && on[1] >= on[0] && on[1] <= 5.0, "{slot:#}");
        assert_eq!(number(slot, "/jam_out_of_tolerance_s"), 0.0);
        for role in ["i", "j"] {
            assert!(number(slot, &format!("/position_rms_m/{role}")) < 1.0, "{slot:#}");
            // 2 deg on roll and on pitch make 2.8 deg.
            assert!((number(slot, &format!("/attitude_rms_deg/{role}")) - 2.83).abs() < 0.5, "{slot:#}");
        }
    }
    assert!(number(&document, "/min_separation_m") >= 5.0);
    assert!(number(&document, "/messages/sent") > 1000.0 && number(&document, "/messages/received") > 1000.0);
    assert!(document.pointer("/messages/rejected").is_some_and(Value::is_object));

    let read =
        |name: &str| -> Value { serde_json::from_slice(&std::fs::read(out.join(name)).unwrap()).unwrap() };
    let plan = read("plan.json");
    assert_eq!(plan["format"], "veilwing-plan/1");
    assert_eq!(plan["plan_digest"], document["plan_digest"]);
    assert_eq!(plan["plan_digest"].as_str().unwrap().len(), 64);
    assert_eq!(read("summary.json"), document);
    for name in ["i-autopilot.tlog", "i-pair.tlog", "j-autopilot.tlog", "j-pair.tlog"] {
        let records = veilwing::link::tlog::TlogReader::open(&out.join(name)).unwrap();
        assert!(records.map(Result::unwrap).count() > 100, "{name}");
    }
}

fn a_killed_companion_ends_the_mission(role: &str) {
    let _alone = alone();
    let faults =
        format!("[[fault]]\nkind = \"companion-kill\"\nvehicle = \"{role}\"\nslot = 0\nafter_s = 2.0\n");
    let (code, document, said, _) = fly(&format!("sitl-kill-{role}"), Some(&faults));
    assert_eq!(code, Some(1), "{said}");
    assert_eq!(document["result"], "aborted");
    assert_protected(&document);
    let (dead, survivor) = if role == "i" { ("I", "J") } else { ("J", "I") };
    let mentions = |what: &[&str]| said.lines().any(|line| what.iter().all(|what| line.contains(what)));
    assert!(mentions(&[&format!("{dead}  companion was killed by signal 9")]), "{said}");
    assert!(mentions(&[&format!("{survivor}  "), "mission aborted", &format!("vehicle {dead}")]), "{said}");
    assert!(mentions(&[&format!("{survivor}  "), "landed and disarmed"]), "{said}");
    // Two seconds and what is left of a lease.
    for vehicle in ["i", "j"] {
        let on = number(&document["slots"][0], &format!("/radiated_s/{vehicle}"));
        assert!(on > 1.0 && on < 3.2, "{document:#}");
        assert_eq!(number(&document["slots"][1], &format!("/radiated_s/{vehicle}")), 0.0);
    }
}

#[test]
fn spec_killing_companion_i_in_mid_slot_is_safe_and_said() {
    a_killed_companion_ends_the_mission("i");
}

#[test]
fn spec_killing_companion_j_in_mid_slot_is_safe_and_said() {
    a_killed_companion_ends_the_mission("j");
}

#[test]
fn spec_a_full_disk_costs_logs_and_a_restarted_companion_does_not_fly_on() {
    let _alone = alone();
    // Once the companion has begun: one that cannot keep the operator's orders does not begin.
    let faults = "[[fault]]\nkind = \"disk-full\"\nvehicle = \"i\"\nafter_s = 6\n\
                  [[fault]]\nkind = \"pair-degraded\"\nloss = 0.1\nspread_s = 0.02\nafter_s = 0\n\
                  [[fault]]\nkind = \"companion-restart\"\nvehicle = \"j\"\nslot = 0\nafter_s = 2\nduration_s = 1\n";
    let (code, document, said, out) = fly("sitl-restart", Some(faults));
    assert_eq!((code, &document["result"]), (Some(1), &Value::from("aborted")), "{said}");
    assert_protected(&document);
    assert!(number(&document, "/messages/rejected/swallowed-by-fault") > 10.0, "{document:#}");
    let started = said.lines().filter(|line| line.contains("J  companion started")).count();
    assert_eq!(started, 2, "{said}");
    assert!(said.contains("vehicle J's companion restarted"), "{said}");
    let records = |name: &str| {
        veilwing::link::tlog::TlogReader::open(&out.join(name)).unwrap().map_while(Result::ok).count()
    };
    // Both lives of J's companion are on record; what the full disk cost I's log, it did not cost the flight.
    let lives = ["j-autopilot.1.tlog", "j-autopilot.tlog"].map(records);
    assert!(lives.iter().all(|records| *records > 100), "{lives:?}");
    let until_full = records("i-autopilot.tlog");
    assert!(3 * until_full < lives.iter().sum::<usize>(), "{until_full} {lives:?}");
}

/// A flight under way, four times as fast as the wall's clock, and what it says.
fn started(mission: &str, more: &[&str]) -> (Child, impl Iterator<Item = String>) {
    let mut sitl = veilwing(&[&["sitl", mission, "--json", "--speed", "4"], more].concat())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(sitl.stderr.take().unwrap()).lines().map(Result::unwrap);
    (sitl, lines)
}

#[test]
fn spec_a_world_that_is_held_up_owns_what_comes_of_it() {
    let _alone = alone();
    let directory = directory("sitl-late");
    let mission = write(&directory, "mission.toml", MISSION);
    let (mut sitl, mut lines) = started(&mission, &["--wall-clock"]);
    let on_air = lines.by_ref().find(|line| line.contains("I  ") && line.contains("slot 0: on"));
    assert!(on_air.is_some(), "the flight ended before its slot");
    // The world stands still for 0.15 s, which is 0.6 s of flight; the companions do not.
    let pid = i32::try_from(sitl.id()).ok().and_then(rustix::process::Pid::from_raw).unwrap();
    rustix::process::kill_process(pid, rustix::process::Signal::STOP).unwrap();
    let clock = veilwing::link::Clock::real();
    while clock.now().since_start() < std::time::Duration::from_millis(150) {
        std::thread::yield_now();
    }
    rustix::process::kill_process(pid, rustix::process::Signal::CONT).unwrap();
    let said: Vec<String> = lines.collect();
    let mut document = String::new();
    sitl.stdout.take().unwrap().read_to_string(&mut document).unwrap();
    sitl.wait().unwrap();
    let document: Value = serde_json::from_str(&document).unwrap();
    assert_eq!(document["violations"], Value::from(Vec::<Value>::new()), "{said:#?}");
    assert!(number(&document, "/world_late/steps") >= 1.0, "{document:#}");
    assert!(number(&document, "/world_late/worst_ms") > 400.0, "{document:#}");
    for excused in document["excused"].as_array().unwrap() {
        assert!(excused["why"].as_str().unwrap().starts_with("the world ran late by"), "{excused}");
    }
}

#[test]
fn spec_an_interrupt_in_mid_slot_ends_everything_cleanly() {
    let _alone = alone();
    let directory = directory("sitl-interrupt");
    let mission = write(&directory, "mission.toml", MISSION);
    let (mut sitl, mut lines) = started(&mission, &[]);
    let mut children = Vec::new();
    for line in lines.by_ref() {
        if let Some((_, pid)) = line.split_once("companion started, process ") {
            children.push(pid.trim().to_owned());
        }
        // Both are on the air.
        if line.contains("I  ") && line.contains("slot 0: on") {
            break;
        }
    }
    assert_eq!(children.len(), 2, "the flight ended before its slot");
    let pid = i32::try_from(sitl.id()).ok().and_then(rustix::process::Pid::from_raw).unwrap();
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let said: Vec<String> = lines.collect();
    let mut document = String::new();
    sitl.stdout.take().unwrap().read_to_string(&mut document).unwrap();
    assert_eq!(sitl.wait().unwrap().code(), Some(130), "{said:#?}");
    for child in children {
        assert!(!Path::new("/proc").join(&child).exists(), "companion {child} is still there");
    }
    let document: Value = serde_json::from_str(&document).unwrap();
    assert_eq!(document["result"], "interrupted");
    assert_protected(&document);
}

/// The plan without the times that it took.
fn plan(mission: &str, more: &[&str]) -> Value {
    let output = run(&[&["plan", mission, "--json"], more].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let mut plan = json(&output);
    for slot in plan["slots"].as_array_mut().unwrap() {
        let slot = slot.as_object_mut().unwrap();
        assert!(slot.remove("planning_time_s").unwrap().as_f64().unwrap() >= 0.0);
        assert!(slot.remove("bound_time_s").unwrap().as_f64().unwrap() >= 0.0);
    }
    plan
}

#[test]
fn spec_a_plan_is_its_mission_and_seed_whatever_the_threads() {
    let directory = directory("plan-twice");
    let mission = write(&directory, "mission.toml", MISSION);
    let first = plan(&mission, &[]);
    assert_eq!(first, plan(&mission, &[]));
    assert_eq!(plan(&mission, &["--threads", "1"]), plan(&mission, &["--threads", "2"]));
    assert_ne!(first["plan_digest"], plan(&mission, &["--method", "conventional"])["plan_digest"]);
}

#[test]
fn val_evaluate_agrees_with_the_plan_within_four_standard_errors() {
    let directory = directory("evaluate");
    let mission = write(&directory, "mission.toml", MISSION);
    let output = run(&["plan", &mission, "--json"]);
    let plan_file = write(&directory, "plan.json", &text(&output.stdout));
    let planned = json(&output);
    let output = run(&["evaluate", &mission, &plan_file, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let evaluated = json(&output);
    assert_eq!(evaluated["format"], planned["format"]);
    assert_eq!(evaluated["mission_digest"], planned["mission_digest"]);
    assert_eq!(evaluated["plan_digest"], planned["plan_digest"], "numbers read back as they were written");
    let slots = planned["slots"].as_array().unwrap().iter().zip(evaluated["slots"].as_array().unwrap());
    for (planned, evaluated) in slots {
        assert_eq!(planned["vehicles"], evaluated["vehicles"]);
        let of = |what: &str| (number(planned, what), number(evaluated, what));
        let (rate, rate_again) = of("/secrecy_rate_bps");
        let (error, error_again) = of("/standard_error_bps");
        assert!(error_again > 0.0, "2 deg of jitter leave an error: {evaluated:#}");
        assert!((rate - rate_again).abs() <= 4.0 * error.hypot(error_again), "{planned:#}\n{evaluated:#}");
        let (sinr, sinr_again) = of("/sinr/user");
        assert!((sinr / sinr_again - 1.0).abs() < 1e-9);
    }
}

#[test]
fn spec_unusable_arguments_and_files_exit_with_2_and_a_reason() {
    let directory = directory("unusable");
    let mission = write(&directory, "mission.toml", MISSION);
    let faults = write(&directory, "faults.toml", "[[fault]]\nkind = \"meteor\"\nafter_s = 1.0\n");
    let cases: [&[&str]; 12] = [
        &["no-such-command"],
        &["sitl"],
        &["sitl", "no-such-mission.toml"],
        &["sitl", &mission, "--speed", "nan"],
        &["sitl", &mission, "--speed", "0"],
        &["sitl", &mission, "--faults", "no-such-faults.toml"],
        &["sitl", &mission, "--faults", &faults],
        &["plan", &mission, "--method", "magic"],
        &["plan", &mission, "--threads", "-1"],
        &["evaluate", &mission, "no-such-plan.json"],
        &["fly", &mission],
        &["fly", &mission, "--vehicle", "no-such-vehicle.toml"],
    ];
    for arguments in cases {
        let output = run(arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}\n{said}");
        assert!(!said.trim().is_empty() && !said.contains("panicked"), "{arguments:?}\n{said}");
        assert!(output.stdout.is_empty(), "{arguments:?}");
    }
}

#[test]
fn spec_every_help_has_an_example() {
    let help = run(&["--help"]);
    assert_eq!(help.status.code(), Some(0));
    let help = text(&help.stdout);
    assert!(help.contains("Example"), "{help}");
    let listed = help.split_once("Commands:").unwrap().1.split_once("Options:").unwrap().0.to_owned();
    let commands: Vec<&str> = listed
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|command| *command != "help")
        .collect();
    for expected in ["check", "plan", "evaluate", "sitl", "fly", "schema"] {
        assert!(commands.contains(&expected), "{expected} is missing among {commands:?}");
    }
    for command in commands {
        let output = run(&[command, "--help"]);
        assert_eq!(output.status.code(), Some(0), "{command}");
        assert!(text(&output.stdout).contains("Example"), "{command}\n{}", text(&output.stdout));
    }
}
