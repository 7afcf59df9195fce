//! GeoJSON (RFC 7946). Positions are longitude and latitude alone: the format's heights are above the ellipsoid, ours above the
//! sea, so that heights are properties with their frame in the name.

use serde_json::{Value as Json, json};

use super::{Map, Node};
use crate::geo::{Enu, Geodetic};
use crate::role::Role;

pub(super) fn text(map: &Map) -> String {
    let mut features = Vec::new();
    let mut feature = |geometry: Json, properties: Json| {
        features.push(json!({ "type": "Feature", "geometry": geometry, "properties": properties }));
    };
    if let Some(area) = &map.area {
        let [low_m, high_m] = area.altitude_m;
        feature(
            polygon(&map.corners(&area.corners_m, low_m)),
            json!({ "kind": "area", "name": "area", "lowest_up_m": low_m, "highest_up_m": high_m }),
        );
    }
    for area in &map.no_fly {
        let corners = map.corners(&area.corners_m, area.floor_m.unwrap_or_default());
        let mut properties = json!({ "kind": "no-fly", "name": area.name });
        for (key, value) in [("floor_up_m", area.floor_m), ("ceiling_up_m", area.ceiling_m)] {
            if let Some(value) = value {
                properties[key] = json!(value);
            }
        }
        feature(polygon(&corners), properties);
    }
    for (kind, nodes) in [("user", &map.users), ("eavesdropper", &map.eavesdroppers)] {
        for Node { name, at, radius_m, std_m } in nodes {
            let mut properties = at_height(map, at, kind, name);
            for (key, value) in [("radius_m", radius_m), ("std_m", std_m)] {
                if let Some(value) = value {
                    properties[key] = json!(value);
                }
            }
            feature(point(map, at), properties);
        }
    }
    for role in Role::BOTH {
        if let Some(home) = &map.homes[role] {
            let mut properties = at_height(map, home, "home", &format!("home of {role}"));
            properties["vehicle"] = json!(role.key());
            feature(point(map, home), properties);
        }
    }
    for (number, slot) in map.slots.iter().enumerate() {
        for role in Role::BOTH {
            let vehicle = &slot.vehicles[role];
            let at = &vehicle.pose.position_enu_m;
            let mut properties = at_height(map, at, "pose", &format!("{role} for {}", slot.user));
            properties["vehicle"] = json!(role.key());
            properties["slot"] = json!(number);
            properties["user"] = json!(slot.user);
            properties["roll_deg"] = json!(vehicle.pose.roll_rad.to_degrees());
            properties["pitch_deg"] = json!(vehicle.pose.pitch_rad.to_degrees());
            properties["yaw_deg"] = json!(vehicle.pose.yaw_rad.to_degrees());
            properties["tx_power_w"] = json!(vehicle.tx_power_w);
            feature(point(map, at), properties);
        }
    }
    for role in Role::BOTH {
        // One position makes no line.
        if map.tracks[role].len() > 1 {
            let line: Vec<Json> = map.tracks[role].iter().map(|at| position(&map.place(at))).collect();
            feature(
                json!({ "type": "LineString", "coordinates": line }),
                json!({ "kind": "track", "name": format!("flight of {role}"), "vehicle": role.key() }),
            );
        }
    }
    let collection = json!({ "type": "FeatureCollection", "name": map.name, "features": features });
    format!("{collection:#}\n")
}

fn polygon(corners: &[Geodetic]) -> Json {
    let mut ring: Vec<Json> = corners.iter().map(position).collect();
    ring.extend(ring.first().cloned());
    json!({ "type": "Polygon", "coordinates": [ring] })
}

fn position(place: &Geodetic) -> Json {
    json!([place.lon_deg, place.lat_deg])
}

fn point(map: &Map, at: &Enu) -> Json {
    json!({ "type": "Point", "coordinates": position(&map.place(at)) })
}

/// What every point says of itself.
fn at_height(map: &Map, at: &Enu, kind: &str, name: &str) -> Json {
    json!({ "kind": kind, "name": name, "up_m": at.z, "alt_amsl_m": map.place(at).alt_m })
}
