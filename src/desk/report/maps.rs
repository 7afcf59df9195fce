//! A flight as a map.

use super::timeline::{Listener, Timeline};
use crate::geo::{Enu, Geodetic};
use crate::planner::plan::VehiclePlan;
use crate::planning::maps::{Area, Map, Node, Slot};
use crate::role::{PerVehicle, Role};

/// Positions of a track nearer to each other than this, in metres, are one.
const STEP_M: f64 = 0.5;

/// The flight's map; `None` where its record does not say where on earth it was.
#[must_use]
pub fn map(timeline: &Timeline) -> Option<Map> {
    let scene = &timeline.scene;
    let origin = scene.origin?;
    Some(Map {
        name: scene.mission.clone(),
        origin: Geodetic { lat_deg: origin.lat_deg, lon_deg: origin.lon_deg, alt_m: origin.alt_amsl_m },
        area: scene
            .airspace
            .as_ref()
            .map(|air| Area { corners_m: air.area_enu_m.clone(), altitude_m: air.altitude_m }),
        no_fly: scene.airspace.iter().flat_map(|air| air.no_fly.clone()).collect(),
        users: scene
            .users
            .iter()
            .map(|user| Node {
                name: user.name.clone(),
                at: user.position_enu_m.into(),
                radius_m: None,
                std_m: None,
            })
            .collect(),
        eavesdroppers: scene.eavesdroppers.iter().map(listener).collect(),
        homes: PerVehicle::from_fn(|role| home(timeline, role)),
        slots: scene
            .slots
            .iter()
            .map(|slot| Slot {
                user: slot.user.clone(),
                length_s: None,
                vehicles: slot.vehicles.clone().map(VehiclePlan::from),
            })
            .collect(),
        tracks: PerVehicle::from_fn(|role| track(timeline, role)),
    })
}

/// Where an eavesdropper was, if a simulated world knows; else where it was thought to be.
fn listener(listener: &Listener) -> Node {
    let Listener { name, position_enu_m, radius_m, std_m, true_position_enu_m } = listener;
    match true_position_enu_m {
        Some(truth) => Node { name: name.clone(), at: (*truth).into(), radius_m: None, std_m: None },
        None => Node { name: name.clone(), at: (*position_enu_m).into(), radius_m: *radius_m, std_m: *std_m },
    }
}

fn positions(timeline: &Timeline, role: Role) -> impl Iterator<Item = (Enu, bool)> + '_ {
    let states = timeline.samples.iter().filter_map(move |sample| sample.vehicles[role].as_ref());
    states.map(|state| (Enu::from(state.position_enu_m), state.landed))
}

/// Where the vehicle first stood.
fn home(timeline: &Timeline, role: Role) -> Option<Enu> {
    positions(timeline, role).next().filter(|(_, landed)| *landed).map(|(at, _)| at)
}

fn track(timeline: &Timeline, role: Role) -> Vec<Enu> {
    let mut track: Vec<Enu> = Vec::new();
    for (at, _) in positions(timeline, role) {
        if track.last().is_none_or(|last| (at - last).norm() >= STEP_M) {
            track.push(at);
        }
    }
    track
}
