//! What one half of the service says of itself, and does when it is told to, at a moment of a slot: a pair on a link
//! without delay or loss, its radios in reach.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{MavMessage as Common, TIMESYNC_DATA};
use veilwing::geo::Enu;
use veilwing::pair::Order;
use veilwing::pair::wire::{self, VeilwingSilence};
use veilwing::role::{PerVehicle, Role};
use veilwing::service::{Outgoing, Standing, Tolerance, Vehicle};
use veilwing::time::Instant;

use super::clocks::Clocks;
use super::companion::Companion;
use super::radio::Radio;
use super::setup::{Flown, LEASE, NUMBERED, service, system};

const STEP: Duration = Duration::from_millis(1);

pub(super) struct Pair {
    pub(super) t: Duration,
    pub(super) companions: PerVehicle<Companion>,
    radios: PerVehicle<Radio>,
    /// Whose messages do not reach the other.
    pub(super) unheard: PerVehicle<bool>,
    /// Whose radio does not say anything.
    pub(super) dumb: PerVehicle<bool>,
    /// What was said to the other, heard or not.
    pub(super) said: Vec<(Role, wire::MavMessage)>,
}

impl Pair {
    pub(super) fn new() -> Self {
        Self::apart(0)
    }

    /// J's UTC is ahead by so much.
    pub(super) fn apart(utc_error_us: i64) -> Self {
        let companions = PerVehicle::from_fn(|role| {
            let utc_error_us = if role == Role::J { utc_error_us } else { 0 };
            let clocks = Clocks { started: Duration::ZERO, rate: 1.0, utc_error_us };
            let boot = if role == Role::I { 1 } else { 2 };
            let flown = Flown::default();
            Companion::new(role, clocks, service(role, boot, NUMBERED, LEASE, &flown), &flown)
        });
        Self {
            t: Duration::ZERO,
            companions,
            radios: PerVehicle::default(),
            unheard: PerVehicle::default(),
            dumb: PerVehicle::default(),
            said: Vec::new(),
        }
    }

    /// In the middle of the airtime of slot 2, both on the air.
    pub(super) fn on_air() -> Self {
        let mut pair = Self::new();
        pair.until(|pair| pair.is_on(Role::I) && pair.companions.i.service.slot_number() == 2);
        pair.run(Duration::from_millis(500));
        assert!(pair.is_on(Role::I) && pair.is_on(Role::J));
        pair
    }

    pub(super) fn now(&self) -> Instant {
        self.companions.i.clocks.local(self.t)
    }

    pub(super) fn is_on(&self, role: Role) -> bool {
        self.companions[role].service.interlock().is_on()
    }

    pub(super) fn standing(&self, role: Role) -> Standing {
        self.companions[role].service.standing()
    }

    pub(super) fn gave_up(&self, role: Role) -> &str {
        self.companions[role].aborted.as_deref().unwrap_or("no")
    }

    /// An order at this vehicle, and what comes of it there.
    pub(super) fn order(&mut self, role: Role, order: Order) {
        let now = self.now();
        self.companions[role].service.orders_mut().give(order, now);
        self.companions[role].handle_timeout(self.t);
    }

    pub(super) fn step(&mut self) {
        self.t += STEP;
        let t = self.t;
        for role in Role::BOTH {
            if t.as_millis().is_multiple_of(200) && !self.dumb[role] {
                let report = self.radios[role].report(t);
                self.companions[role].handle_radio(&report, t);
            }
            if self.companions[role].wake_at() <= t {
                self.companions[role].handle_timeout(t);
            }
            while let Some(message) = self.companions[role].service.poll_transmit() {
                match message {
                    Outgoing::Pair(message) => {
                        if !self.unheard[role] {
                            self.companions[role.peer()].handle_pair(&message, t);
                        }
                        self.said.push((role, *message));
                    }
                    Outgoing::Radio(message) => {
                        if let Common::COMMAND_INT(command) = *message {
                            let answer = self.radios[role].command(&command, t);
                            if !self.dumb[role] {
                                self.companions[role].handle_radio(&answer, t);
                            }
                        }
                    }
                }
            }
        }
    }

    pub(super) fn run(&mut self, span: Duration) {
        let end = self.t + span;
        while self.t < end {
            self.step();
        }
    }

    pub(super) fn until(&mut self, reached: impl Fn(&Self) -> bool) {
        let latest = self.t + Duration::from_secs(60);
        while !reached(self) {
            assert!(self.t < latest, "{:?}", Role::BOTH.map(|role| self.standing(role)));
            self.step();
        }
    }
}

