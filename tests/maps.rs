//! The maps of a plan and of a flight, and the way back: an area and homes by latitude and longitude.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::path::Path;

use serde_json::Value;
use veilwing::config::Mission;

use command::{directory, veilwing};

/// What a command says on stderr; it must succeed.
fn run(arguments: &[&str]) -> String {
    let output = veilwing(arguments).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {stderr}");
    stderr
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// The features of a kind.
fn features<'f>(map: &'f Value, kind: &str) -> Vec<&'f Value> {
    let all = map["features"].as_array().unwrap().iter();
    all.filter(|feature| feature["properties"]["kind"] == kind).collect()
}

/// Latitude and longitude of a GeoJSON position.
fn lat_lon(position: &Value) -> [f64; 2] {
    [position[1].as_f64().unwrap(), position[0].as_f64().unwrap()]
}

/// What a plan's maps say of area and homes makes the same mission when it is written into its file.
#[test]
fn spec_area_and_homes_go_to_a_map_and_back() {
    let out = directory("maps-plan");
    run(&["plan", "config/mission.toml", "--out", out.to_str().unwrap()]);
    let map = json(&out.join("plan.geojson"));
    let [area] = features(&map, "area")[..] else { panic!("{map}") };
    let ring = area["geometry"]["coordinates"][0].as_array().unwrap();
    let corners: Vec<[f64; 2]> = ring[1..].iter().map(lat_lon).collect();
    let homes: Vec<[f64; 2]> =
        features(&map, "home").iter().map(|home| lat_lon(&home["geometry"]["coordinates"])).collect();
    let text = std::fs::read_to_string("config/mission.toml").unwrap();
    let demo = Mission::parse("m.toml", &text).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut homes = homes.iter();
    for line in &mut lines {
        if line.starts_with("area_enu_m") {
            *line = format!("area_lat_lon = {corners:?}");
        } else if line.starts_with("home_enu_m") {
            *line = format!("home_lat_lon = {:?}", homes.next().unwrap());
        }
    }
    let by_globe =
        Mission::parse("m.toml", &lines.join("\n")).unwrap_or_else(|findings| panic!("{findings}"));
    assert!(by_globe.warnings.is_empty(), "{}", by_globe.warnings);
    assert_ne!(by_globe.digest(), demo.digest());
    assert_eq!(by_globe.airspace.area_enu_m.len(), demo.airspace.area_enu_m.len());
    for corner in &demo.airspace.area_enu_m {
        let near = |other: &&nalgebra::Vector2<f64>| (*other - corner).norm() < 2e-3;
        assert!(by_globe.airspace.area_enu_m.iter().any(|other| near(&other)), "{corner}");
    }
    for (a, b) in [(&demo.vehicles.i, &by_globe.vehicles.i), (&demo.vehicles.j, &by_globe.vehicles.j)] {
        assert!((a.home_enu_m.unwrap() - b.home_enu_m.unwrap()).norm() < 2e-3, "{a:?} {b:?}");
    }
    // By value it is the same mission as by its file.
    assert_eq!(by_globe.changed(|_| ()).unwrap().digest(), by_globe.digest());
}

#[test]
fn spec_what_is_wrong_with_an_area_or_a_home_by_coordinates_is_said_at_its_key() {
    let text = std::fs::read_to_string("config/mission.toml").unwrap();
    let area = "area_enu_m = [[-100.0, -100.0], [100.0, -100.0], [100.0, 100.0], [-100.0, 100.0]]";
    let globe =
        "area_lat_lon = [[50.0746, 14.4364], [50.0746, 14.4392], [50.0764, 14.4392], [50.0764, 14.4364]]";
    let home = "home_enu_m = [-15.0, -10.0, 0.0]";
    let origin = "origin = { lat_deg = 50.0755, lon_deg = 14.4378, alt_amsl_m = 200.0 }\n# (default";
    let cases: [(&[(&str, &str)], &str); 7] = [
        (&[(area, &format!("{area}\n{globe}"))], "`area_lat_lon` is given together with `area_enu_m`"),
        (
            &[(area, globe), (origin, "# (default")],
            "a position by latitude and longitude needs the mission's `origin`",
        ),
        (
            &[(area, &globe.replace("14.43", "50.07").replace("50.0746", "14.43"))],
            "a corner of `area_lat_lon` is",
        ),
        (
            &[(
                area,
                "area_lat_lon = [[50.0746, 14.4364], [50.0764, 14.4392], [50.0746, 14.4392], [50.0764, 14.4364]]",
            )],
            "`area_lat_lon` crosses itself",
        ),
        (&[(home, "home_lat_lon = [50.08, 14.4378]")], "lies outside `area_enu_m`"),
        (
            &[(home, "home_enu_m = [-15.0, -10.0, 0.0]\nhome_alt_m = 3.0")],
            "`home_alt_m` is given together with `home_enu_m`",
        ),
        (
            &[(home, "home_lat_lon = [50.0755, 14.4378]"), (origin, "# (default")],
            "needs the mission's `origin`",
        ),
    ];
    for (edits, said) in cases {
        let edited = edits.iter().fold(text.clone(), |text, (from, to)| {
            assert!(text.contains(from), "{from:?} is not in the mission");
            text.replacen(from, to, 1)
        });
        let findings = Mission::parse("m.toml", &edited).unwrap_err().to_string();
        assert!(findings.contains(said), "{said:?} is not in {findings}");
    }
    let good = Mission::parse("m.toml", &text.replacen(area, globe, 1)).unwrap();
    // Ten kilometres a tenth of a degree: the corner in the north-east.
    let corner = good.airspace.area_enu_m[2];
    assert!((corner.y - 100.1).abs() < 0.2 && (corner.x - 100.2).abs() < 0.3, "{corner}");
}

