//! What is known, what the operator wants, and what follows from either. No I/O.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavSeverity};

use super::order::Asked;
use super::recording::Recording;
use super::replay::Replay;
use super::vehicle::{AUTOPILOT, Id, News, Vehicle};
use crate::desk::Order;
use crate::role::Role;
use crate::time::{Instant, Utc};

/// More vehicles than these are none of this pair.
const MOST_VEHICLES: usize = 8;
/// So many lines are kept.
const MOST_LINES: usize = 2000;
/// A question that nobody answers is none any more: an Enter that comes later is meant for something else.
const ASKED_FOR: Duration = Duration::from_secs(15);
/// How an order ended is shown for so long.
const SHOWN_FOR: Duration = Duration::from_secs(20);

/// A key, as far as it means anything here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// A character.
    Char(char),
    /// Yes.
    Enter,
    /// No.
    Escape,
    /// The next choice.
    Tab,
    /// Back in time.
    Left,
    /// On in time.
    Right,
    /// Earlier lines, or faster.
    Up,
    /// Later lines, or slower.
    Down,
    /// A page of earlier lines.
    PageUp,
    /// A page of later lines.
    PageDown,
    /// To the beginning.
    Home,
    /// To the end.
    End,
    /// Control and C.
    Interrupt,
}

/// What is to follow a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum After {
    /// Nothing.
    Stay,
    /// The view is to be left.
    Leave,
    /// So is what is watched.
    Interrupt,
}

/// What is watched.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// Companions over these addresses.
    Live(Vec<String>),
    /// A simulated flight in this very process.
    Simulated(String),
    /// A recorded flight of this name.
    Recorded(String),
}

/// Who is told an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Whom {
    /// The pair: whichever serves, and all of them where that is safer.
    Pair,
    One(Role),
}

/// A line of what was said.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line {
    pub at: Instant,
    pub who: String,
    pub severity: MavSeverity,
    pub text: String,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct State {
    pub(super) source: Source,
    /// The companions' component.
    companion: u8,
    /// UTC at the instant 0.
    utc: Utc,
    pub(super) vehicles: Vec<Vehicle>,
    pub(super) lines: VecDeque<Line>,
    /// So many of the newest lines are below the window.
    pub(super) scrolled: usize,
    pub(super) asked: Vec<Asked>,
    pub(super) question: Option<(Order, Instant)>,
    pub(super) whom: Whom,
    pub(super) remark: Option<(String, Instant)>,
    pub(super) helps: bool,
    pub(super) replay: Option<Replay>,
    recording: Option<Recording>,
    /// So many records have been taken.
    taken: usize,
}

impl State {
    /// Nothing heard yet. `utc`: at the instant 0; `companion`: the companions' MAVLink component.
    #[must_use]
    pub fn new(source: Source, companion: u8, utc: Utc) -> Self {
        Self {
            source,
            companion,
            utc,
            vehicles: Vec::new(),
            lines: VecDeque::new(),
            scrolled: 0,
            asked: Vec::new(),
            question: None,
            whom: Whom::Pair,
            remark: None,
            helps: false,
            replay: None,
            recording: None,
            taken: 0,
        }
    }

    /// A recorded flight, at its beginning.
    #[must_use]
    pub fn recorded(name: String, companion: u8, recording: Recording, now: Instant) -> Self {
        let mut state = Self::new(Source::Recorded(name), companion, recording.began);
        state.replay = Some(Replay::new(recording.length(), now));
        state.recording = Some(recording);
        state.forget();
        state
    }

    /// What time the view shows: of a recorded flight its own.
    #[must_use]
    pub fn time(&self, now: Instant) -> Instant {
        self.replay.as_ref().map_or(now, |replay| Instant::from_start(replay.at(now)))
    }

    /// UTC at an instant of the view.
    pub(super) fn utc(&self, at: Instant) -> Utc {
        self.utc + at.since_start()
    }

