//! The airspace as a union of convex cells, each a list of half-planes and a band of altitudes: what a solver with linear
//! constraints can use.
//!
//! A no-fly area is cut into convex pieces as the geofence is. Each side of a piece cuts the cells that the piece meets, so
//! that of every cell that is left either all or nothing is inside the piece; what of the band no piece over a cell takes is
//! free. So the cells cover all that is allowed but for slivers, and a search in one of them cannot enter an area.

use nalgebra::{Vector2, Vector3};

use super::problem::{Airspace, NoFly};
use crate::geo::polygon::Polygon;

/// How far a pose keeps out of a no-fly area, in metres: what rounding may take from a limit, so that no plan lies inside.
const KEEPS_OUT_M: f64 = 5e-7;
/// Cells narrower or lower than this, in metres, hold no pose.
const SLIVER_M: f64 = 1e-6;

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

/// A convex part of the airspace.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Its sides.
    pub sides: Vec<HalfPlane>,
    /// Its lowest and highest altitude in metres.
    pub altitude_m: [f64; 2],
    /// Its corners, counter-clockwise: side `k` begins at corner `k`.
    corners: Vec<Vector2<f64>>,
    /// Whether it reaches through the whole band, so that altitudes do not tell it from another one.
    whole: bool,
}

impl Cell {
    /// How far `p` is inside, in metres; negative outside.
    fn depth_m(&self, p: &Vector3<f64>) -> f64 {
        let across = self.sides.iter().map(|h| h.offset_m - h.normal.dot(&p.xy()));
        let depth = across.fold(f64::INFINITY, f64::min);
        let [low, high] = self.altitude_m;
        if self.whole { depth } else { depth.min(p.z - low).min(high - p.z) }
    }

    /// Its point nearest to `p`.
    fn nearest(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let [low, high] = self.altitude_m;
        let ground = p.xy();
        let inside = self.sides.iter().all(|h| h.normal.dot(&ground) <= h.offset_m);
        let ends = self.corners.iter().zip(self.corners.iter().cycle().skip(1));
        let along = |(a, b): (&Vector2<f64>, &Vector2<f64>)| {
            let edge = b - a;
            a + edge * ((ground - a).dot(&edge) / edge.norm_squared()).clamp(0.0, 1.0)
        };
        let nearer = |a: &Vector2<f64>, b: &Vector2<f64>| {
            (a - ground).norm_squared().total_cmp(&(b - ground).norm_squared())
        };
        let ground = if inside { ground } else { ends.map(along).min_by(nearer).unwrap_or(ground) };
        ground.push(p.z.clamp(low, high))
    }
}

/// A simple polygon and a band of altitudes, less the no-fly areas, cut into convex cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    polygon: Polygon,
    cells: Vec<Cell>,
    /// Whether anything is left out of the polygon.
    has_gaps: bool,
}

