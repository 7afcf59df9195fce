//! What the world cannot see by itself and its host can: how a companion fares.

use std::time::Duration;

/// What is sent over a good link arrives within this, with the steps of all who take part.
pub(super) const GOOD_WAY: Duration = Duration::from_millis(5);

/// How datagrams fare on a way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Passage {
    /// All arrive, within milliseconds.
    #[default]
    Good,
    /// Some are lost, late, or overtaken.
    Impaired,
    /// None arrives.
    Cut,
}

/// The circumstances of a vehicle's companion, as its host knows them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Circumstances {
    /// The process runs: it is neither dead nor stopped.
    pub runs: bool,
    /// Which process it is: one that was started anew remembers nothing of what the last one knew.
    pub life: u32,
    /// Between it and its vehicle, both ways, beside what [`Fault`](super::fault::Fault) does to that link.
    pub vehicle_link: Passage,
    /// From its peer to it.
    pub from_peer: Passage,
    /// What is sent over the vehicle's link from now on is under way for so long at most.
    pub vehicle_way: Duration,
    /// The same from its peer to it.
    pub peer_way: Duration,
}

impl Default for Circumstances {
    fn default() -> Self {
        Self {
            runs: true,
            life: 0,
            vehicle_link: Passage::Good,
            from_peer: Passage::Good,
            vehicle_way: GOOD_WAY,
            peer_way: GOOD_WAY,
        }
    }
}
