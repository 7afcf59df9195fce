//! The messages.

use nalgebra::{UnitQuaternion, Vector3};

use super::protobuf::Message;
use crate::desk::report::telemetry::{Lease, Said};
use crate::desk::report::timeline::{
    Event, EventKind, OriginScene, Sample, Scene, Severity, Source, Timeline, VehicleState,
};
use crate::geo::{Enu, Geodetic};
use crate::role::{PerVehicle, Role};

/// The mission's frame: east, north, up.
pub(super) const MISSION: &str = "mission";

/// An instant, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Moment(pub u64);

impl Moment {
    /// Flight seconds, after the flight's beginning where its UTC is known.
    pub fn of(timeline: &Timeline, at_s: f64) -> Self {
        let begins = timeline.scene.started_utc_us.unwrap_or(0).saturating_mul(1000);
        Self(begins.saturating_add((at_s * 1e9).round() as u64))
    }

    /// As `google.protobuf.Timestamp`.
    pub fn message(self) -> Message {
        let seconds = self.0 / 1_000_000_000;
        Message::default()
            .integer(1, seconds.cast_signed())
            .integer(2, (self.0 % 1_000_000_000).cast_signed())
    }
}

/// A message that begins with its instant.
fn at(moment: Moment) -> Message {
    Message::default().message(1, &moment.message())
}

/// A vehicle's own frame.
pub(super) fn frame(role: Role) -> &'static str {
    match role {
        Role::I => "vehicle_i",
        Role::J => "vehicle_j",
    }
}

pub(super) fn source(source: Source) -> &'static str {
    match source {
        Source::Simulation => "simulation",
        Source::Telemetry => "telemetry",
    }
}

pub(super) fn vector(v: &Vector3<f64>) -> Message {
    Message::default().double(1, v.x).double(2, v.y).double(3, v.z)
}

pub(super) fn quaternion(q: &UnitQuaternion<f64>) -> Message {
    Message::default().double(1, q.i).double(2, q.j).double(3, q.k).double(4, q.w)
}

pub(super) fn pose(position: &Vector3<f64>, rotation: &UnitQuaternion<f64>) -> Message {
    Message::default().message(1, &vector(position)).message(2, &quaternion(rotation))
}

pub(super) fn transforms(moment: Moment, vehicles: &[(Role, &VehicleState)]) -> Message {
    let transforms = vehicles.iter().map(|(role, state)| {
        at(moment)
            .text(2, MISSION)
            .text(3, frame(*role))
            .message(4, &vector(&state.position_enu_m.into()))
            .message(5, &quaternion(&state.attitude.rotation()))
    });
    Message::default().messages(1, transforms)
}

pub(super) fn pose_in_frame(moment: Moment, state: &VehicleState) -> Message {
    let pose = pose(&state.position_enu_m.into(), &state.attitude.rotation());
    at(moment).text(2, MISSION).message(3, &pose)
}

pub(super) fn location(moment: Moment, role: Role, state: &VehicleState, origin: OriginScene) -> Message {
    let origin = Geodetic { lat_deg: origin.lat_deg, lon_deg: origin.lon_deg, alt_m: origin.alt_amsl_m };
    let place = Geodetic::from_enu(Enu::from(state.position_enu_m), origin);
    let colour = match role {
        Role::I => [0.0, 0.45, 0.7],
        Role::J => [0.83, 0.37, 0.0],
    };
    Message::default()
        .message(6, &moment.message())
        .text(7, frame(role))
        .double(1, place.lat_deg)
        .double(2, place.lon_deg)
        .double(3, place.alt_m)
        // Not known.
        .doubles(4, &[0.0; 9])
        .integer(5, 0)
        .message(8, &colour_of(colour, 1.0))
}

pub(super) fn colour_of([r, g, b]: [f64; 3], opacity: f64) -> Message {
    Message::default().double(1, r).double(2, g).double(3, b).double(4, opacity)
}

pub(super) fn antenna(moment: Moment, state: &VehicleState) -> Message {
    let (roll, pitch, yaw) = state.attitude.euler();
    at(moment)
        .message(2, &vector(&state.position_enu_m.into()))
        .message(3, &vector(&state.attitude.antenna_axis()))
        .double(4, roll.to_degrees())
        .double(5, pitch.to_degrees())
        .double(6, yaw.to_degrees())
}

