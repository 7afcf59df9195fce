//! Where one half of the service turns from one thing to another: what it may count on, when it asks, tells, waits and gives up.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavMessage as Common;
use veilwing::pair::Order;
use veilwing::pair::wire::{MavMessage, VeilwingFlags, VeilwingSilence};
use veilwing::role::Role;
use veilwing::service::{Event, Jamming, Outgoing, Served, Silence, Slot, Standing, Vehicle};

use super::service::Pair;
use super::setup::{CAP_W, GUARD, LEAD, LEASE, PLANNED_W, SLOT, SLOTS};

const LATEST: Duration = Duration::from_secs(3);

impl Pair {
    /// Slot `slot` is agreed on by both.
    fn agreed(slot: u16) -> Self {
        let mut pair = Self::new();
        pair.listen();
        pair.until(|pair| {
            let agreed = |role| pair.slot(role).is_some_and(|is| is.commitment.slot == slot);
            Role::BOTH.into_iter().all(agreed)
        });
        pair
    }

    fn slot(&self, role: Role) -> Option<&Slot> {
        self.companions[role].service.slot()
    }

    /// Both, from now on.
    fn listen(&mut self) {
        Role::BOTH.into_iter().for_each(|role| self.companions[role].events = Some(Vec::new()));
    }

    fn heard(&self, role: Role) -> &[Event] {
        self.companions[role].events.as_deref().unwrap_or_default()
    }

    /// How often `role` has said what `is` is about.
    fn told(&self, role: Role, is: impl Fn(&MavMessage) -> bool) -> usize {
        self.said.iter().filter(|(who, message)| *who == role && is(message)).count()
    }

    /// To the first instant of the slot of `role` at which that is so.
    fn to(&mut self, role: Role, at: impl Fn(&Slot) -> veilwing::time::Instant) {
        self.until(|pair| pair.slot(role).is_some_and(|slot| pair.now() >= at(slot)));
    }

    fn says(&self, role: Role, flag: VeilwingFlags) -> bool {
        self.companions[role.peer()].service.peer().says(flag)
    }

    /// Its owner has ended the mission, and the service goes on.
    fn ends(&mut self, role: Role) {
        self.companions[role].aborted = Some("it was enough".into());
    }
}

fn asks(message: &MavMessage) -> bool {
    matches!(message, MavMessage::VEILWING_LEASE_REQUEST(_))
}

fn grants(message: &MavMessage) -> bool {
    matches!(message, MavMessage::VEILWING_LEASE_GRANT(_))
}

/// Three copies of each.
fn silences(message: &MavMessage) -> bool {
    matches!(message, MavMessage::VEILWING_SILENT(_))
}

#[test]
fn spec_plans_and_clocks_agree_once_they_are_compared_and_by_how_much_clocks_differ_is_said() {
    for (ahead_us, agree) in [(40_000, true), (400_000, false)] {
        let mut pair = Pair::apart(ahead_us);
        for role in Role::BOTH {
            let service = &pair.companions[role].service;
            assert!(!service.agrees() && !service.clocks_agree() && service.clock_offset_s().is_none());
        }
        pair.run(Duration::from_secs(3));
        for (role, sign) in [(Role::I, 1.0), (Role::J, -1.0)] {
            let service = &pair.companions[role].service;
            assert_eq!((service.agrees(), service.clocks_agree()), (true, agree), "{role}");
            let ahead_s = service.clock_offset_s().unwrap();
            assert!((ahead_s - sign * ahead_us as f64 * 1e-6).abs() < 2e-3, "{role}: {ahead_s}");
        }
    }
}

