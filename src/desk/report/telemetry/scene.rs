//! What does not change, as far as the logs' surroundings know it.

use std::path::Path;

use serde::Deserialize;

use super::TelemetryError;
use crate::config::Mission;
use crate::desk::report::directory::{json, read};
use crate::desk::report::timeline::{
    AirspaceScene, EmissionScene, Listener, OriginScene, Place, PlannedSlot, RadioScene, SCENE_FORMAT, Scene,
    Source,
};
use crate::link::{Envelope, RawFrame};
use crate::pair::wire::{self, VEILWING_PROPOSE_DATA};
use crate::planner::document::VehicleDocument;
use crate::planner::problem::Uncertainty;
use crate::planning::maps::NoFlyArea;
use crate::role::PerVehicle;
use crate::schedule::order::Order;

/// The plan document beside the logs.
const PLAN: &str = "plan.json";
/// Poses travel in single precision.
const SAME_POSE: f64 = 1e-3;

/// The plan document as far as the report needs it.
#[derive(Debug, Deserialize)]
struct Plan {
    slots: Vec<PlanSlot>,
}

#[derive(Debug, Clone, Deserialize)]
struct PlanSlot {
    user: String,
    secrecy_rate_bps: Option<f64>,
    vehicles: PerVehicle<VehicleDocument>,
}

/// From the mission, if there is one.
pub(super) fn scene(directory: &Path, mission: Option<&Mission>) -> Result<Scene, TelemetryError> {
    let name = directory.file_name().map(|name| name.to_string_lossy().into_owned());
    Ok(Scene {
        format: SCENE_FORMAT.to_owned(),
        source: Source::Telemetry,
        mission: mission.map(|mission| mission.name.clone()).or(name).unwrap_or_default(),
        mission_digest: mission.map(Mission::digest_hex),
        seed: None,
        started_utc_us: None,
        origin: mission.and_then(OriginScene::of),
        jitter_std_deg: mission.map(|mission| mission.jitter.std_rad.to_degrees()),
        emission: mission.and_then(|mission| mission.emission.as_ref()).map(EmissionScene::from),
        radio: mission.map(|mission| RadioScene {
            bandwidth_hz: mission.radio.bandwidth_hz,
            noise_power_w: mission.radio.noise_power_w,
            reference_gain: mission.radio.reference_gain,
        }),
        airspace: mission.map(|mission| AirspaceScene {
            altitude_m: mission.airspace.altitude_m,
            area_enu_m: mission.airspace.area_enu_m.iter().map(|v| [v.x, v.y]).collect(),
            no_fly: mission.airspace.no_fly.iter().map(NoFlyArea::new).collect(),
            min_separation_m: mission.airspace.min_separation_m,
        }),
        users: mission.iter().flat_map(|mission| &mission.users).map(place).collect(),
        eavesdroppers: mission.iter().flat_map(|mission| &mission.eavesdroppers).map(listener).collect(),
        slots: Vec::new(),
    })
}

fn place(user: &crate::config::User) -> Place {
    Place { name: user.name.clone(), position_enu_m: user.position_enu_m.into() }
}

fn listener(eavesdropper: &crate::config::NamedEavesdropper) -> Listener {
    let (radius_m, std_m) = match eavesdropper.node.uncertainty {
        Uncertainty::None => (None, None),
        Uncertainty::Disc { radius_m } => (Some(radius_m), None),
        Uncertainty::Gaussian { std_m } => (None, Some(std_m)),
    };
    Listener {
        name: eavesdropper.name.clone(),
        position_enu_m: eavesdropper.node.position_enu_m.into(),
        radius_m,
        std_m,
        true_position_enu_m: None,
    }
}

/// The slots as I proposed them; users and rates from the plan document, if it is there.
pub(super) fn take_proposals<'a>(
    scene: &mut Scene,
    pair: impl Iterator<Item = &'a (u64, RawFrame)>,
    directory: &Path,
    mission: Option<&Mission>,
) -> Result<(), TelemetryError> {
    let path = directory.join(PLAN);
    let plan: Option<Plan> = if path.exists() { Some(json(&path, &read(&path)?, 1)?) } else { None };
    let planned = plan.map(|plan| plan.slots).unwrap_or_default();
    let mut slots: Vec<Option<PlannedSlot>> = Vec::new();
    // Slots that were never proposed are known only where the plan's order is the order of flight.
    if let Some(mission) = mission.filter(|mission| mission.tdma.order == Order::Listed) {
        let superframes = usize::from(mission.tdma.superframes);
        slots = std::iter::repeat_n(&planned, superframes)
            .flatten()
            .cloned()
            .map(|s| Some(from_plan(s)))
            .collect();
    }
    for (_, frame) in pair {
        let Ok(envelope) = frame.parse::<Envelope>() else { continue };
        let wire::MavMessage::VEILWING_PROPOSE(proposal) = envelope.message.message() else { continue };
        let number = usize::from(proposal.slot);
        // A number from a damaged log must not take all memory.
        if number < 10_000 {
            slots.resize(slots.len().max(number + 1), None);
            slots[number] = Some(proposed(proposal, &planned));
        }
    }
    // A slot that nobody knows of ends what can be numbered.
    scene.slots = slots.into_iter().map_while(|slot| slot).collect();
    Ok(())
}

fn from_plan(slot: PlanSlot) -> PlannedSlot {
    PlannedSlot { user: slot.user, secrecy_rate_bps: slot.secrecy_rate_bps, vehicles: slot.vehicles }
}

fn proposed(m: &VEILWING_PROPOSE_DATA, planned: &[PlanSlot]) -> PlannedSlot {
    let vehicle = |position: [f32; 3], euler: [f32; 3], power_w: f32| {
        let [roll_rad, pitch_rad, yaw_rad] = euler.map(f64::from);
        VehicleDocument {
            position_enu_m: position.map(f64::from),
            roll_rad,
            pitch_rad,
            yaw_rad,
            tx_power_w: f64::from(power_w),
            antenna_axis_enu: crate::radio::pattern::antenna_axis(roll_rad, pitch_rad, yaw_rad).into(),
        }
    };
    let vehicles = PerVehicle {
        i: vehicle(m.i_position_enu_m, m.i_euler_rad, m.i_power_w),
        j: vehicle(m.j_position_enu_m, m.j_euler_rad, m.j_power_w),
    };
    let same = |a: &VehicleDocument, b: &VehicleDocument| {
        let positions = a.position_enu_m.iter().zip(&b.position_enu_m);
        let angles = [(a.roll_rad, b.roll_rad), (a.pitch_rad, b.pitch_rad), (a.yaw_rad, b.yaw_rad)];
        positions.map(|(a, b)| (*a, *b)).chain(angles).all(|(a, b)| (a - b).abs() < SAME_POSE)
    };
    let known = planned
        .iter()
        .find(|slot| same(&slot.vehicles.i, &vehicles.i) && same(&slot.vehicles.j, &vehicles.j));
    match known {
        Some(slot) => from_plan(slot.clone()),
        None => PlannedSlot { user: String::new(), secrecy_rate_bps: None, vehicles },
    }
}
