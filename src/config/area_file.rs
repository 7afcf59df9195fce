//! A field as others draw it: area, no-fly areas and homes from a QGroundControl plan or a GeoJSON file. What is read counts as
//! if the mission file said it; the path does not.
//!
//! | | QGroundControl `.plan` | GeoJSON |
//! |---|---|---|
//! | area | the one inclusion polygon of `geoFence` | the Polygon of `kind` "area", or the only Polygon |
//! | no-fly areas | exclusion polygons; exclusion circles as polygons of 16 corners around them | Polygons of `kind` "no-fly" |
//! | their heights | all: the format has none | `floor_up_m`, `ceiling_up_m` |
//! | homes | the first rally point I's, the second J's, where there are two | Points of `kind` "home" with `vehicle` "i" or "j" |
//!
//! `plannedHomePosition` and the waypoints of a plan, and any other feature, are not read.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use serde_json::Value as Json;

use super::draft::NoFlyDraft;
use super::file::{MAX_BYTES, read_text};
use crate::geo::{Enu, Geodetic};
use crate::role::{PerVehicle, Role};

/// Corners of the polygon around a circle.
const CIRCLE_CORNERS: usize = 16;

/// What such a file says. Corners by latitude and longitude.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct AreaFile {
    pub(crate) area: Vec<[f64; 2]>,
    pub(crate) no_fly: Vec<NoFlyDraft>,
    /// Latitude and longitude, and how high above the mission origin, where that is said.
    pub(crate) homes: PerVehicle<Option<([f64; 2], Option<f64>)>>,
}

impl AreaFile {
    /// Reads one.
    ///
    /// # Errors
    /// A clause that continues the file's name: what is wrong with it.
    pub(crate) fn read(path: &Path) -> Result<Self, String> {
        let text = read_text(path, MAX_BYTES).map_err(|findings| {
            findings.list().iter().map(|found| found.message.as_str()).collect::<String>()
        })?;
        Self::of_text(&text)
    }

    /// The same of its text.
    pub(crate) fn of_text(text: &str) -> Result<Self, String> {
        let json: Json = serde_json::from_str(text).map_err(|error| format!("is no JSON: {error}"))?;
        if json["fileType"] == "Plan" {
            of_plan(&json)
        } else if json["type"] == "FeatureCollection" || json["type"] == "Feature" {
            of_geojson(&json)
        } else {
            Err("is neither a QGroundControl plan (\"fileType\": \"Plan\") nor a GeoJSON FeatureCollection"
                .to_owned())
        }
    }
}

fn list<'j>(json: &'j Json, what: &str) -> Result<&'j [Json], String> {
    match json {
        Json::Null => Ok(&[]),
        json => json.as_array().map(Vec::as_slice).ok_or_else(|| format!("says {what} that are no list")),
    }
}

/// Two numbers, latitude first.
fn position(latitude: &Json, longitude: &Json, of: &str) -> Result<[f64; 2], String> {
    let within = |json: &Json, most: f64| json.as_f64().filter(|deg| deg.abs() <= most);
    match (within(latitude, 89.0), within(longitude, 180.0)) {
        (Some(lat_deg), Some(lon_deg)) => Ok([lat_deg, lon_deg]),
        _ => {
            Err(format!("has a position in {of} that is no latitude and longitude: {latitude}, {longitude}"))
        }
    }
}

/// A ring without the corner that closes it.
fn open(mut corners: Vec<[f64; 2]>, of: &str) -> Result<Vec<[f64; 2]>, String> {
    if corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    if corners.len() < 3 {
        return Err(format!("has {} corners in {of}, fewer than 3", corners.len()));
    }
    Ok(corners)
}

