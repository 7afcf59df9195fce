//! Two vehicles' orders, whatever the link between them loses, and whoever restarts.

mod kept;

use proptest::prelude::*;

use super::*;

fn at(s: u64) -> Instant {
    Instant::from_start(Duration::from_secs(s))
}

fn status(orders: &Orders) -> VEILWING_STATUS_DATA {
    let mut status = VEILWING_STATUS_DATA::default();
    orders.say(&mut status);
    status
}

fn changes(orders: &mut Orders) -> Vec<Change> {
    std::iter::from_fn(|| orders.poll_change()).collect()
}

/// Both vehicles, on the ground and ready.
struct Pair {
    sides: [Orders; 2],
    now: Instant,
}

impl Pair {
    fn new() -> Self {
        let side = || {
            let mut orders = Orders::new(Record::default());
            orders.set_ready(true);
            orders
        };
        Self { sides: [side(), side()], now: at(0) }
    }

    fn give(&mut self, side: usize, order: Order) -> u32 {
        self.sides[side].give(order, self.now)
    }

    fn say(&mut self, from: usize) -> Vec<Change> {
        let status = status(&self.sides[from]);
        changes(&mut self.sides[1 - from]);
        self.sides[1 - from].hear(&status, self.now);
        changes(&mut self.sides[1 - from])
    }

    fn talk(&mut self) {
        for from in [0, 1, 0, 1] {
            self.say(from);
        }
    }

    fn take_off(&mut self, side: usize) -> bool {
        let confirmed = self.sides[side].is_start_confirmed();
        if confirmed {
            self.sides[side].begin();
        }
        confirmed
    }

    /// The process dies and comes back, with what it has kept; on the ground or not.
    fn restart(&mut self, side: usize, on_the_ground: bool) {
        let record = *self.sides[side].record();
        self.sides[side] = Orders::new(record);
        self.sides[side].set_ready(true);
        self.sides[1 - side].new_boot();
        if on_the_ground {
            self.sides[side].began_on_the_ground();
        }
    }

    fn killed(&self) -> [bool; 2] {
        [0, 1].map(|side| self.sides[side].is_killed())
    }
}

#[test]
fn spec_a_start_is_begun_by_both_or_not_at_all_and_counts_once() {
    for to in 0..2 {
        let mut pair = Pair::new();
        let number = pair.give(to, Order::Start);
        assert!(!pair.take_off(to), "alone");
        pair.say(to);
        assert!(pair.take_off(1 - to), "it has heard that the other stands by it");
        assert!(!pair.take_off(to));
        pair.say(1 - to);
        assert!(pair.take_off(to));
        assert!(pair.sides.iter().all(|orders| orders.is_flying(number) && orders.is_spent()));
        // Landed, and restarted: the same START is none.
        pair.talk();
        for side in 0..2 {
            pair.restart(side, true);
        }
        pair.talk();
        assert_eq!(pair.sides.each_ref().map(Orders::pending_start), [None; 2]);
        assert!(pair.give(to, Order::Start) > number);
        pair.talk();
        assert!(pair.take_off(0) && pair.take_off(1));
    }
}

#[test]
fn spec_a_start_that_is_not_confirmed_expires_at_both() {
    let mut pair = Pair::new();
    pair.sides[1].set_ready(false);
    pair.give(0, Order::Start);
    pair.talk();
    assert!(!pair.take_off(0) && !pair.take_off(1));
    let expires = at(0) + START_EXPIRES;
    for orders in &mut pair.sides {
        assert_eq!(orders.poll_timeout(), Some(expires));
        changes(orders);
        orders.handle_timeout(expires - Duration::from_millis(1));
        assert_eq!(changes(orders), []);
        orders.handle_timeout(expires);
        assert_eq!(changes(orders), [Change::StartExpired]);
    }
    pair.sides[1].set_ready(true);
    pair.talk();
    assert!(!pair.take_off(0) && !pair.take_off(1));
}

