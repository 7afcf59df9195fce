//! Transits as the planner of a superframe asks for them, and how long a superframe takes.
//!
//! A superframe is a cycle: from the last user's poses back to the first's. Its length is that of the slot table's, opening
//! to opening, once the cycle is under way; the way from the start and the way home are not part of it, and of the last
//! superframe of a mission nobody flies the way back.

use std::time::Duration;

use nalgebra::Vector3;

use super::error::TableError;
use super::order::{Order, Places};
use super::table::{Table, Timing};
use super::trajectory::Start;
use super::transit::Router;
use crate::geo::Pose;
use crate::planner::volume::Ways;
use crate::role::{PerVehicle, Role};

/// So many superframes in a row have one way to the first user and hardly fewer ways back than ways there.
const MANY: u16 = u16::MAX;

fn hovering(poses: &PerVehicle<Pose>) -> PerVehicle<Start> {
    poses.map(|pose| Start { position_enu_m: pose.position_enu_m, attitude: pose.attitude() })
}

impl Ways for Router {
    fn straight_s(&self, role: Role, by_m: &Vector3<f64>) -> (f64, Vector3<f64>) {
        self.limits(role).straight_s(by_m)
    }

    fn turn_rate_rad_s(&self, role: Role) -> f64 {
        self.limits(role).tilt_rate_rad_s
    }

    fn transit_s(&self, from: &PerVehicle<Pose>, to: &PerVehicle<Pose>) -> Option<f64> {
        self.plan(&hovering(from), to).ok().map(|transit| transit.duration().as_secs_f64())
    }

    fn shortest(&self, users: usize, between_s: &[f64]) -> Vec<usize> {
        let time = |s: &f64| Duration::try_from_secs_f64(*s).unwrap_or(Duration::MAX);
        let places = Places {
            of_user: (0..users).map(|user| vec![user]).collect(),
            // A cycle may as well begin with the first.
            from_start: (0..users)
                .map(|user| if user == 0 { Duration::ZERO } else { Duration::MAX })
                .collect(),
            between: between_s.iter().map(time).collect(),
            superframes: MANY,
        };
        let listed = || (0..users).collect();
        places
            .tour(Order::Shortest)
            .map_or_else(listed, |tour| tour.visits.into_iter().map(|(user, _)| user).collect())
    }
}

/// How long a superframe takes, from opening to opening of its first slot, when it follows another. `lengths` are the users'
/// slots, where they differ from the timing's.
///
/// # Errors
/// [`TableError`] as of the slot table.
pub fn superframe(
    router: &Router,
    users: &[PerVehicle<Pose>],
    lengths: &[Duration],
    timing: &Timing,
    order: Order,
) -> Result<Duration, TableError> {
    let Some(first) = users.first() else { return Err(TableError::Empty { users: 0, superframes: 1 }) };
    let start = hovering(first);
    // The order that is shortest in the long run, then twice round.
    let order = match order {
        Order::Listed => (0..users.len()).collect(),
        Order::Shortest => {
            let time = |from, to| router.transit_s(&users[from], &users[to]).unwrap_or(f64::INFINITY);
            let n = users.len();
            let between_s: Vec<f64> =
                (0..n * n).map(|k| if k / n == k % n { 0.0 } else { time(k / n, k % n) }).collect();
            router.shortest(n, &between_s)
        }
    };
    let candidates: Vec<_> = order.iter().map(|user| vec![users[*user]]).collect();
    let lengths: Vec<_> =
        order.iter().map(|user| lengths.get(*user).copied().unwrap_or(timing.slot)).collect();
    let timing = Timing { superframes: 2, ..*timing };
    let table = Table::with_lengths(router, &start, &candidates, &lengths, &timing, Order::Listed)?;
    let opens = |slot: usize| table.entries.get(slot).map_or(Duration::ZERO, |entry| entry.opens);
    Ok(opens(users.len()).saturating_sub(opens(0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Enu;
    use crate::schedule::testing;
    use rand::RngExt;

    /// Both vehicles level, J 20 m east of I.
    fn poses(x: f64, y: f64) -> PerVehicle<Pose> {
        let at =
            |x| Pose { position_enu_m: Enu::new(x, y, 40.0), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        PerVehicle { i: at(x), j: at(x + 20.0) }
    }

    const TIMING: Timing = Timing::new(Duration::from_secs(20), Duration::from_secs(1), 1);

    #[test]
    fn val_a_superframe_closes_its_cycle() {
        // North, side by side: 100 m take 4 + 10 s, each followed by 3 s of settling and a slot.
        let users = [poses(0.0, 0.0), poses(0.0, 100.0)];
        let found = superframe(&testing::router(), &users, &[], &TIMING, Order::Listed).unwrap();
        assert_eq!(found, Duration::from_secs(2 * (14 + 3 + 20)));
        let one = superframe(&testing::router(), &users[..1], &[], &TIMING, Order::Listed).unwrap();
        assert_eq!(one, Duration::from_secs(23));
        assert!(superframe(&testing::router(), &[], &[], &TIMING, Order::Listed).is_err());
    }

    #[test]
    fn val_the_shortest_cycle_is_that_of_all_orders() {
        let mut rng = testing::rng(3);
        let router = testing::router();
        for _ in 0..10 {
            let mut place = || rng.random_range(-300.0..300.0);
            let users: Vec<_> = (0..5).map(|_| poses(place(), place())).collect();
            let shortest = superframe(&router, &users, &[], &TIMING, Order::Shortest).unwrap();
            let mut least = Duration::MAX;
            for k in 0..24usize {
                // Every order that begins with the first.
                let mut rest: Vec<usize> = (1..5).collect();
                let mut order = vec![0];
                let mut code = k;
                for left in (1..=4).rev() {
                    order.push(rest.remove(code % left));
                    code /= left;
                }
                let users: Vec<_> = order.iter().map(|user| users[*user]).collect();
                least = least.min(superframe(&router, &users, &[], &TIMING, Order::Listed).unwrap());
            }
            // Openings are rounded up to a tenth.
            assert!(shortest <= least + Duration::from_millis(500), "{shortest:?} {least:?}");
        }
    }
}
