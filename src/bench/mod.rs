//! The first hardware day on the ground: what links, autopilot, radio, clocks and this computer do, before anything flies.
//! A state machine without I/O, as the executive is: it is fed messages and instants and says what it wants sent.
//!
//! It is made of the parts that fly, the autopilot's adapter and the transmitter's driver, none of which is ever asked to act;
//! and what they would say is let through only as far as [`muzzle`] lets it: questions, and power off. It stops when a vehicle
//! is armed.

pub mod figures;
pub mod line;
pub mod muzzle;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, MavState, TIMESYNC_DATA};
use mavlink::{MavHeader, Message};

use crate::autopilot::{self, Autopilot, Event, Wanted, heartbeat};
use crate::mission::Outgoing;
use crate::pair::clock::ClockFilter;
use crate::pair::wire;
use crate::preflight::{Check, Verdict};
use crate::role::Role;
use crate::service::silences_after;
use crate::time::{Instant, Utc};
use crate::transmitter::{self, Kind, Transmitter, wire as radio_wire};
use figures::{Arrivals, Drift, RoundTrips, Samples};
use line::{Line, Stream};

/// How often each link is asked for the time.
const ASK_EVERY: Duration = Duration::from_millis(50);
const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
/// Marks of our questions, apart from those of the adapter's own, which are nanoseconds since the start.
const MARK: u64 = 1 << 61;
/// Streams, parameters and clocks settle for so long before anything counts.
pub const SETTLE: Duration = Duration::from_secs(4);

/// What the bench is told.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Which vehicle this is.
    pub role: Role,
    /// Our own (system, component).
    pub own: (u8, u8),
    /// As for a flight.
    pub autopilot: autopilot::Settings,
    /// As for a flight.
    pub transmitter: transmitter::Settings,
    /// The radio has a link of its own.
    pub radio_apart: bool,
}

/// The bench.
#[derive(Debug)]
pub struct Bench {
    settings: Settings,
    begun: Instant,
    autopilot: Autopilot,
    /// `None` where telling it off would be setting a parameter.
    transmitter: Option<Transmitter>,
    trips: RoundTrips,
    drift: Drift,
    arrivals: BTreeMap<u32, Arrivals>,
    ages: Samples,
    utc_offset_s: Option<f64>,
    pair: RoundTrips,
    pair_clock: ClockFilter,
    lateness: [Samples; 2],
    under_load: bool,
    armed: bool,
    next_ask: Instant,
    next_heartbeat: Instant,
    next_tick: Instant,
    out: VecDeque<Outgoing>,
    held_back: BTreeMap<&'static str, u64>,
}

impl Bench {
    /// One that has heard nothing yet.
    #[must_use]
    pub fn new(settings: Settings, now: Instant) -> Self {
        let by_parameter = matches!(settings.transmitter.kind, Kind::Parameter(_) | Kind::None);
        Self {
            begun: now,
            autopilot: Autopilot::new(settings.autopilot.clone(), now),
            transmitter: (!by_parameter).then(|| Transmitter::new(settings.transmitter.clone(), now)),
            trips: RoundTrips::default(),
            drift: Drift::default(),
            arrivals: BTreeMap::new(),
            ages: Samples::default(),
            utc_offset_s: None,
            pair: RoundTrips::default(),
            pair_clock: ClockFilter::default(),
            lateness: Default::default(),
            under_load: false,
            armed: false,
            next_ask: now,
            next_heartbeat: now,
            next_tick: now,
            out: VecDeque::new(),
            held_back: BTreeMap::new(),
            settings,
        }
    }

