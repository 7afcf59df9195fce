//! The radio truth: the paper's section II, evaluated at what really is.

use nalgebra::{UnitQuaternion, Vector3};

use super::config::{Eavesdropper, RadioConfig, Uncertainty};
use crate::frames::antenna_axis;
use crate::random::{Noise, Purpose};

/// Nearer than this the far field has no meaning; it bounds the SINR of a vehicle standing on a receiver.
const NEAREST_M: f64 = 0.1;

/// A transmitting vehicle at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Emitter {
    pub position_enu_m: Vector3<f64>,
    pub axis: Vector3<f64>,
    pub power_w: f64,
}

impl Emitter {
    pub fn new(position_enu_m: Vector3<f64>, attitude: &UnitQuaternion<f64>, power_w: f64) -> Self {
        Self { position_enu_m, axis: antenna_axis(attitude), power_w }
    }

    /// Received power over the reference gain: the dipole's pattern (1.4) and free space.
    fn reach(&self, receiver: &Vector3<f64>) -> f64 {
        let line = receiver - self.position_enu_m;
        let squared = line.norm_squared();
        let cosine_squared = if squared > 0.0 { self.axis.dot(&line).powi(2) / squared } else { 0.0 };
        (1.0 - cosine_squared).max(0.0) * self.power_w / squared.max(NEAREST_M * NEAREST_M)
    }
}

/// The signal of I over the jamming of J and the noise, at a receiver (1.5).
pub(crate) fn sinr(radio: &RadioConfig, i: &Emitter, j: &Emitter, receiver: &Vector3<f64>) -> f64 {
    let b0 = radio.reference_gain;
    b0 * i.reach(receiver) / (b0 * j.reach(receiver) + radio.noise_power_w)
}

/// The secrecy rate (1.6), bit/s.
pub(crate) fn secrecy_rate_bps(
    radio: &RadioConfig,
    i: &Emitter,
    j: &Emitter,
    user: &Vector3<f64>,
    eavesdroppers: &[Vector3<f64>],
) -> f64 {
    // The logarithm is monotonic, so the strongest eavesdropper has the largest SINR.
    let heard = eavesdroppers.iter().map(|e| sinr(radio, i, j, e)).fold(0.0, f64::max);
    let rate = (1.0 + sinr(radio, i, j, user)).log2() - (1.0 + heard).log2();
    radio.bandwidth_hz * rate.max(0.0)
}

