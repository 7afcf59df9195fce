//! The pair protocol under every fault: two real companions' state machines, simulated in virtual time.

#![cfg(feature = "companion")]

#[path = "pair/clocks.rs"]
mod clocks;
#[path = "pair/companion.rs"]
mod companion;
#[path = "pair/edges.rs"]
mod edges;
#[path = "pair/kept.rs"]
mod kept;
#[path = "pair/model.rs"]
mod model;
#[path = "pair/observer.rs"]
mod observer;
#[path = "pair/radio.rs"]
mod radio;
#[path = "pair/service.rs"]
mod service;
#[path = "pair/setup.rs"]
mod setup;
#[path = "pair/sweep.rs"]
mod sweep;
#[path = "pair/world.rs"]
mod world;

use std::time::Duration;

use clap::Parser as _;
use setup::Flown;
use veilwing::pair::wire::MavMessage;
use veilwing::role::Role;
use world::{Case, FaultKind};

fn quiet(seed: u64, slots: usize) -> Case {
    Case {
        loss: 0.0,
        delay: Duration::ZERO,
        duplication: 0.0,
        fault: FaultKind::None,
        slots,
        seed,
        turning: false,
    }
}

#[test]
fn spec_every_slot_is_served_on_a_good_link() {
    let seen = world::run(quiet(1, 20));
    assert_eq!(seen.violations, Vec::<String>::new());
    assert_eq!((seen.slots, seen.served), (20, 20));
    assert!(seen.airtime > world::AIRTIME.mul_f64(0.9 * 20.0), "{:?}", seen.airtime);
}

/// The stored table is the one that `cargo run --release --example pair_sweep -- --slots 20` prints.
#[test]
fn regress_a_sample_of_the_sweep() {
    compare_with_the_stored(false, include_str!("pair/sweep_20.txt"));
}

/// The same, of slots that carry each other on: with `--turning`.
#[test]
fn regress_a_sample_of_the_sweep_through_turns() {
    compare_with_the_stored(true, include_str!("pair/sweep_turning_20.txt"));
}

fn compare_with_the_stored(turning: bool, stored: &str) {
    let mut table = sweep::HEADER.to_owned() + "\n";
    for case in sweep::cases(20, 1, turning) {
        let row = sweep::Row { case, seen: world::run(case) };
        assert_eq!(row.seen.violations, Vec::<String>::new(), "replay: {}", row.replay());
        if row.must_serve() {
            assert_eq!(row.seen.served, row.seen.slots, "{:?} replay: {}", row.seen.aborts, row.replay());
        }
        table += &(sweep::print(&row) + "\n");
    }
    for (new, old) in table.lines().zip(stored.lines()) {
        assert_eq!(new, old, "if this is meant: store the new table");
    }
    assert_eq!(table.lines().count(), stored.lines().count());
}

/// What a failing line prints runs that cell, and running it again is the same flight.
#[test]
fn spec_a_replay_line_is_its_cell() {
    for case in [false, true].into_iter().flat_map(|turning| sweep::cases(3, 7, turning)) {
        let row = sweep::Row { case, seen: world::Seen::default() };
        let line = row.replay();
        let (_, arguments) = line.split_once(" -- ").unwrap();
        let arguments = std::iter::once("pair_sweep").chain(arguments.split(' '));
        assert_eq!(sweep::Args::try_parse_from(arguments).unwrap().cases(), [case], "{line}");
    }
    let case =
        Case { loss: 0.3, delay: Duration::from_millis(20), fault: FaultKind::Restart, ..quiet(9, 10) };
    assert_eq!(format!("{:?}", world::run(case)), format!("{:?}", world::run(case)));
}

/// J vouches for the plan's power alone.
#[test]
fn spec_a_jammer_weaker_than_planned_protects_nobody() {
    let seen = world::run(Case { fault: FaultKind::WeakJammer, ..quiet(3, 5) });
    assert_eq!(seen.violations, Vec::<String>::new());
    assert_eq!((seen.slots, seen.served, seen.airtime), (5, 0, Duration::ZERO));
}

fn violated(seen: &world::Seen, invariant: &str) -> bool {
    seen.violations.iter().any(|violation| violation.contains(invariant))
}