    /// A message from the autopilot's link, at this UTC of this computer.
    pub fn handle_autopilot(&mut self, header: MavHeader, message: &MavMessage, now: Instant, utc: Utc) {
        self.autopilot.handle_message(header, message, now);
        if !self.settings.radio_apart {
            self.handle_radio_link(header, message, now);
        }
        self.take_events(now);
        self.armed |= self.autopilot.state().is_armed();
        let from_autopilot =
            self.autopilot.state().system.is_some_and(|system| u32::from(system) == header.system_id)
                && header.component_id == 1;
        if !from_autopilot || !self.has_settled(now) {
            return;
        }
        match message {
            MavMessage::TIMESYNC(answer) if answer.tc1 > 0 => {
                let asked = u64::try_from(answer.ts1).ok().and_then(|mark| self.trips.answered(mark, now));
                if let Some(asked) = asked {
                    self.drift.add(asked, now, answer.tc1 as f64 * 1e-3);
                }
            }
            MavMessage::SYSTEM_TIME(_) => {
                if let Some(theirs) = self.autopilot.utc(now) {
                    let apart = |a: Utc, b: Utc| a.saturating_since(b).as_secs_f64();
                    self.utc_offset_s = Some(apart(utc, theirs) - apart(theirs, utc));
                }
            }
            MavMessage::ATTITUDE_QUATERNION(_) => {
                if let Some(age) = self.autopilot.state_age(now) {
                    self.ages.add_ms(age);
                }
            }
            _ => {}
        }
        self.arrivals.entry(message.message_id()).or_default().add(now);
    }

    /// A message of the common dialect from the radio's own link.
    pub fn handle_radio_link(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        if let Some(transmitter) = &mut self.transmitter {
            transmitter.handle_message(header, message, now);
        }
    }

    /// The radio's own message.
    pub fn handle_report(&mut self, header: MavHeader, message: &radio_wire::MavMessage, now: Instant) {
        if let Some(transmitter) = &mut self.transmitter {
            transmitter.handle_radio(header, message, now);
        }
    }

    /// A message from the pair link: the time, asked or told. What a companion says besides is none of ours.
    pub fn handle_pair(&mut self, message: &wire::MavMessage, now: Instant, utc: Utc) {
        let wire::MavMessage::VEILWING_CLOCK(clock) = message else { return };
        if clock.receive_us == 0 && clock.transmit_us == 0 {
            let reply = wire::VEILWING_CLOCK_DATA {
                receive_us: utc.unix_us,
                transmit_us: utc.unix_us,
                ..clock.clone()
            };
            self.out.push_back(Outgoing::Pair(Box::new(wire::MavMessage::VEILWING_CLOCK(reply))));
        } else if self.pair.answered(clock.originate_us, now).is_some() {
            self.pair_clock.take(clock.originate_us, clock.receive_us, clock.transmit_us, utc.unix_us);
        }
    }

    /// Does what is due at `now`, at this UTC of this computer.
    pub fn handle_timeout(&mut self, now: Instant, utc: Utc) {
        // First, as a setpoint would go first.
        if self.next_tick <= now {
            if self.has_settled(now) {
                self.lateness[usize::from(self.under_load)].add_ms(now.saturating_since(self.next_tick));
            }
            let period = Duration::from_secs_f64(1.0 / self.settings.autopilot.rate_hz);
            self.next_tick = (self.next_tick + period).max(now);
        }
        self.autopilot.handle_timeout(now);
        if let Some(transmitter) = &mut self.transmitter {
            transmitter.handle_timeout(now);
        }
        self.take_events(now);
        if self.next_heartbeat <= now {
            self.next_heartbeat = now + HEARTBEAT_EVERY;
            let heartbeat = heartbeat(MavState::MAV_STATE_STANDBY);
            if self.settings.radio_apart {
                self.out.push_back(Outgoing::Radio(Box::new(heartbeat.clone())));
            }
            self.out.push_back(Outgoing::Autopilot(Box::new(heartbeat)));
        }
        if self.next_ask <= now {
            self.next_ask = now + ASK_EVERY;
            self.ask(now, utc);
        }
        self.trips.forget(now);
        self.pair.forget(now);
    }

