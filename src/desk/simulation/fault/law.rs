//! The law from which each flight's faults of one kind are drawn: how often, when, to whom and how much.

use super::kind::{FaultKind, Magnitude};

/// Whom a fault befalls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Whom {
    /// Vehicle I.
    I,
    /// Vehicle J.
    J,
    /// One of the two, drawn.
    Either,
    /// Both at once.
    Both,
}

/// How often a fault happens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frequency {
    /// Once in a flight with this probability.
    Once(f64),
    /// So many an hour of flight, on average, independently of one another.
    PerHour(f64),
}

/// One `[[fault]]`: the law from which each flight's faults of it are drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct FaultLaw {
    /// What happens.
    pub kind: FaultKind,
    /// To whom.
    pub whom: Whom,
    /// How often.
    pub frequency: Frequency,
    /// The slot, from 0 over superframes, from whose first emission `after_s` counts.
    pub slot: Option<u16>,
    /// Lowest and highest: seconds of flight, or after the slot's first emission. `None`: uniform over the planned
    /// flight, or over the slot.
    pub after_s: Option<[f64; 2]>,
    /// Lowest and highest. `None`: for ever.
    pub duration_s: Option<[f64; 2]>,
    /// Lowest and highest of each size that belongs to the kind.
    pub sizes: Vec<(Magnitude, [f64; 2])>,
}
