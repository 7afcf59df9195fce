//! The flight report: one sound page, true to the flight, and a clear word for every directory that holds none.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../command/mod.rs"]
mod command;
mod directories;
mod mcap;
mod page;
mod replay;
mod sample;

use proptest::prelude::*;
use veilwing::desk::report::timeline::{Listener, ViolationSummary};
use veilwing::desk::report::{Event, EventKind, Scene, Severity, Source, Timeline, html, load, store, table};
use veilwing::role::Role;

use command::directory;
use page::sound;
use sample::{event, flight};

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn spec_the_story_of_a_fault_has_its_times_and_reasons() {
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
        "the <testers>",
        "a yard",
        "2026-01-01T00:00:00Z to 2026-12-31T23:59:59Z",
        "2400 to 2410 MHz, at most 500 mW",
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
fn spec_a_warning_given_again_and_again_is_told_once() {
    let mut flown = flight();
    let said = "its autopilot link is stale";
    for at_s in (0..20).map(|k| 14.5 + 0.1 * f64::from(k)).chain([30.0]) {
        flown.events.push(event(at_s, EventKind::Notice, Role::I, Severity::Warning, said));
    }
    flown.events.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    let seen = sound(&html(&flown));
    assert!(seen.contains(&format!("\u{201c}{said}\u{201d}, 20 times until 16.4 s")), "{seen}");
    assert_eq!(seen.matches(said).count(), 2, "the one after a while is told by itself\n{seen}");
}

#[test]
fn spec_violations_and_completion_head_the_page() {
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
fn spec_text_from_files_cannot_become_markup() {
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
fn spec_sparse_flights_make_sound_pages() {
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
fn spec_a_stored_flight_loads_and_reports_alike() {
    let directory = directory("report-store");
    store(&directory, &flight()).unwrap();
    let loaded = load(&directory).unwrap();
    assert_eq!((&loaded.scene, &loaded.events), (&flight().scene, &flight().events));
    assert_eq!(loaded.samples.len(), flight().samples.len());
    let again = self::directory("report-store-again");
    store(&again, &loaded).unwrap();
    assert_eq!(html(&load(&again).unwrap()), html(&loaded));
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
