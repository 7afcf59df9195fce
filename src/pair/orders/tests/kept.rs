//! What is kept, told and answered of orders: when, and once.

use super::*;

fn kept(pair: &mut Pair, side: usize) -> Option<Record> {
    pair.sides[side].poll_record()
}

#[test]
fn spec_what_has_changed_is_kept_once() {
    let mut pair = Pair::new();
    assert_eq!(kept(&mut pair, 0), None);
    let number = pair.give(0, Order::Kill);
    assert_eq!(kept(&mut pair, 0).map(|record| record.kill), Some(number));
    assert_eq!(kept(&mut pair, 0), None);
    pair.say(0);
    assert_eq!(kept(&mut pair, 1).map(|record| (record.kill, record.newest)), Some((number, number)));
    pair.say(0);
    assert_eq!(kept(&mut pair, 1), None, "heard before");
    pair.sides[0].lift();
    assert_eq!(kept(&mut pair, 0).map(|record| record.lifted), Some(number));
    pair.sides[0].lift();
    assert_eq!(kept(&mut pair, 0), None);
}

#[test]
fn spec_that_a_start_is_forgotten_is_kept() {
    let mut orders = Orders::new(Record::default());
    assert!(!orders.is_spent());
    orders.forget_start();
    assert_eq!(orders.poll_record(), Some(Record { spent: true, ..Record::default() }));
    orders.forget_start();
    assert_eq!(orders.poll_record(), None);
    let number = orders.give(Order::Start, at(0));
    assert_eq!(orders.pending_start(), Some(number));
    orders.poll_record();
    orders.forget_start();
    assert_eq!(orders.pending_start(), None);
    assert_eq!(orders.poll_record().map(|record| record.begun), Some(number));
}

#[test]
fn spec_an_order_that_holds_keeps_its_number_and_is_not_told_again() {
    let mut pair = Pair::new();
    for order in [Order::Kill, Order::Pause, Order::Start] {
        let number = pair.give(0, order);
        changes(&mut pair.sides[0]);
        assert_eq!(pair.give(0, order), number, "{order:?}");
        assert_eq!(changes(&mut pair.sides[0]), [], "{order:?}");
    }
    let mut running = Pair::new();
    assert_eq!(running.give(0, Order::Continue), 0, "nothing to continue");
    assert_eq!(changes(&mut running.sides[0]), []);
    let recall = running.give(0, Order::Recall);
    assert!(running.give(0, Order::Recall) > recall, "each is of its moment");
}

#[test]
fn spec_the_peer_is_told_at_once_of_what_it_acts_on() {
    let mut orders = Orders::new(Record::default());
    assert!(!orders.poll_untold());
    orders.set_ready(true);
    assert!(!orders.poll_untold(), "ready for nothing");
    let number = orders.give(Order::Start, at(0));
    assert!(orders.poll_untold() && !orders.poll_untold());
    orders.set_ready(true);
    assert!(!orders.poll_untold());
    for ready in [false, true] {
        orders.set_ready(ready);
        assert!(orders.poll_untold(), "{ready}");
    }
    let said = VEILWING_STATUS_DATA { newest_order: number, start: number, ..Default::default() };
    orders.hear(&said, at(1));
    assert!(orders.is_start_confirmed());
    orders.begin();
    assert!(orders.poll_untold());
    assert!(orders.is_flying(number) && !orders.is_flying(number + 1));
    orders.stand_down();
    assert!(!orders.is_flying(number) && orders.poll_untold());
}

#[test]
fn spec_a_kill_is_lifted_when_the_second_lifts_it_and_both_say_so_then() {
    for first in 0..2 {
        let mut pair = Pair::new();
        pair.give(0, Order::Kill);
        pair.talk();
        pair.sides[first].lift();
        assert_eq!(changes(&mut pair.sides[first]), []);
        assert!(pair.sides[first].is_lifted_here_alone());
        assert_eq!(pair.say(first), []);
        pair.sides[1 - first].lift();
        assert_eq!(changes(&mut pair.sides[1 - first]), [Change::KillLifted]);
        assert_eq!(pair.say(1 - first), [Change::KillLifted]);
    }
}

#[test]
fn spec_a_start_that_is_done_with_is_not_taken_from_one_who_still_flies_by_it() {
    let mut pair = Pair::new();
    let number = pair.give(0, Order::Start);
    pair.talk();
    assert!(pair.take_off(0) && pair.take_off(1));
    pair.talk();
    pair.restart(1, true);
    assert_eq!(pair.say(0), []);
    assert!(pair.sides[0].is_flying(number));
    assert_eq!(pair.sides[1].pending_start(), None);
}

#[test]
fn spec_a_restart_voids_what_the_other_stood_by_and_is_no_withdrawal() {
    let mut pair = Pair::new();
    pair.give(0, Order::Start);
    pair.talk();
    let mut waiting = pair.sides[0].clone();
    assert!(waiting.is_start_confirmed());
    waiting.new_boot();
    assert!(!waiting.is_start_confirmed());

    assert!(pair.take_off(0) && pair.take_off(1));
    pair.talk();
    pair.restart(1, true);
    assert_eq!(pair.say(1), [], "it has forgotten, and does not take back");
    // Without a restart it does.
    let mut pair = Pair::new();
    pair.give(0, Order::Start);
    pair.talk();
    assert!(pair.take_off(0) && pair.take_off(1));
    pair.talk();
    pair.sides[1].stand_down();
    assert_eq!(pair.say(1), [Change::StartWithdrawn]);
}

#[test]
fn spec_of_a_pause_and_a_start_of_one_number_the_start_holds() {
    let mut pair = Pair::new();
    assert_eq!(pair.give(0, Order::Pause), pair.give(1, Order::Start));
    pair.talk();
    assert!(!pair.sides.iter().any(Orders::is_paused));
}

#[test]
fn spec_the_peer_has_an_order_once_it_has_said_its_number_or_a_later_one() {
    for order in [Order::Kill, Order::Recall, Order::Pause, Order::Start] {
        let mut pair = Pair::new();
        pair.give(0, Order::Continue);
        let number = pair.give(0, order);
        pair.say(0);
        assert!(!pair.sides[0].peer_has(order, number), "{order:?}");
        pair.say(1);
        for (asked, has) in [(number - 1, true), (number, true), (number + 1, false)] {
            assert_eq!(pair.sides[0].peer_has(order, asked), has, "{order:?} {asked}");
        }
    }
}

#[test]
fn spec_what_was_heard_waits_to_be_kept() {
    let mut pair = Pair::new();
    let number = pair.give(0, Order::Pause);
    pair.say(0);
    pair.say(0);
    let record = kept(&mut pair, 1);
    assert_eq!(record.map(|record| (record.hold, record.holding)), Some((number, true)));
}

#[test]
fn spec_a_recall_of_the_peer_s_is_told_once() {
    let mut pair = Pair::new();
    pair.give(0, Order::Recall);
    assert_eq!(pair.say(0), [Change::Recalled]);
    assert_eq!(pair.say(0), []);
}
