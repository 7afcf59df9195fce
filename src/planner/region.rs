//! The geofence as a union of convex cells, each a list of half-planes: what a solver with linear constraints can use.

use nalgebra::Vector2;

use crate::geo::polygon::Polygon;

/// The half-plane `normal . p <= offset` with a unit normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfPlane {
    /// Outward unit normal.
    pub normal: Vector2<f64>,
    /// Offset in metres.
    pub offset_m: f64,
    /// Whether the edge is a cut between two cells rather than the geofence itself.
    pub cut: bool,
}

/// A simple polygon cut into convex cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    polygon: Polygon,
    cells: Vec<Vec<HalfPlane>>,
}

fn turn(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> f64 {
    (b - a).perp(&(c - b))
}

impl Region {
    /// The region of a simple polygon, either orientation. `None` without an interior.
    #[must_use]
    pub fn new(area: &[Vector2<f64>]) -> Option<Self> {
        let polygon = Polygon::new(area).ok()?;
        let corners = polygon.corners();
        let size_m = (2.0 * polygon.area_m2()).sqrt();
        let pieces = merge(corners, triangulate(corners)?, size_m);
        let cells = pieces.iter().map(|piece| half_planes(corners, piece)).collect();
        Some(Self { polygon, cells })
    }

    /// The convex cells.
    #[must_use]
    pub fn cells(&self) -> &[Vec<HalfPlane>] {
        &self.cells
    }

    /// The polygon itself.
    #[must_use]
    pub fn polygon(&self) -> &Polygon {
        &self.polygon
    }

    /// How far `p` is inside cell `cell`, in metres; negative outside.
    #[must_use]
    pub fn depth_m(&self, cell: usize, p: Vector2<f64>) -> f64 {
        self.cells[cell].iter().map(|h| h.offset_m - h.normal.dot(&p)).fold(f64::INFINITY, f64::min)
    }

    /// The cell in which `p` lies deepest.
    #[must_use]
    pub fn cell_of(&self, p: Vector2<f64>) -> usize {
        let mut best = 0;
        for cell in 1..self.cells.len() {
            if self.depth_m(cell, p) > self.depth_m(best, p) {
                best = cell;
            }
        }
        best
    }

    /// Whether `p` is inside or within `tolerance_m` of it.
    #[must_use]
    pub fn contains(&self, p: Vector2<f64>, tolerance_m: f64) -> bool {
        self.depth_m(self.cell_of(p), p) >= -tolerance_m
            || (p - self.polygon.nearest_on_boundary(p)).norm() <= tolerance_m
    }

    /// The point of the region that is nearest to `p`.
    #[must_use]
    pub fn nearest(&self, p: Vector2<f64>) -> Vector2<f64> {
        if self.depth_m(self.cell_of(p), p) >= 0.0 { p } else { self.polygon.nearest_on_boundary(p) }
    }
}

/// Ear clipping. `None` if no ear is found: the polygon crosses itself.
fn triangulate(polygon: &[Vector2<f64>]) -> Option<Vec<Vec<usize>>> {
    let mut rest: Vec<usize> = (0..polygon.len()).collect();
    let mut triangles = Vec::new();
    while rest.len() > 3 {
        let n = rest.len();
        let ear = (0..n).find(|&k| {
            let [a, b, c] = [rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]];
            let [pa, pb, pc] = [a, b, c].map(|v| polygon[v]);
            turn(pa, pb, pc) > 0.0
                && !rest
                    .iter()
                    .filter(|v| ![a, b, c].contains(v))
                    .map(|v| polygon[*v])
                    .any(|p| turn(pa, pb, p) >= 0.0 && turn(pb, pc, p) >= 0.0 && turn(pc, pa, p) >= 0.0)
        });
        // Vertices on a straight line make no ear, and are no corner either.
        let flat = || {
            (0..n).find(|&k| {
                turn(polygon[rest[(k + n - 1) % n]], polygon[rest[k]], polygon[rest[(k + 1) % n]]) == 0.0
            })
        };
        match ear {
            Some(k) => triangles.push(vec![rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]]),
            None => {
                rest.remove(flat()?);
                continue;
            }
        }
        rest.remove(ear?);
    }
    triangles.push(rest);
    Some(triangles)
}

