//! An area with a margin around it: what an autopilot is given as its fence, so that ordinary flight along the area's edge does
//! not touch it.

use std::collections::BTreeSet;

use nalgebra::Vector2;

use super::separation::segment_distance_m;
use crate::geo::polygon::{NotSimple, Polygon, PolygonError, check_simple};

/// How often the margin at a corner is halved before there is none.
const HALVINGS: u8 = 3;
/// Corners are acute whose sides' directions have a dot product below this: somewhat less than a right angle's 0, so that a
/// right angle that is rounded stays one corner.
const ACUTE: f64 = -0.1;

/// An area pushed outward.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outset {
    /// Corners counter-clockwise, not closed; they enclose the area.
    pub corners: Vec<Vector2<f64>>,
    /// How many of the area's corners have less than the margin: at sharp notches of the area, and at those narrower than two
    /// margins, where the sides pushed outward would cross each other.
    pub tight: usize,
}

/// `area` with every side pushed outward by `margin_m`. Acute corners get two corners, so that none reaches far out: at most
/// twice as many as the area has. That the area does not cross itself is the caller's promise (`config` checks it).
///
/// # Errors
/// [`PolygonError`] if the area has no interior or a corner is not finite.
pub fn outset(area: &[Vector2<f64>], margin_m: f64) -> Result<Outset, PolygonError> {
    let polygon = Polygon::new(area)?;
    let corners = polygon.corners();
    let mut halved = vec![0; corners.len()];
    loop {
        let (points, cut) = pushed(corners, &halved, margin_m);
        let looser = crossing(&points).into_iter().flatten().filter(|corner| halved[*corner] <= HALVINGS);
        let looser: Vec<usize> = looser.collect();
        if looser.is_empty() {
            let tight = halved.iter().filter(|times| **times > 0).count() + cut;
            return Ok(Outset { corners: points.into_iter().map(|(_, point)| point).collect(), tight });
        }
        looser.into_iter().for_each(|corner| halved[corner] += 1);
    }
}

/// `area` with every side pushed inward by `margin_m`, or by a half or a quarter of it where that leaves nothing or crosses
/// itself; `None` where even that does: what an autopilot is given of a no-fly area, so that flight along its side does not
/// touch it.
#[must_use]
pub fn inset(area: &[Vector2<f64>], margin_m: f64) -> Option<Vec<Vector2<f64>>> {
    let polygon = Polygon::new(area).ok()?;
    [1.0, 0.5, 0.25].into_iter().find_map(|part| pulled(&polygon, part * margin_m))
}

/// The sides pushed inward by `margin_m`, if the result is a polygon that lies so deep inside everywhere.
fn pulled(polygon: &Polygon, margin_m: f64) -> Option<Vec<Vector2<f64>>> {
    let corners = polygon.corners();
    let n = corners.len();
    let inner: Vec<Vector2<f64>> = (0..n)
        .map(|k| {
            let here = corners[k];
            let before = (here - corners[(k + n - 1) % n]).normalize();
            let after = (corners[(k + 1) % n] - here).normalize();
            // Counter-clockwise: inside is on the left. Where the two sides pushed inward meet.
            let [in_before, in_after] = [before, after].map(|along| Vector2::new(-along.y, along.x));
            here + (in_before + in_after) * (margin_m / (1.0 + before.dot(&after)).max(1e-3))
        })
        .collect();
    check_simple(&inner).ok()?;
    let made = Polygon::new(&inner).ok()?;
    let least_m = margin_m * (1.0 - 1e-6);
    let deep =
        |p: Vector2<f64>| polygon.encloses(p) && (p - polygon.nearest_on_boundary(p)).norm() >= least_m;
    let clear = |[p, q]: [Vector2<f64>; 2]| {
        polygon.edges().all(|[a, b]| {
            segment_distance_m([p.push(0.0), q.push(0.0)], [a.push(0.0), b.push(0.0)]) >= least_m
        })
    };
    // Turned inside out, its corners would go round the other way.
    let kept = made.corners() == inner.as_slice();
    (kept && inner.iter().copied().all(deep) && made.edges().all(clear)).then_some(inner)
}

