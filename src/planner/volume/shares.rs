//! How a superframe's slots are shared out, and what each user gets by that.
//!
//! With equal shares every slot has the same length, and what counts is the sum of what all users get. With the least-served
//! user first what counts is the least volume of any user: then slots are as long as makes all volumes equal, within the
//! limits of a slot's length, and no longer together than equal ones would be. With rates r, a guard time g and that volume m,
//! a slot is `max(shortest, g + m / r)` long, and m is the largest for which
//!
//! - the slots' sum is at most that of equal slots, and
//! - the longest slot, of the user with the least rate, is at most `longest`.

use super::{Fairness, Service};

/// A rate below this in nats per hertz counts as this: the volume of a user that is not served yet still rises with its rate.
const LEAST_RATE: f64 = 1e-3;

/// What the slots of a superframe are worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Shares {
    /// Each user's slot in seconds.
    pub slots_s: Vec<f64>,
    /// What counts: the sum of all volumes, or the least of them; in seconds times the unit of the rates.
    pub volume: f64,
    /// How that changes with each rate.
    pub by_rate: Vec<f64>,
    /// How the sum of all slots changes with each rate.
    pub length_by_rate: Vec<f64>,
}

/// The shares for given rates. `counts` says of whom a rate may be expected at all.
pub fn shares(service: &Service, rates: &[f64], counts: &[bool]) -> Shares {
    let air_s = service.slot_s - service.guard_s;
    match service.fairness {
        Fairness::Slots => Shares {
            slots_s: vec![service.slot_s; rates.len()],
            volume: rates.iter().map(|rate| air_s * rate.max(0.0)).sum(),
            by_rate: rates.iter().map(|rate| if *rate > 0.0 { air_s } else { 0.0 }).collect(),
            length_by_rate: vec![0.0; rates.len()],
        },
        Fairness::MaxMin => least_first(service, rates, counts),
    }
}