fn of_plan(plan: &Json) -> Result<AreaFile, String> {
    let fence = &plan["geoFence"];
    let mut read = AreaFile::default();
    let mut areas = Vec::new();
    for (index, polygon) in list(&fence["polygons"], "geoFence.polygons")?.iter().enumerate() {
        let of = format!("geoFence.polygons number {}", index + 1);
        let corners = list(&polygon["polygon"], &of)?.iter().map(|at| position(&at[0], &at[1], &of));
        let corners = open(corners.collect::<Result<_, _>>()?, &of)?;
        match polygon["inclusion"].as_bool() {
            Some(true) => areas.push(corners),
            Some(false) => read.no_fly.push(exclusion(&read.no_fly, corners)),
            None => return Err(format!("does not say in {of} whether it is an inclusion")),
        }
    }
    for (index, circle) in list(&fence["circles"], "geoFence.circles")?.iter().enumerate() {
        let of = format!("geoFence.circles number {}", index + 1);
        if circle["inclusion"].as_bool() != Some(false) {
            return Err(format!("has an inclusion circle, {of}: draw the area as a polygon"));
        }
        let at = &circle["circle"];
        let centre = position(&at["center"][0], &at["center"][1], &of)?;
        let radius_m = at["radius"].as_f64().filter(|metres| (0.1..=50_000.0).contains(metres));
        let radius_m = radius_m.ok_or_else(|| format!("has no radius from 0.1 to 50000 m in {of}"))?;
        read.no_fly.push(exclusion(&read.no_fly, around(centre, radius_m)));
    }
    read.area = only(areas, "inclusion polygons in geoFence")?;
    let rally = list(&plan["rallyPoints"]["points"], "rallyPoints.points")?;
    if let [i, j] = rally {
        let home = |at: &Json| position(&at[0], &at[1], "rallyPoints").map(|home| Some((home, None)));
        read.homes = PerVehicle { i: home(i)?, j: home(j)? };
    }
    Ok(read)
}

fn exclusion(before: &[NoFlyDraft], corners: Vec<[f64; 2]>) -> NoFlyDraft {
    let name = format!("exclusion-{}", before.len() + 1);
    NoFlyDraft { name, area_lat_lon: Some(corners), ..NoFlyDraft::default() }
}

/// Corners of a regular polygon that contains a circle.
fn around([lat_deg, lon_deg]: [f64; 2], radius_m: f64) -> Vec<[f64; 2]> {
    let centre = Geodetic { lat_deg, lon_deg, alt_m: 0.0 };
    let step = TAU / CIRCLE_CORNERS as f64;
    // A little more than its sides need, for the plane that they are straight in.
    let reach_m = radius_m / (PI / CIRCLE_CORNERS as f64).cos() * (1.0 + 1e-4);
    let corner = |k: usize| {
        let (sin, cos) = (step * k as f64).sin_cos();
        let at = Geodetic::from_enu(Enu::new(reach_m * cos, reach_m * sin, 0.0), centre);
        [at.lat_deg, at.lon_deg]
    };
    (0..CIRCLE_CORNERS).map(corner).collect()
}

fn only(mut areas: Vec<Vec<[f64; 2]>>, what: &str) -> Result<Vec<[f64; 2]>, String> {
    match (areas.len(), areas.pop()) {
        (1, Some(area)) => Ok(area),
        (count, _) => Err(format!("has {count} {what}, and the area is exactly one")),
    }
}

