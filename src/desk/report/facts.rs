//! What follows from a timeline: who was on the air when, what went wrong, how each slot went.

use super::said::{Said, gives_up, is_failsafe};
use super::timeline::{Event, EventKind, Severity, SlotSummary, Timeline, VehicleState};
use crate::geo::Pose;
use crate::role::{PerVehicle, Role};

/// What is said this soon after an emission may be about its end.
pub const AFTERWARDS_S: f64 = 0.5;

/// An autopilot's failsafe this soon before or after a companion gives up is why it does.
const FAILSAFE_S: f64 = 1.0;

/// A vehicle of which nothing is known for this long before the end is told of in the past.
const LOST_S: f64 = 1.0;

/// A stretch of time in which one vehicle radiated, for one slot at one power.
#[derive(Debug, Clone, PartialEq)]
pub struct Emission {
    /// Who.
    pub role: Role,
    /// For which slot.
    pub slot: Option<u16>,
    /// First sample on the air, flight seconds.
    pub from_s: f64,
    /// First sample off the air; the end of the record if it was still on.
    pub until_s: f64,
    /// Watts.
    pub power_w: f64,
    /// Whether it was seen to end.
    pub ended: bool,
}

/// Something that a reader of the charts looks for; marked by its number in all of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// From 1.
    pub number: usize,
    /// Flight seconds.
    pub at_s: f64,
    /// Index among the timeline's events.
    pub event: usize,
}

/// How one slot of the plan went.
#[derive(Debug, Clone, PartialEq)]
pub struct SlotRun {
    /// From 0, over superframes.
    pub number: u16,
    /// The user served; empty if unknown.
    pub user: String,
    /// First emission for it to the last; `None` if nobody radiated for it.
    pub window_s: Option<[f64; 2]>,
    /// The plan's expectation, bit/s.
    pub planned_bps: Option<f64>,
    /// Mean while I radiated, bit/s; `None` if it did not, or if rates are unknown.
    pub achieved_bps: Option<f64>,
    /// Of that mean; only the simulated world knows.
    pub standard_error_bps: Option<f64>,
    /// Seconds on the air.
    pub radiated_s: PerVehicle<f64>,
    /// I on the air without J.
    pub unprotected_s: f64,
    /// Off the planned position while radiating.
    pub position_rms_m: PerVehicle<Option<f64>>,
    /// Off the planned attitude while radiating, jitter included.
    pub attitude_rms_deg: PerVehicle<Option<f64>>,
}

/// A timeline and what follows from it.
#[derive(Debug)]
pub struct Facts<'a> {
    /// The flight.
    pub timeline: &'a Timeline,
    /// In the order of their beginnings.
    pub emissions: Vec<Emission>,
    /// Injected faults; if none, the event that led to the flight's end, or else the first warning of the flight.
    pub marks: Vec<Mark>,
    /// The plan's slots, and those flown without a plan.
    pub slots: Vec<SlotRun>,
    /// The end of the record, flight seconds.
    pub end_s: f64,
}

impl<'a> Facts<'a> {
    /// Looks through a timeline.
    #[must_use]
    pub fn new(timeline: &'a Timeline) -> Self {
        let mut emissions: Vec<Emission> =
            Role::BOTH.into_iter().flat_map(|role| emissions(timeline, role)).collect();
        emissions.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
        let marks = marks(&timeline.events);
        let end_s = timeline.end_s();
        let mut facts = Self { timeline, emissions, marks, slots: Vec::new(), end_s };
        let known = facts.emissions.iter().filter_map(|e| e.slot.map(|slot| usize::from(slot) + 1));
        let count = known.chain([timeline.scene.slots.len()]).max().unwrap_or(0);
        facts.slots = (0..count).filter_map(|k| u16::try_from(k).ok()).map(|k| facts.slot(k)).collect();
        facts
    }

    /// Event behind a mark.
    #[must_use]
    pub fn event(&self, mark: &Mark) -> &Event {
        &self.timeline.events[mark.event]
    }

    /// The emission of a vehicle that was going on at `at_s`.
    #[must_use]
    pub fn on_air(&self, role: Role, at_s: f64) -> Option<&Emission> {
        self.emissions.iter().find(|e| e.role == role && e.from_s <= at_s && at_s < e.until_s)
    }

    /// What a vehicle's state was last known to be, and when.
    #[must_use]
    pub fn last_state(&self, role: Role) -> Option<(f64, &VehicleState)> {
        let mut backwards = self.timeline.samples.iter().rev();
        backwards.find_map(|sample| Some((sample.at_s, sample.vehicles[role].as_ref()?)))
    }

