//! The replay's data, and the maps that share its picture: true to the flight, small, and with the fence inside.

use serde_json::Value;
use veilwing::desk::report::{Timeline, html};
use veilwing::role::Role;

use crate::page::{data, sound};
use crate::sample::flight;

/// A column of differences, as numbers.
fn column(steps: &Value, unit: f64) -> Vec<f64> {
    let mut sum = 0;
    let steps = steps.as_array().unwrap().iter().map(|step| step.as_i64().unwrap());
    steps
        .map(|step| {
            sum += step;
            sum as f64 * unit
        })
        .collect()
}

/// A value that is held from one index to the next.
fn held(steps: &Value, index: usize) -> &Value {
    let mut steps = steps.as_array().unwrap().iter();
    &steps.rfind(|step| step[0].as_u64().unwrap() as usize <= index).unwrap()[1]
}

fn times(data: &Value) -> Vec<f64> {
    column(&data["t"], 1e-4)
}

#[test]
fn spec_the_replays_data_are_the_flights() {
    let flight = flight();
    let page = html(&flight);
    sound(&page);
    let data = data(&page);
    let times = times(&data);
    assert_eq!(times.len(), flight.samples.len());
    for (role, vehicle) in Role::BOTH.into_iter().zip(data["v"].as_array().unwrap()) {
        let columns = |key: &str, unit| [0, 1, 2].map(|k| column(&vehicle[key][k], unit));
        let (positions, axes) = (columns("p", 1e-2), columns("a", 1e-4));
        for (index, sample) in flight.samples.iter().enumerate() {
            let state = sample.vehicles[role].as_ref().unwrap();
            assert!((times[index] - sample.at_s).abs() < 1e-4);
            let axis = state.attitude.antenna_axis();
            for k in 0..3 {
                assert!((positions[k][index] - state.position_enu_m[k]).abs() <= 0.005_001);
                assert!((axes[k][index] - axis[k]).abs() <= 5.1e-5);
            }
            assert_eq!(held(&vehicle["w"], index).as_f64().unwrap(), state.tx_power_w.unwrap_or(0.0));
            assert_eq!(held(&vehicle["s"], index).as_i64().unwrap(), state.slot.map_or(-1, i64::from));
            assert_eq!(held(&vehicle["m"], index).as_str().unwrap(), state.mode);
            assert_eq!(held(&vehicle["k"], index), &Value::Bool(true));
        }
    }
    let (user, strongest) = (column(&data["h"]["u"], 1e-2), column(&data["h"]["e"], 1e-2));
    for (index, sample) in flight.samples.iter().enumerate() {
        assert_eq!(held(&data["h"]["on"], index), sample.heard.is_some());
        if let Some(heard) = &sample.heard {
            assert!((user[index] - 10.0 * heard.user_sinr.log10()).abs() < 0.005_001);
            assert!((strongest[index] - 10.0 * heard.eavesdropper_sinr[0].log10()).abs() < 0.005_001);
            assert_eq!(held(&data["h"]["k"], index), 0);
        }
    }
    let why: Vec<&str> = data["off"].as_array().unwrap().iter().map(|off| off[2].as_str().unwrap()).collect();
    assert_eq!(
        why,
        [
            "its companion was gone, and its last command expired",
            "no jam lease in force, for vehicle J had not renewed its promise to jam"
        ]
    );
    assert_eq!(data["eves"][0]["t"], serde_json::json!([66.0, -14.0, 0.0]));
    assert_eq!(data["slots"][1]["u"], "bravo");
}

/// Ten minutes at 20 Hz, every figure of every sample different.
fn long() -> Timeline {
    let mut flight = flight();
    let of = flight.samples.clone();
    flight.samples = (0..12_000_u32)
        .map(|k| {
            let at_s = f64::from(k) * 0.05;
            let mut sample = of[k as usize * of.len() / 12_000].clone();
            sample.at_s = at_s;
            for (role, off) in Role::BOTH.into_iter().zip([0.0, 1.0]) {
                let state = sample.vehicles[role].as_mut().unwrap();
                let angle = 0.7 * at_s + off;
                state.attitude =
                    veilwing::geo::Attitude::from_euler(0.3 + 0.1 * (9.0 * angle).sin(), 0.1, angle);
                state.position_enu_m[0] += 10.0 * angle.sin();
                state.position_enu_m[1] += 10.0 * angle.cos();
            }
            sample
        })
        .collect();
    flight
}

#[test]
fn spec_a_long_flights_replay_is_thinned_but_not_where_something_changes() {
    let mut flight = long();
    let blink_s = flight.samples[6_001].at_s;
    let state = flight.samples[6_001].vehicles.j.as_mut().unwrap();
    (state.mode, state.tx_power_w) = ("ODD".into(), Some(0.125));
    let page = html(&flight);
    let data = data(&page);
    let times = times(&data);
    assert!((2_900..3_100).contains(&times.len()), "{}", times.len());
    let size = serde_json::to_string(&data).unwrap().len();
    assert!(size < 300_000, "{size} bytes");
    let last = flight.samples.last().unwrap().at_s;
    assert!((times.last().unwrap() - last).abs() < 1e-4);
    let index = times.iter().position(|time| (time - blink_s).abs() < 1e-4).expect("the change is there");
    assert_eq!(held(&data["v"][1]["w"], index), 0.125);
    assert_eq!(
        held(&data["v"][1]["m"], index + 1),
        flight.samples[6_002].vehicles.j.as_ref().unwrap().mode.as_str()
    );
}

/// Two kilometres of fence around a flight of a few metres.
#[test]
fn spec_the_fence_is_inside_the_map() {
    let mut flight = flight();
    let area = vec![[-900.0, -700.0], [1100.0, -700.0], [1100.0, 1300.0], [-900.0, 1300.0]];
    flight.scene.airspace.as_mut().unwrap().area_enu_m = area;
    let page = html(&flight);
    for (name, width) in [("map-wide", 640.0), ("map-narrow", 343.0)] {
        let map = page.split(&format!("<svg id=\"{name}\"")).nth(1).unwrap();
        let map = &map[..map.find("</svg>").unwrap()];
        let fence = map.lines().find(|line| line.contains("stroke-dasharray=\"8 4\"")).unwrap();
        let points = fence.split('"').nth(1).unwrap();
        for point in points.split(' ') {
            let (x, y) = point.split_once(',').unwrap();
            let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
            assert!(x > 46.0 && x < width - 8.0 && y > 8.0 && y < width - 46.0, "{name}: {point}");
        }
    }
}
