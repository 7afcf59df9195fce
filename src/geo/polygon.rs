//! Simple polygons in the mission frame's horizontal plane: whether corners make one, what lies inside, what is nearest.
//! The planner's convex cells and the slot table's shortest paths are built on it.

use nalgebra::Vector2;

/// Coordinates beyond this, in metres, are no part of a tangent plane on Earth.
pub const MAX_COORDINATE_M: f64 = 1e7;
/// Areas below this many square metres hold no vehicle.
const LEAST_AREA_M2: f64 = 1.0;

/// Corners counter-clockwise, no two in a row at one place, the last joining the first. Encloses an area; that it does
/// not cross itself is the maker's promise (see [`check_simple`]): a crossing one is taken by the even-odd rule.
#[derive(Debug, Clone, PartialEq)]
pub struct Polygon {
    corners: Vec<Vector2<f64>>,
}

/// Why corners make no polygon.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PolygonError {
    /// Fewer than three different corners.
    #[error("the area has {vertices} different vertices; give at least 3")]
    TooFewVertices {
        /// How many there are.
        vertices: usize,
    },
    /// A coordinate is not a number, or beyond [`MAX_COORDINATE_M`].
    #[error("vertex {index} of the area is ({x_m}, {y_m}); give coordinates within {MAX_COORDINATE_M:e} m")]
    NotUsable {
        /// Position in the list, from 0.
        index: usize,
        /// East, metres.
        x_m: f64,
        /// North, metres.
        y_m: f64,
    },
    /// All corners lie on a line.
    #[error("the area is {area_m2} m^2; its vertices lie on a line")]
    NoArea {
        /// The polygon's area.
        area_m2: f64,
    },
}

/// Why corners, as an operator lists them, are not a simple polygon: a clause that continues its name. Corners are counted
/// from 0 here, from 1 in messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NotSimple {
    /// The last corner is the first again.
    #[error("repeats its first corner as corner {}: the last corner joins the first by itself", .corner + 1)]
    Closed {
        /// The last corner.
        corner: usize,
    },
    /// A corner twice in a row.
    #[error("has corners {} and {} at the same point", .corner, .corner + 1)]
    Repeated {
        /// The second of them.
        corner: usize,
    },
    /// Two edges meet elsewhere than at the corner they share.
    #[error("crosses itself: the edge from corner {} meets the edge from corner {}", .first + 1, .second + 1)]
    Crossing {
        /// The corner that the first edge starts from.
        first: usize,
        /// The corner that the second edge starts from.
        second: usize,
    },
    /// Too small to hold a vehicle.
    #[error("encloses less than 1 m^2")]
    Empty,
}

impl Polygon {
    /// The polygon with these corners, in either orientation, closed or not. Repeated corners are left out.
    ///
    /// # Errors
    /// [`PolygonError`] if it has no interior or a corner is not finite.
    pub fn new(corners: &[Vector2<f64>]) -> Result<Self, PolygonError> {
        let usable = |corner: &Vector2<f64>| corner.iter().all(|c| c.abs() <= MAX_COORDINATE_M);
        if let Some((index, corner)) = corners.iter().enumerate().find(|(_, corner)| !usable(corner)) {
            return Err(PolygonError::NotUsable { index, x_m: corner.x, y_m: corner.y });
        }
        let mut corners = corners.to_vec();
        corners.dedup();
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        if corners.len() < 3 {
            return Err(PolygonError::TooFewVertices { vertices: corners.len() });
        }
        let twice_area_m2 = twice_signed_area_m2(&corners);
        if twice_area_m2 == 0.0 {
            return Err(PolygonError::NoArea { area_m2: 0.0 });
        }
        if twice_area_m2 < 0.0 {
            corners.reverse();
        }
        Ok(Self { corners })
    }

    /// The corners, counter-clockwise.
    #[must_use]
    pub fn corners(&self) -> &[Vector2<f64>] {
        &self.corners
    }