#[test]
fn spec_a_recall_or_a_kill_beats_a_start_that_was_given_without_knowing_of_it_whatever_their_numbers() {
    for (order, ahead) in [(Order::Recall, 0), (Order::Recall, 5), (Order::Kill, 0), (Order::Kill, 5)] {
        for to in 0..2 {
            let mut pair = Pair::new();
            // Numbers of orders that the other has not heard of.
            for k in 0..ahead {
                pair.give(to, if k % 2 == 0 { Order::Pause } else { Order::Continue });
            }
            pair.give(to, Order::Start);
            pair.give(1 - to, order);
            pair.talk();
            assert!(!pair.take_off(0) && !pair.take_off(1), "{order:?} {ahead} {to}");
            assert_eq!(pair.sides.each_ref().map(Orders::pending_start), [None; 2]);
            assert!(pair.sides.iter().all(Orders::is_spent), "--start is taken back, too");
        }
    }
}

#[test]
fn spec_a_start_that_the_other_has_taken_back_is_withdrawn_from_who_has_begun() {
    let mut pair = Pair::new();
    pair.give(0, Order::Start);
    pair.say(0);
    pair.say(1);
    assert!(pair.take_off(0));
    pair.sides[1].handle_timeout(at(0) + START_EXPIRES);
    assert_eq!(changes(&mut pair.sides[1]), [Change::StartExpired]);
    assert_eq!(pair.say(1), [Change::StartWithdrawn]);
    assert!(pair.say(1).is_empty(), "once");
}

#[test]
fn spec_a_kill_holds_until_it_is_lifted_at_both_by_a_person_or_a_restart_on_the_ground() {
    for lift in [true, false] {
        let mut pair = Pair::new();
        pair.give(0, Order::Kill);
        assert_eq!(pair.killed(), [true, false]);
        assert_eq!(pair.say(0), [Change::Killed]);
        let release = |pair: &mut Pair, side: usize| match lift {
            true => pair.sides[side].lift(),
            false => pair.restart(side, true),
        };
        // A restart in the air lifts nothing, nor does a START, which is dropped.
        pair.restart(0, false);
        pair.talk();
        assert_eq!(pair.killed(), [true; 2]);
        release(&mut pair, 0);
        pair.talk();
        assert_eq!(pair.killed(), [true; 2]);
        assert!(pair.sides[0].is_lifted_here_alone() && !pair.sides[1].is_lifted_here_alone());
        release(&mut pair, 1);
        pair.talk();
        assert_eq!(pair.killed(), [false; 2]);
        // And again.
        pair.give(1, Order::Kill);
        pair.talk();
        assert_eq!(pair.killed(), [true; 2]);
    }
}

#[test]
fn spec_a_kill_given_to_one_that_restarts_before_it_could_tell_the_other_still_reaches_it() {
    let mut pair = Pair::new();
    pair.give(0, Order::Kill);
    pair.restart(0, true);
    pair.talk();
    // Lifted at 0 by its restart; 1 has never restarted.
    assert_eq!(pair.killed(), [true; 2]);
}

#[test]
fn spec_the_later_of_pause_and_continue_holds_and_a_start_ends_both() {
    let mut pair = Pair::new();
    pair.give(0, Order::Pause);
    assert_eq!(pair.say(0), [Change::Held(true)]);
    pair.give(1, Order::Continue);
    assert_eq!(pair.say(1), [Change::Held(false)]);
    // At once at both, without knowing of each other: the pause.
    pair.give(0, Order::Pause);
    pair.talk();
    pair.give(0, Order::Continue);
    let number = pair.sides[1].give(Order::Continue, at(1));
    pair.talk();
    pair.give(0, Order::Pause);
    assert!(number < pair.sides[0].record().hold);
    pair.talk();
    assert!(pair.sides.iter().all(Orders::is_paused));
    pair.give(1, Order::Start);
    pair.talk();
    assert!(!pair.sides.iter().any(Orders::is_paused));
}

