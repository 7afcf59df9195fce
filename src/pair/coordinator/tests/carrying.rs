//! Slots that carry each other on, motions in the middle of one, and what a status says of rest and of time.

use super::saying::statuses;
use super::*;

/// From one slot's close to the next one's opening.
const BETWEEN: Duration = Duration::from_secs(3);
/// The first slot closes so long after its opening.
const LENGTH: Duration = Duration::from_secs(100);

/// Committed to the first slot, which the second carries on, and each knows it of the other; at 8 s.
fn carrying((mut i, mut j): (Coordinator, Coordinator)) -> (Coordinator, Coordinator) {
    for side in [&mut i, &mut j] {
        side.plan.as_mut().unwrap().slots[1].carries_on_after = Some(BETWEEN);
    }
    i.propose(0, utc(7000), None, at(2000));
    (2000..8000).step_by(10).for_each(|ms| drop(run(&mut i, &mut j, ms)));
    assert!(i.commitment().is_some() && i.commitment() == j.commitment());
    (i, j)
}

/// What the next slot is agreed on as, by a UTC that is `off_us` behind what it was, and when the last one has closed.
fn carried(side: &mut Coordinator, off_us: u64) -> (Commitment, Instant) {
    let now_ms = 8000;
    let behind = Utc { unix_us: utc(now_ms).unix_us - off_us };
    side.set_utc(Some(behind), at(now_ms));
    let closes_at = side.commitment().unwrap().opens_at + LENGTH;
    (side.carry_on(closes_at).unwrap(), closes_at)
}

#[test]
fn val_a_slot_opens_by_the_clock_on_both_sides_and_no_clock_moves_it_by_more_than_it_can_have_drifted() {
    // 103 s from opening to opening: two crystals are 20.6 ms apart at most.
    for (off_us, moved_us) in
        [(0, 0), (1000, 0), (1001, 1001), (20_000, 20_000), (20_600, 20_600), (90_000, 20_600)]
    {
        let (mut i, mut j) = carrying(pair());
        for side in [&mut i, &mut j] {
            let before = side.commitment().unwrap();
            let (carried, closes_at) = carried(side, off_us);
            let moved = Duration::from_micros(moved_us);
            let off_s = carried.opens_at.seconds_since(closes_at + BETWEEN + moved);
            assert!(off_s.abs() < 2e-9, "{off_us}: {off_s}");
            assert_eq!((carried.slot, carried.proposal, carried.leaves_at), (1, before.proposal, closes_at));
            assert_eq!(carried.opens, before.opens + (LENGTH + BETWEEN));
            assert_eq!(side.commitment(), Some(carried));
        }
    }
    // And ahead.
    let (mut i, _) = carrying(pair());
    i.set_utc(Some(utc(8005)), at(8000));
    let closes_at = i.commitment().unwrap().opens_at + LENGTH;
    let early = closes_at + BETWEEN - Duration::from_millis(5);
    assert!(i.carry_on(closes_at).unwrap().opens_at.seconds_since(early).abs() < 2e-9);
}

#[test]
fn spec_what_the_plan_has_otherwise_or_the_other_has_left_is_not_carried_on() {
    let closes_at = at(8000);
    let (i, j) = carrying(pair());
    for mut side in [i, j] {
        let mut left = side.clone();
        left.agreed.as_mut().unwrap().peer_left = true;
        let mut unheard = side.clone();
        unheard.agreed.as_mut().unwrap().peer_went_along = false;
        let mut apart = side.clone();
        apart.plan.as_mut().unwrap().slots[1].carries_on_after = None;
        for mut other in [left, unheard, apart] {
            let before = other.commitment();
            assert_eq!((other.carry_on(closes_at), other.commitment()), (None, before));
        }
        assert!(side.carry_on(closes_at).is_some());
        assert_eq!(side.carry_on(closes_at), None, "the third carries on none");
    }
}

#[test]
fn spec_a_motion_is_asked_for_made_and_taken_up_by_both_over_the_wire() {
    let (mut i, mut j) = carrying(following());
    let opens_ms = 7000;
    assert!(i.may_ask_motion(at(8000)) && !j.may_ask_motion(at(8000)));
    assert!(!i.may_ask_motion(at(opens_ms - 10)), "before the opening nothing moves");
    assert!(i.flies_alike(at(8000)));
    events(&mut i);
    events(&mut j);
    i.ask_motion(Places::new(1800), at(8000));
    assert_eq!(events(&mut i), vec![Event::PlanMotion]);
    assert!(!i.may_ask_motion(at(8000)));
    run(&mut i, &mut j, 8000);
    assert_eq!(events(&mut j), vec![Event::PlanMotion]);
    assert_eq!(i.asked_motion().unwrap().number, j.asked_motion().unwrap().number);
    i.motion_planned(1, Some(9), at(8010));
    j.motion_planned(1, Some(9), at(8020));
    // What was lost is said again.
    sent(&mut j);
    let wakes = i.poll_timeout().0;
    assert!(wakes <= at(8100), "{wakes:?}");
    (8030..8300).step_by(10).for_each(|ms| drop(run(&mut i, &mut j, ms)));
    assert_eq!((events(&mut i), events(&mut j)), (vec![Event::TakeUp(1)], vec![Event::TakeUp(1)]));
    assert!(i.flies_alike(at(99_000)) && i.may_ask_motion(at(8900)));
}

#[test]
fn spec_i_knows_that_j_does_not_fly_what_it_flies() {
    let (mut i, mut j) = carrying(following());
    i.ask_motion(Places::new(1400), at(8000));
    run(&mut i, &mut j, 8000);
    i.motion_planned(1, Some(9), at(8010));
    j.motion_planned(1, Some(9), at(8010));
    sent(&mut j).iter().for_each(|m| i.handle_message(m, at(8010)));
    assert_eq!(events(&mut i).last(), Some(&Event::TakeUp(1)));
    // J's word that it flies it never comes.
    assert!(i.flies_alike(at(8600)) && !i.flies_alike(at(8800)));
}

#[test]
fn spec_a_status_says_where_its_sender_rests_and_when_it_was_sent() {
    let mut alone = coordinator(Role::I, 11);
    let said = |alone: &mut Coordinator, rests, ms| {
        alone.set_local(Local { rests, ..Local::default() }, at(ms));
        alone.handle_timeout(at(ms));
        statuses(alone).pop().unwrap()
    };
    let rest = Rest { position_enu_m: [1.5, -2.5, 80.25], wxyz: [0.5, 0.5, -0.5, 0.5] };
    let status = said(&mut alone, Some(rest), 1000);
    assert_eq!((status.rests_enu_m, status.rests_wxyz), (rest.position_enu_m, rest.wxyz));
    assert_eq!(status.time_us, 1_000_000);
    let status = said(&mut alone, None, 1200);
    assert_eq!((status.rests_enu_m, status.rests_wxyz, status.time_us), ([0.0; 3], [0.0; 4], 1_200_000));
}

#[test]
fn spec_j_knows_which_slot_it_was_asked_for_and_i_is_asked_for_none() {
    let (mut i, mut j) = pair();
    assert_eq!((i.asked(), j.asked()), (None, None));
    j.set_readiness(Some(2));
    i.propose(2, utc(7000), None, at(2000));
    run(&mut i, &mut j, 2000);
    assert_eq!((i.asked(), j.asked()), (None, Some(2)));
}
