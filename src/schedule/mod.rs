//! TDMA: slots, order of users, transit trajectories, separation and geofence (PROTOCOL F1).
//!
//! From one slot's poses to the next, both vehicles fly a [`transit`] inside the [`geofence`] and the altitude band,
//! outside the no-fly areas, and apart from each other even when one of them is late. The [`table`] strings transits and slots together. All of
//! it is a pure function of plan, airspace, limits and starting positions: the companions of both vehicles compute
//! the same table, bit for bit.

pub mod choice;
mod error;
pub mod geofence;
mod legs;
mod no_fly;
pub mod order;
pub mod outset;
mod route;
pub mod separation;
mod sequence;
pub mod table;
pub mod trajectory;
pub mod transit;
pub mod ways;

#[cfg(test)]
mod testing;
