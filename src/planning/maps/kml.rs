//! KML 2.2 (OGC 07-147r2), with altitudes above the sea ("absolute").

use std::fmt::Write as _;

use super::{Map, Node};
use crate::geo::{Enu, Geodetic};
use crate::role::Role;
use crate::units::Watts;

/// Styles by id: icon's or line's colour as aabbggrr.
const STYLES: [(&str, &str); 6] = [
    ("area", "ff808080"),
    ("no-fly", "ff0000ff"),
    ("user", "ff3c9f00"),
    ("eavesdropper", "ff2020d0"),
    ("i", "ffb06000"),
    ("j", "ff0080f0"),
];

pub(super) fn text(map: &Map) -> String {
    let mut out = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    out.push_str("<kml xmlns=\"http://www.opengis.net/kml/2.2\">\n<Document>\n");
    // Writing to a String cannot fail.
    let _ = writeln!(out, "<name>{}</name>", escaped(&map.name));
    out.push_str("<description>To look at. Companions fly by the mission file alone.</description>\n");
    for (id, colour) in STYLES {
        let _ = writeln!(
            out,
            "<Style id=\"{id}\"><IconStyle><color>{colour}</color></IconStyle><LineStyle><color>{colour}</color>\
             <width>2</width></LineStyle><PolyStyle><color>20{}</color></PolyStyle></Style>",
            &colour[2..]
        );
    }
    area(map, &mut out);
    folder("Users", &mut out, |out| nodes(map, &map.users, "user", out));
    folder("Eavesdroppers", &mut out, |out| nodes(map, &map.eavesdroppers, "eavesdropper", out));
    for role in Role::BOTH {
        folder(&format!("Vehicle {role}"), &mut out, |out| vehicle(map, role, out));
    }
    out.push_str("</Document>\n</kml>\n");
    out
}

fn area(map: &Map, out: &mut String) {
    if let Some(area) = &map.area {
        let [low_m, high_m] = area.altitude_m;
        let heights = format!("{low_m} to {high_m} m above the mission origin");
        prism(map, ("area", &heights, "area"), &area.corners_m, high_m, out);
    }
    if map.no_fly.is_empty() {
        return;
    }
    folder("No-fly areas", out, |out| {
        // One without a ceiling is drawn as high as the vehicles may fly.
        let top_m = map.area.as_ref().map_or(0.0, |area| area.altitude_m[1]);
        for area in &map.no_fly {
            let said = (area.name.as_str(), area.heights());
            prism(map, (said.0, &said.1, "no-fly"), &area.corners_m, area.ceiling_m.unwrap_or(top_m), out);
        }
    });
}

/// A polygon at a height, with walls to the ground.
fn prism(
    map: &Map,
    (name, description, style): (&str, &str, &str),
    corners_m: &[[f64; 2]],
    top_m: f64,
    out: &mut String,
) {
    let mut ring = map.corners(corners_m, top_m);
    ring.extend(ring.first().copied());
    let _ = writeln!(
        out,
        "<Placemark><name>{}</name><description>{}</description>\
         <styleUrl>#{style}</styleUrl><Polygon><extrude>1</extrude><altitudeMode>absolute</altitudeMode><outerBoundaryIs>\
         <LinearRing><coordinates>{}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>",
        escaped(name),
        escaped(description),
        coordinates(&ring)
    );
}

fn nodes(map: &Map, nodes: &[Node], style: &str, out: &mut String) {
    for Node { name, at, radius_m, std_m } in nodes {
        let known = match (radius_m, std_m) {
            (Some(radius_m), _) => format!("within {radius_m} m, "),
            (None, Some(std_m)) => format!("+- {std_m} m, "),
            (None, None) => String::new(),
        };
        placemark(map, name, &format!("{known}{}", height(at)), style, at, out);
    }
}

fn vehicle(map: &Map, role: Role, out: &mut String) {
    let style = role.key();
    if let Some(home) = &map.homes[role] {
        placemark(map, &format!("home of {role}"), &height(home), style, home, out);
    }
    for (number, slot) in map.slots.iter().enumerate() {
        let vehicle = &slot.vehicles[role];
        let at = &vehicle.pose.position_enu_m;
        let [roll, pitch, yaw] =
            [vehicle.pose.roll_rad, vehicle.pose.pitch_rad, vehicle.pose.yaw_rad].map(f64::to_degrees);
        let said = format!(
            "slot {number}, {}, roll {roll:.1}, pitch {pitch:.1}, yaw {yaw:.1} deg, {}",
            height(at),
            Watts(vehicle.tx_power_w)
        );
        placemark(map, &format!("{role} for {}", slot.user), &said, style, at, out);
    }
    if map.tracks[role].len() > 1 {
        let line: Vec<Geodetic> = map.tracks[role].iter().map(|at| map.place(at)).collect();
        let _ = writeln!(
            out,
            "<Placemark><name>flight of {role}</name><styleUrl>#{style}</styleUrl><LineString><altitudeMode>absolute\
             </altitudeMode><coordinates>{}</coordinates></LineString></Placemark>",
            coordinates(&line)
        );
    }
}

fn placemark(map: &Map, name: &str, description: &str, style: &str, at: &Enu, out: &mut String) {
    let _ = writeln!(
        out,
        "<Placemark><name>{}</name><description>{}</description><styleUrl>#{style}</styleUrl><Point><extrude>1</extrude>\
         <altitudeMode>absolute</altitudeMode><coordinates>{}</coordinates></Point></Placemark>",
        escaped(name),
        escaped(description),
        coordinates(&[map.place(at)])
    );
}

fn folder(name: &str, out: &mut String, fill: impl FnOnce(&mut String)) {
    let _ = writeln!(out, "<Folder><name>{name}</name>");
    fill(out);
    out.push_str("</Folder>\n");
}

fn height(at: &Enu) -> String {
    format!("{:.1} m above the mission origin", at.z)
}

fn coordinates(places: &[Geodetic]) -> String {
    let each = places.iter().map(|place| format!("{},{},{}", place.lon_deg, place.lat_deg, place.alt_m));
    each.collect::<Vec<_>>().join(" ")
}

/// Text of an element. What XML has no place for, not even escaped, is left out.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c if c.is_control() || ('\u{fffe}'..='\u{ffff}').contains(&c) => {}
            c => out.push(c),
        }
    }
    out
}
