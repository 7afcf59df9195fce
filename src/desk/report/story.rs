//! What happened, in plain words and in the order of time.
//!
//! Times and powers are those of the record; what a companion said is quoted as said.

use super::facts::{AFTERWARDS_S, Emission, Facts, SlotRun};
use super::said::Said;
use super::timeline::{Event, EventKind, Severity, Source};
use super::verdict::{headline, lead};
use super::words::{clause, gloss, instant, power, sentence, span, speaker};
use crate::desk::simulation::FaultKind;
use crate::role::Role;

/// A beat this long after a mark tells how long after.
const AFTERMATH_S: f64 = 30.0;
/// What both vehicles do or say within this time is told once.
const TOGETHER_S: f64 = 1.0;
/// A warning that comes again within this time is told with the one before it.
const AGAIN_S: f64 = 5.0;

/// How something is to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tone {
    /// As it should be.
    Good,
    /// Neither.
    Plain,
    /// A fault, a warning.
    Fault,
    /// The mission or its safety suffers.
    Bad,
}

/// One thing that happened.
#[derive(Debug, Clone, PartialEq)]
pub struct Beat {
    /// Flight seconds.
    pub at_s: f64,
    /// How to take it.
    pub tone: Tone,
    /// A sentence.
    pub text: String,
    /// The number of the mark that this is.
    pub mark: Option<usize>,
    /// The last mark before it and the seconds since then.
    pub since: Option<(usize, f64)>,
}

/// A flight as a story.
#[derive(Debug, Clone, PartialEq)]
pub struct Story {
    /// How it ended.
    pub tone: Tone,
    /// The same in a line.
    pub headline: String,
    /// The same in a paragraph.
    pub lead: String,
    /// In the order of time.
    pub beats: Vec<Beat>,
}

/// Tells a flight.
#[must_use]
pub fn tell(facts: &Facts) -> Story {
    let mut teller = Teller { facts, beats: Vec::new(), told: Vec::new() };
    teller.marks();
    teller.slots();
    teller.motion();
    teller.events();
    let mut beats = teller.beats;
    beats.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    for beat in &mut beats {
        let before = facts.marks.iter().rev().find(|mark| mark.at_s <= beat.at_s);
        beat.since = before
            .filter(|mark| beat.mark.is_none() && beat.at_s - mark.at_s <= AFTERMATH_S)
            .map(|mark| (mark.number, beat.at_s - mark.at_s));
    }
    beats.push(ending(facts));
    let (tone, headline) = headline(facts);
    Story { tone, headline, lead: lead(facts), beats }
}

/// What a vehicle was seen to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Motion<'a> {
    TookOff,
    Landed,
    /// Its autopilot's mode, before and after.
    Mode(&'a str, &'a str),
}

struct Teller<'a> {
    facts: &'a Facts<'a>,
    beats: Vec<Beat>,
    /// Indices of events that have been told.
    told: Vec<usize>,
}

