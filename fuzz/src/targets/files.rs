//! Files that people write: whatever is wrong with one is said with its place.

use std::fmt::Debug;

use veilwing::config::{Diagnostics, Mission, Vehicle, plan_of_text};
use veilwing::desk::simulation::{Faults, Lengths, draw};
use veilwing_sitl::{AirframeError, AirframeModel};

use crate::reached::{Reached, unquoted};
use crate::target::Target;

const FILE: &str = "f.toml";
/// What TOML and JSON are made of.
const MARKS: &[&str] = &[
    "[",
    "]",
    "[[",
    "]]",
    "{",
    "}",
    "=",
    "\n",
    ",",
    "\"",
    "'''",
    "#",
    "_",
    "true",
    "false",
    "null",
    "\\u0000",
    "2026-11-21T18:00:00Z",
    "[mission]",
    "[[user]]",
    "[[eavesdropper]]",
    "[tdma]",
    "[planner]",
    "[pair]",
    "[transmitter]",
    "[[fault]]",
    "name",
    "enu_m",
    "kind",
    "probability",
    "duration_s",
    "\"slots\"",
    "\"vehicles\"",
    "\"format\"",
];

/// Mission files.
pub const MISSION: Target = Target {
    name: "mission-file",
    what: "the text of a mission file",
    words: MARKS,
    seeds: missions,
    run: mission,
    generated: 3000,
};
/// Vehicle files.
pub const VEHICLE: Target = Target {
    name: "vehicle-file",
    what: "the text of a vehicle file",
    words: MARKS,
    seeds: vehicles,
    run: vehicle,
    generated: 3000,
};
/// Fault files.
pub const FAULTS: Target = Target {
    name: "fault-file",
    what: "the text of a fault file",
    words: MARKS,
    seeds: fault_files,
    run: faults,
    generated: 3000,
};
/// Airframes of the simulated world.
pub const AIRFRAME: Target = Target {
    name: "airframe-file",
    what: "the text of an airframe",
    words: MARKS,
    seeds: airframes,
    run: airframe,
    generated: 3000,
};
/// Plan documents.
pub const PLAN: Target = Target {
    name: "plan-document",
    what: "the text of a plan document, as `evaluate` reads it",
    words: MARKS,
    seeds: plans,
    run: plan,
    generated: 3000,
};

fn missions() -> Vec<Vec<u8>> {
    [include_str!("../../../config/mission.toml"), include_str!("../../../tests/flight/yard.toml")]
        .map(Into::into)
        .into()
}

fn vehicles() -> Vec<Vec<u8>> {
    [include_str!("../../../config/vehicle-i.toml"), include_str!("../../../config/vehicle-j.toml")]
        .map(Into::into)
        .into()
}

fn fault_files() -> Vec<Vec<u8>> {
    vec![include_str!("../../../config/faults.toml").into()]
}

fn airframes() -> Vec<Vec<u8>> {
    [
        include_str!("../../../sitl/airframes/tilted-eight.toml"),
        include_str!("../../../sitl/airframes/level-four.toml"),
    ]
    .map(Into::into)
    .into()
}