    /// The edges, counter-clockwise: from each corner to the next.
    pub fn edges(&self) -> impl Iterator<Item = [Vector2<f64>; 2]> + '_ {
        edges(&self.corners)
    }

    /// The area enclosed.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        twice_signed_area_m2(&self.corners) / 2.0
    }

    /// Whether a point is inside, by the even-odd rule. On the boundary the answer may go either way.
    #[must_use]
    pub fn encloses(&self, point: Vector2<f64>) -> bool {
        self.edges().fold(false, |inside, [p, q]| {
            let straddles = (p.y > point.y) != (q.y > point.y);
            inside ^ (straddles && point.x < p.x + (q.x - p.x) * (point.y - p.y) / (q.y - p.y))
        })
    }

    /// Whether a point is inside or within `tolerance_m` of the boundary.
    #[must_use]
    pub fn contains(&self, point: Vector2<f64>, tolerance_m: f64) -> bool {
        self.encloses(point) || (point - self.nearest_on_boundary(point)).norm() <= tolerance_m
    }

    /// The point of the boundary that is nearest to `point`.
    #[must_use]
    pub fn nearest_on_boundary(&self, point: Vector2<f64>) -> Vector2<f64> {
        let mut best = (f64::INFINITY, point);
        for [p, q] in self.edges() {
            let edge = q - p;
            let along = ((point - p).dot(&edge) / edge.norm_squared()).clamp(0.0, 1.0);
            let candidate = p + edge * along;
            let distance2 = (point - candidate).norm_squared();
            if distance2 < best.0 {
                best = (distance2, candidate);
            }
        }
        best.1
    }

    /// The middles of the pieces into which the boundary cuts the segment from `a` to `b`. Each piece is wholly inside or wholly
    /// outside, so that one point of it tells; those no longer than `shortest_m` are passed over.
    pub fn middles_of_pieces(
        &self,
        a: Vector2<f64>,
        b: Vector2<f64>,
        shortest_m: f64,
    ) -> impl Iterator<Item = Vector2<f64>> {
        let d = b - a;
        let length2 = d.norm_squared();
        let mut cuts = vec![0.0, 1.0];
        for [p, q] in self.edges() {
            let e = q - p;
            let denominator = d.perp(&e);
            // A cut too many does no harm: parallel edges and near misses are cut as well.
            if denominator * denominator <= 1e-24 * length2 * e.norm_squared() {
                cuts.extend([(p - a).dot(&d) / length2, (q - a).dot(&d) / length2]);
            } else if (-1e-6..=1.0 + 1e-6).contains(&((p - a).perp(&d) / denominator)) {
                cuts.push((p - a).perp(&e) / denominator);
            }
        }
        cuts.retain(|t| (0.0..=1.0).contains(t));
        cuts.sort_by(f64::total_cmp);
        let shortest = shortest_m / length2.sqrt();
        let pieces: Vec<[f64; 2]> = cuts.windows(2).map(|w| [w[0], w[1]]).collect();
        pieces
            .into_iter()
            .filter(move |[from, to]| to - from > shortest)
            .map(move |[from, to]| a + d * (0.5 * (from + to)))
    }

    /// Largest distance of a point of the polygon from `point`: that of a corner.
    #[must_use]
    pub fn farthest_m(&self, point: Vector2<f64>) -> f64 {
        self.corners.iter().map(|corner| (corner - point).norm()).fold(0.0, f64::max)
    }

    /// Largest distance between two points of the polygon: between two corners.
    #[must_use]
    pub fn diameter_m(&self) -> f64 {
        self.corners.iter().map(|corner| self.farthest_m(*corner)).fold(0.0, f64::max)
    }

    /// Largest coordinate in size.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        self.corners.iter().map(|corner| corner.amax()).fold(0.0, f64::max)
    }
}

/// Checks that the corners make a simple polygon that encloses an area, as they are listed: none repeated, not closed.
///
/// # Errors
/// [`NotSimple`], the first that is found.
pub fn check_simple(corners: &[Vector2<f64>]) -> Result<(), NotSimple> {
    let n = corners.len();
    for corner in 1..n {
        if corners[corner] == corners[corner - 1] {
            return Err(NotSimple::Repeated { corner });
        }
    }
    if n > 1 && corners[0] == corners[n - 1] {
        return Err(NotSimple::Closed { corner: n - 1 });
    }
    let sides: Vec<Segment> = edges(corners).collect();
    let pairs = || (0..n).flat_map(|first| (first + 1..n).map(move |second| (first, second)));
    // A polygon squashed onto a line also meets itself; that it is empty says more.
    let small = twice_signed_area_m2(corners).abs() < 2.0 * LEAST_AREA_M2;
    if small && !pairs().any(|(first, second)| crosses(sides[first], sides[second])) {
        return Err(NotSimple::Empty);
    }
    match pairs().find(|&(first, second)| edges_meet(&sides, first, second)) {
        Some((first, second)) => Err(NotSimple::Crossing { first, second }),
        None => Ok(()),
    }
}

type Segment = [Vector2<f64>; 2];

fn edges(corners: &[Vector2<f64>]) -> impl Iterator<Item = Segment> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1)).map(|(p, q)| [p, q])
}

/// Twice the area (shoelace formula), positive if counter-clockwise. Taken about the first corner, so that coordinates far
/// from the origin lose no digits.
fn twice_signed_area_m2(corners: &[Vector2<f64>]) -> f64 {
    let Some(origin) = corners.first() else { return 0.0 };
    edges(corners).map(|[p, q]| (p - origin).perp(&(q - origin))).sum()
}

