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
        let mut ring: Vec<Json> = map.corners(area, low_m).iter().map(position).collect();
        ring.extend(ring.first().cloned());
        feature(
            json!({ "type": "Polygon", "coordinates": [ring] }),
            json!({ "kind": "area", "name": "area", "lowest_up_m": low_m, "highest_up_m": high_m }),
        );
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
