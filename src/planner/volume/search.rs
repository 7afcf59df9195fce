//! The search for a superframe's poses.
//!
//! 1. *Places.* Every position of I with every one of J that the users' own plans have, each user's best attitudes there
//!    (`place`), and which user is served from which of them (`table`): all from one, all with one position of I or of J, and
//!    as each likes.
//! 2. *Climb.* The best of each kind, all variables free but for the positions that are shared, which are one. The time of a
//!    short way goes like its root: free positions never quite meet, so what is shared must be tied.
//! 3. *Again*, with the positions that were found among the places, and the order of users that is shortest for them.
//! 4. *Polish* the best by finer samples and sharper maxima, J's axis free, and settle by the ways that will be flown.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::expectation::kernel::{POWER, Raw, VEHICLE};
use super::super::expectation::sobol;
use super::super::model::Memory;
use super::super::parallel;
use super::super::problem::PowerSteps;
use super::super::solver::limited::Settings;
use super::layout::{Axes, Pattern};
use super::objective::{COARSE, Candidate, Case, FINE, MEDIUM, View, legs};
use super::place;
use super::table::{About, Among, State, choose, distinct, position};
use super::ways::{Ways, largest_s};

/// Positions of a vehicle closer than this, in metres, are one place.
const APART_M: f64 = 2.0;
/// Most positions of a vehicle that make places; of these at most so many of the users' plans, of so many others of each, and
/// over eavesdroppers.
const MOST_POSITIONS: usize = 28;
const MOST_OWN: usize = 9;
const OTHERS: usize = 2;
const MOST_OTHERS: usize = 9;
const MOST_OVER: usize = 5;
/// Random positions among them.
const RANDOM: usize = 9;
/// Pairs of positions that are looked at more closely for all users, and positions of I and of J with the best of the other's.
/// A first look tells little of what a place is worth: of few pairs the best place of all is often missing.
const PLACES: usize = 200;
const SIDES: usize = 3;
/// Places that all users share, places of I and places of J that are climbed from; the first so far apart, in metres.
const SHARED: [usize; 2] = [160, 4];
const ONE_SHARED: usize = 1;
const SCATTERED_M: f64 = 30.0;
/// Axes that are followed at each place, and at those that have been climbed to.
const FOLLOWED: [usize; 2] = [2, 12];
/// Candidates that are climbed from to the end, after some coarse steps of all, and how far apart, in metres.
const CLIMBED: usize = 25;
const CLIMBED_APART_M: f64 = 8.0;
/// Candidates that are polished.
const POLISHED: usize = 4;
const BEGIN: Settings = Settings { iterations: 30, tolerance: 1e-3, first_step: 0.5 };
const CLIMB: Settings = Settings { iterations: 60, tolerance: 1e-4, first_step: 0.5 };
const POLISH: Settings = Settings { iterations: 150, tolerance: 2e-5, first_step: 0.2 };

/// The best candidates for a superframe, best first by the largest of all times. `plans` are each user's own plans, the best
/// first.
pub fn candidates<W: Ways>(
    case: &Case<'_, W>,
    plans: &[Vec<Raw>],
    seed: u64,
    threads: usize,
) -> Vec<Candidate> {
    let users = case.setups.len();
    let mut found = Vec::new();
    let own: Vec<Raw> = plans.iter().map(|plans| plans[0]).collect();
    let listed: Vec<usize> = (0..users).collect();
    let first = order_of(case, &own, &listed);
    let mut memory = Memory::default();
    let value = case.worth(&first, COARSE, &own, &mut memory);
    found.push(Candidate { raws: own.clone(), order: first, value, converged: true });

    let mut pool = Pool::new(case, plans, seed);
    pool.fill(case, plans, threads);
    let mut climbed: Vec<Candidate> = Vec::new();
    for round in 0..2 {
        let best = found.iter().chain(&climbed).max_by(|a, b| a.value.total_cmp(&b.value)).cloned();
        let Some(best) = best else { break };
        let starts = pool.starts(case, &best, round);
        let begun = parallel::map(threads, starts.len(), |memory: &mut Memory, index| {
            climb(case, &starts[index], (COARSE, Axes::Nulled), &BEGIN, memory)
        });
        let mut begun: Vec<Candidate> = begun.into_iter().flatten().collect();
        begun.sort_by(|a, b| b.value.total_cmp(&a.value));
        let begun = scattered(begun, CLIMBED, CLIMBED_APART_M);
        let ends = parallel::map(threads, begun.len(), |memory: &mut Memory, index| {
            climb(case, &begun[index], (MEDIUM, Axes::Nulled), &CLIMB, memory)
        });
        climbed.extend(ends.into_iter().flatten());
        climbed.sort_by(|a, b| b.value.total_cmp(&a.value));
        climbed = different(climbed, POLISHED);
        if round == 0 {
            pool.widen(case, &climbed, plans, threads);
        }
    }
    found.append(&mut climbed);
    finish(case, found, threads)
}

