//! A flight from the telemetry logs of its two companions alone: `i-autopilot.tlog`, `i-pair.tlog` and J's, and
//! `i-transmitter.tlog` where the radio has a link of its own.
//!
//! What a log cannot know is not made up: a vehicle without a log is absent, powers are those that transmitters
//! acknowledged, and rates follow from the vehicles' own estimates by the mission's model. Where a mission file and a plan
//! are at hand, they give nodes, users' names and planned rates; poses and powers of the slots are in the logs themselves.

mod leases;
mod scene;
mod vehicle;

use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::directory::RecordError;
use super::timeline::{Event, EventKind, Heard, Sample, Scene, Severity, Timeline, VehicleState};
use crate::config::Mission;
use crate::link::tlog::{TlogError, TlogReader};
use crate::link::{Aboard, Envelope, RawFrame};
use crate::pair::wire;
use crate::radio::antenna::Pattern;
use crate::radio::fading::Rician;
use crate::radio::link::{Transmitter, sinr};
use crate::radio::secrecy;
use crate::role::{PerVehicle, Role};
use crate::transmitter::wire::MavMessage as RadioMessage;
pub use leases::{Lease, Said, leases};
use vehicle::Tracker;

/// The timeline has a sample this often.
const EVERY_US: u64 = 50_000;
/// A vehicle whose log has ended, or has a gap, is unknown after this time.
const STALE_US: u64 = 2_000_000;

/// Why logs make no flight.
#[derive(Debug, thiserror::Error)]
pub enum TelemetryError {
    /// A log that is none.
    #[error("{}: {source}", path.display())]
    Log {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        source: TlogError,
    },
    /// No log of either vehicle.
    #[error(
        "{}: neither a recorded flight (scene.json, timeline.csv, events.jsonl) nor telemetry logs (i-autopilot.tlog, i-pair.tlog, j-autopilot.tlog, j-pair.tlog): give the directory that `veilwing sitl --out` or a companion's [log] dir wrote",
        directory.display()
    )]
    Nothing {
        /// Where they should be.
        directory: PathBuf,
    },
    /// Logs without a single position.
    #[error("{}: no position of either vehicle in the telemetry logs: nothing to report", directory.display())]
    NoPosition {
        /// Where they are.
        directory: PathBuf,
    },
    /// A plan beside the logs that cannot be read.
    #[error(transparent)]
    Plan(#[from] RecordError),
}

/// One vehicle's logs.
#[derive(Debug, Default)]
struct Logs {
    /// With the radio's.
    autopilot: Vec<(u64, RawFrame)>,
    pair: Vec<(u64, RawFrame)>,
}

/// The flight that a directory's logs tell of.
///
/// # Errors
/// [`TelemetryError`]. A log whose writer was cut off is read as far as it goes, and the report says so.
pub fn load(directory: &Path, mission: Option<&Mission>) -> Result<Timeline, TelemetryError> {
    let mut events = Vec::new();
    let mut read = |role: Role| -> Result<Logs, TelemetryError> {
        let name = role.key();
        let mut log = |link| frames(&directory.join(format!("{name}-{link}.tlog")), role, &mut events);
        let (mut autopilot, pair) = (log("autopilot")?, log("pair")?);
        let radio = log("transmitter")?;
        if !radio.is_empty() {
            autopilot.extend(radio);
            autopilot.sort_by_key(|(us, _)| *us);
        }
        Ok(Logs { autopilot, pair })
    };
    let logs = PerVehicle { i: read(Role::I)?, j: read(Role::J)? };
    let stamps = Role::BOTH
        .into_iter()
        .flat_map(|role| [&logs[role].autopilot, &logs[role].pair].map(|log| log.first().map(|(us, _)| *us)));
    let Some(zero_us) = stamps.flatten().min() else {
        return Err(TelemetryError::Nothing { directory: directory.to_owned() });
    };
    let mut scene = scene::scene(directory, mission)?;
    scene.started_utc_us = Some(zero_us);
    let pair = Role::BOTH.into_iter().flat_map(|role| logs[role].pair.iter());
    scene::take_proposals(&mut scene, pair, directory, mission)?;
    let tracks = PerVehicle::from_fn(|role| track(role, &logs[role], zero_us, mission, &mut events));
    let samples = merge(&tracks, &scene);
    if samples.iter().all(|sample| sample.vehicles.i.is_none() && sample.vehicles.j.is_none()) {
        return Err(TelemetryError::NoPosition { directory: directory.to_owned() });
    }
    for event in events.iter_mut().filter(|event| event.at_s.is_infinite()) {
        event.at_s = samples.last().map_or(0.0, |sample| sample.at_s);
    }
    events.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Ok(Timeline { scene, samples, events, summary: None })
}

/// The frames of a log; none if it is not there. What is cut off at its end becomes an event at the flight's end.
fn frames(path: &Path, role: Role, events: &mut Vec<Event>) -> Result<Vec<(u64, RawFrame)>, TelemetryError> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let failed = |source| TelemetryError::Log { path: path.to_owned(), source };
    let mut frames = Vec::new();
    for record in TlogReader::open(path).map_err(failed)? {
        match record {
            Ok((utc, frame)) => frames.push((utc.unix_us, frame)),
            // A power cut leaves half a record, or a block that was never written. What is no log from its beginning is none.
            Err(error @ (TlogError::Truncated { .. } | TlogError::Damaged { .. }))
                if !frames.is_empty() || matches!(error, TlogError::Truncated { .. }) =>
            {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                let mut event = notice(f64::INFINITY, role, Severity::Warning, String::new());
                event.kind = EventKind::Process;
                event.text = match error {
                    TlogError::Damaged { offset } => {
                        format!("log {name} is damaged at byte {offset}: read up to there")
                    }
                    _ => format!("log {name} ends inside a record: its writer was cut off"),
                };
                events.push(event);
            }
            Err(error) => return Err(failed(error)),
        }
    }
    // Two threads of a companion may stamp a few microseconds out of order.
    frames.sort_by_key(|(us, _)| *us);
    Ok(frames)
}

