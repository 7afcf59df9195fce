//! `veilwing sitl --radio-hosts`: real radio hosts and devices over loopback, whatever the machine has to do beside: nothing
//! here depends on when something happens. Whole flights of theirs are in virtual time (`tests/flight/hosts.rs`), and by the
//! wall's clock in `examples/radio_faults.rs`.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::Stdio;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use command::{directory, said, veilwing};

const MISSION: &str = include_str!("flight/yard.toml");

fn mission(directory: &Path) -> String {
    let path = directory.join("mission.toml");
    std::fs::write(&path, MISSION).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Each host has told its device off over the device's own protocol, read it back, and heard its companion.
fn hosts_serve_and_end(kind: &str, key: &str) {
    let directory = directory(&format!("radio-hosts-{kind}"));
    let (mission, out) = (mission(&directory), directory.join("out"));
    let arguments = ["sitl", &mission, "--json", "--radio-hosts", kind, "--device-dead-ms", "400", "--out"];
    let mut sitl =
        veilwing(&arguments).arg(&out).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(sitl.stderr.take().unwrap()).lines().map(Result::unwrap);
    let mut children = Vec::new();
    let mut awaited =
        ["] I  |radio: off", "] J  |radio: off", "] I  |commanded by 1/191", "] J  |commanded by 2/191"]
            .to_vec();
    let mut heard = Vec::new();
    while !awaited.is_empty() {
        let line = lines.next().unwrap_or_else(|| panic!("{kind}: the flight ended: {heard:#?}"));
        if let Some((_, process)) = line.split_once("started, process ") {
            children.push(process.trim().to_owned());
        }
        awaited.retain(|parts| !parts.split('|').all(|part| line.contains(part)));
        heard.push(line);
    }
    assert_eq!(children.len(), 4, "{heard:#?}");
    kill_process(Pid::from_raw(sitl.id().cast_signed()).unwrap(), Signal::INT).unwrap();
    heard.extend(lines);
    let mut document = String::new();
    sitl.stdout.take().unwrap().read_to_string(&mut document).unwrap();
    assert_eq!(sitl.wait().unwrap().code(), Some(130), "{heard:#?}");
    for child in children {
        assert!(!Path::new("/proc").join(&child).exists(), "process {child} is still there");
    }
    let document: Value = serde_json::from_str(&document).unwrap();
    assert_eq!(document["radio_hosts"]["kind"], kind, "{document:#}");
    assert_eq!(document["radio_hosts"]["dead_ms"], 400.0);
    assert_eq!(document["violations"], Value::Array(Vec::new()), "{document:#}");
    for name in ["i", "j"] {
        // A file to start from, which says what the device is.
        let text = std::fs::read_to_string(out.join(format!("radio-{name}.toml"))).unwrap();
        assert!(text.contains(&format!("kind = \"{key}\"")) && text.contains("dead_ms = 400.0"), "{text}");
        assert!(out.join(format!("radio-{name}")).join("radio.tlog").exists());
    }
}

#[test]
fn spec_hosts_of_programs_serve_and_end_with_the_flight() {
    hosts_serve_and_end("command", "command");
}

#[test]
fn spec_hosts_of_attenuators_serve_and_end_with_the_flight() {
    hosts_serve_and_end("attenuator", "attenuator");
}

#[test]
fn spec_hosts_of_radios_by_json_serve_and_end_with_the_flight() {
    hosts_serve_and_end("json_rpc", "json_rpc");
}

#[test]
fn spec_hosts_of_modems_serve_and_end_with_the_flight() {
    hosts_serve_and_end("at", "at");
}

#[test]
fn spec_hosts_of_every_other_way_to_a_device_serve_and_end_with_the_flight() {
    for (kind, key) in [
        ("interface", "command"),
        ("attenuator_http", "attenuator"),
        ("ubus", "json_rpc"),
        ("parameter", "parameter"),
        ("parameter_bytewise", "parameter"),
    ] {
        hosts_serve_and_end(kind, key);
    }
}

#[cfg(feature = "serial")]
#[test]
fn spec_hosts_of_devices_on_serial_lines_serve_and_end_with_the_flight() {
    hosts_serve_and_end("attenuator_serial", "attenuator");
    hosts_serve_and_end("at_serial", "at");
}

#[test]
fn spec_a_host_that_ends_by_itself_on_the_ground_ends_the_flight() {
    let directory = directory("radio-hosts-ends");
    let (mission, out) = (mission(&directory), directory.join("out"));
    let mut sitl = veilwing(&["sitl", &mission, "--json", "--radio-hosts", "at", "--out"])
        .arg(&out)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(sitl.stderr.take().unwrap()).lines().map(Result::unwrap);
    let mut heard = Vec::new();
    let mut host = None;
    for line in lines.by_ref() {
        if let Some((_, process)) = line.split_once("J  radio host started, process ") {
            host = process.trim().parse().ok();
        }
        // It stops in order from here on.
        let ready = line.contains("] J  ") && line.contains("radio: off");
        heard.push(line);
        if ready {
            break;
        }
    }
    kill_process(host.and_then(Pid::from_raw).unwrap(), Signal::TERM).unwrap();
    heard.extend(lines);
    assert!(heard.iter().any(|line| line.contains("no flight without J's radio host")), "{heard:#?}");
    let mut document = String::new();
    sitl.stdout.take().unwrap().read_to_string(&mut document).unwrap();
    assert_eq!(sitl.wait().unwrap().code(), Some(1), "{heard:#?}");
    assert!(document.contains("\"result\": \"aborted\""), "{document}");
}

#[test]
fn spec_what_cannot_work_is_refused_with_a_reason() {
    let directory = directory("radio-hosts-refused");
    let mission = mission(&directory);
    let hosts = ["sitl", &mission, "--radio-hosts", "at"];
    let faults = "config/faults-radio.toml";
    let cases: [(&[&str], &str); 7] = [
        (&["--speed", "4"], "a radio host lives by this machine's clock"),
        (&["--own-radio-links"], "--own-radio-links"),
        (&["--device-ms", "20"], "--device-ms"),
        (&["--device-dead-ms", "soon"], "give milliseconds"),
        (&["!", "--radio-hosts", "smoke"], "smoke"),
        (&["!", "--faults", faults], "befalls radio hosts, and there are none: give --radio-hosts KIND"),
        (&["!", "--device-goes-dark"], "--radio-hosts"),
    ];
    for (more, says) in cases {
        let arguments = match more {
            ["!", more @ ..] => [&hosts[..2], more].concat(),
            more => [&hosts[..], more].concat(),
        };
        let output = veilwing(&arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", said(&output));
        assert!(said(&output).contains(says), "{arguments:?}: {}", said(&output));
    }
    let output = veilwing(&["campaign", &mission, "--runs", "1", "--faults", faults]).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains("campaigns have none"), "{}", said(&output));
}
