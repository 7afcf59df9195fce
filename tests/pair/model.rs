//! Exhaustive check of a slot over the real state machines, by `stateright`.
//!
//! Both companions agree on a slot over a good network and come on station; from shortly before the airtime to after
//! the slot's close, everything that can happen is then explored: time goes on by a step, any message under way (at
//! most two in each direction, older ones are lost) is delivered once, or delivered and kept for a second time, in any
//! order; either companion dies at any step. Radios obey at once and fall silent by themselves; J's UTC is 0.2 s ahead.
//! Hello and clock messages are left out: nothing after the agreement depends on them.

use std::hash::{Hash, Hasher};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavMessage as RadioMessage;
use stateright::{Checker, Expectation, HasDiscoveries, Model, Property};
use veilwing::link::Clock;
use veilwing::pair::wire::MavMessage;
use veilwing::role::{PerVehicle, Role};
use veilwing::service::Outgoing;
use veilwing::transmitter::Kind;

use super::clocks::Clocks;
use super::companion::Companion;
use super::radio::Radio;
use super::setup::{LEASE, service};

/// A bug put in on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bug {
    None,
    LeaseNeverExpires,
    JOffBeforeI,
    GrantCountedFromReceipt,
}

#[derive(Debug, Clone)]
pub struct SlotModel {
    pub bug: Bug,
    pub step: Duration,
    /// Short, so that everything can be explored. Of a slot a second is guard.
    pub slot: Duration,
    pub copies: u8,
    pub crashes: u8,
    /// With a budget of losses every other message arrives before time goes on; without, messages wait as they like.
    pub losses: Option<u8>,
}

#[derive(Debug, Clone)]
pub struct State {
    t: Duration,
    companions: PerVehicle<Option<Companion>>,
    radios: PerVehicle<Radio>,
    under_way: Vec<(Role, MavMessage)>,
    copies: u8,
    crashes: u8,
    losses: u8,
    granted_until: Duration,
    served: bool,
    s1: bool,
    s2: bool,
    s3: bool,
}

impl State {
    /// Everything that the future depends on, as text: the state machines' own `Debug` leaves nothing out.
    fn text(&self) -> String {
        format!("{self:?}")
    }
}

impl PartialEq for State {
    fn eq(&self, other: &Self) -> bool {
        self.text() == other.text()
    }
}

impl Hash for State {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.text().hash(state);
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Action {
    Step,
    Deliver(usize),
    DeliverAndKeep(usize),
    Lose(usize),
    Die(Role),
}

impl SlotModel {
    fn start(&self) -> State {
        let lease = if self.bug == Bug::LeaseNeverExpires { Duration::from_secs(60) } else { LEASE };
        let companions = PerVehicle::from_fn(|role| {
            let (utc_error_us, boot, lease) = match role {
                Role::I => (0, 1, lease),
                Role::J => (200_000, 2, LEASE),
            };
            let clocks = Clocks { started: Duration::ZERO, rate: 1.0, utc_error_us };
            // Radios obey at once: numbers and clocks would only tell states apart that are the same.
            let radio = Kind::Leased { command: 31010 };
            Some(Companion::new(role, clocks, service(role, boot, radio, lease, self.slot)))
        });
        let mut state = State {
            t: Duration::ZERO,
            companions,
            radios: PerVehicle::default(),
            under_way: Vec::new(),
            copies: self.copies,
            crashes: self.crashes,
            losses: self.losses.unwrap_or(0),
            granted_until: Duration::ZERO,
            served: false,
            s1: true,
            s2: true,
            s3: true,
        };
        let early = |state: &State| {
            let slot = state.companions.i.as_ref().and_then(|i| i.service.slot());
            slot.is_none_or(|slot| state.t + self.step < slot.radiate_from.since_start())
        };
        while early(&state) {
            let to = state.t + Duration::from_millis(5);
            self.pass(&mut state, to, false);
            while !state.under_way.is_empty() {
                self.deliver(&mut state, 0, false);
            }
        }
        state
    }

