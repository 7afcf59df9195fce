//! The MCAP file, read back by the crate's own reader and, by its own descriptors alone, by prost-reflect.

use std::collections::BTreeMap;

use prost_reflect::{DescriptorPool, DynamicMessage, ReflectMessage, Value};
use veilwing::desk::report::mcap::{Attached, mcap};
use veilwing::desk::report::telemetry::{Lease, Said};
use veilwing::desk::report::timeline::OriginScene;
use veilwing::desk::report::{EventKind, Severity, Timeline};
use veilwing::planning::maps::NoFlyArea;
use veilwing::role::Role;

use crate::command::{directory, veilwing};
use crate::sample::{event, flight};
use crate::text;

/// By topic, each message's time and content.
pub type Read = BTreeMap<String, Vec<(u64, DynamicMessage)>>;

/// Everything in a file. A message of which any part is not as its channel's schema says fails.
pub fn read(bytes: &[u8]) -> Read {
    let summary = ::mcap::Summary::read(bytes).unwrap().expect("a file with a summary");
    let topics = summary.channels.values().map(|channel| (channel.topic.clone(), Vec::new()));
    let mut all: Read = topics.collect();
    let mut last = 0;
    for message in ::mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= last, "messages are in the order of time");
        last = message.log_time;
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!(
            (schema.encoding.as_str(), message.channel.message_encoding.as_str()),
            ("protobuf", "protobuf")
        );
        let pool = DescriptorPool::decode(&*schema.data).unwrap();
        let of = pool.get_message_by_name(&schema.name).unwrap();
        let decoded = DynamicMessage::decode(of, &*message.data).unwrap();
        known(&decoded);
        let read = all.get_mut(&message.channel.topic).unwrap();
        assert_eq!(read.len(), message.sequence as usize);
        read.push((message.log_time, decoded));
    }
    let counted = summary.stats.unwrap().channel_message_counts;
    for (id, channel) in &summary.channels {
        assert_eq!(
            counted.get(id).copied().unwrap_or(0),
            all[&channel.topic].len() as u64,
            "{}",
            channel.topic
        );
    }
    all
}

/// Nothing in it is unknown to its type, nor is anything in what it is made of.
fn known(message: &DynamicMessage) {
    let name = message.descriptor().full_name().to_owned();
    assert_eq!(message.unknown_fields().count(), 0, "unknown fields in {name}");
    for (field, value) in message.fields() {
        match value {
            Value::Message(inner) => known(inner),
            Value::List(all) => all.iter().filter_map(Value::as_message).for_each(known),
            Value::EnumNumber(number) => {
                let kind = field.kind();
                let of = kind.as_enum().unwrap();
                assert!(of.get_value(*number).is_some(), "{number} is no {}", of.full_name());
            }
            _ => {}
        }
    }
}

fn field(message: &DynamicMessage, path: &str) -> Value {
    let (first, rest) = path.split_once('.').map_or((path, None), |(first, rest)| (first, Some(rest)));
    let value = message.get_field_by_name(first).unwrap_or_else(|| panic!("no {first}")).into_owned();
    match rest {
        Some(rest) => field(value.as_message().unwrap(), rest),
        None => value,
    }
}

fn number(message: &DynamicMessage, path: &str) -> f64 {
    match field(message, path) {
        Value::F64(value) => value,
        Value::I32(value) => value.into(),
        Value::EnumNumber(value) => value.into(),
        other => panic!("{path} is {other:?}"),
    }
}

fn words(message: &DynamicMessage, path: &str) -> String {
    field(message, path).as_str().unwrap().to_owned()
}

/// The flight made by hand, with an origin, a no-fly area, a violation and one that does not count.
fn whole() -> Timeline {
    let mut flight = flight();
    flight.scene.origin = Some(OriginScene { lat_deg: 50.0, lon_deg: 14.0, alt_amsl_m: 200.0 });
    flight.scene.airspace.as_mut().unwrap().no_fly.push(NoFlyArea {
        name: "mast".into(),
        corners_m: vec![[1.0, 2.0], [3.0, 2.0], [3.0, 4.0]],
        floor_m: None,
        ceiling_m: Some(40.0),
    });
    for (kind, code) in [(EventKind::Violation, "S1"), (EventKind::Excused, "S3")] {
        let mut event = event(14.2, kind, Role::I, Severity::Error, "I radiates while J does not jam");
        event.code = Some(code.into());
        flight.events.push(event);
    }
    flight.events.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    flight
}

