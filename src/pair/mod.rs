//! Slot agreement between the two companions: a state machine without I/O over the messages of
//! `message_definitions/veilwing.xml`. ARCHITECTURE.md draws the sequence of a slot.

pub mod adoption;
mod age;
pub mod clock;
pub mod coordinator;
pub mod lease;
pub mod orders;
mod peer;
pub mod wire;

pub use coordinator::{
    AskedSlot, Commitment, Coordinator, Drifting, Event, Local, MeasuredJitter, OF_POSES, Pace, Places,
    PlanTerms, Rest, Settings, SlotTerms, Timer, Vouch,
};
pub use orders::{Change, Order, Orders, Record};
pub use peer::Peer;