#[test]
fn spec_what_a_half_says_of_itself_in_the_course_of_a_slot() {
    let mut pair = Pair::new();
    assert_eq!(pair.standing(Role::I), Standing::Away);
    pair.run(Duration::from_millis(20));
    assert_eq!((pair.standing(Role::I), pair.companions.i.service.slot_number()), (Standing::Between, 0));
    pair.until(|pair| {
        pair.companions.i.service.slot_number() == 2 && pair.standing(Role::I) == Standing::Agreed
    });
    assert_eq!((pair.standing(Role::J), pair.companions.j.service.slot_number()), (Standing::Agreed, 2));
    let (now, i) = (pair.now(), &pair.companions.i.service);
    assert!(i.silence(now).is_some() && i.lease_end(now).is_none() && i.slot().is_some());
    pair.until(|pair| pair.standing(Role::I) == Standing::OnAir);
    assert_eq!(pair.standing(Role::J), Standing::OnAir);
    pair.run(Duration::from_millis(300));
    let now = pair.now();
    for role in Role::BOTH {
        let service = &pair.companions[role].service;
        assert_eq!(service.silence(now), None);
        let end = service.lease_end(now).unwrap();
        assert_eq!(service.jam_lease(now), Some(end).filter(|_| role == Role::I));
        assert!(end > now && end <= now + LEASE, "{role}: {end:?} at {now:?}");
    }
    pair.until(|pair| pair.companions.i.service.slot_number() == 3);
    assert!(pair.gave_up(Role::I) == "no" && pair.gave_up(Role::J) == "no");
}

#[test]
fn spec_a_pause_between_slots_is_said_and_one_in_a_slot_closes_it() {
    let mut pair = Pair::new();
    pair.run(Duration::from_millis(20));
    pair.order(Role::I, Order::Pause);
    assert_eq!(pair.standing(Role::I), Standing::Paused);
    pair.order(Role::I, Order::Continue);
    assert_eq!(pair.standing(Role::I), Standing::Between);
    let mut pair = Pair::on_air();
    pair.order(Role::I, Order::Pause);
    assert!(!pair.is_on(Role::I), "at once");
    pair.until(|pair| !pair.is_on(Role::J));
    pair.until(|pair| Role::BOTH.into_iter().all(|role| pair.standing(role) == Standing::Paused));
    pair.order(Role::J, Order::Continue);
    pair.until(|pair| pair.is_on(Role::I));
}

#[test]
fn spec_a_killed_j_jams_on_while_i_may_rest_on_it_and_says_so() {
    let mut pair = Pair::on_air();
    pair.order(Role::J, Order::Kill);
    assert_eq!((pair.is_on(Role::J), pair.standing(Role::J)), (true, Standing::JammingOnKilled));
    let told_at = pair.t;
    pair.until(|pair| !pair.is_on(Role::J));
    assert!(!pair.is_on(Role::I) && pair.t - told_at <= LEASE, "{:?}", pair.t - told_at);
    assert_ne!(pair.standing(Role::J), Standing::JammingOnKilled);
    let mut pair = Pair::on_air();
    pair.order(Role::I, Order::Kill);
    assert!(!pair.is_on(Role::I), "at once");
    pair.until(|pair| !pair.is_on(Role::J));
}

/// 0.88 m off: beyond what a vehicle must come to, within what it serves at.
#[test]
fn spec_who_hangs_at_the_edge_of_its_pose_stays_on_the_air_and_does_not_come_on() {
    fn at_the_edge(here: &mut Vehicle) {
        here.position.as_mut().unwrap().0 += Enu::new(0.88, 0.0, 0.0);
    }
    for role in Role::BOTH {
        let mut pair = Pair::new();
        pair.until(|pair| pair.standing(role) == Standing::Agreed);
        let slot = pair.companions[role].service.slot().unwrap();
        let (opens_at, later) = (slot.commitment.opens_at, slot.radiate_from + Duration::from_secs(1));
        // By then it has come, and it does not leave.
        pair.until(|pair| pair.now() >= opens_at);
        pair.companions[role].amiss = at_the_edge;
        pair.until(|pair| pair.now() >= later);
        assert!(!pair.is_on(role) && !pair.is_on(Role::I), "{role}");
        pair.companions[role].amiss = |_| {};
        pair.until(|pair| pair.is_on(Role::I));
        assert_eq!(pair.companions[role].service.slot_number(), 0, "{role}");
        pair.companions[role].amiss = at_the_edge;
        pair.run(Duration::from_millis(200));
        assert!(pair.is_on(Role::I) && pair.is_on(Role::J), "{role}");
    }
}

#[test]
fn spec_j_leaves_once_i_is_off_and_i_at_once() {
    let mut pair = Pair::on_air();
    let (now, t) = (pair.now(), pair.t);
    assert!(!pair.companions.j.service.abandon(now));
    assert!(pair.companions.j.service.is_abandoning());
    assert_eq!(pair.standing(Role::J), Standing::JammingOnLeaving);
    pair.companions.j.handle_timeout(t);
    pair.until(|pair| pair.gave_up(Role::J) != "no");
    assert!(!pair.is_on(Role::I) && !pair.is_on(Role::J) && pair.t - t <= LEASE);
    assert!(!pair.companions.j.service.is_abandoning());
    assert_eq!(pair.standing(Role::J), Standing::Away);
    let mut pair = Pair::on_air();
    let now = pair.now();
    assert!(pair.companions.i.service.abandon(now) && !pair.companions.i.service.is_abandoning());
    assert_eq!((pair.standing(Role::I), pair.companions.i.service.slot_number()), (Standing::Away, 0));
}

