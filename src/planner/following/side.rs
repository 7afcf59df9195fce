//! Where a vehicle has to stay, so that the two are apart whichever motion the other flies, and wherever on it it is.

use nalgebra::Vector3;

use crate::geo::Enu;
use crate::role::PerVehicle;

/// Steps of the search for the shortest line, which are many where ways are long and near to each other, and what may be left of it
/// to gain, as a part of its length.
const STEPS: usize = 256;
const NEAR: f64 = 1e-6;

/// The half-space `outwards . p <= offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Side {
    /// Unit normal out of it, ENU.
    pub outwards: Vector3<f64>,
    /// Offset in metres.
    pub offset_m: f64,
}

impl Side {
    /// Each vehicle's side of two planes so far apart, in the middle of the shortest line between all that either may still fly, across
    /// it; of what is nearer to the other's than that the planes lie in it. `before` points from I to J across planes that hold it as
    /// well: what they left between the two these do not take away.
    ///
    /// The line is found by Gilbert's steps: the point of what lies between two convex hulls, as differences of their points, that is
    /// nearest to none, moved towards the difference that is farthest against it.
    #[must_use]
    pub fn between(
        reach_enu_m: &PerVehicle<Vec<Enu>>,
        before: Option<Vector3<f64>>,
        apart_m: f64,
    ) -> PerVehicle<Self> {
        let PerVehicle { i, j } = reach_enu_m;
        // The last point of I's and the first of J's in a direction.
        let supports = |way: &Vector3<f64>| {
            let farthest = |points: &[Enu], sign: f64| {
                let reaches = points.iter().copied().map(|p| (sign * way.dot(&p), p));
                reaches.reduce(|most, other| if other.0 > most.0 { other } else { most })
            };
            farthest(i, 1.0).zip(farthest(j, -1.0)).map(|((_, i), (_, j))| [i, j])
        };
        let mut best: Option<(f64, Self)> = None;
        // With the plane in the middle between both.
        let mut try_across = |way: &Vector3<f64>| {
            let outwards = way.try_normalize(0.0)?;
            let [p, q] = supports(&outwards)?;
            let gap_m = outwards.dot(&(q - p));
            if best.as_ref().is_none_or(|(known, _)| gap_m > *known) {
                best = Some((gap_m, Self { outwards, offset_m: outwards.dot(&(p + q)) / 2.0 }));
            }
            Some(q - p)
        };
        if let Some(before) = before {
            try_across(&before);
        }
        let mut nearest = i.first().zip(j.first()).map_or(Vector3::x(), |(i, j)| j - i);
        for _ in 0..STEPS {
            let Some(against) = try_across(&nearest) else { break };
            let step = nearest - against;
            let along = nearest.dot(&step);
            if along <= NEAR * nearest.norm_squared() {
                break;
            }
            nearest -= step * (along / step.norm_squared()).min(1.0);
        }
        let (gap_m, middle) = best.unwrap_or((0.0, Self { outwards: Vector3::x(), offset_m: 0.0 }));
        let half_m = apart_m.min(gap_m) / 2.0;
        PerVehicle {
            i: Self { offset_m: middle.offset_m - half_m, ..middle },
            j: Self { outwards: -middle.outwards, offset_m: -middle.offset_m - half_m },
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
    use proptest::prelude::*;

    use super::*;

    /// Of vehicles that rest.
    fn between(places_enu_m: &PerVehicle<Enu>, apart_m: f64) -> PerVehicle<Side> {
        Side::between(&places_enu_m.map(|place| vec![place]), None, apart_m)
    }

    #[test]
    fn spec_whoever_stays_on_its_side_is_far_enough_from_the_other() {
        let places = PerVehicle { i: Enu::new(0.0, 0.0, 50.0), j: Enu::new(30.0, 40.0, 50.0) };
        let sides = between(&places, 7.0);
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
        let sides = between(&places, 7.0);
        assert!(sides.i.outside_m(&places.i).abs() < 1e-9 && sides.j.outside_m(&places.j).abs() < 1e-9);
        assert!(sides.i.outside_m(&Enu::new(0.0, 0.0, 50.5)) > 0.4);
        let same = between(&PerVehicle { i: places.i, j: places.i }, 7.0);
        assert!(same.i.outside_m(&places.i).abs() < 1e-9 && same.j.outwards == -same.i.outwards);
    }

    #[test]
    fn val_the_shortest_line_between_two_ways() {
        // An edge beside a face: 3 m apart along y, wherever their corners are.
        let i = vec![Enu::new(-40.0, 0.0, 50.0), Enu::new(60.0, 0.0, 50.0), Enu::new(0.0, -9.0, 20.0)];
        let face = [[-30.0, 3.0, 30.0], [80.0, 3.0, 35.0], [10.0, 3.0, 90.0], [5.0, 20.0, 60.0]];
        let reach = PerVehicle { i, j: face.map(Enu::from).to_vec() };
        let sides = Side::between(&reach, None, 2.0);
        assert!((sides.i.outwards - Vector3::y()).norm() < 1e-2, "{}", sides.i.outwards);
        assert!((sides.i.offset_m - 0.5).abs() < 0.2 && (sides.j.offset_m + 2.5).abs() < 0.2);
    }

    proptest! {
        #[test]
        fn prop_all_that_either_may_fly_is_on_its_side_and_planes_never_come_nearer(
            points in prop::collection::vec([-60.0..60.0f64, -60.0..60.0, 0.0..40.0], 4..24),
            away in [-1.0..1.0f64, -1.0..1.0, -0.5..0.5], apart_m in 1.0..9.0f64,
        ) {
            let away = Vector3::from(away);
            prop_assume!(away.norm() > 0.1);
            let away = away.normalize();
            let half = points.len() / 2;
            let all: Vec<Enu> = points.iter().map(|p| Enu::from(*p)).collect();
            let [i, j] = [&all[..half], &all[half..]];
            let reach_of = |points: &[Enu], sign: f64| points.iter().map(|p| sign * away.dot(p)).fold(f64::MIN, f64::max);
            // J's moved away until there is just what is asked for between them.
            let by = away * (reach_of(i, 1.0) + reach_of(j, -1.0) + apart_m + 1e-9);
            let reach = PerVehicle { i: i.to_vec(), j: j.iter().map(|p| p + by).collect::<Vec<_>>() };
            for before in [None, Some(away)] {
                let sides = Side::between(&reach, before, apart_m);
                let gap_m = -sides.j.offset_m - sides.i.offset_m;
                prop_assert!(gap_m <= apart_m + 1e-9 && sides.j.outwards == -sides.i.outwards);
                if before.is_some() {
                    prop_assert!(gap_m >= apart_m - 1e-9, "{} {}", gap_m, apart_m);
                }
                // A line that is found by itself may be one that none lies across: then nobody flies on.
                if gap_m < 0.0 {
                    continue;
                }
                for role in crate::role::Role::BOTH {
                    prop_assert!(reach[role].iter().all(|p| sides[role].outside_m(p) <= 1e-9));
                }
            }
        }
    }
}