#[test]
fn spec_slots_follow_each_other_without_a_refusal_and_each_leaves_time_for_its_transit() {
    let mut pair = Pair::agreed(4);
    let [i, j] = Role::BOTH.map(|role| pair.heard(role).to_vec());
    assert!(!i.iter().chain(&j).any(|event| matches!(event, Event::Refused(..) | Event::GiveUp(_))));
    pair.listen();
    let mut opened_at = pair.slot(Role::I).unwrap().commitment.opens_at;
    for slot in 5..SLOTS {
        pair.until(|pair| pair.slot(Role::I).is_some_and(|is| is.commitment.slot == slot));
        let (now, is) = (pair.now(), pair.slot(Role::I).unwrap().commitment);
        let agreement = pair.companions.i.service.agreement_time();
        assert!(is.leaves_at >= now && is.opens_at == is.leaves_at + LEAD, "{is:?} at {now:?}");
        let longest = SLOT + agreement + LEAD + Duration::from_millis(50);
        let apart = is.opens_at.saturating_since(opened_at);
        assert!(apart >= SLOT + LEAD && apart <= longest, "slot {slot} opens {apart:?} after the last");
        opened_at = is.opens_at;
    }
}

#[test]
fn spec_no_slot_is_agreed_on_before_both_are_where_their_last_ways_end() {
    for role in Role::BOTH {
        let mut pair = Pair::new();
        pair.companions[role].amiss = |here| here.arrived = false;
        pair.run(Duration::from_secs(5));
        assert_eq!(Role::BOTH.map(|role| pair.standing(role)), [Standing::Between; 2], "{role}");
        pair.companions[role].amiss = |_| {};
        let came_at = pair.t;
        pair.until(|pair| pair.slot(Role::I).is_some() && pair.slot(Role::J).is_some());
        assert!(pair.t - came_at < Duration::from_secs(1), "{role}");
    }
}

#[test]
fn spec_a_slot_is_switched_on_once_and_off_once_in_its_window_and_nobody_is_told_of_a_silence() {
    let mut pair = Pair::agreed(2);
    pair.until(|pair| pair.companions.i.service.slot_number() == 3);
    let before = pair.t;
    pair.until(|pair| pair.companions.j.service.slot_number() == 3);
    pair.run(Duration::from_millis(20));
    assert!(pair.t - before < Duration::from_millis(40));
    for role in Role::BOTH {
        let power_w = PLANNED_W[role].min(CAP_W[role]);
        let of_slot = |event: &&Event| match event {
            Event::On(permit) => permit.slot == 2,
            _ => false,
        };
        let heard = pair.heard(role);
        let first = heard.iter().position(|event| of_slot(&event)).unwrap();
        let switched: Vec<_> =
            heard[first..].iter().filter(|event| matches!(event, Event::On(_) | Event::Off(_))).collect();
        let [Event::On(permit), Event::Off(silence)] = switched[..] else { panic!("{role}: {switched:?}") };
        assert_eq!((permit.power_w, *silence), (power_w, Silence::NoSlot), "{role}");
        assert!(heard.contains(&Event::Over(2, Served::Yes)), "{role}: {heard:?}");
        assert_eq!(pair.told(role, silences), 0, "{role}");
    }
}

#[test]
fn spec_i_asks_for_leases_within_its_airtime_and_a_moment_before_and_j_is_off_once_i_is() {
    let mut pair = Pair::agreed(2);
    pair.to(Role::I, |slot| slot.radiate_from - Duration::from_millis(210));
    let before = pair.told(Role::I, asks);
    pair.run(Duration::from_millis(9));
    assert_eq!(pair.told(Role::I, asks), before);
    pair.to(Role::I, |slot| slot.radiate_from);
    assert!(pair.told(Role::I, asks) > before);
    pair.to(Role::I, |slot| slot.radiate_until);
    let asked = pair.told(Role::I, asks);
    pair.run(Duration::from_millis(50));
    assert!(pair.slot(Role::I).is_some() && !pair.is_on(Role::I) && !pair.is_on(Role::J));
    pair.run(GUARD / 2);
    assert_eq!(pair.told(Role::I, asks), asked);
}