    /// Whether a vehicle's record ends before the flight's.
    #[must_use]
    pub fn is_lost(&self, role: Role) -> bool {
        self.last_state(role).is_some_and(|(at_s, _)| at_s + LOST_S < self.end_s)
    }

    /// Whether something went wrong while somebody was on the air for a slot.
    #[must_use]
    pub fn is_disturbed(&self, run: &SlotRun) -> bool {
        let Some([from_s, until_s]) = run.window_s else { return false };
        self.timeline.events.iter().any(|event| {
            let bad = event.severity >= Severity::Warning || event.kind == EventKind::Fault;
            bad && event.at_s >= from_s && event.at_s < until_s + AFTERWARDS_S
        })
    }

    /// Slots in which I was on the air: undisturbed, and disturbed.
    #[must_use]
    pub fn served(&self) -> (usize, usize) {
        let on_air = || self.slots.iter().filter(|run| run.radiated_s.i > 0.0);
        let disturbed = on_air().filter(|run| self.is_disturbed(run)).count();
        (on_air().count() - disturbed, disturbed)
    }

    /// Seconds in which I radiated while J did not, in all.
    #[must_use]
    pub fn unprotected_s(&self) -> f64 {
        self.slots.iter().map(|slot| slot.unprotected_s).sum()
    }

    fn slot(&self, number: u16) -> SlotRun {
        let planned = self.timeline.scene.slots.get(usize::from(number));
        let own = || self.emissions.iter().filter(move |e| e.slot == Some(number));
        let from_s = own().map(|e| e.from_s).fold(f64::INFINITY, f64::min);
        let until_s = own().map(|e| e.until_s).fold(f64::NEG_INFINITY, f64::max);
        let on_air = |role| own().filter(|e| e.role == role).fold(0.0, |sum, e| sum + e.until_s - e.from_s);
        let mut run = SlotRun {
            number,
            user: planned.map_or_else(String::new, |slot| slot.user.clone()),
            window_s: (from_s < until_s).then_some([from_s, until_s]),
            planned_bps: planned.and_then(|slot| slot.secrecy_rate_bps),
            achieved_bps: None,
            standard_error_bps: None,
            radiated_s: PerVehicle::from_fn(on_air),
            unprotected_s: 0.0,
            position_rms_m: PerVehicle::default(),
            attitude_rms_deg: PerVehicle::default(),
        };
        match self.timeline.summary.as_ref().and_then(|summary| summary.slots.get(usize::from(number))) {
            Some(measured) => take_over(&mut run, measured),
            None => self.measure(&mut run),
        }
        run
    }

    /// From the samples, where nobody has measured it better.
    fn measure(&self, run: &mut SlotRun) {
        let mut rate = Mean::default();
        let mut errors: [[Mean; 2]; 2] = Default::default();
        for (sample, next) in self.timeline.samples.iter().zip(self.timeline.samples.iter().skip(1)) {
            let lasts_s = next.at_s - sample.at_s;
            let radiates = |role: Role| {
                let state = sample.vehicles[role].as_ref();
                state.is_some_and(|v| v.tx_power_w.is_some() && v.slot == Some(run.number))
            };
            if radiates(Role::I) && !radiates(Role::J) {
                run.unprotected_s += lasts_s;
            }
            if let Some(heard) = sample.heard.as_ref().filter(|_| radiates(Role::I)) {
                rate.add(heard.secrecy_rate_bps, lasts_s);
            }
            for role in Role::BOTH.into_iter().filter(|&role| radiates(role)) {
                if let Some(error) = self.pose_error(run.number, role, sample.vehicles[role].as_ref()) {
                    let [position, attitude] = &mut errors[role as usize];
                    position.add(error.position_m.powi(2), lasts_s);
                    attitude.add(error.attitude_deg.powi(2), lasts_s);
                }
            }
        }
        run.achieved_bps = rate.get();
        run.position_rms_m = PerVehicle::from_fn(|role| errors[role as usize][0].get().map(f64::sqrt));
        run.attitude_rms_deg = PerVehicle::from_fn(|role| errors[role as usize][1].get().map(f64::sqrt));
    }