#[test]
fn spec_every_channel_of_a_flight_is_read_back() {
    let flight = whole();
    let said = |at_s, what, left_s| Lease { at_s, what, slot: 1, duration_ms: 500, left_s };
    let leases =
        [said(10.0, Said::Asked, 0.0), said(10.1, Said::Granted, 0.4), said(14.3, Said::GivenUp, 0.0)];
    let plan = Attached { name: "plan.json".into(), media_type: "application/json", data: b"{}".to_vec() };
    let bytes = mcap(&flight, &leases, &[plan]).unwrap();
    assert_eq!(
        bytes,
        mcap(
            &flight,
            &leases,
            &[Attached { name: "plan.json".into(), media_type: "application/json", data: b"{}".to_vec() }]
        )
        .unwrap(),
        "the same flight, the same bytes"
    );

    let read = read(&bytes);
    let counts: Vec<(&str, usize)> = read.iter().map(|(topic, all)| (topic.as_str(), all.len())).collect();
    let samples = flight.samples.len();
    let expected = [
        ("/events", 5),
        ("/pair/lease", 3),
        ("/radio/secrecy", samples),
        ("/radio/sinr", samples),
        ("/scene", 1),
        ("/tf", samples),
        ("/vehicle_i/antenna", samples),
        ("/vehicle_i/location", samples),
        ("/vehicle_i/pose", samples),
        ("/vehicle_i/power", samples),
        ("/vehicle_i/state", samples),
        ("/vehicle_j/antenna", samples),
        ("/vehicle_j/location", samples),
        ("/vehicle_j/pose", samples),
        ("/vehicle_j/power", samples),
        ("/vehicle_j/state", samples),
        ("/violations", 2),
    ];
    assert_eq!(counts, expected);

    // At 12 s both are on the air, at 20 s neither is.
    let at = |topic: &str, at_s: f64| {
        let all = &read[topic];
        let found = all.iter().find(|(time, _)| *time == (at_s * 1e9) as u64);
        found.unwrap_or_else(|| panic!("no {topic} at {at_s}")).1.clone()
    };
    for (at_s, power, rate, sinr, slot) in [(12.0, 0.5, 1.425e7, 50.0, 0.0), (20.0, 0.0, 0.0, 0.0, -1.0)] {
        let on = at("/vehicle_i/power", at_s);
        assert_eq!((number(&on, "tx_power_w"), number(&on, "slot")), (power, slot));
        assert_eq!(number(&at("/radio/secrecy", at_s), "secrecy_rate_bps"), rate);
        assert_eq!(number(&at("/radio/sinr", at_s), "strongest_eavesdropper_sinr_linear"), sinr);
    }
    assert_eq!(words(&at("/radio/secrecy", 12.0), "user"), "alpha");
    let antenna = at("/vehicle_j/antenna", 12.0);
    let state = flight.samples[240].vehicles.j.as_ref().unwrap();
    let axis = state.attitude.antenna_axis();
    let read_axis = ["x", "y", "z"].map(|k| number(&antenna, &format!("axis_enu.{k}")));
    assert_eq!(read_axis, [axis.x, axis.y, axis.z]);
    assert!((number(&antenna, "roll_deg") - 0.31_f64.to_degrees()).abs() < 1e-9);
    // The transform turns the body's own axis to the antenna's.
    let transforms = at("/tf", 12.0);
    let transforms = field(&transforms, "transforms");
    let transform = transforms.as_list().unwrap()[1].as_message().unwrap().clone();
    assert_eq!(words(&transform, "child_frame_id"), "vehicle_j");
    let [x, y, z, w] = ["x", "y", "z", "w"].map(|k| number(&transform, &format!("rotation.{k}")));
    let turned = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)];
    assert!(turned.iter().zip(read_axis).all(|(a, b)| (a - b).abs() < 1e-12), "{turned:?} {read_axis:?}");
    let location = at("/vehicle_j/location", 12.0);
    assert!((number(&location, "altitude") - 220.0).abs() < 0.01);
    // 30 m east at 50 degrees north: 30 / (111.3 km * cos 50).
    assert!((number(&location, "longitude") - 14.0 - 30.0 / 71_700.0).abs() < 1e-6);
    assert_eq!(words(&at("/vehicle_j/state", 20.0), "mode"), "HOLD");

    let violations: Vec<(String, f64)> =
        read["/violations"].iter().map(|(_, m)| (words(m, "name"), number(m, "level"))).collect();
    assert_eq!(violations, [("S1".into(), 4.0), ("S3".into(), 4.0)]);
    let left: Vec<f64> = read["/pair/lease"].iter().map(|(_, m)| number(m, "left_s")).collect();
    assert_eq!(left, [0.0, 0.4, 0.0]);
    let entities = field(&read["/scene"][0].1, "entities");
    let ids: Vec<String> =
        entities.as_list().unwrap().iter().map(|e| words(e.as_message().unwrap(), "id")).collect();
    assert_eq!(
        ids,
        ["area", "no-fly/mast", "user/alpha", "user/bravo", "eavesdropper/hill", "antenna/i", "antenna/j"]
    );

    let summary = ::mcap::Summary::read(&bytes).unwrap().unwrap();
    let [index] = summary.attachment_indexes.as_slice() else { panic!("one attachment") };
    let attached = ::mcap::read::attachment(&bytes, index).unwrap();
    assert_eq!((attached.name.as_str(), &*attached.data), ("plan.json", b"{}".as_slice()));
    let [index] = summary.metadata_indexes.as_slice() else { panic!("one table of metadata") };
    let metadata = ::mcap::read::metadata(&bytes, index).unwrap().metadata;
    assert_eq!((metadata["seed"].as_str(), metadata["mission"].as_str()), ("7", "yard"));
    assert_eq!((&metadata["mission_digest"], metadata["result"].as_str()), (&"ab".repeat(32), "aborted"));
}

