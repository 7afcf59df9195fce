//! Areas as they are written down: in the digest, and in files that others draw.

use std::path::PathBuf;

use nalgebra::Vector2;
use veilwing::config::{Mission, NoFlyDraft};
use veilwing::geo::Enu;
use veilwing::planning::maps::Map;

use crate::{command, obstructed};

#[test]
fn spec_areas_are_in_the_digest_one_by_one_by_text_and_by_value() {
    let text = std::fs::read_to_string("tests/flight/yard.toml").unwrap();
    let area =
        "[[airspace.no_fly]]\nname = \"mast\"\narea_enu_m = [[20, 20], [25, 20], [25, 25]]\nceiling_m = 15\n";
    let bare = Mission::parse("m.toml", &text).unwrap();
    let with = |area: &str| Mission::parse("m.toml", &format!("{text}{area}")).unwrap();
    let read = with(area);
    assert!(read.airspace.no_fly[0].floor_m.is_none() && bare.airspace.no_fly.is_empty());
    let mast = NoFlyDraft {
        name: "mast".into(),
        area_enu_m: Some(vec![[20.0, 20.0], [25.0, 20.0], [25.0, 25.0]]),
        ceiling_m: Some(15.0),
        ..NoFlyDraft::default()
    };
    let built = bare.changed(|draft| draft.no_fly = vec![mast.clone()]).unwrap();
    assert_eq!(built.digest(), read.digest(), "{:?}", built.differences(&read));
    assert_eq!(built.airspace, read.airspace);
    let none = built.changed(|draft| draft.no_fly.clear()).unwrap();
    assert_eq!(none.digest(), bare.digest());
    let others = [
        area.replace("mast", "pole"),
        area.replace("[20, 20]", "[20, 21]"),
        area.replace("ceiling_m = 15", "ceiling_m = 16"),
        area.replace("ceiling_m", "floor_m"),
    ];
    for other in others {
        assert_ne!(with(&other).digest(), read.digest(), "{other}");
    }
    // What nobody would read is refused.
    let lost = bare.changed(|draft| draft.airspace.no_fly = read.airspace.no_fly.clone()).unwrap_err();
    assert!(lost.to_string().contains("put them into the draft's own `no_fly`"), "{lost}");
}

fn directory(name: &str) -> PathBuf {
    command::directory(&format!("no-fly-{name}"))
}

#[test]
fn spec_what_plan_out_wrote_gives_the_same_field_and_the_path_is_not_in_the_digest() {
    let (mission, plan, _) = obstructed();
    let written = mission.changed(|draft| draft.no_fly[1].ceiling_m = Some(31.5)).unwrap();
    let map = Map::of_plan(&written, &plan).unwrap();
    let folder = directory("maps");
    for (name, text) in map.files("field") {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let read = |file: &str| {
        let text = std::fs::read_to_string("tests/flight/yard.toml").unwrap();
        let text = text.replace(
            "area_enu_m = [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]",
            &format!("area_file = \"{file}\""),
        );
        let text = text
            .replace("home_enu_m = [-8.0, 0.0, 0.0]\n", "")
            .replace("home_enu_m = [8.0, -20.0, 0.0]\n", "");
        let path = folder.join("mission.toml");
        std::fs::write(&path, text).unwrap();
        Mission::load(&path).unwrap()
    };
    // 1e-7 degrees are 11 mm.
    let near =
        |a: &[Vector2<f64>], b: &[Vector2<f64>]| a.iter().all(|a| b.iter().any(|b| (a - b).norm() < 0.011));
    for file in ["field.geojson", "field-i.plan"] {
        let again = read(file);
        assert_eq!(again.airspace.area_enu_m.len(), 4);
        assert!(near(&again.airspace.area_enu_m, &written.airspace.area_enu_m), "{file}");
        assert_eq!(again.airspace.no_fly.len(), 2, "{file}");
        for (a, b) in again.airspace.no_fly.iter().zip(&written.airspace.no_fly) {
            assert!(near(&a.area_enu_m, &b.area_enu_m), "{file}");
            if file == "field.geojson" {
                assert_eq!((&a.name, a.heights_m()), (&b.name, b.heights_m()));
            }
        }
        let home = again.vehicles.i.home_enu_m;
        assert_eq!(home.is_some(), file == "field.geojson");
        assert!(home.is_none_or(|home| (home - Enu::new(-30.0, -30.0, 0.0)).norm() < 0.011));
        // What was read counts, and not from where: a copy of the mission that needs no other file is the same mission.
        let alone = Mission::parse("alone.toml", &again.with_rows().unwrap()).unwrap();
        assert_eq!(alone.digest(), again.digest(), "{:?}", alone.differences(&again));
        std::fs::copy(folder.join(file), folder.join(format!("other-{file}"))).unwrap();
        assert_eq!(read(&format!("other-{file}")).digest(), again.digest());
        assert_eq!(again.changed(|_| ()).unwrap().digest(), again.digest());
    }
    assert_ne!(read("field.geojson").digest(), read("field-i.plan").digest());
}

#[test]
fn spec_a_broken_area_file_is_named_with_what_is_wrong_with_it() {
    let folder = directory("broken");
    std::fs::write(folder.join("empty.plan"), r#"{ "fileType": "Plan" }"#).unwrap();
    for (file, says) in [
        ("empty.plan", "`area_file` is \"empty.plan\": the file has 0 inclusion polygons in geoFence"),
        ("none.plan", "`area_file` is \"none.plan\": the file"),
    ] {
        let text = std::fs::read_to_string("tests/flight/yard.toml").unwrap();
        let text = text.replace(
            "area_enu_m = [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]",
            &format!("area_file = \"{file}\""),
        );
        let path = folder.join("mission.toml");
        std::fs::write(&path, text).unwrap();
        let told = Mission::load(&path).unwrap_err().to_string();
        assert!(told.contains(says), "{told}");
        assert!(told.contains("mission.toml:8:"), "{told}");
    }
}