fn least_first(service: &Service, rates: &[f64], counts: &[bool]) -> Shares {
    let n = rates.len();
    let (guard_s, [shortest_s, longest_s]) = (service.guard_s, service.slot_limits_s);
    let mut out = Shares {
        slots_s: vec![shortest_s; n],
        volume: 0.0,
        by_rate: vec![0.0; n],
        length_by_rate: vec![0.0; n],
    };
    let rate = |user: usize| rates[user].max(LEAST_RATE);
    let rises = |user: usize| if rates[user] > LEAST_RATE { 1.0 } else { 0.0 };
    let mut active: Vec<usize> = (0..n).filter(|user| counts[*user]).collect();
    let Some(&least) = active.iter().min_by(|a, b| rate(**a).total_cmp(&rate(**b))) else { return out };
    let all_s = n as f64 * service.slot_s;
    // Whose slot is the shortest anyway leaves the others less, and they may be next.
    let (mut volume, mut inverse);
    loop {
        inverse = active.iter().map(|user| 1.0 / rate(*user)).sum::<f64>();
        let left_s = all_s - (n - active.len()) as f64 * shortest_s - active.len() as f64 * guard_s;
        volume = left_s / inverse;
        let before = active.len();
        active.retain(|user| *user == least || guard_s + volume / rate(*user) >= shortest_s);
        if active.len() == before {
            break;
        }
    }
    let most = (longest_s - guard_s) * rate(least);
    if volume < most {
        out.volume = volume;
        for user in active {
            out.slots_s[user] = guard_s + volume / rate(user);
            out.by_rate[user] = rises(user) * volume / (rate(user) * rate(user) * inverse);
        }
        return out;
    }
    // The least served has the longest slot; the others need no more than makes their volumes equal.
    out.volume = most;
    out.by_rate[least] = rises(least) * (longest_s - guard_s);
    for user in (0..n).filter(|user| counts[*user]) {
        let slot_s = guard_s + most / rate(user);
        if slot_s > shortest_s {
            out.slots_s[user] = slot_s.min(longest_s);
            if user != least {
                out.length_by_rate[user] -= rises(user) * most / (rate(user) * rate(user));
                out.length_by_rate[least] += out.by_rate[least] / rate(user);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn service(fairness: Fairness) -> Service {
        Service {
            slot_s: 10.0,
            guard_s: 1.0,
            settle_s: 2.0,
            slot_limits_s: [5.0, 20.0],
            fairness,
            may_reorder: true,
        }
    }

    #[test]
    fn val_equal_slots() {
        let found = shares(&service(Fairness::Slots), &[3.0, 0.0, 5.0], &[true; 3]);
        assert_eq!((found.volume, found.slots_s, found.by_rate), (72.0, vec![10.0; 3], vec![9.0, 0.0, 9.0]));
    }

    #[test]
    fn val_volumes_are_equal_where_no_limit_binds() {
        // 27 s of air in shares of 1/2 : 1/3 : 1/6 of one volume: m (1/2 + 1/3 + 1/6) = 27.
        let wide = Service { slot_limits_s: [2.0, 30.0], ..service(Fairness::MaxMin) };
        let found = shares(&wide, &[2.0, 3.0, 6.0], &[true; 3]);
        assert!((found.volume - 27.0).abs() < 1e-12);
        for (slot_s, rate) in found.slots_s.iter().zip([2.0, 3.0, 6.0]) {
            assert!(((slot_s - 1.0) * rate - 27.0).abs() < 1e-9);
        }
        assert!((found.slots_s.iter().sum::<f64>() - 30.0).abs() < 1e-9);
    }

    #[test]
    fn val_the_shortest_slot_and_the_longest_bind() {
        // Of 2 and 20: 4 s of air for the second leave 14 for the first.
        let found = shares(&service(Fairness::MaxMin), &[2.0, 20.0], &[true; 2]);
        assert_eq!((found.slots_s, found.volume), (vec![15.0, 5.0], 28.0));
        // Three of 20, one of 1: no slot is longer than 20 s.
        let found = shares(&service(Fairness::MaxMin), &[20.0, 1.0, 20.0, 20.0], &[true; 4]);
        assert_eq!((found.slots_s, found.volume), (vec![5.0, 20.0, 5.0, 5.0], 19.0));
        // Whom nobody can serve has the shortest, and does not count.
        let found = shares(&service(Fairness::MaxMin), &[3.0, 0.0], &[true, false]);
        assert_eq!((found.slots_s, found.volume), (vec![15.0, 5.0], 42.0));
    }

    proptest! {
        #[test]
        fn prop_within_the_limits_and_slopes_right(rates in prop::collection::vec(0.05..15.0f64, 1..8), step in 0.01..1.0f64) {
            let service = service(Fairness::MaxMin);
            let counts = vec![true; rates.len()];
            let found = shares(&service, &rates, &counts);
            let sum: f64 = found.slots_s.iter().sum();
            prop_assert!(sum <= 10.0 * rates.len() as f64 + 1e-9);
            for (slot_s, rate) in found.slots_s.iter().zip(&rates) {
                prop_assert!((5.0 - 1e-9..=20.0 + 1e-9).contains(slot_s));
                prop_assert!((slot_s - 1.0) * rate >= found.volume - 1e-9);
            }
            // A better rate of anybody never lowers the least volume.
            for user in 0..rates.len() {
                let at = |by: f64| {
                    let mut rates = rates.clone();
                    rates[user] += by;
                    let found = shares(&service, &rates, &counts);
                    (found.volume, found.slots_s.iter().sum::<f64>())
                };
                prop_assert!(at(step).0 >= found.volume - 1e-9);
                // Away from where another limit comes to bind the slopes are those of differences.
                let (ahead, behind) = (at(1e-6), at(-1e-6));
                let smooth = |a: f64, b: f64, c: f64| (a - 2.0 * b + c).abs() < 1e-9;
                if smooth(ahead.0, found.volume, behind.0) && smooth(ahead.1, sum, behind.1) {
                    prop_assert!(((ahead.0 - behind.0) / 2e-6 - found.by_rate[user]).abs() < 1e-3 * (1.0 + found.by_rate[user].abs()));
                    prop_assert!(((ahead.1 - behind.1) / 2e-6 - found.length_by_rate[user]).abs() < 1e-3 * (1.0 + found.length_by_rate[user].abs()));
                }
            }
        }
    }
}
