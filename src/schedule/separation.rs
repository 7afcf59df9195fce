//! Distance between the vehicles' paths, taken as sets of points: where it is kept, neither vehicle's timing matters.

use crate::geo::Enu;
use crate::planner::problem::Airspace;
use crate::role::{PerVehicle, Role};

/// What rounding may leave of a distance, in metres.
const ROUNDING_M: f64 = 1e-6;

/// The distance aimed at between the vehicles in metres: the airspace's minimum and a margin for tracking errors,
/// 2 m or a fifth of the minimum, whichever is more.
#[must_use]
pub fn clearance_m(airspace: &Airspace) -> f64 {
    airspace.min_separation_m + (0.2 * airspace.min_separation_m).max(2.0)
}

/// What is to be kept between two paths whose ends may be closer than that.
#[derive(Debug, Clone)]
pub(super) struct Clearance {
    /// Kept away from tight ends, in metres.
    pub full_m: f64,
    /// Kept everywhere: less than `full_m` if ends are closer to each other.
    pub least_m: f64,
    /// Each vehicle's ends at which the other is closer than `full_m`. Within [`Self::NEAR`] of them, `least_m` will do.
    tight: PerVehicle<Vec<Enu>>,
}

impl Clearance {
    /// Radius round a tight end over the full clearance: room to open up in.
    const NEAR: f64 = 2.0;

    /// The clearance to keep between paths with these pairs of ends, each (I's, J's, distance).
    pub fn new(full_m: f64, ends: &[(PerVehicle<Option<Enu>>, f64)]) -> Self {
        let least_m = ends.iter().fold(full_m, |least, end| least.min(end.1));
        let tight = PerVehicle::from_fn(|role| {
            ends.iter().filter(|end| end.1 < full_m).filter_map(|end| end.0[role]).collect()
        });
        Self { full_m, least_m, tight }
    }

    /// Whether the path of vehicle `role` and that of the other are far enough apart, whatever the timing.
    pub fn is_kept(&self, role: Role, own: &[Enu], peers: &[Enu]) -> bool {
        if polyline_distance_m(own, peers) < self.least_m - ROUNDING_M {
            return false;
        }
        let full_m = self.full_m - ROUNDING_M;
        let outside = |path: &[Enu], role: Role| outside(path, &self.tight[role], Self::NEAR * self.full_m);
        self.least_m >= self.full_m
            || (distance_m(outside(own, role), peers) >= full_m
                && distance_m(outside(peers, role.peer()), own) >= full_m)
    }
}

/// The least distance in metres between two polylines; a single point is a polyline. Infinite if one is empty.
#[must_use]
pub fn polyline_distance_m(a: &[Enu], b: &[Enu]) -> f64 {
    distance_m(segments(a), b)
}

fn distance_m(a: impl IntoIterator<Item = [Enu; 2]>, b: &[Enu]) -> f64 {
    let pairs = a.into_iter().flat_map(|s| segments(b).map(move |t| segment_distance_m(s, t)));
    pairs.fold(f64::INFINITY, f64::min)
}

/// The segments of a polyline; of a single point, the segment from it to itself.
fn segments(polyline: &[Enu]) -> impl Iterator<Item = [Enu; 2]> {
    let single = (polyline.len() == 1).then(|| [polyline[0], polyline[0]]);
    single.into_iter().chain(polyline.windows(2).map(|w| [w[0], w[1]]))
}

/// What of a polyline lies outside all balls of `radius_m` about `centres`.
fn outside(polyline: &[Enu], centres: &[Enu], radius_m: f64) -> Vec<[Enu; 2]> {
    centres.iter().fold(segments(polyline).collect(), |pieces: Vec<_>, centre| {
        pieces.into_iter().flat_map(|piece| outside_ball(piece, *centre, radius_m)).flatten().collect()
    })
}

/// The pieces of a segment before and after its passage through a ball: |a + t u - c| = r solved for t.
fn outside_ball([a, b]: [Enu; 2], centre: Enu, radius_m: f64) -> [Option<[Enu; 2]>; 2] {
    let (u, w) = (b - a, a - centre);
    let (uu, uw, rest) = (u.norm_squared(), u.dot(&w), w.norm_squared() - radius_m * radius_m);
    let discriminant = uw * uw - uu * rest;
    if discriminant <= 0.0 {
        // The line misses the ball, or there is no line.
        let inside = uu == 0.0 && rest < 0.0;
        return [(!inside).then_some([a, b]), None];
    }
    let root = discriminant.sqrt();
    let (enters, leaves) = ((-uw - root) / uu, (-uw + root) / uu);
    if enters >= 1.0 || leaves <= 0.0 {
        return [Some([a, b]), None];
    }
    [(enters > 0.0).then(|| [a, a + u * enters]), (leaves < 1.0).then(|| [a + u * leaves, b])]
}

