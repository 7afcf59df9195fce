//! `veilwing check` on missions that are legal and dangerous: a warning with file, line, key, value and remedy, exit code 0;
//! and none on what is shipped.

#![cfg(feature = "companion")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::path::Path;

use command::veilwing;

/// A slip: what stands in config/mission.toml, what somebody makes of it, and what must be said of it.
struct Slip {
    name: &'static str,
    /// The first occurrence is replaced.
    from: &'static str,
    to: &'static str,
    /// What stands in the line that is warned of.
    line: &'static str,
    /// The value, in the message.
    message: &'static str,
    help: &'static str,
}

const SLIPS: [Slip; 26] = [
    Slip {
        name: "user-far",
        from: "enu_m = [-15.0, 0.0, 0.0]",
        to: "enu_m = [15000.0, 0.0, 0.0]",
        line: "enu_m = [15000.0",
        message: "user \"alpha\" is 14.9 km from the area",
        help: "metres from the mission origin",
    },
    Slip {
        name: "beside-a-user",
        from: "enu_m = [80.0, -40.0, 5.0]",
        to: "enu_m = [-14.0, 2.0, 0.0]",
        line: "enu_m = [-14.0",
        message: "eavesdropper \"hill\" stands 2.2 m beside user \"alpha\"",
        help: "check both positions",
    },
    Slip {
        name: "home-in-the-band",
        from: "home_enu_m = [-15.0, -10.0, 0.0]",
        to: "home_enu_m = [-15.0, -10.0, 30.0]",
        line: "home_enu_m = [-15.0, -10.0, 30.0]",
        message: "the home of I is 30 m above the origin, inside the band of 20 to 80 m",
        help: "where the vehicle stands on the ground",
    },
    Slip {
        name: "home-above-the-band",
        from: "home_enu_m = [-10.0, -60.0, 0.0]",
        to: "home_enu_m = [-10.0, -60.0, 200.0]",
        line: "home_enu_m = [-10.0, -60.0, 200.0]",
        message: "the home of J is 200 m above the origin, above the band of 20 to 80 m",
        help: "in metres",
    },
    Slip {
        name: "home-far-below",
        from: "home_enu_m = [-10.0, -60.0, 0.0]",
        to: "home_enu_m = [-10.0, -60.0, -200.0]",
        line: "home_enu_m = [-10.0, -60.0, -200.0]",
        message: "the home of J is 220 m below the lowest altitude of 20 m",
        help: "in metres",
    },
    Slip {
        name: "power-in-dbm",
        from: "max_power_w = 0.5 ",
        to: "max_power_w = 27.0 ",
        line: "max_power_w = 27.0",
        message: "`max_power_w` is 27 W, which is 44.3 dBm",
        help: "if 27 dBm were meant, write 5.012e-1",
    },
    Slip {
        name: "altitudes-above-the-sea",
        from: "altitude_m = [20.0, 80.0] ",
        to: "altitude_m = [220.0, 280.0] ",
        line: "altitude_m = [220.0",
        message: "from 220 to 280 m above the mission origin, which is itself 200 m above the sea",
        help: "write [20, 80]",
    },
    Slip {
        name: "user-above-the-sea",
        from: "enu_m = [15.0, 8.0, 1.5]",
        to: "enu_m = [15.0, 8.0, 201.5]",
        line: "enu_m = [15.0, 8.0, 201.5]",
        message: "user \"bravo\" is 201.5 m above the mission origin",
        help: "if this one is above the sea, write 1.5",
    },
    Slip {
        name: "low",
        from: "altitude_m = [20.0, 80.0] ",
        to: "altitude_m = [6.0, 80.0] ",
        line: "altitude_m = [6.0",
        message: "`altitude_m` lets the vehicles fly 6 m above the mission origin",
        help: "8 m or more",
    },
    Slip {
        name: "past",
        from: "# start_utc = 2026-11-21T18:00:00Z ",
        to: "start_utc = 2024-11-21T18:00:00Z ",
        line: "start_utc = 2024",
        message: "`start_utc` is 2024-11-21T18:00:00Z, which has passed",
        help: "leave it out: then the operator starts",
    },
    Slip {
        name: "short-slot",
        from: "slot_s = 10.0 ",
        to: "slot_s = 3.0 ",
        line: "slot_s = 3.0",
        message: "of each slot of 3 s 2.0 s are on the air, less than the 3.0 s",
        help: "give longer slots",
    },
    Slip {
        name: "slot-in-milliseconds",
        from: "slot_s = 10.0 ",
        to: "slot_s = 10000.0 ",
        line: "slot_s = 10000.0",
        message: "2 slots of 10000 s take 333 min at least",
        help: "slot_s is in seconds",
    },
    Slip {
        name: "origin-empty",
        from: "{ lat_deg = 50.0755, lon_deg = 14.4378, alt_amsl_m = 200.0 }\n# (default",
        to: "{ lat_deg = 0.0, lon_deg = 0.0, alt_amsl_m = 200.0 }\n# (default",
        line: "lat_deg = 0.0",
        message: "the origin 0, 0 lies in the sea",
        help: "give lat_deg and lon_deg of the site",
    },
    Slip {
        name: "noise-in-milliwatts",
        from: "noise_power_w = 1.0e-12 ",
        to: "noise_power_w = 1.0e-9 ",
        line: "noise_power_w = 1.0e-9",
        message: "`noise_power_w` is 1e-9 W, -60.0 dBm: 54 dB above the thermal noise",
        help: "-114.0 dBm are 4.0e-15 W",
    },
    Slip {
        name: "noise-below-thermal",
        from: "noise_power_w = 1.0e-12 ",
        to: "noise_power_w = 1.0e-20 ",
        line: "noise_power_w = 1.0e-20",
        message: "`noise_power_w` is 1e-20 W, -170.0 dBm: less than the thermal noise",
        help: "over the whole bandwidth",
    },
    Slip {
        name: "bandwidth-in-megahertz",
        from: "bandwidth_hz = 1.0e6 ",
        to: "bandwidth_hz = 20.0 ",
        line: "bandwidth_hz = 20.0",
        message: "`bandwidth_hz` is 20 Hz",
        help: "if 20 MHz were meant, write 2e7",
    },
    Slip {
        name: "jitter-in-radians",
        from: "std_deg = 2.0  ",
        to: "std_deg = 0.035  ",
        line: "std_deg = 0.035",
        message: "`std_deg` is 0.035 deg, steadier than any vehicle",
        help: "if 0.035 rad were meant, write 2.01",
    },
    Slip {
        name: "heading-in-radians",
        from: "heading_std_deg = 2.0 ",
        to: "heading_std_deg = 0.0349 ",
        line: "heading_std_deg = 0.0349",
        message: "`heading_std_deg` is 0.0349 deg",
        help: "if 0.0349 rad were meant, write 2.00",
    },
    Slip {
        name: "tilt-in-radians",
        from: "max_tilt_deg = 90.0 ",
        to: "max_tilt_deg = 1.57 ",
        line: "max_tilt_deg = 1.57",
        message: "`max_tilt_deg` is 1.57 deg",
        help: "if 1.57 rad were meant, write 90",
    },
    Slip {
        name: "speed-in-kilometres-an-hour",
        from: "speed_m_s = 8.0 ",
        to: "speed_m_s = 29.0 ",
        line: "speed_m_s = 29.0",
        message: "`speed_m_s` is 29 m/s, 104 km/h",
        help: "if 29 km/h were meant, write 8.1",
    },
    Slip {
        name: "close",
        from: "min_separation_m = 5.0 ",
        to: "min_separation_m = 1.0 ",
        line: "min_separation_m = 1.0",
        message: "`min_separation_m` is 1 m",
        help: "5 m or more",
    },
    Slip {
        name: "shallow-null",
        from: "null_depth_db = 25.0 ",
        to: "null_depth_db = 2.5 ",
        line: "null_depth_db = 2.5",
        message: "`null_depth_db` is 2.5 dB, hardly a null",
        help: "20 to 30 is usual",
    },
    Slip {
        name: "deep-null",
        from: "null_depth_db = 25.0 ",
        to: "null_depth_db = 60.0 ",
        line: "null_depth_db = 60.0",
        message: "`null_depth_db` is 60 dB, deeper than any",
        help: "give what was measured",
    },
    Slip {
        name: "worst-case-of-nothing",
        from: "objective = \"mean\" ",
        to: "objective = \"worst-case\" ",
        line: "objective = \"worst-case\"",
        message: "all are known exactly",
        help: "give each eavesdropper the radius_m",
    },
    Slip {
        name: "band-in-megahertz",
        from: "[radio]\nbandwidth_hz",
        to: "[emission]\nauthorised_by = \"a regulator\"\nband_hz = [2400.0, 2410.0]\nmax_power_w = 0.5\n[radio]\nbandwidth_hz",
        line: "band_hz = [2400.0",
        message: "`band_hz` is 2400 to 2410 Hz",
        help: "write [2.4e9, 2.41e9]",
    },
    Slip {
        name: "real-with-the-paper's-gain",
        from: "[radio]\nbandwidth_hz",
        to: "[emission]\nauthorised_by = \"a regulator\"\nband_hz = [2.4e9, 2.41e9]\nmax_power_w = 0.5\n[radio]\nbandwidth_hz",
        line: "reference_gain = 1.0",
        message: "`reference_gain` is 1: at 2.4 GHz",
        help: "give [radio] carrier_hz instead",
    },
];