#[test]
fn spec_i_asks_for_no_lease_that_it_could_not_use() {
    let amiss: [fn(&mut Pair); 7] = [
        |pair| pair.companions.i.pose_lost = true,
        |pair| pair.companions.i.stale_since = Some(pair.now() - LEASE),
        |pair| pair.companions.i.amiss = |vehicle| vehicle.in_control = false,
        |pair| pair.companions.i.amiss = |vehicle| vehicle.estimator_ok = false,
        |pair| pair.companions.i.service.set_permitted(false),
        |pair| pair.order(Role::I, Order::Kill),
        |pair| pair.order(Role::I, Order::Pause),
    ];
    for (k, comes_about) in amiss.into_iter().enumerate() {
        let mut pair = Pair::on_air();
        // J hears nothing of it, and would go on granting what it is asked for.
        pair.unheard.i = true;
        comes_about(&mut pair);
        let t = pair.t;
        pair.companions.i.handle_timeout(t);
        pair.run(Duration::from_millis(2));
        assert!(!pair.is_on(Role::I), "{k}");
        let asked = pair.told(Role::I, asks);
        pair.run(Duration::from_millis(400));
        assert!(pair.slot(Role::I).is_none_or(|slot| pair.now() < slot.radiate_until), "{k}");
        assert_eq!(pair.told(Role::I, asks), asked, "{k}");
    }
}

#[test]
fn spec_j_grants_nothing_in_a_slot_that_it_closes_though_it_still_jams() {
    let mut pair = Pair::on_air();
    // I hears nothing of it, and asks on.
    pair.unheard.j = true;
    pair.order(Role::J, Order::Pause);
    pair.run(Duration::from_millis(2));
    let (asked, granted) = (pair.told(Role::I, asks), pair.told(Role::J, grants));
    pair.run(Duration::from_millis(300));
    assert!(pair.is_on(Role::J) && pair.is_on(Role::I) && pair.told(Role::I, asks) > asked);
    assert_eq!(pair.told(Role::J, grants), granted);
}

/// A J that has lost control is off at once, and nothing of I's rests on it then.
#[test]
fn spec_j_grants_nothing_past_the_instant_at_which_it_would_lose_its_autopilot() {
    let longest_ms = |amiss: fn(&mut Vehicle)| {
        let mut pair = Pair::on_air();
        pair.companions.j.amiss = amiss;
        let said = pair.said.len();
        pair.run(Duration::from_millis(400));
        let granted = pair.said[said..].iter().filter_map(|(_, message)| match message {
            MavMessage::VEILWING_LEASE_GRANT(grant) => Some(grant.duration_ms),
            _ => None,
        });
        granted.max()
    };
    let soon = longest_ms(|vehicle| vehicle.lost_at = vehicle.state_received_at.map(|at| at + LEASE / 5));
    assert!(soon.is_some_and(|soon| (50..=100).contains(&soon)), "{soon:?}");
    let late = longest_ms(|vehicle| vehicle.lost_at = vehicle.state_received_at.map(|at| at + 10 * LEASE));
    assert!(late == longest_ms(|_| {}) && late > soon, "{late:?}");
}

#[test]
fn spec_j_grants_nothing_past_its_airtime_to_an_i_whose_clock_is_late() {
    let mut pair = Pair::apart(200_000);
    pair.until(|pair| pair.companions.j.service.slot_number() == 2 && pair.is_on(Role::I));
    pair.to(Role::J, |slot| slot.radiate_until);
    let (asked, granted) = (pair.told(Role::I, asks), pair.told(Role::J, grants));
    pair.run(Duration::from_millis(150));
    assert!(pair.is_on(Role::I) && pair.is_on(Role::J) && pair.told(Role::I, asks) > asked);
    assert_eq!(pair.told(Role::J, grants), granted);
}

#[test]
fn spec_a_j_that_is_off_keeps_nobody_waiting_whatever_it_has_granted() {
    let mut pair = Pair::on_air();
    pair.unheard.j = true;
    pair.companions.j.pose_lost = true;
    pair.until(|pair| !pair.is_on(Role::J));
    assert!(pair.is_on(Role::I), "it has not heard of it");
    let now = pair.now();
    assert!(pair.companions.j.service.abandon(now));
}

