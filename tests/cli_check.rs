//! `veilwing check` on files that cannot be used: exit code 2, every error with its place and remedy, no panic.

#![cfg(feature = "companion")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Output;

use command::veilwing;
use veilwing::config::Mission;

fn broken(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/broken_missions").join(file)
}

fn check(arguments: &[&str]) -> Output {
    veilwing(&[&["check"], arguments].concat()).output().unwrap()
}

/// One expected finding: place, part of the message, part of the remedy.
type Expected = (String, String, String);

fn expected() -> BTreeMap<String, Vec<Expected>> {
    let table = std::fs::read_to_string(broken("expected.txt")).unwrap();
    let mut all: BTreeMap<String, Vec<Expected>> = BTreeMap::new();
    for row in table.lines().filter(|row| !row.starts_with('#')) {
        let columns: Vec<&str> = row.split(" | ").collect();
        let [file, place, message, help] = columns[..] else { panic!("{row}") };
        let finding = (place.to_owned(), message.to_owned(), help.to_owned());
        all.entry(file.to_owned()).or_default().push(finding);
    }
    all
}

#[test]
fn spec_every_broken_file_has_an_expectation_and_there_are_twenty() {
    let files: BTreeSet<String> = std::fs::read_dir(broken(""))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".toml"))
        .collect();
    assert_eq!(files, expected().into_keys().collect());
    assert!(files.len() >= 20);
}

#[test]
fn spec_the_library_finds_every_error_and_no_other() {
    for (file, expected) in expected() {
        let findings = Mission::load(&broken(&file)).expect_err(&file);
        let found: Vec<String> =
            findings.list().iter().map(|finding| format!("{}:{}", finding.line, finding.column)).collect();
        let places: Vec<&String> = expected.iter().map(|(place, ..)| place).collect();
        assert_eq!(found.iter().collect::<Vec<_>>(), places, "{findings}");
        for (finding, (_, message, help)) in findings.list().iter().zip(&expected) {
            assert!(finding.message.contains(message), "{file}: {message:?} is not in {:?}", finding.message);
            assert!(finding.help.contains(help), "{file}: {help:?} is not in {:?}", finding.help);
        }
    }
}

#[test]
fn spec_the_command_prints_them_and_exits_with_2() {
    for (file, expected) in expected() {
        let path = broken(&file).display().to_string();
        let output = check(&[&path]);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(output.stdout.is_empty() && !stderr.contains("panicked") && !stderr.contains("backtrace"));
        for (place, message, help) in expected {
            assert!(stderr.contains(&format!("{path}:{place}: ")), "{place} is not in {stderr}");
            assert!(
                stderr.contains(&message) && stderr.contains(&help),
                "{message:?} or {help:?} is not in {stderr}"
            );
        }
    }
}

#[test]
fn spec_what_is_no_file_is_refused_in_the_same_form() {
    let huge = Path::new(env!("CARGO_TARGET_TMPDIR")).join("huge.toml");
    std::fs::write(&huge, vec![b'#'; (1 << 20) + 1]).unwrap();
    let huge = huge.display().to_string();
    for (path, message, help) in [
        ("tests/broken_missions/missing.toml", "there is no such file", "check the path"),
        ("tests/broken_missions", "this is a directory", "a file inside it"),
        (huge.as_str(), "is larger than 1048576 bytes", "a few kilobytes"),
    ] {
        let output = check(&[path]);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(&format!("{path}:1:1: ")) && stderr.contains(message), "{stderr}");
        assert!(stderr.contains("help: ") && stderr.contains(help), "{stderr}");
        assert!(output.stdout.is_empty() && !stderr.contains("panicked"));
    }
}

#[test]
fn spec_shipped_files_pass_with_a_summary() {
    let output = check(&[
        "config/mission.toml",
        "--vehicle",
        "config/vehicle-i.toml",
        "--vehicle",
        "config/vehicle-j.toml",
    ]);
    let stdout = String::from_utf8(output.stdout).unwrap();
    assert_eq!((output.status.code(), String::from_utf8(output.stderr).unwrap().as_str()), (Some(0), ""));
    for part in [
        "2 (alpha, bravo)",
        "3 (hill, gate, van)",
        "by radio.max_power_w",
        "simulated transmitters only",
        "antenna of I   dipole, its null 25 dB below the largest gain",
        "fading         none: nothing is scattered",
        "pointing       heading 2.00, mounting 0.50 deg; position 0.5 m, vertically 0.8 m",
        "origin         50.075500, 14.437800 deg, 200 m above mean sea level",
        "airspace       20 to 80 m above it, 200 m east by 200 m north, 4 corners,",
        "homes          I [-15, -10, 0], J [-10, -60, 0], 50 m apart",
        "               alpha [-15, 0, 0], within 1 m, 65 m from van",
        "               gate [-50, 60, 0], exact, 69 m from alpha",
        "power of I     up to 500.000 mW (27.0 dBm), by radio.max_power_w",
        "radio          1000 kHz, noise 1e-12 W (-90.0 dBm), path gain at 1 m 0.0 dB",
        "start          when the operator says so",
        "9 s each on the air, 18 s in all",
    ] {
        assert!(stdout.contains(part), "{part} is not in {stdout}");
    }
    let paper = check(&["config/paper.toml"]);
    let stderr = String::from_utf8(paper.stderr).unwrap();
    assert_eq!(paper.status.code(), Some(0), "{stderr}");
    let stdout = String::from_utf8(paper.stdout).unwrap();
    for ideal in ["antenna of I   ideal dipole, its null without a floor", "pointing       exact"] {
        assert!(stdout.contains(ideal), "{ideal} is not in {stdout}");
    }
    assert!(
        stderr.starts_with("config/paper.toml:") && stderr.contains("warning: `std_deg` is 0"),
        "{stderr}"
    );
}

