use std::fs;
use std::io::Read;
use std::path::PathBuf;
use std::time::Duration;

use super::bundle::{Bundle, BundleError};
use super::*;
use crate::durable::append::{Appender, Keeping};

/// A directory of the test's own, empty; removed with it.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("veilwing-logbook-{name}-{}", std::process::id()));
        fs::remove_dir_all(&path).ok();
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}

const NOW: Utc = Utc { unix_us: 1_795_433_997_250_000 };
const NO_LIMITS: Limits = Limits { max_bytes: u64::MAX, min_free_bytes: 0 };

fn begin_at(root: &Path, role: Role, utc: Utc, digest: &str, limits: Limits) -> Running {
    let (writer, mission_digest) = (Writer::Companion(role), Some(digest.to_owned()));
    Running::begin(root, limits, &Start { writer, mission: "court/yard  ä", mission_digest, utc }).unwrap()
}

fn begin(root: &Path, role: Role) -> Running {
    begin_at(root, role, NOW, "abc", NO_LIMITS)
}

fn name(running: &Running) -> String {
    running.path().file_name().unwrap().to_str().unwrap().to_owned()
}

#[test]
fn spec_every_start_has_a_directory_of_its_own_whatever_the_clock_says() {
    let root = Scratch::new("starts");
    let first = begin(&root.0, Role::I);
    // In the same second, then with a clock that was set back to where computers without a battery begin.
    let second = begin(&root.0, Role::I);
    let third = begin_at(&root.0, Role::J, Utc { unix_us: 12_000_000 }, "abc", NO_LIMITS);
    assert_eq!(name(&first), "20261123T113957Z-court-yard-i-0001");
    assert_eq!(name(&second), "20261123T113957Z-court-yard-i-0002");
    assert_eq!(name(&third), "19700101T000012Z-court-yard-j-0003");
    let entries = Logbook::new(&root.0).entries().unwrap();
    let verdicts: Vec<Verdict> = entries.iter().map(Entry::verdict).collect();
    assert_eq!(verdicts, [Verdict::Running; 3]);
    // One that says how it ended, one that is cut off, one that goes on.
    second.end(Ended::Aborted, Some("vehicle J is lost".to_owned()), Duration::from_secs(61)).unwrap();
    drop((first, second));
    let entries = Logbook::new(&root.0).entries().unwrap();
    let verdicts: Vec<Verdict> = entries.iter().map(Entry::verdict).collect();
    assert_eq!(verdicts, [Verdict::CutOff, Verdict::Ended(Ended::Aborted), Verdict::Running]);
    assert_eq!(entries[1].cause(), Some("vehicle J is lost"));
    assert_eq!(entries[1].duration(), Some(Duration::from_secs(61)));
    assert_eq!(entries[0].duration(), None, "nothing was logged");
}

#[test]
fn spec_names_of_flights_are_told_from_others() {
    for (text, mission, writer, number) in [
        ("20261123T113957Z-courtyard-i-0007", "courtyard", Writer::Companion(Role::I), 7),
        ("20261123T113957Z-a-b-j-12345", "a-b", Writer::Companion(Role::J), 12_345),
        ("19700101T000000Z-1-68-radio-0001", "1-68", Writer::Radio, 1),
    ] {
        let name = Name::parse(text).unwrap();
        assert_eq!((name.mission.as_str(), name.writer, name.number), (mission, writer, number));
    }
    for other in [
        "",
        "-",
        "i-autopilot.tlog",
        "20261123T113957Z",
        "20261123T113957Z-courtyard-k-0007",
        "20261123T113957Z-courtyard-i-",
        "20261123T113957Z-courtyard-i-7x",
        "2026-11-23-courtyard-i-0007",
        ".removing-20261123T113957Z-courtyard-i-0007",
        "äääääääääääääää-i-i-1",
    ] {
        let parsed = Name::parse(other);
        assert!(parsed.as_ref().is_none_or(|name| name.text.ends_with('-')), "{other:?}: {parsed:?}");
    }
    assert_eq!(
        (plain("../../etc"), plain("  "), plain("Hof 7")),
        ("etc".into(), "mission".into(), "Hof-7".into())
    );
}

#[test]
fn spec_a_quota_takes_the_oldest_and_never_what_runs_nor_the_last_before_it() {
    let root = Scratch::new("quota");
    for number in 0..4 {
        let flight = begin(&root.0, Role::I);
        flight.keep("a", &"x".repeat(1000)).unwrap();
        if number < 3 {
            flight.end(Ended::Completed, None, Duration::ZERO).unwrap();
        }
    }
    let names = || -> Vec<u64> {
        Logbook::new(&root.0).entries().unwrap().iter().map(|entry| entry.number).collect()
    };
    let small = Limits { max_bytes: 1, min_free_bytes: 0 };
    let dry = Logbook::new(&root.0).prune(small, true).unwrap();
    assert_eq!((dry.len(), names()), (2, vec![1, 2, 3, 4]));
    let fifth = begin_at(&root.0, Role::I, NOW, "abc", small);
    assert_eq!(names(), [3, 4, 5]);
    // It grows beyond the quota while it runs: then the third goes, since the fourth is the last before it.
    let told: fn(&Path, Option<&io::Error>) = |_, _| {};
    let log = Appender::start(&fifth.path().join("a.tlog"), fifth.keeping(), told).unwrap();
    for _ in 0..40 {
        log.push(vec![0u8; 1 << 20]);
    }
    drop(log);
    assert_eq!(names(), [4, 5]);
    assert_eq!(fs::metadata(fifth.path().join("a.tlog")).unwrap().len(), 40 << 20);
    // What a power cut left of a removal is finished by the next start.
    fs::create_dir_all(root.0.join(".removing-x/y")).unwrap();
    let _sixth = begin_at(&root.0, Role::J, NOW, "abc", NO_LIMITS);
    assert!(!root.0.join(".removing-x").exists());
}