/// The last steps, and what is left is ranked by the finest view.
fn finish<W: Ways>(case: &Case<'_, W>, mut found: Vec<Candidate>, threads: usize) -> Vec<Candidate> {
    found.sort_by(|a, b| b.value.total_cmp(&a.value));
    found.truncate(POLISHED);
    let mut ends: Vec<Candidate> = parallel::map(threads, found.len(), |memory: &mut Memory, index| {
        let mut at = climb(case, &found[index], (MEDIUM, Axes::Free), &POLISH, memory)
            .unwrap_or_else(|| found[index].clone());
        for (user, raw) in at.raws.iter_mut().enumerate() {
            *raw = possible(case, user, raw, memory);
        }
        let mut end = climb(case, &at, (FINE, Axes::Free), &POLISH, memory).unwrap_or(at);
        end.value = case.worth(&end.order, FINE, &end.raws, memory);
        end
    });
    let mut memory = Memory::default();
    for known in found {
        let value = case.worth(&known.order, FINE, &known.raws, &mut memory);
        ends.push(Candidate { value, ..known });
    }
    ends.sort_by(|a, b| b.value.total_cmp(&a.value));
    ends
}

/// A climb in which whatever is shared stays so, and once more if another order has become shorter.
fn climb<W: Ways>(
    case: &Case<'_, W>,
    from: &Candidate,
    how: (View, Axes),
    settings: &Settings,
    memory: &mut Memory,
) -> Option<Candidate> {
    let pattern = Pattern::of(&from.raws);
    let end = case.climb(from, &pattern, how, settings, memory)?;
    let order = order_of(case, &end.raws, &end.order);
    if order == end.order {
        return Some(end);
    }
    let again = Candidate { order, ..end.clone() };
    let other = case.climb(&again, &pattern, how, settings, memory);
    other.filter(|other| other.value > end.value).or(Some(end))
}

/// The shortest order for these configurations, where it may be chosen; `known` unless another is shorter.
fn order_of<W: Ways>(case: &Case<'_, W>, raws: &[Raw], known: &[usize]) -> Vec<usize> {
    let n = raws.len();
    // Round three users both ways are the same.
    if !case.service.may_reorder || n < 4 {
        return known.to_vec();
    }
    let between_s: Vec<f64> =
        raws.iter().flat_map(|from| raws.iter().map(|to| largest_s(case.ways, from, to))).collect();
    let length = |order: &[usize]| legs(order).map(|(from, to)| between_s[from * n + to]).sum::<f64>();
    let order = case.ways.shortest(n, &between_s);
    if length(&order) < length(known) - 1e-6 { order } else { known.to_vec() }
}