#[test]
fn spec_times_are_utc_where_it_is_known_and_what_is_unknown_is_left_out() {
    let mut flight = whole();
    flight.scene.started_utc_us = Some(1_800_000_000_000_000);
    flight.scene.origin = None;
    flight.scene.radio = None;
    flight.samples.iter_mut().for_each(|sample| sample.vehicles.j = None);
    flight.events.clear();
    let read = read(&mcap(&flight, &[], &[]).unwrap());
    let [(first, message), .., (last, _)] = read["/tf"].as_slice() else { panic!("transforms") };
    assert_eq!((*first, *last), (1_800_000_000_000_000_000, 1_800_000_030_000_000_000));
    let transforms = field(message, "transforms");
    let [transform] = transforms.as_list().unwrap() else { panic!("J is not known") };
    assert_eq!(field(transform.as_message().unwrap(), "timestamp.seconds"), Value::I64(1_800_000_000));
    for (topic, all) in &read {
        let empty =
            ["/vehicle_j", "/radio", "/pair", "/events", "/violations"].iter().any(|t| topic.starts_with(t));
        assert_eq!(all.is_empty(), empty || topic == "/vehicle_i/location", "{topic}");
    }
    flight.samples.clear();
    self::read(&mcap(&flight, &[], &[]).unwrap());
}

/// A flight of two real companions: leases by the pair's log, files that go along, a file that cannot be written.
#[test]
fn spec_a_flown_flight_has_its_leases_and_its_files() {
    let directory = directory("report-mcap");
    let mission = directory.join("mission.toml");
    std::fs::write(&mission, include_str!("../flight/yard.toml")).unwrap();
    let out = directory.join("out");
    let [mission, out] = [&mission, &out].map(|path| path.to_str().unwrap());
    let flown =
        veilwing(&["campaign", mission, "--runs", "1", "--seed", "3", "--out", out]).output().unwrap();
    assert_eq!(flown.status.code(), Some(0), "{}", text(&flown.stderr));
    let file = directory.join("flight.mcap");
    let report = |more: &[&str]| {
        let page = directory.join("page.html");
        let base = ["report", out, "--out", page.to_str().unwrap(), "--mcap", file.to_str().unwrap()];
        let output = veilwing(&[&base, more].concat()).output().unwrap();
        (output.status.code(), text(&output.stderr))
    };
    for more in [&[][..], &["--telemetry"]] {
        assert_eq!(report(more).0, Some(0), "{}", report(more).1);
        let bytes = std::fs::read(&file).unwrap();
        let read = read(&bytes);
        let leases: Vec<(u64, f64, f64, f64)> = read["/pair/lease"]
            .iter()
            .map(|(at, m)| (*at, number(m, "what"), number(m, "left_s"), number(m, "duration_ms")))
            .collect();
        for what in [0.0, 1.0, 2.0] {
            assert!(leases.iter().any(|lease| lease.1 == what), "nobody said {what}");
        }
        assert!(leases.iter().all(|(_, _, left_s, _)| (0.0..0.6).contains(left_s)));
        // Whenever I is on the air, the last word on leases leaves some of it.
        let mut on = 0;
        for (at, power) in read["/vehicle_i/power"].iter().filter(|(_, m)| number(m, "tx_power_w") > 0.0) {
            let (said, _, left_s, _) = leases.iter().rfind(|lease| lease.0 <= *at).unwrap();
            assert!((at - said) as f64 * 1e-9 <= *left_s, "no lease at {at} ns: {power:?}");
            on += 1;
        }
        assert!(on > 100, "{on}");
        let summary = ::mcap::Summary::read(&bytes).unwrap().unwrap();
        let mut names: Vec<&str> = summary.attachment_indexes.iter().map(|a| a.name.as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["mission.toml", "plan.json", "scene.json", "summary.json"]);
    }
    std::fs::remove_file(&file).unwrap();
    std::fs::create_dir(&file).unwrap();
    let (code, said) = report(&[]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("flight.mcap") && said.contains("there is a directory of that name"), "{said}");
}
