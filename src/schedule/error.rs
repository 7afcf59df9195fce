//! Why there is no slot table.

use super::transit::TransitError;

/// Why there is no table.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TableError {
    /// Nobody to serve.
    #[error("there is no slot: {users} users in {superframes} superframes; give at least one of each")]
    Empty {
        /// Users with at least one pose.
        users: usize,
        /// Superframes.
        superframes: u16,
    },
    /// Slots are numbered in 16 bits.
    #[error("{slots} slots are too many: lower tdma.superframes so that there are at most {limit}")]
    TooMany {
        /// Users times superframes.
        slots: usize,
        /// The limit.
        limit: u16,
    },
    /// Nothing is left of a slot.
    #[error("tdma.guard_s ({guard_s} s) leaves nothing of tdma.slot_s ({slot_s} s): lower it")]
    NoAirtime {
        /// Slot in seconds.
        slot_s: f64,
        /// Guard in seconds.
        guard_s: f64,
    },
    /// A leg of the tour cannot be flown (or, in the shortest order, no tour can be flown and this leg is the first).
    #[error("from {} to user {to}: {source}", from.map_or_else(|| "the start".to_owned(), |user| format!("user {user}")))]
    Transit {
        /// Index of the user before, or the start.
        from: Option<usize>,
        /// Index of the user to be served.
        to: usize,
        /// What is wrong.
        source: TransitError,
    },
}
