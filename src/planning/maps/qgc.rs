//! QGroundControl's plan file, for one vehicle: the area as its fence, with the no-fly areas excluded, its home as a rally point, its poses as waypoints. It
//! holds no attitudes and no powers: flown by an autopilot it would be a flight from place to place, without a word on the air.

use serde_json::{Value as Json, json};

use super::Map;
use crate::geo::{Enu, Geodetic};
use crate::role::Role;

/// MAV_CMD_NAV_WAYPOINT.
const WAYPOINT: u16 = 16;
/// MAV_FRAME_GLOBAL: altitudes above the sea.
const GLOBAL: u8 = 0;
/// QGroundControl's altitude mode for that.
const ABSOLUTE: u8 = 2;
/// MAV_AUTOPILOT_GENERIC and MAV_TYPE_OCTOROTOR: what is flown is not asked here.
const FIRMWARE: u8 = 0;
const VEHICLE: u8 = 14;

pub(super) fn text(map: &Map, role: Role) -> String {
    let home = map.homes[role].unwrap_or_else(Enu::zeros);
    let lowest_m = map.area.as_ref().map_or(0.0, |area| area.altitude_m[0]);
    let area = map.area.iter().map(|area| polygon(&map.corners(&area.corners_m, lowest_m), true));
    // The format's polygons have no heights: of an area over or under which one may fly this shows too much.
    let no_fly = map.no_fly.iter().map(|area| polygon(&map.corners(&area.corners_m, lowest_m), false));
    let fence: Vec<Json> = area.chain(no_fly).collect();
    // Above the home, at the lowest altitude of the band: rally points are relative to the home.
    let rally: Vec<Json> = map.homes[role]
        .iter()
        .map(|home| {
            let place = map.place(home);
            json!([place.lat_deg, place.lon_deg, (lowest_m - home.z).max(0.0)])
        })
        .collect();
    let items: Vec<Json> = map
        .slots
        .iter()
        .enumerate()
        .map(|(number, slot)| {
            let place = map.place(&slot.vehicles[role].pose.position_enu_m);
            waypoint(number + 1, &place, slot.length_s.unwrap_or_default())
        })
        .collect();
    let planned_home = map.place(&home);
    let plan = json!({
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": { "version": 2, "circles": [], "polygons": fence },
        "rallyPoints": { "version": 2, "points": rally },
        "mission": {
            "version": 2,
            "firmwareType": FIRMWARE,
            "vehicleType": VEHICLE,
            "globalPlanAltitudeMode": ABSOLUTE,
            "cruiseSpeed": 8.0,
            "hoverSpeed": 8.0,
            "plannedHomePosition": [planned_home.lat_deg, planned_home.lon_deg, planned_home.alt_m],
            "items": items,
        },
    });
    format!("{plan:#}\n")
}

fn polygon(corners: &[Geodetic], inclusion: bool) -> Json {
    let corners: Vec<Json> = corners.iter().map(|corner| json!([corner.lat_deg, corner.lon_deg])).collect();
    json!({ "version": 1, "inclusion": inclusion, "polygon": corners })
}

fn waypoint(number: usize, place: &Geodetic, hold_s: f64) -> Json {
    json!({
        "type": "SimpleItem",
        "doJumpId": number,
        "command": WAYPOINT,
        "frame": GLOBAL,
        "autoContinue": true,
        "AMSLAltAboveTerrain": null,
        "Altitude": place.alt_m,
        "AltitudeMode": ABSOLUTE,
        // Hold, acceptance radius, pass radius, yaw (as it is), place.
        "params": [hold_s, 0.0, 0.0, null, place.lat_deg, place.lon_deg, place.alt_m],
    })
}
