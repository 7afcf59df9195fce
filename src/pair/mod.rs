//! Slot agreement between the two companions.

pub mod wire;
