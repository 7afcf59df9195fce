//! A flight's directory: its record, and its telemetry logs. Whatever is there makes a page, or an error with the file's
//! name.

use std::path::Path;
use std::sync::OnceLock;

use veilwing::config::Mission;
use veilwing::desk::report::{RecordError, directory, html, load, store, telemetry};
use veilwing::desk::simulation::Wire;
use veilwing::link::RawFrame;
use veilwing::link::tlog::append_record;
use veilwing::role::Role;
use veilwing::time::Utc;

use super::recording::{MISSION, recording};
use crate::reached::{Reached, unquoted};
use crate::scratch::Scratch;
use crate::target::Target;

#[allow(
    missing_docs,
    clippy::unwrap_used,
    dead_code,
    reason = "the flight made by hand of the report's tests"
)]
#[path = "../../../tests/report/sample.rs"]
mod sample;

/// What `sitl --out` writes.
pub const RECORD: Target = Target {
    name: "flight-record",
    what: "the texts of scene.json, timeline.csv, events.jsonl and summary.json to the report",
    words: &[
        "{",
        "}",
        "[",
        "]",
        ",",
        ":",
        "\"",
        "null",
        "true",
        "\n",
        "\u{1e}",
        "veilwing-scene/1",
        "\"at_s\"",
        "\"kind\"",
        "\"vehicle\"",
        "\"i\"",
        "\"j\"",
        "\"eavesdroppers\"",
        "OFFBOARD",
        "\"violation\"",
        "\"notice\"",
        "\"fault\"",
    ],
    seeds: records,
    run: record,
    generated: 400,
};
/// What companions log.
pub const LOGS: Target = Target {
    name: "flight-logs",
    what: "the bytes of both vehicles' telemetry logs to the report",
    words: &[],
    seeds: logs,
    run: log,
    generated: 200,
};

/// HEARTBEAT and GPS_GLOBAL_ORIGIN: without them, positions in an autopilot's frame tell nothing.
const NEEDED: [Option<u32>; 2] = [Some(0), Some(49)];
/// Between the files of a record.
const BREAK: u8 = 0x1E;
const FILES: [&str; 4] = [directory::SCENE, directory::TIMELINE, directory::EVENTS, directory::SUMMARY];
const LOG_FILES: [&str; 4] = ["i-autopilot.tlog", "i-pair.tlog", "j-autopilot.tlog", "j-pair.tlog"];

fn records() -> Vec<Vec<u8>> {
    let mut flight = sample::flight();
    flight.samples = flight.samples.into_iter().skip(190).step_by(10).take(15).collect();
    let scratch = Scratch::new();
    let read = |directory: &Path| -> Option<Vec<Vec<u8>>> {
        store(directory, &flight).ok()?;
        FILES[..3].iter().map(|name| std::fs::read(directory.join(name)).ok()).collect()
    };
    let summary = br#"{"result":"aborted","plan_digest":null,"flight_s":30.0,"slots":[],"violations":[],"min_separation_m":null}"#;
    read(scratch.path())
        .map(|files| vec![[&files.join(&BREAK)[..], &[BREAK], summary].concat()])
        .unwrap_or_default()
}

fn record(input: &[u8], reached: &mut Reached) {
    let input = unquoted(input);
    let files: Vec<(&str, &[u8])> = FILES.into_iter().zip(input.splitn(4, |byte| *byte == BREAK)).collect();
    let scratch = Scratch::with(&files);
    match load(scratch.path()) {
        Ok(timeline) => {
            let page = html(&timeline);
            assert!(page.contains("</html>"));
            note_page(&page, reached);
        }
        Err(error) => {
            let told = error.to_string();
            assert!(FILES.iter().any(|name| told.contains(name)), "{told}");
            if let RecordError::Json { path, line, .. } = &error {
                assert!(*line >= 1 && told.contains(&format!("{}:{line}:", path.display())), "{told}");
            }
            let words = told.replace(&*scratch.path().to_string_lossy(), "");
            reached.sentence("refused", &words);
        }
    }
}

/// Which kinds of sentences a page has.
fn note_page(page: &str, reached: &mut Reached) {
    const KINDS: [&str; 14] = [
        "<h1>Completed",
        "<h1>Not completed",
        "<h1>Not safe",
        "could not be kept",
        "began to jam",
        "fell silent",
        "was killed",
        "landed",
        "still in the air",
        "cannot be known",
        "not watched",
        "Not flown",
        "strongest of",
        "ends inside a record",
    ];
    for kind in KINDS.iter().filter(|kind| page.contains(**kind)) {
        reached.note(format_args!("{kind}"));
    }
    reached.count("drawings", page.matches("<svg").count() as u64);
}

fn id_of(frame: &[u8]) -> Option<u32> {
    RawFrame::from_bytes(frame).map(|frame| frame.message_id())
}

/// Of both vehicles, from an instant of the flight on: so many frames of each log.
fn logs() -> Vec<Vec<u8>> {
    let recording = recording();
    let from = |begin: usize, count: usize| {
        let mut input = vec![1];
        for name in LOG_FILES {
            let role = if name.starts_with('i') { Role::I } else { Role::J };
            let wire = if name.contains("pair") { Wire::Pair } else { Wire::Autopilot };
            let (before, after) = recording.heard[role].split_at(begin.min(recording.heard[role].len()));
            let needed =
                NEEDED.iter().filter_map(|id| before.iter().find(|heard| id_of(&heard.bytes) == *id));
            let mut log = Vec::new();
            let heard = needed.chain(after.iter().take(count));
            for message in heard.filter(|message| message.wire == wire) {
                let utc = Utc { unix_us: 1_800_000_000_000_000 } + message.at;
                append_record(&mut log, utc, &message.bytes);
            }
            input.extend((log.len() as u16).to_le_bytes());
            input.extend(log);
        }
        input
    };
    vec![from(0, 40), from(1500, 150), from(9000, 150)]
}

fn log(input: &[u8], reached: &mut Reached) {
    static MISSION_READ: OnceLock<Option<Mission>> = OnceLock::new();
    let Some((head, mut rest)) = input.split_first() else { return };
    let mut files: Vec<(&str, &[u8])> = Vec::new();
    for name in LOG_FILES {
        let Some((length, behind)) = rest.split_first_chunk::<2>() else { break };
        let (content, behind) = behind.split_at(behind.len().min(usize::from(u16::from_le_bytes(*length))));
        if !content.is_empty() {
            files.push((name, content));
        }
        rest = behind;
    }
    let scratch = Scratch::with(&files);
    let mission = MISSION_READ.get_or_init(|| Mission::parse("yard.toml", MISSION).ok()).as_ref();
    match telemetry::load(scratch.path(), mission.filter(|_| head & 1 == 1)) {
        Ok(timeline) => {
            assert!(timeline.samples.iter().all(|sample| sample.at_s.is_finite()));
            let page = html(&timeline);
            assert!(page.contains("</html>"));
            note_page(&page, reached);
        }
        Err(error) => {
            let told = error.to_string();
            assert!(told.contains(&*scratch.path().to_string_lossy()), "{told}");
            reached.sentence("refused", &told.replace(&*scratch.path().to_string_lossy(), ""));
        }
    }
}
