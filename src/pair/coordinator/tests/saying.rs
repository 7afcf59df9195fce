//! What is said, and when: hellos, statuses, silences, and who is lost.

use super::*;

const NANOSECOND: Duration = Duration::from_nanos(1);

pub(super) fn statuses(of: &mut Coordinator) -> Vec<wire::VEILWING_STATUS_DATA> {
    let status = |message| match message {
        MavMessage::VEILWING_STATUS(status) => Some(status),
        _ => None,
    };
    sent(of).into_iter().filter_map(status).collect()
}

fn hellos(of: &mut Coordinator) -> Vec<MavMessage> {
    let mut all = sent(of);
    all.retain(|message| matches!(message, MavMessage::VEILWING_HELLO(_)));
    all
}

#[test]
fn spec_each_timer_is_due_in_its_turn_and_by_its_name() {
    let mut alone = coordinator(Role::I, 11);
    alone.set_utc(Some(utc(0)), Instant::ZERO);
    assert_eq!(alone.poll_timeout(), (Instant::ZERO, Timer::Hello), "of several the first");
    let mut due = Vec::new();
    for _ in 0..12 {
        let (now, timer) = alone.poll_timeout();
        due.push((now.since_start().as_millis(), timer));
        alone.handle_timeout(now);
    }
    let status = |ms| (ms, Timer::Status);
    let all = [(0, Timer::Hello), status(100), status(200), status(300), status(400), (500, Timer::Hello)];
    let next = [status(600), status(700), status(800), status(900), (1000, Timer::Hello), status(1100)];
    assert_eq!(due, [all, next].concat());
    assert_eq!(sent(&mut alone).iter().filter(|m| matches!(m, MavMessage::VEILWING_CLOCK(_))).count(), 2);
    let timers = [
        Timer::Hello,
        Timer::Status,
        Timer::Clock,
        Timer::Proposal,
        Timer::Start,
        Timer::LeaseRequest,
        Timer::PeerLost,
    ];
    let names: std::collections::BTreeSet<_> = timers.map(Timer::name).into();
    assert_eq!(names.len(), timers.len());
}

#[test]
fn spec_clocks_agree_once_they_are_compared() {
    assert!(!coordinator(Role::I, 11).clocks_agree());
    let (i, j) = pair();
    assert!(i.clocks_agree() && j.clocks_agree());
}

#[test]
fn spec_a_status_says_where_the_vehicle_is_and_what_it_is_committed_to() {
    let (mut i, mut j) = pair();
    let said = |i: &mut Coordinator, j: &mut Coordinator, ms: u64| {
        let own = |message| match message {
            MavMessage::VEILWING_STATUS(status) if status.boot_id == 11 => Some(status),
            _ => None,
        };
        let last = (0..20).flat_map(|k| run(i, j, ms + 10 * k)).filter_map(own).last().unwrap();
        ((last.proposal, last.slot), last.position_enu_m)
    };
    let (nothing, nowhere) = said(&mut i, &mut j, 2000);
    assert!(nothing == (0, 0) && nowhere.iter().all(|x| x.is_nan()), "{nowhere:?}");
    i.set_local(Local { position_enu_m: Some(Enu::new(1.0, -2.0, 80.5)), ..Local::default() }, at(2200));
    j.set_readiness(Some(2));
    i.propose(2, utc(8000), None, at(2200));
    let (committed, here) = said(&mut i, &mut j, 2200);
    assert_eq!((committed, here), ((i.commitment().unwrap().proposal, 2), [1.0, -2.0, 80.5]));
}

#[test]
fn spec_the_clock_is_asked_when_it_is_due_and_once_a_second() {
    let mut time = SharedTime::new(Duration::from_millis(250), at(100));
    time.set_utc(Some(utc(0)), Instant::ZERO);
    let asked = [99, 100, 101, 1099, 1100].map(|ms| time.ask(at(ms)).is_some());
    assert_eq!(asked, [false, true, false, false, true]);
}

#[test]
fn val_the_instant_of_a_utc_lies_before_ours_or_after_it() {
    let mut time = SharedTime::new(Duration::from_millis(250), Instant::ZERO);
    assert_eq!(time.instant_of(utc(1000)), None);
    time.set_utc(Some(utc(5000)), at(7000));
    assert_eq!(time.instant_of(utc(1000)), Some(at(3000)));
    assert_eq!(time.instant_of(utc(9000)), Some(at(11_000)));
}

