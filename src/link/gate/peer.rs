//! Which MAVLink system is at the other end.

use std::collections::BTreeSet;
use std::time::Duration;

use super::notice::Notice;
use crate::link::counters::Rejection;
use crate::time::Instant;

/// How long to listen for a second system before the first is taken.
pub(super) const WINDOW: Duration = Duration::from_secs(3);

/// The system at the other end.
#[derive(Debug)]
pub(super) enum Peer {
    /// It is given.
    System(u8),
    /// Whoever is at the other end of a way that leads to nobody else.
    Anyone,
    /// Not known, where anybody may speak: the only one heard for [`WINDOW`].
    Sought {
        /// When the first one was heard.
        since: Option<Instant>,
        /// All that were heard.
        systems: BTreeSet<u8>,
    },
}

impl Peer {
    /// Not known, and nobody heard yet.
    pub(super) fn sought() -> Self {
        Self::Sought { since: None, systems: BTreeSet::new() }
    }

    /// Whether frames of this system may be the peer's, as far as is known.
    pub(super) fn may_be(&self, system: u32) -> bool {
        match self {
            Self::System(peer) => u32::from(*peer) == system,
            Self::Anyone => true,
            Self::Sought { .. } => u8::try_from(system).is_ok(),
        }
    }

    /// A sound frame of a system that may be the peer's has come: what to tell of it, and whether it is the peer's;
    /// [`Rejection::Unpinned`] while that is not known.
    pub(super) fn hear(&mut self, system: u32, now: Instant) -> (Option<Notice>, Result<(), Rejection>) {
        let Self::Sought { since, systems } = self else { return (None, Ok(())) };
        let Ok(system) = u8::try_from(system) else { return (None, Err(Rejection::ForeignSystem)) };
        let first = *since.get_or_insert(now);
        let new = systems.insert(system);
        if systems.len() > 1 {
            let told = new.then(|| Notice::SeveralSystems(systems.iter().copied().collect()));
            return (told, Err(Rejection::Unpinned));
        }
        if now.saturating_since(first) < WINDOW {
            return (None, Err(Rejection::Unpinned));
        }
        *self = Self::System(system);
        (Some(Notice::OneSystem(system)), Ok(()))
    }
}