pub(super) fn state(moment: Moment, state: &VehicleState, phase: &str) -> Message {
    at(moment)
        .text(2, phase)
        .text(3, &state.mode)
        .flag(4, state.armed)
        .flag(5, state.landed)
        .double(6, state.battery.map_or(f64::NAN, |share| 100.0 * share))
}

/// A slot's number, or -1 for none.
fn slot(slot: Option<u16>) -> i64 {
    slot.map_or(-1, i64::from)
}

pub(super) fn power(moment: Moment, state: &VehicleState) -> Message {
    at(moment)
        .flag(2, state.tx_power_w.is_some())
        .double(3, state.tx_power_w.unwrap_or(0.0))
        .integer(4, slot(state.slot))
}

/// The slot that I serves at an instant, and its user.
fn served<'a>(scene: &'a Scene, sample: &Sample) -> (Option<u16>, &'a str) {
    let number = sample.vehicles.i.as_ref().and_then(|i| i.slot).filter(|_| sample.heard.is_some());
    let planned = number.and_then(|number| scene.slots.get(usize::from(number)));
    (number, planned.map_or("", |slot| slot.user.as_str()))
}

pub(super) fn sinr(moment: Moment, scene: &Scene, sample: &Sample) -> Message {
    let heard = sample.heard.as_ref();
    let of = |k: usize| heard.and_then(|heard| heard.eavesdropper_sinr.get(k)).copied().unwrap_or(0.0);
    let each = scene.eavesdroppers.iter().enumerate();
    let each = each.map(|(k, e)| Message::default().text(1, &e.name).double(2, of(k)));
    let strongest = (0..scene.eavesdroppers.len()).map(of).fold(0.0, f64::max);
    at(moment)
        .flag(2, heard.is_some())
        .text(3, served(scene, sample).1)
        .double(4, heard.map_or(0.0, |heard| heard.user_sinr))
        .messages(5, each)
        .double(6, strongest)
}

pub(super) fn secrecy(moment: Moment, scene: &Scene, sample: &Sample) -> Message {
    let (number, user) = served(scene, sample);
    at(moment)
        .flag(2, sample.heard.is_some())
        .integer(3, slot(number))
        .text(4, user)
        .double(5, sample.heard.as_ref().map_or(0.0, |heard| heard.secrecy_rate_bps))
}

pub(super) fn lease(moment: Moment, said: &Lease) -> Message {
    let what = match said.what {
        Said::Asked => 0,
        Said::Granted => 1,
        Said::GivenUp => 2,
    };
    at(moment)
        .integer(2, what)
        .integer(3, said.slot.into())
        .integer(4, said.duration_ms.into())
        .double(5, said.left_s)
}

pub(super) fn log(moment: Moment, event: &Event) -> Message {
    let level = match event.severity {
        Severity::Info => 2,
        Severity::Warning => 3,
        Severity::Error => 4,
    };
    let kind = match event.kind {
        EventKind::Fault => "fault",
        EventKind::FaultOver => "fault-over",
        EventKind::Notice => "notice",
        EventKind::Process => "process",
        EventKind::Violation => "violation",
        EventKind::Excused => "excused",
    };
    let name = match (&event.code, event.vehicle) {
        (Some(code), _) if matches!(event.kind, EventKind::Violation | EventKind::Excused) => code.clone(),
        (_, Some(role)) => format!("{}/{kind}", frame(role)),
        (_, None) => kind.to_owned(),
    };
    at(moment).integer(2, level).text(3, &event.text).text(4, &name).text(5, kind).fixed32(6, 0)
}

/// Which phase each companion last said to be in.
#[derive(Debug)]
pub(super) struct Phases<'a> {
    events: std::iter::Peekable<std::slice::Iter<'a, Event>>,
    now: PerVehicle<&'a str>,
}

impl<'a> Phases<'a> {
    pub fn new(events: &'a [Event]) -> Self {
        Self { events: events.iter().peekable(), now: PerVehicle { i: "", j: "" } }
    }

    /// What has been said up to an instant.
    pub fn advance(&mut self, at_s: f64) {
        while let Some(event) = self.events.next_if(|event| event.at_s <= at_s) {
            if let (Some(role), Some(phase)) = (event.vehicle, event.phase.as_deref()) {
                self.now[role] = phase;
            }
        }
    }

    pub fn of(&self, role: Role) -> &'a str {
        self.now[role]
    }
}
