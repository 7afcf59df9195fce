//! The geofence: a simple polygon, maybe concave, in either orientation, in the mission frame's horizontal plane.
//!
//! Shortest paths run over the visibility graph of the reflex vertices (a shortest path in a simple polygon turns
//! nowhere else; Lozano-Perez and Wesley, 1979). The vertices are first pulled into the fence along their
//! bisectors, so that a vehicle does not graze the corner; where that closes a gap, by less, at last not at all.
//! Ties go to the path found first in vertex order: the same fence and ends give the same path, bit for bit.

use std::sync::OnceLock;

use nalgebra::Vector2;

use crate::geo::polygon::{Polygon, PolygonError};

/// A point this far outside, in metres, still counts as inside: the boundary belongs to the fence.
pub const BOUNDARY_TOLERANCE_M: f64 = 1e-9;
/// How far corners are kept away from, in metres, in the order tried.
pub(super) const CORNER_MARGINS_M: [f64; 3] = [0.5, 0.05, 0.0];

/// How far beside a polygon's boundary a point counts as on it, in metres.
pub(super) fn tolerance_m(polygon: &Polygon) -> f64 {
    // Beyond some 300 km rounding alone moves a point by more than the nominal tolerance.
    BOUNDARY_TOLERANCE_M.max(16.0 * f64::EPSILON * polygon.reach_m())
}

/// A geofence with what its shortest paths need.
#[derive(Debug, Clone)]
pub struct Geofence {
    polygon: Polygon,
    tolerance_m: f64,
    /// One for each of `CORNER_MARGINS_M`, made when a path first needs it.
    graphs: [OnceLock<Graph>; CORNER_MARGINS_M.len()],
}

/// Corners and which of them see each other.
#[derive(Debug, Clone)]
struct Graph {
    corners: Vec<Vector2<f64>>,
    /// Row-major, symmetric.
    visible: Vec<bool>,
}

impl Geofence {
    /// A fence around `area_enu_m`, not closed (the last vertex joins the first). That it does not cross itself is
    /// the caller's promise (`config` checks it).
    ///
    /// # Errors
    /// [`PolygonError`] if the polygon has no interior or a vertex is not finite.
    pub fn new(area_enu_m: &[Vector2<f64>]) -> Result<Self, PolygonError> {
        let polygon = Polygon::new(area_enu_m)?;
        let tolerance_m = tolerance_m(&polygon);
        Ok(Self { polygon, tolerance_m, graphs: Default::default() })
    }

    /// Whether `point` is inside or on the boundary, to [`BOUNDARY_TOLERANCE_M`].
    #[must_use]
    pub fn contains(&self, point: Vector2<f64>) -> bool {
        self.polygon.contains(point, self.tolerance_m)
    }

    /// Whether all of the segment from `a` to `b` is inside or on the boundary.
    #[must_use]
    pub fn contains_segment(&self, a: Vector2<f64>, b: Vector2<f64>) -> bool {
        if !self.contains(a) || !self.contains(b) {
            return false;
        }
        if (b - a).norm_squared() <= self.tolerance_m * self.tolerance_m {
            return true;
        }
        self.polygon.middles_of_pieces(a, b, 2.0 * self.tolerance_m).all(|middle| self.contains(middle))
    }

    /// The point of the fence nearest to `point` (itself if inside).
    #[must_use]
    pub fn project(&self, point: Vector2<f64>) -> Vector2<f64> {
        if self.contains(point) { point } else { self.polygon.nearest_on_boundary(point) }
    }

    /// The shortest path inside the fence, both ends included; `None` if an end is outside.
    #[must_use]
    pub fn shortest_path(&self, from: Vector2<f64>, to: Vector2<f64>) -> Option<Vec<Vector2<f64>>> {
        if !self.contains(from) || !self.contains(to) {
            return None;
        }
        if self.contains_segment(from, to) {
            return Some(vec![from, to]);
        }
        CORNER_MARGINS_M.iter().zip(&self.graphs).find_map(|(&margin_m, graph)| {
            self.path_over(graph.get_or_init(|| self.graph(margin_m)), from, to)
        })
    }

