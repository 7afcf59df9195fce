//! In which order users are served, and from which of several equally good poses: the shortest total transit.
//!
//! Places are numbered; each belongs to a user, and a user may have several (candidate poses of nearly the same
//! secrecy rate), of which one is visited, the same in every superframe. A tour starts at the pair's starting
//! positions, is flown `superframes` times over, and ends at its last place. Its length,
//! `start(first) + superframes * path + (superframes - 1) * back(last, first)`, is counted in whole nanoseconds, so that
//! sums are exact and ties (which go to the earlier place) are the same on both vehicles.

use std::time::Duration;

/// The number of users up to which the shortest tour is exact.
pub const EXACT_USERS: usize = 12;
/// Steps of dynamic programming that are affordable, about a second: more places than this are left to the heuristic.
const MAX_STEPS: u128 = 500_000_000;
/// Rounds of improvement of the heuristic beyond that; a round that finds nothing ends it.
const MAX_ROUNDS: usize = 100;

/// The users' order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Order {
    /// As listed in the mission.
    #[default]
    Listed,
    /// The order with the least total transit time: exact up to [`EXACT_USERS`] users (see
    /// [`Places::is_exact`]), a heuristic beyond.
    Shortest,
}

/// What there is to choose from.
#[derive(Debug, Clone, PartialEq)]
pub struct Places {
    /// Each user's places, by number from 0; every user has at least one.
    pub of_user: Vec<Vec<usize>>,
    /// Transit time from the start to each place; [`Duration::MAX`] where there is none.
    pub from_start: Vec<Duration>,
    /// Transit time between places, row-major (from, to); [`Duration::MAX`] where there is none.
    pub between: Vec<Duration>,
    /// How often the tour is flown, at least 1.
    pub superframes: u16,
}

/// A tour: the user and the place, in the order of visits, and its length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tour {
    /// (user, place).
    pub visits: Vec<(usize, usize)>,
    /// Total transit time.
    pub length: Duration,
}

impl Places {
    /// The best tour in the given order; `None` if there are no users or every tour has a transit that does not exist.
    #[must_use]
    pub fn tour(&self, order: Order) -> Option<Tour> {
        let users: Vec<usize> = (0..self.of_user.len()).collect();
        match order {
            Order::Listed => self.best_places(&users),
            Order::Shortest if self.is_exact() => self.held_karp(),
            Order::Shortest => self.improved(),
        }
    }

    /// Whether [`Order::Shortest`] finds the shortest tour of these places, or only a short one.
    #[must_use]
    pub fn is_exact(&self) -> bool {
        let (users, places) = (self.of_user.len(), self.from_start.len() as u128);
        let firsts = if self.superframes > 1 { places } else { 1 };
        users <= EXACT_USERS && (places * places * firsts) << users <= MAX_STEPS
    }

    /// Length of a tour over `places`; `Duration::MAX` if a transit in it does not exist.
    #[must_use]
    pub fn length(&self, places: &[usize]) -> Duration {
        let (Some(&first), Some(&last)) = (places.first(), places.last()) else { return Duration::ZERO };
        let path = places.windows(2).fold(Duration::ZERO, |sum, w| sum.saturating_add(self.leg(w[0], w[1])));
        let repeats = u32::from(self.superframes.saturating_sub(1));
        let once = self.from_start[first].saturating_add(path);
        if repeats == 0 {
            return once;
        }
        once.saturating_add(path.saturating_add(self.leg(last, first)).saturating_mul(repeats))
    }

    fn leg(&self, from: usize, to: usize) -> Duration {
        self.between[from * self.from_start.len() + to]
    }

    /// A tour's length is additive only once its first place is fixed, because of the way back. Tours of one
    /// superframe have none: there the first place is left open, which is written as all places at once.
    fn firsts(&self, of: impl Iterator<Item = usize>) -> Vec<Vec<usize>> {
        if self.superframes > 1 { of.map(|place| vec![place]).collect() } else { vec![of.collect()] }
    }