/// The least distance in metres between two segments.
///
/// Minimises |a + s u - c - t v|^2 over s, t in [0, 1]. The minimum of a convex quadratic over a square is its free
/// minimum where that lies inside, else on one of the four sides: a point against a segment. Taking the least of all
/// of these needs no case for parallel or degenerate segments.
#[must_use]
pub fn segment_distance_m([a, b]: [Enu; 2], [c, d]: [Enu; 2]) -> f64 {
    let (u, v, w) = (b - a, d - c, a - c);
    let sides =
        [(a, c, d), (b, c, d), (c, a, b), (d, a, b)].map(|(p, q, r)| point_segment_distance_m(p, q, r));
    let least = sides.into_iter().fold(f64::INFINITY, f64::min);
    let (uu, uv, vv, uw, vw) = (u.dot(&u), u.dot(&v), v.dot(&v), u.dot(&w), v.dot(&w));
    let determinant = uu * vv - uv * uv;
    // Nearly parallel segments are nearest at a side, to rounding.
    if determinant <= 1e-12 * uu * vv {
        return least;
    }
    let (s, t) = ((uv * vw - vv * uw) / determinant, (uu * vw - uv * uw) / determinant);
    let inside = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    if inside { least.min((w + u * s - v * t).norm()) } else { least }
}

fn point_segment_distance_m(p: Enu, q: Enu, r: Enu) -> f64 {
    let e = r - q;
    let length2 = e.norm_squared();
    let s = if length2 > 0.0 { ((p - q).dot(&e) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (p - q - e * s).norm()
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::schedule::testing;

    fn e(x: f64, y: f64, z: f64) -> Enu {
        Enu::new(x, y, z)
    }

    #[test]
    fn val_distances_of_known_segments() {
        let s = [e(0., 0., 0.), e(10., 0., 0.)];
        for (t, expected) in [
            ([e(5., -5., 3.), e(5., 5., 3.)], 3.0),
            ([e(0., 4., 0.), e(10., 4., 0.)], 4.0),
            ([e(13., 4., 0.), e(20., 4., 0.)], 5.0),
            ([e(12., 0., 0.), e(20., 0., 0.)], 2.0),
            ([e(5., 0., 0.), e(5., 0., 0.)], 0.0),
            ([e(2., 0., 7.), e(2., 0., 1.)], 1.0),
        ] {
            assert!((segment_distance_m(s, t) - expected).abs() < 1e-12);
            assert!((segment_distance_m(t, s) - expected).abs() < 1e-12);
        }
        assert_eq!(polyline_distance_m(&[e(0., 0., 0.)], &[e(3., 4., 0.)]), 5.0);
        assert_eq!(polyline_distance_m(&[], &[e(3., 4., 0.)]), f64::INFINITY);
    }

    #[test]
    fn val_pieces_outside_balls() {
        let line = [e(-10., 0., 0.), e(10., 0., 0.), e(10., 10., 0.)];
        let pieces = outside(&line, &[e(0., 3., 0.)], 5.0);
        assert_eq!(
            pieces,
            [[e(-10., 0., 0.), e(-4., 0., 0.)], [e(4., 0., 0.), e(10., 0., 0.)], [line[1], line[2]]]
        );
        let pieces = outside(&line, &[e(-10., 0., 0.), e(10., 5., 0.)], 13.0);
        assert_eq!(pieces.len(), 0);
        assert_eq!(outside(&[e(1., 0., 0.)], &[e(0., 0., 0.)], 2.0).len(), 0);
        assert_eq!(outside(&[e(2., 0., 0.)], &[e(0., 0., 0.)], 2.0).len(), 1);
        assert_eq!(outside(&line, &[], 2.0).len(), 2);
    }

    #[test]
    fn spec_clearance_is_full_away_from_tight_ends() {
        let (i, j) = (e(0., 0., 0.), e(5., 0., 0.));
        let clearance = Clearance::new(7.0, &[(PerVehicle { i: Some(i), j: Some(j) }, 5.0)]);
        let beside = |far: f64| (vec![i, e(0., far, 0.)], vec![j, e(5., far, 0.)]);
        let kept = |(a, b): (Vec<Enu>, Vec<Enu>)| clearance.is_kept(Role::I, &a, &b);
        // Side by side for 13 m is near the ends; for 15 m it is not; opening up on the way is.
        assert!(kept(beside(13.0)) && !kept(beside(15.0)));
        assert!(kept((vec![i, e(0., 50., 0.)], vec![j, e(30., 50., 0.)])));
        // Never below the least.
        assert!(!kept((vec![i, e(1., 3., 0.)], vec![j])));
    }

    #[test]
    fn prop_segment_distance_is_the_least_over_a_grid() {
        let mut rng = testing::rng(3);
        for _ in 0..300 {
            let mut p = || Enu::from_fn(|_, _| rng.random_range(-1.0..1.0));
            let (s, t) = ([p(), p()], [p(), p()]);
            let closed = segment_distance_m(s, t);
            let n = 100;
            let on = |s: [Enu; 2], k: i32| s[0] + (s[1] - s[0]) * (f64::from(k) / f64::from(n));
            let sampled = (0..=n)
                .flat_map(|i| (0..=n).map(move |k| (on(s, i) - on(t, k)).norm()))
                .fold(f64::INFINITY, f64::min);
            // A grid point lies within half a step of each segment's nearest point.
            let step = 0.5 * ((s[1] - s[0]).norm() + (t[1] - t[0]).norm()) / f64::from(n);
            assert!(closed <= sampled + 1e-12 && sampled <= closed + step, "{closed} {sampled}");
        }
    }
}