/// Joins neighbouring pieces for as long as the result is convex (Hertel and Mehlhorn).
fn merge(polygon: &[Vector2<f64>], mut pieces: Vec<Vec<usize>>, size_m: f64) -> Vec<Vec<usize>> {
    let convex = |piece: &[usize]| {
        let n = piece.len();
        (0..n).all(|k| {
            turn(polygon[piece[k]], polygon[piece[(k + 1) % n]], polygon[piece[(k + 2) % n]])
                >= -1e-12 * size_m
        })
    };
    'again: loop {
        for a in 0..pieces.len() {
            for b in a + 1..pieces.len() {
                if let Some(joined) = join(&pieces[a], &pieces[b]).filter(|piece| convex(piece)) {
                    pieces[a] = joined;
                    pieces.remove(b);
                    continue 'again;
                }
            }
        }
        return pieces;
    }
}

/// Two pieces (vertices in order) joined along an edge they share.
fn join(a: &[usize], b: &[usize]) -> Option<Vec<usize>> {
    for (k, &from) in a.iter().enumerate() {
        let to = a[(k + 1) % a.len()];
        if let Some(m) = (0..b.len()).find(|&m| b[m] == to && b[(m + 1) % b.len()] == from) {
            let rest_of_a = (1..=a.len()).map(|step| a[(k + step) % a.len()]);
            let rest_of_b = (2..b.len()).map(|step| b[(m + step) % b.len()]);
            return Some(rest_of_a.chain(rest_of_b).collect());
        }
    }
    None
}

fn half_planes(polygon: &[Vector2<f64>], piece: &[usize]) -> Vec<HalfPlane> {
    let n = piece.len();
    (0..n)
        .filter_map(|k| {
            let (from, to) = (piece[k], piece[(k + 1) % n]);
            let edge = polygon[to] - polygon[from];
            let length = edge.norm();
            (length > 0.0).then(|| {
                let normal = Vector2::new(edge.y, -edge.x) / length;
                HalfPlane {
                    normal,
                    offset_m: normal.dot(&polygon[from]),
                    cut: (from + 1) % polygon.len() != to,
                }
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn polygon(points: &[[f64; 2]]) -> Vec<Vector2<f64>> {
        points.iter().map(|p| Vector2::new(p[0], p[1])).collect()
    }

    fn l_shape() -> Vec<Vector2<f64>> {
        polygon(&[
            [-500.0, -500.0],
            [500.0, -500.0],
            [500.0, 20.0],
            [20.0, 20.0],
            [20.0, 500.0],
            [-500.0, 500.0],
        ])
    }

    #[test]
    fn val_convex_polygons_are_one_cell() {
        let square = polygon(&[[0.0, 0.0], [0.0, 2.0], [2.0, 2.0], [2.0, 0.0]]);
        let region = Region::new(&square).unwrap();
        assert_eq!(region.cells().len(), 1);
        assert!(region.cells()[0].iter().all(|h| !h.cut));
        assert!((region.depth_m(0, Vector2::new(1.0, 0.5)) - 0.5).abs() < 1e-15);
        assert_eq!(region.nearest(Vector2::new(5.0, 1.0)), Vector2::new(2.0, 1.0));
        assert!((region.polygon().diameter_m() - 8f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn val_l_shape_is_cut() {
        let region = Region::new(&l_shape()).unwrap();
        assert!((2..=3).contains(&region.cells().len()));
        assert!(region.cells().iter().all(|c| c.iter().any(|h| h.cut)));
        assert!(region.contains(Vector2::new(-100.0, 400.0), 0.0));
        assert!(region.contains(Vector2::new(400.0, 0.0), 0.0));
        assert!(!region.contains(Vector2::new(400.0, 400.0), 1e-6));
        let near = region.nearest(Vector2::new(100.0, 30.0));
        assert!((near - Vector2::new(100.0, 20.0)).norm() < 1e-12);
    }

    #[test]
    fn spec_no_interior_no_region() {
        assert_eq!(Region::new(&polygon(&[[0.0, 0.0], [1.0, 1.0]])), None);
        assert_eq!(Region::new(&polygon(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])), None);
    }

    proptest! {
        /// Star-shaped polygons about the origin, as concave as can be: cells agree with the even-odd rule.
        #[test]
        fn prop_cells_cover_the_polygon(radii in prop::collection::vec(10.0..100.0, 5..12), x in -90.0..90.0, y in -90.0..90.0) {
            let n = radii.len() as f64;
            let star: Vec<_> = radii.iter().enumerate().map(|(k, r)| {
                let angle = std::f64::consts::TAU * k as f64 / n;
                Vector2::new(r * angle.cos(), r * angle.sin())
            }).collect();
            let region = Region::new(&star).unwrap();
            let p = Vector2::new(x, y);
            let distance = (p - region.polygon().nearest_on_boundary(p)).norm();
            if distance > 1e-6 {
                prop_assert_eq!(region.contains(p, 0.0), region.polygon().encloses(p));
            }
            prop_assert!(region.contains(region.nearest(p), 1e-9));
        }
    }
}
