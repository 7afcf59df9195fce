//! The flight report: one sound page, true to the flight, and a clear word for every directory that holds none.

// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use proptest::prelude::*;
use quick_xml::events::Event as Xml;
use veilwing::geo::Attitude;
use veilwing::report::flight::timeline::{
    AirspaceScene, Heard, Listener, Place, PlannedSlot, RadioScene, SCENE_FORMAT, SlotSummary, Summary,
    VehicleState, ViolationSummary,
};
use veilwing::report::flight::{
    Event, EventKind, Sample, Scene, Severity, Source, Timeline, html, load, store, table,
};
use veilwing::report::plan_document::VehicleDocument;
use veilwing::role::{PerVehicle, Role};

const MISSION: &str = include_str!("flight/yard.toml");

/// A directory of this test's own, empty.
fn directory(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if path.exists() {
        std::fs::remove_dir_all(&path).unwrap();
    }
    std::fs::create_dir_all(&path).unwrap();
    path
}

fn veilwing(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_veilwing")).args(arguments).stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Well-formed XML without duplicate identifiers, scripts, or anything to fetch; the text that a reader sees.
fn sound(page: &str) -> String {
    let mut reader = quick_xml::Reader::from_str(page);
    reader.config_mut().check_end_names = true;
    let mut ids = BTreeSet::new();
    let mut seen = String::new();
    let mut open = Vec::new();
    loop {
        match reader.read_event().unwrap() {
            Xml::Start(element) => {
                open.push(text(element.name().as_ref()));
                check(&element, &mut ids);
            }
            Xml::Empty(element) => check(&element, &mut ids),
            Xml::End(_) => {
                open.pop();
            }
            Xml::Text(run) if !open.iter().any(|name| name == "style" || name == "svg") => {
                seen.push_str(&run.decode().unwrap());
            }
            Xml::GeneralRef(reference) => {
                seen.push_str(match reference.decode().unwrap().as_ref() {
                    "amp" => "&",
                    "lt" => "<",
                    "gt" => ">",
                    "quot" => "\"",
                    other => panic!("&{other}; is no entity of XML"),
                });
            }
            Xml::Eof => break,
            _ => {}
        }
    }
    assert!(open.is_empty(), "{open:?} left open");
    for foreign in ["http:", "https:", "//www", "<script", "<link", "<img", "@import", "url(h"] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    seen
}

fn check(element: &quick_xml::events::BytesStart, ids: &mut BTreeSet<String>) {
    for attribute in element.attributes() {
        let attribute = attribute.unwrap();
        let value = text(&attribute.value);
        match attribute.key.as_ref() {
            b"id" => assert!(ids.insert(value.clone()), "two elements are called {value}"),
            b"points" | b"d" | b"x" | b"y" | b"width" | b"height" => {
                assert!(!value.contains("NaN") && !value.contains("inf"), "{value}");
            }
            _ => {}
        }
    }
}

fn pose(east_m: f64) -> VehicleDocument {
    VehicleDocument {
        position_enu_m: [east_m, 5.0, 20.0],
        roll_rad: 0.3,
        pitch_rad: -0.2,
        yaw_rad: 0.0,
        tx_power_w: 0.5,
        antenna_axis_enu: [0.0; 3],
    }
}

fn state(east_m: f64, on: bool, landed: bool, mode: &str) -> VehicleState {
    let up_m = if landed { 0.0 } else { 20.0 };
    VehicleState {
        position_enu_m: [east_m, 5.0, up_m],
        attitude: Attitude::from_euler(0.31, -0.2, 0.0),
        held: Some(Attitude::from_euler(0.3, -0.2, 0.0)),
        mode: mode.into(),
        armed: !landed,
        landed,
        battery: Some(0.9),
        tx_power_w: on.then_some(0.5),
        slot: on.then_some(0),
    }
}

fn event(at_s: f64, kind: EventKind, vehicle: Role, severity: Severity, text: &str) -> Event {
    Event { at_s, kind, vehicle: Some(vehicle), severity, phase: None, code: None, text: text.into() }
}

/// Half a minute: take-off at 2 s, J on at 10 s, I from 10.5 s; J's companion is killed at 14 s; I is off at 14.25 s,
/// J at 14.5 s; I lands at 25 s, J hovers on.
fn flight() -> Timeline {
    let at = |k: u32| f64::from(k) * 0.05;
    let samples = (0..=600).map(at).map(|at_s| {
        let on_i = (10.5..14.25).contains(&at_s);
        let on_j = (10.0..14.5).contains(&at_s);
        let i = state(0.0, on_i, !(2.0..25.0).contains(&at_s), "OFFBOARD");
        let j = state(30.0, on_j, at_s < 2.0, if at_s < 15.0 { "OFFBOARD" } else { "HOLD" });
        let heard = Heard { user_sinr: 1e6, eavesdropper_sinr: vec![50.0], secrecy_rate_bps: 1.425e7 };
        Sample { at_s, vehicles: PerVehicle { i: Some(i), j: Some(j) }, heard: on_i.then_some(heard) }
    });
    let mut kill = event(14.0, EventKind::Fault, Role::J, Severity::Warning, "companion killed (SIGKILL)");
    kill.code = Some("companion-kill".into());
    let slot = |user: &str, achieved| SlotSummary {
        user: user.into(),
        planned_secrecy_rate_bps: Some(1.4e7),
        achieved_secrecy_rate_bps: Some(achieved),
        standard_error_bps: Some(1e4),
        radiated_s: if achieved > 0.0 { PerVehicle { i: 3.75, j: 4.5 } } else { PerVehicle::default() },
        unprotected_s: 0.0,
        position_rms_m: PerVehicle::default(),
        attitude_rms_deg: PerVehicle::default(),
    };
    let planned = |user: &str| PlannedSlot {
        user: user.into(),
        secrecy_rate_bps: Some(1.4e7),
        vehicles: PerVehicle { i: pose(0.0), j: pose(30.0) },
    };
    Timeline {
        scene: Scene {
            format: SCENE_FORMAT.into(),
            source: Source::Simulation,
            mission: "yard".into(),
            mission_digest: Some("ab".repeat(32)),
            seed: Some(7),
            started_utc_us: None,
            jitter_std_deg: Some(2.0),
            radio: Some(RadioScene { bandwidth_hz: 1e6, noise_power_w: 1e-12, reference_gain: 1.0 }),
            airspace: Some(AirspaceScene {
                altitude_m: [20.0, 80.0],
                area_enu_m: vec![[-90.0, -90.0], [90.0, -90.0], [90.0, 90.0]],
                min_separation_m: 5.0,
            }),
            users: ["alpha", "bravo"]
                .map(|name| Place { name: name.into(), position_enu_m: [0.0; 3] })
                .into(),
            eavesdroppers: vec![Listener {
                name: "hill".into(),
                position_enu_m: [60.0, -20.0, 0.0],
                radius_m: Some(15.0),
                std_m: None,
                true_position_enu_m: Some([66.0, -14.0, 0.0]),
            }],
            slots: vec![planned("alpha"), planned("bravo")],
        },
        samples: samples.collect(),
        events: vec![
            event(1.0, EventKind::Notice, Role::I, Severity::Info, "waiting: home: not received"),
            event(1.5, EventKind::Notice, Role::I, Severity::Info, "preflight passed, taking off"),
            kill,
            event(14.25, EventKind::Notice, Role::I, Severity::Warning, "silent: no jam lease in force"),
            event(
                17.0,
                EventKind::Notice,
                Role::I,
                Severity::Error,
                "mission aborted: nothing heard from vehicle J",
            ),
        ],
        summary: Some(Summary {
            result: "aborted".into(),
            plan_digest: None,
            flight_s: 30.0,
            slots: vec![slot("alpha", 1.42e7), slot("bravo", 0.0)],
            violations: Vec::new(),
            min_separation_m: Some(30.0),
        }),
    }
}

#[test]
fn val_the_story_of_a_fault_has_its_times_and_reasons() {
    let seen = sound(&html(&flight()));
    for fact in [
        "Not completed: 0 of 2 slots served in full, 1 in part; no invariant broken.",
        "At 14.0 s, 3.50 s after vehicle I went on the air for alpha, vehicle J's companion was killed. \
         Vehicle I was silent 250 ms later and vehicle J was silent 500 ms later.",
        "In 3.75 s on the air vehicle I was never without vehicle J's jamming.",
        "Both vehicles took off.",
        "Slot 0, user alpha: vehicle J began to jam with 500 mW.",
        "Vehicle I fell silent after 3.75 s on the air: no jam lease in force, for vehicle J had not renewed its promise \
         to jam. (+250 ms)",
        "Vehicle J's transmitter fell silent by itself, 500 ms after its companion had fallen silent",
        "Alpha had had 3.75 s of service; the secrecy rate was 14.20 bit/s/Hz against 14.00 planned.",
        "Vehicle J's autopilot went from OFFBOARD to HOLD. (+1.00 s)",
        "mission aborted: nothing heard from vehicle J",
        "Vehicle I landed.",
        "vehicle J is in the air, 20 m up, in HOLD",
        "Vehicle J was still in the air at the end, in HOLD: it had no companion left to bring it down.",
        "Not flown: slot 1 (bravo).",
        "home: not received",
    ] {
        assert!(seen.contains(fact), "{fact:?} is not in\n{seen}");
    }
    let order =
        ["took off", "began to jam", "was killed.", "fell silent after", "went from OFFBOARD", "I landed."];
    let story = &seen[seen.find("What happened").unwrap()..];
    let places: Vec<usize> = order.iter().map(|fact| story.find(fact).unwrap()).collect();
    assert!(places.is_sorted(), "{places:?}");
}

#[test]
fn val_violations_and_completion_head_the_page() {
    let mut broken = flight();
    broken.events.push(Event {
        code: Some("S1".into()),
        ..event(14.2, EventKind::Violation, Role::I, Severity::Error, "I radiates while J does not jam")
    });
    broken.summary.as_mut().unwrap().violations.push(ViolationSummary {
        invariant: "S1".into(),
        at_s: 14.2,
        detail: String::new(),
    });
    let seen = sound(&html(&broken));
    assert!(
        seen.contains("Not safe: 1 invariant broken") && seen.contains("S1 was broken: I radiates while"),
        "{seen}"
    );
    assert!(seen.contains("at 14.200 s: I radiates while J does not jam"));

    // What is nobody's doing aboard is told, and not counted.
    let mut excused = flight();
    excused.events.push(Event {
        code: Some("S3".into()),
        ..event(
            14.2,
            EventKind::Excused,
            Role::I,
            Severity::Warning,
            "J went off while I was on; the world ran late by 90 ms at 14.100 s",
        )
    });
    let seen = sound(&html(&excused));
    assert!(
        seen.contains("no invariant broken by a companion; 1 time one could not be kept")
            && !seen.contains("Not safe"),
        "{seen}"
    );
    assert!(
        seen.contains("S3 did not hold, which does not count: J went off while I was on; the world ran late")
    );
    assert!(seen.contains("not counted, at 14.200 s: J went off while I was on"));
    // Every invariant is watched: none is left open.
    let table = &seen[seen.find("What must never happen").unwrap()..];
    for code in ["S1", "S2", "S3", "S4", "S5", "S6", "F1", "F2", "F3"] {
        assert!(table.contains(code), "{code}");
    }
    assert!(!table.contains("not watched"));

    let mut good = flight();
    good.events.truncate(2);
    good.summary.as_mut().unwrap().result = "completed".into();
    let seen = sound(&html(&good));
    assert!(seen.contains("Completed: 1 of 2 slots served in full; no invariant broken."), "{seen}");
    assert!(seen.contains(
        "vehicle J began to jam with 500 mW; vehicle I transmitted from 500 ms later, with 500 mW, for 3.75 s; \
         J stopped 250 ms after I"
    ));
}

#[test]
fn val_text_from_files_cannot_become_markup() {
    let nasty = "</title><script>alert(1)</script>&amp;\u{0}\u{7}\"'";
    let mut timeline = flight();
    timeline.scene.mission = nasty.into();
    timeline.scene.users[0].name = nasty.into();
    timeline.scene.slots[0].user = nasty.into();
    timeline.scene.eavesdroppers[0].name = nasty.into();
    timeline.scene.mission_digest = Some(nasty.into());
    for event in &mut timeline.events {
        event.text = nasty.into();
        event.phase = Some(nasty.into());
    }
    for sample in &mut timeline.samples {
        sample.vehicles.i.as_mut().unwrap().mode = nasty.into();
    }
    assert!(sound(&html(&timeline)).contains("<script>alert(1)</script>&amp;\"'"));
}

#[test]
fn val_sparse_flights_make_sound_pages() {
    let whole = flight();
    let telemetry = |mut timeline: Timeline| {
        timeline.scene.source = Source::Telemetry;
        timeline.summary = None;
        timeline.scene.eavesdroppers[0].true_position_enu_m = None;
        timeline
    };
    let seen = sound(&html(&telemetry(whole.clone())));
    assert!(
        seen.contains("as the vehicles' own telemetry tells it") && seen.contains("nobody knows"),
        "{seen}"
    );
    assert!(!seen.contains("invariants broken"));

    let mut bare = telemetry(whole.clone());
    bare.scene = Scene {
        radio: None,
        airspace: None,
        users: Vec::new(),
        eavesdroppers: Vec::new(),
        slots: Vec::new(),
        ..bare.scene
    };
    bare.samples.iter_mut().for_each(|sample| (sample.vehicles.j, sample.heard) = (None, None));
    sound(&html(&bare));
    bare.samples.truncate(1);
    bare.events.clear();
    sound(&html(&bare));
    bare.samples.clear();
    sound(&html(&bare));

    let mut many = whole;
    let one = many.scene.eavesdroppers[0].clone();
    many.scene.eavesdroppers.resize(7, Listener { std_m: Some(4.0), radius_m: None, ..one });
    for heard in many.samples.iter_mut().filter_map(|sample| sample.heard.as_mut()) {
        heard.eavesdropper_sinr.resize(7, 3.0);
    }
    assert!(sound(&html(&many)).contains("strongest of 7 eavesdroppers"));
}

#[test]
fn val_a_stored_flight_loads_and_reports_alike() {
    let directory = directory("report-store");
    store(&directory, &flight()).unwrap();
    let loaded = load(&directory).unwrap();
    assert_eq!((&loaded.scene, &loaded.events), (&flight().scene, &flight().events));
    assert_eq!(loaded.samples.len(), flight().samples.len());
    let again = self::directory("report-store-again");
    store(&again, &loaded).unwrap();
    assert_eq!(html(&load(&again).unwrap()), html(&loaded));
}

#[test]
fn val_directories_without_a_flight_are_refused_with_reason() {
    let directory = directory("report-bad");
    let report = |wanted: &str| {
        let output = veilwing(&["report", directory.to_str().unwrap()]);
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
    let missing = veilwing(&["report", directory.join("nowhere").to_str().unwrap()]);
    assert_eq!(missing.status.code(), Some(2));
}

/// One flight of two real companions, J's killed: recorded, reported by the simulator, by `report`, and from the
/// telemetry logs alone.
#[test]
fn val_a_flown_fault_is_reported_from_the_record_and_from_telemetry() {
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
    let flown = veilwing(&["sitl", mission, "--json", "--speed", "4", "--faults", faults, "--out", out_text]);
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
    let again = veilwing(&["report", out_text, "--out", copy.to_str().unwrap()]);
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stderr));
    assert_eq!(std::fs::read_to_string(&copy).unwrap(), page);

    // The same directory without what only a simulated world knows.
    for name in ["scene.json", "timeline.csv", "events.jsonl", "summary.json"] {
        std::fs::remove_file(out.join(name)).unwrap();
    }
    let report = || veilwing(&["report", out_text, "--out", copy.to_str().unwrap()]);
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
    std::fs::write(&log, &good[..good.len() / 2]).unwrap();
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn prop_no_table_panics(noise in "[0-9,.\\-eENa\n]{0,400}", at in 0usize..20_000, cell in "[^\n]{0,12}") {
        let mut whole = table::write(&flight().samples[200..215], 1);
        let _ = table::read(&noise);
        let at = at % whole.len();
        whole.insert_str(at, &cell);
        let _ = table::read(&whole);
        let _ = table::read(&whole[..at]);
    }
}