/// A comparison over a way without delay, the peer's clock ahead by so much.
fn compared(ahead: Duration) -> SharedTime {
    let mut time = SharedTime::new(Duration::from_millis(250), Instant::ZERO);
    time.set_utc(Some(utc(0)), Instant::ZERO);
    let Some(MavMessage::VEILWING_CLOCK(asked)) = time.ask(Instant::ZERO) else { panic!() };
    let theirs = (utc(0) + ahead).unix_us;
    let answer = wire::VEILWING_CLOCK_DATA { receive_us: theirs, transmit_us: theirs, ..asked };
    assert_eq!(time.take(&answer, Instant::ZERO), None);
    time
}

#[test]
fn val_clocks_agree_up_to_the_tolerance() {
    let microsecond = Duration::from_micros(1);
    let tolerance = Duration::from_millis(250);
    assert!(compared(tolerance).agrees());
    assert!(!compared(tolerance + microsecond * 2).agrees());
    assert!(!SharedTime::new(tolerance, Instant::ZERO).agrees());
}

#[test]
fn spec_a_step_of_more_than_half_the_tolerance_or_another_boot_voids_the_comparison() {
    for (step_us, voids) in [(125_000, false), (125_001, true), (400_000, true)] {
        let mut time = compared(Duration::ZERO);
        assert!(time.offset().is_some());
        time.set_utc(Some(Utc { unix_us: utc(10).unix_us + step_us }), at(10));
        assert_eq!(time.offset().is_none(), voids, "{step_us}");
        assert_eq!(time.ask(at(10)).is_some(), voids, "{step_us}: compared anew at once");
    }
    let (mut i, mut j) = pair();
    assert_eq!(j.clock_offset().map(|offset| offset.offset_us), Some(0));
    let mut reborn = coordinator(Role::I, 12);
    for ms in [3000, 3050, 3100] {
        for message in hellos_at(&mut reborn, ms).iter().chain(&hellos_at(&mut i, 2000)) {
            j.handle_message(message, at(ms));
        }
        hellos_at(&mut j, ms).iter().for_each(|message| reborn.handle_message(message, at(ms)));
    }
    assert!(events(&mut j).contains(&Event::PeerRestarted));
    assert_eq!(j.clock_offset(), None);
}

/// Hellos alone, none kept back for its turn.
fn hellos_at(of: &mut Coordinator, ms: u64) -> Vec<MavMessage> {
    of.acquaintance.due = at(ms);
    of.handle_timeout(at(ms));
    hellos(of)
}

#[test]
fn spec_who_must_be_answered_is_greeted_within_50_ms() {
    let (mut i, mut j) = (coordinator(Role::I, 11), coordinator(Role::J, 22));
    assert_eq!(hellos_at(&mut j, 0).len(), 1);
    let from_i = hellos_at(&mut i, 0);
    j.handle_message(&from_i[0], at(10));
    // It has not heard us yet. 50 ms after our last hello it hears the next.
    j.handle_timeout(at(49));
    assert_eq!(hellos(&mut j).len(), 0);
    j.handle_timeout(at(50));
    let from_j = hellos(&mut j);
    assert_eq!(from_j.len(), 1);
    j.handle_timeout(at(549));
    assert_eq!(hellos(&mut j).len(), 0);
    // It echoes: met for the first time, and greeted again.
    i.handle_message(&from_j[0], at(200));
    assert_eq!(events(&mut i), [Event::PeerFound]);
    assert_eq!(i.acquaintance.due, at(50));
}

#[test]
fn spec_the_peer_is_told_at_once_of_what_it_acts_on_and_else_in_its_turn() {
    let (mut i, _) = pair();
    let told_at = |i: &mut Coordinator, ms| {
        i.handle_timeout(at(ms));
        statuses(i).pop()
    };
    told_at(&mut i, 2100);
    let mut local = Local::default();
    i.set_local(local, at(2101));
    local.preflight_ok = true;
    i.set_local(local, at(2101));
    assert_eq!(told_at(&mut i, 2101), None);
    local.airborne = true;
    i.set_local(local, at(2102));
    let status = told_at(&mut i, 2102).unwrap();
    assert!(status.flags.contains(wire::VeilwingFlags::VEILWING_FLAGS_AIRBORNE));
    i.set_local(local, at(2103));
    assert_eq!(told_at(&mut i, 2103), None);
    let kill = i.orders_mut().give(crate::pair::Order::Kill, at(2104));
    i.set_local(local, at(2104));
    assert_eq!(told_at(&mut i, 2104).map(|status| status.kill), Some(kill));
    i.set_local(local, at(2105));
    assert_eq!(told_at(&mut i, 2105), None);
}

