//! Vehicle files, alone and against a mission.

use super::*;
use crate::time::Utc;

#[test]
fn spec_a_tunnel_must_say_whom_it_leads_to() {
    let text = |more: &str| {
        format!(
            "vehicle.role = \"i\"\nautopilot.system_id = 1\n[pair]\nlink = \"udpout:10.0.0.1:14600\"\n{more}"
        )
    };
    let tunnel = vehicle(&text("tunnel = true\npeer_system_id = 2\n"));
    assert_eq!((tunnel.pair_peer_system, tunnel.pair_tunnel), (Some(2), true));
    for (more, line, fragment) in [
        ("tunnel = true\n", 5, "whom TUNNEL is addressed to"),
        ("tunnel = \"yes\"\n", 5, "true or false"),
        ("peer_system_id = 1\n", 5, "this vehicle's own system_id"),
        ("peer_system_id = 0\n", 5, "outside 1 to 255"),
    ] {
        let findings = Vehicle::parse("v.toml", &text(more)).unwrap_err().to_string();
        assert!(findings.contains(fragment) && findings.contains(&format!("v.toml:{line}:")), "{findings}");
    }
}

/// A vehicle file of these tables, each given once; `{what}` adds to `[what]`.
fn file(autopilot: &str, transmitter: &str, pair: &str) -> String {
    format!(
        "vehicle.role = \"i\"\n[autopilot]\n{autopilot}\n[transmitter]\n{transmitter}\n[pair]\nlink = \"udpout:10.0.0.1:14600\"\n{pair}\n"
    )
}

#[test]
fn spec_a_link_that_learns_its_peers_address_must_be_told_its_peers_system() {
    let udp = "link = \"udpin:0.0.0.0:14540\"";
    // With each: the line, what is said of it, and the remedy.
    for (text, line, says, remedy) in [
        (file(udp, "", ""), 3, "does not say which autopilot", "[autopilot] system_id"),
        (
            file("link = \"serial:/dev/ttyACM0:921600\"", "link = \"udpin:0.0.0.0:14570\"", ""),
            5,
            "no `system_id` says which radio",
            "[transmitter] system_id",
        ),
        (file(&format!("{udp}\nsystem_id = 1"), udp, ""), 6, "the autopilot's too", "leave it out"),
        (file(&format!("{udp}\nsystem_id = 1"), "key_file = \"k\"", ""), 6, "it has none", "[autopilot]"),
    ] {
        let findings = Vehicle::parse("v.toml", &text).unwrap_err();
        let [finding] = findings.list() else { panic!("{findings}") };
        assert_eq!(finding.line, line, "{findings}");
        assert!(finding.message.contains(says) && finding.help.contains(remedy), "{findings}");
    }
    // The default link learns too.
    let least = "vehicle.role = \"i\"\npair.link = \"udpout:10.0.0.1:14600\"\n";
    assert!(Vehicle::parse("v.toml", least).unwrap_err().to_string().contains("[autopilot] system_id"));
    for (autopilot, transmitter) in [
        (format!("{udp}\nsystem_id = 1"), "link = \"udpin:0.0.0.0:14570\""),
        ("link = \"tcpout:127.0.0.1:5760\"".to_owned(), "link = \"udpin:0.0.0.0:14570\"\nsystem_id = 51"),
        ("link = \"udpout:127.0.0.1:5760\"".to_owned(), ""),
    ] {
        assert!(
            Vehicle::parse("v.toml", &file(&autopilot, transmitter, "")).is_ok(),
            "{autopilot} {transmitter}"
        );
    }
}

