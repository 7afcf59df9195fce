//! What the operator should know of a link's other end.

use std::time::Duration;

use crate::time::Utc;

/// A line for the log.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Notice {
    /// The clocks of the two ends differ.
    #[error("{}", clocks(.0))]
    Clocks(Apart),
    /// This machine's clock is behind the timestamps that it has used before.
    #[error("this machine's clock, {here}, is {} behind what it was in an earlier run: set it", span(*behind))]
    OwnClock {
        /// By so much.
        behind: Duration,
        /// What it says.
        here: Utc,
    },
    /// The only system heard where the peer's is not given.
    #[error(
        "system {0} is taken for the other end, the only one heard in three seconds; say so in the vehicle file: peer_system_id = {0}"
    )]
    OneSystem(u8),
    /// Several systems are heard where the peer's is not given.
    #[error("{} speak here, and none is taken: say in the vehicle file which one is the other end, peer_system_id", systems(.0))]
    SeveralSystems(Vec<u8>),
}

/// Two clocks that differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Apart {
    /// The other end's; at least that, where it only shows in what it signs.
    pub there: Utc,
    /// This machine's.
    pub here: Utc,
    /// Its frames are turned away for it.
    pub refused: bool,
    /// This machine's has been later before.
    pub here_was_later: bool,
}

fn clocks(apart: &Apart) -> String {
    let Apart { there, here, refused, here_was_later } = apart;
    let (off, way) = if there > here {
        (there.saturating_since(*here), "ahead of")
    } else {
        (here.saturating_since(*there), "behind")
    };
    let consequence = if *refused { "its frames are turned away: set" } else { "set" };
    let which =
        if *here_was_later { "this machine's, which has been later before" } else { "the one that is wrong" };
    format!(
        "the other end's clock is {} {way} this machine's (there {there}, here {here}): {consequence} {which}",
        span(off)
    )
}

/// A length of time in the largest unit that fits it.
fn span(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    match seconds {
        0.0..120.0 => format!("{seconds:.0} s"),
        120.0..3570.0 => format!("{:.0} min", seconds / 60.0),
        3570.0..172_800.0 => format!("{:.1} h", seconds / 3600.0),
        _ => format!("{:.1} days", seconds / 86_400.0),
    }
}

fn systems(ids: &[u8]) -> String {
    let ids: Vec<String> = ids.iter().map(u8::to_string).collect();
    format!("systems {}", ids.join(", "))
}
