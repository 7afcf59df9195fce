//! What an operator watches in a terminal: both companions over any MAVLink address, or a recorded flight.
//!
//! [`State`] is fed messages, keys and instants and drained of messages; it reads no clock and no socket. [`view::draw`] shows
//! it in a terminal of any size from 80 by 24. The loop round both is `veilwing watch` (and `sitl --watch`).

mod order;
mod recording;
mod replay;
mod state;
mod vehicle;
pub mod view;

#[cfg(test)]
mod tests;

pub use recording::{Recording, RecordingError};
pub use replay::Replay;
pub use state::{After, Key, Source, State};
pub use vehicle::{Id, Vehicle};
