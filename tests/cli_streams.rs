//! Where results and words go: a stdout or stderr that takes nothing, a directory that cannot be written, Ctrl-C. Each
//! has its exit code and a word that helps; none is a panic.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::process::Stdio;

use command::{directory, said, veilwing};

fn full() -> File {
    File::options().write(true).open("/dev/full").unwrap()
}

const COMMANDS: [&[&str]; 4] = [
    &["check", "config/mission.toml"],
    &["schema"],
    &["plan", "config/paper.toml", "--json"],
    &["campaign", "config/mission.toml", "--runs", "1", "--json"],
];

#[test]
fn spec_a_full_disk_behind_stdout_is_told_and_ends_with_1() {
    for arguments in COMMANDS {
        let output = veilwing(arguments).stdout(full()).output().unwrap();
        let said = said(&output);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(said.contains("cannot write the result to stdout") && !said.contains("panicked"), "{said}");
    }
}

#[test]
fn spec_a_reader_that_has_gone_away_is_no_failure() {
    for arguments in COMMANDS {
        let mut child = veilwing(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", said(&output));
        assert!(!said(&output).contains("panicked"), "{}", said(&output));
    }
}

#[test]
fn spec_words_that_nobody_can_hear_change_no_result_and_no_exit_code() {
    for (arguments, code) in [
        (&["check", "no-such.toml"][..], 2),
        (&["plan", "no-such.toml"], 2),
        (&["evaluate", "config/paper.toml", "no-such.json"], 2),
        (&["--no-such-option"], 2),
        (&["check", "config/paper.toml"], 0),
        (&["campaign", "config/mission.toml", "--runs", "1"], 0),
    ] {
        let output = veilwing(arguments).stderr(full()).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        assert_eq!(output.stdout.is_empty(), code != 0, "{arguments:?}");
        let mut child = veilwing(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stderr.take());
        assert_eq!(child.wait().unwrap().code(), Some(code), "{arguments:?}");
    }
}

#[test]
fn spec_an_output_directory_that_cannot_be_written_is_refused_before_the_work() {
    let in_the_way = directory("cli-streams").join("file");
    std::fs::write(&in_the_way, "").unwrap();
    let in_the_way = in_the_way.display().to_string();
    let under = format!("{in_the_way}/under");
    for command in [
        &["plan", "config/mission.toml"][..],
        &["sitl", "config/mission.toml"],
        &["campaign", "config/mission.toml", "--runs", "1"],
        &["figures"],
    ] {
        for (out, why, remedy) in [
            ("/proc/no-such", "there is no such directory", "give a directory in which files can be made"),
            (under.as_str(), "is a file, not a directory", "give a directory in which files can be made"),
            (in_the_way.as_str(), "", "give "),
        ] {
            let output = veilwing(&[command, &["--out", out]].concat()).output().unwrap();
            let said = said(&output);
            assert_eq!(output.status.code(), Some(2), "{command:?}: {said}");
            assert!(said.contains(&format!("cannot write {out}")) && !said.contains("panicked"), "{said}");
            assert!(said.contains(why) && said.contains(remedy), "{command:?}: {said}");
            assert!(output.stdout.is_empty());
        }
    }
}

/// What only computes ends at once: no half-written file, no other exit code.
#[test]
fn spec_ctrl_c_and_sigterm_end_a_command_with_130() {
    for signal in [rustix::process::Signal::INT, rustix::process::Signal::TERM] {
        // It warns of the mission, then waits for a plan that never comes.
        let mut child = veilwing(&["evaluate", "config/paper.toml", "-"])
            .stdin(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Not its end, which would be an answer.
        let _plan = child.stdin.take();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        stderr.read_line(&mut line).unwrap();
        assert!(line.contains("warning"), "{line}");
        let pid = rustix::process::Pid::from_raw(child.id().try_into().unwrap()).unwrap();
        rustix::process::kill_process(pid, signal).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{signal:?}");
        assert!(stderr.lines().any(|line| line.unwrap() == "interrupted"));
    }
}

/// A companion whose log nobody takes goes on, and stops in order: with the program that started it, if told so.
#[test]
fn spec_a_companion_outlives_its_log_and_ends_with_who_started_it() {
    let directory = directory("cli-streams-companion");
    let vehicle = directory.join("vehicle.toml");
    let logs = toml::Value::from(directory.display().to_string());
    let text = format!(
        "[vehicle]\nrole = \"i\"\n[autopilot]\nlink = \"udpout:127.0.0.1:9\"\n\
         [pair]\nlink = \"udpout:127.0.0.1:9\"\n[log]\ndir = {logs}\n"
    );
    std::fs::write(&vehicle, text).unwrap();
    let vehicle = vehicle.display().to_string();
    for disk_is_full in [false, true] {
        let arguments = ["fly", "config/mission.toml", "--vehicle", &vehicle, "--until-stdin-ends"];
        let stderr = if disk_is_full { full().into() } else { Stdio::piped() };
        let mut child = veilwing(&arguments).stdin(Stdio::piped()).stderr(stderr).spawn().unwrap();
        drop(child.stderr.take());
        // Waiting closes stdin.
        assert_eq!(child.wait().unwrap().code(), Some(130), "{disk_is_full}");
    }
}
