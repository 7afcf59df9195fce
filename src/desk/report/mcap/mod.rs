//! A flight as an MCAP file, for Foxglove and rerun.
//!
//! | channel | type | when |
//! |---|---|---|
//! | `/tf` | `foxglove.FrameTransforms` | each sample: both bodies, `vehicle_i` and `vehicle_j`, in the frame `mission` (ENU) |
//! | `/vehicle_i/pose` | `foxglove.PoseInFrame` | each sample; the antenna's attitude, jitter included |
//! | `/vehicle_i/location` | `foxglove.LocationFix` | each sample, where the mission has an origin; altitude above mean sea level |
//! | `/vehicle_i/antenna` | `veilwing.Antenna` | each sample: where it is, its axis, which is its null, and the paper's angles |
//! | `/vehicle_i/state` | `veilwing.State` | each sample: phase, mode, armed, landed, battery |
//! | `/vehicle_i/power` | `veilwing.Power` | each sample; slot -1 while silent |
//! | `/scene` | `foxglove.SceneUpdate` | once: area, no-fly areas, users, eavesdroppers; axes and null cones, which follow `/tf` |
//! | `/radio/sinr` | `veilwing.Sinr` | each sample, where the channel is known; 0 while I is silent |
//! | `/radio/secrecy` | `veilwing.SecrecyRate` | the same |
//! | `/pair/lease` | `veilwing.Lease` | each request, grant and giving up in the pair's telemetry log |
//! | `/events` | `foxglove.Log` | each event but violations |
//! | `/violations` | `foxglove.Log` | each violation (ERROR, named by its invariant); one that does not count is a WARNING |
//!
//! and J's as I's. Every channel is there, also one without a message: no violation is an empty channel. Messages are
//! Protocol Buffers, since rerun takes nothing apart that is JSON. A time is UTC where the flight knows it, else it counts from
//! the flight's beginning, at 1970; both in nanoseconds. The same flight makes the same bytes.

mod messages;
mod protobuf;
mod scene;
mod schemas;

use std::collections::BTreeMap;
use std::io::Cursor;

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{Attachment, McapError, WriteOptions, Writer};

use super::telemetry::Lease;
use super::timeline::{EventKind, Timeline};
use crate::role::{PerVehicle, Role};
use messages::Moment;
use protobuf::{Message, Type};

/// A file that goes along with a flight.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attached {
    /// Its name.
    pub name: String,
    /// What it is.
    pub media_type: &'static str,
    /// All of it.
    pub data: Vec<u8>,
}

/// Names of the files of a flight's directory that go along with it.
pub const ATTACHED: [(&str, &str); 4] = [
    ("mission.toml", "application/toml"),
    ("plan.json", "application/json"),
    ("scene.json", "application/json"),
    ("summary.json", "application/json"),
];

/// A channel: its topic and the type of its messages.
type Channel = (String, &'static Type);

/// Messages in the order of time, each with its instant and its channel.
#[derive(Debug, Default)]
struct Recording {
    channels: Vec<Channel>,
    messages: Vec<(u64, u16, Vec<u8>)>,
}

impl Recording {
    fn channel(&mut self, topic: &str, of: &'static Type) -> u16 {
        self.channels.push((topic.to_owned(), of));
        // Channels are counted from 1; there are two dozen.
        self.channels.len() as u16
    }

    fn add(&mut self, moment: Moment, channel: u16, message: Message) {
        self.messages.push((moment.0, channel, message.finish()));
    }
}

/// A vehicle's channels.
#[derive(Debug, Clone, Copy)]
struct Own {
    pose: u16,
    location: u16,
    antenna: u16,
    state: u16,
    power: u16,
}

/// The whole file.
///
/// # Errors
/// [`McapError`]: something in it is larger than the format can say.
pub fn mcap(timeline: &Timeline, leases: &[Lease], attached: &[Attached]) -> Result<Vec<u8>, McapError> {
    let mut recording = record(timeline, leases);
    recording.messages.sort_by_key(|(at, channel, _)| (*at, *channel));
    let mut bytes = Vec::new();
    let options =
        WriteOptions::new().compression(None).library(concat!("veilwing ", env!("CARGO_PKG_VERSION")));
    let mut writer = Writer::with_options(Cursor::new(&mut bytes), options)?;
    for (topic, of) in &recording.channels {
        let schema = writer.add_schema(of.name, "protobuf", &of.descriptors())?;
        writer.add_channel(schema, topic, "protobuf", &BTreeMap::new())?;
    }
    writer.write_metadata(&Metadata { name: "veilwing".to_owned(), metadata: metadata(timeline) })?;
    let begins = Moment::of(timeline, 0.0).0;
    for file in attached {
        writer.attach(&Attachment {
            log_time: begins,
            create_time: begins,
            name: file.name.clone(),
            media_type: file.media_type.to_owned(),
            data: file.data.as_slice().into(),
        })?;
    }
    let mut sequences = vec![0; recording.channels.len() + 1];
    for (at, channel, data) in &recording.messages {
        let sequence = &mut sequences[usize::from(*channel)];
        let (log_time, publish_time, channel_id) = (*at, *at, *channel);
        let header = MessageHeader { channel_id, sequence: *sequence, log_time, publish_time };
        writer.write_to_known_channel(&header, data)?;
        *sequence += 1;
    }
    writer.finish()?;
    drop(writer);
    Ok(bytes)
}

fn metadata(timeline: &Timeline) -> BTreeMap<String, String> {
    let scene = &timeline.scene;
    let summary = timeline.summary.as_ref();
    let time = match scene.started_utc_us {
        Some(_) => "UTC",
        None => "nanoseconds since the flight's beginning",
    };
    let all = [
        ("mission", Some(scene.mission.clone())),
        ("mission_digest", scene.mission_digest.clone()),
        ("plan_digest", summary.and_then(|summary| summary.plan_digest.clone())),
        ("seed", scene.seed.map(|seed| seed.to_string())),
        ("source", Some(messages::source(scene.source).to_owned())),
        ("result", summary.map(|summary| summary.result.clone())),
        ("time", Some(time.to_owned())),
        ("veilwing_version", Some(env!("CARGO_PKG_VERSION").to_owned())),
    ];
    all.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?))).collect()
}