impl Teller<'_> {
    fn say(&mut self, at_s: f64, tone: Tone, text: String) {
        self.beats.push(Beat { at_s, tone, text, mark: None, since: None });
    }

    fn marks(&mut self) {
        for mark in &self.facts.marks {
            let text = format!("{}.", sentence(&clause(self.facts.event(mark))));
            let (at_s, mark_number) = (mark.at_s, Some(mark.number));
            self.beats.push(Beat { at_s, tone: Tone::Fault, text, mark: mark_number, since: None });
            self.told.push(mark.event);
        }
    }

    fn slots(&mut self) {
        for run in &self.facts.slots {
            let Some([from_s, _]) = run.window_s else { continue };
            if self.facts.is_disturbed(run) {
                self.disturbed_slot(run);
            } else {
                let text = undisturbed_slot(self.facts, run);
                self.say(from_s, Tone::Good, text);
            }
        }
    }

    fn disturbed_slot(&mut self, run: &SlotRun) {
        let own = self.facts.emissions.iter().filter(|e| e.slot == Some(run.number));
        for emission in own {
            let Emission { role, from_s, until_s, .. } = *emission;
            let what = match role {
                Role::I => "went on the air",
                Role::J => "began to jam",
            };
            let power = power(emission.power_w);
            let text = format!("{}: vehicle {role} {what} with {power}.", sentence(&slot_name(run)));
            self.say(from_s, Tone::Plain, text);
            if emission.ended {
                let (tone, text) = self.silence(emission);
                self.say(until_s, tone, text);
            }
        }
        if let (Some([_, until_s]), Some(rates)) = (run.window_s, rates(self.facts, run)) {
            let served = span(run.radiated_s.i);
            self.say(until_s, Tone::Plain, format!("{} had had {served} of service; {rates}.", whom(run)));
        }
    }

    /// Why an emission ended, as far as anything on record explains it.
    fn silence(&mut self, emission: &Emission) -> (Tone, String) {
        let Emission { role, until_s, .. } = *emission;
        let after = span(until_s - emission.from_s);
        let mut events = self.facts.timeline.events.iter().enumerate();
        let reason = events.find_map(|(index, event)| match Said::of(&event.text) {
            Said::Silent(why)
                if event.kind == EventKind::Notice
                    && event.vehicle == Some(role)
                    && (event.at_s - until_s).abs() <= AFTERWARDS_S =>
            {
                Some((index, why))
            }
            _ => None,
        });
        if let Some((index, why)) = reason {
            self.told.push(index);
            let why = gloss(why);
            return (Tone::Good, format!("Vehicle {role} fell silent after {after} on the air: {why}."));
        }
        let events = &self.facts.timeline.events;
        let lost = events.iter().find(|event| {
            let gone = event.fault().is_some_and(FaultKind::is_of_the_companion);
            gone && event.vehicle == Some(role) && event.at_s <= until_s && event.at_s >= emission.from_s
        });
        match lost {
            Some(event) => {
                let left = span(until_s - event.at_s);
                let text = format!(
                    "Vehicle {role}'s transmitter fell silent by itself, {left} after its companion had fallen silent: every power command carries an expiry."
                );
                (Tone::Good, text)
            }
            None => (Tone::Plain, format!("Vehicle {role} went off the air after {after}.")),
        }
    }

    /// Take-offs, landings, modes: from the states, not from anybody's word.
    fn motion(&mut self) {
        let mut seen = Vec::new();
        for role in Role::BOTH {
            let states = self.facts.timeline.samples.iter();
            let known: Vec<_> =
                states.filter_map(|s| s.vehicles[role].as_ref().map(|v| (s.at_s, v))).collect();
            for pair in known.windows(2) {
                let [(_, before), (at_s, now)] = [pair[0], pair[1]];
                if before.landed != now.landed {
                    let what = if now.landed { Motion::Landed } else { Motion::TookOff };
                    seen.push((at_s, role, what));
                }
                if before.mode != now.mode && !(before.landed && now.landed) {
                    seen.push((at_s, role, Motion::Mode(&before.mode, &now.mode)));
                }
            }
        }
        seen.sort_by(|a, b| a.0.total_cmp(&b.0));
        while !seen.is_empty() {
            let (at_s, role, what) = seen.remove(0);
            let twin = seen
                .iter()
                .position(|other| other.2 == what && other.1 != role && other.0 - at_s <= TOGETHER_S);
            let both = twin.is_some();
            twin.map(|index| seen.remove(index));
            let whose =
                if both { "Both autopilots".to_owned() } else { format!("Vehicle {role}'s autopilot") };
            let who = if both { "Both vehicles".to_owned() } else { format!("Vehicle {role}") };
            let (tone, text) = match what {
                Motion::TookOff => (Tone::Good, format!("{who} took off.")),
                Motion::Landed => (Tone::Good, format!("{who} landed.")),
                Motion::Mode(from, to) => (Tone::Plain, format!("{whose} went from {from} to {to}.")),
            };
            self.say(at_s, tone, text);
        }
    }

    /// What companions said, and what the monitor saw.
    fn events(&mut self) {
        let events = &self.facts.timeline.events;
        for (index, event) in events.iter().enumerate() {
            if self.told.contains(&index) {
                continue;
            }
            match event.kind {
                EventKind::Violation => {
                    let code = event.code.as_deref().unwrap_or("an invariant");
                    self.say(event.at_s, Tone::Bad, format!("{code} was broken: {}.", event.text));
                }
                EventKind::Excused => {
                    let code = event.code.as_deref().unwrap_or("an invariant");
                    self.say(
                        event.at_s,
                        Tone::Fault,
                        format!("{code} did not hold, which does not count: {}.", event.text),
                    );
                }
                EventKind::FaultOver => {
                    self.say(event.at_s, Tone::Plain, format!("Over: {}.", event.text));
                }
                EventKind::Process if !self.follows_a_kill(event) => {
                    let tone = if event.severity > Severity::Info { Tone::Fault } else { Tone::Plain };
                    let who = event.vehicle.map_or(String::new(), |role| format!("Vehicle {role}'s "));
                    self.say(event.at_s, tone, sentence(&format!("{who}{}.", event.text)));
                }
                EventKind::Notice if self.is_news(index) => {
                    let twin = events.iter().enumerate().skip(index + 1).find(|(k, other)| {
                        other.text == event.text
                            && other.kind == event.kind
                            && other.vehicle != event.vehicle
                            && other.at_s - event.at_s <= TOGETHER_S
                            && !self.told.contains(k)
                    });
                    let vehicle = if twin.is_some() { None } else { event.vehicle };
                    self.told.extend(twin.map(|(k, _)| k));
                    let tone = match event.severity {
                        Severity::Info => Tone::Plain,
                        Severity::Warning => Tone::Fault,
                        Severity::Error => Tone::Bad,
                    };
                    let mut text = format!("{}: \u{201c}{}\u{201d}", sentence(&speaker(vehicle)), event.text);
                    if let Some((times, until_s)) = self.repeats(index) {
                        text += &format!(", {times} times until {}", instant(until_s));
                    }
                    self.say(event.at_s, tone, text);
                }
                EventKind::Fault | EventKind::Process | EventKind::Notice => {}
            }
        }
    }

    /// How often a vehicle gives a warning before it has been quiet about it for a while, and when last; told with that.
    fn repeats(&mut self, index: usize) -> Option<(usize, f64)> {
        let events = &self.facts.timeline.events;
        let said = &events[index];
        if said.severity < Severity::Warning {
            return None;
        }
        let (mut times, mut last_s) = (1, said.at_s);
        for (k, event) in events.iter().enumerate().skip(index + 1) {
            if event.at_s - last_s > AGAIN_S {
                break;
            }
            if event.kind == said.kind && event.vehicle == said.vehicle && event.text == said.text {
                (times, last_s) = (times + 1, event.at_s);
                self.told.push(k);
            }
        }
        (times > 1).then_some((times, last_s))
    }

    /// A warning, or the first word of a phase worth telling.
    fn is_news(&self, index: usize) -> bool {
        let events = &self.facts.timeline.events;
        let event = &events[index];
        if event.severity >= Severity::Warning {
            return true;
        }
        let told_otherwise = ["connecting", "standby", "ended"];
        if self.facts.timeline.scene.source == Source::Telemetry {
            // Texts on the wire carry no phase; what the states show is told from them.
            return !matches!(Said::of(&event.text), Said::Waiting(_) | Said::Landed | Said::OnAir);
        }
        let Some(phase) = event.phase.as_deref().filter(|phase| !told_otherwise.contains(phase)) else {
            return false;
        };
        let before = events[..index].iter().rev();
        let last = before.filter(|e| e.vehicle == event.vehicle).find_map(|e| e.phase.as_deref());
        last != Some(phase)
    }

    fn follows_a_kill(&self, event: &Event) -> bool {
        self.facts.timeline.events.iter().any(|fault| {
            fault.fault() == Some(FaultKind::CompanionKill)
                && fault.vehicle == event.vehicle
                && (0.0..TOGETHER_S).contains(&(event.at_s - fault.at_s))
        })
    }
}