#[test]
fn spec_a_vehicles_plan_has_the_fence_its_rally_point_and_a_waypoint_for_each_slot() {
    let out = directory("maps-qgc");
    run(&["plan", "config/mission.toml", "--out", out.to_str().unwrap()]);
    let plan = json(&out.join("plan.json"));
    let map = json(&out.join("plan.geojson"));
    for role in ["i", "j"] {
        let qgc = json(&out.join(format!("plan-{role}.plan")));
        assert_eq!((&qgc["fileType"], &qgc["version"]), (&"Plan".into(), &1.into()));
        assert_eq!(qgc["geoFence"]["polygons"][0]["polygon"].as_array().unwrap().len(), 4);
        // Twenty metres above its home, where the altitude band begins.
        assert_eq!(qgc["rallyPoints"]["points"][0][2], 20.0);
        let items = qgc["mission"]["items"].as_array().unwrap();
        assert_eq!(items.len(), 2);
        let poses = features(&map, "pose");
        let poses = poses.iter().filter(|pose| pose["properties"]["vehicle"] == role);
        for ((item, pose), slot) in items.iter().zip(poses).zip(plan["slots"].as_array().unwrap()) {
            let place = lat_lon(&pose["geometry"]["coordinates"]);
            assert_eq!([4, 5].map(|k| item["params"][k].as_f64().unwrap()), place);
            let up_m = slot["vehicles"][role]["position_enu_m"][2].as_f64().unwrap();
            let amsl_m = item["params"][6].as_f64().unwrap();
            // The tangent plane leaves the sphere by a millimetre at a hundred metres.
            assert!((amsl_m - 200.0 - up_m).abs() < 5e-3, "{amsl_m} {up_m}");
            assert_eq!(pose["properties"]["user"], slot["user"]);
        }
    }
    let globe = std::fs::read_to_string(out.join("plan.kml")).unwrap();
    assert_eq!(globe.matches("<Placemark>").count(), 1 + 2 + 3 + 2 + 4, "{globe}");
}

#[test]
fn spec_names_of_a_mission_cannot_break_a_map() {
    let out = directory("maps-names");
    let path = out.join("mission.toml");
    let text = std::fs::read_to_string("config/mission.toml").unwrap();
    let text = text.replacen("\"alpha\"", "'a</name><b>&\"'", 1).replacen("\"courtyard\"", "'<x>&'", 1);
    std::fs::write(&path, text).unwrap();
    run(&["plan", path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    let globe = std::fs::read_to_string(out.join("plan.kml")).unwrap();
    assert!(globe.contains("<name>a&lt;/name&gt;&lt;b&gt;&amp;\"</name>"), "{globe}");
    assert_eq!(globe.matches("<name>").count(), globe.matches("</name>").count());
    assert_eq!(features(&json(&out.join("plan.geojson")), "user")[0]["properties"]["name"], "a</name><b>&\"");
}

#[test]
fn spec_without_an_origin_there_are_no_maps_and_that_is_said() {
    let out = directory("maps-nowhere");
    let said = run(&["plan", "config/paper.toml", "--out", out.to_str().unwrap()]);
    assert!(said.contains("no maps: the mission has no origin"), "{said}");
    let files: Vec<_> = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(files, ["plan.json"]);
}

#[test]
fn spec_a_reports_maps_show_where_both_vehicles_flew() {
    let out = directory("maps-flight");
    run(&["campaign", "config/mission.toml", "--runs", "1", "--out", out.to_str().unwrap()]);
    let said = run(&["report", out.to_str().unwrap()]);
    assert!(said.contains("maps: report.geojson, report.kml, report-i.plan, report-j.plan"), "{said}");
    let map = json(&out.join("report.geojson"));
    let tracks = features(&map, "track");
    assert_eq!(tracks.len(), 2);
    for track in tracks {
        let line = track["geometry"]["coordinates"].as_array().unwrap();
        assert!(line.len() > 50, "{} positions", line.len());
        // It passes within two metres of its pose in every slot.
        let role = &track["properties"]["vehicle"];
        for pose in features(&map, "pose").iter().filter(|pose| pose["properties"]["vehicle"] == *role) {
            let [lat, lon] = lat_lon(&pose["geometry"]["coordinates"]);
            let nearest_m = line
                .iter()
                .map(lat_lon)
                .map(|[a, o]| ((a - lat) * 111e3).hypot((o - lon) * 111e3 * lat.to_radians().cos()))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest_m < 2.0, "{role}: {nearest_m} m");
        }
    }
}
