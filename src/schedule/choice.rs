//! From which of several nearly equal poses each user is served, so that the pair's ways between slots are short.
//!
//! Chosen when the plan is made, before anybody knows where the vehicles will start: both companions make the same plan
//! from the same mission, and its digest covers what was chosen. So the ways from the start and home are left out here;
//! the order itself is settled later, by the slot table, which knows the start.

use super::legs::Legs;
use super::order::Order;
use super::transit::Router;
use crate::geo::Pose;
use crate::role::PerVehicle;

/// For each user the position of one of its candidates: of all choices and orders the one with the least total transit
/// time between slots over `superframes` (exact as far as [`Order::Shortest`] is). Ties go to the earlier candidates. Each
/// user's first where no choice can be flown, or there is nothing to choose.
#[must_use]
pub fn shortest(router: &Router, users: &[Vec<PerVehicle<Pose>>], superframes: u16) -> Vec<usize> {
    let mut chosen = vec![0; users.len()];
    if users.iter().any(Vec::is_empty) || users.iter().all(|candidates| candidates.len() == 1) {
        return chosen;
    }
    let mut legs = Legs::new(router, None, users);
    // Where no tour exists the table will say so, with the leg that fails.
    if let Ok(tour) = legs.tour(superframes.max(1), Order::Shortest) {
        for (user, place) in tour.visits {
            chosen[user] = legs.candidate(user, place);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Enu;
    use crate::schedule::testing;

    /// Both vehicles level, J 20 m east of I.
    fn poses(x: f64, y: f64) -> PerVehicle<Pose> {
        let at =
            |x| Pose { position_enu_m: Enu::new(x, y, 40.0), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        PerVehicle { i: at(x), j: at(x + 20.0) }
    }

    #[test]
    fn spec_the_choice_is_the_nearest_of_all_combinations() {
        // The first candidates are far apart; in a line stand the second of a, the third of b and the second of c.
        let users = [
            vec![poses(-400.0, 300.0), poses(0.0, 0.0)],
            vec![poses(400.0, -300.0), poses(300.0, 300.0), poses(0.0, 50.0)],
            vec![poses(-300.0, -400.0), poses(0.0, 100.0)],
        ];
        assert_eq!(shortest(&testing::router(), &users, 1), [1, 2, 1]);
        assert_eq!(shortest(&testing::router(), &users, 3), [1, 2, 1]);
    }

    #[test]
    fn spec_nothing_to_choose() {
        assert_eq!(shortest(&testing::router(), &[vec![poses(0.0, 0.0)], vec![poses(50.0, 0.0)]], 1), [0, 0]);
        assert!(shortest(&testing::router(), &[], 1).is_empty());
    }

    #[test]
    fn spec_what_cannot_be_flown_is_not_chosen() {
        // A pose outside the geofence has no way to it.
        let users = [vec![poses(900.0, 0.0), poses(0.0, 0.0)], vec![poses(10.0, 0.0), poses(300.0, 0.0)]];
        assert_eq!(shortest(&testing::router(), &users, 1), [1, 0]);
        let nowhere = [vec![poses(900.0, 0.0), poses(900.0, 50.0)], vec![poses(10.0, 0.0)]];
        assert_eq!(shortest(&testing::router(), &nowhere, 1), [0, 0]);
    }
}