    /// The best places when the users are visited in the order of `users`: dynamic programming from visit to visit.
    fn best_places(&self, users: &[usize]) -> Option<Tour> {
        let first_user = *users.first()?;
        let mut best: Option<Tour> = None;
        for firsts in self.firsts(self.of_user[first_user].iter().copied()) {
            let mut stages: Vec<Vec<(Duration, usize)>> =
                vec![firsts.iter().map(|&place| (self.from_start[place], 0)).collect()];
            let mut places = vec![firsts];
            for &user in &users[1..] {
                let before: Vec<_> = places[places.len() - 1].iter().zip(&stages[stages.len() - 1]).collect();
                let stage = self.of_user[user].iter().map(|&to| {
                    let through = before.iter().enumerate().map(|(k, (from, (spent, _)))| {
                        (
                            spent.saturating_add(
                                self.leg(**from, to).saturating_mul(u32::from(self.superframes)),
                            ),
                            k,
                        )
                    });
                    through.min().unwrap_or((Duration::MAX, 0))
                });
                stages.push(stage.collect());
                places.push(self.of_user[user].clone());
            }
            for end in 0..places[places.len() - 1].len() {
                let mut chosen = Vec::with_capacity(users.len());
                let mut k = end;
                for (stage, places) in stages.iter().zip(&places).rev() {
                    chosen.push(places[k]);
                    k = stage[k].1;
                }
                chosen.reverse();
                self.keep_better(&mut best, users, &chosen);
            }
        }
        best
    }

    /// The shortest tour over all orders and places by dynamic programming over (set of users visited, last place)
    /// (Held and Karp, 1962): 2^users * places^2 steps.
    fn held_karp(&self) -> Option<Tour> {
        let users = self.of_user.len();
        let n = self.from_start.len();
        let mut user_of = vec![0; n];
        for (user, places) in self.of_user.iter().enumerate() {
            places.iter().for_each(|&place| user_of[place] = user);
        }
        let sets = 1usize << users;
        let mut best: Option<Tour> = None;
        for firsts in self.firsts(self.of_user.iter().flatten().copied()) {
            let mut spent = vec![Duration::MAX; sets * n];
            let mut before = vec![usize::MAX; sets * n];
            for &place in &firsts {
                spent[(1 << user_of[place]) * n + place] = self.from_start[place];
            }
            for set in 1..sets {
                for from in 0..n {
                    let so_far = spent[set * n + from];
                    if so_far == Duration::MAX {
                        continue;
                    }
                    for to in (0..n).filter(|&to| set & (1 << user_of[to]) == 0) {
                        let state = (set | (1 << user_of[to])) * n + to;
                        let leg = self.leg(from, to).saturating_mul(u32::from(self.superframes));
                        let through = so_far.saturating_add(leg);
                        if through < spent[state] {
                            spent[state] = through;
                            before[state] = from;
                        }
                    }
                }
            }
            for end in (0..n).filter(|&end| spent[(sets - 1) * n + end] < Duration::MAX) {
                let mut chosen = Vec::with_capacity(users);
                let (mut set, mut place) = (sets - 1, end);
                while place != usize::MAX {
                    chosen.push(place);
                    let previous = before[set * n + place];
                    set &= !(1 << user_of[place]);
                    place = previous;
                }
                chosen.reverse();
                let order: Vec<usize> = chosen.iter().map(|&place| user_of[place]).collect();
                self.keep_better(&mut best, &order, &chosen);
            }
        }
        best
    }

    /// For many users: the nearest neighbour's tour and the listed order over each user's first place, each improved by
    /// reversing parts (2-opt, Croes 1958) and by moving single users until neither helps; of the two the shorter; then
    /// the best places for that order.
    fn improved(&self) -> Option<Tour> {
        let first_places: Option<Vec<usize>> =
            self.of_user.iter().map(|places| places.first().copied()).collect();
        let place = first_places?;
        let length =
            |order: &[usize]| self.length(&order.iter().map(|&user| place[user]).collect::<Vec<_>>());
        let mut tours = [self.nearest_neighbour(&place), (0..place.len()).collect()];
        for order in &mut tours {
            for _ in 0..MAX_ROUNDS {
                if !(improve(order, &length, |order, i, k| order[i..=k].reverse())
                    | improve(order, &length, |order, i, k| order[i..=k].rotate_left(1))
                    | improve(order, &length, |order, i, k| order[i..=k].rotate_right(1)))
                {
                    break;
                }
            }
        }
        let [a, b] = tours;
        self.best_places(if length(&b) < length(&a) { &b } else { &a })
    }