fn plans() -> Vec<Vec<u8>> {
    let vehicle = r#"{"position_enu_m":[0,0,30],"roll_rad":0,"pitch_rad":0.1,"tx_power_w":0.5}"#;
    let slot = format!(r#"{{"user":"alpha","vehicles":{{"i":{vehicle},"j":{vehicle}}}}}"#);
    vec![format!("{{\"format\":\"veilwing-plan/1\",\n\"slots\":[{slot}]}}\n").into_bytes()]
}

/// What a file's reader is given for an input.
fn text(input: &[u8]) -> String {
    String::from_utf8_lossy(&unquoted(input)).into_owned()
}

/// Looks at what was found wrong, or not.
fn judge<T: Debug>(text: &str, read: Result<T, Diagnostics>, reached: &mut Reached) -> Option<T> {
    let findings = match read {
        Ok(value) => return Some(value),
        Err(findings) => findings,
    };
    assert!(findings.has_errors(), "refused without an error");
    let lines = text.split('\n').count();
    let told = findings.to_string();
    assert!(told.starts_with(FILE), "{told}");
    for finding in findings.list() {
        assert!((1..=lines).contains(&finding.line) && finding.column >= 1, "{finding:?} of {lines} lines");
        assert!(!finding.message.is_empty() && !finding.help.is_empty(), "{finding:?}");
        assert!(told.contains(&format!("{FILE}:{}:{}", finding.line, finding.column)), "{told}");
        reached.sentence("refused", &finding.message);
    }
    None
}

fn warned(findings: &Diagnostics, reached: &mut Reached) {
    assert!(!findings.has_errors(), "accepted with an error: {findings}");
    findings.list().iter().for_each(|finding| reached.sentence("warned", &finding.message));
}

fn mission(input: &[u8], reached: &mut Reached) {
    let text = text(input);
    let Some(mission) = judge(&text, Mission::parse(FILE, &text), reached) else { return };
    warned(&mission.warnings, reached);
    // The same text means the same, and what it means can be asked for.
    let again = Mission::parse(FILE, &text).map(|mission| mission.digest());
    assert_eq!(again.ok(), Some(mission.digest()));
    let problems = (0..mission.users.len()).filter(|user| mission.problem(*user).is_some()).count();
    assert!(mission.problem(mission.users.len()).is_none());
    reached.count("users", problems as u64);
    reached.count("eavesdroppers", mission.eavesdroppers.len() as u64);
    reached.note(format_args!(
        "{:?} {:?} {:?}",
        mission.tdma.order,
        mission.planner.method,
        mission.has_origin()
    ));
    let kept = mission.changed(|_| {}).map(|same| same.digest());
    assert_eq!(kept.ok(), Some(mission.digest()), "by value it is the same mission");
}

fn vehicle(input: &[u8], reached: &mut Reached) {
    let text = text(input);
    let Some(vehicle) = judge(&text, Vehicle::parse(FILE, &text), reached) else { return };
    warned(&vehicle.warnings, reached);
    let written = vehicle.to_toml();
    let again = Vehicle::parse(FILE, &written);
    assert!(again.is_ok(), "{written}\n{again:?}");
    assert_eq!(again.map(|vehicle| vehicle.to_toml()).ok().as_deref(), Some(written.as_str()));
    let form = (vehicle.role, vehicle.pair_tunnel, vehicle.autopilot.firmware, vehicle.autopilot.actuation);
    reached.note(format_args!("{form:?}"));
}

fn faults(input: &[u8], reached: &mut Reached) {
    let text = text(input);
    let Some(faults) = judge(&text, Faults::parse(FILE, &text), reached) else { return };
    let lengths = Lengths { flight_s: 80.0, slot_s: 5.0 };
    for fault in draw(&faults, 1, lengths) {
        reached.note(format_args!("{:?} {} {:?}", fault.kind, fault.duration.is_some(), fault.vehicle()));
        assert!(!fault.describe().is_empty());
    }
}

fn airframe(input: &[u8], reached: &mut Reached) {
    let text = text(input);
    match AirframeModel::parse(FILE, &text) {
        Ok(model) => reached.note(format_args!("{:?} {}", model.airframe, model.geometry.rotors.len())),
        Err(error) => {
            let told = error.to_string();
            assert!(told.starts_with(FILE) && !told.ends_with('\n'), "{told}");
            let AirframeError::Syntax { reason, .. } = &error else {
                return reached.sentence("value", &told);
            };
            // Its first line has the place, what stands under the caret is the reason.
            assert!(reason.contains("line"), "{told}");
            reached.sentence("syntax", reason.rsplit_once("^\n").map_or("", |(_, why)| why));
        }
    }
}

fn plan(input: &[u8], reached: &mut Reached) {
    let text = text(input);
    if let Some(plan) = judge(&text, plan_of_text(FILE, &text), reached) {
        reached.count("slots", plan.slots.len() as u64);
        reached.note(format_args!("{}", plan.mission_digest.is_some()));
    }
}