/// A point pushed outward, and the number of the area's corner that it belongs to.
type Pushed = (usize, Vector2<f64>);

/// The corners at the ends of two sides that cross each other, if any do.
fn crossing(points: &[Pushed]) -> Option<BTreeSet<usize>> {
    let corners: Vec<Vector2<f64>> = points.iter().map(|(_, point)| *point).collect();
    match check_simple(&corners) {
        Err(NotSimple::Crossing { first, second }) => {
            let ends = [first, second].into_iter().flat_map(|side| [side, (side + 1) % points.len()]);
            Some(ends.map(|end| points[end].0).collect())
        }
        _ => None,
    }
}

/// The corners pushed outward, and at how many of them a notch is too sharp for the whole margin.
fn pushed(corners: &[Vector2<f64>], halved: &[u8], margin_m: f64) -> (Vec<Pushed>, usize) {
    let n = corners.len();
    let mut points: Vec<Pushed> = Vec::with_capacity(2 * n);
    let mut cut = 0;
    for k in 0..n {
        let here = corners[k];
        let margin_m = if halved[k] > HALVINGS { 0.0 } else { margin_m * 0.5f64.powi(halved[k].into()) };
        let before = (here - corners[(k + n - 1) % n]).normalize();
        let after = (corners[(k + 1) % n] - here).normalize();
        // Counter-clockwise: outside is on the right.
        let [out_before, out_after] = [before, after].map(|along| Vector2::new(along.y, -along.x));
        let (straight, turns_left) = (before.dot(&after), before.perp(&after) > 0.0);
        let out = if straight >= ACUTE {
            // Where the two sides pushed outward meet.
            vec![(out_before + out_after) / (1.0 + straight)]
        } else if turns_left {
            vec![out_before + before, out_after - after]
        } else {
            // The two sides would meet far out, and beyond the other sides of the notch.
            cut += usize::from(halved[k] == 0);
            vec![out_before + out_after]
        };
        points.extend(out.into_iter().map(|out| (k, here + out * margin_m)));
    }
    points.dedup_by(|a, b| a.1 == b.1);
    (points, cut)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schedule::testing::{polygon, rng, star, v2};

    /// The least distance of the fence from the area, walking along the fence, and whether the area is within it.
    fn clearance_m(area: &Polygon, fence: &Polygon) -> f64 {
        let walk = fence.edges().flat_map(|[p, q]| (0..50).map(move |k| p + (q - p) * (f64::from(k) / 50.0)));
        let signed = walk.map(|point| {
            let distance_m = (point - area.nearest_on_boundary(point)).norm();
            if area.encloses(point) { -distance_m } else { distance_m }
        });
        signed.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn val_a_square_and_an_l_grow_by_the_margin_in_either_orientation() {
        for reverse in [false, true] {
            let mut square = polygon(&[[0., 0.], [10., 0.], [10., 10.], [0., 10.]]);
            let mut l_shape = polygon(&[[0., 0.], [40., 0.], [40., 20.], [20., 20.], [20., 40.], [0., 40.]]);
            if reverse {
                square.reverse();
                l_shape.reverse();
            }
            let grown = outset(&square, 5.0).unwrap();
            assert_eq!(grown.tight, 0);
            assert_eq!(Polygon::new(&grown.corners).unwrap().area_m2(), 400.0);
            let grown = Polygon::new(&outset(&l_shape, 5.0).unwrap().corners).unwrap();
            // 1200 m^2, 160 m of sides, five corners outward and one inward.
            assert!((grown.area_m2() - (1200.0 + 160.0 * 5.0 + 4.0 * 25.0)).abs() < 1e-9);
            assert!(grown.encloses(v2([24., 24.])) && !grown.encloses(v2([26., 26.])));
        }
    }

    #[test]
    fn spec_a_needle_does_not_reach_far_and_a_narrow_notch_has_less_margin_and_is_counted() {
        let needle = polygon(&[[0., 0.], [100., 1.], [0., 2.]]);
        let grown = outset(&needle, 5.0).unwrap();
        assert_eq!((grown.corners.len(), grown.tight), (4, 0), "one corner of it is acute");
        assert!(grown.corners.iter().all(|c| c.x < 106.0), "{:?}", grown.corners);
        let fence = Polygon::new(&grown.corners).unwrap();
        assert!(clearance_m(&Polygon::new(&needle).unwrap(), &fence) > 4.9);

        // Two rooms that a notch 2 m wide divides, open to the north.
        let notched = polygon(&[
            [0., 0.],
            [42., 0.],
            [42., 30.],
            [22., 30.],
            [22., 10.],
            [20., 10.],
            [20., 30.],
            [0., 30.],
        ]);
        let grown = outset(&notched, 5.0).unwrap();
        assert!(grown.tight > 0);
        assert_eq!(check_simple(&grown.corners), Ok(()));
        let (area, fence) = (Polygon::new(&notched).unwrap(), Polygon::new(&grown.corners).unwrap());
        assert!(notched.iter().all(|corner| fence.contains(*corner, 1e-9)));
        assert!(clearance_m(&area, &fence) > -1e-9);
        // Away from the notch the margin is whole.
        assert!(fence.encloses(v2([-4.9, 15.])) && fence.encloses(v2([20., -4.9])));
    }

    #[test]
    fn val_a_square_shrinks_by_the_margin_a_strip_by_less_and_a_thread_has_no_inside_left() {
        for reverse in [false, true] {
            let mut square = polygon(&[[0., 0.], [40., 0.], [40., 40.], [0., 40.]]);
            if reverse {
                square.reverse();
            }
            let inner = inset(&square, 5.0).unwrap();
            assert!((Polygon::new(&inner).unwrap().area_m2() - 900.0).abs() < 1e-9, "{inner:?}");
        }
        let strip = inset(&polygon(&[[0., 0.], [40., 0.], [40., 8.], [0., 8.]]), 5.0).unwrap();
        assert!((Polygon::new(&strip).unwrap().area_m2() - 35.0 * 3.0).abs() < 1e-9, "{strip:?}");
        assert_eq!(inset(&polygon(&[[0., 0.], [40., 0.], [40., 2.], [0., 2.]]), 5.0), None);
    }

    #[test]
    fn prop_what_an_autopilot_is_given_of_a_random_area_lies_inside_it() {
        let mut rng = rng(6);
        let mut made = 0;
        for _ in 0..300 {
            let corners = star(&mut rng, 100.0);
            let Some(inner) = inset(&corners, 5.0) else { continue };
            made += 1;
            let (area, inner) = (Polygon::new(&corners).unwrap(), Polygon::new(&inner).unwrap());
            // Walking along the inner one, outside is positive.
            assert!(clearance_m(&area, &inner) < -1.24, "{corners:?}");
            for [p, q] in inner.edges() {
                for k in 0..50 {
                    assert!(area.encloses(p + (q - p) * (f64::from(k) / 50.0)), "{corners:?}");
                }
            }
        }
        assert!(made > 30, "{made}");
    }

    #[test]
    fn prop_random_concave_areas_lie_inside_their_fence_which_crosses_itself_nowhere() {
        let mut rng = rng(5);
        let mut whole = 0;
        for _ in 0..300 {
            let corners = star(&mut rng, 100.0);
            let grown = outset(&corners, 5.0).unwrap();
            assert!(!matches!(check_simple(&grown.corners), Err(NotSimple::Crossing { .. })), "{corners:?}");
            assert!(grown.corners.len() <= 2 * corners.len());
            let (area, fence) = (Polygon::new(&corners).unwrap(), Polygon::new(&grown.corners).unwrap());
            assert!(corners.iter().all(|corner| fence.contains(*corner, 1e-9)), "{corners:?}");
            assert!(clearance_m(&area, &fence) > -1e-6, "{corners:?} {grown:?}");
            if grown.tight == 0 {
                whole += 1;
                assert!(clearance_m(&area, &fence) > 4.9, "{corners:?} {grown:?}");
            }
        }
        assert!(whole > 30, "{whole}");
    }
}