/// A configuration with a power of J that its transmitter can give: of several the best.
fn possible<W: Ways>(case: &Case<'_, W>, user: usize, raw: &Raw, memory: &mut Memory) -> Raw {
    let setup = &case.setups[user];
    let steps = &setup.problem.power_steps.j;
    let mut choice = vec![*raw];
    let mut with = |power_w: f64| {
        let mut other = *raw;
        other[VEHICLE + POWER] = power_w;
        choice.push(other);
    };
    match steps {
        PowerSteps::Any => return *raw,
        PowerSteps::AtLeast(_) => with(0.0),
        PowerSteps::Levels(levels_w) => {
            with(0.0);
            levels_w.iter().filter(|w| **w <= setup.highest_w[1]).for_each(|w| with(*w));
            choice.remove(0);
        }
    }
    let mut rated: Vec<(f64, Raw)> =
        choice.into_iter().map(|raw| (case.rate(user, MEDIUM, &raw, memory, &mut [0.0; 14]), raw)).collect();
    rated.sort_by(|a, b| b.0.total_cmp(&a.0));
    rated.first().map_or(*raw, |(_, raw)| *raw)
}

/// The best candidates that are not nearly the same.
fn different(sorted: Vec<Candidate>, most: usize) -> Vec<Candidate> {
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in sorted {
        let same = |known: &Candidate| {
            (known.value - candidate.value).abs() < 1e-4 * known.value.abs()
                && known
                    .raws
                    .iter()
                    .zip(&candidate.raws)
                    .all(|(a, b)| (0..2).all(|v| (position(a, v) - position(b, v)).norm() < APART_M))
        };
        if kept.len() < most && !kept.iter().any(same) {
            kept.push(candidate);
        }
    }
    kept
}

/// Positions of both vehicles and what each user makes of two of them.
struct Pool {
    positions: [Vec<Vector3<f64>>; 2],
    states: Vec<Vec<State>>,
    /// Users and pairs whose states are known.
    known: Vec<(usize, [usize; 2])>,
}

impl Pool {
    /// The mean of the positions of the users' own plans, these themselves, those of each user's next best plans, over
    /// eavesdroppers (of J), and a few at random.
    fn new<W: Ways>(case: &Case<'_, W>, plans: &[Vec<Raw>], seed: u64) -> Self {
        let setup = &case.setups[0];
        let [low, high] = setup.problem.airspace.altitude_m;
        let positions = [0, 1].map(|v: usize| {
            let own: Vec<Vector3<f64>> =
                plans.iter().take(MOST_OWN).map(|plans| position(&plans[0], v)).collect();
            let centre = own.iter().sum::<Vector3<f64>>() / own.len() as f64;
            let mut rng = ChaCha8Rng::seed_from_u64(sobol::mix(seed, 0x7001 + v as u64));
            let over = setup.problem.eavesdroppers.iter().take(if v == 0 { 0 } else { MOST_OVER });
            let over: Vec<_> = over
                .map(|e| setup.allowed(Vector3::new(e.position_enu_m.x, e.position_enu_m.y, low)))
                .collect();
            let random: Vec<_> = (0..RANDOM)
                .map(|k| {
                    let (x, y) = setup.uniform(&mut rng);
                    setup.outside(Vector3::new(
                        x,
                        y,
                        if (v + k).is_multiple_of(2) { low } else { rng.random_range(low..=high) },
                    ))
                })
                .collect();
            let others = (1..=OTHERS).flat_map(|k| plans.iter().filter_map(move |plans| plans.get(k)));
            let others = others.take(MOST_OTHERS).map(|raw| position(raw, v));
            let all =
                std::iter::once(setup.allowed(centre)).chain(own).chain(others).chain(over).chain(random);
            let mut all = distinct(all, APART_M);
            all.truncate(MOST_POSITIONS);
            all
        });
        Self { positions, states: vec![Vec::new(); case.setups.len()], known: Vec::new() }
    }

    /// Whether both vehicles may be there at once.
    fn is_possible<W: Ways>(&self, case: &Case<'_, W>, [i, j]: [usize; 2]) -> bool {
        let apart_m = (self.positions[0][i] - self.positions[1][j]).norm();
        apart_m >= case.setups[0].problem.airspace.min_separation_m
    }