    /// Takes what has been heard on an address.
    pub fn take(&mut self, channel: usize, header: MavHeader, message: &MavMessage, now: Instant) {
        let Ok(system) = u8::try_from(header.system_id) else { return };
        if let Some(line) = self.order_overheard(header, message, now) {
            self.line(line);
        }
        let id = Id { channel, system };
        let known = self.vehicles.iter().position(|vehicle| vehicle.id == id);
        let place = match known {
            Some(place) => place,
            None if Vehicle::makes_known(header.component_id, self.companion, message) => {
                if self.vehicles.len() == MOST_VEHICLES {
                    return;
                }
                let roles = self.recording.as_ref().map(|recording| &recording.roles);
                let role = roles.and_then(|roles| roles.get(channel).copied().flatten());
                self.vehicles.push(Vehicle::new(id, role));
                self.vehicles.len() - 1
            }
            None => return,
        };
        let companion = self.companion;
        let Some(vehicle) = self.vehicles.get_mut(place) else { return };
        let Some(news) = vehicle.take(header.component_id, companion, message, now) else { return };
        let mut who = name_of(vehicle);
        match news {
            News::Text(component, severity, text) => {
                match component {
                    AUTOPILOT => who.push_str(" autopilot"),
                    component if component != companion => who.push_str(&format!(" component {component}")),
                    _ => {}
                }
                self.line(Line { at: now, who, severity, text });
            }
            News::Answer(component, ack) => {
                if component != companion {
                    return;
                }
                let ended = self.asked.iter_mut().find_map(|asked| {
                    let from = asked.to == id || asked.to == Id { channel, system: 0 };
                    (from && asked.answer(&ack, now)).then(|| (asked.words(now), asked.failed()))
                });
                if let Some((text, failed)) = ended {
                    let severity = if failed {
                        MavSeverity::MAV_SEVERITY_WARNING
                    } else {
                        MavSeverity::MAV_SEVERITY_NOTICE
                    };
                    self.line(Line { at: now, who: "order".into(), severity, text });
                }
            }
        }
    }

    /// Of what somebody else orders a companion.
    fn order_overheard(&self, header: MavHeader, message: &MavMessage, at: Instant) -> Option<Line> {
        let (component, command, param1) = match message {
            MavMessage::COMMAND_LONG(c) => (c.target_component, c.command, c.param1),
            MavMessage::COMMAND_INT(c) => (c.target_component, c.command, c.param1),
            _ => return None,
        };
        if ![0, self.companion].contains(&component) || header.component_id == self.companion {
            return None;
        }
        let order = match command {
            MavCmd::MAV_CMD_MISSION_START => Order::Start,
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE if param1 == 0.0 => Order::Pause,
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE => Order::Continue,
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Order::Return,
            MavCmd::MAV_CMD_USER_2 if param1 == 1.0 => Order::Lift,
            MavCmd::MAV_CMD_USER_2 => Order::Kill,
            _ => return None,
        };
        let text = format!("station {} orders: {}", header.system_id, order.name());
        Some(Line { at, who: "order".into(), severity: MavSeverity::MAV_SEVERITY_NOTICE, text })
    }

    /// A line of this program's own.
    pub fn remark(&mut self, text: String, now: Instant) {
        let at = self.time(now);
        self.line(Line { at, who: "watch".into(), severity: MavSeverity::MAV_SEVERITY_WARNING, text });
    }

    fn line(&mut self, line: Line) {
        if self.scrolled > 0 {
            self.scrolled += 1;
        }
        self.lines.push_back(line);
        self.lines.drain(..self.lines.len().saturating_sub(MOST_LINES));
    }

    /// Does what is due: of a recorded flight, takes what it has come to.
    pub fn advance(&mut self, now: Instant) {
        let at = self.time(now);
        self.question = self.question.filter(|(_, since)| *since + ASKED_FOR >= now);
        self.asked.retain(|asked| asked.end.is_none_or(|(_, end)| end + SHOWN_FOR >= now));
        let Some(recording) = self.recording.take() else { return };
        if self.taken > 0
            && recording.records.get(self.taken - 1).is_some_and(|last| last.at > at.since_start())
        {
            self.recording = Some(recording);
            self.forget();
            return self.advance(now);
        }
        let mut taken = self.taken;
        let roles = recording.roles.clone();
        while let Some(record) = recording.records.get(taken).filter(|record| record.at <= at.since_start()) {
            self.take_recorded(
                &roles,
                record.channel,
                record.header,
                &record.message,
                Instant::from_start(record.at),
            );
            taken += 1;
        }
        self.taken = taken;
        self.recording = Some(recording);
    }

