//! What speaks for or against a flight: named checks, each with the offending value and what it should be.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavType;

use super::boot_clock::Tracking;
use super::firmware::Firmware;
use super::settings::Settings;
use super::state::{Landed, VehicleState};
use super::streams::Streams;
use crate::preflight::{Check, Verdict, check};

/// Position and attitude at this part of the rate asked for still fly: an autopilot on a loaded machine is slow evenly.
const FLYABLE: f64 = 0.4;
/// Local and global position may disagree by this much, in metres.
const ORIGIN_TOLERANCE_M: f64 = 5.0;

/// What the checks look at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evidence<'a> {
    pub(super) firmware: Firmware,
    pub(super) system: u8,
    pub(super) settings: &'a Settings,
    pub(super) state: &'a VehicleState,
    pub(super) streams: &'a Streams,
    /// Whether position and attitude are fresh.
    pub(super) fresh: bool,
    /// Their age at the most, if they come and it is known.
    pub(super) age: Option<Duration>,
    /// How well the autopilot's clock is known.
    pub(super) tracking: Tracking,
    pub(super) utc_uncertainty: Option<Duration>,
}

/// The check that fails where no autopilot was found, of which `candidates` compete.
pub(super) fn none_found(candidates: usize) -> Check {
    let detail = match candidates {
        0 => "no heartbeat of a PX4 or ArduCopter autopilot on the link: check the link's address".to_owned(),
        n => format!("{n} autopilots on the link: name one with autopilot.system_id"),
    };
    check("autopilot", Verdict::Fail, detail)
}

/// The checks that every autopilot has to pass.
pub(super) fn checks(evidence: &Evidence) -> Vec<Check> {
    let (firmware, system) = (evidence.firmware, evidence.system);
    let version = evidence.state.version.map_or(String::new(), |(a, b, c)| format!(" {a}.{b}.{c}"));
    let mut all = vec![
        check("autopilot", Verdict::Pass, format!("{firmware}{version}, system {system}")),
        vehicle_type(evidence.state.vehicle_type),
    ];
    all.extend(telemetry(evidence));
    all.extend(readiness(evidence.state, evidence.settings));
    all
}

fn vehicle_type(vehicle_type: Option<MavType>) -> Check {
    let multirotor = matches!(
        vehicle_type,
        Some(
            MavType::MAV_TYPE_QUADROTOR
                | MavType::MAV_TYPE_COAXIAL
                | MavType::MAV_TYPE_HEXAROTOR
                | MavType::MAV_TYPE_OCTOROTOR
                | MavType::MAV_TYPE_TRICOPTER
                | MavType::MAV_TYPE_DODECAROTOR
                | MavType::MAV_TYPE_DECAROTOR
                | MavType::MAV_TYPE_GENERIC_MULTIROTOR
        )
    );
    let kind = vehicle_type.map_or("unknown".to_owned(), |kind| format!("{kind:?}"));
    if multirotor {
        check("vehicle type", Verdict::Pass, kind)
    } else {
        check("vehicle type", Verdict::Fail, format!("{kind}, should be a multirotor: set MAV_TYPE"))
    }
}

/// Whether the firmware can do what the vehicle file asks of it.
pub(super) fn actuation(firmware: Firmware, settings: &Settings) -> Check {
    match firmware.cannot(settings) {
        Some(why) => check("actuation", Verdict::Fail, why),
        None => check("actuation", Verdict::Pass, format!("{} on {firmware}", settings.actuation)),
    }
}

fn telemetry(evidence: &Evidence) -> Vec<Check> {
    let mut all = vec![age(evidence), boot_clock(evidence.tracking)];
    let slow = evidence.streams.report().filter(|stream| !stream.good).collect::<Vec<_>>();
    if slow.is_empty() {
        all.push(check("telemetry", Verdict::Pass, "every stream comes at its rate"));
    }
    for stream in slow {
        let rate = stream.measured_hz.map_or("not yet measured".to_owned(), |hz| format!("{hz:.1} Hz"));
        let flyable = stream.measured_hz.is_some_and(|hz| hz >= FLYABLE * stream.wanted_hz);
        let result = if stream.essential && !flyable { Verdict::Fail } else { Verdict::Warn };
        all.push(check(
            "telemetry",
            result,
            format!("{}: {rate}, should be {:.0} Hz", stream.name, stream.wanted_hz),
        ));
    }
    all.push(match evidence.utc_uncertainty {
        Some(within) => {
            check("clock", Verdict::Pass, format!("UTC from SYSTEM_TIME within {} ms", within.as_millis()))
        }
        None => check("clock", Verdict::Fail, "no UTC in SYSTEM_TIME: wait for GPS"),
    });
    all
}