/// `slot 0, user alpha`.
#[must_use]
pub fn slot_name(run: &SlotRun) -> String {
    if run.user.is_empty() {
        format!("slot {}", run.number)
    } else {
        format!("slot {}, user {}", run.number, run.user)
    }
}

fn whom(run: &SlotRun) -> String {
    if run.user.is_empty() { format!("The user of slot {}", run.number) } else { sentence(&run.user) }
}

fn undisturbed_slot(facts: &Facts, run: &SlotRun) -> String {
    let of = |role| {
        let mut all = facts.emissions.iter().filter(move |e| e.slot == Some(run.number) && e.role == role);
        all.next().map(|first| (first, all.next_back().unwrap_or(first)))
    };
    let mut text = format!("{}: ", sentence(&slot_name(run)));
    match (of(Role::J), of(Role::I)) {
        (Some((j, j_last)), Some((i, i_last))) => {
            text += &format!(
                "vehicle J began to jam with {}; vehicle I transmitted from {} later, with {}, for {}; ",
                power(j.power_w),
                span(i.from_s - j.from_s),
                power(i.power_w),
                span(run.radiated_s.i),
            );
            text += &match (j_last.ended, j_last.until_s >= i_last.until_s) {
                (false, _) => "J was still on when the record ended".to_owned(),
                (true, true) => format!("J stopped {} after I", span(j_last.until_s - i_last.until_s)),
                (true, false) => format!("J stopped {} before I", span(i_last.until_s - j_last.until_s)),
            };
        }
        (None, Some((i, _))) => {
            text += &format!(
                "vehicle I alone transmitted, with {}, for {}",
                power(i.power_w),
                span(run.radiated_s.i)
            );
        }
        (Some((j, _)), None) => {
            text +=
                &format!("vehicle J alone was on, with {}, for {}", power(j.power_w), span(run.radiated_s.j));
        }
        (None, None) => text += "nobody was on the air",
    }
    if let Some(rates) = rates(facts, run) {
        text += &format!(". {}", sentence(&rates));
    }
    text + "."
}