#[test]
fn spec_an_eavesdropper_that_may_stand_at_a_user_is_warned_of() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("beside.toml");
    let mission = std::fs::read_to_string("config/paper.toml").unwrap();
    let beside = "\n[[eavesdropper]]\nname = \"beside\"\nenu_m = [30.0, 0.0, 0.0]\nradius_m = ";
    for (radius_m, warned) in [(29.0, false), (31.0, true)] {
        std::fs::write(&path, format!("{mission}{beside}{radius_m}\n")).unwrap();
        let output = check(&[path.to_str().unwrap()]);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{stderr}");
        let told = stderr.contains("eavesdropper \"beside\" may stand where user")
            && stderr.contains("30 m from where it is said to be: in the worst case no secrecy is possible");
        assert_eq!(told, warned, "{stderr}");
    }
}

#[test]
fn spec_the_summary_tells_what_the_mission_states_of_its_link_and_of_its_permission() {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = directory.join("stated.toml");
    let mission = std::fs::read_to_string("config/mission.toml").unwrap();
    let stated = "
[emission]
authorised_by = \"a regulator\"
band_hz = [2.4e9, 2.41e9]
max_power_w = 0.5
licensee = \"the testers\"
licence = \"T-1\"
valid = [2026-01-01T00:00:00Z, 2126-12-31T23:59:59Z]
site = \"a yard\"
[antenna.j]
pattern_file = [[0.0, -20.0], [90.0, 0.0], [180.0, -20.0]]
[fading]
rician_k_db = { user = 15.0, eavesdropper = 12.0 }
";
    let powers = mission.replacen("# min_power_w = 0.010 ", "min_power_w = 0.010 ", 1).replace(
        "\n# power_levels_w = [0.010, 0.025, 0.1, 0.5]\n",
        "\npower_levels_w = [0.010, 0.025, 0.1, 0.5]\n",
    );
    std::fs::write(&path, format!("{powers}{stated}")).unwrap();
    let path = path.display().to_string();
    let real = directory.join("real.toml");
    let vehicle = std::fs::read_to_string("config/vehicle-i.toml").unwrap();
    std::fs::write(&real, vehicle.replace("simulated = true ", "simulated = false")).unwrap();
    let output = check(&[&path, "--vehicle", real.to_str().unwrap()]);
    let stdout = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    for line in [
        "antenna of I   dipole, its null 25 dB below the largest gain",
        "antenna of J   measured in 3 points, the least gain -20 dB at 0 deg",
        "fading         Rician, K 15.0 dB at users, 12.0 dB at eavesdroppers",
        "pointing       heading 2.00, mounting 0.50 deg; position 0.5 m, vertically 0.8 m",
        "power of I     up to 500.000 mW (27.0 dBm), by radio.max_power_w, at least",
        "power of J     up to 500.000 mW (27.0 dBm), by radio.max_power_w, in levels of",
        "               10.000 mW, 25.000 mW, 100.000 mW, 500.000 mW",
        "emission       2400 to 2410 MHz, at most 500.000 mW (27.0 dBm), authorised by a",
        "licensee       the testers",
        "licence        T-1",
        "site           a yard",
        "valid          2026-01-01T00:00:00Z to 2126-12-31T23:59:59Z",
    ] {
        assert!(stdout.lines().any(|said| said == line), "{line:?} is not in {stdout}");
    }
    // Expired, by this machine's clock.
    let expired = std::fs::read_to_string(&path).unwrap().replace("2126-12-31", "2026-01-02");
    std::fs::write(&path, expired).unwrap();
    let output = check(&[&path, "--vehicle", real.to_str().unwrap()]);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(
        stderr.contains("it has expired, it is") && stderr.contains("a permission that holds then"),
        "{stderr}"
    );
    assert_eq!(check(&[&path]).status.code(), Some(0), "nothing real is to be radiated");
}

#[test]
fn spec_errors_of_mission_and_vehicles_are_all_printed() {
    let vehicle = Path::new(env!("CARGO_TARGET_TMPDIR")).join("slow.toml");
    let text = std::fs::read_to_string("config/vehicle-i.toml").unwrap();
    std::fs::write(&vehicle, text.replace("\nspeed_m_s = 10.0", "\nspeed_m_s = 1.0")).unwrap();
    let vehicle = vehicle.display().to_string();
    let slow = check(&["config/mission.toml", "--vehicle", &vehicle]);
    let stderr = String::from_utf8(slow.stderr).unwrap();
    assert_eq!(slow.status.code(), Some(2));
    assert!(
        stderr.contains("`speed_m_s` is 1 m/s, but the mission plans this vehicle with 8 m/s"),
        "{stderr}"
    );

    let both = check(&["tests/broken_missions/zero_noise.toml", "--vehicle", "config/mission.toml"]);
    let stderr = String::from_utf8(both.stderr).unwrap();
    assert_eq!(both.status.code(), Some(2));
    assert!(stderr.contains("zero_noise.toml:3:17: ") && stderr.contains("config/mission.toml:"), "{stderr}");
}

#[test]
fn spec_the_schema_is_one_json_document_with_all_files_or_that_of_one() {
    let output = veilwing(&["schema"]).output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let schema: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for file in ["mission", "vehicle", "radio"] {
        assert!(schema["definitions"][file]["properties"].is_object(), "{file}");
        let one = veilwing(&["schema", file]).output().unwrap();
        let one: serde_json::Value = serde_json::from_slice(&one.stdout).unwrap();
        assert_eq!(one["properties"], schema["definitions"][file]["properties"]);
    }
}