    /// What the users make of those pairs of positions that look best: for all of them, with one position of I or of J, and for
    /// each by itself.
    fn fill<W: Ways>(&mut self, case: &Case<'_, W>, plans: &[Vec<Raw>], threads: usize) {
        let users = case.setups.len();
        let [ni, nj] = [self.positions[0].len(), self.positions[1].len()];
        let looks = parallel::map(threads, users * ni, |memory: &mut Memory, index| {
            place::rough(case, index % users, self.positions[0][index / users], &self.positions[1], memory)
        });
        let rough = |user: usize, [i, j]: [usize; 2]| looks[i * users + user][j];
        let pairs: Vec<[usize; 2]> = (0..ni)
            .flat_map(|i| (0..nj).map(move |j| [i, j]))
            .filter(|pair| self.is_possible(case, *pair))
            .collect();
        let mut wanted: Vec<(usize, [usize; 2])> = Vec::new();
        let value = |rates: &[f64]| case.worth_of(rates, 0.0);
        let mut shared: Vec<(f64, [usize; 2])> = pairs
            .iter()
            .map(|pair| (value(&(0..users).map(|user| rough(user, *pair)).collect::<Vec<_>>()), *pair))
            .collect();
        shared.sort_by(|a, b| b.0.total_cmp(&a.0));
        // The best of all, and of every position with any: what looks best at first often is one basin.
        let mut seen = [vec![false; ni], vec![false; nj]];
        for (rank, (_, pair)) in shared.iter().enumerate() {
            let is_new = !seen[0][pair[0]] || !seen[1][pair[1]];
            if rank < PLACES || is_new {
                (seen[0][pair[0]], seen[1][pair[1]]) = (true, true);
                wanted.extend((0..users).map(|user| (user, *pair)));
            }
        }
        let best_of = |user: usize, holds: &dyn Fn([usize; 2]) -> bool| {
            let own = pairs.iter().filter(|pair| holds(**pair));
            own.copied().max_by(|a, b| rough(user, *a).total_cmp(&rough(user, *b)))
        };
        for (v, n) in [ni, nj].into_iter().enumerate() {
            let mut sides: Vec<(f64, Vec<[usize; 2]>)> = (0..n)
                .filter_map(|at| {
                    let own: Option<Vec<[usize; 2]>> =
                        (0..users).map(|user| best_of(user, &|pair| pair[v] == at)).collect();
                    let own = own?;
                    let rates: Vec<f64> =
                        own.iter().enumerate().map(|(user, pair)| rough(user, *pair)).collect();
                    Some((value(&rates), own))
                })
                .collect();
            sides.sort_by(|a, b| b.0.total_cmp(&a.0));
            for (_, own) in sides.into_iter().take(SIDES) {
                wanted.extend(own.into_iter().enumerate());
            }
        }
        wanted.extend((0..users).filter_map(|user| Some((user, best_of(user, &|_| true)?))));
        self.add(case, wanted, plans, FOLLOWED[0], threads);
    }

    fn add<W: Ways>(
        &mut self,
        case: &Case<'_, W>,
        wanted: Vec<(usize, [usize; 2])>,
        plans: &[Vec<Raw>],
        followed: usize,
        threads: usize,
    ) {
        let mut new: Vec<(usize, [usize; 2])> = Vec::new();
        for entry in wanted {
            if !self.known.contains(&entry) && !new.contains(&entry) {
                new.push(entry);
            }
        }
        let placed = parallel::map(threads, new.len(), |memory: &mut Memory, index| {
            let (user, [i, j]) = new[index];
            let positions = [self.positions[0][i], self.positions[1][j]];
            place::at(case, user, positions, &plans[user][..1], followed, memory)
        });
        for (&(user, at), placed) in new.iter().zip(placed) {
            self.states[user].extend(placed.into_iter().map(|placed| State { at, placed }));
        }
        self.known.extend(new);
    }