fn age(evidence: &Evidence) -> Check {
    let limit_ms = evidence.settings.freshness.as_millis();
    match evidence.age {
        _ if evidence.fresh => check("position and attitude", Verdict::Pass, "fresh"),
        Some(age) => {
            let detail = format!(
                "up to {} ms old when they are used, should be at most {limit_ms} ms: the autopilot's link delays them",
                age.as_millis()
            );
            check("position and attitude", Verdict::Fail, detail)
        }
        None => check("position and attitude", Verdict::Fail, "not received within the freshness limit"),
    }
}

fn boot_clock(tracking: Tracking) -> Check {
    let name = "age of telemetry";
    match tracking {
        Tracking::RoundTrip(shortest) => {
            check(name, Verdict::Pass, format!("known within {} ms, by TIMESYNC", shortest.as_millis()))
        }
        Tracking::Asking => check(name, Verdict::Fail, "TIMESYNC is not answered yet"),
        Tracking::Lost => {
            check(name, Verdict::Fail, "TIMESYNC is answered no more: check the autopilot's link")
        }
        Tracking::OneWay => check(
            name,
            Verdict::Warn,
            "the autopilot does not answer TIMESYNC: telemetry that is late from the start, or stays so for a minute, \
             counts as fresh",
        ),
    }
}

fn readiness(state: &VehicleState, settings: &Settings) -> Vec<Check> {
    let flag = |name, value: Option<bool>, worst: Verdict, bad: &str| match value {
        Some(true) => check(name, Verdict::Pass, "good"),
        Some(false) => check(name, worst, bad),
        None => check(name, Verdict::Warn, "the autopilot does not say"),
    };
    let local = state.position_enu_m.map(|position| position.value);
    let global = state.global_position_enu_m.map(|position| position.value);
    let origin = match (state.local_origin, local, global) {
        (None, ..) => check("local origin", Verdict::Fail, "GPS_GLOBAL_ORIGIN not received: wait for GPS"),
        (Some(_), Some(local), Some(global)) if (local - global).norm() > ORIGIN_TOLERANCE_M => {
            let apart_m = (local - global).norm();
            let detail = format!("local and global position are {apart_m:.1} m apart, should be below 5 m");
            check("local origin", Verdict::Fail, detail)
        }
        _ => check("local origin", Verdict::Pass, "known"),
    };
    let min_percent = settings.min_battery * 100.0;
    let battery = match state.battery.and_then(|battery| battery.value.remaining) {
        None => check("battery", Verdict::Warn, "the autopilot does not say"),
        Some(left) if left * 100.0 < min_percent => check(
            "battery",
            Verdict::Fail,
            format!("{:.0}%, should be at least {min_percent:.0}%", left * 100.0),
        ),
        Some(left) => check("battery", Verdict::Pass, format!("{:.0}%", left * 100.0)),
    };
    let home = match state.home_enu_m {
        Some(_) => check("home", Verdict::Pass, "known"),
        None => check("home", Verdict::Fail, "HOME_POSITION not received: return to launch has no goal"),
    };
    let ground = match (state.is_armed(), state.landed.map(|landed| landed.value)) {
        (false, _) | (true, Some(Landed::OnGround)) => check("armed", Verdict::Pass, "on the ground"),
        (true, _) => check("armed", Verdict::Warn, "already flying"),
    };
    vec![
        origin,
        home,
        match state.estimator.map(|estimator| estimator.value) {
            Some(Err(fault)) => check("estimator", Verdict::Fail, fault.to_string()),
            healthy => flag("estimator", healthy.map(|_| true), Verdict::Fail, ""),
        },
        flag("gps", state.gps_ok.map(|ok| ok.value), Verdict::Fail, "unhealthy: wait for a fix"),
        // Judged for the present mode, which is not yet ours: arming itself has the last word, with its reason.
        flag(
            "pre-arm",
            state.prearm_ok.map(|ok| ok.value),
            Verdict::Warn,
            "the autopilot's own checks do not pass",
        ),
        battery,
        ground,
    ]
}