    fn take_recorded(
        &mut self,
        roles: &[Option<Role>],
        channel: usize,
        header: MavHeader,
        message: &MavMessage,
        at: Instant,
    ) {
        let before = self.vehicles.len();
        self.take(channel, header, message, at);
        if let Some(new) = self.vehicles.get_mut(before) {
            new.role = new.role.or(roles.get(channel).copied().flatten());
        }
    }

    /// A recorded flight from its beginning.
    fn forget(&mut self) {
        self.vehicles.clear();
        self.lines.clear();
        self.scrolled = 0;
        self.taken = 0;
        let remarks =
            self.recording.iter().flat_map(|recording| recording.remarks.clone()).collect::<Vec<_>>();
        for text in remarks {
            let (at, severity) = (Instant::ZERO, MavSeverity::MAV_SEVERITY_WARNING);
            self.line(Line { at, who: "watch".into(), severity, text });
        }
    }

    /// The next message to send, and on which address.
    pub fn poll_transmit(&mut self, now: Instant) -> Option<(usize, MavMessage)> {
        let component = self.companion;
        let mut lines = Vec::new();
        let mut sent = None;
        for asked in &mut self.asked {
            let was_open = asked.end.is_none();
            sent = asked.poll(component, now).map(|message| (asked.to.channel, message));
            if was_open && asked.end.is_some() {
                lines.push(asked.words(now));
            }
            if sent.is_some() {
                break;
            }
        }
        for text in lines {
            let severity = MavSeverity::MAV_SEVERITY_ERROR;
            self.line(Line { at: now, who: "order".into(), severity, text });
        }
        sent
    }

    /// Takes a key.
    pub fn key(&mut self, key: Key, now: Instant) -> After {
        if key == Key::Interrupt {
            return After::Interrupt;
        }
        if let Some((order, _)) = self.question.take() {
            match key {
                Key::Enter | Key::Char('y' | 'Y') => self.give(order, now),
                // Two keys in a hurry: the second K is a kill's yes.
                Key::Char('k' | 'K') if order == Order::Kill => self.give(order, now),
                _ => self.tell(format!("{}: not ordered", order.name()), now),
            }
            return After::Stay;
        }
        match key {
            Key::Char('q' | 'Q') => return After::Leave,
            Key::Char('?' | 'h' | 'H') => self.helps = !self.helps,
            Key::Escape => {
                self.helps = false;
                self.scrolled = 0;
            }
            Key::PageUp => self.scroll(8),
            Key::PageDown => self.scrolled = self.scrolled.saturating_sub(8),
            _ if self.replay.is_some() => self.key_of_replay(key, now),
            Key::Up => self.scroll(1),
            Key::Down => self.scrolled = self.scrolled.saturating_sub(1),
            Key::Tab => {
                self.whom = match self.whom {
                    Whom::Pair => Whom::One(Role::I),
                    Whom::One(Role::I) => Whom::One(Role::J),
                    Whom::One(Role::J) => Whom::Pair,
                }
            }
            Key::Char(letter) => {
                let order = match letter.to_ascii_lowercase() {
                    's' => Order::Start,
                    'p' => Order::Pause,
                    'c' => Order::Continue,
                    'r' => Order::Return,
                    'k' => Order::Kill,
                    'l' => Order::Lift,
                    _ => return After::Stay,
                };
                self.question = Some((order, now));
            }
            _ => {}
        }
        After::Stay
    }

    fn key_of_replay(&mut self, key: Key, now: Instant) {
        let Some(replay) = &mut self.replay else { return };
        match key {
            Key::Char(' ') | Key::Enter => replay.toggle(now),
            Key::Char('+' | '=') | Key::Up => replay.change_speed(true, now),
            Key::Char('-') | Key::Down => replay.change_speed(false, now),
            Key::Left => replay.leap(-10.0, now),
            Key::Right => replay.leap(10.0, now),
            Key::Char('[' | ',') => replay.leap(-1.0, now),
            Key::Char(']' | '.') => replay.leap(1.0, now),
            Key::Home => replay.seek(Duration::ZERO, now),
            Key::End => replay.seek(replay.length(), now),
            Key::Char('s' | 'p' | 'c' | 'r' | 'k' | 'l' | 'S' | 'P' | 'C' | 'R' | 'K' | 'L') => {
                self.tell("a recorded flight takes no orders".into(), now);
            }
            _ => {}
        }
    }

