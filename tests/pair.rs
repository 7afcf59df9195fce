//! The pair protocol under every fault: two real companions' state machines, simulated in virtual time.

#[path = "pair/companion.rs"]
mod companion;
#[path = "pair/radio.rs"]
mod radio;
#[path = "pair/sweep.rs"]
mod sweep;
#[path = "pair/world.rs"]
mod world;

use std::time::Duration;

use world::{Case, FaultKind};

fn quiet(seed: u64, slots: usize) -> Case {
    Case { loss: 0.0, delay: Duration::ZERO, duplication: 0.0, fault: FaultKind::None, slots, seed }
}

#[test]
fn regress_every_slot_is_served_on_a_good_link() {
    let seen = world::run(quiet(1, 20));
    assert_eq!(seen.violations, Vec::<String>::new());
    assert_eq!((seen.slots, seen.served), (20, 20));
    assert!(seen.airtime > world::AIRTIME.mul_f64(0.9 * 20.0), "{:?}", seen.airtime);
}

#[test]
fn regress_a_sample_of_the_sweep() {
    for row in sweep::rows(20, 1) {
        assert_eq!(row.seen.violations, Vec::<String>::new(), "replay: {}", row.replay());
        if row.must_serve() {
            assert_eq!(row.seen.served, row.seen.slots, "{:?} replay: {}", row.seen.aborts, row.replay());
        }
    }
}
