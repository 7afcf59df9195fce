//! Flights whose world gives out the time (`veilwing sitl`): real processes and sockets, and nothing that depends
//! on who is run when.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use command::{directory, said, veilwing};

const MISSION: &str = include_str!("flight/yard.toml");
const FAULTS: &str = "[[fault]]\nkind = \"pair-degraded\"\nloss = 0.2\nspread_s = 0.02\nafter_s = 0\n\
    [[fault]]\nkind = \"companion-stop\"\nvehicle = \"i\"\nslot = 0\nafter_s = 1\nduration_s = 0.3\n\
    [[fault]]\nkind = \"companion-restart\"\nvehicle = \"j\"\nslot = 0\nafter_s = 3\nduration_s = 0.5\n";

fn write(directory: &Path, name: &str, text: &str) -> String {
    let path = directory.join(name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Without how long it took.
fn document(text: &[u8]) -> Value {
    let mut document: Value = serde_json::from_slice(text).unwrap();
    assert!(document.as_object_mut().unwrap().remove("wall_s").unwrap().as_f64().unwrap() > 0.0);
    document
}

#[test]
fn spec_a_flight_in_step_is_the_same_to_the_last_message_each_time() {
    let directory = directory("in-step-twice");
    let mission = write(&directory, "mission.toml", MISSION);
    let faults = write(&directory, "faults.toml", FAULTS);
    let flights = ["first", "second"].map(|name| {
        let out = directory.join(name);
        let arguments = ["sitl", &mission, "--json", "--speed", "50", "--faults", &faults, "--out"];
        let output = veilwing(&arguments).arg(&out).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", said(&output));
        let events = std::fs::read_to_string(out.join("events.jsonl")).unwrap();
        (document(&output.stdout), events)
    });
    let [(document, events), second] = &flights;
    assert_eq!((document, events), (&second.0, &second.1));
    assert_eq!(document["violations"], Value::Array(Vec::new()), "{document:#}");
    for fault in ["companion-stop", "companion-restart"] {
        assert!(events.contains(fault), "{events}");
    }
    assert!(events.contains("vehicle J's companion restarted"), "{events}");
}

fn signal(process: u32, signal: Signal) {
    kill_process(Pid::from_raw(process.try_into().unwrap()).unwrap(), signal).unwrap();
}

/// A flight under way, its processes (the world and the companions), and what it says.
fn started(mission: &str) -> (Child, [u32; 3], impl Iterator<Item = String>) {
    let arguments = ["sitl", mission, "--json", "--speed", "10"];
    let mut sitl = veilwing(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(sitl.stderr.take().unwrap()).lines().map(Result::unwrap);
    let companions = [(); 2].map(|()| {
        lines.find_map(|line| line.split_once("companion started, process ")?.1.trim().parse().ok()).unwrap()
    });
    let processes = [sitl.id(), companions[0], companions[1]];
    (sitl, processes, lines)
}

/// Nothing of what the machine does is in the flight: whoever is not run for a while, the others wait.
#[test]
fn spec_a_process_that_is_not_run_for_a_while_is_not_late() {
    let directory = directory("in-step-held-up");
    let mission = write(&directory, "mission.toml", MISSION);
    let undisturbed = veilwing(&["sitl", &mission, "--json", "--speed", "50"]).output().unwrap();
    assert_eq!(undisturbed.status.code(), Some(0), "{}", said(&undisturbed));
    let (mut sitl, processes, mut lines) = started(&mission);
    assert!(lines.any(|line| line.contains("I  ") && line.contains("slot 0: on")));
    let clock = veilwing::link::Clock::real();
    for process in processes {
        // Two seconds of flight each, far more than any lease.
        let until = clock.now() + std::time::Duration::from_millis(200);
        signal(process, Signal::STOP);
        while clock.now() < until {
            std::thread::yield_now();
        }
        signal(process, Signal::CONT);
    }
    let said: Vec<String> = lines.collect();
    let mut disturbed = Vec::new();
    sitl.stdout.take().unwrap().read_to_end(&mut disturbed).unwrap();
    assert_eq!(sitl.wait().unwrap().code(), Some(0), "{said:#?}");
    assert_eq!(document(&disturbed), document(&undisturbed.stdout));
}

#[test]
fn spec_a_companion_that_dies_of_something_else_does_not_stop_the_world() {
    let directory = directory("in-step-death");
    let mission = write(&directory, "mission.toml", MISSION);
    let (mut sitl, [_, _, j], mut lines) = started(&mission);
    assert!(lines.any(|line| line.contains("I  ") && line.contains("slot 0: on")));
    signal(j, Signal::KILL);
    let said: Vec<String> = lines.collect();
    let mut text = Vec::new();
    sitl.stdout.take().unwrap().read_to_end(&mut text).unwrap();
    assert_eq!(sitl.wait().unwrap().code(), Some(1), "{said:#?}");
    let document = document(&text);
    assert_eq!(document["violations"], Value::Array(Vec::new()), "{document:#}");
    assert!(said.iter().any(|line| line.contains("J  companion was killed by signal 9")), "{said:#?}");
    assert!(
        said.iter().any(|line| line.contains("I  ") && line.contains("landed and disarmed")),
        "{said:#?}"
    );
}

/// A vehicle file.
fn vehicle(directory: &Path, autopilot: &str, simulated: bool) -> String {
    let logs = toml::Value::from(directory.display().to_string());
    let text = format!(
        "[vehicle]\nrole = \"i\"\n[autopilot]\nlink = \"{autopilot}\"\nsystem_id = 1\n\
         [transmitter]\nkind = \"leased\"\nsimulated = {simulated}\n[pair]\nlink = \"udpout:127.0.0.1:9\"\n[log]\ndir = {logs}\n"
    );
    write(directory, "vehicle.toml", &text)
}

/// Nobody flies by a time that is made up: not with a real transmitter, not with an autopilot elsewhere, and not unless
/// somebody is there who gives out time.
#[test]
fn spec_only_a_simulated_vehicle_takes_its_time_from_stdin_and_only_from_a_world() {
    let directory = directory("in-step-refused");
    let permit = "[emission]\nauthorised_by = \"a test\"\nband_hz = [2.4e9, 2.5e9]\nmax_power_w = 1.0\n\
        valid = [2026-01-01T00:00:00Z, 2126-01-01T00:00:00Z]\n";
    let mission = write(&directory, "mission.toml", &format!("{MISSION}{permit}"));
    let (loopback, begin) = ("udpout:127.0.0.1:9", "veilwing-step/1 1000000 1800014400000000\n");
    let twice = format!("{begin}{begin}");
    for (autopilot, simulated, input, says) in [
        ("udpout:192.168.1.7:14550", true, begin, "udpout:192.168.1.7:14550 is not UDP within this machine"),
        ("udpin:0.0.0.0:14550", true, begin, "udpin:0.0.0.0:14550 is not UDP within this machine"),
        ("serial:/dev/ttyACM0:57600", true, begin, "is not UDP within this machine"),
        ("serial:/dev/ttyACM0:57600", false, begin, "the transmitter is real"),
        (loopback, true, "", "stdin gives no time"),
        (loopback, true, "go 1 2\n", "stdin gives no time"),
        (loopback, true, "yes\n", "\"yes\" is no word of a simulated world"),
        (loopback, true, twice.as_str(), "the world began twice"),
    ] {
        let vehicle = vehicle(&directory, autopilot, simulated);
        let arguments = ["fly", &mission, "--vehicle", &vehicle, "--clock-from-stdin"];
        let mut child = veilwing(&arguments).stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        // It may have refused already.
        let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{autopilot} {input:?}: {}", said(&output));
        assert!(said(&output).contains(says), "{autopilot} {input:?}: {}", said(&output));
    }
    // Nor beside a clock of its own, and the world's end is the companion's.
    let vehicle = vehicle(&directory, loopback, true);
    let fly = ["fly", &mission, "--vehicle", &vehicle, "--clock-from-stdin"];
    let both = veilwing(&[&fly[..], &["--clock-rate", "2"]].concat()).output().unwrap();
    assert_eq!(both.status.code(), Some(2), "{}", said(&both));
    let mut child = veilwing(&fly).stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(format!("{begin}go 1000000 1002500\n").as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", said(&output));
    assert!(said(&output).lines().any(|line| line == "done 1002500"), "{}", said(&output));
}

#[test]
fn spec_radios_with_links_of_their_own_are_flown_in_step_and_logged_by_themselves() {
    let directory = directory("in-step-radios");
    let mission = write(&directory, "mission.toml", MISSION);
    let out = directory.join("flight");
    let arguments = ["sitl", &mission, "--json", "--speed", "50", "--own-radio-links", "--out"];
    let output = veilwing(&arguments).arg(&out).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", said(&output));
    let document = document(&output.stdout);
    assert_eq!(document["violations"], Value::Array(Vec::new()), "{document:#}");
    for slot in document["slots"].as_array().unwrap() {
        assert!(slot["radiated_s"]["i"].as_f64().unwrap() > 2.5, "{document:#}");
        assert_eq!(slot["unprotected_s"].as_f64(), Some(0.0), "{document:#}");
    }
    for name in ["i", "j"] {
        let vehicle = std::fs::read_to_string(out.join(format!("vehicle-{name}.toml"))).unwrap();
        assert!(
            vehicle.contains("[transmitter]") && vehicle.matches("udpout:127.0.0.1").count() == 3,
            "{vehicle}"
        );
    }
    // The companions' logs alone tell what was radiated: it is in the radios' logs.
    let logs = directory.join("logs");
    std::fs::create_dir_all(&logs).unwrap();
    std::fs::copy(&mission, logs.join("mission.toml")).unwrap();
    for name in ["i", "j"] {
        for link in ["autopilot", "transmitter", "pair"] {
            let log = format!("{name}-{link}.tlog");
            std::fs::copy(out.join(&log), logs.join(&log)).unwrap();
        }
    }
    let page = directory.join("page.html");
    let report =
        veilwing(&["report", logs.to_str().unwrap(), "--out", page.to_str().unwrap()]).output().unwrap();
    assert_eq!(report.status.code(), Some(0), "{}", said(&report));
    let text = std::fs::read_to_string(&page).unwrap();
    assert!(text.contains("<dt>slots served in full</dt><dd>2 of 2</dd>"), "{text}");
}
