//! Polygons of an operational area: whether one is usable, and how large.

use nalgebra::Vector2;

/// Areas below this many square metres hold no vehicle.
const LEAST_AREA_M2: f64 = 1.0;

/// Why a polygon encloses no area: a clause that continues its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum PolygonError {
    #[error("repeats its first corner as corner {}: the last corner joins the first by itself", .corner + 1)]
    Closed { corner: usize },
    #[error("has corners {} and {} at the same point", .corner, .corner + 1)]
    Repeated { corner: usize },
    #[error("crosses itself: the edge from corner {} meets the edge from corner {}", .first + 1, .second + 1)]
    Crossing { first: usize, second: usize },
    #[error("encloses less than 1 m^2")]
    Empty,
}

/// Checks that the polygon is simple and encloses an area. Corners are counted from 0 here, from 1 in messages.
pub(super) fn check(corners: &[Vector2<f64>]) -> Result<(), PolygonError> {
    let n = corners.len();
    for corner in 1..n {
        if corners[corner] == corners[corner - 1] {
            return Err(PolygonError::Repeated { corner });
        }
    }
    if n > 1 && corners[0] == corners[n - 1] {
        return Err(PolygonError::Closed { corner: n - 1 });
    }
    // A polygon squashed onto a line also meets itself; that it is empty says more.
    if area_m2(corners) < LEAST_AREA_M2 && !any_crossing(corners, proper_crossing) {
        return Err(PolygonError::Empty);
    }
    for first in 0..n {
        for second in first + 1..n {
            if edges_meet(corners, first, second) {
                return Err(PolygonError::Crossing { first, second });
            }
        }
    }
    Ok(())
}

/// The area enclosed by a simple polygon (shoelace formula).
pub(super) fn area_m2(corners: &[Vector2<f64>]) -> f64 {
    let n = corners.len();
    (0..n).map(|i| corners[i].perp(&corners[(i + 1) % n])).sum::<f64>().abs() / 2.0
}

/// The largest distance between two points of the polygon: between two corners.
pub(super) fn diameter_m(corners: &[Vector2<f64>]) -> f64 {
    corners.iter().flat_map(|a| corners.iter().map(move |b| (a - b).norm())).fold(0.0, f64::max)
}

/// Whether a point is inside (even-odd rule; the border may go either way).
pub(super) fn contains(corners: &[Vector2<f64>], point: Vector2<f64>) -> bool {
    let n = corners.len();
    let crossings = (0..n).filter(|&i| {
        let (a, b) = (corners[i], corners[(i + 1) % n]);
        (a.y > point.y) != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossings.count() % 2 == 1
}

type Segment = [Vector2<f64>; 2];

fn edge(corners: &[Vector2<f64>], i: usize) -> Segment {
    [corners[i], corners[(i + 1) % corners.len()]]
}

fn any_crossing(corners: &[Vector2<f64>], meet: impl Fn(Segment, Segment) -> bool) -> bool {
    let n = corners.len();
    (0..n).any(|i| (i + 1..n).any(|j| meet(edge(corners, i), edge(corners, j))))
}

/// Whether two edges share a point beyond the corner that neighbours share.
fn edges_meet(corners: &[Vector2<f64>], first: usize, second: usize) -> bool {
    let n = corners.len();
    let (a, b) = (edge(corners, first), edge(corners, second));
    if second == first + 1 {
        return folds_back(a[0], a[1], b[1]);
    }
    if first == 0 && second == n - 1 {
        return folds_back(b[0], b[1], a[1]);
    }
    proper_crossing(a, b) || touches(a, b[0]) || touches(a, b[1]) || touches(b, a[0]) || touches(b, a[1])
}

/// Whether the path a, b, c returns along itself at b.
fn folds_back(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> bool {
    turn(a, b, c) == 0.0 && (a - b).dot(&(c - b)) > 0.0
}

/// Twice the signed area of a triangle.
fn turn(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}

fn proper_crossing([a, b]: Segment, [c, d]: Segment) -> bool {
    turn(a, b, c) * turn(a, b, d) < 0.0 && turn(c, d, a) * turn(c, d, b) < 0.0
}

fn touches([a, b]: Segment, point: Vector2<f64>) -> bool {
    turn(a, b, point) == 0.0 && (a - point).dot(&(b - point)) <= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners(points: &[[f64; 2]]) -> Vec<Vector2<f64>> {
        points.iter().copied().map(Vector2::from).collect()
    }

    #[test]
    fn val_simple_polygons_pass_in_either_orientation() {
        let mut l_shape = corners(&[[0., 0.], [4., 0.], [4., 2.], [2., 2.], [2., 4.], [0., 4.]]);
        assert_eq!(check(&l_shape), Ok(()));
        assert_eq!(area_m2(&l_shape), 12.0);
        assert_eq!(diameter_m(&l_shape), 32f64.sqrt());
        assert!(contains(&l_shape, Vector2::new(1.0, 3.0)) && !contains(&l_shape, Vector2::new(3.0, 3.0)));
        l_shape.reverse();
        assert_eq!(check(&l_shape), Ok(()));
        // A corner on a straight side is no fault.
        assert_eq!(check(&corners(&[[0., 0.], [2., 0.], [4., 0.], [4., 4.]])), Ok(()));
    }

    #[test]
    fn val_polygons_without_an_inside_are_named() {
        use PolygonError::{Closed, Crossing, Empty, Repeated};
        for (points, error) in [
            (&[[0., 0.], [9., 9.], [9., 0.], [0., 9.]][..], Crossing { first: 0, second: 2 }),
            (&[[0., 0.], [9., 0.], [9., 9.], [4., 0.], [0., 9.]], Crossing { first: 0, second: 2 }),
            (&[[0., 0.], [9., 0.], [4., 0.], [4., 9.]], Crossing { first: 0, second: 1 }),
            (&[[0., 0.], [9., 0.], [9., 9.], [0., 0.]], Closed { corner: 3 }),
            (&[[0., 0.], [0., 0.], [9., 9.], [0., 9.]], Repeated { corner: 1 }),
            (&[[0., 0.], [5., 5.], [9., 9.]], Empty),
            (&[[0., 0.], [0.1, 0.], [0.1, 0.1]], Empty),
        ] {
            assert_eq!(check(&corners(points)), Err(error), "{points:?}");
        }
    }
}
