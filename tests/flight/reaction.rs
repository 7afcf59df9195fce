//! S4: the power-off command within 100 ms of the first sign of a fault on the wire. `examples/reaction.rs` prints the
//! same table for a thousand faults.

use veilwing::desk::simulation::{Given, vehicle};

use crate::harness::yard;
use crate::reaction_table::{Base, table};
use veilwing::role::Role;

#[test]
fn spec_every_fault_is_answered_within_s4_at_every_phase_of_a_slot() {
    let planned = yard();
    let vehicle = vehicle(&planned.mission, Role::I).unwrap();
    let given = Given { mission: planned.mission.clone(), plan: planned.plan.clone(), vehicle };
    let base = Base::new(&given);
    let table = table(&base, 36, 2);
    println!("{table}");
    assert!(table.beyond().is_empty(), "{:#?}", table.beyond());
}
