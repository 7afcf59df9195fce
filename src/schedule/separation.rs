//! Distance between the vehicles' paths, taken as sets of points: where it is kept, neither vehicle's timing matters.

use crate::geo::Enu;
use crate::planner::problem::Airspace;

/// The distance aimed at between the vehicles in metres: the airspace's minimum and a margin for tracking errors,
/// 2 m or a fifth of the minimum, whichever is more.
#[must_use]
pub fn clearance_m(airspace: &Airspace) -> f64 {
    airspace.min_separation_m + (0.2 * airspace.min_separation_m).max(2.0)
}

/// The least distance in metres between two polylines; a single point is a polyline. Infinite if one is empty.
#[must_use]
pub fn polyline_distance_m(a: &[Enu], b: &[Enu]) -> f64 {
    segments(a).flat_map(|s| segments(b).map(move |t| segment_distance_m(s, t))).fold(f64::INFINITY, f64::min)
}

/// The segments of a polyline; of a single point, the segment from it to itself.
fn segments(polyline: &[Enu]) -> impl Iterator<Item = [Enu; 2]> + Clone {
    let single = (polyline.len() == 1).then(|| [polyline[0], polyline[0]]);
    single.into_iter().chain(polyline.windows(2).map(|w| [w[0], w[1]]))
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
