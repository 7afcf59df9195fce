//! Missions that nobody has looked at, by kind, seed and number.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::problem::{Objective, Problem, Uncertainty};

/// What is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// One to five eavesdroppers in discs, without jitter and with 1, 2 or 5 deg of it.
    WorstCase,
    /// The same, in discs or Gaussians, for the 5% quantile.
    Quantile,
    /// Gaussians of 80 m without jitter, for the 5% quantile.
    WideGaussians,
    /// Ten eavesdroppers, nothing random.
    Ten,
    /// Five eavesdroppers, 2 deg, the desired yaw free.
    FreeYaw,
}

const KINDS: [(&str, Kind); 5] = [
    ("worst-case", Kind::WorstCase),
    ("quantile", Kind::Quantile),
    ("wide-gaussians", Kind::WideGaussians),
    ("ten", Kind::Ten),
    ("free-yaw", Kind::FreeYaw),
];

impl Kind {
    /// The kind of this name.
    pub fn named(name: &str) -> Option<Self> {
        KINDS.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        KINDS.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }
}

/// Mission `index` of a kind.
pub fn draw(kind: Kind, seed: u64, index: usize) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(seed.wrapping_mul(0x9e37_79b9).wrapping_add(index as u64));
    let count = match kind {
        Kind::WorstCase | Kind::Quantile => rng.random_range(1..=5),
        Kind::WideGaussians => rng.random_range(2..=5),
        Kind::Ten => 10,
        Kind::FreeYaw => 5,
    };
    let nodes: Vec<[f64; 2]> = (0..count).map(|_| [0; 2].map(|_| rng.random_range(-500.0..500.0))).collect();
    let jitter_deg: f64 = match kind {
        Kind::WorstCase | Kind::Quantile => [0.0, 1.0, 2.0, 5.0][rng.random_range(0..4)],
        Kind::WideGaussians | Kind::Ten => 0.0,
        Kind::FreeYaw => 2.0,
    };
    let mut problem = Problem::paper(nodes, 0.5, jitter_deg.to_radians());
    problem.airspace.min_separation_m = 5.0;
    problem.free_yaw = kind == Kind::FreeYaw;
    problem.objective = match kind {
        Kind::WorstCase => Objective::WorstCase,
        Kind::Quantile | Kind::WideGaussians => Objective::Quantile,
        Kind::Ten | Kind::FreeYaw => Objective::Mean,
    };
    let discs = kind == Kind::WorstCase || rng.random_range(0..2) == 0;
    for node in &mut problem.eavesdroppers {
        node.uncertainty = match kind {
            Kind::WorstCase | Kind::Quantile if discs => {
                Uncertainty::Disc { radius_m: rng.random_range(10.0..80.0) }
            }
            Kind::WorstCase | Kind::Quantile => Uncertainty::Gaussian { std_m: rng.random_range(5.0..80.0) },
            Kind::WideGaussians => Uncertainty::Gaussian { std_m: 80.0 },
            Kind::Ten | Kind::FreeYaw => Uncertainty::None,
        };
    }
    problem
}

/// What it is, in a few words.
pub fn describe(problem: &Problem) -> String {
    let sizes = problem.eavesdroppers.iter().map(|e| match e.uncertainty {
        Uncertainty::None => String::new(),
        Uncertainty::Disc { radius_m } => format!(" d{radius_m:.0}"),
        Uncertainty::Gaussian { std_m } => format!(" g{std_m:.0}"),
    });
    let sizes: String = sizes.collect();
    format!("N {} {:.0} deg{sizes}", problem.eavesdroppers.len(), problem.jitter.std_rad.to_degrees())
}
