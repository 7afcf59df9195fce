//! Manners at a terminal: no escape sequence where nobody asked for one, and lines that a narrow window shows whole.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::fs::File;
use std::io::Read;
use std::os::fd::OwnedFd;
use std::process::Command;

use rustix::fs::{Mode, OFlags, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use command::{directory, veilwing};

/// Each subcommand with something that it does in a moment; each with words on stderr, or results on stdout.
fn commands(kept: &str, radio: &str) -> Vec<Vec<String>> {
    let flight = format!("{kept}/flight");
    let lines = [
        "--help".to_owned(),
        "--version".to_owned(),
        "no-such-command".to_owned(),
        "check config/mission.toml --vehicle config/vehicle-i.toml".to_owned(),
        "check tests/broken_missions/inverted_altitudes.toml".to_owned(),
        "plan config/paper.toml".to_owned(),
        "plan config/paper.toml --bound certify".to_owned(),
        format!("plan config/paper.toml --json --out {kept}"),
        format!("evaluate config/paper.toml {kept}/plan.json"),
        "evaluate config/paper.toml no-such-plan.json".to_owned(),
        format!("figures --scenarios 2 --only figure-3 --only figure-breakdown --out {kept}/figures"),
        format!("sitl tests/flight/yard.toml --speed 50 --out {flight}"),
        format!("campaign tests/flight/yard.toml --runs 1 --coverage --out {kept}/campaign"),
        format!("report {kept}/campaign"),
        "fly config/mission.toml --vehicle no-such-vehicle.toml".to_owned(),
        format!("radio {radio}"),
        "radio no-such-radio.toml".to_owned(),
        "calibrate pattern no-such-log.csv --receiver 0,0,0".to_owned(),
        "schema mission".to_owned(),
        format!("ground-station install --dir {kept}/buttons"),
        "watch no-such-flight".to_owned(),
        format!("manuals {kept}/manuals"),
    ];
    lines.iter().map(|line| line.split(' ').map(str::to_owned).collect()).collect()
}

/// All that a command says to a terminal of 80 columns.
fn at_a_terminal(mut command: Command) -> String {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let terminal = || -> OwnedFd {
        let path = ptsname(&master, Vec::new()).unwrap();
        open(path, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap()
    };
    let mut child = command.stdout(terminal()).stderr(terminal()).spawn().unwrap();
    // Its own ends of the terminal are open still.
    drop(command);
    let mut text = Vec::new();
    let mut piece = [0; 4096];
    let mut master = File::from(master);
    // The terminal's last end closed is an error there, EIO.
    while let Ok(length @ 1..) = master.read(&mut piece) {
        text.extend(&piece[..length]);
    }
    child.wait().unwrap();
    String::from_utf8_lossy(&text).into_owned()
}

#[test]
fn spec_no_command_sends_an_escape_sequence_into_a_pipe_or_where_it_is_refused() {
    let kept = directory("cli-manners");
    let radio = kept.join("radio.toml");
    // It ends at once: there is no such directory for its log.
    let text =
        include_str!("../packaging/etc/radio.toml").replace("/var/lib/veilwing/radio", "/proc/no-such");
    std::fs::write(&radio, text).unwrap();
    let (kept, radio) = (kept.to_str().unwrap(), radio.to_str().unwrap());
    for arguments in commands(kept, radio) {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let is_flight = arguments[0] == "sitl";
        let output = veilwing(&arguments).env("TERM", "xterm-256color").output().unwrap();
        let piped = [output.stdout, output.stderr].concat();
        assert!(!piped.is_empty() || arguments[0] == "manuals", "{arguments:?}");
        assert!(!piped.contains(&0x1B) && !piped.contains(&b'\r'), "{arguments:?} escapes into a pipe");
        for (name, value) in [("NO_COLOR", "1"), ("TERM", "dumb")] {
            if is_flight {
                // It refuses to fly into a directory that is in use; nothing of the terminal is in a flight.
                continue;
            }
            let mut command = veilwing(&arguments);
            // Where CI is set, the library that draws the help takes any terminal for one that knows colours.
            command.env("CI", "true").env("TERM", "xterm-256color").env(name, value);
            let said = at_a_terminal(command);
            assert!(!said.contains('\u{1B}'), "{arguments:?} with {name}={value}: {said:?}");
        }
    }
}

/// So that the test above can fail: at a terminal that knows them, they are there.
#[test]
fn spec_a_terminal_gets_a_bar_with_an_estimate_that_fits_80_columns() {
    let run = |refused: bool| {
        let mut command = veilwing(&["campaign", "tests/flight/yard.toml", "--runs", "2", "--threads", "1"]);
        command.env("TERM", "xterm-256color").env_remove("NO_COLOR");
        if refused {
            command.env("NO_COLOR", "1");
        }
        at_a_terminal(command)
    };
    let said = run(false);
    assert!(said.contains('\u{1B}') && said.contains("of 2") && said.contains("left"), "{said:?}");
    let plain = |line: &str| {
        let mut parts = line.split("\u{1B}[");
        let first = parts.next().unwrap_or_default().to_owned();
        parts.fold(first, |text, part| {
            text + part.trim_start_matches(|c: char| !c.is_ascii_alphabetic()).get(1..).unwrap_or_default()
        })
    };
    for line in said.split(['\r', '\n']).map(plain).filter(|line| line.contains("left")) {
        assert!(line.chars().count() <= 80, "{line:?}");
    }
    assert!(!run(true).contains("left"));
}

/// Tables for a reader, by an upper limit for a line of each.
#[test]
fn spec_tables_fit_80_columns() {
    let kept = directory("cli-manners-tables");
    let kept = kept.to_str().unwrap();
    for arguments in [
        &["plan", "config/mission.toml", "--out", kept][..],
        &["evaluate", "config/mission.toml", &format!("{kept}/plan.json")],
        &[
            "check",
            "config/mission.toml",
            "--vehicle",
            "config/vehicle-i.toml",
            "--vehicle",
            "config/vehicle-j.toml",
        ],
        &["sitl", "tests/flight/yard.toml", "--speed", "50"],
        &["campaign", "tests/flight/yard.toml", "--runs", "1", "--coverage"],
    ] {
        let output = veilwing(arguments).output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.lines().count() > 3, "{arguments:?}: {text}");
        for line in text.lines() {
            assert!(line.chars().count() <= 80, "{arguments:?}: {} columns: {line}", line.chars().count());
        }
    }
}
