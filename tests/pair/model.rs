//! Exhaustive check of a slot over the real state machines, by `stateright`.
//!
//! Both companions agree on a slot over a good network and come on station; from shortly before the airtime to after
//! the slot's close, everything that can happen is then explored: time goes on by a step, any message under way (at
//! most two in each direction, older ones are lost) is delivered once, or delivered and kept for a second time, in any
//! order; either companion dies at any step, and comes back at any later one. Radios obey at once and fall silent by
//! themselves; what they answer can be held up from any step on, and then comes late, twice or never. J's UTC is 0.2 s
//! ahead. Hello and clock messages are left out within a slot: nothing after the agreement depends on them. Each
//! configuration explores some of this: all at once would be too much.

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
use super::kept::{Kept, hash_text};
use super::radio::{Radio, Said};
use super::setup::{Flown, LEASE, NUMBERED, TICK, powered, service};
use veilwing::pair::adoption::GRACE;

/// A bug put in on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bug {
    None,
    LeaseNeverExpires,
    JOffBeforeI,
    GrantCountedFromReceipt,
    /// I says of its poses what makes J take them for its own.
    PosesNotCompared,
}

#[derive(Debug, Clone)]
pub struct SlotModel {
    pub bug: Bug,
    pub step: Duration,
    /// Slots are short, so that everything can be explored. Of each a second is guard.
    pub flown: Flown,
    /// Everything that can happen is explored from so long before the first slot's airtime ends; from before it begins, if not given.
    pub before_its_end: Option<Duration>,
    /// From when I first proposes a slot, instead.
    pub from_the_proposal: bool,
    pub copies: u8,
    pub crashes: u8,
    /// Companions that come back.
    pub restarts: u8,
    /// With a budget of losses every other message arrives before time goes on; without, messages wait as they like.
    pub losses: Option<u8>,
    /// Radios that number their commands; how often what they answer is held up, or comes twice. Every crystal is then off
    /// as far as crystals are.
    pub radio_troubles: Option<u8>,
    pub slots: usize,
}

#[derive(Debug, Clone)]
pub struct State {
    t: Duration,
    companions: PerVehicle<Kept<Option<Companion>>>,
    radios: PerVehicle<Radio>,
    under_way: Vec<(Role, MavMessage)>,
    /// What radios have answered, and whose answers are held up.
    answers: Vec<(Role, Said)>,
    held_up: PerVehicle<bool>,
    next_report: Duration,
    copies: u8,
    crashes: u8,
    restarts: u8,
    losses: u8,
    radio_troubles: u8,
    /// Its first companion has died: what is on the air is that one's.
    j_has_died: bool,
    i_has_died: bool,
    granted_until: Duration,
    served: bool,
    /// By number.
    last_served: Option<i32>,
    s1: bool,
    s2: bool,
    s3: bool,
    /// Motions that are made anew: the last that J flew, whether I was on in what J flew only, and whether both flew one while I was
    /// on: the last there is.
    j_flew: u16,
    alike: bool,
    joined: bool,
    /// Whether both had the same poses whenever both were committed to a proposal, and whether they ever were.
    same_poses: bool,
    committed: bool,
}

impl PartialEq for State {
    fn eq(&self, other: &Self) -> bool {
        format!("{self:?}") == format!("{other:?}")
    }
}

