//! Where a vehicle has to stay, so that the two are apart whatever the other does.

use nalgebra::Vector3;

use crate::geo::Enu;
use crate::role::PerVehicle;

/// The half-space `outwards . p <= offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Side {
    /// Unit normal out of it, ENU.
    pub outwards: Vector3<f64>,
    /// Offset in metres.
    pub offset_m: f64,
}

impl Side {
    /// Each vehicle's side of the two planes that lie so far apart about the middle between two places, across the line from one to
    /// the other. Of places that are nearer to each other than that the planes lie in them.
    #[must_use]
    pub fn between(places_enu_m: &PerVehicle<Enu>, apart_m: f64) -> PerVehicle<Self> {
        let PerVehicle { i, j } = places_enu_m;
        let way = j - i;
        let distance_m = way.norm();
        let outwards = if distance_m > 0.0 { way / distance_m } else { Vector3::x() };
        let (middle_m, half_m) = (outwards.dot(&(i + j)) / 2.0, apart_m.min(distance_m) / 2.0);
        PerVehicle {
            i: Self { outwards, offset_m: middle_m - half_m },
            j: Self { outwards: -outwards, offset_m: -middle_m - half_m },
        }
    }

    /// How far a place is outside, in metres; negative inside.
    #[must_use]
    pub fn outside_m(&self, place_enu_m: &Enu) -> f64 {
        self.outwards.dot(place_enu_m) - self.offset_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_whoever_stays_on_its_side_is_far_enough_from_the_other() {
        let places = PerVehicle { i: Enu::new(0.0, 0.0, 50.0), j: Enu::new(30.0, 40.0, 50.0) };
        let sides = Side::between(&places, 7.0);
        // Half of 50 m, less half of 7 m.
        assert!((sides.i.outside_m(&places.i) + 21.5).abs() < 1e-9);
        assert!((sides.j.outside_m(&places.j) + 21.5).abs() < 1e-9);
        let on_the_edge = |side: &Side, by: f64| places.i + side.outwards * by;
        let i = on_the_edge(&sides.i, 21.5);
        let j = on_the_edge(&sides.i, 28.5);
        assert!(sides.i.outside_m(&i).abs() < 1e-9 && sides.j.outside_m(&j).abs() < 1e-9);
        assert!((i - j).norm() >= 7.0 - 1e-9);
    }

    #[test]
    fn spec_who_is_nearer_than_that_may_only_go_away() {
        let places = PerVehicle { i: Enu::new(0.0, 0.0, 50.0), j: Enu::new(0.0, 0.0, 53.0) };
        let sides = Side::between(&places, 7.0);
        assert!(sides.i.outside_m(&places.i).abs() < 1e-9 && sides.j.outside_m(&places.j).abs() < 1e-9);
        assert!(sides.i.outside_m(&Enu::new(0.0, 0.0, 50.5)) > 0.4);
        let same = Side::between(&PerVehicle { i: places.i, j: places.i }, 7.0);
        assert!(same.i.outside_m(&places.i).abs() < 1e-9 && same.j.outwards == -same.i.outwards);
    }
}
