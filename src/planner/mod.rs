//! Chooses both poses and both transmit powers of a slot.

pub mod plan;
pub mod problem;
pub mod slots;