/// The slot's rate against its plan; `None` if it is unknown.
fn rates(facts: &Facts, run: &SlotRun) -> Option<String> {
    let bandwidth_hz = facts.timeline.scene.radio?.bandwidth_hz;
    let achieved = run.achieved_bps? / bandwidth_hz;
    let estimated = if facts.timeline.scene.source == Source::Telemetry { "estimated " } else { "" };
    let against = run
        .planned_bps
        .map_or(String::new(), |planned| format!(" against {:.2} planned", planned / bandwidth_hz));
    Some(format!("the {estimated}secrecy rate was {achieved:.2} bit/s/Hz{against}"))
}

fn ending(facts: &Facts) -> Beat {
    let mut text = format!("The record ends after {}", instant(facts.end_s));
    for role in Role::BOTH {
        if let Some((at_s, state)) = facts.last_state(role) {
            let [_, _, up_m] = state.position_enu_m;
            text += &match state.landed {
                _ if facts.is_lost(role) => {
                    format!("; nothing is known of vehicle {role} after {}", instant(at_s))
                }
                true => format!("; vehicle {role} is on the ground"),
                false => format!("; vehicle {role} is in the air, {up_m:.0} m up, in {}", state.mode),
            };
        }
    }
    Beat { at_s: facts.end_s, tone: Tone::Plain, text: text + ".", mark: None, since: None }
}