    /// The corners at which paths may turn, with margin `k` of [`CORNER_MARGINS_M`].
    pub(super) fn turns(&self, k: usize) -> &[Vector2<f64>] {
        &self.graphs[k].get_or_init(|| self.graph(CORNER_MARGINS_M[k])).corners
    }

    /// The fence's corners at which paths may turn, pulled in by `margin_m` or as far as there is room.
    fn graph(&self, margin_m: f64) -> Graph {
        let vertices = self.polygon.corners();
        let n = vertices.len();
        let mut corners = Vec::new();
        for k in 0..n {
            let (previous, v, next) = (vertices[(k + n - 1) % n], vertices[k], vertices[(k + 1) % n]);
            if (v - previous).perp(&(next - v)) < 0.0 {
                corners.push(self.pulled_in(previous, v, next, margin_m));
            }
        }
        let m = corners.len();
        let mut visible = vec![false; m * m];
        for i in 0..m {
            for j in i + 1..m {
                let sees = self.contains_segment(corners[i], corners[j]);
                visible[i * m + j] = sees;
                visible[j * m + i] = sees;
            }
        }
        Graph { corners, visible }
    }

    /// The reflex vertex `v` moved along its inward bisector.
    fn pulled_in(
        &self,
        previous: Vector2<f64>,
        v: Vector2<f64>,
        next: Vector2<f64>,
        margin_m: f64,
    ) -> Vector2<f64> {
        let (back, ahead) = ((previous - v).normalize(), (next - v).normalize());
        // The left normal stands in where the corner is almost straight and the bisector ill-defined.
        let normal = Vector2::new(-ahead.y, ahead.x);
        let inward = (-(back + ahead)).try_normalize(1e-6).unwrap_or(normal);
        let mut step_m = margin_m;
        for _ in 0..4 {
            let candidate = v + inward * step_m;
            if self.contains_segment(v, candidate) {
                return candidate;
            }
            step_m *= 0.5;
        }
        v
    }