    fn nearest_neighbour(&self, place: &[usize]) -> Vec<usize> {
        let mut left: Vec<usize> = (0..place.len()).collect();
        let mut order: Vec<usize> = Vec::with_capacity(left.len());
        while !left.is_empty() {
            let distance = |user: usize| match order.last() {
                Some(&last) => self.leg(place[last], place[user]),
                None => self.from_start[place[user]],
            };
            let nearest = (0..left.len()).min_by_key(|&k| distance(left[k])).unwrap_or(0);
            order.push(left.remove(nearest));
        }
        order
    }

    fn keep_better(&self, best: &mut Option<Tour>, users: &[usize], places: &[usize]) {
        let length = self.length(places);
        if length < best.as_ref().map_or(Duration::MAX, |tour| tour.length) {
            let visits = users.iter().copied().zip(places.iter().copied()).collect();
            *best = Some(Tour { visits, length });
        }
    }
}

/// Applies `change` to every stretch of `order` in turn and keeps what is shorter; whether anything was.
fn improve(
    order: &mut Vec<usize>,
    length: &impl Fn(&[usize]) -> Duration,
    change: impl Fn(&mut [usize], usize, usize),
) -> bool {
    let mut shortest = length(order);
    let mut improved = false;
    for i in 0..order.len() {
        for k in i + 1..order.len() {
            let mut changed = order.clone();
            change(&mut changed, i, k);
            let changed_length = length(&changed);
            if changed_length < shortest {
                shortest = changed_length;
                *order = changed;
                improved = true;
            }
        }
    }
    improved
}

#[cfg(test)]
mod tests {
    use rand::RngExt;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::schedule::testing;

    fn random_places(rng: &mut ChaCha8Rng, users: usize, places: usize, superframes: u16) -> Places {
        let n = users * places;
        // Few different values, so that ties are common; some transits do not exist.
        let mut time = || match rng.random_range(0..40u64) {
            0 => Duration::MAX,
            seconds => Duration::from_secs(seconds),
        };
        Places {
            from_start: (0..n).map(|_| time()).collect(),
            between: (0..n * n).map(|_| time()).collect(),
            of_user: (0..users).map(|user| (user * places..(user + 1) * places).collect()).collect(),
            superframes,
        }
    }

    fn permutations(n: usize) -> Vec<Vec<usize>> {
        if n == 0 {
            return vec![Vec::new()];
        }
        let insert = |rest: Vec<usize>| {
            (0..n).map(move |k| {
                let mut all = rest.clone();
                all.insert(k, n - 1);
                all
            })
        };
        permutations(n - 1).into_iter().flat_map(insert).collect()
    }

    /// The least length over all choices of places in the given orders, by enumeration.
    fn brute_force(places: &Places, orders: &[Vec<usize>]) -> Option<Duration> {
        let candidates = places.of_user[0].len();
        let users = places.of_user.len();
        let choices = candidates.pow(u32::try_from(users).unwrap());
        let lengths = orders.iter().flat_map(|order| {
            (0..choices).map(move |choice| {
                let place = |&user: &usize| {
                    places.of_user[user][choice / candidates.pow(u32::try_from(user).unwrap()) % candidates]
                };
                places.length(&order.iter().map(place).collect::<Vec<_>>())
            })
        });
        lengths.min().filter(|&length| length < Duration::MAX)
    }

    #[test]
    fn val_length_of_a_tour_counts_the_way_back() {
        let s = Duration::from_secs;
        let places = Places {
            of_user: vec![vec![0], vec![1]],
            from_start: vec![s(5), s(1)],
            between: vec![s(0), s(10), s(20), s(0)],
            superframes: 3,
        };
        // 5 + 3 * 10 + 2 * 20; 1 + 3 * 20 + 2 * 10.
        assert_eq!((places.length(&[0, 1]), places.length(&[1, 0])), (s(75), s(81)));
        assert_eq!(places.tour(Order::Shortest), Some(Tour { visits: vec![(0, 0), (1, 1)], length: s(75) }));
    }