    fn ask(&mut self, now: Instant, utc: Utc) {
        self.pair_clock.ask(utc.unix_us);
        self.pair.ask(utc.unix_us, now);
        let request = wire::VEILWING_CLOCK_DATA { originate_us: utc.unix_us, receive_us: 0, transmit_us: 0 };
        self.out.push_back(Outgoing::Pair(Box::new(wire::MavMessage::VEILWING_CLOCK(request))));
        let Some(target_system) = self.autopilot.state().system.filter(|_| self.has_settled(now)) else {
            return;
        };
        let mark = MARK | u64::try_from(now.since_start().as_nanos()).unwrap_or_default();
        self.trips.ask(mark, now);
        let question = TIMESYNC_DATA {
            tc1: 0,
            ts1: i64::try_from(mark).unwrap_or(i64::MAX),
            target_system,
            target_component: 1,
        };
        self.out.push_back(Outgoing::Autopilot(Box::new(MavMessage::TIMESYNC(question))));
    }

    /// What is measured from now on is measured under load.
    pub fn set_under_load(&mut self) {
        self.under_load = true;
    }

    /// Whether a vehicle is armed: then there is nothing to be measured here.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// When [`Self::handle_timeout`] is next to be called.
    #[must_use]
    pub fn poll_timeout(&self) -> Instant {
        let own = self.next_tick.min(self.next_heartbeat).min(self.next_ask);
        let parts =
            [self.autopilot.poll_timeout(), self.transmitter.as_ref().and_then(Transmitter::poll_timeout)];
        parts.into_iter().flatten().map(|(at, _)| at).fold(own, Instant::min)
    }

    /// The next message to send: of what the parts would say, what may be said.
    pub fn poll_transmit(&mut self) -> Option<Outgoing> {
        loop {
            let next = self.next_outgoing()?;
            let command = match self.settings.transmitter.kind {
                Kind::Numbered { command } | Kind::Leased { command } => Some(command),
                Kind::Parameter(_) | Kind::None => None,
            };
            let (name, may) = match &next {
                Outgoing::Autopilot(message) | Outgoing::Radio(message) => {
                    (message.message_name(), muzzle::may_be_said(message, command))
                }
                Outgoing::Pair(message) => (message.message_name(), muzzle::may_be_said_to_the_peer(message)),
            };
            if may {
                return Some(next);
            }
            *self.held_back.entry(name).or_default() += 1;
        }
    }

    fn next_outgoing(&mut self) -> Option<Outgoing> {
        let apart = self.settings.radio_apart;
        let radio = self.transmitter.as_mut().and_then(Transmitter::poll_transmit).map(Box::new);
        radio
            .map(|message| if apart { Outgoing::Radio(message) } else { Outgoing::Autopilot(message) })
            .or_else(|| self.out.pop_front())
            .or_else(|| self.autopilot.poll_transmit().map(|message| Outgoing::Autopilot(Box::new(message))))
    }

    /// The MAVLink system and component we speak as.
    #[must_use]
    pub fn own(&self) -> (u8, u8) {
        self.settings.own
    }

    fn take_events(&mut self, now: Instant) {
        while let Some(event) = self.autopilot.poll_event() {
            if let Event::Discovered { system, .. } = event
                && self.settings.own.0 != system
            {
                self.settings.own.0 = system;
                self.autopilot.adopt_system(system);
                if let Some(transmitter) = &mut self.transmitter {
                    transmitter.adopt_system(system, now);
                }
            }
        }
    }

    fn has_settled(&self, now: Instant) -> bool {
        now.saturating_since(self.begun) >= SETTLE
    }