fn of_geojson(json: &Json) -> Result<AreaFile, String> {
    let single = [json.clone()];
    let features = if json["type"] == "Feature" { &single[..] } else { list(&json["features"], "features")? };
    let polygons = features.iter().filter(|feature| feature["geometry"]["type"] == "Polygon").count();
    let mut read = AreaFile::default();
    let mut areas = Vec::new();
    for (index, feature) in features.iter().enumerate() {
        let (geometry, properties) = (&feature["geometry"], &feature["properties"]);
        let kind = properties["kind"].as_str();
        let of = format!("feature number {}", index + 1);
        match (geometry["type"].as_str(), kind) {
            (Some("Polygon"), kind) => {
                let corners = ring(geometry, &of)?;
                match kind {
                    Some("area") => areas.push(corners),
                    Some("no-fly") => read.no_fly.push(no_fly(properties, &read.no_fly, corners, &of)?),
                    None if polygons == 1 => areas.push(corners),
                    _ => {
                        return Err(format!(
                            "does not say of {of}, a Polygon, whether its \"kind\" is \"area\" or \"no-fly\""
                        ));
                    }
                }
            }
            (Some("MultiPolygon"), _) => {
                return Err(format!("has a MultiPolygon, {of}: write each polygon as a feature of its own"));
            }
            (Some("Point"), Some("home")) => {
                let at = &geometry["coordinates"];
                let home = position(&at[1], &at[0], &of)?;
                let role = Role::BOTH.into_iter().find(|role| properties["vehicle"] == role.key());
                let role = role.ok_or_else(|| {
                    format!("does not say of {of}, a home, whose: \"vehicle\" is \"i\" or \"j\"")
                })?;
                read.homes[role] = Some((home, properties["up_m"].as_f64()));
            }
            _ => {}
        }
    }
    read.area = only(areas, "Polygons of \"kind\" \"area\"")?;
    Ok(read)
}

fn ring(geometry: &Json, of: &str) -> Result<Vec<[f64; 2]>, String> {
    let [outer] = list(&geometry["coordinates"], of)? else {
        return Err(format!(
            "has a Polygon with holes, or with nothing, {of}: draw each hole as a no-fly area"
        ));
    };
    // GeoJSON has the longitude first.
    let corners = list(outer, of)?.iter().map(|at| position(&at[1], &at[0], of));
    open(corners.collect::<Result<_, _>>()?, of)
}