    /// Lets time pass; `bounded`: only what matters in a slot is sent, and at most two messages wait.
    fn pass(&self, state: &mut State, until: Duration, bounded: bool) {
        loop {
            let wakes = Role::BOTH.into_iter().filter_map(|role| {
                state.companions[role].as_ref().map(|c| (c.wake_at().max(state.t), Some(role)))
            });
            let ends = Role::BOTH.into_iter().filter_map(|role| {
                state.radios[role].expires_at().filter(|&at| at > state.t).map(|at| (at, None))
            });
            let Some((at, who)) = wakes.chain(ends).min().filter(|(at, _)| *at <= until) else { break };
            state.t = at;
            if let Some(role) = who {
                if let Some(companion) = state.companions[role].as_mut() {
                    companion.handle_timeout(at);
                }
                self.collect(state, role, bounded);
            }
            self.look(state);
        }
        state.t = until;
        self.look(state);
    }

    fn collect(&self, state: &mut State, role: Role, bounded: bool) {
        while let Some(message) = state.companions[role].as_mut().and_then(|c| c.service.poll_transmit()) {
            let message = match message {
                Outgoing::Pair(message) => *message,
                Outgoing::Radio(message) => {
                    if let RadioMessage::COMMAND_INT(command) = *message {
                        let answer = state.radios[role].command(&command, state.t);
                        if let Some(companion) = state.companions[role].as_mut() {
                            companion.handle_radio(&answer, state.t);
                        }
                    }
                    continue;
                }
            };
            if let MavMessage::VEILWING_LEASE_GRANT(grant) = &message {
                let until = state.t + Duration::from_millis(grant.duration_ms.into());
                state.granted_until = state.granted_until.max(until);
            }
            let apart = matches!(message, MavMessage::VEILWING_HELLO(_) | MavMessage::VEILWING_CLOCK(_));
            if bounded && apart {
                continue;
            }
            let to = role.peer();
            state.under_way.push((to, message));
            let waiting = state.under_way.iter().filter(|(whose, _)| *whose == to).count();
            if bounded && waiting > 2 {
                let oldest = state.under_way.iter().position(|(whose, _)| *whose == to);
                oldest.map(|oldest| state.under_way.remove(oldest));
            }
        }
    }

    fn deliver(&self, state: &mut State, index: usize, bounded: bool) {
        let (to, mut message) = state.under_way.remove(index);
        match (&mut message, self.bug) {
            (MavMessage::VEILWING_LEASE_GRANT(grant), Bug::GrantCountedFromReceipt) => {
                grant.time_us = state.t.as_micros() as u64;
            }
            (MavMessage::VEILWING_LEASE_GRANT(grant), Bug::LeaseNeverExpires) => grant.duration_ms = 60_000,
            (MavMessage::VEILWING_STATUS(status), Bug::JOffBeforeI) => status.released_us = u64::MAX,
            _ => {}
        }
        if let Some(companion) = state.companions[to].as_mut() {
            companion.handle_pair(&message, state.t);
        }
        self.collect(state, to, bounded);
        self.look(state);
    }

    fn look(&self, state: &mut State) {
        let on = PerVehicle::from_fn(|role| state.radios[role].emission(state.t));
        if let Some(i) = on.i {
            let jammed = on.j.is_some_and(|j| j.slot == i.slot);
            state.s3 &= jammed;
            state.s1 &= state.t < state.granted_until;
            state.served |= jammed;
        }
        if on.j.is_some() {
            // A dead companion's radio runs out within its lease, which no slot's end shortens afterwards.
            let committed = state.companions.j.as_ref().map(|j| j.service.slot().is_some());
            state.s2 &= committed.unwrap_or(true);
        }
    }

    fn over(&self, state: &State) -> bool {
        let ends = |c: &Companion| c.service.slot().is_none();
        let done = |role| state.companions[role].as_ref().is_none_or(ends);
        done(Role::I)
            && done(Role::J)
            && !Role::BOTH.into_iter().any(|r| state.radios[r].emission(state.t).is_some())
    }
}

impl Model for SlotModel {
    type State = State;
    type Action = Action;