/// Exit code, stdout and stderr.
fn check(path: &str) -> (Option<i32>, String, String) {
    let output = veilwing(&["check", path]).output().unwrap();
    let [stdout, stderr] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    (output.status.code(), stdout, stderr)
}

#[test]
fn spec_each_dangerous_slip_is_warned_of_at_its_line_with_its_value_and_a_remedy() {
    // A plan for volume knows no worst case.
    let mission = std::fs::read_to_string("config/mission.toml").unwrap();
    let mission = mission.replace("optimise = \"volume\"", "optimise = \"rate\"");
    for Slip { name, from, to, line, message, help } in SLIPS {
        assert!(mission.contains(from), "{name}: {from:?} is not in the mission");
        let text = mission.replacen(from, to, 1);
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("slip-{name}.toml"));
        std::fs::write(&path, &text).unwrap();
        let path = path.to_str().unwrap();
        let (code, stdout, stderr) = check(path);
        assert_eq!(code, Some(0), "{name}: {stderr}");
        assert!(stdout.starts_with("mission "), "{name}: a usable mission is summed up: {stdout}");
        let number = 1 + text.lines().position(|l| l.starts_with(line) || l.contains(line)).unwrap();
        assert!(stderr.starts_with(&format!("{path}:{number}:")), "{name}: not at line {number}: {stderr}");
        assert_eq!(stderr.matches(": warning: ").count(), 1, "{name}: {stderr}");
        assert!(stderr.contains(message), "{name}: {message:?} is not in {stderr}");
        let remedy = stderr.split("help: ").nth(1).unwrap();
        assert!(remedy.contains(help), "{name}: {help:?} is not in {remedy}");
    }
}