#[test]
fn spec_an_off_that_is_not_answered_is_due_again_at_once() {
    let mut pair = Pair::on_air();
    pair.dumb.i = true;
    pair.order(Role::I, Order::Pause);
    pair.step();
    let (again_at, _) = pair.companions.i.service.interlock().poll_timeout().unwrap();
    assert!(again_at <= pair.now() + Duration::from_millis(25), "{again_at:?} at {:?}", pair.now());
    assert!(pair.companions.i.service.poll_timeout().0 <= again_at);
}

#[test]
fn spec_j_does_not_radiate_for_an_i_that_is_not_where_it_serves() {
    let mut pair = Pair::agreed(2);
    pair.companions.i.pose_lost = true;
    pair.to(Role::I, |slot| slot.radiate_from - Duration::from_millis(50));
    assert_eq!(Role::BOTH.map(|role| pair.standing(role)), [Standing::Agreed; 2], "nothing is owed yet");
    let mut airtime = false;
    while pair.companions.i.service.slot_number() == 2 {
        pair.step();
        assert!(!pair.is_on(Role::I) && !pair.is_on(Role::J));
        airtime |= Role::BOTH.map(|role| pair.standing(role)) == [Standing::Hindered; 2];
    }
    assert!(airtime);
    pair.run(Duration::from_millis(20));
    // What the last look within the airtime found, and not that it is over now.
    for (role, silence) in [(Role::I, Silence::Pose), (Role::J, Silence::NoPeer)] {
        let over = Event::Over(2, Served::No(Some(silence)));
        assert!(pair.heard(role).contains(&over), "{role}: {:?}", pair.heard(role));
        assert!(!pair.heard(role).iter().any(|event| matches!(event, Event::JammedInVain(..))), "{role}");
    }
    // Nor for one that was there, and is not heard any more.
    let mut pair = Pair::agreed(2);
    pair.to(Role::J, |slot| slot.commitment.opens_at - LEASE - Duration::from_millis(100));
    assert!(pair.says(Role::I, VeilwingFlags::VEILWING_FLAGS_ON_STATION));
    pair.unheard.i = true;
    pair.to(Role::J, |slot| slot.radiate_from + Duration::from_secs(1));
    assert!(!pair.heard(Role::J).iter().any(|event| matches!(event, Event::On(permit) if permit.slot == 2)));
}

#[test]
fn spec_j_ends_a_slot_in_which_i_hears_none_of_its_grants() {
    let mut pair = Pair::agreed(2);
    pair.to(Role::I, |slot| slot.commitment.opens_at - Duration::from_millis(300));
    pair.unheard.j = true;
    let airtime = pair.slot(Role::J).unwrap().radiate_from;
    pair.until(|pair| pair.is_on(Role::J));
    pair.until(|pair| pair.standing(Role::J) == Standing::Closing);
    // I was silent for so much of its airtime; before that it need not have been on.
    let in_vain = pair.now().saturating_since(airtime);
    assert!(in_vain.abs_diff(Duration::from_millis(1500)) < Duration::from_millis(40), "{in_vain:?}");
    pair.until(|pair| !pair.is_on(Role::J));
    assert!(pair.now().saturating_since(airtime) <= in_vain + LEASE, "what it has granted, it keeps");
    pair.run(Duration::from_millis(100));
    let vain = |event: &&Event| matches!(event, Event::JammedInVain(2, Jamming::Full));
    assert_eq!(pair.heard(Role::J).iter().filter(vain).count(), 1, "{:?}", pair.heard(Role::J));
}

#[test]
fn spec_a_peer_that_has_ended_is_followed_but_for_the_last_slot_once_its_airtime_is_over() {
    for (slot, wound_up, followed) in
        [(2, false, true), (2, true, true), (SLOTS - 1, false, true), (SLOTS - 1, true, false)]
    {
        let mut pair = Pair::agreed(slot);
        pair.to(Role::I, |slot| slot.radiate_from + Duration::from_millis(100));
        if wound_up {
            pair.to(Role::I, |slot| slot.radiate_until + Duration::from_millis(100));
        }
        pair.ends(Role::J);
        pair.run(Duration::from_millis(50));
        let gave_up = pair.gave_up(Role::I);
        assert_eq!(gave_up, if followed { "PeerEnded" } else { "no" }, "slot {slot}, wound up {wound_up}");
        pair.run(LATEST);
        assert_eq!(pair.gave_up(Role::I) == "no", !followed, "slot {slot}, wound up {wound_up}");
    }
    let mut pair = Pair::new();
    pair.run(Duration::from_millis(20));
    pair.ends(Role::J);
    pair.run(Duration::from_millis(50));
    assert!(pair.gave_up(Role::I) == "PeerEnded" && pair.slot(Role::I).is_none());
}

