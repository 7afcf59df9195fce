//! A flight as the simulated world saw it.

use nalgebra::{Quaternion, UnitQuaternion};
use veilwing_sitl as sim;

use super::timeline::{
    AirspaceScene, EmissionScene, Event, EventKind, Heard, Listener, OriginScene, Place, PlannedSlot,
    RadioScene, SCENE_FORMAT, Sample, Scene, Severity, Source, Timeline, VehicleState,
};
use crate::config::Mission;
use crate::desk::simulation::{Excused, index};
use crate::geo::{Attitude, Pose};
use crate::planner::document::VehicleDocument;
use crate::planner::plan::VehiclePlan;
use crate::planning::maps::NoFlyArea;
use crate::role::PerVehicle;

/// The timeline of a flight that is over: what a [`sim::Recorder`] kept of `world`, and what the host knows of faults,
/// notices and processes. `judged`: the violations that count, and those that do not.
#[must_use]
pub fn timeline(
    mission: &Mission,
    world: &sim::World,
    records: &[sim::Record],
    events: Vec<Event>,
    judged: (&[sim::Violation], &[Excused]),
) -> Timeline {
    let mut timeline = Timeline {
        scene: scene(mission, world),
        samples: records.iter().map(|record| sample(record, world.config().radio.bandwidth_hz)).collect(),
        events,
        summary: None,
    };
    let event = |kind, severity, violation: &sim::Violation, text| Event {
        at_s: violation.at.as_secs_f64(),
        kind,
        vehicle: None,
        severity,
        phase: None,
        code: Some(violation.invariant().name().to_owned()),
        text,
    };
    let (violations, excused) = judged;
    timeline
        .events
        .extend(violations.iter().map(|v| event(EventKind::Violation, Severity::Error, v, v.to_string())));
    timeline.events.extend(excused.iter().map(|Excused { violation, cause }| {
        let text = format!("{violation}, for {} ms; {}", violation.lasted.as_millis(), cause.describe());
        event(EventKind::Excused, Severity::Warning, violation, text)
    }));
    timeline.events.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    timeline
}

fn scene(mission: &Mission, world: &sim::World) -> Scene {
    let config = world.config();
    let (users, truth) = (world.users_enu_m(), world.eavesdroppers_enu_m());
    Scene {
        format: SCENE_FORMAT.to_owned(),
        source: Source::Simulation,
        mission: mission.name.clone(),
        mission_digest: Some(mission.digest_hex()),
        seed: Some(config.seed),
        started_utc_us: None,
        origin: OriginScene::of(mission),
        jitter_std_deg: Some(config.jitter.std_deg),
        emission: mission.emission.as_ref().map(EmissionScene::from),
        radio: Some(RadioScene {
            bandwidth_hz: config.radio.bandwidth_hz,
            noise_power_w: config.radio.noise_power_w,
            reference_gain: config.radio.reference_gain,
        }),
        airspace: Some(AirspaceScene {
            altitude_m: config.airspace.altitude_m,
            area_enu_m: config.airspace.area_enu_m.clone(),
            no_fly: mission.airspace.no_fly.iter().map(NoFlyArea::new).collect(),
            min_separation_m: config.airspace.min_separation_m,
        }),
        users: config
            .users
            .iter()
            .zip(users)
            .map(|(user, position_enu_m)| Place { name: user.name.clone(), position_enu_m })
            .collect(),
        eavesdroppers: config.eavesdroppers.iter().zip(truth).map(|(e, truth)| listener(e, truth)).collect(),
        slots: config.slots.iter().map(slot).collect(),
    }
}

fn listener(eavesdropper: &sim::Node, truth: [f64; 3]) -> Listener {
    let (radius_m, std_m) = match eavesdropper.uncertainty {
        sim::Uncertainty::Exact => (None, None),
        sim::Uncertainty::Disc { radius_m } => (Some(radius_m), None),
        sim::Uncertainty::Gaussian { std_m } => (None, Some(std_m)),
    };
    Listener {
        name: eavesdropper.name.clone(),
        position_enu_m: eavesdropper.position_enu_m,
        radius_m,
        std_m,
        true_position_enu_m: Some(truth),
    }
}

fn slot(slot: &sim::PlannedSlot) -> PlannedSlot {
    let [i, j] = &slot.poses;
    let vehicle = |planned: &sim::PlannedPose| {
        let pose = Pose {
            position_enu_m: planned.position_enu_m.into(),
            roll_rad: planned.roll_rad,
            pitch_rad: planned.pitch_rad,
            yaw_rad: planned.yaw_rad,
        };
        VehicleDocument::from(VehiclePlan { pose, tx_power_w: planned.tx_power_w })
    };
    PlannedSlot {
        user: slot.user.clone(),
        secrecy_rate_bps: Some(slot.secrecy_rate_bps),
        vehicles: PerVehicle { i: vehicle(i), j: vehicle(j) },
    }
}

fn sample(record: &sim::Record, bandwidth_hz: f64) -> Sample {
    let snapshot = &record.snapshot;
    let vehicles = PerVehicle::from_fn(|role| Some(vehicle(&snapshot.vehicles[index(role)])));
    let heard = record.heard.as_ref().map(|heard| {
        let strongest = heard.eavesdropper_sinr.iter().copied().fold(0.0, f64::max);
        let rate = (1.0 + heard.user_sinr).log2() - (1.0 + strongest).log2();
        Heard {
            user_sinr: heard.user_sinr,
            eavesdropper_sinr: heard.eavesdropper_sinr.clone(),
            secrecy_rate_bps: bandwidth_hz * rate.max(0.0),
        }
    });
    Sample { at_s: snapshot.now_s, vehicles, heard }
}

fn vehicle(snapshot: &sim::VehicleSnapshot) -> VehicleState {
    let attitude = |[w, x, y, z]: [f64; 4]| {
        Attitude::from_rotation(UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)))
    };
    VehicleState {
        position_enu_m: snapshot.position_enu_m,
        attitude: attitude(snapshot.attitude_wxyz),
        held: Some(attitude(snapshot.nominal_attitude_wxyz)),
        mode: snapshot.mode.to_owned(),
        armed: snapshot.armed,
        landed: snapshot.landed,
        battery: Some(snapshot.battery),
        tx_power_w: snapshot.tx_power_w,
        slot: snapshot.slot.and_then(|slot| u16::try_from(slot).ok()),
    }
}
