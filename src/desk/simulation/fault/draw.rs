//! Faults of one flight, drawn from the laws of a fault file by the flight's seed.

use std::f64::consts::TAU;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::role::Role;

use super::drawn::Fault;
use super::file::Faults;
use super::kind::Magnitude;
use super::law::{FaultLaw, Frequency, Whom};

/// Laws draw from streams of their own, beyond those of the paths.
const FIRST_STREAM: u64 = 1000;
/// More faults of one law than this in one flight are no flight.
const MOST: usize = 1000;

/// The lengths that times are drawn from where a law gives none, in seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lengths {
    /// Of a flight as planned, from power-up to both landed.
    pub flight_s: f64,
    /// Of a slot.
    pub slot_s: f64,
}

/// The faults of the flight with this seed. Each law draws from a stream of its own, so that a law added at the end of
/// the file changes nothing in the faults of the others.
#[must_use]
pub fn draw(faults: &Faults, seed: u64, lengths: Lengths) -> Vec<Fault> {
    let each = faults.laws.iter().zip(FIRST_STREAM..);
    each.flat_map(|(law, stream)| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        let count = count(law, &mut rng, lengths.flight_s);
        (0..count).map(|_| draw_one(law, &mut rng, lengths)).collect::<Vec<_>>()
    })
    .collect()
}

fn count(law: &FaultLaw, rng: &mut ChaCha8Rng, flight_s: f64) -> usize {
    match law.frequency {
        Frequency::Once(probability) => usize::from(rng.random::<f64>() < probability),
        // A Poisson process, by its exponential gaps.
        Frequency::PerHour(rate) => {
            let mean_gap_s = 3600.0 / rate;
            let mut at_s = 0.0;
            let gaps = std::iter::repeat_with(|| {
                at_s -= mean_gap_s * (1.0 - rng.random::<f64>()).ln();
                at_s
            });
            gaps.take_while(|at_s| *at_s < flight_s).take(MOST).count()
        }
    }
}

fn draw_one(law: &FaultLaw, rng: &mut ChaCha8Rng, lengths: Lengths) -> Fault {
    // Every draw is made, wanted or not, so that fixing one value leaves the others as they were.
    let mut between = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
    let first = between([0.0, 1.0]) < 0.5;
    let whole = if law.slot.is_some() { lengths.slot_s } else { lengths.flight_s };
    let after_s = between(law.after_s.unwrap_or([0.0, whole]));
    let duration_s = between(law.duration_s.unwrap_or_default());
    let direction_rad = between([0.0, TAU]);
    let mut size = |magnitude: Magnitude, [low, high]: [f64; 2]| {
        // Each whole number of the range is as likely as any other.
        if magnitude.is_whole() { between([low, high + 1.0]).floor().min(high) } else { between([low, high]) }
    };
    let sizes = law.sizes.iter().map(|(magnitude, range)| (*magnitude, size(*magnitude, *range))).collect();
    let drawn = if first { Role::I } else { Role::J };
    Fault {
        kind: law.kind,
        roles: match law.whom {
            Whom::I => vec![Role::I],
            Whom::J => vec![Role::J],
            Whom::Either => vec![drawn],
            Whom::Both => Role::BOTH.to_vec(),
        },
        slot: law.slot,
        after: Duration::from_secs_f64(after_s),
        duration: law.duration_s.map(|_| Duration::from_secs_f64(duration_s)),
        sizes,
        direction_rad,
    }
}

#[cfg(test)]
mod tests {
    use veilwing_sitl as sim;

    use super::*;

    const LENGTHS: Lengths = Lengths { flight_s: 80.0, slot_s: 9.0 };

    fn laws(text: &str) -> Faults {
        Faults::parse("f.toml", text).unwrap()
    }

    fn all(faults: &Faults, seeds: u64) -> Vec<Fault> {
        (0..seeds).flat_map(|seed| draw(faults, seed, LENGTHS)).collect()
    }

    #[test]
    fn val_faults_are_as_frequent_as_their_law_says_and_anywhere_in_the_flight() {
        let n = 4000;
        let once = all(&laws("[[fault]]\nkind = \"link-loss\"\nprobability = 0.2\n"), n);
        let share = once.len() as f64 / n as f64;
        assert!((share - 0.2).abs() < 4.0 * (0.2 * 0.8 / n as f64).sqrt(), "{share}");
        let times: Vec<f64> = once.iter().map(|fault| fault.after.as_secs_f64()).collect();
        assert!(times.iter().all(|at| (0.0..80.0).contains(at)));
        // Uniform: mean 40, variance 80^2/12.
        let mean = times.iter().sum::<f64>() / times.len() as f64;
        assert!((mean - 40.0).abs() < 4.0 * 80.0 / (12.0 * times.len() as f64).sqrt(), "{mean}");
        let of_i = once.iter().filter(|fault| fault.roles == [Role::I]).count() as f64 / times.len() as f64;
        assert!((of_i - 0.5).abs() < 4.0 * 0.5 / (times.len() as f64).sqrt(), "{of_i}");
        // 90 an hour are 2 in 80 s, with the variance of a Poisson law.
        let poisson = all(&laws("[[fault]]\nkind = \"pilot-mode\"\nrate_per_hour = 90\n"), n);
        let mean = poisson.len() as f64 / n as f64;
        assert!((mean - 2.0).abs() < 4.0 * (2.0 / n as f64).sqrt(), "{mean}");
    }

    #[test]
    fn spec_what_is_fixed_is_not_drawn() {
        let text =
            "[[fault]]\nkind = \"wind-step\"\nvehicle = \"j\"\nslot = 2\nafter_s = 1.5\nspeed_m_s = 7\n";
        for seed in 0..20 {
            let [fault] = &draw(&laws(text), seed, LENGTHS)[..] else { panic!("one fault") };
            assert_eq!(
                (fault.after, fault.slot, &fault.roles[..]),
                (Duration::from_millis(1500), Some(2), &[Role::J][..])
            );
            let Some(sim::Fault::WindStep { vehicle: 1, mean_enu_m_s: [e, n, 0.0] }) =
                fault.in_the_world(Role::J, true)
            else {
                panic!("{fault:?}")
            };
            assert!((e.hypot(n) - 7.0).abs() < 1e-12);
        }
    }

    #[test]
    fn prop_a_law_added_at_the_end_changes_nothing_in_the_others() {
        let one = "[[fault]]\nkind = \"link-loss\"\nprobability = 0.5\nduration_s = [1, 9]\n";
        let two = format!("{one}[[fault]]\nkind = \"pilot-mode\"\n");
        for seed in 0..100 {
            let (alone, both) = (draw(&laws(one), seed, LENGTHS), draw(&laws(&two), seed, LENGTHS));
            assert_eq!(both[..alone.len()], alone[..]);
            assert_eq!(both.len(), alone.len() + 1);
        }
    }
}
