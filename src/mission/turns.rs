//! Transits in which time alone keeps the vehicles apart ([`Separation::Time`](crate::schedule::transit::Separation)):
//! one moves while the other rests. A vehicle sets off only once the other has said that it rests where the table has
//! it by then; until it has, the rest of the vehicle's way is that much later. Pure.

use std::time::Duration;

use crate::geo::Enu;
use crate::schedule::trajectory::Trajectory;
use crate::time::Instant;

/// How far from its place the other may rest, in metres.
const RESTS_M: f64 = 1.0;

/// The other vehicle's part of such a transit.
#[derive(Debug, Clone)]
pub(super) struct Turns {
    peer: Trajectory,
    /// The last departure of our own that was let go, in our trajectory's time.
    departed: Option<Duration>,
}

impl Turns {
    /// A transit that begins, on which the other flies `peer`.
    pub fn new(peer: Trajectory) -> Self {
        Self { peer, departed: None }
    }

    /// When our trajectory `own` is to have started, which was `starts_at` up to now: later by as long as we have
    /// waited at a departure that is due. `peer_at`: where the other says it is, if it has said so of late.
    pub fn started(
        &mut self,
        own: &Trajectory,
        starts_at: Instant,
        peer_at: Option<Enu>,
        now: Instant,
    ) -> Instant {
        let Some(departs) = own.departure_after(self.departed).filter(|&t| starts_at + t <= now) else {
            return starts_at;
        };
        let place = self.peer.sample(departs).position_enu_m;
        if peer_at.is_some_and(|at| (at - place).norm() <= RESTS_M) {
            self.departed = Some(departs);
            return starts_at;
        }
        // Still resting where this leg begins.
        now - departs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Attitude;
    use crate::schedule::trajectory::{Limits, Start};

    const LIMITS: Limits = Limits::new(10.0, 3.0, 0.5);

    fn at(s: f64) -> Instant {
        Instant::from_start(Duration::from_secs_f64(s))
    }

    /// From x = 0 to x = 40 m, leaving at `leaves_s`.
    fn way(leaves_s: f64) -> Trajectory {
        let start = Start { position_enu_m: Enu::zeros(), attitude: Attitude::level() };
        let mut way = Trajectory::rest(&start);
        way.hold_until(leaves_s);
        way.fly(&[Enu::new(40.0, 0.0, 0.0)], &LIMITS);
        way
    }

    #[test]
    fn spec_the_second_leaves_when_the_first_has_arrived_and_is_later_by_the_wait() {
        let first = way(0.0);
        let arrives_s = first.duration().as_secs_f64();
        let second = way(arrives_s + 2.0);
        let mut turns = Turns::new(first);
        let (mut starts_at, begin) = (at(100.0), 100.0);
        let mut step = |s: f64, peer_at: Option<Enu>| {
            starts_at = turns.started(&second, starts_at, peer_at, at(begin + s));
            starts_at
        };
        // While it is not our turn nothing matters.
        assert_eq!(step(1.0, None), at(begin));
        assert_eq!(step(arrives_s + 1.9, Some(Enu::zeros())), at(begin));
        // Due, and the other is late by three seconds: short of its place, silent, then there.
        let due = arrives_s + 2.0;
        let short = Some(Enu::new(38.9, 0.0, 0.0));
        for (wait, peer_at) in [(0.5, short), (1.5, None), (3.0, short)] {
            let started = step(due + wait, peer_at);
            assert!((started.since_start().as_secs_f64() - (begin + wait)).abs() < 1e-6);
            let still = second.sample(at(begin + due + wait).saturating_since(started));
            assert!(
                still.position_enu_m.norm() < 1e-9 && still.velocity_enu_m_s.vector().norm() < 1e-5,
                "{still:?}"
            );
        }
        let there = Some(Enu::new(39.2, 0.3, 0.0));
        let started = step(due + 3.02, there);
        assert!((started.since_start().as_secs_f64() - (begin + 3.0)).abs() < 1e-6);
        // Once under way it goes on, whatever the other says.
        assert_eq!(step(due + 5.0, None), started);
    }

    #[test]
    fn spec_each_departure_from_rest_is_asked_for_and_each_leg_in_between_is_not() {
        let start = Start { position_enu_m: Enu::zeros(), attitude: Attitude::level() };
        let mut way = Trajectory::rest(&start);
        way.fly(&[Enu::new(10.0, 0.0, 0.0), Enu::new(10.0, 10.0, 0.0)], &LIMITS);
        let moved = way.duration();
        way.hold_until(60.0);
        way.fly(&[Enu::new(10.0, 10.0, 5.0)], &LIMITS);
        assert_eq!(way.departure_after(None), Some(Duration::ZERO));
        assert_eq!(way.departure_after(Some(Duration::ZERO)), Some(Duration::from_secs(60)));
        assert_eq!(way.departure_after(Some(Duration::from_secs(60))), None);
        assert!(moved < Duration::from_secs(60));
    }
}
