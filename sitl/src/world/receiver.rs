//! Who listens: where they truly are, and what of each vehicle reaches them.

use std::time::Duration;

use nalgebra::Vector3;

use super::config::{Node, Uncertainty};
use super::radio::Emitter;
use super::roaming::Roamer;
use super::scattering::{Path, Rician};
use crate::geodesy::Origin;
use crate::random::{Noise, Purpose};
use crate::vehicle::SAMPLE;

/// Nearer than this the far field has no meaning; it bounds the SINR of a vehicle standing on a receiver.
const NEAREST_M: f64 = 0.1;

/// What kind of receiver: each kind has random streams of its own, for its places and for its paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    User,
    Eavesdropper,
}

impl Kind {
    fn places(self) -> Purpose {
        match self {
            Self::User => Purpose::Users,
            Self::Eavesdropper => Purpose::Eavesdroppers,
        }
    }

    fn paths(self) -> Purpose {
        match self {
            Self::User => Purpose::PathsToUsers,
            Self::Eavesdropper => Purpose::PathsToEavesdroppers,
        }
    }
}

/// One receiver, where it truly is.
#[derive(Debug, Clone)]
pub(crate) struct Receiver {
    pub position_enu_m: Vector3<f64>,
    /// It moves.
    roamer: Option<Roamer>,
    /// The ways from I and J, where there is scattering.
    paths: Option<[Path; 2]>,
}

impl Receiver {
    /// The receivers of a kind in one flight.
    pub fn all(nodes: &[Node], kind: Kind, fading: Option<Rician>, seed: u64) -> Vec<Self> {
        let of = |(index, node): (usize, &Node)| Self {
            position_enu_m: true_position(node, Noise::new(seed, kind.places(), index)),
            roamer: node.roams.clone().map(|roams| {
                let of_all = 2 * index + usize::from(kind == Kind::Eavesdropper);
                Roamer::new(roams, Vector3::from(node.position_enu_m), seed, of_all)
            }),
            paths: fading.map(|law| {
                [0, 1].map(|vehicle| Path::new(law, Noise::new(seed, kind.paths(), 2 * index + vehicle)))
            }),
        };
        nodes.iter().enumerate().map(of).collect()
    }

    /// The next radio sample.
    pub fn advance(&mut self, now: Duration) {
        self.paths.iter_mut().flatten().for_each(Path::advance);
        if let Some(roamer) = &mut self.roamer {
            self.position_enu_m = roamer.advance(&self.position_enu_m, SAMPLE.as_secs_f64(), now);
        }
    }

    /// What is said of it at this instant: the frame.
    pub fn report(&mut self, origin: Origin, now: Duration) -> Option<Vec<u8>> {
        self.roamer.as_mut()?.report(&self.position_enu_m, origin, now)
    }

    /// Received power over the reference gain: pattern, free space, scattering.
    pub fn hears(&self, emitter: &Emitter) -> f64 {
        let line = self.position_enu_m - emitter.position_enu_m;
        let pattern = emitter.pattern.gain(&emitter.axis, &line);
        let gain = match &self.paths {
            None => pattern,
            Some(paths) => paths[emitter.vehicle].gain(pattern, emitter.pattern.mean()),
        };
        gain * emitter.power_w / line.norm_squared().max(NEAREST_M * NEAREST_M)
    }

    /// Without scattering, here.
    #[cfg(test)]
    pub fn at(position_enu_m: Vector3<f64>) -> Self {
        Self { position_enu_m, roamer: None, paths: None }
    }
}

