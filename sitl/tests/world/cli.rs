//! The program as a user runs it.

use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};

const PROGRAM: &str = env!("CARGO_BIN_EXE_veilwing-sitl");

#[test]
fn spec_help_has_an_example_and_bad_arguments_exit_2() {
    let help = Command::new(PROGRAM).args(["vehicle", "--help"]).output().unwrap();
    assert!(help.status.success());
    assert!(
        String::from_utf8_lossy(&help.stdout).contains("veilwing-sitl vehicle --link udpout:127.0.0.1:14550")
    );
    for bad in [
        &["--link", "carrier-pigeon"][..],
        &["--link", "udpout:127.0.0.1:9", "--speed", "0"],
        &["--link", "udpout:127.0.0.1:9", "--home", "91,0,0"],
        &["--link", "udpout:127.0.0.1:9", "--system-id", "0"],
        &["--link", "udpin:192.0.2.1:14550"],
        &["--link", "udpout:127.0.0.1:9", "--wind", "3,4"],
        &["--link", "udpout:127.0.0.1:9", "--turbulence", "-1"],
        &["--link", "udpout:127.0.0.1:9", "--airframe-file", "no-such-airframe.toml"],
        &["--link", "udpout:127.0.0.1:9", "--airframe-file", "Cargo.toml"],
        &[],
    ] {
        let output = Command::new(PROGRAM).arg("vehicle").args(bad).output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{bad:?}: {errors}");
        assert!(!errors.contains("panicked"), "{errors}");
    }
}

#[test]
fn spec_a_duration_ends_it_well() {
    let output = Command::new(PROGRAM)
        .args(["vehicle", "--link", "udpout:127.0.0.1:9", "--speed", "100", "--duration", "5"])
        .args(["--airframe-file", "airframes/level-four.toml", "--wind", "-3,1,0", "--turbulence", "4"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn spec_a_signal_ends_it_cleanly_with_130() {
    for signal in ["-INT", "-TERM"] {
        let mut child = Command::new(PROGRAM)
            .args(["vehicle", "--link", "udpout:127.0.0.1:9"])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Its first line comes when the signals are listened for.
        let mut lines = BufReader::new(child.stderr.take().unwrap());
        let mut first = String::new();
        lines.read_line(&mut first).unwrap();
        assert!(first.contains("system 1"), "{first}");
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        assert_eq!(child.wait().unwrap().code(), Some(130));
        let mut rest = String::new();
        lines.read_to_string(&mut rest).unwrap();
        assert!(!rest.contains("panicked"), "{rest}");
    }
}