    #[test]
    fn val_held_karp_equals_brute_force_up_to_seven_users() {
        let mut rng = testing::rng(5);
        for users in 1..=7 {
            let orders = permutations(users);
            for case in 0..12 {
                let candidates = if users <= 5 { 1 + case % 3 } else { 1 };
                let places =
                    random_places(&mut rng, users, candidates, 1 + u16::try_from(case).unwrap() % 2 * 2);
                let tour = places.tour(Order::Shortest);
                assert_eq!(tour.as_ref().map(|t| t.length), brute_force(&places, &orders), "{users} {case}");
                let listed = places.tour(Order::Listed);
                assert_eq!(listed.map(|t| t.length), brute_force(&places, &[(0..users).collect()]));
                if let Some(Tour { visits, length }) = tour {
                    assert_eq!(places.length(&visits.iter().map(|v| v.1).collect::<Vec<_>>()), length);
                    assert!(visits.iter().all(|(user, place)| places.of_user[*user].contains(place)));
                    let mut users_visited: Vec<_> = visits.iter().map(|v| v.0).collect();
                    users_visited.sort_unstable();
                    assert_eq!(users_visited, (0..users).collect::<Vec<_>>());
                }
            }
        }
    }

    #[test]
    fn spec_no_users_or_no_way_is_no_tour() {
        let mut places = random_places(&mut testing::rng(6), 3, 1, 1);
        places.from_start.fill(Duration::MAX);
        assert_eq!(places.tour(Order::Shortest), None);
        assert_eq!(places.tour(Order::Listed), None);
        let empty = Places { of_user: vec![], from_start: vec![], between: vec![], superframes: 1 };
        assert_eq!((empty.tour(Order::Shortest), empty.tour(Order::Listed)), (None, None));
    }

    /// Users on a plane: what the heuristic is meant for.
    fn scattered(rng: &mut ChaCha8Rng, users: usize) -> Places {
        let points: Vec<[f64; 2]> = (0..=users).map(|_| [rng.random(), rng.random()]).collect();
        let time =
            |a: [f64; 2], b: [f64; 2]| Duration::from_secs_f64(100.0 * (a[0] - b[0]).hypot(a[1] - b[1]));
        Places {
            of_user: (0..users).map(|user| vec![user]).collect(),
            from_start: points[1..].iter().map(|&p| time(points[0], p)).collect(),
            between: points[1..].iter().flat_map(|&p| points[1..].iter().map(move |&q| time(p, q))).collect(),
            superframes: 1,
        }
    }

    #[test]
    fn prop_the_heuristic_is_near_the_optimum_where_both_run() {
        let mut rng = testing::rng(7);
        let (mut excess, cases) = (0.0, 50);
        for _ in 0..cases {
            let places = scattered(&mut rng, 11);
            let exact = places.held_karp().unwrap().length.as_secs_f64();
            let heuristic = places.improved().unwrap().length.as_secs_f64();
            assert!(heuristic >= exact - 1e-9);
            excess += heuristic / exact - 1.0;
        }
        println!(
            "the heuristic is {:.2}% longer than the optimum on average",
            100.0 * excess / f64::from(cases)
        );
        assert!(excess / f64::from(cases) < 0.05);
    }

    #[test]
    fn prop_many_users_are_each_visited_once_and_no_longer_than_listed() {
        let mut rng = testing::rng(8);
        for _ in 0..5 {
            let places = scattered(&mut rng, 40);
            assert!(!places.is_exact());
            let (shortest, listed) =
                (places.tour(Order::Shortest).unwrap(), places.tour(Order::Listed).unwrap());
            assert!(shortest.length < listed.length / 2);
            let mut users: Vec<_> = shortest.visits.iter().map(|v| v.0).collect();
            users.sort_unstable();
            assert_eq!(users, (0..40).collect::<Vec<_>>());
        }
    }
}
