//! Ten missions of the paper's arena that nobody has looked at, by seed and number.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::problem::Problem;
use veilwing::planner::volume::{Fairness, Service};
use veilwing::role::PerVehicle;
use veilwing::schedule::trajectory::Limits;

/// Users, eavesdroppers, length of a slot in seconds.
const KINDS: [(usize, usize, f64); 10] = [
    (2, 2, 10.0),
    (3, 5, 20.0),
    (4, 2, 30.0),
    (6, 5, 10.0),
    (8, 2, 20.0),
    (4, 5, 10.0),
    (5, 2, 5.0),
    (2, 5, 60.0),
    (4, 2, 60.0),
    (8, 5, 20.0),
];
/// How many there are.
pub const COUNT: usize = KINDS.len();

/// A mission's superframe.
pub struct Superframe {
    pub problems: Vec<Problem>,
    pub service: Service,
}

/// What vehicles can do: the mission file's defaults.
pub fn limits() -> PerVehicle<Limits> {
    let own = Limits { jerk_m_s3: Some(4.0), ..Limits::new(8.0, 3.0, 45f64.to_radians()) };
    PerVehicle { i: own, j: own }
}

/// Mission `index`: 2 deg of jitter, eavesdroppers anywhere, users in the middle or all over.
pub fn draw(index: usize, seed: u64, fairness: Fairness) -> Superframe {
    let mut rng = ChaCha8Rng::seed_from_u64(seed.wrapping_mul(0x9e37_79b9).wrapping_add(index as u64));
    let (users, count, slot_s) = KINDS[index % COUNT];
    let nodes: Vec<[f64; 2]> = (0..count).map(|_| [0; 2].map(|_| rng.random_range(-500.0..500.0))).collect();
    let mut problem = Problem::paper(nodes, 0.5, 2f64.to_radians());
    problem.airspace.min_separation_m = 5.0;
    let reach_m = if index.is_multiple_of(2) { 150.0 } else { 400.0 };
    let mut place = || rng.random_range(-reach_m..reach_m);
    let problems = (0..users)
        .map(|_| Problem { user_enu_m: Vector3::new(place(), place(), 0.0), ..problem.clone() })
        .collect();
    let service = Service {
        slot_s,
        guard_s: 1.0,
        settle_s: if index.is_multiple_of(3) { 2.0 } else { 3.0 },
        slot_limits_s: [0.5 * slot_s, 2.0 * slot_s],
        fairness,
        may_reorder: index.is_multiple_of(2),
    };
    Superframe { problems, service }
}