    fn scroll(&mut self, by: usize) {
        self.scrolled = (self.scrolled + by).min(self.lines.len().saturating_sub(1));
    }

    fn tell(&mut self, text: String, now: Instant) {
        self.remark = Some((text, now));
    }

    /// Gives an order to whom it is for.
    fn give(&mut self, order: Order, now: Instant) {
        let to = self.addressees(order, now);
        if to.is_empty() {
            return self
                .tell(format!("{}: no companion is heard that it could be given to", order.name()), now);
        }
        // The same order anew takes the place of the old one.
        self.asked.retain(|asked| asked.order != order && asked.end.is_none());
        self.asked.extend(to.into_iter().map(|(to, whom)| Asked::new(order, to, whom, now)));
    }

    fn addressees(&self, order: Order, now: Instant) -> Vec<(Id, String)> {
        let named = |vehicle: &Vehicle| (vehicle.id, name_of(vehicle));
        let companions = || self.vehicles.iter().filter(|vehicle| vehicle.companion_at.is_some());
        let one = match self.whom {
            Whom::One(role) => companions().filter(|vehicle| vehicle.role == Some(role)).map(named).collect(),
            Whom::Pair => Vec::new(),
        };
        match order {
            // To everybody who may hear it, whatever was chosen: it counts for both, and may reach one alone.
            Order::Kill => {
                let all: Vec<_> = companions().map(named).collect();
                let channels = match &self.source {
                    Source::Live(addresses) if all.is_empty() => addresses.len(),
                    Source::Live(_) | Source::Simulated(_) | Source::Recorded(_) => 0,
                };
                let anybody = (0..channels).map(|channel| (Id { channel, system: 0 }, "anybody".to_owned()));
                all.into_iter().chain(anybody).collect()
            }
            _ if self.whom != Whom::Pair => one,
            Order::Lift => companions().map(named).collect(),
            // Either takes it for both. A vehicle in another hand heeds what is for it alone, and is left out here.
            _ => {
                let surrendered = |vehicle: &Vehicle| vehicle.phase(now) == Some(SURRENDERED);
                let mut able: Vec<_> = companions().filter(|v| v.is_heard(now) && !surrendered(v)).collect();
                able.sort_by_key(|vehicle| vehicle.role != Some(Role::I));
                able.first().map(|vehicle| named(vehicle)).into_iter().collect()
            }
        }
    }

    /// The vehicle of a role that was heard last; of no role, the first that has none.
    pub(super) fn vehicle(&self, role: Role) -> Option<&Vehicle> {
        let heard = |vehicle: &&Vehicle| vehicle.companion_at.max(vehicle.autopilot_at);
        let named = self.vehicles.iter().filter(|vehicle| vehicle.role == Some(role)).max_by_key(heard);
        named.or_else(|| {
            let mut nameless = self.vehicles.iter().filter(|vehicle| vehicle.role.is_none());
            let peer = self.vehicles.iter().any(|vehicle| vehicle.role == Some(role.peer()));
            match role {
                Role::I => nameless.next(),
                Role::J if peer => nameless.next(),
                Role::J => nameless.nth(1),
            }
        })
    }

    /// What is remarked on now.
    pub(super) fn remarked(&self, now: Instant) -> Option<&str> {
        self.remark
            .as_ref()
            .filter(|(_, at)| *at + Duration::from_secs(6) >= now)
            .map(|(text, _)| text.as_str())
    }
}

/// The phase in which control is another hand's, by its place in the phases' names.
const SURRENDERED: usize = 10;

fn name_of(vehicle: &Vehicle) -> String {
    vehicle.role.map_or_else(|| format!("system {}", vehicle.id.system), |role| role.to_string())
}