    /// How far a vehicle is from a slot's planned pose; `None` if either is unknown.
    #[must_use]
    pub fn pose_error(&self, slot: u16, role: Role, state: Option<&VehicleState>) -> Option<PoseError> {
        let planned = &self.timeline.scene.slots.get(usize::from(slot))?.vehicles[role];
        let state = state?;
        let pose = Pose {
            position_enu_m: planned.position_enu_m.into(),
            roll_rad: planned.roll_rad,
            pitch_rad: planned.pitch_rad,
            yaw_rad: planned.yaw_rad,
        };
        let off = pose.position_enu_m - nalgebra::Vector3::from(state.position_enu_m);
        let angle = |attitude: &crate::geo::Attitude| attitude.angle_to(&pose.attitude()).to_degrees();
        Some(PoseError {
            position_m: off.norm(),
            attitude_deg: angle(&state.attitude),
            held_deg: state.held.as_ref().map(angle),
        })
    }
}

/// How far a vehicle is from its planned pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError {
    /// Metres.
    pub position_m: f64,
    /// Angle of the rotation between the two, jitter included, degrees.
    pub attitude_deg: f64,
    /// The same without the jitter.
    pub held_deg: Option<f64>,
}

/// A mean over time.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    weight: f64,
}

impl Mean {
    fn add(&mut self, value: f64, weight: f64) {
        self.sum += value * weight;
        self.weight += weight;
    }

    fn get(self) -> Option<f64> {
        (self.weight > 0.0).then(|| self.sum / self.weight)
    }
}

fn take_over(run: &mut SlotRun, measured: &SlotSummary) {
    let served = measured.radiated_s.i > 0.0;
    if run.user.is_empty() {
        run.user.clone_from(&measured.user);
    }
    run.planned_bps = run.planned_bps.or(measured.planned_secrecy_rate_bps);
    run.achieved_bps = measured.achieved_secrecy_rate_bps.filter(|_| served);
    run.standard_error_bps = measured.standard_error_bps.filter(|_| served);
    run.radiated_s = measured.radiated_s;
    run.unprotected_s = measured.unprotected_s;
    run.position_rms_m = measured.position_rms_m;
    run.attitude_rms_deg = measured.attitude_rms_deg;
}

fn emissions(timeline: &Timeline, role: Role) -> Vec<Emission> {
    let mut all: Vec<Emission> = Vec::new();
    let mut on = false;
    for sample in &timeline.samples {
        let state = sample.vehicles[role].as_ref();
        let power_w = state.and_then(|state| state.tx_power_w);
        let slot = state.and_then(|state| state.slot);
        let last = all.last_mut().filter(|_| on);
        let goes_on = last.as_ref().is_some_and(|e| Some(e.power_w) == power_w && e.slot == slot);
        if let Some(last) = last {
            last.until_s = sample.at_s;
            last.ended = !goes_on;
        }
        on = power_w.is_some();
        if let Some(power_w) = power_w.filter(|_| !goes_on) {
            let at_s = sample.at_s;
            all.push(Emission { role, slot, from_s: at_s, until_s: at_s, power_w, ended: false });
        }
    }
    all
}

/// The event that led to the end of a flight that was given up: the first word that a companion gives up, or the autopilot's of
/// its own failsafe where that is why.
pub fn ending(events: &[Event]) -> Option<usize> {
    let notices = || events.iter().enumerate().filter(|(_, event)| event.kind == EventKind::Notice);
    let (index, given_up) = notices().find(|(_, event)| gives_up(&event.text))?;
    let failsafe = notices()
        .find(|(_, event)| is_failsafe(&event.text) && (event.at_s - given_up.at_s).abs() <= FAILSAFE_S);
    Some(failsafe.map_or(index, |(failsafe, _)| failsafe))
}

fn marks(events: &[Event]) -> Vec<Mark> {
    let of = |wanted: fn(&Event) -> bool| {
        let found = events.iter().enumerate().filter(move |(_, event)| wanted(event));
        found.map(|(event, e)| (event, e.at_s)).collect::<Vec<_>>()
    };
    let mut found = of(|event| event.kind == EventKind::Fault);
    if found.is_empty() {
        // What a preflight warns of has led to nothing: the vehicles took off.
        found = of(|event| {
            ![EventKind::Violation, EventKind::Excused].contains(&event.kind)
                && event.severity >= Severity::Warning
                && !matches!(Said::of(&event.text), Said::Warned(_))
        });
        let ended = ending(events).map(|event| (event, events[event].at_s));
        found = ended.or_else(|| found.first().copied()).into_iter().collect();
    }
    let numbered = found.into_iter().enumerate();
    numbered.map(|(k, (event, at_s))| Mark { number: k + 1, at_s, event }).collect()
}