/// What cannot be meant is no warning, and its remedy names the slip.
#[test]
fn spec_dbm_for_watts_and_swapped_coordinates_are_refused_with_what_was_meant() {
    let mission = std::fs::read_to_string("config/mission.toml").unwrap();
    let slips = [
        ("dbm", "noise_power_w = 1.0e-12 ", "noise_power_w = -90.0 ", "(-90 dBm would be 1.000e-12 W)"),
        (
            "swapped",
            "enu_m = [-15.0, 0.0, 0.0]",
            "lat_deg = 14.4378\nlon_deg = 50.0755\nalt_m = 0.0",
            "latitude and longitude are swapped, here or in `origin`",
        ),
        (
            "elsewhere",
            "enu_m = [-15.0, 0.0, 0.0]",
            "lat_deg = 14.4378\nlon_deg = 80.0\nalt_m = 0.0",
            "check the signs and the order of latitude and longitude",
        ),
    ];
    for (name, from, to, said) in slips {
        assert!(mission.contains(from), "{name}");
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("slip-{name}.toml"));
        std::fs::write(&path, mission.replacen(from, to, 1)).unwrap();
        let (code, _, stderr) = check(path.to_str().unwrap());
        assert_eq!(code, Some(2), "{name}: {stderr}");
        assert!(stderr.contains(said), "{name}: {said:?} is not in {stderr}");
    }
}

#[test]
fn spec_what_is_shipped_is_warned_of_nowhere() {
    for path in ["config/mission.toml", "tests/flight/yard.toml"] {
        let (code, stdout, stderr) = check(path);
        assert_eq!((code, stderr.as_str()), (Some(0), ""), "{path}");
        assert!(stdout.starts_with("mission "), "{path}: {stdout}");
    }
    // The paper's mission has no jitter, on purpose, and nothing else that is odd.
    let (code, _, stderr) = check("config/paper.toml");
    assert_eq!((code, stderr.matches("warning: ").count()), (Some(0), 1), "{stderr}");
    assert!(stderr.contains("`std_deg` is 0"), "{stderr}");
}