fn turn(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> f64 {
    (b - a).perp(&(c - b))
}

impl Region {
    /// The region of an airspace; its polygons are simple, in either orientation. `None` if the area is without an
    /// interior. Where the no-fly areas leave nothing there are no cells.
    #[must_use]
    pub fn new(airspace: &Airspace) -> Option<Self> {
        let polygon = Polygon::new(&airspace.area_enu_m).ok()?;
        let convex = pieces(&polygon)?.into_iter().map(|piece| part(&polygon, &piece));
        let mut parts: Vec<Part> = convex.map(|edges| Part { edges, taken_m: Vec::new() }).collect();
        let [low, high] = airspace.altitude_m;
        let has_gaps = !airspace.no_fly.is_empty();
        for area in &airspace.no_fly {
            let [floor, ceiling] = area.heights_m();
            let taken_m = [floor - KEEPS_OUT_M, ceiling + KEEPS_OUT_M];
            if taken_m[0] >= high || taken_m[1] <= low {
                continue;
            }
            for piece in obstacle(area)? {
                parts = parts.into_iter().flat_map(|part| part.cut_by(&piece, taken_m)).collect();
            }
        }
        let cells = parts.into_iter().flat_map(|part| part.cells(airspace.altitude_m)).collect();
        Some(Self { polygon, cells, has_gaps })
    }

    /// The convex cells.
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Whether there are no-fly areas: then what is over the polygon and in the band may still be forbidden.
    #[must_use]
    pub fn has_gaps(&self) -> bool {
        self.has_gaps
    }

    /// The polygon itself.
    #[must_use]
    pub fn polygon(&self) -> &Polygon {
        &self.polygon
    }

    /// How far `p` is inside cell `cell`, in metres; negative outside.
    #[must_use]
    pub fn depth_m(&self, cell: usize, p: &Vector3<f64>) -> f64 {
        self.cells[cell].depth_m(p)
    }

    /// The cell in which `p` lies deepest.
    #[must_use]
    pub fn cell_of(&self, p: &Vector3<f64>) -> usize {
        let mut best = 0;
        for cell in 1..self.cells.len() {
            if self.depth_m(cell, p) > self.depth_m(best, p) {
                best = cell;
            }
        }
        best
    }

    /// Whether the ground point `p` is inside the polygon or within `tolerance_m` of it, no-fly areas or not.
    #[must_use]
    pub fn contains(&self, p: Vector2<f64>, tolerance_m: f64) -> bool {
        self.covers(p, tolerance_m) || (p - self.polygon.nearest_on_boundary(p)).norm() <= tolerance_m
    }

    /// The point of the polygon that is nearest to `p`, no-fly areas or not.
    #[must_use]
    pub fn nearest(&self, p: Vector2<f64>) -> Vector2<f64> {
        if self.covers(p, 0.0) { p } else { self.polygon.nearest_on_boundary(p) }
    }

    fn covers(&self, p: Vector2<f64>, tolerance_m: f64) -> bool {
        if self.has_gaps {
            return self.polygon.encloses(p);
        }
        let p = p.push(0.0);
        self.depth_m(self.cell_of(&p), &p) >= -tolerance_m
    }

    /// The allowed point that is nearest to `p`.
    #[must_use]
    pub fn nearest_allowed(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.ways_out(p).first().copied().unwrap_or(*p)
    }

    /// The nearest point of each cell, nearest first, no point twice.
    #[must_use]
    pub fn ways_out(&self, p: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let mut points: Vec<Vector3<f64>> = self.cells.iter().map(|cell| cell.nearest(p)).collect();
        points.sort_by(|a, b| (a - p).norm_squared().total_cmp(&(b - p).norm_squared()));
        points.dedup_by(|a, b| (*a - *b).norm() < SLIVER_M);
        points
    }

    /// Whether `p` is in one of the cells.
    #[must_use]
    pub fn allows(&self, p: &Vector3<f64>) -> bool {
        self.cells.iter().any(|cell| cell.depth_m(p) >= 0.0)
    }

    /// Corners of cells with the altitudes between which they are allowed.
    pub fn corners(&self) -> impl Iterator<Item = (&Vector2<f64>, [f64; 2])> {
        self.cells.iter().flat_map(|cell| cell.corners.iter().map(move |corner| (corner, cell.altitude_m)))
    }
}

/// Side `k` begins at corner `k`.
type Edges = Vec<(Vector2<f64>, HalfPlane)>;

/// A convex part of the polygon, and the altitudes over it that no-fly areas take.
#[derive(Debug, Clone)]
struct Part {
    edges: Edges,
    taken_m: Vec<[f64; 2]>,
}

impl Part {
    /// Itself, or, if `piece` has a part of it, that part with the altitudes that are taken, and the parts around it.
    fn cut_by(self, piece: &[HalfPlane], taken_m: [f64; 2]) -> Vec<Self> {
        let mut rest = self.edges.clone();
        let mut around = Vec::new();
        for side in piece {
            let beyond = HalfPlane { normal: -side.normal, offset_m: -side.offset_m, cut: true };
            around.push(clipped(&rest, &beyond));
            rest = clipped(&rest, side);
            if is_sliver(&rest) {
                return vec![self];
            }
        }
        let keep = |edges: Edges| Self { edges, taken_m: self.taken_m.clone() };
        let mut parts: Vec<Self> = around.into_iter().filter(|edges| !is_sliver(edges)).map(keep).collect();
        let mut inside = keep(rest);
        inside.taken_m.push(taken_m);
        parts.push(inside);
        parts
    }

    /// What of the band is left over it.
    fn cells(self, [low, high]: [f64; 2]) -> Vec<Cell> {
        let whole = self.taken_m.is_empty();
        let mut taken = self.taken_m;
        taken.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut free = Vec::new();
        let mut from = low;
        for [floor, ceiling] in taken {
            if floor > from {
                free.push([from, floor.min(high)]);
            }
            from = from.max(ceiling);
        }
        if from <= high {
            free.push([from, high]);
        }
        let thin = high - low <= SLIVER_M;
        let (corners, sides): (Vec<_>, Vec<_>) = self.edges.into_iter().unzip();
        let cell = |altitude_m| Cell { sides: sides.clone(), altitude_m, corners: corners.clone(), whole };
        free.into_iter().filter(|[from, to]| thin || to - from > SLIVER_M).map(cell).collect()
    }
}

/// The part of a convex polygon inside a half-plane.
fn clipped(edges: &Edges, side: &HalfPlane) -> Edges {
    let beyond_m = |p: &Vector2<f64>| side.normal.dot(p) - side.offset_m;
    let mut kept = Vec::with_capacity(edges.len() + 1);
    for (k, (from, edge)) in edges.iter().enumerate() {
        let (to, _) = &edges[(k + 1) % edges.len()];
        let (out, next) = (beyond_m(from), beyond_m(to));
        let crossing = || from + (to - from) * (out / (out - next));
        if out <= 0.0 {
            kept.push((*from, *edge));
            if next > 0.0 {
                kept.push((crossing(), *side));
            }
        } else if next <= 0.0 {
            kept.push((crossing(), *edge));
        }
    }
    kept.dedup_by(|after, before| {
        let same = after.0 == before.0;
        if same {
            before.1 = after.1;
        }
        same
    });
    kept
}

/// Whether a convex polygon is too narrow for anything.
fn is_sliver(edges: &Edges) -> bool {
    if edges.len() < 3 {
        return true;
    }
    let origin = edges[0].0;
    let pairs = || edges.iter().zip(edges.iter().cycle().skip(1));
    let twice_m2: f64 = pairs().map(|(a, b)| (a.0 - origin).perp(&(b.0 - origin))).sum();
    let around_m: f64 = pairs().map(|(a, b)| (a.0 - b.0).norm()).sum();
    twice_m2 <= SLIVER_M * around_m
}

/// The convex pieces of a no-fly area, pushed outward by what a pose keeps off. `None` without an interior.
fn obstacle(area: &NoFly) -> Option<Vec<Vec<HalfPlane>>> {
    let polygon = Polygon::new(&area.area_enu_m).ok()?;
    let pushed = |piece: Vec<usize>| {
        let sides = part(&polygon, &piece).into_iter().map(|(_, side)| side);
        sides.map(|side| HalfPlane { offset_m: side.offset_m + KEEPS_OUT_M, cut: true, ..side }).collect()
    };
    Some(pieces(&polygon)?.into_iter().map(pushed).collect())
}

/// A simple polygon in convex pieces.
fn pieces(polygon: &Polygon) -> Option<Vec<Vec<usize>>> {
    let corners = polygon.corners();
    let size_m = (2.0 * polygon.area_m2()).sqrt();
    Some(merge(corners, triangulate(corners)?, size_m))
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

/// The corners and sides of a convex piece.
fn part(polygon: &Polygon, piece: &[usize]) -> Edges {
    let corners = polygon.corners();
    let n = piece.len();
    (0..n)
        .filter_map(|k| {
            let (from, to) = (piece[k], piece[(k + 1) % n]);
            let edge = corners[to] - corners[from];
            let length = edge.norm();
            (length > 0.0).then(|| {
                let normal = Vector2::new(edge.y, -edge.x) / length;
                let cut = (from + 1) % corners.len() != to;
                (corners[from], HalfPlane { normal, offset_m: normal.dot(&corners[from]), cut })
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

    fn region(area: &[Vector2<f64>]) -> Option<Region> {
        Region::new(&airspace(area, &[]))
    }

    fn airspace(area: &[Vector2<f64>], no_fly: &[NoFly]) -> Airspace {
        Airspace {
            altitude_m: [20.0, 120.0],
            area_enu_m: area.to_vec(),
            no_fly: no_fly.to_vec(),
            min_separation_m: 5.0,
        }
    }

    fn no_fly(corners: &[Vector2<f64>], floor_m: Option<f64>, ceiling_m: Option<f64>) -> NoFly {
        NoFly { name: "mast".to_owned(), area_enu_m: corners.to_vec(), floor_m, ceiling_m }
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
        let region = region(&square).unwrap();
        assert_eq!(region.cells().len(), 1);
        assert!(region.cells()[0].sides.iter().all(|h| !h.cut) && !region.has_gaps());
        assert!((region.depth_m(0, &Vector3::new(1.0, 0.5, 20.0)) - 0.5).abs() < 1e-15);
        assert_eq!(region.nearest(Vector2::new(5.0, 1.0)), Vector2::new(2.0, 1.0));
        assert!((region.polygon().diameter_m() - 8f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn val_l_shape_is_cut() {
        let region = region(&l_shape()).unwrap();
        assert!((2..=3).contains(&region.cells().len()));
        assert!(region.cells().iter().all(|c| c.sides.iter().any(|h| h.cut)));
        assert!(region.contains(Vector2::new(-100.0, 400.0), 0.0));
        assert!(region.contains(Vector2::new(400.0, 0.0), 0.0));
        assert!(!region.contains(Vector2::new(400.0, 400.0), 1e-6));
        let near = region.nearest(Vector2::new(100.0, 30.0));
        assert!((near - Vector2::new(100.0, 20.0)).norm() < 1e-12);
    }

    #[test]
    fn spec_no_interior_no_region() {
        assert_eq!(region(&polygon(&[[0.0, 0.0], [1.0, 1.0]])), None);
        assert_eq!(region(&polygon(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])), None);
    }

    #[test]
    fn val_a_box_over_a_square_leaves_four_sides_and_what_is_under_and_over_it() {
        let square = polygon(&[[0., 0.], [100., 0.], [100., 100.], [0., 100.]]);
        let mast = polygon(&[[40., 40.], [60., 40.], [60., 60.], [40., 60.]]);
        let cut = |floor_m, ceiling_m| {
            Region::new(&airspace(&square, &[no_fly(&mast, floor_m, ceiling_m)])).unwrap()
        };
        let pillar = cut(None, None);
        assert_eq!(pillar.cells().len(), 4);
        assert!(pillar.has_gaps() && !pillar.allows(&Vector3::new(50.0, 50.0, 60.0)));
        let out = pillar.nearest_allowed(&Vector3::new(41.0, 50.0, 60.0));
        assert!((out - Vector3::new(40.0 - KEEPS_OUT_M, 50.0, 60.0)).norm() < 1e-9);
        assert_eq!(pillar.ways_out(&Vector3::new(50.0, 50.0, 60.0)).len(), 4);
        let lump = cut(Some(50.0), Some(70.0));
        assert_eq!(lump.cells().len(), 6);
        let out = lump.nearest_allowed(&Vector3::new(50.0, 50.0, 69.0));
        assert!((out - Vector3::new(50.0, 50.0, 70.0 + KEEPS_OUT_M)).norm() < 1e-9);
        // What is wholly over or under the band, or beside the area, takes nothing.
        assert_eq!(cut(Some(120.1), None).cells().len(), 1);
        assert_eq!(cut(None, Some(19.9)).cells().len(), 1);
        let whole = no_fly(&polygon(&[[-1., -1.], [101., -1.], [101., 101.], [-1., 101.]]), None, None);
        assert_eq!(Region::new(&airspace(&square, &[whole])).unwrap().cells().len(), 0);
    }

    proptest! {
        /// Two star-shaped areas in a star-shaped fence: what the cells allow is what no prism holds, but within a micrometre.
        #[test]
        fn prop_cells_cover_what_no_area_takes(
            radii in prop::collection::vec(10.0..100.0, 21),
            centre in prop::array::uniform2(-50.0..50.0),
            heights in prop::array::uniform2(0.0..140.0),
            points in prop::collection::vec((-90.0..90.0, -90.0..90.0, 20.0..120.0), 20),
        ) {
            let star = |radii: &[f64], about: Vector2<f64>, scale: f64| -> Vec<Vector2<f64>> {
                let angle = |k: usize| std::f64::consts::TAU * k as f64 / radii.len() as f64;
                radii.iter().enumerate().map(|(k, r)| {
                    about + Vector2::new(angle(k).cos(), angle(k).sin()) * (r * scale)
                }).collect()
            };
            let fence = star(&radii[..7], Vector2::zeros(), 1.0);
            let areas = [
                no_fly(&star(&radii[7..14], Vector2::from(centre), 0.5), None, Some(heights[0])),
                no_fly(&star(&radii[14..], Vector2::new(10.0, 0.0), 0.4), Some(heights[1]), None),
            ];
            let region = Region::new(&airspace(&fence, &areas)).unwrap();
            let taken = |p: &Vector3<f64>, margin_m: f64| areas.iter().any(|area| {
                let polygon = Polygon::new(&area.area_enu_m).unwrap();
                let [floor, ceiling] = area.heights_m();
                let deep = (p.xy() - polygon.nearest_on_boundary(p.xy())).norm();
                let deep = if polygon.encloses(p.xy()) { deep } else { -deep };
                deep.min(p.z - floor).min(ceiling - p.z) > margin_m
            });
            for (x, y, z) in points {
                let p = Vector3::new(x, y, z);
                let edge_m = (p.xy() - region.polygon().nearest_on_boundary(p.xy())).norm();
                let near = edge_m < 1e-4 || taken(&p, -1e-4) != taken(&p, 1e-4);
                if !near {
                    prop_assert_eq!(region.allows(&p), region.polygon().encloses(p.xy()) && !taken(&p, 0.0), "{}", p);
                }
                if !region.cells().is_empty() {
                    let out = region.nearest_allowed(&p);
                    prop_assert!(!taken(&out, 0.0) && region.polygon().contains(out.xy(), 1e-9), "{} {}", p, out);
                }
            }
        }

        /// Star-shaped polygons about the origin, as concave as can be: cells agree with the even-odd rule.
        #[test]
        fn prop_cells_cover_the_polygon(radii in prop::collection::vec(10.0..100.0, 5..12), x in -90.0..90.0, y in -90.0..90.0) {
            let n = radii.len() as f64;
            let star: Vec<_> = radii.iter().enumerate().map(|(k, r)| {
                let angle = std::f64::consts::TAU * k as f64 / n;
                Vector2::new(r * angle.cos(), r * angle.sin())
            }).collect();
            let region = region(&star).unwrap();
            let p = Vector2::new(x, y);
            let distance = (p - region.polygon().nearest_on_boundary(p)).norm();
            if distance > 1e-6 {
                prop_assert_eq!(region.contains(p, 0.0), region.polygon().encloses(p));
            }
            prop_assert!(region.contains(region.nearest(p), 1e-9));
        }
    }
}