#[test]
fn spec_nothing_real_is_radiated_over_a_link_that_anyone_may_speak_on() {
    let (udp, serial) = ("link = \"udpout:10.0.0.2:14540\"", "link = \"serial:/dev/ttyACM0:921600\"");
    let key = "key_file = \"k\"";
    let real = |more: &str| format!("simulated = false\n{more}");
    let (radio_udp, radio_serial) =
        ("link = \"udpout:10.0.0.3:14570\"", "link = \"serial:/dev/ttyUSB0:57600\"");
    let both = |a: &str, b: &str| format!("{a}\n{b}");
    let permitting = mission(&format!(
        "{DEMO}[emission]\nauthorised_by = \"me\"\nband_hz = [2.4e9, 2.41e9]\nmax_power_w = 0.5\n{VALID}"
    ));
    for (autopilot, transmitter, refused) in [
        ("system_id = 1".to_owned(), real(""), &["autopilot"][..]),
        (udp.to_owned(), real(""), &["autopilot"]),
        (udp.to_owned(), real("kind = \"parameter\"\nname = \"P\"\nunit = \"W\""), &["autopilot"]),
        (serial.to_owned(), real(radio_udp), &["transmitter"]),
        (udp.to_owned(), real(radio_udp), &["autopilot", "transmitter"]),
        (both(udp, key), real(radio_udp), &["transmitter"]),
        (udp.to_owned(), real(radio_serial), &["autopilot"]),
        (udp.to_owned(), real("kind = \"none\""), &[]),
        (udp.to_owned(), String::new(), &[]),
        (serial.to_owned(), real(""), &[]),
        (both(udp, key), real(""), &[]),
        (both(udp, key), real(&both(radio_udp, key)), &[]),
        (both(udp, key), real(radio_serial), &[]),
    ] {
        let text = file(&autopilot, &transmitter, "");
        let findings = vehicle(&text).check_against(&permitting);
        let errors = findings.list();
        assert!(errors.iter().all(|finding| finding.severity == Severity::Error), "{findings}");
        assert_eq!(errors.len(), refused.len(), "{text}{errors:?}");
        for (finding, whose) in errors.iter().zip(refused) {
            assert!(
                finding.message.contains(&format!("the {whose}'s link is neither signed")),
                "{text}{finding:?}"
            );
            assert!(finding.help.contains(&format!("[{whose}] key_file")), "{text}{finding:?}");
        }
    }
}

#[test]
fn spec_operators_are_systems() {
    let systems = |text: &str| {
        Vehicle::parse(
            "v.toml",
            &format!("{}[operators]\nsystem_ids = {text}\n", file("system_id = 1", "", "")),
        )
    };
    assert_eq!(systems("[255, 245]").unwrap().operators, [255, 245]);
    assert_eq!(systems("[]").unwrap().operators, [0_u8; 0]);
    for (text, says) in
        [("[0]", "outside 1 to 255"), ("255", "must be an array"), ("[256]", "outside 1 to 255")]
    {
        let findings = systems(text).unwrap_err().to_string();
        assert!(findings.contains(says), "{findings}");
    }
}

const VALID: &str = "valid = [2026-01-01T00:00:00Z, \"2026-12-31T23:59:59Z\"]\n";

/// A permission's time is compared with the mission's start, and with this machine's clock.
#[test]
fn spec_a_real_transmitter_is_refused_before_and_after_its_permission() {
    let real = vehicle(&VEHICLE_I.replace("simulated = true ", "simulated = false"));
    let permitted = format!(
        "{DEMO}[emission]\nauthorised_by = \"me\"\nband_hz = [2.4e9, 2.41e9]\nmax_power_w = 0.5\nlicensee = \"us\"\n{VALID}"
    );
    let starting = |at: &str| {
        mission(&permitted.replace("# start_utc = 2026-11-21T18:00:00Z", &format!("start_utc = {at}")))
    };
    let at = |year| Utc::from_civil((year, 6, 1), (0, 0, 0), 0, 0).unwrap();
    let anytime = mission(&permitted);
    let says = |mission: &Mission, year| real.check_permission_at(mission, at(year)).to_string();
    assert_eq!(says(&anytime, 2026), "");
    assert!(says(&anytime, 2025).contains("has not begun") && says(&anytime, 2027).contains("has expired"));
    assert!(says(&anytime, 2000).contains("was never set"));
    let planned = starting("2026-11-21T18:00:00Z");
    assert_eq!(
        (says(&planned, 2025), real.check_against(&planned).to_string()),
        (String::new(), String::new())
    );
    let late = real.check_against(&starting("2027-01-01T00:00:00Z"));
    assert!(
        late.has_errors() && late.to_string().contains("the mission starts at 2027-01-01T00:00:00Z"),
        "{late}"
    );
    // What is simulated needs no permission.
    assert!(vehicle(VEHICLE_I).check_permission_at(&anytime, at(2027)).list().is_empty());
    // Whole in the digest, and in what a mission says of itself.
    let emission = anytime.emission.clone().unwrap();
    assert_eq!(
        emission.valid.map(|valid| valid.map(|t| t.to_string())),
        Some(["2026-01-01T00:00:00Z", "2026-12-31T23:59:59Z"].map(str::to_owned))
    );
    for changed in ["\"us\"|\"them\"", "23:59:59Z|23:59:58Z", "licensee|licence", "licensee|site"] {
        let (from, to) = changed.split_once('|').unwrap();
        assert_ne!(mission(&permitted.replace(from, to)).digest(), anytime.digest(), "{changed}");
    }
}