fn no_fly(
    properties: &Json,
    before: &[NoFlyDraft],
    corners: Vec<[f64; 2]>,
    of: &str,
) -> Result<NoFlyDraft, String> {
    let height = |key: &str| match &properties[key] {
        Json::Null => Ok(None),
        json => {
            let metres = json.as_f64().filter(|metres| (-1000.0..=10_000.0).contains(metres));
            metres
                .map(Some)
                .ok_or_else(|| format!("says a {key} in {of} that is no height in metres: {json}"))
        }
    };
    let mut area = exclusion(before, corners);
    if let Some(name) = properties["name"].as_str().filter(|name| !name.is_empty() && name.len() <= 64) {
        area.name = name.to_owned();
    }
    (area.floor_m, area.ceiling_m) = (height("floor_up_m")?, height("ceiling_up_m")?);
    Ok(area)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: &str = r#"{ "fileType": "Plan", "version": 1, "geoFence": { "version": 2,
        "polygons": [
            { "inclusion": true, "version": 1, "polygon": [[50.0, 14.0], [50.0, 14.01], [50.01, 14.01], [50.01, 14.0]] },
            { "inclusion": false, "version": 1, "polygon": [[50.001, 14.001], [50.001, 14.002], [50.002, 14.002]] }],
        "circles": [{ "inclusion": false, "version": 1, "circle": { "center": [50.005, 14.005], "radius": 20 } }] },
        "rallyPoints": { "version": 2, "points": [[50.003, 14.003, 20], [50.003, 14.0035, 20]] } }"#;

    #[test]
    fn val_a_plan_gives_area_no_fly_areas_and_homes() {
        let read = AreaFile::of_text(PLAN).unwrap();
        assert_eq!(read.area.len(), 4);
        assert_eq!(read.homes.j, Some(([50.003, 14.0035], None)));
        let [triangle, disc] = &read.no_fly[..] else { panic!("{read:?}") };
        assert_eq!((triangle.name.as_str(), disc.name.as_str()), ("exclusion-1", "exclusion-2"));
        // The circle lies inside its polygon: no side is nearer to its middle, no corner much further.
        let centre = Geodetic { lat_deg: 50.005, lon_deg: 14.005, alt_m: 0.0 };
        let corners: Vec<_> = disc
            .area_lat_lon
            .as_ref()
            .unwrap()
            .iter()
            .map(|[lat_deg, lon_deg]| {
                Geodetic { lat_deg: *lat_deg, lon_deg: *lon_deg, alt_m: 0.0 }.to_enu(centre).xy()
            })
            .collect();
        let area = crate::geo::polygon::Polygon::new(&corners).unwrap();
        let nearest_m = area.nearest_on_boundary(nalgebra::Vector2::zeros()).norm();
        assert!(nearest_m > 20.0 && area.farthest_m(nalgebra::Vector2::zeros()) < 20.5, "{nearest_m}");
    }

    #[test]
    fn val_geojson_gives_names_and_heights() {
        let text = r#"{ "type": "FeatureCollection", "features": [
            { "type": "Feature", "properties": { "kind": "area" }, "geometry": { "type": "Polygon",
              "coordinates": [[[14.0, 50.0], [14.01, 50.0], [14.01, 50.01], [14.0, 50.0]]] } },
            { "type": "Feature", "properties": { "kind": "no-fly", "name": "mast", "ceiling_up_m": 60 },
              "geometry": { "type": "Polygon", "coordinates": [[[14.001, 50.001], [14.002, 50.001], [14.002, 50.002]]] } },
            { "type": "Feature", "properties": { "kind": "home", "vehicle": "j", "up_m": 1.5 },
              "geometry": { "type": "Point", "coordinates": [14.003, 50.003] } },
            { "type": "Feature", "properties": null, "geometry": { "type": "LineString", "coordinates": [] } }] }"#;
        let read = AreaFile::of_text(text).unwrap();
        assert_eq!(read.area, [[50.0, 14.0], [50.0, 14.01], [50.01, 14.01]]);
        assert_eq!(read.no_fly[0].name, "mast");
        assert_eq!((read.no_fly[0].floor_m, read.no_fly[0].ceiling_m), (None, Some(60.0)));
        assert_eq!(read.homes, PerVehicle { i: None, j: Some(([50.003, 14.003], Some(1.5))) });
    }

    #[test]
    fn spec_what_is_no_field_is_refused_by_what_is_wrong_with_it() {
        let polygon = |kind: &str, corners: &str| {
            format!(
                r#"{{ "type": "Feature", "properties": {{ {kind} }}, "geometry": {{ "type": "Polygon", "coordinates": {corners} }} }}"#
            )
        };
        let good = "[[[14.0, 50.0], [14.01, 50.0], [14.01, 50.01], [14.0, 50.0]]]";
        let two = format!(
            r#"{{ "type": "FeatureCollection", "features": [{}, {}] }}"#,
            polygon(r#""kind": "area""#, good),
            polygon("", good)
        );
        for (text, says) in [
            ("{", "is no JSON"),
            ("[]", "is neither a QGroundControl plan"),
            (
                r#"{ "fileType": "Plan" }"#,
                "has 0 inclusion polygons in geoFence, and the area is exactly one",
            ),
            (&PLAN.replacen("\"inclusion\": false", "\"inclusion\": true", 1), "has 2 inclusion polygons"),
            (
                &PLAN.replace("\"circles\": [{ \"inclusion\": false", "\"circles\": [{ \"inclusion\": true"),
                "has an inclusion circle",
            ),
            (&PLAN.replace("[50.0, 14.0]", "[95.0, 14.0]"), "no latitude and longitude: 95.0, 14.0"),
            (&PLAN.replace("\"radius\": 20", "\"radius\": -1"), "has no radius"),
            (&two, "does not say of feature number 2, a Polygon, whether"),
            (&polygon("", "[[[14.0, 50.0], [14.01, 50.0]]]"), "has 2 corners in feature number 1"),
            (
                &polygon(
                    "",
                    &format!("[{good}, {good}]")[..]
                        .replace("[[[[", "[[[")
                        .replace("]]]]", "]]]")
                        .replace("]]], [[[", "]], [["),
                ),
                "has a Polygon with holes",
            ),
        ] {
            let error = AreaFile::of_text(text).unwrap_err();
            assert!(error.contains(says), "{error}\n{text}");
        }
    }
}
