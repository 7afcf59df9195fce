//! Chooses both poses and both transmit powers of a slot.

pub mod bound;
pub mod plan;
pub mod problem;