#[test]
fn spec_a_peer_that_leaves_on_the_way_is_not_waited_for_unless_there_is_a_pause() {
    for (paused, gives_up) in [(false, "PeerLeft"), (true, "no")] {
        let mut pair = Pair::agreed(2);
        pair.run(Duration::from_millis(200));
        if paused {
            pair.dumb.i = true;
            pair.order(Role::I, Order::Pause);
        }
        let (now, t) = (pair.now(), pair.t);
        assert!(pair.companions.j.service.abandon(now));
        pair.companions.j.handle_timeout(t);
        pair.run(Duration::from_millis(200));
        assert_eq!(pair.gave_up(Role::I), gives_up, "paused {paused}");
    }
    // In the slot the leases decide, until it is known that the other has ended.
    let mut pair = Pair::on_air();
    let (now, t) = (pair.now(), pair.t);
    assert!(!pair.companions.j.service.abandon(now));
    pair.companions.j.handle_timeout(t);
    pair.until(|pair| pair.gave_up(Role::I) != "no");
    assert_eq!(pair.gave_up(Role::I), "PeerEnded");
}

#[test]
fn spec_who_finds_no_slot_goes_home_after_a_minute_and_a_half_or_after_ten_minutes_of_a_pause() {
    let seconds = Duration::from_secs;
    let alone = || {
        let mut pair = Pair::new();
        // On the ground: it is heard, and takes no part.
        pair.companions.j.joining = false;
        pair.step();
        assert_eq!(pair.standing(Role::I), Standing::Between);
        pair
    };
    let gives_up_after = |pair: &mut Pair, longest: Duration| {
        pair.run(longest);
        let t = pair.t;
        pair.companions.i.handle_timeout(t);
        assert_eq!(pair.gave_up(Role::I), "no");
        pair.run(Duration::from_millis(30));
        assert!(pair.gave_up(Role::I).starts_with("NoSlot"), "{}", pair.gave_up(Role::I));
    };
    gives_up_after(&mut alone(), seconds(90));
    let mut pair = alone();
    pair.order(Role::I, Order::Pause);
    gives_up_after(&mut pair, seconds(600));
    // What was waited for before does not count after a pause.
    let mut pair = alone();
    pair.order(Role::I, Order::Pause);
    pair.run(seconds(100));
    pair.order(Role::I, Order::Continue);
    gives_up_after(&mut pair, seconds(90));
}

#[test]
fn spec_a_slot_that_the_peer_refuses_is_proposed_twice_a_second_and_given_up_after_half_a_minute() {
    let mut pair = Pair::new();
    // It is ready for another slot.
    pair.companions.j.joining = false;
    let now = pair.now();
    pair.companions.j.service.join(5, None, now);
    let proposed = |message: &MavMessage| matches!(message, MavMessage::VEILWING_PROPOSE(_));
    pair.run(Duration::from_secs(20));
    let before = pair.told(Role::I, proposed);
    pair.run(Duration::from_secs(10));
    let times = pair.told(Role::I, proposed) - before;
    assert!((18..=20).contains(&times), "{times}");
    assert_eq!(pair.gave_up(Role::I), "no");
    pair.run(Duration::from_secs(2));
    assert_eq!(pair.gave_up(Role::I), "Refused(0, VEILWING_ANSWER_WRONG_SLOT)");
}