fn record(timeline: &Timeline, leases: &[Lease]) -> Recording {
    let mut recording = Recording::default();
    let transforms = recording.channel("/tf", &schemas::FRAME_TRANSFORMS);
    let own = PerVehicle::from_fn(|role| {
        let mut of = |name: &str, of| recording.channel(&format!("/{}/{name}", messages::frame(role)), of);
        Own {
            pose: of("pose", &schemas::POSE_IN_FRAME),
            location: of("location", &schemas::LOCATION_FIX),
            antenna: of("antenna", &schemas::ANTENNA),
            state: of("state", &schemas::STATE),
            power: of("power", &schemas::POWER),
        }
    });
    let scene = recording.channel("/scene", &schemas::SCENE_UPDATE);
    let sinr = recording.channel("/radio/sinr", &schemas::SINR);
    let secrecy = recording.channel("/radio/secrecy", &schemas::SECRECY);
    let lease = recording.channel("/pair/lease", &schemas::LEASE);
    let events = recording.channel("/events", &schemas::LOG);
    let violations = recording.channel("/violations", &schemas::LOG);

    let begins = Moment::of(timeline, timeline.samples.first().map_or(0.0, |sample| sample.at_s));
    recording.add(begins, scene, scene::update(timeline, begins));
    let mut phases = messages::Phases::new(&timeline.events);
    for sample in &timeline.samples {
        let at = Moment::of(timeline, sample.at_s);
        phases.advance(sample.at_s);
        let known = |role: Role| sample.vehicles[role].as_ref().map(|state| (role, state));
        let vehicles: Vec<_> = Role::BOTH.into_iter().filter_map(known).collect();
        if !vehicles.is_empty() {
            recording.add(at, transforms, messages::transforms(at, &vehicles));
        }
        for (role, state) in vehicles {
            let own = own[role];
            recording.add(at, own.pose, messages::pose_in_frame(at, state));
            if let Some(origin) = timeline.scene.origin {
                recording.add(at, own.location, messages::location(at, role, state, origin));
            }
            recording.add(at, own.antenna, messages::antenna(at, state));
            recording.add(at, own.state, messages::state(at, state, phases.of(role)));
            recording.add(at, own.power, messages::power(at, state));
        }
        if timeline.scene.radio.is_some() {
            recording.add(at, sinr, messages::sinr(at, &timeline.scene, sample));
            recording.add(at, secrecy, messages::secrecy(at, &timeline.scene, sample));
        }
    }
    for said in leases {
        let at = Moment::of(timeline, said.at_s);
        recording.add(at, lease, messages::lease(at, said));
    }
    for event in &timeline.events {
        let judged = matches!(event.kind, EventKind::Violation | EventKind::Excused);
        let at = Moment::of(timeline, event.at_s);
        recording.add(at, if judged { violations } else { events }, messages::log(at, event));
    }
    recording
}
