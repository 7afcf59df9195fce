//! The judge of turns: attitude paths by a dense dynamic programme along straight lines, bent afterwards by many random
//! changes; rates by plain Monte Carlo. And what a plan's turns are worth, and whether they keep their limits, read off the
//! plan instant by instant.
//!
//! A path on either side of the silence is a list of attitudes a fixed time apart, no further from each other than the
//! vehicle turns in that time; what it costs is the service that is lost against standing, and the silence between two paths.

use std::f64::consts::FRAC_PI_2;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::problem::Problem;
use veilwing::planner::turning::{Protected, State};
use veilwing::role::Role;

use crate::mission::Superframe;
use crate::search::turn_rad;
use crate::world::{Configuration, Look, World};

/// What is left of a silence when both are turned, in seconds: a jammer comes on, and a lease is asked for.
const READY_S: f64 = 0.2;
/// Longest path in steps, and what part of the whole turn that is.
const LONGEST: usize = 24;
const PART: f64 = 0.6;
/// Powers of J that are tried at an attitude, over the standing one.
const POWERS: [f64; 6] = [1.0, 0.6, 0.35, 0.2, 0.08, 0.02];
/// Random changes of a pair of paths, and starts of them.
const CHANGES: usize = 600;
const STARTS: usize = 3;
/// Noises by which paths are compared.
const NOISES: usize = 160;

/// Roll and pitch of I and J, and J's power.
#[derive(Debug, Clone, Copy)]
struct At {
    angles: [[f64; 2]; 2],
    power_w: f64,
}

/// One side, from the silence on backwards.
type Side = Vec<At>;

/// A change of the user.
pub struct Turn {
    sides: [Side; 2],
    silence_s: f64,
    /// Time between attitudes of a path, in seconds.
    step_s: f64,
}

pub struct Paths<'a> {
    mission: &'a Superframe,
    worlds: Vec<World>,
    looks: Vec<Look>,
    rates_rad_s: [f64; 2],
}

fn moved(x: &Configuration, at: &At) -> Configuration {
    let mut y = *x;
    for v in 0..2 {
        y.angles_rad[v][0] = at.angles[v][0];
        y.angles_rad[v][1] = at.angles[v][1];
    }
    y.power_w[1] = at.power_w;
    y
}

fn full(at: &At, v: usize, x: &Configuration) -> [f64; 3] {
    [at.angles[v][0], at.angles[v][1], x.angles_rad[v][2]]
}

impl<'a> Paths<'a> {
    pub fn new(mission: &'a Superframe, rates_rad_s: [f64; 2]) -> Self {
        let worlds: Vec<World> = mission.problems.iter().map(World::new).collect();
        let looks = worlds
            .iter()
            .enumerate()
            .map(|(k, world)| world.look([NOISES, 1], 0.0, f64::INFINITY, 311 + k as u64))
            .collect();
        Self { mission, worlds, looks, rates_rad_s }
    }

    fn rate(&self, user: usize, x: &Configuration) -> f64 {
        self.worlds[user].value(x, &self.looks[user])
    }

    /// The silence between two paths: the guard, or the turn and what a jammer and a lease take after it.
    fn silence_s(&self, xs: &[Configuration; 2], ends: [&At; 2]) -> f64 {
        let turn =
            |v: usize| turn_rad(&full(ends[0], v, &xs[0]), &full(ends[1], v, &xs[1])) / self.rates_rad_s[v];
        (turn(0).max(turn(1)) + READY_S).max(self.mission.service.guard_s)
    }

    fn standing(x: &Configuration) -> At {
        At { angles: [0, 1].map(|v: usize| [x.angles_rad[v][0], x.angles_rad[v][1]]), power_w: x.power_w[1] }
    }

    /// The best rate over a few powers of J, and that power.
    fn best_rate(&self, user: usize, x: &Configuration, at: &At) -> (f64, At) {
        let tried = POWERS.map(|share| {
            let at = At { power_w: share * x.power_w[1], ..*at };
            (self.rate(user, &moved(x, &at)), at)
        });
        tried
            .into_iter()
            .fold((f64::NEG_INFINITY, *at), |best, other| if other.0 > best.0 { other } else { best })
    }