#[test]
fn spec_late_state_of_j_is_told_once_and_what_pose_or_link_take_is_told_with_the_reason() {
    let mut pair = Pair::on_air();
    pair.listen();
    pair.companions.j.stale_since = Some(pair.now());
    let t = pair.t;
    pair.until(|pair| !pair.is_on(Role::I));
    assert!(pair.t - t <= Duration::from_millis(60), "{:?}", pair.t - t);
    assert!(pair.is_on(Role::J) && pair.told(Role::J, silences) == 3);
    pair.run(Duration::from_millis(10));
    assert_eq!(pair.told(Role::J, silences), 3);
    assert!(pair.heard(Role::I).contains(&Event::PeerSilent(VeilwingSilence::VEILWING_SILENCE_LINK)));
    // Prompt again, and late again: that is said again.
    let mut pair = Pair::on_air();
    for time in 1..=2 {
        pair.companions.j.stale_since = Some(pair.now());
        pair.run(Duration::from_millis(60));
        assert_eq!(pair.told(Role::J, silences), 3 * time);
        pair.companions.j.stale_since = None;
        pair.until(|pair| pair.is_on(Role::I) && pair.is_on(Role::J));
        pair.run(Duration::from_millis(50));
    }
    let mut pair = Pair::on_air();
    pair.listen();
    pair.companions.j.pose_lost = true;
    pair.until(|pair| !pair.is_on(Role::J));
    pair.step();
    assert!(!pair.is_on(Role::I), "it is told, and does not wait for its lease to end");
    pair.run(Duration::from_millis(50));
    assert!(pair.heard(Role::I).contains(&Event::PeerSilent(VeilwingSilence::VEILWING_SILENCE_POSE)));
    assert_eq!(pair.gave_up(Role::I), "no");
}

#[test]
fn spec_what_a_half_tells_the_other_of_itself_is_so() {
    let mut pair = Pair::agreed(2);
    assert!(pair.says(Role::I, VeilwingFlags::VEILWING_FLAGS_AIRBORNE));
    assert!(!pair.says(Role::I, VeilwingFlags::VEILWING_FLAGS_RADIATING));
    assert!(!pair.companions.i.service.says_guarding());
    pair.until(|pair| pair.is_on(Role::I));
    pair.run(Duration::from_millis(5));
    assert!(pair.says(Role::I, VeilwingFlags::VEILWING_FLAGS_RADIATING));
    pair.companions.i.amiss = |vehicle: &mut Vehicle| vehicle.guarding = true;
    pair.run(Duration::from_millis(30));
    assert!(pair.companions.i.service.says_guarding());
    assert!(pair.says(Role::I, VeilwingFlags::VEILWING_FLAGS_GUARDING));
    let now = pair.now();
    // In control of its vehicle, and no part of the pair any more.
    assert!(pair.companions.i.service.abandon(now));
    pair.run(Duration::from_millis(30));
    assert!(!pair.says(Role::I, VeilwingFlags::VEILWING_FLAGS_AIRBORNE));
}

#[test]
fn spec_a_paused_slot_stays_agreed_on_until_its_radio_is_known_to_be_off() {
    let mut pair = Pair::on_air();
    pair.dumb.i = true;
    pair.order(Role::I, Order::Pause);
    pair.run(Duration::from_millis(20));
    assert_eq!(pair.standing(Role::I), Standing::Closed);
    assert!(pair.says(Role::I, VeilwingFlags::VEILWING_FLAGS_RADIATING), "as far as is known");
    assert!(pair.companions.j.service.peer().committed.is_some());
}

#[test]
fn spec_another_system_s_radio_is_another_radio_and_nothing_is_on_there() {
    let mut pair = Pair::on_air();
    let now = pair.now();
    let service = &mut pair.companions.i.service;
    service.adopt_system(9, now);
    assert!(!service.interlock().is_on());
    service.handle_timeout(now + LEASE);
    let sent = std::iter::from_fn(|| service.poll_transmit());
    let targets: Vec<u8> = sent
        .filter_map(|message| match message {
            Outgoing::Radio(message) => match *message {
                Common::COMMAND_INT(command) => Some(command.target_system),
                _ => None,
            },
            Outgoing::Pair(_) => None,
        })
        .collect();
    assert!(!targets.is_empty() && targets.iter().all(|target| *target == 9), "{targets:?}");
}
