//! What the world cannot see by itself and its host can: how a companion fares.

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
}

impl Default for Circumstances {
    fn default() -> Self {
        Self { runs: true, life: 0, vehicle_link: Passage::Good, from_peer: Passage::Good }
    }
}