    /// The positions that were found join the places: with each other, and one of them with what the users have.
    fn widen<W: Ways>(
        &mut self,
        case: &Case<'_, W>,
        found: &[Candidate],
        plans: &[Vec<Raw>],
        threads: usize,
    ) {
        let mut wanted: Vec<(usize, [usize; 2])> = Vec::new();
        for candidate in found {
            self.join(candidate, plans, &mut wanted);
        }
        wanted.retain(|(_, pair)| self.is_possible(case, *pair));
        self.add(case, wanted, plans, FOLLOWED[1], threads);
    }

    /// Adds the positions of a candidate, and what is to be looked at there.
    fn join(&mut self, best: &Candidate, plans: &[Vec<Raw>], wanted: &mut Vec<(usize, [usize; 2])>) {
        let users = plans.len();
        let mut ours = [Vec::new(), Vec::new()];
        for (v, ours) in ours.iter_mut().enumerate() {
            for at in distinct(best.raws.iter().map(|raw| position(raw, v)), APART_M) {
                ours.push(self.positions[v].len());
                self.positions[v].push(at);
            }
        }
        let own = |v: usize, user: usize| {
            let at = position(&plans[user][0], v);
            (0..self.positions[v].len()).find(|k| (self.positions[v][*k] - at).norm() < APART_M)
        };
        for user in 0..users {
            for &i in &ours[0] {
                wanted.extend(ours[1].iter().copied().chain(own(1, user)).map(|j| (user, [i, j])));
            }
            for &j in &ours[1] {
                wanted.extend(own(0, user).map(|i| (user, [i, j])));
            }
        }
    }

    /// The best choices of each kind, to climb from.
    fn starts<W: Ways>(&self, case: &Case<'_, W>, best: &Candidate, round: usize) -> Vec<Candidate> {
        let mut memory = Memory::default();
        let rates: Vec<f64> = best
            .raws
            .iter()
            .enumerate()
            .map(|(user, raw)| case.rate(user, COARSE, raw, &mut memory, &mut [0.0; 14]))
            .collect();
        let about = About::new(case, best.value, &rates);
        let order = &best.order;
        let take = |among: Vec<Among>, most: usize, apart_m: f64| {
            let mut all: Vec<Candidate> = among
                .into_iter()
                .filter_map(|among| choose(case, &self.states, among, order, &about))
                .collect();
            all.sort_by(|a, b| b.value.total_cmp(&a.value));
            scattered(all, most, apart_m)
        };
        let numbers = |v: usize| 0..self.positions[v].len();
        let mut out = Vec::new();
        let mut pairs: Vec<[usize; 2]> = self.known.iter().map(|(_, pair)| *pair).collect();
        pairs.sort_unstable();
        pairs.dedup();
        out.extend(take(pairs.into_iter().map(Among::Both).collect(), SHARED[round], SCATTERED_M));
        out.extend(take(numbers(0).map(Among::I).collect(), ONE_SHARED, APART_M));
        out.extend(take(numbers(1).map(Among::J).collect(), ONE_SHARED, APART_M));
        out.extend(take(vec![Among::Any], 1, APART_M));
        // What all share is found under more than one name.
        let mut distinct: Vec<Candidate> = Vec::new();
        for candidate in out {
            if !distinct.iter().any(|known| known.raws == candidate.raws) {
                distinct.push(candidate);
            }
        }
        distinct
    }
}

/// The best candidates of which no two have all their positions within a distance of each other.
fn scattered(sorted: Vec<Candidate>, most: usize, apart_m: f64) -> Vec<Candidate> {
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in sorted {
        let near = |known: &Candidate| {
            let mut pairs = known.raws.iter().zip(&candidate.raws);
            pairs.all(|(a, b)| (0..2).all(|v| (position(a, v) - position(b, v)).norm() < apart_m))
        };
        if kept.len() < most && !kept.iter().any(near) {
            kept.push(candidate);
        }
    }
    kept
}