#[test]
fn spec_whoever_radiates_has_released_nothing() {
    for role in Role::BOTH {
        let mut alone = coordinator(role, 11);
        alone.set_local(Local { radiating: true, ..Local::default() }, at(10));
        alone.handle_timeout(at(10));
        assert_eq!(statuses(&mut alone)[0].released_us, 0);
        alone.set_local(Local::default(), at(20));
        alone.handle_timeout(at(20));
        assert_eq!(statuses(&mut alone)[0].released_us, 20_000);
    }
}

#[test]
fn regress_a_new_boot_that_knows_nothing_of_its_radio_ends_no_lease_of_the_last_one() {
    let (_, mut j, ..) = granted();
    assert!(j.leases_outstanding(at(6100)));
    // I's companion has died and is back; commands to its radio are held up, so that the last one's power lasts.
    let mut reborn = coordinator(Role::I, 12);
    let said: Vec<_> = (6110..6300).step_by(10).flat_map(|ms| run(&mut reborn, &mut j, ms)).collect();
    assert!(events(&mut j).contains(&Event::PeerRestarted));
    let released = |message: &MavMessage| match message {
        MavMessage::VEILWING_STATUS(status) if status.boot_id == 12 => Some(status.released_us),
        _ => None,
    };
    let released: Vec<_> = said.iter().filter_map(released).collect();
    assert!(released.len() > 1 && released.iter().all(|us| *us == 0), "{released:?}");
    assert!(j.leases_outstanding(at(6300)), "the dead boot's radio may still be on");
    // Once it is known to be off, nobody waits.
    reborn.set_local(Local::default(), at(6300));
    run(&mut reborn, &mut j, 6300);
    assert!(!j.leases_outstanding(at(6300)));
}

#[test]
fn spec_while_leases_are_asked_for_those_before_the_last_silence_are_released() {
    let (mut i, _, _, grant) = granted();
    let released = |i: &mut Coordinator, ms| i.release_status(at(ms));
    assert_eq!(released(&mut i, 6101), 6_000_000, "none since it asks for leases");
    i.want_lease(false, at(6105));
    assert_eq!(released(&mut i, 6106), 6_106_000);
    i.want_lease(true, at(6107));
    assert_eq!(released(&mut i, 6108), 6_106_000, "what was said last holds");
    let late = wire::VEILWING_LEASE_GRANT_DATA { time_us: 6_107_000, ..grant };
    i.handle_message(&MavMessage::VEILWING_LEASE_GRANT(late), at(6109));
    assert!(i.lease(at(6109)).is_some());
    assert_eq!(released(&mut i, 6110), 0);
}

#[test]
fn regress_a_lease_asked_for_in_the_instant_of_a_release_is_released_or_never_asked_for() {
    let (mut i, _, _, grant) = granted();
    i.want_lease(false, at(6105));
    i.handle_timeout(at(6105));
    sent(&mut i);
    // In one instant: the status says that all is released, and leases are asked for again.
    let released_us = i.release_status(at(6200));
    assert_eq!(released_us, 6_200_000);
    i.want_lease(true, at(6200));
    i.handle_timeout(at(6200));
    i.handle_timeout(at(6200) + Duration::from_micros(1));
    let asked_us = sent(&mut i).iter().find_map(|message| match message {
        MavMessage::VEILWING_LEASE_REQUEST(request) => Some(request.time_us),
        _ => None,
    });
    assert_eq!(asked_us, Some(released_us + 1), "at once, and not before what J may take for released");
    let of_the_instant = wire::VEILWING_LEASE_GRANT_DATA { time_us: released_us, ..grant };
    i.handle_message(&MavMessage::VEILWING_LEASE_GRANT(of_the_instant), at(6210));
    assert_eq!(i.lease(at(6210)), None);
}

