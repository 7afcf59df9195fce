//! The radio truth: the paper's section II, evaluated at what really is.

use nalgebra::Vector3;

use super::config::RadioConfig;
use super::receiver::Receiver;
use crate::vehicle::antenna::Pattern;

/// A transmitting vehicle at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Emitter<'a> {
    /// 0 for I, 1 for J.
    pub vehicle: usize,
    pub position_enu_m: Vector3<f64>,
    /// Of the antenna, unit length, ENU.
    pub axis: Vector3<f64>,
    pub power_w: f64,
    pub pattern: &'a Pattern,
}

/// The signal of I over the jamming of J and the noise, at a receiver (1.5).
pub(crate) fn sinr(radio: &RadioConfig, i: &Emitter, j: &Emitter, receiver: &Receiver) -> f64 {
    let b0 = radio.reference_gain;
    b0 * receiver.hears(i) / (b0 * receiver.hears(j) + radio.noise_power_w)
}

/// The secrecy rate (1.6), bit/s.
pub(crate) fn secrecy_rate_bps(
    radio: &RadioConfig,
    i: &Emitter,
    j: &Emitter,
    user: &Receiver,
    eavesdroppers: &[Receiver],
) -> f64 {
    // The logarithm is monotonic, so the strongest eavesdropper has the largest SINR.
    let heard = eavesdroppers.iter().map(|e| sinr(radio, i, j, e)).fold(0.0, f64::max);
    let rate = (1.0 + sinr(radio, i, j, user)).log2() - (1.0 + heard).log2();
    radio.bandwidth_hz * rate.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Euler, antenna_axis};
    use crate::vehicle::antenna::Antenna;

    const RADIO: RadioConfig =
        RadioConfig { bandwidth_hz: 2e6, noise_power_w: 1e-12, reference_gain: 1.0, max_power_w: [1.0; 2] };

    const DIPOLE: Pattern = Pattern::Dipole { leak: 0.0 };

    fn emitter(position: [f64; 3], roll_deg: f64, pitch_deg: f64, power_w: f64) -> Emitter<'static> {
        let attitude =
            Euler { roll_rad: roll_deg.to_radians(), pitch_rad: pitch_deg.to_radians(), yaw_rad: 0.0 }
                .rotation();
        let position_enu_m = Vector3::from(position);
        Emitter { vehicle: 0, position_enu_m, axis: antenna_axis(&attitude), power_w, pattern: &DIPOLE }
    }

    fn receiver(x: f64, y: f64, z: f64) -> Receiver {
        Receiver::at(Vector3::new(x, y, z))
    }

    #[test]
    fn val_sinr_by_hand() {
        // I at 100 m east, 100 m up, level: the line to the origin makes 45 degrees with the dipole, gain 1/2,
        // distance squared 2e4. J straight above at 100 m, rolled by 90 degrees: gain 1, distance squared 1e4.
        let (i, j) =
            (emitter([100.0, 0.0, 100.0], 0.0, 0.0, 0.4), emitter([0.0, 0.0, 100.0], 90.0, 0.0, 0.02));
        let origin = receiver(0.0, 0.0, 0.0);
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
        assert!(sinr(&RADIO, &i, &off, &receiver(-100.0, 0.0, 0.0)) < 1e-6);
        assert!((sinr(&RADIO, &i, &off, &receiver(100.0, 0.0, 0.0)) * 2e-8 - 1.0).abs() < 1e-9);
        // Roll 45 degrees points it at (0, -1, 1).
        let i = emitter([0.0, 0.0, 100.0], 45.0, 0.0, 1.0);
        assert!(sinr(&RADIO, &i, &off, &receiver(0.0, 100.0, 0.0)) < 1e-6);
    }

    #[test]
    fn val_secrecy_rate_by_hand_and_never_negative() {
        let (i, j) =
            (emitter([0.0, 0.0, 100.0], 90.0, 0.0, 1e-6), emitter([0.0, 50.0, 100.0], 0.0, 0.0, 0.0));
        let (user, near) = (receiver(0.0, 0.0, 0.0), receiver(100.0, 0.0, 100.0));
        // User: gain 1 over 1e4 m^2, SINR 100. Eavesdropper at the same distance and gain: nothing is secret.
        let far = receiver(0.0, 0.0, -100.0);
        let expected = 2e6 * (101f64.log2() - 26f64.log2());
        assert!(
            (secrecy_rate_bps(&RADIO, &i, &j, &user, std::slice::from_ref(&far)) / expected - 1.0).abs()
                < 1e-12
        );
        assert!((secrecy_rate_bps(&RADIO, &i, &j, &user, &[]) / (2e6 * 101f64.log2()) - 1.0).abs() < 1e-12);
        assert_eq!(secrecy_rate_bps(&RADIO, &i, &j, &far, std::slice::from_ref(&user)), 0.0);
        assert_eq!(secrecy_rate_bps(&RADIO, &i, &j, &user, &[far, near]), 0.0);
    }

    #[test]
    fn val_a_leaking_jammer_is_heard_by_the_user_in_its_null() {
        // Straight above at 100 m and level: of 0.02 W over 1e4 m^2, a hundredth and a half come down at 20 and 3 dB.
        let i = emitter([100.0, 0.0, 100.0], 0.0, 0.0, 0.4);
        for (depth_db, share) in [(20.0, 0.01), (10.0 * 2f64.log10(), 0.5)] {
            let leaking = Pattern::new(&Antenna::NullDepth { depth_db });
            let j = Emitter { pattern: &leaking, ..emitter([0.0, 0.0, 100.0], 0.0, 0.0, 0.02) };
            let expected = 1e-5 / (2e-6 * share + 1e-12);
            assert!((sinr(&RADIO, &i, &j, &receiver(0.0, 0.0, 0.0)) / expected - 1.0).abs() < 1e-12);
        }
    }
}