    /// Dijkstra over `graph` and the two ends.
    fn path_over(&self, graph: &Graph, from: Vector2<f64>, to: Vector2<f64>) -> Option<Vec<Vector2<f64>>> {
        let m = graph.corners.len();
        let (source, target) = (m, m + 1);
        let point = |k: usize| {
            if k == source {
                from
            } else if k == target {
                to
            } else {
                graph.corners[k]
            }
        };
        let end_sees: Vec<[bool; 2]> = graph
            .corners
            .iter()
            .map(|&c| [self.contains_segment(from, c), self.contains_segment(c, to)])
            .collect();
        let sees = |a: usize, b: usize| match (a, b) {
            (a, b) if a < m && b < m => graph.visible[a * m + b],
            (a, b) if a == source && b < m => end_sees[b][0],
            (a, b) if a < m && b == target => end_sees[a][1],
            _ => false,
        };
        let mut distance = vec![f64::INFINITY; m + 2];
        let mut before = vec![source; m + 2];
        let mut done = vec![false; m + 2];
        distance[source] = 0.0;
        loop {
            let open = (0..m + 2).filter(|&k| !done[k] && distance[k].is_finite());
            let nearest = open.min_by(|&a, &b| distance[a].total_cmp(&distance[b]))?;
            if nearest == target {
                break;
            }
            done[nearest] = true;
            for k in (0..m + 2).filter(|&k| sees(nearest, k)) {
                let through = distance[nearest] + (point(k) - point(nearest)).norm();
                if through < distance[k] {
                    distance[k] = through;
                    before[k] = nearest;
                }
            }
        }
        let mut path = vec![to];
        let mut k = target;
        while k != source {
            k = before[k];
            path.push(point(k));
        }
        path.reverse();
        Some(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schedule::testing::{self, star, v2};

    /// A U open to the north: the way from one arm to the other leads round the notch.
    fn u_shape() -> Vec<Vector2<f64>> {
        testing::polygon(&[
            [0., 0.],
            [30., 0.],
            [30., 30.],
            [20., 30.],
            [20., 10.],
            [10., 10.],
            [10., 30.],
            [0., 30.],
        ])
    }

    #[test]
    fn val_points_of_a_concave_fence_in_both_orientations() {
        for reverse in [false, true] {
            let mut area = u_shape();
            if reverse {
                area.reverse();
            }
            let fence = Geofence::new(&area).unwrap();
            for inside in
                [[5., 20.], [15., 5.], [25., 29.], [0., 0.], [10., 20.], [15., 10.], [30., 30.], [-9e-10, 5.]]
            {
                assert!(fence.contains(v2(inside)), "{inside:?}");
            }
            for outside in [[15., 20.], [15., 10.0001], [-1e-8, 5.], [31., 31.], [15., 30.]] {
                assert!(!fence.contains(v2(outside)), "{outside:?}");
            }
        }
    }

    #[test]
    fn val_segments_of_a_concave_fence() {
        let fence = Geofence::new(&u_shape()).unwrap();
        for (a, b) in
            [([5., 5.], [25., 5.]), ([10., 10.], [20., 10.]), ([10., 30.], [10., 0.]), ([5., 5.], [5., 5.])]
        {
            assert!(fence.contains_segment(v2(a), v2(b)), "{a:?} {b:?}");
        }
        for (a, b) in [
            ([5., 20.], [25., 20.]),
            ([10., 30.], [20., 30.]),
            ([5., 12.], [25., 9.]),
            ([5., 5.], [15., 15.]),
        ] {
            assert!(!fence.contains_segment(v2(a), v2(b)), "{a:?} {b:?}");
        }
    }

    #[test]
    fn val_shortest_path_round_the_notch() {
        let fence = Geofence::new(&u_shape()).unwrap();
        let path = fence.shortest_path(v2([5., 25.]), v2([25., 25.])).unwrap();
        assert_eq!(path.len(), 4);
        // Round the two corners exactly, the bisectors' margin of 0.5 m apart.
        let tight = 2.0 * 5f64.hypot(15.0) + 10.0;
        let length: f64 = path.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        assert!(length > tight && length < tight + 4.0 * 0.5, "{length} {tight}");
        assert!(path[1..3].iter().all(|c| (c - fence.polygon.nearest_on_boundary(*c)).norm() > 0.3));
        assert_eq!(fence.shortest_path(v2([5., 25.]), v2([15., 25.])), None);
        assert_eq!(fence.project(v2([13., 25.])), v2([10., 25.]));
    }

    #[test]
    fn spec_a_gap_narrower_than_the_margin_is_still_passed() {
        // Two rooms joined by a gap of 0.02 m.
        let area = [
            [0., 0.],
            [10., 0.],
            [10., 4.99],
            [20., 0.],
            [30., 0.],
            [30., 10.],
            [20., 10.],
            [10., 5.01],
            [10., 10.],
            [0., 10.],
        ];
        let fence = Geofence::new(&testing::polygon(&area)).unwrap();
        let path = fence.shortest_path(v2([1., 9.]), v2([29., 1.])).unwrap();
        assert!(path.windows(2).all(|w| fence.contains_segment(w[0], w[1])));
    }

    #[test]
    fn prop_paths_stay_inside_random_concave_fences() {
        let mut rng = testing::rng(1);
        let mut bent = 0;
        for _ in 0..300 {
            let area = star(&mut rng, 100.0);
            let fence = Geofence::new(&area).unwrap();
            let (a, b) = (testing::inside(&mut rng, &fence, 100.0), testing::inside(&mut rng, &fence, 100.0));
            let path = fence.shortest_path(a, b).expect("a simple polygon is connected");
            assert_eq!((path[0], path[path.len() - 1]), (a, b));
            bent += usize::from(path.len() > 2);
            for w in path.windows(2) {
                for k in 0..=1000 {
                    let p = w[0] + (w[1] - w[0]) * (f64::from(k) / 1000.0);
                    assert!(fence.polygon.contains(p, 1e-8));
                }
            }
            let back = fence.shortest_path(b, a).unwrap();
            let length = |p: &[Vector2<f64>]| p.windows(2).map(|w| (w[1] - w[0]).norm()).sum::<f64>();
            assert!((length(&path) - length(&back)).abs() < 1e-9 * length(&path).max(1.0));
        }
        assert!(bent > 30, "{bent} of 300 paths had a corner: the instances are too easy");
    }
}