fn notice(at_s: f64, role: Role, severity: Severity, text: String) -> Event {
    Event { at_s, kind: EventKind::Notice, vehicle: Some(role), severity, phase: None, code: None, text }
}

/// A vehicle's states, each with its instant; `None` where it is no longer known.
type Track = Vec<(u64, Option<VehicleState>)>;

fn track(role: Role, logs: &Logs, zero_us: u64, mission: Option<&Mission>, events: &mut Vec<Event>) -> Track {
    let mut tracker = Tracker::new(mission.map(|mission| mission.origin));
    let mut track = Track::new();
    let mut next_us = zero_us;
    let mut pair = logs.pair.iter().peekable();
    let mut last_us = zero_us;
    for (us, frame) in &logs.autopilot {
        // Where there is no mission file, the pair's own messages tell positions in its frame.
        while let Some((_, other)) = pair.next_if(|(at, _)| at <= us) {
            if let Ok(status) = other.parse::<Envelope>()
                && let wire::MavMessage::VEILWING_STATUS(status_data) = status.message.message()
            {
                tracker.pair_status(status.header, status_data.position_enu_m);
            }
        }
        if *us > last_us + STALE_US {
            track.push((last_us + STALE_US, None));
        }
        last_us = *us;
        if let Some(at) = tracker.expire(*us) {
            track.push((at, tracker.state()));
        }
        let Ok(parsed) = frame.parse::<Aboard>() else { continue };
        let seconds = (us - zero_us) as f64 * 1e-6;
        match &parsed.message {
            Aboard::Common(message) => {
                if let Some((severity, text)) = tracker.handle(parsed.header, message, *us) {
                    events.push(notice(seconds, role, severity, text));
                }
            }
            Aboard::Radio(enclosed) => {
                let RadioMessage::VEILWING_RADIO(report) = enclosed.message();
                tracker.radio(report, *us);
            }
        }
        if *us >= next_us || tracker.changed() {
            track.push((*us, tracker.state()));
            next_us = us - (us - zero_us) % EVERY_US + EVERY_US;
        }
    }
    // A companion that was killed leaves a radio that is on until its last command's expiry.
    if let Some(at) = tracker.expire(u64::MAX) {
        track.push((at, tracker.state()));
    }
    if !logs.autopilot.is_empty() {
        track.push((last_us.max(track.last().map_or(0, |(at, _)| *at)) + STALE_US, None));
    }
    track.sort_by_key(|(at, _)| *at);
    for (at, _) in &mut track {
        *at -= zero_us;
    }
    track
}

/// Both vehicles at every instant at which either is heard of.
fn merge(tracks: &PerVehicle<Track>, scene: &Scene) -> Vec<Sample> {
    let mut instants: Vec<u64> =
        Role::BOTH.into_iter().flat_map(|role| tracks[role].iter().map(|(at, _)| *at)).collect();
    instants.sort_unstable();
    instants.dedup();
    let mut at = PerVehicle { i: 0, j: 0 };
    let mut samples = Vec::with_capacity(instants.len());
    for instant in instants {
        let vehicles = PerVehicle::from_fn(|role| {
            let track = &tracks[role];
            while track.get(at[role]).is_some_and(|(next, _)| *next <= instant) {
                at[role] += 1;
            }
            at[role].checked_sub(1).and_then(|k| track[k].1.clone())
        });
        let heard = heard(scene, &vehicles);
        samples.push(Sample { at_s: instant as f64 * 1e-6, vehicles, heard });
    }
    // The end of the logs is the end of the flight, not the time at which they have become stale.
    let known = |sample: &Sample| sample.vehicles.i.is_some() || sample.vehicles.j.is_some();
    while samples.last().is_some_and(|sample| !known(sample)) {
        samples.pop();
    }
    samples
}

/// What the mission's model says is heard of I.
fn heard(scene: &Scene, vehicles: &PerVehicle<Option<VehicleState>>) -> Option<Heard> {
    let radio = scene.radio?;
    let (i, j) = (vehicles.i.as_ref()?, vehicles.j.as_ref()?);
    i.tx_power_w?;
    let name = &scene.slots.get(usize::from(i.slot?))?.user;
    let user = scene.users.iter().find(|user| user.name == *name)?;
    let [i, j] = [i, j].map(|state| Transmitter {
        position_enu_m: Vector3::from(state.position_enu_m),
        axis: state.attitude.antenna_axis(),
        tx_power_w: state.tx_power_w.unwrap_or(0.0),
        // A timeline says nothing of patterns: what is estimated is the ideal dipoles'.
        antenna: &Pattern::IDEAL,
    });
    let at = |node: [f64; 3]| {
        sinr(&i, &j, &Vector3::from(node), Rician::NONE, radio.reference_gain, radio.noise_power_w)
    };
    let user_sinr = at(user.position_enu_m);
    let eavesdropper_sinr: Vec<f64> = scene.eavesdroppers.iter().map(|e| at(e.position_enu_m)).collect();
    let secrecy_rate_bps =
        secrecy::rate_bps(radio.bandwidth_hz, user_sinr, eavesdropper_sinr.iter().copied());
    Some(Heard { user_sinr, eavesdropper_sinr, secrecy_rate_bps })
}