/// Where a node truly is, drawn once a flight.
fn true_position(node: &Node, mut noise: Noise) -> Vector3<f64> {
    let offset = match node.uncertainty {
        Uncertainty::Exact => Vector3::zeros(),
        Uncertainty::Disc { radius_m } => {
            let (r, angle) = (radius_m * noise.uniform().sqrt(), std::f64::consts::TAU * noise.uniform());
            Vector3::new(r * angle.cos(), r * angle.sin(), 0.0)
        }
        Uncertainty::Gaussian { std_m } => Vector3::new(std_m * noise.normal(), std_m * noise.normal(), 0.0),
    };
    Vector3::from(node.position_enu_m) + offset
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::antenna::{Antenna, Pattern};

    #[test]
    fn val_true_positions_follow_their_law() {
        let at = |uncertainty| Node {
            name: String::new(),
            position_enu_m: [1.0, 2.0, 3.0],
            uncertainty,
            roams: None,
        };
        let center = Vector3::new(1.0, 2.0, 3.0);
        let n = 4000;
        for kind in [Kind::User, Kind::Eavesdropper] {
            let spread = |u: Uncertainty| {
                let drawn =
                    (0..n).map(|seed| Receiver::all(&[at(u)], kind, None, seed)[0].position_enu_m - center);
                let all: Vec<f64> = drawn.map(|offset| offset.norm_squared()).collect();
                (all.iter().sum::<f64>() / n as f64, all.iter().fold(0.0f64, |a, b| a.max(*b)))
            };
            assert_eq!(spread(Uncertainty::Exact), (0.0, 0.0));
            // E r^2 = R^2/2 with variance R^4/12 on a disc; 2 s^2 with variance 4 s^4 for a Gaussian.
            let (mean, greatest) = spread(Uncertainty::Disc { radius_m: 10.0 });
            assert!((mean - 50.0).abs() < 4.0 * (1e4f64 / 12.0 / n as f64).sqrt() && greatest <= 100.0);
            let (mean, _) = spread(Uncertainty::Gaussian { std_m: 5.0 });
            assert!((mean - 50.0).abs() < 4.0 * (2500.0 / n as f64).sqrt());
        }
    }

    #[test]
    fn spec_users_and_eavesdroppers_are_drawn_apart() {
        let uncertainty = Uncertainty::Gaussian { std_m: 5.0 };
        let node = Node { name: String::new(), position_enu_m: [0.0; 3], uncertainty, roams: None };
        let nodes = [node.clone(), node];
        let place = |kind, k: usize| Receiver::all(&nodes, kind, None, 9)[k].position_enu_m;
        let all = [place(Kind::User, 0), place(Kind::User, 1), place(Kind::Eavesdropper, 0)];
        assert!(all[0] != all[1] && all[0] != all[2] && all[1] != all[2], "{all:?}");
    }

    #[test]
    fn val_paths_to_all_receivers_are_independent() {
        let law = Rician { k_db: -20.0, coherence_s: 0.0 };
        let node = Node {
            name: String::new(),
            position_enu_m: [0.0; 3],
            uncertainty: Uncertainty::Exact,
            roams: None,
        };
        let mut receivers = Receiver::all(&[node.clone(), node.clone()], Kind::User, Some(law), 3);
        receivers.extend(Receiver::all(&[node], Kind::Eavesdropper, Some(law), 3));
        let pattern = Pattern::new(&Antenna::Dipole);
        let emitters = [0, 1].map(|vehicle| Emitter {
            vehicle,
            position_enu_m: Vector3::new(0.0, 0.0, 10.0),
            axis: Vector3::x(),
            power_w: 1.0,
            pattern: &pattern,
        });
        let n = 20_000;
        let mut sums = [0.0; 6];
        let mut products = vec![0.0; 36];
        for _ in 0..n {
            receivers.iter_mut().for_each(|receiver| receiver.advance(Duration::ZERO));
            let heard: Vec<f64> =
                receivers.iter().flat_map(|r| emitters.map(|e| 100.0 * r.hears(&e))).collect();
            for (a, x) in heard.iter().enumerate() {
                sums[a] += x;
                heard.iter().enumerate().for_each(|(b, y)| products[6 * a + b] += x * y);
            }
        }
        let n = f64::from(n);
        let covariance = |a: usize, b: usize| products[6 * a + b] / n - sums[a] * sums[b] / (n * n);
        for a in 0..6 {
            for b in 0..a {
                let correlation = covariance(a, b) / (covariance(a, a) * covariance(b, b)).sqrt();
                assert!(correlation.abs() < 4.0 / n.sqrt(), "{a} {b}: {correlation}");
            }
        }
    }
}
