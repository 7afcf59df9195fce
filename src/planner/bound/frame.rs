//! A frame that turns with the line to one eavesdropper while I moves over a box: that line stays where it is in the frame, and the
//! antenna's axis may as well be told there.
//!
//! I goes from the centre straight to `p`. The line to a node turns in one plane as it does, and the frame with the leader's, by the
//! angle between the two ends. In the frame the direction u to another node changes as fast as `x = u' - w x u`, w the leader's rate of
//! turning. Where I moves by d in all, `u' = -(d - u <u, d>) / s` at a distance s; x is linear in d at the centre, so that a corner
//! has the most of it. On the way x changes by no more than `|u''| + |w'| + |w| |u'|`, of which `|u''| <= 2 / sqrt(3) r^2`,
//! `|w'| <= r_1^2` and `|w| |u'| <= r_1 r`, where r and r_1 are the length of d over the least distance to the node and to the leader.

use nalgebra::Vector3;

use super::cell::Cell;

/// `2 / sqrt(3)`, upward.
const BENT: f64 = 1.1548;

/// A node as it is seen from a box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight {
    /// From the centre: the direction, and how far it is, metres.
    pub direction: Vector3<f64>,
    distance: f64,
    /// The box's radius over the least distance.
    nearness: f64,
}

impl Sight {
    pub fn new(cell: &Cell, node: &Vector3<f64>) -> Self {
        let line = node - cell.centre();
        let distance = line.norm();
        let direction = line.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let nearness = cell.radius() / cell.least_distance_squared(node).sqrt();
        Self { direction, distance, nearness }
    }

    /// How the direction changes where the box's centre moves.
    fn turned(&self, moved: &Vector3<f64>) -> Vector3<f64> {
        (self.direction * self.direction.dot(moved) - moved) / self.distance
    }

    /// How far this direction is from that of the centre, anywhere in `cell`, in the frame that turns with the line to `leader`: an upper
    /// bound on the length of the difference of the two unit vectors.
    pub fn drift(&self, cell: &Cell, leader: &Self) -> f64 {
        let half = (cell.hi - cell.lo) * 0.5;
        let along = leader.direction.dot(&self.direction);
        let mut first = 0.0_f64;
        for [y, z] in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
            let corner = half.component_mul(&Vector3::new(1.0, y, z));
            // w x u, w = u_1 x u_1' of the leader's direction u_1.
            let lead = leader.turned(&corner);
            let carried = lead * along - leader.direction * lead.dot(&self.direction);
            first = first.max((self.turned(&corner) - carried).norm_squared());
        }
        let (own, led) = (self.nearness, leader.nearness);
        let second = 0.5 * (BENT * own * own + led * led + led * own);
        // No two unit vectors are farther apart; not a number where a node lies in the box.
        if first.sqrt() + second < 2.0 { first.sqrt() + second } else { 2.0 }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn prop_directions_drift_no_farther_than_bounded_and_some_as_far() {
        let mut rng = ChaCha8Rng::seed_from_u64(71);
        let mut closest = 0.0_f64;
        for round in 0..3000 {
            let mut within = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
            let size = [0.3, 3.0, 15.0][round % 3];
            let (centre, half, leader, node) = (within(40.0), within(size).abs(), within(60.0), within(60.0));
            let cell = Cell { lo: centre - half, hi: centre + half };
            let sights = [&leader, &node].map(|node| Sight::new(&cell, node));
            let bound = sights[1].drift(&cell, &sights[0]);
            if bound >= 2.0 {
                continue;
            }
            for _ in 0..40 {
                let corner = within(1.0).map(f64::signum);
                let share = if round % 2 == 0 { corner } else { within(1.0) };
                let p = centre + half.component_mul(&share);
                let [led, seen] = [leader - p, node - p].map(|line| line.normalize());
                // By another road: the rotation between two vectors, as nalgebra finds it.
                let back = Rotation3::rotation_between(&led, &sights[0].direction).unwrap();
                let drift = (back * seen - sights[1].direction).norm();
                assert!(drift <= bound + 1e-12, "{cell:?} {leader} {node}: {drift} {bound}");
                closest = closest.max(drift / bound);
            }
        }
        assert!(closest > 0.95, "{closest}");
    }
}