impl Hash for State {
    fn hash<H: Hasher>(&self, state: &mut H) {
        hash_text(self, state);
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Action {
    Step,
    Deliver(usize),
    DeliverAndKeep(usize),
    Lose(usize),
    Die(Role),
    Restart(Role),
    HoldUpAnswers(Role),
    Answer(usize),
    AnswerAndKeep(usize),
}

/// A radio says by itself what it does.
const REPORT_EVERY: Duration = Duration::from_millis(200);
/// What J turns in a tenth of a second, before it hears that I is off.
const OFF_USER_RAD: f64 = 0.06;
/// The worst that crystals do, in parts per million.
const CRYSTAL_PPM: f64 = 45.0;

impl SlotModel {
    fn start(&self) -> State {
        let lease = if self.bug == Bug::LeaseNeverExpires { Duration::from_secs(60) } else { LEASE };
        let companions = PerVehicle::from_fn(|role| {
            let (utc_error_us, boot, lease) = match role {
                Role::I => (0, 1, lease),
                Role::J => (200_000, 2, LEASE),
            };
            let clocks = Clocks { started: Duration::ZERO, rate: self.rate(role), utc_error_us };
            let mut companion = Companion::new(
                role,
                clocks,
                service(role, boot, self.radio(), lease, &self.flown),
                &self.flown,
            );
            companion.to_ask = if role == Role::I { self.flown.motions } else { 0 };
            companion.to_ask_from = self.before_its_end.unwrap_or_default();
            Kept::new(Some(companion))
        });
        let mut radios = PerVehicle::<Radio>::default();
        if self.radio_troubles.is_some() {
            (radios.i.fast_ppm, radios.j.fast_ppm) = (-CRYSTAL_PPM, CRYSTAL_PPM);
        }
        let mut state = State {
            t: Duration::ZERO,
            companions,
            radios,
            under_way: Vec::new(),
            answers: Vec::new(),
            held_up: PerVehicle::default(),
            next_report: if self.radio_troubles.is_some() { Duration::ZERO } else { Duration::MAX },
            copies: self.copies,
            crashes: self.crashes,
            restarts: self.restarts,
            losses: self.losses.unwrap_or(0),
            radio_troubles: self.radio_troubles.unwrap_or(0),
            j_has_died: false,
            i_has_died: false,
            granted_until: Duration::ZERO,
            served: false,
            last_served: None,
            s1: true,
            s2: true,
            s3: true,
            j_flew: 0,
            alike: true,
            joined: false,
            same_poses: true,
            committed: false,
        };
        let early = |state: &State| {
            if self.from_the_proposal {
                let proposed =
                    |(_, message): &(Role, MavMessage)| matches!(message, MavMessage::VEILWING_PROPOSE(_));
                return !state.under_way.iter().any(proposed);
            }
            let slot = state.companions.i.as_ref().and_then(|i| i.service.slot());
            slot.is_none_or(|slot| match self.before_its_end {
                None => state.t + self.step < slot.radiate_from.since_start(),
                Some(before) => state.t + before < slot.radiate_until.since_start(),
            })
        };
        while early(&state) {
            let to = state.t + Duration::from_millis(5);
            self.pass(&mut state, to, false);
            while early(&state) && !state.under_way.is_empty() {
                self.deliver(&mut state, 0, false);
            }
        }
        state
    }

    /// Where answers come at once, numbers and clocks would only tell states apart that are the same.
    fn radio(&self) -> Kind {
        match self.radio_troubles {
            None => Kind::Leased { command: 31010 },
            Some(_) => NUMBERED,
        }
    }

    /// J's clock against I's is off by what two crystals can be.
    fn rate(&self, role: Role) -> f64 {
        let ppm = if role == Role::I { -CRYSTAL_PPM } else { CRYSTAL_PPM };
        1.0 + if self.radio_troubles.is_some() { ppm * 1e-6 } else { 0.0 }
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
            let next = wakes.chain(ends).chain([(state.next_report, None)]).min();
            let Some((at, who)) = next.filter(|(at, _)| *at <= until) else { break };
            state.t = at;
            if at == state.next_report {
                state.next_report += REPORT_EVERY;
                for role in Role::BOTH {
                    let report = state.radios[role].report(at);
                    self.answered(state, role, report, bounded);
                }
            }
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

    /// A radio's word reaches its companion, unless it is held up.
    fn answered(&self, state: &mut State, role: Role, answer: Said, bounded: bool) {
        if self.hold_up(state, role, &answer) {
            return;
        }
        if let Some(companion) = state.companions[role].as_mut() {
            companion.handle_radio(&answer, state.t);
        }
        self.collect(state, role, bounded);
    }

    /// At most two words wait; older ones never come.
    fn hold_up(&self, state: &mut State, role: Role, answer: &Said) -> bool {
        if !state.held_up[role] {
            return false;
        }
        state.answers.push((role, answer.clone()));
        if state.answers.len() > 2 {
            state.answers.remove(0);
        }
        true
    }

    fn collect(&self, state: &mut State, role: Role, bounded: bool) {
        while let Some(message) = state.companions[role].as_mut().and_then(|c| c.service.poll_transmit()) {
            let message = match message {
                Outgoing::Pair(message) => *message,
                Outgoing::Radio(message) => {
                    if let RadioMessage::COMMAND_INT(command) = *message {
                        let answer = state.radios[role].command(&command, state.t);
                        if !self.hold_up(state, role, &answer)
                            && let Some(companion) = state.companions[role].as_mut()
                        {
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
            // A proposal for places comes as two.
            if bounded && waiting > 2 + usize::from(self.flown.renews.is_some()) {
                let oldest = state.under_way.iter().position(|(whose, _)| *whose == to);
                oldest.map(|oldest| state.under_way.remove(oldest));
            }
        }
    }

    fn late_answer(&self, state: &mut State, index: usize, keep: bool) {
        let (role, answer) = state.answers.remove(index);
        if let Some(companion) = state.companions[role].as_mut() {
            companion.handle_radio(&answer, state.t);
        }
        if keep {
            state.answers.push((role, answer));
        }
        self.collect(state, role, true);
        self.look(state);
    }

    fn deliver(&self, state: &mut State, index: usize, bounded: bool) {
        let (to, mut message) = state.under_way.remove(index);
        match (&mut message, self.bug) {
            (MavMessage::VEILWING_LEASE_GRANT(grant), Bug::GrantCountedFromReceipt) => {
                grant.time_us = state.t.as_micros() as u64;
            }
            (MavMessage::VEILWING_LEASE_GRANT(grant), Bug::LeaseNeverExpires) => grant.duration_ms = 60_000,
            (MavMessage::VEILWING_STATUS(status), Bug::JOffBeforeI) => status.released_us = u64::MAX,
            (MavMessage::VEILWING_PLACES(places), Bug::PosesNotCompared) => places.begins_ms += 1,
            (MavMessage::VEILWING_PROPOSE(propose), Bug::PosesNotCompared) => {
                let number = u32::from(propose.plan_digest[0]);
                propose.plan_digest = propose.plan_digest.map(|byte| byte + 1);
                propose.i_power_w *= (powered(number + 1) / powered(number)) as f32;
            }
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
            state.last_served = state.last_served.max(Some(i.slot).filter(|_| jammed));
        }
        // One that is back takes nothing over.
        if let Some(j) = state.companions.j.as_ref().filter(|_| !state.j_has_died) {
            state.j_flew = j.flies.0;
        }
        if let (Some(_), Some(i), false) = (on.i, &*state.companions.i, state.i_has_died) {
            let (number, begins_at, [i_flew, j_flew]) = i.flies;
            let begun = i.clocks.local(state.t).saturating_since(begins_at);
            let nearly = i_flew == j_flew && state.j_flew == j_flew && begun <= GRACE + TICK;
            state.alike &= number == state.j_flew || nearly;
            state.joined |= number == self.flown.motions && number == state.j_flew;
        }
        if let (Some(i), Some(j)) = (&*state.companions.i, &*state.companions.j) {
            let proposal = |of: &Companion| of.service.slot().map(|slot| slot.commitment.proposal);
            if proposal(i).is_some() && proposal(i) == proposal(j) {
                state.committed = true;
                state.same_poses &= i.service.slot_vehicles() == j.service.slot_vehicles();
            }
        }
        if on.j.is_some() {
            // A dead companion's radio runs out within its lease, which no slot's end shortens afterwards.
            let committed = state.companions.j.as_ref().is_some_and(|j| j.service.slot().is_some());
            state.s2 &= committed || state.j_has_died;
            let off_user_rad = state.companions.j.as_ref().map_or(0.0, |j| j.off_user_rad(state.t));
            state.s2 &= off_user_rad < OFF_USER_RAD;
        }
    }

    fn is_last(&self, slot: Option<i32>) -> bool {
        slot.is_some_and(|slot| slot as usize + 1 == self.slots)
    }

    fn over(&self, state: &State) -> bool {
        let flown = |c: &Companion| c.aborted.is_some() || c.finished.len() >= self.slots;
        let ends = |c: &Companion| c.service.slot().is_none() && flown(c);
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
        let (alive, dead): (Vec<_>, Vec<_>) =
            Role::BOTH.into_iter().partition(|role| state.companions[*role].is_some());
        if state.crashes > 0 {
            actions.extend(alive.into_iter().map(Action::Die));
        }
        if state.restarts > 0 {
            actions.extend(dead.into_iter().map(Action::Restart));
        }
        if self.losses.is_some() && !state.under_way.is_empty() {
            return;
        }
        for index in 0..state.answers.len() {
            actions.push(Action::Answer(index));
            if state.radio_troubles > 0 {
                actions.push(Action::AnswerAndKeep(index));
            }
        }
        if state.radio_troubles > 0 {
            let prompt = Role::BOTH.into_iter().filter(|role| !state.held_up[*role]);
            actions.extend(prompt.map(Action::HoldUpAnswers));
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
                *state.companions[role] = None;
                state.j_has_died |= role == Role::J;
                state.i_has_died |= role == Role::I;
            }
            Action::Restart(role) => {
                state.restarts -= 1;
                let clocks = Clocks { started: state.t, rate: self.rate(role), utc_error_us: 0 };
                let service = service(role, 3, self.radio(), LEASE, &self.flown);
                let mut born = Companion::new(role, clocks, service, &self.flown);
                // In flight it takes nothing over.
                (born.aborted, born.joining) = (Some("back in the air".into()), false);
                *state.companions[role] = Some(born);
            }
            Action::HoldUpAnswers(role) => {
                state.radio_troubles -= 1;
                state.held_up[role] = true;
            }
            Action::Answer(index) => self.late_answer(&mut state, index, false),
            Action::AnswerAndKeep(index) => {
                state.radio_troubles -= 1;
                self.late_answer(&mut state, index, true);
            }
        }
        Some(state)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let mut properties = vec![
            Property::<Self>::always("S1: I radiates on a lease of J alone", |_, state| state.s1),
            Property::<Self>::always("S2: J radiates in a committed slot alone", |_, state| state.s2),
            Property::<Self>::sometimes("a slot is served", |_, state| state.served),
            Property::<Self>::sometimes("it is the last one", |model, state| {
                model.is_last(state.last_served)
            }),
            Property::<Self>::always("S3: J jams whenever I radiates", |_, state| state.s3),
        ];
        if self.flown.motions > 0 {
            properties.push(Property::<Self>::always("I radiates in the motion that J flies", |_, state| {
                state.alike
            }));
            properties.push(Property::<Self>::sometimes("both fly the last motion", |_, state| state.joined));
        }
        if self.flown.anew || self.flown.renews.is_some() {
            properties.push(Property::<Self>::always("both serve a slot from the same poses", |_, state| {
                state.same_poses
            }));
            properties.push(Property::<Self>::sometimes("both are committed", |_, state| state.committed));
        }
        // Not so without the radio's answers, nor where one may die before it begins.
        let may_be_left = self.from_the_proposal && self.crashes > 0;
        if self.losses.is_some() && self.radio_troubles.is_none() && !may_be_left {
            properties.push(Property::<Self>::eventually("the last slot is served", |model, state| {
                model.crashes > 0 && state.served || model.is_last(state.last_served)
            }));
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
