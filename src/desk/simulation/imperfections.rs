//! What a mission says of its hardware and its site, told to the simulated world, which draws the truth from it by the seed
//! of each flight.

use veilwing_sitl as sim;

use crate::config::{AntennaDraft, Mission};
use crate::planner::problem;
use crate::radio::fading::Rician;
use crate::role::PerVehicle;

/// The link as it is, in the world's terms. The default is the ideal: perfect dipoles that point where they are told, no
/// scattering, users who are where they are said to be.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Imperfections {
    /// Each vehicle's antenna.
    pub antennas: PerVehicle<sim::Antenna>,
    /// The laws of each vehicle's biases, which stay what they are for a flight.
    pub errors: PerVehicle<sim::PointingErrors>,
    /// The Rician factor towards users and towards eavesdroppers, dB; `None`: nothing is scattered.
    pub rician_k_db: Towards<Option<f64>>,
    /// How well each user's position is known, in the mission's order; exactly where there is none.
    pub users: Vec<sim::Uncertainty>,
}

/// A value for each kind of receiver.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Towards<T> {
    /// For all users.
    pub user: T,
    /// For all eavesdroppers.
    pub eavesdropper: T,
}

/// A hovering vehicle sways by a good part of a wavelength in about this time, and its scattering with it.
const COHERENCE_S: f64 = 0.05;

impl Imperfections {
    /// What `mission` states. Angles and decibels are taken as stated, so that the world makes its own patterns of them.
    #[must_use]
    pub fn of(mission: &Mission) -> Self {
        let errors = sim::PointingErrors {
            heading_std_deg: mission.pointing.heading_std_rad.to_degrees(),
            mounting_std_deg: mission.pointing.mounting_std_rad.to_degrees(),
            position_std_m: mission.pointing.position_std_m,
        };
        let k_db = |law: Rician| law.is_present().then(|| 10.0 * law.factor().log10());
        Self {
            antennas: mission.antennas_as_stated().map(antenna),
            errors: PerVehicle { i: errors, j: errors },
            rician_k_db: Towards {
                user: k_db(mission.fading.user),
                eavesdropper: k_db(mission.fading.eavesdropper),
            },
            users: mission.users.iter().map(|user| uncertainty(user.uncertainty)).collect(),
        }
    }

    /// What the world scatters.
    #[must_use]
    pub(super) fn fading(&self) -> sim::Fading {
        let law = |k_db: f64| sim::Rician { k_db, coherence_s: COHERENCE_S };
        sim::Fading {
            user: self.rician_k_db.user.map(law),
            eavesdropper: self.rician_k_db.eavesdropper.map(law),
        }
    }

    /// How well the position of this user is known.
    pub(super) fn user(&self, index: usize) -> sim::Uncertainty {
        self.users.get(index).copied().unwrap_or_default()
    }
}

/// An antenna, in the world's terms.
fn antenna(stated: &AntennaDraft) -> sim::Antenna {
    match (&stated.pattern, stated.null_depth_db) {
        (Some(points), _) => sim::Antenna::Measured { gain_db: points.clone() },
        (None, Some(depth_db)) => sim::Antenna::NullDepth { depth_db },
        (None, None) => sim::Antenna::Dipole,
    }
}

/// How well a position is known, in the world's terms.
pub(super) fn uncertainty(stated: problem::Uncertainty) -> sim::Uncertainty {
    match stated {
        problem::Uncertainty::None => sim::Uncertainty::Exact,
        problem::Uncertainty::Disc { radius_m } => sim::Uncertainty::Disc { radius_m },
        problem::Uncertainty::Gaussian { std_m } => sim::Uncertainty::Gaussian { std_m },
    }
}
