//! A flight made by hand, with a fault.

use veilwing::desk::report::timeline::{
    AirspaceScene, EmissionScene, Heard, Listener, Place, PlannedSlot, RadioScene, SCENE_FORMAT, SlotSummary,
    Summary, VehicleState,
};
use veilwing::desk::report::{Event, EventKind, Sample, Scene, Severity, Source, Timeline};
use veilwing::geo::Attitude;
use veilwing::planner::document::VehicleDocument;
use veilwing::role::{PerVehicle, Role};

pub fn pose(east_m: f64) -> VehicleDocument {
    VehicleDocument {
        position_enu_m: [east_m, 5.0, 20.0],
        roll_rad: 0.3,
        pitch_rad: -0.2,
        yaw_rad: 0.0,
        tx_power_w: 0.5,
        antenna_axis_enu: [0.0; 3],
    }
}

pub fn state(east_m: f64, on: bool, landed: bool, mode: &str) -> VehicleState {
    let up_m = if landed { 0.0 } else { 20.0 };
    VehicleState {
        position_enu_m: [east_m, 5.0, up_m],
        attitude: Attitude::from_euler(0.31, -0.2, 0.0),
        held: Some(Attitude::from_euler(0.3, -0.2, 0.0)),
        mode: mode.into(),
        armed: !landed,
        landed,
        battery: Some(0.9),
        tx_power_w: on.then_some(0.5),
        slot: on.then_some(0),
    }
}

pub fn event(at_s: f64, kind: EventKind, vehicle: Role, severity: Severity, text: &str) -> Event {
    Event { at_s, kind, vehicle: Some(vehicle), severity, phase: None, code: None, text: text.into() }
}

/// Half a minute: take-off at 2 s, J on at 10 s, I from 10.5 s; J's companion is killed at 14 s; I is off at 14.25 s,
/// J at 14.5 s; I lands at 25 s, J hovers on.
pub fn flight() -> Timeline {
    let at = |k: u32| f64::from(k) * 0.05;
    let samples = (0..=600).map(at).map(|at_s| {
        let on_i = (10.5..14.25).contains(&at_s);
        let on_j = (10.0..14.5).contains(&at_s);
        let i = state(0.0, on_i, !(2.0..25.0).contains(&at_s), "OFFBOARD");
        let j = state(30.0, on_j, at_s < 2.0, if at_s < 15.0 { "OFFBOARD" } else { "HOLD" });
        let heard = Heard { user_sinr: 1e6, eavesdropper_sinr: vec![50.0], secrecy_rate_bps: 1.425e7 };
        Sample { at_s, vehicles: PerVehicle { i: Some(i), j: Some(j) }, heard: on_i.then_some(heard) }
    });
    let mut kill = event(14.0, EventKind::Fault, Role::J, Severity::Warning, "companion killed (SIGKILL)");
    kill.code = Some("companion-kill".into());
    let slot = |user: &str, achieved| SlotSummary {
        user: user.into(),
        planned_secrecy_rate_bps: Some(1.4e7),
        achieved_secrecy_rate_bps: Some(achieved),
        standard_error_bps: Some(1e4),
        radiated_s: if achieved > 0.0 { PerVehicle { i: 3.75, j: 4.5 } } else { PerVehicle::default() },
        unprotected_s: 0.0,
        position_rms_m: PerVehicle::default(),
        attitude_rms_deg: PerVehicle::default(),
    };
    let planned = |user: &str| PlannedSlot {
        user: user.into(),
        secrecy_rate_bps: Some(1.4e7),
        vehicles: PerVehicle { i: pose(0.0), j: pose(30.0) },
    };
    Timeline {
        scene: Scene {
            format: SCENE_FORMAT.into(),
            source: Source::Simulation,
            mission: "yard".into(),
            mission_digest: Some("ab".repeat(32)),
            seed: Some(7),
            started_utc_us: None,
            origin: None,
            jitter_std_deg: Some(2.0),
            emission: Some(EmissionScene {
                authorised_by: "a regulator".into(),
                band_hz: [2.4e9, 2.41e9],
                max_power_w: 0.5,
                licensee: Some("the <testers>".into()),
                licence: None,
                valid: Some(["2026-01-01T00:00:00Z".into(), "2026-12-31T23:59:59Z".into()]),
                site: Some("a yard".into()),
            }),
            radio: Some(RadioScene { bandwidth_hz: 1e6, noise_power_w: 1e-12, reference_gain: 1.0 }),
            airspace: Some(AirspaceScene {
                altitude_m: [20.0, 80.0],
                area_enu_m: vec![[-90.0, -90.0], [90.0, -90.0], [90.0, 90.0]],
                no_fly: Vec::new(),
                min_separation_m: 5.0,
            }),
            users: ["alpha", "bravo"]
                .map(|name| Place { name: name.into(), position_enu_m: [0.0; 3] })
                .into(),
            eavesdroppers: vec![Listener {
                name: "hill".into(),
                position_enu_m: [60.0, -20.0, 0.0],
                radius_m: Some(15.0),
                std_m: None,
                true_position_enu_m: Some([66.0, -14.0, 0.0]),
            }],
            slots: vec![planned("alpha"), planned("bravo")],
        },
        samples: samples.collect(),
        events: vec![
            event(1.0, EventKind::Notice, Role::I, Severity::Info, "waiting: home: not received"),
            event(1.5, EventKind::Notice, Role::I, Severity::Info, "preflight passed, taking off"),
            kill,
            event(14.25, EventKind::Notice, Role::I, Severity::Warning, "silent: no jam lease in force"),
            event(
                17.0,
                EventKind::Notice,
                Role::I,
                Severity::Error,
                "mission aborted: nothing heard from vehicle J",
            ),
        ],
        summary: Some(Summary {
            result: "aborted".into(),
            plan_digest: None,
            flight_s: 30.0,
            slots: vec![slot("alpha", 1.42e7), slot("bravo", 0.0)],
            violations: Vec::new(),
            min_separation_m: Some(30.0),
        }),
    }
}