/// A bug put in on purpose must be found, or the observer sees nothing.
#[test]
fn spec_a_grant_counted_from_its_receipt_is_found() {
    let found = (1..=5).any(|seed| {
        let case = Case { loss: 0.3, delay: Duration::from_millis(400), ..quiet(seed, 40) };
        assert_eq!(world::run(case).violations, Vec::<String>::new());
        let seen = world::run_with(case, |now_us, message| {
            if let MavMessage::VEILWING_LEASE_GRANT(grant) = message {
                grant.time_us = now_us;
            }
        });
        violated(&seen, "S1") || violated(&seen, "S3")
    });
    assert!(found);
}

#[test]
fn spec_a_lease_that_never_expires_is_found() {
    let case = Case { loss: 0.3, fault: FaultKind::Restart, ..quiet(8, 40) };
    assert_eq!(world::run(case).violations, Vec::<String>::new());
    let forever = Duration::from_secs(60);
    let seen = world::run_with_lease(case, forever, &mut |_, message: &mut MavMessage| {
        if let MavMessage::VEILWING_LEASE_GRANT(grant) = message {
            grant.duration_ms = 60_000;
        }
    });
    assert!(violated(&seen, "S1"), "{seen:?}");
}

#[test]
fn spec_j_off_before_i_is_found() {
    // Where J's clock is ahead of I's, J is done first and must wait for I.
    let found = (9..17).filter(|&seed| {
        let case = Case { delay: Duration::from_millis(20), ..quiet(seed, 10) };
        assert_eq!(world::run(case).violations, Vec::<String>::new());
        let seen = world::run_with(case, |_, message| {
            if let MavMessage::VEILWING_STATUS(status) = message {
                status.released_us = u64::MAX;
            }
        });
        violated(&seen, "S3")
    });
    assert!(found.count() >= 1);
}

fn slot_model(bug: model::Bug) -> model::SlotModel {
    let step = Duration::from_millis(250);
    let flown = Flown { length: Duration::from_millis(1500), ..Flown::default() };
    let (restarts, losses, radio_troubles, slots) = (0, None, None, 1);
    let before_its_end = None;
    model::SlotModel {
        bug,
        step,
        flown,
        before_its_end,
        from_the_proposal: false,
        copies: 1,
        crashes: 1,
        restarts,
        losses,
        radio_troubles,
        slots,
    }
}

/// Explores the model, prints what was found, and wants every property to hold.
fn holds(model: model::SlotModel) -> model::Explored {
    let explored = model::explore(model);
    println!("{explored}");
    assert_eq!(explored.broken, Vec::<&str>::new());
    explored
}

/// `cargo test --test pair model -- --nocapture` prints the states, the properties and the time of each exploration.
#[test]
fn prop_model_no_order_of_messages_and_no_death_breaks_a_slot() {
    let explored = holds(slot_model(model::Bug::None));
    assert!(explored.states > 1000, "{explored}");
}

#[test]
fn prop_model_a_slot_is_served_when_the_losses_end() {
    let model = model::SlotModel {
        copies: 0,
        crashes: 0,
        losses: Some(3),
        step: Duration::from_millis(200),
        // Time for one lease more than can be lost.
        flown: Flown { length: Duration::from_millis(2000), ..Flown::default() },
        ..slot_model(model::Bug::None)
    };
    holds(model);
}

/// A radio's answers come late, twice or never, from any step on; no two crystals agree.
#[test]
fn prop_model_no_word_of_a_radio_breaks_a_slot() {
    let model = model::SlotModel {
        copies: 0,
        crashes: 0,
        losses: Some(0),
        radio_troubles: Some(2),
        ..slot_model(model::Bug::None)
    };
    holds(model);
}

/// Either companion dies at any step and is back at any later one.
#[test]
fn prop_model_no_restart_breaks_a_slot() {
    holds(model::SlotModel { copies: 0, restarts: 1, ..slot_model(model::Bug::None) });
}

/// A slot, the agreement on the next one, and that one.
#[test]
fn prop_model_a_second_slot_follows_the_first() {
    let model = model::SlotModel {
        copies: 0,
        crashes: 0,
        losses: Some(1),
        slots: 2,
        // What waits for a step is older by as much, and what was said a lease's length ago counts for nothing.
        step: Duration::from_millis(300),
        ..slot_model(model::Bug::None)
    };
    holds(model);
}