    /// What was measured of links, messages, parameters, clocks, cadence and radio.
    #[must_use]
    pub fn lines(&self, now: Instant) -> Vec<Line> {
        let remedy =
            "check cable, baud rate and who else speaks on the link; see docs/on-a-vehicle.md, Links";
        let mut lines = line::round_trips("autopilot link", &self.trips, [50.0, 250.0], remedy);
        let overdue_ms = silences_after(self.settings.role).as_secs_f64() * 1e3;
        let never = Arrivals::default();
        for Wanted { id, name, rate_hz, essential } in self.autopilot.wanted() {
            let arrivals = self.arrivals.get(&id).unwrap_or(&never);
            lines.push(line::stream(&Stream {
                name,
                wanted_hz: rate_hz,
                rate_hz: arrivals.rate_hz(now),
                gaps: &arrivals.gaps,
                silences_ms: essential.then_some(1e3 / rate_hz + overdue_ms),
            }));
        }
        lines.push(line::age(&self.ages));
        let within_s = self.autopilot.utc_uncertainty().unwrap_or_default().as_secs_f64();
        lines.push(line::clock(self.utc_offset_s, within_s));
        lines.push(line::drift(&self.drift));
        lines.extend(self.autopilot.preflight(now).into_iter().map(Line::from));
        let rate_hz = self.settings.autopilot.rate_hz;
        lines.push(line::cadence("cadence at rest", &self.lateness[0], rate_hz));
        lines.push(line::cadence("cadence under load", &self.lateness[1], rate_hz));
        lines.extend(self.pair_lines());
        lines.extend(self.radio_lines(now));
        lines
    }

    fn pair_lines(&self) -> Vec<Line> {
        let name = "pair link";
        if self.pair.times.count() == 0 {
            let remedy = "run `veilwing bench` on the other vehicle at the same time, or its companion; then check address, key and mesh";
            return vec![Line::new(
                name,
                Verdict::Warn,
                "the other vehicle does not answer".to_owned(),
                remedy,
            )];
        }
        let remedy =
            "J's lease of 500 ms is renewed over this link: look for distance, antennas and other traffic";
        let mut lines = line::round_trips(name, &self.pair, [80.0, 300.0], remedy);
        if let Some(offset) = self.pair_clock.offset() {
            let apart_s = offset.offset_us as f64 * 1e-6;
            let verdict = if apart_s.abs() <= 0.25 { Verdict::Pass } else { Verdict::Warn };
            let seen = format!("the other computer's is {apart_s:+.3} s against this one's");
            let remedy = "set the one that is wrong, by network or GPS (chrony): logs and keys go by them";
            lines.push(Line::new("pair clocks", verdict, seen, remedy));
        }
        lines
    }

    fn radio_lines(&self, now: Instant) -> Vec<Line> {
        let Some(transmitter) = &self.transmitter else {
            let seen = match self.settings.transmitter.kind {
                Kind::None => "none configured",
                _ => "set by a parameter, and the bench sets none: nothing was asked of it",
            };
            let remedy = "for its times, off and its read-back: `veilwing radio measure`, with a dummy load";
            return vec![Line::new("radio", Verdict::Warn, seen.to_owned(), remedy)];
        };
        let remedy = "is it powered, on this link, and of this form (docs/radio.md)?";
        let off = match (transmitter.is_off(now), transmitter.round_trip(now)) {
            (true, Some(round_trip)) => {
                let ms = round_trip.as_secs_f64() * 1e3;
                Line::new("radio", Verdict::Pass, format!("off, and answers so after {ms:.1} ms"), remedy)
            }
            (true, None) => {
                Line::new("radio", Verdict::Warn, "off by its own expiry; no answer".to_owned(), remedy)
            }
            (false, _) => Line::new("radio", Verdict::Fail, "does not say that it is off".to_owned(), remedy),
        };
        let checks: Vec<Check> = transmitter.preflight(now);
        std::iter::once(off).chain(checks.into_iter().map(Line::from)).collect()
    }

    /// What the parts would have said and were not let, by the message's name: a parameter to be put right, say.
    #[must_use]
    pub fn held_back(&self) -> &BTreeMap<&'static str, u64> {
        &self.held_back
    }
}

#[cfg(all(test, feature = "desk"))]
mod tests;