#[test]
fn spec_a_real_transmitter_needs_the_mission_to_allow_it() {
    let real = vehicle(&VEHICLE_I.replace("simulated = true ", "simulated = false"));
    let findings = real.check_against(&mission(DEMO));
    assert!(findings.has_errors());
    assert!(findings.list()[0].message.contains("no [emission] table"), "{findings}");
    let undated =
        format!("{DEMO}[emission]\nauthorised_by = \"me\"\nband_hz = [2.4e9, 2.41e9]\nmax_power_w = 0.5\n");
    let findings = real.check_against(&mission(&undated));
    let [finding] = findings.list() else { panic!("{findings}") };
    assert!(
        finding.message.contains("does not say when it is valid")
            && finding.help.contains("valid = [from, until]")
    );
    let permitted = format!("{undated}{VALID}");
    assert!(real.check_against(&mission(&permitted)).is_empty());
    // The default origin is where nobody is.
    let nowhere = format!("{LEAST}{}", &permitted[DEMO.len()..]);
    let mission = mission(&nowhere);
    assert!(mission.warnings.to_string().contains("no real transmitter may radiate"));
    let findings = real.check_against(&mission);
    assert!(findings.list()[0].message.contains("the mission has no `origin`"), "{findings}");
    assert!(vehicle(VEHICLE_I).check_against(&mission).list().iter().all(|f| !f.message.contains("origin")));
}

#[test]
fn spec_a_vehicle_may_not_be_slower_than_planned() {
    let slow = VEHICLE_I
        .replace("speed_m_s = 10.0", "speed_m_s = 7.9")
        .replace("climb_m_s = 5.0", "climb_m_s = 3.9")
        .replace("tilt_rate_deg_s = 90.0", "tilt_rate_deg_s = 44.0")
        .replace("max_tilt_deg = 90.0", "max_tilt_deg = 45.0")
        .replace("max_power_w = 0.5", "max_power_w = 0.1");
    let findings = vehicle(&slow).check_against(&mission(DEMO));
    let severities: Vec<Severity> = findings.list().iter().map(|finding| finding.severity).collect();
    use Severity::{Error, Warning};
    assert_eq!(severities, [Error, Error, Error, Warning, Warning], "{findings}");
    assert!(
        findings.list()[0].message.contains("7.9 m/s")
            && findings.list()[0].help.contains("vehicles.i.speed_m_s")
    );
}

#[test]
fn spec_a_parameter_transmitter_must_say_how_it_is_silenced() {
    for (without, fragment) in
        [("off_value = 0.0\n", "silence"), ("name = \"TX_POWER\"\n", "no `name`"), ("simulated = true\n", "")]
    {
        let text = VEHICLE_J.replace(without, "");
        assert_ne!(text, VEHICLE_J);
        match Vehicle::parse("v.toml", &text) {
            Ok(_) => assert_eq!(fragment, ""),
            Err(findings) => {
                assert!(!fragment.is_empty() && findings.to_string().contains(fragment), "{findings}")
            }
        }
    }
    let Kind::Parameter(PowerParameter { unit: Unit::Levels(levels), .. }) =
        &vehicle(VEHICLE_J).transmitter.kind
    else {
        panic!("no levels")
    };
    let powers: Vec<f64> = levels.iter().map(|level| level.power_w).collect();
    assert_eq!(powers, [0.01, 0.1, 0.5]);
}

#[test]
fn spec_a_real_transmitter_of_the_first_form_needs_that_accepted() {
    let real = VEHICLE_I.replace("simulated = true", "simulated = false");
    assert!(Vehicle::parse("v.toml", &real).is_ok(), "the second form");
    let first = real.replace("form = 2", "form = 1");
    let findings = Vehicle::parse("v.toml", &first).unwrap_err();
    let [finding] = findings.list() else { panic!("{findings}") };
    assert_eq!(finding.line, line_of(&first, "form = 1"), "{findings}");
    assert!(finding.message.contains("lasts too long"), "{findings}");
    let accepted = first.replace("accept_late_commands = false", "accept_late_commands = true");
    assert_ne!(accepted, first);
    let vehicle = vehicle(&accepted);
    assert_eq!(vehicle.transmitter.kind, Kind::Leased { command: 31010 });
    // Nothing real, nothing to accept.
    assert!(Vehicle::parse("v.toml", &VEHICLE_I.replace("form = 2", "form = 1")).is_ok());
}