/// A slot that carries the one before on, by nobody's word: messages in any order, late, twice or never, from a second before the
/// change to the end of the slot after it.
fn change(losses: Option<u8>) -> model::SlotModel {
    model::SlotModel {
        copies: 0,
        crashes: 0,
        losses,
        slots: 2,
        flown: Flown { slots: 2, turning: true, length: Duration::from_millis(1300), ..Flown::default() },
        before_its_end: Some(Duration::from_millis(250)),
        // Fewer, or it takes minutes; shorter than a lease all the same.
        step: Duration::from_millis(400),
        ..slot_model(model::Bug::None)
    }
}

#[test]
fn prop_model_no_order_of_messages_and_no_death_breaks_a_slot_that_carries_another_on() {
    holds(model::SlotModel { copies: 1, crashes: 1, ..change(None) });
}

#[test]
fn prop_model_a_slot_that_carries_another_on_is_served_when_the_losses_end() {
    let flown = Flown { length: Duration::from_millis(2000), ..change(None).flown };
    holds(model::SlotModel { flown, step: Duration::from_millis(200), ..change(Some(2)) });
}

#[test]
fn prop_model_no_restart_breaks_a_slot_that_carries_another_on() {
    holds(model::SlotModel { crashes: 1, restarts: 1, ..change(Some(1)) });
}

/// The same where the slot after it is planned anew, as only one of the two knows: it does not carry the one before on.
fn renewed(knows: Role, losses: Option<u8>) -> model::SlotModel {
    let change = change(losses);
    let flown = Flown { renews: Some(knows), ..change.flown };
    model::SlotModel { flown, step: Duration::from_millis(350), ..change }
}

#[test]
fn prop_model_no_death_breaks_a_slot_that_is_planned_anew() {
    for knows in Role::BOTH {
        holds(model::SlotModel { crashes: 1, ..renewed(knows, Some(0)) });
    }
}

/// The last second of a slot, in which motions are taken up, one after the other.
fn following(motions: u16, losses: Option<u8>) -> model::SlotModel {
    model::SlotModel {
        copies: 0,
        crashes: 0,
        losses,
        flown: Flown { length: Duration::from_millis(2500), motions, ..Flown::default() },
        before_its_end: Some(Duration::from_secs(1)),
        ..slot_model(model::Bug::None)
    }
}

/// Of one motion, in the order in which messages come. With a copy kept, 1.2 million states, it takes eight minutes, and holds.
#[test]
fn prop_model_no_order_of_messages_has_i_on_in_a_motion_that_j_does_not_fly() {
    holds(model::SlotModel { before_its_end: Some(Duration::from_millis(700)), ..following(1, None) });
}

#[test]
fn prop_model_no_loss_has_i_on_in_a_motion_that_j_does_not_fly() {
    holds(following(2, Some(2)));
}

#[test]
fn prop_model_no_restart_has_i_on_in_a_motion_that_j_does_not_fly() {
    holds(model::SlotModel { crashes: 1, restarts: 1, ..following(2, Some(1)) });
}

/// From the first proposal of a slot whose poses are made anew for each, to its end.
fn anew(losses: Option<u8>) -> model::SlotModel {
    model::SlotModel {
        copies: 0,
        crashes: 0,
        losses,
        flown: Flown { anew: true, ..slot_model(model::Bug::None).flown },
        from_the_proposal: true,
        ..slot_model(model::Bug::None)
    }
}

#[test]
fn prop_model_no_loss_has_both_serve_a_slot_from_different_poses() {
    holds(anew(Some(2)));
}

#[test]
fn prop_model_no_copy_has_both_serve_a_slot_from_different_poses() {
    holds(model::SlotModel { copies: 1, ..anew(Some(1)) });
}

#[test]
fn prop_model_no_restart_has_both_serve_a_slot_from_different_poses() {
    holds(model::SlotModel { crashes: 1, restarts: 1, ..anew(Some(0)) });
}

#[test]
fn spec_model_finds_the_bugs_put_in_on_purpose() {
    let forged = model::SlotModel { bug: model::Bug::PosesNotCompared, ..anew(Some(0)) };
    let explored = model::explore(forged);
    println!("{explored}");
    assert!(explored.broken.contains(&"both serve a slot from the same poses"), "{explored}");
    use model::Bug;
    for bug in [Bug::LeaseNeverExpires, Bug::JOffBeforeI, Bug::GrantCountedFromReceipt] {
        let explored = model::explore(slot_model(bug));
        println!("{explored}");
        assert!(explored.broken.iter().any(|name| name.starts_with('S')), "{bug:?}: {explored}");
    }
}