#[test]
fn spec_a_log_that_must_be_new_empties_nothing() {
    let root = Scratch::new("new");
    let flight = begin(&root.0, Role::I);
    let path = flight.path().join("a.tlog");
    fs::write(&path, "earlier").unwrap();
    let told: fn(&Path, Option<&io::Error>) = |_, _| {};
    assert!(Appender::<Vec<u8>>::start(&path, flight.keeping(), told).is_err());
    assert_eq!(fs::read_to_string(&path).unwrap(), "earlier");
    drop(Appender::<Vec<u8>>::start(&path, Keeping::default(), told).unwrap());
    assert_eq!(fs::read_to_string(&path).unwrap(), "");
}

#[test]
fn spec_the_newest_log_is_shown_in_the_log_directory_and_an_earlier_file_there_is_kept() {
    let root = Scratch::new("shown");
    let log = "i-autopilot.tlog";
    fs::write(root.0.join(log), "from before there were directories").unwrap();
    for content in ["one", "two"] {
        let flight = begin(&root.0, Role::I);
        flight.keep(log, content).unwrap();
        flight.show(log).unwrap();
        assert_eq!(fs::read_to_string(root.0.join(log)).unwrap(), content);
    }
    assert_eq!(
        fs::read_to_string(root.0.join("i-autopilot.1.tlog")).unwrap(),
        "from before there were directories"
    );
    assert_eq!(Logbook::new(&root.0).entries().unwrap().len(), 2);
}

/// The names in an archive, and the content of one.
fn unpacked(path: &Path) -> Vec<(String, String)> {
    let mut archive = tar::Archive::new(flate2::read::GzDecoder::new(fs::File::open(path).unwrap()));
    let mut all = Vec::new();
    for entry in archive.entries().unwrap() {
        let mut entry = entry.unwrap();
        let mut text = String::new();
        entry.read_to_string(&mut text).unwrap();
        all.push((entry.path().unwrap().display().to_string(), text));
    }
    all.sort();
    all
}

#[test]
fn spec_a_bundle_has_both_vehicles_flights_of_one_mission_where_a_report_looks() {
    let root = Scratch::new("bundle");
    let (of_i, of_j) = (root.0.join("i"), root.0.join("j"));
    let at = |seconds| NOW + Duration::from_secs(seconds);
    let record = |root: &Path, role: Role, seconds, digest: &str, length| {
        let flight = begin_at(root, role, at(seconds), digest, NO_LIMITS);
        flight.keep(&format!("{}-pair.tlog", role.key()), &name(&flight)).unwrap();
        flight.keep("mission.toml", digest).unwrap();
        flight.end(Ended::Completed, None, Duration::from_secs(length)).unwrap();
        name(&flight)
    };
    record(&of_i, Role::I, 0, "old", 100);
    let i = record(&of_i, Role::I, 1000, "new", 100);
    record(&of_j, Role::J, 0, "old", 100);
    let j = record(&of_j, Role::J, 1010, "new", 30);
    let again = record(&of_j, Role::J, 1050, "new", 20);
    let radio = {
        let start = Start { writer: Writer::Radio, mission: "1-68", mission_digest: None, utc: at(900) };
        let radio = Running::begin(&of_i, NO_LIMITS, &start).unwrap();
        radio.keep("radio.tlog", "r").unwrap();
        radio.end(Ended::Interrupted, None, Duration::from_secs(500)).unwrap();
        name(&radio)
    };
    let mut entries = Logbook::new(&of_i).entries().unwrap();
    entries.extend(Logbook::new(&of_j).entries().unwrap());
    // The newest is J's second start, whose partner is I's; the first start, and the radio's, were on record meanwhile.
    let bundle = Bundle::choose(&entries, &[], "here").unwrap();
    assert_eq!(bundle.notes, Vec::<String>::new());
    let out = root.0.join("a.tar.gz");
    bundle.write(&out).unwrap();
    let unpacked = unpacked(&out);
    let of = |file: &str| {
        unpacked
            .iter()
            .find(|(name, _)| *name == format!("{}/{file}", bundle.name))
            .map(|(_, text)| text.as_str())
    };
    assert_eq!(of("i-pair.tlog"), Some(i.as_str()));
    assert_eq!(of("j-pair.tlog"), Some(again.as_str()));
    assert_eq!(of(&format!("{j}/j-pair.tlog")), Some(j.as_str()));
    assert_eq!(of(&format!("{radio}/radio.tlog")), Some("r"));
    assert_eq!(of("mission.toml"), Some("new"));
    assert!(of("log-i.json").is_some() && of("lock").is_none());
    assert!(matches!(bundle.write(&out), Err(BundleError::Io { .. })), "an archive is not written over");

    let named = Bundle::choose(&entries, &[i.clone(), j.clone()], "here").unwrap();
    assert_eq!(named.flights.iter().map(|flight| flight.name.as_str()).collect::<Vec<_>>(), [&i, &j]);
    let alone = Bundle::choose(&entries[..2], &[], "here").unwrap();
    assert!(alone.notes[0].starts_with("no flight of vehicle J"), "{:?}", alone.notes);
    let mixed = Bundle::choose(&entries, &[entries[0].name.clone(), j], "here");
    assert!(matches!(mixed, Err(BundleError::Missions { .. })));
    assert!(matches!(Bundle::choose(&entries, &["x".into()], "here"), Err(BundleError::Unknown { .. })));
    assert!(matches!(Bundle::choose(&[], &[], "here"), Err(BundleError::Nothing { .. })));
}
