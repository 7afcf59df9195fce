//! `veilwing report` on directories: refused with reason, and those of a flown fault.

use veilwing::desk::report::store;

use crate::command::{directory, veilwing};
use crate::page::sound;
use crate::sample::flight;
use crate::text;

const MISSION: &str = include_str!("../flight/yard.toml");

#[test]
fn spec_directories_without_a_flight_are_refused_with_reason() {
    let directory = directory("report-bad");
    let report = |wanted: &str| {
        let output = veilwing(&["report", directory.to_str().unwrap()]).output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(wanted) && !said.contains("panicked"), "{wanted:?} not in {said}");
    };
    report("i-autopilot.tlog");
    store(&directory, &flight()).unwrap();
    let damage = |name: &str, with: &dyn Fn(String) -> String, wanted: &str| {
        let path = directory.join(name);
        let good = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, with(good.clone())).unwrap();
        report(wanted);
        std::fs::write(&path, good).unwrap();
    };
    damage("timeline.csv", &|good| good[..good.len() - 30].into(), "timeline.csv: line 602");
    damage("timeline.csv", &|good| good.replacen("OFFBOARD,0,1", "OFFBOARD,0,?", 1), "column i_landed");
    damage("timeline.csv", &|good| good.lines().next().unwrap().into(), "no samples");
    damage("timeline.csv", &|_| "\u{1}\u{2}".into(), "no flight's timeline");
    damage("scene.json", &|good| good[..100].into(), "scene.json:");
    damage("scene.json", &|good| good.replace("scene/1", "scene/9"), "veilwing-scene/9");
    damage("events.jsonl", &|good| good + "{\"at_s\": 1", "events.jsonl:6");
    damage("events.jsonl", &|good| good.replace("companion-kill\"", "k\",\"x\":1,\"y\":\""), "unknown field");
    std::fs::write(directory.join("summary.json"), "[]").unwrap();
    report("summary.json:1");
    std::fs::remove_file(directory.join("scene.json")).unwrap();
    report("scene.json");
    let missing = veilwing(&["report", directory.join("nowhere").to_str().unwrap()]).output().unwrap();
    assert_eq!(missing.status.code(), Some(2));
}

/// One flight of two real companions, J's killed: recorded, reported by the simulator, by `report`, and from the
/// telemetry logs alone.
#[test]
fn spec_a_flown_fault_is_reported_from_the_record_and_from_telemetry() {
    let directory = directory("report-flown");
    let mission = directory.join("mission.toml");
    std::fs::write(&mission, MISSION).unwrap();
    let faults = directory.join("faults.toml");
    std::fs::write(
        &faults,
        "[[fault]]\nkind = \"companion-kill\"\nvehicle = \"j\"\nslot = 0\nafter_s = 1.5\n",
    )
    .unwrap();
    let out = directory.join("out");
    let [mission, faults, out_text] = [&mission, &faults, &out].map(|path| path.to_str().unwrap());
    let sitl = ["sitl", mission, "--json", "--speed", "50", "--faults", faults, "--out", out_text];
    let flown = veilwing(&sitl).output().unwrap();
    assert_eq!(flown.status.code(), Some(1), "{}", text(&flown.stderr));
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    let seen = sound(&page);
    for fact in [
        "Not completed: 0 of 2",
        "vehicle J's companion was killed",
        "Vehicle I fell silent after",
        "never without",
    ] {
        assert!(seen.contains(fact), "{fact}\n{seen}");
    }

    let copy = directory.join("copy.html");
    let again = veilwing(&["report", out_text, "--out", copy.to_str().unwrap()]).output().unwrap();
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
    assert_eq!(std::fs::read_to_string(&copy).unwrap(), page);

    // The same directory without what only a simulated world knows.
    for name in ["scene.json", "timeline.csv", "events.jsonl", "summary.json"] {
        std::fs::remove_file(out.join(name)).unwrap();
    }
    let report = || veilwing(&["report", out_text, "--out", copy.to_str().unwrap()]).output().unwrap();
    let from_logs = report();
    assert_eq!(from_logs.status.code(), Some(0), "{}", text(&from_logs.stderr));
    let seen = sound(&std::fs::read_to_string(&copy).unwrap());
    for fact in [
        "as the vehicles' own telemetry tells it: 0 of 2 slots served in full, 1 in part",
        "Slot 0, user alpha: vehicle J began to jam with",
        "no jam lease in force",
        "the estimated secrecy rate was",
        "never without vehicle J's jamming",
        "Vehicle I landed at",
        "cannot be known",
    ] {
        assert!(seen.contains(fact), "{fact}\n{seen}");
    }

    // A log that was cut off is read as far as it goes; one that is damaged is refused by its place.
    let log = out.join("j-autopilot.tlog");
    let good = std::fs::read(&log).unwrap();
    std::fs::write(&log, &good[..good.len() - 1]).unwrap();
    assert_eq!(report().status.code(), Some(0));
    let seen = sound(&std::fs::read_to_string(&copy).unwrap());
    assert!(seen.contains("log j-autopilot.tlog ends inside a record"), "{seen}");
    let mut bad = good;
    bad[8] = 0;
    std::fs::write(&log, &bad).unwrap();
    let refused = report();
    let said = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("j-autopilot.tlog") && said.contains("damaged at byte 0"), "{said}");

    // Without a mission file positions are those that the vehicles told each other.
    std::fs::remove_file(&log).unwrap();
    std::fs::remove_file(out.join("mission.toml")).unwrap();
    assert_eq!(report().status.code(), Some(0), "{}", text(&report().stderr));
    sound(&std::fs::read_to_string(&copy).unwrap());
}

