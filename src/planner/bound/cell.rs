//! Axis-aligned boxes of positions, and the airspace they must meet.

use nalgebra::{Vector2, Vector3};

use crate::planner::problem::Airspace;

/// Steps of Dinkelbach's method, which converges faster than linearly.
const RATIO_STEPS: usize = 3;

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

    /// The sine of the largest angle between `direction` and a line from the box to `point`, 2 for a right angle or more. It is at a
    /// corner: the points whose lines lie within an angle of a direction are a convex cone.
    pub fn spread(&self, point: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
        let mut most = 0.0_f64;
        for corner in 0..8 {
            let line =
                point - Vector3::from_fn(|k, _| if corner >> k & 1 == 0 { self.lo[k] } else { self.hi[k] });
            if !(line.dot(direction) > 0.0) {
                return 2.0;
            }
            most = most.max(line.cross(direction).norm_squared() / line.norm_squared());
        }
        most.sqrt()
    }

    /// A lower bound on the squared distance to the origin over that to `point`, which lies outside: by Dinkelbach's method. Of
    /// `|p|^2 - t |p - point|^2` the least is found coordinate by coordinate; where that is v, no ratio is below `t + v / |p - point|^2`.
    pub fn least_ratio(&self, point: &Vector3<f64>) -> f64 {
        let squares = |p: &Vector3<f64>| [p.norm_squared(), (p - point).norm_squared()];
        let lowest = |t: f64| {
            Vector3::from_fn(|k, _| {
                let (lo, hi, e) = (self.lo[k], self.hi[k], point[k]);
                let value = |p: f64| (1.0 - t) * p * p + 2.0 * t * p * e;
                if t < 1.0 {
                    (-t * e / (1.0 - t)).clamp(lo, hi)
                } else if value(lo) < value(hi) {
                    lo
                } else {
                    hi
                }
            })
        };
        let [near, far] = squares(&self.centre());
        let mut t = near / far;
        for _ in 0..RATIO_STEPS {
            let [near, far] = squares(&lowest(t));
            t = t.min(near / far);
        }
        let [near, far] = squares(&lowest(t));
        (t + (near - t * far).min(0.0) / self.least_distance_squared(point)).max(0.0)
    }

    /// The half of the box about its middle across `axis`.
    pub fn middle(&self, axis: usize) -> Self {
        let quarter = 0.25 * (self.hi[axis] - self.lo[axis]);
        let mut middle = *self;
        middle.lo[axis] += quarter;
        middle.hi[axis] -= quarter;
        middle
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

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn prop_no_point_of_a_box_is_past_its_spread_or_below_its_least_ratio() {
        let mut rng = ChaCha8Rng::seed_from_u64(72);
        let mut nearest = [0.0_f64, f64::INFINITY];
        for round in 0..500 {
            let mut within = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
            let half = within([0.5, 5.0, 20.0][round % 3]).abs();
            let (centre, node) = (within(40.0), within(60.0));
            let cell = Cell { lo: centre - half, hi: centre + half };
            if cell.least_distance_squared(&node) < 1e-3 {
                continue;
            }
            let direction = (node - centre).normalize();
            let (spread, ratio) = (cell.spread(&node, &direction), cell.least_ratio(&node));
            for point in 0..200 {
                let mut share = within(1.0);
                if point % 2 == 0 {
                    share.apply(|x| *x = x.signum());
                }
                let p = centre + half.component_mul(&share);
                let sine = (2.0 * (0.5 * ((node - p).normalize() - direction).norm()).asin()).sin();
                let here = p.norm_squared() / (p - node).norm_squared();
                assert!(spread == 2.0 || sine <= spread * (1.0 + 1e-9), "{cell:?} {node}: {sine} {spread}");
                assert!(here >= ratio * (1.0 - 1e-9), "{cell:?} {node}: {here} {ratio}");
                nearest = [nearest[0].max(sine / spread), nearest[1].min(here / ratio)];
            }
        }
        assert!(nearest[0] > 0.999 && nearest[1] < 1.001, "{nearest:?}");
    }
}