/// Where the eavesdroppers truly are, drawn once a flight.
pub(crate) fn true_positions(eavesdroppers: &[Eavesdropper], seed: u64) -> Vec<Vector3<f64>> {
    eavesdroppers
        .iter()
        .enumerate()
        .map(|(index, e)| {
            let mut noise = Noise::new(seed, Purpose::Eavesdroppers, index);
            let offset = match e.uncertainty {
                Uncertainty::Exact => Vector3::zeros(),
                Uncertainty::Disc { radius_m } => {
                    let (r, angle) =
                        (radius_m * noise.uniform().sqrt(), std::f64::consts::TAU * noise.uniform());
                    Vector3::new(r * angle.cos(), r * angle.sin(), 0.0)
                }
                Uncertainty::Gaussian { std_m } => {
                    Vector3::new(std_m * noise.normal(), std_m * noise.normal(), 0.0)
                }
            };
            Vector3::from(e.position_enu_m) + offset
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Euler;

    const RADIO: RadioConfig =
        RadioConfig { bandwidth_hz: 2e6, noise_power_w: 1e-12, reference_gain: 1.0, max_power_w: [1.0; 2] };

    fn emitter(position: [f64; 3], roll_deg: f64, pitch_deg: f64, power_w: f64) -> Emitter {
        let attitude =
            Euler { roll_rad: roll_deg.to_radians(), pitch_rad: pitch_deg.to_radians(), yaw_rad: 0.0 }
                .rotation();
        Emitter::new(Vector3::from(position), &attitude, power_w)
    }

    #[test]
    fn val_sinr_by_hand() {
        // I at 100 m east, 100 m up, level: the line to the origin makes 45 degrees with the dipole, gain 1/2,
        // distance squared 2e4. J straight above at 100 m, rolled by 90 degrees: gain 1, distance squared 1e4.
        let (i, j) =
            (emitter([100.0, 0.0, 100.0], 0.0, 0.0, 0.4), emitter([0.0, 0.0, 100.0], 90.0, 0.0, 0.02));
        let origin = Vector3::zeros();
        let noise_only = Emitter { power_w: 0.0, ..j };
        assert!((sinr(&RADIO, &i, &noise_only, &origin) / (1e-5 / 1e-12) - 1.0).abs() < 1e-12);
        assert!((sinr(&RADIO, &i, &j, &origin) / (1e-5 / (2e-6 + 1e-12)) - 1.0).abs() < 1e-12);
        // With the null on the origin J is not heard.
        let null = emitter([0.0, 0.0, 100.0], 0.0, 0.0, 0.02);
        assert!((sinr(&RADIO, &i, &null, &origin) / 1e7 - 1.0).abs() < 1e-12);
        // A reference gain scales signal and jamming alike, not the noise.
        let faint = RadioConfig { reference_gain: 1e-4, ..RADIO };
        assert!((sinr(&faint, &i, &null, &origin) / 1e3 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn val_pitch_turns_the_axis_to_the_east() {
        // Pitch 45 degrees points the dipole at (1, 0, 1): silent along it, full across it.
        let i = emitter([0.0, 0.0, 100.0], 0.0, 45.0, 1.0);
        let off = emitter([0.0, 0.0, 200.0], 0.0, 0.0, 0.0);
        assert!(sinr(&RADIO, &i, &off, &Vector3::new(-100.0, 0.0, 0.0)) < 1e-6);
        assert!((sinr(&RADIO, &i, &off, &Vector3::new(100.0, 0.0, 0.0)) * 2e-8 - 1.0).abs() < 1e-9);
        // Roll 45 degrees points it at (0, -1, 1).
        let i = emitter([0.0, 0.0, 100.0], 45.0, 0.0, 1.0);
        assert!(sinr(&RADIO, &i, &off, &Vector3::new(0.0, 100.0, 0.0)) < 1e-6);
    }

    #[test]
    fn val_secrecy_rate_by_hand_and_never_negative() {
        let (i, j) =
            (emitter([0.0, 0.0, 100.0], 90.0, 0.0, 1e-6), emitter([0.0, 50.0, 100.0], 0.0, 0.0, 0.0));
        let (user, near) = (Vector3::zeros(), Vector3::new(100.0, 0.0, 100.0));
        // User: gain 1 over 1e4 m^2, SINR 100. Eavesdropper at the same distance and gain: nothing is secret.
        let far = Vector3::new(0.0, 0.0, -100.0);
        let expected = 2e6 * (101f64.log2() - 26f64.log2());
        assert!((secrecy_rate_bps(&RADIO, &i, &j, &user, &[far]) / expected - 1.0).abs() < 1e-12);
        assert_eq!(secrecy_rate_bps(&RADIO, &i, &j, &user, &[far, near]), 0.0);
        assert_eq!(secrecy_rate_bps(&RADIO, &i, &j, &far, &[user]), 0.0);
        assert!((secrecy_rate_bps(&RADIO, &i, &j, &user, &[]) / (2e6 * 101f64.log2()) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn val_true_positions_follow_their_law() {
        let at =
            |uncertainty| Eavesdropper { name: String::new(), position_enu_m: [1.0, 2.0, 3.0], uncertainty };
        let center = Vector3::new(1.0, 2.0, 3.0);
        let n = 4000;
        let spread = |u: Uncertainty| {
            let all: Vec<f64> =
                (0..n).map(|seed| (true_positions(&[at(u)], seed)[0] - center).norm_squared()).collect();
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