/// Whether two edges share a point beyond the corner that neighbours share.
fn edges_meet(sides: &[Segment], first: usize, second: usize) -> bool {
    let (a, b) = (sides[first], sides[second]);
    if second == first + 1 {
        return folds_back(a[0], a[1], b[1]);
    }
    if first == 0 && second == sides.len() - 1 {
        return folds_back(b[0], b[1], a[1]);
    }
    crosses(a, b) || touches(a, b[0]) || touches(a, b[1]) || touches(b, a[0]) || touches(b, a[1])
}

/// Whether the path a, b, c returns along itself at b.
fn folds_back(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> bool {
    turn(a, b, c) == 0.0 && (a - b).dot(&(c - b)) > 0.0
}

/// Twice the signed area of a triangle.
fn turn(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}

/// Whether two segments cross, each with an end on either side of the other.
fn crosses([a, b]: Segment, [c, d]: Segment) -> bool {
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
    fn val_an_l_has_its_area_its_diameter_and_its_inside_in_either_orientation() {
        let mut l_shape = corners(&[[0., 0.], [4., 0.], [4., 2.], [2., 2.], [2., 4.], [0., 4.]]);
        for _ in 0..2 {
            assert_eq!(check_simple(&l_shape), Ok(()));
            let polygon = Polygon::new(&l_shape).unwrap();
            assert_eq!((polygon.area_m2(), polygon.diameter_m()), (12.0, 32f64.sqrt()));
            assert!(polygon.encloses(Vector2::new(1.0, 3.0)) && !polygon.encloses(Vector2::new(3.0, 3.0)));
            assert_eq!(polygon.nearest_on_boundary(Vector2::new(3.0, 3.5)), Vector2::new(2.0, 3.5));
            assert!(
                polygon.contains(Vector2::new(3.0, 2.1), 0.11)
                    && !polygon.contains(Vector2::new(3.0, 2.1), 0.09)
            );
            assert_eq!(polygon.farthest_m(Vector2::new(-3.0, 0.0)), 7f64.hypot(2.0));
            l_shape.reverse();
        }
        // A corner on a straight side is no fault.
        assert_eq!(check_simple(&corners(&[[0., 0.], [2., 0.], [4., 0.], [4., 4.]])), Ok(()));
    }

    #[test]
    fn spec_repeated_and_closing_corners_are_left_out() {
        let closed = corners(&[[0., 0.], [9., 0.], [9., 0.], [9., 9.], [0., 0.]]);
        assert_eq!(Polygon::new(&closed), Polygon::new(&corners(&[[0., 0.], [9., 0.], [9., 9.]])));
    }

    #[test]
    fn spec_corners_that_enclose_nothing_are_no_polygon() {
        let polygon = |points: &[[f64; 2]]| Polygon::new(&corners(points)).map(|_| ());
        assert_eq!(
            polygon(&[[0., 0.], [1., 0.], [0., 0.]]),
            Err(PolygonError::TooFewVertices { vertices: 2 })
        );
        assert_eq!(polygon(&[[0., 0.], [1., 1.], [2., 2.]]), Err(PolygonError::NoArea { area_m2: 0.0 }));
        for wrong in [f64::NAN, 1.1e7] {
            let error = polygon(&[[0., 0.], [1., wrong], [2., 2.]]);
            assert!(matches!(error, Err(PolygonError::NotUsable { index: 1, .. })), "{error:?}");
        }
    }

    #[test]
    fn spec_polygons_without_an_inside_are_named() {
        use NotSimple::{Closed, Crossing, Empty, Repeated};
        for (points, error) in [
            (&[[0., 0.], [9., 9.], [9., 0.], [0., 9.]][..], Crossing { first: 0, second: 2 }),
            (&[[0., 0.], [9., 0.], [9., 9.], [4., 0.], [0., 9.]], Crossing { first: 0, second: 2 }),
            (&[[0., 0.], [9., 0.], [4., 0.], [4., 9.]], Crossing { first: 0, second: 1 }),
            (&[[0., 0.], [9., 0.], [9., 9.], [0., 0.]], Closed { corner: 3 }),
            (&[[0., 0.], [0., 0.], [9., 9.], [0., 9.]], Repeated { corner: 1 }),
            (&[[0., 0.], [5., 5.], [9., 9.]], Empty),
            (&[[0., 0.], [0.1, 0.], [0.1, 0.1]], Empty),
        ] {
            assert_eq!(check_simple(&corners(points)), Err(error), "{points:?}");
        }
    }
}