/// What the report says first, of flights whose ends have three causes, and of the same flights by their telemetry alone, where
/// nobody tells what befell them and the preflight's warnings come long before.
#[test]
fn spec_a_report_begins_with_what_led_to_the_end() {
    let directory = directory("report-ends");
    let mission = directory.join("mission.toml");
    std::fs::write(&mission, MISSION).unwrap();
    let cases = [
        (
            "kind = \"companion-kill\"\nvehicle = \"j\"",
            "vehicle J's companion was killed",
            "vehicle I's companion said: \u{201c}mission aborted: nothing heard from vehicle J for 3.0 s\u{201d}",
        ),
        (
            "kind = \"companion-stop\"\nvehicle = \"i\"\nduration_s = 3.0",
            "vehicle I's companion was frozen for 3.000 s",
            "vehicle I's companion said: \u{201c}autopilot: Failsafe: Offboard signal lost, switching to HOLD\u{201d}",
        ),
        (
            "kind = \"pilot-mode\"\nvehicle = \"i\"",
            "vehicle I's pilot took over",
            "vehicle I's companion said: \u{201c}silent, hands off: the autopilot went to POSCTL by another hand\u{201d}",
        ),
    ];
    for (index, (fault, by_the_record, by_telemetry)) in cases.into_iter().enumerate() {
        let (faults, out) = (directory.join("faults.toml"), directory.join(format!("flight-{index}")));
        std::fs::write(&faults, format!("[[fault]]\n{fault}\nslot = 0\nafter_s = 1.5\n")).unwrap();
        let [mission, faults, out] = [&mission, &faults, &out].map(|path| path.to_str().unwrap());
        let flown = ["campaign", mission, "--runs", "1", "--faults", faults, "--out", out];
        let flown = veilwing(&flown).output().unwrap();
        assert_eq!(flown.status.code(), Some(0), "{}", text(&flown.stderr));
        let copy = directory.join("copy.html");
        for (more, begins) in [(None, by_the_record), (Some("--telemetry"), by_telemetry)] {
            let report: Vec<&str> =
                ["report", out, "--out", copy.to_str().unwrap()].into_iter().chain(more).collect();
            let reported = veilwing(&report).output().unwrap();
            assert_eq!(reported.status.code(), Some(0), "{}", text(&reported.stderr));
            let page = std::fs::read_to_string(&copy).unwrap();
            let seen = sound(&page);
            let first = seen.split("At ").nth(1).unwrap();
            let first = &first[..first.find(". ").unwrap()];
            assert!(first.ends_with(begins), "{fault}, {more:?}: {first:?}");
            // It is the mark in the charts too, the first and only one.
            assert!(seen.contains("The mark in the charts below: 1"), "{seen}");
        }
    }
}
