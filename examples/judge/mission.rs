//! Missions that nobody has looked at, by kind, seed and number.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::problem::{Objective, Pattern, Pointing, PowerSteps, Problem, Rician, Uncertainty};

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
    /// One to five eavesdroppers, any of the jitters, both antennas with floors of -40 to -15 dB.
    Floors,
    /// The same with Rician factors of 5 to 25 dB in place of floors.
    Scattering,
    /// With headings, mountings and positions that stay wrong, and a user somewhere in a disc or by a Gaussian.
    Pointing,
    /// With four to eight levels of J's power, from a milliwatt on, and floors.
    Levels,
}

const KINDS: [(&str, Kind); 9] = [
    ("worst-case", Kind::WorstCase),
    ("quantile", Kind::Quantile),
    ("wide-gaussians", Kind::WideGaussians),
    ("ten", Kind::Ten),
    ("free-yaw", Kind::FreeYaw),
    ("floors", Kind::Floors),
    ("scattering", Kind::Scattering),
    ("pointing", Kind::Pointing),
    ("levels", Kind::Levels),
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
        Kind::WideGaussians => rng.random_range(2..=5),
        Kind::Ten => 10,
        Kind::FreeYaw => 5,
        _ => rng.random_range(1..=5),
    };
    let nodes: Vec<[f64; 2]> = (0..count).map(|_| [0; 2].map(|_| rng.random_range(-500.0..500.0))).collect();
    let jitter_deg: f64 = match kind {
        Kind::WideGaussians | Kind::Ten => 0.0,
        Kind::FreeYaw => 2.0,
        _ => [0.0, 1.0, 2.0, 5.0][rng.random_range(0..4)],
    };
    let mut problem = Problem::paper(nodes, 0.5, jitter_deg.to_radians());
    problem.airspace.min_separation_m = 5.0;
    problem.free_yaw = kind == Kind::FreeYaw;
    problem.objective = match kind {
        Kind::WorstCase => Objective::WorstCase,
        Kind::Quantile | Kind::WideGaussians => Objective::Quantile,
        _ => Objective::Mean,
    };
    let discs = kind == Kind::WorstCase || rng.random_range(0..2) == 0;
    for node in &mut problem.eavesdroppers {
        node.uncertainty = match kind {
            Kind::WorstCase | Kind::Quantile if discs => {
                Uncertainty::Disc { radius_m: rng.random_range(10.0..80.0) }
            }
            Kind::WorstCase | Kind::Quantile => Uncertainty::Gaussian { std_m: rng.random_range(5.0..80.0) },
            Kind::WideGaussians => Uncertainty::Gaussian { std_m: 80.0 },
            _ => Uncertainty::None,
        };
    }
    make_real(kind, &mut problem, &mut rng);
    problem
}

/// What the paper leaves out.
fn make_real(kind: Kind, problem: &mut Problem, rng: &mut ChaCha8Rng) {
    if matches!(kind, Kind::Floors | Kind::Levels) {
        problem.antennas.i = Pattern::with_null_depth(rng.random_range(15.0..40.0));
        problem.antennas.j = Pattern::with_null_depth(rng.random_range(15.0..40.0));
    }
    match kind {
        Kind::Scattering => {
            problem.fading.user = Rician::from_db(rng.random_range(5.0..25.0));
            problem.fading.eavesdropper = Rician::from_db(rng.random_range(5.0..25.0));
        }
        Kind::Pointing => {
            problem.pointing = Pointing {
                heading_std_rad: rng.random_range(0.2f64..4.0).to_radians(),
                mounting_std_rad: rng.random_range(0.1f64..2.0).to_radians(),
                position_std_m: [rng.random_range(0.1..2.0), rng.random_range(0.1..3.0)],
            };
            let size_m = rng.random_range(0.2..4.0);
            problem.user_uncertainty = if rng.random_range(0..2) == 0 {
                Uncertainty::Disc { radius_m: size_m }
            } else {
                Uncertainty::Gaussian { std_m: size_m }
            };
        }
        Kind::Levels => {
            let count = rng.random_range(4..=8);
            let ratio = problem.radio.max_power_w.j / 1e-3;
            let most_w = problem.radio.max_power_w.j;
            let level = |k: i32| (1e-3 * ratio.powf(f64::from(k) / f64::from(count - 1))).min(most_w);
            problem.power_steps.j = PowerSteps::Levels((0..count).map(level).collect());
        }
        _ => {}
    }
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
