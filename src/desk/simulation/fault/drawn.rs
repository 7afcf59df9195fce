//! A fault of one flight: what happens, to whom, when, how much, and what that means to a link or to the world.

use std::time::Duration;

use veilwing_sitl as sim;

use crate::desk::simulation::index;
use crate::desk::simulation::path::Path;
use crate::role::Role;

use super::kind::{FaultKind, Magnitude};

/// A fault of one flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// What happens.
    pub kind: FaultKind,
    /// To whom: one vehicle or both. For the pair link: the directions from them.
    pub roles: Vec<Role>,
    /// With it `after` counts from vehicle I's first emission in that slot, else from the start.
    pub slot: Option<u16>,
    /// When.
    pub after: Duration,
    /// For how long; for ever without it.
    pub duration: Option<Duration>,
    /// The sizes that belong to the kind.
    pub sizes: Vec<(Magnitude, f64)>,
    /// A horizontal direction from east towards north, for the kinds that have one.
    pub direction_rad: f64,
}

impl Fault {
    fn size(&self, magnitude: Magnitude) -> f64 {
        self.sizes.iter().find(|(of, _)| *of == magnitude).map_or(0.0, |(_, size)| *size)
    }

    /// A vector of this size in the direction that was drawn: east, north, up.
    fn horizontal(&self, magnitude: Magnitude) -> [f64; 3] {
        let (sin, cos) = self.direction_rad.sin_cos();
        let size = self.size(magnitude);
        [size * cos, size * sin, 0.0]
    }

    /// The vehicle that it befalls; `None` if both.
    #[must_use]
    pub fn vehicle(&self) -> Option<Role> {
        match self.roles.as_slice() {
            [role] => Some(*role),
            _ => None,
        }
    }

    /// For the log, with whom it befalls.
    #[must_use]
    pub fn describe(&self) -> String {
        let whom = match self.vehicle() {
            Some(role) if self.kind.is_of_the_pair() => format!("from vehicle {role}"),
            Some(role) => format!("vehicle {role}"),
            None => "both vehicles".to_owned(),
        };
        format!("fault: {whom}: {}", self.what())
    }

    /// What happens, without to whom.
    #[must_use]
    pub fn what(&self) -> String {
        let lasting = self.duration.map_or(String::new(), |d| format!(" for {:.3} s", d.as_secs_f64()));
        let sizes: Vec<String> = self.sizes.iter().map(|(of, size)| format!("{of:?} {size:.3}")).collect();
        let sizes = if sizes.is_empty() { String::new() } else { format!(" ({})", sizes.join(", ")) };
        format!("{}{sizes}{lasting}", self.kind.describe())
    }

    /// What a degraded or cut link does to its datagrams; `None` for faults of anything else.
    #[must_use]
    pub fn path(&self) -> Option<Path> {
        match self.kind {
            FaultKind::PairLoss | FaultKind::LinkLoss => Some(Path::CUT),
            FaultKind::PairFrozen | FaultKind::LinkFrozen => Some(Path::FROZEN),
            FaultKind::PairDegraded | FaultKind::LinkDegraded => Some(Path {
                loss: self.size(Magnitude::Loss),
                duplication: self.size(Magnitude::Duplication),
                delay: Duration::from_secs_f64(self.size(Magnitude::Delay)),
                spread: Duration::from_secs_f64(self.size(Magnitude::Spread)),
                frozen: false,
            }),
            _ => None,
        }
    }

    /// Whether an order is addressed to all components.
    #[must_use]
    pub fn is_to_all(&self) -> bool {
        self.size(Magnitude::ToAll) > 0.0
    }

    /// How the hop to a radio behaves under the fault, or after it.
    fn manners(&self, on: bool) -> sim::Manners {
        if !on {
            return sim::Manners::default();
        }
        sim::Manners {
            loss: self.size(Magnitude::Loss),
            duplication: self.size(Magnitude::Duplication),
            delay_s: self.size(Magnitude::Delay),
            spread_s: self.size(Magnitude::Spread),
        }
    }

    /// What the world is told when the fault begins (`on`) or ends; `None` for the faults of hosts and of pair links.
    #[must_use]
    pub fn in_the_world(&self, role: Role, on: bool) -> Option<sim::Fault> {
        let vehicle = index(role);
        match self.kind {
            FaultKind::LinkLoss => Some(sim::Fault::LinkLoss { vehicle, on }),
            FaultKind::GpsLoss => Some(sim::Fault::GpsLoss { vehicle, on }),
            FaultKind::RadioCommandsDegraded => {
                let manners = self.manners(on);
                Some(sim::Fault::RadioHop { vehicle, toward: sim::Toward::Radio, manners })
            }
            FaultKind::RadioAnswersDegraded => {
                let manners = self.manners(on);
                Some(sim::Fault::RadioHop { vehicle, toward: sim::Toward::Companion, manners })
            }
            FaultKind::RadioCommandsFrozen => {
                Some(sim::Fault::RadioHopFrozen { vehicle, toward: sim::Toward::Radio, on })
            }
            FaultKind::RadioAnswersFrozen => {
                Some(sim::Fault::RadioHopFrozen { vehicle, toward: sim::Toward::Companion, on })
            }
            FaultKind::TransmitterRestart => Some(sim::Fault::TransmitterRestart { vehicle, on }),
            _ if !on => None,
            FaultKind::EstimatorReset => {
                let jump_enu_m = self.horizontal(Magnitude::Jump);
                Some(sim::Fault::EstimatorReset { vehicle, jump_enu_m })
            }
            FaultKind::ClockJump => {
                Some(sim::Fault::ClockJump { vehicle, by_s: self.size(Magnitude::ClockStep) })
            }
            FaultKind::ClockDrift => {
                Some(sim::Fault::ClockDrift { vehicle, ppm: self.size(Magnitude::ClockDrift) })
            }
            FaultKind::AutopilotRestart => Some(sim::Fault::AutopilotRestart { vehicle }),
            FaultKind::BatteryLow => {
                Some(sim::Fault::BatteryLow { vehicle, charge: self.size(Magnitude::Charge) })
            }
            FaultKind::BatteryWeak => {
                Some(sim::Fault::BatteryWeak { vehicle, times: self.size(Magnitude::Drain) })
            }
            FaultKind::BatteryLies => Some(sim::Fault::BatteryLies { vehicle }),
            FaultKind::RotorLoss => {
                Some(sim::Fault::RotorLoss { vehicle, rotor: self.size(Magnitude::Rotor) as usize })
            }
            FaultKind::TransmitterIgnoresExpiry => Some(sim::Fault::TransmitterIgnoresExpiry { vehicle }),
            FaultKind::PilotMode => Some(sim::Fault::PilotMode { vehicle }),
            FaultKind::EstimatorFailure => Some(sim::Fault::EstimatorFailure { vehicle }),
            FaultKind::TransmitterStuck => Some(sim::Fault::TransmitterStuck { vehicle }),
            FaultKind::WindStep => {
                let mean_enu_m_s = self.horizontal(Magnitude::WindSpeed);
                Some(sim::Fault::WindStep { vehicle, mean_enu_m_s })
            }
            FaultKind::CompanionKill
            | FaultKind::CompanionRestart
            | FaultKind::CompanionStop
            | FaultKind::DiskFull
            | FaultKind::DiskStall
            | FaultKind::LinkDegraded
            | FaultKind::LinkFrozen
            | FaultKind::PairLoss
            | FaultKind::PairDegraded
            | FaultKind::PairFrozen
            | FaultKind::Operator(_)
            | FaultKind::Radio(_) => None,
        }
    }
}