#[test]
fn spec_broken_vehicle_files_say_what_is_wrong() {
    // With each: what is pointed at, and at which column of its line.
    for (from, to, at, column, fragment) in [
        ("role = \"i\"", "role = \"k\"", "role", 8, "none of its values"),
        ("role = \"i\"", "", "[vehicle]", 1, "has no `role`"),
        (
            "link = \"udpout:192.168.40.2:14600\"",
            "link = \"udpout:192.168.40.2\"",
            "link = \"udpout",
            8,
            "there is no port",
        ),
        ("rate_hz = 50.0", "rate_hz = 20.0", "rate_hz", 11, "too slow"),
        ("component_id = 191", "component_id = 300", "component_id = 300", 16, "is 300, outside 1 to 255"),
        ("[limits]", "[limit]", "[limit]", 2, "unknown key `limit`"),
    ] {
        let text = VEHICLE_I.replace(from, to);
        assert_ne!(text, VEHICLE_I);
        let findings = Vehicle::parse("v.toml", &text).unwrap_err();
        let [finding] = findings.list() else { panic!("{findings}") };
        assert_eq!((finding.line, finding.column), (line_of(&text, at), column), "{findings}");
        assert!(finding.message.contains(fragment), "{findings}");
    }
}

/// The number of the first line that begins with this.
fn line_of(text: &str, start: &str) -> usize {
    1 + text.lines().position(|line| line.starts_with(start)).unwrap()
}

#[cfg(unix)]
#[test]
fn spec_a_key_file_open_to_others_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let dir = std::env::temp_dir().join(format!("veilwing-key-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    let (file, key) = (dir.join("v.toml"), dir.join("pair.key"));
    std::fs::write(&file, VEHICLE_I.replace("# key_file = \"pair", "key_file = \"pair")).unwrap();
    let missing = Vehicle::load(&file).unwrap_err().to_string();
    std::fs::write(&key, [7; 32]).unwrap();
    let mode = |mode| std::fs::set_permissions(&key, std::fs::Permissions::from_mode(mode)).unwrap();
    mode(0o640);
    let open = Vehicle::load(&file).unwrap_err().to_string();
    mode(0o600);
    let sound = Vehicle::load(&file).unwrap();
    // The others likewise, all of them told.
    std::fs::write(&file, VEHICLE_I.replace("# key_file", "key_file").replace("# link", "link")).unwrap();
    let others = Vehicle::load(&file).unwrap_err().to_string();
    std::fs::remove_dir_all(&dir).unwrap();
    assert!(
        others.contains("autopilot.key cannot be read") && others.contains("radio.key cannot be"),
        "{others}"
    );
    let at = format!(":{}:12: ", line_of(VEHICLE_I, "# key_file = \"pair"));
    assert!(missing.contains(&at) && missing.contains("cannot be read"), "{missing}");
    assert!(open.contains("its mode is 640") && open.contains("chmod 600"), "{open}");
    assert_eq!(sound.key_file, Some(key));
}

#[test]
fn spec_an_area_of_more_corners_than_an_autopilot_keeps_is_refused_unless_no_fence_is_asked_for() {
    let round = |corners: u32| {
        let corner = |k: u32| {
            let angle = f64::from(k) * std::f64::consts::TAU / f64::from(corners);
            nalgebra::Vector2::new(angle.cos(), angle.sin()) * 400.0
        };
        let area = (0..corners).map(corner).collect();
        mission(DEMO).changed(|draft| draft.airspace.area_enu_m = area).unwrap()
    };
    assert!(vehicle(VEHICLE_I).check_against(&round(255)).is_empty());
    let findings = vehicle(VEHICLE_I).check_against(&round(256));
    let [finding] = findings.list() else { panic!("{findings}") };
    assert_eq!(finding.severity, Severity::Error);
    assert!(
        finding.message.contains("a fence of 256 corners") && finding.help.contains("fence = \"none\""),
        "{findings}"
    );
    let none = VEHICLE_I.replace("fence = \"upload\"", "fence = \"none\"  ");
    assert!(vehicle(&none).check_against(&round(256)).is_empty());
    let wrong = VEHICLE_I.replace("fence = \"upload\"", "fence = \"yes\"   ");
    let findings = Vehicle::parse("v.toml", &wrong).unwrap_err().to_string();
    assert!(findings.contains("fence") && findings.contains("\"check\""), "{findings}");
}