    fn init_states(&self) -> Vec<State> {
        vec![self.start()]
    }

    fn actions(&self, state: &State, actions: &mut Vec<Action>) {
        if self.over(state) {
            return;
        }
        if self.losses.is_none() || state.under_way.is_empty() {
            actions.push(Action::Step);
        }
        for index in 0..state.under_way.len() {
            actions.push(Action::Deliver(index));
            if state.copies > 0 {
                actions.push(Action::DeliverAndKeep(index));
            }
            if state.losses > 0 {
                actions.push(Action::Lose(index));
            }
        }
        if state.crashes > 0 {
            actions
                .extend(Role::BOTH.into_iter().filter(|r| state.companions[*r].is_some()).map(Action::Die));
        }
    }

    fn next_state(&self, last: &State, action: Action) -> Option<State> {
        let mut state = last.clone();
        match action {
            Action::Step => {
                let until = state.t + self.step;
                self.pass(&mut state, until, true);
            }
            Action::Deliver(index) => self.deliver(&mut state, index, true),
            Action::DeliverAndKeep(index) => {
                state.copies -= 1;
                let kept = state.under_way[index].clone();
                self.deliver(&mut state, index, true);
                state.under_way.push(kept);
            }
            Action::Lose(index) => {
                state.losses -= 1;
                state.under_way.remove(index);
            }
            Action::Die(role) => {
                state.crashes -= 1;
                state.companions[role] = None;
            }
        }
        Some(state)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let mut properties = vec![
            Property::<Self>::always("S1: I radiates on a lease of J alone", |_, state| state.s1),
            Property::<Self>::always("S2: J radiates in a committed slot alone", |_, state| state.s2),
            Property::<Self>::sometimes("a slot is served", |_, state| state.served),
            Property::<Self>::always("S3: J jams whenever I radiates", |_, state| state.s3),
        ];
        if self.losses.is_some() {
            properties.push(Property::<Self>::eventually("the slot is served", |_, state| state.served));
        }
        properties
    }
}

/// What an exploration found.
pub struct Explored {
    /// Different states.
    pub states: usize,
    /// Names of the properties that do not hold.
    pub broken: Vec<&'static str>,
    report: String,
}

impl std::fmt::Display for Explored {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.report)
    }
}

/// Explores, until a bug put in is found or everything is seen.
pub fn explore(model: SlotModel) -> Explored {
    let properties = model.properties();
    let (name, liveness) = (format!("{:?}", model.bug), model.losses.is_some());
    let stop = match model.bug {
        Bug::None => HasDiscoveries::All,
        _ => HasDiscoveries::AnyFailures,
    };
    let clock = Clock::real();
    let checker = model.checker().threads(1).finish_when(stop).spawn_bfs().join();
    // A discovery is a counterexample, except of what is to happen sometimes: there it is the example.
    let breaks = |p: &Property<SlotModel>| {
        (checker.discovery(p.name).is_some()) != matches!(p.expectation, Expectation::Sometimes)
    };
    let broken: Vec<_> = properties.iter().filter(|p| breaks(p)).map(|p| p.name).collect();
    let states = checker.unique_state_count();
    let mut report = format!(
        "bug put in: {name}{}: {states} states ({} with repetitions), depth {}, {:.1} s",
        if liveness { ", few losses" } else { "" },
        checker.state_count(),
        checker.max_depth(),
        clock.now().since_start().as_secs_f64()
    );
    for property in &properties {
        let kind = match property.expectation {
            Expectation::Always => "always",
            Expectation::Eventually => "eventually",
            Expectation::Sometimes => "sometimes",
        };
        let path = checker.discovery(property.name).map(|path| path.into_actions());
        let verdict = match (broken.contains(&property.name), path) {
            (true, Some(path)) => format!("BROKEN in {} steps: {path:?}", path.len()),
            (true, None) => "NOT SEEN".to_owned(),
            (false, _) => "holds".to_owned(),
        };
        report += &format!("\n  {kind:<10} {:<45} {verdict}", property.name);
    }
    Explored { states, broken, report }
}