#[test]
fn spec_who_drops_out_is_silent_at_once_and_the_other_is_told_why() {
    for role in Role::BOTH {
        let mut pair = Pair::on_air();
        let (now, t) = (pair.now(), pair.t);
        pair.companions[role].service.drop_out(VeilwingSilence::VEILWING_SILENCE_ESTIMATOR, now);
        pair.companions[role].handle_timeout(t);
        assert!(!pair.is_on(role) && pair.standing(role) == Standing::Away);
        pair.until(|pair| pair.gave_up(role.peer()) != "no");
        assert!(pair.t - t <= LEASE, "it is told, and does not wait until it misses us");
        let why = if role == Role::J { "ESTIMATOR" } else { "once the other was off" };
        assert!(pair.gave_up(role.peer()).contains(why), "{}", pair.gave_up(role.peer()));
    }
}

#[test]
fn spec_a_silence_that_is_told_ends_the_other_s_mission_and_not_our_own() {
    let mut pair = Pair::on_air();
    let (now, t) = (pair.now(), pair.t);
    pair.companions.j.service.tell_silence(VeilwingSilence::VEILWING_SILENCE_CONTROL, now);
    pair.companions.j.handle_timeout(t);
    pair.step();
    assert!(pair.gave_up(Role::I).contains("CONTROL"), "{}", pair.gave_up(Role::I));
    assert_eq!(pair.gave_up(Role::J), "no");
}

#[test]
fn spec_a_companion_that_ends_tells_the_other_and_j_waits_for_i() {
    let mut pair = Pair::on_air();
    let now = pair.now();
    assert!(pair.companions.i.service.shut_down(now), "nobody rests on it");
    assert!(!pair.is_on(Role::I));
    let began = pair.t;
    pair.until(|pair| pair.gave_up(Role::J) != "no");
    assert!(pair.t - began <= LEASE, "it is told, and does not wait until it misses us");
    let mut pair = Pair::on_air();
    let (now, began) = (pair.now(), pair.t);
    assert!(!pair.companions.j.service.shut_down(now), "I rests on it");
    assert!(pair.is_on(Role::J));
    loop {
        pair.step();
        let now = pair.now();
        if pair.companions.j.service.shut_down(now) {
            break;
        }
        assert!(pair.t - began <= LEASE);
    }
    assert!(!pair.is_on(Role::I) && !pair.is_on(Role::J));
    assert!(pair.gave_up(Role::I).contains("SHUTDOWN"), "{}", pair.gave_up(Role::I));
}

#[test]
fn spec_where_the_permission_ends_i_is_silent_at_once_and_j_once_i_is() {
    for role in Role::BOTH {
        let mut pair = Pair::on_air();
        let t = pair.t;
        pair.companions[role].service.set_permitted(false);
        pair.companions[role].handle_timeout(t);
        assert_eq!(pair.is_on(role), role == Role::J);
        if role == Role::J {
            pair.companions.i.service.set_permitted(false);
            pair.companions.i.handle_timeout(t);
        }
        pair.until(|pair| !pair.is_on(role));
        assert!(!pair.is_on(Role::I) && pair.t - t <= LEASE);
    }
}

#[test]
fn spec_the_tolerance_of_the_slots_to_come_can_be_set() {
    let mut pair = Pair::new();
    // Nowhere is near enough.
    pair.companions.i.service.set_tolerance(Tolerance::of(-1.0, 0.05, 0.0));
    while pair.companions.j.service.slot_number() < 2 {
        pair.step();
        assert!(!pair.is_on(Role::I));
    }
}

#[test]
fn spec_a_radio_that_asks_for_the_time_is_answered() {
    let mut pair = Pair::new();
    pair.run(Duration::from_millis(20));
    let now = pair.now();
    let from = MavHeader { system_id: system(Role::I).into(), component_id: 68, sequence: 0 };
    let asked = TIMESYNC_DATA { tc1: 0, ts1: 5, ..TIMESYNC_DATA::DEFAULT };
    pair.companions.i.service.handle_radio(from, &Common::TIMESYNC(asked), now);
    let sent: Vec<_> = std::iter::from_fn(|| pair.companions.i.service.poll_transmit()).collect();
    let answered = |message: &Outgoing| match message {
        Outgoing::Radio(message) => matches!(**message, Common::TIMESYNC(TIMESYNC_DATA { ts1: 5, .. })),
        Outgoing::Pair(_) => false,
    };
    assert!(sent.iter().any(answered), "{sent:?}");
}
