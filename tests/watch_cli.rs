//! `veilwing watch` at a terminal: it is taken over, and given back as it was, whatever ends the view; and where there is none.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use mavlink::dialects::ardupilotmega::*;
use rustix::fs::{Mode, OFlags, open};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcgetattr, tcsetwinsize};
use veilwing::link::codec::Encoder;
use veilwing::link::tlog::append_record;
use veilwing::time::Utc;

use command::{directory, veilwing};

const LEAVES: &str = "\u{1B}[?1049l";

/// A flight of two messages, a minute apart.
fn flight(name: &str) -> PathBuf {
    let directory = directory(name);
    let mut encoder = Encoder::default();
    let mut log = Vec::new();
    for (second, phase) in [(0, 1.0), (60, 11.0)] {
        let message = MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
            time_boot_ms: 0,
            value: phase,
            name: "VW_PHASE".into(),
        });
        let utc = Utc { unix_us: 1_795_284_000_000_000 + second * 1_000_000 };
        append_record(&mut log, utc, encoder.encode((1, 191), &message).raw_bytes());
    }
    std::fs::write(directory.join("i-autopilot.tlog"), log).unwrap();
    directory
}

enum Does<'a> {
    Types(&'a [u8]),
    Sends(Signal),
    HangsUp,
}

/// How it ended, what it had drawn, and whether the terminal is as it was.
fn at_a_terminal(flight: &Path, does: &Does<'_>) -> (ExitStatus, String, bool) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let terminal = || -> OwnedFd {
        open(ptsname(&master, Vec::new()).unwrap(), OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap()
    };
    let kept = terminal();
    tcsetwinsize(&kept, Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 }).unwrap();
    let before = tcgetattr(&kept).unwrap();
    let mut command = veilwing(&["watch", flight.to_str().unwrap()]);
    command.env("TERM", "xterm-256color").env_remove("NO_COLOR");
    command.stdin(terminal()).stdout(terminal()).stderr(terminal());
    let mut child = command.spawn().unwrap();
    drop(command);
    let mut master = File::from(master);
    let mut drawn = String::new();
    let mut piece = [0; 4096];
    while !drawn.contains("quit") {
        let length = master.read(&mut piece).unwrap();
        drawn += &String::from_utf8_lossy(&piece[..length]);
    }
    let raw = tcgetattr(&kept).unwrap();
    assert_ne!(raw.local_modes, before.local_modes, "it reads key by key");
    match does {
        Does::Types(keys) => master.write_all(keys).unwrap(),
        Does::Sends(signal) => {
            let pid = Pid::from_raw(i32::try_from(child.id()).unwrap()).unwrap();
            kill_process(pid, *signal).unwrap();
        }
        Does::HangsUp => {
            // Nobody is at the other end any more.
            drop(master);
            return (child.wait().unwrap(), drawn, true);
        }
    }
    while !drawn.contains(LEAVES) {
        let length = master.read(&mut piece).unwrap();
        drawn += &String::from_utf8_lossy(&piece[..length]);
    }
    let status = child.wait().unwrap();
    let after = tcgetattr(&kept).unwrap();
    (status, drawn, after.local_modes == before.local_modes && after.input_modes == before.input_modes)
}

#[test]
fn spec_the_terminal_is_given_back_after_a_key_a_signal_and_a_hangup() {
    let flight = flight("watch-terminal");
    for (does, code) in [
        (Does::Types(b"q"), 0),
        (Does::Types(b"?k q"), 0),
        (Does::Types(b"\x03"), 130),
        (Does::Sends(Signal::TERM), 130),
        (Does::Sends(Signal::INT), 130),
        (Does::Sends(Signal::HUP), 130),
        (Does::Sends(Signal::QUIT), 130),
    ] {
        let (status, drawn, as_it_was) = at_a_terminal(&flight, &does);
        assert_eq!(status.code(), Some(code), "{drawn}");
        assert!(as_it_was && drawn.contains("standby") && drawn.contains("\u{1B}[?25h"), "{drawn}");
    }
    let (status, ..) = at_a_terminal(&flight, &Does::HangsUp);
    assert!(status.code().is_some(), "it ends by itself: {status}");
}

#[test]
fn spec_without_a_terminal_or_without_a_flight_it_says_so_and_ends_with_2() {
    let output = veilwing(&["watch", "udpin:127.0.0.1:14555"]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("stdout is none") && output.stdout.is_empty(), "{said}");
    let output = veilwing(&["sitl", "tests/flight/yard.toml", "--watch"]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("--watch: watch draws on a terminal"), "{said}");
}
