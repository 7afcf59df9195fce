//! Which of a few places each user is served from, and in which of a few attitudes: chosen together, by dynamic programming
//! round the superframe, so that shared, partly shared and own positions are weighed against each other in one.
//!
//! A ratio (volume over length) is not a sum, but where it is largest it is that of the sum `volume - value * length`
//! (Dinkelbach, 1967), and so it is near there: the choice is made by that sum for the value of the best candidate known.

use super::super::expectation::kernel::{Raw, VEHICLE};
use super::Fairness;
use super::objective::{Candidate, Case, legs};
use super::place::Placed;
use super::ways::{Ways, largest_s};

/// A user's configuration at one of the places.
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Numbers of I's and of J's position.
    pub at: [usize; 2],
    /// The configuration and its rate.
    pub placed: Placed,
}

/// Of which of its states a user may make use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Among {
    /// Of any.
    Any,
    /// Those with I here.
    I(usize),
    /// Those with J here.
    J(usize),
    /// Those with both here.
    Both([usize; 2]),
}

impl Among {
    fn holds(self, at: [usize; 2]) -> bool {
        match self {
            Self::Any => true,
            Self::I(i) => at[0] == i,
            Self::J(j) => at[1] == j,
            Self::Both(both) => at == both,
        }
    }
}

/// Most states of a user that are weighed against each other.
const MOST_STATES: usize = 12;

/// The best choice of a state for each user, by what they are worth about the value and the rates of `about`; `None` where a
/// user has none among those allowed.
pub fn choose<W: Ways>(
    case: &Case<'_, W>,
    states: &[Vec<State>],
    among: Among,
    order: &[usize],
    about: &About,
) -> Option<Candidate> {
    let mut allowed: Vec<Vec<&State>> =
        states.iter().map(|own| own.iter().filter(|state| among.holds(state.at)).collect()).collect();
    for own in &mut allowed {
        own.sort_by(|a, b| b.placed.rate.total_cmp(&a.placed.rate));
        own.truncate(MOST_STATES);
    }
    let first = allowed.get(*order.first()?)?;
    if allowed.iter().any(Vec::is_empty) {
        return None;
    }
    let gain = |user: usize, state: &State| about.gain(user, state.placed.rate);
    let cost: Vec<Vec<Vec<f64>>> = legs(order)
        .map(|(from, to)| {
            let row = |a: &&State| {
                let cost = |b: &&State| about.price * largest_s(case.ways, &a.placed.raw, &b.placed.raw);
                allowed[to].iter().map(cost).collect()
            };
            allowed[from].iter().map(row).collect()
        })
        .collect();
    let mut best: Option<(f64, Vec<usize>)> = None;
    for start in 0..first.len() {
        let mut sums = vec![f64::NEG_INFINITY; first.len()];
        sums[start] = gain(order[0], first[start]);
        let mut before: Vec<Vec<usize>> = Vec::new();
        for (leg, &user) in order.iter().enumerate().skip(1) {
            let mut next = vec![f64::NEG_INFINITY; allowed[user].len()];
            let mut through = vec![0; allowed[user].len()];
            for (from, sum) in sums.iter().enumerate().filter(|(_, sum)| **sum > f64::NEG_INFINITY) {
                for (to, cost) in cost[leg - 1][from].iter().enumerate() {
                    if sum - cost > next[to] {
                        (next[to], through[to]) = (sum - cost, from);
                    }
                }
            }
            for (sum, state) in next.iter_mut().zip(&allowed[user]) {
                *sum += gain(user, state);
            }
            before.push(through);
            sums = next;
        }
        let close = |end: usize| cost.get(order.len() - 1).map_or(0.0, |leg| leg[end][start]);
        for (end, sum) in sums.iter().enumerate() {
            let total = sum - close(end);
            if best.as_ref().is_none_or(|(known, _)| total > *known) {
                let mut chosen = vec![end];
                let mut at = end;
                for through in before.iter().rev() {
                    at = through[at];
                    chosen.push(at);
                }
                chosen.reverse();
                best = Some((total, chosen));
            }
        }
    }
    let (_, chosen) = best?;
    let mut raws: Vec<Raw> = vec![[0.0; 14]; states.len()];
    let mut rates = vec![0.0; states.len()];
    for (&user, &state) in order.iter().zip(&chosen) {
        raws[user] = allowed[user][state].placed.raw;
        rates[user] = allowed[user][state].placed.rate;
    }
    let transits_s = legs(order).map(|(from, to)| largest_s(case.ways, &raws[from], &raws[to])).sum();
    let value = case.worth_of(&rates, transits_s);
    Some(Candidate { raws, order: order.to_vec(), value, converged: false })
}

/// What a choice is weighed by.
#[derive(Debug, Clone)]
pub struct About {
    fairness: Fairness,
    /// What a second of transit costs.
    price: f64,
    /// What a second of service is worth.
    air_s: f64,
    /// Of the least-served user first: the superframe's length over the sum of the rates' inverses.
    scale: f64,
    counts: Vec<bool>,
}

impl About {
    /// About a value and rates.
    pub fn new<W: Ways>(case: &Case<'_, W>, value: f64, rates: &[f64]) -> Self {
        let service = case.service;
        let n = rates.len() as f64;
        let inverse: f64 = rates
            .iter()
            .zip(&case.counts)
            .filter(|(_, counts)| **counts)
            .map(|(r, _)| 1.0 / r.max(1e-3))
            .sum();
        let (price, scale) = match service.fairness {
            Fairness::Slots => (value, 0.0),
            // ln(volume) falls with the sum of the inverse rates, ln(length) rises with the transits.
            Fairness::MaxMin => (1.0, n * (service.slot_s + service.settle_s) / inverse.max(1e-12)),
        };
        Self {
            fairness: service.fairness,
            price,
            air_s: service.slot_s - service.guard_s,
            scale,
            counts: case.counts.clone(),
        }
    }

    fn gain(&self, user: usize, rate: f64) -> f64 {
        match self.fairness {
            Fairness::Slots => self.air_s * rate.max(0.0),
            Fairness::MaxMin if self.counts[user] => -self.scale / rate.max(1e-3),
            Fairness::MaxMin => 0.0,
        }
    }
}

/// Positions that are all different by at least so much, in metres.
pub fn distinct(
    positions: impl IntoIterator<Item = nalgebra::Vector3<f64>>,
    apart_m: f64,
) -> Vec<nalgebra::Vector3<f64>> {
    let mut kept: Vec<nalgebra::Vector3<f64>> = Vec::new();
    for position in positions {
        if kept.iter().all(|known| (known - position).norm() >= apart_m) {
            kept.push(position);
        }
    }
    kept
}

/// A vehicle's position in a configuration.
pub fn position(raw: &Raw, v: usize) -> nalgebra::Vector3<f64> {
    nalgebra::Vector3::from_fn(|k, _| raw[v * VEHICLE + k])
}
