//! Logs of flights as processes make them: one directory a start, power cuts, restarts, quotas, bundles, reports.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use serde_json::Value;

use command::{directory, said, veilwing};
use veilwing::link::TlogReader;

const MISSION: &str = include_str!("flight/yard.toml");

/// A vehicle file whose autopilot is nowhere.
fn vehicle(directory: &Path, logs: &Path, more: &str) -> String {
    let path = directory.join("vehicle.toml");
    let logs = toml::Value::from(logs.display().to_string());
    let text = format!(
        "[vehicle]\nrole = \"i\"\n[autopilot]\nlink = \"udpout:127.0.0.1:9\"\n\
         [pair]\nlink = \"udpout:127.0.0.1:9\"\n[log]\ndir = {logs}\n{more}"
    );
    std::fs::write(&path, text).unwrap();
    path.display().to_string()
}

/// Starts a companion, which ends when it has its plan: then nobody is at its stdin any more.
fn start(mission: &str, vehicle: &str) {
    let mut fly = veilwing(&["fly", mission, "--vehicle", vehicle, "--until-stdin-ends"]);
    let mut child = fly.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    let said: Vec<String> = lines.by_ref().take_while(|line| !line.contains("planned")).collect();
    drop(child.stdin.take());
    let rest: Vec<String> = lines.collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{said:#?} {rest:#?}");
}

fn list(logs: &Path) -> Value {
    let output = veilwing(&["logs", logs.to_str().unwrap(), "--json"]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let list: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(list["format"], "veilwing-logs/1");
    list
}

fn flights(logs: &Path) -> Vec<Value> {
    list(logs)["flights"].as_array().unwrap().clone()
}

fn names(logs: &Path) -> Vec<String> {
    flights(logs).iter().map(|flight| flight["name"].as_str().unwrap().to_owned()).collect()
}

/// Every file below a directory, with its content.
fn contents(directory: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for found in std::fs::read_dir(directory).unwrap() {
        let path = found.unwrap().path();
        if path.is_dir() {
            all.extend(contents(&path));
        } else {
            all.insert(path.clone(), std::fs::read(&path).unwrap());
        }
    }
    all
}

fn records(log: &Path) -> usize {
    TlogReader::open(log).unwrap().map_while(Result::ok).count()
}

/// A log of a simulated flight, to be cut.
fn flown(name: &str) -> PathBuf {
    let directory = directory(name);
    let mission = directory.join("mission.toml");
    std::fs::write(&mission, MISSION).unwrap();
    let out = directory.join("out");
    let arguments = ["sitl", mission.to_str().unwrap(), "--json", "--speed", "50", "--out"];
    let output = veilwing(&arguments).arg(&out).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    out
}

#[test]
fn spec_each_start_records_into_a_directory_of_its_own_and_costs_no_earlier_one() {
    let directory = directory("logs-starts");
    let logs = directory.join("flights");
    let mission = directory.join("mission.toml");
    std::fs::write(&mission, MISSION).unwrap();
    let mission = mission.display().to_string();
    let vehicle = vehicle(&directory, &logs, "");
    start(&mission, &vehicle);
    let first = PathBuf::from(flights(&logs)[0]["path"].as_str().unwrap());
    let before = contents(&first);
    for name in [
        "i-autopilot.tlog",
        "i-pair.tlog",
        "companion-i.log",
        "mission.toml",
        "vehicle-i.toml",
        "log-i.json",
        "plan.json",
    ] {
        assert!(before.contains_key(&first.join(name)), "{name} is not in {:?}", before.keys());
    }
    assert_eq!(before[&first.join("mission.toml")], MISSION.as_bytes());
    let plan: Value = serde_json::from_slice(&before[&first.join("plan.json")]).unwrap();
    assert_eq!(plan["format"], "veilwing-plan/1");
    let lines = String::from_utf8(before[&first.join("companion-i.log")].clone()).unwrap();
    for line in lines.lines() {
        let record: Value = serde_json::from_str(line).unwrap();
        assert!(record["fields"]["message"].is_string(), "{line}");
    }
    start(&mission, &vehicle);
    start(&mission, &vehicle);
    assert_eq!(contents(&first), before);
    let all = flights(&logs);
    assert_eq!(all.len(), 3);
    for (index, flight) in all.iter().enumerate() {
        assert!(flight["name"].as_str().unwrap().ends_with(&format!("-yard-i-{:04}", index + 1)), "{flight}");
        assert_eq!((&flight["verdict"], &flight["writer"]), (&"interrupted".into(), &"i".into()));
        assert!(flight["bytes"].as_u64().unwrap() > 1000 && flight["duration_s"].as_f64().unwrap() < 60.0);
    }
    // Where the logs were before there were directories, the newest are to be seen.
    assert_eq!(
        logs.join("i-autopilot.tlog").canonicalize().unwrap(),
        PathBuf::from(all[2]["path"].as_str().unwrap()).canonicalize().unwrap().join("i-autopilot.tlog")
    );
    let table = veilwing(&["logs", logs.to_str().unwrap()]).output().unwrap();
    let table = String::from_utf8(table.stdout).unwrap();
    assert!(table.contains("interrupted") && table.contains("3 flights in"), "{table}");
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
}

#[test]
fn spec_a_power_cut_at_every_byte_of_the_last_record_costs_that_record_alone() {
    let out = flown("logs-cut");
    let whole = std::fs::read(out.join("i-pair.tlog")).unwrap();
    let mut offset = 0;
    let mut last = 0;
    for record in TlogReader::new(whole.as_slice()) {
        last = offset;
        offset += 8 + record.unwrap().1.bytes().len();
    }
    assert_eq!(offset, whole.len());
    let count = records(&out.join("i-pair.tlog"));
    let directory = directory("logs-cut-starts");
    let logs = directory.join("flights");
    let mission = directory.join("mission.toml");
    std::fs::write(&mission, MISSION).unwrap();
    let vehicle = vehicle(&directory, &logs, "");
    start(mission.to_str().unwrap(), &vehicle);
    let first = PathBuf::from(flights(&logs)[0]["path"].as_str().unwrap());
    // As a process leaves it that the power was cut under: it said no end.
    let mut record: Value =
        serde_json::from_slice(&std::fs::read(first.join("log-i.json")).unwrap()).unwrap();
    record["end"] = Value::Null;
    std::fs::write(first.join("log-i.json"), record.to_string()).unwrap();
    let log = first.join("i-pair.tlog");
    for length in last..=whole.len() {
        std::fs::write(&log, &whole[..length]).unwrap();
        assert_eq!(records(&log), if length == whole.len() { count } else { count - 1 }, "{length}");
        let flight = &flights(&logs)[0];
        assert_eq!(flight["verdict"], "cut off");
        assert!(flight["duration_s"].as_f64().unwrap() > 30.0, "{flight}");
    }
    // A few starts after a cut: they leave it as it is.
    std::fs::write(&log, &whole[..last + 5]).unwrap();
    let before = contents(&first);
    for _ in 0..2 {
        start(mission.to_str().unwrap(), &vehicle);
    }
    assert_eq!(contents(&first), before);
    assert_eq!(names(&logs).len(), 3);
}

#[test]
fn spec_what_a_power_cut_left_unwritten_ends_a_report_s_log_and_not_the_report() {
    let out = flown("logs-unwritten");
    let logs = directory("logs-unwritten-report");
    for name in
        ["mission.toml", "plan.json", "i-autopilot.tlog", "i-pair.tlog", "j-autopilot.tlog", "j-pair.tlog"]
    {
        std::fs::copy(out.join(name), logs.join(name)).unwrap();
    }
    // A block that the file system had promised and never wrote.
    let log = logs.join("j-autopilot.tlog");
    let mut bytes = std::fs::read(&log).unwrap();
    let length = bytes.len();
    bytes[length - 4096..].fill(0);
    std::fs::write(&log, bytes).unwrap();
    let report = veilwing(&["report", logs.to_str().unwrap()]).output().unwrap();
    assert_eq!(report.status.code(), Some(0), "{}", said(&report));
    let page = std::fs::read_to_string(logs.join("report.html")).unwrap();
    assert!(page.contains("log j-autopilot.tlog is damaged at byte"), "{page}");
}

#[test]
fn spec_a_full_quota_takes_the_oldest_and_a_disk_that_takes_nothing_costs_no_earlier_flight() {
    let directory = directory("logs-quota");
    let logs = directory.join("flights");
    let mission = directory.join("mission.toml");
    std::fs::write(&mission, MISSION).unwrap();
    let mission = mission.display().to_string();
    let unlimited = vehicle(&directory, &logs, "");
    for _ in 0..4 {
        start(&mission, &unlimited);
    }
    let before = names(&logs);
    let dry =
        veilwing(&["logs", "prune", logs.to_str().unwrap(), "--max-mb", "0", "--dry-run"]).output().unwrap();
    assert!(String::from_utf8_lossy(&dry.stdout).contains("would be removed: 2 flights"), "{}", said(&dry));
    assert_eq!(names(&logs), before);
    // No file of it may grow at all: as on a disk that is full.
    let third = logs.join(&before[2]);
    let kept = contents(&third);
    let shell = format!(
        "ulimit -f 0; exec {} fly {mission} --vehicle {unlimited} --until-stdin-ends",
        env!("CARGO_BIN_EXE_veilwing")
    );
    let full = std::process::Command::new("sh").args(["-c", &shell]).stdin(Stdio::null()).output().unwrap();
    assert_ne!(full.status.code(), Some(0), "{}", said(&full));
    assert_eq!(contents(&third), kept);
    assert!(names(&logs).starts_with(&before), "{:?}", names(&logs));
    // Nothing may stay but the last two and the one that begins.
    let limited = vehicle(&directory, &logs, "max_mb = 0\n");
    start(&mission, &limited);
    let after = names(&logs);
    assert!(after.len() == 3 && !after.contains(&before[0]) && !after.contains(&before[1]), "{after:?}");
}

#[test]
fn spec_both_vehicles_flights_of_a_mission_make_one_bundle_that_report_reads() {
    let out = flown("logs-bundle");
    let directory = directory("logs-bundle-vehicles");
    // The flight's logs, as two vehicles' companions would have kept them.
    for role in ["i", "j"] {
        let flight = directory.join(role).join(format!("20261123T113957Z-yard-{role}-0001"));
        std::fs::create_dir_all(&flight).unwrap();
        for name in [
            format!("{role}-autopilot.tlog"),
            format!("{role}-pair.tlog"),
            "mission.toml".into(),
            "plan.json".into(),
        ] {
            std::fs::copy(out.join(&name), flight.join(&name)).unwrap();
        }
        let record = serde_json::json!({
            "format": "veilwing-log/1", "writer": role, "mission": "yard", "mission_digest": "abc",
            "started_utc": "2026-11-23T11:39:57Z", "started_unix_us": 1_795_433_997_000_000_u64, "version": "0.1.0",
        });
        std::fs::write(flight.join(format!("log-{role}.json")), record.to_string()).unwrap();
    }
    let archive = directory.join("yard.tar.gz");
    let [i, j] = ["i", "j"].map(|role| directory.join(role).display().to_string());
    let bundle = veilwing(&["logs", "bundle", &i, &j, "--out", archive.to_str().unwrap()]).output().unwrap();
    assert_eq!(bundle.status.code(), Some(0), "{}", said(&bundle));
    let unpacked = directory.join("unpacked");
    let read = flate2::read::GzDecoder::new(std::fs::File::open(&archive).unwrap());
    tar::Archive::new(read).unpack(&unpacked).unwrap();
    let flight = unpacked.join("yard-20261123T113957Z");
    let report = veilwing(&["report", flight.to_str().unwrap()]).output().unwrap();
    assert_eq!(report.status.code(), Some(0), "{}", said(&report));
    let page = std::fs::read_to_string(flight.join("report.html")).unwrap();
    assert!(page.contains("<dt>slots served in full</dt><dd>2 of 2</dd>"), "{page}");
    // Of one vehicle alone there is a bundle too, and it is said that it is half.
    let half = veilwing(&["logs", "bundle", &i, "--out", directory.join("half.tar.gz").to_str().unwrap()])
        .output()
        .unwrap();
    assert_eq!(half.status.code(), Some(1), "{}", said(&half));
    assert!(said(&half).contains("no flight of vehicle J is in it"), "{}", said(&half));
    let none = veilwing(&["logs", "bundle", directory.join("unpacked").to_str().unwrap()]).output().unwrap();
    assert_eq!(none.status.code(), Some(2), "{}", said(&none));
}

/// STATUSTEXT put together again, of those that a companion sent.
fn statustexts(log: &Path) -> Vec<String> {
    use mavlink::dialects::ardupilotmega::MavMessage;
    let mut texts = Vec::<String>::new();
    let mut open = None;
    for record in TlogReader::open(log).unwrap() {
        let (_, raw) = record.unwrap();
        let Ok(frame) = raw.parse::<MavMessage>() else { continue };
        let MavMessage::STATUSTEXT(text) = &frame.message else { continue };
        if frame.header.component_id != 191 {
            continue;
        }
        let part = text.text.to_str().unwrap();
        match texts.last_mut() {
            Some(last) if text.id != 0 && open == Some(text.id) && text.chunk_seq > 0 => last.push_str(part),
            _ => texts.push(part.to_owned()),
        }
        open = Some(text.id);
    }
    texts
}

#[test]
fn spec_the_journal_and_the_ground_station_are_told_the_same_story() {
    let out = flown("logs-story");
    for role in ["i", "j"] {
        let log = std::fs::read_to_string(out.join(format!("companion-{role}.log"))).unwrap();
        let lines = log.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        // What the executive says has its phase with it; a link's own lines are the link's.
        let said: Vec<String> = lines
            .filter(|line| line["fields"]["phase"].is_string())
            .map(|line| line["fields"]["message"].as_str().unwrap().to_owned())
            .collect();
        let told = statustexts(&out.join(format!("{role}-autopilot.tlog")));
        assert!(said.len() > 10, "{said:#?}");
        // Before the autopilot's link has a peer nothing can be told.
        let untold: Vec<&String> = said.iter().filter(|text| !told.contains(text)).collect();
        assert!(
            untold.len() <= 2 && untold.iter().all(|text| said[..4].contains(text)),
            "{untold:#?} of {told:#?}"
        );
        let unsaid: Vec<&String> = told.iter().filter(|text| !said.contains(text)).collect();
        assert!(unsaid.is_empty(), "{unsaid:#?}");
    }
}

#[test]
fn spec_the_ground_hears_every_second_how_the_computer_fares() {
    use mavlink::dialects::ardupilotmega::MavMessage;
    let directory = directory("logs-computer");
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let vehicle =
        vehicle(&directory, &directory.join("flights"), "").replace("vehicle.toml", "computer.toml");
    let text = std::fs::read_to_string(directory.join("vehicle.toml")).unwrap();
    let port = socket.local_addr().unwrap().port();
    std::fs::write(&vehicle, text.replacen("127.0.0.1:9", &format!("127.0.0.1:{port}"), 1)).unwrap();
    let arguments = ["fly", "config/mission.toml", "--vehicle", &vehicle, "--until-stdin-ends"];
    let mut child = veilwing(&arguments).stdin(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut heard = Vec::new();
    let mut datagram = [0; 512];
    while heard.len() < 3 {
        let length = socket.recv(&mut datagram).unwrap();
        let frame =
            veilwing::link::RawFrame::from_bytes(&datagram[..length]).map(|raw| raw.parse::<MavMessage>());
        if let Some(Ok(frame)) = frame
            && let MavMessage::ONBOARD_COMPUTER_STATUS(status) = frame.message
        {
            assert_eq!(frame.header.component_id, 191);
            heard.push(status);
        }
    }
    drop(child.stdin.take());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    for pair in heard.windows(2) {
        let apart_s = (pair[1].time_usec - pair[0].time_usec) as f64 * 1e-6;
        assert!((0.9..4.0).contains(&apart_s), "{apart_s} s apart");
        let [now, total] = [pair[1].ram_usage, pair[1].ram_total];
        assert!(
            now > 0 && now < total && pair[1].storage_usage[0] <= pair[1].storage_total[0],
            "{:?}",
            pair[1]
        );
        assert!(pair[1].cpu_combined[0] <= 100, "{:?}", pair[1]);
    }
}

#[test]
fn spec_sitl_does_not_fly_over_a_flight_unless_told() {
    let out = flown("logs-overwrite");
    let before = contents(&out);
    let mission = out.parent().unwrap().join("mission.toml");
    let arguments = ["sitl", mission.to_str().unwrap(), "--json", "--speed", "50", "--out"];
    let refused = veilwing(&arguments).arg(&out).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        said(&refused).contains("there is a flight in") && said(&refused).contains("--overwrite"),
        "{}",
        said(&refused)
    );
    assert_eq!(contents(&out), before);
    std::fs::write(out.join("j-autopilot.1.tlog"), "of an earlier life").unwrap();
    let again = veilwing(&arguments).arg(&out).arg("--overwrite").output().unwrap();
    assert_eq!(again.status.code(), Some(0), "{}", said(&again));
    assert!(!out.join("j-autopilot.1.tlog").exists());
}