#[test]
fn spec_a_vehicle_that_was_armed_by_another_hand_forgets_what_was_asked_for() {
    let mut pair = Pair::new();
    pair.give(0, Order::Start);
    pair.sides[0].forget_start();
    pair.talk();
    assert!(!pair.take_off(0) && !pair.take_off(1));
    assert!(pair.sides[0].is_spent());
}

#[test]
fn regress_numbers_at_their_end_still_kill() {
    let mut pair = Pair::new();
    let end = VEILWING_STATUS_DATA {
        newest_order: u32::MAX,
        kill: u32::MAX,
        kill_lifted: u32::MAX,
        ..Default::default()
    };
    pair.sides[0].hear(&end, at(0));
    pair.sides[0].lift();
    assert!(!pair.sides[0].is_killed());
    pair.give(0, Order::Kill);
    assert!(pair.sides[0].is_killed());
    pair.say(0);
    assert!(pair.sides[1].is_killed());
}

/// The companion that was given the START comes back, is recalled, and hears of the START from the vehicle that flies by it.
#[test]
fn regress_a_start_of_before_a_restart_is_none_after_a_recall() {
    let mut pair = Pair::new();
    pair.give(0, Order::Start);
    pair.say(0);
    assert!(pair.take_off(1));
    pair.restart(0, false);
    pair.give(0, Order::Recall);
    pair.say(0);
    pair.say(1);
    assert!(!pair.take_off(0));
    pair.sides[1].stand_down();
    pair.give(0, Order::Start);
    pair.talk();
    assert!(pair.take_off(0), "one that is given afterwards counts");
}

/// What may happen to the two.
#[derive(Debug, Clone, Copy)]
enum Step {
    Give(usize, Order),
    Say(usize),
    TakeOff(usize),
    Restart(usize),
    Land(usize),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let side = 0..2usize;
    let order = prop::sample::select(vec![
        Order::Start,
        Order::Start,
        Order::Pause,
        Order::Continue,
        Order::Recall,
        Order::Kill,
    ]);
    let step = prop_oneof![
        2 => (side.clone(), order).prop_map(|(side, order)| Step::Give(side, order)),
        4 => side.clone().prop_map(Step::Say),
        3 => side.clone().prop_map(Step::TakeOff),
        1 => side.clone().prop_map(Step::Restart),
        1 => side.prop_map(Step::Land),
    ];
    prop::collection::vec(step, 1..60)
}

proptest! {
    #[test]
    fn prop_no_take_off_after_a_kill_or_recall_that_is_known_nor_twice_by_one_start(steps in steps()) {
        let mut pair = Pair::new();
        let mut begun = [0; 2];
        let mut heard_no = [0; 2];
        for step in steps {
            match step {
                Step::Give(side, order) => {
                    let number = pair.give(side, order);
                    if matches!(order, Order::Kill | Order::Recall) {
                        heard_no[side] = number;
                    }
                }
                Step::Say(from) => {
                    let changes = pair.say(from);
                    if changes.iter().any(|c| matches!(c, Change::Killed | Change::Recalled)) {
                        heard_no[1 - from] = pair.sides[1 - from].record().kill.max(pair.sides[1 - from].record().recall);
                    }
                }
                Step::TakeOff(side) => {
                    if pair.take_off(side) {
                        let number = pair.sides[side].record().begun;
                        prop_assert!(number > begun[side], "a START counts once");
                        prop_assert!(number > heard_no[side], "and not after an order against it");
                        prop_assert!(!pair.sides[side].is_killed());
                        begun[side] = number;
                    }
                }
                Step::Restart(side) => pair.restart(side, false),
                Step::Land(side) => pair.sides[side].stand_down(),
            }
        }
        // Whatever was lost, in the end both know the same.
        pair.talk();
        pair.talk();
        let [a, b] = pair.sides.each_ref().map(|orders| *orders.record());
        prop_assert_eq!((a.kill, a.recall, a.hold, a.holding), (b.kill, b.recall, b.hold, b.holding));
        prop_assert_eq!(pair.sides[0].is_killed(), pair.sides[1].is_killed());
    }
}
