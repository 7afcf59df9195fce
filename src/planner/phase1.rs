//! Phase 1 of the paper: the line of I's plane of maximum gain on the ground, and I's axis from it.
//!
//! A vehicle near the user with its axis across the line through the user at angle nu serves the user in full and
//! receives eavesdropper j off the plane by `|w . p_j|`, w = (sin nu, -cos nu) the line's normal and p_j the
//! eavesdropper's horizontal position from the user. (opA) maximises `min_j |w . p_j|`: piecewise sinusoidal in nu, so
//! its maximum is at a peak of one sinusoid or at a crossing of two, N + N(N - 1) candidates.

use nalgebra::{Matrix3, Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Least distance of the eavesdroppers from the line at angle `nu_rad`, in metres.
#[must_use]
pub fn least_distance_m(nu_rad: f64, from_user: &[Vector2<f64>]) -> f64 {
    let (s, c) = libm::sincos(nu_rad);
    from_user.iter().map(|p| (s * p.x - c * p.y).abs()).fold(f64::INFINITY, f64::min)
}

/// The best line angle in radians, in [0, pi): exact, by enumeration.
#[must_use]
pub fn line_angle(from_user: &[Vector2<f64>]) -> f64 {
    let mut best = (0.0, f64::NEG_INFINITY);
    // Any direction p has its peak across p, and two sinusoids cross along p - q and p + q.
    let across = from_user.iter().map(|p| Vector2::new(-p.y, p.x));
    let pairs = (0..from_user.len()).flat_map(|a| (0..a).map(move |b| (from_user[a], from_user[b])));
    for along in across.chain(pairs.flat_map(|(p, q)| [p - q, p + q])) {
        let nu = libm::atan2(along.y, along.x).rem_euclid(std::f64::consts::PI);
        let distance = least_distance_m(nu, from_user);
        if distance > best.1 {
            best = (nu, distance);
        }
    }
    best.0
}

/// The paper's simulated annealing for (opA), kept as a check of the enumeration.
#[must_use]
pub fn line_angle_by_annealing(from_user: &[Vector2<f64>], steps: usize, rng: &mut ChaCha8Rng) -> f64 {
    let scale = from_user.iter().map(|p| p.norm()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let energy = |nu: f64| -least_distance_m(nu, from_user) / scale;
    let mut nu = rng.random_range(0.0..std::f64::consts::PI);
    let mut best = nu;
    for step in 0..steps {
        let left = 1.0 - step as f64 / steps as f64;
        let temperature = 0.2 * left * left * left + 1e-9;
        let trial = nu + 3.0 * temperature.sqrt() * rng.random_range(-1.0..1.0);
        if rng.random_range(0.0..1.0) < libm::exp((energy(nu) - energy(trial)) / temperature) {
            nu = trial;
        }
        if energy(nu) < energy(best) {
            best = nu;
        }
    }
    best.rem_euclid(std::f64::consts::PI)
}

/// I's axis follows its position (4.8, normalised by its reader): `Y_I = M (p_I - p_0)`, up to length, with
/// `M v = (cos nu, sin nu, 0) x v`.
#[must_use]
pub fn axis_map(nu_rad: f64) -> Matrix3<f64> {
    let (sin, cos) = libm::sincos(nu_rad);
    Vector3::new(cos, sin, 0.0).cross_matrix()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;

    #[test]
    fn val_one_eavesdropper_is_faced_across() {
        let nu = line_angle(&[Vector2::new(100.0, 0.0)]);
        assert!((nu - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn val_two_at_equal_distance_are_bisected() {
        let p = [Vector2::new(100.0, 30.0), Vector2::new(100.0, -30.0)];
        assert!((line_angle(&p) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert!((least_distance_m(line_angle(&p), &p) - 100.0).abs() < 1e-9);
    }

    #[test]
    fn val_axis_of_the_map_is_across_user_and_line() {
        let (nu, v) = (0.7, Vector3::new(3.0, -8.0, 90.0));
        let y = axis_map(nu) * v;
        assert!(y.dot(&v).abs() < 1e-12 && y.dot(&Vector3::new(nu.cos(), nu.sin(), 0.0)).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn prop_enumeration_beats_a_grid_and_annealing(points in prop::collection::vec((-500.0..500.0, -500.0..500.0), 1..9), seed: u64) {
            let p: Vec<_> = points.iter().map(|(x, y)| Vector2::new(*x, *y)).collect();
            let exact = least_distance_m(line_angle(&p), &p);
            for k in 0..720 {
                let nu = std::f64::consts::PI * f64::from(k) / 720.0;
                prop_assert!(least_distance_m(nu, &p) <= exact + 1e-9);
            }
            let annealed = least_distance_m(line_angle_by_annealing(&p, 4000, &mut ChaCha8Rng::seed_from_u64(seed)), &p);
            prop_assert!(annealed <= exact + 1e-9 && annealed >= 0.9 * exact - 1.0, "{annealed} {exact}");
        }
    }
}
