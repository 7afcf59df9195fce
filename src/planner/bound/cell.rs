//! Axis-aligned boxes of positions, and the airspace they must meet.

use nalgebra::{Vector2, Vector3};

use crate::planner::problem::Airspace;

/// A closed box of positions, metres, in the frame of its user.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cell {
    /// Smallest coordinates.
    pub lo: Vector3<f64>,
    /// Largest coordinates.
    pub hi: Vector3<f64>,
}

impl Cell {
    /// A single point.
    pub fn at(point: &Vector3<f64>) -> Self {
        Self { lo: *point, hi: *point }
    }

    /// The midpoint.
    pub fn centre(&self) -> Vector3<f64> {
        (self.lo + self.hi) * 0.5
    }

    /// Half the diagonal: the radius of the ball about the midpoint that holds the box.
    pub fn radius(&self) -> f64 {
        (self.hi - self.lo).norm() * 0.5
    }

    /// The least distance to `point`, squared.
    pub fn least_distance_squared(&self, point: &Vector3<f64>) -> f64 {
        point.zip_zip_map(&self.lo, &self.hi, |p, lo, hi| (lo - p).max(p - hi).max(0.0)).norm_squared()
    }

    /// The greatest distance to `point`, squared.
    pub fn greatest_distance_squared(&self, point: &Vector3<f64>) -> f64 {
        point.zip_zip_map(&self.lo, &self.hi, |p, lo, hi| (p - lo).max(hi - p)).norm_squared()
    }

    /// The longest edge: its axis and length.
    pub fn longest_edge(&self) -> (usize, f64) {
        let edges = self.hi - self.lo;
        let axis = edges.imax();
        (axis, edges[axis])
    }

    /// The two halves across `axis`. They share the midpoint exactly: nothing falls between them.
    pub fn split(&self, axis: usize) -> [Self; 2] {
        let middle = 0.5 * (self.lo[axis] + self.hi[axis]);
        let (mut lower, mut upper) = (*self, *self);
        lower.hi[axis] = middle;
        upper.lo[axis] = middle;
        [lower, upper]
    }

    /// The box cut to within `reach` of the origin along every axis; `None` if nothing is left.
    pub fn cut_to(&self, reach: f64) -> Option<Self> {
        let cut = Self { lo: self.lo.map(|x| x.max(-reach)), hi: self.hi.map(|x| x.min(reach)) };
        (cut.lo <= cut.hi).then_some(cut)
    }
}

/// The airspace about the user: a polygon times a band of altitudes, less what separation forbids.
#[derive(Debug, Clone)]
pub(crate) struct Region {
    /// Polygon vertices relative to the user; empty when the bounding box is the whole area.
    polygon: Vec<Vector2<f64>>,
    /// The bounding box.
    pub bounds: Cell,
    /// Least distance between the two vehicles, squared.
    separation_squared: f64,
}

impl Region {
    /// The airspace relative to `user_enu_m`; `None` if it is empty or not finite.
    pub fn new(airspace: &Airspace, user_enu_m: &Vector3<f64>) -> Option<Self> {
        let polygon: Vec<_> = airspace.area_enu_m.iter().map(|v| v - user_enu_m.xy()).collect();
        let [z_lo, z_hi] = airspace.altitude_m.map(|z| z - user_enu_m.z);
        let infinite = Vector2::repeat(f64::INFINITY);
        let lo = polygon.iter().fold(infinite, |a, v| a.inf(v)).push(z_lo);
        let hi = polygon.iter().fold(-infinite, |a, v| a.sup(v)).push(z_hi);
        if polygon.is_empty() || !(lo <= hi) || lo.iter().chain(hi.iter()).any(|x| !x.is_finite()) {
            return None;
        }
        // Outward by more than the rounding of the subtractions above.
        let slack = 1e-14 * (lo.amax() + hi.amax() + 2.0 * user_enu_m.amax());
        let bounds = Cell { lo: lo.add_scalar(-slack), hi: hi.add_scalar(slack) };
        let on_corner = |v: &Vector2<f64>| (v.x == lo.x || v.x == hi.x) && (v.y == lo.y || v.y == hi.y);
        let whole = polygon.len() == 4 && polygon.iter().all(on_corner);
        let separation = airspace.min_separation_m.max(0.0) * (1.0 - 1e-12);
        Some(Self {
            polygon: if whole { Vec::new() } else { polygon },
            bounds,
            separation_squared: separation * separation,
        })
    }

    /// Whether `cell` lies wholly outside the area (its altitudes are the bounding box's business).
    pub fn excludes(&self, cell: &Cell) -> bool {
        if self.polygon.is_empty() {
            return false;
        }
        let slack = 1e-12 * (cell.lo.amax() + cell.hi.amax());
        let (lo, hi) = (cell.lo.xy().add_scalar(-slack), cell.hi.xy().add_scalar(slack));
        !self.edges().any(|(a, b)| segment_meets(a, b, lo, hi)) && !self.surrounds(&cell.centre().xy())
    }

    /// Whether a point of the bounding box lies outside the area.
    pub fn excludes_point(&self, point: &Vector3<f64>) -> bool {
        !self.polygon.is_empty() && !self.surrounds(&point.xy())
    }

    /// Whether two boxes hold no pair of positions that keeps the separation.
    pub fn too_close(&self, a: &Cell, b: &Cell) -> bool {
        let reach = (a.hi - b.lo).sup(&(b.hi - a.lo));
        reach.norm_squared() < self.separation_squared
    }

    fn edges(&self) -> impl Iterator<Item = (&Vector2<f64>, &Vector2<f64>)> {
        self.polygon.iter().zip(self.polygon.iter().cycle().skip(1))
    }

    /// Even-odd rule.
    fn surrounds(&self, point: &Vector2<f64>) -> bool {
        let mut inside = false;
        for (a, b) in self.edges() {
            if (a.y > point.y) != (b.y > point.y) {
                let crossing = a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x);
                inside ^= point.x < crossing;
            }
        }
        inside
    }
}

/// Whether the segment from `a` to `b` meets the rectangle (Liang-Barsky).
fn segment_meets(a: &Vector2<f64>, b: &Vector2<f64>, lo: Vector2<f64>, hi: Vector2<f64>) -> bool {
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for k in 0..2 {
        let step = b[k] - a[k];
        if step == 0.0 {
            if a[k] < lo[k] || a[k] > hi[k] {
                return false;
            }
            continue;
        }
        let (s, t) = ((lo[k] - a[k]) / step, (hi[k] - a[k]) / step);
        enter = enter.max(s.min(t));
        leave = leave.min(s.max(t));
    }
    enter <= leave
}