impl Coordinator {
    /// What a status at `now` would say of leases.
    fn release_status(&mut self, now: Instant) -> u64 {
        match self.status(now) {
            MavMessage::VEILWING_STATUS(status) => status.released_us,
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn spec_the_peer_is_lost_after_its_timeout_once_and_again_after_it_was_heard() {
    let (mut i, mut j) = pair();
    let heard = i.peer().last_heard.unwrap();
    let lost_at = |i: &mut Coordinator, now| {
        i.handle_timeout(now);
        events(i)
    };
    let timeout = Duration::from_secs(3);
    assert_eq!(lost_at(&mut i, heard + timeout), []);
    let late = timeout + NANOSECOND;
    assert_eq!(i.acquaintance.lost_due(), Some(heard + late));
    assert_eq!(lost_at(&mut i, heard + late), [Event::PeerLost(late)]);
    assert_eq!((i.acquaintance.lost_due(), lost_at(&mut i, heard + late * 2)), (None, vec![]));
    j.handle_timeout(at(9000));
    let status = sent(&mut j).into_iter().find(|m| matches!(m, MavMessage::VEILWING_STATUS(_))).unwrap();
    i.handle_message(&status, at(20_000));
    assert_eq!(lost_at(&mut i, at(20_000) + late), [Event::PeerLost(late)]);
}

#[test]
fn spec_a_request_and_a_grant_are_words_of_the_peer() {
    let (mut i, j, _, grant) = granted();
    assert_eq!(j.peer().last_heard, Some(at(6100)));
    i.handle_message(&MavMessage::VEILWING_LEASE_GRANT(grant), at(6110));
    assert_eq!(i.peer().last_heard, Some(at(6110)));
}

#[test]
fn spec_what_differs_is_told_once_for_each_plan() {
    let told = |mission: [u8; 32], plan: [u8; 32]| {
        let (mut i, mut j) = (coordinator(Role::I, 11), coordinator_of(Role::J, 22, mission, plan));
        (0..200).for_each(|k| drop(run(&mut i, &mut j, 10 * k)));
        assert_eq!(i.agrees(), (mission, plan) == ([1; 32], [2; 32]));
        let first = events(&mut i);
        i.set_plan(PlanTerms { digest: [4; 32], slots: Vec::new() });
        (200..400).for_each(|k| drop(run(&mut i, &mut j, 10 * k)));
        (first, events(&mut i))
    };
    let (found, other_plan) = (Event::PeerFound, Event::PlanDiffers);
    assert_eq!(told([1; 32], [2; 32]), (vec![found], vec![other_plan]));
    assert_eq!(told([1; 32], [3; 32]), (vec![found, other_plan], vec![other_plan]));
    let other = Event::MissionDiffers;
    assert_eq!(told([9; 32], [2; 32]), (vec![found, other], vec![other]));
    assert_eq!(told([9; 32], [3; 32]), (vec![found, other], vec![other]));
}

fn silence_of(messages: &[MavMessage]) -> Vec<wire::VEILWING_SILENT_DATA> {
    let silent = |message: &MavMessage| match message {
        MavMessage::VEILWING_SILENT(silent) => Some(silent.clone()),
        _ => None,
    };
    messages.iter().filter_map(silent).collect()
}

#[test]
fn spec_a_falling_silent_is_said_three_times_counts_once_and_ends_the_lease() {
    let reason = VeilwingSilence::VEILWING_SILENCE_POSE;
    let (mut i, mut j, request, grant) = granted();
    i.handle_message(&MavMessage::VEILWING_LEASE_GRANT(grant.clone()), at(6110));
    events(&mut i);
    j.silent(reason, at(6120));
    let said = silence_of(&sent(&mut j));
    assert_eq!(said.len(), 3);
    assert!(
        said.iter().all(|s| (s.number, s.slot, s.proposal, s.reason) == (1, 0, request.proposal, reason))
    );
    j.handle_message(&MavMessage::VEILWING_LEASE_REQUEST(request), at(6125));
    assert_eq!(sent(&mut j), [], "it vouches for nothing any more");
    let another_s = [
        wire::VEILWING_SILENT_DATA { proposal: 77, ..said[0].clone() },
        wire::VEILWING_SILENT_DATA { boot_id: 77, ..said[0].clone() },
    ];
    for other in another_s {
        i.handle_message(&MavMessage::VEILWING_SILENT(other), at(6126));
        assert_eq!((events(&mut i), i.lease(at(6126))), (vec![], Some(at(6600))));
    }
    for copy in &said {
        i.handle_message(&MavMessage::VEILWING_SILENT(copy.clone()), at(6130));
    }
    assert_eq!((events(&mut i), i.lease(at(6130))), (vec![Event::PeerSilent(reason)], None));
    i.handle_message(&MavMessage::VEILWING_LEASE_GRANT(grant), at(6131));
    assert_eq!(i.lease(at(6131)), None, "a grant of before");
    j.silent(reason, at(6140));
    assert_eq!(silence_of(&sent(&mut j))[0].number, 2);
}

#[test]
fn spec_i_gives_its_lease_up_when_it_falls_silent() {
    let (mut i, _, _, grant) = granted();
    i.handle_message(&MavMessage::VEILWING_LEASE_GRANT(grant.clone()), at(6110));
    i.silent(VeilwingSilence::VEILWING_SILENCE_LINK, at(6120));
    assert_eq!(i.lease(at(6120)), None);
    i.handle_message(&MavMessage::VEILWING_LEASE_GRANT(grant), at(6130));
    assert_eq!(i.lease(at(6130)), None);
}
