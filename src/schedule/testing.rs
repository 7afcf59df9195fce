//! Instances for this module's tests.

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::geofence::Geofence;
use super::trajectory::Limits;
use super::transit::Router;
use crate::planner::problem::Airspace;
use crate::role::PerVehicle;

pub fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

pub fn v2(point: [f64; 2]) -> Vector2<f64> {
    Vector2::from(point)
}

pub fn polygon(points: &[[f64; 2]]) -> Vec<Vector2<f64>> {
    points.iter().copied().map(v2).collect()
}

/// A star: a concave polygon with long arms, in a random orientation, about the origin.
pub fn star(rng: &mut ChaCha8Rng, radius_m: f64) -> Vec<Vector2<f64>> {
    let n = rng.random_range(5..14);
    let mut area: Vec<_> = (0..n)
        .map(|k| {
            let angle = (f64::from(k) + rng.random_range(0.0..0.8)) * std::f64::consts::TAU / f64::from(n);
            Vector2::new(angle.cos(), angle.sin())
                * rng.random_range(if k % 2 == 0 { 0.1..0.5 } else { 0.6..1.0 })
                * radius_m
        })
        .collect();
    if rng.random_bool(0.5) {
        area.reverse();
    }
    area
}

/// A uniform point inside `fence`, which lies within `radius_m` of the origin.
pub fn inside(rng: &mut ChaCha8Rng, fence: &Geofence, radius_m: f64) -> Vector2<f64> {
    loop {
        let point =
            Vector2::new(rng.random_range(-radius_m..radius_m), rng.random_range(-radius_m..radius_m));
        if fence.contains(point) {
            return point;
        }
    }
}

/// A router of a square kilometre for two vehicles of ten metres a second.
pub fn router() -> Router {
    let airspace = Airspace {
        altitude_m: [20.0, 120.0],
        area_enu_m: polygon(&[[-500., -500.], [500., -500.], [500., 500.], [-500., 500.]]),
        no_fly: Vec::new(),
        min_separation_m: 5.0,
    };
    let limits = Limits::new(10.0, 5.0, 0.5);
    Router::new(&airspace, &PerVehicle { i: limits, j: limits }).unwrap()
}