    /// What is lost on the cheapest way to each pair of distances along straight lines towards the other user's attitudes,
    /// and that way.
    fn table(
        &self,
        user: usize,
        x: &Configuration,
        to: &Configuration,
        step_s: f64,
    ) -> Vec<Vec<(f64, Side)>> {
        let from = Self::standing(x);
        let goal = Self::standing(to);
        let standing = self.rate(user, x);
        let along = |v: usize, k: usize| {
            let (a, b) = (from.angles[v], goal.angles[v]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-9);
            let share = (k as f64 * step_s * self.rates_rad_s[v] / length).min(1.0);
            [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
        };
        let mut table: Vec<Vec<(f64, Side)>> = Vec::new();
        for i in 0..=LONGEST {
            let mut row: Vec<(f64, Side)> = Vec::new();
            for j in 0..=LONGEST {
                if i == 0 && j == 0 {
                    row.push((0.0, vec![from]));
                    continue;
                }
                let at = At { angles: [along(0, i), along(1, j)], power_w: from.power_w };
                let (rate, at) = self.best_rate(user, x, &at);
                let lost = step_s * (standing - rate).max(0.0);
                let mut before: Option<&(f64, Side)> = None;
                let diagonal = if i > 0 && j > 0 { Some(&table[i - 1][j - 1]) } else { None };
                let up = if i > 0 { Some(&table[i - 1][j]) } else { None };
                let left = if j > 0 { Some(&row[j - 1]) } else { None };
                for known in [diagonal, up, left].into_iter().flatten() {
                    if before.is_none_or(|best| known.0 < best.0) {
                        before = Some(known);
                    }
                }
                let (cost, way) = before.unwrap();
                let mut side = vec![at];
                side.extend(way);
                row.push((cost + lost, side));
            }
            table.push(row);
        }
        table
    }

    fn cost(&self, users: [usize; 2], xs: &[Configuration; 2], price: f64, turn: &Turn) -> f64 {
        let lost: f64 = (0..2)
            .map(|side| {
                let standing = self.rate(users[side], &xs[side]);
                let of = |at: &At| turn.step_s * (standing - self.rate(users[side], &moved(&xs[side], at)));
                turn.sides[side].iter().map(of).sum::<f64>()
            })
            .sum();
        lost + price * turn.silence_s
    }

    /// The best change of the user that is found, a second of the superframe being worth `price`.
    pub fn best(&self, users: [usize; 2], xs: &[Configuration; 2], price: f64, seed: u64) -> Turn {
        let mut still = Turn {
            step_s: 0.0,
            sides: [0, 1].map(|side: usize| vec![Self::standing(&xs[side])]),
            silence_s: self.silence_s(xs, [&Self::standing(&xs[0]), &Self::standing(&xs[1])]),
        };
        if still.silence_s <= self.mission.service.guard_s {
            return still;
        }
        let step_s = PART * still.silence_s / LONGEST as f64;
        still.step_s = step_s;
        let tables = [0, 1].map(|side: usize| self.table(users[side], &xs[side], &xs[1 - side], step_s));
        let cells = |side: usize| tables[side].iter().flatten().collect::<Vec<_>>();
        let (before, after) = (cells(0), cells(1));
        let mut best = (price * still.silence_s, 0, 0);
        for (a, (lost_a, way_a)) in before.iter().enumerate() {
            for (b, (lost_b, way_b)) in after.iter().enumerate() {
                if lost_a + lost_b >= best.0 {
                    continue;
                }
                let cost = lost_a + lost_b + price * self.silence_s(xs, [&way_a[0], &way_b[0]]);
                if cost < best.0 {
                    best = (cost, a, b);
                }
            }
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let begun = self.timed(xs, [before[best.1].1.clone(), after[best.2].1.clone()], step_s);
        let mut found = (self.cost(users, xs, price, &begun), begun);
        for start in 0..STARTS {
            let mut at = (found.0, [found.1.sides[0].clone(), found.1.sides[1].clone()]);
            let mut size = if start == 0 { 0.05 } else { 0.2 };
            for _ in 0..CHANGES / STARTS {
                let turn = self.timed(xs, self.bent(xs, &at.1, (size, step_s), &mut rng), step_s);
                let cost = self.cost(users, xs, price, &turn);
                if cost < at.0 {
                    at = (cost, turn.sides);
                    size *= 1.3;
                } else {
                    size = (size * 0.98).max(2e-3);
                }
            }
            if at.0 < found.0 {
                found = (at.0, self.timed(xs, at.1, step_s));
            }
        }
        found.1
    }

    fn timed(&self, xs: &[Configuration; 2], sides: [Side; 2], step_s: f64) -> Turn {
        let silence_s = self.silence_s(xs, [&sides[0][0], &sides[1][0]]);
        Turn { sides, silence_s, step_s }
    }

    /// A random change of one vehicle's path on one side, drawn back to what the vehicle can turn.
    fn bent(
        &self,
        xs: &[Configuration; 2],
        sides: &[Side; 2],
        (size, step_s): (f64, f64),
        rng: &mut ChaCha8Rng,
    ) -> [Side; 2] {
        let mut sides = [sides[0].clone(), sides[1].clone()];
        let side = rng.random_range(0..2usize);
        let standing = Self::standing(&xs[side]);
        let path = &mut sides[side];
        if path.len() < LONGEST + 4 && rng.random_range(0..8) == 0 {
            path.push(standing);
        }
        let v = rng.random_range(0..2usize);
        let by: [f64; 2] = [0; 2].map(|_| size * rng.random_range(-1.0..1.0));
        let (centre, width) = (rng.random_range(0..path.len()) as f64, rng.random_range(1.0..8.0));
        let louder = if rng.random_range(0..3) == 0 { rng.random_range(-1.0f64..1.0) } else { 0.0 };
        for (k, at) in path.iter_mut().enumerate() {
            let bump = (-((k as f64 - centre) / width).powi(2)).exp();
            for (angle, by) in at.angles[v].iter_mut().zip(by) {
                *angle = (*angle + bump * by).clamp(-FRAC_PI_2, FRAC_PI_2);
            }
            at.power_w = (at.power_w * (bump * louder).exp()).min(self.worlds[0].most_w[1]);
        }
        // From the standing attitude on: nobody turns faster than it can.
        let mut last = standing;
        for at in path.iter_mut().rev() {
            for v in 0..2 {
                let way = [0, 1].map(|c: usize| at.angles[v][c] - last.angles[v][c]);
                let length = way[0].hypot(way[1]);
                let most = self.rates_rad_s[v] * step_s;
                if length > most {
                    at.angles[v] = [0, 1].map(|c: usize| last.angles[v][c] + way[c] * most / length);
                }
            }
            last = *at;
        }
        sides
    }

    /// What standing configurations and changes deliver for each second of a superframe, bit/s/Hz, on fresh draws.
    pub fn score(
        &self,
        xs: &[Configuration],
        order: &[usize],
        turns: &[Turn],
        draws: usize,
        seed: u64,
    ) -> f64 {
        let service = &self.mission.service;
        let n = xs.len();
        let on_air_s = service.slot_s - service.guard_s;
        let mut volume = 0.0;
        for (place, &user) in order.iter().enumerate() {
            let rate = |x: &Configuration| self.worlds[user].score(x, draws, seed);
            let standing = rate(&xs[user]);
            volume += on_air_s * standing;
            for (turn, side) in [(&turns[(place + n - 1) % n], 1), (&turns[place], 0)] {
                for at in &turn.sides[side] {
                    volume -= turn.step_s * (standing - rate(&moved(&xs[user], at)));
                }
            }
        }
        let silence_s: f64 = turns.iter().map(|turn| turn.silence_s).sum();
        volume / (n as f64 * on_air_s + silence_s)
    }

    /// The same of a plan, read off it by its knots.
    pub fn score_of(&self, plan: &Protected, draws: usize, seed: u64) -> f64 {
        let mut volume = 0.0;
        for slot in &plan.slots {
            for pair in slot.knots.windows(2) {
                let Some(user) = pair[0].served else { continue };
                let lasts_s = pair[1].at_s - pair[0].at_s;
                let state = plan.at(0.5 * (pair[0].at_s + pair[1].at_s)).unwrap();
                volume += lasts_s * self.worlds[user].score(&seen(&state), draws, seed);
            }
        }
        volume / plan.superframe_s
    }
}

/// A state in the judge's terms.
fn seen(state: &State) -> Configuration {
    Configuration {
        position_m: [state.positions_enu_m.i.into(), state.positions_enu_m.j.into()],
        angles_rad: [&state.attitudes.i, &state.attitudes.j].map(|attitude| {
            let (roll, pitch, yaw) = attitude.euler();
            [roll, pitch, yaw]
        }),
        power_w: [state.tx_powers_w.i, state.tx_powers_w.j],
    }
}

/// The largest of what a plan asks over what it may, over the rate of turning, the tilt while anybody is served, the power,
/// and the guard over the silence: 1 and less keeps every limit. By the plan's states, `step_s` apart.
pub fn strain(
    problems: &[Problem],
    plan: &Protected,
    guard_s: f64,
    rates_rad_s: [f64; 2],
    step_s: f64,
) -> f64 {
    let mut worst: f64 = 0.0;
    let mut last: Option<(f64, State)> = None;
    let steps = (plan.superframe_s / step_s) as usize;
    for k in 0..=steps {
        let t_s = k as f64 * step_s;
        let Some(state) = plan.at(t_s) else {
            last = None;
            continue;
        };
        if let Some((before_s, before)) = last {
            for (v, role) in Role::BOTH.into_iter().enumerate() {
                // The chord between two quaternions keeps its accuracy where the angle is small.
                let [a, b] = [&before, &state].map(|s| s.attitudes[role].rotation().into_inner().coords);
                let chord = (a - b).norm().min((a + b).norm());
                worst = worst.max(4.0 * (0.5 * chord).asin() / (t_s - before_s) / rates_rad_s[v]);
            }
        }
        if let Some(user) = state.served {
            let problem = &problems[user];
            for role in Role::BOTH {
                let tilt = state.attitudes[role].antenna_axis().z.clamp(-1.0, 1.0).acos();
                worst = worst.max(tilt / problem.vehicles[role].max_tilt_rad.min(FRAC_PI_2));
                worst = worst.max(state.tx_powers_w[role] / problem.radio.max_power_w[role]);
            }
        } else {
            assert_eq!((state.tx_powers_w.i, state.tx_powers_w.j), (0.0, 0.0));
        }
        last = Some((t_s, state));
    }
    for slot in &plan.slots {
        worst = worst.max(guard_s / slot.silence_s);
    }
    worst
}
